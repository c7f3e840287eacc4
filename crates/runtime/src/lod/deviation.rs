//! Deviation of drawn rays from rays through the source's own voxels. It has two causes: bricks of coarser levels, and
//! voxels that were moved to compress the container. It is computed from the value ranges and errors in the table of
//! contents, seen through the transfer function. Below, "level 0" is that of the source: a container of moved voxels is
//! one more level above it.
//!
//! [`by_error`](super::by_error) decides whether a brick may be drawn, from the brick alone and for any ray. This
//! module works on a drawn picture, where the opacity that a ray gathered in the brick is known. So its bound is far
//! tighter.
//!
//! ## The bound of a ray in mode `dvr`
//!
//! A ray gathers `C = sum over bricks of T_i E_i`: T_i is the transmittance in front of brick i, E_i its own
//! premultiplied colour. All colours are in [0, 1]. Exchange its bricks for those of level 0, one after the other,
//! front to back. The exchange of brick i changes the ray by at most `T'_i |(E - E') + (t - t') B|`. T' is the
//! transmittance through the level-0 bricks in front, t and t' that of the brick before and after the exchange, B in
//! [0, 1] the colour behind.
//!
//! *In the brick*, let kappa and q = kappa c be the drawn extinction and emission at a place, kappa' and q' the exact
//! ones. Move from one to the other in equal shares (as in `by_error`). The change is at most the integral over the
//! brick of `t e^d r`. Here `r = max(|kappa - kappa'|, |q - q'|, |(q - kappa) - (q' - kappa')|)`, and d is the integral
//! of `max(0, kappa - kappa')` up to that place. Choose numbers a and b such that `r <= a kappa + b` for all values of
//! the brick. Then `integral of t (a kappa + b) <= a (1 - t) + b l` over the length l. Two bounds of d: its length
//! times the greatest `kappa - kappa'`, and `-ln t`. Several pairs (a, b) are kept; the least of their sums counts. The
//! change is never more than `1 - exp(-kappa_max l)`, with kappa_max over the brick's own and all exact values.
//!
//! *In front*, `T' <= T e^D`, with D the sum of d over the bricks so far. All light from behind a place with
//! transmittance T changes the ray by at most T. So at every place the sum so far plus T is a bound too. It is the only
//! bound for a ray that ended there.
//!
//! *In macro cells*, b and d are smaller than in the whole brick, because their errors and ranges are. With the same a in
//! all cells of the brick that the ray crosses, the sum of `b l` over them takes the place of `b l`. The lesser of both
//! bounds counts: the range of the brick is examined in smaller parts.
//!
//! *With opacity by the gradient*, both extinctions are multiplied by a factor, m and m', at most 1: `|m kappa - m' kappa'|` is
//! at most `m |kappa - kappa'| + kappa' |m - m'|`, and emission likewise. So with the same a, b grows by the greatest exact
//! extinction times the greatest `|m - m'|`: 1 on another level, whose gradient is unknown. Where values of level 0 moved by at
//! most e, each central difference moved by e, and the gradient by at most the length that three of them make in the world.
//!
//! If voxels may be absent in one level and not in the other, a drawn value may be exchanged for nothing, and nothing
//! for any value beneath. Shaded colours are unknown: r is then the greater of both extinctions.
//!
//! In `mip`, `minip` and `mean` the value of a ray is off; [`Deviation::value`] bounds it. In `iso`, everything behind
//! the first brick whose exact values hold an iso value may be different.

use glam::DVec3;
use supervol_format::cast::whole;
use supervol_format::container::toc::BrickEntry;
use supervol_format::{BrickKey, Geometry, Lod, ValueRange};
use supervol_scene::image::GREY_LEVELS;
use supervol_scene::scene::{GradientOpacity, Mode, ResolvedScene};
use supervol_scene::transfer_function::intervals::Extent;
use supervol_scene::transfer_function::{ALPHA_LIMIT, Intervals};

use super::by_error::DataScale;

/// Parts of a brick's range of drawn values that are examined one by one, for each error that the range is wide. Exact values reach
/// beyond a part by the error, so that more would hardly find anything smaller. With half as many, a smooth volume stated 9.8 levels
/// at E = 8, and with all it states 5.8.
const PARTS_PER_ERROR: f64 = 8.0;
/// Least and most parts of a brick's range.
const PARTS: [f64; 2] = [64.0, 8192.0];
/// The same of a macro cell, of which a brick has hundreds.
const CELL_PARTS: [f64; 2] = [16.0; 2];
/// Divisor that makes a number of grey levels a little more than as large a share of full scale.
const SCALE: f64 = GREY_LEVELS - 1.0;
/// a of each pair, see the module. A brick that `by_error` lets pass at E has a small b for the a that is E / 2.
pub const PER_OPACITY: [f64; 12] = [
    0.0,
    0.25 / SCALE,
    0.5 / SCALE,
    1.0 / SCALE,
    2.0 / SCALE,
    4.0 / SCALE,
    8.0 / SCALE,
    16.0 / SCALE,
    32.0 / SCALE,
    64.0 / SCALE,
    128.0 / SCALE,
    1.0,
];

/// Whether interpolation in a brick, or in a brick beneath it, may reach an absent voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Holes {
    /// All voxels are present.
    None,
    /// Some voxel may be absent.
    Possible,
}

/// Deviation of one drawn brick from level 0; see the module. World lengths, data values, 1 is white.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// Mode `dvr`: b for each a of [`PER_OPACITY`].
    pub(crate) per_length: [f64; PER_OPACITY.len()],
    /// Mode `dvr`: greatest difference of the drawn extinction above the exact one.
    pub(crate) thinner: f64,
    /// Greatest extinction, drawn or exact; infinite in mode `iso` if a surface may lie beneath.
    pub(crate) kappa_max: f64,
    /// Largest difference of a value; infinite if a value may be present or absent.
    pub value: f64,
    /// Least and greatest exact value; empty if there is none.
    pub beneath: ValueRange,
    /// Whether a voxel in the brick or beneath it may be absent. Then something may be drawn where nothing is, and the
    /// reverse.
    pub presence_may_change: bool,
}

impl Deviation {
    /// Deviation of level 0.
    pub const NONE: Self = Self {
        per_length: [0.0; PER_OPACITY.len()],
        thinner: 0.0,
        kappa_max: 0.0,
        value: 0.0,
        beneath: ValueRange::EMPTY,
        presence_may_change: false,
    };
    /// Deviation of an unknown brick.
    pub const UNKNOWN: Self = Self {
        per_length: [f64::INFINITY; PER_OPACITY.len()],
        thinner: f64::INFINITY,
        kappa_max: f64::INFINITY,
        value: f64::INFINITY,
        beneath: ValueRange { min: f64::NEG_INFINITY, max: f64::INFINITY },
        presence_may_change: true,
    };

    /// Whether there is no deviation.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Whether surfaces may be elsewhere than drawn: then nothing bounds the light that they hide.
    #[must_use]
    pub fn is_unbounded(&self) -> bool {
        self.kappa_max.is_infinite()
    }

    /// Largest deviation of a ray that crosses `length` of the brick, if nothing of it is drawn; as a share of the transmittance in front.
    #[must_use]
    pub fn of_nothing(&self, length: f64) -> f64 {
        -(-self.kappa_max * length).exp_m1()
    }

    /// Largest distance of an exact extreme beyond the drawn one, `drawn`; `to_limit`: distance from there to the
    /// extreme exact value.
    fn beyond(&self, drawn: f64, to_limit: f64) -> f64 {
        // Exact values lie beyond the drawn one at most as far as their own range does.
        if drawn.is_nan() { self.value } else { to_limit.clamp(0.0, self.value) }
    }
}

/// Deviation summed up over the macro cells of a brick that a ray crosses, or that of the brick as one cell; mode `dvr`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CrossedCells {
    /// Sum of b times length, for each a of [`PER_OPACITY`].
    per_length: [f64; PER_OPACITY.len()],
    thinner: f64,
    /// Greatest optical depth.
    depth: f64,
}

impl CrossedCells {
    /// Adds a macro cell that the ray crosses for this length.
    pub fn add(&mut self, length: f64, cell: &Deviation) {
        for (sum, b) in self.per_length.iter_mut().zip(cell.per_length) {
            *sum += b * length;
        }
        self.thinner += cell.thinner * length;
        self.depth += cell.kappa_max * length;
    }

    /// The deviation of a brick of which a ray crosses this length.
    fn of_brick(length: f64, brick: &Deviation) -> Self {
        let mut crossed = Self::default();
        crossed.add(length, brick);
        crossed
    }

    /// Largest excess of the drawn optical depth over the exact one. The ray keeps the share `through` of its light.
    fn thinner(&self, through: f64) -> f64 {
        self.thinner.min(-through.ln())
    }

    /// Largest deviation of such a ray, as a share of the transmittance in front of the brick.
    fn of_ray(&self, through: f64) -> f64 {
        let opacity = 1.0 - through;
        let sums = PER_OPACITY.iter().zip(self.per_length).map(|(a, sum)| a * opacity + sum);
        let integral = sums.fold(f64::INFINITY, f64::min);
        (integral * self.thinner(through).exp()).min(-(-self.depth).exp_m1())
    }
}

/// A finished ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FinishedRay {
    /// Transmittance left when the ray ended early: light from behind that is left out.
    pub behind: f64,
    /// `mip`, `minip`, `mean`: its value, data units; NaN if there is none.
    pub value: f64,
    /// `mean`: world length over which values are present.
    pub length: f64,
    /// Error of its cells, and all other errors not caused by coarser levels; 1 is white.
    pub own: f64,
    /// Premultiplied colour, and opacity.
    pub pixel: [f32; 4],
}

/// Deviation summed up along a ray over the bricks it has passed; see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayDeviation {
    /// `dvr`, `iso`: sum of the bricks' deviations so far; `mean`: deviation of values times length.
    pub(crate) sum: f64,
    /// `dvr`, `iso`: least of sum plus transmittance over all places so far.
    pub(crate) bound: f64,
    /// `dvr`: largest possible excess of drawn optical depth in front.
    pub(crate) thinner: f64,
    /// `mip`, `minip`: how far the exact value may lie below.
    pub(crate) below: f64,
    /// `mip`, `minip`: how far the exact value may lie above.
    pub(crate) above: f64,
}

impl RayDeviation {
    /// Deviation of a ray that has passed nothing.
    pub const NONE: Self = Self { sum: 0.0, bound: 1.0, thinner: 0.0, below: 0.0, above: 0.0 };

    /// `dvr`, `iso`: adds a brick. The ray crossed `length` of it, and its transmittance changed from `before` to
    /// `after`; `None` if nothing of the brick is drawn.
    pub fn note_brick(&mut self, before: f64, after: Option<f64>, length: f64, deviation: &Deviation) {
        if before == 0.0 {
            return;
        }
        match after {
            Some(after) => self.note_drawn(before, after, &[CrossedCells::of_brick(length, deviation)]),
            None => {
                let in_front = self.note_before(before);
                self.sum += in_front * deviation.of_nothing(length);
            }
        }
    }

    /// Light that may come from behind this transmittance, at most. Where the ray ends here, the light left is the bound.
    fn note_before(&mut self, before: f64) -> f64 {
        self.bound = self.bound.min(self.sum + before);
        (before * self.thinner.exp()).min(1.0)
    }

    /// Adds a brick of which all these are deviations.
    fn note_drawn(&mut self, before: f64, after: f64, all: &[CrossedCells]) {
        let in_front = self.note_before(before);
        let through = after / before;
        self.sum += in_front * all.iter().map(|crossed| crossed.of_ray(through)).fold(1.0, f64::min);
        self.thinner += all.iter().map(|crossed| crossed.thinner(through)).fold(f64::INFINITY, f64::min);
    }

    /// `dvr`: adds a drawn brick whose deviation is also known in each macro cell; as [`Self::note_brick`].
    pub fn note_cells(&mut self, [before, after]: [f64; 2], length: f64, brick: &Deviation, crossed: &CrossedCells) {
        if before == 0.0 || crossed.depth == 0.0 {
            return;
        }
        self.note_drawn(before, after, &[*crossed, CrossedCells::of_brick(length, brick)]);
    }

    /// `dvr`, `iso`: deviation of a ray that has at most the light `behind` left at its end.
    #[must_use]
    pub fn of_ray(&self, behind: f64) -> f64 {
        (self.sum + behind).min(self.bound)
    }

    /// `mip`: adds a brick that the ray met with this greatest value and left with that; NaN if there is none.
    pub fn note_greatest(&mut self, [before, after]: [f64; 2], deviation: &Deviation) {
        self.above = self.above.max(deviation.beyond(after, deviation.beneath.max - after));
        if before.is_nan() || before != after {
            self.below = deviation.value;
        }
    }

    /// `minip`: adds a brick that the ray met with this least value and left with that; NaN if there is none.
    pub fn note_least(&mut self, [before, after]: [f64; 2], deviation: &Deviation) {
        self.below = self.below.max(deviation.beyond(after, after - deviation.beneath.min));
        if before.is_nan() || before != after {
            self.above = deviation.value;
        }
    }

    /// `mip`, `minip`: how far below and above the drawn value the exact value may lie.
    #[must_use]
    pub fn reach(&self) -> [f64; 2] {
        [self.below, self.above]
    }

    /// `mean`: adds a brick that contributed to the integral of the ray's values.
    pub fn note_mean(&mut self, length: f64, deviation: &Deviation) {
        self.sum += deviation.value * length;
    }

    /// `mean`: how far below and above the drawn mean over this length the exact mean may lie.
    #[must_use]
    pub fn mean_reach(&self, length: f64) -> [f64; 2] {
        if self.sum == 0.0 { [0.0; 2] } else { [self.sum / length; 2] }
    }
}

/// Drawn values, exact values, and their distance; data units.
#[derive(Debug, Clone, Copy)]
struct Values {
    own: ValueRange,
    beneath: ValueRange,
    error: f64,
}

/// Greatest length of a gradient in the world of which each central difference is at most 1.
fn longest_of_unit_differences(geometry: &Geometry) -> f64 {
    let to_world = geometry.world_from_index_gradient();
    let signs = [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]];
    signs.map(|[y, z]| (to_world * DVec3::new(1.0, y, z)).length()).into_iter().fold(0.0, f64::max)
}

/// Computes the deviation of bricks for one scene; see the module.
#[derive(Debug, Clone)]
pub struct Deviations {
    mode: Mode,
    intervals: Intervals,
    /// Iso values, data units.
    iso: Vec<f64>,
    is_shaded: bool,
    /// With opacity by the gradient: greatest change of its factor in level 0, where voxels moved.
    change_of_factor: Option<f64>,
    scale: f64,
    offset: f64,
    value_range: ValueRange,
    voxel_error: f64,
    /// Bound on what the engine's values of rays are off by; modes that gather values.
    value_error: f64,
}

impl Deviations {
    /// Deviations for pictures of a scene, by an engine whose values of rays are off by at most `value_error` (data units).
    #[must_use]
    pub fn new(scene: &ResolvedScene, data: &DataScale<'_>, value_error: f64) -> Self {
        Self {
            mode: scene.mode,
            intervals: Intervals::new(&scene.transfer_function),
            iso: scene.iso.iter().map(|surface| surface.value).collect(),
            is_shaded: scene.shading.is_some(),
            change_of_factor: scene.gradient_opacity.map(|GradientOpacity { from, to }| {
                let moved = data.voxel_error * longest_of_unit_differences(data.geometry);
                (moved / (to - from)).min(1.0)
            }),
            scale: data.scale,
            offset: data.offset,
            value_range: data.value_range.widened(data.voxel_error),
            voxel_error: data.voxel_error,
            value_error,
        }
    }

    /// Whether the finest level holds the source's own voxels: then bricks of it have no deviation.
    #[must_use]
    pub fn is_finest_exact(&self) -> bool {
        self.voxel_error == 0.0
    }

    /// Deviation of the brick with this entry.
    #[must_use]
    pub fn of(&self, key: BrickKey, entry: &BrickEntry, holes: Holes) -> Deviation {
        let beneath = self.data_range(entry.range_beneath).widened(self.voxel_error);
        let values = Values { own: self.data_range(entry.range), beneath, error: entry.error * self.scale.abs() };
        // Voxels of the finest level were moved by far less than the range of a brick: that many parts would take longer than the brick.
        let parts = if key.lod() == Lod::FINEST { [PARTS[0]; 2] } else { PARTS };
        self.of_values(key, values, holes, parts)
    }

    /// Deviation of a macro cell of the brick with this entry. Its values lie in `own` (data units) and are off by at most
    /// `error` (stored units). No voxel of the brick or beneath it is absent.
    #[must_use]
    pub fn of_cell(&self, key: BrickKey, entry: &BrickEntry, own: ValueRange, error: f64) -> Deviation {
        let error = error * self.scale.abs();
        let of_brick = self.data_range(entry.range_beneath).widened(self.voxel_error);
        let around = own.widened(error);
        let beneath = ValueRange { min: around.min.max(of_brick.min), max: around.max.min(of_brick.max) };
        self.of_values(key, Values { own, beneath, error }, Holes::None, CELL_PARTS)
    }

    fn of_values(&self, key: BrickKey, values: Values, holes: Holes, parts: [f64; 2]) -> Deviation {
        let Values { own, beneath, error } = values;
        let is_finest = key.lod() == Lod::FINEST;
        // Holes are the same in level 0. Normals are the same where no voxel has moved.
        let may_have_holes = holes == Holes::Possible && !is_finest;
        let is_unshaded = is_finest || !(self.is_shaded && matches!(self.mode, Mode::Dvr | Mode::Iso));
        let is_exact = is_finest && self.is_finest_exact();
        // Equal values beneath have no gradient there, but next to it they may.
        let keeps_gradients = is_finest || self.change_of_factor.is_none();
        if is_exact || beneath.is_empty() || (error == 0.0 && !may_have_holes && is_unshaded && keeps_gradients) {
            return Deviation::NONE;
        }
        let known = Deviation {
            value: if may_have_holes { f64::INFINITY } else { error },
            beneath,
            presence_may_change: may_have_holes,
            ..Deviation::NONE
        };
        let has_surface = self.iso.iter().any(|&value| beneath.contains(value));
        match self.mode {
            // The position of a surface on another level, or without the error, is unknown.
            Mode::Dvr | Mode::Iso if has_surface => Deviation { kappa_max: f64::INFINITY, ..known },
            Mode::Dvr => {
                let found = self.of_rays(own, (error, parts), known);
                let factor = self.change_of_factor.map_or(0.0, |change| if is_finest { change } else { 1.0 });
                self.with_change_of_factor(found, own, factor)
            }
            Mode::Iso => Deviation::NONE,
            Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => known,
        }
    }

    /// Adds the values of mode `dvr` to `known`: drawn values lie in `own`, each off by at most `error`.
    fn of_rays(&self, own: ValueRange, (error, [least, most]): (f64, [f64; 2]), known: Deviation) -> Deviation {
        let kappa = |alpha| self.intervals.function().kappa(alpha);
        let kappa_max = |range: ValueRange| {
            if range.is_empty() { 0.0 } else { kappa(self.intervals.extent(range.min, range.max).high[3]) }
        };
        let beneath = known.beneath;
        let mut found = Deviation { kappa_max: kappa_max(own).max(kappa_max(beneath)), ..known };
        if found.kappa_max == 0.0 {
            return Deviation::NONE;
        }
        if known.presence_may_change {
            found.per_length = [kappa_max(beneath); PER_OPACITY.len()];
            found.thinner = kappa_max(own);
        }
        if own.is_empty() {
            return found;
        }
        // No error and no width: the least number.
        let parts = whole::<usize>((PARTS_PER_ERROR * own.width() / error).max(least).min(most));
        for part in 0..parts {
            let place = |i: usize| own.min + (own.max - own.min) * (i as f64 / parts as f64);
            let [low, high] = [place(part), if part + 1 == parts { own.max } else { place(part + 1) }];
            let least = kappa(self.intervals.extent(low, high).low[3]);
            // Exact values lie on one side or on the other.
            let reaches =
                [((low - error).max(beneath.min).min(low), high), (low, (high + error).min(beneath.max).max(high))];
            for (from, to) in reaches {
                let (extinction, rate) = self.change(from, to, error, known.presence_may_change);
                found.thinner = found.thinner.max(extinction);
                for (a, b) in PER_OPACITY.iter().zip(&mut found.per_length) {
                    *b = b.max(rate - a * least);
                }
            }
            if low == high {
                break;
            }
        }
        found
    }

    /// The same, if the factor of extinction changes by at most this: see the module.
    fn with_change_of_factor(&self, mut found: Deviation, own: ValueRange, change: f64) -> Deviation {
        if change == 0.0 || found.kappa_max == 0.0 {
            return found;
        }
        let greatest = |range: ValueRange| {
            let extent = (!range.is_empty()).then(|| self.intervals.extent(range.min, range.max));
            extent.map_or(0.0, |extent| self.intervals.function().kappa(extent.high[3]))
        };
        let by_factor = change * greatest(found.beneath);
        for b in &mut found.per_length {
            *b = (*b + by_factor).min(found.kappa_max);
        }
        found.thinner = (found.thinner + by_factor).min(greatest(own));
        found
    }

    /// Largest changes of extinction and of r (see the module) between two values of an interval, at most `error`
    /// apart. With `or_nothing`, also between one of its values and nothing.
    fn change(&self, from: f64, to: f64, error: f64, or_nothing: bool) -> (f64, f64) {
        let extent: Extent = self.intervals.extent(from, to);
        let function = self.intervals.function();
        let (least, greatest) = (function.kappa(extent.low[3]), function.kappa(extent.high[3]));
        if or_nothing {
            return (greatest, greatest);
        }
        let width = to - from;
        // If the transfer function is linear, the error changes it by its share.
        let share = if width > error && self.intervals.is_linear(from, to) { error / width } else { 1.0 };
        // Extinction is steepest where it is greatest.
        let steepest = 1.0 / ((1.0 - extent.high[3].min(ALPHA_LIMIT)) * function.unit_distance());
        let extinction = (greatest - least).min(share * (extent.high[3] - extent.low[3]) * steepest);
        if self.is_shaded {
            return (extinction, greatest);
        }
        let brightest = extent.high[..3].iter().copied().fold(0.0, f64::max);
        let darkest = extent.low[..3].iter().copied().fold(1.0, f64::min);
        let emission = extinction * brightest.max(1.0 - darkest) + greatest * share * extent.color_change();
        (extinction, extinction.max(emission).min(greatest))
    }

    /// Largest deviation of a pixel whose exact value lies up to `below` under and `above` over `value`. `drawn` is its
    /// colour times opacity, and opacity. `value` is NaN if nothing is drawn.
    #[must_use]
    pub fn of_value(&self, value: f64, [below, above]: [f64; 2], drawn: [f32; 4]) -> f64 {
        if value.is_nan() && below == 0.0 && above == 0.0 {
            return 0.0;
        }
        let all = self.value_range;
        let rounding = self.value_error;
        // `max` and `min` drop NaN: if nothing is drawn, the exact value may be anything.
        let (from, to) = ((value - below - rounding).max(all.min), (value + above + rounding).min(all.max));
        let (from, to) = (from.min(all.max), to.max(all.min));
        let may_be_nothing = below.is_infinite() || above.is_infinite();
        let extent = self.intervals.extent(from, to);
        let off = |c: usize| {
            let [low, high] = if c == 3 { [1.0, 1.0] } else { [extent.low[c], extent.high[c]] };
            let drawn = f64::from(drawn[c]);
            // Possibly nothing is present.
            let least = if may_be_nothing { 0.0 } else { low * extent.low[3] };
            (drawn - least).max(high * extent.high[3] - drawn)
        };
        (0..4).map(off).fold(0.0, f64::max)
    }

    /// Largest deviations of a finished ray: for all reasons, and from levels alone; 1 is white.
    #[must_use]
    pub fn of_finished(&self, levels: &RayDeviation, ray: &FinishedRay) -> [f64; 2] {
        let FinishedRay { behind, value, length, own, pixel, .. } = *ray;
        let reach = match self.mode {
            Mode::Dvr | Mode::Iso | Mode::Slice => {
                let of_levels = levels.of_ray(behind) - behind;
                return [(of_levels + own + behind).min(1.0), of_levels];
            }
            Mode::Mip | Mode::Minip => levels.reach(),
            Mode::Mean => levels.mean_reach(length),
        };
        let rounding = self.of_value(value, [0.0; 2], pixel);
        let of_levels = if reach == [0.0; 2] { 0.0 } else { self.of_value(value, reach, pixel) - rounding };
        [(of_levels + own + rounding).min(1.0), of_levels]
    }

    /// A stored range in data units.
    fn data_range(&self, stored: ValueRange) -> ValueRange {
        stored.scaled(self.scale, self.offset)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use supervol_format::codec::Codec;
    use supervol_format::{BrickIndex, BrickLayout, Dims, Geometry, Pyramid};
    use supervol_scene::facts::VolumeFacts;
    use supervol_scene::scene::Scene;

    use super::*;

    const VALUES: ValueRange = ValueRange { min: 0.0, max: 100.0 };

    fn deviations(json: &str) -> Deviations {
        deviations_of(json, 0.0)
    }

    /// Deviations of a volume whose voxels were moved by up to `voxel_error`.
    fn deviations_of(json: &str, voxel_error: f64) -> Deviations {
        let pyramid = Pyramid::new(Dims([32; 3]), BrickLayout::new(16).unwrap(), &[[2, 2, 2]]).unwrap();
        let facts = VolumeFacts::plain(Dims([32; 3]), Geometry::IDENTITY, VALUES);
        let scene = Scene::from_json(json).unwrap().resolve(&facts).unwrap();
        let geometry = &Geometry::IDENTITY;
        Deviations::new(
            &scene,
            &DataScale { pyramid: &pyramid, geometry, scale: 1.0, offset: 0.0, value_range: VALUES, voxel_error },
            0.0,
        )
    }

    fn function(points: &[(f64, f64)]) -> String {
        let point = |&(value, alpha): &(f64, f64)| {
            format!(r#"{{"value": {value:?}, "color": [{:?}, 0.5, 0.25], "alpha": {alpha:?}}}"#, value / 100.0)
        };
        format!(r#""transfer_function": {{"points": [{}]}}"#, points.iter().map(point).collect::<Vec<_>>().join(", "))
    }

    fn entry(own: ValueRange, beneath: ValueRange, error: f64) -> BrickEntry {
        BrickEntry {
            offset: 4096,
            payload_bytes: 1,
            macro_cell_bytes: 2,
            codec: Codec::Raw,
            absent: own.is_empty(),
            uniform: false,
            has_holes: false,
            checksum: 0,
            fill: 0,
            range: own,
            range_beneath: beneath,
            error,
        }
    }

    fn coarse() -> BrickKey {
        BrickKey::new(Lod(1), BrickIndex([0; 3]))
    }

    /// Premultiplied colour and transmittance of pieces `(length, value)` of constant value; `None` is absent.
    fn gather(deviations: &Deviations, pieces: &[(f64, Option<f64>)]) -> ([f64; 3], f64) {
        let function = deviations.intervals.function();
        let (mut color, mut transmittance) = ([0.0; 3], 1.0);
        for &(length, value) in pieces {
            let Some(value) = value else { continue };
            let (c, alpha) = function.classify(value);
            let through = (-function.kappa(alpha) * length).exp();
            (0..3).for_each(|i| color[i] += transmittance * (1.0 - through) * c[i]);
            transmittance *= through;
        }
        (color, transmittance)
    }

    fn difference((c, t): ([f64; 3], f64), (d, u): ([f64; 3], f64)) -> f64 {
        (0..3).map(|i| (c[i] - d[i]).abs()).fold((t - u).abs(), f64::max)
    }

    /// A brick of a ray: least drawn value, width of the drawn range, error, whether values may be absent, and pieces
    /// `(length, share of the width, share of the error)`.
    type Brick = (f64, f64, f64, bool, Vec<(f64, f64, f64)>);

    fn bricks() -> impl Strategy<Value = Vec<Brick>> {
        let pieces = prop::collection::vec((0.01f64..3.0, 0.0f64..1.0, -1.0f64..1.0), 1..6);
        let magnitude = (-4.0f64..1.6).prop_map(|e| 10f64.powf(e));
        prop::collection::vec((0.0f64..90.0, 0.0f64..60.0, magnitude, prop::bool::weighted(0.2), pieces), 1..8)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]
        /// Tests the theorem of the module's head, and that its bound is useful.
        #[test]
        fn no_ray_is_farther_off_than_is_stated(
            points in prop::collection::vec((0.0f64..100.0, prop::sample::select(vec![0.0, 0.01, 0.1, 0.12, 0.8, 1.0])), 1..6),
            bricks in bricks(), ends_at in prop::sample::select(vec![0.0, 0.01]),
        ) {
            let mut points = points;
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let deviations = deviations(&format!("{{{}}}", function(&points)));
            let (mut drawn, mut exact) = (Vec::new(), Vec::new());
            let (mut stated, mut behind, mut transmittance) = (RayDeviation::NONE, 0.0, 1.0);
            for (low, width, error, may_be_absent, pieces) in &bricks {
                let own = ValueRange { min: *low, max: (low + width).min(100.0) };
                let beneath = ValueRange { min: (own.min - error).max(0.0), max: (own.max + error).min(100.0) };
                let deviation = deviations.of(coarse(), &entry(own, beneath, *error), if *may_be_absent { Holes::Possible } else { Holes::None });
                let before = drawn.len();
                for &(length, share, off) in pieces {
                    let value = own.min + share * (own.max - own.min);
                    let off = (3.0 * off).clamp(-1.0, 1.0) * error;
                    // Something where nothing is drawn, and the reverse.
                    let is_there = [!may_be_absent || off > -0.5 * error, !may_be_absent || off < 0.5 * error];
                    exact.push((length, is_there[0].then_some((value + off).clamp(beneath.min, beneath.max))));
                    if behind == 0.0 {
                        drawn.push((length, is_there[1].then_some(value)));
                    }
                }
                if behind > 0.0 {
                    continue;
                }
                let through = gather(&deviations, &drawn[before..]).1;
                let length = pieces.iter().map(|piece| piece.0).sum();
                stated.note_brick(transmittance, Some(transmittance * through), length, &deviation);
                transmittance *= through;
                // The ray ends here: nothing behind is drawn.
                behind = if transmittance <= ends_at { transmittance.max(f64::MIN_POSITIVE) } else { 0.0 };
            }
            let found = difference(gather(&deviations, &drawn), gather(&deviations, &exact));
            let stated = stated.of_ray(behind);
            prop_assert!(found <= stated + 1e-9, "{found} of {stated}");
        }

        /// Tests the theorem with macro cells: pieces of a ray lie in cells of different ranges and errors.
        #[test]
        fn no_ray_through_macro_cells_is_farther_off_than_is_stated(
            points in prop::collection::vec((0.0f64..100.0, prop::sample::select(vec![0.0, 0.01, 0.1, 0.8, 1.0])), 1..6),
            cells in prop::collection::vec((0.0f64..90.0, 0.0f64..30.0, -4.0f64..1.6, 0.01f64..2.0, 0.0f64..1.0, -1.0f64..1.0), 1..12),
        ) {
            let mut points = points;
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let deviations = deviations(&format!("{{{}}}", function(&points)));
            let (mut drawn, mut exact, mut crossed) = (Vec::new(), Vec::new(), CrossedCells::default());
            // The brick holds a spike elsewhere: its own error is the whole range.
            let brick = entry(VALUES, VALUES, 100.0);
            for (low, width, magnitude, length, share, off) in cells {
                let (own, error) = (ValueRange { min: low, max: (low + width).min(100.0) }, 10f64.powf(magnitude));
                let value = own.min + share * (own.max - own.min);
                // The extremes of the error are the worst case.
                let off = (3.0 * off).clamp(-1.0, 1.0) * error;
                drawn.push((length, Some(value)));
                exact.push((length, Some((value + off).clamp(0.0, 100.0))));
                crossed.add(length, &deviations.of_cell(coarse(), &brick, own, error));
            }
            let length = drawn.iter().map(|piece| piece.0).sum();
            let (drawn, exact) = (gather(&deviations, &drawn), gather(&deviations, &exact));
            let mut stated = RayDeviation::NONE;
            stated.note_cells([1.0, drawn.1], length, &deviations.of(coarse(), &brick, Holes::None), &crossed);
            let (found, stated) = (difference(drawn, exact), stated.of_ray(0.0));
            prop_assert!(found <= stated + 1e-9, "{found} of {stated}");
        }

        /// Nothing of a brick is drawn, and any value beneath may be present.
        #[test]
        fn bricks_of_which_nothing_is_drawn_are_bounded(low in 0.0f64..90.0, width in 0.0f64..30.0, length in 0.01f64..20.0) {
            let deviations = deviations(&format!("{{{}}}", function(&[(20.0, 0.0), (60.0, 0.3), (80.0, 0.1)])));
            let beneath = ValueRange { min: low, max: low + width };
            let own = ValueRange { min: low, max: low };
            let deviation = deviations.of(coarse(), &entry(own, beneath, width), Holes::None);
            let mut stated = RayDeviation::NONE;
            stated.note_brick(0.5, None, length, &deviation);
            for share in [0.0, 0.3, 1.0] {
                let (color, through) = gather(&deviations, &[(length, Some(low + share * width))]);
                let most = color.into_iter().fold(1.0 - through, f64::max);
                prop_assert!(0.5 * most <= stated.of_ray(0.0) + 1e-12);
            }
        }
    }

    #[test]
    fn the_bound_is_proportional_to_small_errors_and_ends_at_what_is_there() {
        let deviations = deviations(&format!("{{{}}}", function(&[(0.0, 0.0), (100.0, 0.5)])));
        let own = ValueRange { min: 20.0, max: 80.0 };
        let of = |error: f64| {
            let deviation = deviations.of(coarse(), &entry(own, VALUES, error), Holes::None);
            let mut stated = RayDeviation::NONE;
            // Values of 50 over a length of 4: kappa is 0.2877 each.
            stated.note_brick(1.0, Some((-4.0f64 * 0.287_68).exp()), 4.0, &deviation);
            stated.of_ray(0.0)
        };
        assert!((4.0..6.0).contains(&(of(0.5) / of(0.1))), "{} and {}", of(0.5), of(0.1));
        // 0.005 of alpha per value, 0.01 of red: the exact change is about 0.012 if all errors are alike.
        assert!((0.01..0.05).contains(&of(0.5)), "{}", of(0.5));
        assert!(of(90.0) <= 1.0);
        let exact = deviations.of(coarse(), &entry(own, VALUES, 0.0), Holes::None);
        assert!(
            exact.is_none()
                && deviations
                    .of(BrickKey::new(Lod(0), BrickIndex([0; 3])), &entry(own, VALUES, 9.0), Holes::Possible)
                    .is_none()
        );
        // Normals are unknown even if values are exact.
        let shaded =
            super::tests::deviations(&format!(r#"{{"shading": {{}}, {}}}"#, function(&[(0.0, 0.0), (100.0, 0.5)])));
        assert!(!shaded.of(coarse(), &entry(own, VALUES, 0.0), Holes::None).is_none());
    }

    #[test]
    fn level_0_is_off_by_as_much_as_its_voxels_were_moved() {
        let own = ValueRange { min: 20.0, max: 60.0 };
        let finest = BrickKey::new(Lod(0), BrickIndex([0; 3]));
        let ramp = function(&[(0.0, 0.0), (100.0, 0.5)]);
        let moved = deviations_of(&format!("{{{ramp}}}"), 0.5);
        let of = |error| moved.of(finest, &entry(own, own, error), Holes::Possible);
        assert!(!moved.is_finest_exact() && of(0.0).is_none(), "no voxel of that brick has moved");
        let off = of(0.5);
        assert_eq!((off.value, off.beneath, off.presence_may_change), (0.5, own.widened(0.5), false));
        let of_ray = CrossedCells::of_brick(4.0, &off).of_ray(0.5);
        assert!(of_ray > 0.0 && of_ray < 0.02, "{off:?}");
        // A value just below the transfer function's foot may in truth be above it.
        let foot = deviations_of(&format!("{{{}}}", function(&[(60.2, 0.0), (100.0, 0.5)])), 0.5);
        let of_foot = foot.of(finest, &entry(own, own, 0.5), Holes::None);
        assert!(of_foot.of_nothing(4.0) > 0.0 && of_foot.of_nothing(4.0) < 0.05, "{of_foot:?}");
    }

    #[test]
    fn values_are_mistaken_for_what_lies_beneath() {
        let deviations = deviations(&format!(r#"{{"mode": "mip", {}}}"#, function(&[(0.0, 0.0), (100.0, 1.0)])));
        let brick = |own: [f64; 2], beneath: [f64; 2], error: f64, holes: Holes| {
            let [own, beneath] = [own, beneath].map(|[min, max]| ValueRange { min, max });
            deviations.of(coarse(), &entry(own, beneath, error), holes)
        };
        let mut ray = RayDeviation::NONE;
        ray.note_greatest([f64::NAN, 40.0], &brick([10.0, 40.0], [5.0, 44.0], 6.0, Holes::None));
        assert_eq!(ray.reach(), [6.0, 4.0]);
        ray.note_greatest([40.0, 60.0], &brick([10.0, 60.0], [5.0, 90.0], 3.0, Holes::None));
        assert_eq!(ray.reach(), [3.0, 4.0]);
        ray.note_greatest([60.0, 60.0], &brick([10.0, 50.0], [5.0, 90.0], 50.0, Holes::Possible));
        assert_eq!(ray.reach(), [3.0, 30.0]);
        // Opacity follows the value: 0.57 to 0.9 is possible where 0.6 is drawn.
        let off = deviations.of_value(60.0, ray.reach(), [0.36, 0.3, 0.15, 0.6]);
        assert!((off - 0.45).abs() < 2e-3, "red is 0.9 * 0.9: {off}");
        let mut least = RayDeviation::NONE;
        least.note_least([f64::NAN, 40.0], &brick([40.0, 80.0], [38.0, 90.0], 6.0, Holes::None));
        assert_eq!(least.reach(), [2.0, 6.0]);
        let mut mean = RayDeviation::NONE;
        mean.note_mean(3.0, &brick([0.0, 1.0], [0.0, 1.0], 2.0, Holes::None));
        assert_eq!((mean.mean_reach(6.0), RayDeviation::NONE.mean_reach(0.0)), ([1.0; 2], [0.0; 2]));
        assert_eq!(deviations.of_value(f64::NAN, [0.0; 2], [0.0; 4]), 0.0);
        assert_eq!(deviations.of_value(f64::NAN, [f64::INFINITY; 2], [0.0; 4]), 1.0);
    }
}
