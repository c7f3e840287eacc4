//! Three forms of a voxel's number, and the maps between them.
//!
//! - A *stored number* is the element of a brick's array: `u8`, `u16` or `f32`.
//! - A *render value* is an `f32`: `stored * scale + offset`. Transfer functions are applied to render values.
//! - A *data value* is an `f64` in the data's own units: `render value + shift`.

use supervol_format::cast::{single, whole};
use supervol_format::{Container, ValueRange, VoxelType};

use crate::units::{InUnits, VALUE_LIMIT};

/// Most that a number loses when it is rounded to `f32`, in parts of it.
const ROUNDING: f32 = 0.5 * f32::EPSILON;
/// Integers up to here are numbers of `f32`.
const EXACT_INTEGERS: f64 = (1u32 << f32::MANTISSA_DIGITS) as f64;

/// Map from stored numbers to render values and data values; one for the whole container.
///
/// The map is exact for integers of up to 16 bits and, without shift and scale, for `f32`. `u32`, `i32` and `f64`
/// values are rounded to 24 bits of their distance from [`ValueMap::shift`]. The error of a data value d is at most
/// `2^-24 |d - shift|`, which is at most `2^-23` of the range's width.
///
/// In mode `dvr`, pictures of the CPU do not show that: where rounding decides, cells are integrated with the values of the data. A GPU
/// has the render values alone, and states what rounding may change: with smooth transfer functions over 2^-20 of the range's width it is
/// up to 4 grey levels off, over 2^-25 more than 100 (`tests/tests/drawn/rounded_values.rs`).
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
    /// Whether render values are rounded: they may differ from the data by half a unit in their last place.
    pub is_rounded: bool,
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
        let is_rounded = match voxel_type {
            VoxelType::F64 => true,
            VoxelType::F32 => source_scale != 1.0 || source_offset != shift,
            VoxelType::U32 | VoxelType::I32 => {
                let are_whole = source_scale.fract() == 0.0 && (source_offset - shift).fract() == 0.0;
                let most = (range.min - shift).abs().max((range.max - shift).abs());
                !are_whole || range.is_empty() || most > EXACT_INTEGERS
            }
            // Their render values are computed from stored numbers, which are exact.
            VoxelType::U8 | VoxelType::U16 | VoxelType::I8 | VoxelType::I16 => false,
        };
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
        Self { scale, offset, shift, absent, is_rounded, source_scale, source_offset, bias: bias.unwrap_or(0.0) }
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
        self.data_of_container(number - self.bias)
    }

    /// Bound on what render values of this range of data values are off by, because they are rounded.
    #[must_use]
    pub fn rounding_within(&self, range: ValueRange) -> f32 {
        if self.is_rounded { self.distance_from_data(self.greatest_within(range)) } else { 0.0 }
    }

    /// Greatest size of a render value in a range of data values; 0 if the range is empty.
    #[must_use]
    pub fn greatest_within(&self, range: ValueRange) -> f32 {
        if range.is_empty() { 0.0 } else { self.from_data(range.min).abs().max(self.from_data(range.max).abs()) }
    }

    /// Bound on the distance of render values up to this size from the data's: values that are rounded, and stored numbers whose scale
    /// and offset are.
    #[must_use]
    pub fn distance_from_data(&self, greatest: f32) -> f32 {
        if self.is_rounded {
            return greatest * (ROUNDING * (1.0 + f32::EPSILON));
        }
        let offset = (self.source_offset - self.shift) - self.bias * self.source_scale;
        let are_whole = self.source_scale.fract() == 0.0 && offset.fract() == 0.0;
        let most = f64::from(greatest).max(offset.abs());
        // Values of `f32` have neither scale nor offset here.
        if (self.scale, self.offset) == (1.0, 0.0) || (are_whole && 2.0 * most <= EXACT_INTEGERS) {
            return 0.0;
        }
        // Scale, product, offset and sum are rounded, and the product is at most the value plus the offset.
        (greatest + self.offset.abs()) * (3.0 * ROUNDING * (1.0 + 4.0 * f32::EPSILON))
    }

    /// Data value of a number as the container stores it.
    #[must_use]
    pub fn data_of_container(&self, value: f64) -> f64 {
        value * self.source_scale + self.source_offset
    }

    /// Render value of a number as the container stores it. Monotone, so that ranges map to ranges.
    #[inline]
    #[must_use]
    pub fn from_container(&self, voxel_type: VoxelType, value: f64) -> f32 {
        match integer_bias(voxel_type) {
            Some(bias) => self.from_stored_number(single(value + bias)),
            None => self.from_data(self.data_of_container(value)),
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
