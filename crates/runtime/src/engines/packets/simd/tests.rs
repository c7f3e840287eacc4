//! Tests that every available set equals plain arithmetic, lane by lane.

use supervol_format::random::Random;

use super::*;

/// Numbers of all kinds in every lane.
struct Inputs {
    a: [f32; LANES_LIMIT],
    b: [f32; LANES_LIMIT],
    c: [f32; LANES_LIMIT],
    i: [i32; LANES_LIMIT],
    j: [i32; LANES_LIMIT],
    bits: u32,
}

fn inputs(round: u32) -> Inputs {
    let mut numbers = Random::new(u64::from(round));
    let mut random = move || (numbers.next_u64() >> 40) as u32;
    let mut number = |_| {
        let value = (random() as f32 / (1 << 24) as f32 - 0.5) * 200.0;
        match random() % 8 {
            0 => value.round(),
            1 => f32::NAN,
            _ => value,
        }
    };
    let (a, b, c) =
        (std::array::from_fn(&mut number), std::array::from_fn(&mut number), std::array::from_fn(&mut number));
    let i = std::array::from_fn(|l| (round as i32 * 7 + l as i32 * 13) % 64 - 16);
    let j = std::array::from_fn(|l| (round as i32 + l as i32 * 5) % 64 - 16);
    Inputs { a, b, c, i, j, bits: round.wrapping_mul(0x9e37) & 0xffff }
}

/// Results by name: as bits, NaN as one number.
struct Outcome<'a>(&'a Inputs);

fn canonical(value: f32) -> u32 {
    if value.is_nan() { u32::MAX } else { (value + 0.0).to_bits() }
}

impl Task for Outcome<'_> {
    type Output = Vec<(&'static str, usize, u32)>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Self::Output {
        let inputs = self.0;
        let [a, b, c] = [&inputs.a, &inputs.b, &inputs.c].map(|v| S::load(v));
        let [i, j] = [&inputs.i, &inputs.j].map(|v| S::load_int(v));
        let table: [f32; 32] = std::array::from_fn(|k| (k * k) as f32);
        let table16: [f32; 16] = std::array::from_fn(|k| k as f32 * 0.5);
        let bytes: [u8; 64 + 4] = std::array::from_fn(|k| (k * 37 % 251) as u8);
        let mask = S::mask_from_bits(inputs.bits);
        let places = S::and_int(i, S::splat_int(63));
        // SAFETY: the places are 0 to 63, and the array goes on for 4 bytes.
        let gathered = unsafe { S::gather(bytes.as_ptr(), places, mask) };
        check_moves::<S>(inputs);
        check_around::<S>(places);
        let floats = [
            ("add", a + b),
            ("sub", a - b),
            ("mul", a * b),
            ("div", a / b),
            ("min", S::min(a, b)),
            ("max", S::max(a, b)),
            ("abs", S::abs(a)),
            ("sqrt", S::sqrt(S::abs(a))),
            ("floor", S::floor(a)),
            ("exp2_whole", S::exp2_whole(S::to_float(i))),
            ("select", S::select(mask, a, b)),
            ("lookup16", S::lookup16(&table16, j)),
            ("lookup32", S::lookup32(&table, j)),
            ("float_from_bits", S::float_from_bits(S::and_int(gathered, S::splat_int(0x7f_ffff)))),
        ];
        let ints = [
            ("add_int", i + j),
            ("mul_int", i * j),
            ("and_int", S::and_int(i, j)),
            ("shift_right", S::shift_right::<3>(i)),
            ("to_int", S::to_int(S::select(S::is_nan(a), c, S::splat(7.25)))),
            ("select_int", S::select_int(mask, i, j)),
            ("gather", gathered),
            ("bits_from_float", S::bits_from_float(S::to_float(i))),
        ];
        let masks = [
            ("lt", S::lt(a, b)),
            ("le", S::le(a, b)),
            ("is_nan", S::is_nan(a)),
            ("lt_int", S::lt_int(i, j)),
            ("eq_int", S::eq_int(i, j)),
            ("and", mask & S::lt(a, b)),
            ("or", mask | S::lt(a, b)),
            ("not", !mask),
        ];
        listed::<S>(inputs, &floats, &ints, &masks)
    }
}

/// Checks that words around places are the words at those positions; `places`: 0 to 63.
#[inline(always)]
fn check_around<S: Simd>(places: S::I) {
    let bytes: [u8; 256] = std::array::from_fn(|i| (i * 37) as u8);
    let (before, size, distances) = (8, 3, [0, 7, -1]);
    let [places] = hidden_in_memory::<S, 1>([places]);
    // SAFETY: from 3 bytes before the first place to 4 behind the last distance from the last, the array goes on.
    let words = unsafe { S::gather_around(bytes[before..].as_ptr(), size, &places, distances) };
    for (words, distance) in words.into_iter().zip(distances) {
        let mut found = [0; LANES_LIMIT];
        S::store_int(words, &mut found);
        for (found, place) in found.into_iter().zip(places).take(S::LANES) {
            let first =
                usize::try_from(before as i32 + (place + distance) * size).expect("no place lies before the array");
            let word = bytes[first..].first_chunk().expect("the array goes on for 4 bytes");
            assert_eq!(found, i32::from_le_bytes(*word), "at {place} and {distance}");
        }
    }
    // Any address is allowed.
    S::prefetch(bytes.as_ptr().wrapping_sub(1 << 40));
}

/// Checks that compress and expand follow the mask, and that all lanes are summed.
#[inline(always)]
fn check_moves<S: Simd>(inputs: &Inputs) {
    let numbers = inputs.i.map(|i| i as f32);
    assert_eq!(S::sum(S::load(&numbers)), numbers[..S::LANES].iter().sum::<f32>(), "whole numbers are summed exactly");
    let (a, b, mask) = (S::load(&inputs.a), S::load(&inputs.b), S::mask_from_bits(inputs.bits));
    let mut together = [0.0; LANES_LIMIT];
    S::compress(a, mask, &mut together);
    let taken = (0..S::LANES).filter(|lane| inputs.bits >> lane & 1 == 1);
    let expected: Vec<u32> = taken.map(|lane| canonical(inputs.a[lane])).collect();
    let together: Vec<u32> = together.into_iter().take(expected.len()).map(canonical).collect();
    assert_eq!(together, expected, "compress");
    let mut apart = [0.0; LANES_LIMIT];
    S::store(S::expand(a, mask, b), &mut apart);
    let mut values = inputs.a.iter();
    for (lane, found) in apart.into_iter().enumerate().take(S::LANES) {
        let from =
            if inputs.bits >> lane & 1 == 1 { values.next().expect("as many as lanes") } else { &inputs.b[lane] };
        assert_eq!(canonical(found), canonical(*from), "expand, lane {lane}");
    }
}

/// All results, lane by lane.
#[inline(always)]
fn listed<S: Simd>(
    inputs: &Inputs,
    floats: &[(&'static str, S::F)],
    ints: &[(&'static str, S::I)],
    masks: &[(&'static str, S::M)],
) -> Vec<(&'static str, usize, u32)> {
    let mut out = Vec::new();
    for &(name, value) in floats {
        let mut lanes = [0.0; LANES_LIMIT];
        S::store(value, &mut lanes);
        out.extend((0..S::LANES).map(|lane| (name, lane, canonical(lanes[lane]))));
    }
    for &(name, value) in ints {
        let mut lanes = [0; LANES_LIMIT];
        S::store_int(value, &mut lanes);
        // The result for NaN is unspecified.
        let unknown = |lane: usize| name == "to_int" && inputs.a[lane].is_nan() && inputs.c[lane].is_nan();
        out.extend((0..S::LANES).filter(|&lane| !unknown(lane)).map(|lane| (name, lane, lanes[lane] as u32)));
    }
    for &(name, value) in masks {
        let bits = S::bits(value);
        assert_eq!(bits >> S::LANES.min(31), 0, "{name}: bits beyond the lanes");
        out.extend((0..S::LANES).map(|lane| (name, lane, bits >> lane & 1)));
    }
    out
}

#[test]
fn all_sets_agree_lane_by_lane() {
    for set in InstructionSet::available() {
        for round in 0..500 {
            let inputs = inputs(round);
            let found = dispatch(set, Outcome(&inputs));
            let expected = dispatch(InstructionSet::Portable, Outcome(&inputs));
            let known = |name, lane| expected.iter().find(|e| e.0 == name && e.1 == lane).map(|e| e.2);
            let mut compared = 0;
            for (name, lane, value) in found {
                if let Some(expected) = known(name, lane) {
                    assert_eq!(value, expected, "{} {name}, lane {lane}, round {round}", set.name());
                    compared += 1;
                }
            }
            assert!(compared > 100, "{} lanes compared", compared);
        }
    }
}

struct ExpMinus([f32; LANES_LIMIT]);

impl Task for ExpMinus {
    type Output = [f32; LANES_LIMIT];

    #[inline(always)]
    fn run<S: Simd>(self) -> [f32; LANES_LIMIT] {
        let mut out = [0.0; LANES_LIMIT];
        S::store(exp_minus::<S>(S::load(&self.0)), &mut out);
        out
    }
}

#[test]
fn the_exponential_is_right_to_its_bound() {
    for set in InstructionSet::available() {
        for i in 0..20_000 {
            let a = i as f32 * 5e-3;
            let found = f64::from(dispatch(set, ExpMinus([a; LANES_LIMIT]))[0]);
            let exact = (-f64::from(a)).exp();
            assert!((found - exact).abs() <= 2e-7, "{}: exp(-{a}) is {found}, not {exact}", set.name());
        }
    }
}

struct MinusLn([f32; LANES_LIMIT]);

impl Task for MinusLn {
    type Output = [f32; LANES_LIMIT];

    #[inline(always)]
    fn run<S: Simd>(self) -> [f32; LANES_LIMIT] {
        let mut out = [0.0; LANES_LIMIT];
        S::store(minus_ln::<S>(S::load(&self.0)), &mut out);
        out
    }
}

#[test]
fn the_logarithm_is_right_to_its_bound() {
    for set in InstructionSet::available() {
        for i in 0..20_000 {
            // Densely below 1, and down to the least normal number.
            let a =
                if i < 10_000 { 1.0 - i as f32 * 1e-4 } else { (i as f32 * -4.36e-3).exp2() }.max(f32::MIN_POSITIVE);
            let found = f64::from(dispatch(set, MinusLn([a; LANES_LIMIT]))[0]);
            let exact = -f64::from(a).ln();
            let allowed = 3e-7 * exact + 2e-7;
            assert!((found - exact).abs() <= allowed, "{}: -ln({a}) is {found}, not {exact}", set.name());
        }
        assert_eq!(dispatch(set, MinusLn([1.0; LANES_LIMIT]))[0], 0.0, "{}", set.name());
    }
}

struct MulAdd<'a>(&'a Inputs);

impl Task for MulAdd<'_> {
    type Output = Vec<f32>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Vec<f32> {
        let mut out = [0.0; LANES_LIMIT];
        let Inputs { a, b, c, .. } = self.0;
        S::store(S::mul_add(S::load(a), S::load(b), S::load(c)), &mut out);
        out[..S::LANES].to_vec()
    }
}

#[test]
fn products_and_sums_may_be_fused() {
    for set in InstructionSet::available() {
        for round in 0..500 {
            let inputs = inputs(round);
            for (lane, found) in dispatch(set, MulAdd(&inputs)).into_iter().enumerate() {
                let [a, b, c] = [inputs.a[lane], inputs.b[lane], inputs.c[lane]];
                let allowed = [a * b + c, a.mul_add(b, c)].map(canonical);
                assert!(allowed.contains(&canonical(found)), "{}: {a} * {b} + {c} is {found}", set.name());
            }
        }
    }
}
