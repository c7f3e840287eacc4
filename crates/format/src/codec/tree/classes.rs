//! Classes of details by the activity of the averages around them, so that flat and busy parts of a brick have Huffman codes
//! of their own. Encoder and decoder both know the averages, so classes cost no bits.
//!
//! Details form groups of [`GROUP`] along x. The activity of a group is the sum, over its samples and the three axes, of the
//! distance between the averages before and behind the sample. Three thresholds, in the payload, divide groups into classes.

use super::grid::{Grid, Halving, LANES, lanes_of, rows_of};
use crate::codec::sample::Sample;

/// Details of a group.
pub const GROUP: usize = 16;
/// Number of classes.
pub const CLASSES: usize = 4;
/// Bytes that a chunk of its own costs, roughly: lengths, and codes of its Huffman table.
const CHUNK_BYTES: f64 = 80.0;

/// The details of a halving.
#[derive(Debug, Clone, Copy)]
pub struct Band(pub Halving);

impl Band {
    /// Numbers of the row (y, z).
    #[inline(always)]
    pub fn row(self, at: [usize; 2]) -> usize {
        self.0.pairs(at)
    }

    /// All numbers.
    pub fn count(self) -> usize {
        rows_of(self.0.half).map(|at| self.row(at)).sum()
    }

    /// Number of groups.
    pub fn groups(self) -> usize {
        rows_of(self.0.half).map(|at| self.row(at).div_ceil(GROUP)).sum()
    }

    /// Activities of all groups of all rows, in order.
    #[inline(always)]
    pub fn activities<S: Sample>(self, averages: &Grid<S>) -> Vec<u32> {
        let mut all = Vec::with_capacity(self.0.half[1] * self.0.half[2] * averages.width() / GROUP);
        for at in rows_of(self.0.half) {
            let near = averages.near(at);
            let across = [
                [near.row([-1, 0, 0]), near.row([1, 0, 0])],
                [near.row([0, -1, 0]), near.row([0, 1, 0])],
                [near.row([0, 0, -1]), near.row([0, 0, 1])],
            ];
            for group in 0..self.row(at).div_ceil(GROUP) {
                let mut sum = [0u32; GROUP];
                for [before, behind] in across {
                    let (before, behind) = (lanes_of(before, group), lanes_of(behind, group));
                    for i in 0..GROUP {
                        let distance = before[i].minus(behind[i]).number().unsigned_abs();
                        sum[i] = sum[i].wrapping_add(distance);
                    }
                }
                all.push(total(sum));
            }
        }
        all
    }
}

/// Sum of lanes.
#[inline(always)]
fn total(mut lanes: [u32; GROUP]) -> u32 {
    let mut count = GROUP / 2;
    while count > 0 {
        for i in 0..count {
            lanes[i] = lanes[i].wrapping_add(lanes[i + count]);
        }
        count /= 2;
    }
    lanes[0]
}

/// Division into classes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Thresholds(pub [u32; CLASSES - 1]);

impl Thresholds {
    /// One class for all.
    pub const NONE: Self = Self([u32::MAX; CLASSES - 1]);

    /// Thresholds that divide groups into classes of about the same size.
    pub fn quantiles(activities: &[u32]) -> Self {
        if activities.is_empty() {
            return Self::NONE;
        }
        let mut sorted = activities.to_vec();
        sorted.sort_unstable();
        Self(std::array::from_fn(|i| sorted[(i + 1) * sorted.len() / CLASSES]))
    }

    /// Class of a group.
    #[inline(always)]
    pub fn class(self, activity: u32) -> u8 {
        let [a, b, c] = self.0;
        u8::from(activity >= a) + u8::from(activity >= b) + u8::from(activity >= c)
    }
}

/// Numbers of each class, in order.
pub fn divide<S: Sample>(band: Band, numbers: &[S], activities: &[u32], thresholds: Thresholds) -> [Vec<S>; CLASSES] {
    let mut classes: [Vec<S>; CLASSES] = Default::default();
    let (mut rest, mut group) = (numbers, 0);
    for at in rows_of(band.0.half) {
        let (row, behind) = rest.split_at(band.row(at));
        rest = behind;
        for part in row.chunks(GROUP) {
            classes[usize::from(thresholds.class(activities[group]))].extend_from_slice(part);
            group += 1;
        }
    }
    classes
}

/// Numbers of a band, by class.
pub struct Divided<S> {
    /// Numbers of each class, followed by room for a group.
    pub numbers: [Vec<S>; CLASSES],
    /// Class of each group.
    of_groups: Vec<u8>,
    /// Numbers taken of each class, and groups taken.
    taken: [usize; CLASSES],
    group: usize,
}

impl<S: Sample> Divided<S> {
    /// Zeros for all numbers of a band; all are in the first class.
    pub fn undivided(band: Band) -> Self {
        let numbers = [band.count(), 0, 0, 0].map(Self::zeros);
        Self { numbers, of_groups: vec![0; band.groups()], taken: [0; CLASSES], group: 0 }
    }

    /// Zeros for all numbers of a band.
    pub fn by(band: Band, activities: &[u32], thresholds: Thresholds) -> Self {
        let mut counts = [0; CLASSES];
        let mut of_groups = Vec::with_capacity(activities.len());
        for at in rows_of(band.0.half) {
            let mut left = band.row(at);
            while left > 0 {
                let class = thresholds.class(activities[of_groups.len()]);
                counts[usize::from(class)] += left.min(GROUP);
                of_groups.push(class);
                left = left.saturating_sub(GROUP);
            }
        }
        Self { numbers: counts.map(Self::zeros), of_groups, taken: [0; CLASSES], group: 0 }
    }

    fn zeros(count: usize) -> Vec<S> {
        vec![S::default(); count + GROUP]
    }

    /// Number of each class's numbers.
    pub fn counts(&self) -> [usize; CLASSES] {
        [0, 1, 2, 3].map(|class| self.numbers[class].len() - GROUP)
    }

    /// Adds the next `count` numbers to `row`, whose length is a multiple of [`GROUP`]. What lies behind them changes, too.
    #[inline(always)]
    pub fn add_to(&mut self, row: &mut [S], count: usize) {
        let mut left = count;
        for part in row.as_chunks_mut::<GROUP>().0.iter_mut().take(count.div_ceil(GROUP)) {
            let class = usize::from(self.of_groups[self.group]) % CLASSES;
            let numbers: &[S; GROUP] =
                self.numbers[class][self.taken[class]..].first_chunk().expect("there is room for a group");
            for i in 0..GROUP {
                part[i] = part[i].plus(numbers[i]);
            }
            self.taken[class] += left.min(GROUP);
            left = left.saturating_sub(GROUP);
            self.group += 1;
        }
    }
}

/// Whether classes need fewer bytes than all their details together.
pub fn are_smaller<S: Sample>(classes: &[Vec<S>; CLASSES], all: &[S]) -> bool {
    let bytes = |details: &[S]| if details.is_empty() { 0.0 } else { estimate(details) / 8.0 + CHUNK_BYTES };
    classes.iter().map(|class| bytes(class)).sum::<f64>() < bytes(all)
}

/// Estimated bits of details with a geometric distribution.
fn estimate<S: Sample>(details: &[S]) -> f64 {
    let sum: u64 = details.iter().map(|d| 2 * u64::from(d.number().unsigned_abs())).sum();
    let mean = sum as f64 / details.len() as f64;
    let bits = if mean == 0.0 { 0.0 } else { (mean + 1.0) * (mean + 1.0).log2() - mean * mean.log2() };
    details.len() as f64 * bits
}

const _: () = assert!(GROUP == LANES, "rows are whole groups");
