//! Reductions: coarser levels of labels hold labels, those of `max` hold the greatest value. `verify` checks both, and
//! error bounds hold for both.

use supervol_format::{Lod, VoxelType};
use supervol_preprocess::BuildOptions;
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::report::BuildNote;
use supervol_preprocess::verify::verify;
use supervol_tests::fields::{Field, built, options};
use supervol_tests::forge::Forge;

const LABELS: [f64; 4] = [0.0, 3.0, 17.0, 200.0];

/// Regions of points that are nearest to one of four centres.
fn regions() -> Field {
    Field::new([70, 50, 40], VoxelType::U8, |[x, y, z]| {
        let to = |p: [i64; 3]| (x as i64 - p[0]).pow(2) + (y as i64 - p[1]).pow(2) + (z as i64 - p[2]).pow(2);
        let points = [[10, 10, 10], [50, 20, 30], [30, 40, 5], [60, 45, 35]];
        let nearest = (0..4).min_by_key(|&i| to(points[i])).unwrap_or(0);
        LABELS[nearest]
    })
}

#[test]
fn coarser_levels_of_labels_hold_labels() {
    let built = built(&regions(), &BuildOptions { reduce: None, ..options(16) });
    let container = verify(&built.path, 1 << 26, &|_, _| ()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(container.manifest().parameters["reduce"], "majority");
    assert!(built.report.notes.contains(&BuildNote::Labels), "{:?}", built.report.notes);
    for lod in 1..container.pyramid().levels().len() as u8 {
        for key in container.pyramid().keys_of(Lod(lod)) {
            let entry = container.entry(key).expect("it has been verified");
            let voxels = container.read_brick(key, &entry).expect("it has been verified");
            assert!(voxels.iter().all(|&v| LABELS.contains(&f64::from(v))), "{key}: another label");
        }
    }
}

#[test]
fn verify_holds_levels_against_what_the_manifest_says() {
    for (reduce, name) in [(Reduce::Mean, "mean"), (Reduce::Max, "max"), (Reduce::Majority, "majority")] {
        let built = built(&regions(), &BuildOptions { reduce: Some(reduce), ..options(16) });
        let container = verify(&built.path, 1 << 26, &|_, _| ()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(container.manifest().parameters["reduce"], name);
        let other = if reduce == Reduce::Max { "majority" } else { "max" };
        for (said, words) in
            [(other, format!("{other} of the finer level")), ("least", "one of mean, max, majority".into())]
        {
            let mut forge = Forge::new(std::fs::read(&built.path).expect("it was just built"));
            let mut manifest = forge.original.manifest().clone();
            manifest.parameters.insert("reduce".into(), said.into());
            forge.set_manifest(&manifest);
            let folder = tempfile::tempdir().expect("a temporary folder");
            let path = folder.path().join("forged.svol");
            std::fs::write(&path, &forge.bytes).expect("room");
            let error = verify(&path, 1 << 26, &|_, _| ()).expect_err("another reduction");
            assert!(error.to_string().contains(&words), "{name} as {said}: {error}");
        }
    }
}
