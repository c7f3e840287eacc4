//! Tests: stated errors of parts are bounds ([`super::integrate`]), for one cell and for spans of several.
//!
//! Cases are random, and those that an adversary finds, who changes numbers as long as the true error gets nearer to the stated one.

use supervol_format::random::Random;
use supervol_scene::transfer_function::pieces::{CHANNELS, Column, TransferPieces};
use supervol_scene::transfer_function::{ControlPoint, TransferFunction};

use super::chord::{Chord, Line};
use super::integrate::{Part, Wanted, integrate, integrate_at, order_of_even};
use super::lookup::ManyPieces;
use super::simd::{LANES_LIMIT, Portable, Simd, Task};
use super::uneven::locate;
use crate::engines::cubics::{Cubic, cubic, exact};
use crate::engines::rules::{LEAST_TILT, OPAQUE_TILT, ORDER_OF_DEPTH, ORDER_OF_TILT, SERIES_UP_TO, TILT_LIMIT};

/// Contribution of consecutive chords, by one line.
struct Integrate<'a> {
    pieces: &'a TransferPieces,
    cubics: &'a [Cubic],
}

impl Task for Integrate<'_> {
    type Output = Found;

    #[inline(always)]
    fn run<S: Simd>(self) -> Found {
        let chord = |&(k, length): &Cubic| Chord::<S> {
            values: [0.0, 0.5, 1.0].map(|u| S::splat(cubic(k, u) as f32)),
            cubic: S::splat(k[3] as f32),
            length: S::splat(length as f32),
            noise: S::splat(0.0),
            bounds: Chord::<S>::UNBOUNDED.map(S::splat),
        };
        let chords: Vec<_> = self.cubics.iter().map(chord).collect();
        let line = if chords.len() == 1 { chords[0].line() } else { Line::over(&chords) };
        let table = ManyPieces::new(self.pieces);
        let wanted = Wanted { lanes: S::mask_from_bits(u32::MAX), order: S::splat(0.0), lit: true };
        let located = locate(&table, &line, wanted.lanes);
        let part = integrate_at::<S, _>(&table, self.pieces.limits, (&line, &located), &wanted);
        let first = |v: S::F| {
            let mut lanes = [0.0; LANES_LIMIT];
            S::store(v, &mut lanes);
            lanes[0]
        };
        let [r, g, b] = part.color.map(first);
        Found {
            sums: [r, g, b, first(part.transmittance)],
            error: first(part.error),
            moments: part.moments.map(first),
            misplaced: first(part.misplaced),
        }
    }
}

/// Numbers of a part.
struct Found {
    /// Colour and transmittance.
    sums: [f32; 4],
    error: f32,
    moments: [f32; CHANNELS],
    misplaced: f32,
}

/// A part and its transfer function, as numbers that may be changed one by one.
#[derive(Clone, Debug)]
struct Case {
    /// Value, red, green, blue and opacity of each control point.
    points: Vec<[f64; 5]>,
    cubics: Vec<Cubic>,
}

impl Case {
    fn random(random: &mut impl FnMut() -> f64) -> Self {
        let steep = [0.01, 0.05, 0.3, 0.9][(random() * 4.0) as usize];
        let mut values: Vec<f64> = (0..2 + (random() * 4.0) as usize).map(|_| 100.0 + 20.0 * random()).collect();
        values.sort_by(f64::total_cmp);
        if random() < 0.3 {
            values[1] = values[0];
        }
        let mut alpha = || if random() < 0.3 { 0.0 } else { steep * random() };
        let alphas: Vec<f64> = values.iter().map(|_| alpha()).collect();
        let points = values.into_iter().zip(alphas).map(|(v, alpha)| [v, random(), random(), random(), alpha]);
        let points = points.collect();
        let wide = [1.0, 0.3, 0.1, 0.02][(random() * 4.0) as usize];
        let bowed = [1.0, 0.2, 0.02][(random() * 3.0) as usize];
        let cells = [1, 1, 3, 6][(random() * 4.0) as usize];
        // The slope shared by the cells of a span, and each cell's own share.
        let (slope, own) = (10.0 * (random() - 0.5), if cells == 1 { 0.0 } else { random() });
        let mut cubics: Vec<Cubic> = Vec::new();
        for _ in 0..cells {
            let begin = cubics.last().map_or(100.0 + 20.0 * random(), |&(k, _)| cubic(k, 1.0));
            let slope = wide * (slope + own * 10.0 * (random() - 0.5));
            let k = [begin, slope, bowed * wide * 6.0 * (random() - 0.5), bowed * wide * (random() - 0.5)];
            // A cell in which a ray waits has no length, and one value.
            let is_waited_in = cells > 1 && random() < 0.1;
            cubics.push(if is_waited_in { ([begin, 0.0, 0.0, 0.0], 0.0) } else { (k, 1.5 * random()) });
        }
        Self { points, cubics }
    }

    /// The case with one number changed.
    fn changed(&self, size: f64, random: &mut impl FnMut() -> f64) -> Self {
        let mut case = self.clone();
        let by = size * (random() - 0.5);
        if random() < 0.5 {
            let i = (random() * case.points.len() as f64) as usize;
            let number = (random() * 5.0) as usize;
            let point = &mut case.points[i];
            point[number] = match number {
                0 => point[0] + 20.0 * by,
                4 => (point[4] + by).clamp(0.0, 1.0),
                _ => (point[number] + 2.0 * by).clamp(0.0, 1.0),
            };
            case.points.sort_by(|a, b| a[0].total_cmp(&b[0]));
        } else {
            let i = (random() * case.cubics.len() as f64) as usize;
            let number = (random() * 5.0) as usize;
            let (k, length) = &mut case.cubics[i];
            match number {
                4 => *length = (*length + 2.0 * by).clamp(0.0, 3.0),
                _ => k[number] += 10.0 * by,
            }
            for i in 1..case.cubics.len() {
                case.cubics[i].0[0] = cubic(case.cubics[i - 1].0, 1.0);
            }
        }
        case
    }

    fn transfer_function(&self) -> Option<TransferFunction> {
        let points = self.points.iter().map(|&[value, r, g, b, alpha]| ControlPoint {
            value: f64::from(value as f32),
            color: [r, g, b],
            alpha,
        });
        TransferFunction::new(points.collect(), 1.0).ok()
    }

    /// True and stated error, and true and stated distance of the densities from lines. The fit of the pieces is far finer
    /// than either.
    fn errors(&self) -> [[f64; 2]; 2] {
        let Some(tf) = self.transfer_function() else { return [[0.0; 2]; 2] };
        let pieces = TransferPieces::new(&tf, 0.0, FIT);
        let rounded: Vec<Cubic> =
            self.cubics.iter().map(|&(k, length)| (k.map(|k| f64::from(k as f32)), f64::from(length as f32))).collect();
        let found = Integrate { pieces: &pieces, cubics: &rounded }.run::<Portable>();
        let expected = exact(&tf, &rounded);
        let [r, g, b, through]: [f64; 4] = std::array::from_fn(|c| f64::from(found.sums[c]) - expected[c]);
        // In front of black, and in front of white.
        let seen = [r, g, b, through, r + through, g + through, b + through];
        let off = seen.map(f64::abs).into_iter().fold(0.0, f64::max);
        let misplaced = distance_from_lines(&tf, &rounded, &found.moments);
        [[off, f64::from(found.error)], [misplaced, f64::from(found.misplaced)]]
    }
}

/// Greatest distance of the integrals of opacity and colours, from the beginning of some chords, from those of linear densities
/// with the same sums and these moments; by a sum of [`STEPS`] terms a chord, less what it may be off by.
fn distance_from_lines(tf: &TransferFunction, cubics: &[Cubic], moments: &[f32; CHANNELS]) -> f64 {
    let whole: f64 = cubics.iter().map(|&(_, length)| length).sum();
    let (mut depth, mut at, mut most) = (0.0f64, 0.0, 0.0f64);
    let mut places = vec![([0.0; CHANNELS], 0.0)];
    for &(k, length) in cubics.iter().filter(|&&(_, length)| length > 0.0) {
        for i in 0..STEPS {
            let (color, alpha) = tf.classify(cubic(k, (f64::from(i) + 0.5) / f64::from(STEPS)));
            let extinction = tf.kappa(alpha) * length / f64::from(STEPS);
            let seen = (-depth).exp() * (1.0 - (-extinction).exp());
            (depth, at, most) = (depth + extinction, at + length / f64::from(STEPS), most.max(seen));
            let (mut sums, _) = places[places.len() - 1];
            sums[0] += seen;
            (0..3).for_each(|c| sums[c + 1] += seen * color[c]);
            places.push((sums, at / whole.max(1e-12)));
        }
    }
    let (all, _) = places[places.len() - 1];
    let distance = |&(sums, u): &([f64; CHANNELS], f64)| {
        let line = |c: usize| all[c] * u + 6.0 * f64::from(moments[c]) * (u * u - u);
        (0..CHANNELS).map(|c| (sums[c] - line(c)).abs()).fold(0.0, f64::max)
    };
    (places.iter().map(distance).fold(0.0, f64::max) - most).max(0.0)
}

const FIT: f64 = 1e-6;
const STEPS: u32 = 400;
/// Errors that the test itself makes: by the fit, by roundings of values of 100 to 120, and of the antiderivatives.
const ROUNDED: f64 = 2e-5;

fn check(case: &Case, [off, stated]: [f64; 2], name: &str) {
    assert!(off <= stated + ROUNDED, "{name}: {off} off, {stated} stated: {case:?}");
}

/// Stated errors of parts are bounds, for one cell and for spans of several, and so is what is stated of the origin of light: for
/// random ones, and for those that an adversary finds, who changes numbers as long as the true error gets nearer to the stated
/// one, once for all errors and once for small ones.
#[test]
fn stated_errors_are_errors() {
    let mut numbers = Random::new(11);
    let mut random = || numbers.unit();
    for (which, name) in ["sums", "origin"].into_iter().enumerate() {
        let cases: Vec<Case> = (0..10_000).map(|_| Case::random(&mut random)).collect();
        for most in [f64::INFINITY, 0.05, 0.003] {
            let rank = |errors: [f64; 2]| if errors[1] > most { 0.0 } else { errors[0] / (errors[1] + ROUNDED) };
            let mut worst = Vec::new();
            for case in &cases {
                let errors = case.errors()[which];
                check(case, errors, name);
                worst.push((rank(errors), case.clone()));
            }
            worst.sort_by(|a, b| b.0.total_cmp(&a.0));
            worst.truncate(10);
            println!("{name}, at most {most}: random {:?}", worst[0].0);
            for (ratio, case) in &mut worst {
                for step in 0..800 {
                    let next = case.changed(0.3f64.powi(step / 100), &mut random);
                    let errors = next.errors()[which];
                    check(&next, errors, name);
                    if rank(errors) > *ratio && errors[0] > 10.0 * ROUNDED {
                        (*ratio, *case) = (rank(errors), next);
                    }
                }
            }
            worst.sort_by(|a, b| b.0.total_cmp(&a.0));
            println!("adversary: {:?} {:?}", worst[0], worst[0].1.errors()[which]);
        }
    }
}

/// In a shell that is thin against its chord hardly anything is in front of anything else: changing colour there
/// becomes the mean colour.
#[test]
fn order_does_no_more_than_it_can() {
    let point = |value, color, alpha| ControlPoint { value, color, alpha };
    let (before, behind) = ([0.08, 0.77, 0.98], [0.97, 0.78, 0.38]);
    let points = vec![point(0.842, [0.1; 3], 0.0), point(0.842, before, 0.61), point(0.846, behind, 0.82)];
    let tf = TransferFunction::new(points, 0.4).unwrap();
    let pieces = TransferPieces::new(&tf, 0.0, 1e-4);
    for length in [0.3, 1.0, 3.0] {
        // The chord ends in the shell, which the exact sum treats separately.
        let line = |[from, to]: [f64; 2]| ([from, to - from, 0.0, 0.0], length * (to - from) / 0.646);
        let found = Integrate { pieces: &pieces, cubics: &[line([0.2, 0.846])] }.run::<Portable>();
        let expected = exact(&tf, &[line([0.2, 0.842]), line([0.842, 0.846])]);
        let opacity = 1.0 - expected[3];
        assert!(opacity > 0.001, "nothing is seen");
        let error = (0..3).map(|c| (f64::from(found.sums[c]) - expected[c]).abs()).fold(0.0, f64::max);
        // The effect of order in both directions, and the fit.
        let allowed = opacity * (0.25 * opacity + 1e-3);
        assert!(error < allowed, "{length}: {error} of {opacity}, {:?} for {expected:?}", found.sums);
    }
}

/// The field goes there and back across a kink at which its line hardly rises: what the kink does to first order is as much as its
/// whole effect.
#[test]
fn a_kink_that_the_field_crosses_three_times() {
    let point = |value, alpha| [value, 0.5, 0.5, 0.5, alpha];
    for (rise, cubic) in [(0.002, 1.0), (0.01, 1.0), (0.05, 1.0), (0.002, -1.0), (-0.01, 1.0), (-0.002, -1.0)] {
        let points = vec![point(109.0, 0.05), point(110.0, 0.05), point(110.5, 0.15)];
        let cubics = vec![([110.0 - 0.5 * rise, 0.5 * cubic + rise, -1.5 * cubic, cubic], 1.0)];
        let case = Case { points, cubics };
        check(&case, case.errors()[0], "kink");
    }
}

/// Beside a segment of a thousandth of the others' width, sums over the pieces are rounded by more than the others bend.
#[test]
fn steep_segments_do_not_hide_what_others_do() {
    let ramp = |first: f64, alphas: [f64; 4]| {
        let [a, b, c, d] = alphas;
        vec![
            [first, 0.0, 0.8, 1.0, a],
            [first + 0.001, 0.4, 0.4, 0.2, b],
            [first + 2.8, 1.0, 0.4, 0.8, c],
            [first + 7.2, 0.0, 0.9, 0.9, d],
        ]
    };
    let cases = [
        (ramp(111.19, [0.0, 0.007, 0.038, 0.0]), ([115.25, 5.74, 1.8, 0.0], 2.0)),
        (ramp(104.68, [1.0, 0.0, 0.0, 0.6]), ([108.0, -8.0, -0.1, 0.08], 1.9)),
        (ramp(111.19, [0.2, 0.9, 0.038, 0.0]), ([115.25, 3.0, -1.8, 0.5], 2.0)),
    ];
    for (points, cubic) in cases {
        let case = Case { points, cubics: vec![cubic] };
        check(&case, case.errors()[0], "steep");
    }
}

/// The field stays below a step that its line reaches.
#[test]
fn a_step_that_only_the_line_reaches() {
    let point = |value, alpha| [value, 0.5, 0.5, 0.5, alpha];
    for bump in [0.01, 0.003, 0.3] {
        let points = vec![point(102.505, 0.002), point(102.505, 0.5), point(104.0, 0.6)];
        let rise = 1.28;
        let cubics = vec![([102.504 - rise, rise + 4.0 * bump, -4.0 * bump, 0.0], 0.9)];
        let case = Case { points, cubics };
        let [sums, origin] = case.errors();
        check(&case, sums, "step");
        check(&case, origin, "origin of light at a step");
    }
}

/// In opaque parts order does more than in thin ones: what is first seen may be any colour of the part.
#[test]
fn order_in_opaque_parts() {
    let point = |value, [r, g, b]: [f64; 3]| [value, r, g, b, 1.0];
    for length in [0.3, 1.0, 3.0] {
        let points = vec![point(100.0, [1.0, 0.0, 0.5]), point(101.0, [0.0, 1.0, 0.5]), point(120.0, [0.0, 1.0, 0.5])];
        for cubic in [[100.0, 19.0, 0.0, 0.0], [119.0, -19.0, 0.0, 0.0], [100.0, 40.0, -21.0, 0.0]] {
            let case = Case { points: points.clone(), cubics: vec![(cubic, length)] };
            check(&case, case.errors()[0], "order");
        }
    }
}

/// Order of linear emission and extinction: what the rule takes for `1 / (2 tau) times the integral of (1 - 2 u) exp(-depth(u))` is off by
/// no more than it states.
#[test]
fn order_of_lines() {
    const PLACES: u32 = 400;
    // By pairs of Gauss points: of the 400 stretches, the fourth derivative makes less than 1e-9.
    let exact = |tau: f64, tilt: f64| {
        let gauss = 0.5 / 3.0f64.sqrt();
        let places = (0..PLACES).flat_map(|i| [-gauss, gauss].map(|g| (f64::from(i) + 0.5 + g) / f64::from(PLACES)));
        let at = |u: f64| (1.0 - 2.0 * u) * (-tau * (u - 0.5 * tilt * u * (1.0 - u))).exp();
        places.map(at).sum::<f64>() / f64::from(4 * PLACES) / tau
    };
    let first = |v| {
        let mut lanes = [0.0; LANES_LIMIT];
        Portable::store(v, &mut lanes);
        f64::from(lanes[0])
    };
    for step in 1..=400 {
        let tau = 10f64.powf(f64::from(step) / 400.0 * 4.0 - 2.5);
        let opacity = 1.0 - (-tau).exp();
        let even = first(order_of_even::<Portable>(Portable::splat(tau as f32), Portable::splat((-tau).exp() as f32)));
        for tilt in (-40..=40).map(|i| f64::from(i) / 10.0) {
            let (size, is_opaque) = (tilt.abs(), tau > f64::from(OPAQUE_TILT));
            if size > if is_opaque { 2.0 } else { f64::from(TILT_LIMIT) } {
                continue;
            }
            let off = (even * (1.0 + tilt * tau / 20.0) - exact(tau, tilt)).abs();
            let of_depth = if tau > f64::from(SERIES_UP_TO) { 0.0 } else { f64::from(ORDER_OF_DEPTH) * tau.powi(3) };
            let of_tilt = f64::from(ORDER_OF_TILT) * size * size.max(f64::from(LEAST_TILT));
            let stated = opacity * (of_depth + of_tilt * tau.min(f64::from(OPAQUE_TILT)));
            // Roundings of single precision, here and in the rule.
            let rounded = 4e-7 * (1.0 + size * tau / 20.0) / (1.0 + tau * tau);
            assert!(off <= stated + rounded, "{tau} {tilt}: {off} {stated}");
        }
    }
}

/// Parts do not depend on which others are integrated with them: on whether any of them reaches over a knot.
#[test]
fn parts_do_not_depend_on_their_neighbours() {
    struct Numbers<'a>(&'a TransferPieces, &'a [Cubic]);
    impl Task for Numbers<'_> {
        type Output = Vec<[u32; 15]>;
        #[inline(always)]
        fn run<S: Simd>(self) -> Self::Output {
            let Self(pieces, cubics) = self;
            let number = |of: &dyn Fn(&Cubic) -> f64| {
                let mut lanes = [0.0; LANES_LIMIT];
                (0..LANES_LIMIT).for_each(|lane| lanes[lane] = of(&cubics[lane % cubics.len()]) as f32);
                S::load(&lanes)
            };
            let chord = Chord::<S> {
                values: [0.0, 0.5, 1.0].map(|u| number(&|&(k, _)| cubic(k, u))),
                cubic: number(&|(k, _)| k[3]),
                length: number(&|&(_, length)| length),
                noise: S::splat(1e-5),
                bounds: Chord::<S>::UNBOUNDED.map(S::splat),
            };
            let table = ManyPieces::new(pieces);
            let wanted = Wanted { lanes: S::mask_from_bits(u32::MAX), order: S::splat(1e-5), lit: true };
            let part = integrate::<S, _>(&table, pieces.limits, &chord, &wanted);
            let Part { color, tau, transmittance, error, rounding, moments, misplaced, colors } = part;
            let others = [tau, transmittance, error, rounding, misplaced, colors];
            let mut lanes = vec![[0; 15]; cubics.len()];
            for (i, value) in color.into_iter().chain(moments).chain(others).enumerate() {
                let mut stored = [0.0; LANES_LIMIT];
                S::store(value, &mut stored);
                lanes.iter_mut().zip(stored).for_each(|(lane, value)| lane[i] = value.to_bits());
            }
            lanes
        }
    }
    let mut numbers = Random::new(5);
    let mut random = || numbers.unit();
    let (mut alone, mut compared) = (0, 0);
    for _ in 0..3000 {
        let Some(tf) = Case::random(&mut random).transfer_function() else { continue };
        let pieces = TransferPieces::new(&tf, 0.0, FIT);
        let cubics: Vec<Cubic> = (0..Portable::LANES).map(|_| Case::random(&mut random).cubics[0]).collect();
        let together = Numbers(&pieces, &cubics).run::<Portable>();
        for (cubic, together) in cubics.iter().zip(together) {
            let of_one = Numbers(&pieces, &[*cubic]).run::<Portable>()[0];
            assert_eq!(of_one, together, "{cubic:?}");
            compared += 1;
            let range = [0.0, 0.25, 0.5, 0.75, 1.0].map(|u| self::cubic(cubic.0, u) as f32);
            let knots = pieces.column(Column::Knot, 0);
            alone += u32::from(knots.iter().all(|k| range.iter().all(|v| v < k) || range.iter().all(|v| v > k)));
        }
    }
    assert!(alone > 500 && compared - alone > 500, "{alone} of {compared} reach over no knot");
}

/// Beside a voxel of 1e37 a part may be wrong, but it says so.
#[test]
fn enormous_values() {
    let point = |value, alpha| [value, 0.95, 0.8, 0.45, alpha];
    let points = vec![point(-0.3, 0.0), point(0.7, 0.3)];
    let mut numbers = Random::new(3);
    for size in [1e10, 1e20, 1e37] {
        for i in 0..2000 {
            let mut number = || size * 0.5 * (numbers.unit() - 0.5);
            let k = match i % 3 {
                0 => [0.5, number().abs(), 0.0, 0.0],
                1 => [0.5, number(), number(), number()],
                _ => [number(), number(), number(), number()],
            };
            let case = Case { points: points.clone(), cubics: vec![(k, 1.0)] };
            let tf = case.transfer_function().unwrap();
            let pieces = TransferPieces::new(&tf, 0.0, FIT);
            let found = Integrate { pieces: &pieces, cubics: &case.cubics }.run::<Portable>();
            let expected = exact(&tf, &case.cubics);
            let off = (f64::from(found.sums[3]) - expected[3]).abs();
            let what = format!("{k:?}: {:?} for {expected:?}, {} stated", found.sums, found.error);
            assert!(found.error >= 0.0 && found.sums.iter().all(|sum| sum.is_finite()), "{what}");
            assert!(off <= f64::from(found.error) + ROUNDED, "{what}");
        }
    }
}
