//! One pass over all trace headers.
//!
//! The pass reads headers only (or, where traces are short, whole stretches of the file, which is faster than hopping)
//! and keeps a summary and a list of *runs*: stretches of traces whose inline and crossline numbers progress evenly.
//! A survey stored line by line has one run per line. Memory: 24 bytes per run; at worst, where live and dead traces
//! take turns, every trace is a run.

use std::collections::HashMap;

use super::binary_header::{BinaryHeader, TRACE_HEADER_BYTES};
use super::fields::{Fields, scaled};
use super::input::Input;
use super::layout::Layout;
use super::options::{Offsets, SegyOptions};
use super::position_fit::PositionFit;
use crate::cast::index;
use crate::{Message, ReadOption, SourceError};

/// Traces longer than this are visited header by header; shorter ones are read through.
const READ_THROUGH_BYTES: u64 = 16 * 1024;

/// Bytes of one read of the pass.
const BATCH_BYTES: u64 = 1 << 20;

/// Trace identification code of a dead trace, bytes 29-30.
const DEAD: i16 = 2;

/// Traces in file order with evenly progressing line numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Run {
    /// Inline and crossline number of the first trace.
    pub(super) start: [i32; 2],
    /// Step from trace to trace, modulo 2^32.
    pub(super) step: [i32; 2],
    /// Number of traces, at least 1.
    pub(super) count: u32,
    /// Kind of the traces.
    pub(super) kind: TraceKind,
}

const _: () = assert!(size_of::<Run>() == 24, "the head of this module states the size");

/// Kind of a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TraceKind {
    /// Has samples.
    Live,
    /// Marked dead in its header.
    Dead,
    /// Marked dead, with inline and crossline number 0: padding outside the grid.
    Padding,
    /// Left out by the user's wish.
    Skipped,
    /// Has another offset than the one that is wanted: on the grid, and left out.
    OtherOffset,
}

impl TraceKind {
    /// Whether it takes a place of the grid.
    pub(super) fn is_on_grid(self) -> bool {
        matches!(self, Self::Live | Self::Dead)
    }
}

/// Smallest and largest value, and the trace (from 0) that has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extent<T> {
    pub(super) min: (T, u64),
    pub(super) max: (T, u64),
}

impl<T: PartialOrd + Copy> Extent<T> {
    fn add(extent: &mut Option<Self>, value: T, trace: u64) {
        let e = extent.get_or_insert(Self { min: (value, trace), max: (value, trace) });
        if value < e.min.0 {
            e.min = (value, trace);
        }
        if value > e.max.0 {
            e.max = (value, trace);
        }
    }
}

/// Line numbers of one axis of the grid, as in the headers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LineSummary {
    /// Smallest and largest line number.
    pub(super) extent: Extent<i32>,
    /// Greatest common divisor of all differences: 0 where there is one number only.
    pub(super) gcd: u64,
}

/// Result of the pass.
#[derive(Debug, Default)]
pub(super) struct Scan {
    /// All traces, in file order.
    pub(super) runs: Vec<Run>,
    /// Inlines and crosslines, `None` if every trace is padding.
    pub(super) lines: [Option<LineSummary>; 2],
    /// Steps from trace to trace within one inline, and within one crossline.
    pub(super) steps_along: [u64; 2],
    /// Dead traces without a position.
    pub(super) padding: u64,
    /// Traces that the user leaves out.
    pub(super) skipped: u64,
    /// Traces with another offset than the one that is wanted.
    pub(super) other_offsets: u64,
    /// Their offsets.
    offsets_left_out: Option<Extent<i32>>,
    /// Sample intervals in the trace headers (bytes 117-118), zeros left out, microseconds.
    pub(super) interval_us: Option<Extent<i16>>,
    /// Delay recording time (bytes 109-110, scaled by 215-216), ms, of live traces.
    pub(super) delay_ms: Option<Extent<f64>>,
    /// Sample count of trace headers that contradicts the layout in a file that declares a fixed length.
    pub(super) overruled_samples: Option<u16>,
    /// CDP coordinates (bytes 181-188) against line numbers.
    pub(super) cdp: PositionFit,
    /// Source coordinates (bytes 73-80) against line numbers.
    pub(super) source: PositionFit,
    /// Coordinate units (bytes 89-90) and in how many traces they occur.
    pub(super) coordinate_units: HashMap<i16, u64>,
}

impl Scan {
    /// Walks over the file.
    pub(super) fn run(
        input: Input<'_>,
        layout: &Layout,
        header: &BinaryHeader,
        options: &SegyOptions,
    ) -> Result<Self, SourceError> {
        let mut scan = Self::default();
        let mut last = None;
        for_each_header(input, layout, |trace, fields| {
            let is_skipped = options.skips(trace);
            if !is_skipped {
                scan.check_samples(input, layout, header, trace, fields)?;
            }
            let position =
                [usize::from(options.inline_byte), usize::from(options.crossline_byte)].map(|b| fields.i32(b));
            let offset = fields.i32(options.offset_byte.into());
            let kind = match (fields.i16(29), position) {
                _ if is_skipped => TraceKind::Skipped,
                (DEAD, [0, 0]) => TraceKind::Padding,
                _ if matches!(options.offsets, Offsets::One(wanted) if wanted != offset) => {
                    Extent::add(&mut scan.offsets_left_out, offset, trace);
                    TraceKind::OtherOffset
                }
                (DEAD, _) => TraceKind::Dead,
                _ => TraceKind::Live,
            };
            scan.extend_runs(position, kind, &mut last);
            scan.check_memory(layout, options)?;
            scan.summarise(trace, position, kind, fields);
            Ok(())
        })?;
        scan.check_offsets(input, layout, options)?;
        Ok(scan.finish())
    }

    /// Refuses to leave out all traces.
    fn check_offsets(&self, input: Input<'_>, layout: &Layout, options: &SegyOptions) -> Result<(), SourceError> {
        let (Some(found), Offsets::One(wanted)) = (self.offsets_left_out, options.offsets) else { return Ok(()) };
        if self.other_offsets + self.padding < layout.traces {
            return Ok(());
        }
        let (byte, [least, most]) = (options.offset_byte, [found.min.0, found.max.0]);
        let there = if least == most { format!("all have {least}") } else { format!("they have {least} to {most}") };
        let advice = Message::from("choose another ").option(ReadOption::Offsets).text(", or say with ");
        let advice = advice.option(ReadOption::OffsetByte).text(" where offsets stand");
        Err(input.unsupported(format!("no trace has offset {wanted} (byte {byte}): {there}"), advice))
    }

    /// Refuses a trace that says it has another length.
    fn check_samples(
        &mut self,
        input: Input<'_>,
        layout: &Layout,
        header: &BinaryHeader,
        trace: u64,
        fields: Fields<'_>,
    ) -> Result<(), SourceError> {
        let samples = fields.u16(115);
        if samples == 0 || u64::from(samples) == layout.samples || layout.samples > u64::from(u16::MAX) {
            return Ok(());
        }
        if header.fixed_length {
            self.overruled_samples.get_or_insert(samples);
            return Ok(());
        }
        Err(input.invalid(
            format!(
                "trace {} (header at byte {}), samples in this trace (bytes 115-116)",
                trace + 1,
                layout.header_offset(trace)
            ),
            format!(
                "{} as for all traces (traces of different lengths cannot form a grid; if the trace header is wrong, \
                 the fixed-length flag in bytes 3503-3504 of the file must be 1)",
                layout.samples
            ),
            samples.to_string(),
        ))
    }

    /// Appends a trace to the last run, or begins a new one.
    fn extend_runs(&mut self, position: [i32; 2], kind: TraceKind, last: &mut Option<[i32; 2]>) {
        let previous = last.replace(position);
        if let (Some(run), Some(previous)) = (self.runs.last_mut(), previous)
            && run.kind == kind
            && run.count < u32::MAX
        {
            let step = [0, 1].map(|a| position[a].wrapping_sub(previous[a]));
            if run.count == 1 {
                run.step = step;
            }
            if run.step == step {
                run.count += 1;
                return;
            }
        }
        self.runs.push(Run { start: position, step: [0, 0], count: 1, kind });
    }

    /// Refuses a list of runs that takes more memory than is allowed when it grows the next time.
    fn check_memory(&self, layout: &Layout, options: &SegyOptions) -> Result<(), SourceError> {
        let full = self.runs.len() == self.runs.capacity();
        if full && run_bytes(self.runs.len() as u64) > options.memory_bytes {
            return Err(options.too_little_memory(run_bytes(layout.traces)));
        }
        Ok(())
    }

    /// Adds a trace to the summary.
    fn summarise(&mut self, trace: u64, position: [i32; 2], kind: TraceKind, fields: Fields<'_>) {
        if kind == TraceKind::Skipped {
            self.skipped += 1;
            return;
        }
        let interval = fields.i16(117);
        if interval != 0 {
            Extent::add(&mut self.interval_us, interval, trace);
        }
        if kind == TraceKind::Padding {
            self.padding += 1;
            return;
        }
        for axis in [0, 1] {
            add_line(&mut self.lines[axis], position[axis], trace);
        }
        if kind == TraceKind::OtherOffset {
            self.other_offsets += 1;
        }
        if kind == TraceKind::Live {
            let delay = scaled(f64::from(fields.i16(109)), fields.i16(215));
            Extent::add(&mut self.delay_ms, delay, trace);
        }
        let scalar = fields.i16(71);
        let point = |x: usize, y: usize| [x, y].map(|byte| scaled(f64::from(fields.i32(byte)), scalar));
        self.cdp.add(position, point(181, 185));
        self.source.add(position, point(73, 77));
        // Sixteen bits of noise could fill 65,536 entries at most.
        *self.coordinate_units.entry(fields.i16(89)).or_insert(0) += 1;
    }

    /// Counts in which direction the file walks, from the runs.
    fn finish(mut self) -> Self {
        for run in &self.runs {
            let steps = u64::from(run.count - 1);
            match run.step {
                [0, _] => self.steps_along[0] += steps,
                [_, 0] => self.steps_along[1] += steps,
                _ => {}
            }
        }
        self
    }
}

/// Bytes of a list of runs while it grows: the old one and a new one of twice its length.
pub(super) fn run_bytes(runs: u64) -> u64 {
    3 * runs * size_of::<Run>() as u64
}

/// Adds a line number to an axis.
pub(super) fn add_line(line: &mut Option<LineSummary>, number: i32, trace: u64) {
    let summary =
        line.get_or_insert(LineSummary { extent: Extent { min: (number, trace), max: (number, trace) }, gcd: 0 });
    // The smallest number moves, but the differences to any one member generate all differences.
    let difference = (i64::from(number) - i64::from(summary.extent.min.0)).unsigned_abs();
    if difference != 0 && (summary.gcd == 0 || !difference.is_multiple_of(summary.gcd)) {
        summary.gcd = gcd(summary.gcd, difference);
    }
    let mut extent = Some(summary.extent);
    Extent::add(&mut extent, number, trace);
    summary.extent = extent.unwrap_or(summary.extent);
}

/// Greatest common divisor; `gcd(0, b) = b`.
fn gcd(mut a: u64, mut b: u64) -> u64 {
    while a != 0 {
        (a, b) = (b % a, a);
    }
    b
}

/// Calls `visit` with every trace header, in file order; traces count from 0.
pub(super) fn for_each_header(
    input: Input<'_>,
    layout: &Layout,
    mut visit: impl FnMut(u64, Fields<'_>) -> Result<(), SourceError>,
) -> Result<(), SourceError> {
    let trace_bytes = layout.trace_bytes();
    let batch_traces = if trace_bytes <= READ_THROUGH_BYTES { BATCH_BYTES / trace_bytes } else { 1 };
    let largest = layout.traces.min(batch_traces);
    // A batch ends after its last header, so that nothing past it is read.
    let batch_bytes = |traces: u64| index((traces - 1) * trace_bytes + TRACE_HEADER_BYTES);
    let mut buffer = vec![0; batch_bytes(largest)];
    let mut trace = 0;
    while trace < layout.traces {
        let traces = largest.min(layout.traces - trace);
        let batch = &mut buffer[..batch_bytes(traces)];
        input.read(layout.header_offset(trace), batch)?;
        for header in batch.chunks(index(trace_bytes)) {
            let header = header.first_chunk().expect("each chunk of a batch begins with a whole header");
            visit(trace, Fields::trace_header(header, layout.endian))?;
            trace += 1;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divisor_and_extent_follow_in_any_order() {
        for numbers in [[10, 4, 22, 16], [22, 16, 10, 4], [4, 22, 10, 16], [16, 10, 4, 22]] {
            let mut line = None;
            numbers.iter().enumerate().for_each(|(trace, &n)| add_line(&mut line, n, trace as u64));
            let line = line.unwrap();
            assert_eq!((line.extent.min.0, line.extent.max.0, line.gcd), (4, 22, 6));
        }
        let mut line = None;
        [i32::MAX, i32::MIN].iter().for_each(|&n| add_line(&mut line, n, 0));
        assert_eq!(line.unwrap().gcd, u64::from(u32::MAX));
    }

    #[test]
    fn runs_follow_lines() {
        let mut scan = Scan::default();
        let mut last = None;
        for il in 1..=3 {
            for xl in 0..4 {
                let kind = if (il, xl) == (2, 3) { TraceKind::Dead } else { TraceKind::Live };
                scan.extend_runs([il, 20 - 2 * xl], kind, &mut last);
            }
        }
        let counts: Vec<u32> = scan.runs.iter().map(|r| r.count).collect();
        assert_eq!(counts, [4, 3, 1, 4]);
        assert_eq!(scan.runs[0].step, [0, -2]);
        assert_eq!(scan.finish().steps_along, [8, 0]);
    }
}
