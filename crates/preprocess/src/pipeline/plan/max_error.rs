//! The error that voxels may have in exchange for a smaller container ([`MaxError`]).
//!
//! Voxels are moved to multiples of a step ([`Quantizer`]) once, when they are read from the source; means of coarser
//! levels are moved, too. So a voxel of level 0 is within the bound of the source's voxel, and a coarser one within the
//! bound of the downsampled value. Each brick's error bound includes this. Labels are never moved: a neighbouring value
//! is another label.

use supervol_format::codec::quantize::Quantizer;
use supervol_format::container::header::Descriptor;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{ValueRange, VoxelBox};

use crate::error::BuildError;
use crate::pipeline::plan::tiles::Tile;

/// Largest allowed error of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum MaxError {
    /// No error.
    #[default]
    Exact,
    /// An error in data units.
    Value(f64),
    /// A percentage of the range of all voxels; measuring the range needs another pass over the source.
    Percent(f64),
}

impl MaxError {
    /// Text for the manifest.
    #[must_use]
    pub fn describe(self) -> String {
        match self {
            Self::Exact => "0".into(),
            Self::Value(error) => error.to_string(),
            Self::Percent(percent) => format!("{percent}%"),
        }
    }

    /// Quantizer for this error; `None` if voxels are not moved. `range_of` measures the source in stored units.
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

/// Range of all present voxels of a source, measured tile by tile.
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
