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
use supervol_format::{BrickKey, Lod};
use supervol_sources::stop::check;

use self::cut::cut_brick;
use self::ordered::in_order;
use super::plan::BuildPlan;
use super::plan::tiles::Tile;
use super::reduce::downsample::VoxelBlock;
use super::reduce::error_bound::{Beneath, StepErrors};
use crate::error::BuildError;

/// Receiver of encoded bricks.
pub(super) type TakeBrick<'a> = dyn FnMut(EncodedBrick) -> Result<(), BuildError> + 'a;
/// Distances of a coarse brick's voxels from those of the finer level, in stored units.
pub(super) type StepOf<'a> = dyn Fn(BrickKey) -> StepErrors + Sync + 'a;
/// Entry of a brick that is written already.
pub(super) type EntryOf<'a> = dyn Fn(BrickKey) -> Result<BrickEntry, BuildError> + Sync + 'a;
/// Error bounds of the macro cells of a brick that is written already, in stored units.
pub(super) type CellErrorsOf<'a> = dyn Fn(BrickKey, &BrickEntry) -> Result<Vec<f64>, BuildError> + Sync + 'a;

/// Encoder that uses all threads of a pool.
pub(super) struct Encoder<'a> {
    pub(super) plan: &'a BuildPlan<'a>,
    pub(super) pool: &'a rayon::ThreadPool,
    /// Entries of the finer level: value range and error beneath a brick.
    pub(super) entry_of: &'a EntryOf<'a>,
    pub(super) cell_errors_of: &'a CellErrorsOf<'a>,
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
        let beneath = if step.is_some() { self.beneath(key)? } else { Beneath::default() };
        let moved = descriptor.quantizer.filter(|_| step.is_none());
        let snap = |quantizer: Quantizer| quantizer.snap(voxel_type, absence, &mut voxels);
        let moved = moved.map_or(0.0, snap);
        let mut sealed = seal_brick(descriptor, key, &voxels, options.codec, beneath.range, moved).map_err(|e| {
            BuildError::Broken {
                path: self.plan.output.into(),
                rule: format!("encoding of {key}"),
                expected: "a payload".into(),
                found: e.to_string(),
            }
        })?;
        if let Some(step) = step {
            let (error, of_cells) = beneath.errors(&step(key), sealed.entry.range, descriptor.voxel_error());
            sealed.set_errors(error, &of_cells);
        }
        Ok(sealed)
    }

    /// Value range and error bounds beneath a brick.
    fn beneath(&self, key: BrickKey) -> Result<Beneath, BuildError> {
        let pyramid = &self.plan.descriptor.pyramid;
        let mut beneath = Beneath::new(pyramid, key);
        for child in pyramid.children(key) {
            let entry = (self.entry_of)(child)?;
            beneath.add(pyramid, [key, child], &entry, &(self.cell_errors_of)(child, &entry)?);
        }
        Ok(beneath)
    }
}
