//! Controls of opacity by the gradient: a switch, the histogram of the lengths of the gradient with a ramp over it, and the
//! ramp's numbers.

use eframe::egui::{Align2, DragValue, Painter, Pos2, Rect, Sense, Shape, Stroke, TextStyle, Ui, Vec2};
use supervol_format::cast::single;
use supervol_preprocess::gradients;

use super::editor::{RADIUS, bars};
use crate::edit;
use crate::state::gradients::CountState;
use crate::viewer::{GradientHistogram, Viewer};
use crate::worker::OpenVolume;

/// Height of the diagram, in points.
const HEIGHT: f32 = 70.0;
/// Size of the area of a handle that responds to the mouse, in points.
const GROUND: f32 = 16.0;
/// Free border of the diagram around the ends of the ramp, in points.
const BORDER: Vec2 = Vec2::new(7.0, 7.0);
/// Parts of the histogram's end that a number changes by with each point of a drag.
const PARTS: f64 = 500.0;
/// Names and meanings of the ramp's ends.
const ENDS: [(&str, &str); 2] = [
    ("Gradient where opacity begins", "Length of the gradient up to which nothing shows"),
    ("Gradient of full opacity", "Length of the gradient from which the whole opacity shows"),
];
/// Explanation of the switch.
const SWITCH: &str = "Shows boundaries and makes even regions transparent: the steeper the values change, the more of the \
                      opacity counts (--gradient-opacity). The processor draws it; pictures take several times as long";
/// Explanation of the diagram.
const DIAGRAM: &str = "Bars: number of voxels by length of the gradient, logarithmic, up to the 99.9th percentile. Line: share of the \
                       opacity, from none to all. Drag its ends";

/// Draws the controls.
pub(super) fn show(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    let mut is_on = viewer.gradients.is_on(&viewer.scene);
    if ui.checkbox(&mut is_on, "Opacity by the gradient").on_hover_text(SWITCH).changed() {
        if is_on {
            viewer.gradients.switch_on(ui.ctx(), opened, &mut viewer.scene);
        } else {
            viewer.gradients.switch_off(opened, &mut viewer.scene);
        }
    }
    if is_on {
        viewer.gradients.begin(ui.ctx(), opened);
        let histogram = viewer.gradient_histogram();
        diagram(viewer, histogram.as_ref(), ui);
        numbers(viewer, histogram.as_ref(), opened, ui);
    }
}

/// Draws the histogram, the ramp and its handles.
fn diagram(viewer: &mut Viewer, histogram: Option<&GradientHistogram>, ui: &mut Ui) {
    let (rect, response) = ui.allocate_exact_size(Vec2::new(ui.available_width(), HEIGHT), Sense::hover());
    response.on_hover_text_at_pointer(DIAGRAM);
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let words = match viewer.gradients.state() {
        CountState::Counting(share) => Some(format!("counting gradients: {:.0} %", 100.0 * share)),
        CountState::Failed => Some("no histogram: a brick cannot be read".into()),
        CountState::Done => None,
    };
    if let Some(words) = words {
        let font = TextStyle::Body.resolve(ui.style());
        painter.text(rect.center(), Align2::CENTER_CENTER, words, font, ui.visuals().weak_text_color());
    }
    let inner = rect.shrink2(BORDER);
    let Some(end) = histogram.map(|h| h.end).or(viewer.scene.gradient_opacity.map(|[_, to]| to)) else {
        return;
    };
    let x = |length: f64| inner.left() + single(length / end) * inner.width();
    if let Some(histogram) = histogram {
        let fill = ui.visuals().weak_text_color().gamma_multiply(0.6);
        let parts = histogram.counts.len() as f64;
        bars(&painter, inner, &histogram.counts, |bar| x(end * bar as f64 / parts), fill);
    }
    let Some(ramp) = viewer.scene.gradient_opacity else { return };
    let places = [Pos2::new(x(ramp[0]), inner.bottom()), Pos2::new(x(ramp[1]), inner.top())];
    line(&painter, ui, inner, places);
    for (i, at) in places.into_iter().enumerate() {
        let ground = Rect::from_center_size(at, Vec2::splat(GROUND));
        let handle = ui.interact(ground, ui.scope_id().with(("gradient", i)), Sense::drag());
        let handle = handle.accessible_name(format!("{}, handle", ENDS[i].0)).on_hover_text(ENDS[i].1);
        if let Some(to) = handle.interact_pointer_pos().filter(|_| handle.dragged()) {
            let share = ((to.x - inner.left()) / inner.width().max(1.0)).clamp(0.0, 1.0);
            viewer.scene.gradient_opacity = Some(edit::with_gradient_end(ramp, i, end * f64::from(share)));
        }
        let visuals = ui.visuals();
        let is_lit = handle.hovered() || handle.dragged();
        let stroke = if is_lit { visuals.selection.stroke.color } else { visuals.strong_text_color() };
        painter.circle(at, RADIUS, visuals.weak_text_color(), Stroke::new(if is_lit { 2.5 } else { 1.0 }, stroke));
    }
}

/// Draws the ramp: no opacity before it, all of it beyond.
fn line(painter: &Painter, ui: &Ui, inner: Rect, [from, to]: [Pos2; 2]) {
    let corners = vec![inner.left_bottom(), from, to, inner.right_top()];
    painter.add(Shape::line(corners, Stroke::new(1.5, ui.visuals().strong_text_color())));
}

/// Draws the fields of the ramp's ends.
fn numbers(viewer: &mut Viewer, histogram: Option<&GradientHistogram>, opened: &OpenVolume, ui: &mut Ui) {
    let Some(ramp) = viewer.scene.gradient_opacity else { return };
    let speed = histogram.map_or(ramp[1], |h| h.end) / PARTS;
    let unit = gradients::unit(opened.container().manifest());
    let mut changed = None;
    ui.horizontal(|ui| {
        for (i, (word, (name, words))) in ["From", "to"].into_iter().zip(ENDS).enumerate() {
            let mut length = ramp[i];
            ui.label(word);
            let response = ui
                .add(DragValue::new(&mut length).speed(speed.max(f64::MIN_POSITIVE)).max_decimals(4))
                .on_hover_text(format!("{words}, {unit}"))
                .accessible_name(name);
            if response.changed() {
                changed = Some((i, length));
            }
        }
    });
    ui.weak(&unit);
    if let Some((i, length)) = changed {
        viewer.scene.gradient_opacity = Some(edit::with_gradient_end(ramp, i, length));
    }
}
