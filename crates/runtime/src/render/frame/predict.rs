//! How far a picture may be from the exact one, by what is known without casting a ray again.
//!
//! Only the packet caster in mode `dvr` knows: each of its cells states an error, and what else it leaves out is a share of
//! the error that it is aimed at. The exact picture is that of one level, as in [`super::check`]. Each term says whether it
//! is a bound; the total is one if all terms are. What is no bound is an estimate to the upper side:
//! - *cells*: what the rule of integration misses in each cell, refined cells as they are in the end, times the transmittance
//!   in front, summed up along each ray; the ray with the greatest sum. Errors of either sign add up there, so that the sum is
//!   usually several times the true error. It is no bound: that a cell's error is at most 1.5 times what it states is tested
//!   on random chords, not proven.
//! - *ray ends*: what lies behind the end of rays that end early: a bound, because no channel exceeds 1.
//! - *transfer function*: extinction and emission are piecewise quadratic within a share of the extinction; it is looked at in
//!   nine places between two control points, so that this is no bound.
//! - *levels*: with levels chosen automatically, what coarser levels do, summed up brick by brick along each ray
//!   ([`crate::lod::deviation`]); the ray with the greatest sum: a bound.
//! - *rounding*: `f32` sums over the cells of a brick. No bound: values and positions are rounded, too.

use serde::Serialize;
use supervol_format::Lod;
use supervol_scene::image::GREY_LEVELS;

use crate::engines::totals::EngineErrors;
use crate::render::options::{LevelChoice, RenderOptions};
use crate::render::stats::FrameStats;

/// One reason to be off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Term {
    /// Most that any channel of any pixel may be off by for this reason, grey levels of 255; null where nothing is known.
    pub grey_levels: Option<f64>,
    /// Whether it is never more; otherwise it is an estimate.
    pub is_bound: bool,
}

/// `error_predicted`: see the module.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorPredicted {
    /// The level of whose exact picture the distance is meant; the finest where levels are chosen automatically.
    pub level: u8,
    /// Sum of the others.
    pub total: Term,
    /// Integration of cells.
    pub cells: Term,
    /// Rays that end before they leave the volume.
    pub ray_ends: Term,
    /// Fit of the transfer function's pieces.
    pub transfer_function: Term,
    /// Levels of detail.
    pub levels: Term,
    /// `f32`.
    pub rounding: Term,
}

impl Term {
    fn bound(error: f64) -> Self {
        Self { grey_levels: Some(error * GREY_LEVELS), is_bound: true }
    }

    fn estimate(error: f64) -> Self {
        Self { grey_levels: Some(error * GREY_LEVELS), is_bound: false }
    }

    const UNKNOWN: Self = Self { grey_levels: None, is_bound: false };

    fn sum(terms: [Self; 5]) -> Self {
        let grey_levels = terms.iter().map(|term| term.grey_levels).sum();
        Self { grey_levels, is_bound: terms.iter().all(|term| term.is_bound) }
    }
}

/// The prediction for a frame with these statistics, from what its caster says; `level` is the one that it is held against.
#[must_use]
pub fn predict(errors: &EngineErrors, stats: &FrameStats, options: &RenderOptions, level: Lod) -> ErrorPredicted {
    let cells = Term::estimate(errors.cells);
    let ray_ends = Term::bound(if stats.casting.rays_terminated_early > 0 { errors.ray_ends } else { 0.0 });
    let transfer_function = Term::estimate(errors.transfer_function);
    let rounding = Term::estimate(errors.rounding);
    let levels = levels(errors, stats, options);
    let total = Term::sum([cells, ray_ends, transfer_function, levels, rounding]);
    ErrorPredicted { level: level.0, total, cells, ray_ends, transfer_function, levels, rounding }
}

fn levels(errors: &EngineErrors, stats: &FrameStats, options: &RenderOptions) -> Term {
    match options.level {
        LevelChoice::Auto => Term::bound(errors.levels),
        // Nobody sums up how far a level that stands in is from the one that was asked for.
        LevelChoice::Fixed(_) if stats.fallbacks > 0 || !stats.converged => Term::UNKNOWN,
        LevelChoice::Fixed(_) => Term::bound(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stream::counters::RayCounters;
    const ERRORS: EngineErrors =
        EngineErrors { cells: 0.004, levels: 0.003, ray_ends: 0.001, transfer_function: 0.002, rounding: 1e-5 };

    fn stats() -> FrameStats {
        FrameStats { converged: true, ..FrameStats::default() }
    }

    fn prediction(stats: &FrameStats, level: LevelChoice) -> ErrorPredicted {
        predict(&ERRORS, stats, &RenderOptions { level, max_error: 0.01, ..RenderOptions::default() }, Lod::FINEST)
    }

    #[test]
    fn the_total_is_the_sum_and_a_bound_only_if_all_terms_are() {
        let stats =
            FrameStats { casting: RayCounters { rays_terminated_early: 3, ..RayCounters::default() }, ..stats() };
        let found = prediction(&stats, LevelChoice::Auto);
        let sum = 255.0 * (0.004 + 0.003 + 0.001 + 0.002 + 1e-5);
        assert!((found.total.grey_levels.unwrap() - sum).abs() < 1e-9 && !found.total.is_bound, "{found:?}");
        assert_eq!((found.ray_ends, found.levels), (Term::bound(0.001), Term::bound(0.003)));
        assert!(!found.cells.is_bound && !found.transfer_function.is_bound && !found.rounding.is_bound);
        assert!(Term::sum([Term::bound(1.0); 5]).is_bound);
        // Rays that go on to the end leave nothing out.
        assert_eq!(prediction(&self::stats(), LevelChoice::Auto).ray_ends, Term::bound(0.0));
    }

    #[test]
    fn a_level_that_is_asked_for_is_what_the_picture_is_held_against() {
        let stood_in = FrameStats { fallbacks: 1, ..stats() };
        let late = FrameStats { converged: false, ..stats() };
        let fixed = LevelChoice::Fixed(Lod(1));
        assert_eq!(prediction(&stats(), fixed).levels, Term::bound(0.0));
        for stats in [&stood_in, &late] {
            // Against the finest level whatever is drawn is bounded, against another one it is not.
            assert_eq!(prediction(stats, LevelChoice::Auto).levels, Term::bound(0.003));
            let found = prediction(stats, fixed);
            assert!(found.levels == Term::UNKNOWN && found.total == Term::UNKNOWN, "{found:?}");
        }
    }
}
