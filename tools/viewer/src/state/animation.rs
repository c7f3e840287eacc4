//! State of the animation dialog, and the key frames.

use supervol_scene::camera_path::{CameraPath, FRAME_LIMIT, KeyFrame};
use supervol_scene::image::ImageFormat;
use supervol_scene::scene::{CameraSpec, Scene};

/// Default number of pictures of a turntable (four seconds), and between two key frames (two seconds).
const TURN_FRAMES: u32 = 100;
const STEP_FRAMES: u32 = 50;
/// Most key frames.
const KEY_LIMIT: usize = 200;

/// Kind of the requested animation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// One turn around the volume.
    Turntable,
    /// From key frame to key frame.
    Path,
}

/// State of the dialog.
pub(crate) struct AnimationDialog {
    pub(crate) kind: Kind,
    pub(crate) frames: u32,
    pub(crate) folder: String,
    pub(crate) format: ImageFormat,
    pub(crate) replace: bool,
    pub(crate) size: [u32; 2],
}

/// Key frames taken by the user. They persist while the dialog is closed.
#[derive(Default)]
pub(crate) struct KeyFrames(pub(crate) Vec<KeyFrame>);

impl KeyFrames {
    /// Adds a view at the end.
    pub(crate) fn add(&mut self, camera: &CameraSpec) {
        let frame = self.0.last().map_or(0, |last| last.frame + STEP_FRAMES);
        if self.0.len() < KEY_LIMIT && frame < FRAME_LIMIT {
            self.0.push(KeyFrame { frame, camera: camera.clone() });
        }
    }

    /// Removes a key frame; the first remaining one becomes frame 0.
    pub(crate) fn remove(&mut self, i: usize) {
        self.0.remove(i);
        let first = self.0.first().map_or(0, |key| key.frame);
        self.0.iter_mut().for_each(|key| key.frame -= first);
    }

    /// The camera path, or the reason why there is none.
    pub(crate) fn path(&self) -> Result<CameraPath, String> {
        if self.0.len() < 2 {
            return Err("Take at least two views: turn the volume, then press `Take this view`.".into());
        }
        let path = CameraPath { keys: self.0.clone() };
        let text = serde_json::to_string(&path).map_err(|e| e.to_string())?;
        CameraPath::from_json(&text).map_err(|e| e.to_string())
    }
}

impl AnimationDialog {
    /// The dialog for pictures as large as that on the screen.
    pub(crate) fn new(folder: String, scene: &Scene) -> Self {
        Self {
            kind: Kind::Turntable,
            frames: TURN_FRAMES,
            folder,
            format: ImageFormat::Png,
            replace: false,
            size: [scene.image.width, scene.image.height],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::history::tests::camera;

    #[test]
    fn views_are_key_frames_that_begin_at_0() {
        let mut keys = KeyFrames::default();
        keys.add(&camera(0.0));
        assert!(keys.path().unwrap_err().contains("two views"));
        (1..4).for_each(|x| keys.add(&camera(f64::from(x))));
        assert_eq!(keys.path().unwrap().cameras().len() as u32, 3 * STEP_FRAMES + 1);
        keys.remove(0);
        let frames: Vec<u32> = keys.path().unwrap().keys.iter().map(|key| key.frame).collect();
        assert_eq!(frames, [0, STEP_FRAMES, 2 * STEP_FRAMES]);
        keys.0[1].frame = 500;
        assert!(keys.path().unwrap_err().contains("ascend"));
        (0..2 * KEY_LIMIT).for_each(|_| keys.add(&camera(1.0)));
        assert_eq!(keys.0.len(), KEY_LIMIT);
    }
}
