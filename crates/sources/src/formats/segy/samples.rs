//! Sample formats of SEG-Y, and their exact conversion to the voxel types.
//!
//! Samples go in as the file has them and come out as little-endian voxels. Every conversion here is exact, with one
//! stated exception: IBM numbers below 2^-126 round to the nearest subnormal f32, ties to even. What no voxel type can
//! hold (IBM numbers beyond f32's range, 64-bit integers that f64 would round) is an error with the sample's place:
//! saturating or going through infinity would show a value the file does not have.

use supervol_format::VoxelType;

use crate::cast::{self, single};
use crate::{Endian, Message, ReadOption};

/// Type of a sample in the file: the data sample format code, bytes 3225-3226.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SampleFormat {
    Ibm32,
    I32,
    I16,
    FixedPointWithGain,
    F32,
    F64,
    I24,
    I8,
    I64,
    U32,
    U16,
    U64,
    U24,
    U8,
}

/// Message of a text, the option of the sample format, and a value of it.
pub(super) fn say_format(start: &str, value: &str) -> Message {
    Message::from(start).option(ReadOption::SampleFormat).text(format_args!(" {value}"))
}

impl SampleFormat {
    /// The format with this code (SEG-Y revision 2, table of bytes 3225-3226), if there is one.
    pub(super) fn from_code(code: u16) -> Option<Self> {
        Some(match code {
            1 => Self::Ibm32,
            2 => Self::I32,
            3 => Self::I16,
            4 => Self::FixedPointWithGain,
            5 => Self::F32,
            6 => Self::F64,
            7 => Self::I24,
            8 => Self::I8,
            9 => Self::I64,
            10 => Self::U32,
            11 => Self::U16,
            12 => Self::U64,
            15 => Self::U24,
            16 => Self::U8,
            _ => return None,
        })
    }

    /// Bytes of one sample in the file: 1, 2, 3, 4 or 8.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I24 | Self::U24 => 3,
            Self::Ibm32 | Self::I32 | Self::FixedPointWithGain | Self::F32 | Self::U32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
        }
    }

    /// The smallest voxel type that holds every sample we accept of this format.
    pub(super) fn voxel_type(self) -> VoxelType {
        match self {
            Self::Ibm32 | Self::F32 | Self::FixedPointWithGain => VoxelType::F32,
            Self::F64 | Self::I64 | Self::U64 => VoxelType::F64,
            Self::I32 | Self::I24 => VoxelType::I32,
            Self::U32 | Self::U24 => VoxelType::U32,
            Self::I16 => VoxelType::I16,
            Self::U16 => VoxelType::U16,
            Self::I8 => VoxelType::I8,
            Self::U8 => VoxelType::U8,
        }
    }
}

/// A sample that the voxel type cannot hold.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct BadSample {
    /// Index into the samples that were decoded.
    pub(super) index: usize,
    /// The defect.
    pub(super) reason: String,
}

/// The value of an IBM System/360 single, rounded to f32.
///
/// value = (-1)^s * 0.F * 16^(E - 64), F of 24 bits, E of 7 bits, no hidden bit. F * 2^(4 (E - 64) - 24) is exact in
/// f64, so the only rounding is that of the last conversion, and it happens only below 2^-126. Beyond f32 the result
/// is infinite, which [`decode`] reports.
#[inline]
pub(super) fn f32_from_ibm(word: u32) -> f32 {
    let exponent = u64::from((word >> 24) & 0x7F);
    // Biased exponent of 2^(4 (E - 64) - 24): between 743 and 1251, so always a normal f64.
    let power = f64::from_bits((4 * exponent + 743) << 52);
    let magnitude = single(f64::from(word & 0x00FF_FFFF) * power);
    f32::from_bits(magnitude.to_bits() | (word & 0x8000_0000))
}

/// Maps samples of `N` bytes, most significant byte first, to voxels of `M` bytes.
fn convert<const N: usize, const M: usize>(
    raw: &[u8],
    endian: Endian,
    out: &mut [u8],
    voxel: impl Fn([u8; N]) -> [u8; M],
) {
    let pairs = raw.as_chunks::<N>().0.iter().zip(out.as_chunks_mut::<M>().0);
    match endian {
        Endian::Big => pairs.for_each(|(sample, out)| *out = voxel(*sample)),
        Endian::Little => pairs.for_each(|(sample, out)| {
            let mut sample = *sample;
            sample.reverse();
            *out = voxel(sample);
        }),
    }
}

/// Decodes samples to little-endian voxels of `voxel_type`: the format's own, or the wider integer that
/// [`super::nodata`] may ask for.
///
/// # Panics
/// If `raw` and `out` do not hold the same number of samples.
pub(super) fn decode(
    format: SampleFormat,
    endian: Endian,
    voxel_type: VoxelType,
    raw: &[u8],
    out: &mut [u8],
) -> Result<(), BadSample> {
    assert_eq!(raw.len() / format.bytes(), out.len() / voxel_type.bytes(), "as many voxels as samples");
    use SampleFormat as S;
    use VoxelType as V;
    match (format, voxel_type) {
        (S::Ibm32, _) => {
            convert(raw, endian, out, |b| f32_from_ibm(u32::from_be_bytes(b)).to_le_bytes());
            return check_ibm(raw, endian, out);
        }
        (S::I64, _) => {
            convert(raw, endian, out, |b| (i64::from_be_bytes(b) as f64).to_le_bytes());
            return check_64_bit(raw, endian, |b| i128::from(i64::from_be_bytes(b)));
        }
        (S::U64, _) => {
            convert(raw, endian, out, |b| (u64::from_be_bytes(b) as f64).to_le_bytes());
            return check_64_bit(raw, endian, |b| i128::from(u64::from_be_bytes(b)));
        }
        (S::I24, _) => {
            convert(raw, endian, out, |[a, b, c]| (i32::from_be_bytes([a, b, c, 0]) >> 8).to_le_bytes());
        }
        (S::U24, _) => convert(raw, endian, out, |[a, b, c]| [c, b, a, 0]),
        (S::U8, V::I16) => convert(raw, endian, out, |[a]| i16::from(a).to_le_bytes()),
        (S::I8, V::I16) => convert(raw, endian, out, |b| i16::from(i8::from_be_bytes(b)).to_le_bytes()),
        (S::U16, V::I32) => convert(raw, endian, out, |b| i32::from(u16::from_be_bytes(b)).to_le_bytes()),
        (S::I16, V::I32) => convert(raw, endian, out, |b| i32::from(i16::from_be_bytes(b)).to_le_bytes()),
        (S::U8 | S::I8, _) => out.copy_from_slice(raw),
        (S::U16 | S::I16, _) => convert(raw, endian, out, |b| u16::from_be_bytes(b).to_le_bytes()),
        (S::F64, _) => convert(raw, endian, out, |b| u64::from_be_bytes(b).to_le_bytes()),
        (S::I32 | S::U32 | S::F32 | S::FixedPointWithGain, _) => {
            convert(raw, endian, out, |b| u32::from_be_bytes(b).to_le_bytes());
        }
    }
    Ok(())
}

/// Finds an IBM number that became infinite.
fn check_ibm(raw: &[u8], endian: Endian, decoded: &[u8]) -> Result<(), BadSample> {
    let infinite = |b: &[u8; 4]| f32::from_le_bytes(*b).is_infinite();
    let Some(index) = decoded.as_chunks::<4>().0.iter().position(infinite) else { return Ok(()) };
    let mut word = raw.as_chunks::<4>().0[index];
    if endian == Endian::Little {
        word.reverse();
    }
    let word = u32::from_be_bytes(word);
    Err(BadSample { index, reason: format!("IBM float 0x{word:08X}, which is beyond the range of f32") })
}

/// Finds a 64-bit integer that f64 rounds.
fn check_64_bit(raw: &[u8], endian: Endian, value: impl Fn([u8; 8]) -> i128) -> Result<(), BadSample> {
    for (index, sample) in raw.as_chunks::<8>().0.iter().enumerate() {
        let mut sample = *sample;
        if endian == Endian::Little {
            sample.reverse();
        }
        let exact = value(sample);
        if cast::whole::<i128>(exact as f64) != exact {
            return Err(BadSample { index, reason: format!("{exact}, which f64 cannot hold exactly") });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode_vec(code: u16, endian: Endian, raw: &[u8]) -> Result<Vec<u8>, BadSample> {
        let format = SampleFormat::from_code(code).unwrap();
        let mut out = vec![0; raw.len() / format.bytes() * format.voxel_type().bytes()];
        decode(format, endian, format.voxel_type(), raw, &mut out).map(|()| out)
    }

    #[test]
    fn known_ibm_bit_patterns() {
        // -118.625 is the worked example of IBM's System/360 Principles of Operation.
        let cases = [
            (0xC276_A000, -118.625),
            (0x4110_0000, 1.0),
            (0xC110_0000, -1.0),
            (0x4080_0000, 0.5),
            (0x4264_0000, 100.0),
            (0x0000_0000, 0.0),
            (0x8000_0000, -0.0),
            (0x4019_999A, 1_677_722.0 / 16_777_216.0), // 0.1 as far as 21 bits go
            (0x4600_0001, 1.0),                        // unnormalised
            (0x60FF_FFFF, f32::MAX),
        ];
        for (word, value) in cases {
            assert_eq!(f32_from_ibm(word).to_bits(), f32::to_bits(value), "0x{word:08X}");
        }
    }

    #[test]
    fn small_ibm_numbers_underflow_gradually_and_round_to_even() {
        // 0.F * 16^(E-64): E = 64 - 37 gives F * 2^-172, so F = 2^23 is 2^-149, the smallest subnormal.
        assert_eq!(f32_from_ibm((27 << 24) | 0x80_0000), f32::from_bits(1));
        assert_eq!(f32_from_ibm((27 << 24) | 0x40_0000), 0.0, "half of it is a tie and goes to even");
        assert_eq!(f32_from_ibm((27 << 24) | 0x40_0001), f32::from_bits(1));
        assert_eq!(f32_from_ibm((27 << 24) | 0xC0_0000), f32::from_bits(2), "one and a half goes to even");
        assert_eq!(f32_from_ibm(0x0010_0000), 0.0);
    }

    #[test]
    fn ibm_beyond_f32_is_an_error() {
        let mut raw = 0x4110_0000_u32.to_be_bytes().to_vec();
        raw.extend(0x6110_0000_u32.to_be_bytes());
        let bad = decode_vec(1, Endian::Big, &raw).unwrap_err();
        assert_eq!(bad.index, 1);
        assert!(bad.reason.contains("0x61100000"), "{}", bad.reason);
        assert!(f32_from_ibm(0x7FFF_FFFF).is_infinite());
    }

    #[test]
    fn ibm_conversion_is_monotone_in_normalised_words() {
        let mut last = -1.0;
        for exponent in 0..=0x60_u32 {
            for fraction in (0x10_0000..=0xFF_FFFF_u32).step_by(0x1_2345) {
                let value = f32_from_ibm((exponent << 24) | fraction);
                assert!(value >= last, "{value} after {last}");
                last = value;
            }
        }
    }

    #[test]
    fn three_byte_integers_keep_their_sign() {
        let raw = [0xFF, 0xFF, 0xFE, 0x80, 0x00, 0x00, 0x7F, 0xFF, 0xFF];
        let values =
            |bytes: Vec<u8>| -> Vec<i32> { bytes.as_chunks::<4>().0.iter().map(|b| i32::from_le_bytes(*b)).collect() };
        assert_eq!(values(decode_vec(7, Endian::Big, &raw).unwrap()), [-2, -8_388_608, 8_388_607]);
        assert_eq!(values(decode_vec(15, Endian::Big, &raw).unwrap()), [0xFF_FFFE, 0x80_0000, 0x7F_FFFF]);
        assert_eq!(values(decode_vec(7, Endian::Little, &[0xFE, 0xFF, 0xFF]).unwrap()), [-2]);
    }

    #[test]
    fn long_integers_are_exact_or_refused() {
        let exact = decode_vec(9, Endian::Big, &(-(1_i64 << 53)).to_be_bytes()).unwrap();
        assert_eq!(f64::from_le_bytes(exact.try_into().unwrap()), -9_007_199_254_740_992.0);
        assert!(decode_vec(9, Endian::Big, &((1_i64 << 53) + 1).to_be_bytes()).is_err());
        assert!(decode_vec(9, Endian::Big, &i64::MAX.to_be_bytes()).is_err());
        assert!(decode_vec(12, Endian::Little, &u64::MAX.to_le_bytes()).is_err());
        assert!(decode_vec(12, Endian::Little, &(1_u64 << 63).to_le_bytes()).is_ok());
    }
}
