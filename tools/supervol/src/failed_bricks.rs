//! Bricks that cannot be read: the pictures that fail because of them.

use std::path::Path;

use supervol::FrameStats;
use supervol_arguments::failure::Failure;
use supervol_format::readable::counted;

/// Bricks that cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FailedBricks {
    /// They are an error.
    Refused,
    /// Their coarser parents are drawn in their place (`--allow-failed`).
    Allowed,
}

/// Fails if bricks could not be read and that is not allowed.
pub fn check_all_read(container: &Path, failed: u64, failed_bricks: FailedBricks) -> Result<(), Failure> {
    if failed == 0 || failed_bricks == FailedBricks::Allowed {
        return Ok(());
    }
    Err(Failure::Data(format!(
        "{}: {} could not be read, so the picture is wrong there; --allow-failed accepts it",
        container.display(),
        counted(failed, "brick")
    )))
}

/// Fails if no brick of the picture could be read.
pub fn check_any_read(stats: &FrameStats) -> Result<(), Failure> {
    if !stats.has_nothing_but_failures() {
        return Ok(());
    }
    let first = stats.failures.first().map_or(String::new(), |f| format!("; first error: {}: {}", f.brick, f.reason));
    Err(Failure::Data(format!(
        "cannot read any of the {} bricks that the picture needs; no picture is written{first}",
        stats.bricks_failed
    )))
}
