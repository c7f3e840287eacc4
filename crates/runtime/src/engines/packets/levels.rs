//! Errors of a tile's rays from coarser levels and moved voxels: summed up brick by brick during the cast, with the
//! bounds of [`crate::lod::deviation`].

use std::sync::Arc;

use supervol_format::cast::single;
use supervol_format::{BrickKey, Lod};
use supervol_scene::scene::Mode;

use super::frame::PacketFrame;
use super::noted::TileErrors;
use super::tile::Gathered;
use super::visit::CastTile;
use crate::engines::totals::ErrorsByReason;
use crate::lod::deviation::{Deviation, Deviations, FinishedRay};
use crate::stream::residency::Resident;

/// The rays of a tile in front of a brick that may be off.
pub(super) struct BrickCrossing {
    deviation: Deviation,
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
        let deviation = if is_unknown { Deviation::UNKNOWN } else { *self.deviation(deviations, key) };
        if deviation.is_none() {
            return None;
        }
        // The light behind a surface in one level says nothing if the surface lies elsewhere in the other level.
        let has_surface = self.frame.scene.mode == Mode::Iso || deviation.is_unbounded();
        let is_drawn = matches!(resident, Resident::Brick(_) | Resident::Uniform(_)) && !has_surface;
        let gathered = &self.rays.gathered;
        let of = if self.frame.scene.has_transmittance() { &gathered.transmittance } else { &gathered.value };
        let rays = self.rays.hits().iter().map(|&ray| {
            let ([entry, exit], place) = (self.rays.interval(ray), usize::from(ray));
            (place, exit - entry, of[place])
        });
        Some(BrickCrossing { deviation, is_drawn, rays: rays.collect() })
    }

    fn deviation(&self, deviations: &Deviations, key: BrickKey) -> Arc<Deviation> {
        self.tables.of_levels.of(
            self.frame.scene.field.brick(key),
            |deviation| size_of_val(deviation) as u64,
            || {
                let known = self.view.entry(key);
                known.map_or(Deviation::UNKNOWN, |known| deviations.of(key, &known.entry, known.holes))
            },
        )
    }

    /// Adds the brick's deviation to the rays that have left it.
    pub(super) fn note_levels(&mut self, crossing: &BrickCrossing) {
        let shift = self.frame.scene.map.shift;
        let gathered = &mut self.rays.gathered;
        let Some(levels) = &mut gathered.levels else { return };
        levels.presence_may_change |= crossing.deviation.presence_may_change;
        for &(place, length, before) in &crossing.rays {
            let (ray, deviation) = (&mut levels.rays[place], &crossing.deviation);
            let values = [before, gathered.value[place]].map(|value| value + shift);
            match self.frame.scene.mode {
                Mode::Mip => ray.note_greatest(values, deviation),
                Mode::Minip => ray.note_least(values, deviation),
                Mode::Mean => ray.note_mean(length, deviation),
                Mode::Dvr | Mode::Iso | Mode::Slice => {
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
