//! `supervol render --turntable` and `--path`: a folder of pictures, one for each camera of an animation.
//!
//! The folder's [`PLAN`] says what its pictures show. The same command goes on with what is missing; another one is refused
//! unless `--force` is given. Pictures appear under their names when they are whole, so that what is there is done.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};
use supervol_format::readable::counted;
use supervol_preprocess::Existing;
use supervol_preprocess::output::check_distinct;
use supervol_runtime::frame::RenderOptions;
use supervol_runtime::renderer::Renderer;
use supervol_runtime::scene::{CameraSpec, Scene};
use supervol_runtime::volume::Volume;

use crate::failure::{Failure, with_output};
use crate::output::{Force, PictureFile, TextFile};
use crate::progress::Reporter;
use crate::render::{Subject, check_any_read, with_render, write_picture};

/// Name of the file that says what the pictures of a folder show.
const PLAN: &str = "sequence.json";
/// Most bytes of a plan: of a path of as many key frames as there may be frames.
const PLAN_LIMIT_BYTES: u64 = 64 << 20;

/// Pictures by some cameras.
pub struct Sequence<'a> {
    /// What they show; its camera is that of the first.
    pub subject: Subject<'a>,
    /// One for each picture.
    pub cameras: &'a [CameraSpec],
    /// What was asked for of them.
    pub motion: &'a Value,
    /// Where they go; made where it is not there.
    pub folder: &'a Path,
    /// What is read, and not written to.
    pub inputs: &'a [&'a Path],
    /// Whether pictures of something else are replaced.
    pub force: Force,
    /// Whether bricks that cannot be read may be drawn from coarser ones.
    pub allow_failed: bool,
}

impl Sequence<'_> {
    /// Makes the pictures that are not there yet.
    pub fn run(&self, options: &RenderOptions) -> Result<(), Failure> {
        std::fs::create_dir_all(self.folder)
            .map_err(|e| Failure::Machine(format!("cannot write {}: {e}", self.folder.display())))?;
        let goes_on = self.begin(options)?;
        let is_missing = |frame: &usize| !(goes_on && self.path(*frame).exists());
        let missing: Vec<usize> = (0..self.cameras.len()).filter(is_missing).collect();
        if missing.len() < self.cameras.len() {
            let there = counted((self.cameras.len() - missing.len()) as u64, "picture");
            crate::progress::announce(&format!("{}: {there} are there already", self.folder.display()));
        }
        let start = Instant::now();
        let volume = Volume::of(Arc::clone(self.subject.container));
        let mut renderer = Renderer::new(volume, options.clone()).map_err(with_render)?;
        let bar = Reporter::over_pictures();
        bar.set_length(missing.len() as u64);
        let result = missing.iter().try_for_each(|&frame| self.draw(frame, &mut renderer).map(|()| bar.inc(1)));
        bar.finish_and_clear();
        result?;
        self.print(missing.len(), start).map_err(with_output)
    }

    /// Whether the folder holds pictures of the same; if not, it says from now on that it will.
    fn begin(&self, options: &RenderOptions) -> Result<bool, Failure> {
        let plan = self.folder.join(PLAN);
        check_distinct(&plan, self.inputs.iter().copied())?;
        let text = self.plan(options)?;
        let length = std::fs::metadata(&plan).map(|m| m.len());
        let found = match length {
            Ok(bytes) if bytes <= PLAN_LIMIT_BYTES => std::fs::read_to_string(&plan).ok(),
            Ok(_) => Some(String::new()),
            Err(_) => None,
        };
        let is_same = found.as_ref() == Some(&text);
        if is_same && !self.force.is_given() {
            return Ok(true);
        }
        if found.is_some() && !self.force.is_given() {
            return Err(Failure::Command(format!(
                "{} holds pictures of something else, as its {PLAN} says. Choose another folder, or give --force",
                self.folder.display()
            )));
        }
        // Whatever stops this command from here on: no picture of before passes for one of these.
        for frame in (0..self.cameras.len()).filter(|_| found.is_some()) {
            let path = self.path(frame);
            check_distinct(&path, self.inputs.iter().copied())?;
            match std::fs::remove_file(&path) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    return Err(Failure::Machine(format!("cannot replace {}: {e}", path.display())));
                }
                _ => {}
            }
        }
        TextFile::begin(&plan, Existing::Replace)?.write(&text)?;
        Ok(false)
    }

    /// What decides what the pictures show.
    fn plan(&self, options: &RenderOptions) -> Result<String, Failure> {
        let Subject { container, scene, decorate, .. } = self.subject;
        let manifest = container.manifest();
        let plan = json!({
            "container": { "bytes": container.file_bytes(), "source": manifest.source, "values": manifest.value_range },
            "scene": scene,
            "decorate": decorate,
            "level": format!("{:?}", options.level),
            "max_error": options.max_error,
            "motion": self.motion,
        });
        let text = serde_json::to_string_pretty(&plan).map_err(|e| Failure::Machine(e.to_string()))?;
        Ok(text + "\n")
    }

    /// Where a picture goes.
    fn path(&self, frame: usize) -> PathBuf {
        self.folder.join(format!("frame-{frame:05}.png"))
    }

    fn draw(&self, frame: usize, renderer: &mut Renderer) -> Result<(), Failure> {
        let path = self.path(frame);
        check_distinct(&path, self.inputs.iter().copied())?;
        let file = PictureFile::begin(&path, self.force)?;
        let scene = Scene { camera: Some(self.cameras[frame].clone()), ..self.subject.scene.clone() };
        let resolved = scene.resolve(self.subject.facts).map_err(Failure::command)?;
        renderer.set_scene(resolved.clone());
        renderer.advance(None).map_err(with_render)?;
        let stats = renderer.stats();
        check_any_read(&stats)?;
        let failed = stats.bricks_failed;
        if failed > 0 && !self.allow_failed {
            return Err(Failure::Data(format!(
                "{} is not written: {} could not be read; --allow-failed draws coarser ones instead",
                path.display(),
                counted(failed, "brick")
            )));
        }
        let picture = renderer.picture().expect("nobody cancels: without a deadline there is a whole picture");
        write_picture(&Subject { scene: &scene, ..self.subject }, &resolved, &picture, file)
    }

    fn print(&self, drawn: usize, start: Instant) -> std::io::Result<()> {
        let folder = self.folder.display();
        let seconds = start.elapsed().as_secs_f64();
        writeln!(
            crate::terminal::remarks(),
            "{folder}: {}, {drawn} of them drawn in {seconds:.1} s; a film of them: ffmpeg -framerate 25 -i \
             {folder}/frame-%05d.png film.mp4",
            counted(self.cameras.len() as u64, "picture")
        )
    }
}
