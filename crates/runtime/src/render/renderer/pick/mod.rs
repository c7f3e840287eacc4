//! Picking: the first visible point on the ray through the middle of a pixel.
//!
//! The ray is walked front to back, cell by cell, over the voxels of one level: the finest, or the one that pictures
//! are drawn from. Bricks are fetched on demand, a run of cells at a time. So memory is bounded for any volume, and
//! time by twice the cells on one ray. The picture does not change. The ray follows the rendering model: bricks that
//! could not be read are absent here, although the picture shows their parents.
//!
//! | mode | the point |
//! |---|---|
//! | `dvr` | where the gathered opacity first reaches half of the whole, or the surface or slice that takes it there |
//! | `iso` | the first surface, or slice, that is not fully transparent |
//! | `mip`, `minip` | the first place of the extreme |
//! | `slice` | the first slice that is not fully transparent |
//! | `mean` | of a slab of the grid seen face on: the middle of the slab, see [`section`]; else none: a mean has no depth |

mod along;
mod section;

use std::ops::ControlFlow;

use glam::DVec3;
use serde::Serialize;
use supervol_format::Lod;
use supervol_scene::camera::Ray;
use supervol_scene::clip::{IndexRay, Segment, ToIndex, clip_parts, clip_ray};
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::slices::{Interpolation, SlicePlane, crossings};
use supervol_scene::units::{InUnits, Units};

use self::along::{Cells, Factor, FieldCubic, NODES};
use crate::render::accuracy::check::level_to_check;
use crate::render::drawing::loaded::LoadedVolume;
use crate::render::drawing::slices::sampling::{Chunk, Sampler};
use crate::render::error::RenderError;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::stop::Stop;

/// Cells sampled at a time.
const RUN_CELLS: usize = 1024;
/// Least opacity of a ray that shows something: half a grey level.
const LEAST_OPACITY: f64 = 0.5 / 255.0;
/// Transmittance below which nothing behind changes where half of the opacity is reached.
const NOTHING_LEFT: f64 = 1e-9;
/// Halvings after which a piece of a ray is empty in `f64`.
const HALVINGS: usize = 60;

/// The object at a picked point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum PickedOn {
    /// The semi-transparent volume.
    Volume,
    /// The scene's iso surface of this number.
    Surface(usize),
    /// The greatest or least value on the ray.
    Extreme,
    /// The scene's slice of this number; 0 for a section across an axis of the grid, seen face on.
    Slice(usize),
}

/// The first visible point under a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Picked {
    /// The object at the point.
    pub on: PickedOn,
    /// Value of the volume there, data units; on a slice with a filter, the value before filtering.
    pub value: f64,
    /// World position.
    pub world: [f64; 3],
    /// Index position, level 0.
    pub index: [f64; 3],
    /// The level that the value was read from.
    pub level: u8,
}

/// An event on a ray, front to back.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Event {
    /// A piece of the ray in one cell, between two t, and the factor of its extinction.
    Cell([f64; 2], FieldCubic, Factor),
    /// An absent or clipped part.
    Gap,
    /// The slice of this number, at t, with its value.
    Slice(usize, f64, f64),
}

/// An object, its position t on the ray, and its value in units.
type FoundObject = (PickedOn, f64, f64);

/// The point under pixel (x, y) of the finished picture; `None` if nothing is visible.
///
/// # Errors
/// If the mode has no such point, bricks cannot be fetched, or it is cancelled.
pub(super) fn pick(
    resident: &mut LoadedVolume,
    (scene, units): (&ResolvedScene, &Units),
    options: &RenderOptions,
    [x, y]: [u32; 2],
    stop: &Stop,
) -> Result<Option<Picked>, RenderError> {
    let geometry = InUnits::of(resident.container()).geometry;
    let to_index = ToIndex::new(&geometry);
    let ray = scene.camera.coarser(scene.subgrid).ray(x, y);
    let slab = section::thickness(scene, &geometry, resident.container().descriptor().dims());
    if scene.mode == Mode::Mean && slab.is_none() {
        return Err(RenderError::NoPlace);
    }
    let lod = level_to_check(resident.container(), options.level);
    let mut walk = Walk::new(resident, scene, (ray, to_index.ray(&ray)), (lod, options), stop)?;
    let found = match scene.mode {
        Mode::Dvr => walk.half_of_opacity()?,
        Mode::Iso => walk.first_surface()?,
        Mode::Mip => walk.extreme(1.0)?,
        Mode::Minip => walk.extreme(-1.0)?,
        Mode::Slice => walk.first_slice()?,
        Mode::Mean => walk.middle_of_slab(slab.unwrap_or(0.0))?,
    };
    Ok(found.map(|(on, t, value)| {
        let point = ray.origin + t * ray.direction;
        let world = units.anchor + units.length * point;
        Picked { on, value: value * units.value, world: world.to_array(), index: to_index.point(point), level: lod.0 }
    }))
}

/// Walk along a ray.
struct Walk<'a> {
    scene: &'a ResolvedScene,
    sampler: Sampler<'a>,
    /// The ray in index space of level 0.
    index_ray: IndexRay,
    /// The ray in index space of the sampled level.
    level_ray: IndexRay,
    /// The ray in the clip box and in front of the clip planes; `None` if it misses them.
    whole: Option<Segment>,
    /// The parts of `whole` that all solids keep.
    parts: Vec<Segment>,
    /// Slices that are not clipped: number, t and value, front to back.
    slices: Vec<(usize, f64, f64)>,
    chunk: Chunk,
}

impl<'a> Walk<'a> {
    fn new(
        resident: &'a mut LoadedVolume,
        scene: &'a ResolvedScene,
        (ray, index_ray): (Ray, IndexRay),
        (lod, options): (Lod, &RenderOptions),
        stop: &Stop,
    ) -> Result<Self, RenderError> {
        let container = resident.container().clone();
        let dims = container.descriptor().dims();
        let level = container.pyramid().level_at(lod);
        let level_ray = IndexRay {
            origin: level.from_level_0(index_ray.origin),
            direction: std::array::from_fn(|a| index_ray.direction[a] / level.scale[a] as f64),
        };
        // In `dvr`, invisible bricks need not be read; in other modes, and for gradients, every value counts.
        let is_by_value = scene.mode == Mode::Dvr && scene.gradient_opacity.is_none();
        let mode = if is_by_value { Mode::Dvr } else { Mode::Slice };
        let aimed = ResolvedScene { mode, slices: Vec::new(), ..scene.clone() };
        let level = LevelChoice::Fixed(lod);
        resident.aim(&aimed, &RenderOptions { level, ..options.clone() });
        let sampler = Sampler::new(resident.streamer(), lod, stop.clone())?;
        let parts = clip_parts(&ray, &index_ray, dims, &scene.clip);
        let is_kept = |t: f64| scene.clip.solids.iter().all(|solid| solid.keeps(ray.origin + t * ray.direction));
        let whole = clip_ray(&ray, &index_ray, dims, &scene.clip);
        let crossed = whole.map_or_else(Vec::new, |whole| crossings(&scene.slices, &ray, whole));
        let crossed = crossed.into_iter().filter(|(t, _)| is_kept(*t));
        let slices = crossed.map(|(t, number)| (number, t, f64::NAN)).collect();
        let mut walk = Self { scene, sampler, index_ray, level_ray, whole, parts, slices, chunk: Chunk::default() };
        for place in 0..walk.slices.len() {
            let (number, t, _) = walk.slices[place];
            let SlicePlane { interpolation, .. } = scene.slices[number];
            walk.slices[place].2 = walk.values(&[t], interpolation)?[0];
        }
        Ok(walk)
    }

    /// Values in units at positions of the ray; NaN where absent.
    fn values(&mut self, places: &[f64], how: Interpolation) -> Result<Vec<f64>, RenderError> {
        self.values_at(&places.iter().map(|&t| self.index_ray.at(t)).collect::<Vec<_>>(), how)
    }

    /// Values in units at points in index space of level 0; NaN where absent.
    fn values_at(&mut self, points: &[[f64; 3]], how: Interpolation) -> Result<Vec<f64>, RenderError> {
        let mut chunk = std::mem::take(&mut self.chunk);
        while !self.sampler.advance(points, how, &mut chunk)? {}
        Ok(chunk.values.into_iter().map(|value| self.sampler.map().to_data(value)).collect())
    }

    /// Passes everything on the ray, front to back, to `visit`, until that breaks.
    fn events<T>(&mut self, mut visit: impl FnMut(Event) -> ControlFlow<T>) -> Result<Option<T>, RenderError> {
        let mut slices = self.slices.clone().into_iter().peekable();
        let mut left = f64::NAN;
        for part in self.parts.clone() {
            let is_apart = left != part.t0;
            left = part.t1;
            if is_apart && let ControlFlow::Break(found) = visit(Event::Gap) {
                return Ok(Some(found));
            }
            let mut from = part.t0;
            while from < part.t1 {
                // A slice cuts the part.
                let next = slices.peek().map_or(f64::INFINITY, |slice| slice.1);
                let to = next.clamp(from, part.t1);
                if let Some(found) = self.cells([from, to], &mut visit)? {
                    return Ok(Some(found));
                }
                from = to;
                if next <= part.t1
                    && let Some((number, t, value)) = slices.next()
                    && let ControlFlow::Break(found) = visit(Event::Slice(number, t, value))
                {
                    return Ok(Some(found));
                }
            }
        }
        // A slice at the very end of the ray.
        Ok(slices.find_map(|(number, t, value)| visit(Event::Slice(number, t, value)).break_value()))
    }

    /// The cells of a part of the ray, run by run.
    fn cells<T>(
        &mut self,
        ends: [f64; 2],
        visit: &mut impl FnMut(Event) -> ControlFlow<T>,
    ) -> Result<Option<T>, RenderError> {
        if self.scene.mode == Mode::Slice {
            return Ok(None);
        }
        let mut cells = Cells::new(self.level_ray.origin, self.level_ray.direction, ends);
        loop {
            let run: Vec<[f64; 2]> = cells.by_ref().take(RUN_CELLS).collect();
            if run.is_empty() {
                return Ok(None);
            }
            let nodes = run.iter().flat_map(|[t0, t1]| NODES.map(|x| t0 + x * (t1 - t0)));
            let values = self.values(&nodes.collect::<Vec<_>>(), Interpolation::Linear)?;
            let factors = self.factors(&run)?;
            for ((cell, values), factor) in run.iter().zip(values.as_chunks::<{ NODES.len() }>().0).zip(factors) {
                let is_absent = values.iter().any(|value| value.is_nan());
                let event =
                    if is_absent { Event::Gap } else { Event::Cell(*cell, FieldCubic::through(*values), factor) };
                if let ControlFlow::Break(found) = visit(event) {
                    return Ok(Some(found));
                }
            }
        }
    }

    /// Factors of the extinction in some cells.
    fn factors(&mut self, cells: &[[f64; 2]]) -> Result<Vec<Factor>, RenderError> {
        let Some(ramp) = self.scene.gradient_opacity else { return Ok(vec![Factor::Constant(1.0); cells.len()]) };
        let (geometry, scale) = self.sampler.grid();
        let scale = scale.map(|s| s as f64);
        let to_world = geometry.world_from_index_gradient();
        // Central differences one voxel of the level apart: before and behind along each axis.
        let mut taps = Vec::new();
        for point in cells.iter().flat_map(|[t0, t1]| NODES.map(|x| t0 + x * (t1 - t0))).map(|t| self.index_ray.at(t)) {
            for (axis, step) in (0..3).flat_map(|axis| [(axis, -scale[axis]), (axis, scale[axis])]) {
                let mut tap = point;
                tap[axis] += step;
                taps.push(tap);
            }
        }
        let values = self.values_at(&taps, Interpolation::Linear)?;
        let gradient = |[x0, x1, y0, y1, z0, z1]: &[f64; 6]| {
            let differences = DVec3::new((x1 - x0) / scale[0], (y1 - y0) / scale[1], (z1 - z0) / scale[2]);
            to_world * (0.5 * differences)
        };
        let gradients: Vec<DVec3> = values.as_chunks::<6>().0.iter().map(gradient).collect();
        let factor = |nodes: &[DVec3; NODES.len()]| {
            // An unknown gradient counts as none.
            let is_known = nodes.iter().all(|gradient| !gradient.is_nan());
            let component = |axis: usize| FieldCubic::through(nodes.map(|gradient| gradient[axis]));
            if is_known { Factor::Ramp(ramp, [0, 1, 2].map(component)) } else { Factor::Constant(0.0) }
        };
        Ok(gradients.as_chunks::<{ NODES.len() }>().0.iter().map(factor).collect())
    }

    fn half_of_opacity(&mut self) -> Result<Option<FoundObject>, RenderError> {
        let (scene, mut left) = (self.scene, 1.0);
        let mut sides = SurfaceSides::default();
        self.events(|event| {
            left *= match event {
                Event::Cell([t0, t1], field, factor) => {
                    let surfaces =
                        sides.cross(&field, scene).into_iter().map(|(_, number)| 1.0 - scene.iso[number].alpha);
                    (-depth_between((&field, &factor), [0.0, 1.0], t1 - t0, scene)).exp() * surfaces.product::<f64>()
                }
                Event::Slice(number, _, value) if !value.is_nan() => 1.0 - scene.slices[number].opacity,
                Event::Slice(..) => 1.0,
                Event::Gap => {
                    sides = SurfaceSides::default();
                    1.0
                }
            };
            if left < NOTHING_LEFT { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?;
        if 1.0 - left < LEAST_OPACITY {
            return Ok(None);
        }
        let (half, mut left) = (1.0 - 0.5 * (1.0 - left), 1.0);
        let mut sides = SurfaceSides::default();
        self.events(|event| {
            match event {
                Event::Cell([t0, t1], field, factor) => {
                    // Walks the cell in parts, between surfaces.
                    let mut from = 0.0;
                    let surfaces = sides.cross(&field, scene).into_iter().map(|(x, number)| (x, Some(number)));
                    for (to, surface) in surfaces.chain([(1.0, None)]) {
                        let part = [from, to];
                        let wanted = -(half / left).ln();
                        let depth = depth_between((&field, &factor), part, t1 - t0, scene);
                        if depth >= wanted {
                            let x = place_of_depth((&field, &factor), part, (t1 - t0, wanted), scene);
                            return ControlFlow::Break((PickedOn::Volume, t0 + x * (t1 - t0), field.at(x)));
                        }
                        left *= (-depth).exp();
                        let Some(number) = surface else { continue };
                        left *= 1.0 - scene.iso[number].alpha;
                        if left <= half {
                            let on = PickedOn::Surface(number);
                            return ControlFlow::Break((on, t0 + to * (t1 - t0), scene.iso[number].value));
                        }
                        from = to;
                    }
                }
                Event::Slice(number, t, value) if !value.is_nan() => {
                    left *= 1.0 - scene.slices[number].opacity;
                    if left <= half {
                        return ControlFlow::Break((PickedOn::Slice(number), t, value));
                    }
                }
                Event::Slice(..) => {}
                Event::Gap => sides = SurfaceSides::default(),
            }
            ControlFlow::Continue(())
        })
    }

    /// The first crossing of a visible surface. A value on the surface counts as above it.
    fn first_surface(&mut self) -> Result<Option<FoundObject>, RenderError> {
        let scene = self.scene;
        let mut before: Option<f64> = None;
        self.events(|event| {
            let (cell, field) = match event {
                Event::Cell(cell, field, _) => (cell, field),
                Event::Gap => {
                    before = None;
                    return ControlFlow::Continue(());
                }
                Event::Slice(number, t, value) => return slice_that_shows(scene, number, t, value),
            };
            let mut first: Option<(f64, usize)> = None;
            for (number, surface) in scene.iso.iter().enumerate().filter(|(_, surface)| surface.alpha > 0.0) {
                let level = surface.value;
                let mut side = before.map_or(field.at(0.0) >= level, |value| value >= level);
                for ends in field.turns().windows(2) {
                    let place = [ends[0], ends[1]].into_iter().find(|&x| (field.at(x) >= level) != side);
                    if let Some(place) = place {
                        let x = if place == ends[0] { place } else { field.crossing([ends[0], ends[1]], level) };
                        first = first.filter(|(earlier, _)| *earlier <= x).or(Some((x, number)));
                        break;
                    }
                    side = field.at(ends[1]) >= level;
                }
            }
            before = Some(field.at(1.0));
            match first {
                Some((x, number)) => {
                    let t = cell[0] + x * (cell[1] - cell[0]);
                    ControlFlow::Break((PickedOn::Surface(number), t, scene.iso[number].value))
                }
                None => ControlFlow::Continue(()),
            }
        })
    }

    /// The first position of the greatest (sign 1) or least value (sign -1).
    fn extreme(&mut self, sign: f64) -> Result<Option<FoundObject>, RenderError> {
        let mut best: Option<FoundObject> = None;
        self.events(|event| {
            if let Event::Cell([t0, t1], field, _) = event {
                for x in field.turns() {
                    let value = field.at(x);
                    if best.is_none_or(|(_, _, best)| sign * value > sign * best) {
                        best = Some((PickedOn::Extreme, t0 + x * (t1 - t0), value));
                    }
                }
            }
            ControlFlow::<()>::Continue(())
        })?;
        let alpha = |value: f64| self.scene.transfer_function.classify(value).1;
        Ok(best.filter(|(_, _, value)| alpha(*value) >= LEAST_OPACITY))
    }

    fn first_slice(&mut self) -> Result<Option<FoundObject>, RenderError> {
        let scene = self.scene;
        self.events(|event| match event {
            Event::Slice(number, t, value) => slice_that_shows(scene, number, t, value),
            Event::Cell(..) | Event::Gap => ControlFlow::Continue(()),
        })
    }
}

fn slice_that_shows(scene: &ResolvedScene, number: usize, t: f64, value: f64) -> ControlFlow<FoundObject> {
    let shows = !value.is_nan() && scene.slices[number].opacity > 0.0;
    if shows { ControlFlow::Break((PickedOn::Slice(number), t, value)) } else { ControlFlow::Continue(()) }
}

/// The ray's side of each surface's value, if known.
#[derive(Debug, Default)]
struct SurfaceSides {
    value: Option<f64>,
}

impl SurfaceSides {
    /// Crossings of surfaces in a cell, in order: x and surface number. A value on the surface counts as above it.
    fn cross(&mut self, field: &FieldCubic, scene: &ResolvedScene) -> Vec<(f64, usize)> {
        let mut found = Vec::new();
        for (number, surface) in scene.iso.iter().enumerate() {
            let mut side = self.value.unwrap_or(field.at(0.0)) >= surface.value;
            for ends in field.turns().windows(2) {
                let [begins, is_end_above] = [ends[0], ends[1]].map(|x| field.at(x) >= surface.value);
                if begins != side {
                    found.push((ends[0], number));
                }
                if begins != is_end_above {
                    found.push((field.crossing([ends[0], ends[1]], surface.value), number));
                }
                side = is_end_above;
            }
        }
        self.value = Some(field.at(1.0));
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found
    }
}

/// The field in a piece, and the factor of its extinction.
type Extinction<'a> = (&'a FieldCubic, &'a Factor);

/// Optical depth between two x in a piece of this length.
fn depth_between((field, factor): Extinction<'_>, part: [f64; 2], length: f64, scene: &ResolvedScene) -> f64 {
    let depth = |ends: &[f64]| field.depth([ends[0], ends[1]], length, &scene.transfer_function, factor);
    smooth_parts((field, factor), part, scene).windows(2).map(depth).sum()
}

/// Positions between two x at which extinction is not smooth.
fn smooth_parts((field, factor): Extinction<'_>, [from, to]: [f64; 2], scene: &ResolvedScene) -> Vec<f64> {
    let cuts = field.smooth_parts(&scene.transfer_function, factor);
    let inside = cuts.into_iter().filter(|x| from < *x && *x < to);
    std::iter::once(from).chain(inside).chain([to]).collect()
}

/// The position x, in a part of a piece of this length, at which the wanted optical depth has been gathered.
fn place_of_depth(
    (field, factor): Extinction<'_>,
    part: [f64; 2],
    (length, wanted): (f64, f64),
    scene: &ResolvedScene,
) -> f64 {
    let depth_between = |ends: [f64; 2]| field.depth(ends, length, &scene.transfer_function, factor);
    let mut gathered = 0.0;
    for ends in smooth_parts((field, factor), part, scene).windows(2) {
        let depth = depth_between([ends[0], ends[1]]);
        if gathered + depth < wanted {
            gathered += depth;
            continue;
        }
        let [mut low, mut high] = [ends[0], ends[1]];
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let is_before = gathered + depth_between([ends[0], middle]) < wanted;
            if is_before { low = middle } else { high = middle }
        }
        return high;
    }
    part[1]
}
