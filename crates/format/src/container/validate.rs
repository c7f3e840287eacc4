//! Rules of one container that can be checked brick by brick: [`check_brick`] and [`check_coverage`].
//!
//! Rules between levels (values of coarser voxels, error bounds) need several bricks at once. The preprocessor's
//! `verify` checks them, after it has called the functions of this module.

use super::ContainerError;
use super::reader::{Container, RECORDS_START};
use super::toc::BrickEntry;
use crate::codec::Codec;
use crate::{BrickKey, Lod, cast, macro_cells};

/// Checks one brick with the help of its record and its children's entries. Returns the entry and the stored voxels.
///
/// The rules:
/// - the record's checksum fits and the payload decodes;
/// - the flags describe the voxels;
/// - the range is exactly that of the voxels that interpolation reaches;
/// - the macro cells are exactly those that [`macro_cells::quantize`] makes;
/// - the range beneath is the union of this brick's range and the children's;
/// - at level 0 the error bound is 0, or that of moved voxels
///   ([`Descriptor::quantizer`](super::header::Descriptor::quantizer));
/// - at coarser levels the error bound is at least that of each child.
///
/// # Errors
/// The first broken rule, with the brick, what was expected and what was found.
pub fn check_brick(container: &Container, key: BrickKey) -> Result<(BrickEntry, Vec<u8>), ContainerError> {
    let entry = container.entry(key)?;
    let broken = |rule: &str, expected: String, found: String| {
        Err(ContainerError::invalid(format!("{key}: {rule}"), entry.offset, expected, found))
    };
    let mut record = vec![0; cast::index(entry.record_bytes())];
    container.read_at(entry.offset, &mut record)?;
    let shape = container.shape(key);
    let mut voxels = vec![0; shape.bytes()];
    container.decode_brick(key, &entry, &record, &mut voxels)?;

    let measured = macro_cells::measure(shape, &voxels, container.descriptor().absence);
    let uniform = measured.fill.is_some() && !measured.absent;
    let flags = (entry.absent, entry.has_holes, entry.uniform);
    if flags != (measured.absent, measured.has_holes, uniform) {
        let expected = format!("{:?}", (measured.absent, measured.has_holes, uniform));
        return broken("flags (absent, has holes, uniform)", expected, format!("{flags:?}"));
    }
    if entry.codec == Codec::Uniform && Some(entry.fill) != measured.fill {
        return broken("fill", format!("{:x?}", measured.fill), format!("{:x}", entry.fill));
    }
    if entry.range != measured.range {
        return broken("value range", format!("{:?}", measured.range), format!("{:?}", entry.range));
    }
    if entry.codec != Codec::Uniform {
        let expected = macro_cells::quantize(&measured.cells, measured.range);
        let found = &record[entry.payload_bytes as usize..][..expected.len()];
        if let Some(cell) = expected.chunks_exact(2).zip(found.chunks_exact(2)).position(|(e, f)| e != f) {
            let pair = |bytes: &[u8]| format!("{:?}", &bytes[2 * cell..2 * cell + 2]);
            return broken(&format!("macro cell {cell}"), pair(&expected), pair(found));
        }
    }
    let mut beneath = entry.range;
    let mut children_error: f64 = 0.0;
    for child in container.pyramid().children(key) {
        let child = container.entry(child)?;
        beneath = beneath.union(child.range_beneath);
        children_error = children_error.max(child.error);
    }
    if entry.range_beneath != beneath {
        return broken("range beneath", format!("{beneath:?}"), format!("{:?}", entry.range_beneath));
    }
    let moved = container.descriptor().voxel_error();
    if entry.error < children_error || (key.lod() == Lod::FINEST && entry.error > moved) {
        return broken(
            "error",
            format!("at least {children_error}, at most {moved} at level 0"),
            entry.error.to_string(),
        );
    }
    Ok((entry, voxels))
}

/// Checks that the records fill the space between header and TOC without gaps or overlaps.
///
/// Memory: 16 bytes per brick with a record.
///
/// # Errors
/// The first gap or overlap.
pub fn check_coverage(container: &Container) -> Result<(), ContainerError> {
    let pyramid = container.pyramid();
    let mut records = Vec::new();
    for key in (0..).map_while(|number| pyramid.key(number)) {
        let entry = container.entry(key)?;
        if entry.codec != Codec::Uniform {
            records.push((entry.offset, entry.record_bytes()));
        }
    }
    records.sort_unstable();
    let mut end = RECORDS_START;
    for (offset, bytes) in records {
        if offset != end {
            return Err(ContainerError::invalid(
                "brick records",
                end,
                "a record that begins here",
                format!("one at {offset}"),
            ));
        }
        end += bytes;
    }
    let toc = container.sections().toc_offset;
    if end == toc {
        Ok(())
    } else {
        Err(ContainerError::invalid(
            "brick records",
            end,
            format!("records up to the TOC at {toc}"),
            "unreachable bytes",
        ))
    }
}
