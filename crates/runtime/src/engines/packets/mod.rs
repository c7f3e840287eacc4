//! Frames and passes on the CPU, and the caster that takes rays in packets.
//!
//! Trilinear cells are integrated, not steps (docs/ARCHITECTURE.md, "How a ray is integrated"), in passes:
//! 1. [`CpuFrame::begin`] makes the rays: tiles for packets, one [`RayState`] per ray where they are cast one by one.
//! 2. [`cast_pass`] takes every unfinished ray as far as resident bricks allow. A ray that needs a brick that is not
//!    resident keeps its place and the brick's key; the pass returns all such keys.
//! 3. The caller makes some of them resident and casts the next pass, until no ray waits.
//! 4. [`CpuFrame::image`] makes the picture of the rays, at any time.
//!
//! The picture depends neither on the number of threads, nor on which bricks came when, nor on skipping: to the last bit. On
//! the size of bricks it depends where packets cast, by less than shows (docs/decisions/006-packets.md).
//!
//! Packets, in the order of the data: `tile` (rays) and `order` (bricks), `packets` (their passes), `plans`, `blocks`
//! and `leap` (what shows nothing), `walk` (`trace`: for who checks it), `fetch`;
//! then in `dvr` `packet`, `lookup` and `integrate` (one cell), `shade`, `queue` and `refine` (cells that are not settled by
//! that), and in the other modes `value_tiles` (bricks), `values` (`mip`, `minip`, `mean`), `surfaces` (`iso`). What packets are
//! compared with goes ray by ray through [`scalar`].

#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod begin;
pub mod blocks;
mod cast;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod fetch;
mod inner_surfaces;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod integrate;
pub mod leap;
pub mod levels;
mod lookup;
mod order;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod packet;
mod parts;
mod pending;
mod per_brick;
mod pixels;
pub mod plans;
mod quality;
mod queue;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod refine;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod shade;
mod shaded_cells;
mod silhouette;
pub mod simd;
mod span;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod surfaces;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod tile;
pub mod trace;
mod turning;
mod value_tiles;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
mod values;
#[allow(clippy::needless_range_loop, reason = "axes and channels are indices of several arrays at once")]
pub(crate) mod walk;
pub mod work;

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;
use supervol_format::{BrickKey, Geometry, Lod, Pyramid, ValueRange};
use supervol_scene::camera::{Camera, Ray};
use supervol_scene::clip::{Clip, IndexRay, Segment, clip_parts};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::transfer_function::RenderTransferFunction;
use supervol_scene::value_map::ValueMap;

use crate::engines::cells;
use crate::engines::cells::Integrator;
use crate::engines::cells::shade::Lighting;
use crate::engines::packets::cast::{PacketTables, cast_tiles, tiles_of};
use crate::engines::rules::TERMINATION_OPACITY;
use crate::engines::totals::EngineErrors;
use crate::lod::deviation::Deviations;
use crate::lod::{LodChoice, LodRule};
use crate::stop::Stop;
use crate::stream::classify::Skipping;
use crate::stream::counters::RayCounters;
use crate::stream::field::Field;
use crate::stream::residency::{BrickView, KnownEntry, Resident};
use levels::ErrorsByReason;
use pixels::{Tile, error_pixels_of, pixels_of, work_pixels_of};
pub use plans::{BrickPlans, Made};
pub use quality::{Caster, CpuQuality, PacketRule};
use simd::InstructionSet;

/// Rays that one task casts; neighbours, so that they visit the same bricks.
const BLOCK_RAYS: usize = 256;

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
    /// The field that is drawn: what is kept of its bricks is not another's.
    pub(crate) field: Field,
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
    /// In mode `dvr` with surfaces: the frame of these, in mode `iso`, which lists all crossings and adds none.
    pub(crate) inner: Option<Arc<CpuFrame>>,
    /// Whether crossings are listed, all of them, and not composited.
    pub(crate) lists_crossings: bool,
    pub(crate) map: ValueMap,
    pub(crate) lod: LodRule,
    /// The level at which the search for a brick begins.
    pub(crate) first_lod: Lod,
    pub(crate) skipping: Skipping,
    /// What rays do where something may show.
    pub(crate) integrator: Arc<dyn Integrator>,
    /// Opacity at which a ray ends in mode `dvr`.
    termination_opacity: f64,
    /// What packets look up; `None` where rays are cast one by one.
    packets: Option<Arc<PacketTables>>,
    /// What coarser levels do, where errors are summed up.
    deviations: Option<Arc<Deviations>>,
    /// When packets stop where they are.
    stop: Stop,
    /// Rays that packets have finished, where somebody counts them.
    finished: Option<Arc<AtomicU64>>,
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
    /// Where it has met surfaces, in order, of frames that list them; with `t` as the begin of the present cell.
    pub crossings: Vec<SurfaceCrossing>,
    /// The brick that the ray waits for.
    pub waiting: Option<BrickKey>,
    /// Nothing is left to do.
    pub finished: bool,
}

impl RayState {
    /// A ray before its first pass; finished where there is no segment.
    #[must_use]
    pub fn new(segment: Option<Segment>) -> Self {
        Self {
            t: segment.map_or(0.0, |s| s.t0),
            t_end: segment.map_or(0.0, |s| s.t1),
            color: [0.0; 3],
            transmittance: 1.0,
            value: f64::NAN,
            length: 0.0,
            iso: IsoSides::default(),
            crossings: Vec::new(),
            waiting: None,
            finished: segment.is_none(),
        }
    }
}

/// Where a ray meets a surface, and what that looks like.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceCrossing {
    /// World length along the ray.
    pub t: f64,
    /// Colour after shading, premultiplied.
    pub color: [f32; 3],
    /// Opacity.
    pub alpha: f32,
}

/// Which side of each iso value the ray is on, one bit per surface.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct IsoSides {
    /// The side is known: the ray comes out of a present cell.
    pub known: u32,
    /// The value was not less than the iso value.
    pub above: u32,
    /// The surface has been met.
    pub hit: u32,
}

impl IsoSides {
    /// Notes that the ray passes values from `low` to `high`, or none where these are empty; false, and nothing is noted,
    /// where it meets one of the surfaces' values there that it has not met yet, or has jumped across one.
    #[inline]
    pub(crate) fn pass(&mut self, [low, high]: [f32; 2], surfaces: impl Iterator<Item = f32>) -> bool {
        if low > high {
            self.known = 0;
            return true;
        }
        let mut above = 0;
        for (i, surface) in surfaces.enumerate() {
            if low < surface && surface <= high && self.hit >> i & 1 == 0 {
                return false;
            }
            above |= u32::from(low >= surface) << i;
        }
        if self.known & !self.hit & (self.above ^ above) != 0 {
            return false;
        }
        (self.above, self.known) = (above, u32::MAX);
        true
    }
}

/// The rays of a frame between passes.
#[derive(Debug, Clone)]
pub enum Rays {
    /// One by one, row by row from the top.
    Scalar(Vec<RayState>),
    /// In tiles, for the packet caster.
    Tiles(Vec<Tile>),
}

impl Default for Rays {
    fn default() -> Self {
        Self::Scalar(Vec::new())
    }
}

impl Rays {
    /// The rays one by one, row by row from the top, where they are cast one by one; else none.
    #[must_use]
    pub fn states(&self) -> &[RayState] {
        match self {
            Self::Scalar(states) => states,
            Self::Tiles(_) => &[],
        }
    }

    /// See [`Rays::states`].
    pub fn states_mut(&mut self) -> &mut [RayState] {
        match self {
            Self::Scalar(states) => states,
            Self::Tiles(_) => &mut [],
        }
    }

    /// Rays that wait for a brick.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        match self {
            Self::Scalar(states) => states.iter().filter(|s| s.waiting.is_some()).count() as u64,
            Self::Tiles(tiles) => tiles.iter().map(Tile::waiting).sum(),
        }
    }

    /// Whether every ray is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        match self {
            Self::Scalar(states) => states.iter().all(|s| s.finished),
            Self::Tiles(tiles) => tiles.iter().all(|tile| matches!(tile, Tile::Finished(_))),
        }
    }

    /// What rays in packets may be off by at most, where that is summed up.
    #[must_use]
    pub fn errors(&self) -> ErrorsByReason {
        let Self::Tiles(tiles) = self else { return ErrorsByReason::default() };
        let errors = tiles.iter().filter_map(Tile::errors);
        errors.fold(ErrorsByReason::default(), |greatest, tile| greatest.or(tile.greatest))
    }

    /// Rays that ended before they left the volume.
    #[must_use]
    pub fn terminated_early(&self) -> u64 {
        match self {
            Self::Scalar(states) => states.iter().filter(|s| s.finished && s.t < s.t_end).count() as u64,
            Self::Tiles(tiles) => tiles.iter().map(Tile::terminated_early).sum(),
        }
    }
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
    pub counters: RayCounters,
    /// Whether it ended before some tile was finished, or waits, because it was time to stop.
    pub is_stopped: bool,
}

impl PassFeedback {
    /// Whether every ray is finished.
    #[must_use]
    pub fn is_converged(&self) -> bool {
        self.misses.is_empty() && !self.is_stopped
    }
}

impl CpuFrame {
    /// The frame of a scene over one container: its levels, its place in the world, its values.
    ///
    /// `value_range` is that of the whole volume, data units.
    ///
    /// # Panics
    /// If the scene has surfaces inside the volume (mode `dvr` with `iso`) and the caster is not [`Caster::Packets`].
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
        let mut frame = Self {
            field: Field::FIRST,
            pyramid: pyramid.clone(),
            geometry: *geometry,
            camera: scene.camera,
            subgrid: scene.subgrid,
            rows: 0..scene.camera.height,
            clip: scene.clip.clone(),
            mode: scene.mode,
            // Surfaces are met apart from what is gathered around them.
            transfer_function: RenderTransferFunction::new(&scene.transfer_function.without_surfaces(), map.shift),
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
            inner: None,
            lists_crossings: false,
            map,
            lod: LodRule::new(quality.lod, &scene.camera, geometry),
            first_lod,
            skipping: quality.skipping,
            integrator: quality.caster.integrator(scene, geometry),
            termination_opacity: quality.caster.termination_opacity(),
            packets: None,
            deviations: None,
            stop: Stop::NEVER,
            finished: None,
        };
        let mut made_bytes = quality.made_bytes;
        if scene.mode == Mode::Dvr && !scene.iso.is_empty() {
            made_bytes /= 2;
            let scene = ResolvedScene { mode: Mode::Iso, ..scene.clone() };
            let quality = CpuQuality { made_bytes, plans: None, ..quality.clone() };
            assert!(matches!(quality.caster, Caster::Packets(_)), "only packets draw surfaces inside the volume");
            let surfaces = Self::new(&scene, pyramid, geometry, map, value_range, quality);
            frame.inner = Some(Arc::new(Self { lists_crossings: true, ..surfaces }));
        }
        if let Caster::Packets(rule) = quality.caster {
            let tables = PacketTables::new(&frame, &scene.transfer_function, rule, (made_bytes, quality.plans));
            frame.packets = Some(Arc::new(tables));
        }
        frame
    }

    /// Where packets sum up errors, what these coarser levels do counts, too.
    #[must_use]
    pub fn with_deviations(self, deviations: Deviations) -> Self {
        let sums_errors = self.packets.as_ref().is_some_and(|tables| tables.sums_errors());
        Self { deviations: sums_errors.then(|| Arc::new(deviations)), ..self }
    }

    /// Packets stop when this is due: rays wait where they are, and go on from there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        self.stop = stop;
    }

    /// Packets count the rays that they finish here.
    #[must_use]
    pub fn counting(self, finished: Option<Arc<AtomicU64>>) -> Self {
        Self { finished, ..self }
    }

    pub(crate) fn count_finished(&self, rays: u64) {
        if let Some(finished) = &self.finished {
            finished.fetch_add(rays, Ordering::Relaxed);
        }
    }

    /// Whether it is time to stop.
    pub(crate) fn is_due(&self) -> bool {
        self.stop.is_due()
    }

    /// What packets have found out of bricks, for a frame of another camera; `None` where they cast none in mode `dvr`.
    #[must_use]
    pub fn plans(&self) -> Option<Arc<BrickPlans>> {
        let tables = self.packets.as_ref().filter(|_| self.mode == Mode::Dvr)?;
        Some(tables.plans.clone())
    }

    /// The same frame for some rows of pixels only, numbered from the top: its picture is that band of the picture.
    ///
    /// # Panics
    /// If the picture has no such rows.
    #[must_use]
    pub fn band(&self, pixel_rows: Range<u32>) -> Self {
        let rows = pixel_rows.start * self.subgrid..pixel_rows.end * self.subgrid;
        assert!(rows.end <= self.camera.height, "pixel rows {pixel_rows:?} of {} rows of rays", self.camera.height);
        let inner = self.inner.as_ref().map(|surfaces| Arc::new(surfaces.band(pixel_rows)));
        Self { rows, inner, ..self.clone() }
    }

    /// All rays before the first pass.
    #[must_use]
    pub fn begin(&self) -> Rays {
        if self.packets.is_some() {
            let [columns, rows] = tiles_of(self);
            return Rays::Tiles(vec![Tile::Fresh; columns as usize * rows as usize]);
        }
        Rays::Scalar(self.begin_scalar())
    }

    /// The instructions that packets are cast with; `None` where rays are cast one by one.
    #[must_use]
    pub fn instructions(&self) -> Option<InstructionSet> {
        self.packets.as_ref().map(|tables| tables.instructions())
    }

    /// What a picture may be off by whose rays are off by so much: where packets sum that up, in mode `dvr`.
    #[must_use]
    pub fn errors(&self, rays: ErrorsByReason) -> Option<EngineErrors> {
        let tables = self.packets.as_ref().filter(|tables| self.mode == Mode::Dvr && tables.sums_errors())?;
        Some(EngineErrors {
            cells: rays.cells,
            levels: rays.levels,
            ray_ends: tables.end_error(),
            transfer_function: tables.fit_error(),
            rounding: tables.rounding_error(self),
        })
    }

    /// Rays of the frame's rows.
    #[must_use]
    pub fn ray_count(&self) -> u64 {
        u64::from(self.camera.width) * self.rows.len() as u64
    }

    fn begin_scalar(&self) -> Vec<RayState> {
        let width = self.camera.width;
        let rays = self.rows.clone().into_par_iter().flat_map_iter(|y| (0..width).map(move |x| self.camera.ray(x, y)));
        let parts_of = |ray: Ray| self.parts_of(&ray, &IndexRay::new(&ray, &self.geometry));
        rays.map(|ray| RayState::new(parts_of(ray).first().copied())).collect()
    }

    /// The picture of finished tiles, sub-grid averaged: NaN elsewhere.
    ///
    /// # Panics
    /// If the states are not this frame's, or not of packets.
    #[must_use]
    pub fn finished_pixels(&self, rays: &Rays) -> Image {
        let Rays::Tiles(tiles) = rays else { panic!("rays of another frame") };
        let pixels = pixels_of(self, tiles, |_| [f32::NAN; 4]);
        Image { width: self.camera.width, height: self.rows.len() as u32, pixels }.downsampled(self.subgrid)
    }

    /// What each pixel of finished tiles may be off by, grey, 1 being white, sub-grid averaged: NaN elsewhere; `None` where
    /// that is not summed up.
    #[must_use]
    pub fn error_pixels(&self, rays: &Rays) -> Option<Image> {
        self.deviations.as_ref()?;
        let Rays::Tiles(tiles) = rays else { return None };
        let pixels = error_pixels_of(self, tiles);
        let image = Image { width: self.camera.width, height: self.rows.len() as u32, pixels };
        Some(image.downsampled(self.subgrid))
    }

    /// What the rays of each pixel of finished tiles cost, sub-grid averaged: cells, leaps, 0, 1; NaN elsewhere; `None` where that is
    /// not counted.
    #[must_use]
    pub fn work_pixels(&self, rays: &Rays) -> Option<Image> {
        let Rays::Tiles(tiles) = rays else { return None };
        self.packets.as_ref().filter(|tables| tables.counts_work())?;
        let image =
            Image { width: self.camera.width, height: self.rows.len() as u32, pixels: work_pixels_of(self, tiles) };
        Some(image.downsampled(self.subgrid))
    }

    /// The picture of what the rays have gathered, sub-grid averaged.
    ///
    /// # Panics
    /// If the states are not this frame's.
    #[must_use]
    pub fn image(&self, rays: &Rays) -> Image {
        let (width, height) = (self.camera.width, self.rows.len() as u32);
        let pixels = match rays {
            Rays::Scalar(states) => {
                assert_eq!(states.len(), width as usize * height as usize, "states of another frame");
                states.iter().map(|state| self.pixel(state)).collect()
            }
            Rays::Tiles(tiles) => pixels_of(self, tiles, |state| self.pixel(state)),
        };
        Image { width, height, pixels }.downsampled(self.subgrid)
    }

    fn pixel(&self, state: &RayState) -> [f32; 4] {
        let value = match self.mode {
            Mode::Dvr | Mode::Iso | Mode::Slice => {
                return pixel_of_light(state.color, state.transmittance);
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

/// The pixel of a ray that has gathered light: premultiplied colour and opacity.
#[inline]
fn pixel_of_light([r, g, b]: [f64; 3], transmittance: f64) -> [f32; 4] {
    [r, g, b, 1.0 - transmittance].map(|v| v as f32)
}

impl CpuFrame {
    /// Whether nothing behind can change the picture by more than the frame allows.
    #[inline]
    pub(crate) fn is_done(&self, state: &RayState) -> bool {
        match self.mode {
            Mode::Dvr => state.transmittance <= 1.0 - self.termination_opacity,
            Mode::Iso if self.lists_crossings => false,
            Mode::Iso => {
                let all_hit = state.iso.hit.count_ones() as usize == self.iso.len();
                state.transmittance <= 1.0 - TERMINATION_OPACITY || all_hit
            }
            Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => false,
        }
    }

    /// Column and row, from the top left of the whole picture, of the frame's `ray`th ray; of rays, not of pixels of a
    /// supersampled picture.
    #[inline]
    pub(crate) fn pixel_of(&self, ray: usize) -> [u32; 2] {
        let width = self.camera.width as usize;
        [(ray % width) as u32, self.rows.start + (ray / width) as u32]
    }

    /// Whether rays may be drawn in several parts.
    pub(crate) fn cuts_rays(&self) -> bool {
        !self.clip.solids.is_empty()
    }

    /// The parts of a ray that are drawn, front to back.
    pub(crate) fn parts_of(&self, ray: &Ray, index_ray: &IndexRay) -> Vec<Segment> {
        clip_parts(ray, index_ray, self.pyramid.level_at(Lod::FINEST).dims, &self.clip)
    }
}

/// What one block of rays reports.
#[derive(Default)]
pub(crate) struct BlockFeedback {
    pub(crate) misses: BTreeMap<BrickKey, (u64, f64)>,
    pub(crate) uses: BTreeSet<BrickKey>,
    pub(crate) counters: RayCounters,
    pub(crate) is_stopped: bool,
}

/// Casts every unfinished ray as far as resident bricks allow.
///
/// # Panics
/// If the states are not this frame's, or a brick's size is not what the pyramid says.
pub fn cast_pass<V: BrickView + ?Sized>(view: &V, frame: &CpuFrame, rays: &mut Rays) -> PassFeedback {
    match (rays, &frame.packets) {
        (Rays::Tiles(tiles), Some(tables)) => merge(cast_tiles(&Viewed(view), frame, tables, tiles)),
        (Rays::Scalar(states), None) => {
            assert_eq!(states.len() as u64, frame.ray_count(), "states of another frame");
            let blocks = states.par_chunks_mut(BLOCK_RAYS).enumerate();
            merge(blocks.map(|(block, states)| cast_block(view, frame, block * BLOCK_RAYS, states)).collect())
        }
        _ => panic!("rays of another frame"),
    }
}

/// A view of any kind as one that can be named: the packet caster is compiled once.
struct Viewed<'a, V: ?Sized>(&'a V);

impl<V: BrickView + ?Sized> BrickView for Viewed<'_, V> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        self.0.lookup(key)
    }

    fn stand_in(&self, key: BrickKey) -> Resident<'_> {
        self.0.stand_in(key)
    }

    fn entry(&self, key: BrickKey) -> Option<KnownEntry> {
        self.0.entry(key)
    }
}

/// Casts the unfinished ones of a block of rays, of which the first is the frame's `first`th: here rays are dealt out to
/// the caster that the frame wants.
fn cast_block<V: BrickView + ?Sized>(
    view: &V,
    frame: &CpuFrame,
    first: usize,
    states: &mut [RayState],
) -> BlockFeedback {
    let mut feedback = BlockFeedback::default();
    for (i, state) in states.iter_mut().enumerate().filter(|(_, state)| !state.finished) {
        cells::cast_ray(view, frame, frame.pixel_of(first + i), state, &mut feedback);
    }
    feedback
}

fn merge(blocks: Vec<BlockFeedback>) -> PassFeedback {
    let mut misses: BTreeMap<BrickKey, (u64, f64)> = BTreeMap::new();
    let mut uses = BTreeSet::new();
    let mut counters = RayCounters::default();
    let mut is_stopped = false;
    for block in blocks {
        is_stopped |= block.is_stopped;
        for (key, (rays, nearest)) in block.misses {
            let entry = misses.entry(key).or_insert((0, f64::INFINITY));
            *entry = (entry.0 + rays, entry.1.min(nearest));
        }
        uses.extend(block.uses);
        counters.add(&block.counters);
    }
    let mut misses: Vec<Miss> = misses.into_iter().map(|(key, (rays, nearest))| Miss { key, rays, nearest }).collect();
    misses.sort_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.key.cmp(&b.key)));
    PassFeedback { misses, uses: uses.into_iter().collect(), counters, is_stopped }
}
