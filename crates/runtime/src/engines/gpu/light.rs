//! Twins of `shaders/shared/light.wgsl` and of the arithmetic of `light_walk.wgsl`: the same functions in Rust, for
//! tests of the shader. `packets::integrate` derives the rule and its error. The effect of light on a part
//! (`light_shading.wgsl`) is the same as on the CPU: [`shade_part`] calls its code.
//!
//! Values are in bins of the transfer function ([`super::light_table`]), extents in unit distances.

use glam::Vec3;
use supervol_format::Geometry;
use supervol_format::cast::whole;

use super::layout::LIGHT_BINS;
use super::light_table::LightTable;
use super::shader_light::{LitPart, ShaderLight};
use crate::engines::cells::shade::Lighting;
use crate::engines::gpu::limits::{BIN_TEXELS, FAR, GREATEST_ROOT};
use crate::engines::packets::shade::PacketLighting;
use crate::engines::packets::simd::{LANES_LIMIT, Portable, Simd};
use crate::engines::rules::{
    AVERAGE_OF_BUMP, AVERAGE_OF_CUBIC, FALL_END, FALL_MISPLACED, GREATEST_OF_CUBIC, ORDER_REST, ORDER_SQUARE,
    OUT_OF_ORDER, UNEVEN_MISPLACED,
};

/// Width, in bins, up to which the mean of an interval is that of its ends.
pub const NARROW: f32 = 1.0;
/// 1 over the square of the greatest root.
const PER_SQUARE: f32 = 1.0 / (GREATEST_ROOT as f32 * GREATEST_ROOT as f32);
/// Least divisor, and extinction that counts as none.
const TINY: f32 = 1e-30;

/// The channels at a value: red, green, blue (times extinction), extinction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightChannels {
    /// Antiderivatives where the bin begins, in [`LightTable::unit`].
    pub start: [u32; 4],
    /// Antiderivatives from there on.
    pub rest: [f32; 4],
    /// The channels themselves.
    pub value: [f32; 4],
}

/// The field along a part of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightChord {
    /// At its beginning, middle and end.
    pub values: [f32; 3],
    /// Coefficient of the third power.
    pub cubic: f32,
    /// Length.
    pub extent: f32,
}

/// The line that replaces the field along one or several parts of a ray, and the distance of the field from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightLine {
    /// Values at its beginning and end.
    pub ends: [f32; 2],
    /// Bounds of the field, and of the line.
    pub range: [f32; 2],
    /// Greatest distance of the field from the line.
    pub most: f32,
    /// Bound on its mean distance.
    pub average: f32,
    /// Length.
    pub extent: f32,
}

/// Contribution of a part of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightPart {
    /// Premultiplied.
    pub color: [f32; 3],
    /// Share of light from behind that passes.
    pub transmittance: f32,
    /// Bound on the error of both, beside `fit`.
    pub error: f32,
    /// Error of the table: of the bins' width and of rounded integers. Shorter parts have the same error.
    pub fit: f32,
    /// Light from the front end, as a share of that from both ends, if it varies evenly in between.
    pub front_share: f32,
    /// Share of the part by which evenly varying light may be misplaced.
    pub misplaced: f32,
    /// Variation of colour over the part.
    pub colors: f32,
}

fn light_bin(value: f32) -> f32 {
    value.floor().clamp(-1.0, LIGHT_BINS as f32)
}

/// Texel `i` of a bin.
fn texel(table: &LightTable, i: usize, bin: f32) -> [u32; 4] {
    let first = 4 * (BIN_TEXELS * whole::<usize>(bin + 1.0) + i);
    std::array::from_fn(|word| table.words[first + word])
}

/// The channels at a value.
#[must_use]
pub fn light_at(table: &LightTable, value: f32) -> LightChannels {
    let bin = light_bin(value);
    let y = value - bin.max(0.0);
    let ends = texel(table, 1, bin);
    let share = table.most * PER_SQUARE;
    let channel = |end: usize, c: usize| {
        let root = (ends[2 * end + c / 2] >> (16 * (c % 2)) & 0xffff) as f32;
        share * root * root
    };
    let [left, right] = [0, 1].map(|end| std::array::from_fn::<f32, 4, _>(|c| channel(end, c)));
    let rise = |c: usize| right[c] - left[c];
    LightChannels {
        start: texel(table, 0, bin),
        rest: std::array::from_fn(|c| y * (left[c] + 0.5 * y * rise(c))),
        value: std::array::from_fn(|c| left[c] + y * rise(c)),
    }
}

/// Sums of bends and colour variation below a value's bin, or below the one `behind` bins further. Then the variation
/// of colour in that bin, and in the one before it.
#[must_use]
pub fn light_sums(table: &LightTable, value: f32, behind: f32) -> [f32; 4] {
    texel(table, 2, (light_bin(value) + behind).min(LIGHT_BINS as f32)).map(f32::from_bits)
}

/// The line of no part.
#[must_use]
pub fn no_line() -> LightLine {
    LightLine { ends: [0.0; 2], range: [FAR, -FAR], most: -FAR, average: 0.0, extent: 0.0 }
}

/// The line with the field's mean and the difference between its ends.
#[must_use]
pub fn line_of(chord: &LightChord) -> LightLine {
    let [first, middle, last] = chord.values;
    let rise = last - first;
    let mean = middle * (4.0 / 6.0) + (first + last) * (1.0 / 6.0);
    let (bump, cubic) = ((middle - 0.5 * (first + last)).abs(), chord.cubic.abs());
    let most = 2.0 / 3.0 * bump + GREATEST_OF_CUBIC * cubic;
    let margin = most + GREATEST_OF_CUBIC * cubic;
    LightLine {
        ends: [-0.5, 0.5].map(|share| mean + share * rise),
        range: [first.min(last).min(middle) - margin, first.max(last).max(middle) + margin],
        most,
        average: AVERAGE_OF_BUMP * bump + AVERAGE_OF_CUBIC * cubic,
        extent: chord.extent,
    }
}

/// The line that replaces the field along two consecutive parts. Its distance from each of their lines varies evenly
/// from end to end. So their known distances from the field bound the field's distance from this line.
#[must_use]
pub fn line_over(a: &LightLine, b: &LightLine) -> LightLine {
    let extent = a.extent + b.extent;
    let share = a.extent / extent.max(TINY);
    let mean = 0.5 * (share * (a.ends[0] + a.ends[1]) + (1.0 - share) * (b.ends[0] + b.ends[1]));
    let rise = (a.ends[1] - a.ends[0]) + (b.ends[1] - b.ends[0]);
    let [begin, end] = [-0.5, 0.5].map(|part| mean + part * rise);
    let joint = begin + share * rise;
    let of_a = [a.ends[0] - begin, a.ends[1] - joint];
    let of_b = [b.ends[0] - joint, b.ends[1] - end];
    let most = |line: &LightLine, [x, y]: [f32; 2]| line.most + x.abs().max(y.abs());
    let average = |line: &LightLine, ends| line.average + mean_distance(ends);
    LightLine {
        ends: [begin, end],
        range: [a.range[0].min(b.range[0]).min(begin).min(end), a.range[1].max(b.range[1]).max(begin).max(end)],
        most: most(a, of_a).max(most(b, of_b)),
        average: share * average(a, of_a) + (1.0 - share) * average(b, of_b),
        extent,
    }
}

/// Bound on the mean distance from 0 of a quantity that varies evenly from one number to another.
fn mean_distance([x, y]: [f32; 2]) -> f32 {
    0.25 * (x.abs() + y.abs() + (x + y).abs())
}

/// Share of the light whose order may differ from that along the line of several parts.
#[must_use]
pub fn disorder_of(line: &LightLine) -> f32 {
    (2.0 * line.most / (line.ends[1] - line.ends[0]).abs().max(TINY)).min(1.0)
}

/// Integrates a chord.
#[must_use]
pub fn integrate_chord(table: &LightTable, chord: &LightChord) -> LightPart {
    integrate_line(table, &line_of(chord), 0.0)
}

/// Integrates along a line; `disorder` is [`disorder_of`] for several parts, else 0.
#[must_use]
pub fn integrate_line(table: &LightTable, line: &LightLine, disorder: f32) -> LightPart {
    let LightLine { ends, extent, .. } = *line;
    let rise = ends[1] - ends[0];
    let [a, b] = ends.map(|value| light_at(table, value));
    let is_narrow = rise.abs() <= NARROW || light_bin(ends[0]) == light_bin(ends[1]);
    let means: [f32; 4] = std::array::from_fn(|c| {
        let whole = b.start[c].wrapping_sub(a.start[c]).cast_signed() as f32 * table.unit;
        let of_sums = (whole + (b.rest[c] - a.rest[c])) / rise;
        (if is_narrow { 0.5 * (a.value[c] + b.value[c]) } else { of_sums }).max(0.0)
    });
    let kappa = means[3];
    let tau = kappa * extent;
    let transmittance = (-tau).exp();
    let opacity = 1.0 - transmittance;
    let emitting = if tau < 1e-6 { extent } else { opacity / kappa };
    let order = extent * extent / (12.0 + tau * (6.0 + ORDER_SQUARE * tau));
    let between = |c: usize| b.value[c] - a.value[c];
    let [error, fit, misplaced, colors] = error_of(table, line, disorder, kappa);
    let most = 0.5 * colors * (opacity * (1.0 - 0.5 * transmittance)).powi(2);
    let color = std::array::from_fn(|c| {
        let ordered = order * (between(c) * kappa - means[c] * between(3));
        (means[c] * emitting - ordered.clamp(-most, most)).clamp(0.0, opacity)
    });
    let dim = 1e-3 * kappa + TINY;
    let (at_front, at_back) = (a.value[3].max(0.0) + dim, b.value[3].max(0.0) * transmittance + dim);
    LightPart { color, transmittance, error, fit, front_share: at_front / (at_front + at_back), misplaced, colors }
}

/// A part after shading, as on the CPU: colour and error. `gradients` are those at its beginning, middle and end;
/// `to_eye` is a unit vector.
#[must_use]
pub fn shade_part(lighting: &Lighting, part: &LightPart, gradients: [Vec3; 3], to_eye: Vec3) -> [f32; 4] {
    type S = Portable;
    let splat = <S as Simd>::splat;
    // The lighting needs no positions in space.
    let lighting = PacketLighting::new(lighting, &Geometry::IDENTITY, [1; 3], 1.0);
    let to_eye = to_eye.to_array().map(splat);
    let lit = lighting.at::<S, 3>(&gradients.map(|g| g.to_array().map(splat)), &to_eye);
    let part = LitPart::<S> {
        color: part.color.map(splat),
        transmittance: splat(part.transmittance),
        error: splat(part.error),
        front_share: splat(part.front_share),
        misplaced: splat(part.misplaced),
        colors: splat(part.colors),
    };
    let rule = ShaderLight { lighting: &lighting };
    let ([r, g, b], error) = rule.shade::<S>(&part, &lit, &to_eye);
    [r, g, b, error].map(|lanes| {
        let mut numbers = [0.0; LANES_LIMIT];
        S::store(lanes, &mut numbers);
        numbers[0]
    })
}

/// Error of the line, [`LightPart::fit`], [`LightPart::misplaced`] and [`LightPart::colors`].
fn error_of(table: &LightTable, line: &LightLine, disorder: f32, kappa: f32) -> [f32; 4] {
    let LightLine { ends, range: [below, above], average, extent, .. } = *line;
    let [low, high] = [light_sums(table, below, 0.0), light_sums(table, above, 1.0)];
    let [bends, colors] = std::array::from_fn(|i| high[i] - low[i]);
    let width = (ends[1] - ends[0]).abs();
    let of_mean = 0.5 * bends * average * extent;
    let uneven = (0.25 * bends * width / kappa.max(1e-12)).min(1.0);
    let tau = kappa * extent;
    // Beyond the last bin colour does not change.
    let slope_high = if above >= LIGHT_BINS as f32 { 0.0 } else { high[3] };
    let even_colors = low[2].min(slope_high) * (light_bin(above) + 1.0 - light_bin(below));
    let out_of_order = OUT_OF_ORDER * (colors * uneven.max(disorder)).max(colors - even_colors) + ORDER_REST * colors;
    let of_order = (1.0 - (-tau).exp()) * out_of_order * tau / (4.0 + tau);
    let fall = FALL_MISPLACED * tau * tau / (1.0 + FALL_END * tau * tau);
    let of_bin = 0.5 * bends + 2.0 * (kappa * table.most).sqrt() / GREATEST_ROOT as f32 + table.unit;
    let fit = (of_bin * extent / width.max(1.0)).min(1.0);
    [of_mean.clamp(0.0, 1.0) + of_order, fit, UNEVEN_MISPLACED * uneven + fall, colors.min(1.0)]
}

/// The value at a position in a cell. The cell is [0, 1]^3; corner c has the offsets (c & 1, c >> 1 & 1, c >> 2).
#[must_use]
pub fn value_in(corners: &[f32; 8], [x, y, z]: [f32; 3]) -> f32 {
    let row = |c: usize| corners[c] + x * (corners[c + 1] - corners[c]);
    let layer = |c: usize| row(c) + y * (row(c + 2) - row(c));
    layer(0) + z * (layer(4) - layer(0))
}

/// Coefficient of xyz.
#[must_use]
pub fn twist_of(corners: &[f32; 8]) -> f32 {
    let rise = |c: usize| corners[c + 1] - corners[c];
    (rise(6) - rise(4)) - (rise(2) - rise(0))
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;
    use supervol_scene::transfer_function::{ControlPoint, TransferFunction};

    use super::*;
    use crate::engines::cubics::{Cubic, cubic, exact};

    /// A part beside the function, however close, contributes nothing and has no error.
    #[test]
    fn dark_parts_state_no_error() {
        let point = |value, alpha| ControlPoint { value, color: [0.9, 0.3, 0.1], alpha };
        let tf = TransferFunction::new(vec![point(140.0, 0.0), point(255.0, 0.3)], 1.0).unwrap();
        let table = LightTable::new(&tf, 0.0, 1e-3);
        let part = integrate_chord(&table, &LightChord { values: [-300.0, -190.0, -70.0], cubic: 20.0, extent: 1.0 });
        assert_eq!((part.color, part.transmittance, part.error), ([0.0; 3], 1.0, 0.0), "{part:?}");
        assert!(part.fit < 1e-6, "{part:?}");
    }

    /// Beyond its ends the function is constant: means are exact there, at any distance.
    #[test]
    fn parts_far_from_a_narrow_function_are_exact() {
        let point = |value, alpha| ControlPoint { value, color: [0.9, 0.3, 0.1], alpha };
        let tf = TransferFunction::new(vec![point(0.681, 0.165), point(0.6815, 0.7)], 1.0).unwrap();
        let table = LightTable::new(&tf, 0.0, 1e-3);
        for (value, alpha) in [(-2.1e6, 0.165), (2.1e6, 0.7)] {
            for rise in [0.5, 1.5, 7.0, 300.0] {
                let values = [0.0, 0.5, 1.0].map(|u| value + u * rise);
                let part = integrate_chord(&table, &LightChord { values, cubic: 0.0, extent: 1.0 });
                let off = f64::from(part.transmittance) - (1.0 - alpha);
                assert!(off.abs() < 1e-5 && part.error == 0.0, "{value}, {rise}: {off}, {part:?}");
            }
        }
    }

    /// `count` cubics with one common slope and curvature.
    fn follow_one_another(random: &mut impl FnMut() -> f64, count: usize, wide: f64) -> Vec<Cubic> {
        let mut value = 100.0 + 20.0 * random();
        let (mut slope, bend) = (wide * 10.0 * (random() - 0.5), wide * 6.0 * (random() - 0.5));
        let share = if count == 1 { 1.0 } else { 0.4 };
        (0..count)
            .map(|_| {
                let length = share * 3.0 * random();
                let own = wide * (random() - 0.5);
                let k = [value, share * slope, share * share * bend, share * own];
                value = cubic(k, 1.0);
                slope += share * bend;
                (k, length)
            })
            .collect()
    }

    /// The stated error of a part is never far below its true error, whatever bends it holds. For one part, and for
    /// several by one line, along which the field bends and whose lengths differ.
    #[test]
    fn stated_errors_are_errors() {
        let mut numbers = Random::new(17);
        let mut random = || numbers.unit();
        let (mut worst, mut looked_at) = (0.0f64, 0);
        for i in 0..6000 {
            let mut values: Vec<f64> = (0..2 + (random() * 4.0) as usize).map(|_| 100.0 + 20.0 * random()).collect();
            values.sort_by(f64::total_cmp);
            let steep = if random() < 0.5 { 0.05 } else { 0.9 };
            let points = values.into_iter().map(|value| ControlPoint {
                value: f64::from(value as f32),
                color: [0; 3].map(|_| random()),
                alpha: if random() < 0.3 { 0.0 } else { steep * random() },
            });
            let tf = TransferFunction::new(points.collect(), 2.0).unwrap();
            let table = LightTable::new(&tf, 0.0, 1e-3);
            let wide = if random() < 0.5 { 1.0 } else { 0.1 };
            let cubics = follow_one_another(&mut random, if i % 2 == 0 { 1 } else { 4 }, wide);
            let bins = |v: f64| ((v - f64::from(table.first)) * f64::from(table.bins_per_value)) as f32;
            let line = cubics.iter().fold(no_line(), |line, &(k, length)| {
                let chord = LightChord {
                    values: [0.0, 0.5, 1.0].map(|u| bins(cubic(k, u))),
                    cubic: (k[3] * f64::from(table.bins_per_value)) as f32,
                    extent: (length / tf.unit_distance()) as f32,
                };
                line_over(&line, &line_of(&chord))
            });
            let disorder = if cubics.len() == 1 { 0.0 } else { disorder_of(&line) };
            let found = integrate_line(&table, &line, disorder);
            let expected = exact(&tf, &cubics);
            let [r, g, b] = found.color;
            let off = [r, g, b, found.transmittance].into_iter().zip(expected);
            let error = off.map(|(f, e)| (f64::from(f) - e).abs()).fold(0.0, f64::max);
            // The fit of the pieces behind the table, `f32`, and the step size of the exact sum.
            let own = 2e-3 * f64::from(1.0 - found.transmittance) + 2e-5;
            let allowed = own + 1.5 * f64::from(found.error + found.fit);
            worst = worst.max(error / allowed);
            looked_at += usize::from(error > 1.5e-3);
            assert!(error <= allowed, "{found:?} for {expected:?}, {line:?}, {:?}", tf.points());
        }
        assert!(looked_at > 100 && worst > 0.3, "{looked_at} chords with an error; at worst {worst} of what is stated");
    }
}
