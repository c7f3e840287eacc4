//! What the next picture will want, if the camera goes on as it does: read while nobody waits for a picture.
//!
//! A picture of large pixels, seen from where the camera comes to next, with the levels of small ones: its rays find the bricks
//! that are wanted, what hides what included. Only room that is spare is taken: no brick of the last picture leaves the cache.

use std::time::Instant;

use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::drawing::{sketch_pixel, with_pixels};
use super::resident::Resident;
use crate::lod::LodChoice;
use crate::render::error::RenderError;
use crate::render::frame::cpu::CpuCaster;
use crate::render::frame::cpu_frame_of;
use crate::render::frame::walk::{Bands, FrameWalk};
use crate::render::options::{LevelChoice, RenderOptions};
use crate::stop::Stop;
use crate::stream::streamer::StreamError;

/// What looking ahead has brought.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Ahead {
    /// Bricks that came into the cache.
    pub page_ins: u64,
    /// Bytes read for them.
    pub bytes_read: u64,
    /// Whether all that was looked for is there now.
    pub is_complete: bool,
}

/// Brings the bricks of a picture of this scene into the cache, as far as there is time and spare room. Whoever draws next has to
/// aim the streamer again.
///
/// # Errors
/// If threads cannot be started.
pub(super) fn look_ahead(
    resident: &mut Resident,
    next: &ResolvedScene,
    options: &RenderOptions,
    stop: &Stop,
) -> Result<Ahead, RenderError> {
    resident.aim(next, options);
    let pixel = sketch_pixel(next);
    let scene = with_pixels(next, pixel);
    let options = RenderOptions {
        predict_error: false,
        count_work: false,
        progress: None,
        rays_finished: None,
        ..options.clone()
    };
    let lod = match options.level {
        // Seen through the large pixels, voxels are as large as in the picture through its own.
        LevelChoice::Auto => LodChoice::Auto { voxel_pixels: 1.0 / f64::from(next.subgrid * pixel) },
        LevelChoice::Fixed(lod) => LodChoice::Fixed(lod),
    };
    let plan = resident.plan();
    let made = resident.made_for(pixel);
    let mut caster = CpuCaster::new(cpu_frame_of(resident.container(), &scene, &options, lod, made));
    let mut image = Image::unknown(scene.image_size);
    let streamer = resident.streamer();
    let before = streamer.counters();
    streamer.keep_last_frame(true);
    let mut walk = FrameWalk::new(streamer, plan, &options, Instant::now()).until(stop.clone());
    let result = walk.run_over(&mut caster, (&mut image, None), &mut Bands::default());
    let stats = walk.into_stats();
    streamer.keep_last_frame(false);
    let is_complete = match result {
        Ok(_) => stats.converged,
        // What is spare is taken.
        Err(RenderError::Stream(StreamError::NoRoom { .. })) => false,
        Err(error) => return Err(error),
    };
    let cost = streamer.counters().since(&before);
    Ok(Ahead { page_ins: cost.page_ins, bytes_read: cost.bytes_read, is_complete })
}
