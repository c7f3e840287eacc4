//! Attributes of the CF conventions (netCDF, HDF5, and Zarr by xarray): fill values, valid range, scale, offset, unit,
//! and coordinates of the axes. <https://cfconventions.org>
//!
//! Scale and offset become those of the volume; voxels stay as stored. Evenly spaced coordinates give spacing and
//! origin of their axis; descending ones turn it round. A range of floats for packed integers is a range of values.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use half::f16;

use super::zarr::ome::{ArrayAxis, Role, unit_of};
use crate::cast::index;
use crate::grid::absent::{ALL_VALID, AbsentNumbers};
use crate::grid::elements::Number;
use crate::input::text::shortened;
use crate::input::values::{in_few_digits, line};
use crate::{Message, ReadOption, SourceInfo};

/// Largest number of coordinates along an axis.
pub(crate) const COORDINATES_LIMIT: u64 = 1 << 20;
/// Largest distance of a coordinate from its place on an even axis, in steps.
const EVEN_LIMIT: f64 = 0.01;
/// Largest number of absent values that a note lists.
const LISTED_LIMIT: usize = 4;

/// Value of an attribute.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Attribute {
    Numbers { numbers: Vec<f64>, is_float: bool },
    Text(String),
}

impl Attribute {
    /// The numbers. Zarr 3 has fill values of floats as base64 of a double (xarray), or as a word such as `NaN`.
    fn numbers(&self) -> Vec<f64> {
        let text = match self {
            Self::Numbers { numbers, .. } => return numbers.clone(),
            Self::Text(text) => text.trim(),
        };
        let double = || STANDARD.decode(text).ok()?.try_into().ok().map(f64::from_le_bytes);
        text.parse().ok().or_else(double).into_iter().collect()
    }

    fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text.trim()),
            Self::Numbers { .. } => None,
        }
    }
}

/// An attribute by its name.
pub(crate) type Attributes<'a> = &'a dyn Fn(&str) -> Option<Attribute>;

/// Meaning of the stored numbers of an array.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Explanation {
    /// Stored numbers that are absent.
    pub(crate) absent: Vec<f64>,
    /// Least and greatest valid number, and whether they are values, not stored numbers.
    valid: ([f64; 2], bool),
    scale: f64,
    offset: f64,
    unit: String,
    /// Whether signed integers are meant as unsigned ones.
    pub(crate) is_unsigned: bool,
}

impl Explanation {
    /// Reads the attributes of an array.
    pub(crate) fn of(attributes: Attributes<'_>) -> Self {
        let numbers = |name: &str| attributes(name).map(|found| found.numbers()).unwrap_or_default();
        let first = |name: &str| numbers(name).first().copied();
        let (range, least, greatest) = (numbers("valid_range"), first("valid_min"), first("valid_max"));
        let valid = match range[..] {
            [least, greatest] => [least, greatest],
            _ => [least.unwrap_or(ALL_VALID[0]), greatest.unwrap_or(ALL_VALID[1])],
        };
        let is_float = |name: &&str| matches!(attributes(name), Some(Attribute::Numbers { is_float: true, .. }));
        let is_of_values = ["valid_range", "valid_min", "valid_max"].iter().any(is_float);
        let is_sane = valid[0] <= valid[1];
        let text = |name: &str| attributes(name).and_then(|found| found.text().map(str::to_owned)).unwrap_or_default();
        Self {
            absent: [numbers("_FillValue"), numbers("missing_value")].concat(),
            valid: (if is_sane { valid } else { ALL_VALID }, is_of_values),
            scale: first("scale_factor").filter(|scale| scale.is_finite() && *scale != 0.0).unwrap_or(1.0),
            offset: first("add_offset").filter(|offset| offset.is_finite()).unwrap_or(0.0),
            unit: unit_of_values(&text("units")),
            is_unsigned: text("_Unsigned").eq_ignore_ascii_case("true"),
        }
    }

    /// Type of the numbers: unsigned if the attributes say so.
    pub(crate) fn number(&self, stored: Number) -> Number {
        use supervol_format::VoxelType::{I8, I16, I32, U8, U16, U32};
        match stored {
            Number::Voxel(I8) if self.is_unsigned => Number::Voxel(U8),
            Number::Voxel(I16) if self.is_unsigned => Number::Voxel(U16),
            Number::Voxel(I32) if self.is_unsigned => Number::Voxel(U32),
            Number::Whole { signed: true } if self.is_unsigned => Number::Whole { signed: false },
            other => other,
        }
    }

    /// The value of a stored number.
    pub(crate) fn value(&self, stored: f64) -> f64 {
        stored * self.scale + self.offset
    }

    /// Puts scale, offset, unit and absent value into the description of a volume with numbers of a type, and notes
    /// them. `marker` is the voxel that stands for absent 64-bit integers. Returns the rule for absent numbers, if there is one.
    pub(crate) fn apply(
        &self,
        (number, marker): (Number, Option<f64>),
        info: &mut SourceInfo,
        notes: &mut Vec<Message>,
    ) -> Option<AbsentNumbers> {
        (info.scale, info.offset) = (self.scale, self.offset);
        info.unit.clone_from(&self.unit);
        let held = |value: f64| match number {
            Number::Half => f16::from_f64(value).to_f64(),
            // Attributes have the signed type of the file.
            Number::Voxel(voxel_type) if self.is_unsigned && !voxel_type.is_float() && value < 0.0 => {
                value + voxel_type.limits().1 + 1.0
            }
            _ => value,
        };
        let values: Vec<f64> = self.absent.iter().map(|value| held(*value)).collect();
        let of_voxels = marker.map_or_else(|| values.clone(), |marker| vec![marker]);
        let absent =
            AbsentNumbers::new(info.voxel_type, &of_voxels, self.valid_numbers(info.voxel_type.is_float(), held));
        info.nodata = absent.as_ref().and_then(AbsentNumbers::nodata);
        let mut said: Vec<String> = line(self.scale, self.offset).into_iter().collect();
        let plain = |value: f64| in_few_digits(value, info.voxel_type);
        if absent.is_some() {
            let finite = values.iter().filter(|value| value.is_finite()).take(LISTED_LIMIT);
            let listed: Vec<String> = finite.map(|value| plain(*value)).collect();
            if !listed.is_empty() {
                said.push(format!("absent: {}", listed.join(", ")));
            }
            if self.valid.0 != ALL_VALID {
                let [least, greatest] = self.valid.0;
                said.push(format!("absent: outside of {} to {}", plain(least), plain(greatest)));
            }
        }
        if !said.is_empty() {
            let what = format!("attributes of the file are applied ({}); ", said.join("; "));
            notes.push(Message::from(what).option(ReadOption::Values).text(" ignores them"));
        }
        absent
    }

    /// Least and greatest valid stored number.
    fn valid_numbers(&self, is_float: bool, held: impl Fn(f64) -> f64) -> [f64; 2] {
        let (valid, is_of_values) = self.valid;
        if is_float || !is_of_values || (self.scale, self.offset) == (1.0, 0.0) {
            return valid.map(held);
        }
        // Half a step of tolerance: the ends of the range are rounded values.
        let [a, b] = valid.map(|value| (value - self.offset) / self.scale);
        [a.min(b).round(), a.max(b).round()]
    }
}

/// Unit of values; empty for pure numbers.
fn unit_of_values(text: &str) -> String {
    if matches!(text, "1" | "none" | "unitless" | "dimensionless") { String::new() } else { shortened(text) }
}

/// Coordinates along an axis.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Coordinates {
    pub(crate) values: Vec<f64>,
    pub(crate) unit: String,
}

impl Coordinates {
    /// Coordinates from the stored numbers of an array and its attributes.
    pub(crate) fn of(stored: &[f64], attributes: Attributes<'_>) -> Self {
        let explanation = Explanation::of(attributes);
        let values = stored.iter().map(|number| explanation.value(*number)).collect();
        // "days since 2000-01-01"
        let unit = explanation.unit.split(" since ").next().unwrap_or_default();
        Self { values, unit: unit_of(unit) }
    }

    /// Values of two axes with the second fastest, as they are or, if `is_ordered` is false, exchanged.
    pub(crate) fn transposed_unless(self, is_ordered: bool, [slow, fast]: [u64; 2]) -> Self {
        if is_ordered {
            return self;
        }
        let (slow, fast) = (index(slow), index(fast));
        let values = (0..fast).flat_map(|x| (0..slow).map(move |y| (x, y)));
        Self { values: values.map(|(x, y)| self.values[y * fast + x]).collect(), ..self }
    }

    /// First coordinate and step, if the coordinates are evenly spaced.
    pub(crate) fn even(&self) -> Option<[f64; 2]> {
        let (first, last) = (*self.values.first()?, *self.values.last()?);
        let step = (last - first) / (self.values.len().checked_sub(1).filter(|n| *n > 0)? as f64);
        let is_near = |(i, value): (usize, &f64)| (value - first - step * i as f64).abs() <= EVEN_LIMIT * step.abs();
        (step.is_finite() && step != 0.0 && self.values.iter().enumerate().all(is_near)).then_some([first, step])
    }

    /// Places an axis by its coordinates. Notes uneven ones, which are not used.
    pub(crate) fn place(&self, axis: &mut ArrayAxis, notes: &mut Vec<Message>) {
        axis.unit.clone_from(&self.unit);
        if let Some([first, step]) = self.even() {
            (axis.origin, axis.spacing) = (first, step);
        } else if let [first, .., last] = self.values[..] {
            let name = shortened(&axis.name);
            notes.push(
                format!("coordinates along {name}, {first} to {last}, are not evenly spaced: its spacing is 1").into(),
            );
        } else if let [only] = self.values[..] {
            axis.origin = if only.is_finite() { only } else { 0.0 };
        }
    }
}

/// Notes that the units of axes differ.
pub(crate) fn note_units(axes: &[ArrayAxis], notes: &mut Vec<Message>) {
    let mut units: Vec<&str> =
        axes.iter().filter(|axis| axis.role == Role::Space && !axis.unit.is_empty()).map(|a| a.unit.as_str()).collect();
    units.dedup();
    if units.iter().any(|unit| *unit != units[0] && !(is_angle(unit) && is_angle(units[0]))) {
        let what = format!("the axes have different units ({}): lengths do not compare; ", units.join(", "));
        notes.push(Message::from(what).option(ReadOption::Spacing).text(" sets them"));
    }
}

/// Whether a unit is a degree of latitude or longitude.
fn is_angle(unit: &str) -> bool {
    unit.starts_with("deg")
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, VoxelType};

    use super::*;

    fn numbers(values: &[f64]) -> Option<Attribute> {
        Some(Attribute::Numbers { numbers: values.to_vec(), is_float: values.iter().any(|v| v.fract() != 0.0) })
    }

    #[test]
    fn fill_values_of_xarray() {
        let of = |text: &str| Attribute::Text(text.into()).numbers();
        assert!(of("AAAAAAAA+H8=")[0].is_nan() && of("NaN")[0].is_nan());
        assert_eq!(of("AAAAAICHw8A="), [-9999.0]);
        assert!(of("what").is_empty());
    }

    #[test]
    fn ranges_of_packed_numbers() {
        let attributes = |name: &str| match name {
            "scale_factor" => numbers(&[0.5]),
            "add_offset" => numbers(&[10.0]),
            "valid_range" => numbers(&[10.5, 20.0]),
            "_FillValue" => numbers(&[-1.0]),
            "_Unsigned" => Some(Attribute::Text("true".into())),
            _ => None,
        };
        let explanation = Explanation::of(&attributes);
        let number = explanation.number(Number::Voxel(VoxelType::I8));
        assert_eq!(number, Number::Voxel(VoxelType::U8));
        let mut info = SourceInfo::plain("zarr", Dims([4, 1, 1]), VoxelType::U8);
        let mut notes = Vec::new();
        let absent = explanation.apply((number, None), &mut info, &mut notes).expect("a fill value");
        assert_eq!((info.scale, info.offset, info.nodata), (0.5, 10.0, Some(255.0)));
        let mut voxels = [0, 1, 20, 21];
        absent.mark(&mut voxels);
        assert_eq!(voxels, [255, 1, 20, 255]);
        assert_eq!(notes.len(), 1);
    }

    #[test]
    fn axes_by_coordinates() {
        let placed = |values: &[f64]| {
            let (mut axis, mut notes) = (ArrayAxis::named("lat"), Vec::new());
            let unit = String::from("m");
            Coordinates { values: values.to_vec(), unit }.place(&mut axis, &mut notes);
            (axis.origin, axis.spacing, notes.len())
        };
        assert_eq!(placed(&[90.0, 89.75, 89.5]), (90.0, -0.25, 0));
        assert_eq!(placed(&[0.0, 10.0, 40.0]), (0.0, 1.0, 1));
        assert_eq!(placed(&[7.0]), (7.0, 1.0, 0));
        assert_eq!(placed(&[f64::NAN, 1.0]).2, 1);
    }
}
