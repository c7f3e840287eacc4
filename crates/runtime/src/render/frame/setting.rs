//! Setting of a frame: the memory plan, a streamer, and the facts that both ray casters need for their levels.

use std::sync::Arc;

use supervol_format::Container;
use supervol_format::container::toc;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::units::InUnits;
use supervol_scene::value_map::value_map;

use crate::lod::LodRule;
use crate::lod::by_error::{DataScale, LevelsByError};
use crate::render::options::{LevelChoice, RenderOptions};
use crate::stream::budget::{BrickBytes, BudgetError, DeadlineReserve, Demand, EngineBytes, HostPlan};
use crate::stream::classify::Classifier;
use crate::stream::priority::BrickOrder;
use crate::stream::streamer::Streamer;

/// Divides the host budget for a frame on the CPU.
///
/// # Errors
/// If the budget is too small.
pub fn plan_host(
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
) -> Result<HostPlan, BudgetError> {
    let engine = options.ray_caster().bytes(container.pyramid().layout().core());
    plan_host_for(engine, container, scene, options, DeadlineReserve::of(options.time_budget_ms))
}

/// Divides the host budget for a frame with an engine of this memory.
pub(crate) fn plan_host_for(
    engine: EngineBytes,
    container: &Container,
    scene: &ResolvedScene,
    options: &RenderOptions,
    reserve: DeadlineReserve,
) -> Result<HostPlan, BudgetError> {
    let demand = Demand {
        image_size: scene.image_size,
        subgrid: scene.subgrid,
        engine,
        brick: BrickBytes::of(container),
        reserve,
        threads: rayon::current_num_threads() as u64,
        toc_pages: toc::pages_for(container.pyramid().brick_count()),
        // Meshes stay in memory as long as the scene.
        process_bytes: options.process_bytes.saturating_add(scene.clip.bytes()),
    };
    let plan = HostPlan::new(options.host_memory_bytes, &demand)?;
    Ok(HostPlan {
        cache_bytes: options.cache_bytes.map_or(plan.cache_bytes, |most| plan.cache_bytes.min(most)),
        ..plan
    })
}

/// Calls `make` with the container facts that the level rules need.
pub(super) fn with_data_scale<T>(container: &Container, make: impl FnOnce(&DataScale<'_>) -> T) -> T {
    let InUnits { geometry, scale, offset, value_range, .. } = InUnits::of(container);
    let voxel_error = container.descriptor().voxel_error() * scale.abs();
    make(&DataScale { pyramid: container.pyramid(), geometry: &geometry, scale, offset, value_range, voxel_error })
}

/// A streamer with an empty cache for frames of this scene.
#[must_use]
pub fn streamer_for(
    container: &Arc<Container>,
    scene: &ResolvedScene,
    options: &RenderOptions,
    plan: HostPlan,
) -> Streamer {
    let order = BrickOrder::front_to_back(&scene.camera, &InUnits::of(container).geometry);
    let classifier = classifier_for(container, scene, options);
    let mut streamer = Streamer::new(container.clone(), value_map(container), classifier, order, plan);
    streamer.set_form(options.brick_form);
    streamer
}

/// Classifier of bricks for frames of this scene.
#[must_use]
pub fn classifier_for(container: &Container, scene: &ResolvedScene, options: &RenderOptions) -> Classifier {
    let descriptor = container.descriptor();
    let classifier = Classifier::new(scene, descriptor.voxel_type, value_map(container), options.skipping);
    // A requested level is drawn as it is.
    if let LevelChoice::Fixed(_) = options.level {
        return classifier;
    }
    classifier.with_levels(with_data_scale(container, |data| {
        let lod = LodRule::new(options.lod(), &scene.camera, data.geometry);
        LevelsByError::new(scene, data, lod, options.max_error)
    }))
}
