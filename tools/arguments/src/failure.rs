//! Failures and their exit codes.

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use supervol_files::OutputError;
use supervol_format::container::ContainerError;
use supervol_preprocess::BuildError;

use crate::terminal;

/// Whose fault it is decides the exit code.
#[derive(Debug)]
pub enum Failure {
    /// The data is wrong: 1.
    Data(String),
    /// The command is wrong: 2.
    Command(String),
    /// The machine failed us: 3.
    Machine(String),
    /// Nobody reads standard output any more: 141, as of a program that the signal ends which stands for this.
    Unread,
    /// What has been said already, with this exit code.
    Said(u8),
}

impl Failure {
    /// Prints the message and returns the exit code.
    pub fn report(self) -> ExitCode {
        ExitCode::from(self.say())
    }

    /// Prints the message; the exit code that it stands for.
    pub fn say(self) -> u8 {
        let code = self.code();
        if let Some(message) = self.message() {
            // Nobody is left to tell where standard error cannot be written either; the exit code still says it.
            let _ = writeln!(terminal::stderr(), "supervol: {message}");
        }
        code
    }

    /// The exit code that it stands for.
    pub fn code(&self) -> u8 {
        match self {
            Self::Data(_) => 1,
            Self::Command(_) => 2,
            Self::Machine(_) => 3,
            Self::Unread => 141,
            Self::Said(code) => *code,
        }
    }

    /// What is to be said; nothing to who has read enough, or has been told.
    pub fn message(&self) -> Option<&str> {
        match self {
            Self::Data(message) | Self::Command(message) | Self::Machine(message) => Some(message),
            Self::Unread | Self::Said(_) => None,
        }
    }

    /// A wrong command, with the file that holds the mistake named first, where there is one.
    pub fn named(self, file: Option<&std::path::Path>) -> Self {
        match (self, file) {
            (Self::Command(message), Some(file)) => Self::Command(format!("{}: {message}", file.display())),
            (other, _) => other,
        }
    }

    /// A wrong command.
    pub fn command(message: impl Display) -> Self {
        Self::Command(message.to_string())
    }
}

impl From<BuildError> for Failure {
    fn from(error: BuildError) -> Self {
        let message = error.to_string();
        if error.is_wrong_command() {
            Self::Command(message)
        } else if error.is_machine_failure() {
            Self::Machine(message)
        } else {
            Self::Data(message)
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        BuildError::from(error).into()
    }
}

/// A failure with a container, named by its file.
pub fn with_container(path: &std::path::Path, error: ContainerError) -> Failure {
    let is_missing = matches!(&error, ContainerError::Io { source, .. } if source.kind() == ErrorKind::NotFound);
    if is_missing && !path.exists() {
        return Failure::Command(format!("{}: there is no such file", path.display()));
    }
    if path.is_dir() {
        return Failure::Command(format!(
            "{}: expected a file, found a folder; for a folder of slices or images, run `supervol build` first",
            path.display()
        ));
    }
    BuildError::Container { path: path.into(), source: error }.into()
}

/// A failure to write to standard output or a small file.
pub fn with_output(error: std::io::Error) -> Failure {
    match error.kind() {
        ErrorKind::BrokenPipe => Failure::Unread,
        _ => Failure::Machine(format!("cannot write: {error}")),
    }
}
