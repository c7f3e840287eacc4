//! Step 2, read: one tile is read while the previous one is encoded.
//!
//! - `SourceTiles` reads tiles of level 0 from the source, and computes the source's checksum on the way.
//! - [`slabs`] reads a box of the source by several threads.
//!
//! Tiles of coarser levels come from finer bricks (`levels`).

pub mod slabs;

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use supervol_format::Lod;
use supervol_format::container::manifest::Source;
use supervol_sources::VolumeSource;

use super::plan::memory::Spares;
use super::plan::tiles::Tile;
use super::plan::{BuildPlan, ReadSource};
use crate::error::BuildError;
use crate::provenance::{ChecksumAlong, check_unchanged};

/// Tiles of level 0, read from the source. If the source has no checksum yet, it is computed along with the reading.
pub(super) struct SourceTiles<'a> {
    plan: &'a BuildPlan<'a>,
    source: &'a dyn VolumeSource,
    read: ReadSource<'a>,
    checksum: Mutex<Option<ChecksumAlong>>,
    /// Number of tiles that are still to be read.
    tiles_left: AtomicUsize,
}

impl<'a> SourceTiles<'a> {
    /// Tiles of a source, of which `tiles_left` are still to be read. `read` reads a box of it.
    pub(super) fn new(
        plan: &'a BuildPlan<'a>,
        source: &'a dyn VolumeSource,
        read: ReadSource<'a>,
        checksum: Option<ChecksumAlong>,
        tiles_left: usize,
    ) -> Self {
        Self { plan, source, read, checksum: Mutex::new(checksum), tiles_left: AtomicUsize::new(tiles_left) }
    }

    /// Reads the voxels of a tile, with its apron, into one of the `spares`.
    pub(super) fn read(&self, tile: &Tile, spares: &Spares) -> Result<Vec<u8>, BuildError> {
        let voxels = self.plan.tile_box(Lod::FINEST, tile);
        let mut bytes = spares.take(voxels.voxels() * self.plan.descriptor.voxel_type.bytes());
        (self.read)(voxels, &mut bytes)?;
        let tiles_left = self.tiles_left.fetch_sub(1, Ordering::Relaxed);
        let mut checksum = self.checksum.lock().unwrap_or_else(PoisonError::into_inner);
        checksum.as_mut().map_or(Ok(()), |checksum| checksum.advance(tiles_left, &self.plan.options.canceller))?;
        Ok(bytes)
    }

    /// Completes the checksum once all tiles are read, and checks that the source has not changed.
    pub(super) fn finish(self, origin: &mut Source) -> Result<(), BuildError> {
        let canceller = &self.plan.options.canceller;
        match self.checksum.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(checksum) => origin.xxh3_64 = checksum.finish(canceller)?,
            None => check_unchanged(self.source, origin, canceller)?,
        }
        Ok(())
    }
}

/// Reads tiles on a thread of its own and calls `each` for one after the other. The reader is one tile ahead.
pub(super) fn one_ahead(
    tiles: &[Tile],
    read: &(dyn Fn(&Tile) -> Result<Vec<u8>, BuildError> + Sync),
    each: &mut dyn FnMut(Tile, Vec<u8>) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    std::thread::scope(|scope| {
        // Capacity zero: the reader holds one tile while another is encoded, so no more than two are in memory.
        let (send, receive) = crossbeam_channel::bounded(0);
        let reader = std::thread::Builder::new().spawn_scoped(scope, move || {
            for tile in tiles {
                let result = read(tile);
                let failed = result.is_err();
                // The receiver is gone only if encoding or writing failed. Reading then has no purpose.
                if send.send((*tile, result)).is_err() || failed {
                    return;
                }
            }
        });
        reader.map_err(BuildError::Thread)?;
        for (tile, bytes) in receive {
            each(tile, bytes?)?;
        }
        Ok(())
    })
}
