//! Summaries of bricks for packets in the modes `mip`, `minip`, `mean` and `iso`: numbers, ranges, leaps.
//!
//! Rays keep their results in render values and `f64`. In a brick, packets count in *numbers*: stored numbers minus a
//! centre. The sign is reversed if the mode looks for the least value, or if greater numbers are lesser values. Whole
//! numbers have the same render values as in the scalar caster.

use supervol_format::ValueRange;
use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::{single, whole};
use supervol_scene::scene::{ISO_LIMIT, Mode};
use supervol_scene::value_map::ValueMap;

use super::fetch::Stored;
use super::leap::{AxisDirection, MacroRanges, ProximityCloud, macro_cells_of};
use super::per_brick::PerBrick;
use super::value_tiles::worse;
use crate::engines::ray::IsoSides;
use crate::engines::ray_scene::RayScene;
use crate::engines::value_error::by_f32;
use crate::stream::classify::Skipping;
use crate::stream::residency::DecodedBrick;

/// Greatest whole number that a brick can store.
const GREATEST_STORED: i64 = u16::MAX as i64;

/// Summaries of the bricks of a frame in these modes.
pub type BrickSummaries = PerBrick<BrickSummary>;

/// Summary of a brick, in its numbers.
#[derive(Debug)]
pub struct BrickSummary {
    pub(super) numbers: Numbers,
    /// Ranges of macro cells.
    pub(super) ranges: MacroRanges,
    /// Range of the whole brick; the first is greater if no voxel is present.
    pub(super) range: [f32; 2],
    /// Leaps that hold for every ray; `None` if there are none, or they are unknown.
    pub(super) cloud: Option<ProximityCloud<MACRO_CELL>>,
    /// Iso values: numbers not below are above the surface.
    pub(super) thresholds: Vec<f32>,
    /// How exactly values are gathered.
    pub(super) care: Care,
    mode: Mode,
}

/// How exactly values are gathered in a brick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Care {
    /// `f32` suffices.
    Packets,
    /// `f32` tells which rays are gathered once more, in `f64`. It is off by at most this, data units.
    Closer(f64),
    /// All in `f64`. Beside holes, the rounding of a place decides whether a value is there, and the error has no bound.
    Exact,
}

impl BrickSummary {
    pub(super) fn new(
        scene: &RayScene,
        brick: &DecodedBrick,
        stored: Stored,
        origin: f32,
        ahead: [AxisDirection; 3],
        tolerated: f64,
    ) -> Self {
        let numbers = Numbers::new(scene, brick, stored, origin);
        let ranges: Vec<[f32; 2]> = brick.macro_ranges.iter().map(|&range| numbers.range(range)).collect();
        let thresholds: Vec<f32> = scene.iso.iter().map(|surface| numbers.threshold(surface.value)).collect();
        let passed = |number: f32| thresholds.iter().filter(|&&threshold| threshold <= number).count();
        let cells = macro_cells_of(brick, APRON);
        let cloud = match scene.mode {
            _ if scene.skipping == Skipping::Off => None,
            Mode::Mean => Some(ProximityCloud::new(brick, APRON, ahead, |[low, high]| low <= high)),
            Mode::Iso => {
                let is_empty = |[low, high]: [f32; 2]| low > high;
                let sides: Vec<_> = ranges.iter().map(|&r| (!is_empty(r)).then(|| passed(r[0]))).collect();
                let shows = |i: usize| !is_empty(ranges[i]) && passed(ranges[i][0]) != passed(ranges[i][1]);
                Some(ProximityCloud::of_sides(cells, &sides, shows))
            }
            Mode::Dvr | Mode::Mip | Mode::Minip | Mode::Slice => None,
        };
        let end = |a: usize, pick: fn(f32, f32) -> f32| ranges.iter().map(|r| r[a]).reduce(pick).unwrap_or(f32::NAN);
        Self {
            numbers,
            range: [end(0, f32::min), end(1, f32::max)],
            ranges: MacroRanges {
                cells,
                low: ranges.iter().map(|r| r[0]).collect(),
                high: ranges.iter().map(|r| r[1]).collect(),
            },
            cloud,
            thresholds,
            care: care_of(scene, brick, tolerated),
            mode: scene.mode,
        }
    }

    pub(super) fn bytes(&self) -> u64 {
        let cloud = self.cloud.as_ref().map_or(0, ProximityCloud::bytes);
        (size_of::<Self>() + 2 * size_of_val(&self.ranges.low[..]) + size_of_val(&self.thresholds[..])) as u64 + cloud
    }

    /// Bytes held for a brick with so many core voxels along each axis.
    pub fn most_bytes(core: usize) -> u64 {
        let ranges = core.div_ceil(MACRO_CELL).pow(3) * size_of::<[f32; 2]>();
        (size_of::<Self>() + ranges + ISO_LIMIT * size_of::<f32>()) as u64
            + ProximityCloud::<MACRO_CELL>::most_bytes(core)
    }

    /// Modes `mip` and `minip`: the number with which a ray of this value so far enters the brick. What is not above it cannot be more
    /// extreme than the value.
    pub(super) fn best(&self, value: f64) -> f32 {
        let value = if let Care::Closer(off) = self.care { worse(self.mode, value, off) } else { value };
        if value.is_nan() { f32::NEG_INFINITY } else { self.numbers.not_above(value) }
    }

    /// Factor of numbers in [`Mean`]: a power of two that brings the largest to about 1.
    pub(super) fn mean_scale(&self) -> f32 {
        let largest = self.range[0].abs().max(self.range[1].abs());
        // The exponent's bits alone; neither it nor its inverse is infinite.
        1.0 / f32::from_bits(largest.clamp(1e-30, 1e30).to_bits() & 0x7f80_0000)
    }

    /// The numbers between which a ray can go on; see [`Host::bounds`].
    pub(super) fn bounds(&self, sides: IsoSides) -> [f32; 2] {
        let mut bounds = [f32::NEG_INFINITY, f32::INFINITY];
        for (i, &threshold) in self.thresholds.iter().enumerate().filter(|(i, _)| sides.hit >> i & 1 == 0) {
            if sides.known == 0 {
                return [f32::INFINITY, f32::NEG_INFINITY];
            }
            if sides.above >> i & 1 == 1 {
                bounds[0] = bounds[0].max(threshold);
            } else {
                bounds[1] = bounds[1].min(threshold);
            }
        }
        bounds
    }
}

/// How exactly values of a brick are gathered if the picture tolerates this error of a value.
fn care_of(scene: &RayScene, brick: &DecodedBrick, tolerated: f64) -> Care {
    let values = brick.macro_ranges.iter().filter(|r| r[0] <= r[1]).fold(ValueRange::EMPTY, |all, &[low, high]| {
        let [low, high] = [low, high].map(|value| scene.map.to_data(value));
        ValueRange { min: all.min.min(low), max: all.max.max(high) }
    });
    let off = by_f32(scene.mode, &scene.map, values, scene.pyramid.layout().core());
    match scene.mode {
        Mode::Iso | Mode::Dvr | Mode::Slice => Care::Packets,
        Mode::Mip | Mode::Minip | Mode::Mean if brick.voxels.has_holes(&scene.map) => Care::Exact,
        _ if off <= tolerated => Care::Packets,
        Mode::Mip | Mode::Minip => Care::Closer(off),
        Mode::Mean => Care::Exact,
    }
}

/// How numbers of a brick and render values go together.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers {
    pub(super) stored: Stored,
    pub(super) map: ValueMap,
    /// Centre that is subtracted from stored numbers; whole if they are.
    pub(super) centre: f32,
    /// Whether numbers have the other sign.
    pub(super) is_turned: bool,
}

impl Numbers {
    pub(super) fn new(scene: &RayScene, brick: &DecodedBrick, stored: Stored, origin: f32) -> Self {
        let map = scene.map;
        let descends = stored != Stored::F32 && map.scale < 0.0;
        let [low, high] = brick
            .macro_ranges
            .iter()
            .filter(|r| r[0] <= r[1])
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], range| [low.min(range[0]), high.max(range[1])]);
        let middle = 0.5 * low + 0.5 * high;
        let centre = match (scene.mode, stored) {
            // The middle: then the integral over one value is 0, and its mean exact.
            (Mode::Mean, Stored::F32) if low <= high => {
                // Whole values are counted as integers are: the same picture, however they are stored.
                let whole = (middle + 0.5).floor();
                if low <= whole && whole <= high { whole } else { middle }
            }
            (Mode::Mean, _) if low <= high => stored.to_values_from(middle, &map)[0],
            (_, Stored::F32) => 0.0,
            _ => stored.to_values_from(origin, &map)[0],
        };
        let is_turned = match scene.mode {
            Mode::Minip => !descends,
            Mode::Mip | Mode::Iso => descends,
            Mode::Mean | Mode::Dvr | Mode::Slice => false,
        };
        Self { stored, map, centre, is_turned }
    }

    pub(super) fn turned(&self, number: f64) -> f64 {
        if self.is_turned { -number } else { number }
    }

    /// The number of a render value, in `f64`.
    pub(super) fn quotient(&self, value: f64) -> f64 {
        let stored = match self.stored {
            Stored::F32 => value,
            _ => (value - f64::from(self.map.offset)) / f64::from(self.map.scale),
        };
        self.turned(stored - f64::from(self.centre))
    }

    /// The number of voxels with this render value; `None` where there is none, or more than one.
    pub(super) fn of_voxel(&self, value: f32) -> Option<f32> {
        if self.stored == Stored::F32 {
            return Some(single(self.quotient(f64::from(value))));
        }
        let quotient = (f64::from(value) - f64::from(self.map.offset)) / f64::from(self.map.scale);
        // `as` rounds down what is not negative, and needs no call.
        let nearest = f64::from(whole::<u32>(quotient + 0.5));
        let has_value = |number: f64| self.map.from_stored_number(single(number)) == value;
        let is_the_one = has_value(nearest) && !has_value(nearest - 1.0) && !has_value(nearest + 1.0);
        is_the_one.then(|| single(self.turned(nearest - f64::from(self.centre))))
    }

    /// The range of numbers of all voxels in a range of render values.
    pub(super) fn range(&self, [low, high]: [f32; 2]) -> [f32; 2] {
        if low > high {
            return [f32::INFINITY, f32::NEG_INFINITY];
        }
        let [a, b] = [low, high].map(|value| self.quotient(f64::from(value)));
        let (least, greatest) = (a.min(b), a.max(b));
        if self.stored == Stored::F32 {
            return [single(least), single(greatest)];
        }
        // Whole numbers that may have these values as far as `f32` tells.
        let size = f64::from(low.abs().max(high.abs())) + f64::from(self.map.offset).abs();
        let rounding = 4.0 * f64::from(f32::EPSILON) * size / f64::from(self.map.scale).abs();
        [single((least - rounding).ceil()), single((greatest + rounding).floor())]
    }

    /// A number that is not greater than a render value's.
    pub(super) fn not_above(&self, value: f64) -> f32 {
        // `as` rounds to the nearest `f32`.
        let exact = self.of_voxel(single(value)).filter(|_| f64::from(single(value)) == value);
        exact.unwrap_or_else(|| single(self.quotient(value)).next_down())
    }

    /// Render value of a number.
    pub(super) fn value(&self, number: f32) -> f64 {
        let stored = self.turned(f64::from(number)) + f64::from(self.centre);
        match self.stored {
            Stored::F32 => stored,
            _ if stored == f64::from(whole::<u32>(stored)) => f64::from(self.map.from_stored_number(single(stored))),
            _ => stored * f64::from(self.map.scale) + f64::from(self.map.offset),
        }
    }

    /// The number of an iso value, where numbers grow with values. Voxels with that number or a greater one, and no others,
    /// have a render value that is not below.
    pub(super) fn threshold(&self, value: f32) -> f32 {
        let quotient = self.quotient(f64::from(value));
        if self.stored == Stored::F32 {
            return single(quotient);
        }
        let is_above = |whole: i64| self.map.from_stored_number(whole.unsigned_abs() as f32) >= value;
        let (mut low, mut high) = if self.is_turned { (-GREATEST_STORED, 1) } else { (0, GREATEST_STORED + 1) };
        while low < high {
            let middle = low + (high - low).div_euclid(2);
            if is_above(middle) { high = middle } else { low = middle + 1 }
        }
        let first_above = single(low as f64 - self.turned(f64::from(self.centre)));
        // Between the last whole number below and the first above: at the surface itself, where `f32` can say so.
        if quotient.is_finite() {
            single(quotient).clamp((first_above - 1.0).next_up(), first_above)
        } else {
            first_above
        }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::VoxelType;

    use super::*;

    const SCALINGS: [[f64; 2]; 6] = [[1.0, 0.0], [-1.0, 255.0], [0.1, 3.7], [-0.013, 2.0], [1e-3, -40.0], [250.0, 1e5]];

    fn numbers(scaling: [f64; 2], stored: Stored, is_turned: bool, centre: f32) -> Numbers {
        let voxel_type = if stored == Stored::U8 { VoxelType::U8 } else { VoxelType::U16 };
        let range = ValueRange { min: 0.0, max: 1.0 };
        let map = ValueMap::for_container(voxel_type, scaling[0], scaling[1], None, range);
        Numbers { stored, map, centre, is_turned }
    }

    /// Numbers of voxels, with their render values, for every map, turn and centre.
    fn for_all(check: impl Fn(&Numbers, &[(f32, f32)])) {
        for scaling in SCALINGS {
            for (is_turned, centre) in [(false, 0.0), (true, 0.0), (false, 77.0), (true, 130.0)] {
                let numbers = numbers(scaling, Stored::U8, is_turned, centre);
                let of = |n: u8| (numbers.turned(f64::from(n) - f64::from(centre)) as f32, f32::from(n));
                let voxels: Vec<(f32, f32)> = (0..=255).map(of).collect();
                let voxels: Vec<_> = voxels.into_iter().map(|(x, n)| (x, numbers.map.from_stored_number(n))).collect();
                check(&numbers, &voxels);
            }
        }
    }

    #[test]
    fn voxels_have_the_scalar_casters_values() {
        for_all(|numbers, voxels| {
            for &(number, value) in voxels {
                assert_eq!(numbers.value(number), f64::from(value));
                assert_eq!(numbers.not_above(f64::from(value)), number, "{numbers:?}");
                let between = number + 0.3;
                let found = numbers.not_above(numbers.value(between));
                assert!(found <= between && found > between - 0.01, "{numbers:?}: {found} for {between}");
            }
        });
    }

    #[test]
    fn ranges_hold_their_voxels_and_no_others() {
        for_all(|numbers, voxels| {
            for pair in [(3, 90), (0, 255), (17, 17)] {
                let (a, b) = (voxels[pair.0], voxels[pair.1]);
                let found = numbers.range([a.1.min(b.1), a.1.max(b.1)]);
                assert_eq!(found, [a.0.min(b.0), a.0.max(b.0)], "{numbers:?}");
            }
        });
        let empty = numbers([1.0, 0.0], Stored::U8, true, 5.0).range([1.0, 0.0]);
        assert!(empty[0] > empty[1]);
    }

    #[test]
    fn thresholds_part_voxels_as_values_do() {
        for_all(|numbers, voxels| {
            // Numbers grow with values where descending maps are turned.
            if numbers.is_turned != (numbers.map.scale < 0.0) {
                return;
            }
            let between = voxels.windows(2).map(|pair| 0.5 * (pair[0].1 + pair[1].1));
            let on = voxels.iter().map(|voxel| voxel.1);
            let beyond = [f32::MIN, f32::MAX, -1e6, 1e7];
            for value in between.chain(on).chain(beyond) {
                let threshold = numbers.threshold(value);
                for &(number, of_voxel) in voxels {
                    assert_eq!(number >= threshold, of_voxel >= value, "{numbers:?}: {value}, voxel {of_voxel}");
                }
            }
        });
    }

    #[test]
    fn maps_that_f32_does_not_resolve_give_ranges_that_hold_all() {
        let numbers = numbers([1.0, 1e9], Stored::U16, false, 0.0);
        let value = numbers.map.from_stored_number(500.0);
        assert_eq!(value, numbers.map.from_stored_number(499.0));
        let [low, high] = numbers.range([value; 2]);
        assert!(low <= 499.0 && high >= 500.0);
    }
}
