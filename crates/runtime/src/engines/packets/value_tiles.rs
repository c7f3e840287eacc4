//! Tiles of rays in the modes that gather values (`mip`, `minip`, `mean`) and in `iso`: the effect of a brick on them.
//!
//! Rays keep render values in `f64`. Within a brick, packets use *numbers*: stored numbers minus a centre. Their sign
//! is changed if the least value is sought, or if greater numbers are lesser values. Integer numbers have the same
//! render values as in the scalar caster.

use supervol_format::BrickKey;
use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_scene::scene::{ISO_LIMIT, Mode};
use supervol_scene::value_map::ValueMap;

use super::fetch::Stored;
use super::leap::{Ahead, MacroRanges, ProximityCloud, macro_cells_of};
use super::per_brick::PerBrick;
use super::simd::{Simd, Task, dispatch};
use super::surfaces::Surfaces;
use super::tile::{BrickGrid, TileRays};
use super::values::{Extreme, Host, Mean, ValuePacket, cast};
use super::walk::PacketBrick;
use super::{CpuFrame, IsoSides, RayCounters, RayState, Skipping};
use crate::engines::cells::{LevelVisit, gather_exact_cell};
use crate::engines::packets::cast::{CastTile, PacketTables, cast_ray, packet_brick};
use crate::stream::residency::DecodedBrick;

/// Greatest integer that a brick can store.
const GREATEST_STORED: i64 = u16::MAX as i64;

/// Summaries of the bricks of a frame in these modes.
pub type BrickSummaries = PerBrick<BrickSummary>;

/// Data about a brick for packets, beside its voxels; all in its numbers.
#[derive(Debug)]
pub struct BrickSummary {
    numbers: Numbers,
    /// Ranges of macro cells.
    ranges: MacroRanges,
    /// Range of the whole brick; the first is greater if nothing is present.
    range: [f32; 2],
    /// Cloud for leaping, valid for any state of a ray; `None` if there is none, or nothing to leap over.
    cloud: Option<ProximityCloud<MACRO_CELL>>,
    /// Iso values as numbers: numbers not below are above the surface.
    thresholds: Vec<f32>,
}

impl BrickSummary {
    fn new(frame: &CpuFrame, brick: &DecodedBrick, stored: Stored, origin: f32, ahead: [Ahead; 3]) -> Self {
        let numbers = Numbers::new(frame, brick, stored, origin);
        let ranges: Vec<[f32; 2]> = brick.macro_ranges.iter().map(|&range| numbers.range(range)).collect();
        let thresholds: Vec<f32> = frame.iso.iter().map(|surface| numbers.threshold(surface.value)).collect();
        let passed = |number: f32| thresholds.iter().filter(|&&threshold| threshold <= number).count();
        let cells = macro_cells_of(brick, APRON);
        let cloud = match frame.mode {
            _ if frame.skipping == Skipping::Off => None,
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
        }
    }

    fn bytes(&self) -> u64 {
        let cloud = self.cloud.as_ref().map_or(0, ProximityCloud::bytes);
        (size_of::<Self>() + 2 * size_of_val(&self.ranges.low[..]) + size_of_val(&self.thresholds[..])) as u64 + cloud
    }

    /// Bytes held for a brick with `core` core voxels along each axis.
    pub fn most_bytes(core: usize) -> u64 {
        let ranges = core.div_ceil(MACRO_CELL).pow(3) * size_of::<[f32; 2]>();
        (size_of::<Self>() + ranges + ISO_LIMIT * size_of::<f32>()) as u64
            + ProximityCloud::<MACRO_CELL>::most_bytes(core)
    }

    /// Factor of numbers in [`Mean`]: a power of two that brings the largest to about 1.
    fn mean_scale(&self) -> f32 {
        let largest = self.range[0].abs().max(self.range[1].abs());
        // The exponent's bits alone; neither it nor its inverse is infinite.
        1.0 / f32::from_bits(largest.clamp(1e-30, 1e30).to_bits() & 0x7f80_0000)
    }

    /// The numbers between which a ray meets no surface; see [`Host::bounds`].
    fn bounds(&self, sides: IsoSides) -> [f32; 2] {
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

/// Relation between the numbers of a brick and render values.
#[derive(Debug, Clone, Copy)]
struct Numbers {
    stored: Stored,
    map: ValueMap,
    /// Subtracted from stored numbers; an integer if they are.
    centre: f32,
    /// Whether the sign is changed.
    is_turned: bool,
}

impl Numbers {
    fn new(frame: &CpuFrame, brick: &DecodedBrick, stored: Stored, origin: f32) -> Self {
        let map = frame.map;
        let descends = stored != Stored::F32 && map.scale < 0.0;
        let [low, high] = brick
            .macro_ranges
            .iter()
            .filter(|r| r[0] <= r[1])
            .fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], range| [low.min(range[0]), high.max(range[1])]);
        let middle = 0.5 * low + 0.5 * high;
        let centre = match (frame.mode, stored) {
            // The middle: the integral over a uniform value is then 0, and its mean exact.
            (Mode::Mean, Stored::F32) if low <= high => {
                // Integer values are centred as integer types are: the same picture for any storage.
                let whole = (middle + 0.5).floor();
                if low <= whole && whole <= high { whole } else { middle }
            }
            (Mode::Mean, _) if low <= high => stored.to_values_from(middle, &map)[0],
            (_, Stored::F32) => 0.0,
            _ => stored.to_values_from(origin, &map)[0],
        };
        let is_turned = match frame.mode {
            Mode::Minip => !descends,
            Mode::Mip | Mode::Iso => descends,
            Mode::Mean | Mode::Dvr | Mode::Slice => false,
        };
        Self { stored, map, centre, is_turned }
    }

    fn turned(&self, number: f64) -> f64 {
        if self.is_turned { -number } else { number }
    }

    /// The number of a render value, in `f64`.
    fn quotient(&self, value: f64) -> f64 {
        let stored = match self.stored {
            Stored::F32 => value,
            _ => (value - f64::from(self.map.offset)) / f64::from(self.map.scale),
        };
        self.turned(stored - f64::from(self.centre))
    }

    /// The number of voxels with this render value; `None` if there is none, or more than one.
    fn of_voxel(&self, value: f32) -> Option<f32> {
        if self.stored == Stored::F32 {
            return Some(self.quotient(f64::from(value)) as f32);
        }
        let quotient = (f64::from(value) - f64::from(self.map.offset)) / f64::from(self.map.scale);
        // `as` rounds down numbers that are not negative, without a call.
        let nearest = f64::from((quotient + 0.5) as u32);
        let has_value = |number: f64| self.map.from_stored_number(number as f32) == value;
        let is_the_one = has_value(nearest) && !has_value(nearest - 1.0) && !has_value(nearest + 1.0);
        is_the_one.then(|| self.turned(nearest - f64::from(self.centre)) as f32)
    }

    /// The range of numbers of all voxels in a range of render values.
    fn range(&self, [low, high]: [f32; 2]) -> [f32; 2] {
        if low > high {
            return [f32::INFINITY, f32::NEG_INFINITY];
        }
        let [a, b] = [low, high].map(|value| self.quotient(f64::from(value)));
        let (least, greatest) = (a.min(b), a.max(b));
        if self.stored == Stored::F32 {
            return [least as f32, greatest as f32];
        }
        // Integers that may have these values within the precision of `f32`.
        let size = f64::from(low.abs().max(high.abs())) + f64::from(self.map.offset).abs();
        let rounding = 4.0 * f64::from(f32::EPSILON) * size / f64::from(self.map.scale).abs();
        [(least - rounding).ceil() as f32, (greatest + rounding).floor() as f32]
    }

    /// A number that is at most that of a render value.
    fn not_above(&self, value: f64) -> f32 {
        // `as` rounds to the nearest `f32`.
        let exact = self.of_voxel(value as f32).filter(|_| f64::from(value as f32) == value);
        exact.unwrap_or_else(|| (self.quotient(value) as f32).next_down())
    }

    /// Render value of a number.
    fn value(&self, number: f32) -> f64 {
        let stored = self.turned(f64::from(number)) + f64::from(self.centre);
        match self.stored {
            Stored::F32 => stored,
            _ if stored == f64::from(stored as u32) => f64::from(self.map.from_stored_number(stored as f32)),
            _ => stored * f64::from(self.map.scale) + f64::from(self.map.offset),
        }
    }

    /// The number of an iso value, if numbers grow with values. Voxels with at least that number, and no others, have a
    /// render value that is not below.
    fn threshold(&self, value: f32) -> f32 {
        let quotient = self.quotient(f64::from(value));
        if self.stored == Stored::F32 {
            return quotient as f32;
        }
        let is_above = |whole: i64| self.map.from_stored_number(whole.unsigned_abs() as f32) >= value;
        let (mut low, mut high) = if self.is_turned { (-GREATEST_STORED, 1) } else { (0, GREATEST_STORED + 1) };
        while low < high {
            let middle = low + (high - low).div_euclid(2);
            if is_above(middle) { high = middle } else { low = middle + 1 }
        }
        let first_above = (low as f64 - self.turned(f64::from(self.centre))) as f32;
        // Between the last integer below and the first above: at the surface itself, if `f32` can represent it.
        if quotient.is_finite() {
            (quotient as f32).clamp((first_above - 1.0).next_up(), first_above)
        } else {
            first_above
        }
    }
}

impl CastTile<'_> {
    /// Casts all rays through a brick.
    pub(super) fn gather_brick(&mut self, key: BrickKey, brick: &DecodedBrick) {
        let (frame, tables) = (self.frame, self.tables);
        let (packet_brick, grid) = packet_brick(frame, key, brick);
        let make = || BrickSummary::new(frame, brick, packet_brick.stored, tables.origin, tables.ahead(frame, key));
        let summary = tables.summaries.of(frame.field.brick(key), BrickSummary::bytes, make);
        if frame.skipping == Skipping::On && !self.may_change(&summary) {
            self.feedback.counters.macro_cells_skipped += self.rays.hits().len() as u64;
            return;
        }
        let packet_brick = PacketBrick { centre: summary.numbers.centre, ..packet_brick };
        let corner = self.corner;
        let host = TileHost { frame, tables, key, brick, summary: &summary, grid, corner, rays: self.rays, next: 0 };
        let work = dispatch(tables.set, GatherBrick { packet_brick, host });
        self.feedback.counters.add(&work);
    }

    /// Whether a brick may change the rays that meet it. Removes rays that it cannot change, and records the sides on
    /// which they come out.
    fn may_change(&mut self, summary: &BrickSummary) -> bool {
        let cloud = summary.cloud.as_ref();
        match self.frame.mode {
            Mode::Mip | Mode::Minip => {
                let best = |ray: usize, gathered: &super::tile::Gathered| {
                    let value = gathered.value[ray];
                    if value.is_nan() { f32::NEG_INFINITY } else { summary.numbers.not_above(value) }
                };
                self.rays.keep_hits(|ray, gathered| best(ray, gathered) < summary.range[1]) > 0
            }
            Mode::Iso if cloud.is_some_and(|cloud| cloud.is_empty()) => {
                let thresholds = || summary.thresholds.iter().copied();
                self.rays.keep_hits(|ray, gathered| !gathered.iso[ray].pass(summary.range, thresholds())) > 0
            }
            _ => cloud.is_none_or(|cloud| !cloud.is_empty()),
        }
    }

    /// Casts all rays through a uniform value.
    pub(super) fn gather_uniform(&mut self, key: BrickKey, value: f32) {
        let iso = || self.frame.iso.iter().map(|surface| surface.value);
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let [t0, t1] = self.rays.interval(ray);
            let place = usize::from(ray);
            if self.frame.mode == Mode::Iso && self.rays.gathered.iso[place].pass([value; 2], iso()) {
                continue;
            }
            let cast_ray = cast_ray(self.frame, self.tables, self.rays, self.corner, ray);
            let visit = LevelVisit::new(self.frame, &cast_ray, key);
            let mut state = RayState { t: t0, ..self.rays.gathered.state(place) };
            let counters = &mut self.feedback.counters;
            self.frame.integrator.gather_uniform(&visit, value, [t0, t1], &mut state, counters);
            self.rays.gathered.set_state(place, &state);
            self.rays.crossings.extend(state.crossings.drain(..).map(|crossing| (ray, crossing)));
            if self.frame.is_done(&state) {
                self.rays.end(place);
            }
        }
    }

    /// Casts all rays through nothing.
    pub(super) fn gather_nothing(&mut self) {
        for i in 0..self.rays.hits().len() {
            let ray = usize::from(self.rays.hits()[i]);
            self.rays.gathered.iso[ray].known = 0;
        }
    }
}

/// Casts the rays of a tile that meet a brick, packet by packet.
struct GatherBrick<'a> {
    packet_brick: PacketBrick<'a>,
    host: TileHost<'a>,
}

impl Task for GatherBrick<'_> {
    type Output = RayCounters;

    #[inline(always)]
    fn run<S: Simd>(mut self) -> RayCounters {
        let (brick, summary) = (&self.packet_brick, self.host.summary);
        let leaps = self.host.frame.skipping == Skipping::On;
        let is_turned = summary.numbers.is_turned;
        let cloud = summary.cloud.as_ref();
        // SAFETY, for all three: `packet_brick` compared strides, core and length of the voxels; the summary is the
        // brick's.
        match self.host.frame.mode {
            Mode::Mip | Mode::Minip => {
                let mut extreme = Extreme::<S>::new(is_turned, leaps.then_some(&summary.ranges));
                unsafe { cast::<S, _>(brick, &mut extreme, &mut self.host) }
            }
            Mode::Mean => {
                let mut mean = Mean::<S>::new(summary.mean_scale(), cloud.filter(|cloud| !cloud.is_dense()));
                unsafe { cast::<S, _>(brick, &mut mean, &mut self.host) }
            }
            Mode::Iso => {
                let Numbers { stored, map, centre, .. } = summary.numbers;
                let may_have_holes = stored == Stored::F32 || map.absent.is_some();
                let offset_size =
                    if stored == Stored::F32 { 0.0 } else { centre.abs() + (map.offset / map.scale).abs() };
                let quiet = cloud.map(|cloud| (cloud, &summary.ranges));
                let mut surfaces = Surfaces::<S>::new(is_turned, may_have_holes, offset_size, quiet);
                unsafe { cast::<S, _>(brick, &mut surfaces, &mut self.host) }
            }
            Mode::Dvr | Mode::Slice => RayCounters::default(),
        }
    }
}

/// Host of the rays of a tile that meet a brick.
struct TileHost<'a> {
    frame: &'a CpuFrame,
    tables: &'a PacketTables,
    key: BrickKey,
    brick: &'a DecodedBrick,
    summary: &'a BrickSummary,
    grid: BrickGrid,
    /// The tile's first pixel.
    corner: [u32; 2],
    rays: &'a mut TileRays,
    /// The next hit to lend.
    next: usize,
}

impl TileHost<'_> {
    /// Adds to a ray its part of the mean.
    fn add_integral(&mut self, ray: usize, [integral, present, absent]: [f32; 3], length: f64) {
        if present == 0.0 {
            return;
        }
        let Numbers { stored, map, .. } = self.summary.numbers;
        let length = if absent == 0.0 { length } else { f64::from(present) };
        let scale = if stored == Stored::F32 { 1.0 } else { f64::from(map.scale) };
        let integral = f64::from(integral) * scale / f64::from(self.summary.mean_scale());
        let integral = integral + self.summary.numbers.value(0.0) * length;
        let gathered = &mut self.rays.gathered;
        let before = gathered.value[ray];
        gathered.value[ray] = if before.is_nan() { 0.0 } else { before } + integral;
        gathered.length[ray] += length;
    }
}

impl Host for TileHost<'_> {
    fn lend(&mut self, lane: usize, packet: &mut ValuePacket) -> bool {
        let Some(&ray) = self.rays.hits().get(self.next) else { return false };
        self.rays.pack(self.next, &self.grid, lane, &mut packet.way);
        self.next += 1;
        match self.frame.mode {
            Mode::Mip | Mode::Minip => {
                let value = self.rays.gathered.value[usize::from(ray)];
                let best = if value.is_nan() { f32::NEG_INFINITY } else { self.summary.numbers.not_above(value) };
                packet.numbers[0][lane] = best;
            }
            Mode::Iso => [packet.numbers[0][lane], packet.numbers[1][lane]] = self.bounds(ray),
            Mode::Mean | Mode::Dvr | Mode::Slice => {}
        }
        true
    }

    fn take_back(&mut self, lane: usize, packet: &ValuePacket) {
        let ray = packet.way.rays[lane];
        let number = packet.numbers[0][lane];
        let value = &mut self.rays.gathered.value[usize::from(ray)];
        match self.frame.mode {
            Mode::Mip if number > f32::NEG_INFINITY => *value = value.max(self.summary.numbers.value(number)),
            Mode::Minip if number > f32::NEG_INFINITY => *value = value.min(self.summary.numbers.value(number)),
            Mode::Mean => {
                let [t0, t1] = self.rays.interval(ray);
                self.add_integral(usize::from(ray), packet.numbers.map(|number| number[lane]), t1 - t0);
            }
            _ => {}
        }
    }

    #[cold]
    fn settle(&mut self, ray: u16, base: i32) {
        let cast_ray = cast_ray(self.frame, self.tables, self.rays, self.corner, ray);
        let place = usize::from(ray);
        let mut state = self.rays.gathered.state(place);
        let base = usize::try_from(base).expect("cells of a brick lie behind its first voxel");
        let level = LevelVisit::new(self.frame, &cast_ray, self.key);
        gather_exact_cell(level, self.brick, self.key, base, self.rays.interval(ray), &mut state);
        self.rays.gathered.set_state(place, &state);
        self.rays.crossings.extend(state.crossings.drain(..).map(|crossing| (ray, crossing)));
        if self.frame.is_done(&state) {
            self.rays.end(place);
        }
    }

    fn pass(&mut self, ray: u16, range: [f32; 2]) -> bool {
        let thresholds = self.summary.thresholds.iter().copied();
        self.rays.gathered.iso[usize::from(ray)].pass(range, thresholds)
    }

    fn bounds(&self, ray: u16) -> [f32; 2] {
        if self.rays.is_going(usize::from(ray)) {
            self.summary.bounds(self.rays.gathered.iso[usize::from(ray)])
        } else {
            [f32::NEG_INFINITY, f32::INFINITY]
        }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{ValueRange, VoxelType};

    use super::*;

    const SCALINGS: [[f64; 2]; 6] = [[1.0, 0.0], [-1.0, 255.0], [0.1, 3.7], [-0.013, 2.0], [1e-3, -40.0], [250.0, 1e5]];

    fn numbers(scaling: [f64; 2], stored: Stored, is_turned: bool, centre: f32) -> Numbers {
        let voxel_type = if stored == Stored::U8 { VoxelType::U8 } else { VoxelType::U16 };
        let range = ValueRange { min: 0.0, max: 1.0 };
        let map = ValueMap::for_container(voxel_type, scaling[0], scaling[1], None, range);
        Numbers { stored, map, centre, is_turned }
    }

    /// Numbers of voxels, with their render values, for every map, sign and centre.
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
            // Numbers grow with values if descending maps change the sign.
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
