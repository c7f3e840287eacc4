//! The header of a `.vti`: tags up to the appended data. Text between tags is skipped and never held in memory.

use std::collections::HashMap;
use std::io::BufRead;
use std::path::Path;

use quick_xml::XmlVersion;
use quick_xml::events::BytesStart;
use supervol_format::{Dims, Geometry, VoxelType};

use super::header::{ARRAYS_LIMIT, Array, Blocks, Compressor, Encoding, Header};
use crate::cast::signed;
use crate::grid::elements::Number;
use crate::input::text::shortened;
use crate::{Endian, SourceError};

/// Longest tag in bytes.
const TAG_LIMIT_BYTES: usize = 64 << 10;

/// Tags of a text, one after the other.
struct Tags<'a, R> {
    path: &'a Path,
    reader: R,
    /// Number of bytes read so far.
    at: u64,
}

/// An opening or self-closing tag.
struct Tag {
    name: String,
    attributes: HashMap<String, String>,
}

impl Tag {
    fn get(&self, name: &str) -> Option<&str> {
        self.attributes.get(name).map(String::as_str)
    }

    fn wrong(&self, path: &Path, name: &str, expected: &str) -> SourceError {
        let found = self.get(name).map_or("none".into(), |text| format!("`{}`", shortened(text)));
        SourceError::invalid(path, format!("attribute {name} of {}", self.name), expected, found)
    }

    /// Numbers of an attribute, exactly `N` of them.
    fn numbers<T: std::str::FromStr, const N: usize>(&self, path: &Path, name: &str) -> Result<[T; N], SourceError> {
        let parsed = self.get(name).map(|text| text.split_whitespace().map(|word| word.parse().ok()).collect());
        let numbers: Option<Vec<T>> = parsed.flatten();
        let numbers = numbers.and_then(|numbers| numbers.try_into().ok());
        numbers.ok_or_else(|| self.wrong(path, name, &format!("{N} numbers")))
    }
}

impl<R: BufRead> Tags<'_, R> {
    /// The next opening or self-closing tag, or `None` at the end.
    fn next(&mut self) -> Result<Option<Tag>, SourceError> {
        loop {
            if !self.pass_over(b'<')? {
                return Ok(None);
            }
            let mut text = Vec::new();
            // A comment ends with `-->`, every other tag at the first `>`.
            loop {
                let begun = text.len();
                let limit = (TAG_LIMIT_BYTES - begun) as u64;
                let read = std::io::Read::take(&mut self.reader, limit).read_until(b'>', &mut text);
                let read = read.map_err(|e| SourceError::io(self.path, e))?;
                self.at += read as u64;
                // A comment may be unterminated.
                if read == 0 || text.last() != Some(&b'>') {
                    let found = format!("`{}`", shortened(&String::from_utf8_lossy(&text)));
                    return Err(SourceError::invalid(self.path, "XML", "tags of at most 64 KiB", found));
                }
                if !text.starts_with(b"!--") || text.ends_with(b"-->") {
                    break;
                }
            }
            text.pop();
            if text.first().is_none_or(|first| b"?!/".contains(first)) {
                continue;
            }
            let text = String::from_utf8_lossy(&text);
            let text = text.trim_end_matches('/');
            let name_bytes = text.find(|c: char| c.is_whitespace()).unwrap_or(text.len());
            let mut attributes = HashMap::new();
            for attribute in BytesStart::from_content(text, name_bytes).attributes() {
                let wrong = |found: String| SourceError::invalid(self.path, "XML", "attributes", shortened(&found));
                let attribute = attribute.map_err(|e| wrong(e.to_string()))?;
                let value = attribute.normalized_value(XmlVersion::Implicit1_0).map_err(|e| wrong(e.to_string()))?;
                attributes.insert(attribute.key.local_name().as_ref().to_owned(), value.into_owned());
            }
            return Ok(Some(Tag { name: text[..name_bytes].to_owned(), attributes }));
        }
    }

    /// Skips everything up to and including a byte; false if it does not occur.
    fn pass_over(&mut self, wanted: u8) -> Result<bool, SourceError> {
        loop {
            let available = self.reader.fill_buf().map_err(|e| SourceError::io(self.path, e))?;
            if available.is_empty() {
                return Ok(false);
            }
            let place = available.iter().position(|byte| *byte == wanted);
            let used = place.map_or(available.len(), |place| place + 1);
            self.reader.consume(used);
            self.at += used as u64;
            if place.is_some() {
                return Ok(true);
            }
        }
    }
}

/// Current section of the file.
#[derive(Debug, Clone, PartialEq)]
enum Section {
    /// Outside the grid; arrays here are ignored.
    Elsewhere,
    /// Arrays of points or of cells, and the name of the active one.
    Data { is_of_cells: bool, active: Option<String> },
}

/// State of the parser.
struct Reading {
    header: Header,
    section: Section,
    pieces: usize,
    /// Indices of the arrays in the appended data.
    appended: Vec<usize>,
}

pub(super) fn read(path: &Path, reader: impl BufRead) -> Result<Header, SourceError> {
    let mut tags = Tags { path, reader, at: 0 };
    let first = tags.next()?.filter(|tag| tag.name == "VTKFile");
    let first = first.ok_or_else(|| SourceError::invalid(path, "XML", "an element VTKFile", "none"))?;
    let mut reading =
        Reading { header: begin(path, &first)?, section: Section::Elsewhere, pieces: 0, appended: Vec::new() };
    while let Some(tag) = tags.next()? {
        if tag.name == "AppendedData" {
            let encoding = match tag.get("encoding") {
                Some("raw") => Encoding::Raw,
                Some("base64") => Encoding::Base64,
                _ => return Err(tag.wrong(path, "encoding", "raw or base64")),
            };
            if !tags.pass_over(b'_')? {
                return Err(SourceError::invalid(path, "AppendedData", "a mark `_`", "none"));
            }
            for number in &reading.appended {
                let array = &mut reading.header.arrays[*number];
                array.encoding = encoding;
                array.offset = array.offset.saturating_add(tags.at);
            }
            return reading.finish(path);
        }
        reading.take(path, &tag, tags.at)?;
    }
    if let Some(number) = reading.appended.first() {
        let name = &reading.header.arrays[*number].name;
        return Err(SourceError::invalid(path, format!("array `{name}`"), "an element AppendedData", "none"));
    }
    reading.finish(path)
}

/// Handles the first element.
fn begin(path: &Path, tag: &Tag) -> Result<Header, SourceError> {
    let unsupported = |what: String, advice: &str| Err(SourceError::unsupported(path, what, advice));
    match tag.get("type") {
        Some("ImageData") => {}
        Some("PImageData") => {
            let advice = "write it as one piece first, for example with ParaView (Save Data, .vti)";
            return unsupported("it lists the pieces of an image (.pvti), which are not read together".into(), advice);
        }
        Some(other) => {
            let advice =
                "resample it to an image first, for example with ParaView (Resample To Image; Save Data, .vti)";
            return unsupported(format!("it holds no image but a {}", shortened(other)), advice);
        }
        None => return Err(tag.wrong(path, "type", "ImageData")),
    }
    let compressor = match tag.get("compressor") {
        None => None,
        Some("vtkZLibDataCompressor") => Some(Compressor::Zlib),
        Some("vtkLZ4DataCompressor") => Some(Compressor::Lz4),
        Some(other) => {
            let advice = "write it with zlib or LZ4 first: ParaView, Save Data, Compressor Type";
            return unsupported(
                format!("its arrays are compressed by {}, which is not read", shortened(other)),
                advice,
            );
        }
    };
    let endian = match tag.get("byte_order") {
        Some("LittleEndian") | None => Endian::Little,
        Some("BigEndian") => Endian::Big,
        _ => return Err(tag.wrong(path, "byte_order", "LittleEndian or BigEndian")),
    };
    let word_bytes = match tag.get("header_type") {
        Some("UInt32") | None => 4,
        Some("UInt64") => 8,
        _ => return Err(tag.wrong(path, "header_type", "UInt32 or UInt64")),
    };
    Ok(Header {
        points: [0; 3],
        first: [0; 3],
        geometry: Geometry::IDENTITY,
        endian,
        arrays: Vec::new(),
        blocks: Some(Blocks { word_bytes, compressor }),
    })
}

impl Reading {
    fn take(&mut self, path: &Path, tag: &Tag, at: u64) -> Result<(), SourceError> {
        match tag.name.as_str() {
            "ImageData" => self.image(path, tag),
            "Piece" => self.piece(path, tag),
            "PointData" | "CellData" => {
                let is_of_cells = tag.name == "CellData";
                self.section = Section::Data { is_of_cells, active: tag.get("Scalars").map(str::to_owned) };
                Ok(())
            }
            "FieldData" => {
                self.section = Section::Elsewhere;
                Ok(())
            }
            "DataArray" => self.array(path, tag, at),
            _ => Ok(()),
        }
    }

    fn image(&mut self, path: &Path, tag: &Tag) -> Result<(), SourceError> {
        let extent: [i64; 6] = tag.numbers(path, "WholeExtent")?;
        let header = &mut self.header;
        for axis in 0..3 {
            let count = extent[2 * axis + 1].checked_sub(extent[2 * axis]).and_then(|n| n.checked_add(1));
            let count = count.and_then(|n| u64::try_from(n).ok()).filter(|n| (1..=Dims::LIMIT).contains(n));
            header.points[axis] = count.ok_or_else(|| tag.wrong(path, "WholeExtent", "three ranges of points"))?;
            header.first[axis] = extent[2 * axis];
        }
        if tag.get("Origin").is_some() {
            header.geometry.origin = tag.numbers(path, "Origin")?;
        }
        if tag.get("Spacing").is_some() {
            header.geometry.spacing = tag.numbers(path, "Spacing")?;
        }
        if tag.get("Direction").is_some() {
            header.geometry.direction = tag.numbers(path, "Direction")?;
        }
        header.turn_negative_axes();
        Ok(())
    }

    fn piece(&mut self, path: &Path, tag: &Tag) -> Result<(), SourceError> {
        self.pieces += 1;
        let extent: [i64; 6] = tag.numbers(path, "Extent")?;
        let whole =
            |i: usize| self.header.first[i / 2] + if i % 2 == 1 { signed(self.header.points[i / 2]) - 1 } else { 0 };
        if self.pieces > 1 || (0..6).any(|i| extent[i] != whole(i)) {
            let advice = "write it as one piece first, for example with ParaView (Save Data, .vti)";
            return Err(SourceError::unsupported(path, "the image is in several pieces", advice));
        }
        Ok(())
    }

    fn array(&mut self, path: &Path, tag: &Tag, at: u64) -> Result<(), SourceError> {
        let Section::Data { is_of_cells, active } = &self.section else { return Ok(()) };
        if self.header.arrays.len() == ARRAYS_LIMIT {
            return Err(SourceError::invalid(path, "arrays", format!("at most {ARRAYS_LIMIT}"), "more"));
        }
        let name = tag.get("Name").unwrap_or_default().to_owned();
        // Text and other arrays that are not numbers are ignored.
        let Some(number) = tag.get("type").and_then(number) else { return Ok(()) };
        let components: [u64; 1] = match tag.get("NumberOfComponents") {
            None | Some("") => [1],
            Some(_) => tag.numbers(path, "NumberOfComponents")?,
        };
        let (encoding, offset) = match tag.get("format") {
            Some("appended") => {
                self.appended.push(self.header.arrays.len());
                let [offset] = tag.numbers::<u64, 1>(path, "offset")?;
                (Encoding::Raw, offset)
            }
            Some("binary") => (Encoding::Base64, at),
            Some("ascii") | None => (Encoding::Text, at),
            _ => return Err(tag.wrong(path, "format", "appended, binary or ascii")),
        };
        let is_active = active.as_deref() == Some(name.as_str());
        let (is_of_cells, components) = (*is_of_cells, components[0].max(1));
        let is_colour = number == Number::Voxel(VoxelType::U8) && (3..=4).contains(&components);
        self.header.arrays.push(Array {
            name,
            number,
            components,
            is_of_cells,
            is_active,
            is_colour,
            encoding,
            offset,
        });
        Ok(())
    }

    fn finish(self, path: &Path) -> Result<Header, SourceError> {
        if self.header.points == [0; 3] {
            return Err(SourceError::invalid(path, "XML", "an element ImageData", "none"));
        }
        Ok(self.header)
    }
}

fn number(name: &str) -> Option<Number> {
    Some(match name {
        "Int8" => Number::Voxel(VoxelType::I8),
        "UInt8" => Number::Voxel(VoxelType::U8),
        "Int16" => Number::Voxel(VoxelType::I16),
        "UInt16" => Number::Voxel(VoxelType::U16),
        "Int32" => Number::Voxel(VoxelType::I32),
        "UInt32" => Number::Voxel(VoxelType::U32),
        "Int64" => Number::Whole { signed: true },
        "UInt64" => Number::Whole { signed: false },
        "Float32" => Number::Voxel(VoxelType::F32),
        "Float64" => Number::Voxel(VoxelType::F64),
        _ => return None,
    })
}
