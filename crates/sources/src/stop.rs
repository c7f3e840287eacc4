//! Stops a build from another thread.
//!
//! A build checks the canceller several times a second: before each part of its source that it reads and before each
//! brick that it encodes. While it decodes or hashes whole files, it checks every few hundred kilobytes. Finished work
//! stays on disk, and the same build continues from there (`supervol_preprocess::journal`). A signal ends the process
//! without such a check and removes its unfinished files ([`supervol_files::unfinished`]).

use supervol_format::VoxelBox;
use supervol_format::canceller::Canceller;

use crate::error::SourceError;
use crate::info::SourceInfo;
use crate::source::VolumeSource;

/// Fails if the canceller is set.
///
/// # Errors
/// [`SourceError::Stopped`] if it is.
pub fn check(canceller: &Canceller) -> Result<(), SourceError> {
    if canceller.is_cancelled() { Err(SourceError::Stopped) } else { Ok(()) }
}

/// A source whose reads fail once the canceller is set.
pub struct Stoppable<'a> {
    /// The source to read.
    pub source: &'a dyn VolumeSource,
    /// The cancel flag.
    pub canceller: &'a Canceller,
}

impl std::fmt::Debug for Stoppable<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Stoppable").field("info", self.source.info()).finish_non_exhaustive()
    }
}

impl VolumeSource for Stoppable<'_> {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        check(self.canceller)?;
        self.source.read_box(voxels, out)
    }
}
