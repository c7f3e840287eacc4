//! NumPy arrays (`.npy`, versions 1 to 3): a Python dict literal, then the packed elements.
//!
//! The shape is [z, y, x], as `supervol extract` writes it. `fortran_order` changes only the memory order (z is then
//! fastest), not the meaning of the axes. Format: NumPy Enhancement Proposal 1 and `numpy.lib.format`.
//! The literal may have 1 MiB. Its strict parser knows only strings, True, False and tuples of numbers. Elements are
//! read in place; bytes behind them are noted.
//! Written by hand: the crate `ndarray-npy` reads whole arrays into memory.

mod axes;

use std::fs::File;
use std::path::Path;

use supervol_format::{ByteSource, VoxelBox, VoxelType};

use self::axes::Arranged;
use super::array_survey::SurveyParts;
use crate::cast::index;
use crate::formats::format::{Certainty, Folder, Format, Found};
use crate::grid::dense::shape::{FastestAxis, SplitAxes, split_axes};
use crate::grid::dense::{GridFile, GridLayout, GridSource, checked_bytes};
use crate::grid::elements::{Channels, Elements, Frames, Meaning, Number};
use crate::input::file::SourceFile;
use crate::input::selection::{Choice, Selection};
use crate::{Endian, Message, ReadOption, SourceError, SourceInfo, VolumeSource};

/// Longest header that is read, in bytes. NumPy itself warns beyond 10,000.
const HEADER_LIMIT_BYTES: u64 = 1 << 20;

/// Largest number of axes of an array; NumPy allows 64.
const AXES_LIMIT: usize = 64;

const MAGIC: &[u8; 6] = b"\x93NUMPY";

/// Ends of file names.
const ENDINGS: &[&str] = &[".npy"];

/// Row of the table of formats.
pub const FORMAT: Format = Format {
    name: "npy",
    title: "npy",
    endings: ENDINGS,
    choices: &[Choice::Axes],
    sniff: |start, _| start.begins_with(b"\x93NUM") || start.is_named(ENDINGS),
    certainty: Certainty::Certain,
    folder: Folder::Never,
    open: |path, options| Ok(Box::new(NpySource::open_with(path, &options.selection)?)),
    found: |_| Found::Volume,
};

/// A `.npy` file.
#[derive(Debug)]
pub struct NpySource(GridSource);

/// Part of a file that holds an array with its header.
#[derive(Debug)]
pub(crate) struct ArrayPart {
    /// Name of the format, see [`SourceInfo::format`].
    pub(crate) format: &'static str,
    /// The file, or a file with the inflated array.
    pub(crate) file: File,
    /// Offset of the array in bytes.
    pub(crate) start: u64,
    /// Length of the array in bytes, with its header.
    pub(crate) length: u64,
    /// The opened file, to notice changes.
    pub(crate) source_file: SourceFile,
}

impl NpySource {
    /// Opens a `.npy` file.
    ///
    /// # Errors
    /// If the file cannot be read, breaks the format's rules, or does not hold a supported volume.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        Self::open_with(path, &Selection::default())
    }

    /// As [`Self::open`], with the user's choice of volume and channel in an array of more axes.
    ///
    /// # Errors
    /// As [`Self::open`]; also if there is no such volume or channel.
    pub fn open_with(path: &Path, selection: &Selection) -> Result<Self, SourceError> {
        let source_file = SourceFile::of(path)?;
        let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
        let length = file.len().map_err(|e| SourceError::io(path, e))?;
        Self::of_part(path, ArrayPart { format: "npy", file, start: 0, length, source_file }, selection)
    }

    /// The array in a part of a file.
    pub(crate) fn of_part(path: &Path, part: ArrayPart, selection: &Selection) -> Result<Self, SourceError> {
        let ArrayPart { format, file, start, length, source_file } = part;
        let (text, offset) = header_text(path, &file, start)?;
        let header = parse_header(&text).map_err(|wrong| {
            let found = format!("`{}`", excerpt(&text));
            SourceError::invalid(path, "npy header", wrong, found)
        })?;
        let (number, endian) = element_type(path, &header.descr)?;
        let mut notes = Vec::new();
        let (arranged, frames) = match selection.axes.is_empty() {
            true => Self::as_stored(path, &header, selection, &mut notes)?,
            false => (axes::arrange(path, &header, selection, &mut notes)?, Frames::ONE),
        };
        let Arranged { dims, fastest_first, channels, skipped, survey } = arranged;
        let offset = skipped.checked_mul(number.stored().bytes() as u64).and_then(|bytes| offset.checked_add(bytes));
        let offset = offset.unwrap_or(u64::MAX);
        let plain = GridLayout { dims, voxel_type: number.stored(), endian, fastest_first };
        let layout = Elements::widened(channels, frames, plain);
        let bytes = checked_bytes(path, layout.dims, layout.voxel_type)?;
        let end = offset.checked_add(bytes).filter(|end| *end - start <= length);
        let Some(end) = end else {
            let begin = offset - start;
            let expected = format!("{} bytes ({bytes} of voxels from byte {begin} on)", begin.saturating_add(bytes));
            return Err(SourceError::invalid(path, "length of the file", expected, format!("{length} bytes")));
        };
        let grid = GridFile::single(path, file, offset, layout)?;
        let elements = Elements::of(path, &grid, number, (channels, frames), &mut notes)?;

        let mut info = SourceInfo::plain(format, dims, elements.voxel_type);
        info.files = vec![source_file];
        if let Some(axes) = survey {
            SurveyParts::default().describe(&mut info, axes.each_ref(), &mut notes);
        }
        info.notes = notes;
        if header.fortran_order && selection.axes.is_empty() {
            info.notes.push("Fortran order: z runs fastest in the file".into());
        }
        if header.descr.ends_with("b1") {
            info.notes.push("truth values are read as 0 and 1".into());
        }
        let excess = start + length - end;
        if excess > 0 && selection.axes.is_empty() {
            info.notes.push(format!("the file goes on after the array; bytes not read: {excess}").into());
        }
        Ok(Self(GridSource::with_elements(info, grid, elements)))
    }
}

impl NpySource {
    /// The volume whose axes are those of the array, slowest first.
    fn as_stored(
        path: &Path,
        header: &NpyHeader,
        selection: &Selection,
        notes: &mut Vec<Message>,
    ) -> Result<(Arranged, Frames), SourceError> {
        let SplitAxes { channels, frames, mut chosen } = split_axes_of(path, header, selection)?;
        notes.append(&mut chosen.notes);
        let channels = Channels::choose(path, channels, Meaning::Components, selection, notes)?;
        let frames = Frames { count: frames, wanted: selection.frame_of(path, frames)? };
        let fastest_first = if header.fortran_order { [2, 1, 0] } else { GridLayout::X_FASTEST };
        Ok((Arranged { dims: chosen.dims, fastest_first, channels, skipped: 0, survey: None }, frames))
    }
}

impl VolumeSource for NpySource {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// The dict literal and the offset of the first element, for an array that begins at byte `start_at`.
fn header_text(path: &Path, file: &File, start_at: u64) -> Result<(String, u64), SourceError> {
    let read = |offset: u64, out: &mut [u8]| match file.read_exact_at(start_at + offset, out) {
        Ok(()) => Ok(()),
        Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            let expected = format!("{} bytes from byte {offset} on", out.len());
            Err(SourceError::invalid(path, "npy header", expected, "the end of the file"))
        }
        Err(e) => Err(SourceError::io(path, e)),
    };
    let mut start = [0; 8];
    read(0, &mut start)?;
    if start[..6] != *MAGIC {
        let found = format!("`{}`", start[..6].escape_ascii());
        return Err(SourceError::invalid(path, "magic (bytes 0 to 5)", "`\\x93NUMPY`", found));
    }
    let (length, text_offset): (u64, u64) = match start[6] {
        1 => {
            let mut length = [0; 2];
            read(8, &mut length)?;
            (u16::from_le_bytes(length).into(), 10)
        }
        2 | 3 => {
            let mut length = [0; 4];
            read(8, &mut length)?;
            (u32::from_le_bytes(length).into(), 12)
        }
        version => {
            let found = version.to_string();
            return Err(SourceError::invalid(path, "npy version (byte 6)", "1, 2 or 3", found));
        }
    };
    if length > HEADER_LIMIT_BYTES {
        let expected = format!("at most {HEADER_LIMIT_BYTES} bytes");
        return Err(SourceError::invalid(path, "length of the npy header", expected, format!("{length} bytes")));
    }
    // The limit above keeps the length within the address space.
    let mut text = vec![0; index(length)];
    read(text_offset, &mut text)?;
    Ok((String::from_utf8_lossy(&text).into_owned(), start_at + text_offset + length))
}

/// Contents of the dict.
#[derive(Debug, PartialEq, Eq)]
struct NpyHeader {
    descr: String,
    fortran_order: bool,
    shape: Vec<u64>,
}

fn parse_header(text: &str) -> Result<NpyHeader, String> {
    let mut parser = Parser { rest: text };
    let (mut descr, mut fortran_order, mut shape) = (None, None, None);
    parser.expect("{")?;
    while !parser.accept("}") {
        let key = parser.string()?;
        parser.expect(":")?;
        let again = match key {
            "descr" if parser.peek('[') => return Err("one number per element, not a structure".into()),
            "descr" => descr.replace(parser.string()?.to_owned()).is_some(),
            "fortran_order" => fortran_order.replace(parser.truth()?).is_some(),
            "shape" => shape.replace(parser.tuple()?).is_some(),
            _ => return Err("the keys 'descr', 'fortran_order' and 'shape' only".into()),
        };
        if again {
            return Err(format!("the key '{key}' once"));
        }
        if !parser.accept(",") {
            parser.expect("}")?;
            break;
        }
    }
    if !parser.rest.trim().is_empty() {
        return Err("nothing but spaces behind the closing brace".into());
    }
    match (descr, fortran_order, shape) {
        (Some(descr), Some(fortran_order), Some(shape)) => Ok(NpyHeader { descr, fortran_order, shape }),
        _ => Err("the keys 'descr', 'fortran_order' and 'shape', all three".into()),
    }
}

/// Parser that consumes one token of the literal after the other and skips white space.
struct Parser<'a> {
    rest: &'a str,
}

impl<'a> Parser<'a> {
    fn peek(&mut self, c: char) -> bool {
        self.rest = self.rest.trim_start();
        self.rest.starts_with(c)
    }

    fn accept(&mut self, token: &str) -> bool {
        self.rest = self.rest.trim_start();
        match self.rest.strip_prefix(token) {
            Some(behind) => {
                self.rest = behind;
                true
            }
            None => false,
        }
    }

    fn expect(&mut self, token: &str) -> Result<(), String> {
        if self.accept(token) { Ok(()) } else { Err(format!("`{token}` before `{}`", excerpt(self.rest))) }
    }

    fn string(&mut self) -> Result<&'a str, String> {
        let quote = ['\'', '"'].into_iter().find(|q| self.peek(*q));
        let piece = quote.and_then(|q| self.rest[1..].split_once(q));
        let Some((inside, behind)) = piece.filter(|(inside, _)| !inside.contains('\\')) else {
            return Err(format!("a string before `{}`", excerpt(self.rest)));
        };
        self.rest = behind;
        Ok(inside)
    }

    fn truth(&mut self) -> Result<bool, String> {
        if self.accept("True") {
            return Ok(true);
        }
        if self.accept("False") { Ok(false) } else { Err(format!("True or False before `{}`", excerpt(self.rest))) }
    }

    fn tuple(&mut self) -> Result<Vec<u64>, String> {
        self.expect("(")?;
        let mut numbers = Vec::new();
        while !self.accept(")") {
            self.rest = self.rest.trim_start();
            let digits = self.rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(self.rest.len());
            let number = self.rest[..digits].parse();
            numbers.push(number.map_err(|_| format!("a whole number before `{}`", excerpt(self.rest)))?);
            self.rest = &self.rest[digits..];
            // Python 2 wrote long integers with an L.
            self.accept("L");
            if numbers.len() > AXES_LIMIT {
                return Err(format!("at most {AXES_LIMIT} axes"));
            }
            if !self.accept(",") {
                self.expect(")")?;
                break;
            }
        }
        Ok(numbers)
    }
}

/// Number type and byte order of a NumPy type string such as `<f4`.
fn element_type(path: &Path, descr: &str) -> Result<(Number, Endian), SourceError> {
    let unknown = || {
        let expected = "a byte order (<, > or |) and one of u1 i1 u2 i2 u4 i4 u8 i8 f2 f4 f8 b1";
        SourceError::invalid(path, "descr", expected, format!("`{}`", excerpt(descr)))
    };
    let order = descr.chars().next().filter(|c| "<>|".contains(*c)).ok_or_else(unknown)?;
    let number = match &descr[1..] {
        "u1" | "b1" => Number::Voxel(VoxelType::U8),
        "i1" => Number::Voxel(VoxelType::I8),
        "u2" => Number::Voxel(VoxelType::U16),
        "i2" => Number::Voxel(VoxelType::I16),
        "u4" => Number::Voxel(VoxelType::U32),
        "i4" => Number::Voxel(VoxelType::I32),
        "i8" => Number::Whole { signed: true },
        "u8" => Number::Whole { signed: false },
        "f4" => Number::Voxel(VoxelType::F32),
        "f8" => Number::Voxel(VoxelType::F64),
        "f2" => Number::Half,
        "f16" => return Err(refused(path, descr, "extended floats", "astype('float64')")),
        "c8" | "c16" | "c32" => return Err(refused(path, descr, "complex numbers", "abs() or .real")),
        _ => return Err(unknown()),
    };
    if order == '|' && number.stored().bytes() > 1 {
        return Err(unknown());
    }
    Ok((number, if order == '>' { Endian::Big } else { Endian::Little }))
}

fn refused(path: &Path, descr: &str, what: &str, conversion: &str) -> SourceError {
    let what = format!("elements are {what} (`{descr}`), for which there is no voxel type");
    SourceError::unsupported(path, what, format!("convert with {conversion} before saving"))
}

/// The three axes of the volume, and the axes of channels and frames. The array's shape has the slowest axis first.
fn split_axes_of(path: &Path, header: &NpyHeader, selection: &Selection) -> Result<SplitAxes, SourceError> {
    let shape = &header.shape;
    if let Some(axis) = shape.iter().position(|n| *n == 0) {
        return Err(SourceError::invalid(path, "shape", "at least one element", format!("none along axis {axis}")));
    }
    let fastest_first: Vec<u64> = shape.iter().rev().copied().collect();
    let split = split_axes(&fastest_first, &vec![true; shape.len()], FastestAxis::of(selection));
    let refused = |advice: Message| {
        let what = format!("the array has {} axes ({shape:?}), a volume has three [z, y, x]", shape.len());
        Err(SourceError::unsupported(path, what, advice))
    };
    match split {
        Ok(split) if split.channels == 1 && split.frames == 1 => Ok(split),
        // Either the first or the last axis may be the extra one; only the user knows.
        Ok(_) if selection.channel.is_none() && selection.frame.is_none() => {
            let [first, last] = [shape[0], shape[shape.len() - 1]];
            let advice = Message::from(format!("choose one of the {first} along the first with "));
            let advice = advice.option(ReadOption::Frame).text(format_args!(", or of the {last} along the last with "));
            refused(advice.option(ReadOption::Channel))
        }
        Ok(_) if header.fortran_order => refused("in Fortran order: save it with `numpy.ascontiguousarray`".into()),
        Ok(split) => Ok(split),
        Err(_) => refused("save one volume of it".into()),
    }
}

/// The first characters of a text from a file, safe to print in a message.
fn excerpt(text: &str) -> String {
    text.chars().take(80).map(|c| if c.is_control() { '?' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals() {
        let header = |descr: &str, fortran_order, shape: &[u64]| {
            Ok(NpyHeader { descr: descr.into(), fortran_order, shape: shape.into() })
        };
        let text = "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5), }   \n";
        assert_eq!(parse_header(text), header("<f4", false, &[3, 4, 5]));
        let text = "{\"shape\":(7L,),\"fortran_order\":True,\"descr\":\"|u1\"}";
        assert_eq!(parse_header(text), header("|u1", true, &[7]));
        assert_eq!(parse_header("{'descr': '<f4', 'fortran_order': False, 'shape': ()}"), header("<f4", false, &[]));
        for wrong in [
            "",
            "{",
            "{}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4, 5)",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (3,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3,)} x",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-3,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (3 4)}",
            "{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (3,)}",
            "{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (3,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999,)}",
        ] {
            assert!(parse_header(wrong).is_err(), "{wrong}");
        }
    }
}
