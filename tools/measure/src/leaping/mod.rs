//! Cost and benefit of empty-space skipping: `supervol bench --leaping`.
//!
//! Two tables:
//! - *Rebuilding*: processor time to build the proximity clouds of a number of macro cells, as after a change of the
//!   transfer function. The bricks of a scene are repeated until the number is reached.
//! - *Ways*: the rays of a picture through every brick of level 0, by the walker of packets alone, without voxels. It
//!   shows the number of leaps, the share of the way walked cell by cell, and the processor time.
//!
//! The second table also walks ray by ray, over clouds and over an octree. Times can be compared only within one kind
//! of walker.

mod by_rays;

use std::convert::identity;
use std::hint::black_box;

use rayon::prelude::*;
use serde::Serialize;
use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::{BrickKey, Lod};
use supervol_runtime::engines::blocks::BLOCK;
use supervol_runtime::engines::packets::blocks::cloud_of_blocks;
use supervol_runtime::engines::packets::leap::{AxisDirection, ProximityCloud};
use supervol_runtime::engines::packets::simd::InstructionSet;
use supervol_runtime::engines::packets::trace::{LocalRay, RayInterval, intervals};
use supervol_runtime::render::process;
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident};
use supervol_scene::transfer_function::render::RenderTransferFunction;
use supervol_scene::value_map::ValueMap;
use supervol_scene::value_map::value_map;

use crate::context::{ChartError, Context, Scale};
use crate::peers::cases::{Looks, Subject, planned};
use crate::peers::report::markdown_table;
use crate::resident::ResidentBricks;
use crate::scenes::CARP;
use crate::stability::leaping::{ahead_of, local_ray, rays_of};
use by_rays::Octree;

/// Numbers of macro cells whose clouds are built.
const MACRO_CELLS: [usize; 4] = [1 << 18, 1 << 20, 1 << 22, 1 << 24];
/// Scenes of the report.
const REPORTED: [&str; 3] = ["vessels", "carp", "seismic"];
/// Repetitions of each measurement; the least time is kept.
const REPEATS: usize = 3;

/// Options of the measurement.
#[derive(Debug)]
pub struct Options<'a> {
    /// The volumes.
    pub subject: Subject,
    /// Voxels along an edge of synthetic volumes; `None`: the default of each volume.
    pub edge: Option<u64>,
    /// Width and height of the pictures, pixels; one ray per pixel.
    pub image: [u32; 2],
    /// Gzipped NIfTI file of the carp.
    pub carp_nifti_gz: &'a [u8],
}

/// Results of one scene.
#[derive(Debug, Clone, Serialize)]
pub struct Measured {
    /// Name of the scene or of the file.
    pub scene: String,
    /// Number of macro cells, and processor time to build their clouds, milliseconds.
    pub rebuilding: Vec<(usize, f64)>,
    /// Macro cells of level 0, visible ones among them, and processor time of the clouds of their blocks, milliseconds.
    pub blocks: (usize, usize, f64),
    /// Results for the rays, by kind of skipping.
    pub ways: Vec<Ways>,
}

/// Results for the rays with one kind of skipping.
#[derive(Debug, Clone, Serialize)]
pub struct Ways {
    /// Name of the kind.
    pub kind: &'static str,
    /// Number of leaps.
    pub leaps: u64,
    /// Fraction of the ray length inside the volume that is walked cell by cell.
    pub walked: f64,
    /// Processor time, milliseconds.
    pub cpu_ms: f64,
}

/// One brick and the picture's rays that cross it.
struct Met<'a> {
    brick: &'a DecodedBrick,
    core: [usize; 3],
    rays: Vec<LocalRay>,
}

/// Shortest processor time of several runs, milliseconds.
fn cpu_ms<T>(mut work: impl FnMut() -> T) -> f64 {
    let time = |_| {
        let begun = process::cpu_time();
        black_box(work());
        (process::cpu_time() - begun).as_secs_f64() * 1e3
    };
    (0..REPEATS).map(time).fold(f64::INFINITY, f64::min)
}

/// Measures every scene.
///
/// # Errors
/// If a volume cannot be made.
pub fn run(context: &Context<'_>, options: &Options<'_>) -> Result<Vec<Measured>, ChartError> {
    let mut all = Vec::new();
    for planned in planned(context, &options.subject, options.edge)? {
        let built = planned.build(context, Looks::Unshaded, options.carp_nifti_gz)?;
        let Some(case) = built.cases().first().copied() else { continue };
        let (volume, scene) = (&built.volume, case.scene(options.image)?);
        let resident = ResidentBricks::load(&volume.container)?;
        let (map, pyramid) = (value_map(&volume.container), volume.container.pyramid());
        let transfer_function = RenderTransferFunction::new(&scene.transfer_function, map.shift);
        let rays = rays_of(volume, &scene);
        let keys: Vec<BrickKey> = pyramid.keys_of(Lod::FINEST).collect();
        let met = |key: &BrickKey| match resident.lookup(*key) {
            Resident::Brick(brick) => {
                let brick = brick.facts();
                let start = pyramid.core_box(*key).start.map(|s| s as f64);
                let core = brick.extent.map(|n| n as usize - 2 * APRON);
                let rays = rays.iter().filter_map(|(ray, t)| local_ray(ray, *t, start, core)).collect();
                Some(Met { brick, core, rays })
            }
            _ => None,
        };
        let bricks: Vec<Met<'_>> = keys.par_iter().filter_map(met).collect();
        (context.say)(&format!("measuring {}", built.name));
        all.push(Measured {
            scene: built.name.clone(),
            rebuilding: rebuilding(&bricks, &transfer_function),
            blocks: blocks(&bricks, &map, &transfer_function),
            ways: ways(&bricks, &map, &transfer_function),
        });
    }
    Ok(all)
}

/// Measurements for the report: a mostly empty scene, a half empty one and a hardly empty one, on one thread.
///
/// # Errors
/// If a volume cannot be made.
pub fn for_report(context: &Context<'_>) -> Result<Vec<Measured>, ChartError> {
    let (scenes, image, edge) = match context.scale {
        Scale::Full => (&REPORTED[..], [256, 192], 256),
        Scale::Small => (&REPORTED[..1], [24, 18], 48),
    };
    let subject = Subject::Scenes(scenes.iter().map(|name| (*name).into()).collect());
    let options = Options { subject, edge: Some(edge), image, carp_nifti_gz: CARP };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let pool = pool.map_err(|e| ChartError::Command(format!("one thread: {e}")))?;
    pool.install(|| run(context, &options))
}

fn rebuilding(bricks: &[Met<'_>], transfer_function: &RenderTransferFunction) -> Vec<(usize, f64)> {
    let shows = |[low, high]: [f32; 2]| transfer_function.is_visible(low, high);
    let of_count = |count: usize| {
        let each = bricks.iter().map(|met| met.brick.macro_ranges.len()).sum::<usize>().max(1);
        let needed = (count * bricks.len()).div_ceil(each);
        let cloud =
            |i: usize| ProximityCloud::new(bricks[i % bricks.len()].brick, APRON, [AxisDirection::Down; 3], shows);
        let all = || (0..needed).into_par_iter().map(|i| usize::from(cloud(i).is_dense())).sum::<usize>();
        (count, cpu_ms(all))
    };
    MACRO_CELLS.map(of_count).to_vec()
}

fn blocks(bricks: &[Met<'_>], map: &ValueMap, transfer_function: &RenderTransferFunction) -> (usize, usize, f64) {
    let shows = |[low, high]: [f32; 2]| transfer_function.is_visible(low, high);
    let ranges = || bricks.iter().flat_map(|met| &met.brick.macro_ranges);
    let cloud = |met: &Met<'_>| cloud_of_blocks(met.brick, APRON, [AxisDirection::Down; 3], map, shows);
    let all = || bricks.par_iter().map(|met| usize::from(cloud(met).is_dense())).sum::<usize>();
    (ranges().count(), ranges().filter(|range| shows(**range)).count(), cpu_ms(all))
}

fn ways(bricks: &[Met<'_>], map: &ValueMap, transfer_function: &RenderTransferFunction) -> Vec<Ways> {
    let shows = |[low, high]: [f32; 2]| transfer_function.is_visible(low, high);
    let nearest = |met: &Met<'_>, ahead| cloud_of_blocks(met.brick, APRON, ahead, map, shows);
    let of_macro_cells = |met: &Met<'_>| {
        let cells = met.core.map(|n| n.div_ceil(BLOCK));
        let counts = met.core.map(|n| n.div_ceil(MACRO_CELL));
        let of_block = |i: usize| {
            let block =
                [i % cells[0], i / cells[0] % cells[1], i / (cells[0] * cells[1])].map(|b| b * BLOCK / MACRO_CELL);
            shows(met.brick.macro_ranges[block[0] + counts[0] * (block[1] + counts[1] * block[2])])
        };
        ProximityCloud::of_shown(cells, [AxisDirection::Both; 3], (0..cells.iter().product()).map(of_block))
    };
    let one_by_one = |met: &Met<'_>| {
        let mut cloud = of_macro_cells(met);
        cloud.distances.iter_mut().for_each(|distance| *distance = (*distance).min(1));
        cloud
    };
    let none = |met: &Met<'_>| {
        let cells = met.core.map(|n| n.div_ceil(BLOCK));
        ProximityCloud::of_shown(cells, [AxisDirection::Both; 3], (0..cells.iter().product()).map(|_| true))
    };
    let nearest_ahead = |met: &Met<'_>| nearest(met, ahead_of(&met.rays));
    let set = InstructionSet::best();
    let packets = |met: &Met<'_>, cloud: &ProximityCloud<BLOCK>| intervals(set, cloud, met.core, &met.rays);
    let rays = |met: &Met<'_>, cloud: &ProximityCloud<BLOCK>| {
        by_rays::intervals(&met.rays, met.core, |block| by_rays::around(cloud, block))
    };
    let rays_in_octree =
        |met: &Met<'_>, octree: &Octree| by_rays::intervals(&met.rays, met.core, |block| octree.around(block));
    vec![
        ways_by("none", bricks, none, identity, packets),
        ways_by("blocks of macro cells, one by one", bricks, one_by_one, identity, packets),
        ways_by("macro cells, nearest", bricks, of_macro_cells, identity, packets),
        ways_by("blocks, nearest", bricks, |met| nearest(met, [AxisDirection::Both; 3]), identity, packets),
        ways_by("blocks, nearest ahead", bricks, nearest_ahead, identity, packets),
        ways_by("blocks, nearest ahead, ray by ray", bricks, nearest_ahead, identity, rays),
        ways_by("blocks, octree, ray by ray", bricks, nearest_ahead, Octree::new, rays_in_octree),
    ]
}

/// Results for the rays with a structure built from each brick's cloud. Bricks without visible cells are not entered.
fn ways_by<T: Send>(
    kind: &'static str,
    bricks: &[Met<'_>],
    cloud_of: impl Fn(&Met<'_>) -> ProximityCloud<BLOCK> + Send + Sync,
    made_of: impl Fn(ProximityCloud<BLOCK>) -> T + Send + Sync,
    walk: impl Fn(&Met<'_>, &T) -> Vec<Vec<RayInterval>>,
) -> Ways {
    let make = |met| Some(cloud_of(met)).filter(|cloud| !cloud.is_empty()).map(&made_of);
    let made: Vec<Option<T>> = bricks.par_iter().map(make).collect();
    let pairs = || bricks.iter().zip(&made).filter_map(|(met, made)| Some((met, made.as_ref()?)));
    let cpu_ms = cpu_ms(|| pairs().map(|(met, made)| walk(met, made).len()).sum::<usize>());
    let (mut leaps, mut walked) = (0, 0.0);
    for (met, made) in pairs() {
        for interval in walk(met, made).iter().flatten() {
            leaps += u64::from(interval.is_leap);
            walked += if interval.is_leap { 0.0 } else { f64::from(interval.t[1] - interval.t[0]) };
        }
    }
    let whole: f64 = bricks.iter().flat_map(|met| &met.rays).map(|ray| f64::from(ray.length)).sum();
    Ways { kind, leaps, walked: walked / whole, cpu_ms }
}

/// Both tables as Markdown.
#[must_use]
pub fn markdown(all: &[Measured]) -> String {
    let rebuilding: Vec<[String; 3]> = all
        .iter()
        .flat_map(|m| m.rebuilding.iter().map(|(count, ms)| [m.scene.clone(), count.to_string(), format!("{ms:.1}")]))
        .collect();
    let blocks: Vec<[String; 4]> = all
        .iter()
        .map(|m| [m.scene.clone(), m.blocks.0.to_string(), m.blocks.1.to_string(), format!("{:.1}", m.blocks.2)])
        .collect();
    let ways: Vec<[String; 5]> = all
        .iter()
        .flat_map(|m| m.ways.iter().map(move |w| (m, w)))
        .map(|(m, w)| {
            let walked = format!("{:.1} %", 100.0 * w.walked);
            [m.scene.clone(), w.kind.into(), w.leaps.to_string(), walked, format!("{:.1}", w.cpu_ms)]
        })
        .collect();
    [
        markdown_table(&["scene", "macro cells", "clouds, CPU ms"], &rebuilding),
        markdown_table(&["scene", "macro cells", "that show something", "clouds of blocks, CPU ms"], &blocks),
        markdown_table(&["scene", "distance", "leaps", "way walked", "CPU ms"], &ways),
    ]
    .join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn less_is_walked_and_leapt_the_more_is_known() {
        let folder = tempfile::tempdir().expect("a folder can be made");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let options = Options {
            subject: Subject::Scenes(vec!["vessels".into()]),
            edge: Some(96),
            image: [24, 18],
            carp_nifti_gz: &[],
        };
        let all = run(&context, &options).expect("vessels can be measured");
        let [none, one_by_one, macro_cells, blocks, ahead, by_rays, octree] = &all[0].ways[..] else {
            panic!("seven kinds")
        };
        assert!(none.leaps == 0 && one_by_one.leaps > macro_cells.leaps && blocks.leaps > ahead.leaps);
        assert!(none.walked > macro_cells.walked && macro_cells.walked > blocks.walked);
        // Ray by ray, clouds give the same leaps as packets up to rounding. Octree nodes end at other planes.
        assert!(by_rays.leaps.abs_diff(ahead.leaps) <= ahead.leaps / 100, "{} and {}", by_rays.leaps, ahead.leaps);
        assert!((by_rays.walked / ahead.walked - 1.0).abs() < 0.01, "{} and {}", by_rays.walked, ahead.walked);
        assert!(octree.leaps > by_rays.leaps && octree.walked < macro_cells.walked);
        assert!(markdown(&all).contains("nearest ahead"));
    }
}
