//! One ray through the resident bricks: brick by brick, macro cell by macro cell, trilinear cell by trilinear cell.

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::{BrickIndex, BrickKey, Level, Lod};

use super::cell::{Cell, cubic_of_cell};
use super::modes::{
    Chord, ShadeSetup, TERMINATION_OPACITY, gather_dvr, gather_iso, gather_mean, gather_minip, gather_mip,
};
use super::shade::ChordGradient;
use super::walk::{AxisRay, CellBox, GridWalk, Planes};
use super::{BlockFeedback, Counters, CpuFrame, RayState, Skipping};
use crate::camera::Ray;
use crate::clip::IndexRay;
use crate::raycast::volume::{BrickView, DecodedBrick, Resident, ValueMap, Voxels};
use crate::scene::Mode;

/// What a ray does with the parts of bricks that may show something. All else is the same for every method.
pub(crate) trait Integrator {
    /// Gathers over `t`, which lies in the macro cell `index` of the visited brick.
    fn gather_macro_cell<T: StoredVoxel>(
        &self,
        visit: &BrickVisit<'_>,
        voxels: &[T],
        index: [i64; 3],
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut Counters,
    );

    /// Gathers over `t`, where every voxel has the render value `value`.
    fn gather_uniform(
        &self,
        frame: &CpuFrame,
        setup: &ShadeSetup<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut Counters,
    );
}

/// Trilinear cell by trilinear cell: the method that users get.
pub(crate) struct CellByCell;

impl Integrator for CellByCell {
    fn gather_macro_cell<T: StoredVoxel>(
        &self,
        visit: &BrickVisit<'_>,
        voxels: &[T],
        index: [i64; 3],
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut Counters,
    ) {
        visit.march_macro_cell(voxels, index, t, state, counters);
    }

    fn gather_uniform(
        &self,
        frame: &CpuFrame,
        setup: &ShadeSetup<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut Counters,
    ) {
        counters.cells += 1;
        gather(frame, setup, &Chord::uniform(value, t[1] - t[0]), state, counters);
    }
}

/// Casts one ray until it is finished or waits.
pub(crate) fn cast_ray<V: BrickView + ?Sized, I: Integrator>(
    view: &V,
    frame: &CpuFrame,
    ray: &Ray,
    integrator: &I,
    state: &mut RayState,
    feedback: &mut BlockFeedback,
) {
    let axis_ray = AxisRay::new(&IndexRay::new(ray, &frame.geometry));
    let to_eye = -ray.direction.as_vec3();
    state.waiting = None;
    let mut last_used = None;
    while state.t < state.t_end && !is_done(frame, state) {
        let (key, resident, exit) = resident_at(view, frame, &axis_ray, state.t, &mut feedback.counters);
        let exit = exit.min(state.t_end);
        if !matches!(resident, Resident::Missing) && last_used != Some(key) {
            feedback.uses.insert(key);
            last_used = Some(key);
        }
        feedback.counters.bricks += 1;
        match resident {
            Resident::Missing => {
                state.waiting = Some(key);
                let entry = feedback.misses.entry(key).or_insert((0, f64::INFINITY));
                *entry = (entry.0 + 1, entry.1.min(state.t));
                feedback.counters.rays_waiting += 1;
                return;
            }
            Resident::Brick(brick) => {
                let visit = BrickVisit::new(frame, &axis_ray, to_eye, brick, key);
                match &brick.voxels {
                    Voxels::U8(voxels) => visit.march(voxels, exit, integrator, state, &mut feedback.counters),
                    Voxels::U16(voxels) => visit.march(voxels, exit, integrator, state, &mut feedback.counters),
                    Voxels::F32(voxels) => visit.march(voxels, exit, integrator, state, &mut feedback.counters),
                }
            }
            Resident::Uniform(value) => {
                let setup = shade_setup(frame, frame.pyramid.level_at(key.lod()), to_eye);
                let t = [state.t, exit];
                integrator.gather_uniform(frame, &setup, value, t, state, &mut feedback.counters);
            }
            Resident::Nothing | Resident::Vanished | Resident::UseParent => state.iso.known = 0,
        }
        state.t = exit;
    }
    state.finished = true;
    feedback.counters.rays_finished += 1;
}

/// Whether nothing behind can change the picture by more than the method allows.
pub(crate) fn is_done(frame: &CpuFrame, state: &RayState) -> bool {
    match frame.mode {
        Mode::Dvr => state.transmittance <= 1.0 - frame.method.termination_opacity(),
        Mode::Iso => {
            state.transmittance <= 1.0 - TERMINATION_OPACITY || state.iso.hit.count_ones() as usize == frame.iso.len()
        }
        Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => false,
    }
}

/// What is resident at t, at the level that is fine enough there; and the t at which the ray leaves it.
fn resident_at<'v, V: BrickView + ?Sized>(
    view: &'v V,
    frame: &CpuFrame,
    ray: &AxisRay,
    t: f64,
    counters: &mut Counters,
) -> (BrickKey, Resident<'v>, f64) {
    let mut lod = frame.first_lod;
    loop {
        let (wanted, exit) = brick_at(frame, ray, t, lod);
        let (key, resident) = resident_or_parent(view, frame, wanted, counters);
        let goes_on_beneath = matches!(resident, Resident::Vanished) && key == wanted && wanted.lod() > Lod::FINEST;
        if !goes_on_beneath {
            return (key, resident, exit);
        }
        lod = Lod(wanted.lod().0 - 1);
    }
}

/// The brick that t lies in at the level that is fine enough there, from `lod` on, and the t at which the ray leaves it.
fn brick_at(frame: &CpuFrame, ray: &AxisRay, t: f64, mut lod: Lod) -> (BrickKey, f64) {
    let core = frame.pyramid.layout().core();
    loop {
        let level = frame.pyramid.level_at(lod);
        let bricks = CellBox { low: [0; 3], high: level.bricks.map(|n| i64::from(n) - 1) };
        let walk = GridWalk::new(ray, Planes::of_bricks(level, core), bricks, t);
        let key = BrickKey::new(lod, BrickIndex(walk.index.map(|i| i as u32)));
        if frame.lod.is_fine_enough(&frame.pyramid, key) {
            return (key, walk.exit());
        }
        lod = Lod(lod.0 - 1);
    }
}

/// What is resident under a key; where a brick has failed, what is under its nearest ancestor that has not.
fn resident_or_parent<'v, V: BrickView + ?Sized>(
    view: &'v V,
    frame: &CpuFrame,
    mut key: BrickKey,
    counters: &mut Counters,
) -> (BrickKey, Resident<'v>) {
    loop {
        let resident = view.lookup(key);
        match (resident, frame.pyramid.parent(key)) {
            (Resident::UseParent, Some(parent)) => {
                counters.parent_bricks += 1;
                key = parent;
            }
            _ => return (key, resident),
        }
    }
}

fn shade_setup<'f>(frame: &'f CpuFrame, level: &Level, to_eye: glam::Vec3) -> ShadeSetup<'f> {
    let lighting = frame.lighting.as_ref();
    let world_from_level_gradient = lighting.map_or(glam::Mat3::IDENTITY, |l| l.world_from_level_gradient(level.scale));
    ShadeSetup { lighting, world_from_level_gradient, to_eye }
}

#[inline]
fn gather(frame: &CpuFrame, setup: &ShadeSetup<'_>, chord: &Chord, state: &mut RayState, counters: &mut Counters) {
    match frame.mode {
        Mode::Dvr => gather_dvr(frame, setup, chord, state, counters),
        Mode::Mip => gather_mip(chord, state),
        Mode::Minip => gather_minip(chord, state),
        Mode::Mean => gather_mean(chord, state),
        Mode::Iso => gather_iso(frame, setup, chord, state),
        Mode::Slice => {}
    }
}

/// A voxel as it lies in a brick.
pub(crate) trait StoredVoxel: Copy {
    /// Render value; NaN where absent.
    fn render_value(self, map: &ValueMap) -> f32;
}

impl StoredVoxel for u8 {
    #[inline]
    fn render_value(self, map: &ValueMap) -> f32 {
        if map.absent == Some(u16::from(self)) { f32::NAN } else { map.from_stored_number(f32::from(self)) }
    }
}

impl StoredVoxel for u16 {
    #[inline]
    fn render_value(self, map: &ValueMap) -> f32 {
        if map.absent == Some(self) { f32::NAN } else { map.from_stored_number(f32::from(self)) }
    }
}

impl StoredVoxel for f32 {
    #[inline]
    fn render_value(self, _map: &ValueMap) -> f32 {
        self
    }
}

/// The trilinear cells that a macro cell meets: cell c lies between voxels c and c + 1, so that they go from one voxel
/// before its own first to its own last.
pub(crate) fn cells_of_macro_cell(index: [i64; 3]) -> CellBox {
    let low = index.map(|m| m * MACRO_CELL as i64 - 1);
    CellBox { low, high: low.map(|v| v + MACRO_CELL as i64) }
}

/// One ray's visit to one brick.
pub(crate) struct BrickVisit<'a> {
    pub(crate) frame: &'a CpuFrame,
    pub(crate) ray: &'a AxisRay,
    pub(crate) setup: ShadeSetup<'a>,
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
    fn new(frame: &'a CpuFrame, ray: &'a AxisRay, to_eye: glam::Vec3, brick: &'a DecodedBrick, key: BrickKey) -> Self {
        let level = frame.pyramid.level_at(key.lod());
        let core = frame.pyramid.core_box(key);
        let extent = brick.extent.map(|n| n as usize);
        assert_eq!(extent, core.extent().map(|n| n + 2 * APRON), "stored extent of {key}");
        let start = core.start.map(|s| s as i64);
        let low = start.map(|s| s / MACRO_CELL as i64);
        let counts = core.extent().map(|n| n.div_ceil(MACRO_CELL) as i64);
        Self {
            frame,
            ray,
            setup: shade_setup(frame, level, to_eye),
            brick,
            macro_planes: Planes::of_macro_cells(level),
            cell_planes: Planes::of_cells(level),
            macro_cells: CellBox { low, high: std::array::from_fn(|a| low[a] + counts[a] - 1) },
            start,
            strides: [extent[0], extent[0] * extent[1]],
        }
    }

    /// Gathers from `state.t` to `exit`; leaves `state.t` alone.
    fn march<T: StoredVoxel, I: Integrator>(
        &self,
        voxels: &[T],
        exit: f64,
        integrator: &I,
        state: &mut RayState,
        counters: &mut Counters,
    ) {
        let mut t = state.t;
        let mut walk = GridWalk::new(self.ray, self.macro_planes, self.macro_cells, t);
        while t < exit {
            let macro_exit = walk.exit().min(exit);
            if macro_exit > t {
                if self.frame.skipping == Skipping::On && self.skips(self.macro_range(walk.index), state) {
                    counters.macro_cells_skipped += 1;
                } else {
                    counters.macro_cells += 1;
                    integrator.gather_macro_cell(self, voxels, walk.index, [t, macro_exit], state, counters);
                }
                if is_done(self.frame, state) {
                    return;
                }
            }
            t = macro_exit;
            walk.advance(self.ray);
        }
    }

    #[inline]
    fn macro_range(&self, index: [i64; 3]) -> [f32; 2] {
        let [x, y, z] = [0, 1, 2].map(|a| (index[a] - self.macro_cells.low[a]) as usize);
        let [nx, ny] = [0, 1].map(|a| (self.macro_cells.high[a] - self.macro_cells.low[a] + 1) as usize);
        self.brick.macro_ranges[x + nx * (y + ny * z)]
    }

    /// Whether a macro cell with this range cannot change what the ray gathers; keeps the sides for `iso`.
    #[inline]
    fn skips(&self, [low, high]: [f32; 2], state: &mut RayState) -> bool {
        if low > high {
            state.iso.known = 0;
            return true;
        }
        match self.frame.mode {
            Mode::Dvr => !self.frame.transfer_function.is_visible(low, high),
            Mode::Mip => f64::from(high) <= state.value,
            Mode::Minip => f64::from(low) >= state.value,
            Mode::Iso => {
                let mut above = 0;
                for (i, surface) in self.frame.iso.iter().enumerate() {
                    if low < surface.value && surface.value <= high && state.iso.hit >> i & 1 == 0 {
                        return false;
                    }
                    above |= u32::from(low >= surface.value) << i;
                }
                let jumped = state.iso.known & !state.iso.hit & (state.iso.above ^ above) != 0;
                if !jumped {
                    state.iso.above = above;
                    state.iso.known = u32::MAX;
                }
                !jumped
            }
            Mode::Mean | Mode::Slice => false,
        }
    }

    fn march_macro_cell<T: StoredVoxel>(
        &self,
        voxels: &[T],
        index: [i64; 3],
        [mut t, exit]: [f64; 2],
        state: &mut RayState,
        counters: &mut Counters,
    ) {
        let mut walk = GridWalk::new(self.ray, self.cell_planes, cells_of_macro_cell(index), t);
        while t < exit {
            let cell_exit = walk.exit().min(exit);
            if cell_exit > t {
                counters.cells += 1;
                self.gather_cell(voxels, walk.index, [t, cell_exit], state, counters);
                if is_done(self.frame, state) {
                    return;
                }
            }
            t = cell_exit;
            walk.advance(self.ray);
        }
    }

    #[inline]
    fn gather_cell<T: StoredVoxel>(
        &self,
        voxels: &[T],
        index: [i64; 3],
        [t0, t1]: [f64; 2],
        state: &mut RayState,
        counters: &mut Counters,
    ) {
        let a = self.cell_planes.fractions(self.ray, t0, index);
        let b = self.cell_planes.fractions(self.ray, t1, index);
        let base = self.base(index);
        let Some(cell) = Cell::new(self.corners(voxels, base), a, b) else {
            state.iso.known = 0;
            return;
        };
        let dvr = self.frame.mode == Mode::Dvr;
        if dvr && !self.frame.transfer_function.is_visible(cell.low, cell.high) {
            return;
        }
        let wants_gradient = self.setup.lighting.is_some() && (dvr || self.meets_surface(&cell, state));
        let gradient =
            if wants_gradient { ChordGradient::new(self.gradient_corners(voxels, base), a, b) } else { None };
        let chord = Chord::new(&cell, cubic_of_cell(&cell.corners, a, b), gradient, t1 - t0);
        gather(self.frame, &self.setup, &chord, state, counters);
    }

    fn meets_surface(&self, cell: &Cell, state: &RayState) -> bool {
        // Also where a surface was jumped on the face before this cell.
        self.frame.iso.iter().enumerate().any(|(i, surface)| {
            let jumped = (state.iso.above >> i & 1 == 1) != (cell.low >= surface.value);
            (cell.low <= surface.value && surface.value <= cell.high) || jumped
        })
    }

    /// Place of the first corner of a trilinear cell in the voxel array.
    #[inline]
    pub(crate) fn base(&self, index: [i64; 3]) -> usize {
        let [x, y, z] = [0, 1, 2].map(|axis| (index[axis] - self.start[axis] + APRON as i64) as usize);
        x + self.strides[0] * y + self.strides[1] * z
    }

    /// Render value of the voxel at an offset from `base`; NaN where absent.
    #[inline]
    pub(crate) fn value<T: StoredVoxel>(&self, voxels: &[T], base: usize, offset: [i32; 3]) -> f32 {
        let [dx, dy, dz] = offset.map(|o| o as isize);
        let at = base as isize + dx + dy * self.strides[0] as isize + dz * self.strides[1] as isize;
        voxels[at as usize].render_value(&self.frame.map)
    }

    #[inline]
    pub(crate) fn corners<T: StoredVoxel>(&self, voxels: &[T], base: usize) -> [f32; 8] {
        let [dy, dz] = self.strides;
        let map = &self.frame.map;
        let value = |i: usize| voxels[i].render_value(map);
        let rows = [base, base + dy, base + dz, base + dy + dz];
        [
            value(rows[0]),
            value(rows[0] + 1),
            value(rows[1]),
            value(rows[1] + 1),
            value(rows[2]),
            value(rows[2] + 1),
            value(rows[3]),
            value(rows[3] + 1),
        ]
    }

    /// Central differences at the eight corners, `[axis][corner]`; NaN where a tap is absent.
    #[inline]
    pub(crate) fn gradient_corners<T: StoredVoxel>(&self, voxels: &[T], base: usize) -> [[f32; 8]; 3] {
        let [dy, dz] = self.strides;
        [1, dy, dz].map(|step| {
            let after = self.corners(voxels, base + step);
            let before = self.corners(voxels, base - step);
            std::array::from_fn(|corner| 0.5 * (after[corner] - before[corner]))
        })
    }
}
