//! The stability suite: every regime in which a method breaks, with a recipe, a curve into the failure, and a gate.
//!
//! A [`Regime`] is one row of the list of regimes (S01 to S51). The report runs them at `Scale::Full`. The tests run
//! the same code at `Scale::Small`, with fewer and smaller cases. A gate is a number that the project promises; it is
//! never loosened to pass. A failing regime is reported as failing and listed in `tests/tests/drawn/known_issues.rs`.

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
pub mod regime;
pub mod segments;
mod stated;
pub mod streaming;
mod values;
mod views;

use self::regime::Regime;

/// All implemented regimes, by id.
#[must_use]
pub fn regimes() -> Vec<&'static Regime> {
    let groups: [&'static [Regime]; 14] = [
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
        stated::REGIMES,
        streaming::REGIMES,
        values::REGIMES,
    ];
    let mut all: Vec<&'static Regime> = groups.into_iter().flatten().collect();
    all.sort_by_key(|regime| regime.id);
    all
}

/// Regimes that are not implemented yet, and the missing parts.
pub const WAITING: &[(&str, &str)] = &[
    ("S28", "an engine that sorts bricks"),
    ("S29", "shear-warp engine"),
    ("S30", "shear-warp engine"),
    ("S31", "slicing engine"),
];
