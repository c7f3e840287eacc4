//! State of the panels that is not part of the scene.

use eframe::egui::Vec2;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::preset::slices::middle_slices;
use supervol_scene::scene::{IsoSpec, Mode, Scene, ShadingSpec, TransferFunctionSpec};
use supervol_scene::slices::SliceSpec;

use crate::cutting::Handle;
use crate::worker::OpenVolume;
use crate::{edit, planes};

/// State of the panels that is not part of the scene: the last look of each mode, and selections of the editors.
#[derive(Default)]
pub(crate) struct PanelState {
    left: Vec<(Mode, Look)>,
    /// Index of the selected control point in the editor.
    pub(crate) chosen: Option<usize>,
    /// Unit distance at density 1: that of the volume's first picture.
    pub(crate) unit_distance: Option<f64>,
    /// Last requested percentage of voxels that the window excludes at each end.
    pub(crate) clip_percent: f64,
    /// Last requested light position: degrees to the right of and above the viewer.
    pub(crate) light: [f64; 2],
    /// Index of the selected slice in the volume, which the wheel moves.
    pub(crate) held_slice: usize,
    /// Scrolled points that have not yet moved a slice by a step; `None`: the wheel moves the camera.
    pub(crate) wheel_points: Option<f64>,
    /// Whether handles are shown.
    pub(crate) are_handles_shown: bool,
    /// The dragged handle.
    pub(crate) held: Option<DraggedHandle>,
    /// Slices in the volume, kept while a mode without depth is shown.
    kept_slices: Vec<SliceSpec>,
}

/// Look of a mode when the user left it.
#[derive(Clone)]
struct Look {
    transfer_function: Option<TransferFunctionSpec>,
    shading: Option<Option<ShadingSpec>>,
    gradient_opacity: Option<[f64; 2]>,
    cut_normals: bool,
    iso: Vec<IsoSpec>,
    samples_per_pixel: Option<u32>,
}

impl PanelState {
    /// Initial state for an opened volume.
    pub(crate) fn of(scene: &Scene) -> Self {
        let unit_distance = edit::points(scene).and_then(|points| points.unit_distance);
        Self { unit_distance, clip_percent: 1.0, ..Self::default() }
    }

    /// The scene in another mode, with the mode's last look or its default look.
    pub(crate) fn switched(&mut self, scene: &Scene, opened: &OpenVolume, mode: Mode) -> Scene {
        let Scene { transfer_function, shading, gradient_opacity, cut_normals, iso, samples_per_pixel, .. } =
            scene.clone();
        let now = scene.mode.unwrap_or_default();
        self.left.retain(|(left, _)| *left != now);
        let left = Look { transfer_function, shading, gradient_opacity, cut_normals, iso, samples_per_pixel };
        self.left.push((now, left));
        self.chosen = None;
        let slices = slices_in_mode(&mut self.kept_slices, opened.facts(), (now, &scene.slices), mode);
        let scene = Scene { slices, ..scene.clone() };
        let mut shown = match self.left.iter().find(|(left, _)| *left == mode) {
            Some((_, look)) => {
                let Look { transfer_function, shading, gradient_opacity, cut_normals, iso, samples_per_pixel } =
                    look.clone();
                let mode = Some(mode);
                Scene {
                    mode,
                    transfer_function,
                    shading,
                    gradient_opacity,
                    cut_normals,
                    iso,
                    samples_per_pixel,
                    ..scene
                }
            }
            None => Scene { slices: scene.slices.clone(), ..edit::with_mode(&scene, opened, mode) },
        };
        let alone = Scene { slices: Vec::new(), ..shown.clone() };
        planes::follow_slices(&alone, &mut shown, opened.facts());
        shown
    }
}

/// A handle that is dragged.
pub(crate) struct DraggedHandle {
    pub(crate) handle: Handle,
    /// The scene at the start of the drag.
    pub(crate) before: Scene,
    /// Way of the mouse since the start of the drag, in points.
    pub(crate) way: Vec2,
}

/// Height that the status line has taken in a window of this width. It never decreases. The text of a converged picture
/// is longer than that of an unfinished one. If it took another line, the picture would shrink, start again, and so on
/// without end.
#[derive(Default)]
pub(crate) struct StatusHeight {
    pub(crate) width: f32,
    pub(crate) height: f32,
}

/// Keeps the slices while a mode without depth is shown, and returns those of the new mode. Mode `slice` without slices
/// gets those through the middle.
fn slices_in_mode(
    kept: &mut Vec<SliceSpec>,
    facts: &VolumeFacts,
    (before, slices): (Mode, &[SliceSpec]),
    after: Mode,
) -> Vec<SliceSpec> {
    if planes::has_depth(before) {
        *kept = slices.to_vec();
    }
    match after {
        Mode::Slice if kept.is_empty() => middle_slices(facts),
        _ if planes::has_depth(after) => std::mem::take(kept),
        _ => Vec::new(),
    }
}
