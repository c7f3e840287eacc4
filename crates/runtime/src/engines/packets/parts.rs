//! Rays in several parts: solids cut them (see [`supervol_scene::clip::clip_parts`]).
//!
//! A tile casts the first part of all its rays, then the second part of those that have two, and so on. Gathered values
//! stay with a ray, so its parts are composited, compared or averaged as one whole. Packets and bricks do not know of
//! parts (docs/decisions/022-solids-and-picking.md). In each part, rays may wait for bricks.

use supervol_scene::camera::Ray;
use supervol_scene::clip::{IndexRay, Segment};
use supervol_scene::scene::Mode;

use super::CpuFrame;
use super::tile::{Gathered, TILE_RAYS, TILE_SIDE, TileRays, place_of};
use crate::engines::packets::cast::PacketTables;

/// Most parts of a ray that are found at once: a mesh is searched again only behind them.
const AHEAD_LIMIT: usize = 8;

/// The next parts of each ray of a tile. All rays are in the same part number. Solids are intersected once for several
/// parts.
#[derive(Debug, Clone, Default)]
pub(super) struct PartsAhead {
    /// Empty until a solid is intersected.
    rays: Vec<KnownParts>,
}

/// Known parts of a ray.
#[derive(Debug, Clone, Default)]
struct KnownParts {
    /// Number of the first of them.
    first: usize,
    parts: Vec<Segment>,
    /// Whether there are no parts behind these.
    is_all: bool,
}

impl PartsAhead {
    /// Most bytes that it holds on the heap.
    pub(super) const MOST_BYTES: usize = TILE_RAYS * (size_of::<KnownParts>() + AHEAD_LIMIT * size_of::<Segment>());

    /// Forgets the rays, and keeps the memory.
    pub(super) fn clear(&mut self) {
        for known in &mut self.rays {
            known.parts.clear();
            (known.first, known.is_all) = (0, false);
        }
    }

    /// A part of a ray of the tile that solids may cut; the first is number 0.
    pub(super) fn part(
        &mut self,
        frame: &CpuFrame,
        (ray, world_ray, index_ray): (usize, &Ray, &IndexRay),
        part: usize,
    ) -> Option<Segment> {
        self.rays.resize_with(TILE_RAYS, KnownParts::default);
        let KnownParts { first, parts, is_all } = &mut self.rays[ray];
        if part >= *first + parts.len() && !*is_all {
            let all = frame.parts_of(world_ray, index_ray);
            parts.clear();
            parts.extend(all.iter().skip(part).take(AHEAD_LIMIT));
            (*first, *is_all) = (part, all.len() <= part + AHEAD_LIMIT);
        }
        parts.get(part - *first).copied()
    }
}

/// Starts the rays of a tile on their next part. Returns false if some still wait in this part, or none has another.
pub(super) fn begin_next_part(
    (frame, tables): (&CpuFrame, &PacketTables),
    corner: [u32; 2],
    rays: &mut TileRays,
) -> bool {
    if rays.gathered.waiting.iter().any(Option::is_some) {
        return false;
    }
    // Rays that left the volume are still marked as going.
    rays.take_off();
    rays.gathered.part += 1;
    for ray in (0..TILE_RAYS).filter(|&ray| is_in_picture(frame, corner, ray)) {
        if has_ended((frame, tables), &rays.gathered, ray) {
            continue;
        }
        if let Some((index_ray, segment)) = part_of_ray((frame, tables), corner, rays, ray) {
            // The side in front of a gap is not the side behind it.
            rays.gathered.iso[ray].known = 0;
            rays.set(ray, &index_ray, segment);
        }
    }
    rays.going() > 0
}

/// A ray of the tile, and its part with the tile's current number, if it has one.
pub(super) fn part_of_ray(
    (frame, tables): (&CpuFrame, &PacketTables),
    corner: [u32; 2],
    rays: &mut TileRays,
    ray: usize,
) -> Option<(IndexRay, Segment)> {
    let [x, y] = place_of(ray);
    let world_ray = tables.pixel_rays.ray(corner[0] + x, frame.rows.start + corner[1] + y);
    let index_ray = tables.to_index.ray(&world_ray);
    let segment = rays.ahead.part(frame, (ray, &world_ray, &index_ray), rays.gathered.part)?;
    Some((index_ray, segment))
}

/// Whether a ray of a tile lies in the picture; `corner` is the tile's first pixel in the frame's rows.
pub(super) fn is_in_picture(frame: &CpuFrame, corner: [u32; 2], ray: usize) -> bool {
    let size = [frame.camera.width, frame.rows.len() as u32];
    (0..2).all(|a| corner[a] + place_of(ray)[a] < size[a])
}

/// Whether nothing behind a ray's gathered values is visible.
pub(super) fn has_ended((frame, tables): (&CpuFrame, &PacketTables), gathered: &Gathered, ray: usize) -> bool {
    match frame.mode {
        Mode::Dvr => gathered.transmittance[ray] <= tables.end_error(),
        _ => frame.is_done(&gathered.state(ray)),
    }
}

/// Number of rays of a tile that lie in the picture.
pub(super) fn rays_in_picture(frame: &CpuFrame, corner: [u32; 2]) -> u64 {
    let size = [frame.camera.width, frame.rows.len() as u32];
    let [columns, rows] = [0, 1].map(|a| TILE_SIDE.min(size[a].saturating_sub(corner[a])));
    u64::from(columns) * u64::from(rows)
}
