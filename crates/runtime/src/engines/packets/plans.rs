//! How packets go through the bricks of a view in mode `dvr`: found out once for each brick, and kept from picture to picture
//! while that is still true.
//!
//! What there is to leap over depends on the transfer function and on which way rays go, not on where they come from: a camera
//! that moves finds nearly all of it as it was.

use std::sync::Arc;

use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::value_map::ValueMap;

use super::leap::{Ahead, ProximityCloud};
use super::per_brick::PerBrick;
use super::rule::PacketRule;
use crate::engines::blocks::BLOCK;
use crate::engines::ray_scene::RayScene;
use crate::stream::classify::Skipping;
use crate::stream::field::FieldBrick;

/// Most bytes of what is made once of each brick, and plans of another frame that may still be true.
pub type Made = (u64, Option<Arc<BrickPlans>>);

/// Share of a brick's blocks that show nothing from which rays leap.
pub(super) const LEAST_LEAPT: f64 = 0.125;

/// How packets go through a brick.
#[derive(Debug)]
pub struct BrickPlan {
    /// What there is to leap over.
    pub cloud: ProximityCloud<BLOCK>,
    /// Whether that pays.
    pub leaps: bool,
    /// Cells that are integrated together: only where rays do not leap, or where they land would decide what goes together.
    pub span: usize,
    /// Which way rays go.
    pub(super) ahead: [Ahead; 3],
    /// The direction for which the span was chosen, if it was.
    pub(super) span_along: Option<[f32; 3]>,
}

impl BrickPlan {
    /// Bytes of a plan whose cloud has so many.
    fn bytes_with(cloud: u64) -> u64 {
        (size_of::<Self>() - size_of::<ProximityCloud<BLOCK>>()) as u64 + cloud
    }

    /// Bytes held.
    fn bytes(&self) -> u64 {
        Self::bytes_with(self.cloud.bytes())
    }

    /// Bytes held of a brick with so many core voxels along each axis, at most.
    #[must_use]
    pub fn most_bytes(core: usize) -> u64 {
        Self::bytes_with(ProximityCloud::<BLOCK>::most_bytes(core))
    }
}

/// Everything that plans depend on but for camera and brick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Premises {
    transfer_function: TransferFunction,
    map: ValueMap,
    rule: PacketRule,
    pub(super) is_lit: bool,
    skipping: Skipping,
    bytes_limit: u64,
}

/// The plans of bricks, for whatever camera.
#[derive(Debug)]
pub struct BrickPlans {
    pub(super) premises: Premises,
    of_bricks: PerBrick<BrickPlan>,
}

impl BrickPlans {
    /// Those kept, if they are what this frame needs, else none yet, and never more than so many bytes.
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
        (ahead, direction): ([Ahead; 3], impl Fn() -> [f32; 3]),
        make: impl FnOnce() -> BrickPlan,
    ) -> Arc<BrickPlan> {
        let is_true =
            |plan: &BrickPlan| plan.ahead == ahead && plan.span_along.is_none_or(|along| along == direction());
        self.of_bricks.of_which(brick, is_true, BrickPlan::bytes, make)
    }
}
