//! The ray caster on the GPU: the same algorithm as [`crate::engines::packets`], shader function by shader function.
//!
//! The protocol between calls:
//! 1. [`GpuRenderer::new`] plans memory and allocates everything.
//! 1. [`GpuRenderer::new`] plans memory and allocates everything.
//! 2. [`GpuRenderer::cast_pass`] casts every unfinished ray as far as resident bricks allow, and returns the missing
//!    bricks.
//! 3. The caller answers with [`GpuRenderer::insert`] (a brick) or [`GpuRenderer::set_state`] (anything else), as often
//!    as it likes. At least one answer is needed, or the next pass returns the same. Repeat from 2 until every ray is
//!    finished.
//! 4. [`GpuRenderer::image`] reads the picture back, at any time.
//! 5. [`GpuRenderer::set_scene`] begins another picture: bricks stay resident, and only some kilobytes of tables are
//!    written.
//!
//! Pictures that are too large to be cast at once are cast in bands of rows ([`GpuRenderer::begin`]). After
//! [`GpuError::DeviceLost`] the renderer is useless: open a new device and make a new renderer.

use std::ops::Range;
use std::time::Instant;

use bytemuck::Zeroable;
use rayon::prelude::*;
use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::{narrow, single};
use supervol_format::{BrickKey, Lod, Pyramid};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::value_map::ValueMap;

use crate::engines::gpu::cache::{BlockRanges, CacheShape, GpuCache, SlotContents};
use crate::engines::gpu::deviations::DeviationOf;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::feedback::DeviceFeedback;
use crate::engines::gpu::layout::{
    DEVIATION_NONE, DEVIATION_UNKNOWN, Dispatch, PAGE_DEVIATION_SHIFT, PAGE_FAILED, PAGE_MISSING, PAGE_NOTHING,
    PAGE_REFINE, PAGE_RESIDENT, PAGE_UNIFORM, Scene,
};
use crate::engines::gpu::memory::{MemoryPlan, MemoryRequest, SLOT_LIMIT};
use crate::engines::gpu::options::GpuOptions;
use crate::engines::gpu::page_table::PageTable;
use crate::engines::gpu::pass::{Capacity, DeviceCaster};
use crate::engines::gpu::picture::{PIXELS_TOGETHER, Picture, over_rays, pixel};
use crate::engines::gpu::rays::{RayGrid, ViewLines};
use crate::engines::gpu::scene_tables::{FeedbackPlaces, GpuVolume};
use crate::engines::gpu::slots::{SlotIndex, Slots};
use crate::engines::gpu::texels::VoxelStorage;
use crate::engines::gpu::{pass, scene_tables};
use crate::engines::totals::GpuStats;
use crate::lod::LodChoice;
use crate::stop::Stop;
use crate::stream::classify::Skipping;
use crate::stream::counters::{DeviceCounters, milliseconds};
use crate::stream::field::{Field, FieldBrick};
use crate::stream::held::{BrickRef, ReadBrick};
use crate::stream::residency::DecodedBrick;

/// Handling of the answers in the page table when a scene is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KnownAnswers {
    /// They hold for the new scene, too.
    Keep,
    /// They may be wrong for it.
    Forget,
}

/// State of a brick without resident voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PageEntry {
    /// Not resident: rays wait for it.
    Missing,
    /// It contributes nothing (absent, or in mode dvr invisible).
    Nothing,
    /// It would change the picture too much: rays continue in its children. A later answer or insertion for
    /// the same brick applies where it stands in for a failed child.
    TooCoarse,
    /// All voxels, apron included, have this render value.
    Uniform(f32),
    /// It is unavailable: its parent is drawn.
    Failed,
}

/// Result of inserting a brick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Insertion {
    /// It is resident; the evicted brick, if any, no longer is.
    Placed {
        /// The brick that was evicted.
        evicted: Option<BrickKey>,
    },
    /// Every slot holds a brick inserted since the last pass: cast first.
    NoRoom,
}

/// See the module.
pub struct GpuRenderer {
    gpu: GpuDevice,
    /// The field that is drawn. Its bricks go by their keys here; slots and page table use field and key.
    field: Field,
    pub(crate) pyramid: Pyramid,
    pub(crate) storage: VoxelStorage,
    pub(crate) value_map: ValueMap,
    options: GpuOptions,
    capacity: Capacity,
    slots: Slots,
    cache: GpuCache,
    pub(crate) caster: DeviceCaster,
    pub(crate) picture: Picture,
    parts: PartsInProgress,
    /// The first pass of the band in progress.
    first_pass: u64,
    /// Slots filled since the last pass, whose visibility is not computed yet.
    unclassified: Vec<SlotIndex>,
    /// Deviations of bricks, if errors are summed up.
    deviation_of: Option<DeviationOf>,
    stats: GpuStats,
    /// Device counters before the renderer was made.
    traffic_before: DeviceCounters,
}

/// Progress of a band whose rays solids cut into parts.
#[derive(Default)]
struct PartsInProgress {
    first_row: u32,
    /// Rays that have at least one part.
    rays: u64,
    /// Number of the current part.
    number: usize,
    /// Places of the rays that have another part behind it.
    more: Vec<u32>,
}

impl std::fmt::Debug for GpuRenderer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("GpuRenderer").field("device", &self.gpu).field("options", &self.options).finish_non_exhaustive()
    }
}

impl GpuRenderer {
    /// A renderer of one volume, with its first scene; nothing is resident. Errors of rays are summed up if
    /// `deviation_of` is given and there is memory for it ([`GpuOptions::sums_errors`]).
    ///
    /// # Errors
    /// - [`GpuError::Budget`]: the memory does not suffice.
    /// - [`GpuError::TableLimit`]: the volume has too many bricks for the adapter.
    /// - [`GpuError::Scene`]: the scene is not supported.
    /// - Errors of the driver.
    pub fn new(
        device: &GpuDevice,
        volume: &GpuVolume<'_>,
        scene: &ResolvedScene,
        lod: LodChoice,
        options: GpuOptions,
        deviation_of: Option<DeviationOf>,
    ) -> Result<Self, GpuError> {
        let deviation_of = deviation_of.filter(|_| options.sums_errors);
        let traffic_before = device.traffic();
        let pyramid = volume.pyramid;
        let pages = PageTable::new([pyramid.clone()]);
        let picture = Picture::new(volume, scene, lod, (&options, deviation_of.is_some()), None);
        let capacity = picture.capacity_with_room(pages.count(), &options);
        let plan = plan_memory(device, (volume, pages.count()), &capacity, options)?;
        let shape = CacheShape {
            plan: &plan,
            storage: volume.storage,
            edge: scene_tables::slot_edge(pyramid),
            cells: (pyramid.layout().core() / MACRO_CELL).pow(3),
            sums_errors: options.sums_errors,
        };
        let cache = GpuCache::new(device, &shape, pages)?;
        let slots = usize::try_from(plan.slots).expect("slots are below 2^24");
        let mut renderer = Self {
            gpu: device.clone(),
            field: Field::FIRST,
            pyramid: pyramid.clone(),
            storage: volume.storage,
            value_map: *volume.value_map,
            options,
            capacity,
            slots: Slots::new(slots),
            caster: DeviceCaster::new(device, &cache, &capacity)?,
            cache,
            picture,
            parts: PartsInProgress::default(),
            first_pass: 0,
            unclassified: Vec::new(),
            deviation_of,
            stats: GpuStats {
                adapter: device.name(),
                planned_bytes: plan.total_bytes,
                slots: plan.slots,
                ..GpuStats::default()
            },
            traffic_before,
        };
        renderer.write_tables(volume, scene)?;
        renderer.write_pages();
        renderer.begin(0..renderer.band_rows().min(scene.camera.height));
        Ok(renderer)
    }

    /// Sets the requested error from the next picture on; see [`GpuOptions::max_error`].
    pub fn set_max_error(&mut self, max_error: f64) {
        self.options.max_error = max_error;
    }

    /// Sets the deviations of bricks from the next picture on, if errors are to be summed up. Answers are the same only
    /// if this is.
    pub fn set_deviations(&mut self, deviation_of: Option<DeviationOf>) {
        self.deviation_of = deviation_of;
    }

    /// Begins another picture of the same volume; returns false if there is no memory for this size. Bricks stay
    /// resident. All other answers are forgotten, unless `known` says that they would be the same. Failed
    /// bricks are requested again in any case.
    ///
    /// # Errors
    /// [`GpuError::Scene`] for unsupported scenes.
    pub fn set_scene(
        &mut self,
        volume: &GpuVolume<'_>,
        scene: &ResolvedScene,
        lod: LodChoice,
        known: KnownAnswers,
    ) -> Result<bool, GpuError> {
        let sums_errors = self.deviation_of.is_some();
        let mut picture = Picture::new(volume, scene, lod, (&self.options, sums_errors), Some(&self.picture));
        if !self.capacity.holds(&picture.capacity(self.cache.pages.count(), sums_errors)) {
            return Ok(false);
        }
        if known == KnownAnswers::Keep {
            picture.refine.clone_from(&self.picture.refine);
        }
        let before = std::mem::replace(&mut self.picture, picture);
        self.stats.dispatch_ms_max = 0.0;
        self.write_tables(volume, scene)?;
        if known == KnownAnswers::Keep {
            before.failed.into_iter().for_each(|entry| self.set_page(entry, PAGE_MISSING, 0));
        } else {
            self.cache.clear_pages();
            self.write_pages();
        }
        self.unclassified = self.slots.iter().map(|(_, slot)| slot).collect();
        self.begin(0..self.band_rows().min(scene.camera.height));
        Ok(true)
    }

    /// Writes the tables of the picture.
    fn write_tables(&mut self, volume: &GpuVolume<'_>, scene: &ResolvedScene) -> Result<(), GpuError> {
        let places = FeedbackPlaces {
            grids: self.cache.grids(),
            slots: self.cache.slot_count(),
            entries: self.cache.pages.count(),
        };
        let Picture { tf, light, exactness, .. } = &self.picture;
        let mut config = scene_tables::config(volume, scene, tf, light, *exactness, places)?;
        config.work_limit = pass::work_limit(&self.gpu, config.flags);
        let tables = scene_tables::tables(volume, scene)?;
        let dims = self.pyramid.level_at(Lod::FINEST).dims;
        let lines = ViewLines::new(&scene.camera, volume.geometry, dims);
        config.stride = single(lines.stride());
        let mut view = lines.view(&scene.camera, volume.geometry, dims, &scene.clip)?;
        view.first_value = match scene.mode {
            Mode::Mip => f32::MIN,
            Mode::Minip => f32::MAX,
            _ => 0.0,
        };
        view.in_parts = u32::from(self.picture.parts.is_some());
        self.caster.set_scene(&self.cache, &Scene { config, tables, view, job: Dispatch::zeroed() }, tf, light)
    }

    /// Number of coarsest levels whose bricks are all too coarse.
    fn refined_levels(&self) -> u32 {
        let coarsest = self.picture.refine.iter().rposition(|refine| !refine).map_or(0, |i| {
            let entry = self.pyramid.level_at(Lod::FINEST).brick_count() + i as u64;
            self.pyramid.key(entry).expect("entries below the count have keys").lod().0.into()
        });
        narrow::<u32>(self.pyramid.levels().len() - 1 - coarsest)
    }

    /// Writes the known entries when a picture begins: resident bricks, and bricks that are too coarse.
    fn write_pages(&mut self) {
        let first = self.first_coarse_entry();
        let refined = (first..).zip(&self.picture.refine).filter(|(_, refine)| **refine).map(|(entry, _)| entry);
        for entry in refined.collect::<Vec<u32>>() {
            self.set_page(entry, PAGE_MISSING, 0);
        }
        for (key, slot) in self.slots.iter().collect::<Vec<_>>() {
            self.set_page(self.cache.pages.entry(key), PAGE_RESIDENT, slot.0);
        }
    }

    /// Rows of the picture that are cast at once.
    #[must_use]
    pub fn band_rows(&self) -> u32 {
        pass::band_rows(self.picture.size[0], self.picture.subgrid, self.sums_errors())
    }

    /// Whether errors of rays are summed up.
    pub fn sums_errors(&self) -> bool {
        self.picture.exactness.sums_errors
    }

    /// Rays along an edge of a pixel.
    #[must_use]
    pub fn subgrid(&self) -> u32 {
        self.picture.subgrid
    }

    /// Begins the rays of these rows, numbered from the top; at most [`Self::band_rows`].
    pub fn begin(&mut self, rows: Range<u32>) {
        let first_row = rows.start;
        self.first_pass = self.slots.coming_pass();
        self.caster.begin(rows);
        if let Some(parts) = &self.picture.parts {
            let current = parts.first(self.caster.grid(), first_row);
            self.caster.begin_parts(&current.parts);
            self.parts = PartsInProgress { first_row, rays: current.parts.len() as u64, number: 0, more: current.more };
        }
    }

    /// Starts the rays on their next part; returns whether any ray has one.
    fn begin_next_part(&mut self) -> bool {
        let places = std::mem::take(&mut self.parts.more);
        let Some(parts) = self.picture.parts.as_ref().filter(|_| !places.is_empty()) else { return false };
        self.parts.number += 1;
        let current = parts.current(self.caster.grid(), self.parts.first_row, &places, self.parts.number);
        self.caster.begin_parts(&current.parts);
        self.parts.more = current.more;
        true
    }

    fn first_coarse_entry(&self) -> u32 {
        self.cache.pages.first_coarse_entry(self.field)
    }

    fn set_page(&mut self, entry: u32, state: u32, payload: u32) {
        let coarse = entry.checked_sub(self.first_coarse_entry());
        let refine = coarse.is_some_and(|i| self.picture.refine[i as usize]);
        let deviation = self.deviation_number(entry, state) << PAGE_DEVIATION_SHIFT;
        self.cache.pages.set(entry, [state | deviation | if refine { PAGE_REFINE } else { 0 }, payload]);
    }

    /// Number of the deviation of a page in this state.
    fn deviation_number(&mut self, entry: u32, state: u32) -> u32 {
        match (&self.deviation_of, state) {
            (None, _) | (_, PAGE_MISSING) => DEVIATION_NONE,
            (_, PAGE_FAILED) => DEVIATION_UNKNOWN,
            (Some(deviation_of), _) => {
                let key = self.cache.pages.brick(entry).expect("entries below the count have keys");
                self.cache.deviations.number_of(&deviation_of(key.brick), self.picture.shift)
            }
        }
    }

    /// Number of bricks that fit the budget.
    #[must_use]
    pub fn slot_capacity(&self) -> usize {
        self.slots.capacity()
    }

    /// Whether the brick's voxels are resident.
    #[must_use]
    pub fn is_resident(&self, key: BrickKey) -> bool {
        self.slots.place(self.field.brick(key)).is_some()
    }

    /// All resident bricks.
    pub fn resident(&self) -> impl Iterator<Item = FieldBrick> + '_ {
        self.slots.iter().map(|(key, _)| key)
    }

    /// Makes bricks resident, as far as there is room ([`Self::insert`]); all threads of the pool make their texels.
    ///
    /// # Errors
    /// As [`Self::insert`].
    pub fn insert_all(&mut self, bricks: &[BrickRef<'_>]) -> Result<(), GpuError> {
        // Texels of as many bricks as there are threads are held at once.
        for bricks in bricks.chunks(rayon::current_num_threads()) {
            let begin = Instant::now();
            let bricks: Vec<ReadBrick<'_>> = bricks.iter().map(|brick| brick.read()).collect();
            let contents = bricks.par_iter().map(|brick| self.contents_of(brick)).collect::<Result<Vec<_>, _>>()?;
            self.stats.counters.upload_ms += milliseconds(begin.elapsed());
            for (brick, contents) in bricks.iter().zip(&contents) {
                // Bricks without a slot are missing again in the next pass.
                if self.insert_contents(brick, contents)? == Insertion::NoRoom {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// Makes a brick resident. The least recently used brick is evicted, never one inserted since the last pass.
    ///
    /// # Errors
    /// [`GpuError::Brick`] if the brick does not match the pyramid, or a lost device.
    pub fn insert(&mut self, brick: &DecodedBrick) -> Result<Insertion, GpuError> {
        let contents = self.contents_of(brick)?;
        self.insert_contents(brick, &contents)
    }

    fn insert_contents(&mut self, brick: &DecodedBrick, contents: &SlotContents) -> Result<Insertion, GpuError> {
        let key = self.field.brick(brick.key);
        let entry = self.cache.pages.entry(key);
        if let Some(slot) = self.slots.place(key) {
            self.set_page(entry, PAGE_RESIDENT, slot.0);
            return Ok(Insertion::Placed { evicted: None });
        }
        let Some((slot, evicted)) = self.slots.insert(key) else { return Ok(Insertion::NoRoom) };
        if let Some(old) = evicted {
            self.set_page(self.cache.pages.entry(old), PAGE_MISSING, 0);
            self.stats.counters.evictions += 1;
        }
        let begin = Instant::now();
        self.stats.counters.upload_bytes += self.cache.write(slot, contents)?;
        self.stats.counters.upload_ms += milliseconds(begin.elapsed());
        self.stats.counters.page_ins += 1;
        self.unclassified.push(slot);
        self.set_page(entry, PAGE_RESIDENT, slot.0);
        Ok(Insertion::Placed { evicted: evicted.map(|old| old.brick) })
    }

    /// Answers a brick. If it was resident, its slot becomes free, unless it is too coarse: it may stand in for its
    /// children.
    ///
    /// # Panics
    /// If the pyramid has no such brick.
    pub fn set_state(&mut self, key: BrickKey, state: PageEntry) {
        let key = self.field.brick(key);
        let entry = self.cache.pages.entry(key);
        if let (PageEntry::TooCoarse, Some(i)) = (state, entry.checked_sub(self.first_coarse_entry())) {
            self.picture.refine[i as usize] = true;
            if let Some(slot) = self.slots.place(key) {
                return self.set_page(entry, PAGE_RESIDENT, slot.0);
            }
        }
        self.slots.remove(key);
        if state == PageEntry::Failed {
            self.picture.failed.push(entry);
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
    /// A lost device, or an error of the driver at a dispatch.
    pub fn cast_pass(&mut self) -> Result<DeviceFeedback, GpuError> {
        self.cast_pass_until(&Stop::NEVER)
    }

    /// The same, but rays pause when `stop` is due.
    ///
    /// # Errors
    /// As [`Self::cast_pass`].
    pub fn cast_pass_until(&mut self, stop: &Stop) -> Result<DeviceFeedback, GpuError> {
        let begin = Instant::now();
        self.cache.flush_pages()?;
        if !self.unclassified.is_empty() {
            self.unclassified.sort_unstable();
            self.unclassified.dedup();
            self.caster.classify(&self.cache, &self.unclassified);
            self.unclassified.clear();
        }
        if !self.has_room_for_scouts() {
            self.caster.end_scouting();
        }
        let refined_levels = self.refined_levels();
        let mut raw = self.caster.cast_pass(refined_levels, stop)?;
        while raw.is_finished() && self.begin_next_part() {
            raw = raw.followed_by(self.caster.cast_pass(refined_levels, stop)?);
        }
        let is_finished = raw.is_finished();
        let mut feedback = raw.feedback;
        feedback.is_stopped = raw.is_stopped;
        if self.picture.parts.is_some() {
            // A ray is finished when its last part is, and all rays finish their last parts at the end.
            feedback.counters.rays_finished = if is_finished { std::mem::take(&mut self.parts.rays) } else { 0 };
        }
        self.slots.end_pass(raw.uses.iter().copied());
        feedback.uses = raw.uses.iter().filter_map(|&slot| self.slots.key(slot)).map(|key| key.brick).collect();
        feedback.misses = raw
            .misses
            .iter()
            .map(|&(entry, rays)| {
                let key = self.cache.pages.brick(entry).expect("the shader names entries of the page table").brick;
                crate::engines::feedback::Miss {
                    key,
                    rays: u64::from(rays),
                    nearest: self.picture.lod.distance(&self.pyramid, key),
                }
            })
            .collect();
        feedback.misses.sort_by(|a, b| a.nearest.total_cmp(&b.nearest).then(a.key.cmp(&b.key)));
        feedback.device.passes = 1;
        feedback.device.pass_ms = milliseconds(begin.elapsed());
        self.stats.counters.add(&feedback.device);
        self.stats.dispatch_ms_max = self.stats.dispatch_ms_max.max(raw.dispatch_ms_max);
        Ok(feedback)
    }

    /// Whether bricks that scouts ask for will still be resident when the other rays need them. For a volume that does
    /// not fit, half of the slots are kept for the other rays.
    fn has_room_for_scouts(&self) -> bool {
        let slots = self.slots.capacity();
        slots as u64 >= self.cache.pages.count() || 2 * self.slots.used_since(self.first_pass) < slots
    }

    /// Pixels of the band along x and y.
    fn band_size(&self) -> [u32; 2] {
        let RayGrid { width, height } = self.caster.grid();
        [width, height].map(|rays| rays / self.picture.subgrid)
    }

    /// The picture of the light gathered by the rays of the band, sub-grid averaged.
    ///
    /// # Errors
    /// A lost device.
    pub fn image(&mut self) -> Result<Image, GpuError> {
        let [width, height] = self.band_size();
        let mut pixels = vec![[0.0; 4]; width as usize * height as usize];
        self.write_image(&mut pixels)?;
        Ok(Image { width, height, pixels })
    }

    /// The same, written into `to`, row by row.
    ///
    /// # Errors
    /// A lost device.
    ///
    /// # Panics
    /// If the number of pixels differs.
    pub fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), GpuError> {
        let Picture { mode, tf, .. } = &self.picture;
        let caster = &mut self.caster;
        over_rays(caster.grid(), self.picture.subgrid, to, |rays| {
            caster.read_pixels(false, |first, gathered, _| {
                let rays = rays[first..].par_iter_mut().zip(gathered).with_min_len(PIXELS_TOGETHER);
                rays.for_each(|(to, gathered)| *to = pixel(*mode, tf, gathered));
            })
        })
    }

    /// Statistics since the renderer was made.
    #[must_use]
    pub fn stats(&self) -> GpuStats {
        let mut counters = self.gpu.traffic().since(&self.traffic_before);
        counters.add(&self.stats.counters);
        GpuStats { slots_used: self.slots.occupied() as u64, counters, ..self.stats.clone() }
    }

    /// Whether macro cells are skipped.
    #[must_use]
    pub fn skipping(&self) -> Skipping {
        self.options.skipping
    }
}

fn plan_memory(
    device: &GpuDevice,
    (volume, entries): (&GpuVolume<'_>, u64),
    capacity: &Capacity,
    options: GpuOptions,
) -> Result<MemoryPlan, GpuError> {
    let limits = device.limits();
    let binding = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    if entries * 8 > binding || u32::try_from(entries).is_err() {
        return Err(GpuError::TableLimit {
            what: format!("the page table of {entries} bricks"),
            needed: entries.saturating_mul(8),
            limit: binding,
            advice: "convert the volume with larger bricks, or use the CPU backend".to_owned(),
        });
    }
    let macro_edge = (volume.pyramid.layout().core() / MACRO_CELL) as u64;
    MemoryPlan::new(&MemoryRequest {
        budget_bytes: options.memory_bytes,
        fixed_bytes: entries * 8 + capacity.bytes(entries.min(SLOT_LIMIT)),
        slot_texels: volume.storage.texels([scene_tables::slot_edge(volume.pyramid); 3]),
        // For each macro cell its range, those of its blocks and its proximity; and the slot's place in a list.
        ranges_bytes: macro_edge.pow(3) * (12 + size_of::<BlockRanges>() as u64) + 4,
        useful_slots: entries,
        max_dimension: limits.max_texture_dimension_3d,
        max_binding_bytes: binding,
    })
}
