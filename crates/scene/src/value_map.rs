//! Three forms of a voxel's number, and the maps between them.
//!
//! - A *stored number* is the element of a brick's array: `u8`, `u16` or `f32`.
//! - A *render value* is an `f32`: `stored * scale + offset`. Transfer functions are applied to render values.
//! - A *data value* is an `f64` in the data's own units: `render value + shift`.

use supervol_format::cast::{single, whole};
use supervol_format::{Container, ValueRange, VoxelType};

use crate::units::{InUnits, VALUE_LIMIT};

/// Map from stored numbers to render values and data values; one for the whole container.
///
/// The map is exact for integers of up to 16 bits and, without shift and scale, for `f32`. `u32`, `i32` and `f64`
/// values are rounded to 24 bits of their distance from [`ValueMap::shift`]. The error of a data value d is at most
/// `2^-24 |d - shift|`, which is at most `2^-23` of the range's width.
///
/// Consequence for a smooth transfer function: let w be the width over which its control points lie, as a share of the
/// range's width. For w of at least 2^-16 the error is at most half a grey level. Narrower functions show steps: up to
/// 7 grey levels at 2^-20, more than 100 at 2^-25 (`windows_of_values_that_f32_does_not_resolve` in
/// `tests/tests/drawn/known_issues.rs`). Near the shift, which is mostly zero, far narrower functions are exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ValueMap {
    /// Render value per stored number; may be negative.
    pub scale: f32,
    /// Render value of the stored number 0.
    pub offset: f32,
    /// Data value of the render value 0.
    pub shift: f64,
    /// The stored number that marks an absent voxel, for `U8` and `U16` bricks.
    pub absent: Option<u16>,
    /// Container scale: data value = container value * scale + offset.
    source_scale: f64,
    /// See `source_scale`.
    source_offset: f64,
    /// Added to integers of at most 16 bits to store them unsigned.
    bias: f64,
}

impl ValueMap {
    /// The map for a container of this voxel type: data value = container value * `scale` + `offset`.
    ///
    /// `range` is the value range of the whole volume in data units. If it lies far from zero relative to its width,
    /// its middle becomes the shift, so that `f32` resolves it.
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
        let bias = integer_bias(voxel_type);
        let (scale, offset, absent) = match bias {
            Some(bias) => {
                let (low, high) = voxel_type.limits();
                let hole = nodata.filter(|v| v.fract() == 0.0 && (low..=high).contains(v));
                let offset = (source_offset - shift) - bias * source_scale;
                (single(source_scale), single(offset), hole.map(|v| whole::<u16>(v + bias)))
            }
            // Values of these types become render values when a brick is decoded, in `f64`.
            None => (1.0, 0.0, None),
        };
        Self { scale, offset, shift, absent, source_scale, source_offset, bias: bias.unwrap_or(0.0) }
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

    /// Data value of a stored number that is an integer, without the roundings of render values.
    #[inline]
    #[must_use]
    pub fn data_of_stored(&self, number: f64) -> f64 {
        (number - self.bias) * self.source_scale + self.source_offset
    }

    /// Render value of a number as the container stores it. Monotone, so that ranges map to ranges.
    #[inline]
    #[must_use]
    pub fn from_container(&self, voxel_type: VoxelType, value: f64) -> f32 {
        match integer_bias(voxel_type) {
            Some(bias) => self.from_stored_number(single(value + bias)),
            None => self.from_data(value * self.source_scale + self.source_offset),
        }
    }
}

/// Map from stored numbers to render values for a container.
#[must_use]
pub fn value_map(container: &Container) -> ValueMap {
    let d = container.descriptor();
    let InUnits { scale, offset, value_range, .. } = InUnits::of(container);
    let range = if container.manifest().value_range.is_some() { value_range } else { ValueRange::EMPTY };
    ValueMap::for_container(d.voxel_type, scale, offset, d.absence.nodata, range)
}

/// Bias added to an integer of at most 16 bits to store it unsigned; `None` for types rendered as `f32`.
fn integer_bias(voxel_type: VoxelType) -> Option<f64> {
    match voxel_type {
        VoxelType::U8 | VoxelType::U16 => Some(0.0),
        VoxelType::I8 => Some(128.0),
        VoxelType::I16 => Some(32768.0),
        VoxelType::U32 | VoxelType::I32 | VoxelType::F32 | VoxelType::F64 => None,
    }
}

/// The nearest `f32`, clamped so that differences do not overflow; NaN stays NaN.
fn to_f32(value: f64) -> f32 {
    single(value.clamp(-VALUE_LIMIT, VALUE_LIMIT))
}
