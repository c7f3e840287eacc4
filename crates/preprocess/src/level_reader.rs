//! Boxes of voxels of any level, read back from a container's bricks: how a finer level feeds the next coarser one,
//! how `verify` looks at several bricks at once, and how `extract` reads.
//!
//! Decoded bricks are kept up to a byte budget, least recently used first out, because neighbouring boxes share bricks.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;
use supervol_format::brick::APRON;
use supervol_format::container::ContainerError;
use supervol_format::container::header::Descriptor;
use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelBox};

/// Whatever hands out decoded bricks: a finished container, or one that is being written.
pub trait BrickStore: Sync {
    /// What the container holds.
    fn descriptor(&self) -> &Descriptor;

    /// Stored voxels of a brick, little endian, x fastest.
    ///
    /// # Errors
    /// If the brick cannot be read or decoded.
    fn read_brick(&self, key: BrickKey) -> Result<Vec<u8>, ContainerError>;
}

impl BrickStore for Container {
    fn descriptor(&self) -> &Descriptor {
        Container::descriptor(self)
    }

    fn read_brick(&self, key: BrickKey) -> Result<Vec<u8>, ContainerError> {
        Container::read_brick(self, key, &self.entry(key)?)
    }
}

/// Reads boxes of one level.
pub struct LevelReader<'a> {
    store: &'a dyn BrickStore,
    lod: Lod,
    budget_bytes: usize,
    cache: Mutex<Cache>,
}

#[derive(Default)]
struct Cache {
    bricks: HashMap<BrickKey, (u64, Arc<Vec<u8>>)>,
    bytes: usize,
    clock: u64,
}

impl Cache {
    fn get(&mut self, key: BrickKey) -> Option<Arc<Vec<u8>>> {
        self.clock += 1;
        let now = self.clock;
        let (used, brick) = self.bricks.get_mut(&key)?;
        *used = now;
        Some(brick.clone())
    }

    fn put(&mut self, key: BrickKey, brick: Arc<Vec<u8>>, budget_bytes: usize) {
        while self.bytes + brick.len() > budget_bytes {
            let Some(oldest) = self.bricks.iter().min_by_key(|(_, (used, _))| *used).map(|(&k, _)| k) else { return };
            self.bytes -= self.bricks.remove(&oldest).map_or(0, |(_, b)| b.len());
        }
        self.clock += 1;
        self.bytes += brick.len();
        if let Some((_, replaced)) = self.bricks.insert(key, (self.clock, brick)) {
            self.bytes -= replaced.len();
        }
    }
}

impl<'a> LevelReader<'a> {
    /// A reader of level `lod` that keeps decoded bricks of at most `budget_bytes` between calls.
    #[must_use]
    pub fn new(store: &'a dyn BrickStore, lod: Lod, budget_bytes: usize) -> Self {
        Self { store, lod, budget_bytes, cache: Mutex::default() }
    }

    /// Fills `out` with the voxels of a box of the level, little endian, packed, x fastest.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    ///
    /// # Panics
    /// If the box leaves the level's grid, or `out` has another length than the box.
    pub fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), ContainerError> {
        let descriptor = self.store.descriptor();
        let pyramid = &descriptor.pyramid;
        let dims = pyramid.level_at(self.lod).dims;
        assert!((0..3).all(|a| voxels.end[a] <= dims.0[a]), "box {voxels:?} leaves the grid of {dims}");
        assert_eq!(out.len(), voxels.voxels() * descriptor.voxel_type.bytes(), "box {voxels:?}");
        let core = pyramid.layout().core() as u64;
        let first = voxels.start.map(|v| v / core);
        let end: [u64; 3] =
            std::array::from_fn(
                |a| if voxels.end[a] > voxels.start[a] { voxels.end[a].div_ceil(core) } else { first[a] },
            );
        // One layer of bricks at a time: what is decoded and not yet copied stays small beside the box.
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                let keys: Vec<BrickKey> = (first[0]..end[0])
                    .map(|x| BrickKey::new(self.lod, BrickIndex([x as u32, y as u32, z as u32])))
                    .collect();
                let bricks: Vec<Arc<Vec<u8>>> =
                    keys.par_iter().map(|&key| self.brick(key)).collect::<Result<_, ContainerError>>()?;
                for (key, brick) in keys.iter().zip(&bricks) {
                    self.copy_core(*key, brick, voxels, out);
                }
            }
        }
        Ok(())
    }

    fn brick(&self, key: BrickKey) -> Result<Arc<Vec<u8>>, ContainerError> {
        let lock = || self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(brick) = lock().get(key) {
            return Ok(brick);
        }
        let brick = Arc::new(self.store.read_brick(key)?);
        lock().put(key, brick.clone(), self.budget_bytes);
        Ok(brick)
    }

    /// Copies the part of the brick's core that lies in the box.
    fn copy_core(&self, key: BrickKey, brick: &[u8], voxels: VoxelBox, out: &mut [u8]) {
        let descriptor = self.store.descriptor();
        let size = descriptor.voxel_type.bytes();
        let core = descriptor.pyramid.core_box(key);
        let stored = descriptor.pyramid.stored_extent(key);
        let part = core.intersect(voxels);
        let [nx, ny, nz] = part.extent();
        let extent = voxels.extent();
        let from: [usize; 3] = std::array::from_fn(|a| (part.start[a] - core.start[a]) as usize + APRON);
        let to: [usize; 3] = std::array::from_fn(|a| (part.start[a] - voxels.start[a]) as usize);
        for z in 0..nz {
            for y in 0..ny {
                let source = (((from[2] + z) * stored[1] + from[1] + y) * stored[0] + from[0]) * size;
                let target = (((to[2] + z) * extent[1] + to[1] + y) * extent[0] + to[0]) * size;
                out[target..target + nx * size].copy_from_slice(&brick[source..source + nx * size]);
            }
        }
    }
}
