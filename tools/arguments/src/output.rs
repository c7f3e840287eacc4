//! Outputs of commands: pictures, statistics and folders of reports, by the rules of [`supervol_files`].
//!
//! An output is opened before anything is computed. So a command fails early if its output cannot be written.

use std::io::{self, Cursor, IsTerminal, Write};
use std::path::{Path, PathBuf};

use clap::Args;
use supervol_files::kind::FileKind;
use supervol_files::unfinished::UnfinishedFolder;
use supervol_files::{OutputError, OutputFile, check_distinct};
use supervol_preprocess::{BuildError, Existing};
use supervol_scene::image::stored::record_path;
use supervol_scene::image::{EncodeError, Image, ImageFormat, RecordText};

use crate::failure::{Failure, with_output};
use crate::flags;
use crate::terminal;

/// Option `--force` of commands that overwrite files of their own kind without it.
#[derive(Debug, Clone, Copy, Args)]
pub struct Force {
    /// Overwrite existing files of any kind
    ///
    /// By default, only a file of the same kind is overwritten: a picture by a picture, statistics by statistics, a
    /// report by a report.
    #[arg(long)]
    force: bool,
}

impl Force {
    /// True if `--force` was given.
    pub fn is_given(self) -> bool {
        self.force
    }

    /// Rule for an existing output. `kind` is the rule without `--force`.
    pub fn or(self, kind: Existing) -> Existing {
        if self.force { Existing::Replace } else { kind }
    }
}

/// Name of standard output on the command line.
const STANDARD_OUTPUT: &str = "-";

/// Tests if the picture goes to standard output.
pub fn is_standard(output: &Path) -> bool {
    output == Path::new(STANDARD_OUTPUT)
}

/// Stream for remarks: standard error if the picture goes to standard output.
pub fn remarks_on(output: &Path) -> Box<dyn Write> {
    if is_standard(output) && !terminal::is_quiet() { Box::new(terminal::stderr()) } else { terminal::remarks() }
}

/// Picture file to be written.
#[derive(Debug)]
pub struct PictureFile {
    /// `None` is standard output.
    file: Option<OutputFile>,
    format: ImageFormat,
    path: PathBuf,
}

impl PictureFile {
    /// Opens the output of a picture. The file name determines the format.
    ///
    /// # Errors
    /// If standard output is a terminal, if the name has no known ending, or if the file may not be written or cannot
    /// be.
    pub fn begin(path: &Path, force: Force) -> Result<Self, Failure> {
        if is_standard(path) {
            if io::stdout().is_terminal() {
                let message =
                    "-o -: expected a pipe or a file on standard output, found a terminal; write to a file instead";
                return Err(Failure::Command(message.into()));
            }
            return Ok(Self { file: None, format: ImageFormat::Png, path: path.into() });
        }
        let format = ImageFormat::from_path(path).map_err(Failure::command)?;
        let file = OutputFile::begin(path, force.or(Existing::ReplacePicture))?;
        Ok(Self { file: Some(file), format, path: path.into() })
    }

    /// Writes a map of numbers for each pixel: as floats if the format holds them, else in colours.
    ///
    /// # Errors
    /// If the file cannot be written, or the format cannot hold the map.
    pub fn write_map(self, map: Image, in_colors: impl FnOnce(Image) -> Image) -> Result<(), Failure> {
        let map = if self.format == ImageFormat::Png { in_colors(map) } else { map };
        self.write(&map, [0.0; 3])
    }

    /// Format of the file.
    pub fn format(&self) -> ImageFormat {
        self.format
    }

    /// Writes the picture.
    ///
    /// # Errors
    /// If the file cannot be written, or the format cannot hold the picture.
    pub fn write(self, image: &Image, background: [f64; 3]) -> Result<(), Failure> {
        self.write_with(image, background, None)
    }

    /// Writes the picture with a record, if its format holds one.
    ///
    /// # Errors
    /// As [`Self::write`].
    pub fn write_with(
        self,
        image: &Image,
        background: [f64; 3],
        record: Option<RecordText<'_>>,
    ) -> Result<(), Failure> {
        let encoded = match &self.file {
            Some(file) if !file.is_stream() => image.encode_with(self.format, background, record, &mut file.file()),
            stream => {
                // OpenEXR files are not written sequentially.
                let mut bytes = Cursor::new(Vec::new());
                image.encode_with(self.format, background, record, &mut bytes).and_then(|()| {
                    match stream {
                        Some(file) => file.file().write_all(bytes.get_ref())?,
                        None => io::stdout().lock().write_all(bytes.get_ref())?,
                    }
                    Ok(())
                })
            }
        };
        encoded.map_err(|error| match error {
            EncodeError::Io(source) if self.file.is_none() => with_output(source),
            EncodeError::Io(source) => BuildError::write(&self.path, source).into(),
            EncodeError::Encode(message) => Failure::Command(format!("{}: {message}", self.path.display())),
        })?;
        Ok(self.file.map_or(Ok(()), |file| file.publish().map(drop))?)
    }
}

/// Text file to be written.
#[derive(Debug)]
pub struct TextFile {
    file: OutputFile,
    path: PathBuf,
}

impl TextFile {
    /// Opens the output of statistics.
    ///
    /// # Errors
    /// If a file exists there that is no statistics and `force` does not allow it, or if the folder cannot be written
    /// to.
    pub fn begin_statistics(path: &Path, force: Force) -> Result<Self, Failure> {
        Self::begin(path, force.or(Existing::ReplaceStatistics))
    }

    /// Opens the output of a text.
    ///
    /// # Errors
    /// If a file exists there that `existing` protects, or if the folder cannot be written to.
    pub fn begin(path: &Path, existing: Existing) -> Result<Self, Failure> {
        Ok(Self { file: OutputFile::begin(path, existing)?, path: path.into() })
    }

    /// Writes the text.
    ///
    /// # Errors
    /// If the file cannot be written, or appeared in the meantime.
    pub fn write(self, text: &str) -> Result<(), Failure> {
        let written = self.file.file().write_all(text.as_bytes());
        written.map_err(|source| BuildError::write(&self.path, source))?;
        Ok(self.file.publish().map(drop)?)
    }
}

/// Names of the outputs of `render` beside the picture.
#[derive(Debug, Clone, Copy, Default)]
pub struct Beside<'a> {
    /// Error map.
    pub error_map: Option<&'a Path>,
    /// Work map.
    pub work_map: Option<&'a Path>,
    /// Statistics.
    pub statistics: Option<&'a Path>,
    /// Fidelity.
    pub fidelity: Option<&'a Path>,
    /// Whether the record is wanted, for which a NumPy picture needs a file of its own.
    pub record: Recording,
}

/// Amount of a picture's record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Recording {
    /// In formats that hold text, without more work.
    #[default]
    Usual,
    /// In every format, with the stated error.
    Full,
}

/// Outputs of `render`.
#[derive(Debug)]
pub struct RenderOutputs {
    /// The picture.
    pub picture: PictureFile,
    /// Error map and work map, if requested.
    pub maps: [Option<PictureFile>; 2],
    /// Statistics, if requested.
    pub statistics: Option<TextFile>,
    /// Fidelity, if requested.
    pub fidelity: Option<TextFile>,
    /// File for the record, if it is requested and the picture does not hold it.
    pub record: Option<TextFile>,
}

impl RenderOutputs {
    /// Opens all outputs. No output may be an input or another output.
    ///
    /// # Errors
    /// If two of these files are the same, or if one of the outputs cannot be opened.
    pub fn begin(picture: &Path, beside: Beside<'_>, inputs: &[&Path], force: Force) -> Result<Self, Failure> {
        let Beside { error_map, work_map, statistics, fidelity, record } = beside;
        let is_numpy = || ImageFormat::from_path(picture).is_ok_and(|format| format == ImageFormat::Npy);
        let record = (record == Recording::Full && is_numpy()).then(|| record_path(picture));
        let mut taken = inputs.to_vec();
        let paths = [Some(picture), error_map, work_map, statistics, fidelity, record.as_deref()];
        for path in paths.into_iter().flatten() {
            check_distinct(path, taken.iter().copied())?;
            taken.push(path);
        }
        let text =
            |path: Option<&Path>, existing| path.map(|path| TextFile::begin(path, force.or(existing))).transpose();
        let map = |path: Option<&Path>| path.map(|path| PictureFile::begin(path, force)).transpose();
        let statistics = text(statistics, Existing::ReplaceStatistics)?;
        let fidelity = text(fidelity, Existing::ReplaceFidelity)?;
        let record = text(record.as_deref(), Existing::ReplaceRecord)?;
        let maps = [map(error_map)?, map(work_map)?];
        Ok(Self { picture: PictureFile::begin(picture, force)?, maps, statistics, fidelity, record })
    }
}

/// Folder for the reports of one command. Each report only overwrites a report of its own kind.
#[derive(Debug)]
pub struct ReportFolder<'a> {
    /// Path of the folder.
    pub folder: &'a Path,
    force: Force,
}

impl<'a> ReportFolder<'a> {
    /// Creates the folder if it does not exist.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn begin(folder: &'a Path, force: Force) -> Result<Self, Failure> {
        std::fs::create_dir_all(folder)
            .map_err(|e| Failure::Machine(format!("cannot write {}: {e}", folder.display())))?;
        Ok(Self { folder, force })
    }

    /// Writes reports under these names. If one would overwrite a file of another kind, all go into a new folder
    /// inside this one. So the results of a long measurement are not lost.
    ///
    /// # Errors
    /// If a report would overwrite an input or a file of another kind: the error names the new folder. If a file cannot
    /// be written.
    pub fn write(&self, reports: &[(String, Vec<u8>)], inputs: &[&Path]) -> Result<(), Failure> {
        let check = |(name, bytes): &(String, Vec<u8>)| {
            let path = self.folder.join(name);
            check_distinct(&path, inputs.iter().copied())?;
            self.check(&path, bytes)
        };
        let Err(refused) = reports.iter().try_for_each(check) else { return write_into(self.folder, reports) };
        let aside = tempfile::Builder::new().prefix("reports-").tempdir_in(self.folder);
        let aside = aside.map_err(|source| BuildError::write(self.folder, source))?.keep();
        write_into(&aside, reports)?;
        Err(Failure::Command(format!("{}. The reports are in {}", flags::message(&refused), aside.display())))
    }

    /// Lets `write` fill a temporary folder, and writes the files of that folder as reports.
    ///
    /// # Errors
    /// If `write` fails, if the folder cannot be written or read, or if [`Self::write`] fails.
    pub fn write_with<E: Into<Failure>>(
        &self,
        inputs: &[&Path],
        write: impl FnOnce(&Path) -> Result<(), E>,
    ) -> Result<(), Failure> {
        let cannot = |e| Failure::Machine(format!("cannot write {}: {e}", self.folder.display()));
        let made = UnfinishedFolder::create_in(self.folder).map_err(cannot)?;
        write(made.path()).map_err(Into::into)?;
        let read = |entry: std::io::Result<std::fs::DirEntry>| {
            let entry = entry?;
            Ok((entry.file_name().to_string_lossy().into_owned(), std::fs::read(entry.path())?))
        };
        let reports: Result<Vec<_>, _> = std::fs::read_dir(made.path()).map_err(cannot)?.map(read).collect();
        self.write(&reports.map_err(cannot)?, inputs)
    }

    fn check(&self, path: &Path, bytes: &[u8]) -> Result<(), BuildError> {
        if self.force.or(Existing::Keep) == Existing::Replace || !path.is_file() {
            return Ok(());
        }
        let found = FileKind::of(path).map_err(|source| BuildError::write(path, source))?;
        let expected = FileKind::of_bytes(bytes);
        if found == expected || found == FileKind::Empty {
            return Ok(());
        }
        Err(OutputError::OtherKind { path: path.into(), expected, found }.into())
    }
}

fn write_into(folder: &Path, reports: &[(String, Vec<u8>)]) -> Result<(), Failure> {
    for (name, bytes) in reports {
        let path = folder.join(name);
        let file = OutputFile::begin(&path, Existing::Replace)?;
        let written = file.file().write_all(bytes);
        written.map_err(|source| BuildError::write(&path, source))?;
        file.publish()?;
    }
    Ok(())
}
