//! The GPU ray caster in a frame: copies bricks from the host cache to its slots.
//!
//! The device's page table remembers bricks independently of the host cache. A brick that the host cache dropped may
//! still be resident on the device, and a brick in the host cache may have to be copied again.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_format::{BrickKey, Container, Pyramid, VoxelType};
use supervol_scene::facts::value_map;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::InUnits;

use super::setting::with_data_scale;
use super::walk::FinishedBands;
use super::{FrameWalk, plan_host_for, streamer_for};
use crate::engines::engine::{Advance, Engine};
use crate::engines::gpu::caster::{
    BandErrors, DeviationOf, GpuDevice, GpuError, GpuOptions, GpuRenderer, GpuStats, GpuVolume, PageEntry,
    SHARED_MEMORY, VoxelStorage,
};
use crate::engines::maps::Maps;
use crate::engines::packets::levels::ErrorsByReason;
use crate::engines::totals::{EngineErrors, EngineTotals};
use crate::lod::LodChoice;
use crate::lod::deviation::{Deviation, Deviations};
use crate::render::error::RenderError;
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stop::Stop;
use crate::stream::budget::{CasterBytes, HostPlan};
use crate::stream::classify::may_have_holes;
use crate::stream::counters::{DeviceCounters, RayCounters};
use crate::stream::field::FieldBrick;
use crate::stream::residency::{BrickView, Resident};
use crate::stream::streamer::{Fetched, HostView, OnMissing, Streamer};

/// A device, with the data that it keeps from picture to picture: bricks, tables, pipelines.
pub(crate) struct GpuBackend {
    device: GpuDevice,
    caster: Option<GpuCaster>,
    /// Answers that its page table holds.
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

/// A finished picture.
pub(crate) struct GpuDrawn {
    pub(crate) image: Image,
    pub(crate) stats: FrameStats,
    /// Further maps requested of its pixels.
    pub(crate) maps: Maps,
    /// Largest errors of its rays, if requested.
    pub(crate) errors: ErrorsByReason,
    /// Time spent fetching bricks.
    pub(crate) fetching: Duration,
}

/// The GPU ray caster in WGSL.
struct GpuCaster {
    renderer: GpuRenderer,
    pyramid: Pyramid,
    counters: RayCounters,
    stop: Stop,
    is_paused_when_due: bool,
    /// Rows whose rays have begun; those of a paused picture.
    rows: Range<u32>,
    /// Device counters before this picture.
    before: DeviceCounters,
    /// Deviations by levels, if they are summed up; then errors of the picture so far.
    deviations: Option<Arc<Deviations>>,
    errors: ErrorsByReason,
    error_pixels: Option<Image>,
    /// Bricks answered without voxels, for this picture and earlier ones: the next camera asks for most of them again.
    answered: BTreeSet<FieldBrick>,
}

/// Most bricks kept in `answered`, about 40 bytes each.
const ANSWERED_LIMIT: usize = 1 << 15;

/// Setting of a picture.
pub(crate) struct GpuPicture<'a> {
    pub(crate) scene: &'a ResolvedScene,
    pub(crate) options: &'a RenderOptions,
    pub(crate) plan: HostPlan,
    pub(crate) stop: &'a Stop,
    /// Whether rays pause when the stop condition is due ([`RenderError::Cancelled`]). They continue when the same
    /// picture is drawn next. If not, the picture is completed from resident bricks.
    pub(crate) is_paused_when_due: bool,
    /// Statistics of earlier pictures of the same scene.
    pub(crate) before: FrameStats,
    /// Size of the largest picture of the scene: rays along x and y, and whether errors are stated.
    pub(crate) room: ([u32; 2], bool),
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
            Err(RenderError::Gpu(GpuError::DeviceLost { message })) => message,
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
        let lod = options.lod();
        let (mut caster, mut bands) = match (caster, paused) {
            (Some(caster), Some(paused)) if paused.scene == *scene && paused.lod == lod => {
                (caster.resumed(picture), paused.bands)
            }
            (caster, _) => {
                let number = streamer.answers();
                let answers = Some(Answers { number, lod, states_errors: options.predict_error });
                let keeps_answers = self.answers == answers;
                self.answers = answers;
                let [width, height] = scene.image_size;
                // A picture of larger pixels leaves the memory for the next full-size one.
                let is_as_large = self.spare.len() == width as usize * height as usize;
                let spare = FinishedBands::over(if is_as_large { std::mem::take(&mut self.spare) } else { Vec::new() });
                (self.begin(caster, streamer, picture, keeps_answers)?, spare)
            }
        };
        let mut walk =
            FrameWalk::new(streamer, plan, options, Instant::now()).until(stop.clone()).after(picture.before.clone());
        match walk.run_on(&mut caster, scene.image_size, &mut bands) {
            Ok(image) => {
                let fetching = walk.fetching();
                let (stats, errors) = (FrameStats { backend: "gpu", ..walk.into_stats() }, caster.errors);
                self.caster = Some(caster);
                Ok(GpuDrawn { image, stats, maps: bands.into_maps(), errors, fetching })
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
        caster: Option<GpuCaster>,
        streamer: &mut Streamer,
        picture: &GpuPicture<'_>,
        keeps_answers: bool,
    ) -> Result<GpuCaster, RenderError> {
        let GpuPicture { scene, options, stop, .. } = *picture;
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
        let deviations =
            options.predict_error.then(|| Arc::new(with_data_scale(container, |data| Deviations::new(scene, data))));
        let deviation_of = || deviations.as_ref().map(|of| deviation_of(container.clone(), of.clone()));
        let kept = match caster {
            Some(mut kept) => {
                let before = kept.renderer.stats().counters;
                kept.renderer.set_max_error(options.max_error);
                kept.renderer.set_deviations(deviation_of());
                let has_room = kept.renderer.set_scene(&volume, scene, lod, keeps_answers)?;
                has_room.then_some((kept.renderer, before, kept.answered))
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
        if !keeps_answers {
            let is_too_coarse = |key: &FieldBrick| streamer.is_too_coarse(*key);
            let keys: Vec<FieldBrick> = renderer.resident().filter(is_too_coarse).collect();
            keys.into_iter().for_each(|key| renderer.set_state(key.brick, PageEntry::TooCoarse));
        }
        let mut caster = GpuCaster {
            before,
            renderer,
            pyramid: descriptor.pyramid.clone(),
            counters: RayCounters { rays: scene.rays(), ..RayCounters::default() },
            stop: stop.clone(),
            is_paused_when_due: picture.is_paused_when_due,
            rows: 0..0,
            deviations,
            errors: ErrorsByReason::default(),
            error_pixels: None,
            answered: BTreeSet::new(),
        };
        if keeps_answers {
            caster.answered = answered;
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
        Ok(entry) => deviations.of(key, &entry, may_have_holes(&container, key, &entry)),
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
    let plan = plan_host_for(
        CasterBytes::on_device(options.predict_error),
        container,
        scene,
        options,
        options.time_budget_ms.is_some(),
    )?;
    let stop = Stop::at(options.time_budget_ms.map(|ms| Instant::now() + Duration::from_millis(ms)));
    let mut streamer = streamer_for(container, scene, options, plan);
    let before = FrameStats::default();
    let room = ([scene.camera.width, scene.camera.height], options.predict_error);
    let picture = GpuPicture { scene, options, plan, stop: &stop, is_paused_when_due: false, before, room };
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

impl GpuCaster {
    /// The same picture, resumed with more time.
    fn resumed(self, picture: &GpuPicture<'_>) -> Self {
        Self { stop: picture.stop.clone(), is_paused_when_due: picture.is_paused_when_due, ..self }
    }

    /// Copies bricks of the host cache to slots, as many as there are slots for.
    fn insert(&mut self, view: &HostView<'_>, keys: impl IntoIterator<Item = BrickKey>) -> Result<(), RenderError> {
        let mut bricks = Vec::new();
        for key in keys {
            if let (Resident::Brick(brick), false) = (view.stand_in(key), self.renderer.is_resident(key)) {
                if matches!(view.lookup(key), Resident::TooCoarse) {
                    self.renderer.set_state(key, PageEntry::TooCoarse);
                }
                bricks.push(brick);
            }
        }
        Ok(self.renderer.insert_all(&bricks)?)
    }

    /// Answers a brick that has no voxels to copy.
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

    /// The same, and remembers that it was asked for.
    fn note_answer(&mut self, view: &HostView<'_>, key: FieldBrick) {
        if self.answered.len() >= ANSWERED_LIMIT {
            self.answered.clear();
        }
        self.answered.insert(key);
        self.answer(view, key.brick);
    }

    /// Stops waiting: bricks that are not resident are drawn from their parents; makes the coarsest brick resident.
    fn stop_waiting(&mut self, view: &HostView<'_>) -> Result<(), RenderError> {
        let coarsest = self.pyramid.coarsest();
        let keys: Vec<BrickKey> = self.pyramid.keys_of(coarsest).collect();
        self.insert(view, keys)?;
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

impl Engine for GpuCaster {
    fn room(&self) -> usize {
        // One slot stays free for the coarsest brick, in case the time runs out.
        self.renderer.slot_capacity().saturating_sub(1).max(1)
    }

    fn band_rows(&self) -> u32 {
        (self.renderer.band_rows() / self.renderer.subgrid()).max(1)
    }

    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), RenderError> {
        if self.rows != pixel_rows {
            let subgrid = self.renderer.subgrid();
            self.renderer.begin(pixel_rows.start * subgrid..pixel_rows.end * subgrid);
            self.rows = pixel_rows;
        }
        Ok(())
    }

    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, RenderError> {
        let is_late = view.on_missing() == OnMissing::UseParent;
        if is_late && self.is_paused_when_due {
            return Err(RenderError::Cancelled);
        }
        if is_late {
            self.stop_waiting(view)?;
        }
        // A pass that completes a picture stops only on a cancel request.
        let stop = if self.is_paused_when_due { self.stop.clone() } else { self.stop.instead_at(None) };
        let feedback = self.renderer.cast_pass_until(&stop)?;
        self.counters.add(&feedback.counters);
        Ok(Advance {
            wanted: view.field().bricks(feedback.misses.into_iter().map(|miss| miss.key)),
            used: view.field().bricks(feedback.uses),
            remaining: feedback.unfinished_rays,
            stood_in: feedback.counters.parent_bricks,
            is_stopped: feedback.is_stopped,
        })
    }

    fn update(&mut self, view: &HostView<'_>, fetched: &Fetched) -> Result<(), RenderError> {
        fetched.answered.iter().chain(&fetched.neighbours).for_each(|key| self.note_answer(view, *key));
        self.insert(view, fetched.bricks.iter().map(|key| key.brick))
    }

    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), RenderError> {
        let Some(deviations) = &self.deviations else { return Ok(self.renderer.write_image(to)?) };
        if let Some(BandErrors { pixels, greatest, ended_early }) =
            self.renderer.write_image_with_errors(deviations, to)?
        {
            self.errors = self.errors.or(greatest);
            self.counters.rays_terminated_early += ended_early;
            self.error_pixels = Some(pixels);
        }
        Ok(())
    }

    fn pixel_maps(&mut self) -> Maps {
        Maps { errors: self.error_pixels.take(), work: None }
    }

    fn totals(&self) -> EngineTotals {
        let stats = self.renderer.stats();
        let counters = stats.counters.since(&self.before);
        let [ray_ends, transfer_function, rounding] = self.renderer.common_errors();
        let ErrorsByReason { cells, levels, .. } = self.errors;
        let states_errors = self.deviations.is_some() && self.renderer.sums_cells();
        EngineTotals {
            rays: self.counters,
            errors: states_errors.then_some(EngineErrors { cells, levels, ray_ends, transfer_function, rounding }),
            device: Some(GpuStats { counters, ..stats }),
            ..EngineTotals::default()
        }
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
