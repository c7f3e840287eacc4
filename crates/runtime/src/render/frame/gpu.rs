//! Frames on a device: what it holds stays from picture to picture, and another device takes the place of one that is lost.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{Container, VoxelType};
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::InUnits;
use supervol_scene::value_map::value_map;

use super::on_device::{GpuDrawn, GpuPicture, device_bytes};
use super::setting::with_data_scale;
use super::walk::FinishedBands;
use super::{FrameWalk, plan_host_for, streamer_for};
use crate::engines::error::EngineError;
use crate::engines::gpu::caster::{GpuRenderer, KnownAnswers, PageEntry};
use crate::engines::gpu::deviations::DeviationOf;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::engine::GpuEngine;
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::limits::SHARED_MEMORY;
use crate::engines::gpu::options::GpuOptions;
use crate::engines::gpu::scene_tables::GpuVolume;
use crate::engines::gpu::texels::VoxelStorage;
use crate::engines::value_error::by_device;
use crate::lod::LodChoice;
use crate::lod::by_error::DataScale;
use crate::lod::deviation::{Deviation, Deviations};
use crate::render::enlarge::Enlarge;
use crate::render::error::RenderError;
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stop::{Stop, WhenDue};
use crate::stream::budget::{DeadlineReserve, HostPlan};
use crate::stream::classify::holes_in;
use crate::stream::counters::DeviceCounters;
use crate::stream::field::FieldBrick;
use crate::stream::streamer::{OnMissing, Streamer};

/// A device, with the data that it keeps from picture to picture: bricks, tables, pipelines.
pub(crate) struct GpuBackend {
    device: GpuDevice,
    caster: Option<GpuEngine>,
    /// The streamer's answers that its page table holds.
    answers: Option<Answers>,
    /// The picture whose rays were paused.
    paused: Option<Paused>,
    /// Pixels of a picture that is no longer needed: the next picture reuses their memory.
    spare: Vec<[f32; 4]>,
    /// Bytes of device memory to use by default.
    default_memory: u64,
}

/// A paused picture: its setting and its finished parts.
struct Paused {
    scene: ResolvedScene,
    lod: LodChoice,
    bands: FinishedBands,
}

/// Key of the answers in a page table.
#[derive(PartialEq)]
struct Answers {
    /// Version of the streamer's answers, which changes with the look: [`Streamer::answers`].
    number: u64,
    /// The choice of levels.
    lod: LodChoice,
    /// Whether deviations of bricks are included.
    states_errors: bool,
}

impl GpuBackend {
    /// A backend that holds nothing yet.
    pub(crate) fn new(device: GpuDevice) -> Self {
        let default_memory = device.default_memory();
        Self { device, caster: None, answers: None, paused: None, spare: Vec::new(), default_memory }
    }

    /// Device memory to use by default, bytes: [`GpuDevice::default_memory`], or the part of it that could be
    /// allocated.
    pub(crate) fn default_memory(&self) -> u64 {
        self.default_memory
    }

    /// The device.
    pub(crate) fn device(&self) -> &GpuDevice {
        &self.device
    }

    /// Takes the memory of a picture that is no longer needed, for the next one.
    pub(crate) fn take_back(&mut self, picture: Image) {
        self.spare = picture.pixels;
    }

    /// Enlarges a picture: each pixel becomes `factor` x `factor` pixels.
    pub(crate) fn enlarged(&mut self, picture: Image, factor: u32, size: [u32; 2]) -> Image {
        picture.enlarged_over(std::mem::take(&mut self.spare), factor, size)
    }

    /// Draws a picture from bricks on the device and bricks that the streamer has or fetches. If the device is lost, it
    /// is replaced by the device that `reopen` returns, and the picture is drawn once more. The statistics report the
    /// loss; counters of the lost device are not in them.
    ///
    /// # Errors
    /// As [`crate::render::renderer::render`], and errors of the GPU. The device loss itself, if the second device
    /// cannot be opened or is lost too.
    pub(crate) fn draw(
        &mut self,
        streamer: &mut Streamer,
        picture: &GpuPicture<'_>,
        reopen: &dyn Fn() -> Result<GpuDevice, GpuError>,
    ) -> Result<GpuDrawn, RenderError> {
        let lost = match self.draw_once(streamer, picture) {
            Err(RenderError::Engine(EngineError::Gpu(GpuError::DeviceLost { message }))) => message,
            other => return other,
        };
        let Ok(second) = reopen() else { return Err(GpuError::DeviceLost { message: lost }.into()) };
        *self = Self::new(second);
        let drawn = self.draw_once(streamer, picture)?;
        Ok(GpuDrawn { stats: FrameStats { gpu_lost_because: Some(lost), ..drawn.stats }, ..drawn })
    }

    fn draw_once(&mut self, streamer: &mut Streamer, picture: &GpuPicture<'_>) -> Result<GpuDrawn, RenderError> {
        // After an error no unfinished picture is kept.
        let (caster, paused) = (self.caster.take(), self.paused.take());
        let GpuPicture { scene, options, plan, stop, .. } = *picture;
        // Bands are for rays in host memory.
        let plan = HostPlan { band_rows: scene.image_size[1], ..plan };
        let lod = options.lod();
        let (mut caster, mut bands) = match (caster, paused) {
            (Some(caster), Some(paused)) if paused.scene == *scene && paused.lod == lod => {
                (caster.resumed(picture.stops()), paused.bands)
            }
            (caster, _) => {
                let number = streamer.answers();
                let answers = Some(Answers { number, lod, states_errors: options.predict_error });
                let known = if self.answers == answers { KnownAnswers::Keep } else { KnownAnswers::Forget };
                self.answers = answers;
                let [width, height] = scene.image_size;
                // A picture of larger pixels leaves the memory for the next full-size one.
                let is_as_large = self.spare.len() == width as usize * height as usize;
                let spare = FinishedBands::over(if is_as_large { std::mem::take(&mut self.spare) } else { Vec::new() });
                (self.begin(caster, streamer, picture, known)?, spare)
            }
        };
        let mut walk =
            FrameWalk::new(streamer, plan, options, Instant::now()).until(stop.clone()).after(picture.before.clone());
        match walk.run_on(&mut caster, scene.image_size, &mut bands) {
            Ok(image) => {
                let fetching = walk.fetching();
                let (stats, errors) = (FrameStats { backend: "gpu", ..walk.into_stats() }, caster.errors());
                let above = caster.take_pixels_above();
                self.caster = Some(caster);
                Ok(GpuDrawn { image, stats, maps: bands.into_maps(), errors, above, fetching })
            }
            Err(RenderError::Cancelled) => {
                self.paused = Some(Paused { scene: scene.clone(), lod, bands });
                self.caster = Some(caster);
                Err(RenderError::Cancelled)
            }
            Err(error) => Err(error),
        }
    }

    /// The caster of the previous picture if its memory suffices, else a new one.
    fn begin(
        &mut self,
        caster: Option<GpuEngine>,
        streamer: &mut Streamer,
        picture: &GpuPicture<'_>,
        known: KnownAnswers,
    ) -> Result<GpuEngine, RenderError> {
        let GpuPicture { scene, options, .. } = *picture;
        let container = streamer.container();
        let descriptor = container.descriptor();
        let map = value_map(container);
        let InUnits { geometry, value_range, .. } = InUnits::of(container);
        let volume = GpuVolume {
            pyramid: &descriptor.pyramid,
            geometry: &geometry,
            value_map: &map,
            value_range,
            storage: storage(descriptor.voxel_type),
        };
        let lod = options.lod();
        let value_error = by_device(&map, value_range);
        let make = |data: &DataScale<'_>| Arc::new(Deviations::new(scene, data, value_error));
        let deviations = options.predict_error.then(|| with_data_scale(container, make));
        let deviation_of = || deviations.as_ref().map(|of| deviation_of(container.clone(), of.clone()));
        let kept = match caster {
            Some(kept) => {
                let (mut renderer, answered) = kept.into_parts();
                let before = renderer.stats().counters;
                renderer.set_max_error(options.max_error);
                renderer.set_deviations(deviation_of());
                let has_room = renderer.set_scene(&volume, scene, lod, known)?;
                has_room.then_some((renderer, before, answered))
            }
            None => None,
        };
        let gpu_options = |memory_bytes| GpuOptions {
            memory_bytes,
            skipping: options.skipping,
            max_error: options.max_error,
            sums_errors: picture.room.1,
            room: Some(picture.room.0),
        };
        let (mut renderer, before, answered) = match kept {
            Some(kept) => kept,
            None => {
                let make =
                    |bytes| GpuRenderer::new(&self.device, &volume, scene, lod, gpu_options(bytes), deviation_of());
                let renderer = match options.gpu_memory_bytes {
                    Some(bytes) => make(bytes)?,
                    None => with_what_fits(&mut self.default_memory, make)?,
                };
                (renderer, DeviceCounters::default(), BTreeSet::new())
            }
        };
        if known == KnownAnswers::Forget {
            let is_too_coarse = |key: &FieldBrick| streamer.is_too_coarse(*key);
            let keys: Vec<FieldBrick> = renderer.resident().filter(is_too_coarse).collect();
            keys.into_iter().for_each(|key| renderer.set_state(key.brick, PageEntry::TooCoarse));
        }
        let mut caster = GpuEngine::new(renderer, scene.rays(), picture.stops(), deviations, before);
        if known == KnownAnswers::Keep {
            caster.set_answered(answered);
        } else {
            let again = streamer.answer_again(answered);
            let view = streamer.view(OnMissing::Wait);
            again.into_iter().for_each(|key| caster.note_answer(&view, key));
        }
        Ok(caster)
    }
}

/// Calls `make` with `memory` bytes. If the device has no room, tries half of that, and so on down to
/// [`SHARED_MEMORY`].
fn with_what_fits<T>(memory: &mut u64, make: impl Fn(u64) -> Result<T, GpuError>) -> Result<T, GpuError> {
    loop {
        match make(*memory) {
            Err(GpuError::OutOfMemory { .. }) if *memory / 2 >= SHARED_MEMORY => *memory /= 2,
            made => return made,
        }
    }
}

/// Function that computes deviations of bricks from the table of contents.
fn deviation_of(container: Arc<Container>, deviations: Arc<Deviations>) -> DeviationOf {
    Box::new(move |key| match container.entry(key) {
        Ok(entry) => deviations.of(key, &entry, holes_in(&container, key, &entry)),
        Err(_) => Deviation::UNKNOWN,
    })
}

/// Draws one picture on `device`, on the calling thread's pool. If the device is lost, draws on the one that `reopen`
/// returns.
///
/// # Errors
/// As any picture; the device loss itself, if the second device cannot be opened or is lost too.
pub fn render_gpu_surviving(
    device: GpuDevice,
    reopen: &dyn Fn() -> Result<GpuDevice, GpuError>,
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    let bytes = device_bytes(options, container.pyramid().layout().core());
    let plan = plan_host_for(bytes, container, scene, options, DeadlineReserve::of(options.time_budget_ms))?;
    let stop = Stop::at(options.time_budget_ms.map(|ms| Instant::now() + Duration::from_millis(ms)));
    let mut streamer = streamer_for(container, scene, options, plan);
    let before = FrameStats::default();
    let room = ([scene.camera.width, scene.camera.height], options.predict_error);
    let picture = GpuPicture { scene, options, plan, stop: &stop, when_due: WhenDue::Complete, before, room };
    let GpuDrawn { image, stats, .. } = GpuBackend::new(device).draw(&mut streamer, &picture, reopen)?;
    Ok((image, stats))
}

/// Storage of decoded bricks of this type: see [`crate::stream::residency::Voxels`].
fn storage(voxel_type: VoxelType) -> VoxelStorage {
    match voxel_type.bytes() {
        1 => VoxelStorage::U8,
        2 => VoxelStorage::U16,
        _ => VoxelStorage::F32,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_without_room_gets_half_as_much_and_so_on() {
        let full = || GpuError::OutOfMemory { doing: "a texture".to_owned(), message: "full".to_owned() };
        let mut memory = 4 * SHARED_MEMORY;
        let made = with_what_fits(&mut memory, |bytes| if bytes > 2 * SHARED_MEMORY { Err(full()) } else { Ok(bytes) });
        assert!(matches!(made, Ok(bytes) if bytes == 2 * SHARED_MEMORY), "{made:?}");
        assert_eq!(memory, 2 * SHARED_MEMORY, "the next picture does not ask for more");
        let none = with_what_fits::<()>(&mut memory, |_| Err(full()));
        assert!(matches!(none, Err(GpuError::OutOfMemory { .. })), "{none:?}");
        assert_eq!(memory, SHARED_MEMORY);
        let mut memory = 4 * SHARED_MEMORY;
        let lost = |_| Err(GpuError::DeviceLost { message: "gone".to_owned() });
        assert!(matches!(with_what_fits::<()>(&mut memory, lost), Err(GpuError::DeviceLost { .. })));
        assert_eq!(memory, 4 * SHARED_MEMORY, "only a lack of memory is mended by less of it");
    }
}
