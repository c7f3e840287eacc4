//! Decoding of records on rayon's worker threads: checksum, codec, then conversion to the form that ray casters read.
//!
//! Each brick is decoded alone, so the result does not depend on the number of threads. A brick that cannot be decoded
//! is returned as an error of that brick; it never stops a frame.

use rayon::prelude::*;
use supervol_format::Container;
use supervol_format::container::ContainerError;
use supervol_format::container::toc::BrickEntry;
use supervol_scene::value_map::ValueMap;

use super::io::Record;
use crate::stream::field::FieldBrick;
use crate::stream::held::{HeldBrick, PackedBrick};
use crate::stream::residency::DecodedBrick;

/// A record that was read, with its TOC entry.
#[derive(Debug)]
pub struct Encoded {
    /// The brick.
    pub key: FieldBrick,
    /// Its entry.
    pub entry: BrickEntry,
    /// Its record.
    pub record: Record,
    /// An evicted brick whose memory is reused.
    pub spare: Option<DecodedBrick>,
}

/// Decodes bricks, in the order given. `packs`: those that become smaller are packed.
#[must_use]
pub fn decode_bricks(
    container: &Container,
    map: &ValueMap,
    bricks: Vec<Encoded>,
    packs: bool,
) -> Vec<(FieldBrick, Result<HeldBrick, ContainerError>)> {
    bricks
        .into_par_iter()
        .map_init(
            || (Vec::new(), None),
            |(voxels, plain), mut brick| {
                if packs {
                    brick.spare = plain.take().or(brick.spare);
                }
                let key = brick.key;
                let decoded = decode(container, map, brick, voxels);
                (key, decoded.map(|decoded| if packs { packed(decoded, plain) } else { HeldBrick::Plain(decoded) }))
            },
        )
        .collect()
}

/// Packs a brick if that makes it smaller; leaves the memory of its voxels to the next one.
fn packed(decoded: DecodedBrick, spare: &mut Option<DecodedBrick>) -> HeldBrick {
    match PackedBrick::new(&decoded) {
        Some(packed) => {
            *spare = Some(decoded);
            HeldBrick::Packed(packed)
        }
        None => HeldBrick::Plain(decoded),
    }
}

/// Decodes one brick; `voxels` is scratch space reused from brick to brick.
fn decode(
    container: &Container,
    map: &ValueMap,
    brick: Encoded,
    voxels: &mut Vec<u8>,
) -> Result<DecodedBrick, ContainerError> {
    let Encoded { key: FieldBrick { brick: key, .. }, entry, record, spare } = brick;
    let shape = container.shape(key);
    voxels.clear();
    voxels.resize(shape.bytes(), 0);
    container.decode_brick(key, &entry, record.bytes(), voxels)?;
    let cells = container.macro_cells(key, &entry, record.bytes()).into_iter().map(|r| [r.min, r.max]);
    let absence = container.descriptor().absence;
    let decoded = DecodedBrick::from_stored(key, shape, voxels, cells, map, absence, spare);
    Ok(decoded.with_macro_errors(container.cell_errors(key, &entry, record.bytes())))
}
