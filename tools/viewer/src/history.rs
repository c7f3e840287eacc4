//! Undo and redo: the scenes after each edit. The camera is not part of the history, so that undoing an edit keeps the
//! present view.

use std::collections::VecDeque;

use supervol_scene::scene::Scene;

/// Most edits that can be undone.
const LIMIT: usize = 200;

/// The history of edits; see the module.
#[derive(Debug, Clone, Default)]
pub struct History {
    past: VecDeque<Scene>,
    now: Scene,
    future: Vec<Scene>,
}

/// The scene without the parts that are not edits: camera and image size.
fn edited(scene: &Scene) -> Scene {
    let mut edited = Scene { camera: None, ..scene.clone() };
    let background = edited.image.background;
    edited.image = Scene::default().image;
    edited.image.background = background;
    edited
}

/// An earlier scene with the present camera and image size.
fn seen_as(edited: &Scene, scene: &Scene) -> Scene {
    let mut out = Scene { camera: scene.camera.clone(), ..edited.clone() };
    (out.image.width, out.image.height) = (scene.image.width, scene.image.height);
    out
}

impl History {
    /// An empty history.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self { now: edited(scene), ..Self::default() }
    }

    /// Records an edit if the scene has changed.
    pub fn commit(&mut self, scene: &Scene) {
        let new = edited(scene);
        if new == self.now {
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
    pub fn undo(&mut self, scene: &Scene) -> Option<Scene> {
        self.commit(scene);
        let before = self.past.pop_back()?;
        self.future.push(std::mem::replace(&mut self.now, before));
        Some(seen_as(&self.now, scene))
    }

    /// Redo: the scene after the edit that was undone last.
    pub fn redo(&mut self, scene: &Scene) -> Option<Scene> {
        self.commit(scene);
        let after = self.future.pop()?;
        self.past.push_back(std::mem::replace(&mut self.now, after));
        Some(seen_as(&self.now, scene))
    }
}

#[cfg(test)]
mod tests {
    use supervol_scene::scene::Mode;

    use super::*;

    #[test]
    fn edits_are_undone_one_by_one_and_the_camera_stays() {
        let mut scene = Scene::default();
        let mut history = History::new(&scene);
        for samples in [1, 4, 9] {
            scene.samples_per_pixel = Some(samples);
            history.commit(&scene);
            history.commit(&scene);
        }
        scene.image.width = 77;
        assert_eq!(history.can(), [true, false]);
        let mut back = Vec::new();
        while let Some(before) = history.undo(&scene) {
            assert_eq!(before.image.width, 77, "the window's size is no edit");
            back.push(before.samples_per_pixel);
            scene = before;
        }
        assert_eq!(back, [Some(4), Some(1), None]);
        scene = history.redo(&scene).expect("an edit was undone");
        assert_eq!(scene.samples_per_pixel, Some(1));
        scene.mode = Some(Mode::Mip);
        history.commit(&scene);
        assert_eq!(history.can(), [true, false], "a new edit forgets what was undone");
    }

    #[test]
    fn the_past_is_bounded() {
        let mut scene = Scene::default();
        let mut history = History::new(&scene);
        for i in 0..3 * LIMIT {
            scene.image.background = [i as f64 / 1000.0; 3];
            history.commit(&scene);
        }
        assert_eq!(history.past.len(), LIMIT);
    }
}
