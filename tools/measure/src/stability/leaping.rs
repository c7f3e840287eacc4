//! Regime of leaping: S22. Rays through one brick at a time, by the walker of packets alone.

use rayon::prelude::*;
use supervol_format::brick::APRON;
use supervol_format::cast::{index, narrow, single, whole};
use supervol_format::random::Random;
use supervol_format::{BrickKey, Dims, Lod, VoxelType};
use supervol_runtime::engines::blocks::BLOCK;
use supervol_runtime::engines::packets::blocks::cloud_of_blocks;
use supervol_runtime::engines::packets::leap::{AxisDirection, ProximityCloud};
use supervol_runtime::engines::packets::simd::InstructionSet;
use supervol_runtime::engines::packets::trace::{LocalRay, RayInterval, intervals};
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident, Voxels};
use supervol_scene::clip::{IndexRay, clip_ray};
use supervol_scene::scene::ResolvedScene;
use supervol_scene::transfer_function::render::RenderTransferFunction;
use supervol_scene::value_map::ValueMap;
use supervol_scene::value_map::value_map;
use supervol_sources::VolumeSource;
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::synthetic::Synthetic;

use super::parallel::worst;
use super::regime::{CurvePoint, Gate, Outcome, Regime};
use super::views::{BLUE, GOLD, fractions};
use crate::context::{ChartError, Context};
use crate::resident::ResidentBricks;
use crate::scenes::CARP;
use crate::volume::{Point, Volume, build_options, image_size};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[Regime {
    id: "S22",
    title: "Proximity clouds",
    recipe: "Bricks with random blocks that show, 0.1 to 50 %; rays of which components are 0 and -0, and that start on \
             faces. Then vessels, CT and a survey's brightest spots, cell by cell: what could be skipped, and what is.",
    x_label: "blocks that show something, percent",
    y_label: "ways through what shows nothing, per ray and brick",
    run: leaping,
}];

/// Largest distance from a face, in cells, of a position on the face: rounding of `f32` over the largest brick.
const ON_FACE: f64 = 1e-4;
/// Least fraction of the empty length that must be skipped.
const LEAST_SKIPPED: f64 = 0.8;
/// Core voxels of the random bricks: the default core, and one that ends inside a block on two axes.
const CORES: [[usize; 3]; 2] = [[64; 3], [37, 22, 61]];
/// Fractions of visible blocks.
const OCCUPANCIES: [f64; 6] = [0.001, 0.005, 0.02, 0.1, 0.25, 0.5];
/// Number of random rays per brick.
const RAYS_PER_BRICK: usize = 256;
/// Core of the bricks of volumes, voxels.
const BRICK: u32 = 64;

/// Findings along some rays.
#[derive(Debug, Clone, Copy, Default)]
struct Findings {
    /// Pairs of a ray and a brick that it crosses.
    ways: f64,
    /// Number of leaps.
    leaps: f64,
    /// Number of empty cells.
    empty_cells: f64,
    /// World length in empty cells, and the leapt part of it.
    skippable: f64,
    skipped: f64,
    /// Visible cells that were leapt over.
    jumped_over: f64,
    /// Rays whose intervals have gaps, overlap, or do not end at the end of the ray.
    untiled: f64,
    /// Greatest distance of a leap's end from the nearest block face or end of the ray, cells.
    beside_faces: f64,
}

impl Findings {
    fn add(self, other: Self) -> Self {
        Self {
            ways: self.ways + other.ways,
            leaps: self.leaps + other.leaps,
            empty_cells: self.empty_cells + other.empty_cells,
            skippable: self.skippable + other.skippable,
            skipped: self.skipped + other.skipped,
            jumped_over: self.jumped_over + other.jumped_over,
            untiled: self.untiled + other.untiled,
            beside_faces: worst([self.beside_faces, other.beside_faces]),
        }
    }

    /// Examines one ray. `shows`: whether a cell (a cube of `side` voxels) is visible. Cells outside the brick may
    /// occur.
    fn of_ray(
        ray: &LocalRay,
        ways: &[RayInterval],
        core: [usize; 3],
        side: usize,
        shows: impl Fn([i64; 3]) -> bool,
    ) -> Self {
        let mut found = Self { ways: 1.0, untiled: f64::from(!is_tiled(ray, ways)), ..Self::default() };
        let leaps: Vec<[f64; 2]> = ways.iter().filter(|s| s.is_leap).map(|s| s.t.map(f64::from)).collect();
        found.leaps = leaps.len() as f64;
        found.beside_faces = worst(leaps.iter().map(|leap| beside_faces(ray, leap[1])));
        for ([from, to], cell) in pieces(ray, core, side) {
            if !shows(cell) {
                found.skippable += to - from;
                found.empty_cells += 1.0;
            }
            for [begin, end] in leaps.iter().map(|leap| [leap[0].max(from), leap[1].min(to)]) {
                if end <= begin {
                    continue;
                }
                if !shows(cell) {
                    found.skipped += end - begin;
                } else if is_inside(position(ray, 0.5 * (begin + end)), cell, side) {
                    found.jumped_over += 1.0;
                }
            }
        }
        found
    }
}

fn position(ray: &LocalRay, t: f64) -> [f64; 3] {
    std::array::from_fn(|a| f64::from(ray.origin[a]) + t * f64::from(ray.direction[a]))
}

/// Whether the intervals cover the ray from 0 to its end without gaps.
fn is_tiled(ray: &LocalRay, ways: &[RayInterval]) -> bool {
    let begins_and_ends = ways.first().is_none_or(|s| s.t[0] == 0.0)
        && ways.last().is_none_or(|s| s.t[1] == ray.length)
        && !ways.is_empty();
    begins_and_ends && ways.windows(2).all(|w| w[0].t[1] == w[1].t[0]) && ways.iter().all(|s| s.t[0] <= s.t[1])
}

/// Distance of a position from the nearest block face on any axis, cells; 0 at the end of the ray.
fn beside_faces(ray: &LocalRay, t: f64) -> f64 {
    if t >= f64::from(ray.length) {
        return 0.0;
    }
    let side = BLOCK as f64;
    let beside = |p: f64| (p - (p / side).round() * side).abs();
    position(ray, t).map(beside).into_iter().fold(f64::INFINITY, f64::min)
}

/// Whether a position lies inside a cell and on none of its faces.
fn is_inside(position: [f64; 3], cell: [i64; 3], side: usize) -> bool {
    let low = cell.map(|c| (c * narrow::<i64>(side)) as f64);
    (0..3).all(|a| low[a] + ON_FACE < position[a] && position[a] < low[a] + side as f64 - ON_FACE)
}

/// Cells along a ray, by brute force: all plane crossings, sorted. The midpoint of two crossings gives the cell.
fn pieces(ray: &LocalRay, core: [usize; 3], side: usize) -> Vec<([f64; 2], [i64; 3])> {
    let length = f64::from(ray.length);
    let mut ends = vec![0.0, length];
    for (a, voxels) in core.into_iter().enumerate() {
        let (origin, direction) = (f64::from(ray.origin[a]), f64::from(ray.direction[a]));
        let crossings = (0..=voxels / side).map(|plane| ((plane * side) as f64 - origin) / direction);
        ends.extend(crossings.filter(|&t| 0.0 < t && t < length));
    }
    ends.sort_by(f64::total_cmp);
    let cell = |[from, to]: [f64; 2]| position(ray, 0.5 * (from + to)).map(|p| whole::<i64>((p / side as f64).floor()));
    ends.windows(2).map(|w| [w[0], w[1]]).filter(|w| w[0] < w[1]).map(|w| (w, cell(w))).collect()
}

fn leaping(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let bricks = context.pick(378, 27);
    let mut curve = Vec::new();
    let mut random = Findings::default();
    for occupancy in OCCUPANCIES {
        let percent = 100.0 * occupancy;
        for (name, counts) in
            [("distance to the nearest", Counts::All), ("distance to the nearest ahead", Counts::Ahead)]
        {
            let found = random_bricks(occupancy, bricks, counts);
            if counts == Counts::All {
                curve.push(CurvePoint::new("blocks, one by one", percent, found.empty_cells / found.ways, None));
            }
            curve.push(CurvePoint::new(name, percent, found.leaps / found.ways, None));
            random = random.add(found);
        }
    }
    let mut gates = vec![
        Gate::at_most("cells that show something and are leapt over, random bricks", random.jumped_over, 0.0),
        Gate::at_most("rays that leaps and walks do not tile, random bricks", random.untiled, 0.0),
        Gate::at_most("greatest distance of a leap's end from a face, voxels", random.beside_faces, ON_FACE),
    ];
    let mut note = format!("{} random rays and bricks.", random.ways);
    for (name, found) in volumes(context)? {
        let share = found.skipped / found.skippable;
        gates.push(Gate::at_least(format!("{name}: share of what could be skipped that is"), share, LEAST_SKIPPED));
        gates.push(Gate::at_most(
            format!("{name}: cells that show something and are leapt over"),
            found.jumped_over,
            0.0,
        ));
        gates.push(Gate::at_most(format!("{name}: rays that leaps and walks do not tile"), found.untiled, 0.0));
        note += &format!(" {name}: {:.2} leaps per ray and brick.", found.leaps / found.ways);
    }
    note += " What could be skipped is counted cell by cell, between eight voxels each: a brute force that no program could \
             afford.";
    Ok(Outcome { curve, gates, note })
}

/// Blocks that count in a cloud.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Counts {
    All,
    /// Blocks that rays of the brick may still reach.
    Ahead,
}

/// Random rays through bricks with this fraction of visible blocks.
fn random_bricks(occupancy: f64, bricks: usize, counts: Counts) -> Findings {
    let of_brick = |brick: usize| {
        let mut random = Random::new((brick as u64) << 16 | whole::<u64>(occupancy * 1e4));
        let core = CORES[brick % CORES.len()];
        let ways = [AxisDirection::Up, AxisDirection::Down, AxisDirection::Both];
        let allowed = [brick, brick / 3, brick / 9].map(|i| ways[i % ways.len()]);
        let ahead = if counts == Counts::Ahead { allowed } else { [AxisDirection::Both; 3] };
        let cells = core.map(|n| n.div_ceil(BLOCK));
        let shown: Vec<bool> = (0..cells.iter().product()).map(|_| random.unit() < occupancy).collect();
        let cloud = ProximityCloud::of_shown(cells, ahead, shown.iter().copied());
        let rays: Vec<LocalRay> = (0..RAYS_PER_BRICK).map(|_| random_ray(&mut random, core, allowed)).collect();
        let place = |cell: [i64; 3]| {
            let [x, y, z] = std::array::from_fn(|a| narrow::<usize>(cell[a].max(0)).min(cells[a] - 1));
            x + cells[0] * (y + cells[1] * z)
        };
        let sets: Vec<InstructionSet> = InstructionSet::available().collect();
        let ways = intervals(sets[brick / 2 % sets.len()], &cloud, core, &rays);
        let of_ray = |(ray, ways): (&LocalRay, &Vec<RayInterval>)| {
            Findings::of_ray(ray, ways, core, BLOCK, |cell| shown[place(cell)])
        };
        rays.iter().zip(&ways).map(of_ray).fold(Findings::default(), Findings::add)
    };
    (0..bricks).into_par_iter().map(of_brick).reduce(Findings::default, Findings::add)
}

/// A ray that begins on a face of the brick or inside it, in an allowed direction. Many positions lie on block faces;
/// every third component is 0 or -0.
fn random_ray(random: &mut Random, core: [usize; 3], allowed: [AxisDirection; 3]) -> LocalRay {
    loop {
        let ends = core.map(|n| [-0.5, n as f64 - 0.5]);
        let mut at: [f64; 3] = std::array::from_fn(|a| ends[a][0] + random.unit() * core[a] as f64);
        let mut direction = random.direction();
        for a in 0..3 {
            match allowed[a] {
                AxisDirection::Up => direction[a] = direction[a].abs(),
                AxisDirection::Down => direction[a] = -direction[a].abs(),
                AxisDirection::Both => {}
            }
            match random.below(6) {
                0 => at[a] = (index(random.below((core[a] / BLOCK) as u64 + 1)) * BLOCK) as f64,
                1 => at[a] = (random.below(core[a] as u64 / 2) * 2) as f64,
                2 => at[a] = ends[a][index(random.below(2))],
                _ => {}
            }
            match random.below(6) {
                0 => direction[a] = 0.0,
                1 => direction[a] = -0.0,
                2 if random.below(4) == 0 => direction[a] *= 1e-7,
                _ => {}
            }
            at[a] = at[a].clamp(ends[a][0], ends[a][1]);
        }
        let ray = LocalRay { origin: at.map(single), direction: direction.map(single), length: 0.0 };
        let way_out = |a: usize| match f64::from(ray.direction[a]) {
            0.0 => f64::INFINITY,
            d => (ends[a][usize::from(d > 0.0)] - f64::from(ray.origin[a])) / d,
        };
        let length = single((0..3).map(way_out).fold(f64::INFINITY, f64::min));
        if length.is_finite() && length > 0.0 {
            return LocalRay { length, ..ray };
        }
    }
}

/// Volumes, each with the findings along the rays of a picture.
fn volumes(context: &Context<'_>) -> Result<Vec<(&'static str, Findings)>, ChartError> {
    let synthetic = |name: &str, edge: u64| Synthetic::new(name, Dims([edge; 3]), Some(VoxelType::U8), 1);
    let carp = context.folder.join("s22-carp.nii.gz");
    std::fs::write(&carp, CARP).map_err(|source| ChartError::Write { path: carp.clone(), source })?;
    let tubes: &[Point] = &[(0.2, BLUE, 0.0), (0.9, GOLD, 0.3)];
    let bones: &[Point] = &[(0.55, BLUE, 0.0), (1.0, GOLD, 0.8)];
    let bright_spots: &[Point] = &[(0.9, BLUE, 0.0), (1.0, GOLD, 0.8)];
    let edge = context.pick(512, 128);
    let sources: [(&str, Box<dyn VolumeSource>, &[Point]); 3] = [
        ("vessels", Box::new(synthetic("vessels", edge)?), tubes),
        ("CT", Box::new(NiftiSource::open(&carp, &SpoolFolder::at(context.folder))?), bones),
        ("survey", Box::new(synthetic("seismic", edge)?), bright_spots),
    ];
    let mut found = Vec::new();
    for (name, source, points) in sources {
        let volume = Volume::build(context, &format!("S22 {name}"), source.as_ref(), &build_options(BRICK))?;
        let size = context.pick(image_size(160, 120), image_size(32, 24));
        let scene = volume.scene(&[&volume.outside(), &size, &fractions(&volume, 1.0, points)])?;
        found.push((name, through_volume(&volume, &scene)?));
    }
    Ok(found)
}

/// Rays of a picture that meet the volume, with start and end as world lengths.
pub(crate) fn rays_of(volume: &Volume, scene: &ResolvedScene) -> Vec<(IndexRay, [f64; 2])> {
    let camera = &scene.camera;
    let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x, y)));
    let of_pixel = |(x, y)| {
        let ray = camera.ray(x, y);
        let index_ray = IndexRay::new(&ray, &volume.facts.geometry);
        let segment = clip_ray(&ray, &index_ray, volume.facts.dims, &scene.clip)?;
        Some((index_ray, [segment.t0, segment.t1]))
    };
    pixels.filter_map(of_pixel).collect()
}

/// All rays of a picture through all bricks of level 0 that are entered.
fn through_volume(volume: &Volume, scene: &ResolvedScene) -> Result<Findings, ChartError> {
    let bricks = ResidentBricks::load(&volume.container)?;
    let (rays, map) = (rays_of(volume, scene), value_map(&volume.container));
    let keys: Vec<BrickKey> = volume.container.pyramid().keys_of(Lod::FINEST).collect();
    let transfer_function = RenderTransferFunction::new(&scene.transfer_function, map.shift);
    let of_brick = |key: &BrickKey| {
        let Resident::Brick(brick) = bricks.lookup(*key) else { return Findings::default() };
        let start = volume.container.pyramid().core_box(*key).start.map(|s| s as f64);
        through_brick(&rays, &brick.read(), start, &map, &transfer_function)
    };
    Ok(keys.par_iter().map(of_brick).reduce(Findings::default, Findings::add))
}

fn through_brick(
    rays: &[(IndexRay, [f64; 2])],
    brick: &DecodedBrick,
    start: [f64; 3],
    map: &ValueMap,
    transfer_function: &RenderTransferFunction,
) -> Findings {
    let core = brick.extent.map(|n| n as usize - 2 * APRON);
    let local: Vec<LocalRay> = rays.iter().filter_map(|(ray, t)| local_ray(ray, *t, start, core)).collect();
    let shows = |[low, high]: [f32; 2]| transfer_function.is_visible(low, high);
    let cloud = cloud_of_blocks(brick, APRON, ahead_of(&local), map, shows);
    let shows_cell = |cell: [i64; 3]| shows(range_of(brick, cell, map));
    let ways = if cloud.is_empty() {
        // Empty bricks are not entered.
        local.iter().map(|ray| vec![RayInterval { t: [0.0, ray.length], is_leap: true }]).collect()
    } else {
        intervals(InstructionSet::best(), &cloud, core, &local)
    };
    let of_ray = |(ray, ways): (&LocalRay, &Vec<RayInterval>)| Findings::of_ray(ray, ways, core, 1, shows_cell);
    local.iter().zip(&ways).map(of_ray).fold(Findings::default(), Findings::add)
}

/// Directions of these rays on each axis.
pub(crate) fn ahead_of(rays: &[LocalRay]) -> [AxisDirection; 3] {
    std::array::from_fn(|a| {
        let goes = |sign: f32| rays.iter().any(|ray| sign * ray.direction[a] > 0.0);
        match [goes(1.0), goes(-1.0)] {
            [_, false] => AxisDirection::Up,
            [false, true] => AxisDirection::Down,
            [true, true] => AxisDirection::Both,
        }
    })
}

/// A ray in a brick's own coordinates; `None` if it misses the brick.
pub(crate) fn local_ray(
    ray: &IndexRay,
    [mut from, mut to]: [f64; 2],
    start: [f64; 3],
    core: [usize; 3],
) -> Option<LocalRay> {
    for a in 0..3 {
        let ends = [start[a] - 0.5, start[a] + core[a] as f64 - 0.5].map(|p| (p - ray.origin[a]) / ray.direction[a]);
        (from, to) = (from.max(ends[0].min(ends[1])), to.min(ends[0].max(ends[1])));
    }
    (from < to).then(|| LocalRay {
        origin: std::array::from_fn(|a| single(ray.origin[a] + from * ray.direction[a] - start[a])),
        direction: ray.direction.map(single),
        length: single(to - from),
    })
}

/// Least and greatest render value of a cell's eight voxels.
fn range_of(brick: &DecodedBrick, cell: [i64; 3], map: &ValueMap) -> [f32; 2] {
    let extent = brick.extent.map(|n| n as usize);
    let mut range = [f32::INFINITY, f32::NEG_INFINITY];
    for corner in 0..8 {
        let at = [0, 1, 2].map(|a| narrow::<usize>(cell[a] + (corner >> a & 1) + narrow::<i64>(APRON)));
        let voxel = at[0] + extent[0] * (at[1] + extent[1] * at[2]);
        let value = match &brick.voxels {
            Voxels::U8(v) => map.from_stored_number(f32::from(v[voxel])),
            Voxels::U16(v) => map.from_stored_number(f32::from(v[voxel])),
            Voxels::F32(v) => v[voxel],
        };
        range = [range[0].min(value), range[1].max(value)];
    }
    range
}
