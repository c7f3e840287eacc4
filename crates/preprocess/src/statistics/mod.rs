//! Histogram, percentiles and range of a volume's present voxels, collected brick by brick in bounded memory.
//!
//! - `bins`: bins of fixed size. 8- and 16-bit voxels have a bin per value, so their statistics are exact. Wider voxels
//!   are resolved to 1 part in 128 at any magnitude.
//! - `sketch`: for wider voxels, also the finest intervals that fit a table. They resolve the range of the values to
//!   1/4096 or better at any offset, and a few far values change nothing for the others.
//! - `values`: the statistics of the manifest.
//!
//! A percentile comes from the narrower of its bin and its interval. Both counts depend on the values alone, so the
//! number of threads does not matter.

mod bins;
mod central;
mod sketch;
mod values;

use supervol_format::cast::whole;
use supervol_format::voxel_type::{Absence, Voxel};
use supervol_format::{ValueRange, VoxelType, with_voxel};

use self::bins::{bins, key, value_of};
pub(crate) use self::sketch::{Interval, Sketch};
pub use self::values::{Form, LABELS, Values, finite};

/// Number of bins of the manifest's histogram.
pub const HISTOGRAM_BINS: usize = 256;
/// Percentiles in the manifest.
pub const PERCENTS: [f64; 11] = [0.1, 1.0, 2.0, 5.0, 25.0, 50.0, 75.0, 95.0, 98.0, 99.0, 99.9];

/// Counts of one volume.
#[derive(Debug, Clone)]
pub struct Statistics {
    voxel_type: VoxelType,
    counts: Vec<u64>,
    /// Range of voxels wider than 16 bits; for narrower ones the bins tell the range.
    range: ValueRange,
    /// Counts of voxels wider than 16 bits.
    sketch: Option<Sketch>,
}

/// Whether bins of this type hold one value each.
fn has_exact_bins(voxel_type: VoxelType) -> bool {
    voxel_type.bytes() <= 2
}

impl Statistics {
    /// Statistics without voxels.
    #[must_use]
    pub fn new(voxel_type: VoxelType) -> Self {
        let sketch = (!has_exact_bins(voxel_type)).then(|| Sketch::new(voxel_type));
        Self { voxel_type, counts: vec![0; bins(voxel_type)], range: ValueRange::EMPTY, sketch }
    }

    /// Statistics without voxels, to be merged with these. Its intervals are as wide as these, so that they fit sooner.
    #[must_use]
    pub fn beside(&self) -> Self {
        let sketch = self.sketch.as_ref().map(Sketch::beside);
        Self { counts: vec![0; self.counts.len()], range: ValueRange::EMPTY, sketch, ..*self }
    }

    /// Memory of the statistics in bytes.
    #[must_use]
    pub fn bytes(voxel_type: VoxelType) -> u64 {
        let sketch = if has_exact_bins(voxel_type) { 0 } else { Sketch::bytes() };
        (bins(voxel_type) * size_of::<u64>()) as u64 + sketch
    }

    /// Counts the present voxels among these (little endian).
    pub fn add(&mut self, voxels: &[u8], absence: Absence) {
        with_voxel!(self.voxel_type, V => self.add_typed::<V>(voxels, absence));
    }

    fn add_typed<V: Voxel>(&mut self, voxels: &[u8], absence: Absence) {
        let holes = absence.possible(V::TYPE);
        // One bin per value, selected by the bits alone; the range follows from the counts.
        let sign = key(V::TYPE, 0.0);
        if size_of::<V>() == 1 && !holes {
            voxels.chunks(u32::MAX as usize).for_each(|part| self.add_bytes(part, sign));
            return;
        }
        if size_of::<V>() == 2 && !holes {
            let words = voxels.as_chunks::<2>().0;
            words.iter().for_each(|word| self.counts[usize::from(u16::from_le_bytes(*word)) ^ sign] += 1);
            return;
        }
        for bytes in voxels.chunks_exact(size_of::<V>()) {
            let v = V::read_le(bytes).to_f64();
            if !(holes && absence.is_absent(v)) {
                self.counts[key(V::TYPE, v)] += 1;
                self.range.include(v);
                if let Some(sketch) = &mut self.sketch {
                    sketch.add(v);
                }
            }
        }
    }

    /// Counts bytes, at most 2^32 of one value. Neighbours are often equal, and each increment would wait for the
    /// previous one; so several tables take turns.
    fn add_bytes(&mut self, bytes: &[u8], sign: usize) {
        const TURNS: usize = 4;
        let mut turns = [[0u32; 1 << u8::BITS]; TURNS];
        let (groups, rest) = bytes.as_chunks::<TURNS>();
        for group in groups {
            for (turn, &byte) in group.iter().enumerate() {
                turns[turn][usize::from(byte)] += 1;
            }
        }
        rest.iter().for_each(|&byte| turns[0][usize::from(byte)] += 1);
        for byte in 0..1 << u8::BITS {
            self.counts[byte ^ sign] += turns.iter().map(|counts| u64::from(counts[byte])).sum::<u64>();
        }
    }

    /// Adds the counts of another part of the same volume.
    pub fn merge(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(a, b)| *a += b);
        self.range = self.range.union(other.range);
        if let (Some(sketch), Some(other)) = (&mut self.sketch, &other.sketch) {
            sketch.merge(other);
        }
    }

    /// Range of the present voxels in stored values.
    #[must_use]
    pub fn range(&self) -> ValueRange {
        if !has_exact_bins(self.voxel_type) {
            return self.range;
        }
        let counted = |bin: &usize| self.counts[*bin] > 0;
        let ends = ((0..self.counts.len()).find(counted), (0..self.counts.len()).rfind(counted));
        match ends {
            (Some(low), Some(high)) => {
                ValueRange { min: value_of(self.voxel_type, low), max: value_of(self.voxel_type, high) }
            }
            _ => ValueRange::EMPTY,
        }
    }

    /// Number of present voxels.
    #[must_use]
    pub fn present(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Number of different values; `None` if there were too many to tell them apart.
    #[must_use]
    pub fn distinct(&self) -> Option<u64> {
        match &self.sketch {
            Some(sketch) => sketch.distinct(),
            None => Some(self.counts.iter().filter(|count| **count > 0).count() as u64),
        }
    }

    /// Bins that hold voxels as intervals: those of narrow types hold one value each, others count at their middle.
    fn binned(&self) -> Vec<Interval> {
        let range = self.range();
        let counted = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        let of_bin = |(bin, &count)| {
            let value = value_of(self.voxel_type, bin).clamp(range.min, range.max);
            Interval { low: value, high: value, count }
        };
        counted.map(of_bin).collect()
    }

    /// The finest intervals of stored values that are known, ascending.
    fn intervals(&self) -> Vec<Interval> {
        let Some(sketch) = &self.sketch else { return self.binned() };
        let ValueRange { min, max } = self.range;
        let within = |i: Interval| Interval { low: i.low.clamp(min, max), high: i.high.clamp(min, max), ..i };
        sketch.intervals().into_iter().map(within).collect()
    }
}

/// Counts in [`HISTOGRAM_BINS`] equal parts of the range. Intervals count at their middle.
fn histogram(intervals: &[Interval], range: ValueRange) -> Vec<u64> {
    let mut out = vec![0; HISTOGRAM_BINS];
    // Halved, because the range of doubles may be wider than the greatest double.
    let half_width = range.max * 0.5 - range.min * 0.5;
    for interval in intervals {
        let above = interval.middle() * 0.5 - range.min * 0.5;
        let share = if half_width > 0.0 { above / half_width } else { 0.0 };
        out[whole::<usize>(share * HISTOGRAM_BINS as f64).min(HISTOGRAM_BINS - 1)] += interval.count;
    }
    out
}

/// `[percent, stored value]` pairs: the value of the interval in which the cumulative count reaches the percentage.
fn percentiles(intervals: &[Interval]) -> Vec<([f64; 2], Interval)> {
    let total: u64 = intervals.iter().map(|interval| interval.count).sum();
    let mut out = Vec::new();
    let mut percents = PERCENTS.iter().peekable();
    let mut below = 0;
    for interval in intervals {
        below += interval.count;
        while percents.peek().is_some_and(|p| below as f64 >= total as f64 * **p / 100.0) {
            out.extend(percents.next().map(|&p| ([p, interval.middle()], *interval)));
        }
    }
    out
}

#[cfg(test)]
mod tests;
