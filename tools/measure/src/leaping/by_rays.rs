//! Paths through a brick ray by ray, in `f64`: for comparison with the leaps of packets and with an octree.
//!
//! The walker of packets knows only proximity clouds. This walker leaps out of any given box and then walks as many
//! cells as a packet does before its next test. Numbers of leaps and walked lengths can be compared with those of
//! packets. Processor times can be compared only among walkers of this kind.

use supervol_format::cast::{narrow, single, whole};
use supervol_runtime::engines::blocks::BLOCK;
use supervol_runtime::engines::packets::leap::ProximityCloud;
use supervol_runtime::engines::packets::trace::{LocalRay, ROUND, RayInterval};

/// An empty box of cells: lower and upper plane along each axis.
pub type Box3 = [[i64; 2]; 3];

/// An ideal octree over a brick's blocks. A node is empty if all its blocks are empty. The largest empty node around a
/// block is known without descending.
pub struct Octree {
    cells: [usize; 3],
    /// Edge of the largest empty node around each block, in blocks; 0 for visible blocks.
    edges: Vec<u8>,
}

impl Octree {
    /// The octree over the blocks of a cloud.
    #[must_use]
    pub fn new(cloud: ProximityCloud<BLOCK>) -> Self {
        let cells = cloud.cells;
        let blocks = cells.iter().product();
        let mut edges: Vec<u8> = cloud.distances.into_iter().take(blocks).map(|distance| distance.min(1)).collect();
        let mut edge = 2;
        while edge < 2 * cells.iter().copied().max().unwrap_or(1) {
            let nodes = cells.map(|n| n.div_ceil(edge));
            let node_of = |block: usize| {
                let [x, y, z] = block_at(block, cells).map(|b| b / edge);
                x + nodes[0] * (y + nodes[1] * z)
            };
            let mut is_empty = vec![true; nodes.iter().product()];
            (0..blocks).for_each(|block| is_empty[node_of(block)] &= edges[block] > 0);
            (0..blocks).filter(|&block| is_empty[node_of(block)]).for_each(|block| edges[block] = narrow::<u8>(edge));
            edge *= 2;
        }
        Self { cells, edges }
    }

    /// The largest empty node around a block.
    #[must_use]
    pub fn around(&self, block: [usize; 3]) -> Option<Box3> {
        let edge = i64::from(self.edges[block[0] + self.cells[0] * (block[1] + self.cells[1] * block[2])]);
        (edge > 0).then(|| block.map(|b| narrow::<i64>(b) / edge * edge).map(|first| planes(first, first + edge)))
    }
}

/// The empty box around a block that a proximity cloud guarantees.
#[must_use]
pub fn around(cloud: &ProximityCloud<BLOCK>, block: [usize; 3]) -> Option<Box3> {
    let distance = cloud.distances[block[0] + cloud.cells[0] * (block[1] + cloud.cells[1] * block[2])];
    let reach = i64::from(distance);
    (reach > 0).then(|| block.map(narrow::<i64>).map(|b| planes(b - reach + 1, b + reach)))
}

fn block_at(place: usize, [nx, ny, _]: [usize; 3]) -> [usize; 3] {
    [place % nx, place / nx % ny, place / (nx * ny)]
}

fn planes(first_block: i64, end_block: i64) -> [i64; 2] {
    // Space before the first block is outside the brick.
    let first_block = if first_block <= 0 { -1 } else { first_block };
    [first_block, end_block].map(|block| block * narrow::<i64>(BLOCK))
}

/// The intervals of each ray, in order. `box_around` gives the empty box around a block.
pub fn intervals(
    rays: &[LocalRay],
    core: [usize; 3],
    box_around: impl Fn([usize; 3]) -> Option<Box3>,
) -> Vec<Vec<RayInterval>> {
    let of_ray = |ray: &LocalRay| {
        let (mut way, mut found) = (Way::new(ray, core), Vec::new());
        while way.t < way.end {
            let before = way.t;
            let leapt = box_around(way.block());
            match leapt {
                Some(empty) => way.leave(empty),
                None => (0..ROUND).for_each(|_| way.leave(way.cell.map(|cell| [cell, cell + 1]))),
            }
            found.push(RayInterval { t: [single(before), single(way.t)], is_leap: leapt.is_some() });
        }
        found
    };
    rays.iter().map(of_ray).collect()
}

/// State of a ray on its way through a brick.
struct Way {
    origin: [f64; 3],
    direction: [f64; 3],
    inverse: [f64; 3],
    /// Last cell of the brick along each axis; the first one is -1.
    last_cell: [i64; 3],
    cell: [i64; 3],
    t: f64,
    end: f64,
}

impl Way {
    fn new(ray: &LocalRay, core: [usize; 3]) -> Self {
        let (origin, direction) = (ray.origin.map(f64::from), ray.direction.map(f64::from));
        let last_cell = core.map(|n| narrow::<i64>(n) - 1);
        let cell = std::array::from_fn(|a| {
            let is_face = origin[a].fract() == 0.0 && direction[a] < 0.0;
            (whole::<i64>(origin[a].floor()) - i64::from(is_face)).clamp(-1, last_cell[a])
        });
        let inverse = direction.map(f64::recip);
        Self { origin, direction, inverse, last_cell, cell, t: 0.0, end: f64::from(ray.length) }
    }

    fn block(&self) -> [usize; 3] {
        self.cell.map(|cell| narrow::<usize>(cell.max(0)) / BLOCK)
    }

    /// Moves to the point at which the ray leaves a box around its cell, or to the end of the ray.
    fn leave(&mut self, planes: Box3) {
        let exits: [f64; 3] = std::array::from_fn(|a| match self.direction[a] {
            0.0 => f64::INFINITY,
            d => (planes[a][usize::from(d > 0.0)] as f64 - self.origin[a]) * self.inverse[a],
        });
        self.t = exits.into_iter().fold(self.end, f64::min).max(self.t);
        for a in 0..3 {
            let [low, high] = planes[a];
            let next = match (exits[a] <= self.t, self.direction[a] > 0.0) {
                (true, true) => high,
                (true, false) => low - 1,
                (false, _) => {
                    let position = self.origin[a] + self.t * self.direction[a];
                    whole::<i64>(position.floor()).clamp(low, high - 1)
                }
            };
            self.cell[a] = next.clamp(-1, self.last_cell[a]);
        }
    }
}
