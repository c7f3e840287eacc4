//! Entries of the table of contents and the pages that hold them. The byte tables are in [`super`].

use super::header::{VERSION_QUANTIZED, f64_at, u32_at, u64_at};
use super::{ContainerError, checksum};
use crate::codec::Codec;
use crate::{BrickKey, ValueRange, cast};

/// Bytes per entry.
pub const ENTRY_BYTES: usize = 80;
/// Bytes per whole page.
pub const PAGE_BYTES: usize = 65536;
/// Entries per whole page.
pub const ENTRIES_PER_PAGE: usize = 818;

pub(super) const CHECKSUM_BYTES: usize = 8;
const CHECKSUM_AT: usize = PAGE_BYTES - CHECKSUM_BYTES;
const FLAG_ABSENT: u8 = 1;
const FLAG_UNIFORM: u8 = 2;
const FLAG_HOLES: u8 = 4;

/// Entry of the table of contents for one brick. Values are stored values, before scale and offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrickEntry {
    /// Offset of the record in the file in bytes; 0 if the codec is uniform.
    pub offset: u64,
    /// Length of the payload in bytes.
    pub payload_bytes: u32,
    /// Length of the macro cells behind the payload in bytes, their error bounds included.
    pub macro_cell_bytes: u32,
    /// Codec of the payload.
    pub codec: Codec,
    /// No voxel of the core is present, so the brick is invisible.
    pub absent: bool,
    /// All stored voxels are present and have the same value.
    pub uniform: bool,
    /// An absent voxel is among those that interpolation reaches.
    pub has_holes: bool,
    /// Checksum of the record; 0 if there is no record.
    pub checksum: u64,
    /// Bits of every stored voxel if the codec is uniform; otherwise 0.
    pub fill: u64,
    /// Range of the values that interpolation reaches in this brick.
    pub range: ValueRange,
    /// Range of this brick and all finer bricks that it covers.
    pub range_beneath: ValueRange,
    /// Upper bound of |trilinear(this level) - trilinear(source)| in the brick's region. It holds where both, and all
    /// levels between them, are present. Next to a hole, a level between them may be absent although both are present.
    /// At level 0 it is 0, unless voxels were moved ([`super::header::Descriptor::quantizer`]).
    pub error: f64,
}

impl BrickEntry {
    /// Length of the record in bytes: payload and macro cells.
    #[must_use]
    pub fn record_bytes(&self) -> u64 {
        u64::from(self.payload_bytes) + u64::from(self.macro_cell_bytes)
    }

    /// The 80 bytes of this entry.
    #[must_use]
    pub fn encode(&self) -> [u8; ENTRY_BYTES] {
        let mut bytes = [0; ENTRY_BYTES];
        bytes[..8].copy_from_slice(&self.offset.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.payload_bytes.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.macro_cell_bytes.to_le_bytes());
        bytes[16] = self.codec as u8;
        bytes[17] = [(self.absent, FLAG_ABSENT), (self.uniform, FLAG_UNIFORM), (self.has_holes, FLAG_HOLES)]
            .iter()
            .filter_map(|&(set, bit)| set.then_some(bit))
            .sum();
        let numbers = [
            self.checksum,
            self.fill,
            self.range.min.to_bits(),
            self.range.max.to_bits(),
            self.range_beneath.min.to_bits(),
            self.range_beneath.max.to_bits(),
            self.error.to_bits(),
        ];
        for (i, number) in numbers.iter().enumerate() {
            bytes[24 + 8 * i..32 + 8 * i].copy_from_slice(&number.to_le_bytes());
        }
        bytes
    }

    /// Decodes the entry of `key`. `offset` is its position in the file, for messages.
    ///
    /// # Errors
    /// If a field has an impossible value.
    pub fn decode(bytes: &[u8; ENTRY_BYTES], key: BrickKey, offset: u64) -> Result<Self, ContainerError> {
        let invalid = |at: u64, field: &str, expected: &str, found: String| {
            ContainerError::invalid(format!("TOC entry of {key}: {field}"), offset + at, expected, found)
        };
        let codec = Codec::from_tag(bytes[16]).ok_or_else(|| {
            let expected = format!("0 to {} (others need a newer supervol)", Codec::ALL.len() - 1);
            invalid(16, "codec", &expected, bytes[16].to_string())
        })?;
        let flags = bytes[17];
        if flags & !(FLAG_ABSENT | FLAG_UNIFORM | FLAG_HOLES) != 0 {
            return Err(invalid(17, "flags", "bits 0 to 2", format!("{flags:#010b}")));
        }
        if bytes[18] != 0 {
            return Err(invalid(18, "stored scale", "0", bytes[18].to_string()));
        }
        if bytes[19..24] != [0; 5] {
            return Err(invalid(19, "reserved bytes", "0", format!("{:?}", &bytes[19..24])));
        }
        let range = ValueRange { min: f64_at(bytes, 40), max: f64_at(bytes, 48) };
        let range_beneath = ValueRange { min: f64_at(bytes, 56), max: f64_at(bytes, 64) };
        let error = f64_at(bytes, 72);
        if [range.min, range.max, range_beneath.min, range_beneath.max].iter().any(|v| v.is_nan()) {
            return Err(invalid(40, "value ranges", "no NaN", format!("{range:?}, {range_beneath:?}")));
        }
        if error.is_nan() || error < 0.0 {
            return Err(invalid(72, "error", "0 or more", error.to_string()));
        }
        Ok(Self {
            offset: u64_at(bytes, 0),
            payload_bytes: u32_at(bytes, 8),
            macro_cell_bytes: u32_at(bytes, 12),
            codec,
            absent: flags & FLAG_ABSENT != 0,
            uniform: flags & FLAG_UNIFORM != 0,
            has_holes: flags & FLAG_HOLES != 0,
            checksum: u64_at(bytes, 24),
            fill: u64_at(bytes, 32),
            range,
            range_beneath,
            error,
        })
    }
}

/// Number of pages for this many entries.
#[must_use]
pub fn pages_for(entries: u64) -> u64 {
    entries.div_ceil(ENTRIES_PER_PAGE as u64)
}

/// Length of a TOC with this many entries in the file. All pages are whole except the last: from version 3 on, its
/// unused bytes between entries and checksum are cut.
#[must_use]
pub fn bytes_for(entries: u64, version: u32) -> u64 {
    match pages_for(entries) {
        0 => 0,
        pages => (pages - 1) * PAGE_BYTES as u64 + page_bytes(pages - 1, entries, version) as u64,
    }
}

/// Length in the file of page `number` of a TOC with this many entries.
#[must_use]
pub fn page_bytes(number: u64, entries: u64, version: u32) -> usize {
    let is_cut = number + 1 == pages_for(entries) && version > VERSION_QUANTIZED;
    let last = cast::index(entries - number * ENTRIES_PER_PAGE as u64);
    if is_cut { last * ENTRY_BYTES + CHECKSUM_BYTES } else { PAGE_BYTES }
}

/// Cuts a page to the length that it has in the file, see [`bytes_for`].
#[must_use]
pub fn cut(mut page: Vec<u8>, bytes: usize) -> Vec<u8> {
    page.drain(bytes - CHECKSUM_BYTES..CHECKSUM_AT);
    page
}

/// Restores a whole page from its bytes in the file.
///
/// # Panics
/// If `bytes` is too short for a checksum, or longer than a page.
#[must_use]
pub fn uncut(mut bytes: Vec<u8>) -> Vec<u8> {
    let at = bytes.len() - CHECKSUM_BYTES;
    bytes.splice(at..at, std::iter::repeat_n(0, PAGE_BYTES - bytes.len()));
    bytes
}

/// Packs up to [`ENTRIES_PER_PAGE`] encoded entries into a page.
///
/// # Panics
/// If there are more entries than a page holds.
#[must_use]
pub fn encode_page(entries: &[u8]) -> Vec<u8> {
    assert!(entries.len() <= ENTRIES_PER_PAGE * ENTRY_BYTES, "{} bytes of entries exceed a page", entries.len());
    let mut page = vec![0; PAGE_BYTES];
    page[..entries.len()].copy_from_slice(entries);
    let sum = checksum(&page[..CHECKSUM_AT]);
    page[CHECKSUM_AT..].copy_from_slice(&sum.to_le_bytes());
    page
}

/// Checks a whole page: its checksum, and that the bytes behind its `entries` entries are zero. `offset` and `stored`
/// are the page's position and length in the file.
///
/// # Errors
/// If the page is damaged.
pub fn check_page(
    page: &[u8],
    number: u64,
    entries: usize,
    (offset, stored): (u64, usize),
) -> Result<(), ContainerError> {
    let sum = checksum(&page[..CHECKSUM_AT]);
    let found = u64_at(page, CHECKSUM_AT);
    if sum != found {
        let what = format!("TOC page {number}: checksum");
        return Err(ContainerError::invalid(
            what,
            offset + (stored - CHECKSUM_BYTES) as u64,
            format!("{sum:016x}"),
            format!("{found:016x}"),
        ));
    }
    match (entries * ENTRY_BYTES..CHECKSUM_AT).find(|&i| page[i] != 0) {
        Some(at) => {
            Err(ContainerError::invalid(format!("TOC page {number}: reserved byte"), offset + at as u64, 0, page[at]))
        }
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BrickIndex, Lod};

    fn entry() -> BrickEntry {
        BrickEntry {
            offset: 0x0102_0304_0506_0708,
            payload_bytes: 77,
            macro_cell_bytes: 1024,
            codec: Codec::Zstd,
            absent: false,
            uniform: false,
            has_holes: true,
            checksum: 99,
            fill: 0,
            range: ValueRange { min: -1.0, max: 2.0 },
            range_beneath: ValueRange { min: -3.0, max: 4.0 },
            error: 0.25,
        }
    }

    #[test]
    fn entries_survive_the_round_trip_at_the_specified_offsets() {
        let bytes = entry().encode();
        let key = BrickKey::new(Lod(0), BrickIndex([0; 3]));
        assert_eq!(BrickEntry::decode(&bytes, key, 0).expect("a written entry reads"), entry());
        assert_eq!(bytes.len(), 80);
        assert_eq!(u64_at(&bytes, 0), 0x0102_0304_0506_0708);
        assert_eq!((u32_at(&bytes, 8), u32_at(&bytes, 12)), (77, 1024));
        assert_eq!(bytes[16..24], [3, 4, 0, 0, 0, 0, 0, 0]);
        assert_eq!((u64_at(&bytes, 24), u64_at(&bytes, 32)), (99, 0));
        assert_eq!([40, 48, 56, 64, 72].map(|at| f64_at(&bytes, at)), [-1.0, 2.0, -3.0, 4.0, 0.25]);
    }

    #[test]
    fn pages_hold_what_the_specification_says() {
        assert_eq!(ENTRIES_PER_PAGE * ENTRY_BYTES, 65440);
        assert_eq!((pages_for(1), pages_for(818), pages_for(819)), (1, 1, 2));
        assert_eq!([1, 818, 819, 1636].map(|n| bytes_for(n, 3)), [88, 65448, 65536 + 88, 65536 + 65448]);
        assert_eq!([1, 818, 819].map(|n| bytes_for(n, 2)), [65536, 65536, 2 * 65536]);
        let page = encode_page(&[7; 3 * ENTRY_BYTES]);
        let stored = cut(page.clone(), page_bytes(0, 3, 3));
        assert_eq!((stored.len(), &stored[..240]), (248, &[7; 240][..]));
        assert_eq!(uncut(stored), page);
        assert_eq!(uncut(cut(page.clone(), page_bytes(0, 3, 2))), page);
        let page = encode_page(&entry().encode());
        check_page(&page, 0, 1, (0, PAGE_BYTES)).expect("a written page is whole");
        let mut damaged = page.clone();
        damaged[65440] = 1;
        assert!(check_page(&damaged, 0, 1, (0, PAGE_BYTES)).is_err());
    }
}
