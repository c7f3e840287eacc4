//! One regime of the stability suite, at its smallest size.

use supervol_measure::stability::regime::{Gate, GateKind, Outcome};
use supervol_measure::stability::regimes;
use supervol_measure::{ChartError, Context, Scale};
use supervol_runtime::render::error::RenderError;

/// Measures a regime. Returns `None` and prints `SKIPPED` if this machine cannot.
///
/// # Panics
/// If there is no such regime, or if it fails although its requirements are met.
#[must_use]
pub fn measured(id: &str) -> Option<Outcome> {
    let regime = regimes().into_iter().find(|regime| regime.id == id).unwrap_or_else(|| panic!("no regime {id}"));
    let folder = tempfile::tempdir().expect("tests need a temporary folder");
    let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
    match (regime.run)(&context) {
        Ok(outcome) => {
            assert!(!outcome.curve.is_empty() && !outcome.gates.is_empty(), "{id} measures nothing");
            // A regime that keeps the greatest measurement would lose a NaN.
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

/// The gates of a regime that do not hold, in words. Gates of speed belong to benchmarks and are left out.
#[must_use]
pub fn broken_gates(outcome: &Outcome) -> Vec<String> {
    let broken = outcome.gates.iter().filter(|gate| gate.kind == GateKind::Result && !gate.holds());
    broken.map(|Gate { what, value, limit, side, .. }| format!("{what}: {value}, {side:?} {limit}")).collect()
}
