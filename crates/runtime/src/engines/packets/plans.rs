//! How packets go through the bricks of a view in mode `dvr`: found out once for each brick, and kept from picture to picture
//! while that is still true.
//!
//! What there is to leap over depends on the transfer function and on which way rays go, not on where they come from: a camera
//! that moves finds nearly all of it as it was.

use std::sync::Arc;

use supervol_format::BrickKey;
use supervol_format::brick::APRON;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::value_map::ValueMap;

use super::blocks::cloud_of_blocks;
use super::leap::{Ahead, ProximityCloud};
use super::per_brick::PerBrick;
use super::{CpuFrame, PacketRule};
use crate::engines::blocks::BLOCK;
use crate::engines::packets::cast::PacketTables;
use crate::stream::classify::Skipping;
use crate::stream::residency::DecodedBrick;

/// Most bytes of what is made once of each brick, and plans of another frame that may still be true.
pub type Made = (u64, Option<Arc<BrickPlans>>);

/// Share of a brick's blocks that show nothing from which rays leap.
const LEAST_LEAPT: f64 = 0.125;

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
    ahead: [Ahead; 3],
    /// The direction for which the span was chosen, if it was.
    span_along: Option<[f32; 3]>,
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
struct Premises {
    transfer_function: TransferFunction,
    map: ValueMap,
    rule: PacketRule,
    is_lit: bool,
    skipping: Skipping,
    bytes_limit: u64,
}

/// The plans of bricks, for whatever camera.
#[derive(Debug)]
pub struct BrickPlans {
    premises: Premises,
    of_bricks: PerBrick<BrickPlan>,
}

impl BrickPlans {
    /// Those kept, if they are what this frame needs, else none yet, and never more than so many bytes.
    #[must_use]
    pub fn new(
        kept: Option<Arc<Self>>,
        frame: &CpuFrame,
        (source, rule): (&TransferFunction, PacketRule),
        bytes_limit: u64,
    ) -> Arc<Self> {
        let premises = Premises {
            transfer_function: source.clone(),
            map: frame.map,
            rule: PacketRule { sums_errors: false, counts_work: false, ..rule },
            is_lit: frame.lighting.is_some(),
            skipping: frame.skipping,
            bytes_limit,
        };
        let kept = kept.filter(|kept| kept.premises == premises);
        kept.unwrap_or_else(|| Arc::new(Self { of_bricks: PerBrick::new(bytes_limit), premises }))
    }

    /// How to go through a brick.
    pub fn of(&self, frame: &CpuFrame, tables: &PacketTables, key: BrickKey, brick: &DecodedBrick) -> Arc<BrickPlan> {
        let ahead = tables.ahead(frame, key);
        let is_true = |plan: &BrickPlan| {
            let direction = || tables.direction_through(frame, key);
            plan.ahead == ahead && plan.span_along.is_none_or(|along| along == direction())
        };
        let make = || self.make(frame, tables, (key, ahead), brick);
        self.of_bricks.of_which(frame.field.brick(key), is_true, BrickPlan::bytes, make)
    }

    fn make(
        &self,
        frame: &CpuFrame,
        tables: &PacketTables,
        (key, ahead): (BrickKey, [Ahead; 3]),
        brick: &DecodedBrick,
    ) -> BrickPlan {
        let shows = |[low, high]: [f32; 2]| frame.transfer_function.is_visible(low, high);
        let cloud = cloud_of_blocks(brick, APRON, ahead, &frame.map, shows);
        let leaps = LEAST_LEAPT * cloud.cubes() as f64 <= cloud.hidden as f64;
        let may_span = !leaps && !self.premises.is_lit;
        let span_along = may_span.then(|| tables.direction_through(frame, key));
        let span = span_along.map_or(1, |along| tables.choose_span(frame, (key, brick), along));
        BrickPlan { cloud, leaps: leaps && frame.skipping == Skipping::On, span, ahead, span_along }
    }
}
