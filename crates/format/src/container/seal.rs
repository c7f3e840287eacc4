//! Encoding of a brick's voxels to the TOC entry and the record of a container.

use super::header::Descriptor;
use super::reader::shape_of;
use super::toc::BrickEntry;
use super::writer::EncodedBrick;
use crate::codec::{self, Codec, CodecChoice, CodecError, Coding};
use crate::{BrickKey, ValueRange, cell_errors, macro_cells};

/// Makes the entry and the record of a brick from its stored voxels. [`check_brick`](super::validate::check_brick)
/// checks the result.
///
/// `children` is the union of the children's `range_beneath` (empty at level 0), `error` the brick's error bound; both
/// in stored units. All macro cells have that bound; [`EncodedBrick::set_errors`] gives them their own.
///
/// # Errors
/// If a codec cannot get memory.
///
/// # Panics
/// If the length of `voxels` is not that of the brick.
pub fn seal_brick(
    descriptor: &Descriptor,
    key: BrickKey,
    voxels: &[u8],
    choice: CodecChoice,
    children: ValueRange,
    error: f64,
) -> Result<EncodedBrick, CodecError> {
    let shape = shape_of(descriptor, key);
    let measured = macro_cells::measure(shape, voxels, descriptor.absence);
    let (codec, mut record, fill) = match measured.fill {
        Some(fill) => (Codec::Uniform, Vec::new(), fill),
        None => {
            let coding = Coding { choice, absence: descriptor.absence, quantizer: descriptor.quantizer };
            let (codec, payload) = codec::encode(coding, shape, voxels)?;
            (codec, payload, 0)
        }
    };
    let payload_bytes = record.len();
    if codec != Codec::Uniform {
        record.extend(macro_cells::quantize(&measured.cells, measured.range));
        if cell_errors::are_held(&descriptor.pyramid, key) {
            record.extend(cell_errors::quantize(&vec![error; measured.cells.len()], error));
        }
    }
    let entry = BrickEntry {
        offset: 0,
        payload_bytes: u32::try_from(payload_bytes).expect("a brick of 132^3 doubles has fewer than 2^32 bytes"),
        macro_cell_bytes: u32::try_from(record.len() - payload_bytes).expect("16^3 macro cells of three bytes are few"),
        codec,
        absent: measured.absent,
        uniform: measured.fill.is_some() && !measured.absent,
        has_holes: measured.has_holes,
        checksum: 0,
        fill,
        range: measured.range,
        range_beneath: measured.range.union(children),
        error,
    };
    Ok(EncodedBrick { key, entry, record })
}
