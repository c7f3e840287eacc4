//! Commands that are executables of their own, as git and cargo have them.
//!
//! The executable is looked for beside this one, then on `PATH`. It gets the arguments of this process, unchanged. On
//! Unix it takes the place of this process, so that standard streams, signals and the exit code are its own. Elsewhere
//! this process waits for it, and ends with its exit code.

use std::env;
use std::io;
use std::path::PathBuf;
use std::process::Command;

use supervol_arguments::failure::Failure;

/// An executable, and the package that builds it.
pub struct Executable {
    name: &'static str,
    package: &'static str,
}

impl Executable {
    /// `supervol view`.
    pub const VIEW: Self = Self { name: "supervol-view", package: "supervol-viewer" };
    /// `supervol bench` and `supervol chart`.
    pub const MEASURE: Self = Self { name: "supervol-measure", package: "supervol-measure" };

    /// Runs it with the arguments of this process.
    pub fn run(&self) -> Result<(), Failure> {
        let mut command = Command::new(self.beside().unwrap_or_else(|| self.name.into()));
        command.args(env::args_os().skip(1));
        replace_process(&mut command).map_err(|error| self.failure(&error))
    }

    /// Its path, if it lies in the folder of this executable. Links to this executable are followed.
    fn beside(&self) -> Option<PathBuf> {
        let this = env::current_exe().and_then(|path| path.canonicalize()).ok()?;
        let path = this.with_file_name(format!("{}{}", self.name, env::consts::EXE_SUFFIX));
        path.is_file().then_some(path)
    }

    fn failure(&self, error: &io::Error) -> Failure {
        let Self { name, package } = self;
        if error.kind() == io::ErrorKind::NotFound {
            return Failure::Command(format!(
                "this command needs the executable `{name}`, which is neither beside `supervol` nor on PATH; build it with \
                 `cargo build --release -p {package}`"
            ));
        }
        Failure::Machine(format!("cannot start `{name}`: {error}"))
    }
}

/// The command instead of this process. Returns only if it cannot be started.
#[cfg(unix)]
fn replace_process(command: &mut Command) -> io::Result<()> {
    Err(std::os::unix::process::CommandExt::exec(command))
}

/// The command, until it ends; this process then ends with its exit code.
#[cfg(not(unix))]
fn replace_process(command: &mut Command) -> io::Result<()> {
    let status = command.status()?;
    std::process::exit(status.code().unwrap_or(3))
}
