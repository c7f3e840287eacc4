//! `supervol render --turntable` and `--path`: writes a folder of pictures, one for each camera of an animation
//! ([`frames`]).
//!
//! [`frames`]: supervol_decorations::frames

use std::path::Path;
use std::time::Instant;

use serde_json::Value;
use supervol::{Options, Renderer};
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::output::{Force, PictureFile};
use supervol_arguments::progress::Reporter;
use supervol_decorations::frames::{Frames, FramesError, Others};
use supervol_files::check_distinct;
use supervol_format::readable::counted;
use supervol_scene::image::ImageFormat;
use supervol_scene::scene::CameraSpec;

use crate::failed_bricks::{FailedBricks, check_any_read};
use crate::picture::with_picture;
use crate::written::{Finished, Subject};

/// Pictures of an animation.
pub struct Sequence<'a> {
    /// Subject of the pictures, with the camera of the first one.
    pub subject: Subject<'a>,
    /// Camera of each picture.
    pub cameras: &'a [CameraSpec],
    /// The requested motion, as JSON.
    pub motion: &'a Value,
    /// Folder of the pictures; created if it does not exist.
    pub folder: &'a Path,
    /// File format of the pictures.
    pub format: ImageFormat,
    /// Input files, which must not be overwritten.
    pub inputs: &'a [&'a Path],
    /// Whether other pictures are overwritten.
    pub force: Force,
    /// Whether unreadable bricks may be replaced by their parents.
    pub failed_bricks: FailedBricks,
}

impl Sequence<'_> {
    /// Draws the missing pictures.
    pub fn run(&self, options: &Options) -> Result<(), Failure> {
        let others = if self.force.is_given() { Others::Replace } else { Others::Keep("give --force") };
        let missing = self.frames().begin(options, others).map_err(with_frames)?;
        if missing.len() < self.cameras.len() {
            let there = counted((self.cameras.len() - missing.len()) as u64, "picture");
            supervol_arguments::progress::announce(&format!("{}: {there} exist already", self.folder.display()));
        }
        let start = Instant::now();
        let mut renderer = self.subject.volume.renderer(options.clone()).map_err(with_picture)?;
        let bar = Reporter::over_pictures();
        bar.set_length(missing.len() as u64);
        let result = missing.iter().try_for_each(|&frame| self.draw(frame, &mut renderer).map(|()| bar.inc(1)));
        bar.finish_and_clear();
        result?;
        self.print(missing.len(), start).map_err(with_output)
    }

    fn frames(&self) -> Frames<'_> {
        let Subject { volume, scene, decorate } = self.subject;
        let Self { cameras, motion, folder, format, inputs, .. } = *self;
        let container = volume.container();
        Frames { container, scene, decorate, cameras, motion, folder, format, inputs }
    }

    fn draw(&self, frame: usize, renderer: &mut Renderer) -> Result<(), Failure> {
        let path = self.frames().path(frame);
        check_distinct(&path, self.inputs.iter().copied())?;
        let file = PictureFile::begin(&path, self.force)?;
        let scene = self.frames().scene(frame);
        renderer.set_scene(&scene).map_err(with_picture)?;
        renderer.advance(None).map_err(with_picture)?;
        let picture = renderer.picture().expect("nobody cancels: without a deadline there is a whole picture");
        check_any_read(picture.stats())?;
        let failed = picture.failed_bricks();
        if failed > 0 && self.failed_bricks == FailedBricks::Refused {
            return Err(Failure::Data(format!(
                "{} is not written: {} could not be read; --allow-failed draws their coarser parents instead",
                path.display(),
                counted(failed, "brick")
            )));
        }
        Finished { picture: &picture, decorate: self.subject.decorate }.write(file, None)
    }

    fn print(&self, drawn: usize, start: Instant) -> std::io::Result<()> {
        let folder = self.folder.display();
        let seconds = start.elapsed().as_secs_f64();
        writeln!(
            supervol_arguments::terminal::remarks(),
            "{folder}: {}, {drawn} of them drawn in {seconds:.1} s{}",
            counted(self.cameras.len() as u64, "picture"),
            self.frames().advice()
        )
    }
}

/// Failure of preparing the folder.
fn with_frames(error: FramesError) -> Failure {
    match error {
        FramesError::Output(error) => error.into(),
        FramesError::SomethingElse { .. } => Failure::Command(error.to_string()),
        FramesError::Folder { .. } | FramesError::Replace { .. } => Failure::Machine(error.to_string()),
    }
}
