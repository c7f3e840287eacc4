//! Pictures on the CPU: the choice between packets of rays and rays one by one.
//!
//! [`CpuFrame`] is a picture that is to be cast, [`CpuRays`] its rays between passes. Rays know their picture, so that none are
//! cast for another. The choice is made here, once a pass: no loop over rays, packets or cells knows of it.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::cells;
use super::cells::frame::CellFrame;
use super::cells::rays::CellRays;
use super::cells::{CellRule, Integration};
use super::feedback::PassFeedback;
use super::packets;
use super::packets::simd::InstructionSet;
use super::packets::{BrickPlans, PacketFrame, PacketRays, PacketRule};
use super::ray::RayState;
use super::ray_scene::{BrickChoice, DrawnVolume};
use super::totals::{EngineErrors, ErrorsByReason};
use crate::lod::LodChoice;
use crate::lod::deviation::Deviations;
use crate::stop::Stop;
use crate::stream::budget::{EngineBytes, MADE_LIMIT};
use crate::stream::classify::Skipping;
use crate::stream::residency::BrickView;

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

    /// What it holds in host memory beside its tables; `core`: voxels along an edge of a full brick's core.
    #[must_use]
    pub fn bytes(&self, core: usize) -> EngineBytes {
        match self {
            Self::Packets(rule) => packets::bytes_held(core, *rule),
            Self::Cells(_) | Self::Custom(_) => cells::frame::bytes_held(),
        }
    }
}

impl Default for Caster {
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
    /// What packets of another picture found out of the same volume's bricks: taken over where it is still true.
    pub plans: Option<Arc<BrickPlans>>,
}

impl Default for CpuQuality {
    fn default() -> Self {
        let lod = LodChoice::Auto { voxel_pixels: 1.0 };
        Self { lod, skipping: Skipping::On, caster: Caster::DEFAULT, made_bytes: MADE_LIMIT, plans: None }
    }
}

/// A picture on the CPU.
#[derive(Debug, Clone)]
pub enum CpuFrame {
    /// By packets.
    Packets(Box<PacketFrame>),
    /// Ray by ray.
    Cells(Box<CellFrame>),
}

/// The rays of a picture between passes, and the picture that they are cast for.
#[derive(Debug, Clone)]
pub enum CpuRays {
    /// In tiles.
    Packets(PacketRays),
    /// One by one.
    Cells(CellRays),
}

impl CpuFrame {
    /// The picture of a scene over one volume.
    ///
    /// # Panics
    /// If the scene has surfaces inside the volume (mode `dvr` with `iso`) and the caster is not [`Caster::Packets`].
    #[must_use]
    pub fn new(scene: &ResolvedScene, volume: &DrawnVolume<'_>, quality: CpuQuality) -> Self {
        let CpuQuality { lod, skipping, caster, made_bytes, plans } = quality;
        let bricks = BrickChoice { lod, skipping };
        let has_surfaces = scene.mode == Mode::Dvr && !scene.iso.is_empty();
        assert!(!has_surfaces || caster.is_default(), "only packets draw surfaces inside the volume");
        match caster {
            Caster::Packets(rule) => {
                Self::Packets(Box::new(PacketFrame::new(scene, volume, bricks, rule, (made_bytes, plans))))
            }
            Caster::Cells(rule) => Self::Cells(Box::new(CellFrame::new(scene, volume, bricks, rule))),
            Caster::Custom(integration) => Self::Cells(Box::new(CellFrame::by(scene, volume, bricks, &*integration))),
        }
    }

    /// Where packets sum up errors, what these coarser levels do counts, too.
    #[must_use]
    pub fn with_deviations(self, deviations: Deviations) -> Self {
        match self {
            Self::Packets(frame) => Self::Packets(Box::new(frame.with_deviations(deviations))),
            cells @ Self::Cells(_) => cells,
        }
    }

    /// Packets count the rays that they finish here.
    #[must_use]
    pub fn counting(self, finished: Option<Arc<AtomicU64>>) -> Self {
        match self {
            Self::Packets(frame) => Self::Packets(Box::new(frame.counting(finished))),
            cells @ Self::Cells(_) => cells,
        }
    }

    /// Packets stop when this is due: rays wait where they are, and go on from there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        if let Self::Packets(frame) = self {
            frame.set_stop(stop);
        }
    }

    /// What packets have found out of bricks, for a picture of another camera; `None` where they cast none in mode `dvr`.
    #[must_use]
    pub fn plans(&self) -> Option<Arc<BrickPlans>> {
        match self {
            Self::Packets(frame) => frame.plans(),
            Self::Cells(_) => None,
        }
    }

    /// The same picture for some rows of pixels only, numbered from the top.
    ///
    /// # Panics
    /// If the picture has no such rows.
    #[must_use]
    pub fn band(&self, pixel_rows: Range<u32>) -> Self {
        match self {
            Self::Packets(frame) => Self::Packets(Box::new(frame.band(pixel_rows))),
            Self::Cells(frame) => Self::Cells(Box::new(frame.band(pixel_rows))),
        }
    }

    /// All rays before the first pass.
    #[must_use]
    pub fn begin(&self) -> CpuRays {
        self.clone().into_rays()
    }

    /// The same of a picture that nobody else needs.
    #[must_use]
    pub fn into_rays(self) -> CpuRays {
        match self {
            Self::Packets(frame) => CpuRays::Packets(PacketRays::new(*frame)),
            Self::Cells(frame) => CpuRays::Cells(CellRays::new(*frame)),
        }
    }

    /// The instructions that packets are cast with; `None` where rays are cast one by one.
    #[must_use]
    pub fn instructions(&self) -> Option<InstructionSet> {
        match self {
            Self::Packets(frame) => Some(frame.instructions()),
            Self::Cells(_) => None,
        }
    }

    /// What a picture may be off by whose rays are off by so much: where packets sum that up, in mode `dvr`.
    #[must_use]
    pub fn errors(&self, rays: ErrorsByReason) -> Option<EngineErrors> {
        match self {
            Self::Packets(frame) => frame.errors(rays),
            Self::Cells(_) => None,
        }
    }
}

impl CpuRays {
    /// Casts every unfinished ray as far as resident bricks allow.
    ///
    /// # Panics
    /// If a brick's size is not what the pyramid says.
    pub fn cast_pass<V: BrickView + ?Sized>(&mut self, view: &V) -> PassFeedback {
        match self {
            Self::Packets(rays) => rays.cast_pass(view),
            Self::Cells(rays) => rays.cast_pass(view),
        }
    }

    /// Packets stop when this is due: rays wait where they are, and go on from there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        if let Self::Packets(rays) = self {
            rays.set_stop(stop);
        }
    }

    /// The picture of what the rays have gathered, sub-grid averaged.
    #[must_use]
    pub fn image(&self) -> Image {
        match self {
            Self::Packets(rays) => rays.image(),
            Self::Cells(rays) => rays.image(),
        }
    }

    /// The picture of what is finished, sub-grid averaged: NaN elsewhere.
    #[must_use]
    pub fn finished_pixels(&self) -> Image {
        match self {
            Self::Packets(rays) => rays.finished_pixels(),
            Self::Cells(rays) => rays.finished_pixels(),
        }
    }

    /// What each finished pixel may be off by: see [`PacketRays::error_pixels`].
    #[must_use]
    pub fn error_pixels(&self) -> Option<Image> {
        match self {
            Self::Packets(rays) => rays.error_pixels(),
            Self::Cells(_) => None,
        }
    }

    /// What the rays of each finished pixel cost: see [`PacketRays::work_pixels`].
    #[must_use]
    pub fn work_pixels(&self) -> Option<Image> {
        match self {
            Self::Packets(rays) => rays.work_pixels(),
            Self::Cells(_) => None,
        }
    }

    /// What rays in packets may be off by at most, where that is summed up.
    #[must_use]
    pub fn errors(&self) -> ErrorsByReason {
        match self {
            Self::Packets(rays) => rays.errors(),
            Self::Cells(_) => ErrorsByReason::default(),
        }
    }

    /// The rays, row by row from the top, where they are cast one by one; else none.
    #[must_use]
    pub fn states(&self) -> &[RayState] {
        match self {
            Self::Packets(_) => &[],
            Self::Cells(rays) => rays.states(),
        }
    }

    /// Rays that wait for a brick.
    #[must_use]
    pub fn waiting(&self) -> u64 {
        match self {
            Self::Packets(rays) => rays.waiting(),
            Self::Cells(rays) => rays.waiting(),
        }
    }

    /// Whether every ray is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        match self {
            Self::Packets(rays) => rays.is_finished(),
            Self::Cells(rays) => rays.is_finished(),
        }
    }

    /// Rays that ended before they left the volume.
    #[must_use]
    pub fn terminated_early(&self) -> u64 {
        match self {
            Self::Packets(rays) => rays.terminated_early(),
            Self::Cells(rays) => rays.terminated_early(),
        }
    }

    /// Rays of the picture.
    #[must_use]
    pub fn ray_count(&self) -> u64 {
        match self {
            Self::Packets(rays) => rays.ray_count(),
            Self::Cells(rays) => rays.ray_count(),
        }
    }
}
