//! A grid in chunks that are decoded as a whole (Zarr, N5), read box by box in bounded memory.
//!
//! A chunk has the axes of the array in C order. Up to three of them are x, y and z; on the others one position is
//! fixed. Decoded chunks are cached, least recently used dropped first, because neighbouring boxes share them. At most
//! [`ChunkMemory::readers`] threads decode at a time, each with a chunk outside the cache. Threads that want the same
//! chunk wait for the one that decodes it.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use supervol_format::recent::Recent;
use supervol_format::{Dims, VoxelBox};

use super::absent::{AbsentColumns, AbsentNumbers};
use super::elements::{Elements, NumberGrid};
use super::mirrored::Mirrored;
use crate::cast::index;
use crate::grid::dense::swap_bytes;
use crate::grid::layout::GridLayout;
use crate::{AccessOrder, Endian, SourceError, SourceInfo, VolumeSource};

/// Largest number of axes of an array.
pub(crate) const AXES_LIMIT: usize = 16;
/// Copies of a chunk that a reader may hold at once: encoded, between two stages, decoded.
const COPIES: u64 = 3;
/// Largest number of cached chunks.
const KEPT_LIMIT: u64 = 1024;
/// Largest memory for chunks in bytes, unless two chunks need more.
const SHARE_LIMIT_BYTES: u64 = 256 << 20;
/// Largest number of threads that decode at once.
const READERS_LIMIT: u64 = 16;

/// Source of decoded chunks.
pub(crate) trait Chunks: Send + Sync + std::fmt::Debug {
    /// Decodes a chunk, named by its number along each axis of the array. `None` if the chunk is missing: all its
    /// elements have the fill value.
    fn decode(&self, number: &[u64]) -> Result<Option<Vec<u8>>, SourceError>;
}

/// Shape of an array and its chunks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ArrayShape {
    /// Elements along each axis, slowest first.
    pub(crate) shape: Vec<u64>,
    /// Elements of a chunk along each axis.
    pub(crate) chunk: Vec<u64>,
    /// Order of the axes in a decoded chunk, slowest first.
    pub(crate) stored: Vec<usize>,
    /// Byte order of the elements.
    pub(crate) endian: Endian,
    /// Little-endian bytes of an element of a missing chunk.
    pub(crate) fill: [u8; 8],
}

impl ArrayShape {
    /// Size of the array in bytes, for elements of `element` bytes; `None` if it does not fit 64 bits.
    pub(crate) fn whole_bytes(&self, element: usize) -> Option<u64> {
        checked_product(&self.shape, element)
    }

    /// Size of a chunk in bytes, for elements of `element` bytes; `None` if it does not fit the address space.
    pub(crate) fn chunk_bytes(&self, element: usize) -> Option<usize> {
        usize::try_from(checked_product(&self.chunk, element)?).ok().filter(|n| *n <= isize::MAX as usize / 4)
    }
}

fn checked_product(sizes: &[u64], element: usize) -> Option<u64> {
    sizes.iter().try_fold(element as u64, |product, n| product.checked_mul(*n))
}

/// Number of the element at a position in an array or block of these sizes, last axis fastest.
pub(crate) fn number_in_c_order(place: &[u64], sizes: &[u64]) -> u64 {
    place.iter().zip(sizes).fold(0, |number, (n, size)| number * size + n)
}

/// Selection of the array's elements that are the volume.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Placement {
    /// The axes that are x, y, z; `None` for an axis of one voxel.
    pub(crate) axes: [Option<usize>; 3],
    /// The fixed position on each other axis.
    pub(crate) fixed: Vec<u64>,
}

/// Number of chunks that are in memory at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChunkMemory {
    kept: u64,
    readers: u64,
    chunk_bytes: u64,
}

impl ChunkMemory {
    /// Divides a quarter of `memory_bytes`, which is the source's share. An error is the value of `memory_bytes` that
    /// would suffice.
    pub(crate) fn plan(chunk_bytes: u64, memory_bytes: u64) -> Result<Self, u64> {
        let least = chunk_bytes.saturating_mul(COPIES + 1);
        if least > memory_bytes / 4 {
            return Err(least.saturating_mul(4));
        }
        // A larger cache would not help: each chunk of a box is requested once.
        let share = (memory_bytes / 4).min(SHARE_LIMIT_BYTES.max(2 * least));
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get() as u64);
        let readers = (share / 2 / (COPIES * chunk_bytes)).clamp(1, threads.min(READERS_LIMIT));
        let kept = ((share - readers * COPIES * chunk_bytes) / chunk_bytes).clamp(1, KEPT_LIMIT);
        Ok(Self { kept, readers, chunk_bytes })
    }

    /// Largest memory for chunks in bytes.
    pub(crate) fn bytes(self) -> u64 {
        (self.kept + COPIES * self.readers) * self.chunk_bytes
    }
}

/// Grid of a volume in chunks.
#[derive(Debug)]
pub(crate) struct ChunkGrid {
    layout: GridLayout,
    array: ArrayShape,
    placement: Placement,
    /// Elements from one position to the next on each axis, within a chunk.
    strides: Vec<usize>,
    chunks: Box<dyn Chunks>,
    memory: ChunkMemory,
    state: Mutex<State>,
    changed: Condvar,
}

/// Decoded chunk; `None` if all elements have the fill value.
type Decoded = Option<Arc<Vec<u8>>>;

/// Cached chunks, and chunks that are being decoded.
#[derive(Debug, Default)]
struct State {
    readers: u64,
    loading: Vec<[u64; 3]>,
    kept: Recent<[u64; 3], Decoded>,
}

impl ChunkGrid {
    /// Grid over the elements that `placement` selects. `layout` has the dims of that selection and the type of the
    /// elements.
    pub(crate) fn new(
        layout: GridLayout,
        array: ArrayShape,
        placement: Placement,
        chunks: Box<dyn Chunks>,
        memory: ChunkMemory,
    ) -> Self {
        let mut strides = vec![0; array.shape.len()];
        let mut product = 1;
        for axis in array.stored.iter().rev() {
            strides[*axis] = product;
            product *= index(array.chunk[*axis]);
        }
        let (state, changed) = (Mutex::default(), Condvar::new());
        Self { layout, array, placement, strides, chunks, memory, state, changed }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // The lists are consistent even after a panic, so a poisoned lock is safe to use.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Size of a chunk in voxels along x, y, z.
    fn chunk_extent(&self) -> [u64; 3] {
        self.placement.axes.map(|axis| axis.map_or(1, |axis| self.array.chunk[axis]))
    }

    /// The chunk with this number along x, y, z, from the cache or decoded.
    fn chunk(&self, number: [u64; 3]) -> Result<Decoded, SourceError> {
        let mut state = self.state();
        loop {
            if let Some(found) = state.kept.get(&number) {
                return Ok(found.clone());
            }
            if !state.loading.contains(&number) {
                break;
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.loading.push(number);
        drop(state);
        let decoded = self.chunks.decode(&self.number_in_array(number));
        let mut state = self.state();
        state.loading.retain(|loading| *loading != number);
        self.changed.notify_all();
        let chunk = decoded?.map(Arc::new);
        state.kept.insert_within(index(self.memory.kept), number, chunk.clone());
        Ok(chunk)
    }

    fn number_in_array(&self, number: [u64; 3]) -> Vec<u64> {
        let mut all: Vec<u64> = self.placement.fixed.iter().zip(&self.array.chunk).map(|(at, n)| at / n).collect();
        for (axis, number) in self.placement.axes.iter().zip(number) {
            axis.iter().for_each(|axis| all[*axis] = number);
        }
        all
    }

    /// Copies the part of a chunk that lies in a box.
    fn copy(&self, chunk: Option<&[u8]>, first: [u64; 3], (part, whole): (VoxelBox, VoxelBox), out: &mut [u8]) {
        let bytes = self.layout.voxel_type.bytes();
        match bytes {
            1 => self.copy_elements::<1>(chunk, first, part, whole, out),
            2 => self.copy_elements::<2>(chunk, first, part, whole, out),
            4 => self.copy_elements::<4>(chunk, first, part, whole, out),
            _ => self.copy_elements::<8>(chunk, first, part, whole, out),
        }
    }

    fn copy_elements<const BYTES: usize>(
        &self,
        chunk: Option<&[u8]>,
        first: [u64; 3],
        part: VoxelBox,
        whole: VoxelBox,
        out: &mut [u8],
    ) {
        let (out, _) = out.as_chunks_mut::<BYTES>();
        let from = chunk.map(|chunk| chunk.as_chunks::<BYTES>().0);
        let mut fill = [0; BYTES];
        fill.copy_from_slice(&self.array.fill[..BYTES]);
        let stride = self.placement.axes.map(|axis| axis.map_or(0, |axis| self.strides[axis]));
        let fixed = self.placement.fixed.iter().zip(&self.array.chunk).zip(&self.strides);
        let base: usize = fixed.map(|((at, n), stride)| index(at % n) * stride).sum();
        let [nx, ny, _] = whole.extent();
        let width = part.extent()[0];
        for z in part.start[2]..part.end[2] {
            for y in part.start[1]..part.end[1] {
                let [dx, dy, dz] = [part.start[0] - whole.start[0], y - whole.start[1], z - whole.start[2]].map(index);
                let row = &mut out[dx + nx * (dy + ny * dz)..][..width];
                let Some(from) = from else {
                    row.fill(fill);
                    continue;
                };
                let inside = [part.start[0] - first[0], y - first[1], z - first[2]].map(index);
                let at = base + inside.iter().zip(stride).map(|(n, stride)| n * stride).sum::<usize>();
                if stride[0] == 1 {
                    row.copy_from_slice(&from[at..at + width]);
                } else {
                    for (x, voxel) in row.iter_mut().enumerate() {
                        *voxel = from[at + x * stride[0]];
                    }
                }
                if self.array.endian == Endian::Big {
                    swap_bytes(row.as_flattened_mut(), BYTES);
                }
            }
        }
    }
}

impl NumberGrid for ChunkGrid {
    fn layout(&self) -> &GridLayout {
        &self.layout
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let extent = self.chunk_extent();
        for part in chunk_boxes(voxels, extent) {
            let number: [u64; 3] = std::array::from_fn(|a| part.start[a] / extent[a]);
            let first = std::array::from_fn(|a| number[a] * extent[a]);
            let reader = Reader::begin(self);
            let chunk = self.chunk(number)?;
            self.copy(chunk.as_ref().map(|chunk| &chunk[..]), first, (part, voxels), out);
            drop(reader);
        }
        Ok(())
    }

    fn parts(&self, voxels: VoxelBox) -> Box<dyn Iterator<Item = VoxelBox> + '_> {
        Box::new(chunk_boxes(voxels, self.chunk_extent()))
    }
}

/// Copies the elements of a small block to their positions in a whole chunk. The rest of the chunk is never read.
pub(crate) fn widened(data: &[u8], sizes: &[u64], chunk: &[u64], element: usize, bytes: usize) -> Vec<u8> {
    let mut out = vec![0; bytes];
    let row = index(*sizes.last().unwrap_or(&1)) * element;
    let mut place = vec![0u64; sizes.len()];
    for run in data.chunks_exact(row.max(1)) {
        let at = index(number_in_c_order(&place, chunk)) * element;
        out[at..at + row].copy_from_slice(run);
        // Next row: the second-to-last axis runs fastest.
        for axis in (0..sizes.len().saturating_sub(1)).rev() {
            place[axis] += 1;
            if place[axis] < sizes[axis] {
                break;
            }
            place[axis] = 0;
        }
    }
    out
}

/// Permission of one thread to hold a chunk outside the cache.
struct Reader<'a>(&'a ChunkGrid);

impl<'a> Reader<'a> {
    fn begin(grid: &'a ChunkGrid) -> Self {
        let mut state = grid.state();
        while state.readers >= grid.memory.readers {
            state = grid.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.readers += 1;
        Self(grid)
    }
}

impl Drop for Reader<'_> {
    fn drop(&mut self) {
        self.0.state().readers -= 1;
        self.0.changed.notify_all();
    }
}

/// A box cut at the boundaries of chunks of this extent, x fastest.
fn chunk_boxes(voxels: VoxelBox, extent: [u64; 3]) -> impl Iterator<Item = VoxelBox> {
    let along = move |axis: usize| {
        let (start, last, step) = (voxels.start[axis], voxels.end[axis], extent[axis]);
        let end = move |at: u64| (at / step + 1).saturating_mul(step).min(last);
        std::iter::successors((start < last).then_some(start), move |&at| Some(end(at)).filter(|&next| next < last))
            .map(move |at| [at, end(at)])
    };
    along(2).flat_map(move |z| {
        along(1)
            .flat_map(move |y| along(0).map(move |x| VoxelBox { start: [x[0], y[0], z[0]], end: [x[1], y[1], z[1]] }))
    })
}

/// Volume stored in chunks.
#[derive(Debug)]
pub struct ChunkedSource {
    info: SourceInfo,
    grid: ChunkGrid,
    elements: Elements,
    absent: Option<AbsentNumbers>,
    mirrored: Mirrored,
    columns: Option<AbsentColumns>,
}

impl ChunkedSource {
    /// Source with this description over these chunks.
    pub(crate) fn new(mut info: SourceInfo, grid: ChunkGrid, elements: Elements) -> Self {
        let dims: Dims = elements.dims(&grid);
        assert_eq!((info.dims, info.voxel_type), (dims, elements.voxel_type), "metadata against chunks");
        // Any order of boxes is equally good; this order makes slabs be read in parallel.
        info.access_order = AccessOrder::X_FASTEST;
        info.memory_bytes += grid.memory.bytes();
        Self { info, grid, elements, absent: None, mirrored: Mirrored::default(), columns: None }
    }

    /// The same source with a rule for absent numbers.
    #[must_use]
    pub(crate) fn with_absent(self, absent: Option<AbsentNumbers>) -> Self {
        Self { absent, ..self }
    }

    /// The same source in another order along its axes, without the traces that do not exist.
    #[must_use]
    pub(crate) fn with_order(self, order: Option<(Mirrored, Option<AbsentColumns>)>) -> Self {
        let (mirrored, columns) = order.unwrap_or_default();
        Self { mirrored, columns, ..self }
    }
}

impl VolumeSource for ChunkedSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let in_file = self.mirrored.of_box(voxels, self.info.dims);
        self.elements.read_box(&self.grid, in_file, out)?;
        if let Some(absent) = &self.absent {
            absent.mark(out);
        }
        if let Some(columns) = &self.columns {
            columns.mark(in_file, out);
        }
        self.mirrored.reverse(in_file.extent(), self.info.voxel_type.bytes(), out);
        Ok(())
    }
}
