//! The header of a legacy file: lines of words, and arrays between them.

use std::io::{BufRead, Read, Seek};
use std::path::Path;

use supervol_format::{Dims, Geometry, VoxelType};

use super::header::{ARRAYS_LIMIT, Array, Encoding, Header};
use crate::grid::elements::Number;
use crate::input::text::shortened;
use crate::{Endian, SourceError};

/// Longest line in bytes.
const LINE_LIMIT_BYTES: u64 = 4096;
/// Largest number of lines of a header.
const LINES_LIMIT: usize = 65_536;

/// Lines of the file, with the current offset.
struct Lines<'a, R> {
    path: &'a Path,
    reader: R,
    at: u64,
    count: usize,
}

impl<R: BufRead + Seek> Lines<'_, R> {
    /// Words of the next non-empty line; empty at the end of the file.
    fn words(&mut self) -> Result<Vec<String>, SourceError> {
        loop {
            let line = self.line()?;
            match line {
                None => return Ok(Vec::new()),
                Some(line) if line.trim().is_empty() => {}
                Some(line) => return Ok(line.split_whitespace().map(str::to_owned).collect()),
            }
        }
    }

    fn line(&mut self) -> Result<Option<String>, SourceError> {
        let mut line = Vec::new();
        let mut limited = Read::take(&mut self.reader, LINE_LIMIT_BYTES);
        let count = limited.read_until(b'\n', &mut line).map_err(|e| SourceError::io(self.path, e))?;
        self.at += count as u64;
        self.count += 1;
        if self.count > LINES_LIMIT || count as u64 == LINE_LIMIT_BYTES {
            let found = format!("`{}`", shortened(&String::from_utf8_lossy(&line)));
            return Err(SourceError::invalid(self.path, "header", "lines of words, and not too many", found));
        }
        Ok((count > 0).then(|| String::from_utf8_lossy(&line).into_owned()))
    }

    fn pass_over(&mut self, bytes: u64) -> Result<(), SourceError> {
        let offset = i64::try_from(bytes).unwrap_or(i64::MAX);
        self.reader.seek_relative(offset).map_err(|e| SourceError::io(self.path, e))?;
        self.at = self.at.saturating_add(bytes);
        Ok(())
    }
}

pub(super) fn read(path: &Path, reader: impl BufRead + Seek) -> Result<Header, SourceError> {
    let mut lines = Lines { path, reader, at: 0, count: 0 };
    // The first two lines, mark and title, are not needed.
    lines.line()?;
    lines.line()?;
    let encoding = match lines.words()?.first().map(|word| word.to_uppercase()).as_deref() {
        Some("BINARY") => Encoding::Raw,
        Some("ASCII") => Encoding::Text,
        other => {
            let found = shortened(other.unwrap_or("nothing"));
            return Err(SourceError::invalid(path, "third line", "BINARY or ASCII", found));
        }
    };
    let kind = lines.words()?.get(1).map(|word| word.to_uppercase()).unwrap_or_default();
    if kind != "STRUCTURED_POINTS" {
        let advice = "resample it to an image first, for example with ParaView (Resample To Image; Save Data, .vti)";
        return Err(SourceError::unsupported(path, format!("it holds no image but {}", shortened(&kind)), advice));
    }
    let header = Header {
        points: [0; 3],
        first: [0; 3],
        geometry: Geometry::IDENTITY,
        // On every machine.
        endian: Endian::Big,
        arrays: Vec::new(),
        blocks: None,
    };
    let mut reading = Reading { path, header, encoding, is_of_cells: false, tuples: 0 };
    loop {
        let words = lines.words()?;
        if words.is_empty() || !reading.take(&words, &mut lines)? {
            break;
        }
    }
    if reading.header.points == [0; 3] {
        return Err(SourceError::invalid(path, "header", "a line DIMENSIONS", "none"));
    }
    reading.header.turn_negative_axes();
    Ok(reading.header)
}

struct Reading<'a> {
    path: &'a Path,
    header: Header,
    encoding: Encoding,
    is_of_cells: bool,
    /// Number of points or cells.
    tuples: u64,
}

impl Reading<'_> {
    /// Handles a line; false if nothing behind it can be found.
    fn take(&mut self, words: &[String], lines: &mut Lines<'_, impl BufRead + Seek>) -> Result<bool, SourceError> {
        let word = |i: usize| words.get(i).map(String::as_str).unwrap_or_default();
        match word(0).to_uppercase().as_str() {
            "DIMENSIONS" => {
                self.header.points = self.numbers(words)?;
                let is_allowed = |n: &u64| (1..=Dims::LIMIT).contains(n);
                if !self.header.points.iter().all(is_allowed) {
                    return Err(self.wrong(words, "three numbers of points"));
                }
            }
            "SPACING" | "ASPECT_RATIO" => self.header.geometry.spacing = self.numbers(words)?,
            "ORIGIN" => self.header.geometry.origin = self.numbers(words)?,
            "POINT_DATA" | "CELL_DATA" => {
                self.is_of_cells = word(0).eq_ignore_ascii_case("CELL_DATA");
                self.tuples = self.numbers::<u64, 1>(words)?[0];
            }
            "SCALARS" => {
                let components = word(3).parse().unwrap_or(1);
                // The name of a colour table may follow; the table itself is defined elsewhere.
                let begun = lines.at;
                let next = lines.words()?;
                let is_table = next.first().is_some_and(|first| first.eq_ignore_ascii_case("LOOKUP_TABLE"));
                let at = if is_table { lines.at } else { begun };
                lines.reader.seek(std::io::SeekFrom::Start(at)).map_err(|e| SourceError::io(self.path, e))?;
                lines.at = at;
                return self.array(words, word(1), word(2), components, lines);
            }
            "VECTORS" | "NORMALS" => return self.array(words, word(1), word(2), 3, lines),
            "TENSORS" => return self.array(words, word(1), word(2), 9, lines),
            // VTK's own writer uses this for all u8 volumes.
            "COLOR_SCALARS" => {
                let components = word(2).parse().unwrap_or(1);
                let is_followed = self.array(words, word(1), "unsigned_char", components, lines)?;
                if let Some(array) = self.header.arrays.last_mut().filter(|array| array.encoding == Encoding::Text) {
                    array.encoding = Encoding::Shares;
                }
                return Ok(is_followed);
            }
            "FIELD" => {
                let count: usize = word(2).parse().unwrap_or(0);
                for _ in 0..count.min(ARRAYS_LIMIT) {
                    let words = lines.words()?;
                    let [name, components, tuples, kind] = &words[..] else { return Ok(false) };
                    if tuples.parse() != Ok(self.tuples) {
                        return Ok(false);
                    }
                    let components = components.parse().unwrap_or(1);
                    if !self.array(&words, name, kind, components, lines)? {
                        return Ok(false);
                    }
                }
            }
            "METADATA" => while lines.line()?.is_some_and(|line| !line.trim().is_empty()) {},
            // An unknown entry with its own data.
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Handles an array that begins here; false if its end is unknown.
    fn array(
        &mut self,
        words: &[String],
        name: &str,
        kind: &str,
        components: u64,
        lines: &mut Lines<'_, impl BufRead + Seek>,
    ) -> Result<bool, SourceError> {
        let Some(number) = number(&kind.to_lowercase()) else {
            return Err(self.wrong(words, "a type of whole bytes, such as unsigned_char or float"));
        };
        let points = self.header.points.iter().map(|n| n - u64::from(self.is_of_cells && *n > 1));
        let tuples = points.fold(1u64, |product, n| product.saturating_mul(n));
        if self.header.points == [0; 3] || tuples != self.tuples {
            let expected = format!("{tuples} of them, as DIMENSIONS says");
            return Err(SourceError::invalid(self.path, "points or cells", expected, self.tuples.to_string()));
        }
        if self.header.arrays.len() == ARRAYS_LIMIT {
            return Err(SourceError::invalid(self.path, "arrays", format!("at most {ARRAYS_LIMIT}"), "more"));
        }
        let is_colour = number == Number::Voxel(VoxelType::U8) && (3..=4).contains(&components);
        self.header.arrays.push(Array {
            name: name.into(),
            number,
            components: components.max(1),
            is_of_cells: self.is_of_cells,
            is_active: false,
            is_colour,
            encoding: self.encoding,
            offset: lines.at,
        });
        if self.encoding == Encoding::Text {
            return Ok(false);
        }
        let bytes = tuples.saturating_mul(components.max(1)).saturating_mul(number.stored().bytes() as u64);
        lines.pass_over(bytes)?;
        Ok(true)
    }

    fn wrong(&self, words: &[String], expected: &str) -> SourceError {
        SourceError::invalid(self.path, "header", expected, format!("`{}`", shortened(&words.join(" "))))
    }

    fn numbers<T: std::str::FromStr, const N: usize>(&self, words: &[String]) -> Result<[T; N], SourceError> {
        let parsed: Option<Vec<T>> = words.iter().skip(1).map(|word| word.parse().ok()).collect();
        let numbers = parsed.and_then(|numbers| numbers.try_into().ok());
        numbers.ok_or_else(|| self.wrong(words, &format!("{N} numbers behind the word")))
    }
}

fn number(name: &str) -> Option<Number> {
    Some(match name {
        "char" | "signed_char" => Number::Voxel(VoxelType::I8),
        "unsigned_char" => Number::Voxel(VoxelType::U8),
        "short" => Number::Voxel(VoxelType::I16),
        "unsigned_short" => Number::Voxel(VoxelType::U16),
        "int" => Number::Voxel(VoxelType::I32),
        "unsigned_int" => Number::Voxel(VoxelType::U32),
        // Eight bytes on every machine that writes such files today.
        "long" | "vtktypeint64" => Number::Whole { signed: true },
        "unsigned_long" | "vtktypeuint64" => Number::Whole { signed: false },
        "float" => Number::Voxel(VoxelType::F32),
        "double" => Number::Voxel(VoxelType::F64),
        _ => return None,
    })
}
