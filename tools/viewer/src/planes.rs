//! Slices in the volume and their motion by hand: each is a plane of the scene, across an axis of the grid or oblique.
//!
//! World space, data units. The position of a slice across an axis is a voxel coordinate; that of an oblique slice is a
//! world length from the volume's middle.

use glam::DVec3;
use supervol_format::Geometry;
use supervol_scene::camera::unit_vector;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::preset::slices::plane_across;
use supervol_scene::preset::{Look, colormap, domain_corners, ramps};
use supervol_scene::scene::{Mode, PointSpec, PointsSpec, Scene};
use supervol_scene::slices::{ColorSpec, Interpolation, SLICE_LIMIT, SliceSpec};
use supervol_scene::transfer_function::ControlPoint;

use crate::worker::OpenVolume;

/// Greatest distance between unit normals that count as equal: numbers in scene files are rounded.
const SAME_NORMAL: f64 = 1e-9;
/// Wheel steps over the whole range of an oblique slice.
const OBLIQUE_STEPS: f64 = 200.0;

/// Position of a slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The grid's axis across the slice; `None` for an oblique slice.
    pub axis: Option<usize>,
    /// Voxel coordinate along the axis, or world length along the normal from the volume's middle.
    pub at: f64,
    /// Least and greatest position at which the slice meets the volume; for voxel coordinates, their centres.
    pub range: [f64; 2],
    /// Change of `at` per step of the wheel.
    pub step: f64,
}

/// Whether a mode draws slices at their depth.
#[must_use]
pub fn has_depth(mode: Mode) -> bool {
    matches!(mode, Mode::Dvr | Mode::Iso | Mode::Slice)
}

/// Whether a slice may be removed: mode `slice` needs one.
#[must_use]
pub fn may_remove(scene: &Scene) -> bool {
    scene.mode != Some(Mode::Slice) || scene.slices.len() > 1
}

/// Removes a slice. Default opacities of the volume become those without slices when the last one goes.
pub fn remove(scene: &mut Scene, facts: &VolumeFacts, number: usize) {
    if number < scene.slices.len() && may_remove(scene) {
        let before = scene.clone();
        scene.slices.remove(number);
        follow_slices(&before, scene, facts);
    }
}

/// Changes the default opacities of a volume when its first slice comes or its last one goes. Other opacities stay. Around
/// slices one ray a pixel suffices for a faint volume; each slice needs memory for the rays of a picture.
pub(crate) fn follow_slices(before: &Scene, scene: &mut Scene, facts: &VolumeFacts) {
    if before.slices.is_empty() == scene.slices.is_empty() {
        return;
    }
    let usual = |scene: &Scene| {
        let open = Scene { mode: scene.mode, slices: scene.slices.clone(), ..Scene::default() };
        open.complete(facts, None).transfer_function
    };
    if scene.mode == Some(Mode::Dvr) && scene.transfer_function == usual(before) {
        scene.transfer_function = usual(scene);
        let look = Look::of(facts);
        let is_whole = scene.slices.is_empty() && look.mode == Mode::Dvr;
        scene.samples_per_pixel = Some(if is_whole { look.samples_per_pixel } else { 1 });
    }
}

/// Name of an axis of the grid. For patients, the name of the section across it.
#[must_use]
pub fn axis_name(opened: &OpenVolume, axis: usize) -> String {
    opened.coordinates.section_name(axis)
}

/// Adds a slice through the volume's middle, across an axis of the grid or oblique (`None`). Default opacities of the
/// volume become fainter. Returns the reason if it cannot.
///
/// # Errors
/// If the mode has no depth, or the scene has the most slices already.
pub fn add(scene: &mut Scene, facts: &VolumeFacts, axis: Option<usize>) -> Result<(), String> {
    if !has_depth(scene.mode.unwrap_or_default()) {
        return Err("projections have no depth: choose Volume, Iso or Slices only first".into());
    }
    if scene.slices.len() >= SLICE_LIMIT {
        return Err(format!("expected at most {SLICE_LIMIT} slices"));
    }
    let (normal, offset) = match axis {
        Some(axis) => plane_across(facts, axis, (facts.dims.0[axis] / 2) as f64),
        None => {
            let normal = (0..3).map(|a| DVec3::from_array(plane_across(facts, a, 0.0).0)).sum::<DVec3>();
            let normal = unit_vector(normal).unwrap_or(DVec3::Z);
            (normal.to_array(), normal.dot(middle(facts)))
        }
    };
    let interpolation = Interpolation::default();
    let before = scene.clone();
    scene.slices.push(SliceSpec {
        normal,
        offset,
        opacity: 1.0,
        interpolation,
        filter: None,
        colors: Vec::new(),
        labels: false,
    });
    follow_slices(&before, scene, facts);
    Ok(())
}

/// World point in the middle of the volume.
fn middle(facts: &VolumeFacts) -> DVec3 {
    let [first, .., last] = domain_corners(facts);
    0.5 * (first + last)
}

/// The grid's axis across a slice, and the sign of its normal.
fn across(slice: &SliceSpec, facts: &VolumeFacts) -> Option<(usize, f64)> {
    let normal = unit_vector(slice.normal.into())?;
    (0..3).find_map(|axis| {
        let along = DVec3::from_array(plane_across(facts, axis, 0.0).0);
        let sign = normal.dot(along).signum();
        ((normal - sign * along).length() < SAME_NORMAL).then_some((axis, sign))
    })
}

/// World distance from the origin to a slice along its unit normal.
fn distance(slice: &SliceSpec) -> f64 {
    slice.offset / DVec3::from_array(slice.normal).length()
}

/// Position of a slice.
#[must_use]
pub fn place_of(slice: &SliceSpec, facts: &VolumeFacts) -> Place {
    if let Some((axis, sign)) = across(slice, facts) {
        let [first, second] = [0.0, 1.0].map(|at| plane_across(facts, axis, at).1);
        let at = (sign * distance(slice) - first) / (second - first);
        return Place { axis: Some(axis), at, range: [0.0, (facts.dims.0[axis] - 1) as f64], step: 1.0 };
    }
    let normal = unit_vector(slice.normal.into()).unwrap_or(DVec3::Z);
    let from_middle = domain_corners(facts).map(|corner| normal.dot(corner - middle(facts)));
    let range = [from_middle.into_iter().fold(0.0, f64::min), from_middle.into_iter().fold(0.0, f64::max)];
    let at = distance(slice) - normal.dot(middle(facts));
    Place { axis: None, at, range, step: (range[1] - range[0]) / OBLIQUE_STEPS }
}

/// Moves a slice to another position, in the coordinates of [`place_of`].
pub fn move_to(slice: &mut SliceSpec, facts: &VolumeFacts, at: f64) {
    if !at.is_finite() {
        return;
    }
    match across(slice, facts) {
        Some((axis, _)) => (slice.normal, slice.offset) = plane_across(facts, axis, at),
        None => {
            let normal = DVec3::from_array(slice.normal);
            slice.offset = normal.dot(middle(facts)) + at * normal.length();
        }
    }
}

/// Moves a slice by wheel steps, limited to the volume.
pub fn step(slice: &mut SliceSpec, facts: &VolumeFacts, steps: f64) {
    let Place { at, range: [least, most], step, axis } = place_of(slice, facts);
    // From a position between voxels, the first step goes to a voxel.
    let at = if axis.is_some() { (at + steps).round() } else { at + steps * step };
    move_to(slice, facts, at.clamp(least, most));
}

/// Turns a slice about its point nearest to the volume's middle. A zero normal changes nothing.
pub fn turn(slice: &mut SliceSpec, facts: &VolumeFacts, normal: [f64; 3]) {
    let (Some(before), Some(after)) = (unit_vector(slice.normal.into()), unit_vector(normal.into())) else { return };
    let foot = middle(facts) + before * (distance(slice) - before.dot(middle(facts)));
    (slice.normal, slice.offset) = (after.to_array(), after.dot(foot));
}

/// Sets the colours of a slice from a colour map by name, over the slice's range of values. Slices with a filter that
/// changes the meaning of values keep the filter's colours.
pub fn paint(slice: &mut SliceSpec, facts: &VolumeFacts, name: &str) {
    let Some(colors) = colormap::by_name(name) else { return };
    let known = slice.colors.iter().map(|c| ControlPoint { value: c.value, color: c.color, alpha: 1.0 });
    let known: Vec<ControlPoint> = known.collect();
    let known = if known.is_empty() { ramps::plain_slice(facts) } else { known };
    // The ends carry the range; points between them belong to the colours before.
    let ends = [known.first(), known.last()].into_iter().flatten().copied().collect::<Vec<_>>();
    let points = ramps::repainted(&ends, None, Some(&colors));
    let color = |p: &PointSpec| ColorSpec { value: p.value, color: p.color };
    slice.colors = PointsSpec::of(&points, 1.0).points.iter().map(color).collect();
}

/// Converts slices and clip planes of a scene to another geometry of the volume, so that they pass through the same
/// voxels.
pub fn carry(scene: &mut Scene, from: &Geometry, to: &Geometry) {
    let carried = |normal: [f64; 3], offset: f64| {
        let normal = DVec3::from_array(normal);
        let in_grid = from.linear().transpose() * normal;
        let beyond_origin = offset - normal.dot(from.world_from_index().translation);
        let normal = to.linear().inverse().transpose() * in_grid;
        (normal.to_array(), beyond_origin + normal.dot(to.world_from_index().translation))
    };
    for slice in &mut scene.slices {
        (slice.normal, slice.offset) = carried(slice.normal, slice.offset);
    }
    for plane in &mut scene.clip.planes {
        (plane.normal, plane.offset) = carried(plane.normal, plane.offset);
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, ValueRange};
    use supervol_scene::scene::PlaneSpec;

    use super::*;

    fn facts(spacing: [f64; 3]) -> VolumeFacts {
        VolumeFacts::plain(
            Dims([10, 20, 31]),
            Geometry { origin: [600_000.0, -5.0, 100.0], spacing, ..Geometry::IDENTITY },
            ValueRange { min: 0.0, max: 100.0 },
        )
    }

    #[test]
    fn slices_across_axes_are_told_and_moved_in_voxels() {
        let facts = facts([12.5, 2.0, 4.0]);
        let mut scene = Scene { mode: Some(Mode::Dvr), ..Scene::default() };
        for axis in 0..3 {
            add(&mut scene, &facts, Some(axis)).unwrap();
            let slice = &mut scene.slices[axis];
            let place = place_of(slice, &facts);
            assert_eq!((place.axis, place.range), (Some(axis), [0.0, (facts.dims.0[axis] - 1) as f64]));
            assert!((place.at - (facts.dims.0[axis] / 2) as f64).abs() < 1e-9);
            move_to(slice, &facts, 3.0);
            assert_eq!((slice.normal, slice.offset), plane_across(&facts, axis, 3.0));
            // The same plane with the opposite normal is the same slice.
            (slice.normal, slice.offset) = (slice.normal.map(|n| -2.0 * n), -2.0 * slice.offset);
            assert!((place_of(slice, &facts).at - 3.0).abs() < 1e-9);
            step(slice, &facts, 2.0);
            assert!((place_of(slice, &facts).at - 5.0).abs() < 1e-9);
            step(slice, &facts, -1e9);
            assert_eq!(place_of(slice, &facts).at, 0.0, "no farther than the volume");
        }
    }

    #[test]
    fn oblique_slices_turn_about_the_middle() {
        let facts = facts([12.5, 2.0, 4.0]);
        let mut scene = Scene { mode: Some(Mode::Iso), ..Scene::default() };
        add(&mut scene, &facts, None).unwrap();
        let slice = &mut scene.slices[0];
        let place = place_of(slice, &facts);
        assert!(place.axis.is_none() && place.at.abs() < 1e-6 && place.range[0] < 0.0 && place.range[1] > 0.0);
        move_to(slice, &facts, 7.0);
        turn(slice, &facts, [0.0, 0.0, 0.0]);
        assert!((place_of(slice, &facts).at - 7.0).abs() < 1e-6);
        turn(slice, &facts, [0.0, 3.0, 4.0]);
        assert!((DVec3::from_array(slice.normal) - DVec3::new(0.0, 0.6, 0.8)).length() < 1e-12);
        let before = unit_vector(DVec3::ONE).unwrap();
        let expected = 7.0 * before.dot(DVec3::from_array(slice.normal));
        assert!((place_of(slice, &facts).at - expected).abs() < 1e-6, "the point next to the middle stays on it");
    }

    #[test]
    fn what_cannot_be_added_is_said() {
        let facts = facts([1.0; 3]);
        let mut scene = Scene { mode: Some(Mode::Mip), ..Scene::default() };
        assert!(add(&mut scene, &facts, Some(0)).unwrap_err().contains("depth"));
        scene.mode = Some(Mode::Dvr);
        (0..SLICE_LIMIT).for_each(|_| add(&mut scene, &facts, Some(0)).unwrap());
        assert!(add(&mut scene, &facts, Some(0)).unwrap_err().contains("at most"));
        paint(&mut scene.slices[0], &facts, "viridis");
        assert!(scene.slices[0].colors.len() > 10 && scene.validate().is_ok());
    }

    #[test]
    fn planes_go_through_the_same_voxels_where_the_volume_is_placed_anew() {
        let [before, after] = [facts([12.5, 2.0, 4.0]), facts([12.5, 2.0, 12.0])];
        let mut scene = Scene { mode: Some(Mode::Dvr), ..Scene::default() };
        add(&mut scene, &before, Some(2)).unwrap();
        add(&mut scene, &before, None).unwrap();
        let SliceSpec { normal, offset, .. } = scene.slices[1];
        scene.clip.planes.push(PlaneSpec { normal, offset });
        let voxel = |facts: &VolumeFacts, p: [f64; 3]| facts.geometry.world_from_index().transform_point3(p.into());
        let beyond = |slice: &SliceSpec, p: DVec3| DVec3::from_array(slice.normal).dot(p) - slice.offset;
        let p = [1.0, 4.0, 9.0];
        let expected = beyond(&scene.slices[1], voxel(&before, p));
        carry(&mut scene, &before.geometry, &after.geometry);
        assert!((place_of(&scene.slices[0], &after).at - 15.0).abs() < 1e-9);
        assert!((beyond(&scene.slices[1], voxel(&after, p)) - expected).abs() < 1e-6);
        assert_eq!(scene.clip.planes[0], PlaneSpec { normal: scene.slices[1].normal, offset: scene.slices[1].offset });
    }
}
