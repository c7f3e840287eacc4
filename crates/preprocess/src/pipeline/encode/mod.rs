//! Step 4, encode: bricks are cut out of a tile and compressed on all threads, and handed over in Morton order.
//!
//! - [`cut`] cuts a stored brick out of the voxels of a tile.
//! - [`ordered`] runs work on many threads and hands the results over in order.

pub mod cut;
pub mod ordered;

use supervol_format::codec::quantize::Quantizer;
use supervol_format::container::seal::seal_brick;
use supervol_format::container::toc::BrickEntry;
use supervol_format::container::writer::EncodedBrick;
use supervol_format::{BrickKey, Lod, ValueRange};
use supervol_sources::stop::check;

use self::cut::cut_brick;
use self::ordered::in_order;
use super::plan::BuildPlan;
use super::plan::tiles::Tile;
use super::reduce::downsample::VoxelBlock;
use super::reduce::error_bound::brick_error;
use crate::error::BuildError;

/// Receiver of encoded bricks.
pub(super) type TakeBrick<'a> = dyn FnMut(EncodedBrick) -> Result<(), BuildError> + 'a;
/// Distance of a coarse brick's voxels from those of the finer level, in stored units.
pub(super) type StepOf<'a> = dyn Fn(BrickKey) -> f64 + Sync + 'a;
/// Entry of a brick that is written already.
pub(super) type EntryOf<'a> = dyn Fn(BrickKey) -> Result<BrickEntry, BuildError> + Sync + 'a;

/// Encoder that uses all threads of a pool.
pub(super) struct Encoder<'a> {
    pub(super) plan: &'a BuildPlan<'a>,
    pub(super) pool: &'a rayon::ThreadPool,
    /// Entries of the finer level: value range and error beneath a brick.
    pub(super) entry_of: &'a EntryOf<'a>,
}

impl Encoder<'_> {
    /// Encodes all bricks of a tile, and hands them over in Morton order while others are encoded. `step` is `None` at
    /// level 0.
    pub(super) fn encode_tile(
        &self,
        lod: Lod,
        tile: Tile,
        block: VoxelBlock<'_>,
        step: Option<&StepOf<'_>>,
        take: &mut TakeBrick<'_>,
    ) -> Result<(), BuildError> {
        let bricks = tile.bricks();
        let encode = |i: usize| self.encode_brick(BrickKey::new(lod, bricks[i]), block, step);
        in_order(self.pool, bricks.len(), &encode, take)
    }

    fn encode_brick(
        &self,
        key: BrickKey,
        block: VoxelBlock<'_>,
        step: Option<&StepOf<'_>>,
    ) -> Result<EncodedBrick, BuildError> {
        let BuildPlan { options, descriptor, .. } = self.plan;
        check(&options.canceller)?;
        let (voxel_type, absence) = (descriptor.voxel_type, descriptor.absence);
        let mut voxels = cut_brick(&descriptor.pyramid, key, voxel_type.bytes(), block);
        let (beneath, children_error) = if step.is_some() { self.beneath(key)? } else { (ValueRange::EMPTY, 0.0) };
        let moved = descriptor.quantizer.filter(|_| step.is_none());
        let snap = |quantizer: Quantizer| quantizer.snap(voxel_type, absence, &mut voxels);
        let moved = moved.map_or(0.0, snap);
        let mut sealed =
            seal_brick(descriptor, key, &voxels, options.codec, beneath, moved).map_err(|e| BuildError::Broken {
                path: self.plan.output.into(),
                rule: format!("encoding of {key}"),
                expected: "a payload".into(),
                found: e.to_string(),
            })?;
        if let Some(step) = step {
            let own = sealed.entry.range;
            sealed.entry.error = brick_error(children_error, step(key), own, beneath, descriptor.voxel_error());
        }
        Ok(sealed)
    }

    /// Value range beneath a brick, and the largest error of its children.
    fn beneath(&self, key: BrickKey) -> Result<(ValueRange, f64), BuildError> {
        let (mut beneath, mut children_error) = (ValueRange::EMPTY, 0.0f64);
        for child in self.plan.descriptor.pyramid.children(key) {
            let child = (self.entry_of)(child)?;
            beneath = beneath.union(child.range_beneath);
            children_error = children_error.max(child.error);
        }
        Ok((beneath, children_error))
    }
}
