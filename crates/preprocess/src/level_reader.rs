//! Boxes of voxels of any level, read back from a container's bricks: how a finer level feeds the next coarser one,
//! how `verify` looks at several bricks at once, and how `extract` reads.
//!
//! Decoded bricks are kept up to a byte budget, least recently used first out, because neighbouring boxes share bricks.

use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, PoisonError};

use rayon::prelude::*;
use supervol_format::brick::APRON;
use supervol_format::container::ContainerError;
use supervol_format::container::header::Descriptor;
use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelBox};

use crate::memory::largest_brick_bytes;

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
    /// Whether bricks of one box are decoded on several threads.
    is_parallel: bool,
    store: &'a dyn BrickStore,
    lod: Lod,
    budget_bytes: usize,
    cache: Mutex<Cache>,
}

/// Bytes that a brick in the cache takes beside its voxels: entries of two maps, allocations.
const ENTRY_BYTES: usize = 200;

/// Bricks by key, and keys by the time of their last use: the oldest is found at once, however many there are.
#[derive(Default)]
struct Cache {
    bricks: HashMap<BrickKey, (u64, Arc<Vec<u8>>)>,
    by_use: BTreeMap<u64, BrickKey>,
    bytes: usize,
    clock: u64,
}

impl Cache {
    fn get(&mut self, key: BrickKey) -> Option<Arc<Vec<u8>>> {
        self.clock += 1;
        let now = self.clock;
        let (used, brick) = self.bricks.get_mut(&key)?;
        self.by_use.remove(used);
        self.by_use.insert(now, key);
        *used = now;
        Some(brick.clone())
    }

    fn put(&mut self, key: BrickKey, brick: Arc<Vec<u8>>, budget_bytes: usize) {
        self.remove(key);
        while self.bytes + brick.len() + ENTRY_BYTES > budget_bytes {
            let Some((_, &oldest)) = self.by_use.first_key_value() else { return };
            self.remove(oldest);
        }
        self.clock += 1;
        self.bytes += brick.len() + ENTRY_BYTES;
        self.by_use.insert(self.clock, key);
        self.bricks.insert(key, (self.clock, brick));
    }

    fn remove(&mut self, key: BrickKey) {
        if let Some((used, brick)) = self.bricks.remove(&key) {
            self.by_use.remove(&used);
            self.bytes -= brick.len() + ENTRY_BYTES;
        }
    }
}

impl<'a> LevelReader<'a> {
    /// A reader of level `lod` that keeps decoded bricks of at most `budget_bytes` between calls.
    #[must_use]
    pub fn new(store: &'a dyn BrickStore, lod: Lod, budget_bytes: usize) -> Self {
        Self { is_parallel: true, store, lod, budget_bytes, cache: Mutex::default() }
    }

    /// The same, decoding one brick after the other on the thread that asks: a thread that waits for others would begin with
    /// whatever else there is to do, and hold the bytes of both.
    #[must_use]
    pub fn on_one_thread(self) -> Self {
        Self { is_parallel: false, ..self }
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
        // A few bricks at a time: what is decoded and not yet copied stays small beside the box.
        let at_once = self.bricks_at_once(largest_brick_bytes(pyramid, descriptor.voxel_type));
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                let row: Vec<u64> = (first[0]..end[0]).collect();
                for part in row.chunks(at_once) {
                    let key = |x: u64| BrickKey::new(self.lod, BrickIndex([x as u32, y as u32, z as u32]));
                    let keys: Vec<BrickKey> = part.iter().map(|&x| key(x)).collect();
                    let bricks: Result<Vec<Arc<Vec<u8>>>, ContainerError> = if self.is_parallel {
                        keys.par_iter().map(|&key| self.brick(key)).collect()
                    } else {
                        keys.iter().map(|&key| self.brick(key)).collect()
                    };
                    let bricks = bricks?;
                    for (key, brick) in keys.iter().zip(&bricks) {
                        self.copy_core(*key, brick, voxels, out);
                    }
                }
            }
        }
        Ok(())
    }

    /// Bytes that reading takes on this many threads beside the caller's buffer and the cache.
    #[must_use]
    pub fn working_bytes(descriptor: &Descriptor, threads: usize) -> u64 {
        let brick = largest_brick_bytes(&descriptor.pyramid, descriptor.voxel_type);
        // Each thread reads a record, decompresses it and takes it apart; what others have decoded waits to be copied.
        4 * threads as u64 * brick
    }

    /// Bricks to decode at once: half of what the cache holds, where they cost nothing, but one for every thread.
    fn bricks_at_once(&self, brick_bytes: u64) -> usize {
        let least = if self.is_parallel { rayon::current_num_threads() } else { return 1 };
        (self.budget_bytes / 2 / (brick_bytes as usize + ENTRY_BYTES)).max(least)
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
