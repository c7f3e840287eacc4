//! Panels with sections beside the picture: layout, mouse actions, and the description of the point under the mouse.

use eframe::egui::{Align2, Color32, FontId, PointerButton, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2, pos2};
use supervol_decorations::named_borders;
use supervol_format::cast::{single, whole};
use supervol_scene::scene::{CameraSpec, ImageSpec, RAY_LIMIT, Scene};

use super::picture::{color, pixels_of, place, wheel_steps};
use super::widgets::{coordinate, extent_in_words, heading, voxel_slider, wide_slider};
use super::{reading, slices};
use crate::planes::{self, axis_name};
use crate::sections::{Layout, describe_point, short};
use crate::viewer::Viewer;
use crate::worker::{Message, OpenVolume, PANELS, Probe};
use crate::{edit, navigate};

/// Points between panels.
const GAP: f32 = 3.0;
/// Points between a text in a panel and its border.
const MARGIN: f32 = 6.0;
/// Points around the cursor that the cross leaves free.
const CLEAR: f32 = 7.0;
/// Colours of the planes across the grid's axes.
pub(super) const PLANE_COLORS: [Color32; PANELS] =
    [Color32::from_rgb(235, 90, 80), Color32::from_rgb(90, 200, 90), Color32::from_rgb(90, 150, 255)];

/// Rectangles of the picture and of the panels.
pub(super) struct PanelRects {
    pub(super) picture: Rect,
    panels: [Option<Rect>; PANELS],
}

/// Divides the available room.
pub(super) fn panel_rects(layout: Layout, whole: Rect) -> PanelRects {
    let half = |from: f32, to: f32| [from, 0.5 * (from + to - GAP), 0.5 * (from + to + GAP), to].map(f32::round);
    let [x, y] = [half(whole.left(), whole.right()), half(whole.top(), whole.bottom())];
    let room = |[x0, y0]: [f32; 2], [x1, y1]: [f32; 2]| Rect::from_min_max(pos2(x0, y0), pos2(x1, y1));
    match layout {
        Layout::Alone => PanelRects { picture: whole, panels: [None; PANELS] },
        Layout::One(axis) => {
            let mut panels = [None; PANELS];
            if let Some(panel) = panels.get_mut(axis) {
                *panel = Some(room([x[0], y[0]], [x[1], y[3]]));
            }
            PanelRects { picture: room([x[2], y[0]], [x[3], y[3]]), panels }
        }
        Layout::Three => PanelRects {
            picture: room([x[2], y[2]], [x[3], y[3]]),
            panels: [
                Some(room([x[0], y[2]], [x[1], y[3]])),
                Some(room([x[2], y[0]], [x[3], y[1]])),
                Some(room([x[0], y[0]], [x[1], y[1]])),
            ],
        },
    }
}

/// Draws the panels of the layout.
pub(super) fn show(viewer: &mut Viewer, ui: &Ui, panel_rects: &PanelRects) {
    let Some(opened) = viewer.opened.clone() else { return };
    let before = viewer.sections.cursor;
    for axis in 0..PANELS {
        viewer.sections.panels[axis].scene = None;
        let Some(rect) = panel_rects.panels[axis].filter(|rect| rect.is_positive()) else { continue };
        let response = ui.interact(rect, ui.scope_id().with(("section", axis)), Sense::click_and_drag());
        let response = response.accessible_name(format!("Section {}", axis_name(&opened, axis)));
        aim(viewer, &opened, ui, axis, rect);
        handle_input(viewer, &opened, ui, axis, &response);
        aim(viewer, &opened, ui, axis, rect);
        paint(viewer, &opened, ui, axis, &response);
        show_context_menu(viewer, &opened, axis, &response);
    }
    // Panels drawn before the one that moved the cursor are updated in the next frame.
    if viewer.sections.cursor != before {
        ui.ctx().request_repaint();
    }
}

/// Sets the panel's scene, with as many pixels as the screen has there.
fn aim(viewer: &mut Viewer, opened: &OpenVolume, ui: &Ui, axis: usize, rect: Rect) {
    let [width, height] = pixels_of(ui, rect);
    let image = ImageSpec { width, height, ..viewer.scene.image };
    let scene = viewer.sections.scene_of(axis, opened, &image);
    let rays = |samples: u32| u64::from(width) * u64::from(height) * u64::from(samples);
    viewer.sections.panels[axis].scene = scene.filter(|scene| rays(scene.samples_per_pixel.unwrap_or(1)) <= RAY_LIMIT);
}

/// Context menu: saves the section as a scene, or exports it as a picture.
fn show_context_menu(viewer: &mut Viewer, opened: &OpenVolume, axis: usize, response: &Response) {
    let Some(scene) = viewer.sections.panels[axis].scene.clone().filter(|_| !viewer.is_preview()) else { return };
    response.context_menu(|ui| {
        if ui.button("Save the scene of this section ...").clicked() {
            viewer.dialogs.begin_save_section(opened, scene.clone());
            ui.close();
        }
        if ui.button("Export this section ...").clicked() {
            viewer.dialogs.begin_export_section(opened, scene.clone());
            ui.close();
        }
    });
}

fn handle_input(viewer: &mut Viewer, opened: &OpenVolume, ui: &Ui, axis: usize, response: &Response) {
    let rect = response.rect;
    let moves = ui.input(|input| input.modifiers.shift) || response.dragged_by(PointerButton::Middle);
    let moves = moves || response.dragged_by(PointerButton::Secondary);
    let wants_window = viewer.sections.drag_sets_window || ui.input(|input| input.modifiers.command);
    let sets_window = wants_window && !moves && response.is_pointer_button_down_on();
    let at = response.interact_pointer_pos().map(|at| place(rect, at));
    let is_pointing = response.is_pointer_button_down_on() || response.clicked();
    if response.double_clicked() {
        viewer.sections.panels[axis].camera = None;
    } else if sets_window && response.drag_delta() != Vec2::ZERO {
        let delta = response.drag_delta() / rect.size().max(Vec2::splat(1.0));
        viewer.sections.drag_window([f64::from(delta.x), -f64::from(delta.y)], opened.facts());
    } else if moves && response.drag_delta() != Vec2::ZERO {
        let height = f64::from(rect.height().max(1.0));
        let by = [f64::from(response.drag_delta().x) / height, -f64::from(response.drag_delta().y) / height];
        turn(viewer, axis, |camera| navigate::pan(camera, by));
    } else if let Some(at) =
        at.filter(|_| is_pointing && !moves && !wants_window && ui.input(|i| i.pointer.primary_down()))
    {
        viewer.sections.point_at(axis, at, opened.facts(), &mut viewer.scene);
    }
    if !response.contains_pointer() {
        return;
    }
    let (scrolled, zoom) = ui.input(|input| (f64::from(input.smooth_scroll_delta().y), f64::from(input.zoom_delta())));
    let steps = wheel_steps(&mut viewer.sections.panels[axis].wheel_points, scrolled);
    if steps != 0.0 {
        let mut cursor = viewer.sections.cursor;
        cursor[axis] += steps;
        viewer.sections.move_to(cursor, opened.facts(), &mut viewer.scene);
    }
    if let Some(at) = response.hover_pos().map(|at| place(rect, at)) {
        if zoom != 1.0 {
            let aspect = f64::from(rect.width() / rect.height().max(1.0));
            let stage = edit::stage(opened.facts());
            turn(viewer, axis, |camera| navigate::dolly(camera, &stage, 1.0 / zoom, at, aspect));
        }
        probe(viewer, opened, Some(axis), at);
    }
}

/// Changes the camera of a section.
fn turn(viewer: &mut Viewer, axis: usize, turned: impl FnOnce(&CameraSpec) -> CameraSpec) {
    let panel = &mut viewer.sections.panels[axis];
    if let Some(camera) = panel.scene.as_ref().and_then(|scene| scene.camera.as_ref()) {
        panel.camera = Some(turned(camera));
    }
}

/// Requests a probe at a position of a panel, or of the picture, unless it is the last one. Returns its number, or `None`
/// if the present scene is not requested yet: the picture that follows then asks again.
pub(super) fn probe(viewer: &mut Viewer, opened: &OpenVolume, panel: Option<usize>, at: [f64; 2]) -> Option<u64> {
    let picture = viewer.sections.requested(panel)?;
    let scene = match panel {
        Some(axis) => viewer.sections.panels[axis].scene.as_ref()?,
        None => &viewer.scene,
    };
    let size = [scene.image.width, scene.image.height];
    let share = [0.5 * (1.0 + at[0]), 0.5 * (1.0 - at[1])];
    let pixel = [0, 1].map(|a| whole::<u32>((share[a] * f64::from(size[a])).max(0.0)).min(size[a].saturating_sub(1)));
    let number = viewer.sections.asked.map_or(0, |asked| asked.number);
    let next = Probe { number, volume: opened.number, panel, picture, pixel };
    if viewer.sections.asked == Some(next) {
        return Some(number);
    }
    let next = Probe { number: number + 1, ..next };
    viewer.sections.asked = Some(next);
    viewer.worker.iter().for_each(|worker| worker.probe(next));
    Some(next.number)
}

fn paint(viewer: &Viewer, opened: &OpenVolume, ui: &Ui, axis: usize, response: &Response) {
    let rect = response.rect;
    let painter = ui.painter().with_clip_rect(rect);
    painter.rect_filled(rect, 0.0, color(viewer.scene.image.background));
    if let Some(shown) = &viewer.sections.panels[axis].shown {
        let size = Vec2::from(shown.texture.size().map(|n| n as f32)) / ui.pixels_per_point();
        let whole = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
        painter.image(shown.texture.id(), Rect::from_min_size(rect.min, size), whole, Color32::WHITE);
    }
    let facts = opened.facts();
    let at_cursor = viewer.sections.place_of(axis, viewer.sections.cursor, facts).map(|place| point(rect, place));
    for other in (0..PANELS).filter(|other| *other != axis) {
        // The plane across the other axis appears as a line along the third axis.
        let along = 3 - axis - other;
        let mut ends = [viewer.sections.cursor; 2];
        (ends[0][along], ends[1][along]) = (-0.5, facts.dims.0[along] as f64 - 0.5);
        let ends = ends.map(|end| viewer.sections.place_of(axis, end, facts).map(|place| point(rect, place)));
        let (Some(middle), [Some(from), Some(to)]) = (at_cursor, ends) else { continue };
        let stroke = Stroke::new(1.0, PLANE_COLORS[other]);
        for end in [from, to] {
            let way = end - middle;
            if way.length() > CLEAR {
                painter.line_segment([middle + CLEAR * way.normalized(), end], stroke);
            }
        }
    }
    painter.rect_stroke(rect, 0.0, Stroke::new(1.0, PLANE_COLORS[axis]), eframe::egui::StrokeKind::Inside);
    let corner = rect.left_top() + Vec2::splat(MARGIN);
    let title = draw_text(&painter, corner, Align2::LEFT_TOP, &title(viewer, opened, axis));
    name_borders(viewer.sections.panels[axis].scene.as_ref(), opened, &painter, (rect, title));
    if response.contains_pointer() {
        draw_point_description(viewer, opened, Some(axis), &painter, rect);
    }
    if viewer.sections.panels[axis].scene.is_none() {
        draw_text(&painter, rect.center(), Align2::CENTER_CENTER, "cannot show a section here");
    }
}

/// Draws the names of a patient's sides, or of compass directions, at the borders of a section. The upper one lies below
/// a title that reaches so far.
fn name_borders(
    scene: Option<&Scene>,
    opened: &OpenVolume,
    painter: &eframe::egui::Painter,
    (rect, title): (Rect, Rect),
) {
    let Some(camera) = scene.and_then(|scene| scene.camera.as_ref()) else { return };
    let right = navigate::right_of(camera);
    let names = named_borders(opened.container(), opened.facts(), [right, right.cross(navigate::forward_of(camera))]);
    let inner = rect.shrink(MARGIN);
    let mut top = inner.center_top();
    if title.right() + 2.0 * MARGIN > top.x {
        top.y = title.bottom() + MARGIN;
    }
    let borders = [
        (inner.right_center(), Align2::RIGHT_CENTER),
        (inner.left_center(), Align2::LEFT_CENTER),
        (top, Align2::CENTER_TOP),
        (inner.center_bottom(), Align2::CENTER_BOTTOM),
    ];
    for (name, (at, align)) in names.into_iter().zip(borders) {
        if let Some(name) = name {
            draw_text(painter, at, align, name);
        }
    }
}

/// Point of the window at a normalised position.
pub(super) fn point(rect: Rect, [x, y]: [f64; 2]) -> Pos2 {
    let [x, y] = [0.5 * (1.0 + x), 0.5 * (1.0 - y)];
    rect.min + Vec2::new(single(x), single(y)) * rect.size()
}

/// Draws text over a picture on a readable background. Returns its rectangle.
fn draw_text(painter: &eframe::egui::Painter, at: Pos2, align: Align2, words: &str) -> Rect {
    let galley = painter.layout(words.into(), FontId::proportional(12.0), Color32::WHITE, painter.clip_rect().width());
    let rect = align.anchor_size(at, galley.size());
    painter.rect_filled(rect.expand(2.0), 2.0, Color32::from_black_alpha(170));
    painter.galley(rect.min, galley, Color32::WHITE);
    rect
}

fn title(viewer: &Viewer, opened: &OpenVolume, axis: usize) -> String {
    let voxel = viewer.sections.cursor[axis];
    let scale = &opened.coordinates.axes()[axis];
    let at = format!("{} {}", coordinate(scale, voxel), scale.unit);
    let failed = viewer.sections.panels[axis].shown.as_ref().map_or(0, |shown| shown.stats.bricks_failed);
    let failed = if failed > 0 { format!(", {failed} bricks failed") } else { String::new() };
    let slab = viewer.sections.slab.filter(|_| viewer.sections.shows_slabs(opened.facts()));
    let slab = slab.map_or(String::new(), |slab| format!(", slab of {} voxels", short(slab.thickness)));
    format!("{} {}, voxel {voxel}{slab}{failed}", axis_name(opened, axis), at.trim_end())
}

/// Draws value and position of the point under the mouse, when they are known.
pub(super) fn draw_point_description(
    viewer: &Viewer,
    opened: &OpenVolume,
    panel: Option<usize>,
    painter: &eframe::egui::Painter,
    rect: Rect,
) {
    let is_present = panel.is_some() || viewer.is_up_to_date();
    let is_asked = |probe: &Probe| probe.panel == panel && probe.volume == opened.number;
    let Some(probed) = viewer.sections.probed().filter(|probed| is_present && is_asked(&probed.probe)) else { return };
    let corner = rect.left_bottom() + Vec2::new(MARGIN, -MARGIN);
    match &probed.found {
        Ok(Some(picked)) => {
            draw_text(painter, corner, Align2::LEFT_BOTTOM, &describe_point(picked, opened));
        }
        Ok(None) if panel.is_some() => {
            draw_text(painter, corner, Align2::LEFT_BOTTOM, "nothing visible");
        }
        Ok(None) => {}
        Err(why) if panel.is_some() => {
            draw_text(painter, corner, Align2::LEFT_BOTTOM, why);
        }
        Err(_) => {}
    }
}

/// Draws the controls.
pub(super) fn controls(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Panels beside the picture");
    let Some(opened) = viewer.opened.clone() else { return };
    let before = viewer.sections.layout;
    let mut layout = before;
    ui.horizontal_wrapped(|ui| {
        ui.selectable_value(&mut layout, Layout::Alone, "Picture alone").on_hover_text("No panels");
        let words = "Sections across all axes, linked by a cursor (T)";
        ui.selectable_value(&mut layout, Layout::Three, "Three panels").on_hover_text(words);
        for axis in 0..PANELS {
            let name = axis_name(&opened, axis);
            let words = format!("One panel with the section across {name}");
            let _ = ui.selectable_value(&mut layout, Layout::One(axis), format!("Panel {name}")).on_hover_text(words);
        }
    });
    viewer.set_layout(layout);
    if layout == Layout::Alone {
        return;
    }
    let mut cursor = viewer.sections.cursor;
    for (axis, place) in cursor.iter_mut().enumerate() {
        let name = axis_name(&opened, axis);
        ui.label(format!("Cursor, {name}"));
        wide_slider(ui);
        ui.add(voxel_slider(place, &opened.coordinates.axes()[axis]))
            .on_hover_text(format!("Place of the section: {}", extent_in_words(&opened.coordinates.axes()[axis])))
            .accessible_name(format!("Cursor, {name}"));
    }
    if cursor != viewer.sections.cursor {
        viewer.sections.move_to(cursor, opened.facts(), &mut viewer.scene);
    }
    ui.push_id("panels", |ui| {
        let look = &mut viewer.sections.look;
        slices::interpolation(look, "Panels", ui);
        slices::filter(look, &opened, "Panels", ui);
        reading::controls(viewer, &opened, ui);
    });
    let words = "Adds slices at the cursor to the picture; they move with the cursor";
    if ui.button("Show them in the volume").on_hover_text(words).clicked() {
        show_in_volume(viewer, &opened);
    }
}

/// Adds slices at the cursor to the picture, with the look of the panels.
fn show_in_volume(viewer: &mut Viewer, opened: &OpenVolume) {
    for axis in (0..PANELS).filter(|axis| viewer.sections.layout.shows(*axis)) {
        let place = viewer.sections.cursor[axis];
        let is_there = |slice| {
            let found = planes::place_of(slice, opened.facts());
            found.axis == Some(axis) && (found.at - place).abs() < 0.5
        };
        if viewer.scene.slices.iter().any(is_there) {
            continue;
        }
        if let Err(why) = planes::add(&mut viewer.scene, opened.facts(), Some(axis)) {
            viewer.message = Some(Message::Failure(why));
            return;
        }
        if let Some(slice) = viewer.scene.slices.last_mut() {
            planes::move_to(slice, opened.facts(), place);
            let look = viewer.sections.painted_look(opened.facts());
            (slice.interpolation, slice.filter, slice.colors) = (look.interpolation, look.filter, look.colors);
        }
    }
}
