//! Histogram, percentiles and range of a volume's present voxels, collected brick by brick in bounded memory.
//!
//! Voxels are counted in bins that follow the order of the values. 8- and 16-bit voxels have a bin per value, so their
//! percentiles are exact. Wider voxels are binned by sign, exponent and the upper 7 bits of the mantissa. That resolves
//! values to 1 part in 128 at any magnitude, so a single spike does not hide the other values. Counts are sums of
//! integers, so the number of threads does not matter.

use supervol_format::cast::{narrow, single, whole};
use supervol_format::container::header::Descriptor;
use supervol_format::voxel_type::{Absence, Voxel};
use supervol_format::{ValueRange, VoxelType, with_voxel};

/// Bits of a number that select its bin: sign, exponent (8 bits in single, 11 in double precision), 7 of the mantissa.
const SINGLE_BITS: u32 = 16;
const DOUBLE_BITS: u32 = 19;
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
}

/// Number of bins for voxels of this type.
fn bins(voxel_type: VoxelType) -> usize {
    if voxel_type == VoxelType::F64 { 1 << DOUBLE_BITS } else { 1 << SINGLE_BITS }
}

impl Statistics {
    /// Statistics without voxels.
    #[must_use]
    pub fn new(voxel_type: VoxelType) -> Self {
        Self { voxel_type, counts: vec![0; bins(voxel_type)], range: ValueRange::EMPTY }
    }

    /// Memory of the statistics in bytes.
    #[must_use]
    pub fn bytes(voxel_type: VoxelType) -> u64 {
        (bins(voxel_type) * size_of::<u64>()) as u64
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
    }

    /// Range of the present voxels in stored values.
    #[must_use]
    pub fn range(&self) -> ValueRange {
        if self.voxel_type.bytes() > 2 {
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

    /// `[percent, stored value]` pairs: the value of the bin in which the cumulative count reaches the percentage.
    #[must_use]
    pub fn percentiles(&self) -> Vec<[f64; 2]> {
        let (total, range) = (self.present(), self.range());
        let mut out = Vec::new();
        let mut percents = PERCENTS.iter().peekable();
        let mut below = 0;
        for (bin, &count) in self.counts.iter().enumerate() {
            below += count;
            while count > 0 && percents.peek().is_some_and(|p| below as f64 >= total as f64 * **p / 100.0) {
                let value = value_of(self.voxel_type, bin).clamp(range.min, range.max);
                out.extend(percents.next().map(|&p| [p, value]));
            }
        }
        out
    }

    /// Counts in [`HISTOGRAM_BINS`] equal parts of the range. Bins of wide voxel types count at their middle.
    #[must_use]
    pub fn histogram(&self) -> Vec<u64> {
        let mut out = vec![0; HISTOGRAM_BINS];
        let range = self.range();
        let width = range.width();
        for (bin, &count) in self.counts.iter().enumerate().filter(|(_, c)| **c > 0) {
            let value = value_of(self.voxel_type, bin).clamp(range.min, range.max);
            // Halved, because the range of doubles may be wider than the greatest double.
            let above = value * 0.5 - range.min * 0.5;
            let half_width = range.max * 0.5 - range.min * 0.5;
            let share = if width > 0.0 && half_width > 0.0 { above / half_width } else { 0.0 };
            out[whole::<usize>(share * HISTOGRAM_BINS as f64).min(HISTOGRAM_BINS - 1)] += count;
        }
        out
    }
}

/// Statistics of level 0 for the manifest, in data units.
#[derive(Debug, Clone, PartialEq)]
pub struct Values {
    /// Range of the present voxels; `None` if there are none.
    pub range: Option<ValueRange>,
    /// Number of present voxels.
    pub present: u64,
    /// Counts in equal parts of the range.
    pub histogram: Vec<u64>,
    /// `[percent, value]` pairs, ascending.
    pub percentiles: Vec<[f64; 2]>,
}

/// Clamps a value to finite doubles, because JSON has no infinities.
#[must_use]
pub fn finite(value: f64) -> f64 {
    value.clamp(f64::MIN, f64::MAX)
}

impl Values {
    /// Converts counted statistics.
    #[must_use]
    pub fn of(descriptor: &Descriptor, statistics: &Statistics) -> Self {
        let stored = statistics.range();
        let value = |stored: f64| finite(descriptor.value(stored));
        let ends = [value(stored.min), value(stored.max)];
        let range = (!stored.is_empty()).then(|| ValueRange { min: ends[0].min(ends[1]), max: ends[0].max(ends[1]) });
        let mut percentiles: Vec<[f64; 2]> = statistics.percentiles().into_iter().map(|[p, v]| [p, value(v)]).collect();
        let mut histogram = if stored.is_empty() { Vec::new() } else { statistics.histogram() };
        if descriptor.scale < 0.0 {
            // A negative scale reverses the order of the values.
            percentiles.iter_mut().for_each(|p| p[0] = 100.0 - p[0]);
            percentiles.reverse();
            histogram.reverse();
        }
        Self { range, present: statistics.present(), histogram, percentiles }
    }
}

/// Bin of a stored value; greater values never have a smaller bin.
fn key(voxel_type: VoxelType, value: f64) -> usize {
    match voxel_type {
        VoxelType::U8 | VoxelType::U16 => whole(value),
        VoxelType::I8 => whole(value + 128.0),
        VoxelType::I16 => whole(value + 32768.0),
        VoxelType::F64 => {
            // Doubles in the range of f32 are rounded to f32 first, as for the other types.
            let rounded = single(value);
            let value = if rounded.is_normal() { f64::from(rounded) } else { value };
            (sortable(value) >> (64 - DOUBLE_BITS)) as usize
        }
        _ => {
            // Integers stay below infinity in f32, and present floats are finite.
            let bits = single(value).to_bits();
            // Floats sort like integers if negative ones have all bits flipped, and the others the sign bit.
            let sortable = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
            (sortable >> (32 - SINGLE_BITS)) as usize
        }
    }
}

/// Bits that sort like the numbers: negative numbers have all bits flipped, the others the sign bit.
fn sortable(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 1 { !bits } else { bits | 1 << 63 }
}

/// Stored value of a bin: the value itself, or the middle of the bin.
fn value_of(voxel_type: VoxelType, bin: usize) -> f64 {
    match voxel_type {
        VoxelType::U8 | VoxelType::U16 => bin as f64,
        VoxelType::I8 => bin as f64 - 128.0,
        VoxelType::I16 => bin as f64 - 32768.0,
        // Zero is common, and the middle of its bin would be an arbitrary number.
        VoxelType::F64 if bin == key(VoxelType::F64, 0.0) => 0.0,
        VoxelType::F64 => {
            let sortable = (bin as u64) << (64 - DOUBLE_BITS) | 1 << (63 - DOUBLE_BITS);
            let middle = if sortable >> 63 == 1 { sortable & !(1 << 63) } else { !sortable };
            // Bits that f32 has, too: the middle is the same number for both types.
            f64::from_bits(middle & !((1 << 29) - 1))
        }
        _ => {
            let sortable = narrow::<u32>(bin) << (32 - SINGLE_BITS) | 1 << (31 - SINGLE_BITS);
            let bits = if sortable >> 31 == 1 { sortable & !(1 << 31) } else { !sortable };
            f64::from(f32::from_bits(bits))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_follow_the_order_of_values() {
        let single = [-1e30, -5.0, -1.0, -1e-20, 0.0, 1e-20, 1.0, 2.0, 3e4, 1e30];
        let double = [f64::MIN, -1e300, -5.0, -1e-45, -1e-300, 0.0, 1e-300, 1.1e-300, 1e-45, 1.0, 1e38, 1e39, 1e300];
        for (voxel_type, values) in
            [(VoxelType::F32, &single[..]), (VoxelType::F64, &single), (VoxelType::F64, &double)]
        {
            let bins: Vec<usize> = values.iter().map(|&v| key(voxel_type, v)).collect();
            assert!(bins.windows(2).all(|w| w[0] < w[1]), "{bins:?}");
            for &v in values.iter().filter(|v| **v != 0.0) {
                let back = value_of(voxel_type, key(voxel_type, v));
                assert!((back - v).abs() <= v.abs() / 128.0, "{v} became {back}");
            }
        }
    }

    #[test]
    fn doubles_are_counted_as_the_singles_are_that_they_round_to() {
        for value in [-1e30_f64, -0.1, 1.0 - 1e-9, 0.3, 7e-38, 3.4e38] {
            let [single, double] = [VoxelType::F32, VoxelType::F64].map(|of| value_of(of, key(of, value)));
            assert_eq!(single, double, "{value}");
        }
    }

    #[test]
    fn percentiles_of_bytes_are_exact_and_spikes_move_nothing() {
        let mut bytes = Statistics::new(VoxelType::U8);
        bytes.add(&(0..=255).collect::<Vec<u8>>(), Absence { nodata: Some(255.0) });
        assert_eq!(bytes.present(), 255);
        assert_eq!(bytes.range(), ValueRange { min: 0.0, max: 254.0 });
        assert!(bytes.percentiles().contains(&[50.0, 127.0]));

        let mut floats = Statistics::new(VoxelType::F32);
        let mut values: Vec<f32> = (0..10_000).map(|i| i as f32).collect();
        values[17] = 1e7;
        floats.add(bytemuck::cast_slice(&values), Absence::NON_FINITE_ONLY);
        let p99 = floats.percentiles().iter().find(|p| p[0] == 99.0).expect("99 is listed")[1];
        assert!((p99 - 9900.0).abs() < 80.0, "{p99}");
        assert_eq!(floats.histogram().iter().sum::<u64>(), 10_000);
    }
}
