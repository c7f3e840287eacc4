//! Numbers in SEG-Y headers, addressed as the standard addresses them: by the number of their first byte, from 1.
//!
//! The 400 bytes of the binary header are bytes 3201 to 3600 of the file; the 240 bytes of a trace header are bytes
//! 1 to 240 of the trace. [`Fields`] knows which of the two it looks at; asking for a byte outside is our own mistake.

use crate::Endian;

/// A header's bytes and how to read them.
#[derive(Clone, Copy)]
pub(super) struct Fields<'a> {
    bytes: &'a [u8],
    /// Standard's number of `bytes[0]`: 3201 or 1.
    first: usize,
    endian: Endian,
}

impl<'a> Fields<'a> {
    /// The binary file header; `bytes` are the file's bytes 3201 to 3600.
    pub(super) fn binary_header(bytes: &'a [u8; 400], endian: Endian) -> Self {
        Self { bytes, first: 3201, endian }
    }

    /// A standard trace header.
    pub(super) fn trace_header(bytes: &'a [u8; 240], endian: Endian) -> Self {
        Self { bytes, first: 1, endian }
    }

    /// `N` bytes from byte number `byte` on, most significant first.
    fn big<const N: usize>(&self, byte: usize) -> [u8; N] {
        let at = byte - self.first;
        let mut word: [u8; N] =
            self.bytes[at..at + N].try_into().expect("the range has N bytes; byte numbers are constants or checked");
        if self.endian == Endian::Little {
            word.reverse();
        }
        word
    }

    pub(super) fn i16(&self, byte: usize) -> i16 {
        i16::from_be_bytes(self.big(byte))
    }

    pub(super) fn u16(&self, byte: usize) -> u16 {
        u16::from_be_bytes(self.big(byte))
    }

    pub(super) fn i32(&self, byte: usize) -> i32 {
        i32::from_be_bytes(self.big(byte))
    }

    pub(super) fn u32(&self, byte: usize) -> u32 {
        u32::from_be_bytes(self.big(byte))
    }

    pub(super) fn u64(&self, byte: usize) -> u64 {
        u64::from_be_bytes(self.big(byte))
    }

    pub(super) fn f64(&self, byte: usize) -> f64 {
        f64::from_be_bytes(self.big(byte))
    }
}

/// A header value with its SEG-Y scalar applied: positive multiplies, negative divides, zero means none. Dividing, and
/// not multiplying by a rounded inverse, keeps decimal coordinates as close as they can be.
pub(super) fn scaled(value: f64, scalar: i16) -> f64 {
    match scalar {
        0 => value,
        s if s > 0 => value * f64::from(s),
        s => value / -f64::from(s),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_addressed_by_the_standards_byte_numbers() {
        let mut bytes = [0u8; 240];
        bytes[188..192].copy_from_slice(&[0xFF, 0xFF, 0xFF, 0xFE]);
        assert_eq!(Fields::trace_header(&bytes, Endian::Big).i32(189), -2);
        assert_eq!(Fields::trace_header(&bytes, Endian::Little).u32(189), 0xFEFF_FFFF);
    }

    #[test]
    fn scalars_multiply_divide_or_do_nothing() {
        assert_eq!(
            [0, 1, 10, -10, -100].map(|s| scaled(6_201_972.0, s)),
            [6_201_972.0, 6_201_972.0, 62_019_720.0, 620_197.2, 62_019.72]
        );
        assert_eq!(scaled(32768.0, i16::MIN), 1.0);
    }
}
