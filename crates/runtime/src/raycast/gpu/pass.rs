//! Rays on the GPU, and the dispatches that cast them.
//!
//! Rays live in *chunks* (one pair of buffers each, no larger than a binding may be), and are cast in *pieces*, one
//! dispatch each. A dispatch lets a ray do a limited amount of work, so that no submit blocks the GPU for long; rays
//! that reach the limit go on in the next round. The limit follows the measured time of the dispatches. It decides how
//! the work is dealt out, never what comes of it.

use std::time::Instant;

use bytemuck::Zeroable;

use crate::gpu::cache::GpuCache;
use crate::gpu::device::{GpuDevice, GpuError};
use crate::gpu::feedback::{MISS_LIMIT, PassFeedback, buffer_words, read_misses, read_uses};
use crate::gpu::layout::{Config, Dispatch, GpuCounters, RayState, Tables, WORKGROUP_RAYS};
use crate::gpu::pipelines::{Pipelines, SceneBindings};
use crate::gpu::rays::{RayFactory, RayGrid};
use crate::gpu::scene_tables::{self, GpuVolume};
use crate::gpu::slots::SlotIndex;
use crate::scene::{Mode, ResolvedScene};
use crate::transfer_function::RenderTransferFunction;

/// Most rays of one chunk: 64 MiB of rays.
const CHUNK_RAYS: u64 = 1 << 20;
/// Rays of one dispatch: 256 tiles of 8 x 8.
const PIECE_RAYS: u32 = 1 << 14;
/// The same on software adapters, which are hundreds of times slower: 4 tiles keep two cores busy.
const SOFTWARE_PIECE_RAYS: u32 = 1 << 8;
/// Most bytes read back at once.
const READ_BACK_LIMIT: u64 = 4 << 20;
/// Dispatches slower than this get less work, milliseconds: half of what a display can wait, because the next one may be
/// twice as slow.
const SLOW_DISPATCH_MS: f64 = 50.0;
/// Dispatches faster than this get more.
const FAST_DISPATCH_MS: f64 = 15.0;
/// Loop iterations that a ray may spend in the first dispatch.
const FIRST_WORK_LIMIT: u32 = 2048;
/// Least loop iterations that a ray may spend in a dispatch: the costliest cell does not need many more.
/// Software adapters begin with it.
const LEAST_WORK_LIMIT: u32 = 256;
/// Most loop iterations that a ray may spend in a dispatch.
const WORK_LIMIT: u32 = 1 << 16;
/// The same on software adapters: llvmpipe ends all loops after 65535 iterations of a group of at most 16 lanes, and
/// lanes that part ways add up.
const SOFTWARE_WORK_LIMIT: u32 = 1 << 11;
/// Rounds of one pass; every round brings every ray at least one macro cell further.
const ROUND_LIMIT: usize = 1 << 22;

/// What the caster binds besides its rays.
pub(super) struct CasterTables<'a> {
    pub(super) config: Config,
    pub(super) tables: Tables,
    pub(super) tf: &'a RenderTransferFunction,
    pub(super) cache: &'a GpuCache,
}

/// Feedback in the GPU's terms.
#[derive(Debug, Default)]
pub(super) struct RawFeedback {
    pub(super) feedback: PassFeedback,
    /// Page table entries and waiting rays.
    pub(super) misses: Vec<(u32, u32)>,
    pub(super) uses: Vec<SlotIndex>,
    pub(super) dispatch_ms_max: f64,
}

/// Rays that share buffers.
struct Chunk {
    states: wgpu::Buffer,
    bindings: wgpu::BindGroup,
    /// Place of the first ray in the picture's order.
    first_place: u64,
    rays: u32,
}

/// Rays that share a dispatch.
struct Piece {
    chunk: usize,
    first_ray: u32,
    rays: u32,
    /// Rays that reached the work limit in the last dispatch.
    interrupted: u32,
    /// Rays that wait for a brick.
    waiting: u32,
}

/// Rays, pipelines, feedback.
pub(super) struct Caster {
    gpu: GpuDevice,
    pipelines: Pipelines,
    scene_bindings: wgpu::BindGroup,
    job: wgpu::Buffer,
    feedback: wgpu::Buffer,
    feedback_words: u64,
    miss_counts: wgpu::Buffer,
    read_back: wgpu::Buffer,
    chunks: Vec<Chunk>,
    pieces: Vec<Piece>,
    grid: RayGrid,
    work_limit: u32,
}

/// Bytes of the read-back buffer for ray states.
pub(super) fn read_back_bytes(places: u64) -> u64 {
    (places * size_of::<RayState>() as u64).min(READ_BACK_LIMIT)
}

impl Caster {
    /// Allocates buffers and makes all rays.
    pub(super) fn new(
        gpu: &GpuDevice,
        volume: &GpuVolume<'_>,
        scene: &ResolvedScene,
        tables: &CasterTables<'_>,
    ) -> Result<Self, GpuError> {
        let pipelines = Pipelines::new(gpu)?;
        let entries = volume.pyramid.brick_count();
        let grid = RayGrid { width: scene.camera.width, height: scene.camera.height };
        let slots = tables.cache.slot_count();
        let feedback_words = buffer_words(slots);
        let (storage, uniform) = (wgpu::BufferUsages::STORAGE, wgpu::BufferUsages::UNIFORM);

        let config = filled(gpu, "the configuration", bytemuck::bytes_of(&tables.config), uniform)?;
        let levels = filled(gpu, "the level table", bytemuck::bytes_of(&tables.tables), uniform)?;
        let points = scene_tables::points(tables.tf);
        let points = filled(gpu, "the transfer function", bytemuck::cast_slice(&points), storage)?;
        let index = scene_tables::transfer_index(tables.tf);
        let index = filled(gpu, "the transfer function's index", bytemuck::cast_slice(&index), storage)?;
        let feedback = gpu.buffer("feedback", 4 * feedback_words, storage)?;
        let miss_counts = gpu.buffer("miss counters", 4 * entries, storage)?;
        let read_back = gpu.read_buffer("read-back", (4 * feedback_words).max(read_back_bytes(grid.places())))?;
        let job = gpu.buffer("dispatches", size_of::<Dispatch>() as u64, uniform)?;
        let scene_bindings = pipelines.bind_scene(
            gpu,
            &SceneBindings {
                config: &config,
                tables: &levels,
                page_table: &tables.cache.page_table,
                points: &points,
                transfer_index: &index,
                macro_ranges: &tables.cache.macro_ranges,
                feedback: &feedback,
                miss_counts: &miss_counts,
                textures: &tables.cache.views,
            },
        )?;
        let mut caster = Self {
            gpu: gpu.clone(),
            pipelines,
            scene_bindings,
            job,
            feedback,
            feedback_words,
            miss_counts,
            read_back,
            chunks: Vec::new(),
            pieces: Vec::new(),
            grid,
            work_limit: if gpu.is_software() { LEAST_WORK_LIMIT } else { FIRST_WORK_LIMIT },
        };
        caster.make_rays(volume, scene)?;
        Ok(caster)
    }

    /// The grid of rays.
    pub(super) fn grid(&self) -> RayGrid {
        self.grid
    }

    fn make_rays(&mut self, volume: &GpuVolume<'_>, scene: &ResolvedScene) -> Result<(), GpuError> {
        let factory = RayFactory {
            camera: &scene.camera,
            geometry: volume.geometry,
            dims: volume.pyramid.levels()[0].dims,
            clip: &scene.clip,
            first_value: match scene.mode {
                Mode::Mip => f32::MIN,
                Mode::Minip => f32::MAX,
                _ => 0.0,
            },
        };
        let most = if self.gpu.is_software() { SOFTWARE_PIECE_RAYS } else { PIECE_RAYS };
        let places = self.grid.places();
        let mut first_place = 0;
        while first_place < places {
            let rays = (places - first_place).min(CHUNK_RAYS) as u32;
            let (gpu_rays, states) = factory.make(first_place, rays as usize);
            let usage = wgpu::BufferUsages::STORAGE;
            let gpu_rays = filled(&self.gpu, "rays", bytemuck::cast_slice(&gpu_rays), usage)?;
            let states = filled(&self.gpu, "ray states", bytemuck::cast_slice(&states), usage)?;
            let bindings = self.pipelines.bind_chunk(&self.gpu, &self.job, &gpu_rays, &states)?;
            let chunk = self.chunks.len();
            self.chunks.push(Chunk { states, bindings, first_place, rays });
            for first_ray in (0..rays).step_by(most as usize) {
                let piece_rays = most.min(rays - first_ray);
                let piece = Piece { chunk, first_ray, rays: piece_rays, interrupted: piece_rays, waiting: 0 };
                self.pieces.push(piece);
            }
            first_place += u64::from(rays);
            // The upload's staging is given back before the next chunk is made.
            self.gpu.queue.submit([]);
            self.gpu.wait()?;
        }
        Ok(())
    }

    /// Casts every unfinished ray until it is finished or waits for a brick.
    pub(super) fn cast_pass(&mut self) -> Result<RawFeedback, GpuError> {
        let mut raw = RawFeedback::default();
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&self.feedback, 0, None);
        encoder.clear_buffer(&self.miss_counts, 0, None);
        self.gpu.queue.submit([encoder.finish()]);

        let mut first_round = true;
        for _ in 0..ROUND_LIMIT {
            let mut is_settled = true;
            for i in 0..self.pieces.len() {
                let piece = &self.pieces[i];
                if piece.interrupted > 0 || (first_round && piece.waiting > 0) {
                    self.cast_piece(i, first_round, &mut raw)?;
                    is_settled &= self.pieces[i].interrupted == 0;
                }
            }
            first_round = false;
            if is_settled {
                break;
            }
        }
        raw.feedback.unfinished_rays =
            self.pieces.iter().map(|p| u64::from(p.interrupted) + u64::from(p.waiting)).sum();
        self.read_feedback(&mut raw)?;
        Ok(raw)
    }

    /// One dispatch, waited for.
    fn cast_piece(&mut self, index: usize, first_round: bool, raw: &mut RawFeedback) -> Result<(), GpuError> {
        let begin = Instant::now();
        let piece = &mut self.pieces[index];
        let job = Dispatch {
            first_ray: piece.first_ray,
            ray_count: piece.rays,
            work_limit: self.work_limit,
            first_round: u32::from(first_round),
        };
        self.gpu.queue.write_buffer(&self.job, 0, bytemuck::bytes_of(&job));
        let counters_bytes = size_of::<GpuCounters>() as u64;
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&self.feedback, 0, Some(counters_bytes));
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipelines.raycast);
            pass.set_bind_group(0, &self.scene_bindings, &[]);
            pass.set_bind_group(1, &self.chunks[piece.chunk].bindings, &[]);
            pass.dispatch_workgroups(piece.rays.div_ceil(WORKGROUP_RAYS), 1, 1);
        }
        encoder.copy_buffer_to_buffer(&self.feedback, 0, &self.read_back, 0, counters_bytes);
        self.gpu.queue.submit([encoder.finish()]);
        let counters = self.gpu.read(&self.read_back, counters_bytes, bytemuck::pod_read_unaligned::<GpuCounters>)?;

        raw.feedback.add(&counters);
        piece.interrupted = counters.interrupted;
        piece.waiting = if first_round { counters.waiting } else { piece.waiting + counters.waiting };
        let ms = begin.elapsed().as_secs_f64() * 1e3;
        raw.dispatch_ms_max = raw.dispatch_ms_max.max(ms);
        self.adapt_work_limit(ms, counters.interrupted > 0);
        Ok(())
    }

    fn adapt_work_limit(&mut self, ms: f64, was_reached: bool) {
        let most = if self.gpu.is_software() { SOFTWARE_WORK_LIMIT } else { WORK_LIMIT };
        if ms > SLOW_DISPATCH_MS {
            self.work_limit = (self.work_limit / 2).max(LEAST_WORK_LIMIT);
        } else if ms < FAST_DISPATCH_MS && was_reached {
            self.work_limit = (self.work_limit * 2).min(most);
        }
    }

    /// Counts the listed misses and reads the lists back.
    fn read_feedback(&mut self, raw: &mut RawFeedback) -> Result<(), GpuError> {
        let bytes = 4 * self.feedback_words;
        let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipelines.gather_misses);
            pass.set_bind_group(0, &self.scene_bindings, &[]);
            pass.set_bind_group(1, &self.chunks[0].bindings, &[]);
            pass.dispatch_workgroups(MISS_LIMIT.div_ceil(WORKGROUP_RAYS), 1, 1);
        }
        encoder.copy_buffer_to_buffer(&self.feedback, 0, &self.read_back, 0, bytes);
        self.gpu.queue.submit([encoder.finish()]);
        self.gpu.read(&self.read_back, bytes, |bytes| {
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(bytes);
            let (misses, not_listed) = read_misses(&words);
            raw.misses = misses;
            raw.feedback.misses_not_listed = not_listed;
            raw.uses = read_uses(&words).collect();
        })
    }

    /// Hands every ray's state and pixel to `visit`; pixels may lie beyond the grid's edge.
    pub(super) fn read_states(&mut self, mut visit: impl FnMut([u32; 2], &RayState)) -> Result<(), GpuError> {
        let state_bytes = size_of::<RayState>() as u64;
        let rays_at_once = (READ_BACK_LIMIT / state_bytes) as u32;
        for chunk in &self.chunks {
            for first in (0..chunk.rays).step_by(rays_at_once as usize) {
                let bytes = u64::from(rays_at_once.min(chunk.rays - first)) * state_bytes;
                let mut encoder = self.gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
                let from = u64::from(first) * state_bytes;
                encoder.copy_buffer_to_buffer(&chunk.states, from, &self.read_back, 0, bytes);
                self.gpu.queue.submit([encoder.finish()]);
                let grid = self.grid;
                self.gpu.read(&self.read_back, bytes, |bytes| {
                    let mut state = RayState::zeroed();
                    for (place, raw) in
                        (chunk.first_place + u64::from(first)..).zip(bytes.chunks_exact(state_bytes as usize))
                    {
                        bytemuck::bytes_of_mut(&mut state).copy_from_slice(raw);
                        visit(grid.pixel(place), &state);
                    }
                })?;
            }
        }
        Ok(())
    }
}

/// A buffer that holds these bytes.
fn filled(gpu: &GpuDevice, doing: &str, bytes: &[u8], usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, GpuError> {
    let buffer = gpu.buffer(doing, bytes.len() as u64, usage)?;
    gpu.queue.write_buffer(&buffer, 0, bytes);
    Ok(buffer)
}
