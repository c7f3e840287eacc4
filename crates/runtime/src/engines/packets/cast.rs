//! A pass of the packet caster over the tiles of a picture.
//!
//! ```text
//! tile of 16 x 16 rays -> bricks, front to back -> packets of those that meet the brick -> cells -> pixels
//! ```
//!
//! Protocol as in [`super`]: a tile keeps the gathered state of its rays only while some of them wait.

use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;
use supervol_format::cast::narrow;
use supervol_scene::clip::Segment;

use super::begin::MakeRays;
use super::frame::PacketFrame;
use super::levels::errors_of;
use super::noted::{LevelErrors, NO_WORK};
use super::packet::Queues;
use super::parts::{begin_next_part, has_ended, is_in_picture, part_of_ray, rays_in_picture};
use super::pixels::{FinishedTile, Tile, pixels_of_tile, tiles_of};
use super::places::{TILE_RAYS, TILE_SIDE};
use super::simd::{Simd, Task, dispatch};
use super::tables::PacketTables;
use super::tile::TileRays;
use super::visit::CastTile;
use crate::engines::feedback::BlockFeedback;
use crate::stream::residency::BrickView;

/// Most tiles per task. Tiles differ much in cost, and idle threads take over tasks.
const TASK_TILES: usize = 8;

/// Casts every unfinished ray as far as resident bricks allow. The first tile comes some way even when it is time to stop: else passes
/// that begin late would neither cast a ray nor ask for a brick.
pub(super) fn cast_tiles(view: &dyn BrickView, frame: &PacketFrame, tiles: &mut [Tile]) -> Vec<BlockFeedback> {
    let tables = &*frame.tables;
    let columns = tiles_of(&frame.scene)[0] as usize;
    let has_begun = AtomicBool::new(false);
    let pass = tiles.par_iter_mut().enumerate().with_max_len(TASK_TILES).map_init(
        || (Box::new(TileRays::new()), Box::new(Queues::new())),
        |(rays, queues), (index, tile)| {
            let mut feedback = BlockFeedback::default();
            if matches!(tile, Tile::Finished(_)) {
                return feedback;
            }
            if has_begun.swap(true, Ordering::Relaxed) && frame.is_due() {
                feedback.is_stopped = true;
                return feedback;
            }
            let corner = [index % columns, index / columns].map(|i| narrow::<u32>(i) * TILE_SIDE);
            begin_tile(frame, corner, tile, rays, &mut feedback);
            let begun = rays.going();
            if begun > 0 {
                dispatch(tables.set, BoundRays(rays));
                CastTile { view, frame, tables, corner, rays, queues, feedback: &mut feedback }.run();
            }
            while frame.scene.cuts_rays() && begin_next_part(frame, corner, rays) {
                dispatch(tables.set, BoundRays(rays));
                CastTile { view, frame, tables, corner, rays, queues, feedback: &mut feedback }.run();
            }
            *tile = end_tile(frame, corner, rays);
            feedback.counters.rays_waiting += tile.waiting();
            feedback.counters.rays_finished += match (frame.scene.cuts_rays(), &*tile) {
                (false, tile) => begun as u64 - tile.waiting(),
                (true, Tile::Finished(_)) => rays_in_picture(frame, corner),
                (true, Tile::Fresh | Tile::Waiting(_)) => 0,
            };
            frame.count_finished(feedback.counters.rays_finished);
            feedback
        },
    );
    pass.collect()
}

/// Sets the rays of a tile on their way; those without a way are counted as finished.
fn begin_tile(frame: &PacketFrame, corner: [u32; 2], tile: &Tile, rays: &mut TileRays, feedback: &mut BlockFeedback) {
    let tables = &*frame.tables;
    rays.clear(tables.precision.reserve);
    let waiting = match tile {
        Tile::Waiting(gathered) => Some(gathered),
        _ => None,
    };
    if let Some(gathered) = waiting {
        rays.gathered = (**gathered).clone();
        rays.gathered.waiting = [None; TILE_RAYS];
    }
    if frame.deviations.is_some() && rays.gathered.levels.is_none() {
        rays.gathered.levels = Some(Box::new(LevelErrors::NONE));
    }
    if tables.counts_work && rays.gathered.work.is_none() {
        rays.gathered.work = Some(Box::new(NO_WORK));
    }
    let is_asked = |ray: usize| {
        is_in_picture(frame, corner, ray) && waiting.is_none_or(|gathered| gathered.waiting[ray].is_some())
    };
    if frame.scene.cuts_rays() {
        for ray in (0..TILE_RAYS).filter(|&ray| is_asked(ray)) {
            if let Some((index_ray, segment)) = part_of_ray(frame, corner, rays, ray) {
                let t0 = waiting.map_or(segment.t0, |gathered| gathered.t[ray]);
                rays.set(ray, &index_ray, Segment { t0, ..segment });
            }
        }
        return;
    }
    let PacketTables { pixel_rays, to_index, set, .. } = tables;
    let corner = [corner[0], frame.scene.rows.start + corner[1]];
    let dims = frame.scene.finest_dims();
    dispatch(*set, MakeRays { pixel_rays, to_index, clip: &frame.scene.clip, dims, corner, rays });
    if let Some(gathered) = waiting {
        rays.gathered.t = gathered.t;
    }
    feedback.counters.rays_finished += rays.keep(is_asked);
}

/// Computes the bounds of a tile's rays.
struct BoundRays<'a>(&'a mut TileRays);

impl Task for BoundRays<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        self.0.bound();
    }
}

fn end_tile(frame: &PacketFrame, corner: [u32; 2], rays: &TileRays) -> Tile {
    let gathered = &rays.gathered;
    if gathered.waiting.iter().any(Option::is_some) {
        return Tile::Waiting(Box::new(gathered.clone()));
    }
    let terminated_early = (0..TILE_RAYS).filter(|&ray| has_ended(frame, gathered, ray)).count() as u64;
    let mut pixels = pixels_of_tile(&frame.scene, gathered);
    let mut errors = errors_of(frame, gathered, &pixels);
    let work = gathered.work.clone();
    if frame.asked.is_some() {
        for ray in (0..TILE_RAYS).filter(|&ray| !is_in_picture(frame, corner, ray)) {
            pixels[ray] = [f32::NAN; 4];
            if let Some(errors) = &mut errors {
                errors.of_rays[ray] = f32::NAN;
            }
        }
    }
    Tile::Finished(Box::new(FinishedTile { pixels, terminated_early, errors, work }))
}
