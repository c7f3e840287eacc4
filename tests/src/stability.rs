//! One regime of the stability suite, at its smallest size.

use supervol_measure::stability::{Gate, GateKind, Outcome, regimes};
use supervol_measure::{ChartError, Context, Scale};
use supervol_runtime::render::error::RenderError;

/// Measures a regime; `SKIPPED` is said, and nothing returned, where this machine cannot.
///
/// # Panics
/// If there is no such regime, or it cannot be measured although everything is there for it.
#[must_use]
pub fn measured(id: &str) -> Option<Outcome> {
    let regime = regimes().into_iter().find(|regime| regime.id == id).unwrap_or_else(|| panic!("no regime {id}"));
    let folder = tempfile::tempdir().expect("tests need a temporary folder");
    let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
    match (regime.run)(&context) {
        Ok(outcome) => {
            assert!(!outcome.curve.is_empty() && !outcome.gates.is_empty(), "{id} measures nothing");
            // Where a regime keeps the greatest of what it measured, NaN would be lost.
            let unknown = outcome.curve.iter().find(|point| point.measured.is_nan());
            assert!(unknown.is_none(), "{id}: no number was measured: {unknown:?}");
            Some(outcome)
        }
        Err(error @ (ChartError::Gpu(_) | ChartError::Render(RenderError::Engine(_)))) => {
            let is_required = std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!is_required, "{id}: {error}");
            crate::skipped(&format!("{id}: {error}"));
            None
        }
        Err(error) => panic!("{id}: {error}"),
    }
}

/// The gates of a regime that do not hold, in words; gates of speed are for benchmarks and are left out.
#[must_use]
pub fn broken_gates(outcome: &Outcome) -> Vec<String> {
    let broken = outcome.gates.iter().filter(|gate| gate.kind == GateKind::Result && !gate.holds());
    broken.map(|Gate { what, value, limit, side, .. }| format!("{what}: {value}, {side:?} {limit}")).collect()
}
