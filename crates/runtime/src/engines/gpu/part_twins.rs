//! Twins of `shaders/shared/integrate.wgsl` and `light_shading.wgsl`: what packets do, one lane at a time, under the shader's names.

use glam::Vec3;
use supervol_format::Geometry;

use super::piece_table::PieceTable;
use crate::engines::cells::shade::Lighting;
use crate::engines::gpu::limits::FAR;
use crate::engines::packets::chord::{Chord, Line};
use crate::engines::packets::integrate::{Part, Wanted, integrate_at};
use crate::engines::packets::lookup::{ManyPieces, PieceLookup, quadratics};
use crate::engines::packets::shade::PacketLighting;
use crate::engines::packets::simd::{LANES_LIMIT, Portable, Simd};
use crate::engines::packets::uneven::locate;

type S = Portable;
type F = <S as Simd>::F;

/// Least divisor.
const TINY: f32 = 1e-30;

/// The field along a part of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightChord {
    /// At its beginning, middle and end.
    pub values: [f32; 3],
    /// Coefficient of the third power.
    pub cubic: f32,
    /// World length.
    pub extent: f32,
    /// Bound on the rounding of the values.
    pub noise: f32,
}

/// The line that replaces the field along a part of a ray, or along several, and what is known about the field's distance from it.
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
    /// World length.
    pub extent: f32,
    /// Bound on the rounding of the field.
    pub noise: f32,
}

/// Contribution of a part of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightPart {
    /// Premultiplied.
    pub color: [f32; 3],
    /// Share of light from behind that passes.
    pub transmittance: f32,
    /// Bound on the error of both, and the share of it that rounding makes.
    pub error: f32,
    /// See above.
    pub rounding: f32,
    /// Origin of the colours and of opacity along the part: first moments about its middle.
    pub moments: [f32; 4],
    /// Bound on how far each of the four is from a linear density with its sum and its moment.
    pub misplaced: f32,
    /// Variation of colour over the part.
    pub colors: f32,
}

fn splat(number: f32) -> F {
    S::splat(number)
}

fn first(lanes: F) -> f32 {
    let mut numbers = [0.0; LANES_LIMIT];
    S::store(lanes, &mut numbers);
    numbers[0]
}

fn chord_of(chord: &LightChord) -> Chord<S> {
    Chord {
        values: chord.values.map(splat),
        cubic: splat(chord.cubic),
        length: splat(chord.extent),
        noise: splat(chord.noise),
        bounds: Chord::<S>::UNBOUNDED.map(splat),
    }
}

fn integrated(table: &PieceTable, line: &Line<S>) -> Part<S> {
    let lanes = S::mask_from_bits(u32::MAX);
    let lookup = ManyPieces::new(&table.pieces);
    let located = locate(&lookup, line, lanes);
    integrate_at(&lookup, table.limits(), (line, &located), &Wanted { lanes, order: splat(0.0), lit: true })
}

fn part_of(part: &Part<S>) -> LightPart {
    let [of_opacity, red, green, blue] = part.moments;
    LightPart {
        color: part.color.map(first),
        transmittance: first(part.transmittance),
        error: first(part.error),
        rounding: first(part.rounding),
        moments: [red, green, blue, of_opacity].map(first),
        misplaced: first(part.misplaced),
        colors: first(part.colors),
    }
}

/// The channels at a value: red, green, blue (times extinction), extinction.
#[must_use]
pub fn channels_at(table: &PieceTable, value: f32) -> [f32; 4] {
    let lookup = ManyPieces::new(&table.pieces);
    let place = lookup.place::<S>(splat(value));
    let [extinction, red, green, blue] = quadratics::<S, _>(&lookup, place.piece).at(place.y).value;
    [red, green, blue, extinction].map(first)
}

/// The line of no part.
#[must_use]
pub fn no_line() -> LightLine {
    LightLine { ends: [0.0; 2], range: [FAR, -FAR], most: -FAR, average: 0.0, extent: 0.0, noise: 0.0 }
}

/// The line with the field's mean and the difference between its ends.
#[must_use]
pub fn line_of(chord: &LightChord) -> LightLine {
    let line = chord_of(chord).line();
    LightLine {
        ends: line.ends.map(first),
        range: line.range.map(first),
        most: first(line.most),
        average: first(line.average),
        extent: chord.extent,
        noise: chord.noise,
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
        noise: a.noise.max(b.noise),
    }
}

/// Bound on the mean distance from 0 of a quantity that varies evenly from one number to another.
fn mean_distance([x, y]: [f32; 2]) -> f32 {
    0.25 * (x.abs() + y.abs() + (x + y).abs())
}

/// Integrates a chord.
#[must_use]
pub fn integrate_chord(table: &PieceTable, chord: &LightChord) -> LightPart {
    part_of(&integrated(table, &chord_of(chord).line()))
}

/// Integrates along a line of several parts.
#[must_use]
pub fn integrate_line(table: &PieceTable, line: &LightLine) -> LightPart {
    let ends = (line.ends.map(splat), line.range.map(splat));
    let line = Line::<S>::span(ends, [line.most, line.average].map(splat), [line.extent, line.noise].map(splat));
    part_of(&integrated(table, &line))
}

/// A chord after shading: colour and error. `gradients` are those at its beginning, middle and end, and `cubic` their coefficient
/// of the third power; `to_eye` is a unit vector.
#[must_use]
pub fn shade_part(
    lighting: &Lighting,
    (table, chord): (&PieceTable, &LightChord),
    (gradients, cubic): ([Vec3; 3], Vec3),
    to_eye: Vec3,
) -> [f32; 4] {
    let part = integrated(table, &chord_of(chord).line());
    // The lighting needs no positions in space.
    let lighting = PacketLighting::new(lighting, &Geometry::IDENTITY, [1; 3], 1.0);
    let to_eye = to_eye.to_array().map(splat);
    let along = lighting.at::<S, 3>(&gradients.map(|g| g.to_array().map(splat)), &to_eye);
    let shaded = lighting.shade::<S>(&part, &along, &cubic.to_array().map(splat));
    let [r, g, b] = shaded.color;
    [r, g, b, shaded.error].map(first)
}
