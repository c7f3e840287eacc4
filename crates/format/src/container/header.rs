//! The header and footer page. Both have the layout of the table in [`super`].

use super::{ContainerError, checksum};
use crate::brick::{APRON, MACRO_CELL};
use crate::codec::quantize::Quantizer;
use crate::voxel_type::Absence;
use crate::{BrickLayout, Dims, Geometry, Lod, Pyramid, VoxelType};

/// First bytes of every container. A transfer in text mode damages the high bit or the line ends.
pub const MAGIC: [u8; 8] = *b"\x89SVOL\r\n\x1a";
/// Versions that this program reads; it writes the last one.
pub const VERSIONS: std::ops::RangeInclusive<u32> = 1..=VERSION;
/// Version that this program writes. Records of levels 1 and up hold an error bound for each macro cell.
pub const VERSION: u32 = 4;
/// Version with one error bound for each brick. The last TOC page is cut, and voxels may be moved.
pub const VERSION_BRICK_ERRORS: u32 = 3;
/// Version with the source's own voxels, bit for bit, and a whole last TOC page.
pub const VERSION_EXACT: u32 = 1;
/// Version with moved voxels ([`Descriptor::quantizer`]) and a whole last TOC page. Its own number keeps readers of
/// version 1 from taking the voxels for exact.
pub const VERSION_QUANTIZED: u32 = 2;
/// Size of the header page and of the footer page.
pub const PAGE_BYTES: usize = 4096;

const FLAG_NODATA: u32 = 1;
const VERSION_AT: usize = 8;
const FACTORS_AT: usize = 208;
const SECTIONS_AT: usize = 400;
const STEP_AT: usize = 440;
const RESERVED_AT: usize = 448;
const CHECKSUM_AT: usize = PAGE_BYTES - 8;

/// Description of a container: all that is needed to find, decode and place its bricks.
#[derive(Debug, Clone, PartialEq)]
pub struct Descriptor {
    /// Type of the stored voxels.
    pub voxel_type: VoxelType,
    /// Levels and bricks.
    pub pyramid: Pyramid,
    /// Placement of the grid in the world.
    pub geometry: Geometry,
    /// Data value = stored * scale + offset.
    pub scale: f64,
    /// Offset of the data values, see `scale`.
    pub offset: f64,
    /// Rule for absent voxels.
    pub absence: Absence,
    /// The voxels of all levels are moved to multiples of this quantizer's step. `None` if the voxels of level 0 are
    /// the source's own.
    pub quantizer: Option<Quantizer>,
}

impl Descriptor {
    /// Size of level 0 in voxels.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.pyramid.level_at(Lod::FINEST).dims
    }

    /// Largest distance, in stored units, by which quantizing moves a voxel: at level 0 from the source's voxel, at
    /// coarser levels from the downsampled value.
    #[must_use]
    pub fn voxel_error(&self) -> f64 {
        self.quantizer.map_or(0.0, |quantizer| quantizer.bound(self.voxel_type))
    }

    /// Data value of a stored value.
    #[must_use]
    pub fn value(&self, stored: f64) -> f64 {
        stored * self.scale + self.offset
    }
}

/// Positions of the sections behind the bricks; all zero in the header page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sections {
    /// Offset of the TOC in bytes, which is the end of the brick records.
    pub toc_offset: u64,
    /// Length of the TOC in bytes.
    pub toc_bytes: u64,
    /// Offset of the manifest in bytes.
    pub manifest_offset: u64,
    /// Length of the manifest in bytes.
    pub manifest_bytes: u64,
    /// Checksum of the manifest.
    pub manifest_checksum: u64,
}

/// A size in a field of 32 bits.
fn word(size: usize) -> u32 {
    u32::try_from(size).expect("sizes of pages, bricks and pyramids are far below 2^32")
}

fn put(page: &mut [u8], at: usize, bytes: &[u8]) {
    page[at..at + bytes.len()].copy_from_slice(bytes);
}

fn put_f64s(page: &mut [u8], at: usize, values: &[f64]) {
    for (i, v) in values.iter().enumerate() {
        put(page, at + 8 * i, &v.to_le_bytes());
    }
}

pub(super) fn u32_at(page: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(page[at..at + 4].try_into().expect("four bytes were sliced"))
}

pub(super) fn u64_at(page: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(page[at..at + 8].try_into().expect("eight bytes were sliced"))
}

pub(super) fn f64_at(page: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(page, at))
}

fn f64s_at<const N: usize>(page: &[u8], at: usize) -> [f64; N] {
    std::array::from_fn(|i| f64_at(page, at + 8 * i))
}

/// Encodes a page.
#[must_use]
pub fn encode(descriptor: &Descriptor, sections: Sections) -> Vec<u8> {
    let mut page = vec![0; PAGE_BYTES];
    let pyramid = &descriptor.pyramid;
    put(&mut page, 0, &MAGIC);
    let flags = if descriptor.absence.nodata.is_some() { FLAG_NODATA } else { 0 };
    let words = [
        VERSION,
        word(PAGE_BYTES),
        descriptor.voxel_type as u32,
        word(pyramid.layout().core()),
        word(APRON),
        word(MACRO_CELL),
        word(pyramid.levels().len()),
        flags,
    ];
    for (i, word) in words.iter().enumerate() {
        put(&mut page, VERSION_AT + 4 * i, &word.to_le_bytes());
    }
    for (axis, n) in descriptor.dims().0.iter().enumerate() {
        put(&mut page, 40 + 8 * axis, &n.to_le_bytes());
    }
    let nodata = descriptor.absence.nodata.unwrap_or(0.0);
    put_f64s(&mut page, 64, &[descriptor.scale, descriptor.offset, nodata]);
    put_f64s(&mut page, 88, &descriptor.geometry.spacing);
    put_f64s(&mut page, 112, &descriptor.geometry.origin);
    put_f64s(&mut page, 136, &descriptor.geometry.direction);
    for (i, level) in pyramid.levels()[1..].iter().enumerate() {
        put(&mut page, FACTORS_AT + 3 * i, &level.factors.map(|f| u8::try_from(f).expect("factors are 1 or 2")));
    }
    let numbers = [
        sections.toc_offset,
        sections.toc_bytes,
        sections.manifest_offset,
        sections.manifest_bytes,
        sections.manifest_checksum,
    ];
    for (i, number) in numbers.iter().enumerate() {
        put(&mut page, SECTIONS_AT + 8 * i, &number.to_le_bytes());
    }
    put_f64s(&mut page, STEP_AT, &[descriptor.quantizer.map_or(0.0, Quantizer::step)]);
    let sum = checksum(&page[..CHECKSUM_AT]);
    put(&mut page, CHECKSUM_AT, &sum.to_le_bytes());
    page
}

/// Compares the first bytes of a page, or of a file, with [`MAGIC`].
///
/// # Errors
/// If they differ.
pub(super) fn check_magic(start: &[u8], what: &str, offset: u64) -> Result<(), ContainerError> {
    if start == MAGIC {
        return Ok(());
    }
    let (expected, found) = (format!("{MAGIC:02x?}"), format!("{start:02x?}"));
    Err(ContainerError::Magic { what: what.into(), offset, expected, found })
}

/// Version number in a page that [`decode`] has accepted.
#[must_use]
pub fn version_of(page: &[u8; PAGE_BYTES]) -> u32 {
    u32_at(page, VERSION_AT)
}

/// Decodes a page. `offset` is its position in the file and `what` its name, for messages.
///
/// # Errors
/// If the page is not of a known version, is damaged, or describes an impossible container.
pub fn decode(page: &[u8; PAGE_BYTES], what: &str, offset: u64) -> Result<(Descriptor, Sections), ContainerError> {
    let invalid = |at: usize, field: &str, expected: &dyn std::fmt::Display, found: &dyn std::fmt::Display| {
        ContainerError::invalid(format!("{what}: {field}"), offset + at as u64, expected, found)
    };
    check_magic(&page[..MAGIC.len()], what, offset)?;
    let version = version_of(page);
    if !VERSIONS.contains(&version) {
        return Err(ContainerError::Version { found: version, known: *VERSIONS.end() });
    }
    let sum = checksum(&page[..CHECKSUM_AT]);
    if u64_at(page, CHECKSUM_AT) != sum {
        let found = format!("{:016x}", u64_at(page, CHECKSUM_AT));
        return Err(invalid(CHECKSUM_AT, "checksum", &format!("{sum:016x}"), &found));
    }
    for (at, field, expected) in
        [(12, "page size", word(PAGE_BYTES)), (24, "apron", word(APRON)), (28, "macro cell", word(MACRO_CELL))]
    {
        if u32_at(page, at) != expected {
            return Err(invalid(at, field, &expected, &u32_at(page, at)));
        }
    }
    let voxel_type =
        VoxelType::from_tag(u32_at(page, 16)).ok_or_else(|| invalid(16, "voxel type", &"1 to 8", &u32_at(page, 16)))?;
    let layout = BrickLayout::new(u32_at(page, 20))
        .ok_or_else(|| invalid(20, "brick core", &"16, 32, 64 or 128", &u32_at(page, 20)))?;
    let flags = u32_at(page, 36);
    if flags & !FLAG_NODATA != 0 {
        return Err(invalid(36, "flags", &"0 or 1", &flags));
    }
    if let Some(at) = (RESERVED_AT..CHECKSUM_AT).find(|&i| page[i] != 0) {
        return Err(invalid(at, "reserved byte", &0, &page[at]));
    }
    let dims = Dims(std::array::from_fn(|a| u64_at(page, 40 + 8 * a)));
    let factors = factors_at(page, u32_at(page, 32) as usize)
        .map_err(|(at, f)| invalid(at, "factors", &"0 beyond the last level, else 1 or 2", &f))?;
    let pyramid = Pyramid::new(dims, layout, &factors)?;
    let [scale, value_offset, nodata] = f64s_at(page, 64);
    if !(scale.is_finite() && value_offset.is_finite() && scale != 0.0) {
        return Err(invalid(64, "scale and offset", &"finite, scale not 0", &format!("{scale}, {value_offset}")));
    }
    let geometry = Geometry { spacing: f64s_at(page, 88), origin: f64s_at(page, 112), direction: f64s_at(page, 136) };
    if let Some(defect) = geometry.defect() {
        return Err(invalid(88, "geometry", &"positive spacing, invertible direction", &defect));
    }
    let absence = Absence { nodata: (flags & FLAG_NODATA != 0).then_some(nodata) };
    let quantizer = quantizer_at(page, version, voxel_type)
        .map_err(|expected| invalid(STEP_AT, "step of the voxels", &expected, &f64_at(page, STEP_AT)))?;
    let descriptor = Descriptor { voxel_type, pyramid, geometry, scale, offset: value_offset, absence, quantizer };
    let [toc_offset, toc_bytes, manifest_offset, manifest_bytes, manifest_checksum] =
        std::array::from_fn(|i| u64_at(page, SECTIONS_AT + 8 * i));
    Ok((descriptor, Sections { toc_offset, toc_bytes, manifest_offset, manifest_bytes, manifest_checksum }))
}

/// Decodes the quantizer's step. An error says what was expected.
fn quantizer_at(page: &[u8], version: u32, voxel_type: VoxelType) -> Result<Option<Quantizer>, &'static str> {
    let is_none = u64_at(page, STEP_AT) == 0;
    let step = || Quantizer::new(voxel_type, f64_at(page, STEP_AT)).map(Some);
    match version {
        VERSION_EXACT => is_none.then_some(None).ok_or("0 in version 1"),
        VERSION_QUANTIZED => step().ok_or("a positive step of its type in version 2"),
        _ if is_none => Ok(None),
        _ => step().ok_or("0, or a positive step of its type"),
    }
}

/// Decodes the factors of levels 1 and up. An error holds the offset in the page and the wrong bytes.
fn factors_at(page: &[u8], levels: usize) -> Result<Vec<[u32; 3]>, (usize, String)> {
    let wrong = |at: usize| (at, format!("{:?} with {levels} levels", &page[at..at + 3]));
    if !(1..=Lod::LIMIT).contains(&levels) {
        return Err(wrong(FACTORS_AT));
    }
    let triple = |i: usize| [0, 1, 2].map(|a| u32::from(page[FACTORS_AT + 3 * i + a]));
    let coarser = levels - 1;
    if let Some(i) = (coarser..Lod::LIMIT).find(|&i| triple(i) != [0; 3]) {
        return Err(wrong(FACTORS_AT + 3 * i));
    }
    Ok((0..coarser).map(triple).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn descriptor() -> Descriptor {
        Descriptor {
            voxel_type: VoxelType::I16,
            pyramid: Pyramid::new(Dims([100, 65, 17]), BrickLayout::DEFAULT, &[[2, 2, 1]]).expect("a valid pyramid"),
            geometry: Geometry { spacing: [1.0, 2.0, 3.0], origin: [-1.0, 0.5, 9.0], ..Geometry::IDENTITY },
            scale: -0.5,
            offset: 1024.0,
            absence: Absence { nodata: Some(-999.0) },
            quantizer: None,
        }
    }

    fn quantized() -> Descriptor {
        Descriptor { quantizer: Quantizer::within(VoxelType::I16, 3.0), ..descriptor() }
    }

    #[test]
    fn a_page_survives_the_round_trip() {
        let sections =
            Sections { toc_offset: 1, toc_bytes: 2, manifest_offset: 3, manifest_bytes: 4, manifest_checksum: 5 };
        let page = encode(&descriptor(), sections);
        let page: &[u8; PAGE_BYTES] = page.as_slice().try_into().expect("a page has its size");
        assert_eq!(decode(page, "footer", 0).expect("a written page reads"), (descriptor(), sections));
        let page = encode(&quantized(), sections);
        let page: &[u8; PAGE_BYTES] = page.as_slice().try_into().expect("a page has its size");
        assert_eq!(decode(page, "footer", 0).expect("a written page reads"), (quantized(), sections));
    }

    #[test]
    fn moved_voxels_and_their_versions_go_together() {
        let with = |descriptor: &Descriptor, version: u32, step: f64| {
            let mut page: [u8; PAGE_BYTES] = encode(descriptor, Sections::default()).try_into().expect("a page's size");
            page[8..12].copy_from_slice(&version.to_le_bytes());
            page[440..448].copy_from_slice(&step.to_le_bytes());
            let sum = checksum(&page[..CHECKSUM_AT]).to_le_bytes();
            page[CHECKSUM_AT..].copy_from_slice(&sum);
            decode(&page, "header", 0).map(|(descriptor, _)| descriptor.voxel_error())
        };
        assert!(matches!(with(&descriptor(), 1, 0.0), Ok(0.0)));
        assert!(matches!(with(&quantized(), 2, 7.0), Ok(3.0)));
        assert!(matches!((with(&descriptor(), 3, 0.0), with(&quantized(), 3, 7.0)), (Ok(0.0), Ok(3.0))));
        for (version, step) in
            [(1, 7.0), (2, 0.0), (2, -7.0), (2, f64::NAN), (2, f64::INFINITY), (3, -7.0), (3, f64::NAN)]
        {
            assert!(
                matches!(with(&quantized(), version, step), Err(ContainerError::Invalid { .. })),
                "{version} {step}"
            );
        }
        assert!(matches!(with(&quantized(), 5, 7.0), Err(ContainerError::Version { found: 5, known: 4 })));
    }

    /// The table in the module head is the specification: every field must have the offset given there.
    #[test]
    fn the_specification_s_offsets_hold() {
        let page = encode(
            &descriptor(),
            Sections { toc_offset: 11, toc_bytes: 12, manifest_offset: 13, manifest_bytes: 14, manifest_checksum: 15 },
        );
        assert_eq!(page.len(), 4096);
        assert_eq!(page[..8], [0x89, 0x53, 0x56, 0x4f, 0x4c, 0x0d, 0x0a, 0x1a]);
        let u32s: Vec<u32> = (8..40).step_by(4).map(|at| u32_at(&page, at)).collect();
        assert_eq!(u32s, [4, 4096, 4, 64, 2, 8, 2, 1]);
        assert_eq!([40, 48, 56].map(|at| u64_at(&page, at)), [100, 65, 17]);
        assert_eq!(f64s_at::<3>(&page, 64), [-0.5, 1024.0, -999.0]);
        assert_eq!(f64s_at::<3>(&page, 88), [1.0, 2.0, 3.0]);
        assert_eq!(f64s_at::<3>(&page, 112), [-1.0, 0.5, 9.0]);
        assert_eq!(f64s_at::<9>(&page, 136), Geometry::IDENTITY.direction);
        assert_eq!(page[208..214], [2, 2, 1, 0, 0, 0]);
        assert_eq!([400, 408, 416, 424, 432].map(|at| u64_at(&page, at)), [11, 12, 13, 14, 15]);
        assert!(page[440..4088].iter().all(|b| *b == 0));
        let quantized = encode(&quantized(), Sections::default());
        assert_eq!((u32_at(&quantized, 8), f64_at(&quantized, 440)), (4, 7.0));
        assert!(quantized[448..4088].iter().all(|b| *b == 0));
        assert_eq!(u64_at(&page, 4088), checksum(&page[..4088]));
    }

    #[test]
    fn every_flipped_bit_of_a_page_is_noticed() {
        let page = encode(&descriptor(), Sections::default());
        for bit in 0..PAGE_BYTES * 8 {
            let mut damaged: [u8; PAGE_BYTES] = page.as_slice().try_into().expect("a page has its size");
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&damaged, "header", 0).is_err(), "bit {bit} flipped unnoticed");
        }
    }
}
