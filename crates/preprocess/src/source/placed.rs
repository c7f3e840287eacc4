//! A source whose place in the world somebody knows better than its file.

use supervol_format::{Geometry, VoxelBox};

use super::{SourceError, SourceInfo, VolumeSource};

/// What is said of a volume's place; `None` leaves what the file says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Placing {
    /// World lengths between voxels.
    pub spacing: Option<[f64; 3]>,
    /// Their unit, for all three axes.
    pub unit: Option<String>,
    /// World position of the first voxel.
    pub origin: Option<[f64; 3]>,
    /// Directions of the axes, a 3x3 matrix by rows.
    pub direction: Option<[f64; 9]>,
}

/// A source that is placed elsewhere.
pub struct PlacedSource {
    source: Box<dyn VolumeSource>,
    info: SourceInfo,
}

impl PlacedSource {
    /// Places a source; the notes say that it was done.
    ///
    /// # Errors
    /// If spacings are not positive, or the directions span no volume.
    pub fn new(source: Box<dyn VolumeSource>, placing: &Placing) -> Result<Self, SourceError> {
        let mut info = source.info().clone();
        let file = info.geometry;
        let geometry = Geometry {
            spacing: placing.spacing.unwrap_or(file.spacing),
            origin: placing.origin.unwrap_or(file.origin),
            direction: placing.direction.unwrap_or(file.direction),
        };
        if let Some(defect) = geometry.defect() {
            return Err(SourceError::Options(defect));
        }
        let changed = [
            ("spacing", geometry.spacing != file.spacing),
            ("origin", geometry.origin != file.origin),
            ("direction", geometry.direction != file.direction),
        ];
        // A raw file says nothing that could be overruled.
        if info.format != "raw" {
            for (what, _) in changed.iter().filter(|(_, changed)| *changed) {
                info.notes.push(format!("the {what} was given by hand and is not the file's"));
            }
        }
        if let Some(unit) = &placing.unit {
            info.axes.iter_mut().for_each(|axis| axis.unit.clone_from(unit));
        }
        info.geometry = geometry;
        Ok(Self { source, info })
    }
}

impl VolumeSource for PlacedSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)
    }
}
