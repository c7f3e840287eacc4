//! The transfer function in the form that the shader integrates: extinction and emission in equal bins of values, with
//! their antiderivatives.
//!
//! Values are counted in *bins* from the function's first control point: [`LIGHT_BINS`] of them reach to its last. One
//! more on either side holds all values beyond. Extinction is per unit distance. A bin has three texels, side by side
//! in one cache line ([`BIN_TEXELS`]):
//!
//! 1. The antiderivatives of extinction, and of extinction times red, green, blue, at the beginning of the bin. They
//!    are exact, so means over several bins are exact for any steps and bends in between (`packets::integrate`
//!    describes their use).
//! 2. The same four channels just behind the bin's beginning and just before its end, as roots of their shares of the
//!    greatest. They give a line with the bin's mean.
//! 3. Sums up to the bin's beginning: changes of slope per bin, and variation of visible colour. Then that variation in
//!    the bin, and in the one before it. Their differences bound the error of an integration rule.
//!
//! Packets on the CPU look up pieces (`transfer_function::pieces`), which takes a search and twice as many texels. A
//! bin is found by one conversion, for any number of control points. The price: a kink is blurred over a bin.

use supervol_format::cast::{single, whole};
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::transfer_function::pieces::{CHANNELS, Column, TransferPieces};
use supervol_scene::value_map::ValueMap;

use super::layout::{LIGHT_BINS, TABLE_WIDTH};
use crate::engines::gpu::limits::{BIN_TEXELS, GREATEST_ROOT};
use crate::engines::gpu::texels::VoxelStorage;
use crate::engines::rules::STEEPEST_BIN;

/// Bins, and one on either side.
const PLACES: usize = LIGHT_BINS as usize + 2;
/// Texels of the table: whole rows.
pub const TEXELS: usize = (BIN_TEXELS * PLACES).next_multiple_of(TABLE_WIDTH as usize);

/// Table of the transfer function, see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct LightTable {
    /// Four words per texel.
    pub words: Vec<u32>,
    /// Render value of the first bin's beginning.
    pub first: f32,
    /// Render value in the middle of the function. Numbers are relative to it, because `f32` would otherwise have few
    /// bits after the point.
    pub middle: f32,
    /// Bins per render value.
    pub bins_per_value: f32,
    /// Unit of the antiderivatives' integers: extinction per unit distance times bins.
    pub unit: f32,
    /// Greatest channel.
    pub most: f32,
    /// Whether bins resolve the function: it has no step, or nearly a step. If a ray grazes a step, only roots find it.
    pub is_resolved: bool,
}

/// The numbers of one value, from the pieces.
struct At {
    antiderivative: [f64; CHANNELS],
    /// Bends, variation of colour.
    sums: [f64; 2],
}

impl LightTable {
    /// The table of a function, with an error of at most `tolerance` times the extinction; `shift` is subtracted from
    /// every data value.
    #[must_use]
    pub fn new(source: &TransferFunction, shift: f64, tolerance: f64) -> Self {
        let points = source.points();
        let value_of = |i: usize| f64::from(single(points[i].value - shift));
        let (first, last) = (value_of(0), value_of(points.len() - 1));
        // A function of one step, or of one point, gets a width.
        let width = if last > first { last - first } else { first.abs().max(1.0) * f64::from(f32::EPSILON) * 64.0 };
        let first = if last > first { first } else { first - 0.5 * width };
        let pieces = TransferPieces::new(source, shift, tolerance);
        let per_bin = width / f64::from(LIGHT_BINS);
        let scale = source.unit_distance();
        // A bend at the beginning of a bin belongs to that bin; a bend at the end belongs to the last bin.
        let edge = |i: u32| at(&pieces, first + per_bin * f64::from(i), i < LIGHT_BINS);
        let edges: Vec<At> = (0..=LIGHT_BINS).map(edge).collect();
        // Below the first bin there are no steps, no bends, and no area.
        let before = At { antiderivative: [0.0; CHANNELS], ..at(&pieces, first - width, false) };
        let greatest = edges.iter().flat_map(|edge| edge.antiderivative).fold(0.0, f64::max) * scale / per_bin;
        let unit = greatest.max(f64::from(f32::MIN_POSITIVE)) / f64::from(i32::MAX - 1);
        let most = points.iter().map(|p| source.kappa(p.alpha)).fold(f64::MIN_POSITIVE, f64::max);
        let mut words = vec![0; 4 * TEXELS];
        let mut write = |i: usize, place: usize, texel: [u32; 4]| {
            words[4 * (BIN_TEXELS * place + i)..][..4].copy_from_slice(&texel);
        };
        let mut is_resolved = !pieces.has_steps();
        let mut colors_before = 0.0;
        for place in 0..PLACES {
            let begin = if place == 0 { &before } else { &edges[place - 1] };
            let is_outside = place == 0 || place + 1 == PLACES;
            let ends = if is_outside {
                let value = first + if place == 0 { -width } else { 2.0 * width };
                [channels_at(&pieces, value, false); 2]
            } else {
                let [left, right] = [place - 1, place].map(|i| first + per_bin * i as f64);
                let mean =
                    std::array::from_fn(|c| (edges[place].antiderivative[c] - begin.antiderivative[c]) / per_bin);
                let ends = [channels_at(&pieces, left, false), channels_at(&pieces, right, true)];
                let bends = (edges[place].sums[0] - begin.sums[0]) * per_bin;
                is_resolved &= is_smooth(&ends, &mean, most) && bends <= 2.0 * STEEPEST_BIN * most;
                line_of(ends, mean)
            };
            // Integers: their differences are exact, however much lies below.
            let k = begin.antiderivative.map(|k| whole::<u32>((k * scale / per_bin / unit).round()));
            let k = std::array::from_fn(|c| k[(c + 1) % CHANNELS]);
            write(0, place, k);
            write(1, place, packed(ends, most));
            let [bends, color] = begin.sums;
            let colors = if is_outside { 0.0 } else { edges[place].sums[1] - color };
            write(2, place, [bends * scale * per_bin, color, colors, colors_before].map(|v| single(v).to_bits()));
            colors_before = colors;
        }
        Self {
            words,
            first: single(first),
            middle: single(first + 0.5 * width),
            bins_per_value: single(1.0 / per_bin),
            unit: single(unit),
            most: single(most * scale),
            is_resolved,
        }
    }
}

impl LightTable {
    /// Centre, scale and offset: `bin = (stored number - centre) * scale + offset`; for floats, of render values.
    #[must_use]
    pub fn bins_of_stored(&self, storage: VoxelStorage, map: &ValueMap) -> [f32; 3] {
        let (first, per_value) = (f64::from(self.first), f64::from(self.bins_per_value));
        if storage == VoxelStorage::F32 {
            let centre = self.middle;
            return [centre, self.bins_per_value, single((f64::from(centre) - first) * per_value)];
        }
        let (scale, offset) = (f64::from(map.scale), f64::from(map.offset));
        // The number whose value is nearest to the middle; `as` maps NaN to 0.
        let centre = f64::from(whole::<u16>(((f64::from(self.middle) - offset) / scale).round()));
        let at_centre = (centre * scale + offset - first) * per_value;
        [single(centre), single(scale * per_value), single(at_centre)]
    }
}

/// Whether a bin with these ends and this mean is part of a slope; `most`: the greatest channel.
fn is_smooth([left, right]: &[[f64; CHANNELS]; 2], mean: &[f64; CHANNELS], most: f64) -> bool {
    (0..CHANNELS).all(|c| {
        let of_ends = 0.5 * (left[c] + right[c]);
        (right[c] - left[c]).abs() <= STEEPEST_BIN * most && (of_ends - mean[c]).abs() <= 0.5 * STEEPEST_BIN * most
    })
}

/// The line through a bin with this mean. Its ends have it up to rounding, or up to a kink.
fn line_of(ends: [[f64; CHANNELS]; 2], mean: [f64; CHANNELS]) -> [[f64; CHANNELS]; 2] {
    let off: [f64; CHANNELS] = std::array::from_fn(|c| mean[c] - 0.5 * (ends[0][c] + ends[1][c]));
    ends.map(|end| std::array::from_fn(|c| (end[c] + off[c]).max(0.0)))
}

/// Red, green, blue, extinction at both ends: roots of their shares of `most`, 16 bits each.
fn packed([left, right]: [[f64; CHANNELS]; 2], most: f64) -> [u32; 4] {
    let root = |v: f64| whole::<u32>(((v / most).clamp(0.0, 1.0).sqrt() * f64::from(GREATEST_ROOT)).round());
    let pair = |a: f64, b: f64| root(a) | root(b) << 16;
    [pair(left[1], left[2]), pair(left[3], left[0]), pair(right[1], right[2]), pair(right[3], right[0])]
}

fn piece_of(pieces: &TransferPieces, value: f64, is_left: bool) -> usize {
    let knots = &pieces.column(Column::Knot, 0)[..pieces.count()];
    let passed = knots.partition_point(|&k| if is_left { f64::from(k) < value } else { f64::from(k) <= value });
    passed.max(1) - 1
}

/// The channels at a value; at a step, those on its left or on its right.
fn channels_at(pieces: &TransferPieces, value: f64, is_left: bool) -> [f64; CHANNELS] {
    let i = piece_of(pieces, value, is_left);
    let of = |column, c| f64::from(pieces.column(column, c)[i]);
    let y = value - of(Column::Anchor, 0);
    std::array::from_fn(|c| {
        of(Column::Value, c) + y * (2.0 * of(Column::HalfSlope, c) + y * 3.0 * of(Column::ThirdBend, c))
    })
}

/// The numbers at a value, with or without the bends at it.
fn at(pieces: &TransferPieces, value: f64, is_left: bool) -> At {
    let i = piece_of(pieces, value, is_left);
    let of = |column, c| f64::from(pieces.column(column, c)[i]);
    let y = value - of(Column::Anchor, 0);
    let antiderivative = std::array::from_fn(|c| {
        let rest = of(Column::Value, c) + y * (of(Column::HalfSlope, c) + y * of(Column::ThirdBend, c));
        of(Column::Start, c) + y * rest
    });
    let up_to = |sum, per_value| of(sum, 0) + y * of(per_value, 0);
    let sums =
        [up_to(Column::Bends, Column::BendsPerValue), up_to(Column::ColorVariation, Column::ColorVariationPerValue)];
    At { antiderivative, sums }
}

#[cfg(test)]
mod tests {
    use supervol_scene::transfer_function::ControlPoint;

    use super::*;

    fn table(points: &[(f64, f64)]) -> LightTable {
        let points = points.iter().map(|&(value, alpha)| ControlPoint { value, color: [1.0, 0.5, 0.0], alpha });
        LightTable::new(&TransferFunction::new(points.collect(), 1.0).unwrap(), 0.0, 5e-4)
    }

    #[test]
    fn steps_and_narrow_spikes_are_not_resolved() {
        assert!(table(&[(0.0, 0.0), (255.0, 0.9)]).is_resolved);
        assert!(table(&[(0.0, 0.0), (96.0, 0.0), (100.0, 0.9), (104.0, 0.0), (255.0, 0.0)]).is_resolved);
        assert!(!table(&[(0.0, 0.0), (100.0, 0.0), (100.0, 0.9), (255.0, 0.9)]).is_resolved);
        // A tenth of a bin wide, within one bin.
        assert!(!table(&[(0.0, 0.0), (100.01, 0.0), (100.013, 0.9), (100.016, 0.0), (255.0, 0.0)]).is_resolved);
        assert!(!table(&[(7.0, 0.5)]).words.is_empty());
    }

    /// Numbers are relative to the middle of the function: no bits are lost far from zero.
    #[test]
    fn stored_numbers_become_bins() {
        let table = table(&[(30_000.0, 0.0), (30_016.0, 0.5)]);
        let map = ValueMap::for_container(
            supervol_format::VoxelType::U16,
            1.0,
            0.0,
            None,
            supervol_format::ValueRange { min: 0.0, max: 65535.0 },
        );
        let [centre, scale, offset] = table.bins_of_stored(VoxelStorage::U16, &map);
        for (stored, value) in [(30_000.0, 30_000.0), (30_004.0, 30_004.0), (30_016.0, 30_016.0)] {
            let bin = f64::from((stored - centre) * scale + offset);
            assert!((bin - 256.0 * (value - 30_000.0)).abs() < 1e-2, "{stored}: {bin}");
        }
    }
}
