//! Handles of crop box, clip planes, slices and solids, drawn over the picture and not part of it.

use eframe::egui::{Color32, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2};
use glam::DVec3;
use supervol_scene::scene::CameraSpec;

use super::sections::{PLANE_COLORS, point};
use crate::cutting::{self, Handle, HandleKind};
use crate::navigate;
use crate::planes::axis_name;
use crate::state::panels::DraggedHandle;
use crate::viewer::Viewer;
use crate::worker::OpenVolume;

/// Radius of a handle, and size of the area that responds to the mouse, in points.
const RADIUS: f32 = 5.0;
const GROUND: f32 = 16.0;
const CUT_COLOR: Color32 = Color32::from_rgb(240, 190, 60);
const SLICE_COLOR: Color32 = Color32::from_rgb(200, 120, 240);
/// Edges of a box: pairs of corners whose indices differ in one bit.
pub(super) const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// Draws the handles if they are switched on, and moves the dragged one.
pub(super) fn show(viewer: &mut Viewer, ui: &Ui, picture: &Response) {
    let Some(opened) = viewer.opened.clone().filter(|_| viewer.panel_state.are_handles_shown && viewer.slice.is_none())
    else {
        viewer.panel_state.held = None;
        return;
    };
    let Some(camera) = viewer.scene.camera.clone() else { return };
    let rect = picture.rect;
    let projector = Projector { camera: &camera, rect };
    let painter = ui.painter().with_clip_rect(rect);
    let corners = cutting::crop_corners(&viewer.scene.clip, opened.facts()).map(|corner| projector.place(corner));
    for (from, to) in EDGES {
        if let (Some(from), Some(to)) = (corners[from], corners[to]) {
            painter.line_segment([from, to], Stroke::new(1.0, CUT_COLOR.gamma_multiply(0.7)));
        }
    }
    let mut is_held = false;
    for handle in cutting::handles(&viewer.scene, opened.facts(), &camera) {
        // Handles outside the picture are shown at its border.
        let Some(at) = projector.place(handle.at).map(|at| rect.shrink(RADIUS).clamp(at)) else { continue };
        let ground = Rect::from_center_size(at, Vec2::splat(GROUND));
        let id = ui.scope_id().with(("handle", name_of(&opened, handle.kind)));
        let response = ui.interact(ground, id, Sense::drag());
        let response = response.accessible_name(name_of(&opened, handle.kind));
        is_held |= response.dragged();
        drag(viewer, &opened, &projector, handle, &response);
        let response = response.on_hover_text(name_of(&opened, handle.kind));
        paint(&painter, &projector, handle, at, response.hovered() || response.dragged());
    }
    if !is_held {
        viewer.panel_state.held = None;
    }
}

/// Camera and rectangle of the picture, for projecting world points.
pub(super) struct Projector<'a> {
    pub(super) camera: &'a CameraSpec,
    pub(super) rect: Rect,
}

impl Projector<'_> {
    /// Position of a world point in the window.
    pub(super) fn place(&self, world: DVec3) -> Option<Pos2> {
        let aspect = f64::from(self.rect.width() / self.rect.height().max(1.0));
        navigate::place_of(self.camera, world, aspect).map(|place| point(self.rect, place))
    }
}

fn name_of(opened: &OpenVolume, kind: HandleKind) -> String {
    match kind {
        HandleKind::Face(axis, end) => format!("Crop {}, {}", axis_name(opened, axis), ["first", "last"][end]),
        HandleKind::Plane(i) => format!("Plane {}, move", i + 1),
        HandleKind::Arrow(i) => format!("Plane {}, turn", i + 1),
        HandleKind::Slice(i) => format!("Slice {}, move", i + 1),
        HandleKind::SliceArrow(i) => format!("Slice {}, turn", i + 1),
        HandleKind::Middle(i) => format!("Solid {}, move", i + 1),
        HandleKind::Size(i) => format!("Solid {}, size", i + 1),
    }
}

fn drag(viewer: &mut Viewer, opened: &OpenVolume, projector: &Projector<'_>, handle: Handle, response: &Response) {
    if response.drag_started() {
        viewer.panel_state.held = Some(DraggedHandle { handle, before: viewer.scene.clone(), way: Vec2::ZERO });
    }
    let Some(held) = viewer.panel_state.held.as_mut().filter(|held| held.handle.kind == handle.kind) else { return };
    if !response.dragged() || response.drag_delta() == Vec2::ZERO {
        return;
    }
    held.way += response.drag_delta();
    let height = f64::from(projector.rect.height().max(1.0));
    let way = [f64::from(held.way.x) / height, -f64::from(held.way.y) / height];
    let by = navigate::drag_at(projector.camera, held.handle.at, way);
    let after = cutting::moved(&held.before, opened.facts(), projector.camera, &held.handle, by);
    (viewer.scene.clip, viewer.scene.slices) = (after.clip, after.slices);
}

fn paint(painter: &eframe::egui::Painter, projector: &Projector<'_>, handle: Handle, at: Pos2, is_lit: bool) {
    let color = match handle.kind {
        HandleKind::Face(axis, _) => PLANE_COLORS[axis],
        HandleKind::Slice(_) | HandleKind::SliceArrow(_) => SLICE_COLOR,
        _ => CUT_COLOR,
    };
    if let Some(root) = handle.root.and_then(|root| projector.place(root)) {
        painter.line_segment([root, at], Stroke::new(1.5, color));
    }
    let radius = if is_lit { RADIUS + 1.5 } else { RADIUS };
    painter.circle(at, radius, color, Stroke::new(1.0, Color32::BLACK));
}
