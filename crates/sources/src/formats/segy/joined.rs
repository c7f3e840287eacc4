//! Several files as one: the headers of the first file, then the traces of all files in natural order of their names.
//!
//! Surveys are often stored as one file per inline. The files must agree in byte order, sample format, samples and
//! header lengths. Traces are assigned to grid cells as in a single file. Few files are open at once ([`OpenFiles`]).

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use supervol_format::ByteSource;

use super::binary_header::FILE_HEADER_BYTES;
use super::file_header::read_file_header;
use super::input::Input;
use super::layout::Layout;
use super::options::SegyOptions;
use crate::cast::index;
use crate::input::open_files::OpenFiles;
use crate::{Endian, SourceError};

/// The traces of one file.
#[derive(Debug)]
struct Part {
    path: PathBuf,
    /// Offset of the traces in the file, and in the joined files, in bytes.
    start: u64,
    position: u64,
}

/// Several files as one, see the module.
#[derive(Debug)]
pub(super) struct Joined {
    headers: Vec<u8>,
    parts: Vec<Part>,
    bytes: u64,
    open: OpenFiles,
}

impl Joined {
    /// Joins at least one file; reads the headers of each.
    pub(super) fn new(paths: &[PathBuf], options: &SegyOptions) -> Result<Self, SourceError> {
        let mut joined = Self { headers: Vec::new(), parts: Vec::new(), bytes: 0, open: OpenFiles::default() };
        let mut first: Option<Layout> = None;
        for path in paths {
            let file = File::open(path).map_err(|e| SourceError::io(path, e))?;
            let input = Input { path, bytes: &file };
            let (_, header) = read_file_header(input, options)?;
            let layout = Layout::resolve(input, &header, options, &mut Vec::new())?;
            match first {
                None => {
                    joined.headers = vec![0; usize::try_from(layout.first_trace).unwrap_or(usize::MAX)];
                    input.read(0, &mut joined.headers)?;
                    joined.headers[index(FILE_HEADER_BYTES) - 400..]
                        .iter_mut()
                        .take(400)
                        .enumerate()
                        .for_each(only_one);
                    joined.bytes = layout.first_trace;
                    first = Some(layout);
                }
                Some(first) => check_alike(path, (&paths[0], &first), &layout)?,
            }
            joined.parts.push(Part { path: path.clone(), start: layout.first_trace, position: joined.bytes });
            let traces = layout.traces.checked_mul(layout.trace_bytes());
            let end = traces.and_then(|bytes| joined.bytes.checked_add(bytes));
            joined.bytes = end.ok_or_else(|| input.invalid("traces", "less than 2^64 bytes in all files", "more"))?;
        }
        Ok(joined)
    }
}

/// Clears the fields of a revision 2 binary header that hold for one file only: number and offset of its traces, and
/// the records behind them.
fn only_one((at, byte): (usize, &mut u8)) {
    if (312..332).contains(&at) {
        *byte = 0;
    }
}

fn check_alike(path: &Path, (first_path, first): (&Path, &Layout), layout: &Layout) -> Result<(), SourceError> {
    let facts = |l: &Layout| (l.endian, l.format, l.header_bytes, l.samples);
    if facts(first) == facts(layout) {
        return Ok(());
    }
    let describe = |l: &Layout| {
        let order = if l.endian == Endian::Big { "big" } else { "little" };
        format!("{} samples of format {:?}, {order} endian, headers of {} bytes", l.samples, l.format, l.header_bytes)
    };
    let name = first_path.file_name().unwrap_or_default().display();
    let expected = format!("{} as in {name}", describe(first));
    Err(SourceError::invalid(path, "headers of one survey", expected, describe(layout)))
}

impl ByteSource for Joined {
    fn len(&self) -> io::Result<u64> {
        Ok(self.bytes)
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        let (mut at, mut rest) = (offset, buffer);
        if let Some(headers) = usize::try_from(at).ok().and_then(|at| self.headers.get(at..)) {
            let count = headers.len().min(rest.len());
            let (now, later) = rest.split_at_mut(count);
            now.copy_from_slice(&headers[..count]);
            (at, rest) = (at + count as u64, later);
        }
        while !rest.is_empty() {
            if at >= self.bytes {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            let number = self.parts.partition_point(|part| part.position <= at) - 1;
            let part = &self.parts[number];
            let end = self.parts.get(number + 1).map_or(self.bytes, |next| next.position);
            let count = index((end - at).min(rest.len() as u64));
            let (now, later) = rest.split_at_mut(count);
            self.open.get(number, &part.path)?.read_exact_at(part.start + (at - part.position), now)?;
            (at, rest) = (at + count as u64, later);
        }
        Ok(())
    }
}
