//! Places of traces and samples in the file: the headers' claims, compared with the size of the file.
//!
//! ```text
//! 0      3200   3600                 first_trace                                        end of traces
//! | text | binary | extended text ... | header (+ extensions) samples | header ... | ... | trailer records |
//!                                     |<-------- trace_bytes ------->|
//! ```
//! Every trace has the same length; files in which it varies are refused. After [`Layout::resolve`] the traces fill
//! their part of the file exactly, so that no later read can run past the end, and sizes derived from the layout are
//! bounded by the size of the file.

use super::binary_header::{BinaryHeader, FILE_HEADER_BYTES, TRACE_HEADER_BYTES};
use super::fields::Fields;
use super::input::Input;
use super::options::SegyOptions;
use super::samples::{SampleFormat, say_format};
use super::text_header::{TEXT_BYTES, is_end_stanza};
use crate::cast::index;
use crate::{Endian, Message, SourceError};

/// Extended text headers that a search for the end stanza looks at.
const MAX_TEXT_RECORDS: u64 = 4096;

/// Most traces we can number: the trace index stores `u32` and needs two marks.
pub(super) const MAX_TRACES: u64 = u32::MAX as u64 - 2;

/// Positions of everything in the trace part of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) endian: Endian,
    pub(super) format: SampleFormat,
    /// Byte offset of the first trace header.
    pub(super) first_trace: u64,
    /// Bytes of a trace header with its extensions.
    pub(super) header_bytes: u64,
    /// Samples of every trace, at least 1.
    pub(super) samples: u64,
    /// Number of traces, at least 1.
    pub(super) traces: u64,
}

impl Layout {
    /// Bytes from one trace to the next.
    pub(super) fn trace_bytes(&self) -> u64 {
        self.header_bytes + self.samples * self.format.bytes() as u64
    }

    /// Byte offset of a trace's header; traces count from 0 here.
    pub(super) fn header_offset(&self, trace: u64) -> u64 {
        self.first_trace + trace * self.trace_bytes()
    }

    /// Byte offset of a sample.
    pub(super) fn sample_offset(&self, trace: u64, sample: u64) -> u64 {
        self.header_offset(trace) + self.header_bytes + sample * self.format.bytes() as u64
    }

    /// Finds the layout that the header claims and the file's size confirms.
    pub(super) fn resolve(
        input: Input<'_>,
        header: &BinaryHeader,
        options: &SegyOptions,
        notes: &mut Vec<Message>,
    ) -> Result<Self, SourceError> {
        let file_bytes = input.len()?;
        let format = sample_format(input, header, options, notes)?;
        let mut first_trace = first_trace(input, header, file_bytes)?;
        if header.revision == 0 && header.samples > 0 && header.extended_text_headers > 0 {
            // Revision 0 has no extended text headers; writers used them all the same, others left garbage there.
            let trace = TRACE_HEADER_BYTES + u64::from(header.samples) * format.bytes() as u64;
            let whole = |first: u64| first < file_bytes && (file_bytes - first).is_multiple_of(trace);
            if !whole(first_trace) && whole(FILE_HEADER_BYTES) {
                notes.push(format!(
                    "bytes 3505-3506 claim {} extended text headers in a revision 0 file, but the file's size has no \
                     room for them: ignored",
                    header.extended_text_headers
                ).into());
                first_trace = FILE_HEADER_BYTES;
            }
        }
        let samples = samples_per_trace(input, header, first_trace, file_bytes, notes)?;
        let sketch = Self { endian: header.endian, format, first_trace, header_bytes: 0, samples, traces: 0 };
        sketch.count_traces(input, header, file_bytes)
    }

    /// Fills in header length and number of traces.
    fn count_traces(self, input: Input<'_>, header: &BinaryHeader, file_bytes: u64) -> Result<Self, SourceError> {
        let data_end = match header.trailer_records {
            n if n > 0 => file_bytes.saturating_sub(u64::from(n.unsigned_abs()) * TEXT_BYTES as u64),
            _ => file_bytes,
        };
        let data_bytes = data_end.saturating_sub(self.first_trace);
        let mut fitting = None;
        for &extensions in &header.trace_header_extensions {
            let layout = Self { header_bytes: TRACE_HEADER_BYTES * (1 + extensions), ..self };
            if header.trailer_records == -1 && header.traces > 0 {
                // An unknown number of trailer records: the trace count says where they begin.
                let used = header.traces.checked_mul(layout.trace_bytes());
                let trailer = used.and_then(|used| data_bytes.checked_sub(used));
                if trailer.is_some_and(|t| t.is_multiple_of(TEXT_BYTES as u64)) {
                    fitting = Some(Self { traces: header.traces, ..layout });
                }
            } else if data_bytes.is_multiple_of(layout.trace_bytes()) {
                fitting = Some(Self { traces: data_bytes / layout.trace_bytes(), ..layout });
            }
            if fitting.is_some() {
                break;
            }
        }
        let layout = fitting.ok_or_else(|| self.not_whole(input, header, data_bytes))?;
        if layout.traces == 0 {
            return Err(input.invalid("file size", "at least one trace after the headers", "none"));
        }
        if header.traces > 0 && header.traces != layout.traces {
            let found = format!("{} in the {file_bytes} bytes of the file", layout.traces);
            let expected = format!("{} traces as bytes 3513-3520 say", header.traces);
            return Err(input.invalid("number of traces", expected, found));
        }
        if layout.traces > MAX_TRACES {
            let what = format!("{} traces, more than {MAX_TRACES}", layout.traces);
            return Err(input.unsupported(what, "split the file"));
        }
        Ok(layout)
    }

    /// The message for a file that does not end at the end of a trace.
    fn not_whole(self, input: Input<'_>, header: &BinaryHeader, data_bytes: u64) -> SourceError {
        let extensions = header.trace_header_extensions[0];
        let header_bytes = TRACE_HEADER_BYTES * (1 + extensions);
        let sample_bytes = self.format.bytes();
        let trace_bytes = header_bytes + self.samples * sample_bytes as u64;
        let expected = format!(
            "a whole number of traces of {trace_bytes} bytes ({header_bytes} of header, {} samples of {sample_bytes}) \
             from byte {} on ({}, {})",
            self.samples, self.first_trace, header.endian, header.endian_reason
        );
        let found = format!("{} traces and {} bytes more", data_bytes / trace_bytes, data_bytes % trace_bytes);
        input.invalid("file size", expected, found)
    }
}

/// The sample format: the option's, else the header's.
fn sample_format(
    input: Input<'_>,
    header: &BinaryHeader,
    options: &SegyOptions,
    notes: &mut Vec<Message>,
) -> Result<SampleFormat, SourceError> {
    let code = options.format.unwrap_or(header.format_code);
    if code != header.format_code {
        notes.push(
            format!(
                "the header says sample format {} (bytes 3225-3226); the samples were read as format {code}, as asked",
                header.format_code
            )
            .into(),
        );
    }
    SampleFormat::from_code(code).ok_or_else(|| {
        input.invalid(
            format!("bytes 3225-3226, sample format ({}, {})", header.endian, header.endian_reason),
            say_format("1 to 12, 15 or 16 (if you know the format, say ", "N)"),
            code.to_string(),
        )
    })
}

/// Byte offset of the first trace: stated outright, or after the extended text headers.
fn first_trace(input: Input<'_>, header: &BinaryHeader, file_bytes: u64) -> Result<u64, SourceError> {
    let stated = header.first_trace_offset;
    let offset = match (stated, header.extended_text_headers) {
        (1.., _) => stated,
        (0, -1) => after_end_stanza(input, file_bytes)?,
        (0, count) => {
            let count = u64::try_from(count).map_err(|_| {
                let location = "bytes 3505-3506, number of extended text headers";
                input.invalid(location, "-1, 0 or a positive number", count.to_string())
            })?;
            FILE_HEADER_BYTES + count * TEXT_BYTES as u64
        }
    };
    if (FILE_HEADER_BYTES..file_bytes).contains(&offset) {
        return Ok(offset);
    }
    Err(input.invalid(
        "position of the first trace (bytes 3505-3506 and 3521-3528)",
        format!("from {FILE_HEADER_BYTES} to less than the file's {file_bytes} bytes"),
        offset.to_string(),
    ))
}

/// Looks through the extended text headers for the one that ends them.
fn after_end_stanza(input: Input<'_>, file_bytes: u64) -> Result<u64, SourceError> {
    let mut record = [0; TEXT_BYTES];
    for index in 0..MAX_TEXT_RECORDS {
        let offset = FILE_HEADER_BYTES + index * TEXT_BYTES as u64;
        let end = offset + TEXT_BYTES as u64;
        if end > file_bytes {
            break;
        }
        input.read(offset, &mut record)?;
        if is_end_stanza(&record) {
            return Ok(end);
        }
    }
    let expected = "((SEG: EndText)) at the start of one of them, because bytes 3505-3506 say -1";
    Err(input.invalid("extended text headers", expected, "none"))
}

/// Samples per trace: the binary header's, else the first trace header's.
fn samples_per_trace(
    input: Input<'_>,
    header: &BinaryHeader,
    first_trace: u64,
    file_bytes: u64,
    notes: &mut Vec<Message>,
) -> Result<u64, SourceError> {
    if header.samples > 0 {
        return Ok(u64::from(header.samples));
    }
    let mut samples = 0;
    if first_trace + TRACE_HEADER_BYTES <= file_bytes {
        let mut trace_header = [0; index(TRACE_HEADER_BYTES)];
        input.read(first_trace, &mut trace_header)?;
        samples = u64::from(Fields::trace_header(&trace_header, header.endian).u16(115));
    }
    if samples == 0 {
        return Err(input.invalid(
            "samples per trace (bytes 3221-3222 of the file, bytes 115-116 of the first trace header)",
            "a positive number in one of the two",
            "0 in both",
        ));
    }
    notes.push(format!(
        "the binary header says 0 samples per trace (bytes 3221-3222); the trace headers' {samples} (bytes 115-116) \
         was used"
    ).into());
    Ok(samples)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn header(revision: u8) -> BinaryHeader {
        BinaryHeader {
            endian: Endian::Big,
            endian_reason: "",
            revision,
            format_code: 5,
            interval_us: 4000.0,
            samples: 10,
            fixed_length: true,
            extended_text_headers: 0,
            trace_header_extensions: vec![0],
            feet: false,
            traces: 0,
            first_trace_offset: 0,
            trailer_records: 0,
        }
    }

    fn resolve(file_bytes: usize, header: &BinaryHeader) -> Result<Layout, SourceError> {
        let file = vec![0u8; file_bytes];
        let input = Input { path: Path::new("x.sgy"), bytes: &file };
        Layout::resolve(input, header, &SegyOptions::default(), &mut Vec::new())
    }

    #[test]
    fn traces_fill_the_file() {
        let layout = resolve(3600 + 3 * 280, &header(1)).unwrap();
        assert_eq!((layout.traces, layout.trace_bytes(), layout.sample_offset(1, 2)), (3, 280, 3600 + 280 + 240 + 8));
        let message = resolve(3600 + 3 * 280 + 7, &header(1)).unwrap_err().to_string();
        assert!(message.contains("3 traces and 7 bytes more"), "{message}");
        let message = resolve(3600, &header(1)).unwrap_err().to_string();
        assert!(message.contains("first trace"), "{message}");
    }

    #[test]
    fn header_extensions_are_taken_where_the_size_fits() {
        let two = BinaryHeader { trace_header_extensions: vec![1, 65536], ..header(2) };
        assert_eq!(resolve(3600 + 3 * 520, &two).unwrap().header_bytes, 480);
        let four = BinaryHeader { trace_header_extensions: vec![0, 1], ..header(2) };
        assert_eq!(resolve(3600 + 3 * 520, &four).unwrap().header_bytes, 480);
    }

    #[test]
    fn trailers_and_offsets_are_left_out() {
        let trailer = BinaryHeader { trailer_records: 2, first_trace_offset: 4000, ..header(2) };
        assert_eq!(resolve(4000 + 3 * 280 + 6400, &trailer).unwrap().traces, 3);
        let unknown = BinaryHeader { trailer_records: -1, traces: 3, ..header(2) };
        assert_eq!(resolve(3600 + 3 * 280 + 3200, &unknown).unwrap().traces, 3);
        let lie = BinaryHeader { traces: 4, ..header(2) };
        assert!(resolve(3600 + 3 * 280, &lie).unwrap_err().to_string().contains("3513"));
    }

    #[test]
    fn huge_claims_do_not_overflow() {
        for (traces, offset, samples) in [(u64::MAX, 0, u32::MAX), (u64::MAX, u64::MAX, 1), (3, 3600, u32::MAX)] {
            let lie = BinaryHeader {
                traces,
                first_trace_offset: offset,
                samples,
                trailer_records: -1,
                trace_header_extensions: vec![u64::from(u16::MAX), u64::from(u32::MAX)],
                ..header(2)
            };
            assert!(resolve(5000, &lie).is_err());
        }
    }
}
