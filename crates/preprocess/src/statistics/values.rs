//! The statistics of a manifest, in data units.

use supervol_format::ValueRange;
use supervol_format::container::header::Descriptor;
use supervol_format::container::manifest::{Central, Distribution, LABELS_LISTED, Manifest};
use supervol_format::readable::{Number, Shortened};

use super::bins::key;
use super::central::central;
use super::sketch::Interval;
use super::{Statistics, has_exact_bins, histogram, percentiles};

/// Parameter of a manifest with the reason why the voxels are labels.
pub const LABELS: &str = "labels";

/// Form of the statistics in a manifest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Percentiles and histogram from bins alone, without a distribution, as release 0.1.0 wrote them.
    Binned,
    /// Percentiles and histogram from the finest intervals, with a distribution.
    Resolved,
    /// As [`Form::Resolved`], for labels: no value is far, and the labels are listed.
    Labels,
}

impl Form {
    /// The form of a manifest's statistics.
    #[must_use]
    pub fn of(manifest: &Manifest) -> Self {
        match manifest.distribution {
            None => Self::Binned,
            Some(_) if manifest.parameters.contains_key(LABELS) => Self::Labels,
            Some(_) => Self::Resolved,
        }
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
    /// Different values, and those without far ones; `None` in the form [`Form::Binned`].
    pub distribution: Option<Distribution>,
    /// One sentence about far values, if there are any.
    pub note: Option<String>,
}

/// Clamps a value to finite doubles, because JSON has no infinities.
#[must_use]
pub fn finite(value: f64) -> f64 {
    value.clamp(f64::MIN, f64::MAX)
}

impl Values {
    /// Converts counted statistics.
    #[must_use]
    pub fn of(descriptor: &Descriptor, statistics: &Statistics, form: Form) -> Self {
        let units = DataUnits(descriptor);
        let stored = statistics.range();
        let (present, range) = (statistics.present(), (!stored.is_empty()).then(|| units.range(stored)));
        let intervals = match form {
            Form::Binned => statistics.binned(),
            Form::Resolved | Form::Labels => statistics.intervals(),
        };
        let mut found = percentiles(&intervals);
        if form != Form::Binned && !has_exact_bins(statistics.voxel_type) {
            refine(&mut found, statistics);
        }
        let mut values = Self {
            range,
            present,
            histogram: if stored.is_empty() { Vec::new() } else { units.histogram(&intervals, stored) },
            percentiles: units.percentiles(found.into_iter().map(|(pair, _)| pair)),
            distribution: None,
            note: None,
        };
        if form != Form::Binned {
            let distinct_values = statistics.distinct();
            let places = (form == Form::Resolved).then(|| central(&intervals)).flatten();
            values.note = places.clone().map(|places| units.note(&intervals, places));
            let central = places.map(|places| units.central(&intervals, places));
            let is_listed = form == Form::Labels && distinct_values.is_some_and(|count| count <= LABELS_LISTED as u64);
            let listed = intervals.iter().filter(|_| is_listed);
            let labels = listed.map(|interval| units.value(interval.low)).collect();
            values.distribution = Some(Distribution { distinct_values, central, labels });
        }
        values
    }
}

/// Takes the bin's value where the bin is narrower than the interval.
fn refine(found: &mut [([f64; 2], Interval)], statistics: &Statistics) {
    /// Least number of parts of a value that its bin resolves.
    const PARTS: f64 = 128.0;
    let binned = percentiles(&statistics.binned());
    for ((pair, interval), ([_, value], _)) in found.iter_mut().zip(binned) {
        let is_zero = key(statistics.voxel_type, value) == key(statistics.voxel_type, 0.0);
        // Zero is common, and the middle of its bin would be an arbitrary number.
        let value = if is_zero { 0.0 } else { value };
        if value.abs() / PARTS < interval.high - interval.low {
            pair[1] = value.clamp(interval.low, interval.high);
        }
    }
}

/// Conversion of stored values to data units.
struct DataUnits<'a>(&'a Descriptor);

impl DataUnits<'_> {
    fn value(&self, stored: f64) -> f64 {
        finite(self.0.value(stored))
    }

    /// Whether a negative scale reverses the order of the values.
    fn is_reversed(&self) -> bool {
        self.0.scale < 0.0
    }

    fn range(&self, stored: ValueRange) -> ValueRange {
        let ends = [self.value(stored.min), self.value(stored.max)];
        ValueRange { min: ends[0].min(ends[1]), max: ends[0].max(ends[1]) }
    }

    fn histogram(&self, intervals: &[Interval], stored: ValueRange) -> Vec<u64> {
        let mut counts = histogram(intervals, stored);
        if self.is_reversed() {
            counts.reverse();
        }
        counts
    }

    fn percentiles(&self, stored: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
        let mut pairs: Vec<[f64; 2]> = stored.map(|[p, v]| [p, self.value(v)]).collect();
        if self.is_reversed() {
            pairs.iter_mut().for_each(|p| p[0] = 100.0 - p[0]);
            pairs.reverse();
        }
        pairs
    }

    fn central(&self, intervals: &[Interval], places: std::ops::Range<usize>) -> Central {
        let count = |part: &[Interval]| part.iter().map(|i| i.count).sum::<u64>();
        let far = [count(&intervals[..places.start]), count(&intervals[places.end..])];
        let inside = &intervals[places];
        let stored = range_of(inside);
        let [below, above] = if self.is_reversed() { [far[1], far[0]] } else { far };
        Central {
            range: self.range(stored),
            below,
            above,
            histogram: self.histogram(inside, stored),
            percentiles: self.percentiles(percentiles(inside).into_iter().map(|(pair, _)| pair)),
        }
    }

    /// A value with the digits that its type has.
    fn shortened(&self, value: f64) -> Shortened {
        let descriptor = self.0;
        Shortened::data(value, descriptor.voxel_type, [descriptor.scale, descriptor.offset])
    }

    /// A sentence that names the far values.
    fn note(&self, intervals: &[Interval], places: std::ops::Range<usize>) -> String {
        /// Most values that are named one by one.
        const NAMED: usize = 3;
        /// Share of the voxels from which a single value is no outlier, but stands for "no value".
        const NULL: f64 = 0.001;
        let far: Vec<&Interval> = intervals[..places.start].iter().chain(&intervals[places.end..]).collect();
        let count: u64 = far.iter().map(|i| i.count).sum();
        let all: u64 = intervals.iter().map(|i| i.count).sum();
        let number = |stored: f64| brief(self.value(stored));
        let shown = match &far[..] {
            [first, .., last] if far.len() > NAMED => format!("{} to {}", number(first.low), number(last.low)),
            few => few.iter().map(|i| number(i.low)).collect::<Vec<_>>().join(", "),
        };
        let is_null = far.iter().any(|i| i.count > 1 && i.count as f64 > NULL * all as f64);
        let null = far.iter().max_by_key(|i| i.count).map_or(0.0, |i| self.value(i.low));
        let advice =
            format!(", perhaps a null (the option `nodata` with the value {} makes it absent)", self.shortened(null));
        let ValueRange { min, max } = self.range(range_of(&intervals[places]));
        format!(
            "{} of {all} {} far from all others ({} to {}): {shown}{}; default colours leave them out",
            if count == 1 { "1 voxel".into() } else { format!("{count} voxels") },
            if count == 1 { "lies" } else { "lie" },
            brief(min),
            brief(max),
            if is_null { &advice } else { "" },
        )
    }
}

/// A number with six digits.
fn brief(value: f64) -> String {
    let rounded = format!("{value:.5e}").parse().unwrap_or(value);
    Number(rounded).to_string()
}

/// Range of these intervals, at least one, which ascend.
fn range_of(intervals: &[Interval]) -> ValueRange {
    ValueRange { min: intervals[0].low, max: intervals[intervals.len() - 1].high }
}
