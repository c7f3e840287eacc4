//! Check of a whole container against every rule of the format, brick by brick and level by level.
//!
//! 1. Header, footer, sections and manifest agree (opening the container checks this).
//! 2. The records tile the file without gaps or overlaps.
//! 3. Each brick keeps the rules of [`check_brick`]: checksum, flags, exact ranges, macro cells, range beneath.
//! 4. Aprons repeat the neighbours' voxels, and beyond the grid the nearest ones.
//! 5. Coarser voxels are the mean, maximum or majority of the finer ones, as the manifest says. They are moved to
//!    multiples of the container's step, or of the level's step in the manifest. Voxels of level 0 are multiples of the
//!    container's step.
//! 6. Each error bound is exactly the children's largest bound plus this level's greatest difference. If the limit from
//!    the value ranges is less, it is that limit. The bound of each macro cell is made in the same way from the macro
//!    cells beneath it, is at most that of its brick, and is rounded up to its byte. At level 0 the bound is at most the
//!    distance that voxels may have been moved. Only a comparison with the source shows the real distance
//!    ([`crate::compare`]).
//! 7. The manifest's values (range, percentiles, histogram, count, errors of levels) agree with the voxels.
//!
//! Memory: at most `memory_bytes`. Each thread holds some bricks, the finer ones of a coarser brick, and counts of
//! values; the rest caches decoded bricks. The number of threads follows from the memory. If it does not suffice for
//! one thread, the error names a sufficient number.

use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;
use supervol_format::cast::index;
use supervol_format::cell_errors::{dequantize_cells, quantize};
use supervol_format::codec::wavelet::DECODING_BYTES_PER_VOXEL;
use supervol_format::container::header::Descriptor;
use supervol_format::container::toc::BrickEntry;
use supervol_format::container::validate::{check_brick, check_coverage};
use supervol_format::level_reader::LevelReader;
use supervol_format::{BrickKey, Container, Level, Lod, Pyramid, VoxelBox};

use crate::error::{BuildError, MemoryPurpose};
use crate::pipeline::encode::cut::cut_brick;
use crate::pipeline::plan::memory::left_for_data;
use crate::pipeline::record::manifest::{reduce_of, steps_of};
use crate::pipeline::reduce::downsample::{Reduce, VoxelBlock, downsample, finer_box, rows_of};
use crate::pipeline::reduce::error_bound::{Beneath, step_error};
use crate::pipeline::reduce::quantizer_of;
use crate::statistics::{Form, Statistics, Values, finite};

/// Width in voxels of the apron around a core.
const APRON: u64 = supervol_format::brick::APRON as u64;
/// Number of bricks between two calls of the progress callback.
const BATCH: usize = 256;

/// Checks all rules. The error is the first broken one in entry order of a batch.
///
/// `on_progress` receives the number of checked bricks and of all bricks.
///
/// # Errors
/// The first broken rule, or a failure to read.
pub fn verify(path: &Path, memory_bytes: u64, on_progress: &dyn Fn(u64, u64)) -> Result<Container, BuildError> {
    let wrong = |e| BuildError::container(path, e);
    let container = Container::open(path).map_err(wrong)?;
    let plan = Plan::new(&container, memory_bytes)?;
    check_coverage(&container).map_err(wrong)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build();
    let pool = pool.map_err(|source| BuildError::Threads { threads: plan.threads, source })?;
    let total = container.pyramid().brick_count();
    let mut done = 0;
    let coarser = Coarser::of(path, &container)?;
    let counts = Counts::new(&container, plan.threads);
    let verification = Verification { path, container: &container, coarser, counts: &counts };
    for lod in container.pyramid().lods() {
        let reader = |lod| LevelReader::new(&container, lod, plan.cache_bytes);
        let own = reader(lod);
        let finer = (lod > Lod::FINEST).then(|| reader(Lod(lod.0 - 1)));
        let mut keys = container.pyramid().keys_of(lod).peekable();
        while keys.peek().is_some() {
            let batch: Vec<BrickKey> = keys.by_ref().take(BATCH).collect();
            let first_broken = Mutex::new(None::<(usize, BuildError)>);
            let check_one = |(i, &key): (usize, &BrickKey)| {
                if let Err(error) = verification.check(key, &own, finer.as_ref()) {
                    let mut first = lock(&first_broken);
                    if first.as_ref().is_none_or(|(j, _)| i < *j) {
                        *first = Some((i, error));
                    }
                }
            };
            pool.install(|| batch.par_iter().enumerate().for_each(check_one));
            if let Some((_, error)) = first_broken.into_inner().unwrap_or_else(PoisonError::into_inner) {
                return Err(error);
            }
            done += batch.len() as u64;
            on_progress(done, total);
        }
    }
    counts.compare(path, &container)?;
    Ok(container)
}

/// Number of threads, and the division of the memory among their buffers.
struct Plan {
    threads: usize,
    /// Bytes for decoded bricks of a level; two levels are cached.
    cache_bytes: usize,
}

/// Bricks that a thread holds at once: a record and its decompressed bytes, the brick, the same cut from its
/// neighbours, and averaged. Also a neighbour, its record and decompressed bytes, and values of macro cells.
const BRICKS_AT_HAND: u64 = 10;
/// Memory per record position in bytes, for rule 2; the list grows by doubling.
const COVERAGE_BYTES: u64 = 2 * 16;

impl Plan {
    fn new(container: &Container, memory_bytes: u64) -> Result<Self, BuildError> {
        let (pyramid, voxel_type) = (container.pyramid(), container.descriptor().voxel_type);
        let brick = pyramid.largest_brick_bytes(voxel_type);
        let of_finer = |level: &Level| level.factors.iter().map(|&f| u64::from(f)).product::<u64>();
        let finer = pyramid.levels().iter().skip(1).map(of_finer).max().unwrap_or(0);
        let counts = Statistics::bytes(voxel_type);
        let wavelets = DECODING_BYTES_PER_VOXEL as u64 * brick / voxel_type.bytes() as u64;
        let per_thread = (BRICKS_AT_HAND + finer) * brick + wavelets + counts;
        let fixed = |threads: usize| threads as u64 * per_thread + counts;
        let needed = fixed(1).max(pyramid.brick_count() * COVERAGE_BYTES);
        let purpose = MemoryPurpose::Verify { bricks: pyramid.brick_count() };
        let memory_bytes = left_for_data(memory_bytes, needed, purpose)?;
        // The threads take at most three quarters; the rest caches bricks.
        let fits = |threads: &usize| *threads == 1 || fixed(*threads) <= memory_bytes / 4 * 3;
        let threads = (1..=rayon::current_num_threads()).rev().find(fits).unwrap_or(1);
        Ok(Self { threads, cache_bytes: ((memory_bytes - fixed(threads)) / 2) as usize })
    }
}

/// Statistics of the bricks' values, collected on all threads.
struct Counts {
    /// One per thread, so that no thread waits for another.
    statistics: Vec<Mutex<Statistics>>,
    /// Greatest error of each level in stored units.
    errors: Vec<Mutex<f64>>,
}

impl Counts {
    fn new(container: &Container, threads: usize) -> Self {
        let empty = || Mutex::new(Statistics::new(container.descriptor().voxel_type));
        Self {
            statistics: (0..threads).map(|_| empty()).collect(),
            errors: container.pyramid().levels().iter().map(|_| Mutex::new(0.0)).collect(),
        }
    }

    /// Adds a brick: its error, and at level 0 the voxels of its core.
    fn add(&self, container: &Container, key: BrickKey, error: f64, stored: &[u8]) {
        {
            let mut greatest = lock(&self.errors[key.lod().0 as usize]);
            *greatest = greatest.max(error);
        }
        if key.lod() != Lod::FINEST {
            return;
        }
        let descriptor = container.descriptor();
        let size = descriptor.voxel_type.bytes();
        let [nx, ny, _] = container.pyramid().stored_extent(key);
        let [core_x, core_y, core_z] = container.pyramid().core_box(key).extent();
        let thread = rayon::current_thread_index().unwrap_or(0) % self.statistics.len();
        let mut statistics = lock(&self.statistics[thread]);
        let apron = index(APRON);
        for z in apron..apron + core_z {
            for y in apron..apron + core_y {
                let row = ((z * ny + y) * nx + apron) * size;
                statistics.add(&stored[row..row + core_x * size], descriptor.absence);
            }
        }
    }

    /// Rule 7.
    fn compare(self, path: &Path, container: &Container) -> Result<(), BuildError> {
        let (descriptor, manifest) = (container.descriptor(), container.manifest());
        let mut whole = Statistics::new(descriptor.voxel_type);
        self.statistics.iter().for_each(|part| whole.merge(&lock(part)));
        let values = Values::of(descriptor, &whole, Form::of(manifest));
        let errors: Vec<f64> = self.errors.iter().map(|e| finite(*lock(e) * descriptor.scale.abs())).collect();
        let said = [
            ("value range", format!("{:?}", values.range), format!("{:?}", manifest.value_range)),
            ("present voxels", values.present.to_string(), manifest.present_voxels.to_string()),
            ("percentiles", format!("{:?}", values.percentiles), format!("{:?}", manifest.percentiles)),
            ("histogram", format!("{:?}", values.histogram), format!("{:?}", manifest.histogram)),
            ("distribution", format!("{:?}", values.distribution), format!("{:?}", manifest.distribution)),
            ("errors of levels", format!("{errors:?}"), format!("{:?}", manifest.level_errors)),
        ];
        match said.into_iter().find(|(_, expected, found)| expected != found) {
            None => Ok(()),
            Some((rule, expected, found)) => {
                Err(BuildError::Broken { path: path.into(), rule: format!("manifest: {rule}"), expected, found })
            }
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Downsampling method, from the manifest.
struct Coarser {
    reduce: Reduce,
    /// Steps of the levels, see [`steps_of`].
    steps: Vec<f64>,
}

impl Coarser {
    fn of(path: &Path, container: &Container) -> Result<Self, BuildError> {
        let broken = |parameter: &str, expected: String, found| {
            let rule = format!("manifest, parameter {parameter}");
            BuildError::Broken { path: path.into(), rule, expected, found }
        };
        let manifest = container.manifest();
        let names = || format!("one of {}", Reduce::ALL.map(Reduce::name).join(", "));
        let reduce = reduce_of(manifest).map_err(|found| broken("reduce", names(), found))?;
        let voxel_type = container.descriptor().voxel_type;
        let kind = if voxel_type.is_float() { "powers of two" } else { "odd numbers" };
        let steps = steps_of(manifest, voxel_type)
            .map_err(|found| broken("coarse_steps", format!("{kind} or 0, apart by '; '"), found))?;
        Ok(Self { reduce, steps })
    }
}

/// Container to check, and the statistics of its values.
struct Verification<'a> {
    path: &'a Path,
    container: &'a Container,
    coarser: Coarser,
    counts: &'a Counts,
}

impl Verification<'_> {
    /// Rules 3 to 6 for one brick. `own` and `finer` read its level and the next finer level, if there is one.
    fn check(&self, key: BrickKey, own: &LevelReader<'_>, finer: Option<&LevelReader<'_>>) -> Result<(), BuildError> {
        let &Self { path, container, ref coarser, counts } = self;
        let wrong = |e| BuildError::container(path, e);
        let (entry, stored) = check_brick(container, key).map_err(wrong)?;
        counts.add(container, key, entry.error, &stored);
        let pyramid = container.pyramid();
        let level = pyramid.level_at(key.lod());
        let size = container.descriptor().voxel_type.bytes();
        let around = pyramid.core_box(key).grown(APRON, level.dims);
        let voxels = in_grid(pyramid, key, size, &stored);
        let checked = Checked { path, container, key, entry, around, voxels };
        checked.check_apron(&stored)?;
        for next in next_bricks(pyramid, key) {
            let found = own.brick(next).map_err(wrong)?;
            checked.check_shared(next, &found)?;
        }
        let Some(finer) = finer else { return checked.check_moved() };
        // A coarse voxel beyond the core, for the errors: as far as the children's aprons reach. These were checked with
        // their level.
        let grown = pyramid.core_box(key).grown(1, level.dims);
        let fine_box = finer_box(grown, level.factors, pyramid.level_at(Lod(key.lod().0 - 1)).dims);
        let children: Vec<BrickKey> = pyramid.children(key).collect();
        let mut fine = vec![0; fine_box.voxels() * size];
        finer.read_box_of(&children, fine_box, &mut fine).map_err(wrong)?;
        let fine = VoxelBlock { voxels: fine_box, bytes: &fine };
        checked.check_reduced(coarser, fine)?;
        checked.check_error(fine)
    }
}

/// The voxels of a stored brick that lie in the grid, packed.
fn in_grid(pyramid: &Pyramid, key: BrickKey, size: usize, stored: &[u8]) -> Vec<u8> {
    let core = pyramid.core_box(key);
    let around = core.grown(APRON, pyramid.level_at(key.lod()).dims);
    let first = std::array::from_fn(|a| index(around.start[a] + APRON - core.start[a]));
    let mut voxels = Vec::with_capacity(around.voxels() * size);
    rows_of(stored, pyramid.stored_extent(key), (first, around.extent()), size)
        .for_each(|row| voxels.extend_from_slice(row));
    voxels
}

/// The first bytes in which two rows differ.
fn first_difference(a: &[u8], b: &[u8]) -> (u8, u8) {
    a.iter().copied().zip(b.iter().copied()).find(|(a, b)| a != b).unwrap_or_default()
}

/// The bricks behind this one along each axis, as far as there are some.
fn next_bricks(pyramid: &Pyramid, key: BrickKey) -> impl Iterator<Item = BrickKey> {
    let grid = pyramid.level_at(key.lod()).bricks;
    (0..3).filter_map(move |axis| {
        let mut next = key.brick();
        next.0[axis] += 1;
        (next.0[axis] < grid[axis]).then(|| BrickKey::new(key.lod(), next))
    })
}

/// A brick, and the voxels around it.
struct Checked<'a> {
    path: &'a Path,
    container: &'a Container,
    key: BrickKey,
    entry: BrickEntry,
    /// Box of the core and one apron around it, clipped to the level.
    around: VoxelBox,
    voxels: Vec<u8>,
}

impl Checked<'_> {
    fn broken(&self, rule: &str, expected: String, found: String) -> BuildError {
        BuildError::Broken { path: self.path.into(), rule: format!("{}: {rule}", self.key), expected, found }
    }

    fn block(&self) -> VoxelBlock<'_> {
        VoxelBlock { voxels: self.around, bytes: &self.voxels }
    }

    /// Rule 4 beyond the grid: the apron repeats the nearest voxels.
    fn check_apron(&self, stored: &[u8]) -> Result<(), BuildError> {
        let size = self.container.descriptor().voxel_type.bytes();
        let expected = cut_brick(self.container.pyramid(), self.key, size, self.block());
        match expected.iter().zip(stored).position(|(e, s)| e != s) {
            Some(at) => Err(self.broken("apron", format!("{} at byte {at}", expected[at]), stored[at].to_string())),
            None => Ok(()),
        }
    }

    /// Rule 4 in the grid: this brick and the next one along an axis hold the same voxels where their boxes overlap.
    ///
    /// It suffices for all neighbours. A voxel of an apron that lies outside the core along n axes is in the box of the next
    /// brick along one of them, outside of whose core it lies along n - 1 axes. The last one of these bricks owns it.
    fn check_shared(&self, next: BrickKey, stored: &[u8]) -> Result<(), BuildError> {
        let pyramid = self.container.pyramid();
        let size = self.container.descriptor().voxel_type.bytes();
        let core = pyramid.core_box(next);
        let shared = self.around.intersect(core.grown(APRON, pyramid.level_at(next.lod()).dims));
        let first = std::array::from_fn(|a| index(shared.start[a] + APRON - core.start[a]));
        let theirs = rows_of(stored, pyramid.stored_extent(next), (first, shared.extent()), size);
        let mut rows = self.block().rows(shared, size).zip(theirs);
        let Some((ours, theirs)) = rows.find(|(ours, theirs)| ours != theirs) else { return Ok(()) };
        let (found, expected) = first_difference(ours, theirs);
        let rule = format!("apron between it and {next}");
        Err(self.broken(&rule, format!("a byte of {expected}, as there"), found.to_string()))
    }

    /// Rule 5 at level 0: voxels are multiples of the step, if there is one.
    fn check_moved(mut self) -> Result<(), BuildError> {
        let &Descriptor { voxel_type, absence, quantizer, .. } = self.container.descriptor();
        let Some(quantizer) = quantizer else { return Ok(()) };
        let moved = quantizer.snap(voxel_type, absence, &mut self.voxels);
        if moved > 0.0 {
            let expected = format!("multiples of {}", quantizer.step());
            return Err(self.broken("voxels", expected, format!("one that is {moved} off")));
        }
        Ok(())
    }

    /// Rule 5: coarser voxels follow from the finer ones.
    fn check_reduced(&self, coarser: &Coarser, fine: VoxelBlock<'_>) -> Result<(), BuildError> {
        let descriptor = self.container.descriptor();
        let (voxel_type, absence) = (descriptor.voxel_type, descriptor.absence);
        let Coarser { reduce, ref steps } = *coarser;
        let lod = self.key.lod();
        let factors = self.container.pyramid().level_at(lod).factors;
        let core = self.container.pyramid().core_box(self.key);
        let voxel_bytes = voxel_type.bytes();
        let mut reduced = vec![0; core.voxels() * voxel_bytes];
        downsample(reduce, voxel_type, absence, factors, fine, core, &mut reduced);
        if let Some(quantizer) = quantizer_of(descriptor, steps, lod) {
            quantizer.snap(voxel_type, absence, &mut reduced);
        }
        // Aprons repeat what other bricks own, and are checked there.
        let row_bytes = core.extent()[0] * voxel_bytes;
        let own = self.block().rows(core, voxel_bytes);
        let Some((found, expected)) = own.zip(reduced.chunks(row_bytes)).find(|(own, reduced)| own != reduced) else {
            return Ok(());
        };
        let rule = format!("{} of the finer level", reduce.name());
        let (expected, found) = first_difference(expected, found);
        Err(self.broken(&rule, expected.to_string(), found.to_string()))
    }

    /// Rule 6: the error bound.
    fn check_error(&self, fine: VoxelBlock<'_>) -> Result<(), BuildError> {
        let (descriptor, pyramid) = (self.container.descriptor(), self.container.pyramid());
        let wrong = |e| BuildError::container(self.path, e);
        let mut beneath = Beneath::new(pyramid, self.key);
        for child in pyramid.children(self.key) {
            let entry = self.container.entry(child).map_err(wrong)?;
            // The checksum of this record was compared with the finer level.
            let of_cells = self.container.read_cell_errors(child, &entry).map_err(wrong)?;
            beneath.add(pyramid, [self.key, child], &entry, &of_cells);
        }
        let (factors, core) = (pyramid.level_at(self.key.lod()).factors, pyramid.core_box(self.key));
        let step = step_error(descriptor.voxel_type, descriptor.absence, factors, fine, self.block(), core);
        let (expected, of_cells) = beneath.errors(&step, self.entry.range, descriptor.voxel_error());
        if self.entry.error != expected {
            return Err(self.broken("error bound", expected.to_string(), self.entry.error.to_string()));
        }
        let expected = dequantize_cells(&quantize(&of_cells, self.entry.error), self.entry.error);
        let found = self.container.read_cell_errors(self.key, &self.entry).map_err(wrong)?;
        let has_bounds = self.container.holds_cell_errors(self.key, &self.entry);
        let differs = expected.iter().zip(&found).position(|(expected, found)| expected != found);
        match differs.filter(|_| has_bounds) {
            None => Ok(()),
            Some(cell) => {
                let rule = format!("error bound of macro cell {cell}");
                Err(self.broken(&rule, expected[cell].to_string(), found[cell].to_string()))
            }
        }
    }
}
