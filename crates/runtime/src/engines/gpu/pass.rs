//! Rays on the GPU, and the dispatches that cast them.
//!
//! The rays of a band of rows are cast by as few dispatches as possible. A fast adapter needs one for all; others cast
//! runs of tiles that each take a short time. Tiles whose rays are all finished are in no run. A dispatch limits the
//! work of each ray, so that no submit blocks the GPU for long. Rays that reach the limit continue in the next
//! dispatch. This affects the schedule, never the result.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use bytemuck::Zeroable;
use supervol_format::cast::{index, narrow};
use supervol_scene::transfer_function::RenderTransferFunction;

use super::pixels::{BoundPixels, PixelBuffers};
use crate::engines::gpu::cache::GpuCache;
use crate::engines::gpu::deviations::DeviationTable;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::feedback::{
    DeviceFeedback, FIRST_MISSES, HEADER_WORDS, MISS_LIMIT, buffer_words, listed_misses, read_misses, read_uses,
    tile_words, words_with,
};
use crate::engines::gpu::layout::{
    Dispatch, FLAG_LIGHT, GpuCounters, GpuPoint, LEFT_INTERRUPTED, LEFT_WAITING, RayErrors, RayPart, RayState, Scene,
    View, WORKGROUP_RAYS,
};
use crate::engines::gpu::piece_table::PieceTable;
use crate::engines::gpu::pipelines::{Pipeline, Pipelines, SceneBindings, Variant};
use crate::engines::gpu::rays::{RayGrid, TILE};
use crate::engines::gpu::scene_tables;
use crate::engines::gpu::slots::SlotIndex;
use crate::engines::gpu::table::Table;
use crate::stop::Stop;
use crate::stream::counters::milliseconds;

/// Most bytes of ray states and errors of rays: larger pictures are cast in bands.
const STATES_LIMIT: u64 = 64 << 20;
/// Texels of a control point, four words each.
const POINT_TEXELS: usize = size_of::<GpuPoint>() / 16;
/// Least texels for pieces of the transfer function: some 1,300 pieces, so that another look or error seldom needs more.
const LEAST_PIECES: usize = 1 << 14;
/// Most workgroups of a dispatch.
const GROUPS_LIMIT: u32 = 65_535;
/// Most tiles of rays in a dispatch.
const MOST_RUN_TILES: usize = 1 << 15;
/// The same on software adapters: tiles after an empty corner of the picture may take a thousand times as long.
const MOST_SOFTWARE_RUN_TILES: usize = 1 << 6;
/// Tiles of the first dispatch on an adapter that may be slow.
const FIRST_RUN_TILES: usize = 1 << 10;
/// The same on software adapters.
const FIRST_SOFTWARE_RUN_TILES: usize = 1 << 4;
/// Fewest tiles of a dispatch.
const LEAST_RUN_TILES: usize = 1 << 2;
/// Dispatches slower than this get fewer rays, milliseconds. It is half of what a display can wait, because the next
/// one may be twice as slow.
const SLOW_DISPATCH_MS: f64 = 50.0;
/// Dispatches faster than this get more rays, milliseconds.
const FAST_DISPATCH_MS: f64 = 15.0;
/// Loop iterations of a ray in one dispatch.
const WORK_LIMIT: u32 = 1 << 14;
/// The same on software adapters. llvmpipe silently ends all loops after 65535 iterations of a group of at most 16
/// lanes. Iterations of diverging lanes add up, and it runs loops once that no lane enters.
const SOFTWARE_WORK_LIMIT: u32 = 1 << 8;
/// The same if all rays of a group are in one loop (`light_walk.wgsl`), with inner loops that search the transfer function.
const SOFTWARE_LIGHT_WORK_LIMIT: u32 = 1 << 9;
/// Every n-th row of tiles runs ahead as scouts. Its missing bricks predict those of the rows around it.
const SCOUTING_ROWS: u32 = 8;
/// On software adapters, tiles are cast in squares of this many along an edge: their threads then have equal work.
const SQUARE: u32 = 8;
/// Runs submitted before the first of them is waited for: while one is cast, the next is ready.
const RUNS_IN_FLIGHT: usize = 2;
/// Parts of rays written at once.
const PARTS_AT_ONCE: usize = 1 << 14;
const PARTS_BYTES: u64 = (PARTS_AT_ONCE * size_of::<RayPart>()) as u64;
/// Bytes of the counters of a dispatch.
const COUNTERS_BYTES: u64 = size_of::<GpuCounters>() as u64;
/// Most rounds of a pass; every round advances every ray by at least one cell.
const ROUND_LIMIT: usize = 1 << 22;

/// Loop iterations after which a ray stops at the next cell.
pub(super) fn work_limit(gpu: &GpuDevice, flags: u32) -> u32 {
    match (gpu.is_software(), flags & FLAG_LIGHT != 0) {
        (false, _) => WORK_LIMIT,
        (true, false) => SOFTWARE_WORK_LIMIT,
        (true, true) => SOFTWARE_LIGHT_WORK_LIMIT,
    }
}

/// Bytes of a ray on the device, with or without sums of errors.
const fn ray_bytes(sums_errors: bool) -> u64 {
    (size_of::<RayState>() + if sums_errors { size_of::<RayErrors>() } else { 0 }) as u64
}

/// Rows of rays of this width that fit [`STATES_LIMIT`], in whole pixels of `subgrid` rows; at least one pixel's.
pub(super) fn band_rows(width: u32, subgrid: u32, sums_errors: bool) -> u32 {
    let row_of_tiles = RayGrid { width, height: TILE }.places() * ray_bytes(sums_errors);
    let rows = narrow::<u32>((STATES_LIMIT / row_of_tiles).min(u64::from(u32::MAX / TILE))) * TILE;
    (rows - rows % subgrid).max(subgrid)
}

/// Sizes of everything allocated besides bricks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Capacity {
    /// Places of rays.
    pub(super) places: u64,
    /// Control points.
    pub(super) points: usize,
    /// Bins and knots.
    pub(super) index: usize,
    /// Texels of the transfer function's pieces.
    pub(super) pieces: usize,
    /// Entries of the page table.
    pub(super) entries: u64,
    /// Whether there is memory for errors of rays.
    pub(super) sums_errors: bool,
}

impl Capacity {
    /// Capacity for pictures of this size, or smaller ones, with this transfer function.
    pub(super) fn new(
        (grid, subgrid): (RayGrid, u32),
        (tf, light): (&RenderTransferFunction, &PieceTable),
        entries: u64,
        sums_errors: bool,
    ) -> Self {
        let band = RayGrid { height: grid.height.min(band_rows(grid.width, subgrid, sums_errors)), ..grid };
        let index = tf.bins.len() + tf.knots.len();
        Self {
            places: band.places(),
            points: tf.points.len(),
            index,
            pieces: light.texels().max(LEAST_PIECES),
            entries,
            sums_errors,
        }
    }

    /// The same with memory for as many rays as `other`.
    pub(super) fn with_rays_of(self, other: &Self) -> Self {
        Self { places: self.places.max(other.places), ..self }
    }

    /// Whether it suffices for `other`.
    pub(super) fn holds(&self, other: &Self) -> bool {
        let holds_tables = self.points >= other.points && self.index >= other.index && self.pieces >= other.pieces;
        self.places >= other.places && holds_tables && (self.sums_errors || !other.sums_errors)
    }

    /// Tiles of the longest run.
    fn run_tiles(&self) -> u64 {
        (self.places / u64::from(WORKGROUP_RAYS)).clamp(1, MOST_RUN_TILES as u64)
    }

    /// Bytes of everything allocated; feedback counts twice, because it is read back.
    pub(super) fn bytes(&self, slots: u64) -> u64 {
        self.places * size_of::<RayState>() as u64
            + self.error_bytes()
            + DeviationTable::bytes(self.sums_errors)
            + 4 * (buffer_words(slots, self.entries, self.run_tiles()) + words_with(slots, MISS_LIMIT))
            + Table::bytes(self.points * POINT_TEXELS, 4)
            + Table::bytes(self.index, 1)
            + Table::bytes(self.pieces, 4)
            + size_of::<Scene>() as u64
            + RUNS_IN_FLIGHT as u64 * (COUNTERS_BYTES + 4 * self.run_tiles())
            + PARTS_BYTES
            + PixelBuffers::bytes((self.places, self.sums_errors))
    }

    /// Bytes of errors of rays; at least one place.
    fn error_bytes(&self) -> u64 {
        size_of::<RayErrors>() as u64 * if self.sums_errors { self.places } else { 1 }
    }
}

/// Feedback with entries and slots instead of bricks.
#[derive(Debug, Default)]
pub(super) struct RawFeedback {
    pub(super) feedback: DeviceFeedback,
    /// Page table entries and waiting rays.
    pub(super) misses: Vec<(u32, u32)>,
    pub(super) uses: Vec<SlotIndex>,
    pub(super) dispatch_ms_max: f64,
    /// Whether it was stopped before all rays were finished or waited.
    pub(super) is_stopped: bool,
    /// Rays of the last round that must continue.
    interrupted: u64,
}

impl RawFeedback {
    /// Whether no ray must continue or waits.
    pub(super) fn is_finished(&self) -> bool {
        self.feedback.is_converged() && !self.is_stopped
    }

    /// Adds the feedback of the rays' next part, if nothing was missing in this one.
    pub(super) fn followed_by(mut self, mut next: Self) -> Self {
        next.feedback.counters.add(&self.feedback.counters);
        next.feedback.device.add(&self.feedback.device);
        next.uses.append(&mut self.uses);
        next.uses.sort_unstable();
        next.uses.dedup();
        next.dispatch_ms_max = next.dispatch_ms_max.max(self.dispatch_ms_max);
        next
    }
}

/// Tiles of rays that are cast run by run.
struct TileRuns {
    /// See [`Dispatch::later_round`].
    later: u32,
    tiles: Vec<u32>,
}

/// A dispatch that was submitted.
struct Run {
    tiles: Vec<u32>,
    /// Index of its counter buffer.
    buffer: usize,
    submission: wgpu::SubmissionIndex,
    begin: Instant,
}

/// Pipelines with their bindings.
pub(super) struct Bound {
    variant: Variant,
    /// Whether planes cut rays.
    is_cut: bool,
    pub(super) pipelines: Arc<Pipelines>,
    scene: wgpu::BindGroup,
    classify: wgpu::BindGroup,
    begin: wgpu::BindGroup,
    /// Bindings for parts of rays that solids leave.
    begin_parts: Option<wgpu::BindGroup>,
    cast: wgpu::BindGroup,
    gather: wgpu::BindGroup,
    pub(super) pixels: BoundPixels,
    /// Whether they have cast a ray.
    is_compiled: bool,
}

/// Rays, pipelines, feedback.
pub(crate) struct DeviceCaster {
    pub(super) gpu: GpuDevice,
    /// Pipelines of the picture with their bindings; `None` before the first picture.
    bound: Option<Bound>,
    scene: wgpu::Buffer,
    points: Table,
    transfer_index: Table,
    light: Table,
    feedback: wgpu::Buffer,
    states: wgpu::Buffer,
    /// Errors of rays: one place if they are not summed up.
    errors: wgpu::Buffer,
    parts: wgpu::Buffer,
    /// Counters and tile states of the runs in flight, and the index of the next buffer.
    counters: Vec<wgpu::Buffer>,
    next_read_back: usize,
    read_back: wgpu::Buffer,
    /// The last submission, if it has copied the feedback.
    feedback_after: Option<wgpu::SubmissionIndex>,
    slots: u64,
    /// Position of a run's tiles in the feedback, bytes.
    first_tile: u64,
    pub(super) pixels: PixelBuffers,
    /// Rays of the band in progress.
    grid: RayGrid,
    view: View,
    /// Tiles of the next run.
    run_tiles: usize,
    /// [`Dispatch::refined_levels`]
    refined_levels: u32,
    /// Tiles that a pass examines: the rays of all others in the band are finished.
    unfinished: Vec<u32>,
    /// Tiles that begin when the scouts have all bricks they need.
    held_back: Vec<u32>,
}

impl DeviceCaster {
    /// Allocates buffers.
    pub(super) fn new(gpu: &GpuDevice, cache: &GpuCache, capacity: &Capacity) -> Result<Self, GpuError> {
        let slots = cache.slot_count();
        let storage = wgpu::BufferUsages::STORAGE;
        let scene = gpu.buffer("the scene's tables", size_of::<Scene>() as u64, storage)?;
        let points = Table::new(gpu, "the transfer function", capacity.points * POINT_TEXELS, 4)?;
        let transfer_index = Table::new(gpu, "the transfer function's index", capacity.index, 1)?;
        let light = Table::new(gpu, "the transfer function's pieces", capacity.pieces, 4)?;
        let feedback =
            gpu.buffer("feedback", 4 * buffer_words(slots, capacity.entries, capacity.run_tiles()), storage)?;
        let states = gpu.buffer("ray states", capacity.places * size_of::<RayState>() as u64, storage)?;
        let errors = gpu.buffer("what rays may be off by", capacity.error_bytes(), storage)?;
        let parts = gpu.buffer("parts of rays", PARTS_BYTES, storage)?;
        let of_a_run = COUNTERS_BYTES + 4 * capacity.run_tiles();
        let counters = (0..RUNS_IN_FLIGHT).map(|_| gpu.read_buffer("counters", of_a_run));
        let counters = counters.collect::<Result<_, _>>()?;
        let read_back = gpu.read_buffer("read-back", 4 * words_with(slots, MISS_LIMIT))?;
        Ok(Self {
            bound: None,
            gpu: gpu.clone(),
            scene,
            points,
            transfer_index,
            light,
            feedback,
            states,
            errors,
            parts,
            counters,
            next_read_back: 0,
            read_back,
            slots,
            first_tile: 4 * (HEADER_WORDS as u64 + tile_words(slots, capacity.entries)),
            feedback_after: None,
            pixels: PixelBuffers::new(gpu, (capacity.places, capacity.sums_errors))?,
            grid: RayGrid { width: 0, height: 0 },
            view: View::zeroed(),
            refined_levels: 0,
            unfinished: Vec::new(),
            held_back: Vec::new(),
            run_tiles: match gpu.deals_as() {
                wgpu::DeviceType::DiscreteGpu => MOST_RUN_TILES,
                wgpu::DeviceType::Cpu => FIRST_SOFTWARE_RUN_TILES,
                _ => FIRST_RUN_TILES,
            },
        })
    }

    /// Pipelines for pictures of a kind, with their bindings.
    fn bind(&self, cache: &GpuCache, variant: Variant, view: &View) -> Result<Bound, GpuError> {
        let gpu = &self.gpu;
        let pipelines = gpu.pipelines(variant)?;
        let bindings = SceneBindings {
            scene: &self.scene,
            page_table: &cache.page_table,
            points: &self.points.view,
            transfer_index: &self.transfer_index.view,
            light: &self.light.view,
            macro_ranges: &cache.macro_ranges,
            proximity: &cache.proximity,
            feedback: &self.feedback,
            textures: &cache.views,
            deviations: &cache.deviations.buffer,
        };
        let is_cut = view.plane_count > 0;
        let begin_parts = (view.in_parts != 0).then(|| {
            let pipeline = pipelines.begin_parts(gpu)?;
            pipeline.bind(gpu, &[&self.states, &self.parts])
        });
        Ok(Bound {
            variant,
            is_cut,
            scene: pipelines.bind_scene(gpu, &bindings)?,
            classify: pipelines.classify_cells.bind(gpu, &[&cache.slot_list, &cache.block_ranges])?,
            begin: pipelines.begin_rays(gpu, is_cut)?.bind(gpu, &[&self.states, &self.errors])?,
            begin_parts: begin_parts.transpose()?,
            cast: pipelines.raycast.bind(gpu, &[&self.states, &self.errors])?,
            gather: pipelines.gather_misses.bind(gpu, &[])?,
            pixels: self.pixels.bind(gpu, &pipelines, (&self.scene, &self.states, &self.errors))?,
            pipelines,
            is_compiled: false,
        })
    }

    pub(super) fn bound(&self) -> &Bound {
        self.bound.as_ref().expect("a scene is set before anything is cast")
    }

    /// Sets tables and transfer function for the following rays; a band must be begun next.
    ///
    /// # Errors
    /// If the driver refuses a pipeline.
    pub(super) fn set_scene(
        &mut self,
        cache: &GpuCache,
        scene: &Scene,
        tf: &RenderTransferFunction,
        light: &PieceTable,
    ) -> Result<(), GpuError> {
        let (mode, flags) = (scene.config.mode, scene.config.flags);
        let variant = Variant { mode, flags, textures: cache.texture_count() };
        let is_bound = |bound: &Bound| {
            let has_parts = bound.begin_parts.is_some() || scene.view.in_parts == 0;
            bound.variant == variant && bound.is_cut == (scene.view.plane_count > 0) && has_parts
        };
        if !self.bound.as_ref().is_some_and(is_bound) {
            self.bound = Some(self.bind(cache, variant, &scene.view)?);
        }
        self.view = scene.view;
        self.gpu.write_buffer(&self.scene, 0, bytemuck::bytes_of(scene));
        self.points.write(&self.gpu, bytemuck::cast_slice(&scene_tables::points(tf)));
        self.transfer_index.write(&self.gpu, &scene_tables::transfer_index(tf));
        self.light.write(&self.gpu, &light.words);
        Ok(())
    }

    /// Computes the visibility of the bricks in these slots under the look.
    pub(super) fn classify(&self, cache: &GpuCache, slots: &[SlotIndex]) {
        for slots in slots.chunks(GROUPS_LIMIT as usize) {
            cache.write_slot_list(slots);
            let mut encoder = self.encoder();
            let bound = self.bound();
            self.dispatch(&mut encoder, &bound.pipelines.classify_cells, &bound.classify, narrow::<u32>(slots.len()));
            self.gpu.submit(encoder);
        }
    }

    /// Begins the rays of these rows of pixels.
    pub(super) fn begin(&mut self, rows: Range<u32>) {
        self.grid = RayGrid { width: self.view.width, height: rows.end - rows.start };
        let places = narrow::<u32>(self.grid.places());
        self.look_at_all();
        self.view =
            View { first_row: rows.start, height: rows.end, tiles_x: self.grid.tiles()[0], places, ..self.view };
        let offset = std::mem::offset_of!(Scene, view) as u64;
        self.gpu.write_buffer(&self.scene, offset, bytemuck::bytes_of(&self.view));
        let mut encoder = self.encoder();
        let groups = places.div_ceil(WORKGROUP_RAYS);
        let bound = self.bound();
        let pipeline = bound.pipelines.begin_rays(&self.gpu, bound.is_cut).expect("made when the scene was set");
        self.dispatch(&mut encoder, pipeline, &bound.begin, groups);
        self.gpu.submit(encoder);
    }

    /// Marks all rays of the band as unfinished. Scouts run ahead: all other rays would stop with them at the missing
    /// bricks.
    ///
    /// On hardware there are no scouts. A pass there costs little more than its rays, and an eighth of the rays leaves
    /// most of the device idle.
    fn look_at_all(&mut self) {
        [self.unfinished, self.held_back] = match self.gpu.deals_as_software() {
            true => scouts_and_others(self.grid),
            false => [all_tiles(self.grid).collect(), Vec::new()],
        };
    }

    /// Lets all rays continue with the scouts: further bricks for scouts would be evicted before the others come.
    pub(super) fn end_scouting(&mut self) {
        self.unfinished.append(&mut self.held_back);
        self.sort_unfinished();
    }

    /// Sorts the tiles of a pass into the order of casting, each once.
    fn sort_unfinished(&mut self) {
        match self.gpu.deals_as_software() {
            true => sort_by_squares(&mut self.unfinished, self.grid),
            false => self.unfinished.sort_unstable(),
        }
        self.unfinished.dedup();
    }

    /// Starts rays of the band on their next part.
    pub(super) fn begin_parts(&mut self, parts: &[RayPart]) {
        self.look_at_all();
        for parts in parts.chunks(PARTS_AT_ONCE) {
            let groups = narrow::<u32>(parts.len()).div_ceil(WORKGROUP_RAYS);
            // The last workgroup is filled up with places that do not exist.
            let mut whole = parts.to_vec();
            whole.resize((groups * WORKGROUP_RAYS) as usize, RayPart { place: u32::MAX, ..RayPart::zeroed() });
            self.gpu.write_buffer(&self.parts, 0, bytemuck::cast_slice(&whole));
            let mut encoder = self.encoder();
            let bound = self.bound();
            let bindings = bound.begin_parts.as_ref().expect("bound where there are parts");
            let pipeline = bound.pipelines.begin_parts(&self.gpu).expect("made when the scene was set");
            self.dispatch(&mut encoder, pipeline, bindings, groups);
            self.gpu.submit(encoder);
        }
    }

    /// The rays of the band in progress.
    pub(super) fn grid(&self) -> RayGrid {
        self.grid
    }

    pub(super) fn encoder(&self) -> wgpu::CommandEncoder {
        self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default())
    }

    fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &Pipeline,
        bindings: &wgpu::BindGroup,
        groups: u32,
    ) {
        self.dispatch_on(encoder, pipeline, [&self.bound().scene, bindings], groups);
    }

    pub(super) fn dispatch_on(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        pipeline: &Pipeline,
        bindings: [&wgpu::BindGroup; 2],
        groups: u32,
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline.pipeline);
        (0..).zip(bindings).for_each(|(number, bindings)| pass.set_bind_group(number, bindings, &[]));
        // No more rows than needed: places are numbered row by row.
        let rows = groups.div_ceil(GROUPS_LIMIT).max(1);
        pass.dispatch_workgroups(groups.div_ceil(rows), rows, 1);
    }

    /// Casts every unfinished ray until it is finished or waits for a brick, or `stop` is due. Tiles whose rays are all
    /// finished are dropped, so the next pass begins further on however early this one is stopped.
    ///
    /// Runs of tiles are submitted without waiting for earlier ones, [`RUNS_IN_FLIGHT`] at a time. A run returns the
    /// tiles that must continue in the next round.
    pub(super) fn cast_pass(&mut self, refined_levels: u32, stop: &Stop) -> Result<RawFeedback, GpuError> {
        self.refined_levels = refined_levels;
        self.compile()?;
        let mut raw = RawFeedback::default();
        self.feedback_after = None;
        let mut encoder = self.encoder();
        encoder.clear_buffer(&self.feedback, 0, None);
        self.gpu.submit(encoder);
        loop {
            self.cast_rounds(&mut raw, stop)?;
            if !self.unfinished.is_empty() || self.held_back.is_empty() {
                break;
            }
            self.end_scouting();
        }
        raw.feedback.unfinished_rays += self.held_back.len() as u64 * u64::from(WORKGROUP_RAYS);
        self.sort_unfinished();
        raw.feedback.unfinished_rays += raw.interrupted;
        self.read_feedback(&mut raw)?;
        Ok(raw)
    }

    /// Casts the unfinished rays, round by round.
    fn cast_rounds(&mut self, raw: &mut RawFeedback, stop: &Stop) -> Result<(), GpuError> {
        let mut round = TileRuns { later: 0, tiles: std::mem::take(&mut self.unfinished) };
        for _ in 0..ROUND_LIMIT {
            let left = self.cast_round(round, raw, stop)?;
            if left.is_empty() || raw.is_stopped {
                self.unfinished.extend(left);
                break;
            }
            round = TileRuns { later: 1, tiles: left };
        }
        Ok(())
    }

    /// Runs the shader once without rays. Some drivers compile a shader when it first runs: half a second on software
    /// adapters. That time would be taken for that of the rays, and later runs would be too short.
    fn compile(&mut self) -> Result<(), GpuError> {
        if self.bound().is_compiled {
            return Ok(());
        }
        let beyond_all = u32::MAX / WORKGROUP_RAYS;
        let Run { buffer, submission, .. } = self.submit(vec![beyond_all], 0, false);
        self.gpu.read_after(Some(submission), &self.counters[buffer], COUNTERS_BYTES, |_| ())?;
        self.bound.iter_mut().for_each(|bound| bound.is_compiled = true);
        Ok(())
    }

    /// Submits the tiles of a round, run by run; returns those that must continue.
    fn cast_round(&mut self, round: TileRuns, raw: &mut RawFeedback, stop: &Stop) -> Result<Vec<u32>, GpuError> {
        raw.interrupted = 0;
        let mut left = Vec::new();
        let mut flying: VecDeque<Run> = VecDeque::new();
        let mut last_end = Instant::now();
        let mut tiles = round.tiles.as_slice();
        while !tiles.is_empty() && !raw.is_stopped {
            if flying.len() == RUNS_IN_FLIGHT {
                self.land(&mut flying, &mut last_end, raw, &mut left)?;
                raw.is_stopped = stop.is_due();
                continue;
            }
            let (run, rest) = tiles.split_at(tiles.len().min(self.run_tiles));
            let run = self.submit(run.to_vec(), round.later, rest.is_empty());
            flying.push_back(run);
            tiles = rest;
        }
        while !flying.is_empty() {
            self.land(&mut flying, &mut last_end, raw, &mut left)?;
        }
        left.extend_from_slice(tiles);
        raw.is_stopped |= !left.is_empty() && stop.is_due();
        Ok(left)
    }

    /// Writes the parameters of the next dispatch.
    pub(super) fn write_job(&self, first_pixel: u32, later_round: u32) {
        let job = Dispatch { first_pixel, later_round, refined_levels: self.refined_levels, padding: 0 };
        let offset = std::mem::offset_of!(Scene, job) as u64;
        self.gpu.write_buffer(&self.scene, offset, bytemuck::bytes_of(&job));
    }

    /// Submits a run. The last run of a round also copies the feedback that a pass reads at its end, since few have
    /// another round.
    fn submit(&mut self, tiles: Vec<u32>, later_round: u32, is_last: bool) -> Run {
        let buffer = self.next_read_back;
        self.next_read_back = (buffer + 1) % RUNS_IN_FLIGHT;
        self.write_job(0, later_round);
        self.gpu.write_buffer(&self.feedback, self.first_tile, bytemuck::cast_slice(&tiles));
        let mut encoder = self.encoder();
        encoder.clear_buffer(&self.feedback, 0, Some(COUNTERS_BYTES));
        let bound = self.bound();
        self.dispatch(&mut encoder, &bound.pipelines.raycast, &bound.cast, narrow::<u32>(tiles.len()));
        let (counters, tile_bytes) = (&self.counters[buffer], 4 * tiles.len() as u64);
        encoder.copy_buffer_to_buffer(&self.feedback, 0, counters, 0, COUNTERS_BYTES);
        encoder.copy_buffer_to_buffer(&self.feedback, self.first_tile, counters, COUNTERS_BYTES, tile_bytes);
        if is_last {
            self.gather_feedback(&mut encoder);
        }
        let submission = self.gpu.submit(encoder);
        self.feedback_after = is_last.then(|| submission.clone());
        Run { tiles, buffer, submission, begin: Instant::now() }
    }

    /// Waits for the oldest run, and reads its counters.
    fn land(
        &mut self,
        flying: &mut VecDeque<Run>,
        last_end: &mut Instant,
        raw: &mut RawFeedback,
        left: &mut Vec<u32>,
    ) -> Result<(), GpuError> {
        let Some(run) = flying.pop_front() else { return Ok(()) };
        let bytes = COUNTERS_BYTES + 4 * run.tiles.len() as u64;
        let (counters, states) =
            self.gpu.read_after(Some(run.submission), &self.counters[run.buffer], bytes, |bytes| {
                let (counters, states) = bytes.split_at(index(COUNTERS_BYTES));
                (bytemuck::pod_read_unaligned::<GpuCounters>(counters), bytemuck::pod_collect_to_vec::<u8, u32>(states))
            })?;
        raw.feedback.add(&counters);
        raw.feedback.unfinished_rays += u64::from(counters.waiting);
        // It began when it was submitted, or when the previous one ended.
        let ms = milliseconds(run.begin.max(*last_end).elapsed());
        *last_end = Instant::now();
        raw.dispatch_ms_max = raw.dispatch_ms_max.max(ms);
        self.adapt_run(ms);
        raw.interrupted += u64::from(counters.interrupted);
        let with = |what: u32| {
            run.tiles.iter().zip(&states).filter(move |(_, state)| *state & what != 0).map(|(tile, _)| tile)
        };
        self.unfinished.extend(with(LEFT_WAITING));
        left.extend(with(LEFT_INTERRUPTED));
        Ok(())
    }

    fn adapt_run(&mut self, ms: f64) {
        if ms > SLOW_DISPATCH_MS {
            self.run_tiles = (self.run_tiles / 2).max(LEAST_RUN_TILES);
        } else if ms < FAST_DISPATCH_MS {
            let most = if self.gpu.deals_as_software() { MOST_SOFTWARE_RUN_TILES } else { MOST_RUN_TILES };
            self.run_tiles = (self.run_tiles * 2).min(most);
        }
    }

    /// Encodes counting of the listed misses, and the copy of the part of them that is read first.
    fn gather_feedback(&self, encoder: &mut wgpu::CommandEncoder) {
        let bound = self.bound();
        self.dispatch(encoder, &bound.pipelines.gather_misses, &bound.gather, FIRST_MISSES.div_ceil(WORKGROUP_RAYS));
        let bytes = 4 * words_with(self.slots, FIRST_MISSES);
        encoder.copy_buffer_to_buffer(&self.feedback, 0, &self.read_back, 0, bytes);
    }

    /// Reads the lists back: with the last run's counters, or after it.
    fn read_feedback(&mut self, raw: &mut RawFeedback) -> Result<(), GpuError> {
        let submission = self.feedback_after.take().unwrap_or_else(|| {
            let mut encoder = self.encoder();
            self.gather_feedback(&mut encoder);
            self.gpu.submit(encoder)
        });
        let words = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, u32>(bytes);
        let first = 4 * words_with(self.slots, FIRST_MISSES);
        let mut all = self.gpu.read_after(Some(submission), &self.read_back, first, words)?;
        if listed_misses(&all) > FIRST_MISSES {
            let rest = 4 * words_with(self.slots, listed_misses(&all)) - first;
            let mut encoder = self.encoder();
            encoder.copy_buffer_to_buffer(&self.feedback, first, &self.read_back, 0, rest);
            self.gpu.submit(encoder);
            all.append(&mut self.gpu.read(&self.read_back, rest, words)?);
        }
        (raw.misses, raw.feedback.device.misses_not_listed) = read_misses(&all, self.slots);
        raw.uses = read_uses(&all, self.slots).collect();
        Ok(())
    }
}

/// Tiles of a grid of rays, by number.
fn all_tiles(grid: RayGrid) -> Range<u32> {
    0..narrow::<u32>(grid.places() / u64::from(WORKGROUP_RAYS))
}

/// Sorts tiles into squares of [`SQUARE`] tiles.
fn sort_by_squares(tiles: &mut [u32], grid: RayGrid) {
    let across = grid.tiles()[0];
    tiles.sort_unstable_by_key(|&tile| (tile / across / SQUARE, tile % across / SQUARE, tile));
}

/// Tiles of scouts, and the others: whole rows, evenly spread.
fn scouts_and_others(grid: RayGrid) -> [Vec<u32>; 2] {
    let [across, rows] = grid.tiles();
    let goes_ahead = |tile: &u32| rows < 2 * SCOUTING_ROWS || tile / across % SCOUTING_ROWS == SCOUTING_ROWS / 2;
    let (mut scouts, mut others): (Vec<_>, Vec<_>) = all_tiles(grid).partition(goes_ahead);
    [&mut scouts, &mut others].into_iter().for_each(|tiles| sort_by_squares(tiles, grid));
    [scouts, others]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scouts_and_others_are_all_rays() {
        for (width, height) in [(1, 1), (64, 127), (64, 128), (1024, 768), (3840, 256), (9, 2001)] {
            let grid = RayGrid { width, height };
            let [scouts, others] = scouts_and_others(grid);
            let (ahead, all) = (scouts.len() as u64 * u64::from(WORKGROUP_RAYS), grid.places());
            assert!(ahead == all || (ahead * 6 < all && ahead * 10 > all), "{width} x {height}: {ahead} of {all}");
            let mut both = [scouts, others].concat();
            both.sort_unstable();
            assert!(both.iter().copied().eq(all_tiles(grid)), "{width} x {height}: {both:?}");
        }
    }

    #[test]
    fn rays_of_a_band_keep_to_their_limit() {
        for (width, subgrid) in [(1, 1), (1920, 1), (3840, 1), (7680, 3), (20_000, 5), (40_000, 2)] {
            let rows = band_rows(width, subgrid, false);
            let bytes = |rows: u32| RayGrid { width, height: rows }.places() * ray_bytes(false);
            assert!(rows.is_multiple_of(subgrid) && bytes(rows) <= STATES_LIMIT, "{width}, {subgrid}: {rows}");
            assert!(bytes(rows.saturating_add(2 * TILE)) > STATES_LIMIT || width == 1, "{width}, {subgrid}: {rows}");
        }
        assert_eq!(band_rows(100_000_000, 3, true), 3, "a row of pixels is cast whatever it takes");
        assert_eq!([1920, 3840].map(|width| band_rows(width, 1, false)), [544, 272]);
        assert_eq!([1920, 3840].map(|width| band_rows(width, 1, true)), [416, 208]);
    }
}
