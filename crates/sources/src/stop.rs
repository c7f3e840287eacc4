//! Stops a build from another thread.
//!
//! A build asks before each part of its source that it reads, before each brick that it encodes, and every few hundred kilobytes where
//! it decodes or sums up whole files: several times a second. What it has finished stays, and the same build goes on with it
//! ([`supervol_preprocess::journal`]). A signal needs no asking: it ends the process, and removes what that had not finished
//! ([`supervol_files::unfinished`]).

use supervol_format::VoxelBox;
use supervol_format::canceller::Canceller;

use crate::error::SourceError;
use crate::info::SourceInfo;
use crate::source::VolumeSource;

/// # Errors
/// If somebody wants the build to stop.
pub fn check(canceller: &Canceller) -> Result<(), SourceError> {
    if canceller.is_cancelled() { Err(SourceError::Stopped) } else { Ok(()) }
}

/// A source that hands out nothing any more once somebody wants the build to stop.
pub struct Stoppable<'a> {
    /// The source that is read.
    pub source: &'a dyn VolumeSource,
    /// The request to stop.
    pub canceller: &'a Canceller,
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
