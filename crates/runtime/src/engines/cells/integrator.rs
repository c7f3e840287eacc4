//! Interface of the scalar caster for integrators: the operation of a ray in a macro cell that may be visible.
//!
//! An [`Integration`] is chosen before a scene is known. For each frame it makes one [`Integrator`] with the tables it
//! needs, which all rays of the frame share. Only mode `dvr` uses other integrators than
//! [`CellByCell`](super::CellByCell).

use std::fmt::Debug;
use std::sync::Arc;

use supervol_format::Geometry;
use supervol_scene::scene::ResolvedScene;

use super::visit::{BrickVisit, LevelVisit};
use crate::engines::ray::RayState;
use crate::stream::counters::RayCounters;

/// Method of integration along rays.
pub trait Integration: Debug + Send + Sync {
    /// The integrator of a frame, for a volume with this geometry.
    fn integrator(&self, scene: &ResolvedScene, geometry: &Geometry) -> Arc<dyn Integrator>;

    /// Opacity at which a ray ends; above 1, never.
    fn termination_opacity(&self) -> f64;
}

/// Gathers over the parts of bricks that may be visible.
///
/// Protocol, for each ray:
/// 1. Calls come in the order of growing t, each with an interval `t` (world lengths along the ray). It begins at the
///    end of the last one or later: the gap in between is invisible.
/// 2. Each call gathers over its whole interval, unless [`LevelVisit::is_done`] becomes true.
/// 3. Nothing is kept between calls but the ray's state: a ray may continue in another pass, on another thread.
pub trait Integrator: Debug + Send + Sync {
    /// Gathers over `t`, which lies in the macro cell `index` (level's grid of macro cells) of the visited brick.
    fn gather_macro_cell(
        &self,
        visit: &BrickVisit<'_>,
        index: [i64; 3],
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    );

    /// Gathers over `t`, in which every voxel has the render value `value`.
    fn gather_uniform(
        &self,
        visit: &LevelVisit<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    );
}
