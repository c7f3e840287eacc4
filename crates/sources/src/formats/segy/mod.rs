//! SEG-Y: post-stack 3D seismic volumes, revisions 0, 1 and 2.
//!
//! Grid: x = crossline, y = inline, z = sample, z down. The grid ascends in inline and crossline number; sample k is k
//! sample intervals below the first. Missing traces and traces marked dead are absent: NaN in float volumes, an unused
//! value in integer volumes (`nodata`). A live trace of zeros stays zeros.
//!
//! The path of a file through this folder:
//! 1. `file_header`: `text_header` and `binary_header`, with the byte order (`fields`);
//! 2. `layout`: compares the headers with the size of the file;
//! 3. `sniff`: compares the samples with the declared format;
//! 4. `scan`, `grid`: one pass over the trace headers, then the trace of each grid cell;
//! 5. `diagnose`: reason and advice if the traces form no grid;
//! 6. `survey`, `position_fit`: placement in the world; `nodata`: value of missing voxels;
//! 7. `read`, `samples`: boxes of voxels; `source` ties all of these together.
//!
//! A wrong header is refused with the reason, or overridden by an option. Every assumption is a note
//! ([`SourceInfo::notes`]).
//!
//! Memory while opening: 24 bytes per run of traces (a line in order is one run), three times as many while the list
//! grows. Memory of the open source: none per trace for complete grids, 4 bytes per grid cell for grids with holes or
//! without order. The size of the file and [`SegyOptions::memory_bytes`] bound both.
//!
//! A folder of several files is one survey (`joined`). Of a pre-stack file, one offset is read, or the mean over all
//! offsets (`stack`).
//!
//! Not read: 2D lines without line numbers, traces of varying length, format 4, and the contents of
//! trace header extensions and extended text headers.

mod binary_header;
mod diagnose;
mod fields;
mod file_header;
mod grid;
mod input;
mod joined;
mod layout;
mod nodata;
pub mod options;
mod position_fit;
mod read;
mod samples;
mod scan;
mod sniff;
mod source;
mod stack;
mod survey;
mod text_header;

use std::fs::File;
use std::path::{Path, PathBuf};

use supervol_format::ByteSource;

pub use self::options::{Duplicates, Offsets, SegyOptions};
pub(crate) use self::position_fit::PositionFit;
pub use self::source::SegySource;
pub(crate) use self::survey::{direction, spacing};
pub use self::text_header::{TEXT_BYTES, encode as encode_text};
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::input::file::SourceFile;
use crate::input::folder::{FolderDepth, Listing};
use crate::input::start::{is_named, lower_name};
use crate::{SourceError, SourceInfo, VolumeSource};

/// Name endings of SEG-Y files.
const ENDINGS: &[&str] = &[".sgy", ".segy", ".seg-y", ".seg"];

/// First bytes of SEG-Y text headers: C 1 and C01, in EBCDIC and in ASCII.
const TEXT_HEADERS: [&[u8]; 4] = [b"C 1", b"C01", b"\xc3\x40\xf1", b"\xc3\xf0\xf1"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "segy",
    title: "SEG-Y",
    endings: ENDINGS,
    choices: &[],
    // The text header begins with the letter C: in EBCDIC (0xC3), or in ASCII.
    sniff: |start, _| start.is_named(ENDINGS) || start.begins_with(b"\xc3") || start.begins_with(b"C"),
    certainty: Certainty::Likely,
    folder: Folder::ByFiles { title: "SEG-Y", sniff: |files| Ok(files.0.iter().any(|file| is_named_segy(file))) },
    open: |path, options| {
        options.selection.refuse_all(path)?;
        if !path.is_dir() {
            return open(&[path.into()], None, &options.segy);
        }
        let mut lines = Listing::of(path, FolderDepth::WithSubfolders, options.outside)?.files;
        lines.retain(|file| is_named_segy(file));
        open(&lines, Some(path), &options.segy)
    },
    // Any text may begin with a C.
    found: |start| match start.is_named(ENDINGS) || TEXT_HEADERS.iter().any(|text| start.begins_with(text)) {
        true => Found::Volume,
        false => Found::Other,
    },
};

fn is_named_segy(path: &Path) -> bool {
    is_named(&lower_name(path), ENDINGS)
}

/// Opens a file, or the files of a folder as one survey, in natural order of their names.
///
/// # Errors
/// As [`SegySource::open`]; also if files do not agree.
pub fn open(
    paths: &[PathBuf],
    folder: Option<&Path>,
    options: &SegyOptions,
) -> Result<Box<dyn VolumeSource>, SourceError> {
    options.check()?;
    let [first, ..] = paths else {
        return Err(SourceError::options("SEG-Y: expected at least one file, found none"));
    };
    let files = paths.iter().map(|path| SourceFile::of(path)).collect::<Result<Vec<_>, _>>()?;
    let bytes: Box<dyn ByteSource> = match paths {
        [one] => Box::new(File::open(one).map_err(|e| SourceError::io(one, e))?),
        _ => Box::new(joined::Joined::new(paths, options)?),
    };
    let complete = |info: &mut SourceInfo| {
        if paths.len() > 1 {
            info.notes.push(format!("{} files are read as one survey", paths.len()).into());
        }
        info.memory_bytes += files.len() as u64 * 512;
        info.files = files;
        info.folder = folder.map(Into::into);
    };
    // Messages name the opened file or folder.
    let path = folder.unwrap_or(first);
    if options.offsets == Offsets::Stack || options.duplicates == Duplicates::Mean {
        let mut stack = stack::Stack::from_bytes(bytes, path, options)?;
        complete(&mut stack.info);
        return Ok(Box::new(stack));
    }
    let mut source = SegySource::from_bytes(bytes, path, options)?;
    complete(&mut source.info);
    Ok(Box::new(source))
}
