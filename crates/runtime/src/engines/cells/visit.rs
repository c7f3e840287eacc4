//! One ray's visit to one brick: macro cell by macro cell, and access to its voxels.
//!
//! Indices of macro cells and trilinear cells count in the grids of the brick's level. The offset in the voxel array is
//! computed once for a cell ([`BrickVisit::base`]); neighbours are relative to it.

use glam::Vec3;
use supervol_format::BrickKey;
use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::narrow;
use supervol_scene::clip::Segment;
use supervol_scene::scene::Mode;
use supervol_scene::transfer_function::RenderTransferFunction;
use supervol_scene::value_map::ValueMap;

use super::integrator::Integrator;
use super::modes::ShadeSetup;
use super::walk::{AxisRay, CellBox, GridWalk, Planes};
use crate::engines::ray::RayState;
use crate::engines::ray_scene::RayScene;
use crate::stream::classify::Skipping;
use crate::stream::counters::RayCounters;
use crate::stream::residency::{DecodedBrick, Voxels};

/// A voxel in its stored form.
pub trait StoredVoxel: Copy {
    /// Render value; NaN where absent.
    fn render_value(self, map: &ValueMap) -> f32;

    /// Data value; NaN where absent.
    fn data_value(self, map: &ValueMap) -> f64;
}

impl StoredVoxel for u8 {
    #[inline]
    fn render_value(self, map: &ValueMap) -> f32 {
        if map.absent == Some(u16::from(self)) { f32::NAN } else { map.from_stored_number(f32::from(self)) }
    }

    #[inline]
    fn data_value(self, map: &ValueMap) -> f64 {
        if map.absent == Some(u16::from(self)) { f64::NAN } else { map.data_of_stored(f64::from(self)) }
    }
}

impl StoredVoxel for u16 {
    #[inline]
    fn render_value(self, map: &ValueMap) -> f32 {
        if map.absent == Some(self) { f32::NAN } else { map.from_stored_number(f32::from(self)) }
    }

    #[inline]
    fn data_value(self, map: &ValueMap) -> f64 {
        if map.absent == Some(self) { f64::NAN } else { map.data_of_stored(f64::from(self)) }
    }
}

impl StoredVoxel for f32 {
    #[inline]
    fn render_value(self, _map: &ValueMap) -> f32 {
        self
    }

    #[inline]
    fn data_value(self, map: &ValueMap) -> f64 {
        map.to_data(self)
    }
}

/// The trilinear cells that a macro cell meets. Cell c lies between voxels c and c + 1, so they run from one voxel
/// before the macro cell's first to its last.
#[inline]
#[must_use]
pub fn cells_of_macro_cell(index: [i64; 3]) -> CellBox {
    let low = index.map(|m| m * narrow::<i64>(MACRO_CELL) - 1);
    CellBox { low, high: low.map(|v| v + narrow::<i64>(MACRO_CELL)) }
}

/// A ray in the form for the scalar caster.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CastRay {
    pub(crate) axis_ray: AxisRay,
    /// Minus the ray's direction.
    pub(crate) to_eye: Vec3,
    pub(crate) segment: Segment,
    pub(crate) pixel: [u32; 2],
}

/// One ray at one level: data shared by all its bricks there.
#[derive(Debug)]
pub struct LevelVisit<'a> {
    pub(crate) scene: &'a RayScene,
    pub(crate) axis_ray: &'a AxisRay,
    pub(crate) setup: ShadeSetup<'a>,
    segment: Segment,
    pixel: [u32; 2],
}

impl<'a> LevelVisit<'a> {
    /// A ray at the level of this brick.
    pub(crate) fn new(scene: &'a RayScene, ray: &'a CastRay, key: BrickKey) -> Self {
        let lighting = scene.lighting.as_ref();
        let scale = scene.pyramid.level_at(key.lod()).scale;
        let world_from_level_gradient =
            lighting.map_or(glam::Mat3::IDENTITY, |lighting| lighting.world_from_level_gradient(scale));
        let setup = ShadeSetup { lighting, world_from_level_gradient, to_eye: ray.to_eye };
        Self { scene, axis_ray: &ray.axis_ray, setup, segment: ray.segment, pixel: ray.pixel }
    }

    /// The frame's transfer function, over render values.
    #[inline]
    #[must_use]
    pub fn transfer_function(&self) -> &'a RenderTransferFunction {
        &self.scene.transfer_function
    }

    /// Map from stored numbers to render values, and from these to data values.
    #[inline]
    #[must_use]
    pub fn map(&self) -> &'a ValueMap {
        &self.scene.map
    }

    /// Shading at this level.
    #[inline]
    #[must_use]
    pub fn shade_setup(&self) -> &ShadeSetup<'a> {
        &self.setup
    }

    /// The drawn part of the ray, world lengths from its origin.
    #[inline]
    #[must_use]
    pub fn segment(&self) -> Segment {
        self.segment
    }

    /// Column and row of the ray, from the top left; in rays, not in pixels of a supersampled picture.
    #[inline]
    #[must_use]
    pub fn pixel(&self) -> [u32; 2] {
        self.pixel
    }

    /// Whether nothing behind can change the picture by more than the frame allows.
    #[inline]
    #[must_use]
    pub fn is_done(&self, state: &RayState) -> bool {
        self.scene.is_done(state)
    }
}

/// One ray's visit to one brick.
#[derive(Debug)]
pub struct BrickVisit<'a> {
    pub(crate) level: LevelVisit<'a>,
    brick: &'a DecodedBrick,
    macro_planes: Planes,
    pub(crate) cell_planes: Planes,
    /// Macro cells of the brick, indices in the level's grid of macro cells.
    macro_cells: CellBox,
    /// First core voxel of the brick, level coordinates.
    start: [i64; 3],
    /// Distance between neighbours along y and z in the voxel array.
    strides: [usize; 2],
}

impl<'a> BrickVisit<'a> {
    /// # Panics
    /// If the brick's size does not match the pyramid.
    pub(crate) fn new(level: LevelVisit<'a>, brick: &'a DecodedBrick, key: BrickKey) -> Self {
        let pyramid = &level.scene.pyramid;
        let core = pyramid.core_box(key);
        let extent = brick.extent.map(|n| n as usize);
        assert_eq!(extent, core.extent().map(|n| n + 2 * APRON), "stored extent of {key}");
        let start = core.start.map(narrow::<i64>);
        let low = start.map(|s| s / narrow::<i64>(MACRO_CELL));
        let counts = core.extent().map(|n| narrow::<i64>(n.div_ceil(MACRO_CELL)));
        let planes = pyramid.level_at(key.lod());
        Self {
            brick,
            macro_planes: Planes::of_macro_cells(planes),
            cell_planes: Planes::of_cells(planes),
            macro_cells: CellBox { low, high: std::array::from_fn(|a| low[a] + counts[a] - 1) },
            start,
            strides: [extent[0], extent[0] * extent[1]],
            level,
        }
    }

    /// Gathers from `state.t` to `exit`; does not change `state.t`.
    pub(crate) fn march(
        &self,
        exit: f64,
        integrator: &dyn Integrator,
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        let (scene, ray) = (self.level.scene, self.level.axis_ray);
        let mut t = state.t;
        let mut walk = GridWalk::new(ray, self.macro_planes, self.macro_cells, t);
        while t < exit {
            let macro_exit = walk.exit().min(exit);
            if macro_exit > t {
                if scene.skipping == Skipping::On && self.skips(self.macro_range(walk.index), state) {
                    counters.macro_cells_skipped += 1;
                } else {
                    counters.macro_cells += 1;
                    integrator.gather_macro_cell(self, walk.index, [t, macro_exit], state, counters);
                }
                if scene.is_done(state) {
                    return;
                }
            }
            t = macro_exit;
            walk.advance(ray);
        }
    }

    /// Calls `gather` for each macro cell that the ray crosses in a part of it, with its place in the brick, until it returns
    /// `false`.
    pub(crate) fn for_each_macro_cell(
        &self,
        [mut t, exit]: [f64; 2],
        mut gather: impl FnMut([i64; 3], [usize; 3], [f64; 2]) -> bool,
    ) {
        let ray = self.level.axis_ray;
        let mut walk = GridWalk::new(ray, self.macro_planes, self.macro_cells, t);
        while t < exit {
            let macro_exit = walk.exit().min(exit);
            let place = std::array::from_fn(|a| narrow::<usize>(walk.index[a] - self.macro_cells.low[a]));
            if macro_exit > t && !gather(walk.index, place, [t, macro_exit]) {
                return;
            }
            t = macro_exit;
            walk.advance(ray);
        }
    }

    /// The place in the brick of a trilinear cell that one of its macro cells meets: 0 for the cell that begins one voxel before
    /// the core.
    pub(crate) fn place_of_cell(&self, cell: [i64; 3]) -> [usize; 3] {
        std::array::from_fn(|a| narrow::<usize>(cell[a] - self.start[a] + 1))
    }

    /// Calls `gather` for each trilinear cell that the ray crosses in a macro cell, with the part of `t` in it, until it returns `false`.
    #[inline]
    pub(crate) fn for_each_cell(
        &self,
        macro_cell: [i64; 3],
        [mut t, exit]: [f64; 2],
        mut gather: impl FnMut([i64; 3], [f64; 2]) -> bool,
    ) {
        let ray = self.level.axis_ray;
        let mut walk = GridWalk::new(ray, self.cell_planes, cells_of_macro_cell(macro_cell), t);
        while t < exit {
            let cell_exit = walk.exit().min(exit);
            if cell_exit > t && !gather(walk.index, [t, cell_exit]) {
                return;
            }
            t = cell_exit;
            walk.advance(ray);
        }
    }

    #[inline]
    fn macro_range(&self, index: [i64; 3]) -> [f32; 2] {
        let [x, y, z] = [0, 1, 2].map(|a| narrow::<usize>(index[a] - self.macro_cells.low[a]));
        let [nx, ny] = [0, 1].map(|a| narrow::<usize>(self.macro_cells.high[a] - self.macro_cells.low[a] + 1));
        self.brick.macro_ranges[x + nx * (y + ny * z)]
    }

    /// Whether a macro cell with this range cannot change the ray; updates the sides for `iso`.
    #[inline]
    fn skips(&self, [low, high]: [f32; 2], state: &mut RayState) -> bool {
        let scene = self.level.scene;
        if low > high {
            state.iso.known = 0;
            return true;
        }
        // The range is that of render values.
        let off = || f64::from(scene.map.distance_from_data(low.abs().max(high.abs())));
        match scene.mode {
            Mode::Dvr => !scene.transfer_function.is_visible(low, high),
            Mode::Mip => f64::from(high) + off() <= state.value,
            Mode::Minip => f64::from(low) - off() >= state.value,
            Mode::Iso => state.iso.pass([low, high], scene.iso.iter().map(|surface| surface.value)),
            Mode::Mean | Mode::Slice => false,
        }
    }

    /// The ray at the brick's level.
    #[inline]
    #[must_use]
    pub fn level(&self) -> &LevelVisit<'a> {
        &self.level
    }

    /// The brick's voxels. Integrators match their type once for a macro cell, and read through a [`StoredVoxel`].
    #[inline]
    #[must_use]
    pub fn voxels(&self) -> &'a Voxels {
        &self.brick.voxels
    }

    /// The cell in `cells` that t lies in, and the fractions there, in [0, 1].
    #[inline]
    #[must_use]
    pub fn cell_at(&self, cells: &CellBox, t: f64) -> ([i64; 3], [f64; 3]) {
        self.cell_planes.cell_at(self.level.axis_ray, t, cells)
    }

    /// Distances between neighbours along x, y and z in the voxel array.
    pub(crate) fn steps(&self) -> [usize; 3] {
        [1, self.strides[0], self.strides[1]]
    }

    /// Offset of the first corner of a trilinear cell in the voxel array.
    #[inline]
    #[must_use]
    pub fn base(&self, cell: [i64; 3]) -> usize {
        let [x, y, z] = [0, 1, 2].map(|axis| narrow::<usize>(cell[axis] - self.start[axis] + narrow::<i64>(APRON)));
        x + self.strides[0] * y + self.strides[1] * z
    }

    /// The trilinear cell whose first corner has this offset in the voxel array.
    fn cell_at_base(&self, base: usize) -> [i64; 3] {
        let inside = [base % self.strides[0], base % self.strides[1] / self.strides[0], base / self.strides[1]];
        std::array::from_fn(|axis| self.start[axis] + narrow::<i64>(inside[axis]) - narrow::<i64>(APRON))
    }

    /// The cell whose first corner lies `base` voxels from the brick's first, and the part in it of a ray's interval `t`.
    pub(crate) fn chord_at_base(&self, base: usize, t: [f64; 2]) -> ([i64; 3], [f64; 2]) {
        let index = self.cell_at_base(base);
        (index, self.cell_planes.chord(self.level.axis_ray, index, t))
    }

    /// Render value of the voxel at an offset from `base`; NaN if absent.
    ///
    /// # Panics
    /// If `voxels` are not the brick's. Offsets reach from -1 to 2 for cells that a macro cell meets.
    #[inline]
    #[must_use]
    pub fn value<T: StoredVoxel>(&self, voxels: &[T], base: usize, offset: [i32; 3]) -> f32 {
        let [dx, dy, dz] = offset.map(|o| o as isize);
        let at =
            narrow::<isize>(base) + dx + dy * narrow::<isize>(self.strides[0]) + dz * narrow::<isize>(self.strides[1]);
        voxels[narrow::<usize>(at)].render_value(&self.level.scene.map)
    }

    /// Render values at the eight corners of the cell at `base`, x fastest; NaN if absent.
    ///
    /// # Panics
    /// If `voxels` are not the brick's.
    #[inline]
    #[must_use]
    pub fn corners<T: StoredVoxel>(&self, voxels: &[T], base: usize) -> [f32; 8] {
        let map = &self.level.scene.map;
        self.corner_voxels(base).map(|voxel| voxels[voxel].render_value(map))
    }

    /// Data values at the eight corners of the cell at `base`, x fastest, without the rounding of render values; NaN if absent.
    ///
    /// # Panics
    /// As [`Self::corners`].
    #[must_use]
    pub fn data_corners<T: StoredVoxel>(&self, voxels: &[T], base: usize) -> [f64; 8] {
        let map = &self.level.scene.map;
        self.corner_voxels(base).map(|voxel| {
            let value = voxels[voxel].data_value(map);
            match &self.brick.unrounded {
                Some(unrounded) if !value.is_nan() => unrounded.data_value(voxel, map),
                _ => value,
            }
        })
    }

    /// Places in the brick's array of the eight corners of the cell whose first one is `base`.
    #[inline]
    pub(crate) fn corner_voxels(&self, base: usize) -> [usize; 8] {
        let [dy, dz] = self.strides;
        let rows = [base, base + dy, base + dz, base + dy + dz];
        [rows[0], rows[0] + 1, rows[1], rows[1] + 1, rows[2], rows[2] + 1, rows[3], rows[3] + 1]
    }

    /// Central differences at the eight corners, index space of the level, `[axis][corner]`; NaN if a tap is absent.
    ///
    /// # Panics
    /// If `voxels` are not the brick's.
    #[inline]
    #[must_use]
    pub fn gradient_corners<T: StoredVoxel>(&self, voxels: &[T], base: usize) -> [[f32; 8]; 3] {
        self.steps().map(|step| {
            let after = self.corners(voxels, base + step);
            let before = self.corners(voxels, base - step);
            std::array::from_fn(|corner| 0.5 * (after[corner] - before[corner]))
        })
    }
}
