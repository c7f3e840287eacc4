//! Progressive picture by packets on the CPU: its pixels become smaller until the requested picture is reached.
//!
//! ```text
//! sketch: large pixels, the coarsest level --> smaller pixels, finer levels --> ... --> the picture that is wanted
//! ```
//!
//! The sketch is always finished. Each later picture (a stage) begins as the last one, enlarged; its tiles are
//! overwritten as they are finished. Levels follow the pixel size, so halving the pixel size takes about eight times as
//! long. The time of the last stage decides which sizes are skipped. After a stage that waited for bricks none is
//! skipped, because its time predicts nothing. At the deadline, rays pause between two bricks. Finished pixels stay,
//! the others show the stage before ([`FrameStats::pixels_unfinished`]), and with more time the rays continue. Without
//! a deadline the requested picture is drawn at once.

use std::borrow::Cow;
use std::time::{Duration, Instant};

use supervol_format::{Container, Lod};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::resident::Resident;
use crate::engines::maps::{Maps, of_work};
use crate::engines::totals::ErrorsByReason;
use crate::lod::by_error::ANY_ERROR;
use crate::render::enlarge::Enlarge;
use crate::render::error::RenderError;
use crate::render::frame::cpu::CpuCaster;
use crate::render::frame::cpu_frame_of;
use crate::render::frame::stated::{ErrorStated, complete};
use crate::render::frame::walk::{Bands, FrameWalk};
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};

/// Most rays of a sketch: some milliseconds.
const SKETCH_RAYS: u64 = 8192;
/// Time factor for half the pixel size: four times the rays, through twice the cells.
const TIME_PER_HALVING: f64 = 8.0;
/// Time factor of the requested picture over one whose levels follow the pixel size alone.
const TIME_PER_ERROR: f64 = 1.5;
/// Share of the remaining time that a picture may be expected to take.
pub(super) const LEAST_SURE_SHARE: f64 = 0.6;

/// Progressive picture of one scene.
pub struct Drawing {
    scene: ResolvedScene,
    /// The best picture so far; NaN where nothing is known.
    picture: Option<Image>,
    /// Maps of the pixels of the requested picture; NaN where they are not finished.
    maps: Maps,
    /// Errors of its rays, by reason.
    by_reason: ErrorsByReason,
    /// Size of its pixels.
    pixel: u32,
    /// Pixel size of the picture that unfinished pixels are taken from; `None` if nothing is known of them.
    behind: Option<u32>,
    /// Time that the last finished stage took.
    took: Duration,
    /// Whether it waited for no brick: otherwise the time of a finer one depends on reading.
    was_all_there: bool,
    stage: Option<Stage>,
    /// Finished pixels of the requested picture.
    finished: u64,
    stats: FrameStats,
}

/// Stage: a picture of one pixel size, as far as it has come.
struct Stage {
    pixel: u32,
    scene: ResolvedScene,
    options: RenderOptions,
    caster: CpuCaster,
    bands: Bands,
    spent: Duration,
    /// Page-ins for this picture before the stage began.
    page_ins_before: u64,
}

impl Drawing {
    /// A picture that is not begun.
    #[must_use]
    pub fn new(scene: ResolvedScene) -> Self {
        Self {
            scene,
            picture: None,
            maps: Maps::default(),
            by_reason: ErrorsByReason::default(),
            pixel: 1,
            behind: None,
            took: Duration::ZERO,
            was_all_there: false,
            stage: None,
            finished: 0,
            stats: FrameStats::default(),
        }
    }

    /// Whether every pixel is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.finished == self.scene.pixels()
    }

    /// Whether each pixel is known at least coarsely.
    #[must_use]
    pub fn has_picture(&self) -> bool {
        self.picture.is_some() && self.behind.is_some()
    }

    /// The picture so far, with the requested number of pixels; `None` until each pixel is known.
    #[must_use]
    pub fn picture(&self) -> Option<Cow<'_, Image>> {
        let picture = self.picture.as_ref().filter(|_| self.has_picture())?;
        Some(match self.pixel {
            1 => Cow::Borrowed(picture),
            pixel => Cow::Owned(picture.clone().enlarged(pixel, self.scene.image_size)),
        })
    }

    /// Consumes the drawing: returns the picture, with its maps.
    #[must_use]
    pub fn into_pictures(self) -> Option<(Image, Maps)> {
        let picture = self.picture.filter(|_| self.behind.is_some())?;
        let picture = picture.enlarged(self.pixel, self.scene.image_size);
        let errors = self.maps.errors.map(|known| complete(known, &picture));
        Some((picture, Maps { errors, work: self.maps.work.map(of_work) }))
    }

    /// Error map: the error of each pixel, grey, 1 is white. Present if errors are summed up and there is a picture.
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        Some(complete(self.maps.errors.clone()?, self.picture()?.as_ref()))
    }

    /// Work map: cost of the rays of each pixel ([`of_work`]). Present if work is counted and there is a picture.
    #[must_use]
    pub fn work_map(&self) -> Option<Image> {
        self.picture()?;
        self.maps.work.clone().map(of_work)
    }

    /// The stated errors in numbers.
    #[must_use]
    pub fn error_stated(&self) -> Option<ErrorStated> {
        let pixels_unfinished = self.scene.pixels() - self.finished;
        Some(ErrorStated::of(self.maps.errors.as_ref()?, self.picture()?.as_ref(), self.by_reason, pixels_unfinished))
    }

    /// Statistics so far, including unfinished parts.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        let mut stats = FrameStats { backend: "cpu", ..self.stats.clone() };
        stats.pixels_unfinished = self.scene.pixels() - self.finished;
        if stats.pixels_unfinished > 0 {
            stats.coarsest_pixel = self.behind.unwrap_or(0);
            stats.converged = false;
            // The error of a coarser picture is not summed up.
            stats.error_predicted = None;
        }
        stats
    }

    /// Improves the picture until it is finished or `stop` is due; a little even if it is already due. With a deadline
    /// there is always a whole picture afterwards.
    ///
    /// # Errors
    /// If memory does not suffice, there is no progress, or it is cancelled before there is a whole picture.
    pub fn advance(
        &mut self,
        resident: &mut Resident,
        options: &RenderOptions,
        stop: &Stop,
    ) -> Result<(), RenderError> {
        self.maps.begin(options.asked_maps(), self.scene.image_size);
        let mut stop = stop.clone();
        if self.behind.is_none() && stop.deadline().is_some() {
            self.sketch(resident, options, &stop)?;
        } else {
            stop = stop.not_before(Instant::now() + LEAST_STEP);
        }
        while !self.is_finished() && !stop.is_due() {
            let mut stage = match self.stage.take() {
                // Without a deadline intermediate pictures are not needed.
                Some(stage) if stage.pixel == 1 || stop.deadline().is_some() => stage,
                _ => self.next_stage(resident, options, &stop),
            };
            // A sketch may have been drawn in between.
            resident.aim(&stage.scene, &stage.options);
            let (began, plan) = (Instant::now(), resident.plan());
            let picture = self.picture.as_mut().expect("a stage has a picture");
            let mut walk = FrameWalk::new(resident.streamer(), plan, &stage.options, began)
                .until(stop.clone())
                .after(std::mem::take(&mut self.stats));
            let maps = (stage.pixel == 1).then_some(&mut self.maps);
            let written = walk.run_over(&mut stage.caster, (picture, maps), &mut stage.bands)?;
            self.stats = walk.into_stats();
            stage.spent += began.elapsed();
            if stage.pixel == 1 {
                self.finished = written;
                self.by_reason = stage.caster.errors_by_reason();
            }
            if written == picture.pixels.len() as u64 {
                (self.behind, self.took) = (Some(stage.pixel), stage.spent);
                self.was_all_there = self.stats.streaming.page_ins == stage.page_ins_before;
            } else {
                self.stage = Some(stage);
            }
        }
        Ok(())
    }

    /// Draws the picture of the largest pixels, from resident bricks and the coarsest level.
    fn sketch(&mut self, resident: &mut Resident, options: &RenderOptions, stop: &Stop) -> Result<(), RenderError> {
        let began = Instant::now();
        let pixel = sketch_pixel(&self.scene);
        if pixel > 1 && self.scene.mode == Mode::Dvr {
            resident.look_at_coarsest_level(&self.scene, options, stop)?;
        }
        let mut stage = Stage::new(&self.scene, pixel, resident, options);
        resident.aim(&stage.scene, &stage.options);
        let plan = resident.plan();
        let mut walk = FrameWalk::new(resident.streamer(), plan, &stage.options, began)
            .until(stop.instead_at(Some(began)))
            .after(std::mem::take(&mut self.stats));
        let sketch = walk.run(&mut stage.caster, stage.scene.image_size)?;
        self.stats = walk.into_stats();
        self.was_all_there = self.stats.fallbacks == 0;
        (self.behind, self.took) = (Some(pixel), began.elapsed());
        match &mut self.picture {
            // The requested picture was begun without a deadline: its finished pixels stay.
            Some(finest) => finest.fill_unknown(&sketch, pixel),
            None => (self.picture, self.pixel) = (Some(sketch), pixel),
        }
        Ok(())
    }

    /// Begins the next stage.
    fn next_stage(&mut self, resident: &mut Resident, options: &RenderOptions, stop: &Stop) -> Stage {
        let left = stop.deadline().map(|deadline| deadline.saturating_duration_since(Instant::now()));
        let pixel = left.map_or(1, |left| match self.was_all_there {
            true => next_pixel(self.pixel, self.took, left),
            false => (self.pixel / 2).max(1),
        });
        let page_ins_before = self.stats.streaming.page_ins;
        let stage = Stage { page_ins_before, ..Stage::new(&self.scene, pixel, resident, options) };
        let picture = match self.picture.take() {
            Some(picture) => picture.enlarged(self.pixel / pixel, stage.scene.image_size),
            None => Image::unknown(stage.scene.image_size),
        };
        (self.picture, self.pixel) = (Some(picture), pixel);
        stage
    }
}

impl Stage {
    /// A stage of a scene with this pixel size; no ray is cast yet.
    fn new(scene: &ResolvedScene, pixel: u32, resident: &mut Resident, options: &RenderOptions) -> Self {
        let mut scene = with_pixels(scene, pixel);
        let options = options_for(resident.container(), options, pixel);
        if pixel > 1
            && let Some(coarse) = resident.coarse_transfer_function(&scene, &options)
        {
            scene.transfer_function = coarse;
        }
        let frame = cpu_frame_of(resident.container(), &scene, &options, options.lod(), resident.made_for(pixel));
        if pixel == 1 {
            resident.keep_plans(&frame);
        }
        let caster = CpuCaster::new(frame);
        Self { pixel, scene, options, caster, bands: Bands::default(), spent: Duration::ZERO, page_ins_before: 0 }
    }
}

/// Edge of a pixel of the sketch, in pixels of the picture: a power of two.
pub(super) fn sketch_pixel(scene: &ResolvedScene) -> u32 {
    let [width, height] = scene.image_size;
    let rays = |pixel: u32| u64::from(width.div_ceil(pixel)) * u64::from(height.div_ceil(pixel));
    (0..16).map(|k| 1 << k).find(|&pixel| rays(pixel) <= SKETCH_RAYS).unwrap_or(1 << 16)
}

/// The smallest pixel size whose picture likely fits into the time left, given that the last size took `took`. At most
/// half the last size.
pub(super) fn next_pixel(pixel: u32, took: Duration, left: Duration) -> u32 {
    let expected = |next: u32| {
        let halvings = (pixel / next).ilog2();
        let error = if next == 1 { TIME_PER_ERROR } else { 1.0 };
        took.mul_f64(error * TIME_PER_HALVING.powi(halvings as i32))
    };
    let sure = left.mul_f64(LEAST_SURE_SHARE);
    let half = (pixel / 2).max(1);
    (0..=half.ilog2()).map(|k| 1 << k).find(|&next| expected(next) <= sure).unwrap_or(half)
}

/// The scene with pixels `pixel` times as large along an edge; the scene itself for 1.
pub(super) fn with_pixels(scene: &ResolvedScene, pixel: u32) -> ResolvedScene {
    if pixel == 1 {
        return scene.clone();
    }
    let camera = scene.camera.coarser(scene.subgrid * pixel);
    ResolvedScene { camera, image_size: [camera.width, camera.height], subgrid: 1, ..scene.clone() }
}

/// Options of such a stage: the requested options for pixel size 1.
pub(super) fn options_for(container: &Container, options: &RenderOptions, pixel: u32) -> RenderOptions {
    if pixel == 1 {
        return options.clone();
    }
    let level = match options.level {
        LevelChoice::Auto => LevelChoice::Auto,
        LevelChoice::Fixed(lod) => {
            let coarser = lod.0.saturating_add(pixel.ilog2() as u8);
            LevelChoice::Fixed(Lod(coarser).min(container.pyramid().coarsest()))
        }
    };
    RenderOptions { level, max_error: ANY_ERROR, predict_error: false, count_work: false, ..options.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_that_there_is_time_for_anyway_are_left_out() {
        let ms = Duration::from_millis;
        // 8^3 times 10 ms, and half as much again for the requested picture itself.
        assert_eq!(next_pixel(8, ms(10), ms(20_000)), 1);
        assert_eq!(next_pixel(8, ms(10), ms(12_000)), 2);
        assert_eq!(next_pixel(8, ms(10), ms(1_000)), 4);
        assert_eq!(next_pixel(8, ms(10), ms(1)), 4, "the next one, as far as it comes");
        assert_eq!(next_pixel(2, ms(1_000), ms(0)), 1);
        assert_eq!(next_pixel(1, ms(1_000), ms(0)), 1);
    }
}
