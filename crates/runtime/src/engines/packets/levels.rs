//! Errors of a tile's rays from coarser levels and moved voxels: summed up brick by brick during the cast, with the
//! bounds of [`crate::lod::deviation`].

use std::sync::Arc;

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::{single, whole};
use supervol_format::cell_errors::dequantize;
use supervol_format::space::HALF_VOXEL;
use supervol_format::{BrickKey, Lod, ValueRange};
use supervol_scene::clip::IndexRay;
use supervol_scene::scene::Mode;

use super::frame::PacketFrame;
use super::leap::macro_cells_of;
use super::noted::TileErrors;
use super::tile::Gathered;
use super::visit::CastTile;
use crate::engines::totals::ErrorsByReason;
use crate::lod::deviation::{CrossedCells, Deviation, Deviations, FinishedRay, Holes};
use crate::stream::residency::{KnownEntry, Resident};

/// Rounding of a render value, as a share of its size and that of its offset.
const RENDER_ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

/// Deviation of a brick, and of its macro cells.
#[derive(Debug)]
pub(super) struct BrickDeviation {
    of_brick: Deviation,
    /// x fastest; empty if they are unknown, or those of the brick.
    of_cells: Vec<Deviation>,
    /// Macro cells along each axis.
    cells: [usize; 3],
    /// Whether it was made while the brick was drawn.
    is_of_brick: bool,
}

impl BrickDeviation {
    fn bytes(&self) -> u64 {
        (size_of::<Self>() + size_of_val(&self.of_cells[..])) as u64
    }

    /// Macro cells that a ray crosses between two lengths; `None` if a surface may lie in one of them. `origin` and
    /// `direction` are in macro cells, counted from the first corner of the core.
    fn crossed(&self, origin: [f64; 3], direction: [f64; 3], [entry, exit]: [f64; 2]) -> Option<CrossedCells> {
        let mut cell: [usize; 3] = std::array::from_fn(|a| {
            let at = (origin[a] + entry * direction[a]).floor().clamp(0.0, self.cells[a] as f64 - 1.0);
            whole::<usize>(at)
        });
        let (mut crossed, mut t) = (CrossedCells::default(), entry);
        loop {
            let mut leave = (exit, None);
            for a in 0..3 {
                let is_last = if direction[a] > 0.0 { cell[a] + 1 == self.cells[a] } else { cell[a] == 0 };
                if direction[a] == 0.0 || is_last {
                    continue;
                }
                let plane = cell[a] + usize::from(direction[a] > 0.0);
                let at = (plane as f64 - origin[a]) / direction[a];
                leave = if at < leave.0 { (at, Some(a)) } else { leave };
            }
            let [nx, ny, _] = self.cells;
            let deviation = &self.of_cells[(cell[2] * ny + cell[1]) * nx + cell[0]];
            if deviation.is_unbounded() {
                return None;
            }
            crossed.add((leave.0 - t).max(0.0), deviation);
            let Some(axis) = leave.1 else { return Some(crossed) };
            cell[axis] = if direction[axis] > 0.0 { cell[axis] + 1 } else { cell[axis] - 1 };
            t = t.max(leave.0);
        }
    }
}

/// The rays of a tile in front of a brick that may be off.
pub(super) struct BrickCrossing {
    deviation: Deviation,
    /// Macro cells that each ray crosses, in the order of `rays`; `None` where the brick's deviation counts.
    crossed: Vec<Option<CrossedCells>>,
    is_drawn: bool,
    /// For each ray: its number, its length through the brick, and its transmittance or value.
    rays: Vec<(usize, f64, f64)>,
}

impl CastTile<'_> {
    /// The rays in front of a brick, if it has a deviation.
    pub(super) fn crossing(&self, key: BrickKey, resident: Resident<'_>) -> Option<BrickCrossing> {
        let deviations = self.frame.deviations.as_ref()?;
        let is_unknown = matches!(resident, Resident::UseParent);
        if key.lod() == Lod::FINEST && !is_unknown && deviations.is_finest_exact() {
            return None;
        }
        let of_levels = (!is_unknown).then(|| self.deviation(deviations, key, resident));
        let deviation = of_levels.as_ref().map_or(Deviation::UNKNOWN, |known| known.of_brick);
        if deviation.is_none() {
            return None;
        }
        let crossed = of_levels.map_or_else(Vec::new, |known| self.crossed_cells(key, &known));
        // The light behind a surface in one level says nothing if the surface lies elsewhere in the other level.
        let has_surface = self.frame.scene.mode == Mode::Iso || deviation.is_unbounded();
        let is_drawn = matches!(resident, Resident::Brick(_) | Resident::Uniform(_)) && !has_surface;
        let gathered = &self.rays.gathered;
        let of = if self.frame.scene.has_transmittance() { &gathered.transmittance } else { &gathered.value };
        let rays = self.rays.hits().iter().map(|&ray| {
            let ([entry, exit], place) = (self.rays.interval(ray), usize::from(ray));
            (place, exit - entry, of[place])
        });
        Some(BrickCrossing { deviation, crossed, is_drawn, rays: rays.collect() })
    }

    /// Macro cells that the rays in front of a brick cross; empty if the brick's deviation counts.
    fn crossed_cells(&self, key: BrickKey, known: &BrickDeviation) -> Vec<Option<CrossedCells>> {
        if known.of_cells.is_empty() {
            return Vec::new();
        }
        let pyramid = &self.frame.scene.pyramid;
        let (scale, start) = (pyramid.level_at(key.lod()).scale, pyramid.core_box(key).start);
        let side = |a: usize| scale[a] as f64 * MACRO_CELL as f64;
        let crossed = |&ray: &u16| {
            let IndexRay { origin, direction } = self.rays.index_ray(ray);
            let first = |a: usize| start[a] as f64 / MACRO_CELL as f64;
            let origin = std::array::from_fn(|a| (origin[a] + HALF_VOXEL) / side(a) - first(a));
            known.crossed(origin, std::array::from_fn(|a| direction[a] / side(a)), self.rays.interval(ray))
        };
        self.rays.hits().iter().map(crossed).collect()
    }

    fn deviation(&self, deviations: &Deviations, key: BrickKey, resident: Resident<'_>) -> Arc<BrickDeviation> {
        let is_brick = matches!(resident, Resident::Brick(_));
        self.tables.of_levels.of_which(
            self.frame.scene.field.brick(key),
            |made| made.is_of_brick == is_brick,
            BrickDeviation::bytes,
            || self.make_deviation(deviations, key, resident),
        )
    }

    fn make_deviation(&self, deviations: &Deviations, key: BrickKey, resident: Resident<'_>) -> BrickDeviation {
        let is_of_brick = matches!(resident, Resident::Brick(_));
        let unknown = BrickDeviation { of_brick: Deviation::UNKNOWN, of_cells: Vec::new(), cells: [0; 3], is_of_brick };
        let Some(KnownEntry { entry, holes }) = self.view.entry(key) else { return unknown };
        let of_brick = deviations.of(key, &entry, holes);
        let mut found = BrickDeviation { of_brick, ..unknown };
        let has_transmittance = self.frame.scene.has_transmittance();
        if let Resident::Brick(brick) = resident
            && let brick = brick.facts()
            && brick.macro_errors.len() == brick.macro_ranges.len()
            && has_transmittance
            && holes == Holes::None
            && !of_brick.is_none()
        {
            let map = &self.frame.scene.map;
            let of_cell = |(&[low, high], &code): (&[f32; 2], &u8)| {
                // Render values are rounded.
                let rounding = RENDER_ROUNDING * f64::from(low.abs().max(high.abs()) + map.offset.abs());
                let own = ValueRange { min: map.to_data(low), max: map.to_data(high) }.widened(rounding);
                deviations.of_cell(key, &entry, own, dequantize(code, entry.error))
            };
            found.of_cells = brick.macro_ranges.iter().zip(&brick.macro_errors).map(of_cell).collect();
            found.cells = macro_cells_of(brick, APRON);
        }
        found
    }

    /// Adds the brick's deviation to the rays that have left it.
    pub(super) fn note_levels(&mut self, crossing: &BrickCrossing) {
        let shift = self.frame.scene.map.shift;
        let gathered = &mut self.rays.gathered;
        let Some(levels) = &mut gathered.levels else { return };
        levels.presence_may_change |= crossing.deviation.presence_may_change;
        for (i, &(place, length, before)) in crossing.rays.iter().enumerate() {
            let (ray, deviation) = (&mut levels.rays[place], &crossing.deviation);
            let values = [before, gathered.value[place]].map(|value| value + shift);
            match self.frame.scene.mode {
                Mode::Mip => ray.note_greatest(values, deviation),
                Mode::Minip => ray.note_least(values, deviation),
                Mode::Mean => ray.note_mean(length, deviation),
                Mode::Dvr | Mode::Iso | Mode::Slice => {
                    if let Some(Some(crossed)) = crossing.crossed.get(i) {
                        ray.note_cells([before, gathered.transmittance[place]], length, deviation, crossed);
                        continue;
                    }
                    let after = crossing.is_drawn.then_some(gathered.transmittance[place]);
                    ray.note_brick(before, after, length, deviation);
                }
            }
        }
    }
}

/// Errors of the rays of a finished tile with these pixels; `None` if they were not summed up.
pub(super) fn errors_of(frame: &PacketFrame, gathered: &Gathered, pixels: &[[f32; 4]]) -> Option<Box<TileErrors>> {
    let (levels, deviations) = (gathered.levels.as_ref()?, frame.deviations.as_ref()?);
    let mut greatest = ErrorsByReason { presence_may_change: levels.presence_may_change, ..ErrorsByReason::default() };
    let of_rays = std::array::from_fn(|ray| {
        let transmittance = gathered.transmittance[ray];
        let has_ended = frame.scene.mode == Mode::Dvr && transmittance <= frame.tables.end_error();
        let behind = if has_ended { transmittance } else { 0.0 };
        let (cells, length) = (gathered.error[ray], gathered.length[ray]);
        let value = if frame.scene.mode == Mode::Mean { gathered.value[ray] / length } else { gathered.value[ray] };
        let finished = FinishedRay {
            behind,
            value: value + frame.scene.map.shift,
            length,
            own: cells + frame.own_error(1.0 - transmittance),
            pixel: pixels[ray],
        };
        let [off, of_levels] = deviations.of_finished(&levels.rays[ray], &finished);
        greatest.levels = greatest.levels.max(of_levels);
        greatest.cells = greatest.cells.max(cells);
        single(off)
    });
    Some(Box::new(TileErrors { of_rays, greatest }))
}
