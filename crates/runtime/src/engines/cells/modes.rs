//! Contribution of one chord to a ray, mode by mode.
//!
//! A chord lies in one trilinear cell and is present everywhere or nowhere. `u` runs from 0 to 1 along it, `h` is its
//! world length.

use glam::Vec3;
use supervol_format::cast::{single, whole};
use supervol_scene::scene::ISO_LIMIT;
use supervol_scene::transfer_function::RenderTransferFunction;

use super::cell::{Cell, Real, cubic_at, cubic_extremes, cubic_mean, monotone_intervals, monotone_root};
use super::cell_by_cell::Pairs;
use super::quadrature::{
    GAUSS_OFFSET, KNOT_LIMIT, PAIR_LIMIT, integrate_pair, opacity_of, pairs_between, shaded_pair_count, splits_of_chord,
};
use super::shade::{ChordGradient, Lighting, shade};
use crate::engines::ray::{RayState, SurfaceCrossing};
use crate::engines::ray_scene::RayScene;
use crate::engines::rules::PART_NORMAL_CHANGE;
use crate::stream::counters::RayCounters;

/// Most halvings of a part.
const HALVINGS: u32 = 12;

/// One chord: the field along it, and the gradient if the frame is shaded and the gradient is known.
#[derive(Debug)]
pub struct CellChord {
    /// Least and greatest corner of its cell.
    pub low: f32,
    /// See `low`.
    pub high: f32,
    /// s(u).
    pub cubic: [Real; 4],
    /// Index gradient of the chord's level; `None`: unshaded.
    pub gradient: Option<ChordGradient>,
    /// World length.
    pub h: f64,
}

/// Shading at a point: the part that does not depend on the chord.
#[derive(Debug)]
pub struct ShadeSetup<'a> {
    /// Lighting of the frame; `None`: unshaded.
    pub lighting: Option<&'a Lighting>,
    /// World gradient from the index gradient of the chord's level.
    pub world_from_level_gradient: glam::Mat3,
    /// Minus the ray's direction.
    pub to_eye: Vec3,
}

impl CellChord {
    /// A chord through a cell.
    #[inline]
    #[must_use]
    pub fn new(cell: &Cell, cubic: [Real; 4], gradient: Option<ChordGradient>, h: f64) -> Self {
        Self { low: cell.low, high: cell.high, cubic, gradient, h }
    }

    /// A chord of constant value.
    #[must_use]
    pub fn uniform(value: f32, h: f64) -> Self {
        Self { low: value, high: value, cubic: [Real::from(value), 0.0, 0.0, 0.0], gradient: None, h }
    }

    /// s(u), clamped to the corners' range: rounding must not leave it.
    #[inline]
    fn value(&self, u: Real) -> f32 {
        single(cubic_at(&self.cubic, u)).clamp(self.low, self.high)
    }

    #[inline]
    fn shaded(&self, setup: &ShadeSetup<'_>, color: [f32; 3], u: Real) -> [f32; 3] {
        match (setup.lighting, &self.gradient) {
            (Some(lighting), Some(gradient)) => {
                shade(lighting, color, setup.world_from_level_gradient * gradient.at(u), setup.to_eye)
            }
            _ => color,
        }
    }
}

/// Adds an interval's premultiplied colour and opacity behind those of the ray so far.
#[inline]
pub fn composite(state: &mut RayState, color: [f32; 3], opacity: f32) {
    for (gathered, c) in state.color.iter_mut().zip(color) {
        *gathered += state.transmittance * f64::from(c);
    }
    state.transmittance *= 1.0 - f64::from(opacity);
}

/// Emission and absorption over the chord.
pub fn gather_dvr(
    scene: &RayScene,
    setup: &ShadeSetup<'_>,
    pairs: Pairs,
    chord: &CellChord,
    state: &mut RayState,
    counters: &mut RayCounters,
) {
    let tf = &scene.transfer_function;
    let h = chord.h;
    if chord.low == chord.high && chord.gradient.is_none() {
        let [r, g, b, alpha] = tf.classify(chord.low);
        let opacity = opacity_of(tf.extinction(alpha) * single(h));
        counters.samples += 1;
        composite(state, [r, g, b].map(|c| c * opacity), opacity);
        return;
    }
    let knots = tf.knots_in(chord.low, chord.high);
    if knots.is_empty() || knots.len() > KNOT_LIMIT {
        counters.samples += gather_part(scene, setup, pairs, chord, [0.0, 1.0], state, HALVINGS);
        return;
    }
    let splits = splits_of_chord(&chord.cubic, knots);
    for part in splits.as_slice().windows(2).filter(|part| part[0] < part[1]) {
        counters.samples += gather_part(scene, setup, pairs, chord, [part[0], part[1]], state, HALVINGS);
    }
}

/// Gathers over one part of a chord, between two splits, by Gauss pairs; in halves if the normal turns far. Returns the
/// number of samples.
fn gather_part(
    scene: &RayScene,
    setup: &ShadeSetup<'_>,
    pairs: Pairs,
    chord: &CellChord,
    [begin, end]: [Real; 2],
    state: &mut RayState,
    halvings: u32,
) -> u64 {
    let tf = &scene.transfer_function;
    let wanted = match pairs {
        Pairs::Adaptive { density } => {
            let change = normal_change(setup, chord, [begin, end]);
            if halvings > 0 && change.is_some_and(|change| change > PART_NORMAL_CHANGE) {
                let middle = 0.5 * (begin + end);
                let halves = [[begin, middle], [middle, end]].into_iter();
                return halves.map(|half| gather_part(scene, setup, pairs, chord, half, state, halvings - 1)).sum();
            }
            denser(wanted_pairs(tf, chord, [begin, end], change), density)
        }
        Pairs::Fixed(pairs) => pairs.clamp(1, PAIR_LIMIT),
    };
    let step = (end - begin) / Real::from(wanted);
    for i in 0..wanted {
        let mut kappa = [0.0; 2];
        let mut color = [[0.0; 3]; 2];
        for (point, offset) in [GAUSS_OFFSET, 1.0 - GAUSS_OFFSET].into_iter().enumerate() {
            let u = begin + (Real::from(i) + offset) * step;
            let [r, g, b, alpha] = tf.classify(chord.value(u));
            if alpha > 0.0 {
                kappa[point] = tf.extinction(alpha);
                color[point] = chord.shaded(setup, [r, g, b], u);
            }
        }
        let (c, opacity) = integrate_pair(kappa, color, single(step * chord.h));
        composite(state, c, opacity);
    }
    u64::from(2 * wanted)
}

/// Gauss pairs required between two splits, by the transfer function, and by the normal's change if the chord is
/// shaded.
#[inline]
fn wanted_pairs(tf: &RenderTransferFunction, chord: &CellChord, u: [Real; 2], change: Option<f32>) -> u32 {
    let plain = pairs_between(tf, &chord.cubic, u, chord.h);
    let Some(change) = change else { return plain };
    let middle = 0.5 * (u[0] + u[1]);
    let tau = tf.extinction(tf.classify(chord.value(middle))[3]) * single(chord.h * (u[1] - u[0]));
    plain.max(shaded_pair_count(change, tau))
}

/// Turn of the normal from a part's beginning over its middle to its end, as a length; `None` if there is no normal.
#[inline]
fn normal_change(setup: &ShadeSetup<'_>, chord: &CellChord, [begin, end]: [Real; 2]) -> Option<f32> {
    let (Some(_), Some(gradient)) = (setup.lighting, &chord.gradient) else { return None };
    let normal = |u: Real| (setup.world_from_level_gradient * gradient.at(u)).normalize_or_zero();
    let [a, m, b] = [begin, 0.5 * (begin + end), end].map(normal);
    Some(a.distance(m) + m.distance(b))
}

/// Number of pairs times the density; unchanged if the density is 1.
#[inline]
fn denser(pairs: u32, density: f32) -> u32 {
    if density == 1.0 {
        return pairs;
    }
    // `as` saturates.
    whole::<u32>((pairs as f32 * density).ceil()).clamp(1, PAIR_LIMIT)
}

/// The greatest value so far.
pub fn gather_mip(chord: &CellChord, state: &mut RayState) {
    if f64::from(chord.high) > state.value || state.value.is_nan() {
        let (_, high) = cubic_extremes(&chord.cubic, monotone_intervals(&chord.cubic).as_slice());
        state.value = f64::from(single(high).clamp(chord.low, chord.high)).max(state.value);
    }
}

/// The least value so far.
pub fn gather_minip(chord: &CellChord, state: &mut RayState) {
    if f64::from(chord.low) < state.value || state.value.is_nan() {
        let (low, _) = cubic_extremes(&chord.cubic, monotone_intervals(&chord.cubic).as_slice());
        state.value = f64::from(single(low).clamp(chord.low, chord.high)).min(state.value);
    }
}

/// The integral of the values, and the present length.
pub fn gather_mean(chord: &CellChord, state: &mut RayState) {
    let mean = cubic_mean(&chord.cubic);
    state.value = if state.value.is_nan() { 0.0 } else { state.value } + mean * chord.h;
    state.length += chord.h;
}

/// First crossings of the iso values on the chord, composited in order.
///
/// The ray carries its side from chord to chord. So a crossing exactly on a face is found, although the cubics of its
/// two cells round differently there.
pub fn gather_iso(scene: &RayScene, setup: &ShadeSetup<'_>, chord: &CellChord, state: &mut RayState) {
    let mut hits = [(0.0, 0usize); ISO_LIMIT];
    let mut hit_count = 0;
    for (index, surface) in scene.iso.iter().enumerate() {
        let bit = 1u32 << index;
        if state.iso.hit & bit != 0 {
            continue;
        }
        let begins_above = chord.value(0.0) >= surface.value;
        let ends_above = chord.value(1.0) >= surface.value;
        let jumped = state.iso.known & bit != 0 && (state.iso.above & bit != 0) != begins_above;
        let crossing = if jumped {
            Some(0.0)
        } else {
            let rounded = || (begins_above != ends_above).then(|| end_near(chord, [0.0, 1.0], surface.value));
            first_crossing(chord, surface.value).or_else(rounded)
        };
        state.iso.above = if ends_above { state.iso.above | bit } else { state.iso.above & !bit };
        if let Some(u) = crossing {
            state.iso.hit |= bit;
            hits[hit_count] = (u, index);
            hit_count += 1;
        }
    }
    state.iso.known = u32::MAX;
    let hits = &mut hits[..hit_count];
    hits.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for &(u, index) in hits.iter() {
        let surface = &scene.iso[index];
        let color = chord.shaded(setup, surface.color, u);
        composite(state, color.map(|c| c * surface.alpha), surface.alpha);
    }
}

/// All crossings of the iso values on the chord, which begins at `state.t`, in order: listed, not composited.
///
/// The side is carried as in [`gather_iso`].
pub fn gather_crossings(scene: &RayScene, setup: &ShadeSetup<'_>, chord: &CellChord, state: &mut RayState) {
    let mut found: Vec<(Real, usize)> = Vec::new();
    let intervals = monotone_intervals(&chord.cubic);
    for (index, surface) in scene.iso.iter().enumerate() {
        let bit = 1u32 << index;
        let is_above = |u: Real| chord.value(u) >= surface.value;
        let mut side = if state.iso.known & bit != 0 { state.iso.above & bit != 0 } else { is_above(0.0) };
        for ends in intervals.as_slice().windows(2) {
            let [begins, is_end_above] = [ends[0], ends[1]].map(is_above);
            if begins != side {
                // Jumped: between levels, or by rounding.
                found.push((ends[0], index));
            }
            if begins != is_end_above {
                let root = monotone_root(&chord.cubic, ends[0], ends[1], Real::from(surface.value));
                found.push((root.unwrap_or_else(|| end_near(chord, [ends[0], ends[1]], surface.value)), index));
            }
            side = is_end_above;
        }
        state.iso.above = if side { state.iso.above | bit } else { state.iso.above & !bit };
    }
    state.iso.known = u32::MAX;
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (u, index) in found {
        let surface = &scene.iso[index];
        if surface.alpha > 0.0 {
            let color = chord.shaded(setup, surface.color, u).map(|c| c * surface.alpha);
            state.crossings.push(SurfaceCrossing { t: state.t + u * chord.h, color, alpha: surface.alpha });
        }
    }
}

/// The end of the interval at which the cubic comes just short of a value that its `f32` may have reached.
fn end_near(chord: &CellChord, [begin, end]: [Real; 2], value: f32) -> Real {
    let distance = |u: Real| (cubic_at(&chord.cubic, u) - Real::from(value)).abs();
    if distance(begin) < distance(end) { begin } else { end }
}

fn first_crossing(chord: &CellChord, value: f32) -> Option<Real> {
    // A least corner that has the value is above, whatever the cubic rounds to there.
    if value <= chord.low || value > chord.high {
        return None;
    }
    let intervals = monotone_intervals(&chord.cubic);
    intervals.as_slice().windows(2).find_map(|ends| monotone_root(&chord.cubic, ends[0], ends[1], Real::from(value)))
}
