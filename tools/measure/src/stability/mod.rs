//! The stability suite: every regime in which a method breaks, with a recipe, a curve into the failure, and a gate.
//!
//! A [`Regime`] is one row of the list of regimes (S01 to S48). The report runs them at `Scale::Full`, the tests at
//! `Scale::Small`: the same code, fewer and smaller cases. A gate is a number that the project has promised; it is
//! never loosened to pass: a regime that fails is reported failing and has its place in `tests/tests/known_issues.rs`.

mod borders;
pub mod classification;
mod coded;
pub mod compositing;
mod extremes;
mod geometry;
mod jitter;
pub(crate) mod leaping;
mod lod;
pub(crate) mod parallel;
pub mod reconstruction;
pub mod segments;
pub mod streaming;
mod values;
mod views;

use serde::Serialize;

use crate::context::{ChartError, Context};

/// One regime.
pub struct Regime {
    /// `S01` to `S48`.
    pub id: &'static str,
    /// What fails, in a few words.
    pub title: &'static str,
    /// What is done: one or two sentences.
    pub recipe: &'static str,
    /// What x is in the curve, with its unit.
    pub x_label: &'static str,
    /// What is measured in the curve, with its unit.
    pub y_label: &'static str,
    /// Measures it.
    pub run: fn(&Context<'_>) -> Result<Outcome, ChartError>,
}

/// One point of a curve into the failure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CurvePoint {
    /// Which line of the plot the point belongs to: `default`, or the name of a method of comparison.
    pub series: String,
    /// How far into the regime.
    pub x: f64,
    /// What was measured; null where it is not finite.
    pub measured: f64,
    /// What was computed independently, or follows from a closed form; null where there is no such number.
    pub expected: Option<f64>,
}

impl CurvePoint {
    /// A point of the line `series`.
    #[must_use]
    pub fn new(series: &str, x: f64, measured: f64, expected: Option<f64>) -> Self {
        Self { series: series.into(), x, measured, expected }
    }
}

/// Which side of its limit a gate's value must lie on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The value must not exceed the limit.
    AtMost,
    /// The value must reach the limit.
    AtLeast,
}

/// What a gate's value depends on besides the program.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GateKind {
    /// Nothing: it is the same on every machine and in every run.
    Result,
    /// How fast the machine is and what else it does: tests do not assert it.
    Speed,
}

/// A number that was promised.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Gate {
    /// What the value is, with its unit: one clause.
    pub what: String,
    /// What was measured.
    pub value: f64,
    /// What was promised.
    pub limit: f64,
    /// On which side of the limit the value must lie.
    pub side: Side,
    /// What the value depends on besides the program.
    pub kind: GateKind,
}

impl Gate {
    /// `value <= limit`.
    #[must_use]
    pub fn at_most(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, side: Side::AtMost, kind: GateKind::Result }
    }

    /// `value >= limit`.
    #[must_use]
    pub fn at_least(what: impl Into<String>, value: f64, limit: f64) -> Self {
        Self { what: what.into(), value, limit, side: Side::AtLeast, kind: GateKind::Result }
    }

    /// The same gate, on a measured time.
    #[must_use]
    pub fn speed(self) -> Self {
        Self { kind: GateKind::Speed, ..self }
    }

    /// Whether it holds; never for NaN.
    #[must_use]
    pub fn holds(&self) -> bool {
        match self.side {
            Side::AtMost => self.value <= self.limit,
            Side::AtLeast => self.value >= self.limit,
        }
    }
}

/// What was measured in a regime.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The curve into the failure, never empty: methods of comparison beside the default.
    pub curve: Vec<CurvePoint>,
    /// The regime's gates, never empty; the first is the one quoted.
    pub gates: Vec<Gate>,
    /// What a reader must know: what was measured how, what was found, why a gate fails. May be empty.
    pub note: String,
}

impl Outcome {
    /// Whether every gate holds.
    #[must_use]
    pub fn pass(&self) -> bool {
        !self.gates.is_empty() && self.gates.iter().all(Gate::holds)
    }
}

/// Every regime that applies to what exists, by id.
#[must_use]
pub fn regimes() -> Vec<&'static Regime> {
    let groups: [&'static [Regime]; 13] = [
        borders::REGIMES,
        classification::REGIMES,
        coded::REGIMES,
        compositing::REGIMES,
        extremes::REGIMES,
        geometry::REGIMES,
        jitter::REGIMES,
        leaping::REGIMES,
        lod::REGIMES,
        reconstruction::REGIMES,
        segments::REGIMES,
        streaming::REGIMES,
        values::REGIMES,
    ];
    let mut all: Vec<&'static Regime> = groups.into_iter().flatten().collect();
    all.sort_by_key(|regime| regime.id);
    all
}

/// Regimes of the list that wait, and for what.
pub const WAITING: &[(&str, &str)] = &[
    ("S28", "an engine that sorts bricks"),
    ("S29", "shear-warp engine"),
    ("S30", "shear-warp engine"),
    ("S31", "slicing engine"),
];
