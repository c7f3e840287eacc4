//! Rays of a tile through a brick with opacity by the gradient: cell by cell, in `f64`.
//!
//! Cells that show nothing are left out. The others spend the ray's error budget as cells of packets do (`budget`), and state what
//! they spend.

use supervol_format::BrickKey;
use supervol_format::cast::single;

use super::visit::{CastTile, cast_ray};
use crate::engines::cells::modulated::{CellBudget, ModulatedBrick, Modulation, Seen};
use crate::engines::cells::shown_cells::ShownCells;
use crate::engines::cells::{BrickVisit, LevelVisit};
use crate::engines::rules::BY_OPACITY;
use crate::stream::residency::DecodedBrick;

impl CastTile<'_> {
    /// Rays gather light in a brick of which these cells may show something.
    pub(super) fn cast_modulated(
        &mut self,
        (key, brick): (BrickKey, &DecodedBrick),
        modulation: &Modulation,
        shown: &ShownCells,
    ) {
        let (frame, tables) = (self.frame, self.tables);
        let last = f64::from(tables.precision.last_transmittance);
        let world_from_level = frame.scene.world_from_level_gradient(key.lod());
        let modulated = ModulatedBrick { modulation, world_from_level, shown };
        let counters = &mut self.feedback.counters;
        for i in 0..self.rays.hits().len() {
            let ray = self.rays.hits()[i];
            let place = usize::from(ray);
            let cast = cast_ray(frame, self.rays, self.corner, ray);
            let visit = BrickVisit::new(LevelVisit::new(&frame.scene, &cast, key), brick, key);
            let front = self.rays.gathered.transmittance[place];
            let by_opacity = BY_OPACITY * tables.max_error;
            let mut budget = CellBudget { by_opacity, left: self.rays.gathered.left[place], weight: front };
            let Seen { color, transmittance, error } =
                modulated.gather(&visit, self.rays.interval(ray), &mut budget, last, counters);
            if tables.precision.sums_errors {
                self.rays.add_error(ray, single(error));
            }
            self.rays.set_left(ray, single(budget.left));
            self.rays.add(ray, color.to_array().map(single), single(transmittance), last);
        }
    }
}
