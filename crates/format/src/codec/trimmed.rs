//! The voxels of a brick without repeated layers of apron, coded by another codec: [`raw`], [`rle`] or [`zstd`].
//!
//! Payload:
//! 1. One byte; bits 0 to 5 stand for the low end of x, the high end of x, the low end of y, ... A set bit means that
//!    both layers of apron at this end repeat the outermost layer of the core and are not coded. At least one bit is
//!    set.
//! 2. One byte: the tag of the other codec (1, 2 or 3).
//! 3. The other codec's payload of the remaining voxels, x fastest.
//!
//! The wavelet codec ([`super::wavelet`]) leaves out repeated layers itself.

use super::payload::{BrickShape, Codec, CodecError};
use super::repeats::{Places, Repeats};
use super::{raw, rle, zstd};

/// Bytes before the payload of the other codec.
pub(super) const HEAD_BYTES: usize = 2;

/// First byte of the payload, and shape and bytes of the remaining voxels. `None` if no layer repeats.
pub(super) fn trim(shape: BrickShape, voxels: &[u8]) -> Option<(u8, BrickShape, Vec<u8>)> {
    let size = shape.voxel_type.bytes();
    let repeats = match size {
        1 => Repeats::of(voxels, shape.extent),
        2 => Repeats::of(voxels.as_chunks::<2>().0, shape.extent),
        4 => Repeats::of(voxels.as_chunks::<4>().0, shape.extent),
        _ => Repeats::of(voxels.as_chunks::<8>().0, shape.extent),
    };
    if !repeats.any() {
        return None;
    }
    let (from, coded) = repeats.coded(shape.extent);
    let left = BrickShape { extent: coded, ..shape };
    let mut out = Vec::with_capacity(left.bytes());
    for z in from[2]..from[2] + coded[2] {
        for y in from[1]..from[1] + coded[1] {
            let start = ((z * shape.extent[1] + y) * shape.extent[0] + from[0]) * size;
            out.extend_from_slice(&voxels[start..start + coded[0] * size]);
        }
    }
    Some((repeats.bits(), left, out))
}

/// Payload of this codec around the payload of another codec.
pub(super) fn wrap(bits: u8, codec: Codec, payload: &[u8]) -> Vec<u8> {
    [&[bits, codec as u8], payload].concat()
}

/// Decodes into a buffer of exactly the brick's size.
///
/// # Errors
/// If the payload is not one that [`super::encode`] makes for this shape.
pub fn decode_into(shape: BrickShape, payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    let wrong = |reason: String| CodecError::Trimmed { reason };
    let Some((&[bits, tag], inner)) = payload.split_first_chunk::<HEAD_BYTES>() else {
        return Err(wrong(format!("{} bytes; expected at least {HEAD_BYTES}", payload.len())));
    };
    let repeats = Repeats::from_bits(bits, shape.extent)
        .filter(|repeats| repeats.any())
        .ok_or_else(|| wrong(format!("layers {bits:#010b}; expected some that {:?} voxels have", shape.extent)))?;
    let (from, coded) = repeats.coded(shape.extent);
    let left = BrickShape { extent: coded, ..shape };
    let target = &mut out[..left.bytes()];
    match Codec::from_tag(tag) {
        Some(Codec::Raw) => raw::decode_into(inner, target),
        Some(Codec::Rle) => rle::decode_into(left, inner, target),
        Some(Codec::Zstd) => zstd::decode_into(left, inner, target),
        _ => Err(wrong(format!("codec {tag} within; expected 1, 2 or 3"))),
    }?;
    spread(&Places { from, coded, extent: shape.extent }, shape.voxel_type.bytes(), out);
    Ok(())
}

/// Moves the coded voxels from the beginning of the buffer to their positions, and repeats them.
///
/// The loop starts with the last row. Row r is made of coded row s(r) <= r. That lies at or before row r, because coded
/// rows are no longer than those of the brick. Later steps read coded rows up to s(r - 1) <= r - 1. These end at or
/// before the beginning of row r, so no step overwrites voxels that a later step reads.
fn spread(places: &Places, size: usize, out: &mut [u8]) {
    let row_bytes = places.extent[0] * size;
    let coded_bytes = places.coded[0] * size;
    for (row, first) in places.rows().enumerate().rev() {
        let start = row * row_bytes;
        let source = first * size;
        out.copy_within(source..source + coded_bytes, start + places.from[0] * size);
        places.repeat_along(&mut out[start..start + row_bytes], size);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{CodecChoice, encode};
    use super::*;
    use crate::VoxelType;

    /// Brick whose voxels are computed from their positions. Layers of apron repeat at the ends that `clamp` selects.
    fn brick(shape: BrickShape, clamp: [[bool; 2]; 3], value: impl Fn([usize; 3]) -> u64) -> Vec<u8> {
        let [nx, ny, _] = shape.extent;
        let place = |i: usize| {
            let place = [i % nx, i / nx % ny, i / (nx * ny)];
            std::array::from_fn(|a| {
                let n = shape.extent[a];
                let low = if clamp[a][0] { 2 } else { 0 };
                let high = if clamp[a][1] { n - 3 } else { n - 1 };
                place[a].clamp(low, high)
            })
        };
        let size = shape.voxel_type.bytes();
        (0..shape.voxels()).flat_map(|i| value(place(i)).to_le_bytes()[..size].to_vec()).collect()
    }

    fn noise([x, y, z]: [usize; 3]) -> u64 {
        crate::random::mix((x + 100 * y + 10_000 * z) as u64 + 1)
    }

    fn smooth([x, y, z]: [usize; 3]) -> u64 {
        (x + y * y + 3 * z) as u64
    }

    fn runs([_, y, _]: [usize; 3]) -> u64 {
        (y / 4) as u64
    }

    #[test]
    fn every_choice_of_layers_comes_back_by_every_codec_within() {
        for voxel_type in [VoxelType::U8, VoxelType::I16, VoxelType::F32, VoxelType::F64] {
            for extent in [[5, 9, 12], [20, 5, 7], [9, 8, 5], [5, 5, 5]] {
                let shape = BrickShape { voxel_type, extent };
                for bits in 1..64u8 {
                    let clamp = std::array::from_fn(|a| [0, 1].map(|end| bits >> (2 * a + end) & 1 == 1));
                    for value in [noise, smooth, runs] {
                        let voxels = brick(shape, clamp, value);
                        let (found, left, trimmed) = trim(shape, &voxels).expect("layers repeat");
                        assert_eq!(found & bits, bits, "{extent:?}");
                        let within = [
                            (Codec::Raw, trimmed.clone()),
                            (Codec::Rle, rle::encode(left, &trimmed)),
                            (Codec::Zstd, zstd::encode(left, &trimmed).expect("encoding needs only memory")),
                        ];
                        for (codec, inner) in within {
                            let mut out = vec![0xa5; voxels.len()];
                            let decoded = decode_into(shape, &wrap(found, codec, &inner), &mut out);
                            decoded.expect("what was encoded decodes");
                            assert!(out == voxels, "{shape:?}, layers {bits:#b}, {}", codec.name());
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn a_section_takes_what_its_one_layer_takes() {
        let floats = |p: [usize; 3]| u64::from((noise(p) as f32 / 3.0).to_bits());
        for axis in 0..3 {
            let mut extent = [44, 44, 44];
            extent[axis] = 5;
            let mut clamp = [[false; 2]; 3];
            clamp[axis] = [true; 2];
            let shape = BrickShape { voxel_type: VoxelType::F32, extent };
            let (codec, payload) =
                encode(CodecChoice::Smallest, shape, &brick(shape, clamp, floats)).expect("encoding needs only memory");
            assert_eq!(codec, Codec::Trimmed);
            assert!(payload.len() <= 44 * 44 * 4 + HEAD_BYTES, "{} bytes", payload.len());
        }
    }

    #[test]
    fn bricks_without_such_layers_are_coded_as_before() {
        let shape = BrickShape { voxel_type: VoxelType::U16, extent: [12, 12, 12] };
        let voxels = brick(shape, [[false; 2]; 3], |p| noise(p) & 3);
        for choice in [Codec::Rle, Codec::Zstd].map(CodecChoice::Only) {
            let (codec, _) = encode(choice, shape, &voxels).expect("encoding needs only memory");
            assert_ne!(codec, Codec::Trimmed);
        }
    }

    #[test]
    fn stored_bytes_stay_as_they_are() {
        let shape = BrickShape { voxel_type: VoxelType::U8, extent: [5, 5, 5] };
        let mut voxels = [7; 125];
        voxels[62] = 8;
        assert_eq!(trim(shape, &voxels), None, "the middle stands alone");
        // Along x every voxel repeats the middle column; 25 voxels remain.
        let voxels: Vec<u8> = (0..125).map(|i| (i / 5) as u8).collect();
        let (bits, left, trimmed) = trim(shape, &voxels).expect("x repeats");
        assert_eq!((bits, left.extent, trimmed.len()), (0b11, [1, 5, 5], 25));
        let payload = wrap(bits, Codec::Raw, &trimmed);
        assert_eq!(payload[..5], [3, 1, 0, 1, 2]);
        let mut out = [0; 125];
        decode_into(shape, &payload, &mut out).expect("what was encoded decodes");
        assert_eq!(out[..], voxels[..]);
    }

    #[test]
    fn wrong_heads_are_refused_by_name() {
        let shape = BrickShape { voxel_type: VoxelType::U8, extent: [5, 4, 9] };
        let said = |payload: &[u8]| {
            let refused = decode_into(shape, payload, &mut [0; 5 * 4 * 9]);
            refused.expect_err("it is none that is written").to_string()
        };
        assert!(said(&[3]).contains("at least 2"));
        assert!(said(&[0, 1]).contains("layers"));
        assert!(said(&[0x43, 1]).contains("layers"));
        assert!(said(&[0b100, 1]).contains("layers"), "4 voxels along y are no core and two aprons");
        assert!(said(&[3, 4]).contains("codec 4 within"));
        assert!(said(&[3, 5]).contains("codec 5 within"));
        assert!(!said(&[3, 1, 0]).is_empty(), "too few raw voxels");
    }
}
