//! The ray caster in Rust.
//!
//! It integrates trilinear cells, not steps (docs/ARCHITECTURE.md, "How a ray is integrated"), in passes:
//! 1. [`CpuFrame::begin`] makes one [`RayState`] per ray.
//! 2. [`cast_pass`] takes every unfinished ray as far as resident bricks allow. A ray that needs a brick that is not
//!    resident keeps its place and the brick's key; the pass returns all such keys.
//! 3. The caller makes some of them resident and casts the next pass, until no ray waits.
//! 4. [`CpuFrame::image`] makes the picture of the states, at any time.
//!
//! The picture depends neither on the number of threads, nor on which bricks came when, nor on the size of bricks: to
//! the last bit. Crossings and cubics are `f64`, values and colours `f32`; a ray gathers in `f64`.

pub mod cell;
pub(crate) mod march;
pub mod modes;
pub mod quadrature;
pub mod shade;
pub mod walk;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;
use supervol_format::{BrickKey, Geometry, Lod, Pyramid, ValueRange};

pub use modes::{IsoSides, TERMINATION_OPACITY};

use super::comparison;
use super::method::{CellRule, Method, Pairs};
use super::volume::{BrickView, ValueMap};
use crate::camera::{Camera, Ray};
use crate::clip::{Clip, IndexRay, Segment, clip_ray};
use crate::image::Image;
use crate::lod::{LodChoice, LodRule};
use crate::scene::{Mode, ResolvedScene};
use crate::transfer_function::RenderTransferFunction;
use shade::Lighting;

/// Rays that one task casts; neighbours, so that they visit the same bricks.
const BLOCK_RAYS: usize = 256;

/// Whether macro cells that cannot change the picture are skipped. The picture is the same to the last bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Skipping {
    /// They are skipped.
    #[default]
    On,
    /// They are walked cell by cell: for tests.
    Off,
}

/// One iso surface in render values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IsoSurface {
    /// Render value.
    pub value: f32,
    /// Colour.
    pub color: [f32; 3],
    /// Opacity.
    pub alpha: f32,
}

/// Everything about a picture that is the same for all its rays.
#[derive(Debug, Clone)]
pub struct CpuFrame {
    pub(crate) pyramid: Pyramid,
    pub(crate) geometry: Geometry,
    pub(crate) camera: Camera,
    subgrid: u32,
    /// Rows of rays that are cast; the whole picture unless [`CpuFrame::band`] says otherwise.
    rows: Range<u32>,
    clip: Clip,
    pub(crate) mode: Mode,
    pub(crate) transfer_function: RenderTransferFunction,
    pub(crate) lighting: Option<Lighting>,
    pub(crate) iso: Vec<IsoSurface>,
    pub(crate) map: ValueMap,
    pub(crate) lod: LodRule,
    /// The level at which the search for a brick begins.
    pub(crate) first_lod: Lod,
    pub(crate) skipping: Skipping,
    pub(crate) method: Method,
    /// Gauss pairs of the cell method.
    pub(crate) pairs: Pairs,
    /// What a method of comparison looks up; `None` for the cell method.
    comparison: Option<Arc<comparison::Tables>>,
}

/// One ray between passes.
#[derive(Debug, Clone, PartialEq)]
pub struct RayState {
    /// Where the ray goes on, world length; always at a brick's entry.
    pub t: f64,
    /// Where its segment ends.
    pub t_end: f64,
    /// Premultiplied colour gathered so far (`dvr`, `iso`).
    pub color: [f64; 3],
    /// Share of light from behind that still gets through, from 1 to 0.
    pub transmittance: f64,
    /// `mip`, `minip`: the extreme so far; `mean`: the integral so far; NaN before the first present value.
    pub value: f64,
    /// `mean`: present world length so far.
    pub length: f64,
    /// `iso`: sides and hits.
    pub iso: IsoSides,
    /// The brick that the ray waits for.
    pub waiting: Option<BrickKey>,
    /// Nothing is left to do.
    pub finished: bool,
}

/// What one pass did; sums over its rays.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bricks entered by rays.
    pub bricks: u64,
    /// Macro cells walked cell by cell.
    pub macro_cells: u64,
    /// Macro cells skipped.
    pub macro_cells_skipped: u64,
    /// Trilinear cells crossed.
    pub cells: u64,
    /// Values classified along chords (`dvr`).
    pub samples: u64,
    /// Times a failed brick's parent stood in.
    pub parent_bricks: u64,
    /// Rays that this pass finished.
    pub rays_finished: u64,
    /// Times a ray stopped at a brick that is not resident; in one pass: rays that wait.
    pub rays_waiting: u64,
}

/// A brick that rays wait for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Miss {
    /// The brick.
    pub key: BrickKey,
    /// Rays that wait for it.
    pub rays: u64,
    /// Least world length from a ray's origin to it.
    pub nearest: f64,
}

/// What a pass tells its caller.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PassFeedback {
    /// Bricks that rays wait for, nearest first.
    pub misses: Vec<Miss>,
    /// Bricks that rays read, in key order.
    pub uses: Vec<BrickKey>,
    /// Sums over the pass.
    pub counters: Counters,
}

impl PassFeedback {
    /// Whether every ray is finished.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.misses.is_empty()
    }
}

impl CpuFrame {
    /// The frame of a scene over one container: its levels, its place in the world, its values.
    ///
    /// `value_range` is that of the whole volume, data units.
    #[must_use]
    pub fn new(
        scene: &ResolvedScene,
        pyramid: &Pyramid,
        geometry: &Geometry,
        map: ValueMap,
        value_range: ValueRange,
        quality: CpuQuality,
    ) -> Self {
        let coarsest = pyramid.coarsest();
        let first_lod = match quality.lod {
            LodChoice::Fixed(lod) => lod.min(coarsest),
            LodChoice::Auto { .. } => coarsest,
        };
        Self {
            pyramid: pyramid.clone(),
            geometry: *geometry,
            camera: scene.camera,
            subgrid: scene.subgrid,
            rows: 0..scene.camera.height,
            clip: scene.clip.clone(),
            mode: scene.mode,
            transfer_function: RenderTransferFunction::new(&scene.transfer_function, map.shift),
            lighting: scene.shading.as_ref().map(|s| Lighting::new(s, geometry, value_range.width())),
            iso: scene
                .iso
                .iter()
                .map(|s| IsoSurface {
                    value: map.from_data(s.value),
                    color: s.color.map(|c| c as f32),
                    alpha: s.alpha as f32,
                })
                .collect(),
            map,
            lod: LodRule::new(quality.lod, &scene.camera, geometry),
            first_lod,
            skipping: quality.skipping,
            method: quality.method,
            pairs: match quality.method {
                Method::Cells(rule) => rule.pairs,
                Method::Sampled(_) => CellRule::DEFAULT.pairs,
            },
            comparison: match quality.method {
                Method::Cells(_) => None,
                Method::Sampled(sampling) => Some(Arc::new(comparison::Tables::new(sampling, scene, geometry))),
            },
        }
    }

    /// The same frame for some rows of pixels only, numbered from the top: its picture is that band of the picture.
    ///
    /// # Panics
    /// If the picture has no such rows.
    #[must_use]
    pub fn band(&self, pixel_rows: Range<u32>) -> Self {
        let rows = pixel_rows.start * self.subgrid..pixel_rows.end * self.subgrid;
        assert!(rows.end <= self.camera.height, "pixel rows {pixel_rows:?} of {} rows of rays", self.camera.height);
        Self { rows, ..self.clone() }
    }

    /// The states of all rays before the first pass, row by row from the top.
    #[must_use]
    pub fn begin(&self) -> Vec<RayState> {
        let width = self.camera.width;
        let rays = self.rows.clone().into_par_iter().flat_map_iter(|y| (0..width).map(move |x| self.camera.ray(x, y)));
        rays.map(|ray| {
            let segment = self.segment(&ray);
            RayState {
                t: segment.map_or(0.0, |s| s.t0),
                t_end: segment.map_or(0.0, |s| s.t1),
                color: [0.0; 3],
                transmittance: 1.0,
                value: f64::NAN,
                length: 0.0,
                iso: IsoSides::default(),
                waiting: None,
                finished: segment.is_none(),
            }
        })
        .collect()
    }

    /// The picture of what the rays have gathered, sub-grid averaged.
    ///
    /// # Panics
    /// If the states are not this frame's.
    #[must_use]
    pub fn image(&self, states: &[RayState]) -> Image {
        let (width, height) = (self.camera.width, self.rows.len() as u32);
        assert_eq!(states.len(), width as usize * height as usize, "states of another frame");
        let pixels = states.iter().map(|state| self.pixel(state)).collect();
        Image { width, height, pixels }.downsampled(self.subgrid)
    }

    fn pixel(&self, state: &RayState) -> [f32; 4] {
        let value = match self.mode {
            Mode::Dvr | Mode::Iso | Mode::Slice => {
                let [r, g, b] = state.color;
                return [r, g, b, 1.0 - state.transmittance].map(|v| v as f32);
            }
            Mode::Mip | Mode::Minip => state.value,
            Mode::Mean => state.value / state.length,
        };
        if value.is_nan() {
            return [0.0; 4];
        }
        let [r, g, b, alpha] = self.transfer_function.classify(value as f32);
        [r * alpha, g * alpha, b * alpha, alpha]
    }
}

impl CpuFrame {
    /// Casts one ray by the frame's method; `pixel` counts rays, not pixels of a supersampled picture.
    fn cast_ray<V: BrickView + ?Sized>(
        &self,
        view: &V,
        pixel: [u32; 2],
        state: &mut RayState,
        feedback: &mut BlockFeedback,
    ) {
        let ray = self.camera.ray(pixel[0], pixel[1]);
        match &self.comparison {
            Some(tables) if self.mode == Mode::Dvr => {
                let segment = self.segment(&ray).expect("a ray without a segment is finished before it is cast");
                let integrator = comparison::SampledRay::new(tables, segment, pixel);
                march::cast_ray(view, self, &ray, &integrator, state, feedback);
            }
            _ => march::cast_ray(view, self, &ray, &march::CellByCell, state, feedback),
        }
    }

    /// The part of a ray that is drawn.
    fn segment(&self, ray: &Ray) -> Option<Segment> {
        let dims = self.pyramid.level_at(Lod::FINEST).dims;
        clip_ray(ray, &IndexRay::new(ray, &self.geometry), dims, &self.clip)
    }
}

/// How much work a frame may save, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CpuQuality {
    /// Which level bricks are taken from.
    pub lod: LodChoice,
    /// Whether macro cells are skipped.
    pub skipping: Skipping,
    /// How rays are integrated.
    pub method: Method,
}

impl Default for CpuQuality {
    fn default() -> Self {
        Self { lod: LodChoice::Auto { voxel_pixels: 1.0 }, skipping: Skipping::On, method: Method::default() }
    }
}

/// What one block of rays reports.
#[derive(Default)]
pub(crate) struct BlockFeedback {
    pub(crate) misses: BTreeMap<BrickKey, (u64, f64)>,
    pub(crate) uses: BTreeSet<BrickKey>,
    pub(crate) counters: Counters,
}

/// Casts every unfinished ray as far as resident bricks allow.
///
/// # Panics
/// If the states are not this frame's, or a brick's size is not what the pyramid says.
pub fn cast_pass<V: BrickView + ?Sized>(view: &V, frame: &CpuFrame, states: &mut [RayState]) -> PassFeedback {
    let width = frame.camera.width as usize;
    assert_eq!(states.len(), width * frame.rows.len(), "states of another frame");
    let blocks: Vec<BlockFeedback> = states
        .par_chunks_mut(BLOCK_RAYS)
        .enumerate()
        .map(|(block, states)| {
            let mut feedback = BlockFeedback::default();
            for (i, state) in states.iter_mut().enumerate().filter(|(_, state)| !state.finished) {
                let pixel = block * BLOCK_RAYS + i;
                let pixel = [(pixel % width) as u32, frame.rows.start + (pixel / width) as u32];
                frame.cast_ray(view, pixel, state, &mut feedback);
            }
            feedback
        })
        .collect();
    merge(blocks)
}

/// Sums and unions: independent of how the blocks were dealt out.
fn merge(blocks: Vec<BlockFeedback>) -> PassFeedback {
    let mut misses: BTreeMap<BrickKey, (u64, f64)> = BTreeMap::new();
    let mut uses = BTreeSet::new();
    let mut counters = Counters::default();
    for block in blocks {
        for (key, (rays, nearest)) in block.misses {
            let entry = misses.entry(key).or_insert((0, f64::INFINITY));
            *entry = (entry.0 + rays, entry.1.min(nearest));
        }
        uses.extend(block.uses);
        counters.add(&block.counters);
    }
    let mut misses: Vec<Miss> = misses.into_iter().map(|(key, (rays, nearest))| Miss { key, rays, nearest }).collect();
    misses.sort_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.key.cmp(&b.key)));
    PassFeedback { misses, uses: uses.into_iter().collect(), counters }
}

impl Counters {
    /// Adds another pass or block.
    pub fn add(&mut self, other: &Self) {
        self.bricks += other.bricks;
        self.macro_cells += other.macro_cells;
        self.macro_cells_skipped += other.macro_cells_skipped;
        self.cells += other.cells;
        self.samples += other.samples;
        self.parent_bricks += other.parent_bricks;
        self.rays_finished += other.rays_finished;
        self.rays_waiting += other.rays_waiting;
    }
}
