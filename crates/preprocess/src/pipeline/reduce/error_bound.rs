//! Largest difference, inside one brick, between the trilinear interpolation of a level and that of the next finer
//! level.
//!
//! Both interpolants are trilinear between their own voxels. Their difference is trilinear in each box of the grid that
//! both sets of planes cut, and a trilinear function is greatest at a corner. On a halved axis the corners of coarse
//! voxel c have the fine coordinates 2c, 2c + 1/2 (the coarse voxel itself) and 2c + 1. The region's two ends have the
//! form `2c - 1/2`. The maximum over these points is the exact maximum over the region, not a sample.
//! Points where either level is absent are skipped; the brick's flag "has holes" tells that there may be such points.
//! The sum over levels therefore bounds the distance from level 0 wherever all levels between are present. In slivers
//! beside a hole, a quarter of a voxel wide, a level between can be absent although both ends are present.
//!
//! The maximum is known for each macro cell, too. Between two points that follow each other on an axis the difference is
//! linear along it. So the maximum over the points of a macro cell and the next one on either side is a bound in the cell.
//!
//! Voxels of 8 and 16 bits are compared in single precision, wider integers in double. All weights there are multiples
//! of 1/4, and every product is exact. Floating-point voxels are compared in double precision, and the difference is
//! increased by its possible rounding error.

use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::{index, single, whole};
use supervol_format::container::toc::BrickEntry;
use supervol_format::vectors::{Vectorized, vectorized};
use supervol_format::voxel_type::{Absence, Voxel};
use supervol_format::{BrickKey, Pyramid, ValueRange, VoxelBox, VoxelType, with_voxel};

use crate::pipeline::reduce::downsample::VoxelBlock;

/// Floating-point type of the comparison.
trait Real: Copy + PartialOrd + Default {
    const NAN: Self;
    fn from_f64(v: f64) -> Self;
    fn from_word(v: i32) -> Self;
    fn to_f64(self) -> f64;
    /// `a + (b - a) w`.
    fn blend(a: Self, b: Self, w: Self) -> Self;
    fn distance(a: Self, b: Self) -> Self;
}

macro_rules! real {
    ($t:ty, $from_f64:expr) => {
        impl Real for $t {
            const NAN: Self = <$t>::NAN;
            #[inline(always)]
            fn from_f64(v: f64) -> Self {
                $from_f64(v)
            }
            #[inline(always)]
            fn from_word(v: i32) -> Self {
                v as $t
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn blend(a: Self, b: Self, w: Self) -> Self {
                a + (b - a) * w
            }
            #[inline(always)]
            fn distance(a: Self, b: Self) -> Self {
                (a - b).abs()
            }
        }
    };
}
real!(f32, single);
real!(f64, f64::from);

/// Linear interpolation on one axis at one point: two voxels of a box, and the weight of the second.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Tap {
    first: usize,
    second: usize,
    weight: f64,
}

impl Tap {
    /// Tap of coordinate `p` (in voxels of the level) in a box that starts at `start` and has `n` voxels on this axis.
    /// The coordinate is clamped to the box; callers stay inside it, except at the end of the grid.
    fn new(p: f64, start: u64, n: usize) -> Self {
        let q = (p - start as f64).clamp(0.0, (n - 1) as f64);
        let first = whole::<usize>(q.floor()).min(n - 1);
        let weight = q - first as f64;
        // A point on a voxel uses that voxel twice, so that an absent neighbour has no effect.
        let second = if weight == 0.0 { first } else { (first + 1).min(n - 1) };
        Self { first, second, weight }
    }
}

/// Position in memory of a voxel of a row. On a halved axis the even voxels precede the odd ones. Points at the same
/// offset in their coarse voxels then use adjacent voxels.
#[inline(always)]
fn place(voxel: usize, n: usize, factor: u32) -> usize {
    if factor == 2 { voxel / 2 + voxel % 2 * n.div_ceil(2) } else { voxel }
}

/// Taps with one weight that use consecutive voxels; loops over them need no tables.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TapRun {
    start: Tap,
    count: usize,
}

impl TapRun {
    /// The taps in order, grouped into runs of maximal length.
    fn all(taps: impl IntoIterator<Item = Tap>) -> Vec<Self> {
        let mut runs: Vec<Self> = Vec::new();
        for tap in taps {
            match runs.last_mut() {
                Some(run) if run.tap(run.count) == tap => run.count += 1,
                _ => runs.push(Self { start: tap, count: 1 }),
            }
        }
        runs
    }

    /// Tap `i` of the run; `i` may be one past the last.
    fn tap(&self, i: usize) -> Tap {
        Tap { first: self.start.first + i, second: self.start.second + i, ..self.start }
    }

    /// Interpolates the row at all points of the run.
    #[inline(always)]
    fn blend<F: Real>(&self, row: &[F], out: &mut [F]) {
        let [a, b] = [self.start.first, self.start.second].map(|from| &row[from..from + self.count]);
        if self.start.weight == 0.0 {
            return out.copy_from_slice(a);
        }
        let weight = F::from_f64(self.start.weight);
        for ((t, &a), &b) in out.iter_mut().zip(a).zip(b) {
            *t = F::blend(a, b, weight);
        }
    }
}

/// Macro cells of one axis, in order: for each point, whether it belongs to the cell, or is the next point beside it.
fn cells_of_points(points: &[f64], c0: u64, c1: u64, factor: u32) -> Vec<Vec<bool>> {
    // Distance of the outermost core voxel from the next point behind the cell's face.
    let reach = if factor == 2 { 0.75 } else { 1.0 };
    (c0..c1)
        .step_by(MACRO_CELL)
        .map(|first| {
            let [low, high] = [first as f64 - reach, (first + MACRO_CELL as u64 - 1) as f64 + reach];
            points.iter().map(|p| (low..=high).contains(p)).collect()
        })
        .collect()
}

/// Points of one axis in voxels of the coarse level, for core voxels `c0..c1`, ascending.
fn points(c0: u64, c1: u64, factor: u32) -> Vec<f64> {
    let inner = (c0..c1).flat_map(|c| offsets(factor).iter().map(move |o| c as f64 + o));
    std::iter::once(c0 as f64 - 0.5).chain(inner).chain([c1 as f64 - 0.5]).collect()
}

/// The same points, grouped by their offset in the voxel; this order gives long runs.
fn points_by_place(c0: u64, c1: u64, factor: u32) -> Vec<f64> {
    let inner = offsets(factor).iter().flat_map(|o| (c0..c1).map(move |c| c as f64 + o));
    std::iter::once(c0 as f64 - 0.5).chain(inner).chain([c1 as f64 - 0.5]).collect()
}

fn offsets(factor: u32) -> &'static [f64] {
    if factor == 2 { &[-0.25, 0.0, 0.25] } else { &[0.0] }
}

/// Error bound of a brick: the children's bound plus this level's step error, but at most the largest distance that the
/// value ranges allow. These are the ranges of the brick and of all bricks beneath it. The bound is never less than a
/// child's, so that refinement never raises it. Source voxels lie outside the range beneath by at most `voxel_error`.
/// All values are in stored units.
#[must_use]
pub fn brick_error(
    children_error: f64,
    step_error: f64,
    own: ValueRange,
    beneath: ValueRange,
    voxel_error: f64,
) -> f64 {
    let apart = ((own.max - beneath.min).max(beneath.max - own.min) + voxel_error).next_up();
    children_error.max((children_error + step_error).min(apart))
}

/// Error bound of a macro cell; as [`brick_error`], with the bounds of the children's macro cells in it. It is not greater
/// than the brick's bound, `of_brick`.
#[must_use]
pub fn cell_error(children_error: f64, step_error: f64, of_brick: f64) -> f64 {
    (children_error + step_error).min(of_brick)
}

/// Value range and error bounds beneath a brick, in stored units.
#[derive(Debug, Clone)]
pub struct Beneath {
    /// Range of all bricks beneath it.
    pub range: ValueRange,
    /// Greatest error bound of a child.
    pub error: f64,
    /// Greatest error bound of the children's macro cells in each macro cell of the brick, x fastest.
    of_cells: Vec<f64>,
}

impl Default for Beneath {
    fn default() -> Self {
        Self { range: ValueRange::EMPTY, error: 0.0, of_cells: Vec::new() }
    }
}

impl Beneath {
    /// Nothing yet beneath this brick.
    #[must_use]
    pub fn new(pyramid: &Pyramid, key: BrickKey) -> Self {
        Self { of_cells: vec![0.0; pyramid.macro_cells(key).iter().product()], ..Self::default() }
    }

    /// Adds a child of the brick, with the error bounds of its macro cells.
    pub fn add(&mut self, pyramid: &Pyramid, [key, child]: [BrickKey; 2], entry: &BrickEntry, errors: &[f64]) {
        self.range = self.range.union(entry.range_beneath);
        self.error = self.error.max(entry.error);
        let cells_of_core = pyramid.layout().core() / MACRO_CELL;
        let factors = pyramid.level_at(key.lod()).factors;
        let ([nx, ny, _], [cx, cy, _]) = (pyramid.macro_cells(key), pyramid.macro_cells(child));
        // A macro cell covers whole macro cells of the finer level. Positions count from the brick's first finer cell.
        let first: [usize; 3] = std::array::from_fn(|a| {
            let [of_brick, of_child] = [key, child].map(|key| key.brick().0[a]);
            (of_child - of_brick * factors[a]) as usize * cells_of_core
        });
        for (i, &error) in errors.iter().enumerate() {
            let in_child = [i % cx, i / cx % cy, i / cx / cy];
            let [x, y, z] = std::array::from_fn(|a| (first[a] + in_child[a]) / factors[a] as usize);
            let of_cell = &mut self.of_cells[(z * ny + y) * nx + x];
            *of_cell = of_cell.max(error);
        }
    }

    /// Error bounds of the brick and of its macro cells. `own` is the range of the brick's values.
    #[must_use]
    pub fn errors(&self, steps: &StepErrors, own: ValueRange, voxel_error: f64) -> (f64, Vec<f64>) {
        let of_brick = brick_error(self.error, steps.brick, own, self.range, voxel_error);
        let of_cells = self.of_cells.iter().zip(&steps.cells);
        (of_brick, of_cells.map(|(&children, &step)| cell_error(children, step, of_brick)).collect())
    }
}

/// Greatest distances between both interpolants, in stored units.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepErrors {
    /// Over the region of the brick.
    pub brick: f64,
    /// Over the region of each macro cell, x fastest.
    pub cells: Vec<f64>,
}

/// Greatest distances between both interpolants over the region of the coarse brick with this core.
///
/// `fine` must hold the finer voxels of the core grown by one coarse voxel, `coarse` the core grown by one voxel. Both
/// are clipped to their grids.
#[must_use]
pub fn step_error(
    voxel_type: VoxelType,
    absence: Absence,
    factors: [u32; 3],
    fine: VoxelBlock<'_>,
    coarse: VoxelBlock<'_>,
    core: VoxelBox,
) -> StepErrors {
    let (mut errors, magnitude) = match voxel_type {
        VoxelType::U8 | VoxelType::I8 | VoxelType::U16 | VoxelType::I16 => {
            step_error_in::<f32>(voxel_type, absence, factors, fine, coarse, core)
        }
        _ => step_error_in::<f64>(voxel_type, absence, factors, fine, coarse, core),
    };
    if voxel_type.is_float() {
        for error in errors.cells.iter_mut().chain([&mut errors.brick]) {
            *error = match *error {
                // Differences near the greatest double overflow, and no bound can be given.
                _ if magnitude > f64::MAX / 8.0 => f64::INFINITY,
                // Three nested blends on either side round at most 14 times, each by half a unit in the last place.
                error if error > 0.0 => error + 16.0 * f64::EPSILON * magnitude,
                _ => 0.0,
            };
        }
    }
    errors
}

/// The greatest distances, and the greatest absolute value found.
fn step_error_in<F: Real>(
    voxel_type: VoxelType,
    absence: Absence,
    factors: [u32; 3],
    fine: VoxelBlock<'_>,
    coarse: VoxelBlock<'_>,
    core: VoxelBox,
) -> (StepErrors, f64) {
    // The parts of both blocks that this brick's region uses.
    let around = VoxelBox { start: core.start.map(|v| v.saturating_sub(1)), end: core.end.map(|v| v + 1) }
        .intersect(coarse.voxels);
    let scaled = |v: [u64; 3]| std::array::from_fn(|a| v[a] * u64::from(factors[a]));
    let beneath = VoxelBox { start: scaled(around.start), end: scaled(around.end) }.intersect(fine.voxels);
    let points: [Vec<f64>; 3] = std::array::from_fn(|a| {
        let order = if a == 0 { points_by_place } else { points };
        order(core.start[a], core.end[a], factors[a])
    });
    let taps = |a: usize, part: VoxelBox, scale: f64, shift: f64| -> Vec<Tap> {
        let n = part.extent()[a];
        points[a].iter().map(|p| Tap::new(p * scale + shift, part.start[a], n)).collect()
    };
    let axes = |part: VoxelBox, fine: bool| -> [Vec<Tap>; 3] {
        std::array::from_fn(|a| {
            // Coarse point p of a halved axis is the fine point 2p + 1/2; of another axis, p itself.
            let f = if fine { f64::from(factors[a]) } else { 1.0 };
            taps(a, part, f, (f - 1.0) * 0.5)
        })
    };
    let (fine_axes, coarse_axes) = (axes(beneath, true), axes(around, false));
    let cells = std::array::from_fn(|a| cells_of_points(&points[a], core.start[a], core.end[a], factors[a]));
    with_voxel!(voxel_type, V => vectorized(Comparing {
        fine: Slices::<F, V>::new(fine, beneath, absence, (factors[0], &fine_axes[0])),
        coarse: Slices::<F, V>::new(coarse, around, absence, (1, &coarse_axes[0])),
        fine_axes: &fine_axes,
        coarse_axes: &coarse_axes,
        worst: WorstOfCells::new(cells),
    }))
}

/// Task that compares both interpolants at all points.
struct Comparing<'a, F, V> {
    fine: Slices<'a, F, V>,
    coarse: Slices<'a, F, V>,
    fine_axes: &'a [Vec<Tap>; 3],
    coarse_axes: &'a [Vec<Tap>; 3],
    worst: WorstOfCells<F>,
}

impl<F: Real, V: Voxel> Vectorized for Comparing<'_, F, V> {
    type Output = (StepErrors, f64);

    #[inline(always)]
    fn run(mut self) -> (StepErrors, f64) {
        for (z, (fine_z, coarse_z)) in self.fine_axes[2].iter().zip(&self.coarse_axes[2]).enumerate() {
            self.fine.blend_slice(*fine_z);
            self.coarse.blend_slice(*coarse_z);
            for (y, (fine_y, coarse_y)) in self.fine_axes[1].iter().zip(&self.coarse_axes[1]).enumerate() {
                distances(self.fine.rows(*fine_y), self.coarse.rows(*coarse_y), &mut self.worst.row);
                self.worst.take_row(y, z);
            }
            self.worst.end_slice(z);
        }
        let cells = self.worst.of_cells;
        let brick = cells.iter().copied().fold(0.0, f64::max);
        (StepErrors { brick, cells }, self.fine.magnitude.max(self.coarse.magnitude))
    }
}

/// Greatest distances of the macro cells, from the distances at rows of points along x.
struct WorstOfCells<F> {
    /// Points of the macro cells of each axis ([`cells_of_points`]).
    cells: [Vec<Vec<bool>>; 3],
    /// Distances at the current row of points.
    row: Vec<F>,
    /// Greatest distance at each x point, for each macro cell along y, in an even and in an odd macro cell along z.
    rows: [Vec<Vec<F>>; 2],
    /// Greatest distance of each macro cell, x fastest.
    of_cells: Vec<f64>,
}

impl<F: Real> WorstOfCells<F> {
    fn new(cells: [Vec<Vec<bool>>; 3]) -> Self {
        let [nx, ny, nz] = [0, 1, 2].map(|a| cells[a].len());
        let row = vec![F::default(); cells[0].first().map_or(0, Vec::len)];
        let rows = vec![row.clone(); ny];
        Self { cells, row, rows: [rows.clone(), rows], of_cells: vec![0.0; nx * ny * nz] }
    }

    /// Takes the current row, that of points y and z. Absent points are NaN, which no comparison takes as greater.
    #[inline(always)]
    fn take_row(&mut self, y: usize, z: usize) {
        for (cell_z, _) in self.cells[2].iter().enumerate().filter(|(_, points)| points[z]) {
            for (cell_y, _) in self.cells[1].iter().enumerate().filter(|(_, points)| points[y]) {
                for (worst, &distance) in self.rows[cell_z % 2][cell_y].iter_mut().zip(&self.row) {
                    *worst = if distance > *worst { distance } else { *worst };
                }
            }
        }
    }

    /// Ends the macro cells whose last points along z are at point z.
    fn end_slice(&mut self, z: usize) {
        let [nx, ny, nz] = [0, 1, 2].map(|a| self.cells[a].len());
        for cell_z in 0..nz {
            let points = &self.cells[2][cell_z];
            if !points[z] || points.get(z + 1) == Some(&true) {
                continue;
            }
            for cell_y in 0..ny {
                let row = &mut self.rows[cell_z % 2][cell_y];
                for (cell_x, points) in self.cells[0].iter().enumerate() {
                    let of_cell = row.iter().zip(points).filter(|(_, is_in)| **is_in).map(|(worst, _)| worst.to_f64());
                    self.of_cells[(cell_z * ny + cell_y) * nx + cell_x] = of_cell.fold(0.0, f64::max);
                }
                row.fill(F::default());
            }
        }
    }
}

/// Two rows to blend, and the weight of the second.
type RowPair<'a, F> = (&'a [F], &'a [F], F);

/// Distances between two blended rows.
#[inline(always)]
fn distances<F: Real>(fine: RowPair<'_, F>, coarse: RowPair<'_, F>, out: &mut [F]) {
    let rows = fine.0.iter().zip(fine.1).zip(coarse.0.iter().zip(coarse.1));
    for (out, ((&fa, &fb), (&ca, &cb))) in out.iter_mut().zip(rows) {
        *out = F::distance(F::blend(fa, fb, fine.2), F::blend(ca, cb, coarse.2));
    }
}

/// Part of a block, interpolated along x at all points of that axis, then slice by slice along z, row by row along y.
///
/// Slices are requested in ascending order, and only the two that the current z point uses are kept. They take a few
/// hundred kilobytes; the whole part would be several times the brick.
struct Slices<'a, F, V> {
    block: VoxelBlock<'a>,
    absence: Absence,
    /// First voxel of the part in the block, and extent of the part in voxels.
    from: [usize; 3],
    part: [usize; 3],
    x_taps: Vec<TapRun>,
    x_points: usize,
    /// Values at x points and y voxels of an even and an odd z voxel, NaN if absent; and the z voxels they belong to.
    kept: [Vec<F>; 2],
    kept_z: [Option<usize>; 2],
    /// Values at the current z point between voxels. At a voxel, `current` is the index of the kept slice.
    slice: Vec<F>,
    current: Option<usize>,
    /// Voxels of one z of the part.
    bytes: Vec<u8>,
    /// One row of the part in the order of [`place`], NaN if absent.
    row: Vec<F>,
    factor: u32,
    /// Greatest present absolute value found, for float types.
    magnitude: f64,
    voxel: std::marker::PhantomData<V>,
}

impl<'a, F: Real, V: Voxel> Slices<'a, F, V> {
    fn new(block: VoxelBlock<'a>, part: VoxelBox, absence: Absence, (factor, x_taps): (u32, &[Tap])) -> Self {
        let [nx, ny, nz] = part.extent();
        let placed = |tap: &Tap| {
            let [first, second] = [tap.first, tap.second].map(|voxel| place(voxel, nx, factor));
            Tap { first, second, ..*tap }
        };
        let values = x_taps.len() * ny;
        Self {
            block,
            absence,
            from: std::array::from_fn(|a| index(part.start[a] - block.voxels.start[a])),
            part: [nx, ny, nz],
            x_taps: TapRun::all(x_taps.iter().map(placed)),
            x_points: x_taps.len(),
            kept: [vec![F::NAN; values], vec![F::NAN; values]],
            kept_z: [None; 2],
            slice: vec![F::NAN; values],
            current: None,
            bytes: Vec::with_capacity(nx * ny * size_of::<V>()),
            row: vec![F::NAN; nx],
            factor,
            magnitude: 0.0,
            voxel: std::marker::PhantomData,
        }
    }

    /// Interpolates z voxel `z` along x, unless it is kept already.
    #[inline(always)]
    fn load(&mut self, z: usize) {
        if self.kept_z[z % 2] == Some(z) {
            return;
        }
        self.kept_z[z % 2] = Some(z);
        let holes = self.absence.possible(V::TYPE);
        let block_extent = self.block.voxels.extent();
        let [nx, ny, _] = self.part;
        // Short copies in sequence, so that the processor fetches many rows from memory at the same time.
        self.bytes.clear();
        for y in 0..ny {
            let row = ((self.from[2] + z) * block_extent[1] + self.from[1] + y) * block_extent[0] + self.from[0];
            self.bytes.extend_from_slice(&self.block.bytes[row * size_of::<V>()..(row + nx) * size_of::<V>()]);
        }
        let rows = self.kept[z % 2].chunks_exact_mut(self.x_points).zip(self.bytes.chunks_exact(nx * size_of::<V>()));
        for (out, bytes) in rows {
            let holes_among = holes.then_some(self.absence);
            read_row::<F, V>(bytes, holes_among, self.factor, &mut self.row);
            if V::TYPE.is_float() {
                self.magnitude = self.row.iter().map(|v| v.to_f64().abs()).fold(self.magnitude, f64::max);
            }
            let mut rest = out;
            for run in &self.x_taps {
                let (points, others) = rest.split_at_mut(run.count);
                run.blend(&self.row, points);
                rest = others;
            }
        }
    }

    #[inline(always)]
    fn blend_slice(&mut self, tap: Tap) {
        self.load(tap.first);
        self.load(tap.second);
        self.current = (tap.weight == 0.0).then_some(tap.first % 2);
        if self.current.is_some() {
            return;
        }
        let weight = F::from_f64(tap.weight);
        let pairs = self.kept[tap.first % 2].iter().zip(&self.kept[tap.second % 2]);
        self.slice.iter_mut().zip(pairs).for_each(|(t, (&a, &b))| *t = F::blend(a, b, weight));
    }

    /// The two rows that a y point uses.
    #[inline(always)]
    fn rows(&self, tap: Tap) -> RowPair<'_, F> {
        let n = self.x_points;
        let slice = self.current.map_or(&self.slice, |kept| &self.kept[kept]);
        let row = |y: usize| &slice[y * n..(y + 1) * n];
        (row(tap.first), row(tap.second), F::from_f64(tap.weight))
    }
}

/// Reads a row in the order of [`place`]; absent voxels are NaN.
#[inline(always)]
fn read_row<F: Real, V: Voxel>(bytes: &[u8], absence: Option<Absence>, factor: u32, row: &mut [F]) {
    let value = |voxel: &[u8]| {
        let voxel = V::read_le(voxel);
        if V::TYPE.bytes() <= 2 { F::from_word(voxel.to_word()) } else { F::from_f64(voxel.to_f64()) }
    };
    match absence {
        None => read_row_as::<F, V>(bytes, factor, row, value),
        Some(absence) => read_row_as::<F, V>(bytes, factor, row, |voxel| {
            if absence.is_absent(V::read_le(voxel).to_f64()) { F::NAN } else { value(voxel) }
        }),
    }
}

#[inline(always)]
fn read_row_as<F: Real, V: Voxel>(bytes: &[u8], factor: u32, row: &mut [F], value: impl Fn(&[u8]) -> F) {
    let (size, n) = (size_of::<V>(), row.len());
    if factor == 1 {
        return row.iter_mut().zip(bytes.chunks_exact(size)).for_each(|(target, voxel)| *target = value(voxel));
    }
    let (even, odd) = row.split_at_mut(n.div_ceil(2));
    let pairs = || bytes.chunks_exact(2 * size);
    // Two passes vectorize better than one over both.
    even.iter_mut().zip(pairs()).for_each(|(target, pair)| *target = value(&pair[..size]));
    odd.iter_mut().zip(pairs()).for_each(|(target, pair)| *target = value(&pair[size..]));
    if n % 2 == 1 {
        even[n / 2] = value(&bytes[(n - 1) * size..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::reduce::downsample::{Reduce, downsample, finer_box};
    use supervol_format::Dims;
    use supervol_format::random::Random;

    /// Trilinear interpolation with clamped indices, literally as in the model.
    fn interpolate(dims: [usize; 3], values: &[f64], p: [f64; 3]) -> f64 {
        let mut sum = 0.0;
        for corner in 0..8usize {
            let (mut weight, mut index) = (1.0, [0usize; 3]);
            for a in 0..3 {
                let q = p[a].clamp(0.0, (dims[a] - 1) as f64);
                let w = q - q.floor();
                let bit = corner >> a & 1;
                weight *= if bit == 1 { w } else { 1.0 - w };
                index[a] = (q.floor() as usize + bit).min(dims[a] - 1);
            }
            if weight > 0.0 {
                sum += weight * values[index[0] + dims[0] * (index[1] + dims[1] * index[2])];
            }
        }
        sum
    }

    fn noise(n: usize) -> Vec<f32> {
        let mut random = Random::new(12345);
        (0..n).map(|_| (random.next_u64() >> 40) as f32 / 1000.0).collect()
    }

    #[test]
    fn runs_hold_the_taps_in_their_order() {
        for (start, n, factor) in [(0, 9, 2u32), (3, 64, 2), (0, 1, 2), (2, 5, 1)] {
            let scale = f64::from(factor);
            let points = points_by_place(start, start + n, factor);
            let fine = (n * u64::from(factor)) as usize;
            let tap = |p: &f64| Tap::new(p * scale + (scale - 1.0) * 0.5, start * u64::from(factor), fine);
            let placed = |tap: Tap| {
                let [first, second] = [tap.first, tap.second].map(|voxel| place(voxel, fine, factor));
                Tap { first, second, ..tap }
            };
            let taps: Vec<Tap> = points.iter().map(tap).map(placed).collect();
            let runs = TapRun::all(taps.iter().copied());
            let each = runs.iter().flat_map(|run| (0..run.count).map(|i| run.tap(i)));
            assert!(each.eq(taps.iter().copied()) && runs.len() <= 8, "{runs:?}");
        }
    }

    #[test]
    fn the_bound_holds_at_random_points_and_is_reached() {
        for (dims, factors) in [([9u64, 8, 7], [2u32, 2, 2]), ([6, 6, 6], [2, 1, 1]), ([5, 1, 12], [1, 1, 2])] {
            let fine_dims = Dims(dims);
            let values = noise(fine_dims.full_box().voxels());
            let fine = VoxelBlock { voxels: fine_dims.full_box(), bytes: bytemuck::cast_slice(&values) };
            let coarse_dims = Dims(std::array::from_fn(|a| dims[a].div_ceil(u64::from(factors[a]))));
            let coarse_box = coarse_dims.full_box();
            assert_eq!(finer_box(coarse_box, factors, fine_dims), fine_dims.full_box());
            let mut coarse = vec![0; coarse_box.voxels() * 4];
            let absence = Absence::NON_FINITE_ONLY;
            downsample(Reduce::Mean, VoxelType::F32, absence, factors, fine, coarse_box, &mut coarse);
            let block = VoxelBlock { voxels: coarse_box, bytes: &coarse };
            let bound = step_error(VoxelType::F32, absence, factors, fine, block, coarse_box).brick;

            let as_f64 = |v: &[f32]| v.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
            let (fine_f64, coarse_f64) = (as_f64(&values), as_f64(bytemuck::cast_slice(&coarse)));
            let (fine_n, coarse_n) = (dims.map(|n| n as usize), coarse_dims.0.map(|n| n as usize));
            let difference = |p: [f64; 3]| {
                let fine_p = std::array::from_fn(|a| (p[a] + 0.5) * f64::from(factors[a]) - 0.5);
                (interpolate(fine_n, &fine_f64, fine_p) - interpolate(coarse_n, &coarse_f64, p)).abs()
            };
            // A grid of eighths contains every corner of both grids and many points between.
            let mut reached = 0.0f64;
            let steps = coarse_n.map(|n| n * 8 + 1);
            for k in 0..steps[2] {
                for j in 0..steps[1] {
                    for i in 0..steps[0] {
                        reached = reached.max(difference([i, j, k].map(|s| s as f64 / 8.0 - 0.5)));
                    }
                }
            }
            assert!(reached <= bound * (1.0 + 1e-12), "{reached} exceeds the bound {bound} for {dims:?}");
            assert!(
                reached >= bound * (1.0 - 1e-12),
                "the bound {bound} is wider than the {reached} reached for {dims:?}"
            );
        }
    }

    #[test]
    fn a_brick_s_bound_is_the_sum_of_steps_but_no_more_than_ranges_allow() {
        let range = |min, max| ValueRange { min, max };
        assert_eq!(brick_error(3.0, 2.0, range(0.0, 10.0), range(0.0, 10.0), 0.0), 5.0);
        let capped = brick_error(90.0, 80.0, range(20.0, 70.0), range(0.0, 100.0), 0.0);
        assert!((90.0..90.0 + 1e-9).contains(&capped), "{capped}");
        let capped = brick_error(10.0, 80.0, range(20.0, 70.0), range(0.0, 100.0), 0.0);
        assert!((80.0..80.0 + 1e-9).contains(&capped), "{capped}");
        // Moved source voxels lie further outside, by the distance they were moved.
        let moved = brick_error(10.0, 80.0, range(20.0, 70.0), range(0.0, 100.0), 5.0);
        assert!((85.0..85.001).contains(&moved), "{moved}");
        assert_eq!(brick_error(1.0, 0.0, ValueRange::EMPTY, ValueRange::EMPTY, 0.0), 1.0);
    }

    #[test]
    fn a_ramp_along_a_kept_axis_has_no_error_and_holes_are_left_out() {
        let values: Vec<f32> = (0..4 * 4 * 4).map(|i| if i == 5 { f32::NAN } else { (i % 4) as f32 }).collect();
        let dims = Dims([4, 4, 4]);
        let fine = VoxelBlock { voxels: dims.full_box(), bytes: bytemuck::cast_slice(&values) };
        let coarse_box = Dims([4, 2, 2]).full_box();
        let mut coarse = vec![0; coarse_box.voxels() * 4];
        let absence = Absence::NON_FINITE_ONLY;
        downsample(Reduce::Mean, VoxelType::F32, absence, [1, 2, 2], fine, coarse_box, &mut coarse);
        let block = VoxelBlock { voxels: coarse_box, bytes: &coarse };
        assert_eq!(step_error(VoxelType::F32, absence, [1, 2, 2], fine, block, coarse_box).brick, 0.0);
    }

    /// A field of these values, its mean by these factors, and the errors of a step between them.
    fn step_of(dims: [u64; 3], factors: [u32; 3], values: &[f32]) -> (Dims, Vec<f32>, StepErrors) {
        let fine = VoxelBlock { voxels: Dims(dims).full_box(), bytes: bytemuck::cast_slice(values) };
        let coarse_dims = Dims(std::array::from_fn(|a| dims[a].div_ceil(u64::from(factors[a]))));
        let coarse_box = coarse_dims.full_box();
        let mut coarse = vec![0; coarse_box.voxels() * 4];
        let absence = Absence::NON_FINITE_ONLY;
        downsample(Reduce::Mean, VoxelType::F32, absence, factors, fine, coarse_box, &mut coarse);
        let block = VoxelBlock { voxels: coarse_box, bytes: &coarse };
        let errors = step_error(VoxelType::F32, absence, factors, fine, block, coarse_box);
        (coarse_dims, bytemuck::cast_slice(&coarse).to_vec(), errors)
    }

    #[test]
    fn bounds_of_macro_cells_hold_at_every_point_of_their_regions() {
        for (dims, factors) in [([38u64, 20, 18], [2u32, 2, 2]), ([18, 21, 12], [2, 1, 1]), ([12, 18, 33], [1, 1, 2])] {
            let mut values = noise(Dims(dims).full_box().voxels());
            // Noise of very different strength from place to place.
            for (i, value) in values.iter_mut().enumerate() {
                *value *= [0.0, 1.0, 0.01, 5.0][i / 7 % 4];
            }
            let (coarse_dims, coarse, errors) = step_of(dims, factors, &values);
            let as_f64 = |v: &[f32]| v.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
            let (fine, coarse) = (as_f64(&values), as_f64(&coarse));
            let (fine_n, n) = (dims.map(|n| n as usize), coarse_dims.0.map(|n| n as usize));
            let cells = n.map(|n| n.div_ceil(MACRO_CELL));
            // Greatest distance in each macro cell, and up to the next points beside it.
            let mut reached = vec![[0.0f64; 2]; errors.cells.len()];
            // A grid of quarters contains every corner of both grids and of the macro cells.
            for at in 0..(4 * n[0] + 1) * (4 * n[1] + 1) * (4 * n[2] + 1) {
                let [nx, ny] = [4 * n[0] + 1, 4 * n[1] + 1];
                let p = [at % nx, at / nx % ny, at / nx / ny].map(|s| s as f64 / 4.0 - 0.5);
                let fine_p = std::array::from_fn(|a| (p[a] + 0.5) * f64::from(factors[a]) - 0.5);
                let off = (interpolate(fine_n, &fine, fine_p) - interpolate(n, &coarse, p)).abs();
                for (i, reached) in reached.iter_mut().enumerate() {
                    let cell = [i % cells[0], i / cells[0] % cells[1], i / cells[0] / cells[1]];
                    let is_within = |reach: [f64; 3]| {
                        (0..3).all(|a| {
                            let first = (MACRO_CELL * cell[a]) as f64;
                            (first - reach[a]..=first + MACRO_CELL as f64 - 1.0 + reach[a]).contains(&p[a])
                        })
                    };
                    let beside = factors.map(|factor| if factor == 2 { 0.75 } else { 1.0 });
                    for (reached, reach) in reached.iter_mut().zip([[0.5; 3], beside]) {
                        *reached = if is_within(reach) { reached.max(off) } else { *reached };
                    }
                }
            }
            assert_eq!(errors.cells.iter().copied().fold(0.0, f64::max), errors.brick);
            for (cell, ([inside, around], &bound)) in reached.iter().zip(&errors.cells).enumerate() {
                assert!(*inside <= bound, "cell {cell} of {dims:?} reaches {inside}, bound {bound}");
                assert!(bound <= around * (1.0 + 1e-9), "cell {cell} of {dims:?}: bound {bound}, reached {around}");
            }
        }
    }

    #[test]
    fn a_spike_is_an_error_in_its_macro_cell_alone() {
        let dims = [64u64, 48, 32];
        let mut values = vec![3.0f32; Dims(dims).full_box().voxels()];
        values[(24 * 48 + 8) * 64 + 40] = 103.0;
        let (_, _, errors) = step_of(dims, [2; 3], &values);
        // Macro cells are 4 x 3 x 2; the spike lies in the middle of cell (2, 0, 1).
        for (cell, &error) in errors.cells.iter().enumerate() {
            assert_eq!(error > 0.0, cell == 2 + 4 * 3, "cell {cell}: {error}");
        }
        assert_eq!(errors.brick, errors.cells[14]);
    }

    #[test]
    fn macro_cells_take_over_the_bounds_of_the_cells_beneath_them() {
        let layout = supervol_format::BrickLayout::new(16).expect("16 is a core");
        let pyramid =
            Pyramid::new(Dims([80, 40, 20]), layout, &[[2, 2, 1], [2, 2, 2], [2, 1, 1]]).expect("a valid pyramid");
        let key = BrickKey::new(supervol_format::Lod(2), supervol_format::BrickIndex([1, 0, 0]));
        let mut beneath = Beneath::new(&pyramid, key);
        let range = ValueRange { min: 0.0, max: 100.0 };
        for child in pyramid.children(key) {
            let mut entry = BrickEntry::decode(&[0; 80], child, 0).expect("zeros are an entry");
            (entry.range_beneath, entry.error) = (range, 40.0);
            let [nx, ny, nz] = pyramid.macro_cells(child);
            let errors: Vec<f64> = (0..nx * ny * nz).map(|i| f64::from(child.brick().0[0]) * 10.0 + i as f64).collect();
            beneath.add(&pyramid, [key, child], &entry, &errors);
        }
        // Level 1 has 40 x 20 x 20 voxels. Along x, only its third brick lies in this one, with one macro cell.
        let steps = StepErrors { brick: 7.0, cells: vec![7.0, 1.0, 0.0, 50.0] };
        let (of_brick, of_cells) = beneath.errors(&steps, range, 0.0);
        assert_eq!((of_brick, pyramid.macro_cells(key)), (47.0, [1, 2, 2]));
        assert_eq!(of_cells, [23.0 + 7.0, 21.0 + 1.0, 21.0, 47.0]);
    }
}
