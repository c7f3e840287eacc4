//! Lengths of the gradient: those of a ramp on a stretched grid, and of the neighbours of a hole.

use supervol_format::container::manifest::Source;
use supervol_format::{BrickLayout, Container, VoxelType};
use supervol_preprocess::gradients::Gradients;
use supervol_preprocess::{BuildOptions, build};
use supervol_sources::computed::Computed;

const DIMS: [u64; 3] = [30, 21, 18];
const SLOPES: [f64; 3] = [2.0, 3.0, -4.0];
const SPACING: [f64; 3] = [1.0, 2.0, 5.0];

fn gradients(hole: Option<[u64; 3]>) -> Gradients {
    let ramp = move |p: [u64; 3]| {
        if Some(p) == hole { f64::NAN } else { (0..3).map(|a| SLOPES[a] * p[a] as f64).sum() }
    };
    let source = Computed::new(DIMS, VoxelType::F32, ramp).with_info(|info| info.geometry.spacing = SPACING);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("v.svol");
    let options = BuildOptions { layout: BrickLayout::new(16).expect("a core"), threads: 2, ..BuildOptions::default() };
    build(&source, Source::computed("ramp"), &path, &options, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
    let container = Container::open(&path).unwrap_or_else(|e| panic!("{e}"));
    Gradients::of(&container, &|_, _| ()).unwrap_or_else(|e| panic!("{e}"))
}

/// Length of the gradient if these shares of the slopes remain: half of them at the ends of an axis.
fn length(shares: [f64; 3]) -> f64 {
    (0..3).map(|a| (shares[a] * SLOPES[a] / SPACING[a]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn a_ramp_has_one_length_but_for_its_ends() {
    let found = gradients(None);
    let [all, inside] = [DIMS, DIMS.map(|n| n - 2)].map(|dims| dims.iter().product::<u64>());
    assert_eq!((found.known, found.unknown), (all, 0));
    assert!((found.greatest - length([1.0; 3])).abs() < 1e-6, "{}", found.greatest);
    let resolved = found.greatest / 4096.0;
    assert!((found.percentile(50.0) - length([1.0; 3])).abs() <= resolved, "{}", found.percentile(50.0));
    let least = length([0.5; 3]);
    assert!((found.percentile(0.0) - least).abs() <= resolved, "{} instead of {least}", found.percentile(0.0));
    // At all ends the gradient is at least 3 % shorter.
    assert!(length([1.0, 1.0, 0.5]) < 0.97 * length([1.0; 3]));
    let (counts, beyond) = found.counts(10, 0.99 * length([1.0; 3]));
    assert_eq!((counts.iter().sum::<u64>(), beyond), (all - inside, inside));
}

#[test]
fn beside_a_hole_there_is_none() {
    let (whole, holed) = (gradients(None), gradients(Some([15, 10, 9])));
    assert_eq!((holed.known, holed.unknown), (whole.known - 7, 6));
}
