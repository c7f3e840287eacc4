//! Stored numbers that mean "no data": several values, and values outside a valid range.
//!
//! A container declares one absent value. A rule with more of them replaces each by this value, the marker, when voxels
//! are read. Values are stored numbers: scale and offset are not applied.

use supervol_format::voxel_type::Voxel;
use supervol_format::{VoxelBox, VoxelType, with_voxel};

use crate::cast::index;
use crate::{Message, ReadOption, SourceError, SourceInfo, VolumeSource};

/// Range of valid numbers that excludes none.
pub(crate) const ALL_VALID: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// Rule that tells absent stored numbers from present ones.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AbsentNumbers {
    voxel_type: VoxelType,
    /// Values that are absent, each a number of the type.
    values: Vec<f64>,
    /// Least and greatest number that is present.
    valid: [f64; 2],
    /// Number that replaces all absent ones; NaN if only floats outside the valid range are absent.
    marker: f64,
}

impl AbsentNumbers {
    /// Rule for numbers of a type; `None` if no number of the type is absent by it. Values that the type cannot hold are
    /// ignored.
    pub(crate) fn new(voxel_type: VoxelType, values: &[f64], valid: [f64; 2]) -> Option<Self> {
        let (least, greatest) = voxel_type.limits();
        let mut held: Vec<f64> = Vec::new();
        for value in values.iter().filter_map(|value| held_by(voxel_type, *value)) {
            if !held.contains(&value) {
                held.push(value);
            }
        }
        let is_limited = valid[0] > least || valid[1] < greatest;
        let valid = if is_limited { valid } else { ALL_VALID };
        // Floats have NaN for values outside the range; integers take a neighbour of the range.
        let neighbours = [valid[0].ceil() - 1.0, valid[1].floor() + 1.0];
        let outside = || neighbours.into_iter().find(|value| (least..=greatest).contains(value));
        let marker = match held.first() {
            Some(value) => *value,
            None if !is_limited => return None,
            None if voxel_type.is_float() => f64::NAN,
            None => outside()?,
        };
        Some(Self { voxel_type, values: held, valid, marker })
    }

    /// The absent value that a container declares.
    pub(crate) fn nodata(&self) -> Option<f64> {
        Some(self.marker).filter(|marker| !marker.is_nan())
    }

    /// Replaces absent voxels by the marker.
    pub(crate) fn mark(&self, voxels: &mut [u8]) {
        if self.values.len() < 2 && self.valid == ALL_VALID {
            return;
        }
        let [least, greatest] = self.valid;
        with_voxel!(self.voxel_type, V => {
            let marker = V::from_f64(self.marker);
            for voxel in voxels.chunks_exact_mut(size_of::<V>()) {
                let value = V::read_le(voxel).to_f64();
                if value < least || value > greatest || self.values.contains(&value) {
                    marker.write_le(voxel);
                }
            }
        });
    }
}

/// The number of a type that a value is; `None` if it is not finite or the type has no such number.
fn held_by(voxel_type: VoxelType, value: f64) -> Option<f64> {
    let held = with_voxel!(voxel_type, V => V::from_f64(value).to_f64());
    let is_held = if voxel_type.is_float() { held.is_finite() } else { held == value };
    is_held.then_some(held)
}

/// Columns along z that are absent: places of a survey without a trace.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct AbsentColumns {
    /// Whether there is a column, x fastest.
    live: Vec<bool>,
    width: usize,
    voxel_type: VoxelType,
    marker: f64,
}

impl AbsentColumns {
    /// Columns of a volume, if some are absent. Integers without an absent value cannot mark them; a note says so.
    pub(crate) fn of(live: Option<Vec<bool>>, info: &SourceInfo, notes: &mut Vec<Message>) -> Option<Self> {
        let live = live.filter(|live| live.iter().any(|live| !live))?;
        let missing = live.iter().filter(|live| !**live).count();
        let marker = match info.nodata {
            Some(nodata) => nodata,
            None if info.voxel_type.is_float() => f64::NAN,
            None => {
                let what = format!("{missing} places of the grid have no trace; their voxels are as stored: ");
                notes.push(Message::from(what).option(ReadOption::Nodata).text(" makes them absent"));
                return None;
            }
        };
        notes.push(format!("{missing} places of the grid have no trace; their voxels are absent").into());
        Some(Self { live, width: index(info.dims.0[0]), voxel_type: info.voxel_type, marker })
    }

    /// Marks the absent voxels of a box.
    pub(crate) fn mark(&self, voxels: VoxelBox, out: &mut [u8]) {
        let [nx, ny, _] = voxels.extent();
        let [x0, y0, _] = voxels.start.map(index);
        with_voxel!(self.voxel_type, V => {
            let marker = V::from_f64(self.marker);
            for (at, voxel) in out.chunks_exact_mut(size_of::<V>()).enumerate() {
                let (x, y) = (x0 + at % nx, y0 + at / nx % ny);
                if !self.live[y * self.width + x] {
                    marker.write_le(voxel);
                }
            }
        });
    }
}

/// A source with one more absent value.
pub(crate) struct AbsentSource {
    source: Box<dyn VolumeSource>,
    info: SourceInfo,
    absent: AbsentNumbers,
}

impl std::fmt::Debug for AbsentSource {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AbsentSource").field("info", &self.info).field("absent", &self.absent).finish_non_exhaustive()
    }
}

impl AbsentSource {
    /// Declares a value absent, besides those that the source declares. `value` is scaled, as `info` shows values.
    ///
    /// # Errors
    /// If no voxel of the source can have the value.
    pub(crate) fn new(source: Box<dyn VolumeSource>, value: f64) -> Result<Self, SourceError> {
        let mut info = source.info().clone();
        let exact = (value - info.offset) / info.scale;
        let is_near = !info.voxel_type.is_float() && (exact - exact.round()).abs() <= 1e-6 * exact.abs().max(1.0);
        let stored = if is_near { exact.round() } else { exact };
        let values: Vec<f64> = info.nodata.into_iter().chain([stored]).collect();
        let held = held_by(info.voxel_type, stored);
        let absent = held.and_then(|_| AbsentNumbers::new(info.voxel_type, &values, ALL_VALID)).ok_or_else(|| {
            let what = format!(" {value}: no voxel of type {} can have this value", info.voxel_type);
            SourceError::options(Message::from(ReadOption::Nodata).text(what))
        })?;
        info.nodata = absent.nodata();
        info.reading.push(("nodata", value.to_string()));
        Ok(Self { source, info, absent })
    }

    /// Adds a note for the user.
    pub(crate) fn note(&mut self, note: Message) {
        self.info.notes.push(note);
    }
}

impl VolumeSource for AbsentSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)?;
        self.absent.mark(out);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn marked<V: Voxel>(absent: &AbsentNumbers, values: &[V]) -> Vec<f64> {
        let mut bytes = bytemuck::cast_slice(values).to_vec();
        absent.mark(&mut bytes);
        bytes.chunks_exact(size_of::<V>()).map(|voxel| V::read_le(voxel).to_f64()).collect()
    }

    #[test]
    fn several_values_and_a_range_become_one_marker() {
        let rule = AbsentNumbers::new(VoxelType::I16, &[-32767.0, -999.0, 1e9, 0.5], ALL_VALID).expect("two values");
        assert_eq!(rule.nodata(), Some(-32767.0));
        assert_eq!(marked(&rule, &[-999i16, 3, -32767]), [-32767.0, 3.0, -32767.0]);
        let rule = AbsentNumbers::new(VoxelType::I16, &[], [0.0, 100.0]).expect("a range");
        assert_eq!(rule.nodata(), Some(-1.0));
        assert_eq!(marked(&rule, &[-5i16, 0, 100, 101]), [-1.0, 0.0, 100.0, -1.0]);
        // The type has no number below the range.
        let rule = AbsentNumbers::new(VoxelType::U8, &[], [0.0, 100.0]).expect("a range");
        assert_eq!((rule.nodata(), marked(&rule, &[0u8, 255])), (Some(101.0), vec![0.0, 101.0]));
        let rule = AbsentNumbers::new(VoxelType::F32, &[], [0.0, 1.0]).expect("a range");
        assert_eq!(rule.nodata(), None);
        assert!(marked(&rule, &[2f32, 0.5])[0].is_nan());
        let rule = AbsentNumbers::new(VoxelType::F32, &[9.969_21e36], ALL_VALID).expect("a value");
        assert_eq!(rule.nodata(), Some(f64::from(9.969_21e36f32)));
        assert_eq!(AbsentNumbers::new(VoxelType::U8, &[-1.0, f64::NAN], [0.0, 255.0]), None);
    }
}
