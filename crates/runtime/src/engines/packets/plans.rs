//! Plans of packets through the bricks of a view in mode `dvr`: made once for each brick, and kept from picture to
//! picture while valid.
//!
//! The parts to leap over depend on the transfer function and on the directions of rays, not on the eye's position. So
//! most plans stay valid when the camera moves.

use std::sync::Arc;

use supervol_format::BrickKey;
use supervol_format::brick::APRON;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::value_map::ValueMap;

use super::blocks::cloud_of_blocks;
use super::leap::{Ahead, ProximityCloud};
use super::per_brick::PerBrick;
use super::{CpuFrame, PacketRule, Skipping};
use crate::engines::blocks::BLOCK;
use crate::engines::packets::cast::PacketTables;
use crate::stream::residency::DecodedBrick;

/// Most bytes of data derived from bricks, and plans of another frame that may still be valid.
pub type Made = (u64, Option<Arc<BrickPlans>>);

/// Least share of invisible blocks of a brick for which rays leap.
const LEAST_LEAPT: f64 = 0.125;

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
    /// Directions of rays along each axis.
    ahead: [Ahead; 3],
    /// The direction for which the span was chosen, if it was.
    span_along: Option<[f32; 3]>,
}

impl BrickPlan {
    /// Bytes of a plan with a cloud of this many bytes.
    fn bytes_with(cloud: u64) -> u64 {
        (size_of::<Self>() - size_of::<ProximityCloud<BLOCK>>()) as u64 + cloud
    }

    /// Bytes held.
    fn bytes(&self) -> u64 {
        Self::bytes_with(self.cloud.bytes())
    }

    /// Most bytes held for a brick with `core` core voxels along each axis.
    #[must_use]
    pub fn most_bytes(core: usize) -> u64 {
        Self::bytes_with(ProximityCloud::<BLOCK>::most_bytes(core))
    }
}

/// All inputs of plans but camera and brick.
#[derive(Debug, Clone, PartialEq)]
struct Premises {
    transfer_function: TransferFunction,
    map: ValueMap,
    rule: PacketRule,
    is_lit: bool,
    skipping: Skipping,
    bytes_limit: u64,
}

/// The plans of bricks, for any camera.
#[derive(Debug)]
pub struct BrickPlans {
    premises: Premises,
    of_bricks: PerBrick<BrickPlan>,
}

impl BrickPlans {
    /// `kept`, if these plans suit the frame, else an empty store of at most this many bytes.
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

    /// The plan of a brick.
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
