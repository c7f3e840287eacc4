//! Reason and advice for a file whose traces do not form a grid.
//!
//! This module runs only for files that are refused. It reads the trace headers once more, and examines the words that
//! hold inline and crossline numbers in practice. It only makes suggestions: a wrong guess would give a wrong picture
//! without a warning.

use std::collections::HashSet;
use std::fmt::{Display, Write};

use super::binary_header::TRACE_HEADER_BYTES;
use super::fields::Fields;
use super::grid::NoGrid;
use super::input::Input;
use super::layout::Layout;
use super::options::SegyOptions;
use super::scan::{LineSummary, add_line, for_each_header};
use crate::cast::index;
use crate::{Message, ReadOption, SourceError};

/// Largest number of traces that are examined; bounds the sets here to a few megabytes.
const MAX_TRACES_JUDGED: u64 = 1 << 18;

/// Four-byte words of the trace header that identify traces, and their names in the standard.
const WORDS: [(usize, &str); 12] = [
    (1, "trace in line"),
    (5, "trace in file"),
    (9, "field record"),
    (13, "trace in record"),
    (17, "source point"),
    (21, "ensemble (CDP)"),
    (25, "trace in ensemble"),
    (37, "offset"),
    (181, "CDP x"),
    (185, "CDP y"),
    (189, "inline"),
    (193, "crossline"),
];

/// Pairs in which files are known to keep (inline, crossline), most common first.
const PAIRS: [(usize, usize); 9] =
    [(189, 193), (9, 21), (9, 13), (5, 21), (17, 21), (17, 13), (17, 25), (181, 185), (21, 13)];

/// Statistics of the trace headers.
struct Evidence {
    traces: u64,
    words: Vec<Option<LineSummary>>,
    /// Distinct positions by pair of [`PAIRS`].
    positions: Vec<HashSet<(i32, i32)>>,
    offsets: HashSet<i32>,
    /// The two words that were asked for: smallest and largest.
    asked: [(i32, i32); 2],
}

/// Error for a file without a grid.
pub(super) fn refuse(input: Input<'_>, layout: &Layout, options: &SegyOptions, defect: &NoGrid) -> SourceError {
    let evidence = match gather(input, layout, options) {
        Ok(evidence) => evidence,
        Err(error) => return error,
    };
    let one_place = evidence.asked.iter().all(|(min, max)| min == max);
    let mut what = match defect {
        NoGrid::Sparse { what, .. } => format!("{what} (a 2D line through a survey, or a wrong line number)"),
        NoGrid::Duplicate { traces, inline, crossline } => {
            let place = format!(
                "traces {} and {} both stand at inline {inline} (byte {}) and crossline {crossline} (byte {})",
                traces[0] + 1,
                traces[1] + 1,
                options.inline_byte,
                options.crossline_byte
            );
            if !one_place && differ_in_offset(input, (layout, options), *traces) {
                let byte = options.offset_byte;
                let mut offsets: Vec<i32> = evidence.offsets.into_iter().collect();
                offsets.sort_unstable();
                let (count, last) = (offsets.len(), offsets[offsets.len() - 1]);
                let what =
                    format!("pre-stack gather: {count} offsets (byte {byte}), {} to {last}; {place}", offsets[0]);
                let advice = Message::from("choose one with ").option(ReadOption::Offsets);
                let advice = advice.text(format_args!(" {}, or their mean with ", offsets[0]));
                return input.unsupported(what, advice.option(ReadOption::Offsets).text(" stack"));
            }
            let all = format!("2D line or shot gather, or line numbers elsewhere: all {} traces", layout.traces);
            if one_place { format!("{all} are in one place; {place}") } else { place }
        }
    };
    what.push_str(&varying_words(&evidence));
    let or = match defect {
        NoGrid::Sparse { suspect, .. } => {
            let which = suspect.map_or("N".to_owned(), |trace| (trace + 1).to_string());
            let skip = Message::from("; ").option(ReadOption::SkipTraces);
            skip.text(format_args!(" {which} leaves a wrong trace out"))
        }
        NoGrid::Duplicate { .. } if one_place => Message::default(),
        NoGrid::Duplicate { traces, .. } => {
            let which = Message::from("; ").option(ReadOption::Duplicates).text(" first, last or mean chooses; ");
            which.option(ReadOption::SkipTraces).text(format_args!(" {} leaves one out", traces[1] + 1))
        }
    };
    input.unsupported(what, advice(&evidence, layout, options).message(or))
}

/// Whether two traces have different source-receiver offsets.
fn differ_in_offset(input: Input<'_>, (layout, options): (&Layout, &SegyOptions), traces: [u64; 2]) -> bool {
    let [first, second] = traces.map(|trace| {
        let mut header = [0; index(TRACE_HEADER_BYTES)];
        let read = input.read(layout.header_offset(trace), &mut header);
        read.map(|()| Fields::trace_header(&header, layout.endian).i32(options.offset_byte.into())).ok()
    });
    first != second
}

/// Reads the headers.
fn gather(input: Input<'_>, layout: &Layout, options: &SegyOptions) -> Result<Evidence, SourceError> {
    let judged = Layout { traces: layout.traces.min(MAX_TRACES_JUDGED), ..*layout };
    let mut evidence = Evidence {
        traces: judged.traces,
        words: vec![None; WORDS.len()],
        positions: vec![HashSet::new(); PAIRS.len()],
        offsets: HashSet::new(),
        asked: [(i32::MAX, i32::MIN); 2],
    };
    for_each_header(input, &judged, |trace, fields| {
        for (summary, (byte, _)) in evidence.words.iter_mut().zip(WORDS) {
            add_line(summary, fields.i32(byte), trace);
        }
        for (positions, (il, xl)) in evidence.positions.iter_mut().zip(PAIRS) {
            positions.insert((fields.i32(il), fields.i32(xl)));
        }
        evidence.offsets.insert(fields.i32(options.offset_byte.into()));
        for (range, byte) in evidence.asked.iter_mut().zip([options.inline_byte, options.crossline_byte]) {
            let number = fields.i32(usize::from(byte));
            *range = (range.0.min(number), range.1.max(number));
        }
        Ok(())
    })?;
    Ok(evidence)
}

/// "; header words that vary: 9 field record (2 to 8), ..."
fn varying_words(evidence: &Evidence) -> String {
    let mut text = String::new();
    for (summary, (byte, name)) in evidence.words.iter().zip(WORDS) {
        let Some(LineSummary { extent, gcd: 1.. }) = summary else { continue };
        let lead = if text.is_empty() { "; header words that vary: byte" } else { ", byte" };
        let _ = write!(text, "{lead} {byte} {name} ({} to {})", extent.min.0, extent.max.0);
    }
    if text.is_empty() {
        text.push_str("; no header word that could number lines varies");
    }
    if evidence.traces == MAX_TRACES_JUDGED {
        let _ = write!(text, " (in the first {MAX_TRACES_JUDGED} traces)");
    }
    text
}

/// Advice: the pair of places under which the file is a full grid, or the options in general.
fn advice(evidence: &Evidence, layout: &Layout, options: &SegyOptions) -> Message {
    let word = |byte: usize| {
        let index = WORDS.iter().position(|(b, _)| *b == byte)?;
        evidence.words[index]
    };
    let count = |line: LineSummary| {
        (i64::from(line.extent.max.0) - i64::from(line.extent.min.0)).unsigned_abs() / line.gcd.max(1) + 1
    };
    let bytes = |inline: &dyn Display, crossline: &dyn Display| {
        let inline = Message::from(ReadOption::InlineByte).text(format_args!(" {inline} "));
        inline.option(ReadOption::CrosslineByte).text(format_args!(" {crossline}"))
    };
    let mut best: Option<(bool, Message)> = None;
    for (positions, (il, xl)) in evidence.positions.iter().zip(PAIRS) {
        let (Some(inline), Some(crossline)) = (word(il), word(xl)) else { continue };
        let asked = (usize::from(options.inline_byte), usize::from(options.crossline_byte)) == (il, xl);
        let distinct = positions.len() as u64 == evidence.traces;
        let full = evidence.traces < layout.traces || count(inline) * count(crossline) == evidence.traces;
        if asked || !distinct || !full {
            continue;
        }
        let section = count(inline) == 1 || count(crossline) == 1;
        let shape = if section { "as one section" } else { "as a full grid" };
        let size = format_args!("{} x {} traces", count(inline), count(crossline)).to_string();
        let text = bytes(&il, &xl).text(format_args!(" would read it {shape} of {size}"));
        if best.as_ref().is_none_or(|(was_section, _)| *was_section && !section) {
            best = Some((section, text));
        }
    }
    best.map_or_else(
        || {
            let start = Message::from("if inline and crossline numbers stand in other header bytes, say ");
            start.message(bytes(&"A", &"B"))
        },
        |(_, text)| text,
    )
}
