//! From traces to a grid: which trace stands at which crossline and inline.
//!
//! x counts crosslines and y inlines, both in ascending order of their numbers; the step of each axis is the greatest
//! common divisor of all differences between its line numbers, so every trace lies on the grid.
//!
//! Memory: nothing per trace where the file is a complete grid stored line by line, else 4 bytes per grid cell. The
//! number of cells is bounded before anything is allocated: by [`MAX_CELLS`], and by [`MAX_CELLS_PER_TRACE`] times the
//! traces that are really in the file, so that one wrong line number cannot ask for a huge grid.

use supervol_format::Dims;

use super::input::Input;
use super::layout::{Layout, MAX_TRACES};
use super::options::SegyOptions;
use super::scan::{LineSummary, Run, Scan, TraceKind, run_bytes};
use crate::cast::{index, low_32, signed};
use crate::{LineNumbers, SourceError};

/// Most cells of a grid: 4 GiB of trace numbers, if it has holes.
const MAX_CELLS: u64 = 1 << 30;

/// A grid emptier than this is a lying header or a line through a survey, not a volume.
const MAX_CELLS_PER_TRACE: u64 = 64;

/// Mark of a cell without a trace.
const MISSING: u32 = u32::MAX;

/// Mark of a cell whose trace is dead.
const DEAD: u32 = u32::MAX - 1;

const _: () = assert!(MAX_TRACES < DEAD as u64, "a trace number must not look like a mark");

/// Inlines, crosslines, and the trace at each of their crossings.
#[derive(Debug)]
pub(super) struct Grid {
    /// Along y.
    pub(super) inline: LineNumbers,
    /// Along x.
    pub(super) crossline: LineNumbers,
    /// Crossings without a trace.
    pub(super) missing: u64,
    /// Crossings whose trace is dead.
    pub(super) dead: u64,
    /// Traces that were not read because others stand at their place.
    pub(super) duplicates: u64,
    index: TraceIndex,
}

/// The trace that is read where several stand at one place. A live one precedes a dead one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
    /// There must not be several.
    Only,
    /// The first in the file.
    First,
    /// The last in the file.
    Last,
    /// The one with this number, counted from 0; a place without one is missing.
    Number(u32),
}

/// Trace of each cell.
#[derive(Debug)]
enum TraceIndex {
    /// Trace = first + x * per_x + y * per_y.
    Regular { first: i64, per_x: i64, per_y: i64 },
    /// `[y][x]`, with marks.
    Table(Vec<u32>),
}

/// Why a grid was not built.
#[derive(Debug)]
pub(super) enum GridDefect {
    /// The message is complete.
    Refused(SourceError),
    /// [`super::diagnose`] finds out why.
    NoGrid(NoGrid),
}

/// How the line numbers fail to form a grid.
#[derive(Debug)]
pub(super) enum NoGrid {
    /// Two traces claim the same place.
    Duplicate {
        /// Both traces, from 0.
        traces: [u64; 2],
        /// Inline number in their headers.
        inline: i64,
        /// Crossline number in their headers.
        crossline: i64,
    },
    /// The line numbers span far more places than there are traces.
    Sparse {
        /// The numbers, for the message.
        what: String,
        /// Trace, from 0, whose line numbers are extreme on both axes.
        suspect: Option<u64>,
    },
}

impl Grid {
    /// Builds the grid from the runs of the scan.
    pub(super) fn build(
        input: Input<'_>,
        scan: &Scan,
        layout: &Layout,
        (options, wanted): (&SegyOptions, Wanted),
    ) -> Result<Self, GridDefect> {
        let [Some(inline), Some(crossline)] = scan.lines else {
            let what = match scan.skipped {
                0 => "all traces are dead and have no position",
                _ => "all traces are dead and have no position, or are left out",
            };
            return Err(GridDefect::Refused(input.unsupported(what, "there is nothing to read")));
        };
        let (lines, spans) = ([inline, crossline].map(numbers), [inline, crossline]);
        let positioned = layout.traces - scan.padding - scan.skipped;
        check_size(input, lines, spans, layout, positioned)?;
        let [inline, crossline] = lines;
        // A regular grid has one trace at each place.
        let is_first = !matches!(wanted, Wanted::Number(1..));
        if let Some(index) = regular_index(&scan.runs, inline, crossline).filter(|_| is_first) {
            return Ok(Self { inline, crossline, missing: 0, dead: 0, duplicates: 0, index });
        }
        let tables = if let Wanted::Number(_) = wanted { 2 } else { 1 };
        let needed = run_bytes(scan.runs.len() as u64) + tables * table_bytes(inline, crossline);
        if needed > options.memory_bytes {
            return Err(GridDefect::Refused(options.too_little_memory(needed)));
        }
        let mut table = vec![MISSING; index(inline.count * crossline.count)];
        fill(&mut table, &scan.runs, (inline, crossline), wanted).map_err(GridDefect::NoGrid)?;
        let count = |mark: u32| table.iter().filter(|cell| **cell == mark).count() as u64;
        let (missing, dead) = (count(MISSING), count(DEAD));
        let duplicates = (positioned - scan.other_offsets).saturating_sub(table.len() as u64 - missing);
        let duplicates = if matches!(wanted, Wanted::First | Wanted::Last) { duplicates } else { 0 };
        Ok(Self { inline, crossline, missing, dead, duplicates, index: TraceIndex::Table(table) })
    }

    /// Bytes that it takes as long as the source is open.
    pub(super) fn memory_bytes(&self) -> u64 {
        match &self.index {
            TraceIndex::Regular { .. } => 0,
            TraceIndex::Table(_) => table_bytes(self.inline, self.crossline),
        }
    }

    /// The live trace at column `x`, row `y`, if there is one.
    #[inline]
    pub(super) fn trace(&self, x: u64, y: u64) -> Option<u64> {
        match &self.index {
            TraceIndex::Regular { first, per_x, per_y } => {
                let trace = first + signed(x) * per_x + signed(y) * per_y;
                u64::try_from(trace).ok()
            }
            TraceIndex::Table(table) => {
                let trace = table[index(y * self.crossline.count + x)];
                (trace < DEAD).then_some(u64::from(trace))
            }
        }
    }
}

fn table_bytes(inline: LineNumbers, crossline: LineNumbers) -> u64 {
    inline.count * crossline.count * size_of::<u32>() as u64
}

/// Line numbers of one axis.
fn numbers(line: LineSummary) -> LineNumbers {
    let (min, max) = (i64::from(line.extent.min.0), i64::from(line.extent.max.0));
    let step = line.gcd.max(1);
    // Differences of i32 numbers fit u32, and so does their divisor.
    LineNumbers { first: min, step: signed(step), count: (max - min).unsigned_abs() / step + 1 }
}

/// Refuses grids that are too large or too empty to be meant.
fn check_size(
    input: Input<'_>,
    lines: [LineNumbers; 2],
    spans: [LineSummary; 2],
    layout: &Layout,
    traces: u64,
) -> Result<(), GridDefect> {
    let cells = lines[0].count.saturating_mul(lines[1].count);
    let dims = Dims([lines[1].count, lines[0].count, layout.samples]);
    let describe = |name: &str, axis: usize| {
        let extent = spans[axis].extent;
        format!(
            "{name}s {} (trace {}) to {} (trace {}) in steps of {}",
            extent.min.0,
            extent.min.1 + 1,
            extent.max.0,
            extent.max.1 + 1,
            lines[axis].step
        )
    };
    let found =
        || format!("{} and {}: {cells} places for {traces} traces", describe("inline", 0), describe("crossline", 1));
    if cells > traces.saturating_mul(MAX_CELLS_PER_TRACE) {
        let what = format!("the traces fill less than 1/{MAX_CELLS_PER_TRACE} of their grid: {}", found());
        let extremes = spans.map(|line| [line.extent.min.1, line.extent.max.1]);
        let suspect = extremes[0].into_iter().find(|trace| extremes[1].contains(trace));
        return Err(GridDefect::NoGrid(NoGrid::Sparse { what, suspect }));
    }
    if cells > MAX_CELLS || !dims.is_valid() {
        let what = format!("the grid is too large: {}, {} samples each", found(), layout.samples);
        let advice = format!("at most {MAX_CELLS} places and {} on each axis can be read: split the file", Dims::LIMIT);
        return Err(GridDefect::Refused(input.unsupported(what, advice)));
    }
    Ok(())
}

/// The arithmetic index of a complete grid stored line by line, live traces only.
fn regular_index(runs: &[Run], inline: LineNumbers, crossline: LineNumbers) -> Option<TraceIndex> {
    let first = runs.first()?;
    let along = if first.step[0] == 0 { 1 } else { 0 };
    let counts = [inline.count, crossline.count];
    if runs.len() as u64 != counts[1 - along] || u64::from(first.count) != counts[along] {
        return None;
    }
    let position = |run: &Run, axis: usize| i64::from(run.start[axis]);
    let line_step = runs.get(1).map_or(0, |second| position(second, 1 - along) - position(first, 1 - along));
    let same = |(number, run): (usize, &Run)| {
        run.kind == TraceKind::Live
            && run.count == first.count
            && run.step == first.step
            && run.step[1 - along] == 0
            && position(run, along) == position(first, along)
            && position(run, 1 - along) == position(first, 1 - along) + signed(number as u64) * line_step
    };
    if !runs.iter().enumerate().all(same) {
        return None;
    }
    // Evenly stepping through as many numbers as the axis has, between its ends, reaches each once: unless the step is
    // zero or wrapped around, which the two comparisons exclude.
    let lines = [inline, crossline];
    let covers = |axis: usize, step: i64| lines[axis].count == 1 || step.abs() == lines[axis].step;
    if !(covers(along, i64::from(first.step[along])) && covers(1 - along, line_step)) {
        return None;
    }
    let stride =
        [if along == 0 { 1 } else { i64::from(first.count) }, if along == 1 { 1 } else { i64::from(first.count) }];
    // Numbers that descend in the file count traces backwards.
    let descends = [first.start[0], first.start[1]].map(i64::from);
    let per = [0, 1].map(|axis| if descends[axis] == lines[axis].first { stride[axis] } else { -stride[axis] });
    let start: i64 = (0..2).filter(|&a| per[a] < 0).map(|a| stride[a] * (signed(lines[a].count) - 1)).sum();
    Some(TraceIndex::Regular { first: start, per_x: per[1], per_y: per[0] })
}

/// Writes trace numbers and marks into the table.
fn fill(
    table: &mut [u32],
    runs: &[Run],
    (inline, crossline): (LineNumbers, LineNumbers),
    wanted: Wanted,
) -> Result<(), NoGrid> {
    // Traces seen at each place, where they are counted.
    let mut seen = if let Wanted::Number(_) = wanted { vec![0u32; table.len()] } else { Vec::new() };
    let mut trace: u64 = 0;
    for run in runs {
        let mut position = run.start;
        for _ in 0..run.count {
            if run.kind.is_on_grid() {
                let [y, x] = [(position[0], inline), (position[1], crossline)]
                    .map(|(number, line)| ((i64::from(number) - line.first) / line.step).unsigned_abs());
                let at = index(y * crossline.count + x);
                let cell = &mut table[at];
                // Positions of dead traces are only needed for the message about duplicates.
                if *cell != MISSING && wanted == Wanted::Only {
                    let earlier = if *cell == DEAD { find(runs, position) } else { u64::from(*cell) };
                    let [inline, crossline] = position.map(i64::from);
                    return Err(NoGrid::Duplicate { traces: [earlier, trace], inline, crossline });
                }
                let is_dead = run.kind == TraceKind::Dead;
                let is_taken = match wanted {
                    Wanted::Number(number) => {
                        seen[at] += 1;
                        seen[at] - 1 == number
                    }
                    // A dead trace gives way to a live one.
                    _ if *cell == MISSING || (*cell == DEAD && !is_dead) => true,
                    Wanted::Only | Wanted::First => false,
                    Wanted::Last => !is_dead || *cell == DEAD,
                };
                if is_taken {
                    *cell = if is_dead { DEAD } else { low_32(trace) };
                }
            }
            trace += 1;
            position = [0, 1].map(|a| position[a].wrapping_add(run.step[a]));
        }
    }
    Ok(())
}

/// The first trace with this position.
fn find(runs: &[Run], wanted: [i32; 2]) -> u64 {
    let mut trace = 0;
    for run in runs {
        let mut position = run.start;
        for _ in 0..run.count {
            if position == wanted && run.kind.is_on_grid() {
                return trace;
            }
            trace += 1;
            position = [0, 1].map(|a| position[a].wrapping_add(run.step[a]));
        }
    }
    trace
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(first: i64, step: i64, count: u64) -> LineNumbers {
        LineNumbers { first, step, count }
    }

    fn run(start: [i32; 2], step: [i32; 2], count: u32) -> Run {
        Run { start, step, count, kind: TraceKind::Live }
    }

    /// The regular index must be what the table would say.
    fn assert_regular(runs: &[Run], inline: LineNumbers, crossline: LineNumbers) {
        let index = regular_index(runs, inline, crossline).expect("regular");
        let mut table = vec![MISSING; (inline.count * crossline.count) as usize];
        fill(&mut table, runs, (inline, crossline), Wanted::Only).expect("no duplicates");
        let regular = Grid { inline, crossline, missing: 0, dead: 0, duplicates: 0, index };
        for y in 0..inline.count {
            for x in 0..crossline.count {
                let expected = table[(y * crossline.count + x) as usize];
                assert_eq!(regular.trace(x, y), Some(u64::from(expected)), "x {x} y {y}");
            }
        }
    }

    #[test]
    fn regular_files_need_no_table() {
        let il = |numbers: &[i32], start, step, count| -> Vec<Run> {
            numbers.iter().map(|&n| run([n, start], [0, step], count)).collect()
        };
        let xl = |numbers: &[i32], start, step, count| -> Vec<Run> {
            numbers.iter().map(|&n| run([start, n], [step, 0], count)).collect()
        };
        assert_regular(&il(&[1, 3, 5], 20, 2, 4), line(1, 2, 3), line(20, 2, 4));
        assert_regular(&il(&[5, 3, 1], 26, -2, 4), line(1, 2, 3), line(20, 2, 4));
        assert_regular(&xl(&[20, 22, 24, 26], 1, 2, 3), line(1, 2, 3), line(20, 2, 4));
        assert_regular(&xl(&[26, 24, 22, 20], 5, -2, 3), line(1, 2, 3), line(20, 2, 4));
        assert_regular(&il(&[-1], -4, 1, 4), line(-1, 1, 1), line(-4, 1, 4));
        assert_regular(&xl(&[7], -4, 1, 4), line(-4, 1, 4), line(7, 1, 1));
        assert_regular(&[run([0, 0], [0, 0], 1)], line(0, 1, 1), line(0, 1, 1));
    }

    #[test]
    fn irregular_files_are_not_taken_for_regular() {
        let lines = (line(1, 1, 2), line(20, 1, 3));
        let holes = [run([1, 20], [0, 1], 3), run([2, 20], [0, 1], 2)];
        assert!(regular_index(&holes, lines.0, lines.1).is_none());
        let shifted = [run([1, 20], [0, 1], 3), run([2, 21], [0, 1], 3)];
        assert!(regular_index(&shifted, lines.0, lines.1).is_none());
        let repeated = [run([1, 20], [0, 1], 3), run([1, 20], [0, 1], 3)];
        assert!(regular_index(&repeated, lines.0, lines.1).is_none());
        let mut dead = [run([1, 20], [0, 1], 3), run([2, 20], [0, 1], 3)];
        dead[1].kind = TraceKind::Dead;
        assert!(regular_index(&dead, lines.0, lines.1).is_none());
    }

    #[test]
    fn duplicates_name_both_traces() {
        let runs = [run([1, 20], [0, 1], 3), run([1, 22], [1, 0], 2)];
        let mut table = vec![MISSING; 6];
        let lines = (line(1, 1, 2), line(20, 1, 3));
        let defect = fill(&mut table, &runs, lines, Wanted::Only).unwrap_err();
        assert!(matches!(defect, NoGrid::Duplicate { traces: [2, 3], inline: 1, crossline: 22 }), "{defect:?}");
        let filled = |wanted, runs: &[Run]| {
            let mut table = vec![MISSING; 6];
            fill(&mut table, runs, lines, wanted).expect("one is wanted");
            table
        };
        assert_eq!(filled(Wanted::First, &runs), [0, 1, 2, MISSING, MISSING, 4]);
        assert_eq!(filled(Wanted::Last, &runs), [0, 1, 3, MISSING, MISSING, 4]);
        assert_eq!(filled(Wanted::Number(1), &runs), [MISSING, MISSING, 3, MISSING, MISSING, MISSING]);
        // A live trace precedes a dead one.
        let mut dead = runs;
        dead[1].kind = TraceKind::Dead;
        assert_eq!(filled(Wanted::Last, &dead)[2], 2);
    }
}
