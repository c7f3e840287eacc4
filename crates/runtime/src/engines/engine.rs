//! Interface of an engine, which draws a picture from bricks that arrive one after the other.
//!
//! Protocol, for each band of pixel rows:
//! 1. [`Engine::begin`].
//! 2. [`Engine::advance`]: works as far as the bricks of the view allow; returns the used bricks, the wanted bricks and
//!    the remaining work.
//! 3. [`Engine::update`] with the fetched bricks; again from 2 until nothing remains.
//! 4. [`Engine::write_image`].
//!
//! The interface knows no rays. A ray caster wants the bricks that its rays have reached. Another engine may go through
//! the volume slice by slice, or know its working set beforehand. It wants all these bricks at once, and gets as many
//! as fit, in its own order ([`Engine::order`]). Used bricks that it does not want again leave the cache first. An
//! engine that reads the host cache directly ignores `update`; one with its own memory copies there.

use std::ops::Range;

use supervol_scene::image::Image;

use super::error::EngineError;
use super::maps::Maps;
use super::totals::EngineTotals;
use crate::stop::Stop;
use crate::stream::field::FieldBrick;
use crate::stream::priority::BrickOrder;
use crate::stream::streamer::{Fetched, HostView};

/// Progress of an engine.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Advance {
    /// Bricks that it waits for, each once.
    pub wanted: Vec<FieldBrick>,
    /// Resident bricks that it used, each once.
    pub used: Vec<FieldBrick>,
    /// Unfinished work in the engine's own unit (rays, slices); 0 if the band is done.
    pub remaining: u64,
    /// Times that a coarser brick replaced a wanted one.
    pub stood_in: u64,
    /// Whether the stop condition ended the pass before every ray was finished or waited.
    pub is_stopped: bool,
}

/// Makes a picture from resident bricks.
pub trait Engine {
    /// Most bricks that it accepts between two passes; at least 1.
    fn room(&self) -> usize {
        usize::MAX
    }

    /// Most rows of pixels in a band.
    fn band_rows(&self) -> u32 {
        u32::MAX
    }

    /// Order in which it goes through bricks; `None`: front to back from the camera of the streamer.
    fn order(&self) -> Option<BrickOrder> {
        None
    }

    /// Begins these rows of pixels, numbered from the top.
    ///
    /// # Errors
    /// If a device fails.
    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), EngineError>;

    /// Works as far as the resident bricks allow.
    ///
    /// # Errors
    /// If a device fails.
    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, EngineError>;

    /// Receives the fetched bricks; the view holds their voxels and states.
    ///
    /// # Errors
    /// If a device fails.
    fn update(&mut self, _view: &HostView<'_>, _fetched: &Fetched) -> Result<(), EngineError> {
        Ok(())
    }

    /// Writes the picture of the band over as many pixels, row by row.
    ///
    /// # Errors
    /// If a device fails.
    fn write_image(&mut self, to: &mut [[f32; 4]]) -> Result<(), EngineError>;

    /// Maps of the finished pixels of the band; empty unless they were requested and the engine has them.
    fn pixel_maps(&mut self) -> Maps {
        Maps::default()
    }

    /// Sums so far.
    fn totals(&self) -> EngineTotals;
}

/// An engine that pauses at a stop condition, and continues from there.
pub trait InSteps: Engine {
    /// Sets a new stop condition.
    fn stop_at(&mut self, stop: &Stop);

    /// The pixels of the band that are finished; NaN elsewhere.
    fn finished_pixels(&mut self) -> Image;
}
