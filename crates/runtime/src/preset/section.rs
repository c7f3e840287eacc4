//! One slice of a volume, face on.

use crate::facts::VolumeFacts;
use crate::scene::{Mode, PointsSpec, Scene, TransferFunctionSpec};
use crate::transfer_function::ControlPoint;

use super::domain;
use super::view::View;

/// Share of a voxel across a slice without a slab: a slice is where it is said to be, and not beside it.
const SLICE_VOXELS: f64 = 0.1;
/// Rays along each edge of a pixel of a slice.
const SLICE_SUPERSAMPLING: u32 = 4;

/// Which slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slice {
    /// The grid's axis that it lies across.
    pub axis: usize,
    /// Where on it, voxels.
    pub at: f64,
    /// Voxels across it that the mean is taken over; `None`: the slice alone.
    pub slab: Option<f64>,
    /// How many times as large as it would fit.
    pub zoom: f64,
}

impl Slice {
    /// The scene with nothing but this slice of what its clip box leaves, face on; in these colours where it has none of its own.
    /// `None` where the clip box leaves nothing of it.
    #[must_use]
    pub fn of(&self, scene: &Scene, facts: &VolumeFacts, colors: &[ControlPoint]) -> Option<Scene> {
        let (axis, half) = (self.axis, 0.5 * self.slab.unwrap_or(SLICE_VOXELS));
        let [mut low, mut high] = scene.clip.index_box.unwrap_or_else(|| domain(facts));
        (low[axis], high[axis]) = (low[axis].max(self.at - half), high[axis].min(self.at + half));
        if low[axis] >= high[axis] {
            return None;
        }
        let mut scene = Scene { mode: Some(Mode::Mean), iso: Vec::new(), shading: Some(None), ..scene.clone() };
        scene.clip.index_box = Some([low, high]);
        let spec = || TransferFunctionSpec::Points(PointsSpec::of(colors, facts.geometry.smallest_spacing()));
        scene.transfer_function.get_or_insert_with(spec);
        scene.samples_per_pixel.get_or_insert(SLICE_SUPERSAMPLING * SLICE_SUPERSAMPLING);
        let view = View { zoom: self.zoom, ..View::section(facts, axis) };
        scene.camera = Some(view.camera(&scene.framed(facts, None), [scene.image.width, scene.image.height]));
        Some(scene)
    }
}
