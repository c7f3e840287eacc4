//! The ray caster on the GPU: the same algorithm as [`super::cpu`], shader function by shader function.
//!
//! The protocol between calls:
//! 1. [`GpuRenderer::new`] plans memory, allocates everything, and makes one ray per sample of the picture.
//! 2. [`GpuRenderer::cast_pass`] casts every unfinished ray as far as resident bricks allow, and says which bricks are
//!    missing.
//! 3. The caller answers with [`GpuRenderer::insert`] (a brick) or [`GpuRenderer::set_state`] (anything else), as many
//!    as it likes and as fit; at least one, or the next pass finds the same. Then 2 again, until every ray is finished.
//! 4. [`GpuRenderer::image`] reads the picture back, at any time.
//!
//! After [`GpuError::DeviceLost`] the renderer is of no more use: open a new device and make a new one.

mod pass;

use std::time::Instant;

use rayon::prelude::*;
use supervol_format::brick::MACRO_CELL;
use supervol_format::{BrickKey, Lod, Pyramid};

pub use crate::gpu::cache::VoxelStorage;
pub use crate::gpu::device::{GpuDevice, GpuError, may_have_hardware};
pub use crate::gpu::feedback::{GpuPassCounters, PassFeedback};
pub use crate::gpu::scene_tables::GpuVolume;

use super::cpu::Skipping;
use super::volume::{DecodedBrick, Voxels};
use crate::gpu::cache::{CacheShape, EMPTY_RANGE, GpuCache};
use crate::gpu::feedback::buffer_words;
use crate::gpu::layout::{
    Config, GpuRay, PAGE_FAILED, PAGE_MISSING, PAGE_NOTHING, PAGE_REFINE, PAGE_RESIDENT, PAGE_UNIFORM, RayState, Tables,
};
use crate::gpu::memory::{MemoryPlan, MemoryRequest, SLOT_LIMIT};
use crate::gpu::rays::RayGrid;
use crate::gpu::scene_tables;
use crate::gpu::slots::Slots;
use crate::image::Image;
use crate::lod::{LodChoice, LodRule};
use crate::scene::{Mode, ResolvedScene};
use crate::transfer_function::RenderTransferFunction;
use pass::Caster;

/// What a renderer may use, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct GpuOptions {
    /// Bytes of GPU memory in all: cache, tables, rays, staging.
    pub memory_bytes: u64,
    /// Whether macro cells that cannot change the picture are skipped.
    pub skipping: Skipping,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self { memory_bytes: 1 << 30, skipping: Skipping::On }
    }
}

/// What a brick is, where it is not resident voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PageEntry {
    /// Not resident: rays wait for it.
    Missing,
    /// It contributes nothing (absent, or in mode dvr invisible).
    Nothing,
    /// It would change the picture too much: from now on rays go on in its children. What stands in for a child that has
    /// failed is what is said of the brick, or inserted, after this.
    TooCoarse,
    /// All voxels, apron included, have this render value.
    Uniform(f32),
    /// It cannot be had: its parent is drawn.
    Failed,
}

/// What became of a brick that was offered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Insertion {
    /// It is resident; the brick named, if any, is not any more.
    Placed {
        /// Who had to leave.
        evicted: Option<BrickKey>,
    },
    /// Every slot holds a brick inserted since the last pass: cast first.
    NoRoom,
}

/// Statistics since the renderer was made.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct GpuStats {
    /// Name and kind of the adapter.
    pub adapter: String,
    /// Bytes planned, all of them allocated.
    pub planned_bytes: u64,
    /// Slots in all.
    pub slots: u64,
    /// Slots that hold a brick.
    pub slots_used: u64,
    /// Bricks inserted.
    pub insertions: u64,
    /// Bricks evicted to make room.
    pub evictions: u64,
    /// Voxel bytes handed to the GPU.
    pub upload_bytes: u64,
    /// Time spent handing them over.
    pub upload_ms: f64,
    /// Passes cast.
    pub passes: u64,
    /// Time spent in passes, read-back included.
    pub pass_ms: f64,
    /// Dispatches.
    pub dispatches: u64,
    /// The slowest dispatch.
    pub dispatch_ms_max: f64,
    /// Times a ray went on in another dispatch.
    pub interruptions: u64,
    /// Misses for which the list had no room.
    pub misses_not_listed: u64,
    /// Bricks left out because they and all their ancestors have failed, counted per ray.
    pub bricks_lost: u64,
    /// Times a shader's loop hit its limit.
    pub anomalies: u64,
}

/// See the module.
pub struct GpuRenderer {
    pyramid: Pyramid,
    storage: VoxelStorage,
    mode: Mode,
    subgrid: u32,
    tf: RenderTransferFunction,
    skipping: Skipping,
    /// For each entry from level 1 on, in order: whether the brick is too coarse.
    refine: Vec<bool>,
    /// For sorting misses: how far a brick is.
    lod: LodRule,
    slots: Slots,
    cache: GpuCache,
    caster: Caster,
    stats: GpuStats,
}

impl GpuRenderer {
    /// A renderer of one scene over one volume; nothing is resident.
    ///
    /// # Errors
    /// [`GpuError::Budget`] where the memory does not suffice, [`GpuError::TableLimit`] where the volume has too many
    /// bricks for the adapter, [`GpuError::Scene`] for what is not drawn, and whatever the driver says.
    pub fn new(
        device: &GpuDevice,
        volume: &GpuVolume<'_>,
        scene: &ResolvedScene,
        lod: LodChoice,
        options: GpuOptions,
    ) -> Result<Self, GpuError> {
        let pyramid = volume.pyramid;
        let tf = RenderTransferFunction::new(&scene.transfer_function, volume.value_map.shift);
        let rays = RayGrid { width: scene.camera.width, height: scene.camera.height };
        let tables = scene_tables::tables(volume, scene)?;
        let plan = plan_memory(device, volume, rays, &tf, options)?;
        let macro_edge = pyramid.layout().core() / MACRO_CELL;
        let shape = CacheShape {
            plan: &plan,
            storage: volume.storage,
            edge: scene_tables::slot_edge(pyramid),
            cells: macro_edge.pow(3),
            entries: pyramid.brick_count(),
        };
        let cache = GpuCache::new(device, &shape)?;
        let config = scene_tables::config(volume, scene, &tf, options.skipping, cache.grids())?;
        let caster =
            Caster::new(device, volume, scene, &pass::CasterTables { config, tables, tf: &tf, cache: &cache })?;
        let lod = LodRule::new(lod, &scene.camera, volume.geometry);
        let refine = bricks_to_refine(pyramid, &lod);
        let slots = usize::try_from(plan.slots).expect("slots are below 2^24");
        let mut renderer = Self {
            pyramid: pyramid.clone(),
            storage: volume.storage,
            mode: scene.mode,
            subgrid: scene.subgrid,
            tf,
            skipping: options.skipping,
            refine,
            lod,
            slots: Slots::new(slots),
            cache,
            caster,
            stats: GpuStats {
                adapter: device.name(),
                planned_bytes: plan.total_bytes,
                slots: plan.slots,
                ..GpuStats::default()
            },
        };
        renderer.mark_bricks_to_refine();
        Ok(renderer)
    }

    fn mark_bricks_to_refine(&mut self) {
        let first = self.first_coarse_entry();
        let entries: Vec<u32> = (first..).zip(&self.refine).filter(|(_, refine)| **refine).map(|(e, _)| e).collect();
        for entry in entries {
            self.set_page(entry, PAGE_MISSING, 0);
        }
    }

    fn first_coarse_entry(&self) -> u32 {
        entry_u32(self.pyramid.level_at(Lod::FINEST).brick_count())
    }

    fn set_page(&mut self, entry: u32, state: u32, payload: u32) {
        let coarse = entry.checked_sub(self.first_coarse_entry());
        let refine = coarse.is_some_and(|i| self.refine[i as usize]);
        self.cache.set_page(entry, [state | if refine { PAGE_REFINE } else { 0 }, payload]);
    }

    /// Bricks that fit the budget.
    #[must_use]
    pub fn slot_capacity(&self) -> usize {
        self.slots.capacity()
    }

    /// Whether the brick's voxels are resident.
    #[must_use]
    pub fn is_resident(&self, key: BrickKey) -> bool {
        self.slots.place(key).is_some()
    }

    /// Makes a brick resident; the least recently used brick leaves for it, never one inserted since the last pass.
    ///
    /// # Errors
    /// [`GpuError::Brick`] where the brick is not what the pyramid says, or a lost device.
    pub fn insert(&mut self, brick: &DecodedBrick) -> Result<Insertion, GpuError> {
        let voxels = self.checked_voxels(brick)?;
        let ranges = self.slot_ranges(brick);
        let Some((slot, evicted)) = self.slots.insert(brick.key) else { return Ok(Insertion::NoRoom) };
        if let Some(old) = evicted {
            self.set_page(entry_u32(self.pyramid.entry(old)), PAGE_MISSING, 0);
            self.stats.evictions += 1;
        }
        let begin = Instant::now();
        self.stats.upload_bytes += self.cache.write_voxels(slot, brick.extent.map(|n| n as usize), voxels)?;
        self.cache.write_ranges(slot, &ranges)?;
        self.stats.upload_ms += begin.elapsed().as_secs_f64() * 1e3;
        self.stats.insertions += 1;
        self.set_page(entry_u32(self.pyramid.entry(brick.key)), PAGE_RESIDENT, slot.0);
        Ok(Insertion::Placed { evicted })
    }

    /// Says what a brick is; if it was resident, its slot is free.
    ///
    /// # Panics
    /// If the key names no brick of the pyramid.
    pub fn set_state(&mut self, key: BrickKey, state: PageEntry) {
        self.slots.remove(key);
        let entry = entry_u32(self.pyramid.entry(key));
        if let (PageEntry::TooCoarse, Some(i)) = (state, entry.checked_sub(self.first_coarse_entry())) {
            self.refine[i as usize] = true;
        }
        let (state, payload) = match state {
            PageEntry::Missing | PageEntry::TooCoarse => (PAGE_MISSING, 0),
            PageEntry::Uniform(value) if value.is_finite() => (PAGE_UNIFORM, value.to_bits()),
            PageEntry::Nothing | PageEntry::Uniform(_) => (PAGE_NOTHING, 0),
            PageEntry::Failed => (PAGE_FAILED, 0),
        };
        self.set_page(entry, state, payload);
    }

    /// Casts every unfinished ray as far as resident bricks allow.
    ///
    /// # Errors
    /// A lost device, or what the driver says about a dispatch.
    pub fn cast_pass(&mut self) -> Result<PassFeedback, GpuError> {
        let begin = Instant::now();
        self.cache.flush_pages()?;
        let raw = self.caster.cast_pass()?;
        let mut feedback = raw.feedback;
        self.slots.end_pass(raw.uses.iter().copied());
        feedback.uses = raw.uses.iter().filter_map(|&slot| self.slots.key(slot)).collect();
        feedback.misses = raw
            .misses
            .iter()
            .map(|&(entry, rays)| {
                let key = self.pyramid.key(u64::from(entry)).expect("the shader names entries of the page table");
                super::cpu::Miss { key, rays: u64::from(rays), nearest: self.lod.distance(&self.pyramid, key) }
            })
            .collect();
        feedback.misses.sort_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.key.cmp(&b.key)));
        self.stats.passes += 1;
        self.stats.pass_ms += begin.elapsed().as_secs_f64() * 1e3;
        self.stats.dispatches += feedback.gpu.dispatches;
        self.stats.dispatch_ms_max = self.stats.dispatch_ms_max.max(raw.dispatch_ms_max);
        self.stats.interruptions += feedback.gpu.interruptions;
        self.stats.misses_not_listed += feedback.misses_not_listed;
        self.stats.bricks_lost += feedback.gpu.bricks_lost;
        self.stats.anomalies += feedback.gpu.anomalies;
        Ok(feedback)
    }

    /// The picture of what the rays have gathered, sub-grid averaged.
    ///
    /// # Errors
    /// A lost device.
    pub fn image(&mut self) -> Result<Image, GpuError> {
        let RayGrid { width, height } = self.caster.grid();
        let mut pixels = vec![[0.0; 4]; width as usize * height as usize];
        let (mode, tf) = (self.mode, &self.tf);
        self.caster.read_states(|[x, y], state| {
            if x < width && y < height {
                pixels[y as usize * width as usize + x as usize] = pixel(mode, tf, state);
            }
        })?;
        Ok(Image { width, height, pixels }.downsampled(self.subgrid))
    }

    /// Statistics since the renderer was made.
    #[must_use]
    pub fn stats(&self) -> GpuStats {
        GpuStats { slots_used: self.slots.occupied() as u64, ..self.stats.clone() }
    }

    fn checked_voxels<'b>(&self, brick: &'b DecodedBrick) -> Result<&'b [u8], GpuError> {
        let wrong = |reason: String| Err(GpuError::Brick { key: brick.key, reason });
        let (storage, voxels): (_, &[u8]) = match &brick.voxels {
            Voxels::U8(v) => (VoxelStorage::U8, v),
            Voxels::U16(v) => (VoxelStorage::U16, bytemuck::cast_slice(v)),
            Voxels::F32(v) => (VoxelStorage::F32, bytemuck::cast_slice(v)),
        };
        if !self.pyramid.contains(brick.key) {
            return wrong("the pyramid has no such brick".to_owned());
        }
        let expected = self.pyramid.stored_extent(brick.key);
        if brick.extent.map(|n| n as usize) != expected {
            return wrong(format!("its extent is {:?}, expected {expected:?}", brick.extent));
        }
        if storage != self.storage {
            return wrong(format!("its voxels are {storage:?}, expected {:?}", self.storage));
        }
        let bytes = expected.iter().product::<usize>() * storage.bytes() as usize;
        if voxels.len() != bytes {
            return wrong(format!("it has {} bytes of voxels, expected {bytes}", voxels.len()));
        }
        let cells = self.pyramid.macro_cells(brick.key).iter().product::<usize>();
        if brick.macro_ranges.len() != cells {
            return wrong(format!("it has {} macro ranges, expected {cells}", brick.macro_ranges.len()));
        }
        Ok(voxels)
    }

    /// The ranges of a full slot's macro cells; those that nothing can be seen in are empty.
    fn slot_ranges(&self, brick: &DecodedBrick) -> Vec<[f32; 2]> {
        let edge = self.pyramid.layout().core() / MACRO_CELL;
        let [nx, ny, _] = self.pyramid.macro_cells(brick.key);
        let mut ranges = vec![EMPTY_RANGE; edge.pow(3)];
        for (i, &[low, high]) in brick.macro_ranges.iter().enumerate() {
            let present = low <= high && low.is_finite() && high.is_finite();
            if present && (self.mode != Mode::Dvr || self.tf.is_visible(low, high)) {
                let [x, y, z] = [i % nx, i / nx % ny, i / (nx * ny)];
                ranges[x + edge * (y + edge * z)] = [low, high];
            }
        }
        ranges
    }

    /// Whether macro cells are skipped.
    #[must_use]
    pub fn skipping(&self) -> Skipping {
        self.skipping
    }
}

/// The pixel of one ray's state; twin of the CPU frame's.
fn pixel(mode: Mode, tf: &RenderTransferFunction, state: &RayState) -> [f32; 4] {
    let value = match mode {
        Mode::Dvr | Mode::Iso | Mode::Slice => {
            let [r, g, b] = state.color;
            return [r, g, b, 1.0 - state.transmittance];
        }
        _ if state.present <= 0.0 => return [0.0; 4],
        Mode::Mip | Mode::Minip => state.value,
        Mode::Mean => state.value / state.present,
    };
    let [r, g, b, alpha] = tf.classify(value);
    [r * alpha, g * alpha, b * alpha, alpha]
}

fn entry_u32(entry: u64) -> u32 {
    u32::try_from(entry).expect("the renderer refuses pyramids with more bricks than 32 bits count")
}

/// For each entry from level 1 on: whether the brick is too coarse. `f64` and in one place: both backends agree.
fn bricks_to_refine(pyramid: &Pyramid, lod: &LodRule) -> Vec<bool> {
    let first = pyramid.level_at(Lod::FINEST).brick_count();
    (first..pyramid.brick_count())
        .into_par_iter()
        .map(|entry| !lod.is_fine_enough(pyramid, pyramid.key(entry).expect("entries below the count have keys")))
        .collect()
}

fn plan_memory(
    device: &GpuDevice,
    volume: &GpuVolume<'_>,
    rays: RayGrid,
    tf: &RenderTransferFunction,
    options: GpuOptions,
) -> Result<MemoryPlan, GpuError> {
    let entries = volume.pyramid.brick_count();
    let limits = device.limits();
    let binding = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    if entries * 8 > binding {
        return Err(GpuError::TableLimit {
            what: format!("the page table of {entries} bricks"),
            needed: entries * 8,
            limit: binding,
            advice: "convert the volume with larger bricks, or use --backend cpu".to_owned(),
        });
    }
    let per_ray = (size_of::<GpuRay>() + size_of::<RayState>()) as u64;
    // Page table and miss counters; feedback twice, for it is read back; points and index of the transfer function.
    let fixed = rays.places() * per_ray
        + entries * 12
        + 2 * 4 * buffer_words(entries.min(SLOT_LIMIT))
        + 64 * tf.points.len() as u64
        + 4 * (tf.bins.len() + tf.knots.len()) as u64
        + (size_of::<Config>() + size_of::<Tables>()) as u64
        + pass::read_back_bytes(rays.places());
    let macro_edge = (volume.pyramid.layout().core() / MACRO_CELL) as u64;
    MemoryPlan::new(&MemoryRequest {
        budget_bytes: options.memory_bytes,
        fixed_bytes: fixed,
        slot_edge: scene_tables::slot_edge(volume.pyramid),
        texel_bytes: u64::from(volume.storage.bytes()),
        ranges_bytes: macro_edge.pow(3) * 8,
        useful_slots: entries,
        max_dimension: limits.max_texture_dimension_3d,
        max_binding_bytes: binding,
    })
}
