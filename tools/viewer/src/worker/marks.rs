//! Bricks that are outlined in the picture: failed bricks and, on request, bricks in memory, by level.

use supervol_format::{BrickKey, Lod};
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::stream::field::Field;
use supervol_runtime::stream::state::StateKind;

use super::messages::{Inspect, Mark};

/// Most bricks that are outlined, and most bricks of a level that are checked for failures.
pub const MARK_LIMIT: usize = 1000;
const CHECK_LIMIT: usize = 1 << 18;
/// The drawn field; only its bricks are outlined.
const FIELD: Field = Field::FIRST;

/// Bricks to outline: failed ones, and all in memory if `inspect` asks for them.
pub(super) fn marks(renderer: &Renderer, inspect: Inspect) -> Vec<Mark> {
    let Some(streamer) = renderer.streamer() else { return Vec::new() };
    let pyramid = renderer.volume().container().pyramid();
    let mark = |key: BrickKey, is_failed: bool| {
        let (level, voxels) = (pyramid.level_at(key.lod()), pyramid.core_box(key));
        let dims = renderer.volume().facts().dims.0;
        let corner =
            |at: [u64; 3]| -> [f64; 3] { std::array::from_fn(|a| (at[a] * level.scale[a]).min(dims[a]) as f64 - 0.5) };
        Mark { level: key.lod().0, corners: [corner(voxels.start), corner(voxels.end)], is_failed }
    };
    let has_failed = |lod: &Lod| streamer.states().count(*lod, StateKind::Failed) > 0;
    let failed = (0..=pyramid.coarsest().0).map(Lod).filter(has_failed).flat_map(|lod| {
        let keys = pyramid.keys_of(lod).take(CHECK_LIMIT);
        keys.filter(|key| streamer.states().state(FIELD.brick(*key)).kind() == StateKind::Failed)
    });
    let mut marks: Vec<Mark> = failed.map(|key| mark(key, true)).take(MARK_LIMIT).collect();
    if inspect == Inspect::Bricks {
        let keys = streamer.cache().keys().filter(|key| key.field == FIELD);
        let mut there: Vec<BrickKey> = keys.map(|key| key.brick).collect();
        there.sort_unstable();
        marks.extend(there.into_iter().map(|key| mark(key, false)).take(MARK_LIMIT - marks.len()));
    }
    marks
}
