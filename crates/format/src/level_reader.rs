//! Reader for boxes of voxels of one level, assembled from decoded bricks. The build pipeline makes each coarser level
//! from it. `verify`, `extract`, `mesh` and the reference integrator read their voxels through it.
//!
//! A reader caches decoded bricks up to a number of bytes and drops the least recently used first, because neighbouring
//! boxes share bricks. It decodes bricks one after the other on the calling thread, unless its owner provides threads
//! ([`Decoding`]).

use std::sync::{Arc, Mutex, PoisonError};

use crate::brick::APRON;
use crate::container::ContainerError;
use crate::container::header::Descriptor;
use crate::pyramid::axis_number;
use crate::recent::Recent;
use crate::voxel_type::Voxel;
use crate::{BrickIndex, BrickKey, Container, Lod, VoxelBox, cast, with_voxel};

/// Source of decoded bricks: a finished container, or one that is being written.
pub trait BrickStore: Sync {
    /// Description of the container.
    fn descriptor(&self) -> &Descriptor;

    /// Stored voxels of a brick, little endian, x fastest. Reuses the memory of `spare`, whose contents are lost.
    ///
    /// # Errors
    /// If the brick cannot be read or decoded.
    fn read_brick(&self, key: BrickKey, spare: Vec<u8>) -> Result<Vec<u8>, ContainerError>;
}

impl BrickStore for Container {
    fn descriptor(&self) -> &Descriptor {
        Container::descriptor(self)
    }

    fn read_brick(&self, key: BrickKey, spare: Vec<u8>) -> Result<Vec<u8>, ContainerError> {
        self.read_brick_into(key, &self.entry(key)?, spare)
    }
}

/// Stored voxels of a brick, little endian, x fastest.
pub type StoredBrick = Arc<Vec<u8>>;

/// Function that decodes a brick; any thread may call it.
pub type DecodeBrick<'a> = dyn Fn(BrickKey) -> Result<StoredBrick, ContainerError> + Sync + 'a;

/// Functions that decode the bricks of a box in parallel.
#[derive(Debug, Clone, Copy)]
pub struct Decoding {
    /// Smallest number of bricks per call of `decode`: the number of threads, asked again for each box.
    pub at_once: fn() -> usize,
    /// Decodes bricks with the given function and returns them in the order of the keys.
    pub decode: fn(&[BrickKey], &DecodeBrick<'_>) -> Result<Vec<StoredBrick>, ContainerError>,
}

/// Reads boxes of one level.
pub struct LevelReader<'a> {
    store: &'a dyn BrickStore,
    lod: Lod,
    budget_bytes: usize,
    decoding: Option<Decoding>,
    kept: Mutex<Kept>,
}

/// Memory of a cached brick besides its voxels, in bytes: entries of two maps, allocations.
const ENTRY_BYTES: usize = 200;

/// Largest number of buffers kept for reuse.
const SPARES: usize = 2;

#[derive(Default)]
struct Kept {
    bricks: Recent<BrickKey, StoredBrick>,
    bytes: usize,
    /// Buffers of evicted bricks, reused for the next ones. Without reuse the buffers would move between the threads'
    /// allocators and fragment memory: measured, a third more than the cached bytes.
    spares: Vec<Vec<u8>>,
}

impl Kept {
    fn spare_bytes(&self) -> usize {
        self.spares.iter().map(Vec::capacity).sum()
    }

    fn put(&mut self, key: BrickKey, brick: StoredBrick, budget_bytes: usize) {
        let bytes = brick.len() + ENTRY_BYTES;
        while self.bytes + self.spare_bytes() + bytes > budget_bytes {
            let Some((_, oldest)) = self.bricks.remove_oldest() else { return };
            self.bytes -= oldest.len() + ENTRY_BYTES;
            if self.spares.len() < SPARES {
                self.spares.extend(Arc::into_inner(oldest));
            }
        }
        self.bytes += bytes;
        if let Some(before) = self.bricks.insert(key, brick) {
            self.bytes -= before.len() + ENTRY_BYTES;
        }
    }
}

impl std::fmt::Debug for LevelReader<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut fields = f.debug_struct("LevelReader");
        fields.field("lod", &self.lod).field("budget_bytes", &self.budget_bytes).field("decoding", &self.decoding);
        fields.finish_non_exhaustive()
    }
}

impl<'a> LevelReader<'a> {
    /// Reader of level `lod`. It caches decoded bricks of at most `budget_bytes` between calls and decodes on the
    /// calling thread.
    #[must_use]
    pub fn new(store: &'a dyn BrickStore, lod: Lod, budget_bytes: usize) -> Self {
        Self { store, lod, budget_bytes, decoding: None, kept: Mutex::default() }
    }

    /// The same reader, but decoding several bricks in parallel.
    #[must_use]
    pub fn decoding(self, decoding: Decoding) -> Self {
        Self { decoding: Some(decoding), ..self }
    }

    /// Box of all voxels of the level.
    #[must_use]
    pub fn whole(&self) -> VoxelBox {
        self.store.descriptor().pyramid.level_at(self.lod).dims.full_box()
    }

    /// Fills `out` with the voxels of a box of the level, little endian, without gaps, x fastest.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    ///
    /// # Panics
    /// If the box leaves the level's grid, or the length of `out` is not that of the box.
    pub fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), ContainerError> {
        let size = self.store.descriptor().voxel_type.bytes();
        assert_eq!(out.len(), voxels.voxels() * size, "box {voxels:?}");
        self.for_each_run(voxels, |at, run| out[at * size..][..run.len()].copy_from_slice(run))
    }

    /// Values of a box of the level, x fastest. `value` converts a stored value; absent voxels are NaN.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    ///
    /// # Panics
    /// If the box leaves the level's grid.
    pub fn values(&self, voxels: VoxelBox, value: impl Fn(f64) -> f64) -> Result<Vec<f64>, ContainerError> {
        let descriptor = self.store.descriptor();
        let (voxel_type, absence) = (descriptor.voxel_type, descriptor.absence);
        let mut values = vec![f64::NAN; voxels.voxels()];
        self.for_each_run(voxels, |at, run| {
            with_voxel!(voxel_type, V => {
                for (here, voxel) in values[at..].iter_mut().zip(run.chunks_exact(size_of::<V>())) {
                    let stored = V::read_le(voxel).to_f64();
                    *here = if absence.is_absent(stored) { f64::NAN } else { value(stored) };
                }
            });
        })?;
        Ok(values)
    }

    /// Passes the voxels of a box of the level to `take` in runs along x, brick by brick. `take` receives the number of
    /// the run's first voxel in the box (x fastest) and the run's bytes (little endian). Each voxel is in exactly one
    /// run.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    ///
    /// # Panics
    /// If the box leaves the level's grid.
    pub fn for_each_run(&self, voxels: VoxelBox, mut take: impl FnMut(usize, &[u8])) -> Result<(), ContainerError> {
        let descriptor = self.store.descriptor();
        let pyramid = &descriptor.pyramid;
        let dims = pyramid.level_at(self.lod).dims;
        assert!((0..3).all(|a| voxels.end[a] <= dims.0[a]), "box {voxels:?} leaves the grid of {dims}");
        let core = pyramid.layout().core() as u64;
        let first = voxels.start.map(|v| v / core);
        let end: [u64; 3] =
            std::array::from_fn(
                |a| if voxels.end[a] > voxels.start[a] { voxels.end[a].div_ceil(core) } else { first[a] },
            );
        // Part by part, so that the decoded bricks in flight stay small compared with the box.
        let at_once = self.bricks_at_once(pyramid.largest_brick_bytes(descriptor.voxel_type));
        for z in first[2]..end[2] {
            for y in first[1]..end[1] {
                let row: Vec<u64> = (first[0]..end[0]).collect();
                for part in row.chunks(at_once) {
                    let key = |x: u64| BrickKey::new(self.lod, BrickIndex([x, y, z].map(axis_number)));
                    let keys: Vec<BrickKey> = part.iter().map(|&x| key(x)).collect();
                    for (key, brick) in keys.iter().zip(&self.bricks(&keys)?) {
                        self.runs_of((*key, brick), pyramid.core_box(*key).intersect(voxels), voxels, &mut take);
                    }
                }
            }
        }
        Ok(())
    }

    /// Bytes that reading needs on this many threads, besides the caller's buffer and the cache.
    #[must_use]
    pub fn working_bytes(descriptor: &Descriptor, threads: usize) -> u64 {
        // Each thread holds a record and the buffers of its decoder; decoded bricks wait for the caller.
        4 * threads as u64 * descriptor.pyramid.largest_brick_bytes(descriptor.voxel_type)
    }

    /// Number of bricks to decode in one call: as many as fit into half of the cache, but at least one per thread.
    fn bricks_at_once(&self, brick_bytes: u64) -> usize {
        let Some(decoding) = self.decoding else { return 1 };
        (self.budget_bytes / 2 / (cast::index(brick_bytes) + ENTRY_BYTES)).max((decoding.at_once)())
    }

    fn bricks(&self, keys: &[BrickKey]) -> Result<Vec<StoredBrick>, ContainerError> {
        match self.decoding {
            Some(decoding) => (decoding.decode)(keys, &|key| self.brick(key)),
            None => keys.iter().map(|&key| self.brick(key)).collect(),
        }
    }

    /// Fills `out` as [`Self::read_box`] does, but only from these bricks and their aprons. Fewer bricks are decoded than for
    /// a box whose rim lies in neighbours. Where several bricks hold a voxel, the last one's is taken.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    ///
    /// # Panics
    /// If the length of `out` is not that of the box.
    pub fn read_box_of(&self, keys: &[BrickKey], voxels: VoxelBox, out: &mut [u8]) -> Result<(), ContainerError> {
        let Descriptor { voxel_type, pyramid, .. } = self.store.descriptor();
        let (size, dims) = (voxel_type.bytes(), pyramid.level_at(self.lod).dims);
        assert_eq!(out.len(), voxels.voxels() * size, "box {voxels:?}");
        for &key in keys {
            let held = pyramid.core_box(key).grown(APRON as u64, dims).intersect(voxels);
            let mut copy = |at: usize, run: &[u8]| out[at * size..][..run.len()].copy_from_slice(run);
            self.runs_of((key, &self.brick(key)?), held, voxels, &mut copy);
        }
        Ok(())
    }

    /// A decoded brick of this level, with its apron.
    ///
    /// # Errors
    /// If it cannot be read or decoded.
    pub fn brick(&self, key: BrickKey) -> Result<StoredBrick, ContainerError> {
        let lock = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let spare = {
            let mut kept = lock();
            if let Some(brick) = kept.bricks.get(&key) {
                return Ok(brick.clone());
            }
            kept.spares.pop().unwrap_or_default()
        };
        let brick = Arc::new(self.store.read_brick(key, spare)?);
        lock().put(key, brick.clone(), self.budget_bytes);
        Ok(brick)
    }

    /// Passes a part of the box that the brick holds to `take`.
    fn runs_of(
        &self,
        (key, brick): (BrickKey, &[u8]),
        part: VoxelBox,
        voxels: VoxelBox,
        take: &mut impl FnMut(usize, &[u8]),
    ) {
        let Descriptor { voxel_type, pyramid, .. } = self.store.descriptor();
        let size = voxel_type.bytes();
        let (core, stored) = (pyramid.core_box(key), pyramid.stored_extent(key));
        let [nx, ny, nz] = part.extent();
        let extent = voxels.extent();
        let from: [usize; 3] = std::array::from_fn(|a| cast::index(part.start[a] + APRON as u64 - core.start[a]));
        let to: [usize; 3] = std::array::from_fn(|a| cast::index(part.start[a] - voxels.start[a]));
        for z in 0..nz {
            for y in 0..ny {
                let source = (((from[2] + z) * stored[1] + from[1] + y) * stored[0] + from[0]) * size;
                let target = ((to[2] + z) * extent[1] + to[1] + y) * extent[0] + to[0];
                take(target, &brick[source..source + nx * size]);
            }
        }
    }
}
