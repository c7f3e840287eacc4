//! Evaluation of a histogram: shares of voxels between two values, and thresholds between classes of values.

use supervol_format::ValueRange;

/// Counts of voxels in bins of equal width over a range of values.
#[derive(Debug, Clone, Copy)]
pub struct Histogram<'a> {
    counts: &'a [u64],
    range: ValueRange,
}

impl<'a> Histogram<'a> {
    /// A histogram of `counts` over `range`. Without counts every share is zero.
    #[must_use]
    pub fn new(counts: &'a [u64], range: ValueRange) -> Self {
        Self { counts, range }
    }

    /// The middle value of each bin that holds voxels, and the bin's share of all voxels.
    pub fn shares(&self) -> impl Iterator<Item = (f64, f64)> + Clone {
        let total = self.total();
        let bins = self.counts.iter().enumerate().filter(|(_, count)| **count > 0);
        bins.map(move |(bin, &count)| (self.value(bin as f64 + 0.5), count as f64 / total))
    }

    /// Number of bins that hold voxels.
    #[must_use]
    pub fn bins_used(&self) -> usize {
        self.counts.iter().filter(|&&count| count > 0).count()
    }

    /// Share of all voxels in the fullest bin.
    #[must_use]
    pub fn fullest(&self) -> f64 {
        self.counts.iter().copied().max().unwrap_or(0) as f64 / self.total()
    }

    /// Whether the values are a background and something denser, with a gap between both. The background is the lower of
    /// two peaks, narrow and full. Something without a peak of its own is a field that fades.
    #[must_use]
    pub fn has_background(&self) -> bool {
        /// Parts of the range that are compared; noise of single bins vanishes in them.
        const PARTS: usize = 32;
        /// Least share of the background, and its greatest width, in parts.
        const FULL: f64 = 0.25;
        const NARROW: usize = 8;
        /// Least height of the second peak over the gap before it, and its least share of all voxels.
        const PEAK: f64 = 1.6;
        const MATTER: f64 = 0.02;
        if self.bins_used() < 2 * PARTS {
            return false;
        }
        let total = self.total();
        let end = |part: usize| part * self.counts.len() / PARTS;
        let sum = |part: usize| self.counts[end(part)..end(part + 1)].iter().map(|&c| c as f64).sum::<f64>() / total;
        let parts: [f64; PARTS] = std::array::from_fn(sum);
        // The last part may hold all values beyond it.
        let inner = &parts[..PARTS - 1];
        let first = (0..NARROW).max_by(|&a, &b| inner[a].total_cmp(&inner[b]).then(b.cmp(&a))).unwrap_or(0);
        let mut gap = first;
        for part in first + 1..inner.len() {
            if inner[part] < inner[gap] {
                gap = part;
            } else if inner[part] >= PEAK * inner[gap] && inner[part] > 0.0 {
                let background: f64 = parts[..=gap].iter().sum();
                let matter: f64 = parts[gap..].iter().sum();
                let is_narrow =
                    gap <= first + NARROW || parts[..first + NARROW].iter().sum::<f64>() >= 0.9 * background;
                if matter < MATTER {
                    return false;
                }
                return is_narrow && background >= FULL;
            }
        }
        false
    }

    /// Share of all voxels in bins whose middle lies between two values.
    #[must_use]
    pub fn share_between(&self, low: f64, high: f64) -> f64 {
        let within = |bin: &usize| (low..=high).contains(&self.value(*bin as f64 + 0.5));
        (0..self.counts.len()).filter(within).map(|bin| self.counts[bin] as f64).sum::<f64>() / self.total()
    }

    /// The threshold that best separates the voxels above `from` into two classes: N. Otsu (1979), A Threshold
    /// Selection Method from Gray-Level Histograms, equation 18. `None` if fewer than two bins hold voxels.
    #[must_use]
    pub fn threshold_above(&self, from: f64) -> Option<f64> {
        self.threshold_between(from, f64::INFINITY)
    }

    /// The same threshold for the voxels between two values.
    #[must_use]
    pub fn threshold_between(&self, from: f64, to: f64) -> Option<f64> {
        let first = (0..self.counts.len()).find(|&bin| self.value(bin as f64 + 1.0) > from)?;
        let end = (first..self.counts.len()).find(|&bin| self.value(bin as f64) >= to).unwrap_or(self.counts.len());
        let counts = &self.counts[first..end];
        let total: f64 = counts.iter().map(|&c| c as f64).sum();
        let moment: f64 = counts.iter().enumerate().map(|(i, &c)| i as f64 * c as f64).sum();
        let (mut below, mut moment_below) = (0.0, 0.0);
        let (mut best, mut ends) = (0.0, None);
        for (i, &count) in counts.iter().enumerate() {
            below += count as f64;
            moment_below += i as f64 * count as f64;
            let above = total - below;
            if below == 0.0 || above == 0.0 {
                continue;
            }
            let between = (moment * below / total - moment_below).powi(2) / (below * above);
            if between > best {
                (best, ends) = (between, Some((i, i)));
            } else if let Some((start, _)) = ends.filter(|_| between == best) {
                // A threshold anywhere in a run of empty bins separates the classes equally well: take the middle of
                // the run.
                ends = Some((start, i));
            }
        }
        ends.map(|(start, end)| self.value(first as f64 + 1.0 + 0.5 * (start + end) as f64))
    }

    /// The value below which the share `share` of the voxels above `from` lies.
    #[must_use]
    pub fn quantile_above(&self, from: f64, share: f64) -> f64 {
        let first = (0..self.counts.len()).find(|&bin| self.value(bin as f64 + 1.0) > from).unwrap_or(0);
        let counts = self.counts.get(first..).unwrap_or_default();
        let wanted = share * counts.iter().map(|&c| c as f64).sum::<f64>();
        let mut below = 0.0;
        for (i, &count) in counts.iter().enumerate() {
            let next = below + count as f64;
            if next >= wanted && count > 0 {
                return self.value((first + i) as f64 + (wanted - below) / count as f64);
            }
            below = next;
        }
        self.range.max
    }

    fn total(&self) -> f64 {
        self.counts.iter().map(|&c| c as f64).sum::<f64>().max(1.0)
    }

    /// The value at a position counted in bins.
    fn value(&self, place: f64) -> f64 {
        let share = place / self.counts.len().max(1) as f64;
        self.range.min * (1.0 - share) + self.range.max * share
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_part_classes_and_quantiles_leave_the_background_out() {
        let mut counts = vec![0; 256];
        counts[0] = 10_000;
        (100..110).for_each(|bin| counts[bin] = 50);
        (200..210).for_each(|bin| counts[bin] = 50);
        let histogram = Histogram::new(&counts, ValueRange { min: 0.0, max: 256.0 });
        let first = histogram.threshold_above(f64::NEG_INFINITY).expect("two classes");
        assert!(first > 1.0 && first < 100.5, "{first}");
        let second = histogram.threshold_above(first).expect("two classes");
        assert!(second > 110.0 && second < 200.5, "{second}");
        let median = histogram.quantile_above(first, 0.5);
        assert!((109.0..=201.0).contains(&median), "{median}");
        assert!((histogram.share_between(99.0, 300.0) - 1000.0 / 11_000.0).abs() < 1e-12);
        assert_eq!(histogram.bins_used(), 21);
    }

    #[test]
    fn a_single_value_has_no_threshold() {
        assert_eq!(Histogram::new(&[7], ValueRange { min: 3.0, max: 3.0 }).threshold_above(f64::NEG_INFINITY), None);
        assert_eq!(Histogram::new(&[], ValueRange { min: 0.0, max: 1.0 }).threshold_above(0.0), None);
    }
}
