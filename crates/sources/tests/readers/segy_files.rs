//! The SEG-Y files of the shared data folder: each opens with the right grid and values, or is refused with the reason.
//!
//! The folder is `shared/data` beside the repository or further up, or the value of `SUPERVOL_DATA`. Without it these
//! tests print SKIPPED and pass.

#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test helpers fail by panicking, and say what they skip")]

use std::path::{Path, PathBuf};

use supervol_format::{Dims, VoxelType, voxel_type::voxels_as_f64};
use supervol_sources::formats::segy::{SegyOptions, SegySource};
use supervol_sources::{AccessOrder, Endian, SourceError, VolumeSource};

/// The folder `segy` of the data; `None`, with a printed line, if it is missing.
fn folder() -> Option<PathBuf> {
    let stated = std::env::var_os("SUPERVOL_DATA").map(PathBuf::from);
    let mut candidates =
        stated.into_iter().chain(Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared/data")));
    let found = candidates.find(|c| c.join("segy").is_dir());
    if found.is_none() {
        eprintln!("SKIPPED: no folder shared/data with the SEG-Y test files; set SUPERVOL_DATA to name one");
    }
    found.map(|c| c.join("segy"))
}

fn open(file: &Path) -> Result<SegySource, SourceError> {
    SegySource::open(file, &SegyOptions::default())
}

/// All voxels, x fastest.
fn values(source: &SegySource) -> Vec<f64> {
    let info = source.info();
    let mut out = vec![0; info.dims.bytes(info.voxel_type).unwrap() as usize];
    source.read_box(info.dims.full_box(), &mut out).unwrap();
    voxels_as_f64(info.voxel_type, &out)
}

/// Files that open; dims are crosslines x inlines x samples.
const OPENS: [(&str, [u64; 3], VoxelType); 29] = [
    ("real/f3_int16_be.sgy", [18, 23, 75], VoxelType::I16),
    ("real/f3_sparse_ibm_asciihdr.sgy", [26, 23, 36], VoxelType::F32),
    ("real/f3_2lines_ebcdic.sgy", [100, 2, 463], VoxelType::F32),
    ("real/penobscot_xl1155.sgy", [1, 601, 1501], VoxelType::F32),
    ("real/volve_migvel_depth_sub3d.sgy", [52, 18, 226], VoxelType::F32),
    ("odd/missing_traces_75x71x26.segy", [71, 75, 26], VoxelType::F32),
    ("odd/dead_traces_30x41x4.segy", [41, 30, 4], VoxelType::F32),
    ("f3-formats/Format1msb.sgy", [18, 23, 75], VoxelType::F32),
    ("f3-formats/Format2msb.sgy", [18, 23, 75], VoxelType::I32),
    ("f3-formats/Format3lsb.sgy", [18, 23, 75], VoxelType::I16),
    ("f3-formats/Format5lsb.sgy", [18, 23, 75], VoxelType::F32),
    ("f3-formats/Format6msb.sgy", [18, 23, 75], VoxelType::F64),
    ("f3-formats/Format8msb.sgy", [18, 23, 75], VoxelType::I8),
    ("f3-formats/Format10lsb.sgy", [18, 23, 75], VoxelType::U32),
    ("f3-formats/Format11msb.sgy", [18, 23, 75], VoxelType::U16),
    ("f3-formats/Format16msb.sgy", [18, 23, 75], VoxelType::U8),
    ("odd/small.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/small-lsb.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/normal-small.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/multi-text.sgy", [1, 1, 1], VoxelType::F32),
    ("odd/stanzas-known-count.sgy", [2, 3, 4], VoxelType::F32),
    ("odd/mapping-default.sgy", [2, 3, 4], VoxelType::F32),
    ("odd/delay-scalar.sgy", [1, 1, 251], VoxelType::F32),
    ("odd/rotated-small-rev2.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/trace-header-extension1.sgy", [2, 3, 4], VoxelType::F32),
    ("odd/interval-neg-bin-neg-trace.sgy", [1, 1, 1], VoxelType::F32),
    ("odd/small-irregular.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/small_negative_il_xl.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/small-ieee.sgy", [5, 5, 50], VoxelType::F32),
];

/// Further files that open.
const OPENS_TOO: [(&str, [u64; 3], VoxelType); 3] = [
    ("odd/small-duplicate-traceheaders.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/small-traceheader-samplerate.sgy", [5, 5, 50], VoxelType::F32),
    ("odd/minimal.segy", [1, 1, 100], VoxelType::F32),
];

/// Refused files, and words that the message must contain.
const REFUSED: [(&str, &[&str]); 8] = [
    ("f3-formats/Format4msb.sgy", &["format 4", "look like IEEE", "`format` 5"]),
    (
        "real/volve_arbitrary_line_2d.sgy",
        &["2D line", "225 traces", "`inline_byte` 9 `crossline_byte` 21", "one section"],
    ),
    ("odd/small-ps.sgy", &["pre-stack gather: 2 offsets"]),
    ("odd/small-ps-dec-il-inc-xl-off.sgy", &["pre-stack gather: 2 offsets"]),
    ("odd/small-ps-dec-off-inc-il-xl.sgy", &["pre-stack gather: 2 offsets"]),
    ("odd/1xN.sgy", &["pre-stack gather: 4 offsets"]),
    (
        "odd/shot-gather.sgy",
        &["2D line or shot gather", "byte 13 trace in record", "`inline_byte` A `crossline_byte` B"],
    ),
    ("odd/small-2d.sgy", &["2D line", "byte 181 CDP x"]),
];

#[test]
fn every_file_opens_or_is_refused_with_the_reason() {
    let Some(folder) = folder() else { return };
    for (file, dims, voxel_type) in OPENS.into_iter().chain(OPENS_TOO) {
        let source = open(&folder.join(file)).unwrap_or_else(|e| panic!("{e}"));
        let info = source.info();
        eprintln!("{file}: {} {}; {:?}", info.dims, info.voxel_type, info.notes);
        eprintln!("    {:?} {:?}", info.geometry.spacing, info.survey.as_ref().unwrap().corners);
        assert_eq!((info.dims, info.voxel_type), (Dims(dims), voxel_type), "{file}");
        assert_eq!(values(&source).len() as u64, dims.iter().product::<u64>(), "{file}");
    }
    for (file, words) in REFUSED {
        let Err(error) = open(&folder.join(file)) else { panic!("{file} was not refused") };
        let message = error.to_string();
        eprintln!("{message}");
        for word in words {
            assert!(message.contains(word), "{file}: no {word:?} in {message}");
        }
    }
    let message = open(&folder.join("odd/corrupt_binary.segy")).expect_err("refused").to_string();
    assert!(message.contains("samples per trace") && message.contains("0 in both"), "{message}");
    let listed = OPENS.len() + OPENS_TOO.len() + REFUSED.len() + 1;
    let present = ["real", "odd", "f3-formats"].map(|d| std::fs::read_dir(folder.join(d)).unwrap().count());
    assert_eq!(present.iter().sum::<usize>(), listed, "a file of the folder is not listed here");
}

#[test]
fn small_has_the_values_of_its_formula() {
    let Some(folder) = folder() else { return };
    for file in ["odd/small.sgy", "odd/small-lsb.sgy", "odd/small-ieee.sgy"] {
        let source = open(&folder.join(file)).unwrap();
        let survey = source.info().survey.clone().unwrap();
        assert_eq!((survey.inline.first, survey.crossline.first), (1, 20), "{file}");
        let values = values(&source);
        for z in 0..50 {
            for y in 0..5 {
                for x in 0..5 {
                    let expected = (1 + y) as f64 + (20 + x) as f64 / 100.0 + z as f64 / 1e5;
                    let found = values[(z * 5 + y) * 5 + x];
                    assert!((found - expected).abs() < 1e-6, "{file} ({x}, {y}, {z}): {found}, expected {expected}");
                }
            }
        }
    }
    let [big, little] = ["odd/small.sgy", "odd/small-lsb.sgy"].map(|f| values(&open(&folder.join(f)).unwrap()));
    assert_eq!(big, little);
}

#[test]
fn formats_of_f3_hold_equal_values() {
    let Some(folder) = folder() else { return };
    let read = |file: &str| values(&open(&folder.join("f3-formats").join(file)).unwrap());
    let reference = values(&open(&folder.join("real/f3_int16_be.sgy")).unwrap());
    for file in ["Format1msb.sgy", "Format2msb.sgy", "Format3lsb.sgy", "Format5lsb.sgy", "Format6msb.sgy"] {
        assert!(read(file) == reference, "{file} differs from the reference");
    }
    // The narrow and unsigned formats hold the same samples modulo 2^8, 2^16, 2^32.
    let wrapped = |wrap: fn(i64) -> f64| -> Vec<f64> { reference.iter().map(|&v| wrap(v as i64)).collect() };
    assert!(read("Format8msb.sgy") == wrapped(|v| f64::from(v as i8)));
    assert!(read("Format16msb.sgy") == wrapped(|v| f64::from(v as u8)));
    assert!(read("Format11msb.sgy") == wrapped(|v| f64::from(v as u16)));
    assert!(read("Format10lsb.sgy") == wrapped(|v| f64::from(v as u32)));
}

#[test]
fn format_4_can_be_overridden() {
    let Some(folder) = folder() else { return };
    let options = SegyOptions { format: Some(5), ..SegyOptions::default() };
    let source = SegySource::open(&folder.join("f3-formats/Format4msb.sgy"), &options).unwrap();
    assert!(values(&source) == values(&open(&folder.join("real/f3_int16_be.sgy")).unwrap()));
    assert!(source.info().notes.iter().any(|n| n.to_string().contains("sample format 4")), "{:?}", source.info().notes);
}

#[test]
fn a_wrong_format_code_is_noticed() {
    let Some(folder) = folder() else { return };
    let patched = |file: &str, code: u8, low: usize| {
        let mut bytes = std::fs::read(folder.join(file)).unwrap();
        bytes[low] = code;
        SegySource::from_bytes(Box::new(bytes), Path::new(file), &SegyOptions::default())
    };
    let ibm_as_ieee = patched("f3-formats/Format1msb.sgy", 5, 3225).expect_err("refused").to_string();
    assert!(ibm_as_ieee.contains("`format` 1"), "{ibm_as_ieee}");
    let ieee_as_ibm = patched("f3-formats/Format5lsb.sgy", 1, 3224).expect_err("refused").to_string();
    assert!(ieee_as_ibm.contains("`format` 5"), "{ieee_as_ibm}");
    for file in ["real/penobscot_xl1155.sgy", "real/f3_2lines_ebcdic.sgy", "real/f3_sparse_ibm_asciihdr.sgy"] {
        assert!(patched(file, 5, 3225).is_err(), "{file} as IEEE");
    }
    assert!(patched("real/volve_migvel_depth_sub3d.sgy", 1, 3225).is_err());
}

#[test]
fn missing_and_dead_traces_are_absent() {
    let Some(folder) = folder() else { return };
    let missing = open(&folder.join("odd/missing_traces_75x71x26.segy")).unwrap();
    assert_eq!(missing.info().survey.as_ref().unwrap().missing_traces, 387);
    assert_eq!(values(&missing).iter().filter(|v| v.is_nan()).count(), 387 * 26);
    let dead = open(&folder.join("odd/dead_traces_30x41x4.segy")).unwrap();
    let survey = dead.info().survey.as_ref().unwrap();
    assert_eq!((survey.dead_traces, survey.missing_traces), (656, 0));
    assert_eq!(values(&dead).iter().filter(|v| v.is_nan()).count(), 656 * 4);
    assert!((survey.first_sample - 1000.0).abs() < 1e-9);
    let irregular = open(&folder.join("odd/small-irregular.sgy")).unwrap();
    assert_eq!(irregular.info().survey.as_ref().unwrap().missing_traces, 1);
    assert_eq!(values(&irregular).iter().filter(|v| v.is_nan()).count(), 50);
}

#[test]
fn geometry_follows_the_headers() {
    let Some(folder) = folder() else { return };
    let info = |file: &str| open(&folder.join(file)).unwrap().info().clone();
    let close = |a: f64, b: f64| (a - b).abs() < 0.01 * b.abs();

    let penobscot = info("real/penobscot_xl1155.sgy");
    assert_eq!(penobscot.access_order, AccessOrder([0, 1, 2]));
    assert_eq!(penobscot.survey.as_ref().unwrap().inline.count, 601);
    assert!(close(penobscot.geometry.spacing[1], 12.5), "{:?}", penobscot.geometry);
    assert_eq!(penobscot.geometry.spacing[2], 4.0);

    let f3 = info("real/f3_sparse_ibm_asciihdr.sgy");
    assert_eq!(f3.access_order, AccessOrder([1, 0, 2]));
    let survey = f3.survey.as_ref().unwrap();
    assert_eq!((survey.inline.first, survey.inline.step, survey.inline.count), (200, 20, 23));
    assert_eq!((survey.crossline.first, survey.crossline.step, survey.crossline.count), (700, 20, 26));
    // Stated by the text header: 200/700 = (615761.82, 6076334.72).
    let corner = survey.corners.unwrap()[0];
    assert!((corner[0] - 615_761.8).abs() < 0.06 && (corner[1] - 6_076_334.7).abs() < 0.06, "{corner:?}");
    assert!(close(f3.geometry.spacing[0], 500.0) && close(f3.geometry.spacing[1], 500.0), "{:?}", f3.geometry);
    assert!(survey.text_header.contains("F3 Demo Start"));

    let delayed = info("odd/delay-scalar.sgy");
    assert!((delayed.geometry.origin[2] - 1000.0).abs() < 1e-9);
    let negative = info("odd/small_negative_il_xl.sgy").survey.unwrap();
    assert_eq!((negative.inline.first, negative.crossline.first), (-5, -24));
    let rate = info("odd/small-traceheader-samplerate.sgy");
    assert_eq!(rate.geometry.spacing[2], 4.0);
    assert!(rate.notes.iter().any(|n| n.to_string().contains("trace headers'")), "{:?}", rate.notes);
    let unknown = info("odd/interval-neg-bin-neg-trace.sgy");
    assert!(unknown.notes.iter().any(|n| n.to_string().contains("unknown")
        && n.to_string().contains("-2000")
        && n.to_string().contains("-25000")));
    assert_eq!(unknown.axes[2].name, "sample");
}

#[test]
fn options_change_what_is_read() {
    let Some(folder) = folder() else { return };
    let small = folder.join("odd/small.sgy");
    // Inline and crossline swapped: the transposed volume.
    let swapped = SegyOptions { inline_byte: 193, crossline_byte: 189, ..SegyOptions::default() };
    let (plain, swapped) = (values(&open(&small).unwrap()), values(&SegySource::open(&small, &swapped).unwrap()));
    let transposed = (0..1250).all(|i| plain[i] == swapped[(i / 25 * 5 + i % 5) * 5 + i / 5 % 5]);
    assert!(transposed);
    let wrong = SegyOptions { endian: Some(Endian::Little), ..SegyOptions::default() };
    let message = SegySource::open(&small, &wrong).expect_err("refused").to_string();
    assert!(message.contains("sample format (little endian, as asked)"), "{message}");
    for options in [
        SegyOptions { inline_byte: 0, ..SegyOptions::default() },
        SegyOptions { crossline_byte: 238, ..SegyOptions::default() },
        SegyOptions { crossline_byte: 189, ..SegyOptions::default() },
        SegyOptions { format: Some(99), ..SegyOptions::default() },
    ] {
        assert!(matches!(SegySource::open(&small, &options), Err(SourceError::Options(_))), "{options:?}");
    }
    // With the bytes that its refusal suggests, the 2D line reads as one section.
    let line = SegyOptions { inline_byte: 9, crossline_byte: 21, ..SegyOptions::default() };
    let section = SegySource::open(&folder.join("real/volve_arbitrary_line_2d.sgy"), &line).unwrap();
    assert_eq!(section.info().dims, Dims([225, 1, 850]));
}

/// F3: crosslines run east and inlines north; with depth downwards this grid is left-handed. Each corner voxel lies at
/// its place on the map, up to a rotation about the first one.
#[test]
fn surveys_are_not_mirrored() {
    let Some(folder) = folder() else { return };
    for file in ["real/f3_int16_be.sgy", "real/volve_migvel_depth_sub3d.sgy", "odd/missing_traces_75x71x26.segy"] {
        let source = open(&folder.join(file)).unwrap();
        let (info, geometry) = (source.info(), source.info().geometry);
        let corners = info.survey.as_ref().and_then(|s| s.corners).unwrap();
        let [x, y] = [1, 2].map(|c| [0, 1].map(|k| corners[c][k] - corners[0][k]));
        let turn = x[0] * y[1] - x[1] * y[0];
        // With x and y of the map and depth downwards, counter-clockwise is left-handed.
        assert_eq!(geometry.is_left_handed(), turn > 0.0, "{file}");
        let last = [0.0, info.dims.0[1] as f64 - 1.0, 0.0];
        let world = geometry.world_from_index().transform_point3(last.into());
        let clockwise = -turn / x[0].hypot(x[1]);
        assert!((world.y - clockwise).abs() < 0.01 * clockwise.abs(), "{file}: {world} and {clockwise}");
    }
    assert!(open(&folder.join("real/f3_int16_be.sgy")).unwrap().info().geometry.is_left_handed());
}
