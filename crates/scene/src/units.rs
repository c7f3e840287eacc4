//! Units in which pictures are computed.
//!
//! `f32` covers magnitudes from 1e-38 to 3e38; squares overflow or underflow beyond 1e19 and 1e-19. A camera beside a
//! volume that lies 1e18 voxels from the world's origin cannot be represented even in `f64`. A picture is therefore
//! computed in *units* of its own: lengths in multiples of [`Units::length`] from the point [`Units::anchor`], values
//! in multiples of [`Units::value`]. Units are powers of two, so that conversion rounds nothing. For ordinary volumes
//! they are those of the world.
//!
//! [`Scene::resolve`](crate::scene::Scene::resolve) converts scenes into units. [`InUnits`] converts a container's
//! numbers for ray casters, the reference integrator and the streamer. All other code is independent of units.

use glam::DVec3;
use supervol_format::cast::whole;
use supervol_format::space::HALF_VOXEL;
use supervol_format::{Container, Dims, Geometry, ValueRange};

use crate::facts::{DataKind, VolumeFacts};

/// Binary exponents of a voxel's shortest edge for which world lengths are kept. Together with [`PLAIN_VALUES`], the
/// square of a gradient of a millionth of the steepest stays within `f32`.
const PLAIN_LENGTHS: std::ops::RangeInclusive<i32> = -20..=20;
/// Binary exponents of the greatest magnitude of a value for which data values are kept.
const PLAIN_VALUES: std::ops::RangeInclusive<i32> = -20..=40;
/// Percentiles between which a typical value lies.
const MOST_VALUES: std::ops::RangeInclusive<f64> = 1.0..=99.0;
/// Typical values in units are at least 2 to the minus this, so that the square of their inverse stays within `f32`.
const USUAL_DEPTH: i32 = 60;
/// Binary exponents of trusted percentiles: percentiles are computed in single precision.
const COUNTED_VALUES: std::ops::RangeInclusive<i32> = -120..=120;
/// Greatest magnitude of the binary exponent of a unit: its inverse must be finite.
const UNIT_LIMIT: i32 = 1000;
/// Volumes whose corner is farther from the world's origin than this many voxel edges get an anchor. Below, `f64`
/// resolves 2^-22 of a voxel.
const ANCHORED_VOXELS: f64 = (1u64 << 30) as f64;
/// Greatest magnitude of a value in units, for voxels and scenes: beyond, differences overflow in `f32`. Only a voxel
/// that exceeds all others by a factor of more than 2^60 is clamped. The picture does not change by that.
pub const VALUE_LIMIT: f64 = 1.2676506002282294e30;

/// Units of a picture; see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Units {
    /// World position of the origin.
    pub anchor: DVec3,
    /// World length of one unit; a power of two.
    pub length: f64,
    /// Data value of one unit; a power of two.
    pub value: f64,
}

/// The binary exponent of a positive number; subnormal numbers are allowed.
fn exponent(number: f64) -> i32 {
    whole::<i32>(number.log2().floor())
}

/// Two to this power, clamped to [`UNIT_LIMIT`].
fn power(exponent: i32) -> f64 {
    f64::from(exponent.clamp(-UNIT_LIMIT, UNIT_LIMIT)).exp2()
}

/// World lengths of a voxel's edges along x, y, z. Squares of spacings may overflow, squares of directions do not.
#[must_use]
pub fn edges(geometry: &Geometry) -> [f64; 3] {
    let d = geometry.direction;
    std::array::from_fn(|a| geometry.spacing[a] * DVec3::new(d[a], d[3 + a], d[6 + a]).length())
}

impl Units {
    /// World units: no conversion.
    pub const WORLD: Self = Self { anchor: DVec3::ZERO, length: 1.0, value: 1.0 };

    /// Whether lengths are world lengths.
    #[must_use]
    pub fn has_world_lengths(&self) -> bool {
        *self == Self { value: self.value, ..Self::WORLD }
    }

    /// The units of a volume.
    #[must_use]
    pub fn of(facts: &VolumeFacts) -> Self {
        let length = length_unit(&facts.geometry);
        Self { anchor: anchor(&facts.geometry, facts.dims), length, value: value_unit(facts) }
    }

    /// A world point in units.
    #[must_use]
    pub fn point(&self, world: DVec3) -> DVec3 {
        (world - self.anchor) / self.length
    }

    /// The plane of all world points p with normal . p = offset, in units: normal and offset. The normal is scaled by a
    /// power of two, so that nothing is rounded.
    #[must_use]
    pub fn plane(&self, normal: [f64; 3], offset: f64) -> (DVec3, f64) {
        let scale = DVec3::from_array(normal).abs().max_element().log2().floor().exp2();
        let normal = DVec3::from_array(normal) / scale;
        (normal, (offset / scale - normal.dot(self.anchor)) / self.length)
    }

    /// A data value in units.
    #[must_use]
    pub fn value(&self, data: f64) -> f64 {
        (data / self.value).clamp(-VALUE_LIMIT, VALUE_LIMIT)
    }

    /// Position, spacing and direction of a volume in units.
    #[must_use]
    pub fn geometry(&self, world: &Geometry) -> Geometry {
        let spacing = world.spacing.map(|spacing| spacing / self.length);
        Geometry { spacing, origin: self.point(world.origin.into()).to_array(), direction: world.direction }
    }

    /// Facts of a volume in units. Percentiles and histogram are left out; only presets need these, in data units.
    #[must_use]
    pub fn facts(&self, world: &VolumeFacts) -> VolumeFacts {
        let [value_range, central_range] = [world.value_range, world.central_range].map(|range| self.range(range));
        let geometry = self.geometry(&world.geometry);
        VolumeFacts {
            geometry,
            value_range,
            central_range,
            percentiles: vec![],
            histogram: vec![],
            labels: vec![],
            ..world.clone()
        }
    }

    fn range(&self, ValueRange { min, max }: ValueRange) -> ValueRange {
        // The empty range has infinite ends and keeps them.
        ValueRange { min: min / self.value, max: max / self.value }
    }
}

fn length_unit(geometry: &Geometry) -> f64 {
    let shortest = exponent(edges(geometry).into_iter().fold(f64::INFINITY, f64::min));
    if PLAIN_LENGTHS.contains(&shortest) { 1.0 } else { power(shortest) }
}

/// Too large values are scaled just below the limit, not to 1, and typical values stay well above underflow. A few
/// voxels may be far greater than all others, but the transfer function usually concerns the others.
fn value_unit(facts: &VolumeFacts) -> f64 {
    let range = facts.value_range;
    let greatest = if range.is_empty() { 0.0 } else { range.min.abs().max(range.max.abs()) };
    if greatest == 0.0 {
        return 1.0;
    }
    let most = facts.percentiles.iter().filter(|(percent, _)| MOST_VALUES.contains(percent));
    let usual = most.map(|(_, value)| value.abs()).fold(0.0, f64::max);
    let greatest = exponent(greatest);
    let usual = Some(usual).filter(|usual| *usual > 0.0).map(exponent).filter(|e| COUNTED_VALUES.contains(e));
    let usual = usual.unwrap_or(greatest).min(greatest);
    let wanted = if greatest < *PLAIN_VALUES.start() { greatest } else { (greatest - PLAIN_VALUES.end()).max(0) };
    power(wanted.min(usual + USUAL_DEPTH))
}

fn anchor(geometry: &Geometry, dims: Dims) -> DVec3 {
    let edges = edges(geometry);
    let shortest = edges.into_iter().fold(f64::INFINITY, f64::min);
    let farthest = DVec3::from_array(geometry.origin).abs().max_element();
    let extent = (0..3).map(|a| edges[a] * (dims.0[a] as f64 - HALF_VOXEL)).fold(0.0, f64::max);
    let is_far = farthest > ANCHORED_VOXELS * shortest && farthest > extent;
    if is_far { DVec3::from_array(geometry.origin) } else { DVec3::ZERO }
}

/// A container's numbers in the units of its pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InUnits {
    /// Position of level 0.
    pub geometry: Geometry,
    /// Scale from container values: value = container value * `scale` + `offset`.
    pub scale: f64,
    /// Offset from container values; see `scale`.
    pub offset: f64,
    /// Least and greatest value of the volume. If no voxel is present, the range [0, 1] of data values.
    pub value_range: ValueRange,
    /// Range of the central values, see [`VolumeFacts::central_range`].
    pub central_range: ValueRange,
}

impl InUnits {
    /// The numbers of a container.
    #[must_use]
    pub fn of(container: &Container) -> Self {
        // The kind of data does not matter here and is expensive to recognise.
        let (descriptor, facts) = (container.descriptor(), VolumeFacts::of_kind(container, DataKind::Generic));
        let units = Units::of(&facts);
        Self {
            geometry: units.geometry(&descriptor.geometry),
            scale: descriptor.scale / units.value,
            offset: descriptor.offset / units.value,
            value_range: units.range(facts.value_range),
            central_range: units.range(facts.central_range),
        }
    }

    /// The value of a number as the container stores it.
    #[must_use]
    pub fn value(&self, stored: f64) -> f64 {
        stored * self.scale + self.offset
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts(value: f64, spacing: f64, origin: f64) -> VolumeFacts {
        VolumeFacts {
            has_zero_centre: true,
            ..VolumeFacts::plain(
                Dims([30, 20, 10]),
                Geometry { spacing: [spacing; 3], origin: [origin; 3], ..Geometry::IDENTITY },
                ValueRange { min: -0.5 * value, max: value },
            )
        }
    }

    #[test]
    fn ordinary_numbers_are_left_alone() {
        for (value, spacing, origin) in [(1.0, 1.0, 0.0), (1e-5, 1e-5, 6.5e-2), (1e7, 25.0, 6.5e6), (4e9, 3e5, -1e10)] {
            assert_eq!(Units::of(&facts(value, spacing, origin)), Units::WORLD);
        }
    }

    #[test]
    fn extreme_numbers_come_into_range_exactly() {
        for power in [-280, -100, -25, 25, 100, 280] {
            let scale = 10f64.powi(power);
            let facts = facts(scale, scale, 1e18 * scale);
            let units = Units::of(&facts);
            let seen = units.facts(&facts);
            assert_eq!(seen.geometry.origin, [0.0; 3]);
            assert!((0.5..=2.0).contains(&seen.geometry.spacing[0]), "{:?}", seen.geometry);
            assert!((0.5..2e12).contains(&seen.value_range.max), "{:?}", seen.value_range);
            assert_eq!(seen.value_range.max * units.value, facts.value_range.max);
            assert_eq!(seen.geometry.spacing[0] * units.length, scale);
        }
        // The least and the greatest double, and no value at all.
        assert!(Units::of(&self::facts(5e-324, 5e-324, 0.0)).value > 0.0);
        assert!(Units::of(&self::facts(f64::MAX, 1.0, 0.0)).value.is_finite());
        let empty = VolumeFacts { value_range: ValueRange::EMPTY, ..self::facts(1.0, 1.0, 0.0) };
        assert_eq!(Units::of(&empty), Units::WORLD);
        // One voxel far greater than all others.
        for spike in [1e10, 1e20, 1e37, 1e300] {
            let facts = VolumeFacts { percentiles: vec![(1.0, -0.3), (99.0, 0.7)], ..self::facts(spike, 1.0, 0.0) };
            let units = Units::of(&facts);
            assert!(units.value(0.7) > 2f64.powi(-62) && units.value(spike) <= VALUE_LIMIT, "{units:?}");
        }
    }
}
