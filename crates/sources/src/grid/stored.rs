//! A source whose numbers are read as stored: without the scale, offset, unit and absent value that its file states.

use supervol_format::VoxelBox;

use crate::{SourceError, SourceInfo, VolumeSource};

/// Formats whose absent value is no attribute of the file: the user or the reader chose it.
const OWN_NODATA: [&str; 2] = ["raw", "segy"];

/// A source without the attributes that explain its numbers.
pub(crate) struct StoredSource {
    source: Box<dyn VolumeSource>,
    info: SourceInfo,
}

impl std::fmt::Debug for StoredSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("StoredSource").field("info", &self.info).finish_non_exhaustive()
    }
}

impl StoredSource {
    /// Removes scale, offset, unit and absent value from the description of a source.
    #[expect(clippy::new_ret_no_self, reason = "sources are passed as trait objects")]
    pub(crate) fn new(source: Box<dyn VolumeSource>) -> Box<dyn VolumeSource> {
        let mut info = source.info().clone();
        (info.scale, info.offset, info.unit) = (1.0, 0.0, String::new());
        if !OWN_NODATA.contains(&info.format) {
            info.nodata = None;
        }
        info.reading.push(("values", "stored".into()));
        info.notes
            .push("numbers are read as stored: scale, offset, unit and fill values of the file are ignored".into());
        Box::new(Self { source, info })
    }
}

impl VolumeSource for StoredSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)
    }
}
