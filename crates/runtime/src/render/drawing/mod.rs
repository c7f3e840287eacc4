//! Drawings: pictures in progress.
//!
//! Every way of drawing is a [`Drawing`]. It is advanced step by step, and can show its picture after each step:
//!
//! | drawing | for |
//! |---|---|
//! | [`StagedDrawing`](staged::StagedDrawing) | ray packets on the CPU, and devices: large pixels first, smaller ones as time allows |
//! | [`SlicedDrawing`](slices::SlicedDrawing) | scenes with slices: a staged drawing for each region between them |
//! | [`WholeDrawing`](whole::WholeDrawing) | all other engines: the whole picture in one step |
//!
//! [`means`]: the parts of a renderer that drawings share: the [`loaded`] volume, and a [`device`].

pub(crate) mod device;
mod device_stages;
pub(crate) mod loaded;
pub(crate) mod means;
mod packet_stages;
mod recast;
pub(crate) mod slices;
mod spread;
pub(crate) mod stage;
pub(crate) mod staged;
pub(crate) mod whole;

use std::borrow::Cow;

use supervol_scene::image::Image;

use self::means::Means;
use crate::engines::maps::Maps;
use crate::render::accuracy::stated::ErrorStated;
use crate::render::error::RenderError;
use crate::render::stats::FrameStats;
use crate::stop::Stop;

/// A picture in progress.
pub(crate) trait Drawing: Send {
    /// Improves the picture until it is finished or `stop` is due. With a deadline there is always a whole picture
    /// afterwards.
    ///
    /// # Errors
    /// If memory does not suffice, an engine fails, there is no progress, or it is cancelled before there is a whole
    /// picture.
    fn advance(&mut self, means: Means<'_>, stop: &Stop) -> Result<(), RenderError>;

    /// Whether every pixel is finished.
    fn is_finished(&self) -> bool;

    /// The picture so far, with the requested number of pixels; `None` until each pixel is known at least coarsely.
    fn picture(&self) -> Option<Cow<'_, Image>>;

    /// Consumes the drawing: returns the picture, with its maps.
    fn into_pictures(self: Box<Self>) -> Option<(Image, Maps)>;

    /// Error map: the error of each pixel, grey, 1 is white. Present if errors are summed up and there is a picture.
    fn error_map(&self) -> Option<Image>;

    /// Work map: cost of the rays of each pixel ([`of_work`](crate::engines::maps::of_work)). Present if work is counted
    /// and there is a picture.
    fn work_map(&self) -> Option<Image>;

    /// The stated errors in numbers.
    fn error_stated(&self) -> Option<ErrorStated>;

    /// Statistics so far, including unfinished parts.
    fn stats(&self) -> FrameStats;

    /// Consumes a drawing that is no longer needed: returns pixels whose memory the next one may reuse.
    fn into_memory(self: Box<Self>) -> Option<Image> {
        None
    }
}
