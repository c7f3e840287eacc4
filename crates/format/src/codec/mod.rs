//! Codecs: encoding of brick voxels to bytes, and decoding.
//!
//! A codec sees only the stored voxels of one brick (core and apron), little endian, x fastest. Decoders write into a
//! caller's buffer of exactly the decoded size. They trust nothing and fail instead of overrunning. All codecs are
//! lossless: the decoded bytes are the encoded ones, bit for bit. For containers with a bounded error, the voxels are
//! moved to multiples of a step before encoding ([`quantize`]).
//!
//! | tag | codec | payload | when it wins |
//! |---|---|---|---|
//! | 0 | uniform | none: the value is in the TOC entry | one value everywhere, or no data at all |
//! | 1 | [`raw`] | the voxels as they are | noise |
//! | 2 | [`rle`] | runs of equal voxels | labels, masks, sparse data |
//! | 3 | [`zstd`] | predicted differences, byte planes, Zstandard | nearly everything else |
//! | 4 | [`wavelet`] | multiples of a step, transformed | measured data: integers, and floats with a common step |
//! | 5 | [`trimmed`] | raw, rle or zstd, without repeated layers of apron | edges of a grid, above all of a thin one |
//!
//! [`tree`] codes voxels as details of the next coarser level's. It has no tag: no container uses it yet.

mod chunks;
mod compressor;
mod payload;
pub mod quantize;
pub mod raw;
mod repeats;
pub mod rle;
mod sample;
mod tokens;
pub mod tree;
pub mod trimmed;
pub mod wavelet;
pub mod zstd;

pub use self::payload::{BrickShape, Codec, CodecError};
use crate::VoxelType;
use crate::voxel_type::Absence;
use quantize::Quantizer;

/// Codecs that the writer may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CodecChoice {
    /// The codec with the smallest payload, chosen per brick.
    Smallest,
    /// This codec for every brick that is not uniform, with three exceptions. A brick that would grow is stored raw.
    /// Zstd replaces wavelet if the voxels are not multiples of a step. Trimmed replaces rle and zstd if layers of
    /// apron repeat. Without such layers, trimmed means the smallest of raw, rle and zstd.
    Only(Codec),
}

impl CodecChoice {
    /// Name in options and reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Smallest => "auto",
            Self::Only(codec) => codec.name(),
        }
    }
}

/// Options of the encoder, and facts about the voxels that their bytes do not tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coding {
    /// Codecs that may be used.
    pub choice: CodecChoice,
    /// Rule for absent voxels.
    pub absence: Absence,
    /// Present voxels are multiples of this quantizer's step; `None` if they were not moved.
    pub quantizer: Option<Quantizer>,
}

/// Coding of voxels about which nothing else is known.
impl From<CodecChoice> for Coding {
    fn from(choice: CodecChoice) -> Self {
        Self { choice, absence: Absence::NON_FINITE_ONLY, quantizer: None }
    }
}

/// Encodes the stored voxels of one brick. Returns the codec used and the payload.
///
/// # Errors
/// If Zstandard cannot get memory.
///
/// # Panics
/// If the length of `voxels` is not that of `shape`, or the choice is [`Codec::Uniform`], which has no payload.
pub fn encode(coding: impl Into<Coding>, shape: BrickShape, voxels: &[u8]) -> Result<(Codec, Vec<u8>), CodecError> {
    assert_eq!(voxels.len(), shape.bytes(), "a brick of {:?} {} has other bytes", shape.extent, shape.voxel_type);
    let Coding { choice, absence, quantizer } = coding.into();
    let wavelet = |limit| wavelet::encode_if_smaller(shape, voxels, absence, quantizer, limit);
    match choice {
        CodecChoice::Only(Codec::Uniform) => panic!("a uniform brick has no payload to encode"),
        CodecChoice::Only(Codec::Raw) => Ok((Codec::Raw, voxels.to_vec())),
        CodecChoice::Only(Codec::Rle) => without_repeats(shape, voxels, |shape, voxels| {
            Ok(unless_larger(Codec::Rle, rle::encode(shape, voxels), voxels))
        }),
        CodecChoice::Only(Codec::Zstd) => without_repeats(shape, voxels, zstd_unless_larger),
        CodecChoice::Only(Codec::Wavelet) => match wavelet(voxels.len())? {
            Some(payload) => Ok((Codec::Wavelet, payload)),
            None => without_repeats(shape, voxels, zstd_unless_larger),
        },
        CodecChoice::Only(Codec::Trimmed) => without_repeats(shape, voxels, smallest_plain),
        CodecChoice::Smallest => {
            // On equal size the codec that decodes faster wins; wavelets decode slowest.
            let best = without_repeats(shape, voxels, smallest_plain)?;
            Ok(wavelet(best.1.len())?.map_or(best, |payload| (Codec::Wavelet, payload)))
        }
    }
}

/// Encodes a brick without its repeated layers of apron, or the whole brick if no layer repeats.
fn without_repeats(
    shape: BrickShape,
    voxels: &[u8],
    encode: impl Fn(BrickShape, &[u8]) -> Result<(Codec, Vec<u8>), CodecError>,
) -> Result<(Codec, Vec<u8>), CodecError> {
    let Some((bits, left, trimmed)) = trimmed::trim(shape, voxels) else { return encode(shape, voxels) };
    let (codec, payload) = encode(left, &trimmed)?;
    Ok((Codec::Trimmed, trimmed::wrap(bits, codec, &payload)))
}

fn zstd_unless_larger(shape: BrickShape, voxels: &[u8]) -> Result<(Codec, Vec<u8>), CodecError> {
    Ok(unless_larger(Codec::Zstd, zstd::encode(shape, voxels)?, voxels))
}

/// The smallest of raw, rle and zstd. On equal size the one that decodes faster wins: raw before rle before zstd.
fn smallest_plain(shape: BrickShape, voxels: &[u8]) -> Result<(Codec, Vec<u8>), CodecError> {
    let mut best = (Codec::Zstd, zstd::encode(shape, voxels)?);
    if let Some(payload) = rle::encode_if_smaller(shape, voxels, best.1.len()) {
        best = (Codec::Rle, payload);
    }
    if voxels.len() <= best.1.len() {
        best = (Codec::Raw, voxels.to_vec());
    }
    Ok(best)
}

/// The payload, or the raw voxels if the payload is larger: no brick ever expands.
fn unless_larger(codec: Codec, payload: Vec<u8>, voxels: &[u8]) -> (Codec, Vec<u8>) {
    if payload.len() > voxels.len() { (Codec::Raw, voxels.to_vec()) } else { (codec, payload) }
}

/// Decodes a payload into `out`, whose length must be exactly that of the brick.
///
/// # Errors
/// If the payload is not one that [`encode`] makes for this shape.
///
/// # Panics
/// If the length of `out` is not that of `shape`.
pub fn decode_into(codec: Codec, shape: BrickShape, payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    assert_eq!(out.len(), shape.bytes(), "a brick of {:?} {} has other bytes", shape.extent, shape.voxel_type);
    match codec {
        Codec::Uniform => Err(CodecError::NoPayload { codec: codec.name() }),
        Codec::Raw => raw::decode_into(payload, out),
        Codec::Rle => rle::decode_into(shape, payload, out),
        Codec::Zstd => zstd::decode_into(shape, payload, out),
        Codec::Wavelet => wavelet::decode_into(shape, payload, out),
        Codec::Trimmed => trimmed::decode_into(shape, payload, out),
    }
}

/// Fills `out` with the voxel of a uniform brick; its bytes are the lowest of `fill`.
pub fn decode_uniform(voxel_type: VoxelType, fill: u64, out: &mut [u8]) {
    let bytes = fill.to_le_bytes();
    // Voxels are written as arrays, so that the compiler vectorizes the loop.
    match voxel_type.bytes() {
        1 => out.fill(bytes[0]),
        2 => out.as_chunks_mut::<2>().0.fill([bytes[0], bytes[1]]),
        4 => out.as_chunks_mut::<4>().0.fill([bytes[0], bytes[1], bytes[2], bytes[3]]),
        _ => out.as_chunks_mut::<8>().0.fill(bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::with_voxel;
    use proptest::prelude::*;

    /// Codecs with a payload: all but the first.
    const CODECS: &[Codec] = Codec::ALL.split_at(1).1;

    fn round_trip(shape: BrickShape, voxels: &[u8]) {
        let smallest = encode(CodecChoice::Smallest, shape, voxels).expect("encoding needs only memory").1.len();
        let choices = CODECS.iter().copied().map(CodecChoice::Only).chain([CodecChoice::Smallest]);
        for choice in choices {
            let (codec, payload) = encode(choice, shape, voxels).expect("encoding needs only memory");
            assert!(smallest <= payload.len(), "{} {shape:?}: {smallest} of {}", codec.name(), payload.len());
            let mut out = vec![0xa5; voxels.len()];
            decode_into(codec, shape, &payload, &mut out).expect("what was encoded decodes");
            assert!(out == voxels, "{} {shape:?} is not lossless", codec.name());
        }
    }

    #[test]
    fn every_codec_is_exact_for_every_type_over_odd_fields() {
        for voxel_type in VoxelType::ALL {
            for extent in [[5, 5, 5], [20, 20, 20], [9, 7, 6], [68, 5, 5]] {
                let shape = BrickShape { voxel_type, extent };
                let n = shape.voxels();
                let fields: [&dyn Fn(usize) -> f64; 5] = [
                    &|_| 7.0,
                    &|i| i as f64 * 0.25,
                    &|i| if i % 97 == 0 { f64::NAN } else { -3.0 },
                    &|i| [f64::MAX, f64::MIN, 5e-324, -0.0, f64::INFINITY, f64::NEG_INFINITY][i % 6],
                    &|i| ((i.wrapping_mul(2_654_435_761)) >> 7) as f64,
                ];
                for field in fields {
                    let bytes: Vec<u8> = with_voxel!(voxel_type, V => {
                        let mut bytes = vec![0; shape.bytes()];
                        for (i, b) in bytes.chunks_exact_mut(size_of::<V>()).enumerate() {
                            crate::voxel_type::Voxel::write_le(<V as crate::voxel_type::Voxel>::from_f64(field(i)), b);
                        }
                        bytes
                    });
                    assert_eq!(bytes.len() / voxel_type.bytes(), n);
                    round_trip(shape, &bytes);
                }
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

        #[test]
        fn decoders_survive_any_bytes(tag in 1..Codec::ALL.len() as u8, payload in proptest::collection::vec(any::<u8>(), 0..400), t in 0usize..8) {
            let shape = BrickShape { voxel_type: VoxelType::ALL[t], extent: [6, 5, 7] };
            let mut out = vec![0; shape.bytes()];
            let codec = Codec::from_tag(tag).expect("every tag below the number of codecs is known");
            // The result may be an error, but never a panic or an overrun.
            let _ = decode_into(codec, shape, &payload, &mut out);
        }

        #[test]
        fn damaged_payloads_never_panic(flip in any::<usize>(), cut in any::<usize>(), t in 0usize..8) {
            let shape = BrickShape { voxel_type: VoxelType::ALL[t], extent: [8, 6, 5] };
            let voxels: Vec<u8> = (0..shape.bytes()).map(|i| (i / 13) as u8).collect();
            for &codec in CODECS {
                let (_, mut payload) = encode(CodecChoice::Only(codec), shape, &voxels).expect("encoding needs only memory");
                let bit = flip % (payload.len() * 8);
                payload[bit / 8] ^= 1 << (bit % 8);
                payload.truncate(1 + cut % payload.len());
                let mut out = vec![0; shape.bytes()];
                let _ = decode_into(codec, shape, &payload, &mut out);
            }
        }
    }
}
