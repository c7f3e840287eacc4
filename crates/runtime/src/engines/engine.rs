//! What a frame asks of an engine: of whatever makes a picture of bricks that come one after the other.
//!
//! Protocol, for each band of pixel rows:
//! 1. [`Engine::begin`].
//! 2. [`Engine::advance`]: it goes as far as the bricks of the view allow, and says which it used, which it wants, and how much remains.
//! 3. [`Engine::update`] with what was fetched for it; again from 2 until nothing remains.
//! 4. [`Engine::write_image`].
//!
//! Nothing here knows rays. A ray caster wants the bricks that its rays have come to; an engine that goes through the volume slice by
//! slice, or that knows its working set beforehand, wants these at once and gets as many as there is room for, in its own order
//! ([`Engine::order`]): what it used and does not want again leaves first. An engine that reads the host cache directly ignores
//! `update`; one with a memory of its own copies there.

use std::ops::Range;

use supervol_scene::image::Image;

use super::error::EngineError;
use super::maps::Maps;
use super::totals::EngineTotals;
use crate::stop::Stop;
use crate::stream::field::FieldBrick;
use crate::stream::priority::BrickOrder;
use crate::stream::streamer::{Fetched, HostView};

/// How far an engine came.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Advance {
    /// Bricks that it waits for, each once.
    pub wanted: Vec<FieldBrick>,
    /// Resident bricks that it used, each once.
    pub used: Vec<FieldBrick>,
    /// What is not finished, in units of the engine's own (rays, slices); 0 where the band is done.
    pub remaining: u64,
    /// Times a coarser brick stood in for one that was wanted.
    pub stood_in: u64,
    /// Whether it was time to stop before all was finished or waited.
    pub is_stopped: bool,
}

/// Makes a picture from resident bricks.
pub trait Engine {
    /// Bricks that can be handed over between two passes; at least 1.
    fn room(&self) -> usize {
        usize::MAX
    }

    /// Most rows of pixels that are begun at once.
    fn band_rows(&self) -> u32 {
        u32::MAX
    }

    /// The order in which it goes through bricks; `None`: front to back from the camera that the streamer was made for.
    fn order(&self) -> Option<BrickOrder> {
        None
    }

    /// Begins these rows of pixels, numbered from the top.
    ///
    /// # Errors
    /// If a device fails.
    fn begin(&mut self, pixel_rows: Range<u32>) -> Result<(), EngineError>;

    /// Goes as far as the bricks allow.
    ///
    /// # Errors
    /// If a device fails.
    fn advance(&mut self, view: &HostView<'_>) -> Result<Advance, EngineError>;

    /// Takes note of what was fetched; the view holds the bricks and the answers.
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

    /// What is known of the finished pixels of the band besides, where that was asked for and the engine can say it.
    fn pixel_maps(&mut self) -> Maps {
        Maps::default()
    }

    /// Sums so far.
    fn totals(&self) -> EngineTotals;
}

/// An engine that stops when it is time to, and goes on from there.
pub trait InSteps: Engine {
    /// It stops where it is when this is due, instead of when it was to stop before.
    fn stop_at(&mut self, stop: &Stop);

    /// The pixels of the band that are finished; NaN elsewhere.
    fn finished_pixels(&mut self) -> Image;
}
