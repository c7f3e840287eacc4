//! Contents of `stability.json`: one object per regime, with the regime's data and its measurements.
//!
//! The field names are a contract: `id`, `title`, `curve` (of `x`, `measured`, `expected`, `series`), `gate`, `value`,
//! `pass`, `note`. New fields may be added. Numbers that are not finite are null. A regime that cannot be measured
//! counts as failed; its note holds the reason.

use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::context::{ChartError, Context};
use crate::stability::regime::{Gate, Outcome, Regime, Side};

/// One point of a curve.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedPoint {
    /// Position along the regime, from harmless to failing.
    pub x: Option<f64>,
    /// Measured value.
    pub measured: Option<f64>,
    /// Expected value, if it is known independently.
    pub expected: Option<f64>,
    /// Line of the plot: `default`, or the name of a method of comparison.
    pub series: String,
}

/// One gate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedGate {
    /// Meaning of the value, with its unit.
    pub what: String,
    /// Measured value.
    pub value: Option<f64>,
    /// Promised limit.
    pub limit: Option<f64>,
    /// `at_most` or `at_least`.
    pub side: String,
    /// Whether the gate holds.
    pub pass: bool,
}

/// One regime.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegimeRecord {
    /// `S01` to `S51`.
    pub id: String,
    /// The failure, in a few words.
    pub title: String,
    /// Procedure of the measurement.
    pub recipe: String,
    /// Meaning of x, with its unit.
    pub x_label: String,
    /// Measured quantity, with its unit.
    pub y_label: String,
    /// The curve into the failure.
    pub curve: Vec<RecordedPoint>,
    /// Limit of the first gate that fails; of the first gate if none fails.
    pub gate: Option<f64>,
    /// Value of the same gate.
    pub value: Option<f64>,
    /// Whether every gate holds.
    pub pass: bool,
    /// Remarks for the reader.
    pub note: String,
    /// All gates.
    pub gates: Vec<RecordedGate>,
    /// Duration of the measurement, seconds.
    pub wall_s: f64,
}

impl RegimeRecord {
    /// The record of a regime and of its result.
    #[must_use]
    pub fn new(regime: &Regime, result: &Result<Outcome, ChartError>, wall_s: f64) -> Self {
        let nothing = |note: String| Outcome { curve: Vec::new(), gates: Vec::new(), note };
        let outcome = match result {
            Ok(outcome) => outcome.clone(),
            Err(error) => nothing(format!("It could not be measured: {error}")),
        };
        let gates: Vec<RecordedGate> = outcome.gates.iter().map(recorded).collect();
        let quoted = gates.iter().find(|g| !g.pass).or(gates.first());
        let point = |p: &crate::stability::regime::CurvePoint| RecordedPoint {
            x: finite(p.x),
            measured: finite(p.measured),
            expected: p.expected.and_then(finite),
            series: p.series.clone(),
        };
        Self {
            id: regime.id.into(),
            title: regime.title.into(),
            recipe: regime.recipe.into(),
            x_label: regime.x_label.into(),
            y_label: regime.y_label.into(),
            curve: outcome.curve.iter().map(point).collect(),
            gate: quoted.and_then(|g| g.limit),
            value: quoted.and_then(|g| g.value),
            pass: outcome.pass(),
            note: outcome.note.clone(),
            gates,
            wall_s,
        }
    }
}

fn recorded(gate: &Gate) -> RecordedGate {
    RecordedGate {
        what: gate.what.clone(),
        value: finite(gate.value),
        limit: finite(gate.limit),
        side: match gate.side {
            Side::AtMost => "at_most".into(),
            Side::AtLeast => "at_least".into(),
        },
        pass: gate.holds(),
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}

/// Runs regimes one after the other. A regime that returns an error is recorded as failed.
#[must_use]
pub fn run(context: &Context<'_>, regimes: &[&Regime]) -> Vec<RegimeRecord> {
    let run_one = |regime: &&Regime| {
        (context.say)(&format!("{}: {}", regime.id, regime.title));
        let start = Instant::now();
        let result = (regime.run)(context);
        RegimeRecord::new(regime, &result, start.elapsed().as_secs_f64())
    };
    regimes.iter().map(run_one).collect()
}

/// The records as a JSON array, one record per line.
///
/// # Panics
/// Never: all fields are numbers, texts or truth values.
#[must_use]
pub fn to_json(records: &[RegimeRecord]) -> String {
    let line = |record| serde_json::to_string(record).expect("records hold nothing that JSON cannot");
    format!("[\n{}\n]\n", records.iter().map(line).collect::<Vec<_>>().join(",\n"))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::stability::regime::CurvePoint;

    pub(crate) const REGIME: Regime = Regime {
        id: "S99",
        title: "a fixture <of> the report",
        recipe: "Nothing is done.",
        x_label: "size, voxels",
        y_label: "error, share of full scale",
        run: |_| Err(ChartError::Broken("meant to fail".into())),
    };

    pub(crate) fn outcome() -> Outcome {
        let steps = [1.0, 2.0, 4.0, 8.0, 16.0];
        let default = steps.map(|x| CurvePoint::new("default", x, 1e-6 * x, Some(0.0)));
        let other = steps.map(|x| CurvePoint::new("midpoint samples", x, 1e-3 * x * x, None));
        Outcome {
            curve: default.into_iter().chain(other).collect(),
            gates: vec![
                Gate::at_most("largest error, share of full scale", 2e-5, 1e-4),
                Gate::at_least("order", f64::NAN, 2.0),
            ],
            note: "A note.".into(),
        }
    }

    #[test]
    fn json_has_the_promised_keys_and_quotes_the_gate_that_decides() {
        let record = RegimeRecord::new(&REGIME, &Ok(outcome()), 0.5);
        let text = to_json(std::slice::from_ref(&record));
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        for key in ["id", "title", "curve", "gate", "value", "pass", "note", "gates", "recipe", "x_label", "y_label"] {
            assert!(value[0].get(key).is_some(), "no {key}");
        }
        for key in ["x", "measured", "expected", "series"] {
            assert!(value[0]["curve"][0].get(key).is_some(), "no {key}");
        }
        assert_eq!((value[0]["gate"].as_f64(), value[0]["value"].as_f64()), (Some(2.0), None));
        assert!(value[0]["pass"] == false && value[0]["gates"][1]["value"].is_null(), "NaN holds no gate");
        let passing = Outcome { gates: outcome().gates[..1].to_vec(), ..outcome() };
        let passing = RegimeRecord::new(&REGIME, &Ok(passing), 0.5);
        assert_eq!((passing.gate, passing.value, passing.pass), (Some(1e-4), Some(2e-5), true));
        assert_eq!(serde_json::from_str::<Vec<RegimeRecord>>(&text).unwrap(), [record]);
    }

    #[test]
    fn a_regime_that_cannot_be_measured_has_failed_and_says_why() {
        let folder = tempfile::tempdir().unwrap();
        let context = Context { scale: crate::Scale::Small, folder: folder.path(), say: &|_| () };
        let records = run(&context, &[&REGIME]);
        assert!(!records[0].pass && records[0].gate.is_none() && records[0].note.contains("meant to fail"));
    }
}
