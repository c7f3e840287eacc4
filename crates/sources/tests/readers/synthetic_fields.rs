//! Synthetic volumes: boxes agree with each other, formulas hold, seeds matter, vessels are sparse.

use std::f64::consts::{FRAC_PI_2, TAU};

use supervol_format::random::Random;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Dims, VoxelBox, VoxelType};
use supervol_sources::VolumeSource;
use supervol_sources::synthetic::{NAMES, Synthetic};

use crate::grid_support;
use grid_support::{assert_refused, check_boxes, read_all, sub_box, value_at};

fn new(name: &str, dims: [u64; 3], voxel_type: VoxelType, seed: u64) -> Synthetic {
    Synthetic::new(name, Dims(dims), Some(voxel_type), seed).unwrap()
}

fn values(source: &Synthetic) -> Vec<f64> {
    voxels_as_f64(source.info().voxel_type, &read_all(source).unwrap())
}

#[test]
fn boxes_agree_with_the_whole() {
    for name in NAMES {
        for dims in [[70, 50, 90], [1, 1, 300], [300, 1, 1], [1, 1, 1], [2, 2, 2], [1300, 5, 40]] {
            for voxel_type in VoxelType::ALL {
                let source = new(name, dims, voxel_type, 3);
                check_boxes(&source, &read_all(&source).unwrap(), 79);
            }
        }
    }
}

/// Boxes agree with each other far inside a volume that no machine could hold, too.
#[test]
fn boxes_agree_in_huge_volumes() {
    for name in NAMES {
        for dims in [[1 << 16; 3], [8_000_000, 3, 8_000_000]] {
            let source = Synthetic::new(name, Dims(dims), None, 5).unwrap();
            let mut random = Random::new(83);
            for _ in 0..4 {
                let start = dims.map(|n| random.below(n.saturating_sub(80).max(1)));
                let whole = VoxelBox { start, end: [0, 1, 2].map(|a| (start[a] + 80).min(dims[a])) };
                let all = grid_support::read(&source, whole).unwrap();
                let extent = whole.extent().map(|n| n as u64);
                for _ in 0..4 {
                    let inside = sub_box(&mut random, extent);
                    let shift = |at: [u64; 3]| [0, 1, 2].map(|a| at[a] + start[a]);
                    let part = VoxelBox { start: shift(inside.start), end: shift(inside.end) };
                    let expected = grid_support::naive_box(&all, extent, 1, inside);
                    assert!(grid_support::read(&source, part).unwrap() == expected, "{name} {part:?}");
                }
            }
        }
    }
}

#[test]
fn marschner_lobb_is_its_formula() {
    let dims = [41, 37, 64];
    let exact = new("marschner-lobb", dims, VoxelType::F64, 0);
    let bytes = new("marschner-lobb", dims, VoxelType::U8, 0);
    let mut random = Random::new(89);
    for _ in 0..500 {
        let at = dims.map(|n| random.below(n));
        let [x, y, z] = [0, 1, 2].map(|a| 2.0 * at[a] as f64 / (dims[a] - 1) as f64 - 1.0);
        let ripple = |r: f64| (TAU * 6.0 * (FRAC_PI_2 * r).cos()).cos();
        let rho = (1.0 - (FRAC_PI_2 * z).sin() + 0.25 * (1.0 + ripple((x * x + y * y).sqrt()))) / (2.0 * 1.25);
        assert!((value_at(&exact, at) - rho).abs() < 1e-12, "{at:?}");
        assert!((value_at(&bytes, at) - 255.0 * rho).abs() <= 0.5 + 1e-9, "{at:?}");
    }
    let all = values(&exact);
    assert!(all.iter().all(|v| (0.0..=1.0).contains(v)));
}

#[test]
fn sphere_ramp_and_constant() {
    let sphere = new("sphere", [33, 33, 33], VoxelType::F64, 0);
    assert_eq!(value_at(&sphere, [16, 16, 16]), 1.0);
    assert_eq!(value_at(&sphere, [24, 16, 16]), 1.0 - 8.0 / 16.5);
    assert_eq!(value_at(&sphere, [0, 0, 0]), 0.0);
    for (voxel_type, x, expected) in [
        (VoxelType::F32, 999, 999.0),
        (VoxelType::U16, 999, 999.0),
        (VoxelType::U8, 999, 255.0),
        (VoxelType::I8, 0, 0.0),
        (VoxelType::I8, 999, 127.0),
    ] {
        assert_eq!(value_at(&new("ramp", [1000, 2, 2], voxel_type, 0), [x, 1, 1]), expected, "{voxel_type}");
    }
    assert_eq!(value_at(&new("ramp", [256, 1, 1], VoxelType::U8, 0), [255, 0, 0]), 255.0);
    assert!(VoxelType::ALL.iter().all(|t| values(&new("constant", [3, 4, 5], *t, 0)).iter().all(|v| *v == 100.0)));
}

#[test]
fn seismic_looks_like_a_survey() {
    let dims = [96, 80, 160];
    let source = new("seismic", dims, VoxelType::F32, 1);
    assert_eq!(source.info().geometry.spacing, [25.0, 25.0, 10.0]);
    assert_eq!(
        source.info().axes.clone().map(|a| (a.name, a.unit)),
        [("crossline".into(), "m".into()), ("inline".into(), "m".into()), ("depth".into(), "m".into())]
    );
    let all = values(&source);
    let count = all.len() as f64;
    let mean = all.iter().sum::<f64>() / count;
    let rms = (all.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
    assert!(all.iter().all(|v| v.abs() <= 30000.0));
    assert!(mean.abs() < 300.0 && (3000.0..12000.0).contains(&rms), "mean {mean}, rms {rms}");
    // Integer types hold the same field, rounded.
    for (voxel_type, gain, zero) in [
        (VoxelType::U8, 127.0, 128.0),
        (VoxelType::I8, 127.0, 0.0),
        (VoxelType::U16, 30000.0, 32768.0),
        (VoxelType::I16, 30000.0, 0.0),
        (VoxelType::U32, 30000.0, 32768.0),
        (VoxelType::I32, 30000.0, 0.0),
    ] {
        let stored = values(&new("seismic", dims, voxel_type, 1));
        let wrong = stored.iter().zip(&all).filter(|(s, f)| (*s - (*f / 30000.0 * gain + zero)).abs() > 0.51).count();
        assert_eq!(wrong, 0, "{voxel_type}");
    }
    let other = values(&new("seismic", dims, VoxelType::F32, 2));
    let equal = all.iter().zip(&other).filter(|(a, b)| a == b).count();
    assert!(equal < all.len() / 100, "{equal} of {} voxels are the same under another seed", all.len());
    // Neighbouring traces correlate, distant samples of a trace do not.
    let at = |x: u64, y: u64, z: u64| all[(x + dims[0] * (y + dims[1] * z)) as usize];
    let mut correlation = 0.0;
    for z in 0..dims[2] {
        correlation += at(40, 40, z) * at(41, 40, z);
    }
    assert!(correlation / dims[2] as f64 > 0.3 * rms * rms, "neighbouring traces do not resemble each other");
}

#[test]
fn vessels_are_sparse() {
    for dims in [[128, 128, 128], [64, 64, 64], [40, 200, 90], [300, 260, 1], [16, 16, 16]] {
        for seed in [0, 1, 7] {
            let all = read_all(&new("vessels", dims, VoxelType::U8, seed)).unwrap();
            let filled = all.iter().filter(|v| **v != 0).count();
            assert!(filled * 20 < all.len(), "{dims:?} seed {seed}: {filled} of {}", all.len());
        }
    }
    let all = read_all(&new("vessels", [128; 3], VoxelType::U8, 1)).unwrap();
    let filled = all.iter().filter(|v| **v != 0).count();
    let bright = all.iter().filter(|v| **v > 128).count();
    assert!(filled > 4000 && bright > 1000, "{filled} filled, {bright} bright");
    assert!(all != read_all(&new("vessels", [128; 3], VoxelType::U8, 2)).unwrap());
}

#[test]
fn wrong_options() {
    let open = |name: &str, dims| Synthetic::new(name, Dims(dims), None, 0);
    assert_refused(open("nothing", [8; 3]), &["nothing", "marschner-lobb", "constant"]);
    assert_refused(open("ramp", [8, 0, 8]), &["`dims`", "8 x 0 x 8"]);
    assert_refused(open("ramp", [1 << 23; 3]), &["2^64"]);
    assert_eq!(open("ramp", [8; 3]).unwrap().info().voxel_type, VoxelType::U8);
}

/// `cargo test --release -p supervol-sources --test readers synthetic_fields -- --ignored --nocapture`
#[test]
#[ignore = "measures, asserts nothing"]
#[allow(clippy::print_stderr, reason = "the numbers are its purpose")]
fn speed() {
    for name in NAMES {
        for voxel_type in [VoxelType::U8, VoxelType::I16, VoxelType::F32] {
            let started = std::time::Instant::now();
            let source = new(name, [2048; 3], voxel_type, 1);
            let made_ms = started.elapsed().as_secs_f64() * 1e3;
            for extent in [[2048, 2048, 16], [2048, 64, 64], [64, 64, 64]] {
                let start = [0, 960, 960];
                let voxels = VoxelBox { start, end: [0, 1, 2].map(|a| start[a] + extent[a]) };
                let mut out = vec![0; voxels.voxels() * voxel_type.bytes()];
                let voxels = VoxelBox { end: [extent[0], start[1] + extent[1], start[2] + extent[2]], ..voxels };
                let voxels =
                    if extent[1] == 2048 { VoxelBox { start: [0, 0, 960], end: [2048, 2048, 976] } } else { voxels };
                source.read_box(voxels, &mut out).unwrap();
                let (started, mut count) = (std::time::Instant::now(), 0);
                while started.elapsed().as_millis() < 300 {
                    source.read_box(voxels, &mut out).unwrap();
                    count += voxels.voxels();
                }
                let rate = count as f64 / started.elapsed().as_secs_f64() / 1e6;
                eprintln!("{name:15} {voxel_type:3} made in {made_ms:6.1} ms, boxes {extent:?}: {rate:7.0} Mvoxel/s");
            }
        }
    }
}
