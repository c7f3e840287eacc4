//! Failures and their exit codes.

use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::process::ExitCode;

use supervol_files::OutputError;
use supervol_format::container::ContainerError;
use supervol_preprocess::BuildError;

use crate::{flags, terminal};

/// Failure of a command; its kind determines the exit code.
#[derive(Debug)]
pub enum Failure {
    /// The data is wrong: 1.
    Data(String),
    /// The command is wrong: 2.
    Command(String),
    /// The machine failed us: 3.
    Machine(String),
    /// Standard output was closed by its reader: 141, as if SIGPIPE had ended the program.
    OutputClosed,
    /// The message was printed already; only the exit code remains.
    Reported(u8),
}

impl Failure {
    /// Prints the message and returns the exit code.
    pub fn report(self) -> ExitCode {
        ExitCode::from(self.print())
    }

    /// Prints the message and returns the exit code as a number.
    pub fn print(self) -> u8 {
        let code = self.code();
        if let Some(message) = self.message() {
            // If standard error cannot be written either, the exit code still reports the failure.
            let _ = writeln!(terminal::stderr(), "supervol: {message}");
        }
        code
    }

    /// Exit code of the failure.
    pub fn code(&self) -> u8 {
        match self {
            Self::Data(_) => 1,
            Self::Command(_) => 2,
            Self::Machine(_) => 3,
            Self::OutputClosed => 141,
            Self::Reported(code) => *code,
        }
    }

    /// Message to print; `None` if it was printed already or nobody reads the output.
    pub fn message(&self) -> Option<&str> {
        match self {
            Self::Data(message) | Self::Command(message) | Self::Machine(message) => Some(message),
            Self::OutputClosed | Self::Reported(_) => None,
        }
    }

    /// Puts the file name before the message of a wrong command, if there is a file.
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
        let message = flags::message(&error);
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

/// Failure of opening or reading a container; the message names the file.
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
        ErrorKind::BrokenPipe => Failure::OutputClosed,
        _ => Failure::Machine(format!("cannot write: {error}")),
    }
}
