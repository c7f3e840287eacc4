//! How far voxels may be moved to make a container smaller (`--max-error`).
//!
//! Voxels are moved to multiples of a step ([`Quantizer`]) once, as they come from the source; means in coarser levels are,
//! too. So a voxel of level 0 is within the bound of the source's, one of a coarser level within it of what it stands for,
//! and every error bound of a brick counts it. Labels are never moved: a label beside another one is another thing.

use supervol_format::codec::quantize::Quantizer;
use supervol_format::container::header::Descriptor;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{ValueRange, VoxelBox};

use crate::bricker::Tile;
use crate::error::BuildError;

/// Most by which a voxel may be off.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum MaxError {
    /// Not at all.
    #[default]
    Exact,
    /// So much, data units.
    Value(f64),
    /// This percentage of the range of all voxels; to know that, the source is read once more.
    Percent(f64),
}

impl MaxError {
    /// As the manifest says it.
    #[must_use]
    pub fn describe(self) -> String {
        match self {
            Self::Exact => "0".into(),
            Self::Value(error) => error.to_string(),
            Self::Percent(percent) => format!("{percent}%"),
        }
    }

    /// What voxels are moved to; `range_of` measures the source, stored units.
    pub(crate) fn quantizer(
        self,
        descriptor: &Descriptor,
        range_of: impl FnOnce() -> Result<ValueRange, BuildError>,
    ) -> Result<Option<Quantizer>, BuildError> {
        let stored = match self {
            Self::Exact => 0.0,
            Self::Value(error) => error / descriptor.scale.abs(),
            Self::Percent(percent) if percent > 0.0 => range_of()?.width() * percent / 100.0,
            Self::Percent(_) => 0.0,
        };
        Ok(Quantizer::within(descriptor.voxel_type, stored))
    }
}

/// Range of all present voxels of a source, tile by tile.
pub(crate) fn range_of(
    descriptor: &Descriptor,
    tiles: &[Tile],
    read: impl Fn(VoxelBox, &mut [u8]) -> Result<(), BuildError>,
) -> Result<ValueRange, BuildError> {
    let Descriptor { voxel_type, absence, ref pyramid, .. } = *descriptor;
    let mut range = ValueRange::EMPTY;
    for tile in tiles {
        let voxels = tile.voxels(pyramid.layout().core(), descriptor.dims(), 0);
        let mut bytes = vec![0; voxels.voxels() * voxel_type.bytes()];
        read(voxels, &mut bytes)?;
        let row = voxels.extent()[0] * voxel_type.bytes();
        for row in bytes.chunks_exact(row) {
            let present = voxels_as_f64(voxel_type, row).into_iter().filter(|&v| !absence.is_absent(v));
            present.for_each(|value| range.include(value));
        }
    }
    Ok(range)
}
