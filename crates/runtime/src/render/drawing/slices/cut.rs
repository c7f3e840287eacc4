//! Rays, and the slices that cut them into parts.

use std::collections::BTreeSet;
use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;
use supervol_format::{Container, Dims};
use supervol_scene::camera::{PixelRays, Projection};
use supervol_scene::clip::{ClipPlane, ToIndex, clip_ray};
use supervol_scene::scene::ResolvedScene;
use supervol_scene::slices::{SLICE_LIMIT, SlicePlane, crossings};
use supervol_scene::units::InUnits;

/// Least length of a part of a ray, as a share of it. Shorter parts, between two slices in one place, are ignored.
const LEAST_PART: f64 = 1e-12;

/// A region's side of each slice: bit `i` is set on the side that the normal of slice `i` points to.
pub(super) type Sides = u16;
const _: () = assert!(SLICE_LIMIT <= Sides::BITS as usize);

/// A part of a ray, front to back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RayPart {
    Volume(Sides),
    /// Slice number, and position on the ray.
    Slice(usize, f64),
}

/// Rays, and the slices that cut them.
pub(super) struct Cut {
    rays: PixelRays,
    pub(super) to_index: ToIndex,
    pub(super) dims: Dims,
    pub(super) scene: ResolvedScene,
}

impl Cut {
    /// The rays of a scene.
    pub(super) fn new(scene: &ResolvedScene, container: &Container) -> Self {
        Self {
            rays: scene.camera.rays(),
            to_index: ToIndex::new(&InUnits::of(container).geometry),
            dims: container.descriptor().dims(),
            scene: scene.clone(),
        }
    }

    /// Number of rays along x and y.
    pub(super) fn rays_size(&self) -> [u32; 2] {
        [self.scene.camera.width, self.scene.camera.height]
    }

    /// The parts of a ray, front to back.
    pub(super) fn parts(&self, x: u32, y: u32) -> Vec<RayPart> {
        let ray = self.rays.ray(x, y);
        let Some(segment) = clip_ray(&ray, &self.to_index.ray(&ray), self.dims, &self.scene.clip) else {
            return Vec::new();
        };
        let slices = &self.scene.slices;
        let least = LEAST_PART * (segment.t1 - segment.t0);
        let mut parts = Vec::with_capacity(2 * slices.len() + 1);
        let mut before = segment.t0;
        let volume = |from: f64, to: f64| {
            let middle = ray.origin + 0.5 * (from + to) * ray.direction;
            (to - from > least).then(|| RayPart::Volume(sides_of(slices, middle)))
        };
        for (t, number) in crossings(slices, &ray, segment) {
            parts.extend(volume(before, t));
            let point = ray.origin + t * ray.direction;
            if self.scene.clip.solids.iter().all(|solid| solid.keeps(point)) {
                parts.push(RayPart::Slice(number, t));
            }
            before = t;
        }
        parts.extend(volume(before, segment.t1));
        parts
    }

    /// The regions that rays cross, and the rays that meet each slice.
    pub(super) fn met(&self) -> (BTreeSet<Sides>, [Spans; SLICE_LIMIT]) {
        let [width, height] = self.rays_size();
        let row = |y: u32| {
            let mut met = BTreeSet::new();
            let mut ends = [(width, 0, f64::INFINITY); SLICE_LIMIT];
            for x in 0..width {
                for part in self.parts(x, y) {
                    match part {
                        RayPart::Volume(sides) => drop(met.insert(sides)),
                        RayPart::Slice(number, t) => {
                            let (first, end, nearest) = ends[number];
                            ends[number] = (first.min(x), end.max(x + 1), nearest.min(t));
                        }
                    }
                }
            }
            (met, ends)
        };
        let rows: Vec<_> = (0..height).into_par_iter().map(row).collect();
        let spans = std::array::from_fn(|number| Spans::new(rows.iter().map(|(_, ends)| ends[number])));
        (rows.into_iter().flat_map(|(met, _)| met).collect(), spans)
    }

    /// These regions in an order in which each ray crosses them. A ray crosses a slice at most once, away from the side
    /// that it begins on. So a region comes after those that fewer slices separate from the rays' beginnings.
    pub(super) fn front_to_back(&self, regions: BTreeSet<Sides>) -> Vec<Sides> {
        let camera = &self.scene.camera;
        let begins_before = |slice: &SlicePlane| match camera.projection {
            Projection::Perspective { .. } => slice.is_before(camera.eye),
            Projection::Orthographic { .. } => slice.normal.dot(camera.forward) < 0.0,
        };
        let begin: Sides =
            self.scene.slices.iter().enumerate().map(|(i, slice)| Sides::from(begins_before(slice)) << i).sum();
        let mut regions: Vec<Sides> = regions.into_iter().collect();
        regions.sort_by_key(|sides| (sides ^ begin).count_ones());
        regions
    }

    /// The scene of one region, with a pixel for each ray.
    pub(super) fn region(&self, sides: Sides) -> ResolvedScene {
        let mut scene =
            ResolvedScene { image_size: self.rays_size(), subgrid: 1, slices: Vec::new(), ..self.scene.clone() };
        scene.clip.planes.extend(self.scene.slices.iter().enumerate().map(|(i, slice)| {
            let side = if sides >> i & 1 == 1 { 1.0 } else { -1.0 };
            ClipPlane { normal: side * slice.normal, offset: side * slice.offset }
        }));
        scene
    }

    /// The point at which a ray meets a slice.
    pub(super) fn point_on(&self, number: usize, x: u32, y: u32) -> Option<DVec3> {
        let at = self.parts(x, y).into_iter().find_map(|part| match part {
            RayPart::Slice(of, t) if of == number => Some(t),
            _ => None,
        })?;
        let ray = self.rays.ray(x, y);
        Some(ray.origin + at * ray.direction)
    }
}

/// The sides of the slices at a point.
fn sides_of(slices: &[SlicePlane], p: DVec3) -> Sides {
    slices.iter().enumerate().map(|(i, slice)| Sides::from(slice.is_before(p)) << i).sum()
}

/// The rays that meet a slice: from the first to the last one of each row.
#[derive(Debug)]
pub(super) struct Spans {
    /// First ray, end, and number of rays in the rows above, for each row.
    rows: Vec<(u32, u32, usize)>,
    rays: usize,
    /// Least distance of the slice.
    pub(super) nearest: f64,
}

impl Spans {
    /// From the first ray, the end and the least distance of each row.
    fn new(ends: impl Iterator<Item = (u32, u32, f64)>) -> Self {
        let (mut rows, mut rays, mut nearest) = (Vec::new(), 0, f64::INFINITY);
        for (first, end, distance) in ends {
            rows.push((first, end, rays));
            rays += end.saturating_sub(first) as usize;
            nearest = nearest.min(distance);
        }
        Self { rows, rays, nearest }
    }

    /// Number of rays.
    pub(super) fn rays(&self) -> usize {
        self.rays
    }

    /// Number of a ray, if it lies within.
    pub(super) fn at(&self, x: u32, y: u32) -> Option<usize> {
        let (first, end, above) = self.rows[y as usize];
        (first..end).contains(&x).then(|| above + (x - first) as usize)
    }

    /// The rays of a row.
    pub(super) fn row(&self, y: usize) -> Range<u32> {
        let (first, end, _) = self.rows[y];
        first..end
    }

    /// Numbers of the rays of some rows.
    pub(super) fn of_rows(&self, rows: Range<usize>) -> Range<usize> {
        let above = |y: usize| self.rows.get(y).map_or(self.rays, |(_, _, above)| *above);
        above(rows.start)..above(rows.end)
    }
}
