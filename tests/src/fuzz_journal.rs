//! Fuzz body for the files of a killed build ([`supervol_preprocess::journal`]): the same build continues from damaged
//! files.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use supervol_format::VoxelType;
use supervol_format::container::manifest::Source;
use supervol_preprocess::journal::{CHECKSUM_BYTES, NAME_AT, frame_bytes};
use supervol_preprocess::report::{BuildNote, BuildReport, Progress};
use supervol_preprocess::{BuildError, BuildOptions, build};

use crate::fields::{Content, Field, options, origin};
use crate::forge::reseal;
use crate::fuzz_bodies::{in_a_file, whole_file};

const DIMS: [u64; 3] = [70, 20, 3];
/// The least memory of this build, so that it has several tiles and its journal several frames.
const MEMORY_BYTES: u64 = 2 << 20;

/// Files of a build that was stopped before its last brick, and the container of the complete build.
struct Interrupted {
    container: (String, Vec<u8>),
    journal: (String, Vec<u8>),
    whole: Vec<u8>,
}

/// Continues a build from a damaged journal, or (third bit of the mode) from a damaged unfinished container. The second
/// bit requests corrected checksums of the journal. Without corrected checksums, the result must equal that of an
/// uninterrupted build.
///
/// # Panics
/// If the result differs, or the build fails.
pub fn journal(data: &[u8]) {
    let Some(&mode) = data.first() else { return };
    let seed = interrupted();
    let is_container = mode & 4 != 0;
    let (mut container, mut journal) = (seed.container.1.clone(), seed.journal.1.clone());
    let damaged = if is_container { &mut container } else { &mut journal };
    *damaged = whole_file(data, damaged);
    let is_mended = mode & 2 != 0 && !is_container;
    if is_mended {
        mend(&mut journal);
    }
    in_a_file(&seed.journal.0, &journal, |path, _| {
        fs::write(path.with_file_name(&seed.container.0), container).expect("room for a small file");
        let output = path.with_file_name("fuzz.svol");
        match run(&output, &small_options(), &|_| ()) {
            Ok(_) if is_mended => (),
            Ok(_) => {
                let bytes = fs::read(&output).expect("it was just built");
                assert!(bytes == seed.whole, "what was left made another container");
            }
            Err(error) => assert!(is_mended, "{error}"),
        }
    });
}

/// Inputs: both files unchanged, and with an empty list of edits.
pub(crate) fn journal_inputs() -> Vec<Vec<u8>> {
    let seed = interrupted();
    let files = [(0, &seed.journal.1), (4, &seed.container.1)];
    let whole = files.map(|(mode, bytes)| [&[mode], &bytes[..]].concat());
    whole.into_iter().chain([1, 3, 5].map(|mode| vec![mode])).collect()
}

fn small_options() -> BuildOptions {
    BuildOptions { memory_bytes: MEMORY_BYTES, threads: 1, ..options(16) }
}

fn run(
    output: &Path,
    options: &BuildOptions,
    on_progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuildReport, BuildError> {
    let field = Field::of(Content::Smooth, DIMS, VoxelType::U8);
    // A build continues only if the checksum of its source is known.
    build(&field, Source { xxh3_64: "01".into(), ..origin() }, output, options, on_progress)
}

fn interrupted() -> &'static Interrupted {
    static SEED: OnceLock<Interrupted> = OnceLock::new();
    SEED.get_or_init(|| {
        let folder = tempfile::tempdir().expect("fuzzing needs a temporary folder");
        let output = folder.path().join("fuzz.svol");
        let options = small_options();
        let stop = |progress: Progress| {
            if progress.bricks_done + 1 == progress.bricks_total {
                options.canceller.cancel();
            }
        };
        let kept = match run(&output, &options, &stop) {
            Err(BuildError::Stopped { kept: Some(kept) }) => kept,
            other => panic!("a build that is stopped before its last brick keeps the others: {other:?}"),
        };
        let [container, journal] = kept.map(read);
        assert!(frames_of(&journal.1).len() > 3, "frames: {:?}", frames_of(&journal.1));
        let report = run(&output, &small_options(), &|_| ()).expect("it goes on");
        assert!(report.notes.iter().any(|note| matches!(note, BuildNote::Continued { .. })), "{:?}", report.notes);
        Interrupted { container, journal, whole: read(output).1 }
    })
}

/// Name and bytes of a file.
fn read(path: PathBuf) -> (String, Vec<u8>) {
    let name = path.file_name().expect("a file has a name").to_string_lossy().into_owned();
    (name, fs::read(path).expect("it was just written"))
}

/// Corrects the checksums of all parts of a journal.
fn mend(journal: &mut [u8]) {
    for part in frames_of(journal) {
        reseal(&mut journal[part]);
    }
}

/// Byte ranges of a journal's head and of its complete frames.
fn frames_of(journal: &[u8]) -> Vec<std::ops::Range<usize>> {
    let number = |at: usize, bytes: usize| {
        let bytes = journal.get(at..at + bytes)?;
        Some(bytes.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte)))
    };
    let mut parts = Vec::new();
    let mut part_bytes = number(NAME_AT - 2, 2).map(|name| NAME_AT + name + CHECKSUM_BYTES);
    let mut at = 0;
    while let Some(end) = part_bytes.map(|bytes| at + bytes).filter(|end| *end <= journal.len()) {
        parts.push(at..end);
        at = end;
        // The number follows the level.
        part_bytes = number(at + 4, 4).map(frame_bytes);
    }
    parts
}
