//! The volume in one region between slices: a picture of its own, drawn by the CPU or by a device.

use std::borrow::Cow;

use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::drawing::Drawing;
use super::resident::Resident;
use super::stages::{self, Best, Device};
use crate::render::error::RenderError;
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stop::Stop;

/// A region's progressive picture.
pub enum Region {
    /// Drawn by the CPU.
    InSteps(Box<Drawing>),
    /// Drawn by a device: the scene, and its best picture so far.
    InStages(Box<ResolvedScene>, Option<Box<Best>>),
}

impl Region {
    /// A picture that is not begun, for a device or for the CPU.
    #[must_use]
    pub fn new(scene: ResolvedScene, is_by_device: bool) -> Self {
        if is_by_device { Self::InStages(Box::new(scene), None) } else { Self::InSteps(Box::new(Drawing::new(scene))) }
    }

    /// Whether every pixel is finished.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        match self {
            Self::InSteps(drawing) => drawing.is_finished(),
            Self::InStages(_, best) => best.as_ref().is_some_and(|best| best.stats.converged),
        }
    }

    /// Whether each pixel is known at least coarsely.
    #[must_use]
    pub fn has_picture(&self) -> bool {
        match self {
            Self::InSteps(drawing) => drawing.has_picture(),
            Self::InStages(_, best) => best.is_some(),
        }
    }

    /// The picture so far.
    #[must_use]
    pub fn picture(&self) -> Option<Cow<'_, Image>> {
        match self {
            Self::InSteps(drawing) => drawing.picture(),
            Self::InStages(_, best) => best.as_ref().map(|best| Cow::Borrowed(&best.image)),
        }
    }

    /// See [`Drawing::error_map`].
    #[must_use]
    pub fn error_map(&self) -> Option<Image> {
        match self {
            Self::InSteps(drawing) => drawing.error_map(),
            Self::InStages(_, best) => best.as_ref()?.error_map(),
        }
    }

    /// See [`Drawing::work_map`]; devices do not count by pixel.
    #[must_use]
    pub fn work_map(&self) -> Option<Image> {
        match self {
            Self::InSteps(drawing) => drawing.work_map(),
            Self::InStages(..) => None,
        }
    }

    /// Statistics so far, including unfinished parts.
    #[must_use]
    pub fn stats(&self) -> FrameStats {
        match self {
            Self::InSteps(drawing) => drawing.stats(),
            Self::InStages(scene, None) => {
                FrameStats { backend: "gpu", pixels_unfinished: scene.pixels(), ..FrameStats::default() }
            }
            Self::InStages(_, Some(best)) => best.stats.clone(),
        }
    }

    /// Improves the picture until it is finished or `stop` is due. `device` draws the regions that are a device's.
    ///
    /// # Errors
    /// As [`Drawing::advance`] and [`stages::draw`].
    pub fn advance(
        &mut self,
        device: Option<&mut Device>,
        resident: &mut Resident,
        options: &RenderOptions,
        stop: &Stop,
    ) -> Result<(), RenderError> {
        match self {
            Self::InSteps(drawing) => drawing.advance(resident, options, stop),
            Self::InStages(scene, best) => {
                let device = device.expect("who makes pictures by a device has one");
                let before = best.take().map(|best| *best);
                *best = Some(Box::new(stages::draw(device, resident, scene, options, stop, before)?));
                Ok(())
            }
        }
    }
}
