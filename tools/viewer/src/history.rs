//! Undo and redo: the scenes after each edit, with their cameras. Motions of the camera in quick succession (the wheel,
//! keys) are one edit; a drag is one because it is recorded at its end.

use std::collections::VecDeque;

use supervol_scene::scene::Scene;

/// Most edits that can be undone.
const LIMIT: usize = 200;

/// Longest pause, in seconds, between motions of the camera that are one edit.
const PAUSE: f64 = 0.7;

/// The history of edits; see the module.
#[derive(Debug, Clone, Default)]
pub struct History {
    /// Time of the last edit if it was a motion of the camera alone, in seconds of the window's clock.
    moved: Option<f64>,
    past: VecDeque<Scene>,
    now: Scene,
    future: Vec<Scene>,
}

/// The scene without the part that is no edit: the image size.
fn edited(scene: &Scene) -> Scene {
    let mut edited = scene.clone();
    let background = edited.image.background;
    edited.image = Scene::default().image;
    edited.image.background = background;
    edited
}

/// An earlier scene with the present image size.
fn seen_as(edited: &Scene, scene: &Scene) -> Scene {
    let mut out = edited.clone();
    (out.image.width, out.image.height) = (scene.image.width, scene.image.height);
    out
}

impl History {
    /// An empty history.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self { now: edited(scene), ..Self::default() }
    }

    /// Records an edit if the scene has changed. `now` is the time in seconds of the window's clock.
    pub fn commit(&mut self, scene: &Scene, now: f64) {
        let new = edited(scene);
        if new == self.now {
            return;
        }
        let is_motion = Scene { camera: self.now.camera.clone(), ..new.clone() } == self.now;
        let goes_on = is_motion && self.moved.is_some_and(|before| now - before <= PAUSE);
        self.moved = is_motion.then_some(now);
        if goes_on {
            self.now = new;
            self.future.clear();
            return;
        }
        if self.past.len() == LIMIT {
            self.past.pop_front();
        }
        self.past.push_back(std::mem::replace(&mut self.now, new));
        self.future.clear();
    }

    /// Whether undo and redo are possible.
    #[must_use]
    pub fn can(&self) -> [bool; 2] {
        [!self.past.is_empty(), !self.future.is_empty()]
    }

    /// Undo: the scene before the last edit.
    pub fn undo(&mut self, scene: &Scene, now: f64) -> Option<Scene> {
        self.commit(scene, now);
        self.moved = None;
        let before = self.past.pop_back()?;
        self.future.push(std::mem::replace(&mut self.now, before));
        Some(seen_as(&self.now, scene))
    }

    /// Redo: the scene after the edit that was undone last.
    pub fn redo(&mut self, scene: &Scene, now: f64) -> Option<Scene> {
        self.commit(scene, now);
        self.moved = None;
        let after = self.future.pop()?;
        self.past.push_back(std::mem::replace(&mut self.now, after));
        Some(seen_as(&self.now, scene))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use supervol_scene::scene::{CameraSpec, Mode};

    use super::*;

    /// A camera 5 units in front of the origin, and x beside it.
    pub(crate) fn camera(x: f64) -> CameraSpec {
        CameraSpec { eye: [x, -5.0, 0.0], target: [0.0; 3], up: [0.0, 0.0, 1.0], fov_y: Some(30.0), height: None }
    }

    #[test]
    fn edits_are_undone_one_by_one() {
        let mut scene = Scene::default();
        let mut history = History::new(&scene);
        for samples in [1, 4, 9] {
            scene.samples_per_pixel = Some(samples);
            history.commit(&scene, 0.0);
            history.commit(&scene, 0.0);
        }
        scene.image.width = 77;
        assert_eq!(history.can(), [true, false]);
        let mut back = Vec::new();
        while let Some(before) = history.undo(&scene, 0.0) {
            assert_eq!(before.image.width, 77, "the window's size is no edit");
            back.push(before.samples_per_pixel);
            scene = before;
        }
        assert_eq!(back, [Some(4), Some(1), None]);
        scene = history.redo(&scene, 0.0).expect("an edit was undone");
        assert_eq!(scene.samples_per_pixel, Some(1));
        scene.mode = Some(Mode::Mip);
        history.commit(&scene, 0.0);
        assert_eq!(history.can(), [true, false], "a new edit forgets what was undone");
    }

    #[test]
    fn motions_of_the_camera_are_undone_and_quick_ones_together() {
        let mut scene = Scene { camera: Some(camera(0.0)), ..Scene::default() };
        let mut history = History::new(&scene);
        // Three notches of the wheel, a pause, a drag; then an edit and another motion.
        for (x, now) in [(1.0, 10.0), (2.0, 10.3), (3.0, 10.6), (4.0, 20.0)] {
            scene.camera = Some(camera(x));
            history.commit(&scene, now);
        }
        scene.samples_per_pixel = Some(4);
        history.commit(&scene, 20.1);
        scene.camera = Some(camera(5.0));
        history.commit(&scene, 20.2);
        let mut back = Vec::new();
        while let Some(before) = history.undo(&scene, 30.0) {
            back.push((before.camera.clone().map(|camera| camera.eye[0]), before.samples_per_pixel));
            scene = before;
        }
        assert_eq!(back, [(Some(4.0), Some(4)), (Some(4.0), None), (Some(3.0), None), (Some(0.0), None)]);
        assert_eq!(history.redo(&scene, 31.0).and_then(|scene| scene.camera), Some(camera(3.0)));
    }

    #[test]
    fn the_past_is_bounded() {
        let mut scene = Scene::default();
        let mut history = History::new(&scene);
        for i in 0..3 * LIMIT {
            scene.image.background = [i as f64 / 1000.0; 3];
            history.commit(&scene, 0.0);
        }
        assert_eq!(history.past.len(), LIMIT);
    }
}
