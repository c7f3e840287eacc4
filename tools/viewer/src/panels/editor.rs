//! The transfer-function editor: logarithmic histogram, opacities over it, colours below.
//!
//! Opacities are drawn as their cube root, because relevant opacities are far below 0.1.

use std::ops::RangeInclusive;

use eframe::egui::{self, Color32, DragValue, PointerButton, Pos2, Rect, Sense, Shape, Stroke, Ui};
use supervol_format::cast::{narrow, single, whole};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::scene::{PointSpec, Scene};

use crate::edit;
use crate::viewer::Viewer;
use crate::worker::OpenVolume;

/// Heights of the diagram and of the colour strip, in points.
const HEIGHT: f32 = 150.0;
const STRIP: f32 = 14.0;
/// Distance in points at which the mouse picks a control point.
const REACH: f32 = 9.0;
/// Radius of a control point, in points.
pub(super) const RADIUS: f32 = 4.5;
/// Degree of the root at which opacities are drawn.
const ROOT: f64 = 3.0;
/// Free share of the diagram's width beyond the values shown.
const MARGIN: f64 = 0.02;

/// Conversion between (value, opacity) and points of the window.
struct Axes {
    rect: Rect,
    values: RangeInclusive<f64>,
}

impl Axes {
    /// Axes that cover all values of the volume and of control points.
    fn new(rect: Rect, facts: &VolumeFacts, points: &[PointSpec]) -> Self {
        let ends = points.iter().map(|p| p.value).filter(|v| v.is_finite());
        let (low, high) =
            ends.fold((facts.central_range.min, facts.central_range.max), |(l, h), v| (l.min(v), h.max(v)));
        let margin = (MARGIN * (high - low)).max(f64::MIN_POSITIVE);
        Self { rect, values: low - margin..=high + margin }
    }

    fn x(&self, value: f64) -> f32 {
        let (low, high) = (self.values.start(), self.values.end());
        self.rect.left() + single((value - low) / (high - low)) * self.rect.width()
    }

    fn place(&self, value: f64, alpha: f64) -> Pos2 {
        Pos2::new(self.x(value), self.rect.bottom() - single(alpha.powf(1.0 / ROOT)) * self.rect.height())
    }

    /// The value and the opacity at a point of the window.
    fn at(&self, place: Pos2) -> (f64, f64) {
        let (low, high) = (self.values.start(), self.values.end());
        let across = f64::from((place.x - self.rect.left()) / self.rect.width().max(1.0)).clamp(0.0, 1.0);
        let up = f64::from((self.rect.bottom() - place.y) / self.rect.height().max(1.0)).clamp(0.0, 1.0);
        (low + across * (high - low), up.powf(ROOT))
    }
}

/// Draws the editor and the fields of the selected control point.
pub(super) fn show(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    let Some(spec) = edit::points_mut(&mut viewer.scene) else {
        ui.weak("This scene uses a preset. Choose a preset above to edit it.");
        return;
    };
    let size = egui::vec2(ui.available_width(), HEIGHT);
    let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
    let response = response.accessible_name("Transfer function").on_hover_text_at_pointer(
        "Bars: number of voxels by value, logarithmic. Line: opacity (cube root). Drag a point to move it, double click to add one, \
         right click to remove one",
    );
    let axes = Axes::new(rect.shrink2(egui::vec2(4.0, 8.0)), opened.facts(), &spec.points);
    let chosen = &mut viewer.panel_state.chosen;
    *chosen = chosen.filter(|i| *i < spec.points.len());
    let pointer = ui.input(|input| input.pointer.press_origin().filter(|_| response.drag_started()));
    let at = pointer.or_else(|| response.interact_pointer_pos());
    let near = |points: &[PointSpec], at: Pos2| {
        let distance = |i: &usize| axes.place(points[*i].value, points[*i].alpha).distance(at);
        let nearest = (0..points.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)));
        nearest.filter(|i| distance(i) <= REACH)
    };
    if let Some(at) = at {
        let (value, alpha) = axes.at(at);
        if response.double_clicked_by(PointerButton::Primary) && near(&spec.points, at).is_none() {
            *chosen = edit::add_point(&mut spec.points, value, alpha);
        } else if response.secondary_clicked() {
            if let Some(i) = near(&spec.points, at) {
                edit::remove_point(&mut spec.points, i);
                *chosen = None;
            }
        } else if response.drag_started_by(PointerButton::Primary) || response.clicked() {
            *chosen = near(&spec.points, at);
        } else if response.dragged_by(PointerButton::Primary)
            && let Some(i) = *chosen
        {
            edit::move_point(&mut spec.points, i, value, alpha);
        }
    }
    let chosen = *chosen;
    paint(ui, &axes, rect, opened.facts(), &spec.points, chosen);
    strip(ui, &axes, &viewer.scene);
    numbers(viewer, opened, ui);
}

fn paint(ui: &Ui, axes: &Axes, rect: Rect, facts: &VolumeFacts, points: &[PointSpec], chosen: Option<usize>) {
    let painter = ui.painter().with_clip_rect(rect);
    let visuals = ui.visuals();
    painter.rect_filled(rect, 2.0, visuals.extreme_bg_color);
    histogram(&painter, axes, facts, visuals.weak_text_color().gamma_multiply(0.6));
    let (low, high) = (*axes.values.start(), *axes.values.end());
    // The opacity is constant beyond the ends.
    let ends = points.first().map(|p| (low, p.alpha)).into_iter();
    let line = ends.chain(points.iter().map(|p| (p.value, p.alpha))).chain(points.last().map(|p| (high, p.alpha)));
    // Linear opacity is a curve in the cube root.
    let corners: Vec<(f64, f64)> = line.collect();
    let mut curve = Vec::new();
    for pair in corners.windows(2) {
        const PARTS: i32 = 12;
        curve.extend((0..=PARTS).map(|k| {
            let share = f64::from(k) / f64::from(PARTS);
            let between = |a: f64, b: f64| a + share * (b - a);
            axes.place(between(pair[0].0, pair[1].0), between(pair[0].1, pair[1].1))
        }));
    }
    painter.add(Shape::line(curve, Stroke::new(1.5, visuals.strong_text_color())));
    for (i, point) in points.iter().enumerate() {
        let place = axes.place(point.value, point.alpha);
        let stroke = if chosen == Some(i) {
            Stroke::new(2.5, visuals.selection.stroke.color)
        } else {
            Stroke::new(1.0, visuals.strong_text_color())
        };
        painter.circle(place, RADIUS, color(point.color), stroke);
    }
}

fn histogram(painter: &egui::Painter, axes: &Axes, facts: &VolumeFacts, fill: Color32) {
    let (counts, range) = (&facts.histogram, facts.central_range);
    let x = |bar: usize| axes.x(range.min + range.width() * bar as f64 / counts.len() as f64);
    bars(painter, axes.rect, counts, x, fill);
}

/// Draws bars by the logarithms of counts. `x` returns the left end of a bar.
pub(super) fn bars(painter: &egui::Painter, rect: Rect, counts: &[u64], x: impl Fn(usize) -> f32, fill: Color32) {
    let most = counts.iter().copied().max().unwrap_or(0) as f64;
    if most < 1.0 {
        return;
    }
    let bottom = rect.bottom();
    // One mesh: separate rectangles would be rounded to pixels individually and leave gaps.
    let mut mesh = egui::Mesh::default();
    for (bar, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let height = single((count as f64 + 1.0).ln() / (most + 1.0).ln()) * rect.height();
        mesh.add_colored_rect(Rect::from_x_y_ranges(x(bar)..=x(bar + 1), bottom - height..=bottom), fill);
    }
    painter.add(Shape::mesh(mesh));
}

/// Draws the colours over the same values, as if they were opaque.
fn strip(ui: &mut Ui, axes: &Axes, scene: &Scene) {
    let (rect, _) = ui.allocate_exact_size(egui::vec2(ui.available_width(), STRIP), Sense::hover());
    let Some(spec) = edit::points(scene) else { return };
    let Some((first, last)) = spec.points.first().zip(spec.points.last()) else { return };
    let mut mesh = egui::Mesh::default();
    let mut add = |x: f32, rgb: [f64; 3]| {
        mesh.colored_vertex(Pos2::new(x, rect.top()), color(rgb));
        mesh.colored_vertex(Pos2::new(x, rect.bottom()), color(rgb));
    };
    add(axes.rect.left(), first.color);
    spec.points.iter().for_each(|p| add(axes.x(p.value), p.color));
    add(axes.rect.right(), last.color);
    for i in 0..narrow::<u32>(spec.points.len()) + 1 {
        mesh.add_triangle(2 * i, 2 * i + 1, 2 * i + 2);
        mesh.add_triangle(2 * i + 1, 2 * i + 2, 2 * i + 3);
    }
    ui.painter().add(Shape::mesh(mesh));
}

fn color(rgb: [f64; 3]) -> Color32 {
    let [r, g, b] = rgb.map(|c| whole::<u8>((255.0 * c.clamp(0.0, 1.0)).round()));
    Color32::from_rgb(r, g, b)
}

/// Draws the fields of the selected control point.
fn numbers(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    let chosen = viewer.panel_state.chosen;
    let Some(spec) = edit::points_mut(&mut viewer.scene) else { return };
    let Some((i, point)) = chosen.and_then(|i| spec.points.get(i).map(|p| (i, *p))) else {
        ui.weak(format!("{} points; click one to edit its numbers", spec.points.len()));
        return;
    };
    let (mut value, mut alpha, mut rgb) = (point.value, point.alpha, point.color.map(single));
    let speed = (opened.facts().central_range.width() / 500.0).max(f64::MIN_POSITIVE);
    let mut is_removed = false;
    ui.horizontal(|ui| {
        ui.color_edit_button_rgb(&mut rgb).accessible_name("Colour of the point");
        let unit = &opened.container().manifest().unit;
        ui.add(DragValue::new(&mut value).speed(speed).max_decimals(4))
            .on_hover_text(format!("Value {unit}"))
            .accessible_name("Value of the point");
        ui.add(DragValue::new(&mut alpha).speed(0.002).range(0.0..=1.0).clamp_existing_to_range(false).max_decimals(4))
            .on_hover_text("Opacity over the unit distance, 0 to 1")
            .accessible_name("Opacity of the point");
        is_removed = ui.small_button("Remove").clicked();
    });
    if (value, alpha) != (point.value, point.alpha) {
        edit::move_point(&mut spec.points, i, value, alpha);
    }
    if rgb != point.color.map(single) {
        spec.points[i].color = rgb.map(f64::from);
    }
    if is_removed {
        edit::remove_point(&mut spec.points, i);
        viewer.panel_state.chosen = None;
    }
}
