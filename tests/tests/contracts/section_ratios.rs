//! Size of containers of sections (one voxel thick): at most 1.1 times the source, with all levels, the TOC and both
//! header pages.

use std::path::Path;

use supervol_format::VoxelType;
use supervol_format::random::mix;
use supervol_preprocess::BuildOptions;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::verify::verify;
use supervol_sources::formats::segy::{SegyOptions, SegySource};
use supervol_sources::{Survey, VolumeSource};
use supervol_tests::fields::{Field, built, options};
use supervol_tests::skipped;

/// Greatest size of a container as a share of its source's.
const MOST: f64 = 1.1;
const WIDTH: u64 = 1000;
const DEPTH: u64 = 750;

/// Usual build options: bricks of 64, measured halving of axes, the smallest codec.
fn usual() -> BuildOptions {
    BuildOptions { lod_axes: LodAxes::Auto, reduce: None, ..options(64) }
}

/// Noise of mean 0 and variance 1 that depends only on the position: sums of twelve uniform numbers.
fn noise([x, y, z]: [u64; 3]) -> f64 {
    let even = |i: u64| mix(i ^ mix(x ^ mix(y ^ mix(z)))) as f64 / u64::MAX as f64;
    (0..12).map(even).sum::<f64>() - 6.0
}

/// Reflections of dipping and bending layers, from -1 to 1.
fn layers([x, _, z]: [u64; 3]) -> f64 {
    let (x, z) = (x as f64, z as f64);
    let depth = z + 40.0 * (x / 170.0).sin() + 0.1 * x;
    let strength = 0.5 + 0.3 * (depth / 61.0).sin() + 0.2 * (depth / 23.0 + x / 300.0).cos();
    strength * (depth / 3.1).sin()
}

/// A section through these layers.
fn section(voxel_type: VoxelType, middle: f64, amplitude: f64, noise_rms: f64) -> Field {
    Field::new([WIDTH, 1, DEPTH], voxel_type, move |p| middle + amplitude * layers(p) + noise_rms * noise(p))
}

/// The same as a line of a survey, whose sample axis is halved last.
fn line(field: Field) -> Field {
    field.with_info(|info| info.survey = Some(Survey::plain([WIDTH, 1], 4.0)))
}

/// Builds and verifies a container; returns its size as a share of `source_bytes`.
fn share(source: &dyn VolumeSource, source_bytes: u64) -> f64 {
    let built = built(source, &usual());
    verify(&built.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("{e}"));
    built.report.container_bytes as f64 / source_bytes as f64
}

/// The last case is an exception. Its levels halve one axis each and have together as many means as level 0 has voxels.
/// The significant part of a mean is four of these eight bits (docs/decisions/029-what-levels-keep.md).
#[test]
fn sections_take_their_source_and_a_tenth() {
    let cases = [
        ("floats without noise", section(VoxelType::F32, 0.0, 4000.0, 0.0), MOST),
        ("floats", section(VoxelType::F32, 0.0, 4000.0, 200.0), MOST),
        ("line of floats", line(section(VoxelType::F32, 0.0, 4000.0, 200.0)), MOST),
        ("i16", section(VoxelType::I16, 0.0, 8000.0, 400.0), MOST),
        ("line of i16", line(section(VoxelType::I16, 0.0, 8000.0, 400.0)), MOST),
        ("u8", section(VoxelType::U8, 128.0, 60.0, 8.0), MOST),
        ("line of u8", line(section(VoxelType::U8, 128.0, 60.0, 8.0)), 1.36),
    ];
    for (name, field, most) in cases {
        let share = share(&field, field.bytes().len() as u64);
        assert!(share <= most, "{name}: the container takes {share:.3} of its source");
        assert!(share > 0.8, "{name}: {share:.3}, which is no test of anything");
    }
}

#[test]
fn a_line_of_volve_takes_its_file_and_a_tenth() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data/segy/real/volve_arbitrary_line_2d.sgy");
    let Ok(metadata) = file.metadata() else {
        return skipped("the data folder is not there: no line of Volve to build");
    };
    // Its traces have trace numbers, but no line numbers.
    let numbered = SegyOptions { inline_byte: 9, crossline_byte: 21, ..SegyOptions::default() };
    let source = SegySource::open(&file, &numbered).expect("it is one of the formats that are read");
    let share = share(&source, metadata.len());
    assert!(share <= MOST, "the container takes {share:.3} of its file");
}
