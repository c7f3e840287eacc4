//! Layers of apron that repeat the nearest voxels of the core, as at the edge of a grid. They are not coded: a volume
//! one voxel thick is coded once, not five times.

use crate::brick::APRON;

/// Ends at which both layers of apron repeat the outermost layer of the core: low and high end of each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Repeats([[bool; 2]; 3]);

impl Repeats {
    /// Finds the repeated ends among voxels, x fastest.
    pub fn of<T: PartialEq>(voxels: &[T], extent: [usize; 3]) -> Self {
        Self(std::array::from_fn(|axis| {
            let n = extent[axis];
            if n <= 2 * APRON {
                return [false; 2];
            }
            let repeats =
                |from: usize, layers: [usize; APRON]| layers.iter().all(|&l| are_equal(voxels, extent, axis, from, l));
            [repeats(APRON, std::array::from_fn(|l| l)), repeats(n - 1 - APRON, std::array::from_fn(|l| n - 1 - l))]
        }))
    }

    /// Whether any end repeats.
    pub fn any(self) -> bool {
        self.0.as_flattened().contains(&true)
    }

    /// Ends that repeat in both.
    pub fn and(self, other: Self) -> Self {
        Self(std::array::from_fn(|axis| [0, 1].map(|end| self.0[axis][end] && other.0[axis][end])))
    }

    /// As bits 0 to 5: low end of x, high end of x, low end of y, ...
    pub fn bits(self) -> u8 {
        self.0.as_flattened().iter().enumerate().map(|(i, &set)| u8::from(set) << i).sum()
    }

    /// From such bits. `None` if a brick of this extent has no such layers.
    pub fn from_bits(bits: u8, extent: [usize; 3]) -> Option<Self> {
        let repeats = Self(std::array::from_fn(|axis| [0, 1].map(|end| bits >> (2 * axis + end) & 1 == 1)));
        let fits = (0..3).all(|a| extent[a] > 2 * APRON || repeats.0[a] == [false; 2]);
        (fits && bits >> 6 == 0).then_some(repeats)
    }

    /// First coded voxel and number of coded voxels, along each axis.
    pub fn coded(self, extent: [usize; 3]) -> ([usize; 3], [usize; 3]) {
        let layers = |axis: usize, end: usize| if self.0[axis][end] { APRON } else { 0 };
        (std::array::from_fn(|a| layers(a, 0)), std::array::from_fn(|a| extent[a] - layers(a, 0) - layers(a, 1)))
    }
}

/// Whether two layers across an axis hold the same voxels.
fn are_equal<T: PartialEq>(voxels: &[T], extent: [usize; 3], axis: usize, one: usize, other: usize) -> bool {
    let [nx, ny, nz] = extent;
    let row = |y: usize, z: usize| &voxels[(z * ny + y) * nx..][..nx];
    match axis {
        0 => voxels.chunks_exact(nx).all(|row| row[one] == row[other]),
        1 => (0..nz).all(|z| row(one, z) == row(other, z)),
        _ => (0..ny).all(|y| row(y, one) == row(y, other)),
    }
}

/// Positions of the coded voxels among all voxels of a brick.
pub(super) struct Places {
    /// First coded voxel on each axis.
    pub from: [usize; 3],
    /// Number of coded voxels on each axis.
    pub coded: [usize; 3],
    /// Number of voxels of the brick on each axis.
    pub extent: [usize; 3],
}

impl Places {
    /// Coded position on an axis whose voxel stands at the stored position `stored`.
    pub fn source(&self, axis: usize, stored: usize) -> usize {
        stored.saturating_sub(self.from[axis]).min(self.coded[axis] - 1)
    }

    /// For each row of the brick, in order: number of the first coded voxel of the row that it repeats.
    pub fn rows(&self) -> impl DoubleEndedIterator<Item = usize> + ExactSizeIterator {
        let [_, ny, nz] = self.extent;
        (0..ny * nz)
            .map(move |row| (self.source(2, row / ny) * self.coded[1] + self.source(1, row % ny)) * self.coded[0])
    }

    /// Repeats voxels along x in a row. The coded voxels, of `size` bytes each, are already at their positions.
    pub fn repeat_along(&self, row: &mut [u8], size: usize) {
        // Voxels are copied as arrays, so that the compiler uses single machine words.
        match size {
            1 => self.repeat_voxels(row.as_chunks_mut::<1>().0),
            2 => self.repeat_voxels(row.as_chunks_mut::<2>().0),
            4 => self.repeat_voxels(row.as_chunks_mut::<4>().0),
            _ => self.repeat_voxels(row.as_chunks_mut::<8>().0),
        }
    }

    fn repeat_voxels<T: Copy>(&self, row: &mut [T]) {
        let first = self.from[0];
        let last = first + self.coded[0] - 1;
        let ends = [row[first], row[last]];
        row[..first].fill(ends[0]);
        row[last + 1..].fill(ends[1]);
    }
}
