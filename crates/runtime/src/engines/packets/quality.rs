//! Choice of the caster of a frame, its accuracy, and its memory.

use std::sync::Arc;

use supervol_format::Geometry;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::plans::BrickPlans;
use super::simd::InstructionSet;
use super::{RayState, Skipping, TERMINATION_OPACITY};
use crate::engines::cells::{CellByCell, CellRule, Integration, Integrator};
use crate::engines::packets::cast;
use crate::lod::LodChoice;
use crate::stream::budget::{Bands, CasterBytes, MADE_LIMIT};

/// The CPU caster of a frame, with its accuracy.
///
/// All casters walk the same bricks and macro cells, skip the same ones, read through the same streamer and cache, and
/// end in the same picture. They differ only within a visible macro cell.
#[derive(Debug, Clone)]
pub enum Caster {
    /// Cell by cell, in packets of rays: the default (docs/decisions/001-cells-not-steps.md, 006-packets.md).
    Packets(PacketRule),
    /// Cell by cell, ray by ray, in `f64`: packets are compared with it.
    Cells(CellRule),
    /// A custom integrator in the scalar caster, for comparison. Mode `dvr` only; all other modes go cell by cell.
    Custom(Arc<dyn Integration>),
}

impl Caster {
    /// The default caster.
    pub const DEFAULT: Self = Self::Packets(PacketRule::DEFAULT);

    /// Whether this is the default caster, with any instruction set and error.
    #[must_use]
    pub fn is_default(&self) -> bool {
        matches!(self, Self::Packets(_))
    }

    /// The same caster with this requested error, if it has one: the largest of any channel of any pixel, 1 is white.
    #[must_use]
    pub fn with_max_error(self, max_error: f64) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { max_error, ..rule }),
            other => other,
        }
    }

    /// The same caster; sums up the errors of its rays if it can.
    #[must_use]
    pub fn summing_errors(self) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { sums_errors: true, ..rule }),
            other => other,
        }
    }

    /// The same caster; counts the work of each ray if it can.
    #[must_use]
    pub fn counting_work(self) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { counts_work: true, ..rule }),
            other => other,
        }
    }

    /// Opacity at which a ray ends in mode `dvr`; above 1, never.
    #[must_use]
    pub fn termination_opacity(&self) -> f64 {
        match self {
            Self::Packets(_) => TERMINATION_OPACITY,
            Self::Cells(rule) => rule.termination_opacity,
            Self::Custom(integration) => integration.termination_opacity(),
        }
    }

    /// Host memory of the caster beside its tables; `core`: voxels along an edge of a full brick's core.
    #[must_use]
    pub fn bytes(&self, core: usize) -> CasterBytes {
        match self {
            Self::Packets(rule) => cast::bytes_held(core, *rule),
            Self::Cells(_) | Self::Custom(_) => CasterBytes {
                bands: Bands::Allowed,
                tile_side: 1,
                tile: size_of::<RayState>() as u64,
                thread: 0,
                made_of_brick: 0,
                of_pixel: 0,
            },
        }
    }

    pub(super) fn integrator(&self, scene: &ResolvedScene, geometry: &Geometry) -> Arc<dyn Integrator> {
        match self {
            Self::Custom(integration) if scene.mode == Mode::Dvr => integration.integrator(scene, geometry),
            Self::Custom(_) | Self::Packets(_) => Arc::new(CellByCell { pairs: CellRule::DEFAULT.pairs }),
            Self::Cells(rule) => Arc::new(CellByCell { pairs: rule.pairs }),
        }
    }
}

impl Default for Caster {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Least and greatest error that packets can aim at. Below, `f32` is not precise enough; above, nothing is gained.
pub const MAX_ERROR_LIMITS: [f64; 2] = [0.05 / 255.0, 16.0 / 255.0];

/// Accuracy of packets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PacketRule {
    /// Requested error of any channel of any pixel, 1 is white; clamped to [`MAX_ERROR_LIMITS`].
    pub max_error: f64,
    /// Instruction set to use; `None`: the best of the processor.
    pub instructions: Option<InstructionSet>,
    /// Whether errors of cells and levels are summed up along rays, for a prediction: 1 to 2 % of the time.
    pub sums_errors: bool,
    /// Whether the work of each ray is counted ([`super::work`]): several times the time.
    pub counts_work: bool,
}

impl PacketRule {
    /// Half a grey level.
    pub const DEFAULT: Self =
        Self { max_error: 0.5 / 255.0, instructions: None, sums_errors: false, counts_work: false };
}

impl Default for PacketRule {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Levels, skipping and caster of a frame, with memory and plans.
#[derive(Debug, Clone)]
pub struct CpuQuality {
    /// Choice of the level of bricks.
    pub lod: LodChoice,
    /// Whether macro cells are skipped.
    pub skipping: Skipping,
    /// The caster of the rays.
    pub caster: Caster,
    /// Most bytes of data derived from bricks and kept: with less, it is made more often.
    pub made_bytes: u64,
    /// Plans of another frame for the same volume's bricks: used where they are still valid.
    pub plans: Option<Arc<BrickPlans>>,
}

impl Default for CpuQuality {
    fn default() -> Self {
        let lod = LodChoice::Auto { voxel_pixels: 1.0 };
        Self { lod, skipping: Skipping::On, caster: Caster::DEFAULT, made_bytes: MADE_LIMIT, plans: None }
    }
}
