//! Cells in which only the light is uncertain, because the normal turns: one cell at a time, its positions in the
//! lanes.
//!
//! The gradient along a cell is known: one cubic per axis. So are the cell's contribution without light, and the origin
//! of that contribution along the chord. The light is computed in the middle of [`PLACES`] equal parts, weighted as in
//! [`PacketLighting::shade`]. The error has three parts:
//! - kinks, by second differences;
//! - light between two positions, by the turn of the normal to the next one and to the cell's ends;
//! - light that varies unevenly, by its variation.
//!
//! Refinement ([`super::refine`]) would compute as many positions one after the other, and integrate the cell's parts
//! again at each.

use super::integrate::{Part, cubic_at, cubic_through};
use super::shade::{LightAt, PacketLighting, uneven};
use super::shaded_cells::AlongRay;
use super::simd::{LANES_LIMIT, Simd, Task, for_three, lanes, load_from};
use super::walk::PerLane;
use crate::engines::rules::{HIGHLIGHT_REACH, KINK_SHARE, UNEVEN_SHARE};

/// Positions along a cell.
const PLACES: usize = LANES_LIMIT;
/// Length of a part.
const PART: f32 = 1.0 / PLACES as f32;
/// The positions, in cells.
const MIDDLES: PerPlace = {
    let mut middles = [0.0; 2 * PLACES];
    let mut k = 0;
    while k < PLACES {
        middles[k] = (k as f32 + 0.5) * PART;
        k += 1;
    }
    middles
};

/// Numbers per position, with room for those two positions further on.
type PerPlace = [f32; 2 * PLACES];

/// Cells of a packet whose light is uncertain, lane by lane.
pub struct TurningCells {
    /// Colour of the cell's contribution, not premultiplied, without light.
    plain: [PerLane; 3],
    /// Opacity.
    opacity: PerLane,
    /// See [`Part::front_share`].
    front_share: PerLane,
    /// Share of the light's variation that its mean may be off by.
    uneven: PerLane,
    /// The gradient along the cell, axis by axis: coefficients.
    gradients: [[PerLane; 4]; 3],
    /// Unit vectors toward the eye.
    to_eye: [PerLane; 3],
    /// Error without the light; with light in the end.
    error: PerLane,
    /// Premultiplied colour; with light in the end.
    color: [PerLane; 3],
}

impl TurningCells {
    /// Cells with these contributions, gradients and eye vectors, and their colours and errors so far.
    #[inline(always)]
    pub fn new<S: Simd>(
        lighting: &PacketLighting<'_>,
        part: &Part<S>,
        along: &AlongRay<S>,
        to_eye: &[S::F; 3],
        color: &[S::F; 3],
        of_part: S::F,
    ) -> Self {
        let one = S::splat(1.0);
        let opacity = one - part.transmittance;
        let per_opacity = one / S::max(opacity, S::splat(f32::MIN_POSITIVE));
        let [begin, middle, end] = along.gradients;
        let cubics = for_three!(a => cubic_through::<S>([begin[a], middle[a], end[a]], along.cubics[a]));
        let beyond = lighting.error_between::<S>(&begin, &gradient_at::<S>(&cubics, MIDDLES[0]))
            + lighting.error_between::<S>(&end, &gradient_at::<S>(&cubics, MIDDLES[PLACES - 1]));
        let of_ends = S::min(beyond * S::splat(0.5 * PART), one);
        let mut cells = Self {
            plain: for_three!(c => stored::<S>(part.color[c] * per_opacity)),
            opacity: stored::<S>(opacity),
            front_share: stored::<S>(part.front_share),
            uneven: stored::<S>(S::splat(UNEVEN_SHARE) * uneven(part)),
            gradients: [[[0.0; LANES_LIMIT]; 4]; 3],
            to_eye: for_three!(a => stored::<S>(to_eye[a])),
            error: stored::<S>(S::mul_add(opacity, of_ends, of_part)),
            color: for_three!(c => stored::<S>(color[c])),
        };
        for (gradients, cubic) in cells.gradients.iter_mut().zip(cubics) {
            for (into, coefficient) in gradients.iter_mut().zip(cubic) {
                S::store(coefficient, into);
            }
        }
        cells
    }

    /// Adds to a lane's error the light that its positions miss.
    #[inline(always)]
    fn add_missed<S: Simd>(&mut self, lighting: &PacketLighting<'_>, lane: usize, places: &CellLight) {
        let missed = missed::<S>(lighting, self.uneven[lane], places);
        self.error[lane] += self.opacity[lane] * missed.min(1.0);
    }

    /// Colours and errors.
    #[inline(always)]
    pub fn outcome<S: Simd>(&self) -> ([S::F; 3], S::F) {
        (for_three!(c => S::load(&self.color[c])), S::load(&self.error))
    }
}

/// The gradient at u.
#[inline(always)]
fn gradient_at<S: Simd>(cubics: &[[S::F; 4]; 3], u: f32) -> [S::F; 3] {
    for_three!(a => cubic_at::<S>(cubics[a], S::splat(u)))
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

/// Light along one cell.
struct CellLight {
    /// Light of the brightest channel, and light without colour.
    brightest: PerPlace,
    specular: PerPlace,
    normal: [PerPlace; 3],
    nearest: PerPlace,
}

impl CellLight {
    const NOTHING: Self = {
        let nothing = [0.0; 2 * PLACES];
        Self { brightest: nothing, specular: nothing, normal: [nothing; 3], nearest: nothing }
    };
}

impl Task for SettleLight<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let mut places = [CellLight::NOTHING; 2];
        let (mut before, mut last) = (None, 0);
        for (number, lane) in lanes(self.lanes).enumerate() {
            let [here, there] = &mut places;
            let (here, there) = if number % 2 == 0 { (here, &*there) } else { (there, &*here) };
            let mean = light::<S>(self.lighting, self.cells, lane, here);
            for (color, mean) in self.cells.color.iter_mut().zip(mean) {
                color[lane] = self.cells.opacity[lane] * mean;
            }
            // One cell late, so that values just written are not read at once.
            if let Some(before) = before.replace(lane) {
                self.cells.add_missed::<S>(self.lighting, before, there);
            }
            last = number % 2;
        }
        if let Some(before) = before {
            self.cells.add_missed::<S>(self.lighting, before, &places[last]);
        }
    }
}

/// The mean colour of a lane's cell with light; writes the light at its positions.
#[inline(always)]
fn light<S: Simd>(
    lighting: &PacketLighting<'_>,
    cells: &TurningCells,
    lane: usize,
    places: &mut CellLight,
) -> [f32; 3] {
    let zero = S::splat(0.0);
    let plain = for_three!(c => S::splat(cells.plain[c][lane]));
    let strongest = S::max(S::max(plain[0], plain[1]), plain[2]);
    let cubics = for_three!(a => {
        let k = &cells.gradients[a];
        [S::splat(k[0][lane]), S::splat(k[1][lane]), S::splat(k[2][lane]), S::splat(k[3][lane])]
    });
    let to_eye = for_three!(a => S::splat(cells.to_eye[a][lane]));
    // Twice the share, so that the mean over the cell is 1.
    let at_front = 2.0 * cells.front_share[lane];
    let mut sums = [zero; 3];
    for first in (0..PLACES).step_by(S::LANES) {
        let at = load_from::<S>(&MIDDLES, first);
        let gradient = for_three!(a => cubic_at::<S>(cubics[a], at));
        let [lit] = lighting.at::<S, 1>(&[gradient], &to_eye);
        let weight = S::mul_add(at, S::splat(2.0 - 2.0 * at_front), S::splat(at_front));
        for c in 0..3 {
            let f = S::min(lit.of(plain[c]), S::splat(1.0));
            sums[c] = S::mul_add(f, weight, sums[c]);
        }
        let LightAt { inverse_length, nearest, specular, .. } = lit;
        keep::<S>(S::min(lit.of(strongest), S::splat(1.0)), first, &mut places.brightest);
        keep::<S>(specular, first, &mut places.specular);
        keep::<S>(nearest, first, &mut places.nearest);
        for (normal, component) in places.normal.iter_mut().zip(gradient) {
            keep::<S>(component * inverse_length, first, normal);
        }
    }
    for_three!(c => S::sum(sums[c]) * PART)
}

/// Light of a cell that its positions miss, over its opacity.
#[inline(always)]
fn missed<S: Simd>(lighting: &PacketLighting<'_>, uneven: f32, places: &CellLight) -> f32 {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    let mut sum = zero;
    for first in (0..PLACES).step_by(S::LANES) {
        let at = load_from::<S>(&MIDDLES, first);
        // The last position has no next one, the last two have none after that.
        let has_next = S::lt(at, S::splat(1.0 - PART));
        let has_second = S::lt(at, S::splat(1.0 - 2.0 * PART));
        let (rise, bend) = differences::<S>(&places.brightest, first);
        let (rise_of_specular, bend_of_specular) = differences::<S>(&places.specular, first);
        let (rise, bend) = (S::max(rise, rise_of_specular), S::max(bend, bend_of_specular));
        let mut turn = zero;
        for normal in &places.normal {
            let (rise, _) = differences::<S>(normal, first);
            turn = S::mul_add(rise, rise, turn);
        }
        let nearest = S::max(load_from::<S>(&places.nearest, first), load_from::<S>(&places.nearest, first + 1));
        let nearest = S::min(S::mul_add(S::sqrt(turn), S::splat(HIGHLIGHT_REACH), nearest), one);
        let [seen] = lighting.highlights::<S, 1>([nearest * nearest]);
        let of_turn = lighting.missed_by_turn::<S>(turn, seen);
        let of_next = S::mul_add(rise, S::splat(uneven), of_turn * S::splat(PART));
        sum = sum + S::select(has_next, of_next, zero);
        sum = sum + S::select(has_second, bend * S::splat(KINK_SHARE * PART), zero);
    }
    S::sum(sum)
}

/// Absolute first and second differences between positions from number `first` on.
#[inline(always)]
fn differences<S: Simd>(numbers: &PerPlace, first: usize) -> (S::F, S::F) {
    let (here, next) = (load_from::<S>(numbers, first), load_from::<S>(numbers, first + 1));
    let rise = next - here;
    (S::abs(rise), S::abs(load_from::<S>(numbers, first + 2) - next - rise))
}

#[inline(always)]
fn keep<S: Simd>(values: S::F, first: usize, numbers: &mut PerPlace) {
    S::store(values, numbers[first..].first_chunk_mut().expect("there are whole lanes behind each place"));
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::simd::InstructionSet;
    use super::*;
    use crate::engines::cells::shade::Lighting;

    /// The light along one cell, settled: colour and error; and its mean over many positions.
    struct LitCell<'a> {
        lighting: &'a PacketLighting<'a>,
        /// Gradient at beginning, middle and end, and its cubic coefficients.
        gradients: [[f32; 3]; 4],
        plain: [f32; 3],
        front_share: f32,
    }

    impl Task for LitCell<'_> {
        type Output = ([f32; 3], f32, [f64; 3]);

        #[inline(always)]
        fn run<S: Simd>(self) -> Self::Output {
            let Self { lighting, gradients, plain, front_share } = self;
            let three = |v: [f32; 3]| [S::splat(v[0]), S::splat(v[1]), S::splat(v[2])];
            let opacity = 0.25;
            let part = Part {
                color: three(plain.map(|c| c * opacity)),
                transmittance: S::splat(1.0 - opacity),
                front_share: S::splat(front_share),
                ..Part::nothing()
            };
            let mut along = AlongRay::<S>::nothing();
            along.gradients = [three(gradients[0]), three(gradients[1]), three(gradients[2])];
            along.cubics = three(gradients[3]);
            let to_eye = three([0.0, 0.0, 1.0]);
            let zero = S::splat(0.0);
            let mut cells = TurningCells::new::<S>(lighting, &part, &along, &to_eye, &[zero; 3], zero);
            SettleLight { lighting, cells: &mut cells, lanes: 1 }.run::<S>();
            let mut exact = [0.0; 3];
            let cubics = for_three!(a => cubic_through::<S>(
                [along.gradients[0][a], along.gradients[1][a], along.gradients[2][a]], along.cubics[a]));
            let many = 4096;
            for k in 0..many {
                let u = (k as f32 + 0.5) / many as f32;
                let gradient = for_three!(a => cubic_at::<S>(cubics[a], S::splat(u)));
                let [lit] = lighting.at::<S, 1>(&[gradient], &to_eye);
                let weight = 2.0 * (front_share * (1.0 - u) + (1.0 - front_share) * u);
                for (sum, plain) in exact.iter_mut().zip(plain) {
                    let f = stored::<S>(lit.of(S::splat(plain)))[0].min(1.0);
                    *sum += f64::from(opacity * f * weight) / f64::from(many);
                }
            }
            (cells.color.map(|c| c[0]), cells.error[0], exact)
        }
    }

    /// The stated error of the light is hardly ever less than the true one, whether the normal turns gently or turns
    /// over.
    #[test]
    fn stated_errors_of_light_are_errors() {
        let mut seed = 5u64;
        let mut random = move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((seed >> 40) as f32) / (1 << 24) as f32
        };
        let geometry = supervol_format::Geometry::IDENTITY;
        let (mut uncertain, mut worst) = (0, 0.0f64);
        for round in 0..4000 {
            let mut vector = |size: f32| std::array::from_fn(|_| size * (random() - 0.5));
            let light = Vec3::from_array(vector(2.0)).normalize();
            let base: [f32; 3] = vector(2.0);
            let turn = [0.1, 1.0, 4.0][round % 3];
            let mut near = || {
                let other: [f32; 3] = vector(turn);
                std::array::from_fn(|a| base[a] + other[a])
            };
            let gradients = [near(), near(), near(), vector(0.5 * turn)];
            let lighting = Lighting {
                ambient: 0.3,
                diffuse: 0.7,
                specular: 0.2,
                shininess: [32.0, 10.0, 33.5][round % 3],
                lights: vec![(light, 1.0)],
                gradient_floor: 1e-6,
                world_from_index_gradient: glam::DMat3::IDENTITY,
            };
            let lighting = PacketLighting::new(&lighting, &geometry, [1; 3], 1.0);
            let (plain, front_share) = ([random(), random(), 1.0], random());
            for set in InstructionSet::available() {
                let cell = LitCell { lighting: &lighting, gradients, plain, front_share };
                let (color, stated, exact) = super::super::simd::dispatch(set, cell);
                let missed = (0..3).map(|c| (f64::from(color[c]) - exact[c]).abs()).fold(0.0, f64::max);
                assert!(missed <= 2e-5 + 1.2 * f64::from(stated), "{set:?}: {missed} missed, {stated} stated");
                uncertain += usize::from(missed > 1e-4);
                worst = worst.max(missed / (2e-5 + f64::from(stated)));
            }
        }
        assert!(uncertain > 100 && worst > 0.1, "{uncertain} cells are off; at worst by {worst} of what is stated");
    }
}
