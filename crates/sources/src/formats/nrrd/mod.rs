//! NRRD volumes (versions 1 to 5): a text header, and the voxels behind it or in separate files.
//!
//! Raw voxels are read in place. Gzip and text are decoded once into a spool file ([`crate::input::spool`]). The
//! header's world space is kept. One of several channels (the fastest axis) and volumes (the slowest) is chosen. 64-bit
//! integers are kept in the smallest type that holds all of them. Hex, bzip2, block types and more axes are refused,
//! each with advice. Bytes behind raw voxels are noted, not refused: the format allows them.
//! Written by hand: the available NRRD crates read whole volumes into memory.

mod geometry;
mod header;

use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use supervol_format::{ByteSource, VoxelBox, VoxelType};

use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::shape::{FastestAxis, SplitAxes, split_axes};
use crate::grid::dense::{GridFile, GridLayout, GridSource, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Meaning, Number};
use crate::grid::header_data::{DataLayout, HeaderData};
pub use crate::input::data_files::Outside;
use crate::input::data_files::{find_all, note_excess, open_data};
use crate::input::file::SourceFile;
use crate::input::selection::Selection;
use crate::input::spool::{Excess, GzipShare, Spool, SpoolFolder, TextNumbers, Words};
use crate::input::text::shortened;
use crate::{Endian, Message, SourceError, SourceInfo, VolumeSource};
use header::{DataFiles, Encoding, Header};

/// Largest number of bytes that `line skip` may skip.
const LINE_SKIP_LIMIT_BYTES: u64 = 16 << 20;

/// Largest number of unknown fields that are noted by name.
const UNKNOWN_FIELDS_NOTED: usize = 8;

/// Fields that change neither voxels nor their placement.
const FIELDS_WITHOUT_EFFECT: [&str; 9] =
    ["content", "number", "min", "max", "oldmin", "oldmax", "thicknesses", "measurementframe", "blocksize"];

/// Fields that are read.
const FIELDS_READ: [&str; 22] = [
    "type",
    "dimension",
    "sizes",
    "encoding",
    "endian",
    "datafile",
    "byteskip",
    "lineskip",
    "space",
    "spacedimension",
    "spacedirections",
    "spaceorigin",
    "spaceunits",
    "spacings",
    "axismins",
    "axismaxs",
    "centerings",
    "centers",
    "kinds",
    "labels",
    "units",
    "sampleunits",
];

/// Ends of file names.
const ENDINGS: &[&str] = &[".nrrd", ".nhdr"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "nrrd",
    title: "NRRD",
    endings: ENDINGS,
    choices: &[],
    sniff: |start, _| start.begins_with(b"NRRD") || start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| {
        Ok(Box::new(NrrdSource::open_with(path, &options.spool, options.outside, &options.selection)?))
    },
    found: |_| Found::Volume,
};

/// A NRRD volume.
#[derive(Debug)]
pub struct NrrdSource(GridSource);

impl NrrdSource {
    /// Opens a NRRD file, or the header (`.nhdr`) of several files. Compressed voxels are decoded into `spool`.
    ///
    /// # Errors
    /// If a file cannot be read, breaks the format's rules, or does not hold a supported volume. If a data file lies
    /// outside the header's folder.
    pub fn open(path: &Path, spool: &SpoolFolder) -> Result<Self, SourceError> {
        Self::open_with(path, spool, Outside::Refused, &Selection::default())
    }

    /// As [`Self::open`], with the user's choice of volume and channel, and of whether data files may lie anywhere.
    ///
    /// # Errors
    /// As [`Self::open`]; also if there is no such volume or channel.
    pub fn open_with(
        path: &Path,
        spool: &SpoolFolder,
        outside: Outside,
        selection: &Selection,
    ) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let mut reader = BufReader::new(File::open(path).map_err(|e| SourceError::io(path, e))?);
        let header = Header::read(path, &mut reader)?;
        let sizes = header.sizes(path)?;
        let number = number(path, header.required(path, "type")?)?;
        let (SplitAxes { channels, frames, chosen }, meaning) = axes_of(path, &header, &sizes, selection)?;
        let mut notes = chosen.notes.clone();
        let channels = Channels::choose(path, channels, meaning, selection, &mut notes)?;
        let frames = Frames { count: frames, wanted: selection.noted_frame(path, frames, "volumes", &mut notes)? };
        let placement = geometry::placement(path, &header, &chosen, sizes.len())?;
        notes.extend(placement.notes);
        notes.extend(field_notes(&header));

        let encoding = header.encoding(path)?;
        if encoding == Encoding::Text && matches!(number, Number::Whole { .. }) {
            let advice = "write it as raw or gzip first, for example with `unu save -e gzip -f nrrd -i IN -o OUT`";
            return Err(SourceError::unsupported(path, "64-bit integers as text are not read", advice));
        }
        let data = Data { path, header: &header, voxel_type: number.stored(), encoding, outside };
        let plain = GridLayout {
            dims: chosen.dims,
            voxel_type: number.stored(),
            endian: data.endian()?,
            fastest_first: GridLayout::X_FASTEST,
        };
        let layout = Elements::widened(channels, frames, plain);
        checked_bytes(path, layout.dims, layout.voxel_type)?;
        let (grid, data_files) = data.open(layout, sizes.len(), spool, &mut notes)?;
        let elements = Elements::of(path, &grid, number, (channels, frames), &mut notes)?;

        let mut info = SourceInfo::plain("nrrd", chosen.dims, elements.voxel_type);
        info.geometry = placement.geometry;
        info.space = placement.space;
        info.axes = placement.axes;
        info.unit = header.field("sampleunits").map(|u| shortened(u.trim_matches('"'))).unwrap_or_default();
        info.labels = header.is_segmentation().then_some("the file describes segments");
        info.notes = notes;
        info.files = SourceFile::distinct([vec![source_file], data_files].concat());
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl VolumeSource for NrrdSource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// Number type of one of the format's many type names.
fn number(path: &Path, name: &str) -> Result<Number, SourceError> {
    let voxel = |voxel_type| Ok(Number::Voxel(voxel_type));
    match name.to_lowercase().split_whitespace().collect::<Vec<_>>().join(" ").as_str() {
        "signed char" | "int8" | "int8_t" => voxel(VoxelType::I8),
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => voxel(VoxelType::U8),
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => voxel(VoxelType::I16),
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => voxel(VoxelType::U16),
        "int" | "signed int" | "int32" | "int32_t" => voxel(VoxelType::I32),
        "uint" | "unsigned int" | "uint32" | "uint32_t" => voxel(VoxelType::U32),
        "float" => voxel(VoxelType::F32),
        "double" => voxel(VoxelType::F64),
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Ok(Number::Whole { signed: true }),
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            Ok(Number::Whole { signed: false })
        }
        "block" => {
            let advice = "only its writer knows what the blocks are: write out one number per voxel";
            Err(SourceError::unsupported(path, "voxels are opaque blocks (`type: block`)", advice))
        }
        _ => {
            let found = format!("`{}`", shortened(name));
            Err(SourceError::invalid(path, "type", "an integer type, float or double", found))
        }
    }
}

/// The axes of the volume, of its channels and its frames, and the meaning of the channels. An error names the axis
/// that is in the way.
fn axes_of(
    path: &Path,
    header: &Header,
    sizes: &[u64],
    selection: &Selection,
) -> Result<(SplitAxes, Meaning), SourceError> {
    let kinds = header.words(path, "kinds", sizes.len())?;
    let directions = header.field("spacedirections").unwrap_or_default();
    let kind = |axis: usize| kinds.as_ref().map_or("", |k| k[axis].as_str());
    let spatial: Vec<bool> = (0..sizes.len())
        .map(|axis| match kind(axis) {
            "domain" | "space" | "time" => true,
            "" | "none" | "???" => nth_direction(directions, axis) != Some("none"),
            _ => false,
        })
        .collect();
    let fastest = if sizes.len() > 3 { FastestAxis::of(selection) } else { FastestAxis::AsStated };
    let split = split_axes(sizes, &spatial, fastest).map_err(|in_the_way| {
        let describe = |axis: &usize| match kind(*axis) {
            "" => format!("axis {axis} of {} values", sizes[*axis]),
            kind => format!("axis {axis} of {} values (kind {kind})", sizes[*axis]),
        };
        let list: Vec<String> = in_the_way.iter().map(describe).collect();
        let what = format!("a volume has three axes and one number per voxel, but there is also {}", list.join(", "));
        let example = in_the_way.first().copied().unwrap_or_default();
        let advice = format!("take one slice of it first, for example with `unu slice -a {example} -p 0 -i IN -o OUT`");
        SourceError::unsupported(path, what, advice)
    })?;
    let is_colour = kind(0).to_lowercase().contains("color");
    Ok((split, if is_colour { Meaning::Colours } else { Meaning::Components }))
}

/// The text of one direction: `none` or a vector in parentheses.
fn nth_direction(text: &str, axis: usize) -> Option<&str> {
    text.split_inclusive(')')
        .flat_map(|piece| match piece.find('(') {
            Some(open) => [&piece[..open], &piece[open..]],
            None => [piece, ""],
        })
        .flat_map(|piece| if piece.starts_with('(') { vec![piece] } else { piece.split_whitespace().collect() })
        .nth(axis)
}

/// Notes on fields that a user might expect to matter.
fn field_notes(header: &Header) -> Vec<Message> {
    let is_unknown = |name: &&str| !FIELDS_READ.contains(name) && !FIELDS_WITHOUT_EFFECT.contains(name);
    let unknown = || header.names().filter(is_unknown);
    let note = |name: &str| Message::from(format!("field `{}` is unknown and ignored", shortened(name)));
    let mut notes: Vec<Message> = unknown().take(UNKNOWN_FIELDS_NOTED).map(note).collect();
    let more = unknown().count().saturating_sub(UNKNOWN_FIELDS_NOTED);
    if more > 0 {
        notes.push(format!("{more} more fields are unknown and ignored").into());
    }
    if let (Some(low), Some(high)) = (header.field("oldmin"), header.field("oldmax")) {
        let (low, high) = (shortened(low), shortened(high));
        notes.push(format!("the values were quantised from {low} to {high}; they are kept as stored").into());
    }
    notes
}

/// Data needed to find the voxels.
struct Data<'a> {
    path: &'a Path,
    header: &'a Header,
    voxel_type: VoxelType,
    encoding: Encoding,
    outside: Outside,
}

impl Data<'_> {
    fn endian(&self) -> Result<Endian, SourceError> {
        // Text is decoded to little endian, and single bytes have no order.
        if self.encoding == Encoding::Text || self.voxel_type.bytes() == 1 {
            return Ok(Endian::Little);
        }
        match self.header.required(self.path, "endian")?.to_lowercase().as_str() {
            "little" => Ok(Endian::Little),
            "big" => Ok(Endian::Big),
            other => {
                let found = format!("`{}`", shortened(other));
                Err(SourceError::invalid(self.path, "endian", "little or big", found))
            }
        }
    }

    fn open(
        &self,
        layout: GridLayout,
        axes: usize,
        spool: &SpoolFolder,
        notes: &mut Vec<Message>,
    ) -> Result<(GridFile, Vec<SourceFile>), SourceError> {
        let (files, start) = match self.header.data_files(self.path, axes)? {
            DataFiles::Attached => (vec![self.path.to_path_buf()], self.header.end),
            DataFiles::Named(names) => (find_all(self.path, &names, self.outside)?, 0),
        };
        HeaderData { header: self.path, key: "data file", files, start, layout }.open(self, spool, notes)
    }

    /// `byte skip`, if only a number of bytes is allowed.
    fn byte_skip(&self) -> Result<u64, SourceError> {
        let skip = self.header.whole_number(self.path, "byteskip")?;
        u64::try_from(skip).map_err(|_| {
            let expected = "a number of bytes, or -1 with raw encoding";
            SourceError::invalid(self.path, "byte skip", expected, skip.to_string())
        })
    }

    /// Moves the reader to `start` and past the lines to skip; returns its offset.
    fn skip_lines(&self, path: &Path, reader: &mut BufReader<File>, start: u64) -> Result<u64, SourceError> {
        let lines = self.header.whole_number(self.path, "lineskip")?;
        if lines < 0 {
            return Err(SourceError::invalid(self.path, "line skip", "a number of lines", lines.to_string()));
        }
        reader.seek(SeekFrom::Start(start)).map_err(|e| SourceError::io(path, e))?;
        let mut limited = reader.take(LINE_SKIP_LIMIT_BYTES);
        for line in 0..lines {
            let passed = limited.skip_until(b'\n').map_err(|e| SourceError::io(path, e))?;
            if passed == 0 {
                let expected = format!("{lines} lines to skip within {LINE_SKIP_LIMIT_BYTES} bytes");
                return Err(SourceError::invalid(path, "line skip", expected, format!("{line} lines")));
            }
        }
        Ok(start + LINE_SKIP_LIMIT_BYTES - limited.limit())
    }
}

impl DataLayout for Data<'_> {
    fn is_raw(&self) -> bool {
        self.encoding == Encoding::Raw
    }

    /// Offset of the voxels in a raw data file, behind the lines and bytes to skip.
    fn offset(&self, path: &Path, start: u64, share_bytes: u64, notes: &mut Vec<Message>) -> Result<u64, SourceError> {
        let file = open_data(path)?;
        let length = file.len().map_err(|e| SourceError::io(path, e))?;
        let byte_skip = self.header.whole_number(self.path, "byteskip")?;
        // -1: the voxels are at the end of the file.
        if byte_skip == -1 {
            return length.checked_sub(share_bytes).filter(|offset| *offset >= start).ok_or_else(|| {
                let expected = format!("{share_bytes} bytes of voxels at its end");
                SourceError::invalid(path, "length of the file", expected, format!("{length} bytes"))
            });
        }
        let mut reader = BufReader::new(file);
        let start = self.skip_lines(path, &mut reader, start)?;
        let offset = start.checked_add(self.byte_skip()?);
        let offset = offset.filter(|offset| *offset <= length).ok_or_else(|| {
            let expected = format!("at most the {length} bytes of the file");
            SourceError::invalid(path, "byte skip", expected, format!("{byte_skip} after byte {start}"))
        })?;
        // Opening the grid finds a file that is too short; the sum there is checked for overflow.
        let excess = (length - offset).saturating_sub(share_bytes);
        note_excess(path, excess, notes);
        Ok(offset)
    }

    /// Decodes all data files, one after the other, into one spool file.
    fn decode(
        &self,
        files: &[PathBuf],
        start: u64,
        share_bytes: u64,
        folder: &SpoolFolder,
    ) -> Result<File, SourceError> {
        let mut spool = Spool::create(folder)?;
        for path in files {
            let file = open_data(path)?;
            let length = file.len().map_err(|e| SourceError::io(path, e))?;
            let mut reader = BufReader::new(file);
            let start = self.skip_lines(path, &mut reader, start)?;
            let left = length.saturating_sub(start);
            if self.encoding == Encoding::Gzip {
                let skip_bytes = self.byte_skip()?;
                let excess = Excess::Refused;
                let share = GzipShare { path, compressed_bytes: left, skip_bytes, bytes: share_bytes, excess };
                spool.append_gzip(reader, &share)?;
                continue;
            }
            let voxels = share_bytes / self.voxel_type.bytes() as u64;
            // A number takes at least a digit and, unless it is the last, a separator.
            if left.saturating_add(1) / 2 < voxels {
                let found = format!("{left} bytes of text");
                return Err(SourceError::invalid(path, "text data", format!("{voxels} numbers"), found));
            }
            let skip = self.byte_skip()?;
            let skip = i64::try_from(skip).map_err(|_| SourceError::invalid(path, "byte skip", "less", "2^63"))?;
            reader.seek_relative(skip).map_err(|e| SourceError::io(path, e))?;
            let words = if path == self.path { Words::Shown } else { Words::Hidden };
            let numbers = TextNumbers { voxel_type: self.voxel_type, voxels, words, excess: Excess::Refused };
            spool.append_text(path, reader, numbers)?;
        }
        spool.finish()
    }
}
