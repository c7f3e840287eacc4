//! One trilinear cell in `f64`, with a proven bound (docs/bounds.md, section 12): with opacity by the gradient, lit by the normal of a
//! cut face in front of it, or a cell that packets do not settle in `f32`. Those are cells in which a ray grazes a step of the
//! transfer function, or in which a normal turns over.
//!
//! Along a chord the field and each component of the gradient are cubics. The chord is cut where extinction or light may have a
//! kink or a step. On a part, all functions between field and light are polynomials with a bound on the rest
//! ([`super::polynomials`]), and so are the integrals. Where a part is still off by more than it may be, it is halved. Where
//! nothing is known of a part but ranges, these bound its light. So every part states a bound, however short it is.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use supervol_format::BrickKey;
use supervol_scene::clip::faces::{CutFace, CutNormals};
use supervol_scene::scene::GradientOpacity;
use supervol_scene::transfer_function::{ALPHA_LIMIT, Intervals, TransferFunction};

use super::cell::{Real, cubic_at, cubic_of_cell, monotone_intervals, monotone_root, replace_unreached};
use super::modes::ShadeSetup;
use super::polynomials::Model;
use super::shade::Lighting;
use super::shown_cells::ShownCells;
use super::visit::{BrickVisit, LevelVisit, StoredVoxel};
use crate::engines::rules::RESERVE_SHARE;
use crate::stream::counters::RayCounters;
use crate::stream::residency::{DecodedBrick, Voxels};

/// Part of a chord before and behind a crossing of a control point that is left to ranges: farther away than roots are off, and
/// short enough to show nothing.
const BESIDE_CROSSING: Real = 4e-9;
/// Halvings after which a part is taken as it is. It is then shorter than rounding resolves in a cell.
const HALVINGS: u32 = 44;
/// Parts of a chord after which no more are halved: where rounding decides on which side of a step the field lies, none is short
/// enough.
const PARTS_LIMIT: u64 = 4000;
/// Share of a cell's budget that its parts may spend by their lengths. The rest is for [`PARTS_LIMIT`] parts, alike: around steps and
/// turns of the normal, short parts need more than their length gives them.
const BY_LENGTH: f64 = 0.6;
/// Halvings in the search for a place at which the gradient has a length.
const ROOT_HALVINGS: u32 = 34;

/// Extinction and light along chords, for all rays of a frame.
#[derive(Debug, Clone)]
pub struct Modulation {
    /// The ramp of opacity by the gradient; without one, the whole extinction counts.
    pub ramp: Option<GradientOpacity>,
    /// Cuts whose faces are lit by their own normals.
    pub cuts: Option<CutNormals>,
    /// The transfer function, over data values.
    intervals: Arc<Intervals>,
    /// Values at which extinction or colour bends or steps, ascending.
    knots: Arc<[f64]>,
}

impl Modulation {
    /// Ramp and cuts, if any, with a transfer function over data values.
    #[must_use]
    pub fn new(ramp: Option<GradientOpacity>, cuts: Option<&CutNormals>, function: &TransferFunction) -> Self {
        let points = function.points();
        let mut knots: Vec<f64> = points.iter().map(|point| point.value).collect();
        for pair in points.windows(2) {
            // Extinction stays even where alpha exceeds its limit.
            let share = (ALPHA_LIMIT - pair[0].alpha) / (pair[1].alpha - pair[0].alpha);
            if share > 0.0 && share < 1.0 {
                knots.push(pair[0].value + share * (pair[1].value - pair[0].value));
            }
        }
        knots.sort_by(f64::total_cmp);
        knots.dedup();
        let intervals = Arc::new(Intervals::new(function));
        Self { ramp, cuts: cuts.cloned(), intervals, knots: knots.into() }
    }

    /// Whether a field between these values may show, if the gradient is nowhere longer than the root of this square.
    pub(super) fn shows(&self, [low, high]: [f64; 2], greatest_square: f64) -> bool {
        self.ramp.is_none_or(|ramp| greatest_square > ramp.from * ramp.from)
            && self.intervals.extent(low, high).high[3] > 0.0
    }

    /// Factor of extinction for a gradient of this squared length.
    fn factor(&self, square: f64) -> f64 {
        self.ramp.map_or(1.0, |ramp| ramp.factor(square.max(0.0).sqrt()))
    }
}

/// Budget of a cell's error: see `packets::budget`.
#[derive(Debug, Clone, Copy)]
pub struct CellBudget {
    /// Error that each unit of opacity may have.
    pub by_opacity: f64,
    /// Rest of the ray's reserve.
    pub left: f64,
    /// Light from behind the cell that reaches the eye, at most.
    pub weight: f64,
}

impl CellBudget {
    /// The budget of a cell that may be off by so much.
    fn of_one(tolerance: f64) -> Self {
        Self { by_opacity: 0.0, left: tolerance / f64::from(RESERVE_SHARE), weight: 1.0 }
    }
}

/// Light of a chord, or of a part of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Premultiplied colour.
    pub color: DVec3,
    /// Share of the light from behind that passes.
    pub transmittance: f64,
    /// Bound on what they are off by, in front of black and of white.
    pub error: f64,
}

impl Seen {
    /// Nothing.
    pub const CLEAR: Self = Self { color: DVec3::ZERO, transmittance: 1.0, error: 0.0 };

    /// This in front of another.
    #[must_use]
    pub fn before(&self, far: &Self) -> Self {
        Self {
            color: self.color + self.transmittance * far.color,
            transmittance: self.transmittance * far.transmittance,
            error: self.error + (self.transmittance + self.error) * far.error,
        }
    }
}

/// A brick whose cells are integrated in `f64`.
#[derive(Debug)]
pub(crate) struct BoundedBrick<'a> {
    pub(crate) modulation: &'a Modulation,
    /// World gradient from central differences at the brick's level.
    pub(crate) world_from_level: DMat3,
    /// Cells that may show something, if that is known of all of them.
    pub(crate) shown: Option<&'a ShownCells>,
    /// The cut face in front of the ray's part.
    pub(crate) face: Option<CutFace>,
}

/// Light of the part of a ray in one cell of a brick, behind no cut face, off by no more than `tolerance` if rounding allows that.
/// The cell's first corner lies `base` voxels from the brick's first; `t` is the ray's interval in the brick. Counts parts.
pub(crate) fn bounded_cell(
    level: LevelVisit<'_>,
    (key, brick): (BrickKey, &DecodedBrick),
    (base, t): (usize, [f64; 2]),
    tolerance: f64,
    parts: &mut u64,
) -> Seen {
    let (modulation, world_from_level) = (&level.scene.modulation, level.scene.world_from_level_gradient(key.lod()));
    let whole = BoundedBrick { modulation, world_from_level, shown: None, face: None };
    let visit = BrickVisit::new(level, brick, key);
    let part = visit.chord_at_base(base, t);
    let chord = match visit.voxels() {
        _ if part.1[0] >= part.1[1] => None,
        Voxels::U8(voxels) => BoundedChord::new(&visit, &whole, voxels, part),
        Voxels::U16(voxels) => BoundedChord::new(&visit, &whole, voxels, part),
        Voxels::F32(voxels) => BoundedChord::new(&visit, &whole, voxels, part),
    };
    chord.map_or(Seen::CLEAR, |chord| chord.seen(&CellBudget::of_one(tolerance), parts).0)
}

impl BoundedBrick<'_> {
    /// Light of a part `t` of a ray through the brick, until at most `last` of the light from behind reaches the eye. The budget is
    /// that in front of it, and then what is left.
    pub(crate) fn gather(
        &self,
        visit: &BrickVisit<'_>,
        t: [f64; 2],
        budget: &mut CellBudget,
        last: f64,
        counters: &mut RayCounters,
    ) -> Seen {
        match visit.voxels() {
            Voxels::U8(voxels) => self.gather_voxels(visit, voxels, t, (budget, last, counters)),
            Voxels::U16(voxels) => self.gather_voxels(visit, voxels, t, (budget, last, counters)),
            Voxels::F32(voxels) => self.gather_voxels(visit, voxels, t, (budget, last, counters)),
        }
    }

    fn gather_voxels<T: StoredVoxel>(
        &self,
        visit: &BrickVisit<'_>,
        voxels: &[T],
        t: [f64; 2],
        (budget, last, counters): (&mut CellBudget, f64, &mut RayCounters),
    ) -> Seen {
        let (mut seen, front) = (Seen::CLEAR, budget.weight);
        visit.for_each_macro_cell(t, |index, place, t| {
            if self.shown.is_some_and(|shown| !shown.has_macro_cell(place)) {
                counters.macro_cells_skipped += 1;
                return true;
            }
            counters.macro_cells += 1;
            visit.for_each_cell(index, t, |cell, t| {
                if self.may_show(visit, voxels, cell) {
                    counters.cells += 1;
                    if let Some(chord) = BoundedChord::new(visit, self, voxels, (cell, t)) {
                        budget.weight = front * (seen.transmittance + seen.error).min(1.0);
                        let (of_cell, spent) = chord.seen(budget, &mut counters.samples);
                        budget.left -= spent;
                        seen = seen.before(&of_cell);
                    }
                }
                front * seen.transmittance > last
            });
            front * seen.transmittance > last
        });
        seen
    }

    /// Whether a cell may show something. That is exact, whether cells are skipped or not.
    fn may_show<T: StoredVoxel>(&self, visit: &BrickVisit<'_>, voxels: &[T], cell: [i64; 3]) -> bool {
        if let Some(shown) = self.shown {
            return shown.has_cell(visit.place_of_cell(cell));
        }
        let present = visit.data_corners(voxels, visit.base(cell)).into_iter().filter(|value| !value.is_nan());
        let [low, high] = present.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], s| [a.min(s), b.max(s)]);
        low <= high && self.modulation.intervals.extent(low, high).high[3] > 0.0
    }
}

/// A chord, and everything that its light depends on.
pub(crate) struct BoundedChord<'a> {
    modulation: &'a Modulation,
    lighting: Option<&'a Lighting>,
    /// Unit vectors to each light and half way from it to the eye, and its intensity.
    lights: Vec<(DVec3, DVec3, f64)>,
    /// Data values.
    value: [Real; 4],
    /// World gradient, axis by axis; `None` where it is unknown, or vanishes everywhere.
    gradient: Option<[[Real; 4]; 3]>,
    /// Light by the cut face in front, if that lights some of the chord.
    face: Option<LightOfFace>,
    /// World length.
    length: f64,
}

/// Light by the normal of a cut face, along a chord.
#[derive(Debug, Clone, Copy)]
struct LightOfFace {
    /// Factor of a colour, and the highlights that are added.
    diffuse: f64,
    specular: f64,
    /// Its weight, before it is limited to [0, 1]: linear, and falling.
    weight: [Real; 4],
}

impl LightOfFace {
    /// Places at which the weight has a kink.
    fn kinks(&self) -> impl Iterator<Item = f64> {
        let [begin, rise, ..] = self.weight;
        [1.0, 0.0].into_iter().map(move |level| (level - begin) / rise).filter(|u| 0.0 < *u && *u < 1.0)
    }

    /// Whether this light alone counts on all of the chord.
    fn is_alone(&self) -> bool {
        self.weight[0] + self.weight[1] >= 1.0
    }
}

impl<'a> BoundedChord<'a> {
    /// The chord of a ray through a cell; `None` if nothing shows there. Beside a hole the gradient is unknown, and counts as none.
    pub(super) fn new<T: StoredVoxel>(
        visit: &BrickVisit<'a>,
        brick: &BoundedBrick<'a>,
        voxels: &[T],
        (index, [t0, t1]): ([i64; 3], [f64; 2]),
    ) -> Option<Self> {
        let world_from_level = &brick.world_from_level;
        let level = &visit.level;
        let [a, b] = [t0, t1].map(|t| visit.cell_planes.fractions(level.axis_ray, t, index));
        let base = visit.base(index);
        let corners_at = |base: usize| visit.data_corners(voxels, base);
        let value = cubic_of_cell(&present(corners_at(base), a, b)?, a, b);
        let gradient = || {
            let [x, y, z] = visit.steps().map(|step| {
                let [after, before] = [base + step, base - step].map(corners_at);
                let differences = std::array::from_fn(|i| 0.5 * (after[i] - before[i]));
                Some(cubic_of_cell(&present(differences, a, b)?, a, b))
            });
            let (x, y, z) = (x?, y?, z?);
            let of_power = |k: usize| (*world_from_level * DVec3::new(x[k], y[k], z[k])).to_array();
            let powers = [0, 1, 2, 3].map(of_power);
            Some([0, 1, 2].map(|axis| powers.map(|power| power[axis])))
        };
        let gradient = gradient();
        if gradient.is_none() && brick.modulation.ramp.is_some() {
            return None;
        }
        let chord = Self::of(brick.modulation, &level.setup, value, ([t0, t1], brick.face));
        Some(Self { gradient, ..chord })
    }

    /// A part of a ray in which the field has one value.
    pub(crate) fn even(
        modulation: &'a Modulation,
        setup: &ShadeSetup<'a>,
        value: f64,
        t_and_face: ([f64; 2], Option<CutFace>),
    ) -> Self {
        Self::of(modulation, setup, [value, 0.0, 0.0, 0.0], t_and_face)
    }

    /// The chord between two lengths, of which no gradient is known, behind a cut face.
    fn of(
        modulation: &'a Modulation,
        setup: &ShadeSetup<'a>,
        value: [Real; 4],
        ([t0, t1], face): ([f64; 2], Option<CutFace>),
    ) -> Self {
        let lighting = setup.lighting;
        let to_eye = setup.to_eye.as_dvec3();
        let lights = lighting.iter().flat_map(|lighting| &lighting.lights).map(|&(to_light, intensity)| {
            let to_light = to_light.as_dvec3();
            (to_light, (to_light + to_eye).normalize_or_zero(), f64::from(intensity))
        });
        let lights: Vec<_> = lights.collect();
        let by_face = |(lighting, face): (&Lighting, CutFace)| {
            let [full, none] = modulation.cuts.as_ref()?.depths;
            let of_lights = |factor: f32, of: &dyn Fn(DVec3, DVec3) -> f64| {
                f64::from(factor) * lights.iter().map(|&(to_light, half, i)| i * of(to_light, half)).sum::<f64>()
            };
            let diffuse = of_lights(lighting.diffuse, &|to_light, _| face.normal.dot(to_light).abs());
            let shininess = f64::from(lighting.shininess);
            let specular = of_lights(lighting.specular, &|_, half| face.normal.dot(half).abs().powf(shininess));
            let begin = (none - (t0 - face.t)) / (none - full);
            let weight = [begin, -(t1 - t0) / (none - full), 0.0, 0.0];
            (begin > 0.0).then_some(LightOfFace { diffuse: f64::from(lighting.ambient) + diffuse, specular, weight })
        };
        let face = lighting.zip(face).and_then(by_face);
        Self { modulation, lighting, lights, value, gradient: None, face, length: t1 - t0 }
    }

    /// Light of the whole chord, and what it takes of the ray's reserve. Counts parts.
    pub(crate) fn seen(&self, budget: &CellBudget, parts: &mut u64) -> (Seen, f64) {
        let cuts = self.cuts();
        let last = *parts + PARTS_LIMIT;
        let mut gathered = Gathered { budget, seen: Seen::CLEAR, spent: 0.0, parts, last };
        for part in cuts.windows(2).filter(|part| part[0] < part[1]) {
            self.gather([part[0], part[1]], HALVINGS, &mut gathered);
        }
        (gathered.seen, gathered.spent)
    }

    /// Both ends, and the places at which extinction or light may have a kink or a step, ascending.
    fn cuts(&self) -> Vec<f64> {
        let turns = monotone_intervals(&self.value);
        let values = turns.as_slice().iter().map(|&u| cubic_at(&self.value, u));
        let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], s| [a.min(s), b.max(s)]);
        let knots = &self.modulation.knots;
        let first = knots.partition_point(|knot| *knot < low);
        let mut crossings = Vec::new();
        for knot in knots[first..].iter().take_while(|knot| **knot <= high) {
            add_crossings(&mut crossings, &self.value, turns.as_slice(), *knot);
        }
        let mut cuts = vec![0.0, 1.0];
        let beside = crossings.iter().flat_map(|u| [u - BESIDE_CROSSING, u + BESIDE_CROSSING]);
        cuts.extend(beside.filter(|u| 0.0 < *u && *u < 1.0));
        if let Some(gradient) = self.gradient.as_ref().filter(|_| !self.face.is_some_and(|face| face.is_alone())) {
            for direction in self.lights.iter().flat_map(|&(to_light, half, _)| [to_light, half]) {
                let along = std::array::from_fn(|k| (0..3).map(|axis| direction[axis] * gradient[axis][k]).sum());
                add_crossings(&mut cuts, &along, monotone_intervals(&along).as_slice(), 0.0);
            }
        }
        cuts.extend(self.face.iter().flat_map(LightOfFace::kinks));
        cuts.sort_by(f64::total_cmp);
        if let (Some(ramp), Some(gradient)) = (self.modulation.ramp, &self.gradient) {
            add_kinks_of_ramp(ramp, gradient, &mut cuts);
        }
        cuts
    }

    /// Adds a part, in halves where it is off by more than it may be.
    fn gather(&self, part: [f64; 2], halvings: u32, gathered: &mut Gathered<'_>) {
        let size = part[1] - part[0];
        *gathered.parts += 1;
        let found = self.part(part);
        if gathered.allows(&found, size) || halvings == 0 || *gathered.parts >= gathered.last {
            gathered.add(&found);
            return;
        }
        let middle = 0.5 * (part[0] + part[1]);
        self.gather([part[0], middle], halvings - 1, gathered);
        self.gather([middle, part[1]], halvings - 1, gathered);
    }

    /// Light of a part: by polynomials, or by ranges where these are not known, or where they bound it better.
    fn part(&self, part: [f64; 2]) -> Seen {
        let value = Model::of_cubic(&self.value, part);
        let gradient = self.gradient.map(|gradient| {
            let gradient = [0, 1, 2].map(|axis| Model::of_cubic(&gradient[axis], part));
            let square = Model::squared_length(&gradient);
            (gradient, square)
        });
        let squares = gradient.as_ref().map_or([0.0; 2], |(_, square)| square.range());
        let factor = match (self.modulation.ramp, &gradient) {
            (None, _) => Some(Model::constant(1.0)),
            (Some(GradientOpacity { from, .. }), _) if squares[1] <= from * from => return Seen::CLEAR,
            (Some(GradientOpacity { to, .. }), _) if squares[0] >= to * to => Some(Model::constant(1.0)),
            (Some(GradientOpacity { from, to }), Some((_, square))) => {
                square.power(0.5).map(|length| length.plus(-from).scaled(1.0 / (to - from)).clamped())
            }
            (Some(_), None) => None,
        };
        let length = self.length * (part[1] - part[0]);
        let by_models = factor.and_then(|factor| self.by_models(&value, (gradient.as_ref(), part), &factor, length));
        match by_models {
            Some(found) if found.error.is_finite() => found,
            _ => self.by_ranges(value.range(), squares, length),
        }
    }

    /// Light of a part of this length by polynomials; `None` where the field may leave a segment of the transfer function, or
    /// where something is not known to be positive.
    fn by_models(
        &self,
        value: &Model,
        (gradient, part): (Option<&([Model; 3], Model)>, [f64; 2]),
        factor: &Model,
        length: f64,
    ) -> Option<Seen> {
        let (kappa, colors) = self.classified(value)?;
        let extinction = factor.times(&kappa);
        if extinction == Model::ZERO {
            return Some(Seen::CLEAR);
        }
        let colors = self.lit(colors, gradient, part)?;
        // v runs over twice the part.
        let half = 0.5 * length;
        let passing = extinction.integral(half).passing();
        let [depth, off] = extinction.whole().map(|integral| half * integral);
        let transmittance = (-depth.max(0.0)).exp();
        let mut error: f64 = 0.0;
        let color = colors.map(|color| {
            let [emitted, off] = extinction.times(&color).times(&passing).whole();
            error = error.max(half * off);
            half * emitted
        });
        Some(Seen { color: color.into(), transmittance, error: error + transmittance * off.exp_m1() })
    }

    /// Extinction and colour of a field within one segment of the transfer function.
    fn classified(&self, value: &Model) -> Option<(Model, [Model; 3])> {
        let function = self.modulation.intervals.function();
        let [low, high] = value.range();
        let points = function.points();
        let next = points.partition_point(|point| point.value <= 0.5 * (low + high));
        let constant =
            |color: [f64; 3], alpha: f64| (Model::constant(function.kappa(alpha)), color.map(Model::constant));
        if low == high {
            let (color, alpha) = function.classify(low);
            return Some(constant(color, alpha));
        }
        let (Some(a), Some(b)) = (next.checked_sub(1).map(|i| points[i]), points.get(next)) else {
            let end = if next == 0 { points[0] } else { points[next - 1] };
            let is_beyond = if next == 0 { high <= end.value } else { low >= end.value };
            return is_beyond.then(|| constant(end.color, end.alpha));
        };
        if low < a.value || high > b.value {
            return None;
        }
        let share = value.plus(-a.value).scaled(1.0 / (b.value - a.value));
        let linear = |a: f64, b: f64| share.scaled(b - a).plus(a);
        let colors = [0, 1, 2].map(|c| linear(a.color[c], b.color[c]));
        if a.alpha == b.alpha {
            return Some((Model::constant(function.kappa(a.alpha)), colors));
        }
        let alpha = linear(a.alpha, b.alpha);
        let alphas = alpha.range();
        if alphas[0] >= ALPHA_LIMIT {
            return Some((Model::constant(function.kappa(ALPHA_LIMIT)), colors));
        }
        if alphas[1] > ALPHA_LIMIT {
            return None;
        }
        Some((alpha.depth_of_opacity()?.scaled(1.0 / function.unit_distance()), colors))
    }

    /// Colours after shading (RENDERING-MODEL, section 5) on a part of the chord.
    fn lit(&self, colors: [Model; 3], gradient: Option<&([Model; 3], Model)>, part: [f64; 2]) -> Option<[Model; 3]> {
        let Some(LightOfFace { diffuse, specular, weight }) = self.face else {
            return self.lit_by_gradient(colors, gradient);
        };
        let by_face = colors.map(|color| color.scaled(diffuse).plus(specular).clamped());
        let weight = Model::of_cubic(&weight, part).clamped();
        if weight.terms == Model::constant(1.0).terms {
            // No light is farther from another than 1.
            return Some(by_face.map(|light| Model { rest: light.rest + weight.rest, ..light }));
        }
        let rest = weight.scaled(-1.0).plus(1.0);
        let by_gradient = self.lit_by_gradient(colors, gradient)?;
        Some([0, 1, 2].map(|c| weight.times(&by_face[c]).and(&rest.times(&by_gradient[c]))))
    }

    /// Colours after shading by the gradient. Where that is unknown, they are unshaded.
    fn lit_by_gradient(&self, colors: [Model; 3], gradient: Option<&([Model; 3], Model)>) -> Option<[Model; 3]> {
        let (Some(lighting), Some((gradient, square))) = (self.lighting, gradient) else { return Some(colors) };
        let floor = f64::from(lighting.gradient_floor).powi(2);
        let squares = square.range();
        if squares[1] < floor || squares[1] == 0.0 {
            return Some(colors);
        }
        if squares[0] < floor {
            return None;
        }
        let per_length = square.power(-0.5)?;
        let cosine = |direction: DVec3| {
            let along = |axis: usize| gradient[axis].scaled(direction[axis]);
            along(0).and(&along(1)).and(&along(2)).absolute().times(&per_length).clamped()
        };
        let mut diffuse = Model::constant(f64::from(lighting.ambient));
        let mut specular = Model::ZERO;
        for &(to_light, half, intensity) in &self.lights {
            diffuse = diffuse.and(&cosine(to_light).scaled(f64::from(lighting.diffuse) * intensity));
            let shine = highlight(&cosine(half), f64::from(lighting.shininess));
            specular = specular.and(&shine.scaled(f64::from(lighting.specular) * intensity));
        }
        Some(colors.map(|color| color.times(&diffuse).and(&specular).clamped()))
    }

    /// Light of a part of this length, of which no more is known than ranges of the field and of the gradient's squared length.
    fn by_ranges(&self, [low, high]: [f64; 2], squares: [f64; 2], length: f64) -> Seen {
        let extent = self.modulation.intervals.extent(low, high);
        let function = self.modulation.intervals.function();
        let least = self.modulation.factor(squares[0]) * function.kappa(extent.low[3]);
        let most = self.modulation.factor(squares[1]) * function.kappa(extent.high[3]);
        let passing = [most, least].map(|kappa| (-kappa * length).exp());
        let opacity = passing.map(|passing| 1.0 - passing);
        let mut error: f64 = 0.0;
        let color = [0, 1, 2].map(|c| {
            let [dark, bright] = if self.lighting.is_some() { [0.0, 1.0] } else { [extent.low[c], extent.high[c]] };
            let [least, most] = [dark * opacity[1], bright * opacity[0]];
            error = error.max(0.5 * (most - least));
            0.5 * (least + most)
        });
        let off = 0.5 * (passing[1] - passing[0]);
        Seen { color: color.into(), transmittance: 0.5 * (passing[0] + passing[1]), error: error + off }
    }
}

/// Adds places at which the gradient's length passes an end of the ramp, as far as the ends and the middles of parts tell.
fn add_kinks_of_ramp(GradientOpacity { from, to }: GradientOpacity, gradient: &[[Real; 4]; 3], cuts: &mut Vec<f64>) {
    let square_at = |u: f64| gradient.iter().map(|component| cubic_at(component, u).powi(2)).sum::<f64>();
    let places: Vec<f64> = cuts.windows(2).flat_map(|part| [part[0], 0.5 * (part[0] + part[1])]).chain([1.0]).collect();
    let squares: Vec<f64> = places.iter().map(|&u| square_at(u)).collect();
    let before = cuts.len();
    for i in 1..places.len() {
        for level in [from * from, to * to] {
            let side = squares[i - 1] >= level;
            if side != (squares[i] >= level) {
                let (mut low, mut high) = (places[i - 1], places[i]);
                for _ in 0..ROOT_HALVINGS {
                    let middle = 0.5 * (low + high);
                    let is_before = (square_at(middle) >= level) == side;
                    (low, high) = if is_before { (middle, high) } else { (low, middle) };
                }
                cuts.push(high);
            }
        }
    }
    if cuts.len() > before {
        cuts.sort_by(f64::total_cmp);
    }
}

/// A power of a cosine between 0 and 1. Where that may vanish, or its power hardly shows, its greatest value is the bound.
fn highlight(cosine: &Model, shininess: f64) -> Model {
    let greatest = cosine.range()[1].clamp(0.0, 1.0).powf(shininess);
    let middle = Model { rest: 0.5 * greatest, ..Model::constant(0.5 * greatest) };
    match cosine.power(shininess) {
        Some(power) if power.rest < middle.rest => power,
        _ => middle,
    }
}

/// Adds the places at which a cubic has a value. `ends`: those of its monotone intervals.
fn add_crossings(cuts: &mut Vec<f64>, cubic: &[Real; 4], ends: &[f64], value: f64) {
    cuts.extend(ends.windows(2).filter_map(|ends| monotone_root(cubic, ends[0], ends[1], value)));
}

/// Corners of which none is absent that has a weight on the chord from `a` to `b`.
pub(super) fn present(mut corners: [f64; 8], a: [Real; 3], b: [Real; 3]) -> Option<[f64; 8]> {
    if corners.iter().any(|c| c.is_nan()) {
        replace_unreached(&mut corners, a, b);
    }
    (!corners.iter().any(|c| c.is_nan())).then_some(corners)
}

/// Light of a chord so far.
struct Gathered<'a> {
    budget: &'a CellBudget,
    seen: Seen,
    /// Part of the reserve that is spent.
    spent: f64,
    parts: &'a mut u64,
    /// Parts after which no more are halved.
    last: u64,
}

impl Gathered<'_> {
    /// Light from behind all so far that reaches the eye, at most.
    fn weight(&self) -> f64 {
        self.budget.weight * (self.seen.transmittance + self.seen.error).min(1.0)
    }

    /// Whether a part that takes this share of the chord may be added: it may spend a share of its opacity, and its share of what
    /// a cell may take of the reserve.
    fn allows(&self, part: &Seen, share: f64) -> bool {
        let share = (BY_LENGTH * share).max((1.0 - BY_LENGTH) / PARTS_LIMIT as f64);
        self.weight() * part.error - self.by_opacity(part) <= share * f64::from(RESERVE_SHARE) * self.budget.left
    }

    fn by_opacity(&self, part: &Seen) -> f64 {
        self.budget.by_opacity * self.weight() * (1.0 - part.transmittance - part.error).max(0.0)
    }

    fn add(&mut self, part: &Seen) {
        self.spent += (self.weight() * part.error - self.by_opacity(part)).max(0.0);
        self.seen = self.seen.before(part);
    }
}

#[cfg(test)]
mod tests;
