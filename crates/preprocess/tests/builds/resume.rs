//! A killed build continues and ends with the same bytes, whatever files its process left behind.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use supervol_files::unfinished::list_builds;
use supervol_format::container::manifest::Source;
use supervol_format::random::Random;
use supervol_format::{BrickLayout, Dims, Geometry, VoxelBox, VoxelType};
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::report::{BuildNote, BuildReport, Progress};
use supervol_preprocess::{BuildError, BuildOptions, Existing, MaxError, build, identify};
use supervol_sources::computed::Computed;
use supervol_sources::formats::raw::{RawOptions, RawSource};
use supervol_sources::{Endian, SourceError, SourceInfo, VolumeSource};

const OUTPUT: &str = "v.svol";

fn source(seed: u64) -> Computed {
    Computed::new([70, 50, 150], VoxelType::I16, move |[x, y, z]| {
        let hash = (x + 70 * y + 3500 * z + seed).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 52;
        // Noise in one half, one value in the other.
        if x < 40 { hash as f64 } else { 7.0 }
    })
}

/// A source with another description.
struct ReadAs {
    source: Computed,
    info: SourceInfo,
}

impl VolumeSource for ReadAs {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.source.read_box(voxels, out)
    }
}

fn options() -> BuildOptions {
    // So little memory that a level has many tiles.
    BuildOptions {
        layout: BrickLayout::new(16).expect("16 is a core"),
        memory_bytes: 2 << 20,
        threads: 2,
        existing: Existing::Keep,
        ..BuildOptions::default()
    }
}

/// A source entry with this checksum.
fn origin(xxh3_64: &str) -> Source {
    Source { name: "a".into(), format: "computed".into(), bytes: 0, xxh3_64: xxh3_64.into() }
}

fn run(folder: &Path, source: &dyn VolumeSource, on_progress: &(dyn Fn(Progress) + Sync)) -> BuildReport {
    build(source, origin("01"), &folder.join(OUTPUT), &options(), on_progress).unwrap_or_else(|e| panic!("{e}"))
}

/// Copies of a build's files at every progress report, each in its own folder.
fn moments(folder: &Path) -> Vec<PathBuf> {
    let building = folder.join("whole");
    std::fs::create_dir(&building).expect("room");
    let seen: Mutex<Vec<PathBuf>> = Mutex::default();
    run(&building, &source(1), &|progress| {
        let mut seen = seen.lock().expect("nobody panics");
        let moment = folder.join(format!("{:03}-{}", seen.len(), progress.bricks_done));
        std::fs::create_dir(&moment).expect("room");
        for leftover in list_builds(&building).expect("the folder is there") {
            std::fs::copy(&leftover.path, moment.join(leftover.path.file_name().expect("a name"))).expect("room");
        }
        seen.push(moment);
    });
    seen.into_inner().expect("nobody panics")
}

fn bytes(folder: &Path) -> Vec<u8> {
    std::fs::read(folder.join(OUTPUT)).expect("the build wrote it")
}

/// Number of bricks that a continued build took over.
fn restored(report: &BuildReport) -> u64 {
    let of_note = |note: &BuildNote| match note {
        BuildNote::Continued { bricks, .. } => Some(*bricks),
        _ => None,
    };
    report.notes.iter().find_map(of_note).unwrap_or(0)
}

#[test]
fn builds_go_on_from_every_moment_and_end_with_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let moments = moments(folder.path());
    let expected = bytes(&folder.path().join("whole"));
    assert!(moments.len() > 12, "{moments:?}");
    for moment in &moments {
        let done: u64 = moment.to_string_lossy().rsplit('-').next().and_then(|n| n.parse().ok()).expect("a number");
        let most = Mutex::new((u64::MAX, 0));
        let report = run(moment, &source(1), &|progress| {
            let mut most = most.lock().expect("nobody panics");
            *most = (most.0.min(progress.bricks_done), progress.bricks_done);
        });
        assert_eq!(restored(&report), done, "{moment:?}: what was told to be done is done");
        assert_eq!(most.into_inner().expect("nobody panics").1, report.bricks);
        assert!(bytes(moment) == expected, "{moment:?}: other bytes");
        assert_eq!(std::fs::read_dir(moment).expect("the folder is there").count(), 1, "{moment:?}");
    }
}

#[test]
fn what_is_torn_or_damaged_is_made_anew() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let moments = moments(folder.path());
    let expected = bytes(&folder.path().join("whole"));
    let mut numbers = Random::new(5);
    let mut random = move |n: usize| numbers.index(n);
    let (mut went_on, mut less) = (0, 0);
    for (i, moment) in moments.iter().enumerate() {
        let done: u64 = moment.to_string_lossy().rsplit('-').next().and_then(|n| n.parse().ok()).expect("a number");
        let mut files: Vec<PathBuf> =
            list_builds(moment).expect("the folder is there").into_iter().map(|l| l.path.clone()).collect();
        files.sort_by_key(|path| std::fs::metadata(path).expect("it is there").len());
        // Journal or container, truncated or with a wrong byte.
        let path = &files[i % 2];
        let mut content = std::fs::read(path).expect("it is there");
        let at = random(content.len());
        if i % 4 < 2 {
            content.truncate(at)
        } else {
            content[at] ^= 0x40
        }
        std::fs::write(path, &content).expect("room");
        let report = run(moment, &source(1), &|_| ());
        assert!(restored(&report) <= done && bytes(moment) == expected, "{moment:?}: {:?} at {at}", path.file_name());
        went_on += usize::from(restored(&report) > 0);
        less += usize::from(restored(&report) < done);
        assert_eq!(std::fs::read_dir(moment).expect("the folder is there").count(), 1, "{moment:?}");
    }
    assert!(went_on > 3 && less > 3, "{went_on} of {} went on, {less} with less", moments.len());
}

#[test]
fn another_build_begins_anew_and_removes_what_is_left() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let moments = moments(folder.path());
    let last = &moments[moments.len() - 1..];
    for moment in last.iter().chain(&moments[3..4]) {
        let path = moment.join("other.svol");
        let report = build(&source(2), origin("02"), &path, &options(), &|_| ()).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(restored(&report), 0);
        assert_eq!(std::fs::read_dir(moment).expect("the folder is there").count(), 1, "{moment:?}");
    }
    // Another memory limit gives other bytes.
    let moment = &moments[5];
    let larger = BuildOptions { memory_bytes: 3 << 20, ..options() };
    let report = build(&source(1), origin("01"), &moment.join(OUTPUT), &larger, &|_| ());
    assert_eq!(restored(&report.unwrap_or_else(|e| panic!("{e}"))), 0);
    // The same file with other reading options.
    let moment = &moments[7];
    let mut info = source(1).info().clone();
    info.reading = vec![("endian", "big".into())];
    let other = ReadAs { source: source(2), info };
    let report = build(&other, origin("01"), &moment.join(OUTPUT), &options(), &|_| ());
    assert_eq!(restored(&report.unwrap_or_else(|e| panic!("{e}"))), 0);
    // Without a checksum, the source may have changed.
    let moment = &moments[6];
    let report = build(&source(1), origin(""), &moment.join(OUTPUT), &options(), &|_| ());
    assert_eq!(restored(&report.unwrap_or_else(|e| panic!("{e}"))), 0);
    assert_eq!(std::fs::read_dir(moment).expect("the folder is there").count(), 1);
}

/// A raw file of many tiles.
fn file_source(path: &Path) -> RawSource {
    let options = RawOptions {
        dims: Dims([64, 64, 200]),
        voxel_type: VoxelType::U8,
        endian: Endian::Little,
        header_bytes: 0,
        geometry: Geometry::IDENTITY,
        nodata: None,
    };
    RawSource::open(path, &options).expect("as long as it says")
}

#[test]
fn the_checksum_of_a_file_is_taken_while_it_is_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("a.raw");
    let mut random = Random::new(7);
    std::fs::write(&path, (0..64 * 64 * 200).map(|_| random.below(20) as u8).collect::<Vec<u8>>()).expect("room");
    let name = |xxh3_64: &str| Source { format: "raw".into(), ..origin(xxh3_64) };
    let known = identify(&path, "raw").expect("it is there").xxh3_64;

    let built = |output: &str, checksum: &str| {
        let output = folder.path().join(output);
        build(&file_source(&path), name(checksum), &output, &options(), &|_| ()).unwrap_or_else(|e| panic!("{e}"));
        std::fs::read(output).expect("the build wrote it")
    };
    let expected = built("whole.svol", &known);
    assert!(built("along.svol", "") == expected, "the same checksum, taken at once or along the way");

    // A cancelled and continued build has the checksum of the whole file.
    let output = folder.path().join(OUTPUT);
    let stopping = options();
    let canceller = stopping.canceller.clone();
    let stop = |progress: Progress| {
        if progress.bricks_done > 100 {
            canceller.cancel();
        }
    };
    let error = build(&file_source(&path), name(""), &output, &stopping, &stop).expect_err("it was stopped");
    assert!(matches!(error, BuildError::Stopped { kept: Some(_) }), "{error}");
    let report = build(&file_source(&path), name(""), &output, &options(), &|_| ()).unwrap_or_else(|e| panic!("{e}"));
    assert!(restored(&report) > 0 && bytes(folder.path()) == expected);

    // The file is changed during reading, and its modification time set back.
    let modified = std::fs::metadata(&path).and_then(|m| m.modified()).expect("times");
    let overwrite = |progress: Progress| {
        if progress.bricks_done > 0 {
            let file = std::fs::File::options().write(true).open(&path).expect("it is ours");
            (&file).write_all(b"x").and_then(|()| file.set_modified(modified)).expect("room");
        }
    };
    let output = folder.path().join("changed.svol");
    let error = build(&file_source(&path), name(""), &output, &options(), &overwrite).expect_err("it was written to");
    assert!(matches!(error, BuildError::Source(SourceError::Changed { .. })), "{error}");
    assert!(!output.exists());
}

/// A source with one unreadable box.
struct Failing {
    source: Computed,
    fail_at: u64,
    boxes: AtomicU64,
}

impl VolumeSource for Failing {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        if self.boxes.fetch_add(1, Ordering::Relaxed) == self.fail_at {
            let source = std::io::Error::other("injected read failure");
            return Err(SourceError::Io { path: "injected.raw".into(), source });
        }
        self.source.read_box(voxels, out)
    }
}

/// Exact, and with moved voxels, whose step is determined again from the source and must be the same.
#[test]
fn reads_that_fail_cost_no_finished_brick() {
    for max_error in [MaxError::Exact, MaxError::Value(3.0), MaxError::Percent(0.5)] {
        let options = BuildOptions { max_error, ..options() };
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (whole, output) = (folder.path().join("whole.svol"), folder.path().join(OUTPUT));
        let never = Failing { source: source(1), fail_at: u64::MAX, boxes: AtomicU64::default() };
        build(&never, origin("01"), &whole, &options, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
        let expected = std::fs::read(&whole).expect("the build wrote it");
        let (mut kept, mut done) = (0, 0);
        for fail_at in 0..never.boxes.into_inner() {
            let failing = Failing { source: source(1), fail_at, boxes: AtomicU64::default() };
            let result = build(&failing, origin("01"), &output, &options, &|_| ());
            let Err(error) = result else {
                // The continued build had fewer reads than this.
                assert!(done > 0, "{max_error:?}: read {fail_at} did not fail");
                break;
            };
            assert!(error.is_machine_failure() && error.to_string().contains("injected read failure"), "{error}");
            let left = list_builds(folder.path()).expect("the folder is there").len();
            if let BuildError::Kept { kept: left, .. } = &error {
                assert!(left.iter().all(|file| file.exists() && error.to_string().contains(&*file.to_string_lossy())));
                kept += 1;
                done = 2;
            }
            // Failures before the first tile (samples, range) neither add to the kept files nor remove them.
            assert_eq!(left, done, "{max_error:?}, read {fail_at}: {error}");
        }
        assert!(kept > 1, "{max_error:?}: {kept} failures kept something");
        if !output.exists() {
            let report = build(&source(1), origin("01"), &output, &options, &|_| ()).unwrap_or_else(|e| panic!("{e}"));
            assert!(restored(&report) > 0, "{max_error:?}");
        }
        assert!(std::fs::read(&output).expect("the build wrote it") == expected, "{max_error:?}: other bytes");
        assert_eq!(std::fs::read_dir(folder.path()).expect("the folder is there").count(), 2, "{max_error:?}");
    }
}

/// Options with which a build reads nothing of the source before it examines the kept files.
fn decided() -> BuildOptions {
    BuildOptions { reduce: Some(Reduce::Mean), lod_axes: LodAxes::Xyz, ..options() }
}

#[test]
fn a_build_that_was_stopped_goes_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let run = |place: &Path, options: &BuildOptions, on_progress: &(dyn Fn(Progress) + Sync)| {
        std::fs::create_dir_all(place).expect("room");
        build(&source(1), origin("01"), &place.join(OUTPUT), options, on_progress)
    };
    let kept_of = |error: BuildError| {
        let BuildError::Stopped { kept: Some(kept) } = &error else { panic!("{error}") };
        assert!(error.is_stopped() && error.to_string().contains("goes on from there"), "{error}");
        kept.each_ref().map(|path| std::fs::read(path).expect("it is kept"))
    };
    let whole = folder.path().join("whole");
    let total = run(&whole, &decided(), &|_| ()).expect("it is built").bricks;
    let expected = bytes(&whole);
    for bricks in [1, total / 3, total - 1] {
        let place = folder.path().join(bricks.to_string());
        let options = decided();
        let stop = |progress: Progress| {
            if progress.bricks_done >= bricks {
                options.canceller.cancel();
            }
        };
        let kept = kept_of(run(&place, &options, &stop).expect_err("it was stopped"));
        assert!(!place.join(OUTPUT).exists(), "nothing half built has the name of a container");
        // Cancelled again while it examines the kept files, the build keeps all of them.
        let again = kept_of(run(&place, &options, &|_| ()).expect_err("it is stopped"));
        assert!(kept == again, "{bricks}: other bytes are kept");
        let report = run(&place, &decided(), &|_| ()).expect("it goes on");
        assert!(restored(&report) >= bricks, "{} of {bricks} bricks", restored(&report));
        assert!(bytes(&place) == expected, "other bytes after a stop at {bricks}");
        assert_eq!(std::fs::read_dir(&place).expect("the folder is there").count(), 1);
    }
}

/// Cancelled during the first read, a build leaves nothing; cancelled after its last brick, it is complete.
#[test]
fn stops_at_both_ends_leave_nothing_half_done() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let stopping = options();
    let canceller = stopping.canceller.clone();
    let source_that_stops = Computed::new([70, 50, 150], VoxelType::I16, move |_| {
        canceller.cancel();
        0.0
    });
    let output = folder.path().join(OUTPUT);
    let error = build(&source_that_stops, origin("01"), &output, &stopping, &|_| ()).expect_err("it was stopped");
    assert!(error.is_stopped() && error.to_string().contains("nothing is kept"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder is there").count(), 0);
    let late = options();
    let stop_at_end = |progress: Progress| {
        if progress.bricks_done == progress.bricks_total {
            late.canceller.cancel();
        }
    };
    build(&source(1), origin("01"), &output, &late, &stop_at_end).expect("all was done");
    assert!(output.exists());
}
