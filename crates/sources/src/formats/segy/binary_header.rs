//! The 400-byte binary file header, bytes 3201 to 3600, and the byte order it is written in.
//!
//! Revision 1 and 2 fields are only believed where the revision word claims them: older files keep anything there,
//! blanks included. Everything read here is a claim; [`super::layout`] holds it against the size of the file.

use super::fields::Fields;
use super::options::SegyOptions;
use super::samples::SampleFormat;
use crate::Endian;

/// Bytes of the text and binary headers together: where traces or extended text headers begin.
pub(super) const FILE_HEADER_BYTES: u64 = 3600;

/// Bytes of a standard trace header, and of each of its extensions.
pub(super) const TRACE_HEADER_BYTES: u64 = 240;

/// Claims of the binary header.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct BinaryHeader {
    pub(super) endian: Endian,
    /// Why the byte order is what it is, for notes and messages.
    pub(super) endian_reason: &'static str,
    /// Major revision: 0, 1 or 2.
    pub(super) revision: u8,
    /// Data sample format code, unchecked.
    pub(super) format_code: u16,
    /// Sample interval in microseconds (or thousandths of the depth unit); positive only if usable.
    pub(super) interval_us: f64,
    /// Samples per trace; 0 where the header does not say.
    pub(super) samples: u32,
    /// "All traces have the same length", bytes 3503-3504.
    pub(super) fixed_length: bool,
    /// Extended text headers of 3200 bytes; -1 means "until the end stanza".
    pub(super) extended_text_headers: i16,
    /// Claims for the number of 240-byte extensions after each trace header, most likely first: revision 2.1 has two
    /// bytes there, revision 2.0 four.
    pub(super) trace_header_extensions: Vec<u64>,
    /// Whether lengths are in feet (bytes 3255-3256 = 2).
    pub(super) feet: bool,
    /// Number of traces in the file; 0 where the header does not say.
    pub(super) traces: u64,
    /// Byte offset of the first trace from the start of the file; 0 where the header does not say.
    pub(super) first_trace_offset: u64,
    /// Records of 3200 bytes after the last trace; -1 means an unknown number.
    pub(super) trailer_records: i32,
}

impl BinaryHeader {
    /// Reads the header; `file_bytes` is the size of the file, which helps to judge the byte order.
    pub(super) fn read(bytes: &[u8; 400], file_bytes: u64, options: &SegyOptions) -> Result<Self, String> {
        let (endian, endian_reason) = match options.endian {
            Some(endian) => (endian, "as asked"),
            None => detect_endian(bytes, file_bytes, options)?,
        };
        let fields = Fields::binary_header(bytes, endian);
        let revision = revision(bytes);
        let second = revision >= 2;
        let extended_samples = if second { fields.u32(3269) } else { 0 };
        let extended_interval = if second { fields.f64(3273) } else { 0.0 };
        let extension_claims = [u64::from(fields.u16(3507)), u64::from(fields.u32(3507))];
        Ok(Self {
            endian,
            endian_reason,
            revision,
            format_code: fields.u16(3225),
            interval_us: if extended_interval.is_finite() && extended_interval > 0.0 {
                extended_interval
            } else {
                f64::from(fields.i16(3217))
            },
            samples: match options.samples {
                Some(samples) => samples,
                None if extended_samples > 0 => extended_samples,
                None => u32::from(fields.u16(3221)),
            },
            // An option of the user holds for all traces.
            fixed_length: fields.i16(3503) == 1 || options.samples.is_some(),
            extended_text_headers: fields.i16(3505),
            trace_header_extensions: if second { extension_claims.to_vec() } else { vec![0] },
            feet: fields.i16(3255) == 2,
            traces: if second { fields.u64(3513) } else { 0 },
            first_trace_offset: if second { fields.u64(3521) } else { 0 },
            trailer_records: if second { fields.i32(3529) } else { 0 },
        })
    }
}

/// Major revision. The standard writes it as byte 3501, before the minor one; little-endian writers swap the two.
fn revision(bytes: &[u8; 400]) -> u8 {
    match (bytes[300], bytes[301]) {
        (major @ 1..=2, _) => major,
        (0, major @ 1..=2) => major,
        _ => 0,
    }
}

/// The byte order: from revision 2's constant, else the order under which the header makes more sense.
fn detect_endian(bytes: &[u8; 400], file_bytes: u64, options: &SegyOptions) -> Result<(Endian, &'static str), String> {
    if revision(bytes) >= 2 {
        match bytes[96..100] {
            [1, 2, 3, 4] => return Ok((Endian::Big, "by the constant at byte 3297")),
            [4, 3, 2, 1] => return Ok((Endian::Little, "by the constant at byte 3297")),
            [2, 1, 4, 3] | [3, 4, 1, 2] => {
                return Err("a pair-wise byte-swapped file (constant at bytes 3297-3300)".into());
            }
            _ => {}
        }
    }
    let [big, little] =
        [Endian::Big, Endian::Little].map(|e| plausibility(&Fields::binary_header(bytes, e), file_bytes, options));
    let endian = if little > big { Endian::Little } else { Endian::Big };
    Ok((endian, "judged from format code, sample count and file size"))
}

/// How much sense a header makes under one byte order: format code known, file a whole number of traces, interval and
/// sample count usable.
fn plausibility(fields: &Fields<'_>, file_bytes: u64, options: &SegyOptions) -> u32 {
    let coded = SampleFormat::from_code(fields.u16(3225));
    let format = options.format.and_then(SampleFormat::from_code).or(coded);
    let samples = u64::from(options.samples.unwrap_or_else(|| fields.u16(3221).into()));
    let trace_bytes = TRACE_HEADER_BYTES + samples * format.map_or(4, SampleFormat::bytes) as u64;
    let extended = u64::try_from(fields.i16(3505)).unwrap_or(0) * 3200;
    let data_bytes = file_bytes.saturating_sub(FILE_HEADER_BYTES + extended);
    let whole = samples > 0 && data_bytes > 0 && data_bytes.is_multiple_of(trace_bytes);
    8 * u32::from(coded.is_some())
        + 4 * u32::from(whole)
        + 2 * u32::from(samples > 0 && trace_bytes <= data_bytes)
        + u32::from((1..=20_000).contains(&fields.i16(3217)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(endian: Endian, words: &[(usize, u16)]) -> [u8; 400] {
        let mut bytes = [0; 400];
        for &(byte, value) in words {
            let word = if endian == Endian::Big { value.to_be_bytes() } else { value.to_le_bytes() };
            bytes[byte - 3201..byte - 3199].copy_from_slice(&word);
        }
        bytes
    }

    #[test]
    fn byte_order_follows_from_plausibility() {
        for endian in [Endian::Big, Endian::Little] {
            let bytes = header(endian, &[(3217, 4000), (3221, 50), (3225, 1)]);
            let read = BinaryHeader::read(&bytes, 3600 + 440 * 3, &SegyOptions::default()).unwrap();
            assert_eq!((read.endian, read.samples, read.format_code), (endian, 50, 1));
        }
    }

    #[test]
    fn byte_order_follows_from_the_constant_of_revision_2() {
        let mut bytes = header(Endian::Little, &[(3221, 50), (3225, 5)]);
        bytes[300] = 2;
        bytes[96..100].copy_from_slice(&[4, 3, 2, 1]);
        let read = BinaryHeader::read(&bytes, 4040, &SegyOptions::default()).unwrap();
        assert_eq!((read.endian, read.revision), (Endian::Little, 2));
        bytes[96..100].copy_from_slice(&[2, 1, 4, 3]);
        assert!(BinaryHeader::read(&bytes, 4040, &SegyOptions::default()).is_err());
    }

    #[test]
    fn old_revisions_do_not_use_new_fields() {
        let mut bytes = [b'0'; 400];
        bytes[300] = 1;
        let read = BinaryHeader::read(&bytes, 4040, &SegyOptions::default()).unwrap();
        assert_eq!((read.traces, read.first_trace_offset, read.trailer_records), (0, 0, 0));
        assert_eq!(read.trace_header_extensions, [0]);
    }
}
