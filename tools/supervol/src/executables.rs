//! Commands that run in executables of their own, as in git and cargo.
//!
//! `supervol` searches the executable in its own folder, then on `PATH`, and passes its arguments unchanged. On Unix
//! the executable replaces this process, and with it takes over standard streams, signals and exit code. On other
//! systems this process waits for it, and exits with its exit code.

use std::env;
use std::io;
use std::path::PathBuf;
use std::process::Command;

use supervol_arguments::failure::Failure;

/// Executable and the package that builds it.
pub struct Executable {
    name: &'static str,
    package: &'static str,
}

impl Executable {
    /// `supervol view`.
    pub const VIEW: Self = Self { name: "supervol-view", package: "supervol-viewer" };
    /// `supervol bench` and `supervol chart`.
    pub const MEASURE: Self = Self { name: "supervol-measure", package: "supervol-measure" };

    /// Runs the executable with the arguments of this process.
    pub fn run(&self) -> Result<(), Failure> {
        let mut command = Command::new(self.beside().unwrap_or_else(|| self.name.into()));
        command.args(env::args_os().skip(1));
        replace_process(&mut command).map_err(|error| self.failure(&error))
    }

    /// Path of the executable in the folder of this executable, if it exists. Links to this executable are followed.
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

/// Replaces this process by the command. Returns only if the command cannot be started.
#[cfg(unix)]
fn replace_process(command: &mut Command) -> io::Result<()> {
    Err(std::os::unix::process::CommandExt::exec(command))
}

/// Runs the command; then this process exits with its exit code.
#[cfg(not(unix))]
fn replace_process(command: &mut Command) -> io::Result<()> {
    let status = command.status()?;
    std::process::exit(status.code().unwrap_or(3))
}
