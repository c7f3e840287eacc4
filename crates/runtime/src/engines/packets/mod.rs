//! Frames and passes on the CPU, and the caster that takes rays in packets.
//!
//! Trilinear cells are integrated, not steps (docs/ARCHITECTURE.md, "How a ray is integrated"), in passes:
//! 1. [`CpuFrame::begin`] makes the rays: tiles for packets, one [`RayState`] per ray for the scalar caster.
//! 2. [`cast_pass`] casts every unfinished ray as far as resident bricks allow. A ray that needs a missing brick stores
//!    its position and the brick's key; the pass returns all such keys.
//! 3. The caller makes some of them resident and casts the next pass, until no ray waits.
//! 4. [`CpuFrame::image`] makes the picture of the rays, at any time.
//!
//! The picture does not depend on the number of threads, on the order in which bricks arrive, or on skipping, bit for
//! bit. With packets it depends on the size of bricks, by an invisible amount (docs/decisions/006-packets.md).
//!
//! Packets, in the order of the data: `tile` (rays) and `order` (bricks), `packets` (their passes), `plans`, `blocks`
//! and `leap` (invisible parts), `walk` (`trace`: for tests of it), `fetch`. Then in `dvr` `packet`, `lookup` and
//! `integrate` (one cell), `shade`, `queue` and `refine` (cells that need more). In the other modes `value_tiles`
//! (bricks), `values` (`mip`, `minip`, `mean`), `surfaces` (`iso`). Packets are compared with the caster in
//! [`crate::engines::cells`], which casts ray by ray.

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
pub(crate) use crate::engines::packets::cast::{
    END_SHARE, FIT_SHARE, LEAST_SHADED_SHARE, cell_error, fit_error, own_error, rounding_error,
};
use crate::engines::packets::cast::{PacketTables, cast_tiles, tiles_of};
use crate::engines::totals::EngineErrors;
use crate::lod::deviation::Deviations;
use crate::lod::{LodChoice, LodRule};
use crate::stop::Stop;
pub use crate::stream::counters::RayCounters;
use crate::stream::field::Field;
use crate::stream::residency::{BrickView, KnownEntry, Resident};
use levels::ErrorsByReason;
use pixels::{Tile, error_pixels_of, pixels_of, work_pixels_of};
pub use plans::{BrickPlans, Made};
pub use quality::{Caster, CpuQuality, MAX_ERROR_LIMITS, PacketRule};
use simd::InstructionSet;

/// Opacity at which a ray ends. Light behind it can change no channel by more than 0.08/255, and no mean of channels by
/// a tenth of a grey level.
pub const TERMINATION_OPACITY: f64 = 0.9997;

/// Rays per task: neighbours, which visit the same bricks.
const BLOCK_RAYS: usize = 256;

/// Whether macro cells that cannot change the picture are skipped. The picture is the same, bit for bit.
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

/// Data that is the same for all rays of a picture.
#[derive(Debug, Clone)]
pub struct CpuFrame {
    /// The field that is drawn: part of the key of data derived from bricks.
    pub(crate) field: Field,
    pub(crate) pyramid: Pyramid,
    pub(crate) geometry: Geometry,
    pub(crate) camera: Camera,
    subgrid: u32,
    /// Rows of rays that are cast: the whole picture, or a band ([`CpuFrame::band`]).
    rows: Range<u32>,
    clip: Clip,
    pub(crate) mode: Mode,
    pub(crate) transfer_function: RenderTransferFunction,
    pub(crate) lighting: Option<Lighting>,
    pub(crate) iso: Vec<IsoSurface>,
    /// In mode `dvr` with surfaces: a frame in mode `iso` for the surfaces, which lists all crossings and composites
    /// none.
    pub(crate) inner: Option<Arc<CpuFrame>>,
    /// Whether all crossings are listed instead of composited.
    pub(crate) lists_crossings: bool,
    pub(crate) map: ValueMap,
    pub(crate) lod: LodRule,
    /// The level at which the search for a brick begins.
    pub(crate) first_lod: Lod,
    pub(crate) skipping: Skipping,
    /// The integrator used where something may be visible.
    pub(crate) integrator: Arc<dyn Integrator>,
    /// Opacity at which a ray ends in mode `dvr`.
    termination_opacity: f64,
    /// Tables of packets; `None` if rays are cast one by one.
    packets: Option<Arc<PacketTables>>,
    /// Deviations of coarser levels, if errors are summed up.
    deviations: Option<Arc<Deviations>>,
    /// Condition at which packets pause.
    stop: Stop,
    /// Counter of rays that packets have finished.
    finished: Option<Arc<AtomicU64>>,
}

/// One ray between passes.
#[derive(Debug, Clone, PartialEq)]
pub struct RayState {
    /// World length at which the ray continues; always at a brick's entry.
    pub t: f64,
    /// World length at which its segment ends.
    pub t_end: f64,
    /// Premultiplied colour gathered so far (`dvr`, `iso`).
    pub color: [f64; 3],
    /// Share of light from behind that still passes, from 1 to 0.
    pub transmittance: f64,
    /// `mip`, `minip`: the extreme so far; `mean`: the integral so far; NaN before the first present value.
    pub value: f64,
    /// `mean`: present world length so far.
    pub length: f64,
    /// `iso`: sides and hits.
    pub iso: IsoSides,
    /// In frames that list surfaces: its crossings in order, with `t` as the begin of the current cell.
    pub crossings: Vec<SurfaceCrossing>,
    /// The brick that the ray waits for.
    pub waiting: Option<BrickKey>,
    /// Whether nothing is left to do.
    pub finished: bool,
}

impl RayState {
    /// A ray before its first pass; finished if there is no segment.
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

/// A crossing of a ray and a surface, with its appearance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceCrossing {
    /// World length along the ray.
    pub t: f64,
    /// Colour after shading, premultiplied.
    pub color: [f32; 3],
    /// Opacity.
    pub alpha: f32,
}

/// The ray's side of each iso value, one bit per surface.
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
    /// Notes that the ray passes values from `low` to `high`, or none if these are empty. Returns false, and notes
    /// nothing, if it meets a surface's value that it has not met yet, or has jumped across one.
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
    /// The rays, row by row from the top, of the scalar caster; empty for packets.
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

    /// Largest errors of rays in packets, if they are summed up.
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

/// Result of a pass.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PassFeedback {
    /// Bricks that rays wait for, nearest first.
    pub misses: Vec<Miss>,
    /// Bricks that rays read, in key order.
    pub uses: Vec<BrickKey>,
    /// Sums over the pass.
    pub counters: RayCounters,
    /// Whether it was stopped before each tile was finished or waits.
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
    /// The frame of a scene for one container: levels, geometry and values.
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
            // Surfaces are met separately from the light gathered around them.
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

    /// Adds the deviation of coarser levels to the errors that packets sum up.
    #[must_use]
    pub fn with_deviations(self, deviations: Deviations) -> Self {
        let sums_errors = self.packets.as_ref().is_some_and(|tables| tables.sums_errors());
        Self { deviations: sums_errors.then(|| Arc::new(deviations)), ..self }
    }

    /// Sets the condition at which packets pause: rays wait, and continue in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        self.stop = stop;
    }

    /// Sets the counter of rays that packets finish.
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

    /// Plans of bricks, for a frame of another camera; `None` unless packets cast in mode `dvr`.
    #[must_use]
    pub fn plans(&self) -> Option<Arc<BrickPlans>> {
        let tables = self.packets.as_ref().filter(|_| self.mode == Mode::Dvr)?;
        Some(tables.plans.clone())
    }

    /// The same frame for a band of pixel rows, numbered from the top.
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

    /// The instruction set of packets; `None` if rays are cast one by one.
    #[must_use]
    pub fn instructions(&self) -> Option<InstructionSet> {
        self.packets.as_ref().map(|tables| tables.instructions())
    }

    /// Errors of a picture whose rays have these errors, if packets sum them up, in mode `dvr`.
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

    /// Error of each pixel of finished tiles, grey, 1 is white, sub-grid averaged: NaN elsewhere; `None` if errors are
    /// not summed up.
    #[must_use]
    pub fn error_pixels(&self, rays: &Rays) -> Option<Image> {
        self.deviations.as_ref()?;
        let Rays::Tiles(tiles) = rays else { return None };
        let pixels = error_pixels_of(self, tiles);
        let image = Image { width: self.camera.width, height: self.rows.len() as u32, pixels };
        Some(image.downsampled(self.subgrid))
    }

    /// Work of each pixel's rays in finished tiles, sub-grid averaged: cells, leaps, 0, 1; NaN elsewhere; `None` if
    /// work is not counted.
    #[must_use]
    pub fn work_pixels(&self, rays: &Rays) -> Option<Image> {
        let Rays::Tiles(tiles) = rays else { return None };
        self.packets.as_ref().filter(|tables| tables.counts_work())?;
        let image =
            Image { width: self.camera.width, height: self.rows.len() as u32, pixels: work_pixels_of(self, tiles) };
        Some(image.downsampled(self.subgrid))
    }

    /// The picture of the light gathered by the rays, sub-grid averaged.
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

    /// Column and row of the frame's ray number `ray`, from the top left of the whole picture. In rays, not in pixels
    /// of a supersampled picture.
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

/// Result of one block of rays.
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
/// If the states are not this frame's, or a brick's size does not match the pyramid.
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

/// Wraps a view of any kind in one nameable type: the packet caster is compiled once.
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

/// Casts the unfinished rays of a block with the frame's caster; its first ray is number `first` of the frame.
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
