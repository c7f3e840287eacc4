//! The walk of a ray through bricks, macro cells and trilinear cells.
//!
//! All three are families of parallel planes in the index space of level 0. Every crossing is computed from the plane's
//! coordinate by one expression, `AxisRay::crossing`. The same plane has the same coordinate in every family and for
//! every brick size, and so the same t, bit for bit. Intervals join without gap or overlap, and a picture does not
//! depend on the brick size. Cells are half-open in t: the cell of t is the one with `entry <= t < exit`.

use supervol_format::Level;
use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::whole;
use supervol_format::space::HALF_VOXEL;
use supervol_scene::clip::{IndexRay, ROUNDED_LENGTH};

/// Directions below this, index offset per world length, count as parallel: their crossings would overflow.
pub(crate) const PARALLEL: f64 = 1e-200;

/// A ray in the index space of level 0, ready for crossings.
#[derive(Debug, Clone, Copy)]
pub struct AxisRay {
    origin: [f64; 3],
    direction: [f64; 3],
    inverse: [f64; 3],
}

impl AxisRay {
    /// From a ray in index space.
    #[must_use]
    pub fn new(ray: &IndexRay) -> Self {
        let direction = ray.direction.map(|d| if d.abs() < PARALLEL { 0.0 } else { d });
        Self { origin: ray.origin, direction, inverse: direction.map(f64::recip) }
    }

    /// Index coordinate at t.
    #[inline]
    #[must_use]
    pub fn coordinate(&self, axis: usize, t: f64) -> f64 {
        self.origin[axis] + t * self.direction[axis]
    }

    /// Whether a part of the ray may only be the rounding of its ends.
    #[inline]
    #[must_use]
    pub fn is_rounding(&self, [t0, t1]: [f64; 2]) -> bool {
        self.direction.iter().all(|d| (d * (t1 - t0)).abs() <= ROUNDED_LENGTH)
    }

    /// t at which the ray crosses a plane; not for parallel axes.
    #[inline]
    fn crossing(&self, axis: usize, plane: f64) -> f64 {
        (plane - self.origin[axis]) * self.inverse[axis]
    }
}

/// Planes at `first + i * spacing` on each axis, level-0 index coordinates; cell i lies between planes i and i + 1.
#[derive(Debug, Clone, Copy)]
pub struct Planes {
    first: [f64; 3],
    spacing: [f64; 3],
    /// 1 / spacing; exact for cells and macro cells, whose spacings are powers of two.
    inverse_spacing: [f64; 3],
}

impl Planes {
    /// Faces of the bricks of a level.
    #[must_use]
    pub fn of_bricks(level: &Level, core: usize) -> Self {
        Self::new([-HALF_VOXEL; 3], level.scale.map(|s| s as f64 * core as f64))
    }

    /// Faces of the macro cells of a level.
    #[must_use]
    pub fn of_macro_cells(level: &Level) -> Self {
        Self::of_bricks(level, MACRO_CELL)
    }

    /// Faces of the trilinear cells of a level: through the voxels. Cell i lies between voxels i and i + 1.
    #[must_use]
    pub fn of_cells(level: &Level) -> Self {
        let spacing = level.scale.map(|s| s as f64);
        Self::new(spacing.map(|s| HALF_VOXEL * s - HALF_VOXEL), spacing)
    }

    fn new(first: [f64; 3], spacing: [f64; 3]) -> Self {
        Self { first, spacing, inverse_spacing: spacing.map(f64::recip) }
    }

    #[inline]
    fn plane(&self, axis: usize, i: i64) -> f64 {
        self.first[axis] + i as f64 * self.spacing[axis]
    }

    /// The part of an interval of t in which the ray is between a cell's faces.
    #[must_use]
    pub fn chord(&self, ray: &AxisRay, index: [i64; 3], interval: [f64; 2]) -> [f64; 2] {
        let [mut t0, mut t1] = interval;
        for (axis, &cell) in index.iter().enumerate() {
            if ray.direction[axis] != 0.0 {
                let faces = [cell, cell + 1].map(|i| ray.crossing(axis, self.plane(axis, i)));
                t0 = t0.max(faces[0].min(faces[1]));
                t1 = t1.min(faces[0].max(faces[1]));
            }
        }
        [t0, t1]
    }

    /// The cell of a box at the ray's position at t, and the fractions there, clamped to [0, 1].
    #[inline]
    #[must_use]
    pub fn cell_at(&self, ray: &AxisRay, t: f64, cells: &CellBox) -> ([i64; 3], [f64; 3]) {
        let position: [f64; 3] =
            std::array::from_fn(|a| (ray.coordinate(a, t) - self.first[a]) * self.inverse_spacing[a]);
        // `as` saturates.
        let index = std::array::from_fn(|a| whole::<i64>(position[a].floor()).clamp(cells.low[a], cells.high[a]));
        (index, std::array::from_fn(|a| (position[a] - index[a] as f64).clamp(0.0, 1.0)))
    }

    /// Position of the ray at t as a fraction of each cell `index`, clamped to [0, 1].
    #[inline]
    #[must_use]
    pub fn fractions(&self, ray: &AxisRay, t: f64, index: [i64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| {
            let cells = (ray.coordinate(a, t) - self.first[a]) * self.inverse_spacing[a];
            (cells - index[a] as f64).clamp(0.0, 1.0)
        })
    }
}

/// A box of cells, both ends included.
#[derive(Debug, Clone, Copy)]
pub struct CellBox {
    /// Least index on each axis.
    pub low: [i64; 3],
    /// Greatest index on each axis.
    pub high: [i64; 3],
}

/// Walks a ray through the cells of a box of one family.
#[derive(Debug, Clone, Copy)]
pub struct GridWalk {
    planes: Planes,
    cells: CellBox,
    /// The present cell.
    pub index: [i64; 3],
    /// t at which the ray leaves the present cell on each axis; infinite at the box's end.
    exits: [f64; 3],
}

impl GridWalk {
    /// Starts at the cell of t, or at the box's nearest cell.
    #[inline]
    #[must_use]
    pub fn new(ray: &AxisRay, planes: Planes, cells: CellBox, t: f64) -> Self {
        let index = std::array::from_fn(|a| locate(ray, &planes, &cells, a, t));
        let mut walk = Self { planes, cells, index, exits: [f64::INFINITY; 3] };
        (0..3).for_each(|a| walk.exits[a] = walk.exit_on(ray, a));
        walk
    }

    /// t at which the ray leaves the present cell; infinite in the last cell of the box.
    #[inline]
    #[must_use]
    pub fn exit(&self) -> f64 {
        self.exits[0].min(self.exits[1]).min(self.exits[2])
    }

    /// Goes to the next cell: across a face, or through an edge or a corner.
    #[inline]
    pub fn advance(&mut self, ray: &AxisRay) {
        let exit = self.exit();
        for a in 0..3 {
            if self.exits[a] <= exit && exit < f64::INFINITY {
                self.index[a] += if ray.direction[a] > 0.0 { 1 } else { -1 };
                self.exits[a] = self.exit_on(ray, a);
            }
        }
    }

    #[inline]
    fn exit_on(&self, ray: &AxisRay, axis: usize) -> f64 {
        let i = self.index[axis];
        if ray.direction[axis] > 0.0 && i < self.cells.high[axis] {
            ray.crossing(axis, self.planes.plane(axis, i + 1))
        } else if ray.direction[axis] < 0.0 && i > self.cells.low[axis] {
            ray.crossing(axis, self.planes.plane(axis, i))
        } else {
            f64::INFINITY
        }
    }
}

/// The cell of t on one axis: estimated by position, decided by crossings.
#[inline]
fn locate(ray: &AxisRay, planes: &Planes, cells: &CellBox, axis: usize, t: f64) -> i64 {
    let (low, high) = (cells.low[axis], cells.high[axis]);
    let position = (ray.coordinate(axis, t) - planes.first[axis]) * planes.inverse_spacing[axis];
    // `as` saturates.
    let mut i = whole::<i64>(position.floor()).clamp(low, high);
    let crossed = |plane: i64| ray.crossing(axis, planes.plane(axis, plane)) <= t;
    if ray.direction[axis] > 0.0 {
        while i < high && crossed(i + 1) {
            i += 1;
        }
        while i > low && !crossed(i) {
            i -= 1;
        }
    } else if ray.direction[axis] < 0.0 {
        while i > low && crossed(i) {
            i -= 1;
        }
        while i < high && !crossed(i + 1) {
            i += 1;
        }
    }
    i
}

#[cfg(test)]
mod tests {
    use supervol_format::random::Random;
    use supervol_format::{BrickLayout, Dims, Pyramid};

    use super::*;

    /// S26: walked intervals tile the chord, for any ray.
    #[test]
    fn cells_tile_every_chord() {
        let layout = BrickLayout::new(16).unwrap();
        let pyramid = Pyramid::new(Dims([31, 9, 50]), layout, &[[2, 1, 2], [2, 1, 2]]).unwrap();
        let mut numbers = Random::new(7);
        let mut random = || numbers.unit() - 0.5;
        for round in 0..2000 {
            let mut direction = [random(), random(), random()];
            if round % 5 < 3 {
                direction[round % 5] = [0.0, -0.0, 1e-30][round % 3];
            }
            let target = [3.0, 4.0, 7.0].map(|v| v + if round % 7 == 0 { 0.5 } else { random() });
            let origin = std::array::from_fn(|a| target[a] - 20.0 * direction[a]);
            let ray = AxisRay::new(&IndexRay { origin, direction });
            let level = &pyramid.levels()[round % 2];
            for planes in [Planes::of_cells(level), Planes::of_macro_cells(level)] {
                let cells = CellBox { low: [-1; 3], high: level.dims.0.map(|n| n as i64) };
                let (mut t, end) = (5.0, 35.0);
                let mut walk = GridWalk::new(&ray, planes, cells, t);
                let mut steps = 0;
                while t < end {
                    let exit = walk.exit().min(end);
                    assert!(exit >= t);
                    if exit > t {
                        let again = GridWalk::new(&ray, planes, cells, t);
                        assert_eq!((again.index, again.exits), (walk.index, walk.exits), "a walk can begin anywhere");
                        for (a, f) in planes.fractions(&ray, 0.5 * (t + exit), walk.index).into_iter().enumerate() {
                            let raw = (ray.coordinate(a, 0.5 * (t + exit)) - planes.first[a]) / planes.spacing[a];
                            let inside = cells.low[a] < walk.index[a] && walk.index[a] < cells.high[a];
                            let true_fraction = raw - walk.index[a] as f64;
                            assert!(!inside || (f - true_fraction).abs() < 1e-6, "{true_fraction}");
                        }
                    }
                    t = exit;
                    walk.advance(&ray);
                    steps += 1;
                    assert!(steps < 1000);
                }
            }
        }
    }
}
