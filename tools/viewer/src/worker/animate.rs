//! Animations written to a folder, one picture after the other, by the renderer that also draws for the screen. Same
//! result as `render --turntable` and `render --path`.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Value, json};
use supervol_decorations::frames::{Frames, Others};
use supervol_files::{OutputFile, check_distinct};
use supervol_preprocess::Existing;
use supervol_scene::camera_path;
use supervol_scene::preset::view::upright;
use supervol_scene::scene::{CameraSpec, Scene};

use super::drawing::{DrawingState, options};
use super::messages::{Animation, Busy, Decorations, Message, Motion, Settings};
use super::shared::{Shared, lock};
use super::written::encode;

impl Motion {
    /// The request as it is written to `sequence.json`.
    fn asked(&self) -> Value {
        match self {
            Self::Turntable(frames) => json!({ "turntable": frames }),
            Self::Path(path) => json!({ "path": path }),
        }
    }

    fn cameras(&self, camera: &CameraSpec, facts: &supervol_scene::facts::VolumeFacts) -> Vec<CameraSpec> {
        match self {
            Self::Turntable(frames) => camera_path::turntable(camera, upright(facts), *frames),
            Self::Path(path) => path.cameras(),
        }
    }
}

impl DrawingState {
    /// Draws the missing pictures until all are written or the user cancels.
    pub(super) fn animate(
        &mut self,
        shared: &Arc<Shared>,
        animation: &Animation,
        settings: &Settings,
    ) -> Result<Message, String> {
        let opened = self.opened.clone();
        let camera = animation.scene.camera.as_ref();
        let camera =
            camera.ok_or("cannot animate: the world coordinates of this volume are too coarse for a camera")?;
        let (cameras, motion) = (animation.motion.cameras(camera, opened.facts()), animation.motion.asked());
        let scene = Scene { camera: cameras.first().cloned(), ..animation.scene.clone() };
        let inputs: Vec<&Path> =
            [opened.source.as_path(), opened.path.as_path()].into_iter().chain(scene.files()).collect();
        let frames = Frames {
            container: opened.container(),
            scene: &scene,
            decorate: settings.decorations == Decorations::On,
            cameras: &cameras,
            motion: &motion,
            folder: &animation.folder,
            format: animation.format,
            inputs: &inputs,
        };
        let others = match animation.existing {
            Existing::Replace => Others::Replace,
            _ => Others::Keep("tick `Overwrite other pictures`"),
        };
        let missing = frames.begin(&options(shared, settings), others).map_err(|e| e.to_string())?;
        lock(&shared.requests).export_canceller = Some(self.renderer.canceller());
        let mut drawn = Ok(true);
        for (done, frame) in missing.iter().enumerate() {
            let progress = [cameras.len() - missing.len() + done, cameras.len()];
            shared.send(|messages| messages.busy = Some(Busy::Animating(animation.folder.clone(), progress)));
            drawn = self.draw_frame(shared, (&frames, *frame), settings);
            if !matches!(drawn, Ok(true)) {
                break;
            }
        }
        self.resume(shared, settings);
        let folder = animation.folder.display();
        drawn.map(|is_done| match is_done {
            true => Message::Done(format!(
                "{folder}: {} pictures, {} of them drawn now{}",
                cameras.len(),
                missing.len(),
                frames.advice()
            )),
            false => Message::Done(format!("cancelled; the same animation continues with the pictures in {folder}")),
        })
    }

    /// Draws and writes one picture. Returns false if the user has cancelled.
    fn draw_frame(
        &mut self,
        shared: &Arc<Shared>,
        (frames, frame): (&Frames<'_>, usize),
        settings: &Settings,
    ) -> Result<bool, String> {
        let path = frames.path(frame);
        check_distinct(&path, frames.inputs.iter().copied()).map_err(|e| e.to_string())?;
        let output = OutputFile::begin(&path, Existing::ReplacePicture).map_err(|e| e.to_string())?;
        let Some(picture) = self.finished(shared, &frames.scene(frame), settings)? else { return Ok(false) };
        let failed = picture.failed_bricks();
        if failed > 0 {
            return Err(format!("{} is not written: {failed} bricks could not be read", path.display()));
        }
        encode(&picture, settings.decorations, frames.format, &mut output.file()).map_err(|e| e.to_string())?;
        output.publish().map_err(|e| e.to_string())?;
        Ok(true)
    }
}
