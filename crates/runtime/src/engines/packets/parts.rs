//! Rays in several parts: solids cut them (see [`supervol_scene::clip::clip_parts`]).
//!
//! A tile casts the first part of all its rays, then the second part of those that have two, and so on. Gathered values
//! stay with a ray, so its parts are composited, compared or averaged as one whole. Packets and bricks do not know of
//! parts (docs/decisions/022-solids-and-picking.md). In each part, rays may wait for bricks.

use supervol_format::cast::narrow;
use supervol_scene::clip::{IndexRay, Segment};
use supervol_scene::scene::Mode;

use super::frame::PacketFrame;
use super::places::{TILE_RAYS, TILE_SIDE, place_of};
use super::tile::{Gathered, TileRays};

/// Sets the rays of a tile on their way through the next part; false where some still wait in this one, or none has another.
pub(super) fn begin_next_part(frame: &PacketFrame, corner: [u32; 2], rays: &mut TileRays) -> bool {
    if rays.gathered.waiting.iter().any(Option::is_some) {
        return false;
    }
    // Rays that left the volume are still marked as going.
    rays.take_off();
    rays.gathered.part += 1;
    for ray in (0..TILE_RAYS).filter(|&ray| is_in_picture(frame, corner, ray)) {
        if has_ended(frame, &rays.gathered, ray) {
            continue;
        }
        if let Some((index_ray, segment)) = part_of_ray(frame, corner, rays, ray) {
            // The gap separates the parts: the side before it is not the side behind it.
            rays.gathered.iso[ray].known = 0;
            rays.set(ray, &index_ray, segment);
        }
    }
    rays.going() > 0
}

/// A ray of the tile, and its part with the tile's current number, if it has one.
pub(super) fn part_of_ray(
    frame: &PacketFrame,
    corner: [u32; 2],
    rays: &mut TileRays,
    ray: usize,
) -> Option<(IndexRay, Segment)> {
    let [x, y] = place_of(ray);
    let world_ray = frame.tables.pixel_rays.ray(corner[0] + x, frame.scene.rows.start + corner[1] + y);
    let index_ray = frame.tables.to_index.ray(&world_ray);
    let segment = rays.ahead.part(&frame.scene, (ray, &world_ray, &index_ray), rays.gathered.part)?;
    Some((index_ray, segment))
}

/// Whether a ray of a tile, whose first pixel is counted in the frame's rows, lies in the picture and is asked for.
pub(super) fn is_in_picture(frame: &PacketFrame, corner: [u32; 2], ray: usize) -> bool {
    let (size, [x, y]) = (size_of(frame), place_of(ray));
    let [x, y] = [corner[0] + x, corner[1] + y];
    let is_asked = || frame.asked.as_ref().is_none_or(|asked| asked.has_ray([x, frame.scene.rows.start + y]));
    x < size[0] && y < size[1] && is_asked()
}

/// Rays along both sides of the rows of a frame.
fn size_of(frame: &PacketFrame) -> [u32; 2] {
    [frame.scene.camera.width, narrow::<u32>(frame.scene.rows.len())]
}

/// Whether a ray is opaque already, so that nothing behind is visible.
pub(super) fn has_ended(frame: &PacketFrame, gathered: &Gathered, ray: usize) -> bool {
    match frame.scene.mode {
        Mode::Dvr => gathered.transmittance[ray] <= frame.tables.end_error(),
        _ => frame.scene.is_done(&gathered.state(ray)),
    }
}

/// Rays of a tile that lie in the picture and are asked for.
pub(super) fn rays_in_picture(frame: &PacketFrame, corner: [u32; 2]) -> u64 {
    if frame.asked.is_some() {
        return (0..TILE_RAYS).filter(|&ray| is_in_picture(frame, corner, ray)).count() as u64;
    }
    let size = size_of(frame);
    let [columns, rows] = [0, 1].map(|a| TILE_SIDE.min(size[a].saturating_sub(corner[a])));
    u64::from(columns) * u64::from(rows)
}
