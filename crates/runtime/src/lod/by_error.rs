//! Level rules by error: whether a coarser brick may be drawn. They use the brick's error bound and value ranges of the
//! table of contents, seen through the transfer function.
//!
//! A brick of level 1 or more is drawn if one of these rules holds; otherwise its children are.
//! 1. *Nothing beneath it can be seen*: no value of its own range and of all ranges beneath it is visible.
//! 2. *The bound* ([`LevelsByError::keeps_target`]): the picture stays within the target E for all values within the
//! 3. *Small voxels* ([`LevelsByError::keeps_contrast`]): its voxels cover at most a quarter of a pixel, and averaging
//!    has not removed visible contrast. Then 16 rays per pixel still meet each voxel. This rule is a heuristic, not a
//!    bound, and does not depend on E: no stored number says how often the error occurs within a brick. The exact
//!    picture for this rule is level 0 supersampled. Level 0 with one ray per pixel is as far from it
//!    (docs/decisions/005-levels-by-error.md).
//!
//! ## The bound of a ray
//!
//! Let s be the exact field along a ray and s + d the drawn one, |d| <= error, with extinction kappa and colour c
//! (channels in [0, 1]). Move from one to the other in equal shares. The pixel then changes at the rate `integral of T
//! (kappa' dc + dkappa (c - C))`. C is the colour from behind; T is the transmittance of a mixture of both fields. Both
//! colours lie in [0, 1], so the pixel changes by at most
//!
//! ```text
//! integral of T(t) (kappa_max dc + dkappa) dt,      dc, dkappa, kappa_max over [s - error, s + error]
//! ```
//!
//! As `integral of T kappa dt <= 1` and no ray is longer than L, the change stays below E if everywhere
//!
//! ```text
//! kappa_max dc + dkappa <= E (kappa_min / 2 + 1 / (2 L))
//! ```
//!
//! The right side is a brick's share of the ray's budget: half of E is spent by opacity, half by length. So the sum
//! over all bricks of a ray stays within E, however many there are. The bound is strict: errors that cancel are added
//! up. Shaded colours are unknown (normals have no stored bound), so there `dc = 1`. With opacity by the gradient, the
//! extinction is unknown for the same reason: it may be anything up to its greatest value. Rule 3 then holds nowhere, since
//! averages have shorter gradients. In `mip`, `minip` and `mean` the
//! value itself is off by at most the error: its opacity and colour may change by E in all. In `iso` a crossing moves
//! by an unknown length: a brick with an iso value beneath it must be exact.
//!
//! Error bounds hold only where both levels have data; holes are treated by [`Verdict::FineWithoutHoles`].

use glam::DVec3;
use supervol_format::container::toc::BrickEntry;
use supervol_format::{BrickKey, Dims, Geometry, Lod, Pyramid, ValueRange};
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::transfer_function::intervals::Extent;
use supervol_scene::transfer_function::{ALPHA_LIMIT, Intervals};

use super::LodRule;

/// Error that every picture keeps: the whole scale.
pub const ANY_ERROR: f64 = 1.0;
/// Pixels that a voxel may cover under rule 3: the distance between the rays of a picture supersampled 16 times.
const SMALL_VOXEL_PIXELS: f64 = 0.25;
/// Tolerances of rule 3: share of mean opacity that averaging may remove, and change of opacity at the ends of a range.
const CONTRAST_TOLERANCE: f64 = 0.05;
/// Most parts of a brick's range to examine. If they do not suffice, the bound counts as broken.
const PART_LIMIT: usize = 4096;
/// Least length of a part, as a share of the error: shorter parts are not divided.
const FINEST_PART: f64 = 0.25;

/// Verdict of the level rules about a brick of level 1 or more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It may be drawn.
    Fine,
    /// It may be drawn if neither it nor a brick beneath it has holes.
    FineWithoutHoles,
    /// Its children are drawn.
    TooCoarse,
}

/// Container facts that the level rules need.
#[derive(Debug, Clone, Copy)]
pub struct DataScale<'a> {
    /// Levels and bricks.
    pub pyramid: &'a Pyramid,
    /// Place in the world.
    pub geometry: &'a Geometry,
    /// Data value = stored value * scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Least and greatest value of the volume, data units.
    pub value_range: ValueRange,
    /// Largest difference of a level-0 voxel from its source voxel, data units. Exact values may lie outside of all
    /// ranges by this much.
    pub voxel_error: f64,
}

/// Level rules for one scene and container; see the module.
#[derive(Debug, Clone)]
pub struct LevelsByError {
    mode: Mode,
    intervals: Intervals,
    /// Iso values, data units.
    iso: Vec<f64>,
    is_shaded: bool,
    /// Whether extinction depends on the gradient.
    is_modulated: bool,
    /// Target error E, a share of full scale.
    max_error: f64,
    /// Longest ray L, world length.
    longest_ray: f64,
    scale: f64,
    offset: f64,
    value_range: ValueRange,
    voxel_error: f64,
    pyramid: Pyramid,
    lod: LodRule,
}

impl LevelsByError {
    /// Rules for pictures of a scene within `max_error`, a share of full scale. `lod` gives the size of voxels on
    /// screen.
    #[must_use]
    pub fn new(scene: &ResolvedScene, data: &DataScale<'_>, lod: LodRule, max_error: f64) -> Self {
        let dims = data.pyramid.level_at(Lod::FINEST).dims;
        Self {
            mode: scene.mode,
            intervals: Intervals::new(&scene.transfer_function),
            iso: scene.iso.iter().map(|surface| surface.value).collect(),
            is_shaded: scene.shading.is_some(),
            is_modulated: scene.gradient_opacity.is_some(),
            max_error,
            longest_ray: longest_chord(data.geometry, dims, scene.clip.index_box),
            scale: data.scale,
            offset: data.offset,
            value_range: data.value_range.widened(data.voxel_error),
            voxel_error: data.voxel_error,
            pyramid: data.pyramid.clone(),
            lod,
        }
    }

    /// Whether a brick may be drawn, by any of the three rules.
    #[must_use]
    pub fn verdict(&self, key: BrickKey, entry: &BrickEntry) -> Verdict {
        let bounded = self.bounded_verdict(key, entry);
        if bounded == Verdict::Fine
            || self.is_modulated
            || self.lod.voxel_pixels(&self.pyramid, key) > SMALL_VOXEL_PIXELS
        {
            return bounded;
        }
        let keeps_contrast = self.keeps_contrast(self.data_range(entry.range), self.data_range(entry.range_beneath));
        if keeps_contrast { Verdict::Fine } else { bounded }
    }

    /// Whether a brick may be drawn by rule 1 or 2, so that the picture provably keeps the target.
    #[must_use]
    pub fn bounded_verdict(&self, key: BrickKey, entry: &BrickEntry) -> Verdict {
        if key.lod() == Lod::FINEST || self.max_error >= ANY_ERROR {
            return Verdict::Fine;
        }
        let beneath = self.data_range(entry.range_beneath).widened(self.voxel_error);
        if beneath.is_empty() || self.shows_nothing(beneath) {
            return Verdict::Fine;
        }
        let is_kept = self.keeps_target(beneath, entry.error * self.scale.abs());
        if is_kept { Verdict::FineWithoutHoles } else { Verdict::TooCoarse }
    }

    /// Rule 2: whether a brick may be drawn although its values are off by up to `error`. `beneath` is the range of the
    /// brick and everything beneath it. Data units.
    #[must_use]
    pub fn keeps_target(&self, beneath: ValueRange, error: f64) -> bool {
        let hull = (beneath.min, beneath.max);
        // Values are equal everywhere, but normals are not: those of a coarser level reach farther.
        if error == 0.0 && !self.is_shaded && !self.is_modulated {
            return true;
        }
        match self.mode {
            // The position of a surface on another level is unknown.
            Mode::Dvr if self.meets_surface(beneath) => false,
            Mode::Dvr => self.holds_within(hull, error, hull, |extent, share| self.keeps_ray(extent, share)),
            // The ray's value lies in this brick's range, but the value it is exchanged for need not.
            Mode::Mip | Mode::Minip => {
                self.holds_within(hull, error, EVERYTHING, |extent, share| self.keeps_value(extent, share))
            }
            Mode::Mean => {
                let all = (self.value_range.min, self.value_range.max);
                self.holds_within(all, error, EVERYTHING, |extent, share| self.keeps_value(extent, share))
            }
            Mode::Iso | Mode::Slice => false,
        }
    }

    /// Rule 3: whether the brick's own values show as much as those beneath it; data units.
    ///
    /// Averaging narrows the range of values. The values lost at either end must look like the values kept there. As a
    /// model, values are spread evenly over their ranges; the mean opacity and colour over both ranges are then what a
    /// ray gathers from the brick and from the bricks beneath it.
    #[must_use]
    pub fn keeps_contrast(&self, own: ValueRange, beneath: ValueRange) -> bool {
        if own.is_empty() {
            return false;
        }
        match self.mode {
            Mode::Dvr if !self.keeps_surfaces(own, beneath) => false,
            Mode::Dvr => {
                let drawn = self.intervals.mean(own.min, own.max);
                let exact = self.intervals.mean(beneath.min, beneath.max);
                let tolerance = CONTRAST_TOLERANCE * drawn[3].max(exact[3]);
                let means_agree = drawn.iter().zip(exact).all(|(a, b)| (a - b).abs() <= tolerance);
                means_agree && self.changes_little(beneath.min, own.min) && self.changes_little(own.max, beneath.max)
            }
            Mode::Mip => self.changes_little(own.max, beneath.max),
            Mode::Minip => self.changes_little(beneath.min, own.min),
            // A mean of means is the mean.
            Mode::Mean => true,
            Mode::Iso => self.keeps_surfaces(own, beneath),
            Mode::Slice => false,
        }
    }

    /// Whether no value of the range can be seen; data units.
    #[must_use]
    pub fn shows_nothing(&self, range: ValueRange) -> bool {
        match self.mode {
            Mode::Dvr => self.intervals.extent(range.min, range.max).high[3] == 0.0 && !self.meets_surface(range),
            Mode::Iso => !self.meets_surface(range),
            _ => false,
        }
    }

    /// Whether a surface may lie where values have this range; data units.
    fn meets_surface(&self, range: ValueRange) -> bool {
        self.iso.iter().any(|&value| range.contains(value))
    }

    /// Whether the brick's own values meet every surface that the values beneath it meet.
    fn keeps_surfaces(&self, own: ValueRange, beneath: ValueRange) -> bool {
        self.iso.iter().all(|&value| own.contains(value) || !beneath.contains(value))
    }

    /// Whether opacity and colour change little over an interval.
    fn changes_little(&self, low: f64, high: f64) -> bool {
        let extent = self.intervals.extent(low, high.max(low));
        let change = extent.high[3] - extent.low[3] + extent.high[3] * extent.color_change();
        change <= CONTRAST_TOLERANCE
    }

    /// The inequality in the module's head, if the error changes opacity and colour by `share` of the extremes'
    /// distance.
    fn keeps_ray(&self, extent: &Extent, share: f64) -> bool {
        let function = self.intervals.function();
        let (least, greatest) = (function.kappa(extent.low[3]), function.kappa(extent.high[3]));
        // Extinction is steepest where it is greatest.
        let steepest = 1.0 / ((1.0 - extent.high[3].min(ALPHA_LIMIT)) * function.unit_distance());
        if self.is_modulated {
            // Gradients of another level are unknown: anything up to the whole extinction may show, or nothing.
            return greatest <= 0.5 * self.max_error / self.longest_ray;
        }
        let change = (greatest - least).min(share * (extent.high[3] - extent.low[3]) * steepest);
        let color_change = if self.is_shaded { 1.0 } else { share * extent.color_change() };
        change + greatest * color_change <= 0.5 * self.max_error * (least + 1.0 / self.longest_ray)
    }

    /// Whether a ray's value may be off by the error; `share` as in [`Self::keeps_ray`].
    fn keeps_value(&self, extent: &Extent, share: f64) -> bool {
        share * (extent.high[3] - extent.low[3] + extent.high[3] * extent.color_change()) <= self.max_error
    }

    /// Whether `keeps` holds for each value of `range` and its error interval: `error` below or above it, clipped to
    /// `within`. Parts of the range are examined as wholes first, and divided if that does not suffice; the answer is
    /// never wrongly yes. If the transfer function is linear, the error changes it by its share of the part; otherwise
    /// by the part's whole change.
    fn holds_within(
        &self,
        range: Interval,
        error: f64,
        within: Interval,
        keeps: impl Fn(&Extent, f64) -> bool,
    ) -> bool {
        let mut parts = vec![range];
        for _ in 0..PART_LIMIT {
            let Some((low, high)) = parts.pop() else { return true };
            // The error may go to one side or to the other.
            let reaches = [((low - error).max(within.0), high), (low, (high + error).min(within.1))];
            let is_kept = reaches.into_iter().all(|(least, greatest)| {
                let width = greatest - least;
                let is_linear = width > error && self.intervals.is_linear(least, greatest);
                let share = if is_linear { error / width } else { 1.0 };
                keeps(&self.intervals.extent(least, greatest), share)
            });
            if is_kept {
                continue;
            }
            let middle = 0.5 * (low + high);
            let can_be_divided = high - low > FINEST_PART * error && low < middle && middle < high;
            if !can_be_divided {
                return false;
            }
            parts.push((middle, high));
            parts.push((low, middle));
        }
        parts.is_empty()
    }

    /// A stored range in data units.
    fn data_range(&self, stored: ValueRange) -> ValueRange {
        stored.scaled(self.scale, self.offset)
    }
}

type Interval = (f64, f64);

const EVERYTHING: Interval = (f64::NEG_INFINITY, f64::INFINITY);

/// Longest straight line inside the domain, or inside its part within a clip box; world length.
fn longest_chord(geometry: &Geometry, dims: Dims, clip_box: Option<[[f64; 3]; 2]>) -> f64 {
    let extent: [f64; 3] = std::array::from_fn(|a| {
        let kept = clip_box.map_or(f64::INFINITY, |[low, high]| (high[a] - low[a]).max(0.0));
        kept.min(dims.0[a] as f64)
    });
    let linear = geometry.linear();
    let diagonal = |y: f64, z: f64| (linear * DVec3::new(extent[0], y * extent[1], z * extent[2])).length();
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(y, z)| diagonal(y, z)).into_iter().fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use supervol_format::BrickLayout;
    use supervol_scene::facts::VolumeFacts;
    use supervol_scene::scene::Scene;

    use super::*;
    use crate::lod::LodChoice;

    const VALUES: ValueRange = ValueRange { min: 0.0, max: 100.0 };

    /// Rules for a volume of 32 x 32 x 16 voxels, whose longest ray is 48 long.
    fn rules(json: &str, max_error: f64) -> LevelsByError {
        let pyramid = Pyramid::new(Dims([32, 32, 16]), BrickLayout::new(16).unwrap(), &[[2, 2, 2]]).unwrap();
        let facts = VolumeFacts::plain(Dims([32, 32, 16]), Geometry::IDENTITY, VALUES);
        let scene = Scene::from_json(json).unwrap().resolve(&facts).unwrap();
        let data = DataScale {
            pyramid: &pyramid,
            geometry: &Geometry::IDENTITY,
            scale: 1.0,
            offset: 0.0,
            value_range: VALUES,
            voxel_error: 0.0,
        };
        let lod = LodRule::new(LodChoice::Auto { voxel_pixels: 1.0 }, &scene.camera, &Geometry::IDENTITY);
        let rules = LevelsByError::new(&scene, &data, lod, max_error);
        assert_eq!(rules.longest_ray, 48.0);
        rules
    }

    fn range(min: f64, max: f64) -> ValueRange {
        ValueRange { min, max }
    }

    /// `(value, alpha)`; red rises with the value.
    fn function(points: &[(f64, f64)]) -> String {
        let point = |&(value, alpha): &(f64, f64)| {
            format!(r#"{{"value": {value:?}, "color": [{:?}, 0.5, 0.25], "alpha": {alpha:?}}}"#, value / 100.0)
        };
        format!(r#""transfer_function": {{"points": [{}]}}"#, points.iter().map(point).collect::<Vec<_>>().join(", "))
    }

    const HALF: f64 = 0.5 / 255.0;

    #[test]
    fn a_flat_function_forgives_any_error_and_a_spike_none() {
        let grey = r#""transfer_function": {"points": [{"value": 0, "color": [0.5, 0.5, 0.5], "alpha": 0.2}]}"#;
        for mode in ["dvr", "mip", "minip", "mean"] {
            let flat = rules(&format!(r#"{{"mode": "{mode}", {grey}}}"#), HALF);
            assert!(flat.keeps_target(VALUES, 1e9), "{mode}");
            let points = [(0.0, 0.0), (50.0, 0.0), (50.0, 0.8), (50.001, 0.8), (50.001, 0.0), (100.0, 0.0)];
            let spike = rules(&format!(r#"{{"mode": "{mode}", {}}}"#, function(&points)), HALF);
            assert!(!spike.keeps_target(VALUES, 1.0) && !spike.keeps_target(range(40.0, 50.0), 0.001), "{mode}");
            // In dvr, the values are those of the brick, whatever its error. In other modes a ray's value may come from
            // another brick.
            assert_eq!(spike.keeps_target(range(49.5, 49.9), 0.2), mode == "dvr", "{mode}");
            assert!(spike.keeps_target(VALUES, 0.0), "{mode}: exact values");
            // A mean over the ray may be any value of the volume.
            assert_eq!(spike.keeps_target(range(49.5, 49.9), 0.05), mode != "mean", "{mode}");
        }
        // Normals have no bound: any visible value may be lit or not.
        let shaded = rules(&format!(r#"{{"shading": {{}}, {grey}}}"#), HALF);
        assert!(!shaded.keeps_target(VALUES, 1e-9) && !shaded.keeps_target(VALUES, 0.0));
    }

    #[test]
    fn a_larger_target_allows_larger_errors_in_proportion() {
        let ramp = function(&[(0.0, 0.0), (100.0, 0.5)]);
        let most = |mode: &str, max_error: f64| {
            let rules = rules(&format!(r#"{{"mode": "{mode}", {ramp}}}"#), max_error);
            (0..).map(|i| 100.0 * 0.9f64.powi(i)).find(|&error| rules.keeps_target(range(20.0, 80.0), error)).unwrap()
        };
        for mode in ["dvr", "mip", "mean"] {
            let ratio = most(mode, 4.0 * HALF) / most(mode, HALF);
            assert!((3.0..5.5).contains(&ratio), "{mode}: {ratio}");
        }
        // In mip, alpha and red change by 0.005 and 0.01 per value. The target is (0.5 + 0.4 * 1) / 100 times the
        // error.
        let error = most("mip", HALF);
        assert!((0.6..1.01).contains(&(error * 0.009 / HALF)), "{error}");
    }

    #[test]
    fn iso_surfaces_must_be_exact_where_there_are_any() {
        let iso = rules(r#"{"mode": "iso", "shading": null, "iso": [{"value": 40, "color": [1, 1, 1]}]}"#, HALF);
        assert!(iso.shows_nothing(range(40.5, 90.0)) && !iso.shows_nothing(range(40.0, 90.0)));
        assert!(!iso.keeps_target(range(0.0, 90.0), 1e-6) && iso.keeps_target(range(0.0, 90.0), 0.0));
        assert!(iso.keeps_contrast(range(10.0, 50.0), VALUES) && !iso.keeps_contrast(range(50.0, 60.0), VALUES));
    }

    #[test]
    fn averages_that_show_less_are_refused() {
        // S16: a checkerboard of 0 and 100 averages to 50.
        let ends = function(&[(0.0, 0.3), (50.0, 0.001), (100.0, 0.3)]);
        let dvr = rules(&format!("{{{ends}}}"), HALF);
        assert!(!dvr.keeps_contrast(range(50.0, 50.0), VALUES) && dvr.keeps_contrast(range(0.5, 99.5), VALUES));
        assert!(
            !dvr.keeps_contrast(range(50.0, 100.0), VALUES),
            "as opaque on average, but another half of the values"
        );
        // S18: a sheet of 100 in 0 keeps 50; nothing below 60 is visible.
        let sheet = rules(&format!("{{{}}}", function(&[(60.0, 0.0), (60.0, 0.9), (100.0, 0.9)])), HALF);
        assert!(!sheet.keeps_contrast(range(0.0, 50.0), VALUES) && sheet.shows_nothing(range(0.0, 59.0)));
        let mip = rules(&format!(r#"{{"mode": "mip", {ends}}}"#), HALF);
        assert!(!mip.keeps_contrast(range(0.0, 50.0), VALUES) && mip.keeps_contrast(range(40.0, 100.0), VALUES));
        let minip = rules(&format!(r#"{{"mode": "minip", {ends}}}"#), HALF);
        assert!(!minip.keeps_contrast(range(50.0, 100.0), VALUES) && minip.keeps_contrast(range(0.0, 50.0), VALUES));
    }

    /// Premultiplied colour and opacity of a ray through pieces `(length, value)` of constant value: exact.
    fn picture(rules: &LevelsByError, pieces: impl Iterator<Item = (f64, f64)>) -> [f64; 4] {
        let function = rules.intervals.function();
        let (mut color, mut transmittance) = ([0.0; 3], 1.0);
        for (length, value) in pieces {
            let (c, alpha) = function.classify(value);
            let through = (-function.kappa(alpha) * length).exp();
            (0..3).for_each(|i| color[i] += transmittance * (1.0 - through) * c[i]);
            transmittance *= through;
        }
        [color[0], color[1], color[2], 1.0 - transmittance]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3000))]
        /// The theorem of the module's text, on rays of pieces of constant value.
        #[test]
        fn no_ray_leaves_the_target_where_the_bound_holds(
            points in prop::collection::vec((0.0f64..100.0, prop::sample::select(vec![0.0, 0.01, 0.1, 0.12, 0.8, 1.0])), 1..6),
            low in 0.0f64..90.0, width in 0.0f64..60.0, magnitude in -7.0f64..1.5,
            max_error in prop::sample::select(vec![0.1, 0.5, 2.0, 8.0, 100.0]),
            ray in prop::collection::vec((0.01f64..1.0, 0.0f64..1.0, -1.0f64..1.0), 1..30),
        ) {
            let mut points = points;
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            let rules = rules(&format!("{{{}}}", function(&points)), max_error / 255.0);
            let beneath = range(low, (low + width).min(100.0));
            // The largest error, within a factor of two, that the bound allows.
            let allowed = (0..20).map(|i| 10f64.powf(magnitude) * 0.5f64.powi(i));
            let allowed = allowed.into_iter().find(|&error| rules.keeps_target(beneath, error));
            prop_assume!(allowed.is_some());
            let error = allowed.unwrap_or(0.0);
            let total: f64 = ray.iter().map(|piece| piece.0).sum();
            let of = |share: f64| beneath.min + share * (beneath.max - beneath.min);
            let exact = picture(&rules, ray.iter().map(|&(length, share, _)| (length / total * 48.0, of(share))));
            let drawn = picture(&rules, ray.iter().map(|&(length, share, off)| {
                // The extremes of the error are the worst case: most pieces are as far off as allowed.
                let off = (4.0 * off).clamp(-1.0, 1.0) * error;
                (length / total * 48.0, (of(share) + off).clamp(beneath.min, beneath.max))
            }));
            for c in 0..4 {
                let difference = (exact[c] - drawn[c]).abs();
                prop_assert!(difference <= max_error / 255.0 + 1e-12, "channel {}: {} of {}", c, difference * 255.0, max_error);
            }
        }
    }
}
