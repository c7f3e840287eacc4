//! The status line below the picture: present activity, progress of the picture, and its cost.

use eframe::egui::{self, ProgressBar, Ui};
use supervol::{FrameStats, Outlook, grey_levels, missing_in_words};
use supervol_scene::image::GREY_LEVELS;

use crate::state::panels::StatusHeight;
use crate::viewer::{Picture, Viewer};
use crate::worker::{Busy, Message};

/// Points between a text over the picture and its border.
const MARGIN: f32 = 10.0;

/// Explanation of [`accuracy`].
const ACCURACY: &str = "Difference from the picture of all data in full detail, in grey levels from 0 (black) to 255 \
                        (white). Asked: the largest allowed difference; half a level is invisible. Stated: the largest \
                        possible difference of the worst pixel; most pixels differ far less. It is known when the picture is \
                        finished";

/// Draws the line.
pub(crate) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    egui::Panel::bottom("status").show(ui, |ui| {
        let width = ui.available_width();
        if width != viewer.status_height.width {
            viewer.status_height = StatusHeight { width, height: 0.0 };
        }
        ui.set_min_height(viewer.status_height.height);
        let shown = ui.horizontal_wrapped(|ui| match &viewer.picture {
            Some(picture) => numbers(viewer, ui, picture),
            None => {
                ui.label("no picture yet");
            }
        });
        let room = &mut viewer.status_height;
        room.height = room.height.max(shown.response.rect.height());
    });
}

/// Draws activity and messages over the lower left of the picture. In a panel they would change the picture's size.
pub(crate) fn show_over(viewer: &mut Viewer, ui: &Ui, picture: egui::Rect) {
    if viewer.busy.is_none() && viewer.message.is_none() {
        return;
    }
    let corner = picture.left_bottom() + egui::vec2(MARGIN, -MARGIN);
    let area = egui::Area::new(egui::Id::unique("told")).fixed_pos(corner).pivot(egui::Align2::LEFT_BOTTOM);
    area.show(ui.ctx(), |ui| {
        egui::Frame::popup(ui.style()).show(ui, |ui| {
            ui.set_max_width((picture.width() - 4.0 * MARGIN).max(100.0));
            busy(viewer, ui);
            message(viewer, ui);
        });
    });
}

fn busy(viewer: &Viewer, ui: &mut Ui) {
    let Some(busy) = &viewer.busy else { return };
    ui.horizontal(|ui| {
        let (share, words) = match busy {
            Busy::Opening(path) => (None, format!("opening {}", path.display())),
            Busy::Reading(path) => (None, format!("reading {}", path.display())),
            Busy::Building(path, progress) => {
                let share = progress.bytes_done as f32 / progress.bytes_total.max(1) as f32;
                let [level, levels] = [progress.level + 1, progress.levels];
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                (
                    Some(share),
                    format!("building {name} into the cache: level {level} of {levels}, {:.0} %", 100.0 * share),
                )
            }
            Busy::Exporting(path, [done, rows]) => {
                let share = *done as f32 / (*rows).max(1) as f32;
                (Some(share), format!("exporting {}: {done} of {rows} rows", path.display()))
            }
            Busy::Animating(folder, [done, frames]) => {
                let share = *done as f32 / (*frames).max(1) as f32;
                (Some(share), format!("{}: {done} of {frames} pictures", folder.display()))
            }
        };
        match share {
            Some(share) => ui.add(ProgressBar::new(share).desired_width(200.0)),
            None => ui.spinner(),
        };
        ui.label(words);
        if matches!(busy, Busy::Exporting(..) | Busy::Animating(..)) && ui.button("Stop").clicked() {
            viewer.worker.iter().for_each(crate::worker::Worker::cancel_export);
        }
        if matches!(busy, Busy::Opening(_) | Busy::Building(..)) {
            let tip = "Stops the build. Finished parts stay in the cache folder. Opening the same file again continues the build. \
                       Closing the window has the same effect";
            if ui.button("Cancel").on_hover_text(tip).clicked() {
                viewer.worker.iter().for_each(crate::worker::Worker::cancel_build);
            }
        }
    });
}

fn message(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(message) = &viewer.message else { return };
    let mut is_read = false;
    ui.horizontal_wrapped(|ui| {
        match message {
            Message::Failure(text) => ui.colored_label(ui.visuals().error_fg_color, text),
            Message::Done(text) => ui.label(text),
        };
        is_read = ui.small_button("OK").clicked();
    });
    if is_read {
        viewer.message = None;
    }
}

/// Draws a number with a tooltip.
fn number(ui: &mut Ui, text: String, tip: &str) {
    ui.label(text).on_hover_text(tip);
    ui.separator();
}

fn numbers(viewer: &Viewer, ui: &mut Ui, picture: &Picture) {
    let stats = &picture.stats;
    if let Some([x, y, z]) = viewer.opened.as_ref().and_then(|opened| opened.preview_of) {
        let words = "Every n-th voxel, shown while the container is built; thin structures between them are missing";
        ui.colored_label(ui.visuals().warn_fg_color, format!("preview: one of {x} x {y} x {z} voxels"))
            .on_hover_text(words);
        ui.separator();
    }
    let outlook = if picture.is_converged { Outlook::Final } else { Outlook::GoesOn };
    let missing = missing_in_words(stats, outlook);
    if picture.is_converged {
        let rest = missing.as_ref().map_or("Nothing is missing", |_| "Waiting does not help any more");
        ui.strong("converged").on_hover_text(format!("Every pixel is finished. {rest}"));
    } else {
        let pixels = u64::from(stats.image_width) * u64::from(stats.image_height);
        let share = 100.0 * (1.0 - stats.pixels_unfinished as f64 / pixels.max(1) as f64);
        let edge = stats.coarsest_pixel;
        ui.strong(format!("refining {share:.0} %"))
            .on_hover_text(format!("The other pixels have 1/{edge} of the resolution in each direction"));
    }
    ui.separator();
    number(ui, accuracy(stats), ACCURACY);
    if let Some(missing) = missing {
        let words = "Parts of the volume that are not read yet are drawn with less detail until they are there. Parts \
                     that cannot be read stay so";
        ui.colored_label(ui.visuals().warn_fg_color, format!("missing: {missing}")).on_hover_text(words);
        ui.separator();
    }
    number(ui, format!("{:.0} ms", picture.spent_ms), "Time of drawing this picture so far");
    if let Some(latency) = viewer.latencies_ms.back() {
        number(ui, format!("{latency:.0} ms to first"), "Time from the last change to the first picture of it");
    }
    number(ui, levels(stats), "Levels of detail in memory; 0 is the finest");
    number(ui, bricks(stats), "Bricks in memory, bricks still to be read, and unreadable bricks");
    if let Some(ahead) = viewer.looked_ahead().filter(|ahead| ahead.page_ins > 0) {
        let words = "Bricks already read for the next picture, if the camera motion continues";
        number(ui, format!("{} ahead", ahead.page_ins), words);
    }
    let [cache, budget] = [stats.host_cache_bytes, stats.host_budget_bytes].map(mebibytes);
    number(ui, format!("{cache} of {budget} MiB"), "Memory of the bricks, and the limit for bricks, rays and pictures");
    let seconds = picture.spent_ms.max(1.0) / 1e3;
    let words = format!(
        "{} MiB read, {:.0} reads/s",
        mebibytes(stats.streaming.bytes_read),
        stats.streaming.reads as f64 / seconds
    );
    number(ui, words, "Bytes read from the file for this picture, and reads per second of drawing time");
    if let Some(failure) = stats.failures.first() {
        let words = format!("{}. A coarser brick replaces it", failure.reason);
        let label = format!("{} could not be read", failure.brick);
        ui.colored_label(ui.visuals().error_fg_color, label).on_hover_text(words);
    }
    let why = stats.no_gpu_because.as_ref().map_or(String::new(), |why| format!("; no GPU, because {why}"));
    let words = match stats.backend {
        "gpu" => format!("GPU{}", if stats.adapter_is_software { " (a processor)" } else { "" }),
        _ => format!("CPU, {} threads", stats.threads),
    };
    ui.label(words).on_hover_text(format!("Backend that casts the rays{why}"));
}

/// Requested and stated error of a picture.
fn accuracy(stats: &FrameStats) -> String {
    let asked = grey_levels(GREY_LEVELS * stats.max_error_requested);
    match &stats.error_stated {
        Some(stated) => format!("asked {asked}, stated {} of 255 grey levels", grey_levels(stated.largest_grey_levels)),
        None => format!("asked {asked} of 255 grey levels"),
    }
}

fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

fn levels(stats: &FrameStats) -> String {
    let there = stats.bricks_by_level.iter().filter(|level| level.resident + level.uniform > 0);
    let numbers: Vec<usize> = there.map(|level| level.level).collect();
    match (numbers.first(), numbers.last()) {
        (Some(first), Some(last)) if first < last => format!("levels {first} to {last}"),
        (Some(only), _) => format!("level {only}"),
        (None, _) => "no level".into(),
    }
}

fn bricks(stats: &FrameStats) -> String {
    let count = |names: &[&str]| names.iter().filter_map(|name| stats.bricks_by_state.get(name)).sum::<u64>();
    let [there, wanted] = [count(&["in_host", "uniform"]), count(&["queued", "reading", "decoding"])];
    format!("{there} bricks, {wanted} wanted, {} failed", stats.bricks_failed)
}

#[cfg(test)]
mod tests {
    use supervol::ErrorStated;

    use super::*;

    #[test]
    fn asked_and_stated_stand_side_by_side() {
        let stats = FrameStats { max_error_requested: 0.5 / 255.0, ..FrameStats::default() };
        assert_eq!(accuracy(&stats), "asked 0.5 of 255 grey levels");
        let stated = ErrorStated {
            largest_grey_levels: 4.8812,
            mean_grey_levels: 0.5,
            levels_grey_levels: 0.0,
            presence_may_change: false,
            pixels_unknown: 0,
        };
        let stats = FrameStats { error_stated: Some(stated), ..stats };
        assert_eq!(accuracy(&stats), "asked 0.5, stated 4.89 of 255 grey levels");
    }
}
