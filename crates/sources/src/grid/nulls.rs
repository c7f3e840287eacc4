//! Usual nulls: values such as 1e30 and -999.25 that programs write for "no data" without saying so in the file.
//!
//! A value is hidden by default only if it is certain to be a null. It is one of the usual ones; at least one voxel of
//! 1,000 has it; and it lies farther from all other values than these lie from each other. The voxels of three slices
//! decide, so that opening a file stays fast. Other programs (Surfer, OpendTect, ParaView for netCDF, GDAL) hide
//! these values, too, if they know the format.

use supervol_format::VoxelBox;
use supervol_format::voxel_type::voxels_as_f64;

use crate::cast::{index, whole};
use crate::grid::absent::AbsentSource;
use crate::{Message, ReadOption, SourceError, VolumeSource};

/// Rule for usual nulls.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Nulls {
    /// Usual nulls are absent.
    #[default]
    Hidden,
    /// They are values like others.
    Kept,
}

/// Values that programs write for "no data": Petrel and LAS, ESRI, netCDF, Surfer, VTK and MODFLOW, 16-bit grids.
const USUAL: [f64; 15] = [
    1e30,
    -1e30,
    1e20,
    1e31,
    9.969_209_968_386_869e36,
    1.701_41e38,
    1.701_411_834_604_692_3e38,
    3.402_823_466_385_288_6e38,
    -3.402_823_466_385_288_6e38,
    -999.25,
    -999.0,
    -9999.0,
    -99999.0,
    -32768.0,
    -32767.0,
];
/// Relative difference up to which a value equals a usual null: single precision and decimal texts round.
const ROUNDED: f64 = 1e-6;
/// Least share of the voxels that a null has.
const LEAST_SHARE: f64 = 0.001;
/// Least number of other values: a mask of two values has no null.
const LEAST_OTHERS: usize = 8;
/// Slices that are looked at, as shares of the slowest axis.
const SLICES: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];
/// Parts of a slice that are looked at, and most voxels of one.
const PARTS: u64 = 8;
const PART_VOXELS: u64 = 1 << 13;

/// The source with its usual null absent, if it has one for certain. A source that declares an absent value, or holds
/// labels, stays as it is.
pub(crate) fn hide(source: Box<dyn VolumeSource>) -> Result<Box<dyn VolumeSource>, SourceError> {
    let info = source.info();
    if info.nodata.is_some() || info.labels.is_some() || info.voxel_type.bytes() < 2 {
        return Ok(source);
    }
    // A damaged file is reported when it is read as a whole.
    let Ok(values) = sample(source.as_ref()) else { return Ok(source) };
    let Some(null) = null_of(&values) else { return Ok(source) };
    let mut hidden = AbsentSource::new(source, null)?;
    let what = format!("voxels of the value {null} are absent, because it is a usual null far from all others: ");
    hidden.note(Message::from(what).option(ReadOption::Nulls).text(" keeps them"));
    Ok(Box::new(hidden))
}

/// Values of some voxels of a source, scaled.
fn sample(source: &dyn VolumeSource) -> Result<Vec<f64>, SourceError> {
    let info = source.info();
    let [slowest, middle, fastest] = info.access_order.0;
    let (dims, bytes) = (info.dims.0, info.voxel_type.bytes());
    let rows = (PART_VOXELS / dims[fastest].max(1)).clamp(1, dims[middle]);
    let parts = dims[middle].div_ceil(rows).min(PARTS);
    let mut slices = SLICES.map(|share| whole::<u64>((share * dims[slowest] as f64).floor())).to_vec();
    slices.dedup();
    let (mut values, mut buffer) = (Vec::new(), Vec::new());
    for slice in slices {
        for part in 0..parts {
            let first = if parts > 1 { part * (dims[middle] - rows) / (parts - 1) } else { 0 };
            let mut voxels = VoxelBox { start: [0; 3], end: dims };
            (voxels.start[slowest], voxels.end[slowest]) = (slice, slice + 1);
            (voxels.start[middle], voxels.end[middle]) = (first, first + rows);
            voxels.end[fastest] = dims[fastest].min(PART_VOXELS);
            buffer.resize(index(dims[fastest].min(PART_VOXELS)) * index(rows) * bytes, 0);
            source.read_box(voxels, &mut buffer)?;
            let stored = voxels_as_f64(info.voxel_type, &buffer);
            values.extend(stored.into_iter().map(|value| value * info.scale + info.offset));
        }
    }
    Ok(values)
}

/// The usual null among these values, if one is certain.
fn null_of(values: &[f64]) -> Option<f64> {
    let present: Vec<f64> = values.iter().copied().filter(|value| value.is_finite()).collect();
    let is_near = |value: f64, null: f64| (value - null).abs() <= ROUNDED * null.abs();
    USUAL.into_iter().find_map(|null| {
        let exact = present.iter().copied().find(|value| is_near(*value, null))?;
        let count = present.iter().filter(|value| **value == exact).count();
        let mut others: Vec<f64> = present.iter().copied().filter(|value| *value != exact).collect();
        others.sort_by(f64::total_cmp);
        others.dedup();
        let [first, .., last] = others[..] else { return None };
        let gap = if exact < first { first - exact } else { exact - last };
        let is_frequent = count > 1 && count as f64 >= LEAST_SHARE * present.len() as f64;
        (is_frequent && others.len() >= LEAST_OTHERS && gap > last - first).then_some(exact)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(null: f64, every: usize, low: f64, high: f64) -> Vec<f64> {
        let value = |i: usize| low + (high - low) * (i % 97) as f64 / 96.0;
        (0..10_000).map(|i| if i % every == 0 { null } else { value(i) }).collect()
    }

    #[test]
    fn only_a_usual_far_and_frequent_value_is_a_null() {
        let single = |value: f64| f64::from(value as f32);
        for null in USUAL {
            let rounded = single(null);
            assert_eq!(null_of(&values(rounded, 3, 1.0, 5.0)), Some(rounded), "{null}");
        }
        // Not usual; not frequent; not far; an end of the values' own range.
        assert_eq!(null_of(&values(-1234.0, 3, 1.0, 5.0)), None);
        assert_eq!(null_of(&values(-999.25, 9_000, 1.0, 5.0)), None);
        assert_eq!(null_of(&values(-999.0, 3, 0.0, 2000.0)), None);
        assert_eq!(null_of(&values(-32768.0, 3, -30_000.0, 32_767.0)), None);
        assert_eq!(null_of(&values(-1000.0, 3, -900.0, 3000.0)), None, "air in Hounsfield units");
        // A mask of two values, and a constant.
        assert_eq!(null_of(&[-9999.0, 1.0].repeat(500)), None);
        assert_eq!(null_of(&[-9999.0; 500]), None);
        assert_eq!(null_of(&[]), None);
    }
}
