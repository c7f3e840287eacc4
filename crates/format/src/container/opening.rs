//! Opening of a container: reads header, footer and manifest in one request.

use super::header::{self, Descriptor, PAGE_BYTES, Sections};
use super::manifest::{self, Manifest};
use super::reader::{RECORDS_START, read};
use super::{ContainerError, checksum, toc};
use crate::byte_source::ByteSource;
use crate::{Pyramid, cast};

/// Bytes at the end of the file that are read at once: the footer, a manifest of usual length, and the last TOC page.
pub const TAIL_BYTES: u64 = 128 << 10;

/// Parts of a container that opening reads.
pub(super) struct Opened {
    pub file_bytes: u64,
    pub version: u32,
    pub descriptor: Descriptor,
    pub sections: Sections,
    pub manifest: Manifest,
    /// Last bytes of the file.
    pub tail: Vec<u8>,
}

/// Reads header, footer and manifest: in one request, unless the manifest is unusually long.
///
/// # Errors
/// If the bytes cannot be read or are not a whole container.
pub(super) fn open(source: &dyn ByteSource) -> Result<Opened, ContainerError> {
    let io = |source| ContainerError::Io { what: "length of the file".into(), offset: 0, bytes: 0, source };
    let file_bytes = source.len().map_err(io)?;
    if file_bytes < 2 * PAGE_BYTES as u64 {
        // A small file that is not a container gets the error that says so.
        let mut start = [0; header::MAGIC.len()];
        let known = &mut start[..cast::index(file_bytes.min(header::MAGIC.len() as u64))];
        read(source, "first bytes", 0, known)?;
        header::check_magic(&start, "file", 0)?;
        let expected = format!("at least {} bytes", 2 * PAGE_BYTES);
        return Err(ContainerError::invalid("container", 0, expected, format!("{file_bytes} bytes")));
    }
    let (header, tail) = read_ends(source, file_bytes)?;
    // Check the header first: a file that is not a container gets the error that says so.
    let (from_header, header_sections) = header::decode(&header, "header", 0)?;
    let footer_offset = file_bytes - PAGE_BYTES as u64;
    let footer = tail.last_chunk().expect("the tail is no shorter than a page");
    let (descriptor, sections) = header::decode(footer, "footer", footer_offset).map_err(unfinished)?;
    let version = header::version_of(footer);
    if (&from_header, header::version_of(&header)) != (&descriptor, version) || header_sections != Sections::default() {
        let found = format!("version {}, {from_header:?}, {header_sections:?}", header::version_of(&header));
        let expected = format!("the footer's version {version}, {descriptor:?}, no sections");
        return Err(ContainerError::invalid("header", 0, expected, found));
    }
    check_sections(&sections, version, &descriptor.pyramid, footer_offset)?;
    let manifest = match sections.manifest_offset.checked_sub(file_bytes - tail.len() as u64) {
        Some(at) => decode_manifest(&tail[cast::index(at)..][..cast::index(sections.manifest_bytes)], &sections)?,
        None => {
            let mut bytes = vec![0; cast::index(sections.manifest_bytes)];
            read(source, "manifest", sections.manifest_offset, &mut bytes)?;
            decode_manifest(&bytes, &sections)?
        }
    };
    Ok(Opened { file_bytes, version, descriptor, sections, manifest, tail })
}

/// Reads the header page and the last [`TAIL_BYTES`] (or the whole file if it is shorter). If that fails, reads only
/// the header and the footer page: an unreadable place between them concerns only the bricks whose entries lie there.
fn read_ends(source: &dyn ByteSource, file_bytes: u64) -> Result<([u8; PAGE_BYTES], Vec<u8>), ContainerError> {
    let mut header = [0; PAGE_BYTES];
    let mut tail = vec![0; cast::index(file_bytes.min(TAIL_BYTES))];
    let tail_offset = file_bytes - tail.len() as u64;
    if source.read_several(&mut [(0, &mut header), (tail_offset, &mut tail)]).is_ok() {
        return Ok((header, tail));
    }
    read(source, "header", 0, &mut header)?;
    tail.truncate(PAGE_BYTES);
    read(source, "footer", file_bytes - PAGE_BYTES as u64, &mut tail)?;
    Ok((header, tail))
}

/// Rewords the error for a good header without a footer: the file is unfinished or truncated.
fn unfinished(error: ContainerError) -> ContainerError {
    match error {
        ContainerError::Magic { offset, expected, found, .. } => {
            let what = "the file is truncated or was never finished; footer".into();
            ContainerError::Invalid { what, offset, expected, found }
        }
        other => other,
    }
}

/// Checks that the sections follow one another without a gap and have the sizes that the pyramid demands.
fn check_sections(s: &Sections, version: u32, pyramid: &Pyramid, footer_offset: u64) -> Result<(), ContainerError> {
    let toc_bytes = toc::bytes_for(pyramid.brick_count(), version);
    let follows = |start: u64, length: u64, next: u64| start.checked_add(length) == Some(next);
    let whole = s.toc_offset >= RECORDS_START
        && s.toc_bytes == toc_bytes
        && follows(s.toc_offset, s.toc_bytes, s.manifest_offset)
        && follows(s.manifest_offset, s.manifest_bytes, footer_offset)
        && s.manifest_bytes <= manifest::BYTES_LIMIT;
    if whole {
        return Ok(());
    }
    let expected = format!(
        "a TOC of {toc_bytes} bytes, then a manifest of at most {} bytes, then the footer at {footer_offset}, without gaps",
        manifest::BYTES_LIMIT
    );
    Err(ContainerError::invalid("footer: sections", footer_offset, expected, format!("{s:?}")))
}

fn decode_manifest(bytes: &[u8], sections: &Sections) -> Result<Manifest, ContainerError> {
    let offset = sections.manifest_offset;
    let sum = checksum(bytes);
    if sum != sections.manifest_checksum {
        let (expected, found) = (format!("{:016x}", sections.manifest_checksum), format!("{sum:016x}"));
        return Err(ContainerError::invalid("manifest: checksum", offset, expected, found));
    }
    Manifest::from_json(bytes).map_err(|e| ContainerError::invalid("manifest", offset, "the manifest's JSON", e))
}
