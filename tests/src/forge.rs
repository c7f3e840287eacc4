//! Containers that break exactly one rule. Bytes are changed, and all checksums over them are corrected, so that only a
//! check of the rule can detect it.

use std::sync::Arc;

use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::container::checksum;
use supervol_format::container::header::{self, Sections, VERSION_BRICK_ERRORS};
use supervol_format::container::manifest::Manifest;
use supervol_format::container::seal::seal_brick;
use supervol_format::container::toc::{self, BrickEntry, ENTRIES_PER_PAGE, ENTRY_BYTES};
use supervol_format::container::writer::{ContainerWriter, EncodedBrick};
use supervol_format::{BrickKey, Container, ValueRange};

/// The bytes of a container, and the container before the changes.
#[derive(Debug)]
pub struct Forge {
    /// The file.
    pub bytes: Vec<u8>,
    /// The container before the changes.
    pub original: Container,
}

impl Forge {
    /// # Panics
    /// If the bytes are not a complete container.
    #[must_use]
    pub fn new(bytes: Vec<u8>) -> Self {
        let original = Container::from_source(Arc::new(bytes.clone())).expect("only whole containers are forged");
        Self { bytes, original }
    }

    /// The original entry of a brick.
    ///
    /// If the entry cannot be read.
    /// If it cannot be read.
    #[must_use]
    pub fn entry(&self, key: BrickKey) -> BrickEntry {
        self.original.entry(key).expect("the original container is whole")
    }

    /// The present record of a brick.
    #[must_use]
    pub fn record(&self, key: BrickKey) -> Vec<u8> {
        let entry = self.entry(key);
        let start = entry.offset as usize;
        self.bytes[start..start + entry.record_bytes() as usize].to_vec()
    }

    /// Replaces the entry of a brick.
    pub fn set_entry(&mut self, key: BrickKey, entry: &BrickEntry) {
        self.set_entry_bytes(key, &entry.encode());
    }

    /// Replaces the 80 bytes of an entry.
    pub fn set_entry_bytes(&mut self, key: BrickKey, entry: &[u8; ENTRY_BYTES]) {
        let at = self.entry_at(key);
        self.bytes[at..at + ENTRY_BYTES].copy_from_slice(entry);
        self.reseal_toc();
    }

    /// Offset of a brick's entry in the file.
    #[must_use]
    pub fn entry_at(&self, key: BrickKey) -> usize {
        let number = self.original.pyramid().entry(key) as usize;
        let toc = self.original.sections().toc_offset as usize;
        toc + number / ENTRIES_PER_PAGE * toc::PAGE_BYTES + number % ENTRIES_PER_PAGE * ENTRY_BYTES
    }

    /// Replaces a record by one of the same length, with its checksum.
    ///
    /// # Panics
    /// If the length differs.
    pub fn set_record(&mut self, key: BrickKey, record: &[u8]) {
        let mut entry = self.entry(key);
        assert_eq!(record.len() as u64, entry.record_bytes(), "a forged record of {key} must fit the old one's place");
        let start = entry.offset as usize;
        self.bytes[start..start + record.len()].copy_from_slice(record);
        entry.checksum = checksum(record);
        self.set_entry(key, &entry);
    }

    /// Replaces the voxels of a raw-coded brick, and adapts ranges, flags, macro cells and checksum.
    ///
    /// # Panics
    /// If the brick is not coded raw.
    pub fn set_voxels(&mut self, key: BrickKey, voxels: &[u8]) {
        let old = self.entry(key);
        assert_eq!(old.codec, Codec::Raw, "only raw bricks keep their length");
        let descriptor = self.original.descriptor();
        let beneath = self
            .original
            .pyramid()
            .children(key)
            .fold(ValueRange::EMPTY, |range, child| range.union(self.entry(child).range_beneath));
        let raw = CodecChoice::Only(Codec::Raw);
        let sealed = seal_brick(descriptor, key, voxels, raw, beneath, old.error).expect("raw needs nothing");
        let start = old.offset as usize;
        self.bytes[start..start + sealed.record.len()].copy_from_slice(&sealed.record);
        let entry = BrickEntry { offset: old.offset, checksum: checksum(&sealed.record), ..sealed.entry };
        self.set_entry(key, &entry);
    }

    /// Inserts bytes between the last record and the TOC, and moves the sections.
    pub fn insert_before_toc(&mut self, bytes: &[u8]) {
        let old = self.original.sections();
        let at = old.toc_offset as usize;
        self.bytes.splice(at..at, bytes.iter().copied());
        let moved = bytes.len() as u64;
        let sections =
            Sections { toc_offset: old.toc_offset + moved, manifest_offset: old.manifest_offset + moved, ..old };
        let footer = self.bytes.len() - header::PAGE_BYTES;
        let page = header::encode(self.original.descriptor(), sections);
        self.bytes[footer..].copy_from_slice(&page);
    }

    /// Replaces the manifest, and adapts its end and checksum in the footer.
    ///
    /// # Panics
    /// If the manifest is too long for a container.
    pub fn set_manifest(&mut self, manifest: &Manifest) {
        let json = manifest.to_json().expect("a manifest");
        let old = self.original.sections();
        let start = old.manifest_offset as usize;
        self.bytes.truncate(start);
        self.bytes.extend_from_slice(&json);
        let sections = Sections { manifest_bytes: json.len() as u64, manifest_checksum: checksum(&json), ..old };
        self.bytes.extend_from_slice(&header::encode(self.original.descriptor(), sections));
    }

    /// Corrects the checksums of all TOC pages.
    pub fn reseal_toc(&mut self) {
        let Sections { toc_offset, toc_bytes, .. } = self.original.sections();
        let toc = &mut self.bytes[toc_offset as usize..(toc_offset + toc_bytes) as usize];
        for stored in toc.chunks_mut(toc::PAGE_BYTES) {
            let mut page = toc::uncut(stored.to_vec());
            reseal(&mut page);
            stored.copy_from_slice(&toc::cut(page, stored.len()));
        }
    }

    /// Corrects the checksums of the header and footer pages and of the TOC pages.
    pub fn reseal_pages(&mut self) {
        let footer = self.bytes.len() - header::PAGE_BYTES;
        reseal(&mut self.bytes[..header::PAGE_BYTES]);
        reseal(&mut self.bytes[footer..]);
        self.reseal_toc();
    }
}

/// The container in the form of an older version. Before version 4, records hold no error bounds of macro cells; before
/// version 3, all pages of the TOC are full.
///
/// # Panics
/// If the bytes are not a complete container.
#[must_use]
pub fn as_written_by(bytes: &[u8], version: u32) -> Vec<u8> {
    let bytes = &without_cell_errors(bytes);
    if version == VERSION_BRICK_ERRORS {
        return with_version(bytes.clone(), version);
    }
    let footer: &[u8; header::PAGE_BYTES] = bytes.last_chunk().expect("a footer page");
    let (descriptor, old) = header::decode(footer, "footer", 0).expect("it was just written");
    let (toc, manifest) = (old.toc_offset as usize, old.manifest_offset as usize);
    let mut out = bytes[..toc].to_vec();
    out.extend(bytes[toc..manifest].chunks(toc::PAGE_BYTES).flat_map(|page| toc::uncut(page.to_vec())));
    let toc_bytes = (out.len() - toc) as u64;
    out.extend_from_slice(&bytes[manifest..bytes.len() - header::PAGE_BYTES]);
    let sections = Sections { toc_bytes, manifest_offset: old.toc_offset + toc_bytes, ..old };
    out.extend_from_slice(&header::encode(&descriptor, sections));
    with_version(out, version)
}

/// The container without the error bounds of macro cells, still with the number of the newest version.
fn without_cell_errors(bytes: &[u8]) -> Vec<u8> {
    let container = Container::from_source(Arc::new(bytes.to_vec())).expect("only whole containers are rewritten");
    let pyramid = container.pyramid();
    let mut bricks: Vec<_> = (0..pyramid.brick_count())
        .map(|number| pyramid.key(number).expect("every number below the count is a brick"))
        .map(|key| (key, container.entry(key).expect("whole")))
        .collect();
    // Records keep their order.
    bricks.sort_by_key(|(_, entry)| entry.offset);
    let mut writer = ContainerWriter::begin(Vec::new(), container.descriptor().clone()).expect("room");
    for (key, mut entry) in bricks {
        let mut record = vec![0; entry.record_bytes() as usize];
        container.read_at(entry.offset, &mut record).expect("whole");
        let bounds = container.cell_errors(key, &entry, &record).len();
        record.truncate(record.len() - bounds);
        entry.macro_cell_bytes -= bounds as u32;
        writer.append(EncodedBrick { key, entry, record }).expect("room");
    }
    writer.finish(container.manifest()).expect("room")
}

/// The same bytes with another version number in header and footer.
#[must_use]
pub fn with_version(mut bytes: Vec<u8>, version: u32) -> Vec<u8> {
    let footer = bytes.len() - header::PAGE_BYTES;
    for at in [0, footer] {
        let page = &mut bytes[at..at + header::PAGE_BYTES];
        page[8..12].copy_from_slice(&version.to_le_bytes());
        reseal(page);
    }
    bytes
}

/// Writes the checksum of a page into its last eight bytes.
pub fn reseal(page: &mut [u8]) {
    let at = page.len() - 8;
    let sum = checksum(&page[..at]);
    page[at..].copy_from_slice(&sum.to_le_bytes());
}
