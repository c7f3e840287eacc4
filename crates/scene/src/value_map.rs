//! Numbers of a volume in three forms, and the map between them.
//!
//! - A *stored number* is what a brick's array holds: `u8`, `u16` or `f32`.
//! - A *render value* is an `f32`: `stored * scale + offset`. Transfer functions are applied to render values.
//! - A *data value* is an `f64` in the data's own units: `render value + shift`.

use supervol_format::{ValueRange, VoxelType};

use crate::units::VALUE_LIMIT;

/// What stored numbers mean; one for the whole container.
///
/// Exact for integers of up to 16 bits and, where nothing is shifted or scaled, for `f32`. `u32`, `i32` and `f64` values
/// are rounded to 24 bits of their distance from [`ValueMap::shift`]: a data value d is off by up to
/// `2^-24 |d - shift|`, which is at most `2^-23` of the range's width. A smooth transfer function all of whose control
/// points lie within w is right to half a grey level where w is at least 2^-16 of the range's width, and sees steps where
/// it is narrower: at 2^-20 up to 7 grey levels off, at 2^-25 more than 100 (`windows_of_values_that_f32_does_not_resolve`
/// in `tests/tests/known_issues.rs`). Near the shift, mostly zero, far narrower ones are right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueMap {
    /// Render value per stored number; may be negative.
    pub scale: f32,
    /// Render value of the stored number 0.
    pub offset: f32,
    /// Data value of the render value 0.
    pub shift: f64,
    /// The stored `U8` or `U16` number that is a hole.
    pub absent: Option<u16>,
    /// Container scale: data value = container value * scale + offset.
    source_scale: f64,
    /// See `source_scale`.
    source_offset: f64,
}

impl ValueMap {
    /// The map for a container of this voxel type: data value = container value * `scale` + `offset`.
    ///
    /// `range` is that of the whole volume, in data units. Where it lies far from zero for its width, render values are
    /// taken from its middle, so that `f32` resolves it.
    #[must_use]
    pub fn for_container(
        voxel_type: VoxelType,
        scale: f64,
        offset: f64,
        nodata: Option<f64>,
        range: ValueRange,
    ) -> Self {
        let middle = if range.is_empty() { 0.0 } else { 0.5 * range.min + 0.5 * range.max };
        let shift = if middle.is_finite() && middle.abs() > range.width() { middle } else { 0.0 };
        let (source_scale, source_offset) = (scale, offset);
        let (scale, offset, absent) = match integer_bias(voxel_type) {
            Some(bias) => {
                let (low, high) = voxel_type.limits();
                let hole = nodata.filter(|v| v.fract() == 0.0 && (low..=high).contains(v));
                let offset = (source_offset - shift) - bias * source_scale;
                (source_scale as f32, offset as f32, hole.map(|v| (v + bias) as u16))
            }
            // These become render values when a brick is decoded, in f64.
            None => (1.0, 0.0, None),
        };
        Self { scale, offset, shift, absent, source_scale, source_offset }
    }

    /// Render value of a stored number.
    #[inline]
    #[must_use]
    pub fn from_stored_number(&self, number: f32) -> f32 {
        number * self.scale + self.offset
    }

    /// Render value of a data value.
    #[inline]
    #[must_use]
    pub fn from_data(&self, value: f64) -> f32 {
        to_f32(value - self.shift)
    }

    /// Data value of a render value.
    #[inline]
    #[must_use]
    pub fn to_data(&self, render: f32) -> f64 {
        f64::from(render) + self.shift
    }

    /// Render value of a value as the container stores it. Monotone, so that ranges map to ranges.
    #[inline]
    #[must_use]
    pub fn from_container(&self, voxel_type: VoxelType, value: f64) -> f32 {
        match integer_bias(voxel_type) {
            Some(bias) => self.from_stored_number((value + bias) as f32),
            None => self.from_data(value * self.source_scale + self.source_offset),
        }
    }
}

/// What is added to an integer of at most 16 bits to store it unsigned; `None` for the types rendered as `f32`.
fn integer_bias(voxel_type: VoxelType) -> Option<f64> {
    match voxel_type {
        VoxelType::U8 | VoxelType::U16 => Some(0.0),
        VoxelType::I8 => Some(128.0),
        VoxelType::I16 => Some(32768.0),
        VoxelType::U32 | VoxelType::I32 | VoxelType::F32 | VoxelType::F64 => None,
    }
}

/// The nearest `f32` of a magnitude that differences do not run over with; NaN stays NaN.
fn to_f32(value: f64) -> f32 {
    value.clamp(-VALUE_LIMIT, VALUE_LIMIT) as f32
}
