//! Opens a file or a folder with the reader that recognizes it, by its first bytes and its name.
//!
//! The rules are rows of the table [`FORMATS`]. The first row that recognizes the file opens it.

use std::path::{Path, PathBuf};

use crate::formats::format::{Certainty, Folder, FolderFiles, Format};
use crate::formats::unsupported::{refusal_of_file, refusal_of_folder};
use crate::formats::{FORMATS, titles};
use crate::grid::absent::AbsentSource;
use crate::grid::nulls::{self, Nulls};
use crate::grid::stored::StoredSource;
use crate::input::file::SourceFile;
use crate::input::folder::{FolderDepth, Listing};
use crate::input::start::FileStart;
use crate::input::values::Values;
use crate::{Message, ReadOption, SourceError, VolumeSource};

pub use crate::formats::format::Found;
pub use crate::formats::options::OpenOptions;

/// Opens a volume file of any format in [`FORMATS`], or a folder that is a volume.
/// `FILE:/NAME` opens one array of a file that holds several.
///
/// # Errors
/// If no reader knows the file, or the reader refuses it.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    let (path, array) = split_array(path);
    let mut options = options.clone();
    options.selection.array = array.or(options.selection.array);
    let source = if path.is_dir() {
        open_folder(&path, &options)?
    } else {
        // This comes first: opening a FIFO would wait for its writer.
        SourceFile::of(&path)?;
        open_file(&path, &options)?
    };
    let source = if options.values == Values::Stored { StoredSource::new(source) } else { source };
    // Numbers that are not finite are absent anyway.
    Ok(match options.nodata.filter(|value| options.raw.is_none() && value.is_finite()) {
        Some(nodata) => Box::new(AbsentSource::new(source, nodata)?),
        None if options.nulls == Nulls::Hidden && options.values == Values::Explained => nulls::hide(source)?,
        None => source,
    })
}

/// Splits `FILE:/NAME` into the file and the name of an array in it.
#[must_use]
pub fn split_array(path: &Path) -> (PathBuf, Option<String>) {
    let whole = || (path.to_path_buf(), None);
    if path.exists() {
        return whole();
    }
    let Some((file, array)) = path.to_str().and_then(|text| text.split_once(":/")) else { return whole() };
    (file.into(), Some(array.into()))
}

/// Classifies a file by its first bytes and its name only, so that a damaged volume counts as a volume.
///
/// # Errors
/// If the file cannot be read.
pub fn look_at(path: &Path) -> Result<Found, SourceError> {
    let start = FileStart::of(path)?;
    let Some(format) = format_of(&start, &OpenOptions::default()) else { return Ok(Found::Other) };
    let is_refused = format.certainty == Certainty::Likely && refusal_of_file(&start).is_some();
    Ok(if is_refused { Found::Other } else { (format.found)(&start) })
}

/// Whether a folder is a Zarr or N5 by its structure.
#[must_use]
pub fn is_chunked(folder: &Path) -> bool {
    FORMATS.iter().any(|format| format.is_structured(folder))
}

/// The first row that recognizes a file.
fn format_of(start: &FileStart<'_>, options: &OpenOptions) -> Option<&'static Format> {
    FORMATS.iter().find(|format| (format.sniff)(start, options))
}

fn open_file(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    let start = FileStart::of(path)?;
    let format = format_of(&start, options);
    options.selection.refuse_beyond(path, format.map_or(&[], |format| format.choices))?;
    if format.is_none_or(|format| format.certainty == Certainty::Likely)
        && let Some(refusal) = refusal_of_file(&start)
    {
        return Err(refusal);
    }
    let Some(format) = format else {
        options.selection.refuse_all(path)?;
        return Err(unknown_file(path));
    };
    (format.open)(path, options)
}

fn open_folder(path: &Path, options: &OpenOptions) -> Result<Box<dyn VolumeSource>, SourceError> {
    if let Some(format) = FORMATS.iter().find(|format| format.is_structured(path)) {
        return (format.open)(path, options);
    }
    options.selection.level_of(path, 1)?;
    if let Some(refusal) = refusal_of_folder(path) {
        return Err(refusal);
    }
    let files = FolderFiles(Listing::of(path, FolderDepth::WithSubfolders, options.outside)?.files);
    for format in FORMATS {
        if format.takes_folder(&files)? {
            options.selection.refuse_beyond(path, format.choices)?;
            return (format.open)(path, options);
        }
    }
    Err(unknown_folder(path, files.0.len()))
}

/// Error for a file that no row recognizes.
fn unknown_file(path: &Path) -> SourceError {
    let titles: Vec<&str> = titles().collect();
    SourceError::unsupported(
        path,
        "neither its first bytes nor its name are those of a format we read",
        Message::from(format!(
            "expected {}, a folder of slices, or a headerless file together with ",
            titles.join(", ")
        ))
        .option(ReadOption::Dims)
        .text(" and ")
        .option(ReadOption::VoxelType),
    )
}

/// Error for a folder that no row recognizes.
fn unknown_folder(path: &Path, count: usize) -> SourceError {
    if count == 0 {
        // The wrong folder: nothing in it could be wrong.
        let expected = "expected a file, found a folder without files, of which slices could be read";
        return SourceError::options(format!("{}: {expected}", path.display()));
    }
    let titles: Vec<&str> = FORMATS
        .iter()
        .filter_map(|format| match format.folder {
            Folder::ByFiles { title, .. } => Some(title),
            Folder::Never | Folder::ByStructure(_) => None,
        })
        .collect();
    let (last, others) = titles.split_last().expect("folders of slices are read");
    let what = format!("this is a folder of {count} files that are neither {} nor {last}", others.join(", "));
    SourceError::unsupported(path, what, "expected the slices of one volume, or give a file")
}
