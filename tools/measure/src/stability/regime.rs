//! One regime of the stability suite: its measurement, the curve into the failure, and the gates.

use serde::Serialize;

use crate::context::{ChartError, Context};

/// One regime.
#[derive(Debug)]
pub struct Regime {
    /// `S01` to `S51`.
    pub id: &'static str,
    /// The failure, in a few words.
    pub title: &'static str,
    /// Procedure of the measurement: one or two sentences.
    pub recipe: &'static str,
    /// Meaning of the curve's x, with its unit.
    pub x_label: &'static str,
    /// Quantity measured in the curve, with its unit.
    pub y_label: &'static str,
    /// Measurement of the regime.
    pub run: fn(&Context<'_>) -> Result<Outcome, ChartError>,
}

/// One point of a curve into the failure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Line of the plot: `default`, or the name of a method of comparison.
    pub series: String,
    /// Position along the regime, from harmless to failing.
    pub x: f64,
    /// Measured value; null if it is not finite.
    pub measured: f64,
    /// Expected value, computed independently or by a closed form; null if there is none.
    pub expected: Option<f64>,
}

impl CurvePoint {
    /// A point of the line `series`.
    #[must_use]
    pub fn new(series: &str, x: f64, measured: f64, expected: Option<f64>) -> Self {
        Self { series: series.into(), x, measured, expected }
    }
}

/// Side of the limit on which a gate's value must lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The value must not exceed the limit.
    AtMost,
    /// The value must reach the limit.
    AtLeast,
}

/// Dependencies of a gate's value besides the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GateKind {
    /// None: the value is the same on every machine and in every run.
    Result,
    /// Speed and load of the machine: tests do not assert the gate.
    Speed,
}

/// A promised number.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gate {
    /// Meaning of the value, with its unit: one clause.
    pub what: String,
    /// Measured value.
    pub value: f64,
    /// Promised limit.
    pub limit: f64,
    /// Side of the limit on which the value must lie.
    pub side: Side,
    /// Dependencies of the value besides the program.
    pub kind: GateKind,
}

impl Gate {
    /// A gate `value <= limit`.
    #[must_use]
    pub fn at_most(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, side: Side::AtMost, kind: GateKind::Result }
    }

    /// A gate `value >= limit`.
    #[must_use]
    pub fn at_least(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, side: Side::AtLeast, kind: GateKind::Result }
    }

    /// The same gate on a measured time.
    #[must_use]
    pub fn speed(self) -> Self {
        Self { kind: GateKind::Speed, ..self }
    }

    /// Whether the gate holds; never for NaN.
    #[must_use]
    pub fn holds(&self) -> bool {
        match self.side {
            Side::AtMost => self.value <= self.limit,
            Side::AtLeast => self.value >= self.limit,
        }
    }
}

/// Result of a regime.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The curve into the failure, never empty: methods of comparison beside the default.
    pub curve: Vec<CurvePoint>,
    /// The regime's gates, never empty; the first is the one quoted.
    pub gates: Vec<Gate>,
    /// Remarks for the reader: method, findings, reason of a failing gate. May be empty.
    pub note: String,
}

impl Outcome {
    /// Whether every gate holds.
    #[must_use]
    pub fn pass(&self) -> bool {
        !self.gates.is_empty() && self.gates.iter().all(Gate::holds)
    }
}
