//! Cameras of an animation: a full turn around the volume, or interpolation between key frames.
//!
//! Between two key frames the target moves along a straight line. The camera turns around the target at constant
//! angular speed (Shoemake 1985). Distances and angles of view change by a constant factor per frame.

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

use crate::camera::unit_vector;
use crate::spec::CameraSpec;

/// Most frames of a path.
pub const FRAME_LIMIT: u32 = 100_000;

/// Reason why key frames define no path.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum CameraPathError {
    #[error("not a camera path: {0}")]
    Json(#[from] serde_json::Error),
    #[error("key frames: expected {expected}, found {found}")]
    Keys { expected: String, found: String },
}

/// A camera at a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyFrame {
    /// Number of the frame; the first is 0.
    pub frame: u32,
    /// The camera, as in a scene.
    pub camera: CameraSpec,
}

/// File content `{"keys": [{"frame": 0, "camera": {...}}, ...]}`. The first key is frame 0; the last key ends the path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Key frames in ascending order of `frame`.
    pub keys: Vec<KeyFrame>,
}

impl CameraPath {
    /// Reads a path from JSON text.
    ///
    /// # Errors
    /// If the text is not valid, if frames do not ascend from 0 to less than [`FRAME_LIMIT`], or if perspective and
    /// orthographic cameras are mixed. The cameras themselves are checked when their frame is drawn.
    pub fn from_json(text: &str) -> Result<Self, CameraPathError> {
        let path: Self = serde_json::from_str(text)?;
        let wrong = |expected: &str, found: String| Err(CameraPathError::Keys { expected: expected.into(), found });
        if path.keys.first().is_none_or(|key| key.frame != 0) {
            return wrong("the first at frame 0", path.keys.first().map_or("none".into(), |k| format!("{}", k.frame)));
        }
        for pair in path.keys.windows(2) {
            let [from, to] = pair else { continue };
            if to.frame <= from.frame || to.frame >= FRAME_LIMIT {
                let expected = format!("frames that ascend, below {FRAME_LIMIT}");
                return wrong(&expected, format!("{} after {}", to.frame, from.frame));
            }
            if from.camera.fov_y.is_some() != to.camera.fov_y.is_some() {
                let found = format!("both, at frames {} and {}", from.frame, to.frame);
                return wrong("cameras with `fov_y` all along, or with `height`", found);
            }
        }
        Ok(path)
    }

    /// The cameras of all frames, in order.
    #[must_use]
    pub fn cameras(&self) -> Vec<CameraSpec> {
        let between = self.keys.windows(2).flat_map(|pair| {
            let frames = pair[1].frame - pair[0].frame;
            (0..frames).map(move |i| between(&pair[0].camera, &pair[1].camera, f64::from(i) / f64::from(frames)))
        });
        between.chain(self.keys.last().map(|key| key.camera.clone())).collect()
    }
}

/// `frames` cameras on one full turn around the target, at equal angles about the world direction `axis`. The first is
/// `camera` itself.
#[must_use]
pub fn turntable(camera: &CameraSpec, axis: DVec3, frames: u32) -> Vec<CameraSpec> {
    let axis = unit_vector(axis).unwrap_or(DVec3::Z);
    let [eye, target, up] = [camera.eye, camera.target, camera.up].map(DVec3::from_array);
    let turned = |i: u32| {
        let turn = DQuat::from_axis_angle(axis, std::f64::consts::TAU * f64::from(i) / f64::from(frames));
        let eye = target + turn * (eye - target);
        CameraSpec { eye: eye.to_array(), up: (turn * up).to_array(), ..camera.clone() }
    };
    (0..frames).map(turned).collect()
}

/// The camera at the share `share` in [0, 1] of the way between two cameras.
fn between(from: &CameraSpec, to: &CameraSpec, share: f64) -> CameraSpec {
    if share == 0.0 {
        return from.clone();
    }
    let (Some((turn_from, far_from)), Some((turn_to, far_to))) = (orientation(from), orientation(to)) else {
        return from.clone();
    };
    let turn = turn_from.slerp(turn_to, share);
    let target = DVec3::from_array(from.target).lerp(DVec3::from_array(to.target), share);
    let evenly = |a: f64, b: f64| a * (b / a).powf(share);
    let evenly_if = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| evenly(a, b));
    CameraSpec {
        eye: (target + evenly(far_from, far_to) * (turn * DVec3::Z)).to_array(),
        target: target.to_array(),
        up: (turn * DVec3::Y).to_array(),
        fov_y: evenly_if(from.fov_y, to.fov_y),
        height: evenly_if(from.height, to.height),
    }
}

/// The rotation from x, y, z to the camera's right, up and backward axes, and the distance from eye to target.
fn orientation(camera: &CameraSpec) -> Option<(DQuat, f64)> {
    let away = DVec3::from_array(camera.eye) - DVec3::from_array(camera.target);
    let back = unit_vector(away)?;
    let right = unit_vector(DVec3::from_array(camera.up).cross(back))?;
    Some((DQuat::from_mat3(&DMat3::from_cols(right, back.cross(right), back)), away.length()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(eye: [f64; 3], fov_y: f64) -> CameraSpec {
        CameraSpec { eye, target: [1.0, 2.0, 3.0], up: [0.0, 0.0, 1.0], fov_y: Some(fov_y), height: None }
    }

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        DVec3::from_array(a).abs_diff_eq(DVec3::from_array(b), 1e-9)
    }

    #[test]
    fn a_turntable_ends_where_it_began() {
        let path = turntable(&camera([11.0, 2.0, 8.0], 30.0), DVec3::new(0.0, 0.0, 7.0), 4);
        let eyes = [[11.0, 2.0, 8.0], [1.0, 12.0, 8.0], [-9.0, 2.0, 8.0], [1.0, -8.0, 8.0]];
        assert_eq!(path.len(), 4);
        assert!(path.iter().zip(eyes).all(|(camera, eye)| close(camera.eye, eye) && close(camera.up, [0.0, 0.0, 1.0])));
    }

    #[test]
    fn between_key_frames_the_camera_turns_and_moves_evenly() {
        let keys = [(0, camera([11.0, 2.0, 3.0], 40.0)), (4, camera([1.0, 42.0, 3.0], 10.0))];
        let keys = keys.map(|(frame, camera)| KeyFrame { frame, camera });
        let text = serde_json::to_string(&CameraPath { keys: keys.to_vec() }).expect("a path");
        let cameras = CameraPath::from_json(&text).expect("a path").cameras();
        assert_eq!(cameras.len(), 5);
        assert_eq!((&cameras[0], &cameras[4]), (&keys[0].camera, &keys[1].camera));
        // Half way: 45 degrees, and the geometric mean of 10 and 40.
        let half = 20.0 * std::f64::consts::FRAC_1_SQRT_2;
        assert!(close(cameras[2].eye, [1.0 + half, 2.0 + half, 3.0]), "{:?}", cameras[2]);
        assert!(close(cameras[2].up, [0.0, 0.0, 1.0]) && (cameras[2].fov_y.expect("perspective") - 20.0).abs() < 1e-9);
    }

    #[test]
    fn what_is_no_path_is_refused_with_a_reason() {
        let key = |frame: u32, camera: CameraSpec| KeyFrame { frame, camera };
        let parallel = CameraSpec { fov_y: None, height: Some(5.0), ..camera([9.0; 3], 30.0) };
        let cases = [
            (vec![], "frame 0"),
            (vec![key(1, camera([9.0; 3], 30.0))], "frame 0"),
            (vec![key(0, camera([9.0; 3], 30.0)), key(0, camera([8.0; 3], 30.0))], "ascend"),
            (vec![key(0, camera([9.0; 3], 30.0)), key(FRAME_LIMIT, camera([8.0; 3], 30.0))], "below 100000"),
            (vec![key(0, camera([9.0; 3], 30.0)), key(5, parallel)], "`fov_y` all along"),
        ];
        for (keys, expected) in cases {
            let text = serde_json::to_string(&CameraPath { keys }).expect("JSON");
            let error = CameraPath::from_json(&text).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}");
        }
        assert!(CameraPath::from_json("{}").is_err());
    }
}
