//! SEG-Y surveys in several files, unstacked files, and overridden headers.

use std::path::Path;

use supervol_format::{Dims, VoxelType};
use supervol_sources::formats::segy::{Offsets, SegyOptions};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

/// Bytes of the headers of `small.sgy` and of a trace, and number of traces of an inline.
const HEADERS: usize = 3600;
const TRACE: usize = 240 + 4 * 50;
const TRACES: usize = 5;

fn opened(path: &Path, change: impl FnOnce(&mut SegyOptions)) -> Result<Box<dyn VolumeSource>, SourceError> {
    let mut options = OpenOptions::default();
    change(&mut options.segy);
    open(path, &options)
}

/// Writes a file per inline; the alphabetical order of the names differs from the order of the inlines.
fn split(file: &[u8], folder: &Path) {
    let (headers, traces) = file.split_at(HEADERS);
    for (inline, traces) in traces.chunks(TRACES * TRACE).enumerate() {
        std::fs::write(folder.join(format!("line_{}.sgy", 8 + inline)), [headers, traces].concat()).unwrap();
    }
}

#[test]
fn a_folder_with_one_file_per_inline_is_one_survey() {
    let Some(path) = data_file("segy/odd/small.sgy") else { return };
    let whole = opened(&path, |_| ()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    split(&std::fs::read(&path).unwrap(), folder.path());
    let joined = opened(folder.path(), |_| ()).unwrap_or_else(|e| panic!("{e}"));
    check_boxes(joined.as_ref(), &read_all(whole.as_ref()).unwrap(), 1);
    let (one, many) = (whole.info(), joined.info());
    assert_eq!((one.geometry, &one.survey, &one.axes), (many.geometry, &many.survey, &many.axes));
    assert_eq!(many.files.len(), 5);
    assert!(many.notes.iter().any(|n| n.to_string() == "5 files are read as one survey"), "{:?}", many.notes);
    // A missing line is a hole. A duplicate line is not allowed.
    std::fs::remove_file(folder.path().join("line_10.sgy")).unwrap();
    let holes = opened(folder.path(), |_| ()).unwrap();
    assert_eq!(holes.info().survey.as_ref().unwrap().missing_traces, 5);
    std::fs::copy(folder.path().join("line_9.sgy"), folder.path().join("line_9b.sgy")).unwrap();
    assert_refused(opened(folder.path(), |_| ()).map(|_| ()), &["both stand at inline 2"]);
}

#[test]
fn files_of_one_survey_must_be_alike() {
    let Some(path) = data_file("segy/odd/small.sgy") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = std::fs::read(&path).unwrap();
    split(&file, folder.path());
    let other = data_file("segy/odd/1xN.sgy").unwrap();
    std::fs::copy(other, folder.path().join("line_99.sgy")).unwrap();
    assert_refused(
        opened(folder.path(), |_| ()).map(|_| ()),
        &["line_99.sgy", "50 samples", "as in line_8.sgy", "10 samples"],
    );
    std::fs::write(folder.path().join("line_99.sgy"), &file[..3000]).unwrap();
    assert_refused(opened(folder.path(), |_| ()).map(|_| ()), &["line_99.sgy", "3600 bytes"]);
    std::fs::write(folder.path().join("line_99.sgy"), &file[..HEADERS + TRACE + 7]).unwrap();
    assert_refused(opened(folder.path(), |_| ()).map(|_| ()), &["line_99.sgy"]);
}

/// segyio's value of a sample of `small-ps.sgy`: digits of the offset, inline and crossline of its trace, and its
/// number.
fn prestack(offset: f64, [x, y, z]: [u64; 3]) -> f64 {
    100.0 * offset + (y + 1) as f64 + 0.01 * (x + 1) as f64 + 1e-5 * z as f64
}

#[test]
fn one_offset_or_the_mean_of_all() {
    for name in ["small-ps", "small-ps-dec-il-inc-xl-off", "small-ps-dec-off-inc-il-xl"] {
        let Some(path) = data_file(&format!("segy/odd/{name}.sgy")) else { return };
        assert_refused(
            opened(&path, |_| ()).map(|_| ()),
            &["2 offsets (byte 37), 1 to 2", "`offsets` 1", "`offsets` stack"],
        );
        for (offsets, mean) in [(Offsets::One(1), 1.0), (Offsets::One(2), 2.0), (Offsets::Stack, 1.5)] {
            let source = opened(&path, |options| options.offsets = offsets).unwrap_or_else(|e| panic!("{e}"));
            assert_eq!((source.info().dims, source.info().voxel_type), (Dims([3, 4, 10]), VoxelType::F32), "{name}");
            for z in 0..10 {
                for at in [[0, 0, z], [2, 3, z], [1, 2, z]] {
                    let (found, expected) = (value_at(source.as_ref(), at), prestack(mean, at));
                    assert!((found - expected).abs() < 3e-5, "{name}, {offsets:?}, {at:?}: {found} is not {expected}");
                }
            }
            let notes = source.info().notes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ");
            let expected =
                if offsets == Offsets::Stack { "the mean of 2 offsets, 1 to 2" } else { "12 traces of other offsets" };
            assert!(notes.contains(expected), "{notes}");
        }
        // A selection without any trace is refused.
        let nothing = opened(&path, |options| options.offsets = Offsets::One(7)).map(|_| ());
        assert_refused(nothing, &["no trace has offset 7 (byte 37): they have 1 to 2", "`offset_byte`"]);
    }
}

#[test]
fn samples_and_interval_by_hand() {
    let Some(path) = data_file("segy/odd/small.sgy") else { return };
    let whole = opened(&path, |_| ()).unwrap();
    let mut file = std::fs::read(&path).unwrap();
    // Wrong sample count and interval.
    file[3220..3222].copy_from_slice(&17i16.to_be_bytes());
    file[3216..3218].copy_from_slice(&1i16.to_be_bytes());
    let folder = tempfile::tempdir().unwrap();
    let wrong = folder.path().join("wrong.sgy");
    std::fs::write(&wrong, file).unwrap();
    assert!(opened(&wrong, |_| ()).is_err());
    let source = opened(&wrong, |options| (options.samples, options.interval) = (Some(50), Some(2.5))).unwrap();
    check_boxes(source.as_ref(), &read_all(whole.as_ref()).unwrap(), 1);
    assert_eq!(source.info().geometry.spacing[2], 2.5);
    assert_eq!(source.info().survey.as_ref().unwrap().sample_interval, 2.5);
    assert!(
        source.info().notes.iter().any(|n| n.to_string().contains("interval was given by hand")),
        "{:?}",
        source.info().notes
    );
    assert_refused(opened(&path, |options| options.samples = Some(0)).map(|_| ()), &["`samples` 0"]);
    assert_refused(opened(&path, |options| options.interval = Some(f64::NAN)).map(|_| ()), &["`interval`"]);
}
