//! Colour maps by name: a grey ramp, red-white-blue for amplitudes, and well-known maps from their published tables.

use colorous::Gradient;

/// Names of all colour maps.
pub const NAMES: [&str; 12] = [
    "grey",
    "seismic",
    "viridis",
    "magma",
    "inferno",
    "plasma",
    "cividis",
    "turbo",
    "cubehelix",
    "warm",
    "cool",
    "spectral",
];

/// Control points of a smooth colour map: enough for linear interpolation to be within one grey level.
pub const SMOOTH_POINTS: usize = 33;

/// The red-white-blue map of amplitudes, negative to positive: saturated at both ends, white at zero. Pairs of position
/// in [0, 1] and colour.
const SEISMIC: [(f64, [f64; 3]); 7] = [
    (0.0, [0.55, 0.00, 0.05]),
    (0.20, [0.85, 0.15, 0.12]),
    (0.375, [0.97, 0.70, 0.60]),
    (0.5, [0.97, 0.97, 0.97]),
    (0.625, [0.60, 0.75, 0.97]),
    (0.80, [0.12, 0.30, 0.85]),
    (1.0, [0.03, 0.08, 0.50]),
];

/// A colour map: pairs of position in [0, 1] and colour, linear in between. `None` if the name is not in [`NAMES`].
#[must_use]
pub fn by_name(name: &str) -> Option<Vec<(f64, [f64; 3])>> {
    let gradient = match name {
        "grey" => return Some(vec![(0.0, [0.0; 3]), (1.0, [1.0; 3])]),
        "seismic" => return Some(SEISMIC.to_vec()),
        "viridis" => colorous::VIRIDIS,
        "magma" => colorous::MAGMA,
        "inferno" => colorous::INFERNO,
        "plasma" => colorous::PLASMA,
        "cividis" => colorous::CIVIDIS,
        "turbo" => colorous::TURBO,
        "cubehelix" => colorous::CUBEHELIX,
        "warm" => colorous::WARM,
        "cool" => colorous::COOL,
        "spectral" => colorous::SPECTRAL,
        _ => return None,
    };
    Some(sampled(gradient))
}

fn sampled(gradient: Gradient) -> Vec<(f64, [f64; 3])> {
    let at = |i: usize| {
        let place = i as f64 / (SMOOTH_POINTS - 1) as f64;
        let colour = gradient.eval_continuous(place);
        (place, [colour.r, colour.g, colour.b].map(|c| f64::from(c) / 255.0))
    };
    (0..SMOOTH_POINTS).map(at).collect()
}

/// A colour for a label. Consecutive labels differ in hue by the golden angle, so that neighbours are distinct. Labels
/// above 255 are mostly sparse and differ by any amount; bits of a hash choose their hue, brightness and saturation.
#[must_use]
pub fn of_label(number: u64) -> [f64; 3] {
    const GOLDEN_TURN: f64 = 0.618_033_988_749_895;
    let (hue, [most, least]) = if number <= u64::from(u8::MAX) {
        let shades = if number.is_multiple_of(2) { [0.95, 0.35] } else { [0.85, 0.20] };
        ((number as f64 * GOLDEN_TURN + 0.05).fract() * 6.0, shades)
    } else {
        let mixed = number.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ number.wrapping_mul(0xD6E8_FEB8_6659_FD93) >> 32;
        let share = |shift: u32| (mixed >> shift & 0xFFFF) as f64 / f64::from(u16::MAX);
        let most = 0.65 + 0.35 * share(32);
        (6.0 * share(48), [most, most * (0.1 + 0.45 * share(16))])
    };
    [0.0, 2.0, 4.0].map(|turn| {
        let distance = (hue - turn).rem_euclid(6.0);
        let share = (2.0 - distance.min(6.0 - distance)).clamp(0.0, 1.0);
        least + (most - least) * share
    })
}

#[cfg(test)]
mod tests {
    use supervol_format::cast::whole;

    use super::*;

    #[test]
    fn sparse_labels_have_colours_of_their_own() {
        let color = |number: u64| of_label(number).map(|c| whole::<u8>((c * 255.0).round()));
        let brain = (2..85).chain(1000..1036).chain(2000..2036);
        let wide = (1..400u64).map(|i| i * 5_301_007 % (1 << 31));
        for numbers in [brain.collect::<Vec<_>>(), wide.collect()] {
            let mut colors: Vec<[u8; 3]> = numbers.iter().map(|&number| color(number)).collect();
            colors.sort_unstable();
            colors.dedup();
            assert_eq!(colors.len(), numbers.len());
        }
    }

    #[test]
    fn every_name_is_a_map_from_0_to_1() {
        for name in NAMES {
            let map = by_name(name).expect(name);
            assert_eq!((map[0].0, map[map.len() - 1].0), (0.0, 1.0), "{name}");
            assert!(map.windows(2).all(|w| w[0].0 < w[1].0), "{name}");
            assert!(map.iter().flat_map(|(_, c)| c).all(|c| (0.0..=1.0).contains(c)), "{name}");
        }
        assert!(by_name("jet").is_none());
        let colours: Vec<_> = (1..40).map(of_label).collect();
        for pair in colours.windows(2) {
            let apart = (0..3).map(|i| (pair[0][i] - pair[1][i]).abs()).fold(0.0, f64::max);
            assert!(apart > 0.2, "{pair:?}");
        }
    }
}
