//! Parser for the elements of a DICOM data set: tag, value representation, length, value; nested sequences of items.
//!
//! Format: PS3.5, sections 7 and 8. Only requested values of at most [`VALUE_LIMIT_BYTES`] are read; all others are
//! skipped. Parsing ends at the pixel data and returns its position; the pixels themselves are not read.
//! Written by hand, because `dicom-object` reads whole data sets into memory. `dicom-parser` below it does not return
//! the positions of values without reading them, allocates what a length claims, and panics at a misplaced delimiter.

use std::io::{self, BufReader, Read, Seek, SeekFrom};

use crate::Endian;

/// Longest value that is read, in bytes. The longest requested one is an offset table of tens of thousands of frames.
pub(super) const VALUE_LIMIT_BYTES: u32 = 2 << 20;
/// Largest depth of nested sequences that are parsed.
const DEPTH_LIMIT: usize = 16;

/// Length of the group that begins a file.
const GROUP_LENGTH: u32 = 0x0002_0000;
const ITEM: u32 = 0xfffe_e000;
const ITEM_END: u32 = 0xfffe_e00d;
const SEQUENCE_END: u32 = 0xfffe_e0dd;
/// Pixel data as integers, as 32-bit floats and as 64-bit floats.
pub(super) const PIXEL_DATA: u32 = 0x7fe0_0010;
pub(super) const FLOAT_PIXEL_DATA: u32 = 0x7fe0_0008;
pub(super) const DOUBLE_PIXEL_DATA: u32 = 0x7fe0_0009;

/// Value representations with a length of four bytes, behind two reserved bytes.
const LONG_KINDS: [&[u8; 2]; 13] =
    [b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV"];

/// Encoding of the elements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Spelling {
    pub(super) endian: Endian,
    /// Whether each element states its value representation.
    pub(super) is_explicit: bool,
}

impl Spelling {
    pub(super) const EXPLICIT: Self = Self { endian: Endian::Little, is_explicit: true };
    pub(super) const IMPLICIT: Self = Self { endian: Endian::Little, is_explicit: false };
}

/// Reason why parsing of a data set failed.
#[derive(Debug)]
pub(super) enum Fault {
    Io(io::Error),
    /// Byte position, and the defect there.
    Wrong(u64, &'static str),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// Header of an element; its value follows in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Element {
    /// Group and element number.
    pub(super) tag: u32,
    /// Value representation, if the element states it.
    pub(super) kind: Option<[u8; 2]>,
    /// Length of the value in bytes; `None`: up to a delimiter.
    pub(super) length: Option<u32>,
}

/// Position of the pixel data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PixelsAt {
    pub(super) tag: u32,
    /// Offset of the value in bytes.
    pub(super) offset: u64,
    /// Length in bytes; `None`: fragments up to a delimiter.
    pub(super) length: Option<u32>,
}

/// Receiver of the elements of a data set.
pub(super) trait Visitor {
    /// Whether the value of this element, inside these sequences, is requested.
    fn wants(&self, sequences: &[u32], tag: u32) -> bool;
    /// Receives a requested value.
    fn value(&mut self, sequences: &[u32], element: Element, endian: Endian, bytes: Vec<u8>);
    /// An item of these sequences begins.
    fn item(&mut self, sequences: &[u32]);
}

/// Parser of the elements of a file from a position on.
pub(super) struct DataSet<R> {
    from: BufReader<R>,
    at: u64,
    end: u64,
    sequences: Vec<u32>,
}

impl<R: Read + Seek> DataSet<R> {
    /// Parser from byte `at` on, in a file of `end` bytes.
    pub(super) fn new(mut from: R, at: u64, end: u64) -> io::Result<Self> {
        from.seek(SeekFrom::Start(at))?;
        Ok(Self { from: BufReader::with_capacity(16 << 10, from), at, end, sequences: Vec::new() })
    }

    /// Parses the meta information group at the beginning of the file; returns the position behind it.
    pub(super) fn visit_group_2(&mut self, visitor: &mut impl Visitor) -> Result<u64, Fault> {
        let mut end = self.end;
        while self.at + 8 <= end {
            let tag = self.tag(Endian::Little)?;
            if tag >> 16 != 2 {
                return Ok(self.at - 4);
            }
            let element = self.element_of(tag, Spelling::EXPLICIT)?;
            if tag == GROUP_LENGTH && element.length == Some(4) {
                let length = self.u32(Endian::Little)?;
                end = self.end.min(self.at + u64::from(length));
                continue;
            }
            self.value_of(element, Spelling::EXPLICIT, visitor)?;
        }
        Ok(self.at)
    }

    /// Parses all elements up to the pixel data and returns its position; `None` if there is none.
    pub(super) fn visit(&mut self, spelling: Spelling, visitor: &mut impl Visitor) -> Result<Option<PixelsAt>, Fault> {
        self.elements(spelling, Some(self.end), visitor)
    }

    /// Parses elements up to a position, or up to the end of an item.
    fn elements(
        &mut self,
        spelling: Spelling,
        end: Option<u64>,
        visitor: &mut impl Visitor,
    ) -> Result<Option<PixelsAt>, Fault> {
        // A rest shorter than the eight bytes of an element is padding.
        while self.at + 8 <= end.unwrap_or(self.end) {
            let element = self.element(spelling)?;
            match element.tag {
                ITEM_END if end.is_none() => return Ok(None),
                ITEM_END | ITEM | SEQUENCE_END => return Err(Fault::Wrong(self.at - 8, "a delimiter out of place")),
                PIXEL_DATA | FLOAT_PIXEL_DATA | DOUBLE_PIXEL_DATA if self.sequences.is_empty() => {
                    return Ok(Some(PixelsAt { tag: element.tag, offset: self.at, length: element.length }));
                }
                _ => self.value_of(element, spelling, visitor)?,
            }
        }
        if end.is_none() {
            return Err(Fault::Wrong(self.at, "the end of the file inside an item"));
        }
        Ok(None)
    }

    fn value_of(&mut self, element: Element, spelling: Spelling, visitor: &mut impl Visitor) -> Result<(), Fault> {
        let is_wanted = visitor.wants(&self.sequences, element.tag);
        // Elements that are not requested are skipped by their length, if they have one.
        let is_sequence = match element.kind {
            _ if element.length.is_none() => true,
            Some(kind) => is_wanted && &kind == b"SQ",
            None => is_wanted && self.is_at_item(spelling)?,
        };
        if is_sequence {
            // Sequences of unknown representation are encoded without representations.
            let is_unknown = element.kind.is_some_and(|kind| &kind == b"UN");
            let inside = if is_unknown { Spelling::IMPLICIT } else { spelling };
            return self.sequence(element, inside, visitor);
        }
        let Some(length) = element.length else { return Err(Fault::Wrong(self.at, "a value without a length")) };
        if u64::from(length) > self.end - self.at {
            return Err(Fault::Wrong(self.at, "a value that ends behind the file"));
        }
        if is_wanted && length <= VALUE_LIMIT_BYTES {
            let mut bytes = vec![0; length as usize];
            self.read(&mut bytes)?;
            visitor.value(&self.sequences, element, spelling.endian, bytes);
            return Ok(());
        }
        self.skip(length)
    }

    fn sequence(&mut self, element: Element, spelling: Spelling, visitor: &mut impl Visitor) -> Result<(), Fault> {
        if self.sequences.len() == DEPTH_LIMIT {
            return Err(Fault::Wrong(self.at, "sequences too deep inside one another"));
        }
        let end = element.length.map(|length| self.at + u64::from(length));
        if end.is_some_and(|end| end > self.end) {
            return Err(Fault::Wrong(self.at, "a sequence that ends behind the file"));
        }
        self.sequences.push(element.tag);
        while end.is_none_or(|end| self.at < end) {
            let item = self.element(spelling)?;
            match (item.tag, item.length) {
                (SEQUENCE_END, _) if end.is_none() => break,
                (ITEM, length) => {
                    let item_end = length.map(|length| self.at + u64::from(length));
                    if item_end.is_some_and(|item_end| item_end > end.unwrap_or(self.end)) {
                        return Err(Fault::Wrong(self.at, "an item that ends behind its sequence"));
                    }
                    visitor.item(&self.sequences);
                    if self.elements(spelling, item_end, visitor)?.is_some() {
                        return Err(Fault::Wrong(self.at, "pixels inside a sequence"));
                    }
                    if let Some(item_end) = item_end {
                        let left = item_end.checked_sub(self.at).and_then(|left| u32::try_from(left).ok());
                        self.skip(left.ok_or(Fault::Wrong(self.at, "a value that ends behind its item"))?)?;
                    }
                }
                _ => return Err(Fault::Wrong(self.at - 8, "no item inside a sequence")),
            }
        }
        self.sequences.pop();
        Ok(())
    }

    /// Whether the next four bytes begin an item.
    fn is_at_item(&mut self, spelling: Spelling) -> Result<bool, Fault> {
        if self.end - self.at < 8 {
            return Ok(false);
        }
        let tag = self.tag(spelling.endian)?;
        self.from.seek_relative(-4)?;
        self.at -= 4;
        Ok(tag == ITEM)
    }

    fn element(&mut self, spelling: Spelling) -> Result<Element, Fault> {
        let tag = self.tag(spelling.endian)?;
        self.element_of(tag, spelling)
    }

    /// The element whose tag has been read.
    fn element_of(&mut self, tag: u32, spelling: Spelling) -> Result<Element, Fault> {
        // Delimiters have a length and no representation in every encoding.
        if !spelling.is_explicit || tag >> 16 == 0xfffe {
            let length = self.u32(spelling.endian)?;
            return Ok(Element { tag, kind: None, length: defined(length) });
        }
        let kind: [u8; 2] = self.bytes()?;
        if !kind.iter().all(u8::is_ascii_uppercase) {
            return Err(Fault::Wrong(self.at - 2, "no kind of value (two capital letters)"));
        }
        let length = if LONG_KINDS.contains(&&kind) {
            self.bytes::<2>()?;
            self.u32(spelling.endian)?
        } else {
            u32::from(in_order(self.bytes::<2>()?, spelling.endian, u16::from_le_bytes))
        };
        Ok(Element { tag, kind: Some(kind), length: defined(length) })
    }

    fn tag(&mut self, endian: Endian) -> Result<u32, Fault> {
        let mut half = || -> Result<u32, Fault> { Ok(in_order(self.bytes::<2>()?, endian, u16::from_le_bytes).into()) };
        Ok(half()? << 16 | half()?)
    }

    fn u32(&mut self, endian: Endian) -> Result<u32, Fault> {
        Ok(in_order(self.bytes::<4>()?, endian, u32::from_le_bytes))
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut bytes = [0; N];
        self.read(&mut bytes)?;
        Ok(bytes)
    }

    fn read(&mut self, bytes: &mut [u8]) -> Result<(), Fault> {
        let begun = self.at;
        self.from.read_exact(bytes).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => Fault::Wrong(begun, "the end of the file inside an element"),
            _ => Fault::Io(e),
        })?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    fn skip(&mut self, bytes: u32) -> Result<(), Fault> {
        self.from.seek_relative(bytes.into())?;
        self.at += u64::from(bytes);
        Ok(())
    }

    /// Positions and lengths of the pixel fragments that begin here, the offset table first.
    pub(super) fn fragments(&mut self, most: usize) -> Result<Vec<(u64, u32)>, Fault> {
        let mut found = Vec::new();
        loop {
            let item = self.element(Spelling::EXPLICIT)?;
            match (item.tag, item.length) {
                (SEQUENCE_END, _) => return Ok(found),
                (ITEM, Some(length)) if u64::from(length) <= self.end - self.at => {
                    found.push((self.at, length));
                    self.skip(length)?;
                }
                _ => return Err(Fault::Wrong(self.at - 8, "no fragment of pixels")),
            }
            // Some writers omit the last delimiter.
            if self.at == self.end {
                return Ok(found);
            }
            if found.len() > most {
                return Err(Fault::Wrong(self.at, "more fragments of pixels than are read"));
            }
        }
    }
}

fn defined(length: u32) -> Option<u32> {
    (length != u32::MAX).then_some(length)
}

/// Converts bytes of either order to a number.
pub(super) fn in_order<const N: usize, T>(mut bytes: [u8; N], endian: Endian, of_little: impl Fn([u8; N]) -> T) -> T {
    if endian == Endian::Big {
        bytes.reverse();
    }
    of_little(bytes)
}
