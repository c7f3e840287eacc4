//! A folder with the pictures of an animation, one for each camera: what it holds, and which pictures are missing.
//!
//! The folder's [`PLAN`] says what its pictures show. Who asks for the same again goes on with what is missing; something else is
//! refused, unless whoever asks wants the pictures replaced. Pictures appear under their names when they are whole, so that what is
//! there is done.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use supervol_files::{Existing, OutputError, OutputFile, check_distinct};
use supervol_format::Container;
use supervol_runtime::render::options::RenderOptions;
use supervol_scene::image::ImageFormat;
use supervol_scene::scene::{CameraSpec, Scene};

/// Name of the file that says what the pictures of a folder show.
pub const PLAN: &str = "sequence.json";
/// Most bytes of a plan: of a path of as many key frames as there may be frames.
const PLAN_LIMIT_BYTES: u64 = 64 << 20;

/// Why no picture can go to a folder.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say it")]
pub enum FramesError {
    #[error("cannot write {path}: {source}")]
    Folder { path: String, source: std::io::Error },
    #[error("cannot replace {path}: {source}")]
    Replace { path: String, source: std::io::Error },
    #[error("{folder} holds pictures of something else, as its {PLAN} says. Choose another folder, or {advice}")]
    SomethingElse { folder: String, advice: &'static str },
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// Pictures by some cameras.
#[derive(Debug, Clone, Copy)]
pub struct Frames<'a> {
    /// Of what.
    pub container: &'a Container,
    /// What they show; its camera is that of the first.
    pub scene: &'a Scene,
    /// Whether they are decorated.
    pub decorate: bool,
    /// One for each picture.
    pub cameras: &'a [CameraSpec],
    /// What was asked for of them.
    pub motion: &'a Value,
    /// Where they go; made where it is not there.
    pub folder: &'a Path,
    /// What each of them is written as. Pictures of the same in several formats go to one folder.
    pub format: ImageFormat,
    /// What is read, and not written to.
    pub inputs: &'a [&'a Path],
}

/// What becomes of pictures of something else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Others {
    /// They are kept, and nothing is written; how somebody says otherwise.
    Keep(&'static str),
    /// They are replaced.
    Replace,
}

impl Frames<'_> {
    /// Begins the folder, or goes on with it: the numbers of the pictures that are missing.
    ///
    /// # Errors
    /// If the folder holds something else or cannot be written to, or something that is read would be.
    pub fn begin(&self, options: &RenderOptions, others: Others) -> Result<Vec<usize>, FramesError> {
        let failed = |source| FramesError::Folder { path: self.folder.display().to_string(), source };
        std::fs::create_dir_all(self.folder).map_err(failed)?;
        let goes_on = self.begin_plan(options, others)?;
        Ok((0..self.cameras.len()).filter(|frame| !(goes_on && self.path(*frame).exists())).collect())
    }

    /// Whether the folder holds pictures of the same; if not, it says from now on that it will.
    fn begin_plan(&self, options: &RenderOptions, others: Others) -> Result<bool, FramesError> {
        let plan = self.folder.join(PLAN);
        check_distinct(&plan, self.inputs.iter().copied())?;
        let text = self.plan(options);
        let length = std::fs::metadata(&plan).map(|m| m.len());
        let found = match length {
            Ok(bytes) if bytes <= PLAN_LIMIT_BYTES => std::fs::read_to_string(&plan).ok(),
            Ok(_) => Some(String::new()),
            Err(_) => None,
        };
        match others {
            Others::Keep(_) if found.as_ref() == Some(&text) => return Ok(true),
            Others::Keep(advice) if found.is_some() => {
                return Err(FramesError::SomethingElse { folder: self.folder.display().to_string(), advice });
            }
            _ => {}
        }
        // Whatever stops this from here on: no picture of before passes for one of these.
        let of_all_formats = |frame| ImageFormat::ALL.map(|format| self.path_as(frame, format));
        for path in (0..self.cameras.len()).filter(|_| found.is_some()).flat_map(of_all_formats) {
            check_distinct(&path, self.inputs.iter().copied())?;
            match std::fs::remove_file(&path) {
                Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                    return Err(FramesError::Replace { path: path.display().to_string(), source });
                }
                _ => {}
            }
        }
        let output = OutputFile::begin(&plan, Existing::Replace)?;
        let written = output.file().write_all(text.as_bytes());
        written.map_err(|source| OutputError::write(&plan, source))?;
        output.publish()?;
        Ok(false)
    }

    /// What decides what the pictures show.
    fn plan(&self, options: &RenderOptions) -> String {
        let manifest = self.container.manifest();
        let bytes = self.container.file_bytes();
        let plan = json!({
            "container": { "bytes": bytes, "source": manifest.source, "values": manifest.value_range },
            "scene": self.scene,
            "decorate": self.decorate,
            "level": format!("{:?}", options.level),
            "max_error": options.max_error,
            "motion": self.motion,
        });
        format!("{plan:#}\n")
    }

    /// Where a picture goes.
    #[must_use]
    pub fn path(&self, frame: usize) -> PathBuf {
        self.path_as(frame, self.format)
    }

    fn path_as(&self, frame: usize, format: ImageFormat) -> PathBuf {
        self.folder.join(format!("frame-{frame:05}.{}", format.ending()))
    }

    /// What to do with all pictures, as the end of a sentence.
    #[must_use]
    pub fn advice(&self) -> String {
        let folder = self.folder.display();
        match self.format {
            ImageFormat::Npy => String::new(),
            format => {
                format!("; a film of them: ffmpeg -framerate 25 -i {folder}/frame-%05d.{} film.mp4", format.ending())
            }
        }
    }

    /// The scene of a picture.
    #[must_use]
    pub fn scene(&self, frame: usize) -> Scene {
        Scene { camera: Some(self.cameras[frame].clone()), ..self.scene.clone() }
    }
}
