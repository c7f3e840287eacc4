//! Private Python environment with pinned packages, made by the user's own Python.
//!
//! It lives in one folder, which nothing else uses and which may be deleted at any time. It is made once and then
//! reused; nothing is installed elsewhere. Every started program has a time limit. A missing part (Python, its module
//! `venv`, the network, a wheel for this platform) is reported in one sentence and does not fail the command. If a
//! signal ends this process, the started programs are ended too ([`end_all`]).

use std::ffi::OsStr;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::options::PeerOptions;

/// Time limit of a program that should answer at once.
const ANSWER_LIMIT: Duration = Duration::from_secs(60);
/// Time limit of an installation, which downloads about 200 MB.
const INSTALL_LIMIT: Duration = Duration::from_secs(900);
/// Interval between two checks of a running program.
const POLL: Duration = Duration::from_millis(20);
/// Bytes of a program's output that are kept: the last ones.
const OUTPUT_LIMIT: usize = 4096;

/// A package and its exact version.
#[derive(Debug, Clone, Copy)]
pub struct Package {
    /// Name on the Python package index.
    pub name: &'static str,
    /// Version.
    pub version: &'static str,
}

/// Python of the environment, with `package` installed.
///
/// # Errors
/// One sentence that names the missing part.
pub fn prepare(options: &PeerOptions, package: Package, say: &(dyn Fn(&str) + Sync)) -> Result<PathBuf, String> {
    let python = python_of(&options.environment);
    if installed_version(&python, package).as_deref() == Some(package.version) {
        return Ok(python);
    }
    let system = &options.python;
    run(system, &["--version"], ANSWER_LIMIT).map_err(|why| format!("no Python: {why}"))?;
    let Package { name, version } = package;
    say(&format!("installing {name} {version} into {}", options.environment.display()));
    let folder = options.environment.as_os_str();
    run(system, &["-m".as_ref(), "venv".as_ref(), folder], ANSWER_LIMIT)
        .map_err(|why| format!("no Python environment (on Debian, install python3-venv): {why}"))?;
    let requirement = format!("{name}=={version}");
    let install = ["-m", "pip", "install", "--no-input", "--disable-pip-version-check", "-q", &requirement, "numpy"];
    run(&python, &install, INSTALL_LIMIT).map_err(|why| format!("{requirement} cannot be installed: {why}"))?;
    match installed_version(&python, package) {
        Some(found) if found == version => Ok(python),
        found => Err(format!("{requirement} was installed, but version {} is found", found.unwrap_or("none".into()))),
    }
}

/// Path of the environment's Python.
fn python_of(environment: &Path) -> PathBuf {
    if cfg!(windows) { environment.join("Scripts").join("python.exe") } else { environment.join("bin").join("python") }
}

/// Version of an installed package; `None` if the package or the environment is missing.
fn installed_version(python: &Path, package: Package) -> Option<String> {
    if !python.exists() {
        return None;
    }
    let ask = format!("import importlib.metadata as m; print(m.version('{}'))", package.name);
    run(python, &["-c", &ask], ANSWER_LIMIT).ok().map(|answer| answer.trim().to_string())
}

/// Runs a program to its end and returns its standard output.
///
/// # Errors
/// One clause: the program cannot be started, fails (with its last line of output), or exceeds `limit` and is ended.
pub fn run<S: AsRef<OsStr>>(program: &Path, arguments: &[S], limit: Duration) -> Result<String, String> {
    run_telling(program, arguments, limit, &|_| ())
}

/// Like [`run`]; while the program runs, `tell` is called with the time since its start.
///
/// # Errors
/// As [`run`].
pub fn run_telling<S: AsRef<OsStr>>(
    program: &Path,
    arguments: &[S],
    limit: Duration,
    tell: &dyn Fn(Duration),
) -> Result<String, String> {
    let name = program.display();
    let cannot = |what: &str, e: std::io::Error| format!("{name}: {what}: {e}");
    // Files instead of pipes: a program that fills a pipe would block until its time limit.
    let spool = || tempfile::tempfile().map_err(|e| cannot("no temporary file", e));
    let (mut out, mut err) = (spool()?, spool()?);
    let writer = |file: &File| file.try_clone().map(Stdio::from).map_err(|e| cannot("no temporary file", e));
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(writer(&out)?).stderr(writer(&err)?);
    let mut child = Child::spawn(&mut command).map_err(|e| cannot("cannot be started", e))?;
    let start = Instant::now();
    let status = loop {
        match child.try_wait().map_err(|e| cannot("cannot be waited for", e))? {
            Some(status) => break status,
            None if start.elapsed() >= limit => {
                child.end().map_err(|e| cannot("cannot be ended", e))?;
                return Err(format!("{name}: not finished after {} s", limit.as_secs()));
            }
            None => {
                tell(start.elapsed());
                std::thread::sleep(POLL);
            }
        }
    };
    if status.success() {
        return end_of(&mut out).map_err(|e| cannot("its output cannot be read", e));
    }
    let said = end_of(&mut err).map_err(|e| cannot("its output cannot be read", e))?;
    let last = said.lines().rev().map(str::trim).find(|line| !line.is_empty()).unwrap_or("it said nothing");
    Err(format!("{name} failed ({status}): {last}"))
}

/// Process groups of the running programs.
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends every program started by [`run`] and its child processes. No program can start while the guard lives. Call it
/// just before this process ends.
#[must_use]
pub fn end_all() -> impl Drop {
    let running = running();
    running.iter().for_each(|&group| end_group(group));
    running
}

#[cfg(unix)]
fn end_group(group: u32) {
    let group = i32::try_from(group).ok().and_then(rustix::process::Pid::from_raw);
    // The program may have ended by itself.
    let _gone = group.map(|group| rustix::process::kill_process_group(group, rustix::process::Signal::KILL));
}

#[cfg(not(unix))]
fn end_group(_: u32) {}

/// A running program, in its own process group if the system has process groups.
struct Child(std::process::Child);

impl Child {
    fn spawn(command: &mut Command) -> std::io::Result<Self> {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        // Started and registered under one lock, so that [`end_all`] misses none.
        let mut running = running();
        let child = command.spawn()?;
        running.push(child.id());
        Ok(Self(child))
    }

    fn try_wait(&mut self) -> std::io::Result<Option<ExitStatus>> {
        self.0.try_wait()
    }

    /// The program may have ended by itself; either way it is gone and reaped.
    fn end(&mut self) -> std::io::Result<()> {
        end_group(self.0.id());
        self.0.kill().and_then(|()| self.0.wait()).map(drop)
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        running().retain(|&group| group != self.0.id());
    }
}

/// The last [`OUTPUT_LIMIT`] bytes of a file.
fn end_of(file: &mut File) -> std::io::Result<String> {
    use std::io::{Read, Seek, SeekFrom};
    let bytes = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(bytes.saturating_sub(OUTPUT_LIMIT as u64)))?;
    let mut end = Vec::with_capacity(OUTPUT_LIMIT);
    file.take(OUTPUT_LIMIT as u64).read_to_end(&mut end)?;
    Ok(String::from_utf8_lossy(&end).into_owned())
}
