//! What plugs into the scalar caster: what a ray does where a macro cell may show something.
//!
//! [`Integration`] is a choice that is made before a scene is known; for each frame it makes one [`Integrator`], which
//! all rays of the frame share and which holds whatever tables it needs. Only mode `dvr` asks for another integrator than
//! [`CellByCell`](super::CellByCell).

use std::fmt::Debug;
use std::sync::Arc;

use supervol_format::Geometry;
use supervol_scene::scene::ResolvedScene;

use super::visit::{BrickVisit, LevelVisit};
use crate::engines::ray::RayState;
use crate::stream::counters::RayCounters;

/// How frames integrate along rays.
pub trait Integration: Debug + Send + Sync {
    /// What the rays of a frame over a volume with this geometry share.
    fn integrator(&self, scene: &ResolvedScene, geometry: &Geometry) -> Arc<dyn Integrator>;

    /// Opacity at which a ray ends; above 1, never.
    fn termination_opacity(&self) -> f64;
}

/// What rays do with the parts of bricks that may show something.
///
/// Protocol, for each ray:
/// 1. Calls come in the order of growing t, each with an interval `t` (world lengths along the ray) that begins where the
///    last one ended or later: between them lies what cannot show anything.
/// 2. Each call gathers over its whole interval, unless [`LevelVisit::is_done`] becomes true on the way.
/// 3. Nothing is kept between calls but the ray's state: a ray may go on in another pass, on another thread.
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

    /// Gathers over `t`, where every voxel has the render value `value`.
    fn gather_uniform(
        &self,
        visit: &LevelVisit<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    );
}
