//! Sections in panels beside the picture: one, or three that share a cursor.
//!
//! Each section is a scene of its own in mode `slice`, face on, on the plane across an axis of the grid through the
//! cursor. The cursor is a voxel of level 0. Sections show the whole volume, without the clipping of the picture's
//! scene. With a slab, a section shows the mean or an extreme over a layer around the plane. Positions in panels are normalised device coordinates, as in [`navigate`].

use eframe::egui::TextureHandle;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use supervol::{FrameStats, Picked};
use supervol_format::cast::whole;
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::slices::plane_across;
use supervol_scene::preset::{ramps, windows};
use supervol_scene::scene::section::{Slab, Slice, face_on};
use supervol_scene::scene::{CameraSpec, ImageSpec, Scene};
use supervol_scene::slices::{ColorSpec, Interpolation, SliceSpec};
use supervol_scene::transfer_function::ControlPoint;

use crate::worker::{OpenVolume, PANELS, Probe, ProbeAnswer};
use crate::{navigate, planes};

/// Greatest distance, in voxels, between the cursor and a slice in the picture that moves with it.
const SAME_PLACE: f64 = 1e-6;
/// Coordinates above this magnitude, or with more digits behind the point, are shown with powers of ten.
const LARGEST_PLACE: f64 = 1e12;
const MOST_DIGITS: f64 = 9.0;

/// Layout of the panels beside the picture of the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Default)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// No panel.
    #[default]
    Alone,
    /// The section across this axis of the grid.
    One(usize),
    /// Sections across all axes.
    Three,
}

impl Layout {
    /// Whether the section across an axis is shown.
    #[must_use]
    pub fn shows(self, axis: usize) -> bool {
        self == Self::Three || self == Self::One(axis)
    }
}

/// A section on the screen.
pub struct Shown {
    /// Its pixels.
    pub image: std::sync::Arc<eframe::egui::ColorImage>,
    /// Texture with the pixels.
    pub texture: TextureHandle,
    /// Number of the request.
    pub number: u64,
    /// Statistics of the picture.
    pub stats: FrameStats,
    /// Whether the picture is final.
    pub is_converged: bool,
}

impl std::fmt::Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Shown")
            .field("number", &self.number)
            .field("stats", &self.stats)
            .field("is_converged", &self.is_converged)
            .finish_non_exhaustive()
    }
}

/// One panel, across one axis.
#[derive(Debug, Default)]
pub struct Panel {
    /// The camera, if the user has moved it. Its depth is that of the plane.
    pub(crate) camera: Option<CameraSpec>,
    /// Scene to draw; `None` if there is nothing to draw or no room.
    pub(crate) scene: Option<Scene>,
    /// Last request: number of the volume, scene, number of the request.
    pub(crate) sent: Option<(u64, Scene, u64)>,
    /// The picture on the screen.
    pub(crate) shown: Option<Shown>,
    /// Scrolled points that have not yet moved the section by a step.
    pub(crate) wheel_points: f64,
}

impl Panel {
    /// The scene to draw.
    #[must_use]
    pub fn scene(&self) -> Option<&Scene> {
        self.scene.as_ref()
    }

    /// The picture on the screen.
    #[must_use]
    pub fn shown(&self) -> Option<&Shown> {
        self.shown.as_ref()
    }

    /// Whether a picture of the last request is on the screen, converged or not.
    pub(crate) fn shows_request(&self) -> bool {
        match (&self.scene, &self.sent, &self.shown) {
            (Some(scene), Some((_, sent, number)), Some(shown)) => scene == sent && shown.number == *number,
            _ => false,
        }
    }

    /// Whether the picture on the screen is that of `scene`.
    fn is_idle(&self) -> bool {
        match (&self.scene, &self.sent, &self.shown) {
            (None, ..) => true,
            (Some(scene), Some((_, sent, number)), Some(shown)) => {
                scene == sent && shown.number == *number && shown.is_converged
            }
            _ => false,
        }
    }
}

/// All panels with their cursor; see the module.
#[derive(Debug)]
pub struct Sections {
    /// Layout of the panels.
    pub(crate) layout: Layout,
    /// Voxel in index coordinates through which all sections pass.
    pub(crate) cursor: [f64; 3],
    /// Interpolation, filter and colours of the sections. Its plane is not used.
    pub(crate) look: SliceSpec,
    /// Gamma of the colours.
    pub(crate) gamma: f64,
    /// Slab that the sections show; `None`: the plane through the cursor.
    pub(crate) slab: Option<Slab>,
    /// Whether a drag in a panel sets the window in place of the cursor.
    pub(crate) drag_sets_window: bool,
    /// Panels by axis.
    pub(crate) panels: [Panel; PANELS],
    /// Number of requests made so far.
    pub(crate) requests: u64,
    /// Number of the last request of the picture beside the panels.
    pub(crate) picture: u64,
    /// Last probe of a pixel, and the last answer.
    pub(crate) asked: Option<Probe>,
    pub(crate) answered: Option<ProbeAnswer>,
    /// Number of the probe whose answer moves the cursor.
    pub(crate) moving: Option<u64>,
}

impl Default for Sections {
    fn default() -> Self {
        let look = SliceSpec {
            normal: [0.0, 0.0, 1.0],
            offset: 0.0,
            opacity: 1.0,
            interpolation: Interpolation::default(),
            filter: None,
            colors: Vec::new(),
            labels: false,
        };
        Self {
            layout: Layout::Alone,
            cursor: [0.0; 3],
            look,
            gamma: 1.0,
            slab: None,
            drag_sets_window: false,
            panels: Default::default(),
            requests: 0,
            picture: 0,
            asked: None,
            answered: None,
            moving: None,
        }
    }
}

impl Sections {
    /// Sections for an opened volume; the cursor is in its middle.
    pub(crate) fn of(facts: &VolumeFacts, layout: Layout) -> Self {
        Self { layout, cursor: facts.dims.0.map(|n| (n / 2) as f64), ..Self::default() }
    }

    /// Layout of the panels.
    #[must_use]
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Voxel in index coordinates through which all sections pass.
    #[must_use]
    pub fn cursor(&self) -> [f64; 3] {
        self.cursor
    }

    /// The panel of the section across an axis.
    #[must_use]
    pub fn panel(&self, axis: usize) -> Option<&Panel> {
        self.panels.get(axis).filter(|_| self.layout.shows(axis))
    }

    /// Answer to the last probe; `None` until it is known, and as soon as its picture is no longer the requested one.
    #[must_use]
    pub fn probed(&self) -> Option<&ProbeAnswer> {
        let asked = self.asked.filter(|probe| self.requested(probe.panel) == Some(probe.picture))?;
        self.answered.as_ref().filter(|probed| probed.probe.number == asked.number)
    }

    /// Number of the request of the present scene of a panel, or of the picture; `None` if it is not requested yet.
    pub(crate) fn requested(&self, panel: Option<usize>) -> Option<u64> {
        let Some(axis) = panel else { return Some(self.picture) };
        let panel = &self.panels[axis];
        let (_, sent, number) = panel.sent.as_ref()?;
        (panel.scene.as_ref() == Some(sent)).then_some(*number)
    }

    /// Whether all panels show their final pictures.
    #[must_use]
    pub fn are_idle(&self) -> bool {
        (0..PANELS).all(|axis| self.panel(axis).is_none_or(Panel::is_idle))
    }

    /// Scene of a panel in a picture of this size; `None` if nothing can be shown.
    #[must_use]
    pub fn scene_of(&self, axis: usize, opened: &OpenVolume, image: &ImageSpec) -> Option<Scene> {
        let facts = opened.facts();
        let (normal, offset) = plane_across(facts, axis, self.cursor[axis]);
        let slice = SliceSpec { normal, offset, ..self.painted_look(facts) };
        let vertical_exaggeration = opened.scene_exaggeration();
        let open = Scene { image: image.clone(), vertical_exaggeration, ..Scene::default() };
        let mut scene = match self.slab.filter(|_| self.shows_slabs(facts)) {
            Some(slab) => {
                let at = Slice { axis, at: self.cursor[axis], slab: Some(slab), zoom: 1.0 };
                at.of(&open, facts, &self.colors(facts))?
            }
            None => face_on(&open, facts, slice, 1.0)?,
        };
        scene.camera = match (&self.panels[axis].camera, scene.camera.take()) {
            (Some(now), Some(usual)) => Some(navigate::shifted_to(now, &usual)),
            (_, usual) => usual,
        };
        scene.samples_per_pixel = Some(samples(scene.camera.as_ref(), image, facts));
        Some(scene.complete(facts, None))
    }

    /// Whether the sections can show slabs: of values, with linear interpolation and no filter.
    #[must_use]
    pub fn shows_slabs(&self, facts: &VolumeFacts) -> bool {
        facts.kind != DataKind::Labels && self.look.filter.is_none() && self.look.interpolation == Interpolation::Linear
    }

    /// Whether the sections have a window: of values in the volume's units.
    #[must_use]
    pub fn has_window(&self, facts: &VolumeFacts) -> bool {
        facts.kind != DataKind::Labels && self.look.filter.is_none_or(|filter| filter.kind.keeps_values())
    }

    /// Least and greatest value of the window.
    #[must_use]
    pub fn window(&self, facts: &VolumeFacts) -> Option<[f64; 2]> {
        let colors = unbent(&self.look, facts);
        Some([colors.first()?.value, colors.last()?.value]).filter(|_| self.has_window(facts))
    }

    /// Sets the window; `None`: the default one. The colours stay.
    pub fn set_window(&mut self, window: Option<[f64; 2]>, facts: &VolumeFacts) {
        let usual = ramps::plain_slice(facts);
        let usual = [usual.first(), usual.last()].map(|p| p.map_or(0.0, |p| p.value));
        let window = window.unwrap_or(usual);
        let is_good = window.iter().all(|v| v.is_finite()) && window[0] < window[1];
        if is_good && self.has_window(facts) {
            let points = ramps::repainted(&unbent(&self.look, facts), Some(window), None);
            self.look.colors = points.iter().map(|p| ColorSpec { value: p.value, color: p.color }).collect();
        }
    }

    /// Changes the window as a drag by these shares of the panel does; see [`windows::dragged`].
    pub(crate) fn drag_window(&mut self, shares: [f64; 2], facts: &VolumeFacts) {
        if let Some(window) = self.window(facts) {
            self.set_window(Some(windows::dragged(window, shares)), facts);
        }
    }

    /// Colours of the sections over values, with their gamma.
    pub(crate) fn colors(&self, facts: &VolumeFacts) -> Vec<ControlPoint> {
        windows::Paint { gamma: Some(self.gamma), ..windows::Paint::default() }.applied(&unbent(&self.look, facts))
    }

    /// The look of the sections with their gamma.
    pub(crate) fn painted_look(&self, facts: &VolumeFacts) -> SliceSpec {
        let mut look = self.look.clone();
        if self.gamma != 1.0 && self.has_window(facts) {
            look.colors = self.colors(facts).iter().map(|p| ColorSpec { value: p.value, color: p.color }).collect();
        }
        look
    }

    /// Moves the cursor, limited to the volume. Slices of the picture at the old cursor move with it.
    pub(crate) fn move_to(&mut self, cursor: [f64; 3], facts: &VolumeFacts, scene: &mut Scene) {
        let last = facts.dims.0.map(|n| (n - 1) as f64);
        let next: [f64; 3] = std::array::from_fn(|a| match cursor[a].round() {
            place if place.is_finite() => place.clamp(0.0, last[a]),
            _ => self.cursor[a],
        });
        for slice in &mut scene.slices {
            let place = planes::place_of(slice, facts);
            if let Some(axis) = place.axis
                && (place.at - self.cursor[axis]).abs() < SAME_PLACE
                && next[axis] != self.cursor[axis]
            {
                planes::move_to(slice, facts, next[axis]);
            }
        }
        self.cursor = next;
    }

    /// Moves the cursor within a section to a position of its panel.
    pub(crate) fn point_at(&mut self, axis: usize, at: [f64; 2], facts: &VolumeFacts, scene: &mut Scene) {
        let Some(index) = self.index_at(axis, at, facts) else { return };
        let mut cursor = index;
        cursor[axis] = self.cursor[axis];
        self.move_to(cursor, facts, scene);
    }

    /// Index coordinates of the point at a position of a section's panel.
    #[must_use]
    pub fn index_at(&self, axis: usize, at: [f64; 2], facts: &VolumeFacts) -> Option<[f64; 3]> {
        let scene = self.panels[axis].scene.as_ref()?;
        let camera = scene.camera.as_ref()?;
        let world = navigate::point_at(camera, at, aspect(scene));
        let (normal, offset) = plane_across(facts, axis, self.cursor[axis]);
        let normal = DVec3::from_array(normal);
        let on_plane = world + (offset - normal.dot(world)) * normal;
        Some(facts.geometry.world_from_index().inverse().transform_point3(on_plane).to_array())
    }

    /// Position of an index point in the panel of a section.
    #[must_use]
    pub fn place_of(&self, axis: usize, index: [f64; 3], facts: &VolumeFacts) -> Option<[f64; 2]> {
        let scene = self.panels[axis].scene.as_ref()?;
        let camera = scene.camera.as_ref()?;
        let world = facts.geometry.world_from_index().transform_point3(index.into());
        navigate::place_of(camera, world, aspect(scene))
    }
}

/// Colours of a slice before its gamma: its own, else the default ones.
fn unbent(look: &SliceSpec, facts: &VolumeFacts) -> Vec<ControlPoint> {
    if look.colors.is_empty() {
        return ramps::plain_slice(facts);
    }
    look.colors.iter().map(|c| ControlPoint { value: c.value, color: c.color, alpha: 1.0 }).collect()
}

/// Description of a point: value with unit, voxel, world position; for a survey also its lines and its time or depth.
#[must_use]
pub fn describe_point(picked: &Picked, opened: &OpenVolume) -> String {
    let manifest = opened.container().manifest();
    let list = |places: [f64; 3], steps: [f64; 3]| [0, 1, 2].map(|a| place(places[a], steps[a])).join(", ");
    let value =
        if picked.value.is_nan() { "absent".into() } else { format!("{} {}", short(picked.value), manifest.unit) };
    let coordinates = &opened.coordinates;
    let least = [opened.container().stored_geometry().smallest_spacing(); 3];
    let (voxel, world) = (list(picked.index, [1.0; 3]), list(coordinates.world(picked.index), least));
    let unit = &manifest.axes[0].unit;
    let unit = if manifest.axes.iter().all(|axis| axis.unit == *unit) { unit.as_str() } else { "" };
    let mut words = format!("value {}\nvoxel {voxel}\nworld {world} {unit}", value.trim_end()).trim_end().to_owned();
    if coordinates.map().is_some() {
        let [(_, easting), (_, northing), _] = coordinates.point(picked.index);
        let unit = &manifest.axes[0].unit;
        let [easting, northing] = [easting, northing].map(|at| place(at, least[0]));
        words += format!("\neasting {easting}, northing {northing} {unit}").trim_end();
    }
    if coordinates.are_lines() {
        let at = |axis: usize| {
            let scale = &coordinates.axes()[axis];
            format!("{} {}", scale.name, place(scale.place(picked.index[axis]), scale.step))
        };
        words += format!("\n{}, {}, {} {}", at(1), at(0), at(2), manifest.axes[2].unit).trim_end();
    }
    words
}

/// A coordinate as text, with enough digits for a hundredth of the voxel distance `step`.
#[must_use]
pub fn place(value: f64, step: f64) -> String {
    let digits = (2.0 - step.abs().log10()).ceil().max(0.0);
    if digits > MOST_DIGITS || value.abs() >= LARGEST_PLACE || !value.is_finite() {
        return short(value);
    }
    let power = 10f64.powf(digits);
    // Avoids a negative zero.
    format!("{:.*}", whole::<usize>(digits), (value * power).round() / power + 0.0)
}

/// A number as short text.
#[must_use]
pub fn short(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e6).contains(&value.abs()) {
        format!("{value:.3e}")
    } else {
        format!("{}", (value * 1e4).round() / 1e4)
    }
}

/// Rays per pixel: several if a pixel covers several voxels. Otherwise interpolated values are smooth already, and one
/// ray per pixel makes the section follow the mouse four times as fast.
fn samples(camera: Option<&CameraSpec>, image: &ImageSpec, facts: &VolumeFacts) -> u32 {
    const FINE: u32 = 4;
    let pixel = camera.and_then(|camera| camera.height).unwrap_or(0.0) / f64::from(image.height.max(1));
    if pixel > facts.geometry.smallest_spacing() { FINE } else { 1 }
}

/// Width over height.
fn aspect(scene: &Scene) -> f64 {
    f64::from(scene.image.width) / f64::from(scene.image.height.max(1))
}
