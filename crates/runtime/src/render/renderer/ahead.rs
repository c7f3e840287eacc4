//! Prefetch for the next picture: reads its bricks while no picture is wanted, if the camera keeps moving as it does.
//!
//! It casts a picture of large pixels, from the camera's next position, with the levels of small pixels. Its rays find
//! the wanted bricks, occlusion included. Only spare room is used: no brick of the last picture leaves the cache.

use std::time::Instant;

use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use crate::lod::LodChoice;
use crate::render::drawing::loaded::LoadedVolume;
use crate::render::drawing::stage::{sketch_pixel, with_pixels};
use crate::render::error::RenderError;
use crate::render::frame::cpu::CpuCaster;
use crate::render::frame::cpu_frame_of;
use crate::render::frame::walk::{BandProgress, FrameWalk};
use crate::render::options::{LevelChoice, RenderOptions};
use crate::stop::Stop;
use crate::stream::streamer::StreamError;

/// Result of the prefetch.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Ahead {
    /// Bricks that came into the cache.
    pub page_ins: u64,
    /// Bytes read for them.
    pub bytes_read: u64,
    /// Whether all bricks that it looked for are resident.
    pub is_complete: bool,
}

/// Brings the bricks of a picture of this scene into the cache, as far as time and spare room allow. Aim the streamer
/// again before the next picture.
///
/// # Errors
/// If threads cannot be started.
pub(super) fn look_ahead(
    resident: &mut LoadedVolume,
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
        // With this factor, voxels look as large through the large pixels as in the picture through its own pixels.
        LevelChoice::Auto => LodChoice::Auto { voxel_pixels: 1.0 / f64::from(next.subgrid * pixel) },
        LevelChoice::Fixed(lod) => LodChoice::Fixed(lod),
    };
    let plan = resident.plan();
    let made = resident.made_for(pixel);
    let mut caster = CpuCaster::new(cpu_frame_of(resident.container(), &scene, &options, lod, made));
    let mut image = Image::unknown(scene.image_size);
    let streamer = resident.streamer();
    let before = streamer.counters();
    streamer.keep_last_frame();
    let mut walk = FrameWalk::new(streamer, plan, &options, Instant::now()).until(stop.clone());
    let result = walk.run_over(&mut caster, (&mut image, None), &mut BandProgress::default());
    let stats = walk.into_stats();
    streamer.release_last_frame();
    let is_complete = match result {
        Ok(_) => stats.converged,
        // All spare room is used.
        Err(RenderError::Stream(StreamError::NoRoom { .. })) => false,
        Err(error) => return Err(error),
    };
    let cost = streamer.counters().since(&before);
    Ok(Ahead { page_ins: cost.page_ins, bytes_read: cost.bytes_read, is_complete })
}
