//! Sketch of the values of wide voxels: counts in the finest intervals that fit a bounded table.
//!
//! An interval is `[i * 2^e, (i + 1) * 2^e)` for an integer i. Only intervals that hold voxels take room. The exponent e
//! starts so small that each number has an interval of its own. When more than [`LIMIT`] intervals are occupied, e grows
//! until they fit. Intervals of a greater exponent are unions of finer ones. So the final exponent and counts depend on
//! the values alone: neither on their order nor on the division among threads.
//!
//! Promise: if e grew, an interval is at most 2 / `LIMIT` of the range wide, whatever the offset of the values. A few
//! values far from the others take an interval each, and do not make the other intervals wider.

use supervol_format::VoxelType;
use supervol_format::cast::{index, narrow};

/// Most occupied intervals.
pub const LIMIT: usize = 1 << 13;
/// Slots of a full table; half of them stay free.
const SLOTS: usize = 2 * LIMIT;
/// Slots of a new table.
const FIRST_SLOTS: usize = 1 << 10;
/// Numbers of at least this many intervals count by themselves. They are 1/2^51 of the range wide, or multiples of the
/// width.
const EXACT: f64 = (1u64 << 51) as f64;
/// A sum with this number has no fraction.
const ROUNDING: f64 = 3.0 * EXACT;
/// Greatest exponent of an interval. Four intervals of this size hold all doubles.
const EXPONENT_LIMIT: i32 = 1023;

/// An occupied interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Least number of the interval.
    pub low: f64,
    /// Greatest number of the interval, or slightly more; equals `low` if the interval holds one number.
    pub high: f64,
    /// Number of voxels, at least 1.
    pub count: u64,
}

impl Interval {
    /// Its middle.
    #[must_use]
    pub fn middle(&self) -> f64 {
        0.5 * self.low + 0.5 * self.high
    }
}

/// Slot of the table; free if the count is 0.
#[derive(Debug, Clone, Copy, Default)]
struct Slot {
    /// Least number of the interval.
    start: f64,
    count: u64,
}

/// Counts by interval, see the module.
#[derive(Debug, Clone)]
pub struct Sketch {
    voxel_type: VoxelType,
    width: Width,
    slots: Vec<Slot>,
    used: usize,
}

/// Width of the intervals: 2^exponent, and its reciprocal.
#[derive(Debug, Clone, Copy)]
struct Width {
    exponent: i32,
    width: f64,
    reciprocal: f64,
}

impl Width {
    fn of(exponent: i32) -> Self {
        Self { exponent, width: power(exponent), reciprocal: power(-exponent) }
    }

    /// The number i of the interval of `value`, as a floating-point number; `None` if the value is a multiple of the
    /// width itself.
    #[inline]
    fn number(self, value: f64) -> Option<f64> {
        let scaled = value * self.reciprocal;
        if scaled.abs() >= EXACT {
            return None;
        }
        // Adding and subtracting rounds to a whole number, faster than `floor` of a plain x86-64.
        let rounded = (scaled + ROUNDING) - ROUNDING;
        // A negative number may underflow to zero, but belongs to an interval below zero.
        let is_above = rounded > scaled || (rounded == 0.0 && value < 0.0 && scaled == 0.0);
        Some(if is_above { rounded - 1.0 } else { rounded })
    }

    /// Least number of the interval of `value`.
    #[inline]
    fn start(self, value: f64) -> f64 {
        // Zero without a sign.
        self.number(value).map_or(value, |number| number * self.width + 0.0)
    }

    /// Least number of the interval of `value`, and the bits that choose its slot.
    #[inline]
    fn place(self, value: f64) -> (f64, u64) {
        match self.number(value) {
            // The last bits are those of the whole number, so neighbouring intervals have neighbouring slots.
            Some(number) => (number * self.width + 0.0, (number + ROUNDING).to_bits()),
            None => (value, mixed(value.to_bits()) >> 32),
        }
    }
}

/// Bits that differ in all places if `bits` differ in any.
fn mixed(bits: u64) -> u64 {
    bits.wrapping_mul(0x9E37_79B9_7F4A_7C15)
}

/// 2^exponent for -1023 to 1023.
fn power(exponent: i32) -> f64 {
    // The least one is subnormal.
    let bits = if exponent < f64::MIN_EXP - 1 { 1 << 51 } else { narrow::<u64>(i64::from(exponent) + 1023) << 52 };
    f64::from_bits(bits)
}

/// Exponent of a new sketch: each number has an interval of its own, except the least doubles.
fn first_exponent(voxel_type: VoxelType) -> i32 {
    match voxel_type {
        VoxelType::F64 => f64::MIN_EXP - 1,
        VoxelType::F32 => f32::MIN_EXP - 24,
        _ => 0,
    }
}

impl Sketch {
    /// A sketch without values.
    #[must_use]
    pub fn new(voxel_type: VoxelType) -> Self {
        Self::with(voxel_type, Width::of(first_exponent(voxel_type)))
    }

    fn with(voxel_type: VoxelType, width: Width) -> Self {
        let slots = vec![Slot::default(); FIRST_SLOTS];
        Self { voxel_type, width, slots, used: 0 }
    }

    /// A sketch without values, with intervals of this sketch's size: for more voxels of the same volume.
    #[must_use]
    pub fn beside(&self) -> Self {
        Self::with(self.voxel_type, self.width)
    }

    /// Greatest memory of a sketch in bytes, with the copy that is made when intervals are joined.
    #[must_use]
    pub const fn bytes() -> u64 {
        ((SLOTS + LIMIT) * size_of::<Slot>()) as u64
    }

    /// Counts a finite value.
    #[inline]
    pub fn add(&mut self, value: f64) {
        let (start, bits) = self.width.place(value);
        let at = self.slot(bits);
        let slot = &mut self.slots[at];
        if slot.start == start && slot.count > 0 {
            slot.count += 1;
        } else {
            self.add_many(Slot { start, count: 1 }, bits);
        }
    }

    /// First slot for these bits.
    #[inline]
    fn slot(&self, bits: u64) -> usize {
        // The number of slots is a power of two.
        index(bits) & (self.slots.len() - 1)
    }

    #[cold]
    fn add_many(&mut self, slot: Slot, bits: u64) {
        self.insert(slot, bits);
        if self.used * 2 > self.slots.len() {
            self.make_room();
        }
    }

    /// Adds to the slot of an interval.
    fn insert(&mut self, Slot { start, count }: Slot, bits: u64) {
        // An odd step meets every slot.
        let (mask, step) = (self.slots.len() - 1, index(mixed(bits) >> 32) | 1);
        let mut at = self.slot(bits);
        while self.slots[at].count > 0 && self.slots[at].start != start {
            at = (at + step) & mask;
        }
        self.used += usize::from(self.slots[at].count == 0);
        let slot = &mut self.slots[at];
        (slot.start, slot.count) = (start, slot.count + count);
    }

    /// Takes more slots, or greater intervals if the table is full.
    fn make_room(&mut self) {
        let mut occupied: Vec<Slot> = self.slots.iter().filter(|slot| slot.count > 0).copied().collect();
        let mut slots = self.slots.len() * 2;
        if self.used > LIMIT {
            slots = SLOTS;
            occupied.sort_unstable_by(|a, b| a.start.total_cmp(&b.start));
            self.width = Width::of(fitting(&occupied, self.width.exponent));
        }
        self.refill(occupied, slots);
    }

    fn refill(&mut self, occupied: Vec<Slot>, slots: usize) {
        self.slots.clear();
        self.slots.resize(slots, Slot::default());
        self.used = 0;
        for Slot { start, count } in occupied {
            let (start, bits) = self.width.place(start);
            self.insert(Slot { start, count }, bits);
        }
    }

    /// Adds the counts of another sketch of the same volume.
    pub fn merge(&mut self, other: &Self) {
        if other.width.exponent > self.width.exponent {
            self.width = other.width;
            let occupied = self.slots.iter().filter(|slot| slot.count > 0).copied().collect();
            self.refill(occupied, self.slots.len());
        }
        for slot in other.slots.iter().filter(|slot| slot.count > 0) {
            let (start, bits) = self.width.place(slot.start);
            self.add_many(Slot { start, count: slot.count }, bits);
        }
    }

    /// The occupied intervals, ascending.
    #[must_use]
    pub fn intervals(&self) -> Vec<Interval> {
        let occupied = self.slots.iter().filter(|slot| slot.count > 0);
        let mut intervals: Vec<Interval> = occupied
            .map(|&Slot { start, count }| {
                let width = if self.holds_one(start) { 0.0 } else { self.width.width };
                Interval { low: start, high: (start + width).min(f64::MAX), count }
            })
            .collect();
        intervals.sort_unstable_by(|a, b| a.low.total_cmp(&b.low));
        intervals
    }

    /// Number of different values; `None` if there were too many to tell them apart.
    #[must_use]
    pub fn distinct(&self) -> Option<u64> {
        (self.width.exponent == first_exponent(self.voxel_type)).then_some(self.used as u64)
    }

    /// Whether an interval holds one number of the voxel type.
    fn holds_one(&self, start: f64) -> bool {
        // From here on the next number is at least one interval away, or each number has an interval of its own.
        let from = match self.voxel_type {
            VoxelType::F64 => EXACT,
            VoxelType::F32 => power(f32::MANTISSA_DIGITS.cast_signed()),
            _ => return self.width.exponent <= 0,
        };
        start.abs() * self.width.reciprocal >= from || self.width.exponent == first_exponent(self.voxel_type)
    }
}

/// Least exponent above `exponent` for which these occupied intervals, ascending, need at most [`LIMIT`].
fn fitting(occupied: &[Slot], exponent: i32) -> i32 {
    let fits = |exponent: i32| {
        let width = Width::of(exponent);
        let mut starts = occupied.iter().map(|slot| width.start(slot.start));
        let mut last = starts.next();
        let mut count = 1;
        for start in starts {
            count += usize::from(last != Some(start));
            last = Some(start);
        }
        count <= LIMIT
    };
    // Small steps first: usually the next exponent fits.
    let (mut below, mut step) = (exponent, 1);
    while below + step < EXPONENT_LIMIT && !fits(below + step) {
        below += step;
        step *= 2;
    }
    let mut fitting = (below + step).min(EXPONENT_LIMIT);
    while fitting - below > 1 {
        let middle = below + (fitting - below) / 2;
        if fits(middle) {
            fitting = middle;
        } else {
            below = middle;
        }
    }
    fitting
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use supervol_format::cast::whole;

    use super::*;

    fn sketch(voxel_type: VoxelType, values: impl IntoIterator<Item = f64>) -> Sketch {
        let mut sketch = Sketch::new(voxel_type);
        values.into_iter().for_each(|value| sketch.add(value));
        sketch
    }

    #[test]
    fn intervals_hold_their_values_at_any_offset_and_size() {
        for (offset, size) in
            [(0.0, 1.0), (101_325.0, 200.0), (1e9, 1e-3), (-1e300, 1e290), (0.0, 1e-300), (0.0, 1e308)]
        {
            let value = |i: u32| offset + size * (f64::from(i) * 0.618).sin();
            let sketch = sketch(VoxelType::F64, (0..200_000).map(value));
            let intervals = sketch.intervals();
            assert!((LIMIT / 4..=LIMIT).contains(&intervals.len()), "{offset} {size}: {}", intervals.len());
            assert_eq!(intervals.iter().map(|i| i.count).sum::<u64>(), 200_000);
            assert!(intervals.windows(2).all(|pair| pair[0].high <= pair[1].low && pair[0].low < pair[1].low));
            let widest = intervals.iter().map(|i| i.high - i.low).fold(0.0, f64::max);
            assert!(widest <= 4.0 * size / LIMIT as f64, "{offset} {size}: {widest}");
            let is_held = |v: f64| intervals.iter().any(|i| i.low <= v && (v < i.high || v == i.low));
            assert!((0..100).all(|i| is_held(value(i * 1999))), "{offset} {size}");
        }
    }

    #[test]
    fn far_values_do_not_widen_the_intervals_of_the_others() {
        let near = (0..100_000).map(|i| 293.0 + f64::from(i) / 5000.0);
        let far = [-1e30, 1e30, f64::from(f32::MAX), -9999.0, 1e12];
        let sketch = sketch(VoxelType::F64, near.chain(far));
        let intervals = sketch.intervals();
        assert!(intervals.iter().all(|i| i.high - i.low <= 40.0 / LIMIT as f64));
        assert!(far.iter().all(|v| intervals.iter().any(|i| (i.low - v).abs() <= 0.01)));
    }

    #[test]
    fn integers_are_told_apart_until_there_are_too_many() {
        let few = sketch(VoxelType::U32, (0..LIMIT).map(|i| (i * 130_003) as f64));
        assert_eq!(few.distinct(), Some(LIMIT as u64));
        assert!(few.intervals().iter().all(|i| i.low == i.high));
        let many = sketch(VoxelType::U32, (0..=LIMIT).map(|i| (i * 130_003) as f64));
        assert_eq!(many.distinct(), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// The same values in another order, in parts that begin at different exponents, give the same intervals.
        #[test]
        fn neither_order_nor_division_matters(
            seed in any::<u64>(),
            parts in 1usize..6,
            offset in prop_oneof![Just(0.0), Just(1e5), Just(-7e20)],
            spread in 0i32..40,
        ) {
            let mut state = seed | 1;
            let mut random = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1u64 << 53) as f64
            };
            let values: Vec<f64> =
                (0..90_000).map(|_| offset + (random() - 0.5) * power(whole::<i32>(random() * f64::from(spread)))).collect();
            let whole = sketch(VoxelType::F64, values.iter().copied());
            let mut merged = sketch(VoxelType::F64, values[..1000].iter().copied());
            for part in values[1000..].rchunks(89_000usize.div_ceil(parts)) {
                let mut beside = merged.beside();
                part.iter().rev().for_each(|&value| beside.add(value));
                merged.merge(&beside);
            }
            prop_assert_eq!(whole.intervals(), merged.intervals());
        }
    }
}
