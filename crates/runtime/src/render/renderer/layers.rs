//! A picture with slices: every ray is cut where it meets a slice, and its parts are composited again front to back.
//!
//! The slices divide the volume into convex regions. In one region a ray has one part: the same part as in a picture of
//! the volume clipped to that region. So each region is a picture of its own ([`Region`]), drawn by the same packets or
//! device, from the same bricks, with the same deadlines (docs/decisions/019-slices-cut-rays.md). Colours of the slices
//! are sampled ray by ray (`sheet`, `sampling`).

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use glam::{DVec3, Vec3};
use rayon::prelude::*;
use supervol_format::{Container, Dims, Geometry, Lod};
use supervol_scene::camera::{PixelRays, Projection};
use supervol_scene::clip::{ClipPlane, ToIndex, clip_ray};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::slices::{SLICE_LIMIT, SlicePlane, crossings};
use supervol_scene::units::InUnits;

use super::region::Region;
use super::resident::{Resident, level_within};
use super::sampling::Sampler;
use super::sheet::Sheet;
use super::stages::Device;
use crate::engines::totals::ErrorsByReason;
use crate::lod::by_error::ANY_ERROR;
use crate::render::error::RenderError;
use crate::render::frame::stated::{ErrorStated, complete};
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;
use crate::stop::{LEAST_STEP, Stop};
use crate::stream::budget::CasterBytes;

/// Bytes of a ray's colour on a slice, and of a pixel of a region's picture including the memory for a deadline.
const SHEET_BYTES: u64 = size_of::<[f32; 3]>() as u64;
const PICTURE_BYTES: u64 = 20;
/// Least length of a part of a ray, as a share of it. Shorter parts, between two slices in one place, are ignored.
const LEAST_PART: f64 = 1e-12;

/// A region's side of each slice: bit `i` is set on the side that the normal of slice `i` points to.
type Sides = u16;
const _: () = assert!(SLICE_LIMIT <= Sides::BITS as usize);

/// A part of a ray, front to back.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    Volume(Sides),
    /// Slice number, and position on the ray.
    Slice(usize, f64),
}

/// Rays, and the slices that cut them.
pub(super) struct Cut {
    rays: PixelRays,
    pub(super) to_index: ToIndex,
    pub(super) dims: Dims,
    pub(super) scene: ResolvedScene,
}

/// A progressive picture with slices.
pub struct Layers {
    cut: Arc<Cut>,
    /// Regions of the volume between slices, with their sides.
    regions: Vec<(Sides, Region)>,
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

impl Layers {
    /// A picture that is not begun. The volume between the slices is drawn by a device or by the CPU.
    #[must_use]
    pub fn new(scene: &ResolvedScene, container: &Container, is_by_device: bool) -> Self {
        let geometry = InUnits::of(container).geometry;
        let cut = Cut {
            rays: scene.camera.rays(),
            to_index: ToIndex::new(&geometry),
            dims: container.descriptor().dims(),
            scene: scene.clone(),
        };
        let [width, height] = cut.rays_size();
        let meet = |(mut met, mut nearest): (BTreeSet<Sides>, [f64; SLICE_LIMIT]), y: u32| {
            for x in 0..width {
                for part in cut.parts(x, y) {
                    match part {
                        Part::Volume(sides) => drop(met.insert(sides)),
                        Part::Slice(number, t) => nearest[number] = nearest[number].min(t),
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
        let region = |sides| (sides, Region::new(cut.region(sides), is_by_device));
        let regions = if scene.mode == Mode::Slice { Vec::new() } else { met.into_iter().map(region).collect() };
        Self {
            regions,
            sheets: Vec::new(),
            sampled: 0,
            nearest,
            is_coarse: false,
            states_error: false,
            stats: FrameStats::default(),
            cut: Arc::new(cut),
        }
    }

    /// The scene for the memory plan: one pixel for each ray.
    #[must_use]
    pub fn ray_scene(&self) -> ResolvedScene {
        self.cut.region(0)
    }

    /// Host memory of this picture, given that of one picture by this caster.
    #[must_use]
    pub fn bytes(&self, caster: CasterBytes) -> CasterBytes {
        let regions = self.regions.len() as u64;
        let sheets = SHEET_BYTES * self.cut.scene.slices.len() as u64;
        CasterBytes { of_pixel: regions * (PICTURE_BYTES + caster.of_pixel) + sheets, ..caster }
    }

    /// Whether every pixel is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.sampled == self.cut.scene.slices.len() && self.regions.iter().all(|(_, region)| region.is_finished())
    }

    /// Whether each pixel is known at least coarsely.
    fn has_picture(&self) -> bool {
        let has_colors = |sheet: &Sheet| !sheet.colors.is_empty();
        self.sheets.len() == self.cut.scene.slices.len()
            && self.sheets.iter().all(has_colors)
            && self.regions.iter().all(|(_, region)| region.has_picture())
    }

    /// Improves the picture until it is finished or `stop` is due. With a deadline there is always a whole picture
    /// afterwards.
    ///
    /// # Errors
    /// If memory does not suffice, there is no progress, or it is cancelled before there is a whole picture.
    pub fn advance(
        &mut self,
        mut device: Option<&mut Device>,
        resident: &mut Resident,
        options: &RenderOptions,
        stop: &Stop,
    ) -> Result<(), RenderError> {
        self.states_error = options.predict_error;
        // Errors of the parts of a ray add up.
        let parts = (self.cut.scene.slices.len() + 1) as f64;
        let max_error = if options.max_error >= ANY_ERROR { options.max_error } else { options.max_error / parts };
        let options = RenderOptions { max_error, ..options.clone() };
        let mut stop = stop.clone();
        if self.has_picture() {
            stop = stop.not_before(Instant::now() + LEAST_STEP);
        } else if stop.deadline().is_some() {
            let at_once = stop.instead_at(Some(Instant::now()));
            for (_, region) in self.regions.iter_mut().filter(|(_, region)| !region.has_picture()) {
                region.advance(device.as_deref_mut(), resident, &options, &at_once)?;
            }
        }
        self.sample(resident, &options, &stop)?;
        for (_, region) in &mut self.regions {
            if !region.is_finished() && (!stop.is_due() || !region.has_picture()) {
                region.advance(device.as_deref_mut(), resident, &options, &stop)?;
            }
        }
        self.gather_stats(resident);
        Ok(())
    }

    /// Finds the colours of slices that are not known yet.
    fn sample(&mut self, resident: &mut Resident, options: &RenderOptions, stop: &Stop) -> Result<(), RenderError> {
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

    /// The picture so far; `None` until each pixel is known.
    #[must_use]
    pub fn picture(&self) -> Option<Image> {
        let scene = &self.cut.scene;
        if !self.has_picture() {
            return None;
        }
        let pictures: Option<Vec<_>> = self.regions.iter().map(|(_, region)| region.picture()).collect();
        let pictures = pictures?;
        let [width, height] = self.cut.rays_size();
        let pixel = |x: u32, y: u32| {
            let ray = y as usize * width as usize + x as usize;
            let (mut color, mut transmittance) = (Vec3::ZERO, 1.0);
            for part in self.cut.parts(x, y) {
                let (part, alpha) = match part {
                    Part::Volume(sides) => match self.region(sides) {
                        Some(region) => {
                            let [r, g, b, alpha] = pictures[region].pixels[ray];
                            (Vec3::new(r, g, b), alpha)
                        }
                        None => continue,
                    },
                    Part::Slice(number, _) => {
                        let shown = Vec3::from_array(self.sheets[number].colors[ray]);
                        let opacity = scene.slices[number].opacity as f32;
                        if shown.is_nan() { continue } else { (opacity * shown, opacity) }
                    }
                };
                color += transmittance * part;
                transmittance *= 1.0 - alpha;
            }
            [color.x, color.y, color.z, 1.0 - transmittance]
        };
        let rows = (0..height).into_par_iter().flat_map_iter(|y| (0..width).map(move |x| (x, y)));
        let pixels = rows.map(|(x, y)| pixel(x, y)).collect();
        Some(Image { width, height, pixels }.downsampled(scene.subgrid))
    }

    fn region(&self, sides: Sides) -> Option<usize> {
        self.regions.binary_search_by_key(&sides, |(of, _)| *of).ok()
    }

    /// Error of each pixel, grey, 1 is white, if errors are summed up: at most the sum over the parts' errors in colour
    /// and transmittance.
    fn known_errors(&self) -> Option<Image> {
        if !self.states_error {
            return None;
        }
        let maps: Option<Vec<Image>> = self.regions.iter().map(|(_, region)| region.error_map()).collect();
        let maps = maps?;
        let [width, height] = self.cut.rays_size();
        let error = |x: u32, y: u32| {
            let ray = y as usize * width as usize + x as usize;
            let of_part = |part: Part| match part {
                Part::Volume(sides) => self.region(sides).map_or(0.0, |region| 2.0 * maps[region].pixels[ray][0]),
                Part::Slice(number, _) => {
                    let is_exact = number < self.sampled && !self.is_coarse;
                    if is_exact { 0.0 } else { self.cut.scene.slices[number].opacity as f32 }
                }
            };
            let error = self.cut.parts(x, y).into_iter().map(of_part).sum::<f32>().min(1.0);
            [error, error, error, 1.0]
        };
        let rows = (0..height).into_par_iter().flat_map_iter(|y| (0..width).map(move |x| (x, y)));
        let pixels = rows.map(|(x, y)| error(x, y)).collect();
        Some(Image { width, height, pixels }.downsampled(self.cut.scene.subgrid))
    }

    /// Work map: cost of the rays of each pixel, summed over all regions; see [`crate::engines::maps::of_work`]. Slices
    /// are not included.
    #[must_use]
    pub fn work_map(&self) -> Option<Image> {
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

    /// Error map of a picture, if there is one.
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        Some(complete(self.known_errors()?, &self.picture()?))
    }

    /// The stated errors in numbers.
    #[must_use]
    pub fn error_stated(&self) -> Option<ErrorStated> {
        let unknown = self.stats.pixels_unfinished;
        Some(ErrorStated::of(&self.known_errors()?, &self.picture()?, ErrorsByReason::default(), unknown))
    }

    /// Statistics so far, including unfinished parts.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        self.stats.clone()
    }

    fn gather_stats(&mut self, resident: &Resident) {
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

impl Cut {
    /// Number of rays along x and y.
    pub(super) fn rays_size(&self) -> [u32; 2] {
        [self.scene.camera.width, self.scene.camera.height]
    }

    /// The parts of a ray, front to back.
    fn parts(&self, x: u32, y: u32) -> Vec<Part> {
        let ray = self.rays.ray(x, y);
        let Some(segment) = clip_ray(&ray, &self.to_index.ray(&ray), self.dims, &self.scene.clip) else {
            return Vec::new();
        };
        let slices = &self.scene.slices;
        let least = LEAST_PART * (segment.t1 - segment.t0);
        let mut parts = Vec::with_capacity(2 * slices.len() + 1);
        let mut before = segment.t0;
        let volume = |from: f64, to: f64| {
            let middle = ray.origin + 0.5 * (from + to) * ray.direction;
            (to - from > least).then(|| Part::Volume(sides_of(slices, middle)))
        };
        for (t, number) in crossings(slices, &ray, segment) {
            parts.extend(volume(before, t));
            let point = ray.origin + t * ray.direction;
            if self.scene.clip.solids.iter().all(|solid| solid.keeps(point)) {
                parts.push(Part::Slice(number, t));
            }
            before = t;
        }
        parts.extend(volume(before, segment.t1));
        parts
    }

    /// The scene of one region, with a pixel for each ray.
    fn region(&self, sides: Sides) -> ResolvedScene {
        let mut scene =
            ResolvedScene { image_size: self.rays_size(), subgrid: 1, slices: Vec::new(), ..self.scene.clone() };
        scene.clip.planes.extend(self.scene.slices.iter().enumerate().map(|(i, slice)| {
            let side = if sides >> i & 1 == 1 { 1.0 } else { -1.0 };
            ClipPlane { normal: side * slice.normal, offset: side * slice.offset }
        }));
        scene
    }

    /// The point at which a ray meets a slice.
    pub(super) fn point_on(&self, number: usize, x: u32, y: u32) -> Option<DVec3> {
        let at = self.parts(x, y).into_iter().find_map(|part| match part {
            Part::Slice(of, t) if of == number => Some(t),
            _ => None,
        })?;
        let ray = self.rays.ray(x, y);
        Some(ray.origin + at * ray.direction)
    }
}

/// The sides of the slices at a point.
fn sides_of(slices: &[SlicePlane], p: DVec3) -> Sides {
    slices.iter().enumerate().map(|(i, slice)| Sides::from(slice.is_before(p)) << i).sum()
}

/// Geometry of level 0, and the voxels of level 0 along each axis of one voxel of this level: for texels.
pub(super) fn scale_of(container: &Container, lod: Lod) -> (Geometry, [u64; 3]) {
    (InUnits::of(container).geometry, container.pyramid().level_at(lod).scale)
}
