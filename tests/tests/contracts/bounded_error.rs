//! Containers with quantised voxels (`build --max-error`): every voxel is within the error bound of the source's, and
//! every rule of the format holds.

use supervol_format::codec::quantize::Quantizer;
use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::voxel_type::{Absence, voxels_as_f64};
use supervol_format::{Container, Lod, VoxelType};
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::error::BuildError;
use supervol_preprocess::report::BuildNote;
use supervol_preprocess::verify::verify;
use supervol_preprocess::{BuildOptions, MaxError};
use supervol_sources::VolumeSource;
use supervol_tests::fields::{Built, Content, Field, built, options};
use supervol_tests::forge::Forge;

const DIMS: [u64; 3] = [41, 35, 27];

fn options_within(max_error: MaxError, codec: CodecChoice) -> BuildOptions {
    BuildOptions { max_error, codec, ..options(16) }
}

/// Stored voxels of all bricks of level 0, aprons included.
fn stored(container: &Container) -> Vec<Vec<f64>> {
    let read = |key| {
        let entry = container.entry(key).expect("a built container is whole");
        let voxels = container.read_brick(key, &entry).expect("a built container is whole");
        voxels_as_f64(container.descriptor().voxel_type, &voxels)
    };
    container.pyramid().keys_of(Lod::FINEST).map(read).collect()
}

/// Greatest distance of a present voxel from the exact one, in stored units. The same voxels must be absent.
fn farthest(exact: &Container, moved: &Container) -> f64 {
    let absence: Absence = exact.descriptor().absence;
    let mut farthest = 0.0f64;
    for (exact, moved) in stored(exact).concat().into_iter().zip(stored(moved).concat()) {
        if absence.is_absent(exact) {
            assert!(moved == exact || (moved.is_nan() && exact.is_nan()), "hole {exact} became {moved}");
        } else {
            assert!(!absence.is_absent(moved), "{exact} became a hole");
            farthest = farthest.max((moved - exact).abs());
        }
    }
    farthest
}

fn check(exact: &Built, moved: &Built, bound: f64, what: &str) {
    verify(&moved.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("{what}: {e}"));
    let descriptor = moved.container.descriptor();
    assert!(descriptor.quantizer.is_some() && exact.container.descriptor().quantizer.is_none(), "{what}");
    assert!(descriptor.voxel_error() <= bound, "{what}: {} of {bound}", descriptor.voxel_error());
    let farthest = farthest(&exact.container, &moved.container);
    assert!(farthest <= descriptor.voxel_error(), "{what}: {farthest} of {bound}");
    // The bricks' stated error is at most the bound, and equals the greatest error of a voxel.
    let entries = moved.container.pyramid().keys_of(Lod::FINEST).map(|key| moved.container.entry(key).expect("whole"));
    let said = entries.map(|entry| entry.error).fold(0.0, f64::max);
    assert_eq!(said, farthest, "{what}");
}

#[test]
fn voxels_of_every_type_are_within_the_bound() {
    for content in [Content::Noise, Content::Smooth, Content::Shells, Content::Holes] {
        for voxel_type in VoxelType::ALL {
            let field = Field::of(content, DIMS, voxel_type);
            let exact = built(&field, &options(16));
            let range = exact.container.manifest().value_range.expect("there are voxels");
            for (max_error, bound) in
                [(MaxError::Value(3.7), 3.7), (MaxError::Percent(2.0), 0.02 * (range.max - range.min))]
            {
                for codec in [CodecChoice::Smallest, CodecChoice::Only(Codec::Wavelet), CodecChoice::Only(Codec::Zstd)]
                {
                    let moved = built(&field, &options_within(max_error, codec));
                    if moved.container.descriptor().quantizer.is_none() {
                        assert!(bound < 1.0 && !voxel_type.is_float(), "{content:?} {voxel_type} {max_error:?}");
                        continue;
                    }
                    check(&exact, &moved, bound, &format!("{content:?} {voxel_type} {max_error:?} {codec:?}"));
                }
            }
        }
    }
}

#[test]
fn wavelets_are_what_bounded_floats_are_made_of_and_smaller() {
    let field = Field::of(Content::Smooth, [64; 3], VoxelType::F32);
    let sizes = [MaxError::Exact, MaxError::Percent(0.01), MaxError::Percent(1.0)].map(|max_error| {
        let built = built(&field, &BuildOptions { max_error, ..options(64) });
        let wavelets: u64 = built.report.levels.iter().map(|level| level.wavelet_bricks).sum();
        assert_eq!(wavelets > 0, max_error != MaxError::Exact, "{max_error:?}");
        built.report.levels.iter().map(|level| level.bytes).sum::<u64>()
    });
    assert!(sizes[1] * 2 < sizes[0] && sizes[2] * 2 < sizes[1], "{sizes:?}");
}

#[test]
fn the_bytes_are_the_same_with_any_number_of_threads() {
    let field = Field::of(Content::Holes, [150, 90, 110], VoxelType::F32);
    let bytes = |threads: usize| {
        let options = BuildOptions { threads, ..options_within(MaxError::Percent(0.5), CodecChoice::Smallest) };
        std::fs::read(built(&field, &options).path).expect("it was just built")
    };
    assert!(bytes(1) == bytes(4));
}

#[test]
fn labels_are_never_moved() {
    let labels = Field::new(DIMS, VoxelType::U8, |p| ((p[0] / 9 + p[1] / 11 + p[2] / 13) % 5) as f64);
    let exact = built(&labels as &dyn VolumeSource, &BuildOptions { reduce: None, ..options(16) });
    let bounded = BuildOptions { reduce: None, max_error: MaxError::Value(2.0), ..options(16) };
    let same = built(&labels as &dyn VolumeSource, &bounded);
    assert!(same.container.descriptor().quantizer.is_none() && same.report.notes.contains(&BuildNote::LabelsUnchanged));
    assert_eq!(farthest(&exact.container, &same.container), 0.0);
    // If the user declares that values are measurements, they may be quantised.
    let measured = BuildOptions { reduce: Some(Reduce::Mean), ..bounded };
    assert!(built(&labels as &dyn VolumeSource, &measured).container.descriptor().quantizer.is_some());
}

#[test]
fn a_voxel_that_is_no_multiple_is_found() {
    let field = Field::of(Content::Noise, [20; 3], VoxelType::U8);
    let moved = built(&field, &options_within(MaxError::Value(4.0), CodecChoice::Only(Codec::Raw)));
    let quantizer = moved.container.descriptor().quantizer.expect("voxels were moved");
    assert_eq!(Quantizer::within(VoxelType::U8, 4.0), Some(quantizer));
    let key = moved.container.pyramid().keys_of(Lod::FINEST).next().expect("there is a brick");
    let mut forge = Forge::new(std::fs::read(&moved.path).expect("it was just built"));
    let entry = moved.container.entry(key).expect("whole");
    let mut voxels = moved.container.read_brick(key, &entry).expect("whole");
    voxels.iter_mut().for_each(|v| *v += 1);
    forge.set_voxels(key, &voxels);
    std::fs::write(&moved.path, &forge.bytes).expect("room");
    match verify(&moved.path, 1 << 28, &|_, _| ()) {
        Err(BuildError::Broken { rule, .. }) => assert!(rule.contains("voxels") || rule.contains("apron"), "{rule}"),
        other => panic!("{:?}", other.map(|_| ())),
    }
}
