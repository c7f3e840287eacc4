//! Plans of packets through the bricks of a view in mode `dvr`: made once for each brick, and kept from picture to
//! picture while valid.
//!
//! The parts to leap over depend on the transfer function and on the directions of rays, not on the eye's position. So
//! most plans stay valid when the camera moves.

use std::sync::Arc;

use supervol_scene::scene::GradientOpacity;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::value_map::ValueMap;

use super::leap::{AxisDirection, ProximityCloud};
use super::per_brick::PerBrick;
use super::rule::PacketRule;
use crate::engines::blocks::BLOCK;
use crate::engines::cells::shown_cells::ShownCells;
use crate::engines::ray_scene::RayScene;
use crate::stream::classify::Skipping;
use crate::stream::field::FieldBrick;

/// Most bytes of data derived from bricks, and plans of another frame that may still be valid.
pub type Made = (u64, Option<Arc<BrickPlans>>);

/// Share of a brick's blocks that show nothing from which rays leap.
pub(super) const LEAST_LEAPT: f64 = 0.125;

/// Plan of packets through a brick.
#[derive(Debug)]
pub struct BrickPlan {
    /// Cloud for leaping.
    pub cloud: ProximityCloud<BLOCK>,
    /// Whether leaping pays.
    pub leaps: bool,
    /// Cells integrated together. More than one only if rays do not leap, because landing positions would decide the
    /// grouping.
    pub span: usize,
    /// Which way rays go.
    pub(super) ahead: [AxisDirection; 3],
    /// The direction for which the span was chosen, if it was.
    pub(super) span_along: Option<[f32; 3]>,
    /// With opacity by the gradient: cells that may show something.
    pub(super) shown: Option<ShownCells>,
}

impl BrickPlan {
    /// Bytes of a plan with a cloud of this many bytes.
    fn bytes_with(cloud: u64) -> u64 {
        (size_of::<Self>() - size_of::<ProximityCloud<BLOCK>>()) as u64 + cloud
    }

    /// Bytes held.
    fn bytes(&self) -> u64 {
        Self::bytes_with(self.cloud.bytes()) + self.shown.as_ref().map_or(0, ShownCells::bytes)
    }

    /// Most bytes held for a brick with `core` core voxels along each axis.
    #[must_use]
    pub fn most_bytes(core: usize) -> u64 {
        Self::bytes_with(ProximityCloud::<BLOCK>::most_bytes(core))
    }
}

/// All inputs of plans but camera and brick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Premises {
    transfer_function: TransferFunction,
    map: ValueMap,
    rule: PacketRule,
    pub(super) is_lit: bool,
    gradient_opacity: Option<GradientOpacity>,
    skipping: Skipping,
    bytes_limit: u64,
}

/// The plans of bricks, for any camera.
#[derive(Debug)]
pub struct BrickPlans {
    pub(super) premises: Premises,
    of_bricks: PerBrick<BrickPlan>,
}

impl BrickPlans {
    /// `kept`, if these plans suit the frame, else an empty store of at most this many bytes.
    #[must_use]
    pub fn new(
        kept: Option<Arc<Self>>,
        scene: &RayScene,
        (source, rule): (&TransferFunction, PacketRule),
        bytes_limit: u64,
    ) -> Arc<Self> {
        let premises = Premises {
            transfer_function: source.clone(),
            map: scene.map,
            rule: PacketRule { sums_errors: false, counts_work: false, ..rule },
            is_lit: scene.lighting.is_some(),
            gradient_opacity: scene.modulation.ramp,
            skipping: scene.skipping,
            bytes_limit,
        };
        let kept = kept.filter(|kept| kept.premises == premises);
        kept.unwrap_or_else(|| Arc::new(Self { of_bricks: PerBrick::new(bytes_limit), premises }))
    }

    /// How to go through a brick: kept where rays go `ahead` as they did, and along the direction for which a span was chosen.
    pub(super) fn of(
        &self,
        brick: FieldBrick,
        (ahead, direction): ([AxisDirection; 3], impl Fn() -> [f32; 3]),
        make: impl FnOnce() -> BrickPlan,
    ) -> Arc<BrickPlan> {
        let is_true =
            |plan: &BrickPlan| plan.ahead == ahead && plan.span_along.is_none_or(|along| along == direction());
        self.of_bricks.of_which(brick, is_true, BrickPlan::bytes, make)
    }
}
