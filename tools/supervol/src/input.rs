//! Small files that people write: scenes and camera paths.

use std::io::Read;
use std::path::Path;

use supervol_format::byte_source::check_is_file;

use crate::failure::Failure;

/// Most bytes of a scene or a camera path: some ten thousand times what one takes.
const LIMIT_BYTES: u64 = 1_000_000;

/// The text of a small file; `what` it should hold is said where it cannot be read.
pub fn read_text(file: &Path, what: &str) -> Result<String, Failure> {
    let cannot = |e: std::io::Error| Failure::Command(format!("cannot read {what} {}: {e}", file.display()));
    check_is_file(file).map_err(cannot)?;
    let mut text = String::new();
    let opened = std::fs::File::open(file).map_err(cannot)?;
    let bytes = opened.take(LIMIT_BYTES + 1).read_to_string(&mut text).map_err(cannot)?;
    if bytes as u64 > LIMIT_BYTES {
        let found = std::fs::metadata(file).map_or(bytes as u64, |m| m.len());
        let message = format!("{}: expected {what} of at most {LIMIT_BYTES} bytes, found {found}", file.display());
        return Err(Failure::Command(message));
    }
    Ok(text)
}
