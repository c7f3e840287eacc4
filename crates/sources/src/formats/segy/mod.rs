//! SEG-Y: post-stack 3D seismic volumes, revisions 0, 1 and 2.
//!
//! Grid: x = crossline, y = inline, z = sample, z down; the grid ascends in inline and crossline number, and sample k
//! is k sample intervals below the first. Traces the file does not have, and traces marked dead, are absent: NaN in
//! float volumes, a value no sample has in integer volumes (`nodata`). A live trace of zeros stays zeros.
//!
//! The path of a file through this folder:
//! 1. `text_header`, `binary_header`: what the file says about itself, and in which byte order (`fields`);
//! 2. `layout`: those claims held against the size of the file;
//! 3. `sniff`: samples held against the declared format;
//! 4. `scan`, `grid`: one pass over the trace headers, then the trace of each grid cell;
//! 5. `diagnose`: if there is no grid, why, and what to do;
//! 6. `survey`, `position_fit`: place in the world; `nodata`: how holes are stored;
//! 7. `read`, `samples`: boxes of voxels.
//!
//! A header that lies is refused with the reason, or overridden by an option; nothing is guessed silently, and what
//! was assumed stands in [`SourceInfo::notes`].
//!
//! Memory: 24 bytes per run of traces while opening (a line in order is one run), three times as many while the list
//! grows, then nothing per trace for complete grids, or 4 bytes per grid cell for grids with holes or without order; all of
//! it bounded by the size of the file and by [`SegyOptions::memory_bytes`].
//!
//! Several files are one survey where a folder is given (`joined`). Of a file that has not been stacked, one offset or the mean over
//! all of them is read where that is asked for (`stack`).
//!
//! Not read: 2D lines without line numbers, traces of varying length, format 4, and the contents of
//! trace header extensions and extended text headers.

mod binary_header;
mod diagnose;
mod fields;
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
mod stack;
mod survey;
mod text_header;

use std::fs::File;
use std::path::{Path, PathBuf};

use supervol_format::{ByteSource, Dims, Geometry, VoxelBox};

use self::binary_header::{BinaryHeader, FILE_HEADER_BYTES};
use self::grid::{Grid, GridDefect};
use self::input::Input;
use self::layout::Layout;
use self::nodata::Absent;
pub use self::options::{Offsets, SegyOptions};
use self::read::{Neighbours, Reader};
use self::samples::SampleFormat;
use self::scan::Scan;
pub use self::text_header::{TEXT_BYTES, encode as encode_text};
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::input::file::SourceFile;
use crate::input::folder::Listing;
use crate::input::start::{is_named, lower_name};
use crate::{AccessOrder, Axis, SourceError, SourceInfo, Survey, VolumeSource};

/// How names of SEG-Y files end.
const ENDINGS: &[&str] = &[".sgy", ".segy", ".seg-y", ".seg"];

/// How text headers of SEG-Y begin: C 1 and C01, in EBCDIC and in ASCII.
const TEXT_HEADERS: [&[u8]; 4] = [b"C 1", b"C01", b"\xc3\x40\xf1", b"\xc3\xf0\xf1"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "segy",
    title: "SEG-Y",
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
        let mut lines = Listing::of(path, true, options.outside)?.files;
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

/// A file, or a folder of files that are one survey, in natural order of their names; opened as the options say.
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
        return Err(SourceError::Options("SEG-Y: expected at least one file, found none".into()));
    };
    let files = paths.iter().map(|path| SourceFile::of(path)).collect::<Result<Vec<_>, _>>()?;
    let bytes: Box<dyn ByteSource> = match paths {
        [one] => Box::new(File::open(one).map_err(|e| SourceError::io(one, e))?),
        _ => Box::new(joined::Joined::new(paths, options)?),
    };
    let complete = |info: &mut SourceInfo| {
        if paths.len() > 1 {
            info.notes.push(format!("{} files are read as one survey", paths.len()));
        }
        info.memory_bytes += files.len() as u64 * 512;
        info.files = files;
        info.folder = folder.map(Into::into);
    };
    // Messages name what was asked for.
    let path = folder.unwrap_or(first);
    if options.offsets == Offsets::Stack {
        let mut stack = stack::Stack::from_bytes(bytes, path, options)?;
        complete(&mut stack.info);
        return Ok(Box::new(stack));
    }
    let mut source = SegySource::from_bytes(bytes, path, options)?;
    complete(&mut source.info);
    Ok(Box::new(source))
}

/// A SEG-Y file as a volume.
pub struct SegySource {
    path: PathBuf,
    bytes: Box<dyn ByteSource>,
    layout: Layout,
    grid: Grid,
    absent: Absent,
    neighbours: Neighbours,
    info: SourceInfo,
}

impl SegySource {
    /// Opens a file: reads its headers, and the header of every trace.
    ///
    /// Integer files whose grid has holes are read through once more, for a value that can stand for absence.
    ///
    /// # Errors
    /// If the file cannot be read, is not a post-stack 3D SEG-Y file, or contradicts itself.
    pub fn open(path: &Path, options: &SegyOptions) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
        let mut source = Self::from_bytes(Box::new(file), path, options)?;
        source.info.files = vec![source_file];
        Ok(source)
    }

    /// The same, from any source of bytes; `path` is only used in messages.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn from_bytes(bytes: Box<dyn ByteSource>, path: &Path, options: &SegyOptions) -> Result<Self, SourceError> {
        options.check()?;
        let input = Input { path, bytes: bytes.as_ref() };
        let (text, header) = read_file_header(input, options)?;
        let mut notes = Vec::new();
        let layout = Layout::resolve(input, &header, options, &mut notes)?;
        if options.format.is_none() || layout.format == SampleFormat::FixedPointWithGain {
            sniff::check_format(input, &layout)?;
        }
        let scan = Scan::run(input, &layout, &header, options)?;
        let grid = Grid::build(input, &scan, &layout, options).map_err(|defect| match defect {
            GridDefect::Refused(error) => error,
            GridDefect::NoGrid(why) => diagnose::refuse(input, &layout, options, &why),
        })?;
        let holes = grid.missing + grid.dead > 0;
        let absent = if holes {
            nodata::choose(input, &layout)?
        } else {
            Absent { voxel_type: layout.format.voxel_type(), value: f64::NAN }
        };
        note_traces(&layout, &scan, &grid, (absent, options.samples.is_some()), &mut notes);
        let neighbours =
            if scan.steps_along[1] > scan.steps_along[0] { Neighbours::AlongY } else { Neighbours::AlongX };
        let mut info = describe(input, (&layout, &header), (&scan, &grid), options, text, notes)?;
        info.voxel_type = absent.voxel_type;
        info.memory_bytes = grid.memory_bytes();
        info.reading = options.describe();
        info.nodata = (!absent.value.is_nan()).then_some(absent.value);
        info.access_order = AccessOrder(if neighbours == Neighbours::AlongX { [1, 0, 2] } else { [0, 1, 2] });
        Ok(Self { path: path.into(), bytes, layout, grid, absent, neighbours, info })
    }
}

impl VolumeSource for SegySource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let reader = Reader {
            input: Input { path: &self.path, bytes: self.bytes.as_ref() },
            layout: &self.layout,
            grid: &self.grid,
            absent: self.absent,
            neighbours: self.neighbours,
        };
        reader.read_box(self.info.dims, voxels, out)
    }
}

/// Reads text and binary header.
fn read_file_header(input: Input<'_>, options: &SegyOptions) -> Result<(String, BinaryHeader), SourceError> {
    let file_bytes = input.len()?;
    if file_bytes < FILE_HEADER_BYTES {
        let expected = format!("at least the {FILE_HEADER_BYTES} bytes of the file headers");
        return Err(input.invalid("file size", expected, format!("{file_bytes} bytes")));
    }
    let mut headers = [0; FILE_HEADER_BYTES as usize];
    input.read(0, &mut headers)?;
    let (text, binary) = headers.split_at(TEXT_BYTES);
    if matches!(&text[4..7], b"SY1" | b"SY2") {
        let advice = "cut off its first 128 bytes";
        return Err(input.unsupported("the file begins with a tape label (SEG storage unit label)", advice));
    }
    let binary = binary.first_chunk().expect("400 bytes follow the text header");
    let header = BinaryHeader::read(binary, file_bytes, options)
        .map_err(|what| input.unsupported(what, "say --endian big or --endian little"))?;
    Ok((text_header::decode(text, text_header::detect(text)), header))
}

/// Notes what a person should know about the traces.
fn note_traces(layout: &Layout, scan: &Scan, grid: &Grid, (absent, given): (Absent, bool), notes: &mut Vec<String>) {
    let stored = if absent.value.is_nan() { "NaN".to_owned() } else { format!("{}", absent.value) };
    if grid.missing > 0 {
        notes.push(format!("{} places of the grid have no trace; their voxels are absent ({stored})", grid.missing));
    }
    if grid.dead > 0 {
        notes.push(format!("{} traces are marked dead; their voxels are absent ({stored})", grid.dead));
    }
    if scan.other_offsets > 0 {
        notes.push(format!("{} traces of other offsets were left out", scan.other_offsets));
    }
    if scan.padding > 0 {
        notes.push(format!("{} dead traces without line numbers were left out", scan.padding));
    }
    if absent.voxel_type != layout.format.voxel_type() {
        notes.push(format!(
            "every {} value occurs in the file; voxels were widened to {} to have one for absence",
            layout.format.voxel_type(),
            absent.voxel_type
        ));
    }
    if let Some(samples) = scan.overruled_samples {
        let why = if given { "given by hand" } else { "of the binary header, which declares a fixed trace length," };
        let read = layout.samples;
        notes.push(format!("trace headers say {samples} samples (bytes 115-116); the {read} {why} were read"));
    }
    if let Some(delay) = scan.delay_ms
        && delay.min.0 != delay.max.0
    {
        notes.push(format!(
            "delays differ between traces, from {} ms (trace {}) to {} ms (trace {}); traces were not shifted, and the \
             first sample is taken to lie at the smallest",
            delay.min.0,
            delay.min.1 + 1,
            delay.max.0,
            delay.max.1 + 1
        ));
    }
}

/// Grid, world and survey, once traces and grid are known.
fn describe(
    input: Input<'_>,
    (layout, header): (&Layout, &BinaryHeader),
    (scan, grid): (&Scan, &Grid),
    options: &SegyOptions,
    text_header: String,
    mut notes: Vec<String>,
) -> Result<SourceInfo, SourceError> {
    let placement = survey::place(input, (layout, header), scan, grid, &mut notes)?;
    let interval = survey::sample_interval(header, scan, options.interval, &mut notes);
    let depth = text_header::says_depth_domain(&text_header);
    let (z_name, z_unit) = match (interval, depth, header.feet) {
        (None, _, _) => ("sample", ""),
        (_, false, _) => ("time", "ms"),
        (_, true, false) => ("depth", "m"),
        (_, true, true) => ("depth", "ft"),
    };
    if z_name == "time" && text_header::may_mean_depth(&text_header) {
        notes.push(
            "the third axis is taken for time; the text header speaks of depth, too: --domain depth says that".into(),
        );
    }
    // Without an interval the z axis counts samples, and a delay in ms has no place on it.
    let first_sample = interval.and(scan.delay_ms).map_or(0.0, |delay| delay.min.0);
    let spacing_z = interval.unwrap_or(1.0);
    let dims = Dims([grid.crossline.count, grid.inline.count, layout.samples]);
    let axis = |name: &str, unit: &str| Axis { name: name.into(), unit: unit.into() };
    let mut info = SourceInfo::plain("segy", dims, layout.format.voxel_type());
    info.geometry = Geometry {
        spacing: [placement.spacing[0], placement.spacing[1], spacing_z],
        origin: [0.0, 0.0, first_sample],
        direction: survey::direction(placement.corners),
    };
    info.axes = [axis("crossline", placement.units[0]), axis("inline", placement.units[1]), axis(z_name, z_unit)];
    info.survey = Some(Survey {
        inline: grid.inline,
        crossline: grid.crossline,
        corners: placement.corners,
        sample_interval: spacing_z,
        first_sample,
        missing_traces: grid.missing,
        dead_traces: grid.dead,
        text_header,
    });
    info.notes = notes;
    if let Some(defect) = info.geometry.defect() {
        return Err(input.invalid("geometry from coordinates and sample interval", "finite lengths", defect));
    }
    Ok(info)
}
