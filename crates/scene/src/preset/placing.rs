//! Changes of a volume's proportions before it is drawn.
//!
//! - Vertical exaggeration.
//! - A visible width for a single line of voxels.
//! - A limited height for surveys whose line spacing is unknown.

use supervol_format::{Container, Geometry};

use crate::facts::{Frame, VolumeFacts};

/// Greatest ratio of length to width at which a single line of voxels is drawn.
const LINE_LENGTHS: f64 = 10.0;

/// Greatest ratio of height to width at which a survey is drawn whose line spacing has no unit.
const UNKNOWN_HEIGHT: f64 = 2.0;

/// The container with the geometry that is drawn: see [`placement`].
#[must_use]
pub fn placed(container: Container, facts: &VolumeFacts, exaggeration: f64) -> Container {
    let geometry = placement(&container, facts, exaggeration);
    container.placed(geometry)
}

/// The geometry that is drawn: heights or depths multiplied by `exaggeration`, and the other changes of the module.
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

/// The grid's axis that is most nearly vertical.
#[must_use]
pub fn upright_axis(facts: &VolumeFacts) -> usize {
    if facts.frame == Frame::Survey { 2 } else { axis_along(2, facts) }
}

/// The grid's axis that is most nearly parallel to a world axis.
#[must_use]
pub fn axis_along(world: usize, facts: &VolumeFacts) -> usize {
    let linear = facts.geometry.linear();
    let along = |a: &usize| linear.col(*a).normalize_or_zero()[world].abs();
    (0..3).max_by(|a, b| along(a).total_cmp(&along(b))).unwrap_or(world)
}
