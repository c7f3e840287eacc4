//! Rounded means of float volumes. The error is at most half a step, level 0 is unchanged, and the manifest states the
//! step.

use supervol_format::level_reader::LevelReader;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Container, Lod, VoxelType};
use supervol_preprocess::downsample::{Reduce, VoxelBlock, downsample};
use supervol_preprocess::error::BuildError;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::manifest::steps_of;
use supervol_preprocess::verify::verify;
use supervol_preprocess::{BuildOptions, MaxError};
use supervol_tests::fields::{Content, Field, built, options};
use supervol_tests::forge::Forge;

const DIMS: [u64; 3] = [70, 45, 37];
const CACHE_BYTES: usize = 1 << 24;

fn measured() -> BuildOptions {
    BuildOptions { lod_axes: LodAxes::Auto, ..options(16) }
}

/// The stored bytes of a whole level.
fn level(container: &Container, lod: Lod) -> Vec<u8> {
    let dims = container.pyramid().level_at(lod).dims;
    let whole = dims.full_box();
    let mut bytes = vec![0; whole.voxels() * container.descriptor().voxel_type.bytes()];
    LevelReader::new(container, lod, CACHE_BYTES).read_box(whole, &mut bytes).expect("a built container is whole");
    bytes
}

/// Exact means of the next finer level.
fn means(container: &Container, lod: Lod) -> Vec<u8> {
    let finer = Lod(lod.0 - 1);
    let (own, before) = (container.pyramid().level_at(lod), container.pyramid().level_at(finer));
    let bytes = level(container, finer);
    let block = VoxelBlock { voxels: before.dims.full_box(), bytes: &bytes };
    let descriptor = container.descriptor();
    let (voxel_type, whole) = (descriptor.voxel_type, own.dims.full_box());
    let mut out = vec![0; whole.voxels() * voxel_type.bytes()];
    downsample(Reduce::Mean, voxel_type, descriptor.absence, own.factors, block, whole, &mut out);
    out
}

#[test]
fn means_are_within_half_a_step_and_voxels_stay_what_they_are() {
    for (content, voxel_type) in [
        (Content::Noise, VoxelType::F32),
        (Content::Smooth, VoxelType::F32),
        (Content::Holes, VoxelType::F32),
        (Content::Smooth, VoxelType::F64),
    ] {
        let field = Field::of(content, DIMS, voxel_type);
        let rounded = built(&field, &measured());
        let what = format!("{content:?} {voxel_type}");
        verify(&rounded.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("{what}: {e}"));
        let container = &rounded.container;
        let exact = built(&field, &options(16));
        assert!(level(container, Lod::FINEST) == level(&exact.container, Lod::FINEST), "{what}: level 0");
        let steps = steps_of(container.manifest(), voxel_type).expect("it was just written");
        assert_eq!(steps.len() + 1, container.pyramid().levels().len(), "{what}");
        let absence = container.descriptor().absence;
        for (i, &step) in steps.iter().enumerate() {
            assert!(step > 0.0, "{what}: level {} is not rounded", i + 1);
            let lod = Lod(i as u8 + 1);
            let [found, mean] = [level(container, lod), means(container, lod)].map(|b| voxels_as_f64(voxel_type, &b));
            let mut moved = 0;
            for (found, mean) in found.into_iter().zip(mean) {
                if absence.is_absent(mean) {
                    assert!(absence.is_absent(found), "{what}: a hole became {found}");
                    continue;
                }
                assert!((found - mean).abs() <= 0.5 * step, "{what} level {}: {mean} became {found}", i + 1);
                assert_eq!((found / step).fract(), 0.0, "{what}: {found} is no multiple of {step}");
                moved += usize::from(found != mean);
            }
            // Means of multiples of a step may be multiples of a shorter step.
            assert!(moved > 0 || i > 0, "{what}: nothing was rounded");
        }
        let bytes = |built: &Container| built.manifest().parameters.contains_key("coarse_steps");
        assert!(bytes(container) && !bytes(&exact.container), "{what}: who measures nothing rounds nothing");
    }
}

#[test]
fn whole_numbers_maxima_and_bounded_voxels_are_not_rounded_twice() {
    let floats = Field::of(Content::Smooth, DIMS, VoxelType::F32);
    let whole = Field::of(Content::Smooth, DIMS, VoxelType::U16);
    let bounded = BuildOptions { max_error: MaxError::Percent(0.1), ..measured() };
    let greatest = BuildOptions { reduce: Some(Reduce::Max), ..measured() };
    for (field, options) in [(&whole, measured()), (&floats, bounded), (&floats, greatest)] {
        let built = built(field, &options);
        assert_eq!(
            steps_of(built.container.manifest(), built.container.descriptor().voxel_type),
            Ok(Vec::new()),
            "{options:?}"
        );
        verify(&built.path, 1 << 28, &|_, _| ()).expect("it was just built");
    }
}

#[test]
fn a_manifest_that_says_another_step_is_found() {
    let rounded = built(&Field::of(Content::Smooth, DIMS, VoxelType::F32), &measured());
    let said = rounded.container.manifest().parameters["coarse_steps"].clone();
    let steps = steps_of(rounded.container.manifest(), VoxelType::F32).expect("it was just written");
    let halved = steps.iter().map(|step| (step / 2.0).to_string()).collect::<Vec<_>>().join("; ");
    for (text, rule) in [(halved.as_str(), "mean of the finer level"), ("3", "coarse_steps"), ("NaN", "coarse_steps")] {
        assert_ne!(text, said);
        let mut forge = Forge::new(std::fs::read(&rounded.path).expect("it was just built"));
        let mut manifest = forge.original.manifest().clone();
        manifest.parameters.insert("coarse_steps".into(), text.into());
        forge.set_manifest(&manifest);
        let path = rounded.folder.path().join("forged.svol");
        std::fs::write(&path, &forge.bytes).expect("room");
        match verify(&path, 1 << 28, &|_, _| ()) {
            Err(BuildError::Broken { rule: found, .. }) => assert!(found.contains(rule), "{text}: {found}"),
            other => panic!("{text}: {:?}", other.map(|_| ())),
        }
    }
}
