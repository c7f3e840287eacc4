//! Least and greatest present value of a set of voxels; absent voxels are ignored.

use serde::{Deserialize, Serialize};

use crate::readable::Number;

/// Closed interval of values. `min > max` means that no value is present.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ValueRange {
    /// Least present value.
    pub min: f64,
    /// Greatest present value.
    pub max: f64,
}

impl std::fmt::Display for ValueRange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} to {}", Number(self.min), Number(self.max))
    }
}

impl ValueRange {
    /// Range without a value.
    pub const EMPTY: Self = Self { min: f64::INFINITY, max: f64::NEG_INFINITY };

    /// Whether the range has no value.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.min > self.max
    }

    /// Extends the range to contain `value`.
    #[inline]
    pub fn include(&mut self, value: f64) {
        self.min = self.min.min(value);
        self.max = self.max.max(value);
    }

    /// Smallest range that contains both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Whether a value lies inside.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        self.min <= value && value <= self.max
    }

    /// Whether every value of `other` lies inside.
    #[must_use]
    pub fn holds(self, other: Self) -> bool {
        other.is_empty() || (self.min <= other.min && other.max <= self.max)
    }

    /// Range of `scale * value + offset`.
    #[must_use]
    pub fn scaled(self, scale: f64, offset: f64) -> Self {
        if self.is_empty() {
            return self;
        }
        let ends = [self.min, self.max].map(|value| value * scale + offset);
        Self { min: ends[0].min(ends[1]), max: ends[0].max(ends[1]) }
    }

    /// The range extended by `by` at both ends; an empty range stays empty.
    #[must_use]
    pub fn widened(self, by: f64) -> Self {
        if self.is_empty() { self } else { Self { min: self.min - by, max: self.max + by } }
    }

    /// `max - min`, or 0 for an empty range.
    #[must_use]
    pub fn width(self) -> f64 {
        if self.is_empty() { 0.0 } else { self.max - self.min }
    }
}
