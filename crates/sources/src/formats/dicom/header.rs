//! Header of a DICOM file: image size, numbers, placement, series.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use supervol_format::ByteSource;

use super::data_set::{DataSet, Element, Fault, PixelsAt, Spelling, Visitor, in_order};
use super::syntax::Syntax;
use crate::cast::{self, index, low_32};
use crate::input::spool::{Spool, SpoolFolder};
use crate::input::text::shortened;
use crate::{Endian, SourceError};

/// Offset of the mark `DICM`.
const MARK_AT: u64 = 128;
/// Largest number of frames of a file.
pub(super) const FRAMES_LIMIT: u64 = 1 << 16;
/// Largest size of an inflated data set in bytes.
const INFLATED_LIMIT_BYTES: u64 = 4 << 30;

const SHARED: u32 = 0x5200_9229;
const PER_FRAME: u32 = 0x5200_9230;
/// Nested sequences with requested elements: position, orientation, spacing, values, number of a frame.
const MACROS: [u32; 7] = [0x0020_9113, 0x0020_9116, 0x0028_9110, 0x0028_9145, 0x0020_9111, REAL_WORLD, 0x0062_000a];
/// Real-world value mappings, and the codes of their units.
const REAL_WORLD: u32 = 0x0040_9096;
const UNIT_CODES: u32 = 0x0040_08ea;

/// Descriptions of the segments of a segmentation.
const SEGMENTS: u32 = 0x0062_0002;

/// Elements that are read, with their value representations for files that do not state them.
const WANTED: [(u32, &[u8; 2]); 51] = [
    (0x0002_0010, b"UI"),
    (0x0008_0060, b"CS"),
    (0x0008_0100, b"SH"),
    (0x0008_103e, b"LO"),
    (0x0018_0050, b"DS"),
    (0x0018_0088, b"DS"),
    (0x0018_1060, b"DS"),
    (0x0018_0086, b"IS"),
    (0x0020_000e, b"UI"),
    (0x0020_0011, b"IS"),
    (0x0020_0012, b"IS"),
    (0x0020_0013, b"IS"),
    (0x0020_0032, b"DS"),
    (0x0020_0037, b"DS"),
    (0x0020_0100, b"IS"),
    (0x0020_9128, b"UL"),
    (0x0028_0002, b"US"),
    (0x0028_0004, b"CS"),
    (0x0028_0006, b"US"),
    (0x0028_0008, b"IS"),
    (0x0028_0010, b"US"),
    (0x0028_0011, b"US"),
    (0x0028_0030, b"DS"),
    (0x0028_0100, b"US"),
    (0x0028_0101, b"US"),
    (0x0028_0102, b"US"),
    (0x0028_0103, b"US"),
    (0x0028_0120, b"US"),
    (0x0028_1052, b"DS"),
    (0x0028_1053, b"DS"),
    (0x0028_1054, b"LO"),
    (UNIT_CODES, b"SQ"),
    (0x0040_9224, b"FD"),
    (0x0040_9225, b"FD"),
    (0x0054_1001, b"CS"),
    (0x3004_0002, b"CS"),
    (0x3004_000c, b"DS"),
    (0x3004_000e, b"DS"),
    (SHARED, b"SQ"),
    (PER_FRAME, b"SQ"),
    (MACROS[0], b"SQ"),
    (MACROS[1], b"SQ"),
    (MACROS[2], b"SQ"),
    (MACROS[3], b"SQ"),
    (MACROS[4], b"SQ"),
    (MACROS[5], b"SQ"),
    (MACROS[6], b"SQ"),
    (SEGMENTS, b"SQ"),
    (0x0062_0004, b"US"),
    (0x0062_0005, b"LO"),
    (0x0062_000b, b"US"),
];

/// Placement of a frame, meaning of its numbers, and its order among frames at the same place; each `None` if unstated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Place {
    /// World position of the first pixel in mm, left-posterior-superior.
    pub(super) position: Option<[f64; 3]>,
    /// Directions of increasing column and row indices.
    pub(super) orientation: Option<[f64; 6]>,
    /// Distance between rows, and between columns, in mm.
    pub(super) pixel_spacing: Option<[f64; 2]>,
    /// Distance between slices in mm.
    pub(super) between: Option<f64>,
    /// Thickness of a slice in mm.
    pub(super) thickness: Option<f64>,
    pub(super) slope: Option<f64>,
    pub(super) intercept: Option<f64>,
    /// Slope and intercept of the first real-world value mapping, as far as stated.
    real_slope: Option<f64>,
    real_intercept: Option<f64>,
    /// Number of the segment that a frame of a segmentation shows.
    pub(super) segment: Option<f64>,
    /// Time point, echo, trigger time, acquisition.
    pub(super) times: [Option<f64>; 4],
}

impl Place {
    /// Fills the unstated values from `other`.
    pub(super) fn or(self, other: &Self) -> Self {
        Self {
            position: self.position.or(other.position),
            orientation: self.orientation.or(other.orientation),
            pixel_spacing: self.pixel_spacing.or(other.pixel_spacing),
            between: self.between.or(other.between),
            thickness: self.thickness.or(other.thickness),
            slope: self.slope.or(other.slope),
            intercept: self.intercept.or(other.intercept),
            real_slope: self.real_slope.or(other.real_slope),
            real_intercept: self.real_intercept.or(other.real_intercept),
            segment: self.segment.or(other.segment),
            times: std::array::from_fn(|i| self.times[i].or(other.times[i])),
        }
    }

    /// Slope and intercept of the real-world value mapping, if it is a line.
    pub(super) fn real_world(&self) -> Option<(f64, f64)> {
        self.real_slope.filter(|slope| *slope != 0.0).zip(self.real_intercept)
    }

    fn take(&mut self, tag: u32, numbers: &[f64]) {
        let first = numbers.first().copied().filter(|n| n.is_finite());
        let all_finite = numbers.iter().all(|n| n.is_finite());
        match tag {
            0x0018_0050 => self.thickness = first.filter(|n| *n > 0.0),
            0x0018_0088 => self.between = first.map(f64::abs).filter(|n| *n > 0.0),
            0x0020_0032 if all_finite => self.position = numbers.try_into().ok(),
            0x0020_0037 if all_finite => self.orientation = numbers.try_into().ok(),
            0x0028_0030 if numbers.iter().all(|n| n.is_finite() && *n > 0.0) => {
                self.pixel_spacing = numbers.try_into().ok();
            }
            0x0028_1052 => self.intercept = first,
            0x0028_1053 | 0x3004_000e => self.slope = first.filter(|n| *n != 0.0),
            // The first of several mappings counts.
            0x0040_9224 => self.real_intercept = self.real_intercept.or(first),
            0x0040_9225 => self.real_slope = self.real_slope.or(first),
            0x0062_000b => self.segment = first,
            0x0020_0100 | 0x0020_9128 => self.times[0] = first,
            0x0018_0086 => self.times[1] = first,
            0x0018_1060 => self.times[2] = first,
            0x0020_0012 => self.times[3] = first,
            _ => {}
        }
    }
}

/// Size and number format of an image.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Image {
    pub(super) rows: u32,
    pub(super) columns: u32,
    /// Numbers per pixel.
    pub(super) samples: u32,
    /// Whether the numbers of a pixel are in separate planes.
    pub(super) is_planar: bool,
    /// Bits per number; of these, the number of significant bits and the highest significant bit.
    pub(super) allocated: u32,
    pub(super) stored: u32,
    pub(super) high: u32,
    pub(super) is_signed: bool,
    pub(super) photometric: String,
}

/// The header of a file.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) syntax: Syntax,
    pub(super) image: Image,
    pub(super) modality: String,
    pub(super) series_uid: String,
    pub(super) series_number: Option<i64>,
    pub(super) description: String,
    pub(super) instance: i64,
    pub(super) padding: Option<f64>,
    /// Padding value that has more than 16 bits.
    wrong_padding: Option<f64>,
    /// Unit of the values, from whichever of three elements states it.
    pub(super) unit: String,
    /// Unit of the real-world values, and the number of mappings to them.
    pub(super) real_unit: String,
    pub(super) real_mappings: u64,
    pub(super) frame_count: u64,
    /// Numbers and labels of the segments of a segmentation.
    pub(super) segments: Vec<(f64, String)>,
    place: Place,
    shared: Place,
    frames: Vec<Place>,
    /// Distances of the frames from the first along the normal, for dose grids.
    offsets: Vec<f64>,
    pub(super) pixels: Option<PixelsAt>,
}

impl Header {
    fn empty(syntax: Syntax) -> Self {
        Self {
            syntax,
            image: Image { samples: 1, ..Image::default() },
            modality: String::new(),
            series_uid: String::new(),
            series_number: None,
            description: String::new(),
            instance: 0,
            padding: None,
            wrong_padding: None,
            unit: String::new(),
            real_unit: String::new(),
            real_mappings: 0,
            frame_count: 1,
            segments: Vec::new(),
            place: Place::default(),
            shared: Place::default(),
            frames: Vec::new(),
            offsets: Vec::new(),
            pixels: None,
        }
    }

    /// Placement of a frame.
    pub(super) fn frame(&self, number: u64) -> Place {
        let own = self.frames.get(index(number)).copied().unwrap_or_default();
        let mut place = own.or(&self.shared).or(&self.place);
        let along = self.offsets.get(index(number)).zip(self.offsets.first());
        if let (Some((offset, first)), Some(position), Some(normal)) = (along, place.position, normal(&place)) {
            place.position = Some(std::array::from_fn(|i| position[i] + normal[i] * (offset - first)));
        } else if self.frame_count > 1 && own.position.is_none() {
            // A single position for many frames applies only to the first.
            place.position = None;
        }
        place
    }

    /// Reads the header of a file; `None` if the file is not DICOM. A deflated data set is inflated into `spool`.
    pub(super) fn read(path: &Path, spool: &SpoolFolder) -> Result<Option<Self>, SourceError> {
        let Some((mut file, start, syntax)) = open(path, spool)? else { return Ok(None) };
        let end = file.len().map_err(|e| SourceError::io(path, e))?;
        let mut header = Self::empty(syntax);
        let fault = |fault| of_fault(path, fault);
        let mut data_set = DataSet::new(&mut file, start, end).map_err(|e| SourceError::io(path, e))?;
        header.pixels = data_set.visit(header.syntax.spelling, &mut header).map_err(fault)?;
        if let Some(number) = header.wrong_padding {
            let expected = "a number of 16 bits";
            return Err(SourceError::invalid(path, "pixel padding value (0028,0120)", expected, number.to_string()));
        }
        if !(1..=FRAMES_LIMIT).contains(&header.frame_count) {
            let found = header.frame_count.to_string();
            return Err(SourceError::invalid(path, "number of frames", format!("1 to {FRAMES_LIMIT}"), found));
        }
        Ok(Some(header))
    }
}

/// Unit normal of the slices: right-handed with columns and rows.
pub(super) fn normal(place: &Place) -> Option<[f64; 3]> {
    let [ax, ay, az, bx, by, bz] = place.orientation?;
    let normal = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    let length = normal.iter().map(|n| n * n).sum::<f64>().sqrt();
    (length > 0.5).then(|| normal.map(|n| n / length))
}

pub(super) fn of_fault(path: &Path, fault: Fault) -> SourceError {
    match fault {
        Fault::Io(error) => SourceError::io(path, error),
        Fault::Wrong(at, found) => SourceError::invalid(path, format!("byte {at}"), "an element of DICOM", found),
    }
}

/// Data set of a file (inflated if necessary), its first byte, and its transfer syntax. `None` if the file is not
/// DICOM.
pub(super) fn open(path: &Path, spool: &SpoolFolder) -> Result<Option<(File, u64, Syntax)>, SourceError> {
    let io = |e| SourceError::io(path, e);
    let mut file = File::open(path).map_err(io)?;
    let length = file.len().map_err(io)?;
    let mut head = Vec::new();
    Read::by_ref(&mut file).take(MARK_AT + 4).read_to_end(&mut head).map_err(io)?;
    if !head.ends_with(b"DICM") {
        return Ok(without_mark(&head).map(|spelling| (file, 0, Syntax::plain(spelling))));
    }
    let mut first = Group2::default();
    let mut data_set = DataSet::new(&mut file, MARK_AT + 4, length).map_err(io)?;
    let start = data_set.visit_group_2(&mut first).map_err(|fault| of_fault(path, fault))?;
    let syntax = Syntax::of(path, &first.syntax)?;
    if !syntax.is_deflated {
        return Ok(Some((file, start, syntax)));
    }
    file.seek(SeekFrom::Start(start)).map_err(io)?;
    let mut inflated = Spool::create(spool)?;
    inflated.append_inflated(path, std::io::BufReader::new(file), INFLATED_LIMIT_BYTES)?;
    Ok(Some((inflated.finish()?, 0, syntax)))
}

/// Encoding of old files without the mark, which begin with group 8.
fn without_mark(head: &[u8]) -> Option<Spelling> {
    let [0x08, 0x00, _, 0x00, a, b, ..] = *head else { return None };
    let is_explicit = a.is_ascii_uppercase() && b.is_ascii_uppercase();
    Some(if is_explicit { Spelling::EXPLICIT } else { Spelling::IMPLICIT })
}

#[derive(Default)]
struct Group2 {
    syntax: String,
}

impl Visitor for Group2 {
    fn wants(&self, _: &[u32], tag: u32) -> bool {
        tag == 0x0002_0010
    }

    fn value(&mut self, _: &[u32], _: Element, _: Endian, bytes: Vec<u8>) {
        self.syntax = text(&bytes);
    }

    fn item(&mut self, _: &[u32]) {}
}

impl Visitor for Header {
    fn wants(&self, sequences: &[u32], tag: u32) -> bool {
        let is_followed = match sequences {
            [] => true,
            [SHARED | PER_FRAME] => MACROS.contains(&tag),
            [SHARED | PER_FRAME, inside] => MACROS.contains(inside),
            [REAL_WORLD] | [REAL_WORLD, UNIT_CODES] | [SEGMENTS] => true,
            [SHARED | PER_FRAME, REAL_WORLD, UNIT_CODES] => true,
            _ => false,
        };
        is_followed && WANTED.iter().any(|(wanted, _)| *wanted == tag)
    }

    fn item(&mut self, sequences: &[u32]) {
        if sequences == [PER_FRAME] && (self.frames.len() as u64) < FRAMES_LIMIT {
            self.frames.push(Place::default());
        }
        if sequences == [REAL_WORLD] || sequences == [SHARED, REAL_WORLD] {
            self.real_mappings += 1;
        }
    }

    fn value(&mut self, sequences: &[u32], element: Element, endian: Endian, bytes: Vec<u8>) {
        let own_kind = WANTED.iter().find(|(tag, _)| *tag == element.tag).map(|(_, kind)| **kind);
        let kind = element.kind.filter(|kind| kind != b"UN").or(own_kind).unwrap_or(*b"UN");
        match sequences {
            [] => {
                let numbers = numbers(kind, endian, &bytes);
                self.place.take(element.tag, &numbers);
                self.take(element.tag, &bytes, &numbers);
            }
            [SEGMENTS] => self.take_segment(element.tag, &bytes, &numbers(kind, endian, &bytes)),
            // The first of several mappings counts.
            [.., REAL_WORLD, UNIT_CODES] if element.tag == 0x0008_0100 && self.real_unit.is_empty() => {
                self.real_unit = text(&bytes);
            }
            [.., REAL_WORLD, UNIT_CODES] => {}
            [REAL_WORLD] => self.place.take(element.tag, &numbers(kind, endian, &bytes)),
            [SHARED, _] => self.shared.take(element.tag, &numbers(kind, endian, &bytes)),
            [PER_FRAME, _] => {
                if let Some(frame) = self.frames.last_mut() {
                    frame.take(element.tag, &numbers(kind, endian, &bytes));
                }
            }
            _ => {}
        }
    }
}

impl Header {
    fn take(&mut self, tag: u32, bytes: &[u8], numbers: &[f64]) {
        let first = numbers.first().copied();
        // A 16-bit unsigned integer, or 0.
        let word = low_32(cast::whole::<u64>(first.filter(|n| (0.0..=65_535.0).contains(n)).unwrap_or_default()));
        let image = &mut self.image;
        match tag {
            0x0008_0060 => self.modality = text(bytes),
            0x0008_103e => self.description = text(bytes),
            0x0020_000e => self.series_uid = text(bytes),
            0x0020_0011 => self.series_number = first.map(cast::whole::<i64>),
            0x0020_0013 => self.instance = cast::whole::<i64>(first.unwrap_or_default()),
            0x0028_0002 => image.samples = word,
            0x0028_0004 => image.photometric = text(bytes),
            0x0028_0006 => image.is_planar = word == 1,
            // An empty number of frames means one.
            0x0028_0008 => self.frame_count = first.map_or(1, cast::whole::<u64>),
            0x0028_0010 => image.rows = word,
            0x0028_0011 => image.columns = word,
            0x0028_0100 => image.allocated = word,
            0x0028_0101 => image.stored = word,
            0x0028_0102 => image.high = word,
            0x0028_0103 => image.is_signed = word == 1,
            0x0028_0120 => self.take_padding(first),
            0x0028_1054 | 0x0054_1001 | 0x3004_0002 => self.unit = text(bytes),
            0x3004_000c => self.offsets = numbers.to_vec(),
            _ => {}
        }
    }

    /// Takes the number or the label of a segment; numbers precede labels.
    fn take_segment(&mut self, tag: u32, bytes: &[u8], numbers: &[f64]) {
        match (tag, numbers.first()) {
            (0x0062_0004, Some(number)) if (self.segments.len() as u64) < FRAMES_LIMIT => {
                self.segments.push((*number, String::new()));
            }
            (0x0062_0005, _) => {
                if let Some((_, label)) = self.segments.last_mut() {
                    *label = text(bytes);
                }
            }
            _ => {}
        }
    }

    /// Takes the padding value, with the sign of the pixels, in any representation that the file states. 0 is ignored:
    /// some scanners state it although their images have air of that value, so a patient would get holes.
    fn take_padding(&mut self, number: Option<f64>) {
        let Some(number) = number.filter(|n| !n.is_nan()) else { return };
        let whole = cast::whole::<i64>(number);
        let word = u16::try_from(whole).or_else(|_| i16::try_from(whole).map(i16::cast_unsigned));
        let Ok(word) = word else {
            self.wrong_padding = Some(number);
            return;
        };
        let padding = if self.image.is_signed { f64::from(word.cast_signed()) } else { f64::from(word) };
        self.padding = Some(padding).filter(|padding| *padding != 0.0);
    }
}

/// Text without its padding.
fn text(bytes: &[u8]) -> String {
    shortened(String::from_utf8_lossy(bytes).trim_matches(['\0', ' ']))
}

/// The numbers of a value; a text that is not a number becomes NaN.
fn numbers(kind: [u8; 2], endian: Endian, bytes: &[u8]) -> Vec<f64> {
    fn all<const N: usize>(bytes: &[u8], endian: Endian, number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        bytes.as_chunks::<N>().0.iter().map(|&word| in_order(word, endian, &number)).collect()
    }
    match &kind {
        b"US" => all(bytes, endian, |b| u16::from_le_bytes(b).into()),
        b"SS" => all(bytes, endian, |b| i16::from_le_bytes(b).into()),
        b"UL" => all(bytes, endian, |b| u32::from_le_bytes(b).into()),
        b"SL" => all(bytes, endian, |b| i32::from_le_bytes(b).into()),
        b"FL" => all(bytes, endian, |b| f32::from_le_bytes(b).into()),
        b"FD" => all(bytes, endian, f64::from_le_bytes),
        _ => {
            let text = String::from_utf8_lossy(bytes);
            let text = text.trim_matches(['\0', ' ']);
            if text.is_empty() {
                return Vec::new();
            }
            text.split('\\').map(|number| number.trim().parse().unwrap_or(f64::NAN)).collect()
        }
    }
}
