//! Sampling of a ray at equal distances: a [`Sampling`] inside the macro cells that are not skipped.
//!
//! For one-point rules, an interval belongs to the macro cell of its sample point, with its whole length.
//! Pre-integration needs the values at both ends, so its intervals are also cut at the faces of macro cells. Skipping
//! and brick size then change nothing.

use std::sync::Arc;

use supervol_format::Geometry;
use supervol_format::cast::{single, whole};
use supervol_runtime::engines::cells::modes::ShadeSetup;
use supervol_runtime::engines::cells::shade::shade;
use supervol_runtime::engines::cells::{BrickVisit, Integration, Integrator, LevelVisit, StoredVoxel};
use supervol_runtime::engines::ray::RayState;
use supervol_runtime::stream::counters::RayCounters;
use supervol_runtime::stream::residency::Voxels;
use supervol_scene::clip::Segment;
use supervol_scene::scene::ResolvedScene;

use super::preintegration::{Attenuation, PreIntegration};
use super::probe::{BrickProbe, Probe, UniformProbe};
use super::{Accumulation, Classification, Offset, Rule, Sampling};

/// Least step, in smallest voxel spacings: limits the number of samples of a ray.
pub const STEP_LIMIT_VOXELS: f64 = 1e-4;

/// Data shared by all rays of a frame.
#[derive(Debug)]
struct Tables {
    sampling: Sampling,
    /// World length of an interval.
    step: f64,
    unit_distance: f64,
    /// Tables for rules with two-ended intervals.
    preintegration: Option<(PreIntegration, Attenuation)>,
}

impl Tables {
    /// Tables of a scene over a volume.
    fn new(sampling: Sampling, scene: &ResolvedScene, geometry: &Geometry) -> Self {
        let attenuation = match sampling.rule {
            Rule::PreIntegrated => Some(Attenuation::Included),
            Rule::PreIntegratedNeglecting => Some(Attenuation::Neglected),
            Rule::LeftRiemann | Rule::Midpoint | Rule::LinearOpacity => None,
        };
        Self {
            sampling,
            step: sampling.step_voxels.max(STEP_LIMIT_VOXELS) * geometry.smallest_spacing(),
            unit_distance: scene.transfer_function.unit_distance(),
            preintegration: attenuation.map(|a| (PreIntegration::new(&scene.transfer_function), a)),
        }
    }
}

/// State of one ray.
struct SampledRay<'a> {
    tables: &'a Tables,
    segment: Segment,
    /// Length of the first interval, as a fraction of the step, in (0, 1].
    offset: f64,
    /// Position of the sample in its interval, from 0 to 1.
    place: f64,
}

/// Interleaved gradient noise (Jimenez 2014), in [0, 1). Neighbouring pixels differ strongly, as in blue noise.
fn gradient_noise([x, y]: [u32; 2]) -> f64 {
    (52.982_918_9 * (0.067_110_56 * f64::from(x) + 0.005_837_15 * f64::from(y)).fract()).fract()
}

/// `(sqrt(5) - 1) / 2`: its multiples fill the unit interval evenly.
const GOLDEN_RATIO: f64 = 0.618_033_988_749_894_9;

impl<'a> SampledRay<'a> {
    fn new(tables: &'a Tables, visit: &LevelVisit<'_>) -> Self {
        let place = match tables.sampling.rule {
            Rule::LeftRiemann => 0.0,
            _ => 0.5,
        };
        let (offset, place) = match tables.sampling.offset {
            Offset::Fixed(share) => (share.clamp(f64::EPSILON, 1.0), place),
            Offset::Jittered { frame } => {
                (1.0, (gradient_noise(visit.pixel()) + f64::from(frame) * GOLDEN_RATIO).fract())
            }
        };
        Self { tables, segment: visit.segment(), offset, place }
    }

    /// Ray parameter t at the end of interval j, not cut to the segment.
    fn end(&self, j: u64) -> f64 {
        self.segment.t0 + (j as f64 + self.offset) * self.tables.step
    }

    /// Start and end of interval j.
    fn interval(&self, j: u64) -> [f64; 2] {
        let begin = if j == 0 { self.segment.t0 } else { self.end(j - 1) };
        [begin.min(self.segment.t1), self.end(j).min(self.segment.t1)]
    }

    /// Sample position t of an interval.
    fn sample_at(&self, [a, b]: [f64; 2]) -> f64 {
        a + self.place * (b - a)
    }

    /// The first interval with `place` at or after t. `place` must increase with the interval.
    fn first(&self, t: f64, place: impl Fn(u64) -> f64) -> u64 {
        let intervals = ((t - self.segment.t0) / self.tables.step - self.offset).floor();
        // `as` saturates: positions before the segment give interval 0.
        let mut j = whole::<u64>(intervals).saturating_sub(1);
        while place(j) < t {
            j += 1;
        }
        j
    }

    /// Gathers by a rule with one sample point per interval.
    fn gather_points<P: Probe>(
        &self,
        probe: &P,
        visit: &LevelVisit<'_>,
        [t, exit]: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        let mut j = self.first(t, |j| self.sample_at(self.interval(j)));
        loop {
            let [a, b] = self.interval(j);
            let at = self.sample_at([a, b]);
            if at >= exit || a >= self.segment.t1 {
                return;
            }
            counters.samples += 1;
            let classified = match self.tables.sampling.classification {
                Classification::Post => probe.value(at).map(|value| visit.transfer_function().classify(value)),
                Classification::Pre => probe.classified(at),
            };
            if let Some([red, green, blue, alpha]) = classified.filter(|rgba| rgba[3] > 0.0) {
                let opacity = self.opacity(visit, alpha, b - a);
                let color = shaded(visit.shade_setup(), [red, green, blue], || probe.gradient(at));
                self.accumulate(state, color.map(|c| f64::from(c) * opacity), opacity);
                if visit.is_done(state) {
                    return;
                }
            }
            j += 1;
        }
    }

    /// Opacity of an interval of length h.
    fn opacity(&self, visit: &LevelVisit<'_>, alpha: f32, h: f64) -> f64 {
        match self.tables.sampling.rule {
            Rule::LinearOpacity => (f64::from(alpha) * h / self.tables.unit_distance).min(1.0),
            _ => -(-f64::from(visit.transfer_function().extinction(alpha)) * h).exp_m1(),
        }
    }

    /// Gathers by a rule that uses both ends of each interval.
    fn gather_intervals<P: Probe>(
        &self,
        probe: &P,
        visit: &LevelVisit<'_>,
        [t, exit]: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        let (table, attenuation) =
            self.tables.preintegration.as_ref().expect("these rules come with a table of their own");
        let mut j = self.first(t, |j| self.end(j));
        let (mut front_t, mut front) = (t, probe.value(t));
        counters.samples += 1;
        while front_t < exit {
            let back_t = self.end(j).min(exit);
            let back = probe.value(back_t);
            counters.samples += 1;
            if let (Some(a), Some(b), true) = (front, back, back_t > front_t) {
                let (a, b) = (visit.map().to_data(a), visit.map().to_data(b));
                let (color, opacity) = table.interval(a, b, back_t - front_t, *attenuation);
                if opacity > 0.0 {
                    let plain = color.map(|c| single(c / opacity));
                    let lit = shaded(visit.shade_setup(), plain, || probe.gradient(0.5 * (front_t + back_t)));
                    // Without lighting, the colour stays in `f64`.
                    let color = if lit == plain { color } else { lit.map(|c| f64::from(c) * opacity) };
                    self.accumulate(state, color, opacity);
                }
                if visit.is_done(state) {
                    return;
                }
            }
            (front_t, front) = (back_t, back);
            j += 1;
        }
    }

    fn gather<P: Probe>(
        &self,
        probe: &P,
        visit: &LevelVisit<'_>,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        if self.tables.preintegration.is_some() {
            self.gather_intervals(probe, visit, t, state, counters);
        } else {
            self.gather_points(probe, visit, t, state, counters);
        }
    }

    /// Composites an interval's premultiplied colour and opacity behind the ray's sums, then rounds the sums.
    fn accumulate(&self, state: &mut RayState, color: [f64; 3], opacity: f64) {
        let round = rounding(self.tables.sampling.accumulation);
        for (gathered, c) in state.color.iter_mut().zip(color) {
            *gathered = round(*gathered + state.transmittance * c);
        }
        let transmittance = state.transmittance * (1.0 - opacity);
        state.transmittance = match self.tables.sampling.accumulation {
            Accumulation::Double => transmittance,
            _ => 1.0 - round(1.0 - transmittance),
        };
    }
}

/// Rounding to the nearest number of a format.
fn rounding(accumulation: Accumulation) -> fn(f64) -> f64 {
    match accumulation {
        Accumulation::Double => |v| v,
        Accumulation::Single => |v| f64::from(single(v)),
        Accumulation::Half => |v| half::f16::from_f64(v).to_f64(),
        Accumulation::Byte => |v| (v.clamp(0.0, 1.0) * 255.0).round() / 255.0,
    }
}

/// The shaded colour; unchanged if shading is off or the gradient is unknown.
fn shaded(setup: &ShadeSetup<'_>, color: [f32; 3], gradient: impl FnOnce() -> Option<glam::Vec3>) -> [f32; 3] {
    let Some(lighting) = setup.lighting else { return color };
    match gradient() {
        Some(gradient) => shade(lighting, color, setup.world_from_level_gradient * gradient, setup.to_eye),
        None => color,
    }
}

impl Integration for Sampling {
    fn integrator(&self, scene: &ResolvedScene, geometry: &Geometry) -> Arc<dyn Integrator> {
        Arc::new(Tables::new(*self, scene, geometry))
    }

    fn termination_opacity(&self) -> f64 {
        self.termination_opacity
    }
}

impl Tables {
    fn gather_brick<T: StoredVoxel>(
        &self,
        visit: &BrickVisit<'_>,
        (voxels, index): (&[T], [i64; 3]),
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        let probe = BrickProbe::new(visit, voxels, index, &self.sampling);
        SampledRay::new(self, visit.level()).gather(&probe, visit.level(), t, state, counters);
    }
}

impl Integrator for Tables {
    fn gather_macro_cell(
        &self,
        visit: &BrickVisit<'_>,
        index: [i64; 3],
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        match visit.voxels() {
            Voxels::U8(voxels) => self.gather_brick(visit, (voxels, index), t, state, counters),
            Voxels::U16(voxels) => self.gather_brick(visit, (voxels, index), t, state, counters),
            Voxels::F32(voxels) => self.gather_brick(visit, (voxels, index), t, state, counters),
        }
    }

    fn gather_uniform(
        &self,
        visit: &LevelVisit<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        let probe = UniformProbe { value, rgba: visit.transfer_function().classify(value) };
        SampledRay::new(self, visit).gather(&probe, visit, t, state, counters);
    }
}
