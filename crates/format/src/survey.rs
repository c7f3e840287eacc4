//! Geometry of a seismic survey: line numbers, corners, samples. A container stores it in its manifest.

use serde::{Deserialize, Serialize};

use crate::container::manifest::Manifest;

/// Geometry of a seismic survey, from the trace headers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Survey {
    /// First inline number and step: inline of row j is `first + j * step`, step positive.
    pub inline: LineNumbers,
    /// The same for crosslines, along x.
    pub crossline: LineNumbers,
    /// World positions (CDP x, y, scaled) of the grid's corners (first il, first xl), (first il, last xl),
    /// (last il, first xl), (last il, last xl), if the headers have them.
    pub corners: Option<[[f64; 2]; 4]>,
    /// Sample interval along z, in the z axis's unit.
    pub sample_interval: f64,
    /// Position of the first sample along z (delay), in the z axis's unit.
    pub first_sample: f64,
    /// Number of traces of the grid that the file lacks.
    pub missing_traces: u64,
    /// Number of traces that their header marks as dead (trace identification code 2).
    pub dead_traces: u64,
    /// The text header, 40 lines of 80 characters, decoded.
    pub text_header: String,
}

impl Survey {
    /// Survey without positions: lines are numbered from 1, samples begin at 0.
    #[must_use]
    pub fn plain([crosslines, inlines]: [u64; 2], sample_interval: f64) -> Self {
        let lines = |count| LineNumbers { first: 1, step: 1, count };
        Self {
            inline: lines(inlines),
            crossline: lines(crosslines),
            corners: None,
            sample_interval,
            first_sample: 0.0,
            missing_traces: 0,
            dead_traces: 0,
            text_header: String::new(),
        }
    }

    /// The survey of a container; `None` if the container has none, or one with unknown content.
    #[must_use]
    pub fn of(manifest: &Manifest) -> Option<Self> {
        manifest.survey.as_ref().and_then(|json| serde_json::from_value(json.value()).ok())
    }

    /// Scale of each axis of the grid, as (number at index 0, step per index): crossline numbers, inline numbers, and
    /// times or depths in the third axis's unit.
    #[must_use]
    pub fn scales(&self) -> [[f64; 2]; 3] {
        let lines = |lines: LineNumbers| [lines.first as f64, lines.step as f64];
        [lines(self.crossline), lines(self.inline), [self.first_sample, self.sample_interval]]
    }
}

/// Arithmetic progression of line numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineNumbers {
    /// Smallest number.
    pub first: i64,
    /// Distance between neighbours, positive.
    pub step: i64,
    /// Number of lines.
    pub count: u64,
}
