//! Inputs of commands other than volumes: small text files, and containers from standard input.

use std::io::Read;
use std::path::{Path, PathBuf};

use supervol_format::byte_source::check_is_file;
use tempfile::NamedTempFile;

use crate::failure::Failure;

/// Size limit of a scene or a camera path, about ten thousand times a usual size.
const LIMIT_BYTES: u64 = 1_000_000;
/// Name of standard input on the command line.
const STANDARD_INPUT: &str = "-";

/// Tests if the name means standard input.
pub fn is_piped(path: &Path) -> bool {
    path == Path::new(STANDARD_INPUT)
}

/// Text of a small file, or of standard input for `-`. `what` names the expected content in error messages.
///
/// # Errors
/// If the file cannot be read, is no text, or is longer than the limit of small files.
pub fn read_text(file: &Path, what: &str) -> Result<String, Failure> {
    read_text_up_to(LIMIT_BYTES, file, what)
}

/// Like [`read_text`], with a limit of bytes.
///
/// # Errors
/// If the file cannot be read, is no text, or is longer than the limit.
pub fn read_text_up_to(limit_bytes: u64, file: &Path, what: &str) -> Result<String, Failure> {
    let cannot = |e: std::io::Error| Failure::Command(format!("cannot read {what} {}: {e}", file.display()));
    let is_piped = is_piped(file);
    let opened: Box<dyn Read> = if is_piped {
        Box::new(std::io::stdin().lock())
    } else {
        check_is_file(file).map_err(cannot)?;
        Box::new(std::fs::File::open(file).map_err(cannot)?)
    };
    let mut text = String::new();
    let bytes = opened.take(limit_bytes + 1).read_to_string(&mut text).map_err(cannot)?;
    if bytes as u64 > limit_bytes {
        let at_least = || bytes as u64;
        let found =
            if is_piped { at_least() } else { std::fs::metadata(file).map_or_else(|_| at_least(), |m| m.len()) };
        let message = format!("{}: expected {what} of at most {limit_bytes} bytes, found {found}", file.display());
        return Err(Failure::Command(message));
    }
    Ok(text)
}

/// Input file of a command. Standard input is kept in a temporary file as long as this value lives.
#[derive(Debug)]
pub struct Input {
    path: PathBuf,
    _piped: Option<NamedTempFile>,
}

impl Input {
    /// The named file; for `-`, a copy of standard input in the temporary folder of the system.
    ///
    /// # Errors
    /// If standard input cannot be copied. A named file is not opened.
    pub fn named(path: &Path) -> Result<Self, Failure> {
        Self::kept_in(path, &std::env::temp_dir())
    }

    /// Like [`Self::named`], with a folder for the copy of standard input.
    ///
    /// # Errors
    /// If standard input cannot be copied. A named file is not opened.
    pub fn kept_in(path: &Path, folder: &Path) -> Result<Self, Failure> {
        if !is_piped(path) {
            return Ok(Self { path: path.into(), _piped: None });
        }
        let kept = NamedTempFile::new_in(folder).and_then(|mut file| {
            std::io::copy(&mut std::io::stdin().lock(), file.as_file_mut())?;
            Ok(file)
        });
        let kept = kept.map_err(|e| {
            Failure::Machine(format!("cannot copy standard input to a file in {}: {e}", folder.display()))
        })?;
        Ok(Self { path: kept.path().into(), _piped: Some(kept) })
    }

    /// Path to open.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// Runs a command on every input, also after failures. Failures are printed; the exit code is the greatest.
///
/// # Errors
/// If an input fails: its own failure if it is the only one, otherwise [`Failure::Reported`] after the last input. A
/// closed output ends the loop at once.
pub fn for_each(paths: &[PathBuf], run: impl Fn(&Path) -> Result<(), Failure>) -> Result<(), Failure> {
    if let [path] = paths {
        return run(path);
    }
    let mut code = 0;
    for path in paths {
        match run(path) {
            Ok(()) => {}
            Err(Failure::OutputClosed) => return Err(Failure::OutputClosed),
            Err(failure) => code = code.max(failure.print()),
        }
    }
    if code == 0 { Ok(()) } else { Err(Failure::Reported(code)) }
}
