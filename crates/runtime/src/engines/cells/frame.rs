//! A picture by the cell caster: its description, and what rays do where something may show.

use std::ops::Range;
use std::sync::Arc;

use supervol_scene::scene::{Mode, ResolvedScene};

use super::cell_by_cell::{CellByCell, CellRule};
use super::integrator::{Integration, Integrator};
use crate::engines::ray::RayState;
use crate::engines::ray_scene::{BrickChoice, DrawnVolume, RayScene};
use crate::stream::budget::{BandMode, EngineBytes};

/// A picture by the cell caster.
#[derive(Debug, Clone)]
pub struct CellFrame {
    pub(crate) scene: RayScene,
    /// Integrator of the macro cells that may show something.
    pub(crate) integrator: Arc<dyn Integrator>,
}

impl CellFrame {
    /// The picture of a scene, cell by cell.
    #[must_use]
    pub fn new(scene: &ResolvedScene, volume: &DrawnVolume<'_>, bricks: BrickChoice, rule: CellRule) -> Self {
        let integrator = Arc::new(CellByCell { pairs: rule.pairs });
        Self { scene: RayScene::new(scene, volume, bricks, rule.termination_opacity), integrator }
    }

    /// The same by something else that is plugged in, for comparison: in mode `dvr`; all others go cell by cell.
    #[must_use]
    pub fn by(
        scene: &ResolvedScene,
        volume: &DrawnVolume<'_>,
        bricks: BrickChoice,
        integration: &dyn Integration,
    ) -> Self {
        let integrator = match scene.mode {
            Mode::Dvr => integration.integrator(scene, volume.geometry),
            _ => Arc::new(CellByCell { pairs: CellRule::DEFAULT.pairs }),
        };
        Self { scene: RayScene::new(scene, volume, bricks, integration.termination_opacity()), integrator }
    }

    /// The same picture for some rows of pixels only: see [`RayScene::band`].
    ///
    /// # Panics
    /// If the picture has no such rows.
    #[must_use]
    pub fn band(&self, pixel_rows: Range<u32>) -> Self {
        Self { scene: self.scene.band(pixel_rows), integrator: self.integrator.clone() }
    }
}

/// Bytes that the cell caster holds in host memory.
#[must_use]
pub fn bytes_held() -> EngineBytes {
    EngineBytes {
        bands: BandMode::Allowed,
        group_side: 1,
        group: size_of::<RayState>() as u64,
        thread: 0,
        made_of_brick: 0,
        of_pixel: 0,
        of_ray: 0,
    }
}
