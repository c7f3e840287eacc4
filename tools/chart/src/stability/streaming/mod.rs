//! The regimes of streaming: memory that is too small, sources that fail, volumes that are too large, frames too fast.
//!
//! Nearly all run on [`crate::virtual_volume`], so that the container is as large as the regime asks and every byte is
//! accounted for. [`session`] keeps a streamer over several frames, as a viewer does; [`sources`] counts, delays and
//! damages what is read.

mod cache;
mod coordinates;
mod determinism;
mod device;
mod planner;
mod read_errors;
mod session;
mod sources;

use super::Regime;

/// S32 to S35, S39 to S42, S44.
pub const REGIMES: &[Regime] = &[
    cache::SMALL_CACHE,
    cache::STARVATION,
    planner::PLANNER_COST,
    planner::FLY_THROUGH,
    coordinates::HUGE_COORDINATES,
    determinism::EDITS_WHILE_LOADING,
    read_errors::READ_ERRORS,
    device::DEVICE_LOSS,
    determinism::DETERMINISM,
];

#[cfg(test)]
mod tests {
    use crate::stability::GateKind;
    use crate::{Context, Scale};

    /// Every regime here runs at the smallest size; what it found is the business of the suite's own tests.
    #[test]
    fn the_regimes_run() {
        let folder = tempfile::tempdir().expect("a temporary folder can be made");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        for regime in super::REGIMES {
            match (regime.run)(&context) {
                Ok(outcome) => {
                    assert!(!outcome.curve.is_empty() && !outcome.gates.is_empty(), "{}", regime.id);
                    assert!(outcome.gates.iter().all(|g| !g.value.is_nan()), "{}: {:?}", regime.id, outcome.gates);
                    let broken = outcome.gates.iter().filter(|g| g.kind == GateKind::Result && !g.holds());
                    assert_eq!(broken.collect::<Vec<_>>(), Vec::<&crate::stability::Gate>::new(), "{}", regime.id);
                }
                // Only a machine without a graphics device may leave one out.
                Err(error) => assert!(regime.id == "S42" && error.to_string().contains("no GPU"), "{error}"),
            }
        }
    }
}
