//! Cells in which only the light is uncertain: one cell at a time, its positions in the lanes.
//!
//! The gradient along a cell is known: one cubic per axis. So are the cell's contribution without light, and the linear
//! densities of its origin along the chord ([`Part::moments`]). The light is computed in the middle of [`PLACES`] equal
//! stretches and taken for constant in each, and cut off at 1 there.
//!
//! Bound of the error of a stretch of half length e, around a place where the derivatives of n.l are at most n1 and n2:
//! - the light is off the line through the place by `n2 e^2 / 6` in the mean, and what the line does on one side it does
//!   reversed on the other, for a constant density; for one that changes by t, `t n1 e^2 / 3` is left;
//! - where `|n.l|` or the cut has its kink in the stretch, the line is off by half of what it reaches beyond the kink;
//! - where the gradient may vanish, the light may be anything.
//!
//! Refinement ([`super::refine`]) would compute as many positions one after the other, and integrate the cell's parts
//! again at each.

use super::chord::{cubic_at, cubic_through};
use super::integrate::Part;
use super::shade::{LightAt, PacketLighting, greatest_of, nearest_within};
use super::shaded_cells::AlongRay;
use super::simd::{LANES_LIMIT, Simd, Task, for_three, lanes, load_from};
use super::turn::{derivatives, length};
use super::walk::PerLane;

/// Positions along a cell.
const PLACES: usize = LANES_LIMIT;
/// Length of a stretch.
const STRETCH: f32 = 1.0 / PLACES as f32;
/// Half of it.
const HALF: f32 = 0.5 * STRETCH;
/// The positions, in cells; and room for the lanes behind the last.
const MIDDLES: [f32; PLACES + LANES_LIMIT] = {
    let mut middles = [0.0; PLACES + LANES_LIMIT];
    let mut k = 0;
    while k < PLACES {
        middles[k] = (k as f32 + 0.5) * STRETCH;
        k += 1;
    }
    middles
};
/// Change per cell of light that may be anything in a stretch, so that its own way through it and through its neighbours may
/// be taken instead: there and back.
const OPEN_CHANGE: f32 = 2.0 / STRETCH;
/// Most that a density may change over a cell, in parts of itself, and be nowhere below 0.
const STEEPEST: f32 = 2.0;

/// Cells of a packet whose light is uncertain, lane by lane. Densities are relative to the opacity.
pub struct TurningCells {
    /// Colour of the cell's contribution, not premultiplied, without light; and how the density of each changes over the cell.
    plain: [PerLane; 3],
    changes: [PerLane; 3],
    /// Opacity, and how its density changes over the cell.
    opacity: PerLane,
    change: PerLane,
    /// Distance of the densities from the true ones: see [`Part::misplaced`].
    misplaced: PerLane,
    /// Variation of colour.
    colors: PerLane,
    /// The gradient along the cell, axis by axis: coefficients.
    gradients: [[PerLane; 4]; 3],
    /// Unit vectors toward the eye.
    to_eye: [PerLane; 3],
    /// Error without the light; with light in the end.
    error: PerLane,
    /// Premultiplied colour with light, in the end.
    color: [PerLane; 3],
}

impl TurningCells {
    /// Cells with these contributions, gradients and eye vectors, and their errors without light.
    #[inline(always)]
    pub fn new<S: Simd>(part: &Part<S>, along: &AlongRay<S>, to_eye: &[S::F; 3], of_part: S::F) -> Self {
        let (zero, one, twelve) = (S::splat(0.0), S::splat(1.0), S::splat(12.0));
        let opacity = one - part.transmittance;
        let per_opacity = one / S::max(opacity, S::splat(f32::MIN_POSITIVE));
        let [begin, middle, end] = along.gradients;
        let cubics = for_three!(a => cubic_through::<S>([begin[a], middle[a], end[a]], along.cubics[a]));
        let plain = for_three!(c => part.color[c] * per_opacity);
        // Colours are flattened with the opacity: cutting one off at the other would not be light.
        let (change, mut flattened) = flattened_to::<S>(part.moments[0] * per_opacity * twelve, one);
        let mut changes = plain;
        for c in 0..3 {
            let (change, by) = flattened_to::<S>(part.moments[c + 1] * per_opacity * twelve, plain[c]);
            (changes[c], flattened) = (change, S::max(flattened, by));
        }
        let mut cells = Self {
            plain: plain.map(stored::<S>),
            changes: changes.map(stored::<S>),
            opacity: stored::<S>(opacity),
            change: stored::<S>(change),
            misplaced: stored::<S>(S::mul_add(part.misplaced, per_opacity, flattened)),
            colors: stored::<S>(part.colors),
            gradients: [[[0.0; LANES_LIMIT]; 4]; 3],
            to_eye: for_three!(a => stored::<S>(to_eye[a])),
            error: stored::<S>(of_part),
            color: [stored::<S>(zero); 3],
        };
        for (gradients, cubic) in cells.gradients.iter_mut().zip(cubics) {
            for (into, coefficient) in gradients.iter_mut().zip(cubic) {
                S::store(coefficient, into);
            }
        }
        cells
    }

    /// Colours and errors.
    #[inline(always)]
    pub fn outcome<S: Simd>(&self) -> ([S::F; 3], S::F) {
        (for_three!(c => S::load(&self.color[c])), S::load(&self.error))
    }
}

/// Change over a cell of a density of this mean, so that it is nowhere below 0, and how far that moves its integral.
#[inline(always)]
fn flattened_to<S: Simd>(steep: S::F, mean: S::F) -> (S::F, S::F) {
    let most = S::splat(STEEPEST) * mean;
    let change = S::min(S::max(steep, S::splat(0.0) - most), most);
    (change, S::abs(steep - change) * S::splat(1.0 / 8.0))
}

#[inline(always)]
fn stored<S: Simd>(values: S::F) -> PerLane {
    let mut numbers = [0.0; LANES_LIMIT];
    S::store(values, &mut numbers);
    numbers
}

/// Settles the light of some cells.
pub struct SettleLight<'a> {
    /// The brick's lighting.
    pub lighting: &'a PacketLighting<'a>,
    /// All cells of the packet.
    pub cells: &'a mut TurningCells,
    /// The cells to settle, as bits.
    pub lanes: u32,
}

impl Task for SettleLight<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        for lane in lanes(self.lanes) {
            let (mean, missed) = light::<S>(self.lighting, self.cells, lane);
            let opacity = self.cells.opacity[lane];
            for (color, mean) in self.cells.color.iter_mut().zip(mean) {
                color[lane] = opacity * mean;
            }
            self.cells.error[lane] += opacity * missed.min(1.0);
        }
    }
}

/// Bounds around the places of a cell, in parts of the opacity.
struct AtPlaces<S: Simd> {
    gradient: [S::F; 3],
    /// Lanes where the whole stretch has a normal, and where none of it has.
    is_known: S::M,
    is_dark: S::M,
    /// Bounds of the first two derivatives of the normal.
    turn: [S::F; 2],
    /// Inverse of the least length of the gradient where it is known, else 0.
    inverse: S::F,
}

impl<S: Simd> AtPlaces<S> {
    /// The gradient around places, from its coefficients.
    #[inline(always)]
    fn new(cubics: &[[S::F; 4]; 3], at: S::F, floors: [f32; 2]) -> Self {
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let gradient = for_three!(a => cubic_at::<S>(cubics[a], at));
        let two_at = at + at;
        let slopes = for_three!(a => {
            let [_, k1, k2, k3] = cubics[a];
            S::mul_add(two_at, S::mul_add(S::splat(1.5) * at, k3, k2), k1)
        });
        // The second derivative is linear, and greatest at an end of the stretch.
        let bow = S::max(bow_at::<S>(cubics, at - S::splat(HALF)), bow_at::<S>(cubics, at + S::splat(HALF)));
        let slope_there = length::<S>(&slopes);
        let slope = S::mul_add(bow, S::splat(HALF), slope_there);
        let away = S::splat(HALF) * S::mul_add(bow, S::splat(0.5 * HALF), slope_there);
        let long = length::<S>(&gradient);
        let least = long - away;
        let [dark, bright] = floors.map(S::splat);
        let is_known = S::lt(bright, least);
        let inverse = one / S::select(is_known, least, one);
        let [n1, n2, ..] = derivatives::<S>([slope, bow, zero], inverse);
        Self {
            gradient,
            is_known,
            is_dark: S::lt(long + away, dark),
            turn: [n1, n2],
            inverse: S::select(is_known, inverse, zero),
        }
    }
}

/// Length of the second derivative.
#[inline(always)]
fn bow_at<S: Simd>(cubics: &[[S::F; 4]; 3], at: S::F) -> S::F {
    let six = S::splat(6.0) * at;
    length::<S>(&for_three!(a => S::mul_add(six, cubics[a][3], cubics[a][2] + cubics[a][2])))
}

/// The mean colour of a lane's cell with light, and a bound of its error.
#[inline(always)]
fn light<S: Simd>(lighting: &PacketLighting<'_>, cells: &TurningCells, lane: usize) -> ([f32; 3], f32) {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let cubics = for_three!(a => {
        let k = &cells.gradients[a];
        [S::splat(k[0][lane]), S::splat(k[1][lane]), S::splat(k[2][lane]), S::splat(k[3][lane])]
    });
    let to_eye = for_three!(a => S::splat(cells.to_eye[a][lane]));
    let (plain, changes) =
        (for_three!(c => S::splat(cells.plain[c][lane])), for_three!(c => S::splat(cells.changes[c][lane])));
    let change = S::splat(cells.change[lane]);
    let own_change = for_three!(c => S::abs(changes[c] - change * plain[c]));
    let variation = S::mul_add(greatest_of::<S>(own_change), S::splat(0.5), S::splat(cells.colors[lane]));
    let steepest = S::max(greatest_of::<S>(for_three!(c => S::abs(changes[c]))), S::abs(change));
    let (mut sums, mut missed, mut change_of_light) = ([zero; 3], zero, zero);
    for first in (0..PLACES).step_by(S::LANES) {
        let at = load_from::<S>(&MIDDLES, first);
        let around = AtPlaces::<S>::new(&cubics, at, lighting.floors());
        let [lit] = lighting.at::<S, 1>(&[around.gradient], &to_eye);
        let from_middle = at - S::splat(0.5);
        let density = S::mul_add(from_middle, change, one);
        let emission = for_three!(c => S::mul_add(from_middle, changes[c], plain[c]));
        for c in 0..3 {
            let color = S::mul_add(emission[c], lit.diffuse, density * lit.specular);
            // Without light nothing is cut off: that a line of emission reaches over that of opacity is no light.
            sums[c] = sums[c] + S::select(around.is_dark, emission[c], S::min(color, density));
        }
        let stretch = LightStretch { around: &around, lit: &lit, density, emission, steepest, variation };
        let of_stretch = stretch.missed(lighting);
        missed = missed + of_stretch.error;
        if lighting.has_noise() {
            missed = S::mul_add(density, lighting.light_of_noise::<S>(around.inverse), missed);
        }
        change_of_light = change_of_light + of_stretch.change;
    }
    let misplaced = cells.misplaced[lane] * S::sum(change_of_light) * STRETCH;
    (for_three!(c => S::sum(sums[c]) * STRETCH), S::sum(missed) * STRETCH + misplaced)
}

/// Light in a stretch around each place.
struct LightStretch<'a, S: Simd> {
    around: &'a AtPlaces<S>,
    lit: &'a LightAt<S>,
    /// Density of opacity, and of the colours; and the greatest change of any of them over the cell.
    density: S::F,
    emission: [S::F; 3],
    steepest: S::F,
    /// Bound on how far colour is from its mean, and from what the densities say.
    variation: S::F,
}

/// Error in a stretch.
struct Missed<S: Simd> {
    error: S::F,
    /// Change of the light per cell.
    change: S::F,
}

impl<S: Simd> LightStretch<'_, S> {
    /// Bound on what is missed of any channel.
    #[inline(always)]
    fn missed(&self, lighting: &PacketLighting<'_>) -> Missed<S> {
        let (zero, half) = (S::splat(0.0), S::splat(HALF));
        let Self { around, lit, .. } = self;
        let [ambient, diffuse, specular] = lighting.strengths().map(S::splat);
        let [n1, n2] = around.turn;
        let reach = half * n1;
        let nearest = nearest_within::<S>(lit.nearest, reach);
        let [power] = lighting.highlights::<S, 1>([nearest * nearest]);
        let [h1, h2] = lighting.highlight.first_two::<S>(around.turn, nearest, power, STRETCH);
        let change = S::mul_add(n1, diffuse, h1 * specular);
        let density = S::mul_add(self.steepest, half, self.density);
        let emission = S::mul_add(self.steepest, half, greatest_of::<S>(self.emission));
        let bent = S::mul_add(emission * n2, diffuse, density * h2 * specular);
        let shifted = self.steepest * change * S::splat(2.0);
        let turned = half * change * density;
        let smooth =
            S::mul_add(bent + shifted, S::splat(HALF * HALF / 6.0), emission * lighting.kinks::<S>(lit, reach));
        // Colours of the stretch, and of places in it, that are on either side of the cut.
        let brightest = S::min(S::mul_add(reach, diffuse, lit.diffuse), ambient + diffuse);
        let differs = S::mul_add(self.steepest, half * (brightest + S::splat(1.0)), self.variation * brightest);
        let (mut of_cut, mut open) = (zero, zero);
        for color in &self.emission {
            let lit = S::mul_add(*color, lit.diffuse, self.density * lit.specular);
            let near = S::max(turned + differs - S::abs(self.density - lit), zero);
            // A kink inside; and colours on another side of it than their mean.
            of_cut = S::max(of_cut, S::splat(0.5) * S::max(near - differs, zero));
            open = S::max(open, S::min(near, differs));
        }
        let open = S::select(around.is_known, open, S::select(around.is_dark, zero, density));
        let known = S::select(around.is_known, smooth + of_cut, zero);
        // Also beside the stretch, where the true density may differ.
        let error = S::mul_add(S::splat(2.0), open, known);
        let change = S::mul_add(S::splat(OPEN_CHANGE), open, S::select(around.is_known, change, zero));
        Missed { error, change }
    }
}
