//! Where a volume is drawn: as it lies in the world, but for heights that somebody wants larger, for single lines of voxels, which
//! nobody would see, and for surveys whose lines are no length apart that anybody knows.

use supervol_format::{Container, Geometry};

use crate::facts::{Frame, VolumeFacts};

/// How many times as long as wide a single line of voxels is drawn at most.
const LINE_LENGTHS: f64 = 10.0;

/// How many times as high as wide a survey is drawn at most whose lines have no unit: the files say nothing of their distance.
const UNKNOWN_HEIGHT: f64 = 2.0;

/// The container at the place where it is drawn: see [`placement`].
#[must_use]
pub fn placed(container: Container, facts: &VolumeFacts, exaggeration: f64) -> Container {
    let geometry = placement(&container, facts, exaggeration);
    container.placed(geometry)
}

/// The place in the world where a container is drawn. Heights or depths are `exaggeration` times as large, a single line of
/// voxels gets a width that can be seen, and a survey whose lines have no known distance does not become a stick.
///
/// `facts` are those of the container as it is stored.
#[must_use]
pub fn placement(container: &Container, facts: &VolumeFacts, exaggeration: f64) -> Geometry {
    let mut geometry = facts.geometry;
    if let Some(axis) = facts.line_axis() {
        let least = geometry.spacing[axis] * facts.dims.0[axis] as f64 / LINE_LENGTHS;
        (1..3).for_each(|step| {
            let across = &mut geometry.spacing[(axis + step) % 3];
            *across = across.max(least);
        });
    }
    let axes = &container.manifest().axes;
    let has_unknown_lines = container.manifest().survey.is_some() && axes[0].unit.is_empty() && axes[1].unit.is_empty();
    if has_unknown_lines && facts.line_axis().is_none() {
        let extent = |axis: usize| geometry.spacing[axis] * facts.dims.0[axis] as f64;
        let factor = (extent(2) / UNKNOWN_HEIGHT / extent(0).max(extent(1))).max(1.0);
        geometry.spacing[..2].iter_mut().for_each(|spacing| *spacing *= factor);
    }
    geometry.spacing[upright_axis(facts)] *= exaggeration;
    geometry
}

/// The grid's axis that stands most upright.
#[must_use]
pub fn upright_axis(facts: &VolumeFacts) -> usize {
    if facts.frame == Frame::Survey { 2 } else { axis_along(2, facts) }
}

/// The grid's axis that runs along a world axis most of all.
#[must_use]
pub fn axis_along(world: usize, facts: &VolumeFacts) -> usize {
    let linear = facts.geometry.linear();
    let along = |a: &usize| linear.col(*a).normalize_or_zero()[world].abs();
    (0..3).max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(world)
}
