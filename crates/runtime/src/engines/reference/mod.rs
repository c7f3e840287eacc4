//! The reference integrator: defines the right picture, in `f64`.
//!
//! It follows RENDERING-MODEL line by line, and shares with the ray casters only the camera, the clipping and the
//! definition of the transfer function.
//!
//! In mode `dvr` a ray's segment is cut at the faces of the trilinear cells (integer index coordinates), because the
//! field bends there. In a cell the field and its gradient are cubics along the ray (`chord`). Each *piece* is cut
//! again where light has a kink or a step. Between cuts light is smooth. It is sampled at Gauss points, in parts that
//! are halved until two halvings in turn change nothing, no normal turns far, and no colour can reach 1 between samples
//! (`integral`).
//!
//! *Accuracy.* A ray is off by at most 1e-5 of full scale (0.0026 grey levels), for every channel. The tolerance of a ray
//! is a tenth of it, shared by its pieces. Tests compare rays with an integration that knows no cells:
//! `tests/pictures/reference_accuracy.rs`. A part that does not converge is counted.
//!
//! It holds the whole volume in memory: suitable for small volumes only.

mod chord;
mod integral;

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use rayon::prelude::*;
use supervol_format::cast::{narrow, single, whole};
use supervol_format::{Dims, Geometry, ValueRange};
use supervol_scene::clip::faces::CutFace;
use supervol_scene::clip::{IndexRay, ROUNDED_LENGTH, Segment, ToIndex, clip_parts, clip_ray};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene, Shading};
use supervol_scene::slices::filter::{FilteredSlice, TexelGrid};
use supervol_scene::slices::{SliceColors, SlicePlane, crossings, interpolate};

use self::chord::{Chord, ChordScene};
use self::integral::{CLEAR, GaussRule, Integral, Seen, behind};

/// Error of a ray that its pieces share, of full scale.
const RAY_TOLERANCE: f64 = 1e-6;
/// Transmittance behind which nothing is computed.
const OPAQUE: f64 = 1e-9;
/// Relative distance from a piece's ends at which they are sampled: on the ends themselves, rounding could choose the
/// neighbouring cell, which may be absent. Also the distance, voxels, within which an end counts as lying on a plane of
/// voxels.
const END_INSET: f64 = 1e-9;
/// Samples of a piece for the search of extremes and of crossings of surfaces.
const SEARCH_SAMPLES: usize = 32;
/// Gradients below this share of the data range per smallest spacing are noise and not shaded.
const GRADIENT_FLOOR: f64 = 1e-6;
/// Relative variation of the interpolant of equal voxels: its weights sum to 1 only up to rounding.
const ROUNDING: f64 = 1e-13;

/// A volume wholly in memory.
#[derive(Debug, Clone)]
pub struct ReferenceVolume {
    /// Voxels along each axis.
    pub dims: [usize; 3],
    /// Place in the world.
    pub geometry: Geometry,
    /// Data values, x fastest; NaN is absent.
    pub values: Vec<f64>,
    /// Range of the present values.
    pub value_range: ValueRange,
}

/// A picture, with the number of unconverged intervals.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePicture {
    /// The picture.
    pub image: Image,
    /// Intervals that had not converged at the limit of halvings.
    pub capped_pieces: u64,
}

/// The picture of a scene.
#[must_use]
pub fn render_reference(volume: &ReferenceVolume, scene: &ResolvedScene) -> Image {
    render_reference_counted(volume, scene).image
}

/// The picture of a scene, and how many pieces did not converge.
#[must_use]
pub fn render_reference_counted(volume: &ReferenceVolume, scene: &ResolvedScene) -> ReferencePicture {
    let frame = Frame::new(volume, scene);
    let (width, height) = (scene.camera.width, scene.camera.height);
    let pixels = (0..height).into_par_iter().flat_map_iter(|y| (0..width).map(move |x| (x, y)));
    let pixels = pixels.map(|(x, y)| frame.pixel(x, y).map(single)).collect();
    let image = Image { width, height, pixels }.downsampled(scene.subgrid);
    ReferencePicture { image, capped_pieces: frame.capped_pieces.into_inner() }
}

/// Single pixels of the picture of a scene.
#[derive(Debug)]
pub struct ReferenceCaster<'a> {
    frame: Frame<'a>,
}

impl<'a> ReferenceCaster<'a> {
    /// A caster for the picture of [`render_reference`].
    #[must_use]
    pub fn new(volume: &'a ReferenceVolume, scene: &'a ResolvedScene) -> Self {
        Self { frame: Frame::new(volume, scene) }
    }

    /// Pixels (column, row) of the picture, each the mean of its rays: premultiplied RGBA before the background, bit
    /// for bit as in the whole picture. `each` is called after each of them.
    #[must_use]
    pub fn pixels(&self, pixels: &[[u32; 2]], each: &(dyn Fn() + Sync)) -> Vec<[f32; 4]> {
        let pixel = |&[x, y]: &[u32; 2]| {
            let n = self.frame.scene.subgrid;
            let rays = (0..n).flat_map(|j| (0..n).map(move |i| (n * x + i, n * y + j)));
            let pixels = rays.map(|(x, y)| self.frame.pixel(x, y).map(single)).collect();
            let mean = Image { width: n, height: n, pixels }.downsampled(n).pixels[0];
            each();
            mean
        };
        pixels.par_iter().map(pixel).collect()
    }

    /// Intervals so far that had not converged at the limit of halvings.
    #[must_use]
    pub fn capped_pieces(&self) -> u64 {
        self.frame.capped_pieces.load(Ordering::Relaxed)
    }
}

impl ReferenceVolume {
    /// Value of a voxel, indices clamped to the grid.
    fn voxel(&self, index: [i64; 3]) -> f64 {
        let [i, j, k] = [0, 1, 2].map(|a| self.clamped(index[a], a));
        self.values[i + self.dims[0] * (j + self.dims[1] * k)]
    }

    fn clamped(&self, index: i64, axis: usize) -> usize {
        narrow::<usize>(index.clamp(0, narrow::<i64>(self.dims[axis]) - 1))
    }

    /// The voxels around a cell: corner c lies `(c & 1, c >> 1 & 1, c >> 2)` after its first one.
    fn corners(&self, cell: [i64; 3]) -> [f64; 8] {
        // Along each axis, of the voxels before and after: the parts of the index in `values`.
        let mut places = [[0; 2]; 3];
        let mut stride = 1;
        for a in 0..3 {
            places[a] = [cell[a], cell[a].saturating_add(1)].map(|index| stride * self.clamped(index, a));
            stride *= self.dims[a];
        }
        std::array::from_fn(|c| self.values[places[0][c & 1] + places[1][c >> 1 & 1] + places[2][c >> 2]])
    }

    /// s(p): trilinear interpolation; `None` where a voxel of non-zero weight is absent.
    #[must_use]
    pub fn sample(&self, p: [f64; 3]) -> Option<f64> {
        let first = p.map(f64::floor);
        interpolated(&self.corners(first.map(whole::<i64>)), std::array::from_fn(|a| p[a] - first[a]))
    }

    /// Index-space gradient by central differences one voxel apart; `None` where a tap is absent.
    fn gradient(&self, p: [f64; 3]) -> Option<DVec3> {
        let mut gradient = DVec3::ZERO;
        for axis in 0..3 {
            let tap = |step: f64| {
                let mut q = p;
                q[axis] += step;
                self.sample(q)
            };
            gradient[axis] = (tap(1.0)? - tap(-1.0)?) / 2.0;
        }
        Some(gradient)
    }
}

#[derive(Debug)]
struct Frame<'a> {
    volume: &'a ReferenceVolume,
    scene: &'a ResolvedScene,
    chords: ChordScene<'a>,
    rule: GaussRule,
    capped_pieces: AtomicU64,
    /// For each slice: the result of its filter, and colours that suit it.
    filtered: Vec<Option<(FilteredSlice, Option<SliceColors>)>>,
}

/// One ray with its pieces, front to back; one ends where the next begins, unless clipping removed the part in between.
struct Pieces {
    ray: IndexRay,
    direction: DVec3,
    pieces: Vec<[f64; 2]>,
    /// Cut faces that light what is behind them, front to back.
    faces: Vec<CutFace>,
}

impl Pieces {
    /// World length of all pieces.
    fn length(&self) -> f64 {
        self.pieces.iter().map(|end| end[1] - end[0]).sum()
    }

    /// The cut face behind which a piece lies.
    fn face_before(&self, [t0, t1]: [f64; 2]) -> Option<CutFace> {
        self.faces.iter().rev().find(|face| face.t < 0.5 * (t0 + t1)).copied()
    }

    /// The pieces that are longer than the rounding of their ends.
    fn longer_than_rounding(&self) -> impl Iterator<Item = &[f64; 2]> {
        let is_long =
            |end: &[f64; 2]| self.ray.direction.iter().any(|d| (d * (end[1] - end[0])).abs() > ROUNDED_LENGTH);
        self.pieces.iter().filter(move |end| is_long(end))
    }
}

impl<'a> Frame<'a> {
    fn new(volume: &'a ReferenceVolume, scene: &'a ResolvedScene) -> Self {
        let range = volume.value_range;
        let largest = if range.is_empty() { 0.0 } else { range.min.abs().max(range.max.abs()) };
        let floor = (GRADIENT_FLOOR * range.width()).max(ROUNDING * largest);
        let gradient_floor = floor / volume.geometry.smallest_spacing();
        let to_world = (volume.geometry.world_from_index_gradient(), gradient_floor);
        let optional = (scene.gradient_opacity, scene.cut_normals.as_ref());
        let chords = ChordScene::new(&scene.transfer_function, scene.shading.as_ref(), optional, to_world);
        let filtered = scene.slices.iter().map(|slice| filtered(volume, scene, slice)).collect();
        let capped_pieces = AtomicU64::new(0);
        Self { volume, scene, chords, rule: GaussRule::new(), capped_pieces, filtered }
    }

    fn pixel(&self, x: u32, y: u32) -> [f64; 4] {
        let ray = self.scene.camera.ray(x, y);
        let index_ray = IndexRay::new(&ray, &self.volume.geometry);
        let dims = Dims(self.volume.dims.map(|n| n as u64));
        let Some(segment) = clip_ray(&ray, &index_ray, dims, &self.scene.clip) else { return [0.0; 4] };
        let parts = clip_parts(&ray, &index_ray, dims, &self.scene.clip);
        let pieces = parts.into_iter().flat_map(|part| pieces_of(&index_ray, part)).collect();
        let faces = self.scene.cut_normals.as_ref().map(|cuts| cuts.faces(&ray, &index_ray, dims));
        let whole = Pieces { ray: index_ray, direction: ray.direction, pieces, faces: faces.unwrap_or_default() };
        if self.scene.slices.is_empty() {
            return self.gathered(&whole);
        }
        // Slices cut the ray: the part before each, the slice, and the part behind the last.
        let mut picture = (DVec3::ZERO, 1.0);
        let mut before = segment.t0;
        for (t, number) in crossings(&self.scene.slices, &ray, segment) {
            picture = behind(picture, self.between(&whole, before, t));
            let point = ray.origin + t * ray.direction;
            if self.scene.clip.solids.iter().all(|solid| solid.keeps(point)) {
                picture = behind(picture, self.slice(number, point, whole.ray.at(t)));
            }
            before = t;
        }
        let (color, transmittance) = behind(picture, self.between(&whole, before, segment.t1));
        [color.x, color.y, color.z, 1.0 - transmittance]
    }

    /// Premultiplied colour and transmittance of a part of a ray.
    fn between(&self, whole: &Pieces, t0: f64, t1: f64) -> (DVec3, f64) {
        let inner = whole.pieces.iter().map(|piece| [piece[0].max(t0), piece[1].min(t1)]);
        let pieces = inner.filter(|piece| piece[0] < piece[1]).collect();
        let [r, g, b, alpha] = self.gathered(&Pieces { pieces, faces: whole.faces.clone(), ..*whole });
        (DVec3::new(r, g, b), 1.0 - alpha)
    }

    /// Premultiplied colour and transmittance of a slice at a world point and index point.
    fn slice(&self, number: usize, world: DVec3, p: [f64; 3]) -> (DVec3, f64) {
        let slice = &self.scene.slices[number];
        let (value, colors) = match &self.filtered[number] {
            Some((filtered, colors)) => (filtered.value(world, slice.interpolation), colors.as_ref()),
            None => (interpolate(p, slice.interpolation, |index| self.volume.voxel(index)), None),
        };
        let colors = slice.colors.as_ref().or(colors).filter(|_| !value.is_nan());
        let Some(color) = colors.and_then(|colors| colors.color(value)) else { return (DVec3::ZERO, 1.0) };
        (slice.opacity * DVec3::from(color), 1.0 - slice.opacity)
    }

    /// Contribution of the volume to a ray on these pieces.
    fn gathered(&self, pieces: &Pieces) -> [f64; 4] {
        match self.scene.mode {
            Mode::Dvr => self.dvr(pieces),
            Mode::Mip => self.classified(self.extreme(pieces, 1.0)),
            Mode::Minip => self.classified(self.extreme(pieces, -1.0)),
            Mode::Mean => self.classified(self.mean(pieces)),
            Mode::Iso => self.iso(pieces),
            Mode::Slice => [0.0; 4],
        }
    }

    /// `alpha c`, `alpha`: modes that classify one value, without any length.
    fn classified(&self, value: Option<f64>) -> [f64; 4] {
        let Some(value) = value else { return [0.0; 4] };
        let ([r, g, b], alpha) = self.scene.transfer_function.classify(value);
        [alpha * r, alpha * g, alpha * b, alpha]
    }

    fn dvr(&self, pieces: &Pieces) -> [f64; 4] {
        let mut surfaces = self.all_crossings(pieces).into_iter().peekable();
        let per_length = RAY_TOLERANCE / pieces.length();
        let mut seen = CLEAR;
        for end in &pieces.pieces {
            if seen.1 <= OPAQUE {
                break;
            }
            let mut from = end[0];
            while let Some((t, index)) = surfaces.next_if(|(t, _)| *t <= end[1]) {
                if from < t {
                    seen = behind(seen, self.integrated(pieces, [from, t], per_length, seen.1));
                    from = t;
                }
                seen = behind(seen, self.surface(pieces, t, index));
            }
            if from < end[1] {
                seen = behind(seen, self.integrated(pieces, [from, end[1]], per_length, seen.1));
            }
        }
        let (color, transmittance) = seen;
        [color.x, color.y, color.z, 1.0 - transmittance]
    }

    /// Premultiplied colour and transmittance of a piece, or of a part of it, behind this transmittance. It may be off by
    /// `per_length` times its length.
    fn integrated(&self, pieces: &Pieces, [t0, t1]: [f64; 2], per_length: f64, front: f64) -> Seen {
        let along = (&pieces.ray, pieces.face_before([t0, t1]));
        let chord = Chord::new(self.volume, &self.chords, along, pieces.direction, [t0, t1]);
        let Some(chord) = chord else { return CLEAR };
        let capped = || {
            self.capped_pieces.fetch_add(1, Ordering::Relaxed);
        };
        let tolerance = per_length * (t1 - t0);
        Integral { rule: &self.rule, light: &chord, tolerance, capped: &capped }.over(&chord.cuts(), front)
    }

    /// The colour after shading: `c (ka + sum kd |n.l| I) + sum ks |n.h|^shininess I`, clamped to [0, 1].
    fn shaded(&self, color: DVec3, p: [f64; 3], direction: DVec3) -> DVec3 {
        let Some(shading) = &self.scene.shading else { return color };
        let Some(gradient) = self.volume.gradient(p) else { return color };
        let gradient = self.chords.world_from_index_gradient * gradient;
        unlimited_light(shading, color, gradient, self.chords.gradient_floor, -direction).min(DVec3::ONE)
    }

    /// Greatest value (sign 1) or least value (sign -1) over the present part.
    fn extreme(&self, pieces: &Pieces, sign: f64) -> Option<f64> {
        let mut best: Option<f64> = None;
        for end in pieces.longer_than_rounding() {
            let (t, step) = search_grid(inset(*end));
            let at = |t: f64| self.volume.sample(pieces.ray.at(t)).map(|v| v * sign);
            let Some(values) = t.iter().map(|&t| at(t)).collect::<Option<Vec<f64>>>() else { continue };
            let best_at = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
            // The cubic has at most one greatest value inside: between the neighbours of the greatest sample.
            let (low, high) = ((t[best_at] - step).max(t[0]), (t[best_at] + step).min(t[t.len() - 1]));
            let top = peak(low, high, |t| at(t).unwrap_or(f64::NEG_INFINITY));
            let refined = at(top).unwrap_or(values[best_at]).max(values[best_at]);
            best = Some(best.map_or(refined, |b| b.max(refined)));
        }
        best.map(|v| v * sign)
    }

    /// Integral of s over the present length divided by the present length. Simpson's rule is exact for a cubic.
    fn mean(&self, pieces: &Pieces) -> Option<f64> {
        let (mut integral, mut length) = (0.0, 0.0);
        for end in pieces.longer_than_rounding() {
            let h = end[1] - end[0];
            let at = |x: f64| self.volume.sample(pieces.ray.at(end[0] + x * h));
            if let (Some(a), Some(m), Some(b)) = (at(END_INSET), at(0.5), at(1.0 - END_INSET)) {
                integral += h * (a + 4.0 * m + b) / 6.0;
                length += h;
            }
        }
        (length > 0.0).then(|| integral / length)
    }

    /// The first crossing of each iso value, composited in order. A value on the surface counts as above it.
    fn iso(&self, pieces: &Pieces) -> [f64; 4] {
        let mut hits: Vec<(f64, usize)> = Vec::new();
        for (index, surface) in self.scene.iso.iter().enumerate() {
            let in_piece = |&ends: &[f64; 2]| self.crossings_in(pieces, ends, surface.value).first().copied();
            hits.extend(pieces.pieces.iter().find_map(in_piece).map(|t| (t, index)));
        }
        hits.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let mut color = DVec3::ZERO;
        let mut transmittance = 1.0;
        for (t, index) in hits {
            (color, transmittance) = behind((color, transmittance), self.surface(pieces, t, index));
        }
        [color.x, color.y, color.z, 1.0 - transmittance]
    }

    /// Premultiplied colour and transmittance of a surface at t.
    fn surface(&self, pieces: &Pieces, t: f64, index: usize) -> (DVec3, f64) {
        let surface = self.scene.iso[index];
        let color = self.shaded(surface.color.into(), pieces.ray.at(t), pieces.direction);
        (surface.alpha * color, 1.0 - surface.alpha)
    }

    /// Every crossing of every surface's value, in order along the ray. A value on the surface counts as above it.
    fn all_crossings(&self, pieces: &Pieces) -> Vec<(f64, usize)> {
        let mut found = Vec::new();
        for (index, surface) in self.scene.iso.iter().enumerate() {
            for &ends in &pieces.pieces {
                found.extend(self.crossings_in(pieces, ends, surface.value).into_iter().map(|t| (t, index)));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found
    }

    /// Crossings of a present piece with a surface, in order. The ends of a piece belong to it. So a ray that reaches
    /// the surface exactly at the end of a cell, beside an absent one, has crossed it. Values on the two sides of a
    /// clipped or absent part are never compared.
    fn crossings_in(&self, pieces: &Pieces, ends: [f64; 2], surface: f64) -> Vec<f64> {
        let mut places = Vec::new();
        if self.volume.sample(pieces.ray.at(0.5 * (ends[0] + ends[1]))).is_some() {
            let at = |t: f64| {
                let p = pieces.ray.at(t);
                let p = if ends.contains(&t) { p.map(on_plane) } else { p };
                self.volume.sample(p).unwrap_or(f64::NAN)
            };
            // Equal voxels that have the surface's value are on it, however their weights round.
            add_crossings(ends, at, [surface - ROUNDING * surface.abs()], &mut places);
        }
        places.sort_by(f64::total_cmp);
        places
    }
}

/// The result of a slice's filter, and colours that suit it.
fn filtered(
    volume: &ReferenceVolume,
    scene: &ResolvedScene,
    slice: &SlicePlane,
) -> Option<(FilteredSlice, Option<SliceColors>)> {
    let filter = slice.filter?;
    let dims = Dims(volume.dims.map(|n| n as u64));
    let grid = TexelGrid::new(slice, &volume.geometry, dims, &scene.clip, [1; 3]);
    let to_index = ToIndex::new(&volume.geometry);
    let value = |p: DVec3| single(interpolate(to_index.point(p), slice.interpolation, |index| volume.voxel(index)));
    let made = FilteredSlice::new(grid, grid.points(0..grid.texels()).map(value).collect(), filter, 0.0);
    let colors = slice.colors.is_none().then(|| SliceColors::Values(made.colors(filter.kind)));
    Some((made, colors))
}

/// A coordinate of a piece's end: snapped to the plane of voxels that it lies on up to rounding.
fn on_plane(x: f64) -> f64 {
    let plane = x.round();
    if (x - plane).abs() <= END_INSET.max(8.0 * f64::EPSILON * x.abs()) { plane } else { x }
}

/// Adds the positions at which a function crosses some levels. Its extremes are searched first: it is monotone between
/// them, so no crossing is missed where it only grazes a level.
fn add_crossings(
    ends: [f64; 2],
    at: impl Fn(f64) -> f64,
    levels: impl IntoIterator<Item = f64>,
    crossings: &mut Vec<f64>,
) {
    let mut grid: Vec<(f64, f64)> = search_grid(ends).0.into_iter().map(|t| (t, at(t))).collect();
    for i in 1..SEARCH_SAMPLES {
        let (before, after) = (grid[i].1 - grid[i - 1].1, grid[i + 1].1 - grid[i].1);
        if before * after < 0.0 {
            let sign = before.signum();
            let t = peak(grid[i - 1].0, grid[i + 1].0, |t| sign * at(t));
            grid.push((t, at(t)));
        }
    }
    grid.sort_by(|a, b| a.0.total_cmp(&b.0));
    for level in levels {
        for pair in grid.windows(2) {
            let before = pair[0].1 >= level;
            if before != (pair[1].1 >= level) {
                crossings.push(bisect(pair[0].0, pair[1].0, |t| (at(t) >= level) == before));
            }
        }
    }
}

/// Position of the greatest value of a function with one maximum between `low` and `high`.
fn peak(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..60 {
        let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
        if f(a) < f(b) { low = a } else { high = b }
    }
    0.5 * (low + high)
}

/// The end of the part of `low..high` in which `holds` is true; the part begins at `low`.
fn bisect(mut low: f64, mut high: f64, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    high
}

/// Trilinear interpolation of a cell's corners at fractions of it; `None` if a corner of non-zero weight is absent. Equal
/// corners give exactly their value.
fn interpolated(corners: &[f64; 8], [x, y, z]: [f64; 3]) -> Option<f64> {
    let between = |a: f64, b: f64, x: f64| {
        // A corner without weight may be absent.
        if x == 0.0 {
            a
        } else if x == 1.0 {
            b
        } else {
            a + x * (b - a)
        }
    };
    let [a, b, c, d] = [0, 2, 4, 6].map(|i| between(corners[i], corners[i + 1], x));
    let value = between(between(a, b, y), between(c, d, y), z);
    (!value.is_nan()).then_some(value)
}

/// The colour after two-sided shading (Blinn-Phong, RENDERING-MODEL, section 5), not cut off at 1. Gradients below the
/// floor are not shaded. Vectors are world vectors, `to_eye` is a unit vector.
fn unlimited_light(shading: &Shading, color: DVec3, gradient: DVec3, floor: f64, to_eye: DVec3) -> DVec3 {
    let length = gradient.length();
    if length == 0.0 || length < floor {
        return color;
    }
    let normal = gradient / -length;
    let mut diffuse = shading.ambient;
    let mut specular = 0.0;
    for light in &shading.lights {
        let half = (light.to_light + to_eye).normalize_or_zero();
        diffuse += shading.diffuse * normal.dot(light.to_light).abs() * light.intensity;
        specular += shading.specular * normal.dot(half).abs().powf(shading.shininess) * light.intensity;
    }
    color * diffuse + DVec3::splat(specular)
}

/// A segment cut at every t at which an index coordinate is an integer.
fn pieces_of(ray: &IndexRay, segment: Segment) -> Vec<[f64; 2]> {
    let mut ends = vec![segment.t0, segment.t1];
    for axis in 0..3 {
        let (a, b) = (ray.at(segment.t0)[axis], ray.at(segment.t1)[axis]);
        let (low, high) = (whole::<i64>(a.min(b).floor()), whole::<i64>(a.max(b).ceil()));
        for plane in low..=high {
            let t = (plane as f64 - ray.origin[axis]) / ray.direction[axis];
            if t > segment.t0 && t < segment.t1 {
                ends.push(t);
            }
        }
    }
    ends.sort_by(f64::total_cmp);
    ends.dedup();
    ends.windows(2).map(|end| [end[0], end[1]]).collect()
}

/// A piece without its ends, where rounding could choose the neighbouring cell.
fn inset([t0, t1]: [f64; 2]) -> [f64; 2] {
    [t0 + END_INSET * (t1 - t0), t1 - END_INSET * (t1 - t0)]
}

/// Positions from end to end, and the distance between them.
fn search_grid([first, last]: [f64; 2]) -> (Vec<f64>, f64) {
    let step = (last - first) / SEARCH_SAMPLES as f64;
    ((0..=SEARCH_SAMPLES).map(|i| if i == SEARCH_SAMPLES { last } else { first + i as f64 * step }).collect(), step)
}
