//! A picture with slices: every ray is cut where it meets a slice, and its parts are composited again front to back.
//!
//! The slices divide the volume into convex regions. In one region a ray has one part: the same part as in a picture of
//! the volume clipped to that region. So each region is a [`StagedDrawing`] of its own, by the same packets or device,
//! from the same bricks, with the same deadlines (docs/decisions/019-slices-cut-rays.md). Colours of the slices are
//! sampled ray by ray:
//!
//! Regions are drawn front to back. A finished one is composited at once, and its memory serves the next one.
//!
//! - [`cut`]: rays, cut into parts;
//! - [`composite`]: the parts of all rays, composited;
//! - [`sampling`]: values of the volume at points;
//! - [`sheet`]: colours of one slice.

mod composite;
mod cut;
pub(crate) mod sampling;
mod sheet;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use supervol_format::cast::single;
use supervol_format::{Container, Lod};
use supervol_scene::camera::Projection;
use supervol_scene::image::Image;
use supervol_scene::image::enlarge::Enlargement;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::slices::SLICE_LIMIT;

use self::composite::{Composite, RaySum, Shown};
use self::cut::{Cut, RayPart, Sides, Spans};
use self::sampling::Sampler;
use self::sheet::Sheet;
use super::Drawing;
use super::loaded::{LoadedVolume, level_within};
use super::means::{Means, Tools};
use super::stage::SKETCH_RAYS;
use super::staged::StagedDrawing;
use crate::engines::maps::Maps;
use crate::engines::totals::ErrorsByReason;
use crate::lod::by_error::ANY_ERROR;
use crate::render::accuracy::stated::{ErrorStated, complete, error_of};
use crate::render::error::RenderError;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};
use crate::stream::budget::EngineBytes;

/// Bytes of a ray's colour on a slice.
const SHEET_BYTES: u64 = size_of::<[f32; 3]>() as u64;
/// Bytes of a pixel of a region's picture, and of a work map.
const PIXEL_BYTES: u64 = size_of::<[f32; 4]>() as u64;
/// Pixel rows that one task composites at a time.
const BAND_ROWS: u32 = 8;

/// A progressive picture with slices.
pub(crate) struct SlicedDrawing {
    cut: Arc<Cut>,
    /// Regions of the volume between slices, front to back.
    regions: Vec<Region>,
    /// Number of regions that are composited.
    joined: usize,
    composite: Composite,
    /// Whether a device draws the regions.
    is_by_device: bool,
    /// Colours of each slice, as far as they are known.
    sheets: Vec<Sheet>,
    /// Number of slices whose colours are final.
    sampled: usize,
    /// Rays that meet each slice, and its least distance.
    spans: Arc<[Spans; SLICE_LIMIT]>,
    /// Whether slices are drawn from coarser levels, whose error is unknown.
    is_coarse: bool,
    /// Whether errors are to be stated.
    states_error: bool,
    stats: FrameStats,
}

/// A region of the volume between slices.
struct Region {
    sides: Sides,
    /// Its picture, a pixel for each ray; `None` once it is composited.
    drawing: Option<StagedDrawing>,
    /// Statistics, once it is composited.
    stats: FrameStats,
}

impl Region {
    fn stats(&self) -> FrameStats {
        self.drawing.as_ref().map_or_else(|| self.stats.clone(), StagedDrawing::stats)
    }

    fn has_picture(&self) -> bool {
        self.drawing.as_ref().is_none_or(StagedDrawing::has_picture)
    }
}

impl SlicedDrawing {
    /// A picture that is not begun. The volume between the slices is drawn by a device or by the CPU.
    #[must_use]
    pub(crate) fn new(scene: &ResolvedScene, container: &Container, is_by_device: bool) -> Self {
        let cut = Cut::new(scene, container);
        let (met, spans) = cut.met();
        let region = |sides| {
            let scene = cut.region(sides);
            let part = if is_by_device { StagedDrawing::part_by_device } else { StagedDrawing::by_packets };
            Region { sides, drawing: Some(part(scene)), stats: FrameStats::default() }
        };
        let met = if scene.mode == Mode::Slice { Vec::new() } else { cut.front_to_back(met) };
        Self {
            regions: met.into_iter().map(region).collect(),
            joined: 0,
            composite: Composite::default(),
            is_by_device,
            sheets: Vec::new(),
            sampled: 0,
            spans: Arc::new(spans),
            is_coarse: false,
            states_error: false,
            stats: FrameStats::default(),
            cut: Arc::new(cut),
        }
    }

    /// Host memory of this picture, given that of one picture by this engine. One region has more than a sketch at any
    /// time.
    fn bytes(&self, engine: EngineBytes, options: &RenderOptions) -> EngineBytes {
        let [width, height] = self.cut.rays_size();
        let rays = (u64::from(width) * u64::from(height)).max(1);
        let met: u64 = self.spans.iter().map(|spans| spans.rays() as u64).sum();
        let sketches = self.regions.len() as u64 * SKETCH_RAYS.min(rays) * PIXEL_BYTES;
        let shared = (SHEET_BYTES * met + sketches).div_ceil(rays);
        let work = if options.count_work { PIXEL_BYTES } else { 0 };
        // The picture of all rays; with averages over pixels, a smaller one.
        EngineBytes { of_pixel: Composite::RAY_BYTES + PIXEL_BYTES + engine.of_pixel + shared + work, ..engine }
    }

    /// Whether each pixel is known at least coarsely.
    fn has_picture(&self) -> bool {
        self.sheets.len() == self.cut.scene.slices.len()
            && self.sheets.iter().all(|sheet| sheet.colors.is_some())
            && self.regions.iter().all(Region::has_picture)
    }

    /// As [`Drawing::advance`], with memory that is divided already.
    fn advance_with(&mut self, tools: &mut Tools<'_>, stop: &Stop) -> Result<(), RenderError> {
        let mut stop = stop.clone();
        if self.has_picture() {
            stop = stop.not_before(Instant::now() + LEAST_STEP);
        } else if stop.deadline().is_some() {
            let at_once = stop.instead_at(Some(Instant::now()));
            let waiting = self.regions.iter_mut().filter_map(|region| region.drawing.as_mut());
            for drawing in waiting.filter(|drawing| !drawing.has_picture()) {
                drawing.advance_with(tools, &at_once)?;
            }
        }
        self.sample(tools.resident, tools.options, &stop)?;
        self.join_finished();
        for number in self.joined..self.regions.len() {
            if let Some(drawing) = &mut self.regions[number].drawing
                && !drawing.is_finished()
                && (!stop.is_due() || !drawing.has_picture())
            {
                drawing.advance_with(tools, &stop)?;
            }
            self.join_finished();
        }
        self.gather_stats(tools.resident);
        Ok(())
    }

    /// Composites the regions that are finished, once the colours of all slices are final.
    fn join_finished(&mut self) {
        while self.sampled == self.cut.scene.slices.len() && self.joined < self.regions.len() {
            let region = &mut self.regions[self.joined];
            let Some(drawing) = region.drawing.take_if(|drawing| drawing.is_finished()) else { return };
            region.stats = drawing.stats();
            let sides = region.sides;
            let Some((picture, maps)) = Box::new(drawing).into_pictures() else { return };
            let mut composite = std::mem::take(&mut self.composite);
            composite.add_region(&self.cut, (sides, picture, maps), |number, ray| self.slice(number, ray));
            (self.composite, self.joined) = (composite, self.joined + 1);
        }
    }

    /// The part of a ray on a slice.
    fn slice(&self, number: usize, [x, y]: [u32; 2]) -> Shown {
        let opacity = single(self.cut.scene.slices[number].opacity);
        let is_exact = number < self.sampled && !self.is_coarse;
        let error = if is_exact { 0.0 } else { opacity };
        let colors = self.sheets[number].colors.as_ref().zip(self.spans[number].at(x, y));
        match colors.map(|(colors, at)| Vec3::from_array(colors[at])) {
            Some(shown) if !shown.is_nan() => Shown { color: opacity * shown, alpha: opacity, error },
            _ => Shown { error, ..Shown::NOTHING },
        }
    }

    /// Finds the colours of slices that are not known yet.
    fn sample(&mut self, resident: &mut LoadedVolume, options: &RenderOptions, stop: &Stop) -> Result<(), RenderError> {
        let (cut, spans) = (self.cut.clone(), self.spans.clone());
        while self.sampled < cut.scene.slices.len() {
            let is_late = stop.is_late();
            // After the deadline there must still be a picture: all slices are sampled from resident bricks.
            let number = if is_late { self.sheets.len() } else { self.sampled };
            if number >= cut.scene.slices.len() {
                return Ok(());
            }
            let lod = self.level(number, resident.container(), options);
            self.is_coarse |= lod != Lod::FINEST;
            let scene = ResolvedScene { mode: Mode::Slice, ..cut.region(0) };
            resident.aim(&scene, &RenderOptions { level: LevelChoice::Fixed(lod), ..options.clone() });
            let mut sampler = Sampler::new(resident.streamer(), lod, stop.clone())?;
            if is_late {
                self.sheets.push(Sheet::of_what_is_there(
                    &cut,
                    (number, &spans[number]),
                    &mut sampler.of_what_is_there(),
                )?);
                continue;
            }
            if self.sheets.len() == number {
                self.sheets.push(Sheet::default());
            }
            if self.sheets[number].advance(&cut, (number, &spans[number]), &mut sampler)? {
                self.sampled += 1;
            }
        }
        Ok(())
    }

    /// The level of a slice: the finest if an error is requested; otherwise voxels are about as large as a pixel.
    fn level(&self, number: usize, container: &Container, options: &RenderOptions) -> Lod {
        let pyramid = container.pyramid();
        match options.level {
            LevelChoice::Fixed(lod) => return lod.min(pyramid.coarsest()),
            LevelChoice::Auto if options.max_error < ANY_ERROR => return Lod::FINEST,
            LevelChoice::Auto => {}
        }
        let camera = &self.cut.scene.camera;
        let pixel = match camera.projection {
            Projection::Perspective { .. } => camera.pixel_height() * self.spans[number].nearest,
            Projection::Orthographic { .. } => camera.pixel_height(),
        };
        level_within(container, pixel)
    }

    /// The picture so far and its errors, if they are summed up: at most the sum over the errors of a ray's parts in
    /// colour and transmittance. Both are means over the rays of a pixel.
    fn joined_up(&self) -> Option<(Image, Option<Image>)> {
        if !self.has_picture() {
            return None;
        }
        let waiting: Option<Vec<Waiting<'_>>> = self.regions[self.joined..].iter().map(Waiting::new).collect();
        let waiting = waiting?;
        let has_errors =
            self.states_error && !self.composite.lacks_errors && waiting.iter().all(|waiting| waiting.errors.is_some());
        let [width, height] = self.cut.scene.image_size;
        let firsts = (0..height).step_by(BAND_ROWS as usize).collect::<Vec<_>>();
        let band = |first: &u32| {
            let rays = self.band_of_rays(&waiting, *first..(first + BAND_ROWS).min(height));
            let band = |of_ray: fn(&RaySum) -> [f32; 4]| {
                let rows = (rays.len() / self.cut.rays_size()[0] as usize).try_into().expect("a band has few rows");
                let image =
                    Image { width: self.cut.rays_size()[0], height: rows, pixels: rays.iter().map(of_ray).collect() };
                image.downsampled(self.cut.scene.subgrid).pixels
            };
            (band(RaySum::pixel), if has_errors { band(RaySum::error) } else { Vec::new() })
        };
        let (pixels, errors): (Vec<_>, Vec<_>) = firsts.par_iter().map(band).unzip();
        let image = |pixels: Vec<Vec<[f32; 4]>>| Image { width, height, pixels: pixels.concat() };
        Some((image(pixels), has_errors.then(|| image(errors))))
    }

    /// The rays of some rows of pixels, with all parts that are known at least coarsely.
    fn band_of_rays(&self, waiting: &[Waiting<'_>], rows: Range<u32>) -> Vec<RaySum> {
        let (width, subgrid) = (self.cut.rays_size()[0], self.cut.scene.subgrid);
        let (first, end) = (rows.start * subgrid, rows.end * subgrid);
        let of_waiting: Vec<Vec<Shown>> = waiting.iter().map(|waiting| waiting.rows(first..end, width)).collect();
        let ray = |(y, x): (u32, u32)| {
            let in_band = (y - first) as usize * width as usize + x as usize;
            let number = y as usize * width as usize + x as usize;
            let mut sum = self.composite.ray(number);
            sum.add(&self.cut.parts(x, y), |part| {
                Some(match part {
                    RayPart::Slice(slice, _) => self.slice(slice, [x, y]),
                    RayPart::Volume(sides) => {
                        let at = waiting.iter().position(|waiting| waiting.sides == sides);
                        let shown = at.map(|at| of_waiting[at][in_band]);
                        shown.or_else(|| self.composite.held(sides, number)).unwrap_or(Shown::NOTHING)
                    }
                })
            });
            sum
        };
        (first..end).flat_map(|y| (0..width).map(move |x| (y, x))).map(ray).collect()
    }

    fn gather_stats(&mut self, resident: &LoadedVolume) {
        let of_regions: Vec<FrameStats> = self.regions.iter().map(Region::stats).collect();
        let backend = of_regions.first().map_or("cpu", |region| region.backend);
        let mut stats = FrameStats { backend, converged: self.is_finished(), ..FrameStats::default() };
        for region in &of_regions {
            stats.instructions = stats.instructions.or(region.instructions);
            stats.coarsest_pixel = stats.coarsest_pixel.max(region.coarsest_pixel);
            stats.render_ms += region.render_ms;
            stats.casting.add(&region.casting);
            let sums = [
                (&mut stats.passes, region.passes),
                (&mut stats.bands, region.bands),
                (&mut stats.fallbacks, region.fallbacks),
                (&mut stats.bricks_missing_at_deadline, region.bricks_missing_at_deadline),
            ];
            for (sum, count) in sums {
                *sum += count;
            }
        }
        // A ray of the picture is cast once in each region.
        stats.casting.rays = self.cut.rays_size().map(u64::from).iter().product();
        // The rays of a pixel are finished one by one.
        let per_pixel = u64::from(self.cut.scene.subgrid).pow(2);
        let unfinished = of_regions.iter().map(|region| region.pixels_unfinished).max().unwrap_or(0);
        stats.pixels_unfinished = unfinished.div_ceil(per_pixel);
        let cast_again = of_regions.iter().map(|region| region.pixels_cast_again).max().unwrap_or(0);
        stats.pixels_cast_again = cast_again.div_ceil(per_pixel);
        if self.sampled < self.cut.scene.slices.len() {
            stats.pixels_unfinished = self.cut.scene.pixels();
        }
        stats.gather_streamer(resident.as_streamer());
        self.stats = stats;
    }
}

impl Drawing for SlicedDrawing {
    fn advance(&mut self, means: Means<'_>, stop: &Stop) -> Result<(), RenderError> {
        let means = Means { device: means.device.filter(|_| self.is_by_device), ..means };
        let bytes = self.bytes(means.engine_bytes(), means.options);
        // One pixel for each ray.
        let Tools { options, device, resident } = means.for_picture(&self.cut.region(0), bytes)?;
        self.states_error = options.predict_error;
        // Errors of the parts of a ray add up.
        let parts = (self.cut.scene.slices.len() + 1) as f64;
        let max_error = if options.max_error >= ANY_ERROR { options.max_error } else { options.max_error / parts };
        let options = RenderOptions { max_error, ..options.clone() };
        self.advance_with(&mut Tools { options: &options, device, resident }, stop)
    }

    fn is_finished(&self) -> bool {
        self.sampled == self.cut.scene.slices.len() && self.joined == self.regions.len()
    }

    fn picture(&self) -> Option<Cow<'_, Image>> {
        self.joined_up().map(|(picture, _)| Cow::Owned(picture))
    }

    fn into_pictures(self: Box<Self>) -> Option<(Image, Maps)> {
        let (picture, errors) = self.joined_up()?;
        let errors = errors.map(|known| complete(known, &picture));
        Some((picture, Maps { errors, work: self.work_map() }))
    }

    fn error_map(&self) -> Option<Image> {
        let (picture, errors) = self.joined_up()?;
        Some(complete(errors?, &picture))
    }

    /// Slices are not included.
    fn work_map(&self) -> Option<Image> {
        let waiting = self.regions[self.joined..].iter().filter_map(|region| region.drawing.as_ref());
        let maps: Option<Vec<Image>> = waiting.map(StagedDrawing::work_map).collect();
        Some(self.composite.work_with(maps?)?.downsampled(self.cut.scene.subgrid))
    }

    fn error_stated(&self) -> Option<ErrorStated> {
        let unknown = self.stats.pixels_unfinished;
        let (picture, errors) = self.joined_up()?;
        Some(ErrorStated::of(&errors?, &picture, ErrorsByReason::default(), unknown))
    }

    fn stats(&self) -> FrameStats {
        self.stats.clone()
    }
}

/// The picture of a region that is not composited yet.
struct Waiting<'a> {
    sides: Sides,
    picture: &'a Image,
    /// Edge of its pixels, in rays.
    pixel: u32,
    enlargement: Enlargement<'a>,
    /// Errors of its rays; NaN where they are not finished.
    errors: Option<&'a Image>,
}

impl<'a> Waiting<'a> {
    fn new(region: &'a Region) -> Option<Self> {
        let drawing = region.drawing.as_ref()?;
        let (picture, pixel, size) = drawing.unenlarged()?;
        let enlargement = Enlargement::new(picture, pixel, size[0]);
        Some(Self { sides: region.sides, picture, pixel, enlargement, errors: drawing.known_errors() })
    }

    /// The parts of the rays of some rows.
    fn rows(&self, rows: Range<u32>, width: u32) -> Vec<Shown> {
        let rays = rows.start as usize * width as usize..rows.end as usize * width as usize;
        let mut enlarged = Vec::new();
        let pixels = match self.pixel {
            1 => &self.picture.pixels[rays.clone()],
            _ => {
                enlarged.resize(rays.len(), [0.0; 4]);
                self.enlargement.fill_rows(rows.start, &mut enlarged, |_| true);
                &enlarged
            }
        };
        let shown = |(ray, &pixel): (usize, &[f32; 4])| {
            Shown::of_region(pixel, self.errors.map_or(0.0, |known| error_of(known.pixels[ray], pixel)))
        };
        rays.zip(pixels).map(shown).collect()
    }
}
