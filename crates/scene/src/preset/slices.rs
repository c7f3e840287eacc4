//! Slices across the axes of the grid: planes through voxels, and those that a scene gets by default.

use glam::DVec3;

use crate::camera::unit_vector;
use crate::facts::VolumeFacts;
use crate::slices::{Interpolation, SliceSpec};

/// Opaque slices across the grid's axes through the voxels in the middle of the volume.
#[must_use]
pub fn middle_slices(facts: &VolumeFacts) -> Vec<SliceSpec> {
    let slice = |axis: usize| {
        let (normal, offset) = plane_across(facts, axis, (facts.dims.0[axis] / 2) as f64);
        let interpolation = Interpolation::default();
        SliceSpec { normal, offset, opacity: 1.0, interpolation, filter: None, colors: Vec::new(), labels: false }
    };
    (0..3).map(slice).collect()
}

/// The plane across an axis of the grid at an index coordinate: unit normal and offset in world space.
#[must_use]
pub fn plane_across(facts: &VolumeFacts, axis: usize, at: f64) -> ([f64; 3], f64) {
    // Index coordinate `axis` of a world point is the product of a row of the inverse matrix with that point.
    let across = facts.geometry.linear().inverse().transpose().col(axis);
    let normal = unit_vector(across).unwrap_or(DVec3::Z);
    let mut index = DVec3::ZERO;
    index[axis] = at;
    (normal.to_array(), normal.dot(facts.geometry.world_from_index().transform_point3(index)))
}
