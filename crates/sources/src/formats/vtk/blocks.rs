//! Encoded arrays of XML files: base64, blocks of zlib or LZ4, or both.

use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use base64::read::DecoderReader;
use supervol_format::ByteSource;

use super::header::{Array, Blocks, Compressor, Encoding, number};
use crate::cast::index;
use crate::input::spool::{Excess, GzipShare, Spool};
use crate::{Endian, Message, SourceError};

/// Bytes that are decoded at once.
const BUFFER_BYTES: usize = 1 << 16;
/// Largest size in bytes of an LZ4 block, which is decoded as a whole; VTK's own blocks have 32 KiB.
const BLOCK_LIMIT_BYTES: u64 = 64 << 20;
/// Largest expansion of a byte by LZ4.
const LZ4_RATIO_LIMIT: u64 = 255;

/// Reader of the bytes up to the next tag.
pub(super) struct UpTo {
    reader: BufReader<File>,
    is_over: bool,
}

impl UpTo {
    /// Reader from byte `at` on.
    pub(super) fn new(path: &Path, mut file: File, at: u64) -> Result<Self, SourceError> {
        file.seek(SeekFrom::Start(at)).map_err(|e| SourceError::io(path, e))?;
        Ok(Self { reader: BufReader::with_capacity(BUFFER_BYTES, file), is_over: false })
    }
}

impl Read for UpTo {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.is_over {
            return Ok(0);
        }
        let count = self.reader.read(out)?;
        let end = out[..count].iter().position(|byte| *byte == b'<');
        self.is_over = end.is_some();
        Ok(end.unwrap_or(count))
    }
}

/// Reader that skips white space.
struct Dense<R>(R);

impl<R: Read> Read for Dense<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        loop {
            let count = self.0.read(out)?;
            let mut kept = 0;
            for i in 0..count {
                if !out[i].is_ascii_whitespace() {
                    out[kept] = out[i];
                    kept += 1;
                }
            }
            if kept > 0 || count == 0 {
                return Ok(kept);
            }
        }
    }
}

/// Number of base64 characters for this many bytes.
fn characters(bytes: u64) -> u64 {
    bytes.div_ceil(3).saturating_mul(4)
}

/// An array of a file, encoded or in blocks.
pub(super) struct EncodedArray<'a> {
    /// Path of the file, for messages.
    pub(super) path: &'a Path,
    /// The file.
    pub(super) file: File,
    /// Encoding and offset of the array.
    pub(super) array: &'a Array,
    /// Block format.
    pub(super) blocks: Blocks,
    /// Byte order of the words that count bytes.
    pub(super) endian: Endian,
    /// Size of the decoded array in bytes.
    pub(super) bytes: u64,
}

impl EncodedArray<'_> {
    /// Decodes the array into `spool`.
    pub(super) fn decode(self, spool: &mut Spool) -> Result<(), SourceError> {
        let Self { path, file, array, blocks, endian, bytes } = self;
        let left = file.len().map_err(|e| SourceError::io(path, e))?.saturating_sub(array.offset);
        let data = Data { path, left, endian, word_bytes: blocks.word_bytes, bytes };
        match (array.encoding, blocks.compressor) {
            (Encoding::Raw, compressor) => {
                let mut file = file;
                file.seek(SeekFrom::Start(array.offset)).map_err(|e| SourceError::io(path, e))?;
                let mut reader = BufReader::with_capacity(BUFFER_BYTES, file);
                let mut head = vec![0; blocks.word_bytes];
                data.read(&mut reader, &mut head)?;
                let mut rest = vec![0; data.table_bytes(&head)? - head.len()];
                data.read(&mut reader, &mut rest)?;
                data.expand(compressor, &data.table(&[head, rest].concat())?, reader, spool)
            }
            (_, Some(compressor)) => {
                let mut text = Dense(UpTo::new(path, file, array.offset)?);
                let head = data.base64(&mut text, characters(blocks.word_bytes as u64), Vec::new())?;
                let table_bytes = data.table_bytes(&decoded(path, &head)?)?;
                let all = characters(table_bytes as u64) - head.len() as u64;
                let table = decoded(path, &data.base64(&mut text, all, head)?)?;
                let sizes = data.table(table.get(..table_bytes).unwrap_or(&table))?;
                let compressed = sizes.iter().fold(0u64, |sum, (size, _)| sum.saturating_add(*size));
                let text = text.take(characters(compressed));
                data.expand(Some(compressor), &sizes, DecoderReader::new(text, &STANDARD), spool)
            }
            (_, None) => {
                let text = Dense(UpTo::new(path, file, array.offset)?);
                let all = characters(bytes.saturating_add(blocks.word_bytes as u64));
                let mut reader = DecoderReader::new(text.take(all), &STANDARD);
                let mut head = vec![0; blocks.word_bytes];
                data.read(&mut reader, &mut head)?;
                data.check(number(&head, endian), left)?;
                data.copy(reader, spool)
            }
        }
    }
}

fn decoded(path: &Path, characters: &[u8]) -> Result<Vec<u8>, SourceError> {
    STANDARD.decode(characters).map_err(|e| SourceError::invalid(path, "table of blocks", "base64", e.to_string()))
}

/// Properties of an array.
struct Data<'a> {
    path: &'a Path,
    /// Bytes of the file from the array on.
    left: u64,
    endian: Endian,
    word_bytes: usize,
    /// Size of the decoded array in bytes.
    bytes: u64,
}

impl Data<'_> {
    fn wrong(&self, expected: impl Into<Message>, found: impl Into<String>) -> SourceError {
        SourceError::invalid(self.path, "array", expected, found)
    }

    fn read(&self, reader: &mut impl Read, out: &mut [u8]) -> Result<(), SourceError> {
        reader.read_exact(out).map_err(|e| self.failed(e))
    }

    /// Converts a reader's error to a data error or an I/O error.
    fn failed(&self, error: io::Error) -> SourceError {
        match error.kind() {
            io::ErrorKind::UnexpectedEof | io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput => {
                self.wrong("all of its bytes", error.to_string())
            }
            _ => SourceError::io(self.path, error),
        }
    }

    /// Appends the next `count` characters to `there`.
    fn base64(&self, text: &mut impl Read, count: u64, mut there: Vec<u8>) -> Result<Vec<u8>, SourceError> {
        let begun = there.len();
        text.take(count).read_to_end(&mut there).map_err(|e| self.failed(e))?;
        if (there.len() - begun) as u64 == count {
            return Ok(there);
        }
        Err(self.wrong(format!("{count} characters of base64"), format!("{}", there.len() - begun)))
    }

    /// Size in bytes of the table of blocks, from its first word.
    fn table_bytes(&self, head: &[u8]) -> Result<usize, SourceError> {
        let blocks = number(&head[..self.word_bytes], self.endian);
        let bytes = blocks.checked_add(3).and_then(|words| words.checked_mul(self.word_bytes as u64));
        let bytes = bytes.filter(|bytes| *bytes <= self.left).and_then(|bytes| usize::try_from(bytes).ok());
        bytes.ok_or_else(|| self.wrong("a table of blocks inside the file", format!("one of {blocks} blocks")))
    }

    /// Compressed and decoded size of each block in bytes.
    fn table(&self, table: &[u8]) -> Result<Vec<(u64, u64)>, SourceError> {
        let words: Vec<u64> = table.chunks_exact(self.word_bytes).map(|word| number(word, self.endian)).collect();
        let [count, size, last, compressed @ ..] = &words[..] else { return Err(self.wrong("a table", "none")) };
        if compressed.len() as u64 != *count {
            return Err(self.wrong(format!("{count} blocks"), format!("{}", compressed.len())));
        }
        // A last block of size 0 is as long as the others.
        let whole = if *last > 0 { count.saturating_sub(1) } else { *count };
        let all = whole.checked_mul(*size).and_then(|bytes| bytes.checked_add(*last));
        self.check(all.unwrap_or(u64::MAX), self.left)?;
        let decoded = |i: usize| if (i as u64) < whole { *size } else { *last };
        Ok(compressed.iter().enumerate().map(|(i, compressed)| (*compressed, decoded(i))).collect())
    }

    fn check(&self, stated: u64, left: u64) -> Result<(), SourceError> {
        // No deflate stream expands more than 1032 times.
        if stated == self.bytes && self.bytes / 1032 <= left {
            return Ok(());
        }
        Err(self.wrong(format!("{} bytes", self.bytes), format!("{stated} in {left} bytes of the file")))
    }

    fn expand(
        &self,
        compressor: Option<Compressor>,
        sizes: &[(u64, u64)],
        reader: impl Read,
        spool: &mut Spool,
    ) -> Result<(), SourceError> {
        match compressor {
            Some(Compressor::Lz4) => self.expand_lz4(sizes, reader, spool),
            Some(Compressor::Zlib) | None => self.inflate(sizes, reader, spool),
        }
    }

    /// Decodes bare LZ4 blocks, each as a whole.
    fn expand_lz4(&self, sizes: &[(u64, u64)], mut reader: impl Read, spool: &mut Spool) -> Result<(), SourceError> {
        let (mut compressed, mut block) = (Vec::new(), Vec::new());
        for (number, &(compressed_bytes, bytes)) in sizes.iter().enumerate() {
            let most = BLOCK_LIMIT_BYTES.min(compressed_bytes.saturating_mul(LZ4_RATIO_LIMIT));
            if compressed_bytes > BLOCK_LIMIT_BYTES || bytes > most {
                let found = format!("{compressed_bytes} bytes for {bytes}");
                return Err(self.wrong(format!("a block {number} by LZ4 of at most {most} bytes"), found));
            }
            compressed.clear();
            reader.by_ref().take(compressed_bytes).read_to_end(&mut compressed).map_err(|e| self.failed(e))?;
            block.resize(index(bytes), 0);
            let decoded = lz4_flex::block::decompress_into(&compressed, &mut block);
            let wrong = |found| self.wrong(format!("{bytes} bytes of block {number} by LZ4"), found);
            match decoded {
                Ok(decoded) if decoded as u64 == bytes => spool.append(&block)?,
                Ok(decoded) => return Err(wrong(format!("{decoded} bytes"))),
                Err(e) => return Err(wrong(e.to_string())),
            }
        }
        Ok(())
    }

    fn inflate(&self, sizes: &[(u64, u64)], mut reader: impl Read, spool: &mut Spool) -> Result<(), SourceError> {
        for &(compressed_bytes, bytes) in sizes {
            let share = GzipShare { path: self.path, compressed_bytes, skip_bytes: 0, bytes, excess: Excess::Refused };
            let mut block = BufReader::new(reader.by_ref().take(compressed_bytes));
            spool.append_zlib(&mut block, &share)?;
            // The bytes behind the stream belong to the block, too.
            io::copy(&mut block, &mut io::sink()).map_err(|e| self.failed(e))?;
        }
        Ok(())
    }

    fn copy(&self, mut reader: impl Read, spool: &mut Spool) -> Result<(), SourceError> {
        let mut buffer = vec![0; BUFFER_BYTES];
        let mut left = self.bytes;
        while left > 0 {
            let room = buffer.len().min(usize::try_from(left).unwrap_or(usize::MAX));
            self.read(&mut reader, &mut buffer[..room])?;
            spool.append(&buffer[..room])?;
            left -= room as u64;
        }
        Ok(())
    }
}
