//! Folder of the pictures of an animation, one per camera: its plan, and the missing pictures.
//!
//! The folder's [`PLAN`] describes its pictures. A request for the same pictures continues with the missing ones. A
//! request for other pictures is refused unless they may be replaced. Pictures appear under their names only when they
//! are complete, so that an existing picture is finished.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use supervol::Options;
use supervol_files::{Existing, OutputError, OutputFile, check_distinct};
use supervol_format::Container;
use supervol_scene::image::ImageFormat;
use supervol_scene::scene::{CameraSpec, Scene};

/// Name of the file that describes the pictures of a folder.
pub const PLAN: &str = "sequence.json";
/// Most bytes of a plan: enough for a path with the greatest number of key frames.
const PLAN_LIMIT_BYTES: u64 = 64 << 20;

/// Reason why no picture can be written to a folder.
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

/// The pictures of an animation.
#[derive(Debug, Clone, Copy)]
pub struct Frames<'a> {
    /// The volume.
    pub container: &'a Container,
    /// The scene; its camera is that of the first picture.
    pub scene: &'a Scene,
    /// Whether the pictures have decorations.
    pub decorate: bool,
    /// One camera per picture.
    pub cameras: &'a [CameraSpec],
    /// The requested motion, as it is written to the plan.
    pub motion: &'a Value,
    /// Folder of the pictures; it is created if needed.
    pub folder: &'a Path,
    /// File format. Pictures of one animation in several formats can share a folder.
    pub format: ImageFormat,
    /// Input files, which must not be overwritten.
    pub inputs: &'a [&'a Path],
}

/// Treatment of existing pictures of another animation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Others {
    /// They are kept and the request is refused; the text says how to replace them.
    Keep(&'static str),
    /// They are replaced.
    Replace,
}

impl Frames<'_> {
    /// Begins or continues the folder. Returns the numbers of the missing pictures.
    ///
    /// # Errors
    /// If the folder holds another animation or is not writable, or if an input file would be overwritten.
    pub fn begin(&self, options: &Options, others: Others) -> Result<Vec<usize>, FramesError> {
        let failed = |source| FramesError::Folder { path: self.folder.display().to_string(), source };
        std::fs::create_dir_all(self.folder).map_err(failed)?;
        let goes_on = self.begin_plan(options, others)?;
        Ok((0..self.cameras.len()).filter(|frame| !(goes_on && self.path(*frame).exists())).collect())
    }

    /// Whether the folder holds pictures of the same animation. If not, removes old pictures and writes the plan.
    fn begin_plan(&self, options: &Options, others: Others) -> Result<bool, FramesError> {
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
        // Old pictures are removed before the new plan is written, so that none is taken for a new one after an
        // interruption.
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

    /// The plan: everything that determines the content of the pictures.
    fn plan(&self, options: &Options) -> String {
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

    /// Path of a picture.
    #[must_use]
    pub fn path(&self, frame: usize) -> PathBuf {
        self.path_as(frame, self.format)
    }

    fn path_as(&self, frame: usize, format: ImageFormat) -> PathBuf {
        self.folder.join(format!("frame-{frame:05}.{}", format.ending()))
    }

    /// Advice on what to do with all pictures, as the end of a sentence.
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

    /// Scene of a picture.
    #[must_use]
    pub fn scene(&self, frame: usize) -> Scene {
        Scene { camera: Some(self.cameras[frame].clone()), ..self.scene.clone() }
    }
}
