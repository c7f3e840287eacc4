//! Rays in several parts, for the GPU: solids cut them ([`supervol_scene::clip::clip_parts`]).
//!
//! The parts are computed here, in `f64` and by the same functions as for the CPU's rays, meshes included. The shader
//! receives begin and end of each part. All rays of a band cast their first part, then those with a second part cast
//! that, and so on, like tiles on the CPU (docs/decisions/022-solids-and-picking.md). Parts are computed when their
//! turn comes; only the list of rays with another part is kept.

use rayon::prelude::*;
use supervol_format::cast::narrow;
use supervol_format::{Dims, Geometry};
use supervol_scene::camera::{Camera, PixelRays};
use supervol_scene::clip::{Clip, ToIndex, clip_parts};

use super::layout::RayPart;
use super::rays::{RayGrid, ViewLines};

/// The rays of a picture, and the solids that cut them.
#[derive(Debug)]
pub struct RayParts {
    rays: PixelRays,
    size: [u32; 2],
    to_index: ToIndex,
    dims: Dims,
    clip: Clip,
    lines: ViewLines,
}

/// The current part of each ray, and the rays that have another part behind it.
#[derive(Debug, Default)]
pub struct CurrentParts {
    /// In the order of their places.
    pub parts: Vec<RayPart>,
    /// Their places.
    pub more: Vec<u32>,
}

impl RayParts {
    /// Parts of the rays of this camera; `None` without solids.
    #[must_use]
    pub fn new(camera: &Camera, geometry: &Geometry, dims: Dims, clip: &Clip) -> Option<Self> {
        (!clip.solids.is_empty()).then(|| Self {
            rays: camera.rays(),
            size: [camera.width, camera.height],
            to_index: ToIndex::new(geometry),
            dims,
            clip: clip.clone(),
            lines: ViewLines::new(camera, geometry, dims),
        })
    }

    /// The first parts of all rays of a band that begins in this row.
    #[must_use]
    pub fn first(&self, grid: RayGrid, first_row: u32) -> CurrentParts {
        let places: Vec<u32> = (0..narrow::<u32>(grid.places())).collect();
        self.current(grid, first_row, &places, 0)
    }

    /// Part number `number` of the rays at these places.
    #[must_use]
    pub fn current(&self, grid: RayGrid, first_row: u32, places: &[u32], number: usize) -> CurrentParts {
        let found: Vec<(RayPart, bool)> =
            places.par_iter().filter_map(|&place| self.part(grid, first_row, place, number)).collect();
        let more = found.iter().filter(|(_, has_more)| *has_more).map(|(part, _)| part.place).collect();
        CurrentParts { parts: found.into_iter().map(|(part, _)| part).collect(), more }
    }

    /// A part of the ray at a place, and whether there is another behind it.
    fn part(&self, grid: RayGrid, first_row: u32, place: u32, number: usize) -> Option<(RayPart, bool)> {
        let [x, row] = grid.pixel(u64::from(place));
        let y = first_row + row;
        if x >= self.size[0] || row >= grid.height {
            return None;
        }
        let ray = self.rays.ray(x, y);
        let parts = clip_parts(&ray, &self.to_index.ray(&ray), self.dims, &self.clip);
        let segment = parts.get(number)?;
        let [(strides, t), (end_strides, end_rest)] =
            [segment.t0, segment.t1].map(|t| self.lines.strides_to(&ray, [x, y], t));
        Some((RayPart { place, t, strides, end_strides, end_rest }, parts.len() > number + 1))
    }
}
