//! The picture and its mouse actions.

use eframe::egui::text::LayoutJob;
use eframe::egui::{self, Align, Color32, FontId, PointerButton, Pos2, Rect, Response, Sense, Ui, Vec2};
use supervol_format::cast::whole;
use supervol_scene::preset::windows;
use supervol_scene::scene::{ImageSpec, RAY_LIMIT};
use supervol_sources::formats;

use super::{handles, marks, sections};
use crate::sections::Layout;
use crate::viewer::Viewer;
use crate::worker::Busy;
use crate::{edit, navigate};

/// Degrees of rotation per point of a drag.
const TURN_PER_POINT: f64 = 0.4;
/// Scrolled points that reduce the distance to the target by a factor of e.
const SCROLL_POINTS: f64 = 300.0;
/// Scrolled points that move a slice by a step: one notch of most wheels.
const SLICE_POINTS: f64 = 40.0;
/// Factor of the distance for a double click.
const DOUBLE_CLICK: f64 = 0.5;
/// Most pixels of the picture along a side, whatever the screen supports.
const SIDE_LIMIT: u32 = 16_384;

/// Width of the instructions, as a share of the picture.
const INSTRUCTIONS_WIDTH: f32 = 0.8;

/// Draws the picture in the remaining room.
pub(crate) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    let frame = egui::Frame::NONE.fill(color(viewer.scene.image.background));
    egui::CentralPanel::default().frame(frame).show(ui, |ui| {
        let (whole, _) = ui.allocate_exact_size(ui.available_size(), Sense::hover());
        let layout = if viewer.opened.is_some() { viewer.sections.layout } else { Layout::Alone };
        let panel_rects = sections::panel_rects(layout, whole);
        let rect = panel_rects.picture;
        let response = ui.interact(rect, ui.scope_id().with("picture"), Sense::click_and_drag());
        let response = response.accessible_name("Picture");
        sections::show(viewer, ui, &panel_rects);
        fit(viewer, ui, rect);
        move_slice(viewer, ui, &response);
        move_camera(viewer, ui, &response);
        probe_under_mouse(viewer, &response);
        paint(viewer, ui, rect);
        if response.contains_pointer()
            && let Some(opened) = viewer.opened.clone()
        {
            sections::draw_point_description(viewer, &opened, None, &ui.painter().with_clip_rect(rect), rect);
        }
        marks::paint(viewer, ui, rect);
        handles::show(viewer, ui, &response);
        if viewer.opened.is_none() {
            draw_instructions(viewer, ui, rect);
        }
        super::status::show_over(viewer, ui, rect);
    });
}

pub(super) fn color(rgb: [f64; 3]) -> Color32 {
    let [r, g, b] = rgb.map(|c| whole::<u8>((255.0 * c.clamp(0.0, 1.0)).round()));
    Color32::from_rgb(r, g, b)
}

/// Number of screen pixels of a rectangle, along x and y.
pub(super) fn pixels_of(ui: &Ui, rect: Rect) -> [u32; 2] {
    let most = ui.input(|input| u32::try_from(input.max_texture_side).unwrap_or(SIDE_LIMIT)).min(SIDE_LIMIT);
    [rect.width(), rect.height()].map(|points| whole::<u32>((points * ui.pixels_per_point()).round()).clamp(1, most))
}

/// Sets the size of the scene's picture to the number of screen pixels.
fn fit(viewer: &mut Viewer, ui: &Ui, rect: Rect) {
    let [width, height] = pixels_of(ui, rect);
    let samples = u64::from(viewer.scene.samples_per_pixel.unwrap_or(1));
    if u64::from(width) * u64::from(height) * samples <= RAY_LIMIT {
        viewer.scene.image = ImageSpec { width, height, ..viewer.scene.image };
    }
}

/// Normalised position in the picture of a point of the window; y points up.
pub(super) fn place(rect: Rect, at: Pos2) -> [f64; 2] {
    let share = (at - rect.min) / rect.size().max(Vec2::splat(1.0));
    [2.0 * f64::from(share.x) - 1.0, 1.0 - 2.0 * f64::from(share.y)]
}

/// With Alt, the wheel moves the shown or the selected slice. This lasts until scrolling has stopped; otherwise
/// releasing Alt would move the camera by the rest.
fn move_slice(viewer: &mut Viewer, ui: &Ui, response: &Response) {
    let (is_meant, scrolled) = ui.input(|input| (input.modifiers.alt, f64::from(input.smooth_scroll_delta().y)));
    let before = viewer.panel_state.wheel_points.filter(|_| is_meant || scrolled != 0.0);
    viewer.panel_state.wheel_points = before.or((is_meant && response.contains_pointer()).then_some(0.0));
    let Some(points) = &mut viewer.panel_state.wheel_points else { return };
    let steps = wheel_steps(points, scrolled);
    if steps != 0.0 {
        viewer.step_slice(steps);
    }
}

/// Whole steps of the wheel. Adds the scrolled points to the rest in `points`, and leaves the new rest there.
pub(super) fn wheel_steps(points: &mut f64, scrolled: f64) -> f64 {
    *points += scrolled;
    // Smoothed scrolling over several frames adds up to a whole notch, up to rounding.
    let steps = (*points / SLICE_POINTS + 1e-3 * points.signum()).trunc();
    *points -= steps * SLICE_POINTS;
    steps
}

/// Requests a probe of the point under the mouse if the picture has converged. With panels, a click moves their cursor
/// there.
fn probe_under_mouse(viewer: &mut Viewer, response: &Response) {
    let Some(opened) = viewer.opened.clone() else { return };
    let Some(at) = response.hover_pos().filter(|_| response.contains_pointer()) else { return };
    let is_ready = viewer.picture.as_ref().is_some_and(|picture| picture.is_converged) && viewer.is_up_to_date();
    if !is_ready || response.dragged() {
        return;
    }
    let number = sections::probe(viewer, &opened, None, place(response.rect, at));
    if response.clicked() && viewer.sections.layout != Layout::Alone {
        viewer.sections.moving = number;
        // The answer may have arrived before the click.
        if let Some(probed) = viewer.sections.probed().cloned() {
            viewer.receive_answer(probed);
        }
    }
}

fn move_camera(viewer: &mut Viewer, ui: &Ui, response: &Response) {
    let (Some(opened), Some(camera)) = (&viewer.opened, &viewer.scene.camera) else { return };
    let (stage, rect) = (edit::stage(opened.facts()), response.rect);
    let aspect = f64::from(rect.width() / rect.height().max(1.0));
    let delta = response.drag_delta();
    let mut moved = None;
    if delta != Vec2::ZERO && viewer.slice.is_some() && ui.input(|input| input.modifiers.command) {
        let share = delta / rect.size().max(Vec2::splat(1.0));
        if let Some(window) = edit::window(&viewer.scene) {
            let dragged = windows::dragged(window, [f64::from(share.x), -f64::from(share.y)]);
            edit::set_window(&mut viewer.scene, dragged);
        }
        return;
    }
    if delta != Vec2::ZERO {
        let moves = !response.dragged_by(PointerButton::Primary) || ui.input(|input| input.modifiers.shift);
        moved = Some(if moves {
            let height = f64::from(rect.height().max(1.0));
            navigate::pan(camera, [f64::from(delta.x) / height, -f64::from(delta.y) / height])
        } else {
            // The object follows the mouse, so the camera turns the other way.
            navigate::orbit(camera, &stage, [-TURN_PER_POINT * f64::from(delta.x), TURN_PER_POINT * f64::from(delta.y)])
        });
    }
    let at = response.hover_pos().map(|at| place(rect, at));
    if let Some(cursor) = at.filter(|_| response.contains_pointer()) {
        let is_slices = viewer.panel_state.wheel_points.is_some();
        let (scroll, zoom) = ui.input(|input| {
            let scroll = if is_slices { 0.0 } else { f64::from(input.smooth_scroll_delta().y) };
            (scroll, f64::from(input.zoom_delta()))
        });
        let factor = (-scroll / SCROLL_POINTS).exp() / zoom;
        if factor != 1.0 {
            moved = Some(navigate::dolly(moved.as_ref().unwrap_or(camera), &stage, factor, cursor, aspect));
        }
        if response.double_clicked() {
            let centred = navigate::pan(camera, [-0.5 * cursor[0] * aspect, -0.5 * cursor[1]]);
            moved = Some(navigate::dolly(&centred, &stage, DOUBLE_CLICK, [0.0; 2], aspect));
        }
    }
    if moved.is_some() {
        viewer.scene.camera = moved;
    }
}

/// Draws the picture over the rectangle; a picture of another size is scaled to its height.
fn paint(viewer: &Viewer, ui: &Ui, rect: Rect) {
    let Some(picture) = &viewer.picture else { return };
    let [width, height] = picture.texture.size().map(|n| n as f32);
    let pixels = rect.size() * ui.pixels_per_point();
    let fits = (pixels.x - width).abs() < 1.0 && (pixels.y - height).abs() < 1.0;
    let size = if fits {
        Vec2::new(width, height) / ui.pixels_per_point()
    } else {
        rect.height() * Vec2::new(width / height, 1.0)
    };
    let place = if fits { Rect::from_min_size(rect.min, size) } else { Rect::from_center_size(rect.center(), size) };
    let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
    ui.painter().with_clip_rect(rect).image(picture.texture.id(), place, whole, Color32::WHITE);
}

/// Draws instructions if no volume is open.
fn draw_instructions(viewer: &Viewer, ui: &Ui, rect: Rect) {
    let words = match &viewer.busy {
        Some(Busy::Opening(_) | Busy::Building(..)) => "Opening ...".to_owned(),
        _ => {
            let formats: Vec<&str> = formats::titles().collect();
            format!("Drop a volume here, or press Ctrl+O to open one\n.svol, {}", formats.join(", "))
        }
    };
    let width = INSTRUCTIONS_WIDTH * rect.width();
    let mut job = LayoutJob::simple(words, FontId::proportional(16.0), Color32::GRAY, width);
    job.halign = Align::Center;
    let galley = ui.painter().layout_job(job);
    let top = rect.center() - Vec2::new(0.0, 0.5 * galley.size().y);
    ui.painter().galley(top, galley, Color32::GRAY);
}
