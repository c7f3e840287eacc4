//! The integrator of the scalar caster: trilinear cell by trilinear cell (docs/decisions/001-cells-not-steps.md).

use supervol_format::BrickKey;
use supervol_scene::scene::Mode;

use super::cell::{Cell, cubic_of_cell};
use super::integrator::Integrator;
use super::modes::{CellChord, gather_crossings, gather_dvr, gather_iso, gather_mean, gather_minip, gather_mip};
use super::shade::ChordGradient;
use super::visit::{BrickVisit, LevelVisit, StoredVoxel};
use crate::engines::ray::RayState;
use crate::engines::rules::TERMINATION_OPACITY;
use crate::stream::counters::RayCounters;
use crate::stream::residency::{DecodedBrick, Voxels};

/// How finely cells are integrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellRule {
    /// Gauss pairs between two splits of a chord.
    pub pairs: Pairs,
    /// A ray ends when its opacity reaches this; above 1, never.
    pub termination_opacity: f64,
}

impl CellRule {
    /// The default.
    pub const DEFAULT: Self =
        Self { pairs: Pairs::Adaptive { density: 1.0 }, termination_opacity: TERMINATION_OPACITY };
}

impl Default for CellRule {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Number of Gauss pairs between two splits of a chord.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pairs {
    /// The count that the transfer function's variation and the shading require, times `density`.
    Adaptive {
        /// 1 is the default.
        density: f32,
    },
    /// Always this many.
    Fixed(u32),
}

/// Gathers cell by cell, in every mode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellByCell {
    /// Gauss pairs between two splits of a chord.
    pub pairs: Pairs,
}

impl Integrator for CellByCell {
    fn gather_macro_cell(
        &self,
        visit: &BrickVisit<'_>,
        index: [i64; 3],
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        match visit.voxels() {
            Voxels::U8(voxels) => self.march(visit, (voxels, index), t, state, counters),
            Voxels::U16(voxels) => self.march(visit, (voxels, index), t, state, counters),
            Voxels::F32(voxels) => self.march(visit, (voxels, index), t, state, counters),
        }
    }

    fn gather_uniform(
        &self,
        visit: &LevelVisit<'_>,
        value: f32,
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        counters.cells += 1;
        if counts_by_value(visit.scene.mode) && visit.axis_ray.is_rounding(t) {
            return;
        }
        self.gather(visit, &CellChord::uniform(value, t[1] - t[0]), state, counters);
    }
}

/// Gathers over the part of a ray in one trilinear cell of a brick; leaves its begin in `state.t`. The cell's first corner lies `base`
/// voxels from the brick's first; `t` is the ray's interval in the brick.
pub(crate) fn gather_exact_cell(
    level: LevelVisit<'_>,
    brick: &DecodedBrick,
    key: BrickKey,
    base: usize,
    t: [f64; 2],
    state: &mut RayState,
) {
    let visit = BrickVisit::new(level, brick, key);
    let (index, t) = visit.chord_at_base(base, t);
    if t[0] < t[1] {
        state.t = t[0];
        let counters = &mut RayCounters::default();
        let cells = CellByCell { pairs: CellRule::DEFAULT.pairs };
        match visit.voxels() {
            Voxels::U8(voxels) => cells.gather_cell(&visit, (voxels, index), t, state, counters),
            Voxels::U16(voxels) => cells.gather_cell(&visit, (voxels, index), t, state, counters),
            Voxels::F32(voxels) => cells.gather_cell(&visit, (voxels, index), t, state, counters),
        }
    }
}

impl CellByCell {
    /// Gathers over the cells of one macro cell.
    fn march<T: StoredVoxel>(
        &self,
        visit: &BrickVisit<'_>,
        (voxels, index): (&[T], [i64; 3]),
        t: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        visit.for_each_cell(index, t, |index, t| {
            counters.cells += 1;
            self.gather_cell(visit, (voxels, index), t, state, counters);
            !visit.level.is_done(state)
        });
    }

    #[inline]
    fn gather_cell<T: StoredVoxel>(
        &self,
        visit: &BrickVisit<'_>,
        (voxels, index): (&[T], [i64; 3]),
        [t0, t1]: [f64; 2],
        state: &mut RayState,
        counters: &mut RayCounters,
    ) {
        let level = &visit.level;
        if counts_by_value(level.scene.mode) && level.axis_ray.is_rounding([t0, t1]) {
            return;
        }
        let a = visit.cell_planes.fractions(level.axis_ray, t0, index);
        let b = visit.cell_planes.fractions(level.axis_ray, t1, index);
        let base = visit.base(index);
        let Some(cell) = Cell::new(visit.corners(voxels, base), a, b) else {
            state.iso.known = 0;
            return;
        };
        let dvr = level.scene.mode == Mode::Dvr;
        if dvr && !level.scene.transfer_function.is_visible(cell.low, cell.high) {
            return;
        }
        let wants_gradient = level.setup.lighting.is_some() && (dvr || meets_surface(level, &cell, state));
        let gradient =
            if wants_gradient { ChordGradient::new(visit.gradient_corners(voxels, base), a, b) } else { None };
        let chord = CellChord::new(&cell, cubic_of_cell(&cell.corners, a, b), gradient, t1 - t0);
        self.gather(level, &chord, state, counters);
    }

    #[inline]
    fn gather(&self, level: &LevelVisit<'_>, chord: &CellChord, state: &mut RayState, counters: &mut RayCounters) {
        let (scene, setup) = (level.scene, &level.setup);
        match scene.mode {
            Mode::Dvr => gather_dvr(scene, setup, self.pairs, chord, state, counters),
            Mode::Mip => gather_mip(chord, state),
            Mode::Minip => gather_minip(chord, state),
            Mode::Mean => gather_mean(chord, state),
            Mode::Iso if scene.lists_crossings => gather_crossings(scene, setup, chord, state),
            Mode::Iso => gather_iso(scene, setup, chord, state),
            Mode::Slice => {}
        }
    }
}

/// Whether the content of a chord counts however short it is.
fn counts_by_value(mode: Mode) -> bool {
    matches!(mode, Mode::Mip | Mode::Minip | Mode::Mean)
}

fn meets_surface(level: &LevelVisit<'_>, cell: &Cell, state: &RayState) -> bool {
    // Also where a surface was jumped on the face before this cell.
    level.scene.iso.iter().enumerate().any(|(i, surface)| {
        let jumped = (state.iso.above >> i & 1 == 1) != (cell.low >= surface.value);
        (cell.low <= surface.value && surface.value <= cell.high) || jumped
    })
}
