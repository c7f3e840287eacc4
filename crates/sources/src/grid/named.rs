//! A source whose notes name options as a program does.

use supervol_format::VoxelBox;

use crate::message::OptionName;
use crate::{SourceError, SourceInfo, VolumeSource};

/// A source whose notes contain a program's names of the options, for containers and listings of that program.
pub struct NamedSource {
    source: Box<dyn VolumeSource>,
    info: SourceInfo,
}

impl std::fmt::Debug for NamedSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NamedSource").field("info", &self.info).finish_non_exhaustive()
    }
}

impl NamedSource {
    /// Replaces the options in the notes of a source by their names.
    #[must_use]
    pub fn new(source: Box<dyn VolumeSource>, name: OptionName) -> Self {
        let mut info = source.info().clone();
        info.notes.iter_mut().for_each(|note| *note = note.named(name).into());
        Self { source, info }
    }
}

impl VolumeSource for NamedSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)
    }
}
