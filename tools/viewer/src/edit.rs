//! Edits of a scene by the panels. Each result is a scene that could also be written by hand.

use glam::DVec3;
use supervol_format::cast::whole;
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::view::{Direction, View};
use supervol_scene::preset::{colormap, domain, domain_corners, looks, ramps};
use supervol_scene::scene::section::Slice;
use supervol_scene::scene::{CameraSpec, Mode, PointSpec, PointsSpec, Scene, ShadingSpec, TransferFunctionSpec};

use crate::navigate::Stage;
use crate::worker::OpenVolume;

/// Most control points that can be edited individually; a function with more is a table.
pub const POINT_LIMIT: usize = 256;

/// Least distance of the ends of the ramp of opacity by the gradient, as a share of the greater one. Scenes may have narrower
/// ramps, which nobody can tell from steps.
const LEAST_GRADIENT_RAMP: f64 = 1e-3;

/// The stage of a volume for camera motion.
#[must_use]
pub fn stage(facts: &VolumeFacts) -> Stage {
    let [first, .., last] = domain_corners(facts);
    let up = View::from(facts, Direction::Front).up;
    Stage { up, diagonal: (last - first).length().max(f64::MIN_POSITIVE) }
}

/// The camera that frames the visible region from a direction, or from the default direction. `None` if world
/// coordinates are too coarse for cameras; such a scene leaves its camera open.
#[must_use]
pub fn camera_from(scene: &Scene, opened: &OpenVolume, direction: Option<Direction>) -> Option<CameraSpec> {
    scene.camera.as_ref()?;
    let facts = opened.facts();
    let view = direction.map_or_else(|| View::of(facts), |direction| View::from(facts, direction));
    let size = [scene.image.width, scene.image.height];
    Some(view.camera(&scene.framed(facts, opened.overview()), size))
}

/// Control points of the scene's transfer function, with their unit distance (a world length).
#[must_use]
pub fn points(scene: &Scene) -> Option<&PointsSpec> {
    match &scene.transfer_function {
        Some(TransferFunctionSpec::Points(spec)) => Some(spec),
        _ => None,
    }
}

/// Mutable access to the control points.
pub fn points_mut(scene: &mut Scene) -> Option<&mut PointsSpec> {
    match &mut scene.transfer_function {
        Some(TransferFunctionSpec::Points(spec)) => Some(spec),
        _ => None,
    }
}

/// Replaces a preset's name by its control points, so that they can be edited.
pub fn write_out(scene: &mut Scene, facts: &VolumeFacts) {
    if let Some(TransferFunctionSpec::Preset(name)) = &scene.transfer_function
        && let Ok(function) = supervol_scene::preset::transfer_function(name, facts)
    {
        let spec = PointsSpec::of(function.points(), function.unit_distance());
        scene.transfer_function = Some(TransferFunctionSpec::Points(spec));
    }
}

/// The default picture of a kind of data, with the present camera.
#[must_use]
pub fn with_kind(scene: &Scene, opened: &OpenVolume, kind: DataKind) -> Scene {
    let facts = VolumeFacts { kind, ..opened.facts().clone() };
    let open = Scene {
        camera: scene.camera.clone(),
        image: scene.image.clone(),
        clip: scene.clip.clone(),
        vertical_exaggeration: scene.vertical_exaggeration,
        ..Scene::default()
    };
    open.complete(&facts, opened.overview())
}

/// The default picture of a mode, as `render --mode` draws it: with shading for solid data, with a surface for `iso`.
#[must_use]
pub fn with_mode(scene: &Scene, opened: &OpenVolume, mode: Mode) -> Scene {
    let (facts, overview) = (opened.facts(), opened.overview());
    let usual = with_kind(scene, opened, facts.kind);
    if usual.mode == Some(mode) {
        return usual;
    }
    let open = Scene {
        mode: Some(mode),
        transfer_function: None,
        shading: (mode == Mode::Dvr).then(|| (!facts.kind.is_seismic()).then(ShadingSpec::default)),
        gradient_opacity: None,
        cut_normals: false,
        iso: if mode == Mode::Iso { vec![looks::default_surface(facts)] } else { Vec::new() },
        samples_per_pixel: None,
        ..scene.clone()
    };
    open.complete(facts, overview)
}

/// Adds an iso surface inside the semi-transparent volume, as `render --surface` does. It is shaded, because the shape
/// of an unshaded surface is invisible. The first surface gets the default value for the data; each further one lies
/// halfway to the greatest value.
pub fn add_inner_surface(scene: &mut Scene, facts: &VolumeFacts) {
    let mut surface = looks::default_surface(facts);
    if let Some(last) = scene.iso.last() {
        surface.value = 0.5 * last.value + 0.5 * facts.central_range.max;
    } else if scene.shading == Some(None) {
        scene.shading = Some(Some(ShadingSpec::default()));
    }
    scene.iso.push(surface);
}

/// Least and greatest value of the control points.
#[must_use]
pub fn window(scene: &Scene) -> Option<[f64; 2]> {
    let points = &points(scene)?.points;
    Some([points.first()?.value, points.last()?.value])
}

/// Moves all control points to another window.
pub fn set_window(scene: &mut Scene, [low, high]: [f64; 2]) {
    if low.is_finite() && high.is_finite() && low < high {
        repaint(scene, Some([low, high]), None);
    }
}

/// Sets the window that excludes this percentage of the voxels at each end.
pub fn clip_percent(scene: &mut Scene, facts: &VolumeFacts, percent: f64) {
    repaint(scene, Some(ramps::clipped_window(facts, percent)), None);
}

/// Sets the colours of a colour map by name.
pub fn set_colors(scene: &mut Scene, name: &str) {
    if let Some(colors) = colormap::by_name(name) {
        paint(scene, &colors);
    }
}

/// Sets colours at positions from 0 to 1 of the window.
pub fn paint(scene: &mut Scene, colors: &[(f64, [f64; 3])]) {
    repaint(scene, None, Some(colors));
}

fn repaint(scene: &mut Scene, window: Option<[f64; 2]>, colors: Option<&[(f64, [f64; 3])]>) {
    if let Some(spec) = points_mut(scene) {
        let points = ramps::repainted(&spec.control_points(), window, colors);
        *spec = PointsSpec { unit_distance: spec.unit_distance, ..PointsSpec::of(&points, 1.0) };
    }
}

/// Moves a control point, at most up to its neighbours.
pub fn move_point(points: &mut [PointSpec], i: usize, value: f64, alpha: f64) {
    let low = i.checked_sub(1).map_or(f64::NEG_INFINITY, |before| points[before].value);
    let high = points.get(i + 1).map_or(f64::INFINITY, |after| after.value);
    if let Some(point) = points.get_mut(i).filter(|_| value.is_finite() && alpha.is_finite()) {
        (point.value, point.alpha) = (value.clamp(low, high), alpha.clamp(0.0, 1.0));
    }
}

/// Adds a control point with the present colour and returns its index. `None` if there are too many.
pub fn add_point(points: &mut Vec<PointSpec>, value: f64, alpha: f64) -> Option<usize> {
    if points.len() >= POINT_LIMIT || !value.is_finite() {
        return None;
    }
    let place = points.partition_point(|p| p.value <= value);
    let color = match (place.checked_sub(1).map(|i| points[i]), points.get(place)) {
        (Some(a), Some(b)) if b.value > a.value => {
            let share = (value - a.value) / (b.value - a.value);
            std::array::from_fn(|c| a.color[c] + share * (b.color[c] - a.color[c]))
        }
        (Some(p), _) => p.color,
        (None, p) => p.map_or([1.0; 3], |p| p.color),
    };
    points.insert(place, PointSpec { value, color, alpha: alpha.clamp(0.0, 1.0) });
    Some(place)
}

/// Removes a control point; the last one stays.
pub fn remove_point(points: &mut Vec<PointSpec>, i: usize) {
    if points.len() > 1 && i < points.len() {
        points.remove(i);
    }
}

/// The ramp of opacity by the gradient with another end: 0, where opacity begins, or 1, where it is full. An end moves at most up
/// to the other one.
#[must_use]
pub fn with_gradient_end(ramp: [f64; 2], end: usize, length: f64) -> [f64; 2] {
    let [from, to] = ramp;
    let moved = match end {
        0 => [length.max(0.0).min((1.0 - LEAST_GRADIENT_RAMP) * to), to],
        _ => [from, length.max(from / (1.0 - LEAST_GRADIENT_RAMP))],
    };
    if length.is_finite() && moved[1] > 0.0 { moved } else { ramp }
}

/// One slice inside the scene's clip box, face on, as `render --slice` shows it. `None` if nothing of it is left.
#[must_use]
pub fn sliced(scene: &Scene, opened: &OpenVolume, axis: usize, at: u64) -> Option<Scene> {
    let facts = opened.facts();
    let open = Scene { image: scene.image.clone(), clip: scene.clip.clone(), ..Scene::default() };
    let slice = Slice { axis, at: at as f64, slab: None, zoom: 1.0 };
    slice.of(&open, facts, &ramps::of_slice(facts))
}

/// The clip box in voxels: first and last kept voxel along each axis.
#[must_use]
pub fn kept_voxels(scene: &Scene, facts: &VolumeFacts) -> [[u64; 2]; 3] {
    let [low, high] = scene.clip.index_box.unwrap_or_else(|| domain(facts));
    std::array::from_fn(|a| {
        let most = facts.dims.0[a] - 1;
        // Voxel i begins at the face i - 1/2.
        [
            whole::<u64>((low[a] + 0.5).round().clamp(0.0, most as f64)),
            whole::<u64>((high[a] - 0.5).round().clamp(0.0, most as f64)),
        ]
    })
}

/// Keeps these voxels; sets no clip box if they are all.
pub fn keep_voxels(scene: &mut Scene, facts: &VolumeFacts, kept: [[u64; 2]; 3]) {
    let whole = kept.iter().zip(facts.dims.0).all(|(&[first, last], n)| first == 0 && last == n - 1);
    let ends = |end: usize, half: f64| kept.map(|ends| ends[end] as f64 + half);
    scene.clip.index_box = (!whole).then(|| [ends(0, -0.5), ends(1, 0.5)]);
}

/// World direction in which the light travels. The light's position is given in degrees to the right of and above the
/// viewer.
#[must_use]
pub fn light_from(camera: &CameraSpec, [right, above]: [f64; 2]) -> [f64; 3] {
    let forward = (DVec3::from_array(camera.target) - DVec3::from_array(camera.eye)).normalize_or(DVec3::X);
    let to_right = forward.cross(camera.up.into()).normalize_or(forward.any_orthonormal_vector());
    let up = to_right.cross(forward);
    let ([sin_r, cos_r], [sin_a, cos_a]) =
        ([right.to_radians().sin(), right.to_radians().cos()], [above.to_radians().sin(), above.to_radians().cos()]);
    let towards_light = cos_a * (cos_r * -forward + sin_r * to_right) + sin_a * up;
    (-towards_light).to_array()
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, Geometry, ValueRange};

    use super::*;

    fn facts() -> VolumeFacts {
        VolumeFacts::plain(Dims([10, 20, 1]), Geometry::IDENTITY, ValueRange { min: 0.0, max: 100.0 })
    }

    fn point(value: f64, grey: f64) -> PointSpec {
        PointSpec { value, color: [grey; 3], alpha: 0.5 }
    }

    #[test]
    fn points_stay_sorted_and_in_range() {
        let mut points = vec![point(0.0, 0.0), point(10.0, 1.0), point(20.0, 0.0)];
        move_point(&mut points, 1, 90.0, 3.0);
        assert_eq!((points[1].value, points[1].alpha), (20.0, 1.0));
        move_point(&mut points, 1, f64::NAN, 0.1);
        assert_eq!(points[1].value, 20.0);
        move_point(&mut points, 1, 8.0, 0.1);
        assert_eq!(add_point(&mut points, 2.0, 0.2), Some(1));
        assert_eq!(points[1].color, [0.25; 3]);
        assert_eq!(add_point(&mut points, -5.0, 0.2), Some(0));
        assert!(points.is_sorted_by(|a, b| a.value <= b.value));
        while add_point(&mut points, 50.0, 0.0).is_some() {}
        assert_eq!(points.len(), POINT_LIMIT);
        (0..POINT_LIMIT + 5).for_each(|_| remove_point(&mut points, 0));
        assert_eq!(points.len(), 1, "the last point stays");
    }

    #[test]
    fn ends_of_the_gradient_ramp_keep_their_order() {
        let ramp = [5.0, 25.0];
        assert_eq!(with_gradient_end(ramp, 0, 7.0), [7.0, 25.0]);
        assert_eq!(with_gradient_end(ramp, 0, -1.0), [0.0, 25.0]);
        assert_eq!(with_gradient_end(ramp, 0, 30.0), [24.975, 25.0]);
        assert_eq!(with_gradient_end(ramp, 1, 30.0), [5.0, 30.0]);
        let [from, to] = with_gradient_end(ramp, 1, 1.0);
        assert!(from == 5.0 && (to - 5.005).abs() < 1e-4, "{to}");
        for length in [f64::NAN, f64::INFINITY] {
            assert_eq!([0, 1].map(|end| with_gradient_end(ramp, end, length)), [ramp; 2]);
        }
        assert_eq!(with_gradient_end([0.0, 25.0], 1, 0.0), [0.0, 25.0], "a ramp has a width");
        for ramp in [with_gradient_end(ramp, 0, 30.0), with_gradient_end(ramp, 1, 1.0)] {
            let scene = Scene { mode: Some(Mode::Dvr), gradient_opacity: Some(ramp), ..Scene::default() };
            scene.validate().unwrap_or_else(|e| panic!("{e}"));
        }
    }

    #[test]
    fn boxes_are_told_in_voxels() {
        let (mut scene, facts) = (Scene::default(), facts());
        let whole = [[0, 9], [0, 19], [0, 0]];
        assert_eq!(kept_voxels(&scene, &facts), whole);
        let kept = [[2, 5], [0, 19], [0, 0]];
        keep_voxels(&mut scene, &facts, kept);
        assert_eq!(scene.clip.index_box, Some([[1.5, -0.5, -0.5], [5.5, 19.5, 0.5]]));
        assert_eq!(kept_voxels(&scene, &facts), kept);
        keep_voxels(&mut scene, &facts, whole);
        assert_eq!(scene.clip.index_box, None);
    }

    #[test]
    fn light_straight_from_the_viewer_travels_forward() {
        let camera = CameraSpec {
            eye: [0.0, -5.0, 0.0],
            target: [0.0; 3],
            up: [0.0, 0.0, 1.0],
            fov_y: Some(30.0),
            height: None,
        };
        let near = |a: [f64; 3], b: [f64; 3]| (DVec3::from(a) - DVec3::from(b)).length() < 1e-12;
        assert!(near(light_from(&camera, [0.0, 0.0]), [0.0, 1.0, 0.0]));
        assert!(near(light_from(&camera, [90.0, 0.0]), [-1.0, 0.0, 0.0]), "from the right it travels to the left");
        assert!(near(light_from(&camera, [0.0, 90.0]), [0.0, 0.0, -1.0]), "from above it travels down");
    }
}
