//! Writes finished pictures: decorations, records and fidelity.

use std::io::Write;

use supervol::{Picture, Volume};
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::output::{PictureFile, TextFile};
use supervol_arguments::terminal;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::{Image, ImageFormat};
use supervol_scene::scene::{ResolvedScene, Scene};

use crate::look::warnings;

/// Subject of a picture.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The volume.
    pub volume: &'a Volume,
    /// The scene.
    pub scene: &'a Scene,
    /// Whether box, orientation, scale, colour legend and name are drawn beside the volume.
    pub decorate: bool,
}

/// Files of one picture.
pub struct PictureOutputs {
    /// The picture.
    pub picture: PictureFile,
    /// Error map and work map.
    pub maps: [Option<PictureFile>; 2],
    /// Fidelity.
    pub fidelity: Option<TextFile>,
    /// Record, if the picture's format holds none.
    pub record: Option<TextFile>,
}

/// A finished picture.
#[derive(Clone, Copy)]
pub struct Finished<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// As in [`Subject::decorate`].
    pub decorate: bool,
}

impl Finished<'_> {
    /// Writes the picture with its decorations and its record, and warns if it is empty. `record` is the file for the
    /// record if the picture's format holds none.
    pub fn write(&self, output: PictureFile, record: Option<TextFile>) -> Result<(), Failure> {
        let Self { picture, decorate } = *self;
        let (image, resolved, volume) = (picture.image(), picture.resolved(), picture.volume());
        warn_of_nothing(image, resolved, volume.facts())?;
        let mut decorated = None;
        if decorate {
            let drawn_over = decorated.insert(image.clone());
            supervol_decorations::decorate(drawn_over, volume.container(), volume.facts(), resolved, None);
        }
        let shown = decorated.as_ref().unwrap_or(image);
        let format = output.format();
        let of_picture = picture.record();
        let text = of_picture.text_in(format, image, shown);
        output.write_with(shown, resolved.background, Some(&text))?;
        let Some(file) = record else { return Ok(()) };
        file.write(&(text(shown.stored_checksum(format, resolved.background)) + "\n"))
    }

    /// Writes the fidelity of the picture in a file of this format.
    pub fn write_fidelity(&self, format: ImageFormat, file: TextFile) -> Result<(), Failure> {
        let fidelity = self.picture.fidelity_as(format);
        let text = serde_json::to_string_pretty(&fidelity).map_err(|e| Failure::Machine(e.to_string()))?;
        file.write(&(text + "\n"))
    }
}

/// Warns with the reason if the picture is empty.
pub fn warn_of_nothing(image: &Image, resolved: &ResolvedScene, facts: &VolumeFacts) -> Result<(), Failure> {
    let Some(why) = warnings::reason(image, resolved, facts) else { return Ok(()) };
    warn(&format!("the picture shows nothing but its background: {why}"))
}

/// Prints a warning.
pub fn warn(what: &str) -> Result<(), Failure> {
    writeln!(terminal::stderr(), "supervol: warning: {what}").map_err(with_output)
}
