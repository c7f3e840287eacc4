//! Stops a build from another thread.
//!
//! A build asks before each part of its source that it reads, before each brick that it encodes, and every few hundred kilobytes where
//! it decodes or sums up whole files: several times a second. What it has finished stays, and the same build goes on with it
//! ([`crate::journal`]). A signal needs no asking: it ends the process, and removes what that had not finished
//! ([`crate::output::unfinished`]).

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use supervol_format::VoxelBox;

use crate::source::{SourceError, SourceInfo, VolumeSource};

/// Stops a build. Clones stop the same one; once stopped, it stays so.
#[derive(Debug, Clone, Default)]
pub struct Stopper(Arc<AtomicBool>);

impl Stopper {
    /// The build stops soon; one that begins later does at once.
    pub fn stop(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether somebody wants the build to stop.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// # Errors
    /// If somebody wants the build to stop.
    pub(crate) fn check(&self) -> Result<(), SourceError> {
        if self.is_stopped() { Err(SourceError::Stopped) } else { Ok(()) }
    }
}

/// Options and folders that differ only in who may stop them say the same.
impl PartialEq for Stopper {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl Eq for Stopper {}

/// A source that hands out nothing any more once somebody wants the build to stop.
pub(crate) struct Stoppable<'a> {
    pub(crate) source: &'a dyn VolumeSource,
    pub(crate) stopper: &'a Stopper,
}

impl VolumeSource for Stoppable<'_> {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.stopper.check()?;
        self.source.read_box(voxels, out)
    }
}
