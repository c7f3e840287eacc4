//! The stability suite at its smallest sizes. Every gate that is not about speed holds, except those in
//! `known_issues.rs`. `supervol chart --stability -o DIR` runs the same code at full size and writes the report.

use supervol_measure::stability::regimes;
use supervol_tests::stability::{broken_gates, measured};

fn holds(id: &str) {
    if let Some(outcome) = measured(id) {
        let broken = broken_gates(&outcome);
        assert!(broken.is_empty(), "{id}: {broken:#?}\n{}", outcome.note);
    }
}

/// Every regime needs a test here or in `known_issues.rs`.
#[test]
fn every_regime_stands_here_or_among_the_known_issues() {
    let tests = [include_str!("stability.rs"), include_str!("known_issues.rs")].concat();
    for regime in regimes() {
        let name = format!("fn {}_", regime.id.to_lowercase());
        assert!(tests.contains(&name), "{}, {}, has no test", regime.id, regime.title);
    }
}

#[test]
fn s01_pre_versus_post_classification() {
    holds("S01");
}

#[test]
fn s02_self_attenuation() {
    holds("S02");
}

#[test]
fn s03_curved_segments() {
    holds("S03");
}

#[test]
fn s04_one_code_spikes() {
    holds("S04");
}

#[test]
fn s05_segment_lengths() {
    holds("S05");
}

#[test]
fn s06_opacity_correction() {
    holds("S06");
}

#[test]
fn s07_spacing() {
    holds("S07");
}

#[test]
fn s08_early_termination() {
    holds("S08");
}

#[test]
fn s09_accumulation() {
    holds("S09");
}

#[test]
fn s10_filters() {
    holds("S10");
}

#[test]
fn s11_byte_fractions() {
    holds("S11");
}

#[test]
fn s12_gradient_isotropy() {
    holds("S12");
}

#[test]
fn s13_gradients_at_borders() {
    holds("S13");
}

#[test]
fn s14_mixed_levels() {
    holds("S14");
}

#[test]
fn s16_averages_and_transfer_functions() {
    holds("S16");
}

#[test]
fn s17_amplitude_collapse() {
    holds("S17");
}

#[test]
fn s18_thin_features() {
    holds("S18");
}

#[test]
fn s19_wavelets_overshoot() {
    holds("S19");
}

#[test]
fn s20_bounds_of_quantised_voxels() {
    holds("S20");
}

#[test]
fn s21_leaping() {
    holds("S21");
}

#[test]
fn s22_proximity_clouds() {
    holds("S22");
}

#[test]
fn s23_windows_of_values() {
    holds("S23");
}

#[test]
fn s24_axis_parallel_rays() {
    holds("S24");
}

#[test]
fn s25_eye_inside() {
    holds("S25");
}

#[test]
fn s26_corner_rays() {
    holds("S26");
}

#[test]
fn s27_brick_sizes() {
    holds("S27");
}

#[test]
fn s32_small_caches() {
    holds("S32");
}

#[test]
fn s33_starvation() {
    holds("S33");
}

#[test]
fn s34_planner_cost() {
    holds("S34");
}

#[test]
fn s35_fly_through() {
    holds("S35");
}

#[test]
fn s36_affine_grids() {
    holds("S36");
}

#[test]
fn s37_degenerate_dims() {
    holds("S37");
}

#[test]
fn s38_holes() {
    holds("S38");
}

#[test]
fn s39_huge_coordinates() {
    holds("S39");
}

#[test]
fn s40_edits() {
    holds("S40");
}

#[test]
fn s41_read_errors() {
    holds("S41");
}

#[test]
fn s42_device_loss() {
    holds("S42");
}

#[test]
fn s44_determinism() {
    holds("S44");
}

#[test]
fn s45_colour_pipeline() {
    holds("S45");
}

#[test]
fn s46_run_lengths() {
    holds("S46");
}

#[test]
fn s47_extreme_numbers() {
    holds("S47");
}

#[test]
fn s48_long_run() {
    holds("S48");
}

#[test]
fn s49_noise() {
    holds("S49");
}

#[test]
fn s50_gradients() {
    holds("S50");
}

#[test]
fn s51_long_rays() {
    holds("S51");
}
