//! Bricks that are outlined in the picture: failed bricks and, on request, bricks in memory, by level.

use supervol::{BrickKey, PlacedVolume, Renderer};

use super::messages::{Inspect, Mark};

/// Most bricks that are outlined.
pub const MARK_LIMIT: usize = 1000;

/// Bricks to outline: failed ones, and all in memory if `inspect` asks for them.
pub(super) fn marks(renderer: &Renderer, placed: &PlacedVolume, inspect: Inspect) -> Vec<Mark> {
    let (pyramid, dims) = (placed.container().pyramid(), placed.facts().dims.0);
    let mark = |key: BrickKey, is_failed: bool| {
        let (level, voxels) = (pyramid.level_at(key.lod()), pyramid.core_box(key));
        let corner =
            |at: [u64; 3]| -> [f64; 3] { std::array::from_fn(|a| (at[a] * level.scale[a]).min(dims[a]) as f64 - 0.5) };
        Mark { level: key.lod().0, corners: [corner(voxels.start), corner(voxels.end)], is_failed }
    };
    let mut marks: Vec<Mark> = renderer.bricks_failed(MARK_LIMIT).into_iter().map(|key| mark(key, true)).collect();
    if inspect == Inspect::Bricks {
        let there = renderer.bricks_in_memory(MARK_LIMIT - marks.len());
        marks.extend(there.into_iter().map(|key| mark(key, false)));
    }
    marks
}
