//! Sections across an axis of the grid, seen face on: mode `mean` through a slab of the clip box.
//!
//! Index space of level 0; thicknesses are in voxels. All rays cross the slab perpendicularly, so its middle is a place
//! on every ray. A thin slab stands for a plane: its value is the one in the middle. The value of a thicker slab is the
//! mean that the picture shows.

use std::ops::ControlFlow;

use supervol_format::{Dims, Geometry};
use supervol_scene::camera::Projection;
use supervol_scene::scene::ResolvedScene;
use supervol_scene::scene::section::SLICE_VOXELS;
use supervol_scene::slices::Interpolation;

use super::{Event, FoundObject, PickedOn, Walk};
use crate::render::error::RenderError;

/// Difference of a cosine from one up to which a direction counts as perpendicular to a face: rounded cameras.
const ROUNDED_COSINE: f64 = 1e-9;
/// Factor by which rounded box corners may make a thin slab thicker.
const ROUNDED_THICKNESS: f64 = 1.001;

/// Thickness of the slab that the camera shows face on; `None` if the picture shows no such slab.
pub fn thickness(scene: &ResolvedScene, geometry: &Geometry, dims: Dims) -> Option<f64> {
    let Projection::Orthographic { .. } = scene.camera.projection else { return None };
    let corners = scene.clip.index_box?;
    // Rows of the inverse matrix are normals of the faces of voxels.
    let normals = geometry.linear().inverse().transpose();
    (0..3).find_map(|axis| {
        let along = normals.col(axis).normalize_or_zero().dot(scene.camera.forward).abs();
        let [low, high] = scene.clip.slab_of(dims, axis);
        let is_whole = dims.0[axis] > 1 && high - low >= dims.0[axis] as f64;
        let thickness = corners[1][axis] - corners[0][axis];
        (along > 1.0 - ROUNDED_COSINE && !is_whole && low < high).then_some(thickness)
    })
}

impl Walk<'_> {
    /// The middle of a slab of this thickness, with its value.
    pub(super) fn middle_of_slab(&mut self, thickness: f64) -> Result<Option<FoundObject>, RenderError> {
        let Some(whole) = self.whole else { return Ok(None) };
        let middle = 0.5 * (whole.t0 + whole.t1);
        let value = if thickness > ROUNDED_THICKNESS * SLICE_VOXELS {
            self.mean()?
        } else if self.parts.iter().any(|part| (part.t0..=part.t1).contains(&middle)) {
            self.values(&[middle], Interpolation::Linear)?[0]
        } else {
            f64::NAN
        };
        Ok((!value.is_nan()).then_some((PickedOn::Slice(0), middle, value)))
    }

    /// Mean value over the present parts of the ray; NaN if there are none.
    fn mean(&mut self) -> Result<f64, RenderError> {
        let (mut sum, mut length) = (0.0, 0.0);
        self.events(|event| {
            if let Event::Cell([t0, t1], field, _) = event {
                sum += (t1 - t0) * field.mean();
                length += t1 - t0;
            }
            ControlFlow::<()>::Continue(())
        })?;
        Ok(sum / length)
    }
}
