//! A sparse tree of bright tubes. Most of the volume is exactly zero, which suits tests of empty-space leaping.
//!
//! Trees grow from the faces inwards in short straight pieces, turn a little at each, and fork. Radii shrink so that
//! the cubes of the children's radii sum to the cube of the parent's (Murray 1926). Growth stops at a volume budget, so
//! that less than 5 % of any grid is filled. A coarse grid of cells lists the pieces near each cell, so boxes far from
//! all tubes cost nothing. Brightness decreases from 1 in thick tubes to 0.5 in thin ones; the edge is one voxel wide.

use std::collections::VecDeque;

use glam::{DVec3, Vec3};
use supervol_format::random::Random;
use supervol_format::{Dims, VoxelBox};

use super::noise::numbers_for;
use super::target::{Scale, Target};
use crate::cast::{self, index, low_32, single};

/// Share of the grid that tubes may fill; an upper estimate.
const FILL_LIMIT: f64 = 0.045;

/// Largest number of pieces of tube.
const PIECES_LIMIT: usize = 1 << 15;

/// Largest number of cells of the coarse grid.
const CELLS_LIMIT: u64 = 1 << 18;

/// Edge of the smallest cells in voxels; larger cells are this times a power of two.
const CELL_VOXELS: u64 = 32;

/// Radius of the thinnest tube in voxels.
const RADIUS_LEAST: f64 = 0.7;

/// Largest distance in voxels outside a tube at which it may touch a voxel: half the edge plus half a voxel's diagonal.
const REACH_VOXELS: f64 = 1.37;

/// A straight piece of tube, in voxels.
#[derive(Debug, Clone, Copy)]
struct Piece {
    start: DVec3,
    end: DVec3,
    radius: f64,
    brightness: f32,
}

/// Pieces of all trees, and the cells that index them.
#[derive(Debug)]
pub struct Vessels {
    pieces: Vec<Piece>,
    cell_voxels: u64,
    cells: [u64; 3],
    /// `near[first[c]..first[c + 1]]` are the pieces near cell c.
    first: Vec<u32>,
    near: Vec<u32>,
}

impl Vessels {
    /// The trees of this seed in a grid of these dims.
    #[must_use]
    pub fn new(dims: Dims, seed: u64) -> Self {
        let pieces = grow(dims, &mut numbers_for(3, seed));
        let mut cell_voxels = CELL_VOXELS;
        let cells_at = |edge: u64| dims.0.map(|n| n.div_ceil(edge));
        while cells_at(cell_voxels).iter().product::<u64>() > CELLS_LIMIT {
            cell_voxels *= 2;
        }
        let mut vessels =
            Self { pieces, cell_voxels, cells: cells_at(cell_voxels), first: Vec::new(), near: Vec::new() };
        vessels.sort_into_cells();
        vessels
    }

    /// Counting sort: number of pieces per cell, then the start of each list, then the lists.
    fn sort_into_cells(&mut self) {
        let count = index(self.cells.iter().product());
        let mut counts = vec![0_u32; count + 1];
        self.for_each_near(|cell, _| counts[cell + 1] += 1);
        for cell in 0..count {
            counts[cell + 1] += counts[cell];
        }
        let mut near = vec![0; counts[count] as usize];
        let mut next = counts.clone();
        self.for_each_near(|cell, piece| {
            near[next[cell] as usize] = piece;
            next[cell] += 1;
        });
        (self.first, self.near) = (counts, near);
    }

    fn for_each_near(&self, mut visit: impl FnMut(usize, u32)) {
        let edge = self.cell_voxels as f64;
        let half_diagonal = edge * 3.0_f64.sqrt() / 2.0;
        for (number, piece) in (0..).zip(&self.pieces) {
            let reach = DVec3::splat(piece.radius + REACH_VOXELS);
            let low = (piece.start.min(piece.end) - reach) / edge;
            let high = (piece.start.max(piece.end) + reach) / edge;
            // Casts saturate at 0; the upper end is clamped to the last cell.
            let range =
                |axis: usize| cast::whole::<u64>(low[axis])..=cast::whole::<u64>(high[axis]).min(self.cells[axis] - 1);
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        let centre = (DVec3::new(x as f64, y as f64, z as f64) + 0.5) * edge;
                        if piece.distance(centre) <= piece.radius + REACH_VOXELS + half_diagonal {
                            visit(self.cell([x, y, z]), number);
                        }
                    }
                }
            }
        }
    }

    fn cell(&self, [x, y, z]: [u64; 3]) -> usize {
        index(x + self.cells[0] * (y + self.cells[1] * z))
    }

    pub(super) fn fill(&self, target: &mut Target<'_>) {
        // Zero has all bytes zero in every type.
        target.out.fill(0);
        let voxels = target.voxels;
        if voxels.voxels() == 0 {
            return;
        }
        // Blocks have fixed positions, independent of the box, so that arithmetic relative to a block is the same in
        // every read.
        let edge = CELL_VOXELS;
        let mut values = Vec::new();
        let range = |axis: usize| voxels.start[axis] / edge..voxels.end[axis].div_ceil(edge);
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let corner = [x, y, z].map(|i| i * edge);
                    let cell = self.cell(corner.map(|i| i / self.cell_voxels));
                    let near = &self.near[self.first[cell] as usize..self.first[cell + 1] as usize];
                    if !near.is_empty() {
                        self.fill_block(corner, near, &mut values, target);
                    }
                }
            }
        }
    }

    /// Draws the pieces near a block into its requested part.
    fn fill_block(&self, corner: [u64; 3], near: &[u32], values: &mut Vec<f32>, target: &mut Target<'_>) {
        let block = VoxelBox { start: corner, end: corner.map(|c| c + CELL_VOXELS) }.intersect(target.voxels);
        let origin = DVec3::from_array(corner.map(|c| c as f64));
        values.clear();
        values.resize(block.voxels(), 0.0);
        let mut touched = false;
        for piece in near {
            touched |= self.pieces[*piece as usize].draw(origin, block, corner, values);
        }
        if !touched {
            return;
        }
        let scale = Scale::unit(target.voxel_type);
        let voxel_type = target.voxel_type;
        let [nx, ny, _] = block.extent();
        for (row, values) in values.chunks_exact(nx).enumerate() {
            let (y, z) = ((row % ny) as u64, (row / ny) as u64);
            let start = [block.start[0], block.start[1] + y, block.start[2] + z];
            scale.write_fast(values, voxel_type, target.row(start, nx));
        }
    }
}

impl Piece {
    /// Distance of a point from the piece's axis in voxels.
    fn distance(&self, point: DVec3) -> f64 {
        let axis = self.end - self.start;
        let along = ((point - self.start).dot(axis) / axis.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        point.distance(self.start + axis * along)
    }

    /// Raises the values of a block (with its corner at `origin`) to those of this piece. Returns false if it touches
    /// no voxel.
    fn draw(&self, origin: DVec3, block: VoxelBox, corner: [u64; 3], values: &mut [f32]) -> bool {
        // f32 is exact enough within a block and one piece length around it.
        let start = (self.start - origin).as_vec3();
        let axis = (self.end - self.start).as_vec3();
        let inverse_square = 1.0 / axis.length_squared().max(f32::MIN_POSITIVE);
        let edge = single(self.radius + 0.5);
        let [nx, ny, _] = block.extent();
        // Voxels of the block that the tube's bounding box covers, relative to the corner.
        let range = |axis_index: usize| {
            let (a, b) = (start[axis_index], start[axis_index] + axis[axis_index]);
            let low = (block.start[axis_index] - corner[axis_index]).max(cast::whole::<u64>((a.min(b) - edge).ceil()));
            let high =
                (block.end[axis_index] - corner[axis_index]).min(cast::whole::<u64>((a.max(b) + edge).floor() + 1.0));
            low..high
        };
        let mut touched = false;
        for z in range(2) {
            for y in range(1) {
                let row = index(y + corner[1] - block.start[1]) + ny * index(z + corner[2] - block.start[2]);
                for x in range(0) {
                    let offset = Vec3::new(x as f32, y as f32, z as f32) - start;
                    let along = (offset.dot(axis) * inverse_square).clamp(0.0, 1.0);
                    let value = (edge - (offset - axis * along).length()).clamp(0.0, 1.0) * self.brightness;
                    let at = index(x + corner[0] - block.start[0]) + nx * row;
                    values[at] = values[at].max(value);
                    touched |= value > 0.0;
                }
            }
        }
        touched
    }

    /// Upper estimate of the voxels that the piece touches.
    fn volume(&self) -> f64 {
        let reach = self.radius + REACH_VOXELS;
        std::f64::consts::PI * reach * reach * (self.start.distance(self.end) + reach * 4.0 / 3.0)
    }
}

/// End of a branch that still grows.
struct Tip {
    position: DVec3,
    direction: DVec3,
    radius: f64,
    /// Number of pieces until the next fork.
    until_fork: u32,
}

/// Grows all trees at once, piece by piece, until all tips have left the grid or become too thin, or a limit is
/// reached.
fn grow(dims: Dims, random: &mut Random) -> Vec<Piece> {
    let size = DVec3::from_array(dims.0.map(|n| n as f64));
    let shortest = size.min_element();
    let step = (0.03 * shortest).max(3.0);
    let root_radius = (0.016 * shortest).clamp(1.2, 200.0);
    let roots = cast::whole::<u64>((6.0 * size.element_product() / shortest.powi(3)).clamp(6.0, 48.0));
    let mut tips: VecDeque<Tip> = (0..index(roots)).map(|i| root(i, size, root_radius, random)).collect();
    let mut room = FILL_LIMIT * size.element_product();
    let mut pieces = Vec::new();
    while let Some(tip) = tips.pop_front() {
        let end = tip.position + tip.direction * step;
        let brightness = single(0.5 + 0.5 * ((tip.radius - RADIUS_LEAST) / root_radius).clamp(0.0, 1.0));
        let piece = Piece { start: tip.position, end, radius: tip.radius, brightness };
        room -= piece.volume();
        if room < 0.0 || pieces.len() == PIECES_LIMIT {
            break;
        }
        pieces.push(piece);
        if end.cmplt(DVec3::ZERO).any() || end.cmpgt(size).any() {
            continue;
        }
        let turned =
            |random: &mut Random, most: f64| (tip.direction + most * random_vector(random)).normalize_or(tip.direction);
        if tip.until_fork > 0 {
            let direction = turned(random, 0.3);
            tips.push_back(Tip { position: end, direction, until_fork: tip.until_fork - 1, ..tip });
            continue;
        }
        // Murray's law: r^3 = r1^3 + r2^3.
        let share = random.between(0.25, 0.75);
        for share in [share, 1.0 - share] {
            let radius = tip.radius * share.cbrt();
            if radius >= RADIUS_LEAST {
                let until_fork = low_32(cast::whole::<u64>(random.between(2.0, 7.0)));
                tips.push_back(Tip { position: end, direction: turned(random, 0.9), radius, until_fork });
            }
        }
    }
    pieces
}

/// A tip on a face of the grid, pointing inwards.
fn root(index: usize, size: DVec3, radius: f64, random: &mut Random) -> Tip {
    let axis = index % 3;
    let far_side = (index / 3) % 2 == 1;
    let mut position = size * DVec3::new(random.between(0.2, 0.8), random.between(0.2, 0.8), random.between(0.2, 0.8));
    position[axis] = if far_side { size[axis] - 1.0 } else { 0.0 };
    let mut inwards = DVec3::ZERO;
    inwards[axis] = if far_side { -1.0 } else { 1.0 };
    let direction = (inwards + 0.4 * random_vector(random)).normalize_or(inwards);
    Tip { position, direction, radius, until_fork: 5 }
}

/// Random vector in the cube [-1, 1]^3.
fn random_vector(random: &mut Random) -> DVec3 {
    DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), random.between(-1.0, 1.0))
}
