//! Outlines of bricks over the picture: failed bricks in red, and on request bricks in memory.

use eframe::egui::{Align2, Color32, FontId, Rect, Stroke, Ui};
use glam::DVec3;
use supervol_scene::preset::colormap;

use super::handles::{EDGES, Projector};
use super::picture::color;
use crate::viewer::Viewer;
use crate::worker::{Inspect, MARK_LIMIT};

const FAILED: Color32 = Color32::from_rgb(255, 40, 40);
/// Distance in points between lines of the legend, and between the legend and the border.
const LINE: f32 = 16.0;
const MARGIN: f32 = 8.0;

/// Colour of a level.
fn of_level(level: u8) -> Color32 {
    color(colormap::of_label(u64::from(level) + 1))
}

/// Draws the outlines and a legend of their colours.
pub(super) fn paint(viewer: &Viewer, ui: &Ui, rect: Rect) {
    let (Some(picture), Some(opened), Some(camera)) = (&viewer.picture, &viewer.opened, &viewer.scene.camera) else {
        return;
    };
    let painter = ui.painter().with_clip_rect(rect);
    let (projector, world) = (Projector { camera, rect }, opened.facts().geometry.world_from_index());
    for mark in &picture.marks {
        let corner = |n: usize| {
            let at: [f64; 3] = std::array::from_fn(|a| mark.corners[n >> a & 1][a]);
            projector.place(world.transform_point3(DVec3::from_array(at)))
        };
        let stroke = if mark.is_failed { Stroke::new(2.0, FAILED) } else { Stroke::new(1.0, of_level(mark.level)) };
        for (from, to) in EDGES {
            if let (Some(from), Some(to)) = (corner(from), corner(to)) {
                painter.line_segment([from, to], stroke);
            }
        }
    }
    let mut lines: Vec<(String, Color32)> = Vec::new();
    if picture.marks.iter().any(|mark| mark.is_failed) {
        lines.push(("not readable: replaced by coarser bricks".into(), FAILED));
    }
    if viewer.settings.inspect == Inspect::Bricks {
        let mut levels: Vec<u8> = picture.marks.iter().filter(|mark| !mark.is_failed).map(|mark| mark.level).collect();
        levels.dedup();
        lines.extend(levels.into_iter().map(|level| (format!("level {level}"), of_level(level))));
        if picture.marks.len() >= MARK_LIMIT {
            lines.push((format!("only the first {MARK_LIMIT} bricks are shown"), Color32::GRAY));
        }
    }
    for (i, (words, color)) in lines.into_iter().enumerate() {
        let at = rect.left_top() + eframe::egui::vec2(MARGIN, MARGIN + LINE * i as f32);
        painter.text(at, Align2::LEFT_TOP, words, FontId::proportional(13.0), color);
    }
}
