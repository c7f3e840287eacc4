//! The GPU ray caster in a frame: bricks go from the host cache to its slots.
//!
//! Its page table is its own memory of what bricks are: a brick that the host cache dropped may still be resident there,
//! and one that is in the host cache may have to be copied again.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{BrickKey, Container, Pyramid, VoxelType};

use super::caster::{CasterTotals, PassReport, RayCaster};
use super::{FrameWalk, RenderError, RenderOptions, lod_choice, plan_host_for, streamer_for};
use crate::facts::value_map;
use crate::image::Image;
use crate::raycast::cpu::Counters;
use crate::raycast::gpu::{
    GpuDevice, GpuError, GpuOptions, GpuRenderer, GpuVolume, Insertion, PageEntry, VoxelStorage,
};
use crate::raycast::volume::{BrickView, Resident};
use crate::scene::ResolvedScene;
use crate::stats::FrameStats;
use crate::stop::Stop;
use crate::streamer::budget::{CasterBytes, HostPlan};
use crate::streamer::{Fetched, HostView, OnMissing, Streamer};
use crate::units::InUnits;

/// The ray caster in WGSL.
struct GpuCaster {
    renderer: GpuRenderer,
    pyramid: Pyramid,
    rays: u64,
    height: u32,
    counters: Counters,
}

/// Makes the picture on a GPU, from what the streamer has and fetches.
///
/// # Errors
/// As [`crate::renderer::render`], and whatever the GPU cannot do.
pub(crate) fn render_gpu(
    device: &GpuDevice,
    scene: &ResolvedScene,
    options: &RenderOptions,
    streamer: &mut Streamer,
    plan: HostPlan,
    stop: &Stop,
) -> Result<(Image, FrameStats), RenderError> {
    let container = streamer.container().clone();
    let descriptor = container.descriptor();
    let map = value_map(&container);
    let InUnits { geometry, value_range, .. } = InUnits::of(&container);
    let volume = GpuVolume {
        pyramid: &descriptor.pyramid,
        geometry: &geometry,
        value_map: &map,
        value_range,
        storage: storage(descriptor.voxel_type),
    };
    let gpu_options = GpuOptions { memory_bytes: options.gpu_memory_bytes, skipping: options.skipping };
    let renderer = GpuRenderer::new(device, &volume, scene, lod_choice(options), gpu_options)?;
    let mut caster = GpuCaster {
        renderer,
        pyramid: descriptor.pyramid.clone(),
        rays: u64::from(scene.camera.width) * u64::from(scene.camera.height),
        height: scene.image_size[1],
        counters: Counters::default(),
    };
    let mut walk = FrameWalk::new(streamer, plan, options, Instant::now()).until(stop.clone());
    let image = walk.run(&mut caster, scene.image_size)?;
    Ok((image, FrameStats { backend: "gpu", ..walk.into_stats() }))
}

/// Draws on `device`; should that be lost, once more on what `reopen` gives, which takes its place: the GPU's memory is
/// filled again. The statistics tell of the loss, and what the lost device had done is not in them.
///
/// # Errors
/// As `draw`; the loss itself where the second device cannot be opened, or is lost, too.
pub(crate) fn surviving(
    device: &mut GpuDevice,
    reopen: &dyn Fn() -> Result<GpuDevice, GpuError>,
    mut draw: impl FnMut(&GpuDevice) -> Result<(Image, FrameStats), RenderError>,
) -> Result<(Image, FrameStats), RenderError> {
    let lost = match draw(device) {
        Err(RenderError::Gpu(GpuError::DeviceLost { message })) => message,
        other => return other,
    };
    let Ok(second) = reopen() else { return Err(GpuError::DeviceLost { message: lost }.into()) };
    *device = second;
    let (image, stats) = draw(device)?;
    Ok((image, FrameStats { gpu_lost_because: Some(lost), ..stats }))
}

/// One picture on `device`, or on what `reopen` gives should that be lost, on the calling thread's pool.
///
/// # Errors
/// As any picture; the loss itself where the second device cannot be opened, or is lost, too.
pub fn render_gpu_surviving(
    mut device: GpuDevice,
    reopen: &dyn Fn() -> Result<GpuDevice, GpuError>,
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    let plan = plan_host_for(CasterBytes::ON_DEVICE, container, scene, options, options.time_budget_ms.is_some())?;
    let stop = Stop::at(options.time_budget_ms.map(|ms| Instant::now() + Duration::from_millis(ms)));
    surviving(&mut device, reopen, |device| {
        let mut streamer = streamer_for(container, scene, options, plan);
        render_gpu(device, scene, options, &mut streamer, plan, &stop)
    })
}

/// How bricks of this type are decoded: see [`crate::raycast::volume::Voxels`].
fn storage(voxel_type: VoxelType) -> VoxelStorage {
    match voxel_type.bytes() {
        1 => VoxelStorage::U8,
        2 => VoxelStorage::U16,
        _ => VoxelStorage::F32,
    }
}

impl GpuCaster {
    /// Copies a brick of the host cache to a slot, if there is one for it.
    fn insert(&mut self, view: &HostView<'_>, key: BrickKey) -> Result<(), RenderError> {
        if let (Resident::Brick(brick), false) = (view.stand_in(key), self.renderer.is_resident(key)) {
            if matches!(view.lookup(key), Resident::TooCoarse) {
                self.renderer.set_state(key, PageEntry::TooCoarse);
            }
            // A brick for which there is no slot is missed again in the next pass.
            let (Insertion::Placed { .. } | Insertion::NoRoom) = self.renderer.insert(brick)?;
        }
        Ok(())
    }

    /// Says what a brick is that has no voxels to copy.
    fn answer(&mut self, view: &HostView<'_>, key: BrickKey) {
        if matches!(view.lookup(key), Resident::TooCoarse) {
            self.renderer.set_state(key, PageEntry::TooCoarse);
        }
        match view.stand_in(key) {
            Resident::Nothing => self.renderer.set_state(key, PageEntry::Nothing),
            Resident::Uniform(value) => self.renderer.set_state(key, PageEntry::Uniform(value)),
            Resident::UseParent => self.renderer.set_state(key, PageEntry::Failed),
            Resident::Brick(_) | Resident::Missing | Resident::TooCoarse => {}
        }
    }

    /// Nothing is waited for any more: what is not resident is drawn from its parent, and the coarsest brick is there.
    fn stop_waiting(&mut self, view: &HostView<'_>) -> Result<(), RenderError> {
        let coarsest = self.pyramid.coarsest();
        let keys: Vec<BrickKey> = self.pyramid.keys_of(coarsest).collect();
        keys.into_iter().try_for_each(|key| self.insert(view, key))?;
        for entry in 0..self.pyramid.brick_count() {
            let key = self.pyramid.key(entry).expect("entries below the count have keys");
            if self.renderer.is_resident(key) {
                continue;
            }
            self.answer(view, key);
            if matches!(view.stand_in(key), Resident::Brick(_) | Resident::Missing) {
                self.renderer.set_state(key, PageEntry::Failed);
            }
        }
        Ok(())
    }
}

impl RayCaster for GpuCaster {
    fn room(&self) -> usize {
        // One slot stays free for the coarsest brick, should the time run out.
        self.renderer.slot_capacity().saturating_sub(1).max(1)
    }

    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), RenderError> {
        assert_eq!(pixel_rows, 0..self.height, "the renderer made the rays of the whole picture");
        Ok(())
    }

    fn cast_pass(&mut self, view: &HostView<'_>) -> Result<PassReport, RenderError> {
        if view.on_missing() == OnMissing::UseParent {
            self.stop_waiting(view)?;
        }
        let feedback = self.renderer.cast_pass()?;
        self.counters.add(&feedback.counters);
        Ok(PassReport {
            misses: feedback.misses.into_iter().map(|miss| miss.key).collect(),
            uses: feedback.uses,
            unfinished_rays: feedback.unfinished_rays,
            fallbacks: feedback.counters.parent_bricks,
            is_stopped: false,
        })
    }

    fn update(&mut self, view: &HostView<'_>, fetched: &Fetched) -> Result<(), RenderError> {
        fetched.answered.iter().chain(&fetched.neighbours).for_each(|&key| self.answer(view, key));
        fetched.bricks.iter().try_for_each(|&key| self.insert(view, key))
    }

    fn image(&mut self) -> Result<Image, RenderError> {
        Ok(self.renderer.image()?)
    }

    fn totals(&self) -> CasterTotals {
        let stats = self.renderer.stats();
        CasterTotals {
            rays: self.rays,
            // The GPU does not tell which of its finished rays ended early.
            rays_terminated_early: 0,
            samples: self.counters.samples,
            cells: self.counters.cells,
            macro_cells: self.counters.macro_cells,
            macro_cells_skipped: self.counters.macro_cells_skipped,
            gpu_bytes: stats.planned_bytes,
            gpu_page_ins: stats.insertions,
            gpu_anomalies: stats.anomalies,
            gpu_dispatch_ms_max: stats.dispatch_ms_max,
            adapter: Some(stats.adapter),
            upload_time: Duration::from_secs_f64(stats.upload_ms / 1e3),
            ..CasterTotals::default()
        }
    }
}
