//! A picture with slices: every ray is cut where it meets a slice, and its parts are composited again front to back.
//!
//! The slices divide the volume into convex regions. In one region a ray has one part: the same part as in a picture of
//! the volume clipped to that region. So each region is a [`StagedDrawing`] of its own, by the same packets or device,
//! from the same bricks, with the same deadlines (docs/decisions/019-slices-cut-rays.md). Colours of the slices are
//! sampled ray by ray:
//!
//! - [`cut`]: rays, cut into parts;
//! - [`sampling`]: values of the volume at points;
//! - [`sheet`]: colours of one slice.

mod cut;
pub(crate) mod sampling;
mod sheet;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use glam::Vec3;
use rayon::prelude::*;
use supervol_format::cast::single;
use supervol_format::{Container, Lod};
use supervol_scene::camera::Projection;
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::slices::SLICE_LIMIT;

use self::cut::{Cut, RayPart, Sides};
use self::sampling::Sampler;
use self::sheet::Sheet;
use super::Drawing;
use super::loaded::{LoadedVolume, level_within};
use super::means::{Means, Tools};
use super::staged::StagedDrawing;
use crate::engines::maps::Maps;
use crate::engines::totals::ErrorsByReason;
use crate::lod::by_error::ANY_ERROR;
use crate::render::accuracy::stated::{ErrorStated, complete};
use crate::render::error::RenderError;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};
use crate::stream::budget::EngineBytes;

/// Bytes of a ray's colour on a slice, and of a pixel of a region's picture including the memory for a deadline.
const SHEET_BYTES: u64 = size_of::<[f32; 3]>() as u64;
const PICTURE_BYTES: u64 = 20;

/// A progressive picture with slices.
pub(crate) struct SlicedDrawing {
    cut: Arc<Cut>,
    /// Regions of the volume between slices, with their sides.
    regions: Vec<(Sides, StagedDrawing)>,
    /// Whether a device draws the regions.
    is_by_device: bool,
    /// Colours of each slice, as far as they are known.
    sheets: Vec<Sheet>,
    /// Number of slices whose colours are final.
    sampled: usize,
    /// Least distance of each slice.
    nearest: [f64; SLICE_LIMIT],
    /// Whether slices are drawn from coarser levels, whose error is unknown.
    is_coarse: bool,
    /// Whether errors are to be stated.
    states_error: bool,
    stats: FrameStats,
}

impl SlicedDrawing {
    /// A picture that is not begun. The volume between the slices is drawn by a device or by the CPU.
    #[must_use]
    pub(crate) fn new(scene: &ResolvedScene, container: &Container, is_by_device: bool) -> Self {
        let cut = Cut::new(scene, container);
        let [width, height] = cut.rays_size();
        let meet = |(mut met, mut nearest): (BTreeSet<Sides>, [f64; SLICE_LIMIT]), y: u32| {
            for x in 0..width {
                for part in cut.parts(x, y) {
                    match part {
                        RayPart::Volume(sides) => drop(met.insert(sides)),
                        RayPart::Slice(number, t) => nearest[number] = nearest[number].min(t),
                    }
                }
            }
            (met, nearest)
        };
        let none = || (BTreeSet::new(), [f64::INFINITY; SLICE_LIMIT]);
        let join = |(mut met, nearest): (BTreeSet<Sides>, [f64; SLICE_LIMIT]),
                    (others, other): (BTreeSet<Sides>, _)| {
            met.extend(others);
            let other: [f64; SLICE_LIMIT] = other;
            (met, std::array::from_fn(|i| nearest[i].min(other[i])))
        };
        let (met, nearest) = (0..height).into_par_iter().fold(none, meet).reduce(none, join);
        let region = |sides| {
            let scene = cut.region(sides);
            let drawing = if is_by_device { StagedDrawing::by_device(scene) } else { StagedDrawing::by_packets(scene) };
            (sides, drawing)
        };
        let regions = if scene.mode == Mode::Slice { Vec::new() } else { met.into_iter().map(region).collect() };
        Self {
            regions,
            is_by_device,
            sheets: Vec::new(),
            sampled: 0,
            nearest,
            is_coarse: false,
            states_error: false,
            stats: FrameStats::default(),
            cut: Arc::new(cut),
        }
    }

    /// Host memory of this picture, given that of one picture by this engine.
    fn bytes(&self, engine: EngineBytes) -> EngineBytes {
        let regions = self.regions.len() as u64;
        let sheets = SHEET_BYTES * self.cut.scene.slices.len() as u64;
        EngineBytes { of_pixel: regions * (PICTURE_BYTES + engine.of_pixel) + sheets, ..engine }
    }

    /// Whether each pixel is known at least coarsely.
    fn has_picture(&self) -> bool {
        let has_colors = |sheet: &Sheet| !sheet.colors.is_empty();
        self.sheets.len() == self.cut.scene.slices.len()
            && self.sheets.iter().all(has_colors)
            && self.regions.iter().all(|(_, region)| region.has_picture())
    }

    /// As [`Drawing::advance`], with memory that is divided already.
    fn advance_with(&mut self, tools: &mut Tools<'_>, stop: &Stop) -> Result<(), RenderError> {
        let mut stop = stop.clone();
        if self.has_picture() {
            stop = stop.not_before(Instant::now() + LEAST_STEP);
        } else if stop.deadline().is_some() {
            let at_once = stop.instead_at(Some(Instant::now()));
            for (_, region) in self.regions.iter_mut().filter(|(_, region)| !region.has_picture()) {
                region.advance_with(tools, &at_once)?;
            }
        }
        self.sample(tools.resident, tools.options, &stop)?;
        for (_, region) in &mut self.regions {
            if !region.is_finished() && (!stop.is_due() || !region.has_picture()) {
                region.advance_with(tools, &stop)?;
            }
        }
        self.gather_stats(tools.resident);
        Ok(())
    }

    /// Finds the colours of slices that are not known yet.
    fn sample(&mut self, resident: &mut LoadedVolume, options: &RenderOptions, stop: &Stop) -> Result<(), RenderError> {
        let cut = self.cut.clone();
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
                self.sheets.push(Sheet::of_what_is_there(&cut, number, &mut sampler.of_what_is_there())?);
                continue;
            }
            if self.sheets.len() == number {
                self.sheets.push(Sheet::default());
            }
            if self.sheets[number].advance(&cut, number, &mut sampler)? {
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
            Projection::Perspective { .. } => camera.pixel_height() * self.nearest[number],
            Projection::Orthographic { .. } => camera.pixel_height(),
        };
        level_within(container, pixel)
    }

    fn region(&self, sides: Sides) -> Option<usize> {
        self.regions.binary_search_by_key(&sides, |(of, _)| *of).ok()
    }

    /// The picture with these values of rays, given their numbers and parts; the value of a pixel is the mean of its rays.
    fn by_rays(&self, value: impl Fn(usize, Vec<RayPart>) -> [f32; 4] + Sync) -> Image {
        let [width, height] = self.cut.rays_size();
        let rays = (0..height).into_par_iter().flat_map_iter(|y| (0..width).map(move |x| (x, y)));
        let value = |(x, y)| value(y as usize * width as usize + x as usize, self.cut.parts(x, y));
        Image { width, height, pixels: rays.map(value).collect() }.downsampled(self.cut.scene.subgrid)
    }

    /// Error of each pixel, grey, 1 is white, if errors are summed up: at most the sum over the parts' errors in colour
    /// and transmittance.
    fn known_errors(&self) -> Option<Image> {
        if !self.states_error {
            return None;
        }
        let maps: Option<Vec<Image>> = self.regions.iter().map(|(_, region)| region.error_map()).collect();
        let maps = maps?;
        let error = |ray: usize, parts: Vec<RayPart>| {
            let of_part = |part: RayPart| match part {
                RayPart::Volume(sides) => self.region(sides).map_or(0.0, |region| 2.0 * maps[region].pixels[ray][0]),
                RayPart::Slice(number, _) => {
                    let is_exact = number < self.sampled && !self.is_coarse;
                    if is_exact { 0.0 } else { single(self.cut.scene.slices[number].opacity) }
                }
            };
            let error = parts.into_iter().map(of_part).sum::<f32>().min(1.0);
            [error, error, error, 1.0]
        };
        Some(self.by_rays(error))
    }

    fn gather_stats(&mut self, resident: &LoadedVolume) {
        let of_regions: Vec<FrameStats> = self.regions.iter().map(|(_, region)| region.stats()).collect();
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
        let bytes = self.bytes(means.engine_bytes());
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
        self.sampled == self.cut.scene.slices.len() && self.regions.iter().all(|(_, region)| region.is_finished())
    }

    fn picture(&self) -> Option<Cow<'_, Image>> {
        let scene = &self.cut.scene;
        if !self.has_picture() {
            return None;
        }
        let pictures: Option<Vec<_>> = self.regions.iter().map(|(_, region)| region.picture()).collect();
        let pictures = pictures?;
        let pixel = |ray: usize, parts: Vec<RayPart>| {
            let (mut color, mut transmittance) = (Vec3::ZERO, 1.0);
            for part in parts {
                let (part, alpha) = match part {
                    RayPart::Volume(sides) => match self.region(sides) {
                        Some(region) => {
                            let [r, g, b, alpha] = pictures[region].pixels[ray];
                            (Vec3::new(r, g, b), alpha)
                        }
                        None => continue,
                    },
                    RayPart::Slice(number, _) => {
                        let shown = Vec3::from_array(self.sheets[number].colors[ray]);
                        let opacity = single(scene.slices[number].opacity);
                        if shown.is_nan() { continue } else { (opacity * shown, opacity) }
                    }
                };
                color += transmittance * part;
                transmittance *= 1.0 - alpha;
            }
            [color.x, color.y, color.z, 1.0 - transmittance]
        };
        Some(Cow::Owned(self.by_rays(pixel)))
    }

    fn into_pictures(self: Box<Self>) -> Option<(Image, Maps)> {
        let picture = self.picture()?.into_owned();
        let errors = self.known_errors().map(|known| complete(known, &picture));
        Some((picture, Maps { errors, work: self.work_map() }))
    }

    fn error_map(&self) -> Option<Image> {
        Some(complete(self.known_errors()?, self.picture()?.as_ref()))
    }

    /// Slices are not included.
    fn work_map(&self) -> Option<Image> {
        let maps: Option<Vec<Image>> = self.regions.iter().map(|(_, region)| region.work_map()).collect();
        let mut maps = maps?.into_iter();
        let mut sum = maps.next()?;
        for map in maps {
            for (sum, work) in sum.pixels.iter_mut().zip(&map.pixels) {
                *sum = [sum[0] + work[0], sum[1] + work[1], 0.0, sum[3].max(work[3])];
            }
        }
        Some(sum.downsampled(self.cut.scene.subgrid))
    }

    fn error_stated(&self) -> Option<ErrorStated> {
        let unknown = self.stats.pixels_unfinished;
        Some(ErrorStated::of(&self.known_errors()?, self.picture()?.as_ref(), ErrorsByReason::default(), unknown))
    }

    fn stats(&self) -> FrameStats {
        self.stats.clone()
    }
}
