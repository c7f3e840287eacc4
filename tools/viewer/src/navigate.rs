//! Camera motion by hand: orbit, pan, dolly, projection. World space throughout. Positions in the picture are
//! normalised device coordinates: x to the right and y up, both from -1 to 1.
//!
//! Orbits keep the horizon: the camera turns about the volume's up direction, and its elevation stays between the
//! poles.

use glam::{DQuat, DVec3};
use supervol_scene::scene::CameraSpec;

/// Vertical angle of view after a switch to perspective, in degrees.
const FOV_Y: f64 = 30.0;
/// Greatest elevation in degrees; at 90, right and left are undefined.
const STEEPEST: f64 = 89.9;
/// Least and greatest distance from the target, or height of an orthographic picture, in diagonals of the volume.
const DISTANCES: [f64; 2] = [1e-4, 1e3];

/// Facts of the volume that camera motion needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stage {
    /// World direction that points up; a unit vector.
    pub up: DVec3,
    /// World length of the volume's diagonal.
    pub diagonal: f64,
}

/// The camera's axes (unit vectors in world space) and the distance of its target.
struct Axes {
    forward: DVec3,
    right: DVec3,
    up: DVec3,
    distance: f64,
}

impl Axes {
    fn of(camera: &CameraSpec) -> Self {
        let [eye, target, up] = [camera.eye, camera.target, camera.up].map(DVec3::from_array);
        let forward = (target - eye).normalize_or(DVec3::X);
        let right = forward.cross(up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
        Self { forward, right, up: right.cross(forward), distance: (target - eye).length() }
    }

    /// World height of the picture at the distance of the target.
    fn height(&self, camera: &CameraSpec) -> f64 {
        match (camera.height, camera.fov_y) {
            (Some(height), _) => height,
            (None, fov_y) => 2.0 * self.distance * (fov_y.unwrap_or(FOV_Y).to_radians() / 2.0).tan(),
        }
    }
}

/// Turns the camera around its target: by `yaw` to the viewer's right and by `pitch` upwards, in degrees.
#[must_use]
pub fn orbit(camera: &CameraSpec, stage: &Stage, [yaw, pitch]: [f64; 2]) -> CameraSpec {
    let axes = Axes::of(camera);
    let outward = -axes.forward;
    let level = axes.right.cross(stage.up).try_normalize().unwrap_or_else(|| stage.up.any_orthonormal_vector());
    let elevation = outward.dot(stage.up).clamp(-1.0, 1.0).asin().to_degrees();
    let (sin, cos) = (elevation + pitch).clamp(-STEEPEST, STEEPEST).to_radians().sin_cos();
    let level = DQuat::from_axis_angle(stage.up, yaw.to_radians()) * level;
    let eye = DVec3::from_array(camera.target) + axes.distance * (cos * level + sin * stage.up);
    CameraSpec { eye: eye.to_array(), up: stage.up.to_array(), ..camera.clone() }
}

/// Moves the camera so that the target moves in the picture, to the right and up. Unit: heights of the picture.
#[must_use]
pub fn pan(camera: &CameraSpec, [right, up]: [f64; 2]) -> CameraSpec {
    let axes = Axes::of(camera);
    let shift = -axes.height(camera) * (right * axes.right + up * axes.up);
    moved(camera, shift)
}

/// Multiplies the distance to the target by a factor: nearer below 1, away above 1. The point under `cursor`, at the
/// target's depth, stays where it is in a picture with this aspect ratio (width over height).
#[must_use]
pub fn dolly(camera: &CameraSpec, stage: &Stage, factor: f64, cursor: [f64; 2], aspect: f64) -> CameraSpec {
    let axes = Axes::of(camera);
    let height = axes.height(camera);
    let at = 0.5 * height * (cursor[0] * aspect * axes.right + cursor[1] * axes.up);
    let size = if camera.height.is_some() { height } else { axes.distance };
    let [least, most] = DISTANCES.map(|share| share * stage.diagonal);
    let factor = (size * factor).clamp(least.min(size), most.max(size)) / size;
    // The point under the cursor is `target + at`; distances to it are multiplied by the factor.
    let target = DVec3::from_array(camera.target) + at * (1.0 - factor);
    let distance = if camera.height.is_some() { axes.distance } else { axes.distance * factor };
    CameraSpec {
        eye: (target - distance * axes.forward).to_array(),
        target: target.to_array(),
        height: camera.height.map(|height| height * factor),
        ..camera.clone()
    }
}

/// Switches between perspective and orthographic projection. The target keeps its size in the picture.
#[must_use]
pub fn other_projection(camera: &CameraSpec) -> CameraSpec {
    let axes = Axes::of(camera);
    let height = axes.height(camera);
    if camera.height.is_none() {
        return CameraSpec { fov_y: None, height: Some(height), ..camera.clone() };
    }
    let distance = 0.5 * height / (FOV_Y.to_radians() / 2.0).tan();
    let eye = DVec3::from_array(camera.target) - distance * axes.forward;
    CameraSpec { eye: eye.to_array(), fov_y: Some(FOV_Y), height: None, ..camera.clone() }
}

/// Flies: moves camera and target forward by a share of their distance.
#[must_use]
pub fn fly(camera: &CameraSpec, share: f64) -> CameraSpec {
    let axes = Axes::of(camera);
    moved(camera, share * axes.distance * axes.forward)
}

/// World direction in which a camera looks, a unit vector.
#[must_use]
pub fn forward_of(camera: &CameraSpec) -> DVec3 {
    Axes::of(camera).forward
}

/// World direction to a camera's right, a unit vector.
#[must_use]
pub fn right_of(camera: &CameraSpec) -> DVec3 {
    Axes::of(camera).right
}

/// World vector, perpendicular to the view direction, for a drag of a world point. The drag is in heights of the
/// picture, to the right and up.
#[must_use]
pub fn drag_at(camera: &CameraSpec, point: DVec3, [right, up]: [f64; 2]) -> DVec3 {
    let axes = Axes::of(camera);
    let depth = (point - DVec3::from_array(camera.eye)).dot(axes.forward);
    let scale = if camera.height.is_some() { 1.0 } else { depth / axes.distance };
    scale * axes.height(camera) * (right * axes.right + up * axes.up)
}

/// The world point at the target's depth under a position of the picture; `aspect` is width over height.
#[must_use]
pub fn point_at(camera: &CameraSpec, at: [f64; 2], aspect: f64) -> DVec3 {
    let axes = Axes::of(camera);
    let half = 0.5 * axes.height(camera);
    DVec3::from_array(camera.target) + half * (at[0] * aspect * axes.right + at[1] * axes.up)
}

/// Position of a world point in the picture; `None` if it lies beside or behind a perspective camera.
#[must_use]
pub fn place_of(camera: &CameraSpec, point: DVec3, aspect: f64) -> Option<[f64; 2]> {
    let axes = Axes::of(camera);
    let from_eye = point - DVec3::from_array(camera.eye);
    let depth = from_eye.dot(axes.forward);
    let scale = if camera.height.is_some() { 1.0 } else { depth / axes.distance };
    let half = 0.5 * axes.height(camera) * scale;
    let place = [from_eye.dot(axes.right) / (half * aspect), from_eye.dot(axes.up) / half];
    (scale > 0.0 && place.iter().all(|p| p.is_finite())).then_some(place)
}

/// The camera, moved along its view direction to the depth of another camera's target. Used when the user switches
/// slices.
#[must_use]
pub fn shifted_to(camera: &CameraSpec, other: &CameraSpec) -> CameraSpec {
    let axes = Axes::of(camera);
    let depth = (DVec3::from_array(other.target) - DVec3::from_array(camera.target)).dot(axes.forward);
    moved(camera, depth * axes.forward)
}

fn moved(camera: &CameraSpec, by: DVec3) -> CameraSpec {
    let [eye, target] = [camera.eye, camera.target].map(|point| (DVec3::from_array(point) + by).to_array());
    CameraSpec { eye, target, ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use supervol_scene::camera::{Camera, Projection};

    use super::*;

    const STAGE: Stage = Stage { up: DVec3::Z, diagonal: 20.0 };

    fn camera(fov_y: Option<f64>, height: Option<f64>) -> CameraSpec {
        CameraSpec { eye: [10.0, 2.0, 5.0], target: [1.0, 2.0, 3.0], up: [0.0, 0.0, 1.0], fov_y, height }
    }

    fn both() -> [CameraSpec; 2] {
        [camera(Some(30.0), None), camera(None, Some(8.0))]
    }

    /// Position of a world point in a picture of 200 x 100 pixels, normalised.
    fn place(camera: &CameraSpec, point: DVec3) -> [f64; 2] {
        let projection = match camera.height {
            Some(height) => Projection::Orthographic { height },
            None => Projection::Perspective { fov_y: camera.fov_y.unwrap() },
        };
        let camera =
            Camera::look_at(camera.eye.into(), camera.target.into(), camera.up.into(), projection, [200, 100]).unwrap();
        let p = point - camera.eye;
        let half = match projection {
            Projection::Orthographic { height } => height / 2.0,
            Projection::Perspective { fov_y } => p.dot(camera.forward) * (fov_y.to_radians() / 2.0).tan(),
        };
        [p.dot(camera.right) / half / 2.0, p.dot(camera.up) / half]
    }

    #[test]
    fn orbits_keep_distance_and_horizon_and_end_at_the_poles() {
        for start in both() {
            let turned = orbit(&start, &STAGE, [30.0, 10.0]);
            let distance = |c: &CameraSpec| (DVec3::from_array(c.eye) - DVec3::from_array(c.target)).length();
            assert!((distance(&turned) - distance(&start)).abs() < 1e-9);
            assert!(Axes::of(&turned).right.z.abs() < 1e-12, "the horizon is level");
            let above = orbit(&start, &STAGE, [0.0, 1000.0]);
            assert!(Axes::of(&above).forward.z < -0.999);
            let back = orbit(&orbit(&start, &STAGE, [40.0, 0.0]), &STAGE, [-40.0, 0.0]);
            assert!((DVec3::from_array(back.eye) - DVec3::from_array(start.eye)).length() < 1e-9);
        }
    }

    #[test]
    fn an_orbit_to_the_right_shows_more_of_the_right_side() {
        for start in both() {
            let right = Axes::of(&start).right;
            let turned = orbit(&start, &STAGE, [20.0, 0.0]);
            assert!(Axes::of(&turned).forward.dot(right) < -0.1);
        }
    }

    #[test]
    fn the_point_under_the_cursor_stays_there() {
        for start in both() {
            let axes = Axes::of(&start);
            let cursor = [0.5, -0.25];
            let at = 0.5 * axes.height(&start) * (cursor[0] * 2.0 * axes.right + cursor[1] * axes.up);
            let point = DVec3::from_array(start.target) + at;
            for factor in [0.5, 0.9, 1.7] {
                let nearer = dolly(&start, &STAGE, factor, cursor, 2.0);
                let found = place(&nearer, point);
                assert!((found[0] - cursor[0]).abs() < 1e-9 && (found[1] - cursor[1]).abs() < 1e-9, "{found:?}");
                let size = Axes::of(&nearer).height(&nearer) / axes.height(&start);
                assert!((size - factor).abs() < 1e-9);
            }
            let nearest = dolly(&start, &STAGE, 0.0, cursor, 2.0);
            assert!(Axes::of(&nearest).height(&nearest) > 0.0, "never through the target");
        }
    }

    #[test]
    fn points_are_seen_where_they_are() {
        for start in both() {
            let point = DVec3::new(0.5, 3.0, 2.0);
            let found = place_of(&start, point, 2.0).expect("it is before the camera");
            let expected = place(&start, point);
            assert!((0..2).all(|a| (found[a] - expected[a]).abs() < 1e-12), "{found:?} {expected:?}");
            // A dragged point stays under the mouse. One height is 2 in y and, at this aspect ratio, 1 in x.
            let dragged = point + drag_at(&start, point, [0.1, -0.05]);
            let moved = place_of(&start, dragged, 2.0).expect("it is before the camera");
            assert!(
                (moved[0] - found[0] - 0.1).abs() < 1e-12 && (moved[1] - found[1] + 0.1).abs() < 1e-12,
                "{moved:?}"
            );
            let at = [0.3, -0.7];
            let back = place_of(&start, point_at(&start, at, 2.0), 2.0).expect("it is before the camera");
            assert!((0..2).all(|a| (back[a] - at[a]).abs() < 1e-12), "{back:?}");
        }
        assert_eq!(place_of(&camera(Some(30.0), None), DVec3::new(20.0, 2.0, 7.0), 2.0), None, "behind the camera");
    }

    #[test]
    fn what_is_dragged_follows_the_cursor() {
        for start in both() {
            let target = DVec3::from_array(start.target);
            let [x, y] = place(&pan(&start, [0.25, 0.1]), target);
            // One height is 2 in y and, at this aspect ratio, 1 in x.
            assert!((x - 0.25).abs() < 1e-9 && (y - 0.2).abs() < 1e-9, "{x} {y}");
        }
    }

    #[test]
    fn the_projection_changes_there_and_back() {
        for start in both() {
            let once = other_projection(&start);
            assert_ne!(once.height.is_some(), start.height.is_some());
            assert!((Axes::of(&once).height(&once) - Axes::of(&start).height(&start)).abs() < 1e-9);
            assert_eq!(other_projection(&once).height.is_some(), start.height.is_some());
        }
        let [near, far] = both();
        let shifted = shifted_to(&near, &CameraSpec { target: [-8.0, 2.0, 1.0], ..far });
        assert!((Axes::of(&shifted).forward - Axes::of(&near).forward).length() < 1e-12);
        assert!((DVec3::from_array(shifted.target) - DVec3::new(-8.0, 2.0, 1.0)).length() < 1e-9);
        let ahead = fly(&camera(Some(30.0), None), 0.5);
        assert!((DVec3::from_array(ahead.eye) - DVec3::new(5.5, 2.0, 4.0)).length() < 1e-9);
    }
}
