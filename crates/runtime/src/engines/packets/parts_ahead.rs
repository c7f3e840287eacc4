//! The next parts of the rays of a tile, of which solids leave several (see [`supervol_scene::clip::clip_parts`]).

use supervol_scene::camera::Ray;
use supervol_scene::clip::{IndexRay, Segment};

use super::places::TILE_RAYS;
use crate::engines::ray_scene::RayScene;

/// Most parts of a ray that are found at once: a mesh is searched anew only behind them.
const AHEAD_LIMIT: usize = 8;

/// The next parts of each ray of a tile, which is in one after the other: solids are cut with once for several of them.
#[derive(Debug, Clone, Default)]
pub(super) struct PartsAhead {
    /// None before a solid is cut with.
    rays: Vec<KnownParts>,
}

/// Parts of a ray that have been found.
#[derive(Debug, Clone, Default)]
struct KnownParts {
    /// Number of the first of them.
    first: usize,
    parts: Vec<Segment>,
    /// Whether there are none behind these.
    is_all: bool,
}

impl PartsAhead {
    /// Most bytes that it holds beside itself.
    pub(super) const MOST_BYTES: usize = TILE_RAYS * (size_of::<KnownParts>() + AHEAD_LIMIT * size_of::<Segment>());

    /// Forgets the rays, not the room for them.
    pub(super) fn clear(&mut self) {
        for known in &mut self.rays {
            known.parts.clear();
            (known.first, known.is_all) = (0, false);
        }
    }

    /// One of the parts of a ray of the tile that solids may cut: the first is number 0.
    pub(super) fn part(
        &mut self,
        scene: &RayScene,
        (ray, world_ray, index_ray): (usize, &Ray, &IndexRay),
        part: usize,
    ) -> Option<Segment> {
        self.rays.resize_with(TILE_RAYS, KnownParts::default);
        let KnownParts { first, parts, is_all } = &mut self.rays[ray];
        if part >= *first + parts.len() && !*is_all {
            let all = scene.parts_of(world_ray, index_ray);
            parts.clear();
            parts.extend(all.iter().skip(part).take(AHEAD_LIMIT));
            (*first, *is_all) = (part, all.len() <= part + AHEAD_LIMIT);
        }
        parts.get(part - *first).copied()
    }
}
