//! Comparison of a container with its source: equal, within the bound, or the first different voxel.

use std::path::Path;

use supervol_format::container::manifest::Source;
use supervol_format::{BrickLayout, Container, VoxelType};
use supervol_preprocess::compare::{Compared, compare};
use supervol_preprocess::{BuildError, BuildOptions, MaxError, build};
use supervol_sources::computed::Computed;

const DIMS: [u64; 3] = [45, 38, 51];

/// Noise, one brick of zeros with its apron, and a hole; the voxel `at` is changed by `off`.
fn source(voxel_type: VoxelType, at: [u64; 3], off: f64) -> Computed {
    Computed::new(DIMS, voxel_type, move |p| {
        let hash = (p[0] + 70 * p[1] + 3500 * p[2]).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 52;
        let value = match p {
            [0..20, 0..20, 0..20] => 0.0,
            [20, 20, 20..30] if voxel_type == VoxelType::F32 => f64::NAN,
            _ => hash as f64,
        };
        if p == at { value + off } else { value }
    })
}

fn built(folder: &Path, source: &Computed, max_error: MaxError) -> Container {
    let layout = BrickLayout::new(16).expect("16 is a core");
    let options = BuildOptions { layout, max_error, threads: 2, ..BuildOptions::default() };
    let path = folder.join("v.svol");
    build(source, Source::computed("noise"), &path, &options, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
    Container::open(&path).unwrap_or_else(|e| panic!("{e}"))
}

fn compared(container: &Container, source: &Computed) -> Result<Compared, BuildError> {
    compare(Path::new("v.svol"), container, source, 8 << 20, &|_, _| ())
}

fn said(container: &Container, source: &Computed) -> String {
    compared(container, source).expect_err("they differ").to_string()
}

#[test]
fn every_voxel_counts_where_nothing_may_be_lost() {
    for voxel_type in [VoxelType::U16, VoxelType::F32] {
        let folder = tempfile::tempdir().expect("a folder");
        let same = source(voxel_type, [0; 3], 0.0);
        let container = built(folder.path(), &same, MaxError::Exact);
        let found = compared(&container, &same).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(found, Compared { voxels: DIMS.iter().product(), greatest: 0.0, bound: 0.0 });
        // First and last voxels of bricks and of the volume, also in a brick of one value.
        for at in [[0, 0, 0], [15, 16, 31], [16, 0, 50], [44, 37, 50], [31, 32, 5]] {
            let message = said(&container, &source(voxel_type, at, 1.0));
            assert!(message.contains(&format!("voxel {at:?} against its source")), "{message}");
        }
    }
    // A hole instead of a voxel, and a voxel instead of a hole.
    let folder = tempfile::tempdir().expect("a folder");
    let container = built(folder.path(), &source(VoxelType::F32, [3, 30, 40], f64::NAN), MaxError::Exact);
    let message = said(&container, &source(VoxelType::F32, [0; 3], 0.0));
    assert!(message.contains("voxel [3, 30, 40]") && message.contains("found NaN"), "{message}");
}

#[test]
fn moved_voxels_are_within_the_bound_and_no_further() {
    for voxel_type in [VoxelType::U16, VoxelType::F32] {
        let folder = tempfile::tempdir().expect("a folder");
        let same = source(voxel_type, [0; 3], 0.0);
        let container = built(folder.path(), &same, MaxError::Value(5.0));
        let found = compared(&container, &same).unwrap_or_else(|e| panic!("{e}"));
        assert!(found.greatest > 2.0 && found.greatest <= found.bound && found.bound <= 5.0, "{found:?}");
        let at = [33, 20, 40];
        let message = said(&container, &source(voxel_type, at, 11.0));
        assert!(message.contains(&format!("voxel {at:?}")) && message.contains("off"), "{message}");
        // A brick of exact multiples of the step has the error 0: there even a change within the container's bound is
        // refused.
        let message = said(&container, &source(voxel_type, [5, 6, 7], 1.0));
        assert!(message.contains("voxel [5, 6, 7]") && message.contains("expected 1"), "{message}");
    }
}

#[test]
fn other_volumes_and_little_memory_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let same = source(VoxelType::U16, [0; 3], 0.0);
    let container = built(folder.path(), &same, MaxError::Exact);
    assert!(said(&container, &source(VoxelType::F32, [0; 3], 0.0)).contains("type of voxels"));
    let smaller = Computed::new([45, 38, 50], VoxelType::U16, |_| 0.0);
    assert!(said(&container, &smaller).contains("45 x 38 x 50"));
    let message = compare(Path::new("v.svol"), &container, &same, 10_000, &|_, _| ()).expect_err("10 kB").to_string();
    assert!(message.contains("`memory_bytes`"), "{message}");
}
