//! Who casts the rays of a frame, how finely, and what that holds in memory.

use std::sync::Arc;

use supervol_format::Geometry;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::RayState;
use super::plans::BrickPlans;
use super::simd::InstructionSet;
use crate::engines::cells::{CellByCell, CellRule, Integration, Integrator};
use crate::engines::packets::cast;
use crate::engines::rules::{DEFAULT_ERROR, TERMINATION_OPACITY};
use crate::lod::LodChoice;
use crate::stream::budget::{Bands, CasterBytes, MADE_LIMIT};
use crate::stream::classify::Skipping;

/// Who casts the rays of a frame, and how finely.
///
/// Every caster walks the same bricks and macro cells, skips the same ones, reads through the same streamer and cache,
/// and ends at the same scene: only what happens inside a visible macro cell differs.
#[derive(Debug, Clone)]
pub enum Caster {
    /// Cell by cell, in packets of rays: what users get (docs/decisions/001-cells-not-steps.md, 006-packets.md).
    Packets(PacketRule),
    /// Cell by cell, ray by ray, in `f64`: what packets are compared with.
    Cells(CellRule),
    /// By something else that is plugged into the scalar caster, for comparison; mode `dvr` only: all others go cell by
    /// cell.
    Custom(Arc<dyn Integration>),
}

impl Caster {
    /// What users get.
    pub const DEFAULT: Self = Self::Packets(PacketRule::DEFAULT);

    /// Whether this is what users get, with whatever instructions and error.
    #[must_use]
    pub fn is_default(&self) -> bool {
        matches!(self, Self::Packets(_))
    }

    /// The same caster, aimed at this error if it can be aimed: the largest of any channel of any pixel, 1 being white.
    #[must_use]
    pub fn with_max_error(self, max_error: f64) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { max_error, ..rule }),
            other => other,
        }
    }

    /// The same caster, which sums up what its rays may be off by if it can.
    #[must_use]
    pub fn summing_errors(self) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { sums_errors: true, ..rule }),
            other => other,
        }
    }

    /// The same caster, which counts what each of its rays costs if it can.
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

    /// What it holds in host memory beside its tables; `core`: voxels along an edge of a full brick's core.
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

/// How finely packets integrate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PacketRule {
    /// Largest error of any channel of any pixel that is aimed at, 1 being white; brought to
    /// [`MAX_ERROR_LIMITS`](crate::engines::rules::MAX_ERROR_LIMITS).
    pub max_error: f64,
    /// Instructions to use; `None`: the best that the processor has.
    pub instructions: Option<InstructionSet>,
    /// Whether what cells and levels may do is summed up along rays, for a prediction: 1 to 2 % of the time.
    pub sums_errors: bool,
    /// Whether it is counted what each ray costs ([`super::work`]): several times the time.
    pub counts_work: bool,
}

impl PacketRule {
    /// Half a grey level.
    pub const DEFAULT: Self =
        Self { max_error: DEFAULT_ERROR, instructions: None, sums_errors: false, counts_work: false };
}

impl Default for PacketRule {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// How much work a frame may save, and how.
#[derive(Debug, Clone)]
pub struct CpuQuality {
    /// Which level bricks are taken from.
    pub lod: LodChoice,
    /// Whether macro cells are skipped.
    pub skipping: Skipping,
    /// Who casts the rays.
    pub caster: Caster,
    /// Most bytes of what is made once of each brick, and kept: with less it is made more often.
    pub made_bytes: u64,
    /// What packets of another frame found out of the same volume's bricks: taken over where it is still true.
    pub plans: Option<Arc<BrickPlans>>,
}

impl Default for CpuQuality {
    fn default() -> Self {
        let lod = LodChoice::Auto { voxel_pixels: 1.0 };
        Self { lod, skipping: Skipping::On, caster: Caster::DEFAULT, made_bytes: MADE_LIMIT, plans: None }
    }
}
