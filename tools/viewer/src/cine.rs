//! Cine: slices one after the other, at a rate, from the first to the last and again.
//!
//! It moves the section of a panel, or the slice that is shown in place of the volume. No slice is left out: the next one
//! follows when the picture of the present one is on the screen.

use std::time::Duration;

use eframe::egui;

use crate::viewer::Viewer;
use crate::worker::PANELS;

/// Least and greatest rate, in slices per second.
pub const RATES: std::ops::RangeInclusive<f64> = 0.5..=60.0;

/// State of the cine.
#[derive(Debug, Clone, Copy)]
pub struct Cine {
    /// Whether it runs.
    pub(crate) is_running: bool,
    /// Slices per second, at most.
    pub(crate) rate: f64,
    /// The grid's axis along which panels run.
    pub(crate) axis: usize,
    /// Time of the next slice, in seconds of the window's clock.
    due: f64,
}

impl Default for Cine {
    fn default() -> Self {
        Self { is_running: false, rate: 10.0, axis: PANELS - 1, due: 0.0 }
    }
}

impl Cine {
    /// Whether the cine runs.
    #[must_use]
    pub fn is_running(&self) -> bool {
        self.is_running
    }
}

/// Moves to the next slice if it is due, and requests a frame for the following one.
pub(crate) fn advance(viewer: &mut Viewer, ctx: &egui::Context) {
    let Some(opened) = viewer.opened.clone().filter(|_| viewer.cine.is_running) else { return };
    // The shown panel, if it is another one.
    if !viewer.sections.layout.shows(viewer.cine.axis) {
        viewer.cine.axis = (0..PANELS).find(|axis| viewer.sections.layout.shows(*axis)).unwrap_or(viewer.cine.axis);
    }
    let axis = viewer.slice.as_ref().map_or(viewer.cine.axis, |slice| slice.axis);
    let is_shown = match &viewer.slice {
        Some(_) => viewer.is_up_to_date(),
        None => match viewer.sections.panel(axis) {
            Some(panel) => panel.shows_request(),
            // Nothing that could move is on the screen.
            None => {
                viewer.cine.is_running = false;
                return;
            }
        },
    };
    let now = ctx.input(|input| input.time);
    // The worker requests a frame when the picture arrives.
    if !is_shown {
        return;
    }
    if now >= viewer.cine.due {
        let count = opened.facts().dims.0[axis];
        match viewer.slice.as_ref().map(|slice| slice.at) {
            Some(at) => viewer.set_slice(Some((axis, (at + 1) % count))),
            None => {
                let mut cursor = viewer.sections.cursor;
                cursor[axis] = if cursor[axis] + 1.0 < count as f64 { cursor[axis] + 1.0 } else { 0.0 };
                viewer.sections.move_to(cursor, opened.facts(), &mut viewer.scene);
            }
        }
        // A slice that came late does not make the next ones come early.
        viewer.cine.due = (viewer.cine.due + viewer.cine.rate.recip()).max(now);
    }
    let wait = (viewer.cine.due - now).max(0.0);
    ctx.request_repaint_after(Duration::from_secs_f64(wait));
}
