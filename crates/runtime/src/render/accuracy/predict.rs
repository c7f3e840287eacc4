//! Predicted error of a picture: an estimate that needs no ray to be cast again.
//!
//! Only the packet caster in mode `dvr` predicts it: each of its cells states an error, and its other errors are shares
//! of the requested error. The exact picture is that of one level, as in [`super::check`]. Each term says whether it is
//! a bound; the total is a bound if all terms are. A term that is no bound is an estimate from above:
//! - *cells*: error of the integration rule in each cell (the final cells, after refinement), times the transmittance
//!   in front, summed up along each ray. The ray with the greatest sum counts. Errors of both signs add up, so the sum
//!   is usually several times the true error. docs/bounds.md proves each cell's error, but for roundings that it does not name.
//! - *ray ends*: light behind the end of rays that end early. A bound, because no channel exceeds 1.
//! - *transfer function*: extinction and emission are fitted by quadratic pieces, within a share of the extinction. Proven but for
//!   roundings.
//! - *levels*: if levels are chosen automatically, the deviation of coarser levels, summed up brick by brick along each
//!   ray ([`crate::lod::deviation`]). The ray with the greatest sum counts. A bound.
//! - *rounding*: `f32` sums over the cells of a brick. No bound: values and positions are rounded, too.

use serde::Serialize;
use supervol_format::Lod;
use supervol_scene::image::GREY_LEVELS;

use crate::engines::totals::EngineErrors;
use crate::render::options::{LevelChoice, RenderOptions};

/// Error for one reason.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Term {
    /// Largest error of any channel of any pixel for this reason, grey levels of 255; null if unknown.
    pub grey_levels: Option<f64>,
    /// Whether it is a bound; otherwise it is an estimate.
    pub is_bound: bool,
}

/// Predicted error, `error_predicted` in the statistics; see the module.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ErrorPredicted {
    /// The level whose exact picture is meant; the finest if levels are chosen automatically.
    pub level: u8,
    /// Sum of the other terms.
    pub total: Term,
    /// Integration of cells.
    pub cells: Term,
    /// Rays that end inside the volume.
    pub ray_ends: Term,
    /// Fit of the transfer function's pieces.
    pub transfer_function: Term,
    /// Levels of detail.
    pub levels: Term,
    /// Rounding in `f32`.
    pub rounding: Term,
}

/// Facts of a picture that decide which errors it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CastFacts {
    /// Rays that ended early.
    pub rays_terminated_early: u64,
    /// Times a coarser brick stood in for a wanted one.
    pub fallbacks: u64,
    /// Whether every ray was finished with the bricks that it wanted.
    pub is_converged: bool,
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

/// The prediction for a frame with these statistics and errors of its engine; `level` is the level of the exact
/// picture.
#[must_use]
pub fn predict(errors: &EngineErrors, cast: &CastFacts, options: &RenderOptions, level: Lod) -> ErrorPredicted {
    let cells = Term::estimate(errors.cells);
    let ray_ends = Term::bound(if cast.rays_terminated_early > 0 { errors.ray_ends } else { 0.0 });
    let transfer_function = Term::estimate(errors.transfer_function);
    let rounding = Term::estimate(errors.rounding);
    let levels = levels(errors, cast, options);
    let total = Term::sum([cells, ray_ends, transfer_function, levels, rounding]);
    ErrorPredicted { level: level.0, total, cells, ray_ends, transfer_function, levels, rounding }
}

fn levels(errors: &EngineErrors, cast: &CastFacts, options: &RenderOptions) -> Term {
    match options.level {
        LevelChoice::Auto => Term::bound(errors.levels),
        // The difference between a level that stands in and the requested level is not summed up.
        LevelChoice::Fixed(_) if cast.fallbacks > 0 || !cast.is_converged => Term::UNKNOWN,
        LevelChoice::Fixed(_) => Term::bound(0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    const ERRORS: EngineErrors =
        EngineErrors { cells: 0.004, levels: 0.003, ray_ends: 0.001, transfer_function: 0.002, rounding: 1e-5 };

    const CAST: CastFacts = CastFacts { rays_terminated_early: 0, fallbacks: 0, is_converged: true };

    fn prediction(cast: &CastFacts, level: LevelChoice) -> ErrorPredicted {
        predict(&ERRORS, cast, &RenderOptions { level, max_error: 0.01, ..RenderOptions::default() }, Lod::FINEST)
    }

    #[test]
    fn the_total_is_the_sum_and_a_bound_only_if_all_terms_are() {
        let found = prediction(&CastFacts { rays_terminated_early: 3, ..CAST }, LevelChoice::Auto);
        let sum = 255.0 * (0.004 + 0.003 + 0.001 + 0.002 + 1e-5);
        assert!((found.total.grey_levels.unwrap() - sum).abs() < 1e-9 && !found.total.is_bound, "{found:?}");
        assert_eq!((found.ray_ends, found.levels), (Term::bound(0.001), Term::bound(0.003)));
        assert!(!found.cells.is_bound && !found.transfer_function.is_bound && !found.rounding.is_bound);
        assert!(Term::sum([Term::bound(1.0); 5]).is_bound);
        // Rays that reach the end of the volume leave nothing out.
        assert_eq!(prediction(&CAST, LevelChoice::Auto).ray_ends, Term::bound(0.0));
    }

    #[test]
    fn a_level_that_is_asked_for_is_what_the_picture_is_held_against() {
        let stood_in = CastFacts { fallbacks: 1, ..CAST };
        let late = CastFacts { is_converged: false, ..CAST };
        let fixed = LevelChoice::Fixed(Lod(1));
        assert_eq!(prediction(&CAST, fixed).levels, Term::bound(0.0));
        for cast in [&stood_in, &late] {
            // Against the finest level every drawn brick has a bound; against another level it has none.
            assert_eq!(prediction(cast, LevelChoice::Auto).levels, Term::bound(0.003));
            let found = prediction(cast, fixed);
            assert!(found.levels == Term::UNKNOWN && found.total == Term::UNKNOWN, "{found:?}");
        }
    }
}
