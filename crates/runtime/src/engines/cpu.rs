//! Pictures on the CPU: the choice between packets of rays and single rays.
//!
//! [`CpuFrame`] is the picture to cast, [`CpuRays`] its rays between passes. Rays own their picture, so they cannot be
//! cast for another one. The choice is made here, once per pass; no loop over rays, packets or cells repeats it.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

use supervol_format::ValueRange;
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};

use super::asked::AskedPixels;
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

/// Caster of a frame, with its precision.
///
/// Every caster visits the same bricks and macro cells, skips the same ones, reads through the same streamer and cache,
/// and draws the same scene. Casters differ only inside a visible macro cell.
#[derive(Debug, Clone)]
pub enum Caster {
    /// Cell by cell, in packets of rays: the default (docs/decisions/001-cells-not-steps.md, 006-packets.md).
    Packets(PacketRule),
    /// Cell by cell, ray by ray, in `f64`: the comparison for packets.
    Cells(CellRule),
    /// By another integration in the scalar caster, for comparison. Modes other than `dvr` are cast cell by cell.
    Custom(Arc<dyn Integration>),
}

impl Caster {
    /// Caster of normal pictures.
    pub const DEFAULT: Self = Self::Packets(PacketRule::DEFAULT);

    /// Whether this is the default caster, with any instructions and error.
    #[must_use]
    pub fn is_default(&self) -> bool {
        matches!(self, Self::Packets(_))
    }

    /// The same caster with this requested error, if it has one: largest error of a pixel channel, 1 is white.
    #[must_use]
    pub fn with_max_error(self, max_error: f64) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { max_error, ..rule }),
            other => other,
        }
    }

    /// The same caster, which sums up the errors of its rays if it can.
    #[must_use]
    pub fn summing_errors(self) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { sums_errors: true, ..rule }),
            other => other,
        }
    }

    /// The same caster, which counts the work of each ray if it can.
    #[must_use]
    pub fn counting_work(self) -> Self {
        match self {
            Self::Packets(rule) => Self::Packets(PacketRule { counts_work: true, ..rule }),
            other => other,
        }
    }

    /// Bytes of host memory beside its tables; `core`: voxels along an edge of a full brick's core.
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

/// Precision and memory of a picture on the CPU.
#[derive(Debug, Clone)]
pub struct CpuQuality {
    /// Rule for the level of each brick.
    pub lod: LodChoice,
    /// Whether macro cells are skipped.
    pub skipping: Skipping,
    /// Caster of the rays.
    pub caster: Caster,
    /// Most bytes of kept data derived from bricks. With less, the data is derived more often.
    pub made_bytes: u64,
    /// Plans for the same volume's bricks from an earlier picture; reused as far as they are valid.
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

/// The rays of a picture between passes, and the picture.
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

    /// Bound on what values of rays are off by, in modes that gather them; all values of the volume lie in `range`. Data units.
    #[must_use]
    pub fn value_error(&self, range: ValueRange) -> f64 {
        match self {
            Self::Packets(frame) => frame.value_error(range),
            Self::Cells(_) => f64::INFINITY,
        }
    }

    /// Adds these errors of coarser levels, if packets sum up errors.
    #[must_use]
    pub fn with_deviations(self, deviations: Deviations) -> Self {
        match self {
            Self::Packets(frame) => Self::Packets(Box::new(frame.with_deviations(deviations))),
            cells @ Self::Cells(_) => cells,
        }
    }

    /// The same picture of these pixels only, by packets: all others are NaN. Single rays are always cast for all pixels.
    #[must_use]
    pub(crate) fn only(self, asked: AskedPixels) -> Self {
        match self {
            Self::Packets(frame) => Self::Packets(Box::new(frame.only(asked))),
            cells @ Self::Cells(_) => cells,
        }
    }

    /// Packets add the number of finished rays here.
    #[must_use]
    pub fn counting(self, finished: Option<Arc<AtomicU64>>) -> Self {
        match self {
            Self::Packets(frame) => Self::Packets(Box::new(frame.counting(finished))),
            cells @ Self::Cells(_) => cells,
        }
    }

    /// Sets the stop condition of packets. At the stop, rays wait at their place and continue there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        if let Self::Packets(frame) = self {
            frame.set_stop(stop);
        }
    }

    /// Plans of packets for bricks, for a picture of another camera; `None` without packets in mode `dvr`.
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

    /// The same, without a copy of the picture.
    #[must_use]
    pub fn into_rays(self) -> CpuRays {
        match self {
            Self::Packets(frame) => CpuRays::Packets(PacketRays::new(*frame)),
            Self::Cells(frame) => CpuRays::Cells(CellRays::new(*frame)),
        }
    }

    /// Instruction set of packets; `None` if rays are cast one by one.
    #[must_use]
    pub fn instructions(&self) -> Option<InstructionSet> {
        match self {
            Self::Packets(frame) => Some(frame.instructions()),
            Self::Cells(_) => None,
        }
    }

    /// Error of a picture whose rays have these errors; `None` without packets that sum up errors in mode `dvr`.
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

    /// Sets the stop condition of packets. At the stop, rays wait at their place and continue there in the next pass.
    pub(crate) fn set_stop(&mut self, stop: Stop) {
        if let Self::Packets(rays) = self {
            rays.set_stop(stop);
        }
    }

    /// The picture of all rays so far, sub-grid averaged.
    #[must_use]
    pub fn image(&self) -> Image {
        match self {
            Self::Packets(rays) => rays.image(),
            Self::Cells(rays) => rays.image(),
        }
    }

    /// The finished pixels, sub-grid averaged; NaN elsewhere.
    #[must_use]
    pub fn finished_pixels(&self) -> Image {
        match self {
            Self::Packets(rays) => rays.finished_pixels(),
            Self::Cells(rays) => rays.finished_pixels(),
        }
    }

    /// Error of each finished pixel: see [`PacketRays::error_pixels`].
    #[must_use]
    pub fn error_pixels(&self) -> Option<Image> {
        match self {
            Self::Packets(rays) => rays.error_pixels(),
            Self::Cells(_) => None,
        }
    }

    /// Work of the rays of each finished pixel: see [`PacketRays::work_pixels`].
    #[must_use]
    pub fn work_pixels(&self) -> Option<Image> {
        match self {
            Self::Packets(rays) => rays.work_pixels(),
            Self::Cells(_) => None,
        }
    }

    /// Largest errors of rays; zero unless packets sum them up.
    #[must_use]
    pub fn errors(&self) -> ErrorsByReason {
        match self {
            Self::Packets(rays) => rays.errors(),
            Self::Cells(_) => ErrorsByReason::default(),
        }
    }

    /// The rays, row by row from the top, if they are cast one by one; otherwise none.
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
