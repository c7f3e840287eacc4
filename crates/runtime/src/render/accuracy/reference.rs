//! One whole level in memory, for the reference integrator.
//!
//! Eight bytes per voxel must fit the host budget. Every brick of the level must be readable: a reference has no
//! fallbacks.

use glam::DVec3;
use supervol_format::level_reader::LevelReader;
use supervol_format::space::HALF_VOXEL;
use supervol_format::{Container, Geometry, Level, Lod, ValueRange};
use supervol_scene::clip::Clip;
use supervol_scene::clip::faces::CutNormals;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::InUnits;

use crate::engines::reference::ReferenceVolume;
use crate::render::error::RenderError;
use crate::stream::budget::BrickBytes;

/// Bytes of one voxel in a reference volume.
const VOXEL_BYTES: u64 = 8;

/// Bytes that the reference picture of a level needs in host memory.
#[must_use]
pub fn reference_bytes(container: &Container, lod: Lod, scene: &ResolvedScene) -> u64 {
    let voxels = container.pyramid().level_at(lod).dims.voxels().unwrap_or(u64::MAX);
    let brick = BrickBytes::of(container);
    voxels
        .saturating_mul(VOXEL_BYTES)
        .saturating_add(2 * scene.rays() * 16 + brick.decoding + brick.record + scene.clip.bytes())
}

/// One level of a container, wholly in memory.
///
/// # Errors
/// If it does not fit into `host_memory_bytes`, or a brick cannot be read.
pub fn load_level(
    container: &Container,
    lod: Lod,
    scene: &ResolvedScene,
    host_memory_bytes: u64,
) -> Result<ReferenceVolume, RenderError> {
    let needed_bytes = reference_bytes(container, lod, scene);
    if needed_bytes > host_memory_bytes {
        return Err(RenderError::ReferenceTooLarge { level: lod.0, needed_bytes, budget_bytes: host_memory_bytes });
    }
    let in_units = InUnits::of(container);
    let reader = LevelReader::new(container, lod, 0);
    let values = reader.values(reader.whole(), |stored| in_units.value(stored))?;
    let mut value_range = ValueRange::EMPTY;
    values.iter().filter(|v| !v.is_nan()).for_each(|&v| value_range.include(v));
    let geometry = level_geometry(&in_units.geometry, container.pyramid().level_at(lod));
    Ok(ReferenceVolume { dims: reader.whole().extent(), geometry, values, value_range })
}

/// Geometry of a level's grid: its voxel 0 lies in the middle of the level-0 voxels that it covers.
fn level_geometry(geometry: &Geometry, level: &Level) -> Geometry {
    let scale = level.scale.map(|s| s as f64);
    let first = DVec3::from_array(scale.map(|s| HALF_VOXEL * s - HALF_VOXEL));
    let origin = geometry.world_from_index().transform_point3(first);
    let spacing = std::array::from_fn(|a| geometry.spacing[a] * scale[a]);
    Geometry { spacing, origin: origin.to_array(), direction: geometry.direction }
}

/// The scene for a level: the clip box in the level's index space, clipped to the domain of level 0.
#[must_use]
pub fn scene_of_level(container: &Container, lod: Lod, scene: &ResolvedScene) -> ResolvedScene {
    let level = container.pyramid().level_at(lod);
    let dims = container.descriptor().dims().0;
    let domain = [[-HALF_VOXEL; 3], dims.map(|n| n as f64 - HALF_VOXEL)];
    let [low, high] = scene.clip.index_box.unwrap_or(domain);
    let kept = [std::array::from_fn(|a| low[a].max(domain[0][a])), std::array::from_fn(|a| high[a].min(domain[1][a]))];
    let index_box = Some(kept.map(|corner| level.from_level_0(corner)));
    let in_level = |clip: &Clip| Clip { index_box, ..clip.clone() };
    let cut_normals = scene.cut_normals.as_ref().map(|cuts| CutNormals { clip: in_level(&cuts.clip), ..cuts.clone() });
    ResolvedScene { clip: in_level(&scene.clip), cut_normals, ..scene.clone() }
}
