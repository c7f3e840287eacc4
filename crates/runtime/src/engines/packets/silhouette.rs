//! Silhouette of a brick: its visible parts projected into the picture. Rays beside it skip the brick, all others begin
//! just in front of it.
//!
//! After polygon-assisted ray casting (Avila, Sobierajski, Kaufman 1992): visible blocks of cells are projected to a
//! rectangle of pixels and a range of depths each. The intersections of a tile's rays are looked up pixel by pixel.
//! This is done once for a brick and a camera, before packets are packed; leaping finds the same, ray by ray and leap
//! by leap. The skipped parts contribute nothing: no bit changes.
//!
//! Spaces: blocks lie in the brick's own coordinates ([`super::walk`]); depths are world lengths along the camera's
//! forward axis.

use glam::{DMat3, DVec3};
use supervol_format::Geometry;
use supervol_format::cast::{narrow, single, whole};
use supervol_format::space::HALF_VOXEL;
use supervol_scene::camera::{Camera, PixelRays, Projection};

use super::leap::ProximityCloud;
use super::simd::{Simd, Task};
use super::tile::{BrickGrid, TileRays};
use super::walk::BLOCK_SIDE;
use crate::engines::blocks::BLOCK;
use crate::engines::packets::places::{TILE_RAYS, TILE_SIDE, place_of};

/// Most boxes of a brick: if more blocks are visible, groups of eight are used.
const MOST_BOXES: usize = 512;
/// Divisor: greatest share of visible cubes. With more, rays miss little.
const SPARSE: usize = 3;
/// Margin around boxes, in cells: far more than the rounding of positions ([`super::walk::POSITION_ERROR`]).
const MARGIN: f64 = 1.0 / 64.0;
/// Least depth of a box, as a share of its greatest, that can be projected.
const LEAST_DEPTH: f64 = 1e-6;
/// Boxes that the processor handles at once.
const SIDE_BY_SIDE: usize = 16;
/// Pixels in a row of a tile, and of a block of rays.
const ROW: usize = TILE_SIDE as usize;
const BLOCK_ROW: usize = BLOCK_SIDE as usize;

/// Projection from index space to the camera's axes, and to pixels.
#[derive(Debug, Clone, Copy)]
pub struct Projector {
    /// Right, up and forward, as functions of index coordinates.
    to_view: DMat3,
    /// The index space's origin, relative to the eye.
    offset: DVec3,
    pixel_rays: PixelRays,
    is_perspective: bool,
}

/// Boxes of visible parts, projected into the picture.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Silhouette {
    boxes: Vec<Boxes>,
    /// Reference of all depths.
    depth: f64,
}

/// Several boxes side by side; unused ones are met by no ray.
#[derive(Debug, Clone, PartialEq)]
struct Boxes {
    /// First and last column of pixels, first and last row.
    edges: [[i32; SIDE_BY_SIDE]; 4],
    /// Least and greatest depth.
    depths: [[f32; SIDE_BY_SIDE]; 2],
}

impl Projector {
    /// The projector of a camera and a grid.
    #[must_use]
    pub fn new(camera: &Camera, geometry: &Geometry) -> Self {
        let axes = DMat3::from_cols(camera.right, camera.up, camera.forward).transpose();
        Self {
            to_view: axes * geometry.linear(),
            offset: axes * (DVec3::from_array(geometry.origin) - camera.eye),
            pixel_rays: camera.rays(),
            is_perspective: matches!(camera.projection, Projection::Perspective { .. }),
        }
    }

    /// Position of a brick's first voxel, and steps from voxel to voxel, in the camera's axes.
    fn steps_of(&self, grid: &BrickGrid) -> (DVec3, [DVec3; 3]) {
        let first: [f64; 3] =
            std::array::from_fn(|a| (grid.start[a] + HALF_VOXEL) / grid.inverse_scale[a] - HALF_VOXEL);
        let steps = [0, 1, 2].map(|a| self.to_view.col(a) / grid.inverse_scale[a]);
        (self.to_view * DVec3::from_array(first) + self.offset, steps)
    }
}

impl Silhouette {
    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of::<Boxes>() * self.boxes.capacity()) as u64
    }

    /// Most bytes held for a brick with `core` core voxels along each axis.
    #[must_use]
    pub fn most_bytes(core: usize) -> u64 {
        let most_boxes = (core.div_ceil(BLOCK).pow(3) / SPARSE).min(MOST_BOXES);
        (size_of::<Self>() + size_of::<Boxes>() * most_boxes.div_ceil(SIDE_BY_SIDE)) as u64
    }

    /// Empty, with room for `count` boxes.
    fn new(count: usize, depth: f64) -> Self {
        let none = Boxes { edges: [[i32::MAX; SIDE_BY_SIDE]; 4], depths: [[0.0; SIDE_BY_SIDE]; 2] };
        Self { boxes: vec![none; count.div_ceil(SIDE_BY_SIDE)], depth }
    }

    #[inline(always)]
    fn set(&mut self, number: usize, [columns, rows]: [[f64; 2]; 2], depths: [f64; 2]) {
        let (boxes, i) = (&mut self.boxes[number / SIDE_BY_SIDE], number % SIDE_BY_SIDE);
        // Pixels whose centres lie inside; casts saturate.
        let edges = [columns[0].ceil(), columns[1].floor(), rows[0].ceil(), rows[1].floor()];
        (0..4).for_each(|edge| boxes.edges[edge][i] = whole::<i32>(edges[edge]));
        (0..2).for_each(|end| boxes.depths[end][i] = single(depths[end]));
    }
}

/// The visible cubes and their side in cells; `None` if there are too many for it to pay.
fn cubes_that_show(cloud: &ProximityCloud<BLOCK>) -> Option<(f64, Vec<[usize; 3]>)> {
    let shown = cloud.cubes() - cloud.hidden;
    if SPARSE * shown > cloud.cubes() {
        return None;
    }
    let [nx, ny, _] = cloud.cells;
    let blocks = cloud.distances[..cloud.cubes()].iter().enumerate().filter(|(_, distance)| **distance == 0);
    let mut cubes: Vec<[usize; 3]> = blocks.map(|(i, _)| [i % nx, i / nx % ny, i / (nx * ny)]).collect();
    let mut side = BLOCK;
    while cubes.len() > MOST_BOXES {
        side *= 2;
        for cube in &mut cubes {
            *cube = cube.map(|n| n / 2);
        }
        cubes.sort_unstable();
        cubes.dedup();
    }
    Some((side as f64, cubes))
}

/// Projects the visible parts of a brick.
pub struct MakeSilhouette<'a> {
    /// The projection.
    pub projector: &'a Projector,
    /// The grid of the brick.
    pub grid: &'a BrickGrid,
    /// The cloud of its visible parts.
    pub cloud: &'a ProximityCloud<BLOCK>,
}

impl Task for MakeSilhouette<'_> {
    type Output = Option<Silhouette>;

    #[inline(always)]
    fn run<S: Simd>(self) -> Option<Silhouette> {
        let (side, cubes) = cubes_that_show(self.cloud)?;
        let (first, steps) = self.projector.steps_of(self.grid);
        let mut silhouette = Silhouette::new(cubes.len(), first.z);
        for (number, cube) in cubes.into_iter().enumerate() {
            // Cell -1 belongs to the first cube.
            let low = cube.map(|n| if n == 0 { -1.0 } else { n as f64 * side } - MARGIN);
            let high = cube.map(|n| (n + 1) as f64 * side + MARGIN);
            let (mut view, mut depths) = ([[0.0; 8]; 2], [0.0; 8]);
            for corner in 0..8 {
                let ends: [f64; 3] = std::array::from_fn(|a| if corner >> a & 1 == 0 { low[a] } else { high[a] });
                let along =
                    |axis: usize| steps[0][axis] * ends[0] + steps[1][axis] * ends[1] + steps[2][axis] * ends[2];
                (view[0][corner], view[1][corner]) = (first.x + along(0), first.y + along(1));
                depths[corner] = along(2);
            }
            let depths_of_corners = depths.map(|depth| first.z + depth);
            let depths = range(&depths);
            if self.projector.is_perspective {
                let [nearest, farthest] = range(&depths_of_corners);
                if nearest <= LEAST_DEPTH * farthest.abs() {
                    // In or beside the eye's plane: may be anywhere.
                    silhouette.set(number, [[f64::NEG_INFINITY, f64::INFINITY]; 2], [f64::NEG_INFINITY, f64::INFINITY]);
                    continue;
                }
                for corner in 0..8 {
                    let per_depth = depths_of_corners[corner].recip();
                    (view[0][corner], view[1][corner]) = (view[0][corner] * per_depth, view[1][corner] * per_depth);
                }
            }
            let ([left, right], [below, above]) = (range(&view[0]), range(&view[1]));
            let pixels = [[left, above], [right, below]].map(|place| self.projector.pixel_rays.pixel_at(place));
            silhouette.set(number, [0, 1].map(|a| [pixels[0][a], pixels[1][a]]), depths);
        }
        Some(silhouette)
    }
}

/// Least and greatest number.
#[inline(always)]
fn range(numbers: &[f64; 8]) -> [f64; 2] {
    numbers.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &n| {
        [if n < low { n } else { low }, if n > high { n } else { high }]
    })
}

/// Drops the rays of a tile that meet nothing visible; the others begin just in front of the visible part and end just
/// behind it.
pub struct MeetSilhouette<'a> {
    /// Silhouette of the brick that the rays have entered.
    pub silhouette: &'a Silhouette,
    /// The projection that was used for it.
    pub projector: &'a Projector,
    /// The tile's first pixel, in the whole picture.
    pub corner: [u32; 2],
    /// The tile's rays.
    pub rays: &'a mut TileRays,
}

impl Task for MeetSilhouette<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let Self { silhouette, projector, corner, rays } = self;
        let corner = corner.map(|n| i32::try_from(n).unwrap_or(i32::MAX));
        let last = corner.map(|n| n.saturating_add(narrow::<i32>(TILE_SIDE) - 1));
        let mut pixels = DepthsOfPixels { near: [[f32::INFINITY; ROW]; ROW], far: [[f32::NEG_INFINITY; ROW]; ROW] };
        let mut is_met = false;
        for boxes in &silhouette.boxes {
            let [left, right, top, bottom] = &boxes.edges;
            let mut meets = [0u8; SIDE_BY_SIDE];
            for i in 0..SIDE_BY_SIDE {
                let [x, y] =
                    [(left[i] <= last[0]) & (right[i] >= corner[0]), (top[i] <= last[1]) & (bottom[i] >= corner[1])];
                meets[i] = u8::from(x & y);
            }
            if meets == [0; SIDE_BY_SIDE] {
                continue;
            }
            is_met = true;
            for i in (0..SIDE_BY_SIDE).filter(|&i| meets[i] != 0) {
                let in_tile =
                    |n: i32, axis: usize| n.saturating_sub(corner[axis]).clamp(0, narrow::<i32>(TILE_SIDE) - 1);
                let columns = [left[i], right[i]].map(|n| in_tile(n, 0));
                let rows = [top[i], bottom[i]].map(|n| narrow::<usize>(in_tile(n, 1)));
                pixels.add(columns, rows, boxes.depths.map(|depths| depths[i]));
            }
        }
        if !is_met {
            rays.set_hits(&[]);
            return;
        }
        let forward = projector.to_view.row(2).to_array();
        let depth = silhouette.depth - projector.offset.z;
        rays.keep_between(forward, depth, &pixels.of_rays());
    }
}

/// Least and greatest depth of visible parts behind each pixel of a tile, row by row; the least is greater if there is
/// nothing.
struct DepthsOfPixels {
    near: [[f32; ROW]; ROW],
    far: [[f32; ROW]; ROW],
}

impl DepthsOfPixels {
    #[inline(always)]
    fn add(&mut self, [left, right]: [i32; 2], [top, bottom]: [usize; 2], [near, far]: [f32; 2]) {
        let is_inside: [bool; ROW] = std::array::from_fn(|x| (left <= narrow::<i32>(x)) & (narrow::<i32>(x) <= right));
        for y in top..=bottom {
            for (x, &is_inside) in is_inside.iter().enumerate() {
                let (n, f) = (&mut self.near[y][x], &mut self.far[y][x]);
                *n = if is_inside & (near < *n) { near } else { *n };
                *f = if is_inside & (far > *f) { far } else { *f };
            }
        }
    }

    /// The same in the order of rays.
    #[inline(always)]
    fn of_rays(&self) -> [[f32; TILE_RAYS]; 2] {
        let mut out = [[0.0; TILE_RAYS]; 2];
        // A row of a block of rays is a row of pixels in the picture.
        for first in (0..TILE_RAYS).step_by(BLOCK_ROW) {
            let [x, y] = place_of(first).map(|n| n as usize);
            out[0][first..first + BLOCK_ROW].copy_from_slice(&self.near[y][x..x + BLOCK_ROW]);
            out[1][first..first + BLOCK_ROW].copy_from_slice(&self.far[y][x..x + BLOCK_ROW]);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::Dims;
    use supervol_format::random::Random;
    use supervol_scene::clip::{Clip, ToIndex, cut, slab};

    use super::super::begin::MakeRays;
    use super::super::leap::AxisDirection;
    use super::super::simd::{InstructionSet, dispatch};
    use super::super::tile::IndexBox;
    use super::*;

    /// Blocks along an edge of the brick, and its first voxel.
    const BLOCKS: [usize; 3] = [16, 12, 9];
    const START: [f64; 3] = [64.0, 128.0, 64.0];

    struct Brick {
        shown: Vec<bool>,
        grid: BrickGrid,
        silhouette: Silhouette,
    }

    fn brick_of(shown: Vec<bool>, projector: &Projector, set: InstructionSet, scale: f64) -> Brick {
        let cloud = ProximityCloud::<BLOCK>::of_shown(BLOCKS, [AxisDirection::Both; 3], shown.iter().copied());
        let grid = BrickGrid { inverse_scale: [1.0 / scale; 3], start: START };
        let made = dispatch(set, MakeSilhouette { projector, grid: &grid, cloud: &cloud });
        Brick { shown, grid, silhouette: made.expect("few blocks show") }
    }

    impl Brick {
        /// Entry into and exit from the visible parts on a ray; `None` if it meets nothing.
        fn met(&self, origin: [f64; 3], direction: [f64; 3], way: [f64; 2]) -> Option<[f64; 2]> {
            let side = BLOCK as f64;
            let in_block = |i: usize| {
                let block = [i % BLOCKS[0], i / BLOCKS[0] % BLOCKS[1], i / (BLOCKS[0] * BLOCKS[1])];
                let chord = (0..3).fold((way[0], way[1]), |chord, a| {
                    let low = if block[a] == 0 { -1.0 } else { block[a] as f64 * side };
                    let ends = [low, (block[a] + 1) as f64 * side];
                    let in_index = |n: f64| (n + START[a] + HALF_VOXEL) / self.grid.inverse_scale[a] - HALF_VOXEL;
                    cut(chord, slab(origin[a], direction[a], ends.map(in_index)))
                });
                (chord.0 < chord.1).then_some([chord.0, chord.1])
            };
            let chords = (0..self.shown.len()).filter(|&i| self.shown[i]).filter_map(in_block);
            chords.reduce(|all, chord| [all[0].min(chord[0]), all[1].max(chord[1])])
        }
    }

    fn camera_of(case: usize, unit: &mut impl FnMut() -> f64) -> Camera {
        let middle = DVec3::new(90.0, 150.0, 80.0);
        let away = [200.0, 60.0, 10.0][case % 3];
        let eye = middle + away * DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5);
        let projection = match case % 2 {
            0 => Projection::Orthographic { height: 70.0 },
            _ => Projection::Perspective { fov_y: 35.0 },
        };
        Camera::look_at(eye, middle, DVec3::Z, projection, [64, 48]).expect("a camera")
    }

    /// Rays that meet visible parts are kept, from before to behind them, with the eye far away, near, or inside. Most
    /// other rays are dropped if the eye is not inside.
    #[test]
    fn rays_that_meet_what_shows_are_kept_from_before_to_behind() {
        let mut random = Random::new(77);
        let (mut kept, mut missing, mut left_out) = (0, 0, 0);
        let sets: Vec<InstructionSet> = InstructionSet::available().collect();
        for case in 0..96 {
            let geometry = Geometry { spacing: [0.5 + random.unit(), 1.0, 0.8], ..Geometry::IDENTITY };
            let camera = camera_of(case, &mut || random.unit());
            let (projector, to_index) = (Projector::new(&camera, &geometry), ToIndex::new(&geometry));
            // A few blocks, or more of them than boxes, which are then grouped by eight.
            let most = if case % 5 == 0 { 30.0 } else { 0.5 };
            let shown = (0..BLOCKS.iter().product()).map(|_| 100.0 * random.unit() < most);
            let set = sets[case % sets.len()];
            let mut shown: Vec<bool> = shown.collect();
            shown[0] = true;
            let brick = brick_of(shown, &projector, set, [1.0, 0.5][case / 2 % 2]);
            let corner = [16 * (case as u32 % 4), 16 * (case as u32 % 3)];
            let mut rays = TileRays::new();
            let (pixel_rays, clip, dims) = (&camera.rays(), &Clip::default(), Dims([400; 3]));
            let (to_index, way) = (&to_index, IndexBox { low: [-0.5; 3], high: [399.5; 3] });
            dispatch(set, MakeRays { pixel_rays, to_index, clip, dims, corner, rays: &mut rays });
            rays.enter(&way);
            let hits = rays.hits().to_vec();
            let ways: Vec<[f64; 2]> = hits.iter().map(|&ray| rays.interval(ray)).collect();
            let (silhouette, projector) = (&brick.silhouette, &projector);
            dispatch(set, MeetSilhouette { silhouette, projector, corner, rays: &mut rays });
            for (&ray, way) in hits.iter().zip(ways) {
                let index_ray = rays.index_ray(ray);
                let is_kept = rays.hits().contains(&ray);
                let Some([from, to]) = brick.met(index_ray.origin, index_ray.direction, way) else {
                    (missing, left_out) = (missing + 1, left_out + u32::from(!is_kept));
                    continue;
                };
                assert!(is_kept, "case {case}: ray {ray} meets what shows from {from} to {to}");
                let [entry, exit] = rays.interval(ray);
                let start = entry + f64::from(rays.start[usize::from(ray)]);
                assert!(start <= from && to <= exit, "case {case}, ray {ray}: {start} to {exit} for {from} to {to}");
                kept += 1;
            }
        }
        assert!(kept > 1_000 && left_out > 1_000, "{kept} kept, {left_out} left out");
        assert!(2 * left_out > missing, "only {left_out} of {missing} rays that meet nothing are left out");
    }

    #[test]
    fn there_are_no_silhouettes_of_what_shows_nearly_everywhere() {
        let cloud = |shows: fn(usize) -> bool| {
            ProximityCloud::<BLOCK>::of_shown([16; 3], [AxisDirection::Both; 3], (0..4096).map(shows))
        };
        assert_eq!(cubes_that_show(&cloud(|i| i % 2 == 0)), None);
        let (side, cubes) = cubes_that_show(&cloud(|i| i % 4 == 0)).expect("a quarter shows");
        assert_eq!(
            (side, cubes.len()),
            (2.0 * BLOCK as f64, 4 * 8 * 8),
            "one of four along x, so one of two by eights"
        );
        let (side, cubes) = cubes_that_show(&cloud(|i| i == 17)).expect("one block shows");
        assert_eq!((side, cubes), (BLOCK as f64, vec![[1, 1, 0]]));
        let full = Silhouette::new(MOST_BOXES, 0.0);
        assert_eq!(full.bytes(), Silhouette::most_bytes(64));
        let (_, cubes) = cubes_that_show(&ProximityCloud::<BLOCK>::of_shown(
            [4; 3],
            [AxisDirection::Both; 3],
            (0..64).map(|i| i % 3 == 1),
        ))
        .expect("a third shows");
        assert_eq!(Silhouette::new(cubes.len(), 0.0).bytes(), Silhouette::most_bytes(4 * BLOCK));
    }
}
