//! Voxels without random access (gzip, zlib, text), decoded once into a temporary file.
//!
//! The temporary file has no name, so it vanishes with the process, even after a crash. Decoding is streaming. It stops
//! at the byte count that the header announces, after a request for one more byte to notice excess. A header that
//! announces more than its file could hold is refused before decoding. The checksum at the end of a stream is checked.

use std::fs::File;
use std::io::{BufRead, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use flate2::bufread::{DeflateDecoder, MultiGzDecoder, ZlibDecoder};
use supervol_format::canceller::Canceller;
use supervol_format::voxel_type::Voxel;
use supervol_format::{VoxelType, with_voxel};

use crate::cast::index;
use crate::error::SourceError;
use crate::stop::check;

/// Buffer size for copying in bytes.
const BUFFER_BYTES: usize = 1 << 18;

/// Largest expansion of a deflate stream (zlib's technical notes: 1032 to 1).
pub(crate) const DEFLATE_RATIO_LIMIT: u64 = 1032;

/// Longest accepted number in a text encoding, in characters.
const TOKEN_LIMIT: usize = 128;

/// Folder for temporary files of decoded voxels.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct SpoolFolder {
    folder: Option<PathBuf>,
    canceller: Canceller,
}

/// Prints the folder alone: options are compared by their debug text.
impl std::fmt::Debug for SpoolFolder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("SpoolFolder").field(&self.folder).finish()
    }
}

impl SpoolFolder {
    /// The system's folder for temporary files.
    #[must_use]
    pub fn system() -> Self {
        Self::default()
    }

    /// This folder. It must exist and have room for the decoded volume.
    #[must_use]
    pub fn at(folder: impl Into<PathBuf>) -> Self {
        Self { folder: Some(folder.into()), ..Self::default() }
    }

    /// The same folder; decoding stops when `canceller` is set.
    #[must_use]
    pub fn unless(self, canceller: Canceller) -> Self {
        Self { canceller, ..self }
    }

    fn path(&self) -> PathBuf {
        self.folder.clone().unwrap_or_else(std::env::temp_dir)
    }
}

/// Reaction of a decoder to more bytes than the header announces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Excess {
    /// An error, found by a request for one more byte.
    Refused,
    /// Expected (further volumes of a series): decoding stops.
    Expected,
}

/// Whether errors may quote the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Words {
    /// The text is in the file that the user has named.
    Shown,
    /// The text is in a file that a header has named. That might be any file, so messages must not reveal its contents.
    Hidden,
}

/// Numbers to read from a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TextNumbers {
    /// Type of the voxels that the numbers become.
    pub voxel_type: VoxelType,
    /// Number of voxels.
    pub voxels: u64,
    /// Whether errors may quote the text.
    pub words: Words,
    /// Reaction to further numbers.
    pub excess: Excess,
}

/// Converts a word to a voxel; false if it is not a number of this type.
type ParseVoxel = fn(&str, VoxelType, &mut [u8]) -> bool;

/// A compressed stream, and the part of it to decode.
#[derive(Debug)]
pub struct GzipShare<'a> {
    /// File of the stream, for messages.
    pub path: &'a Path,
    /// Bytes of the file that are left for the stream.
    pub compressed_bytes: u64,
    /// Decoded bytes to skip first.
    pub skip_bytes: u64,
    /// Decoded bytes to keep.
    pub bytes: u64,
    /// Reaction to further bytes.
    pub excess: Excess,
}

/// A spool file being written.
#[derive(Debug)]
pub struct Spool {
    folder: PathBuf,
    canceller: Canceller,
    file: BufWriter<File>,
}

impl Spool {
    /// Creates an empty spool file in this folder.
    ///
    /// # Errors
    /// If the folder is not writable.
    pub fn create(spool: &SpoolFolder) -> Result<Self, SourceError> {
        let folder = spool.path();
        let file = tempfile::tempfile_in(&folder).map_err(|e| SourceError::spool(&folder, e))?;
        Ok(Self { file: BufWriter::with_capacity(BUFFER_BYTES, file), folder, canceller: spool.canceller.clone() })
    }

    /// Appends the decoded bytes of a gzip stream.
    ///
    /// # Errors
    /// If the stream is damaged or shorter than announced. If it is longer and [`Excess::Refused`] is set. If the
    /// folder is full.
    pub fn append_gzip(&mut self, reader: impl BufRead, share: &GzipShare<'_>) -> Result<(), SourceError> {
        self.append_deflated("gzip", MultiGzDecoder::new(reader), share)
    }

    /// Appends the decoded bytes of a zlib stream.
    ///
    /// # Errors
    /// As [`Self::append_gzip`].
    pub fn append_zlib(&mut self, reader: impl BufRead, share: &GzipShare<'_>) -> Result<(), SourceError> {
        self.append_deflated("zlib", ZlibDecoder::new(reader), share)
    }

    fn append_deflated(
        &mut self,
        kind: &str,
        mut decoder: impl Read,
        share: &GzipShare<'_>,
    ) -> Result<(), SourceError> {
        let wanted = share.skip_bytes.checked_add(share.bytes);
        let ceiling = share.compressed_bytes.saturating_add(1).saturating_mul(DEFLATE_RATIO_LIMIT);
        let Some(wanted) = wanted.filter(|w| *w <= ceiling) else {
            let found = format!("{} compressed bytes, which hold at most {ceiling}", share.compressed_bytes);
            return Err(SourceError::invalid(
                share.path,
                format!("{kind} data"),
                format!("{} bytes", share.bytes),
                found,
            ));
        };
        let mut buffer = vec![0; BUFFER_BYTES];
        let mut done = 0;
        while done < wanted {
            check(&self.canceller)?;
            let room = buffer.len().min(usize::try_from(wanted - done).unwrap_or(usize::MAX));
            let count = decoder.read(&mut buffer[..room]).map_err(|e| damaged(kind, share.path, done, e))?;
            if count == 0 {
                let found = format!("{done} bytes");
                return Err(SourceError::invalid(
                    share.path,
                    format!("decoded {kind} data"),
                    format!("{wanted} bytes"),
                    found,
                ));
            }
            let passed_over = index(share.skip_bytes.saturating_sub(done).min(count as u64));
            self.write(&buffer[passed_over..count])?;
            done += count as u64;
        }
        if share.excess == Excess::Refused {
            // Reading to the end also makes the decoder compare the stream's checksum.
            let more = decoder.read(&mut buffer[..1]).map_err(|e| damaged(kind, share.path, done, e))?;
            if more != 0 {
                let found = format!("at least {} bytes", wanted + 1);
                return Err(SourceError::invalid(
                    share.path,
                    format!("decoded {kind} data"),
                    format!("{wanted} bytes"),
                    found,
                ));
            }
        }
        Ok(())
    }

    /// Appends all bytes of a bare deflate stream, at most `limit`.
    ///
    /// # Errors
    /// If the stream is damaged or longer, or the folder is full.
    pub fn append_inflated(&mut self, path: &Path, reader: impl BufRead, limit: u64) -> Result<(), SourceError> {
        let mut decoder = DeflateDecoder::new(reader);
        let mut buffer = vec![0; BUFFER_BYTES];
        let mut done = 0;
        loop {
            let count = decoder.read(&mut buffer).map_err(|e| damaged("deflate", path, done, e))?;
            done += count as u64;
            if count == 0 {
                return Ok(());
            }
            if done > limit {
                let advice = "write it without deflation first";
                return Err(SourceError::unsupported(path, format!("it inflates to more than {limit} bytes"), advice));
            }
            self.write(&buffer[..count])?;
        }
    }

    /// Appends numbers from a text, separated by white space or commas, as little-endian voxels.
    ///
    /// # Errors
    /// If there are fewer numbers. If there are more, and more are refused. If a word is not a number of this type. If
    /// the folder is full.
    pub fn append_text(&mut self, path: &Path, reader: impl BufRead, numbers: TextNumbers) -> Result<(), SourceError> {
        self.append_words(path, reader, numbers, parse_voxel)
    }

    /// As [`Self::append_text`], with `parse` as the conversion from words to voxels.
    pub(crate) fn append_words(
        &mut self,
        path: &Path,
        reader: impl BufRead,
        numbers: TextNumbers,
        parse: ParseVoxel,
    ) -> Result<(), SourceError> {
        let TextNumbers { voxel_type, voxels, words, excess } = numbers;
        let mut tokens = Tokens { reader, path, token: String::new() };
        let mut voxel = [0; 8];
        let voxel = &mut voxel[..voxel_type.bytes()];
        for number in 0..voxels {
            let Some(token) = tokens.next()? else {
                let found = format!("{number} numbers");
                return Err(SourceError::invalid(path, "text data", format!("{voxels} numbers"), found));
            };
            if !parse(token, voxel_type, voxel) {
                let found = match words {
                    Words::Shown => format!("`{token}`"),
                    Words::Hidden => format!("a word of {} characters", token.chars().count()),
                };
                let location = format!("number {number} of the text data");
                return Err(SourceError::invalid(path, location, format!("a number of type {voxel_type}"), found));
            }
            self.write(voxel)?;
        }
        if excess == Excess::Refused && tokens.next()?.is_some() {
            let found = format!("at least {} numbers", voxels + 1);
            return Err(SourceError::invalid(path, "text data", format!("{voxels} numbers"), found));
        }
        Ok(())
    }

    /// Appends decoded bytes.
    ///
    /// # Errors
    /// If the folder is full.
    pub fn append(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        self.write(bytes)
    }

    /// Returns the finished file.
    ///
    /// # Errors
    /// If the last bytes cannot be written.
    pub fn finish(self) -> Result<File, SourceError> {
        self.file.into_inner().map_err(|e| SourceError::spool(&self.folder, e.into_error()))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
        check(&self.canceller)?;
        self.file.write_all(bytes).map_err(|e| SourceError::spool(&self.folder, e))
    }
}

/// Converts a decoder's error: a stream that breaks the rules of its `kind` (`gzip`, `zlib`) is wrong data; everything
/// else is an I/O error.
pub(crate) fn damaged(kind: &str, path: &Path, done: u64, error: std::io::Error) -> SourceError {
    use std::io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    match error.kind() {
        InvalidData | InvalidInput | UnexpectedEof => {
            let location = format!("after {done} decoded bytes");
            SourceError::invalid(path, location, format!("a whole {kind} stream"), error.to_string())
        }
        _ => SourceError::io(path, error),
    }
}

/// Words of a text, one at a time.
struct Tokens<'a, R> {
    reader: R,
    path: &'a Path,
    token: String,
}

impl<R: BufRead> Tokens<'_, R> {
    fn next(&mut self) -> Result<Option<&str>, SourceError> {
        self.token.clear();
        loop {
            let available = self.reader.fill_buf().map_err(|e| SourceError::io(self.path, e))?;
            if available.is_empty() {
                return Ok((!self.token.is_empty()).then_some(&self.token));
            }
            let mut used = 0;
            for byte in available {
                used += 1;
                let separator = byte.is_ascii_whitespace() || *byte == b',';
                if separator && !self.token.is_empty() {
                    self.reader.consume(used);
                    return Ok(Some(&self.token));
                }
                if !separator {
                    self.token.push(char::from(*byte));
                }
                if self.token.len() > TOKEN_LIMIT {
                    let expected = format!("numbers of at most {TOKEN_LIMIT} characters");
                    return Err(SourceError::invalid(self.path, "text data", expected, "a longer word"));
                }
            }
            self.reader.consume(used);
        }
    }
}

/// Writes a number as a voxel; false if it is not a number of this type.
pub(crate) fn parse_voxel(token: &str, voxel_type: VoxelType, out: &mut [u8]) -> bool {
    if voxel_type.is_float() {
        let Ok(value) = token.parse::<f64>() else { return false };
        with_voxel!(voxel_type, V => V::from_f64(value).write_le(out));
        return true;
    }
    let (least, greatest) = voxel_type.limits();
    // A double represents every integer type here exactly.
    match token.parse::<i64>() {
        Ok(value) if (least..=greatest).contains(&(value as f64)) => {
            with_voxel!(voxel_type, V => V::from_f64(value as f64).write_le(out));
            true
        }
        _ => false,
    }
}
