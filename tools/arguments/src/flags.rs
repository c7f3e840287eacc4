//! Messages of the libraries in the words of the command line.
//!
//! Libraries name their options, not flags. This module adds the flags. It distinguishes errors and notes by their
//! variants and never changes the text of a message.

use supervol_files::{OutputError, is_bound_to_place};
use supervol_format::readable::Mib;
use supervol_preprocess::BuildError;
use supervol_preprocess::error::{MemoryPurpose, kept_advice};
use supervol_preprocess::report::BuildNote;
use supervol_sources::SourceError;

use crate::source::{OPTIONS, flag};

/// Message of a failed build, check or export.
#[must_use]
pub fn message(error: &BuildError) -> String {
    match error {
        BuildError::Output(error) => output_message(error),
        BuildError::Source(error @ SourceError::Spool { source, .. }) if is_bound_to_place(source) => {
            format!("{} with -o", error.named(flag))
        }
        BuildError::Source(error) => error.named(flag),
        BuildError::Kept { error, kept, written_bytes, missing_bytes } => {
            format!("{}. {}", message(error), kept_advice(kept, *written_bytes, *missing_bytes))
        }
        BuildError::Outdated { path, what } => format!("{} is kept: {what}. --force builds it again", path.display()),
        BuildError::NoCacheFolder => {
            "no cache folder to build into: give one with --cache, or use `supervol build`".into()
        }
        BuildError::FolderInInput { .. } => format!("{error} with -o"),
        BuildError::Memory { needed_bytes, allowed_bytes, purpose } => {
            let (needed, allowed) = (Mib(*needed_bytes), Mib(*allowed_bytes));
            let bricks = match purpose {
                MemoryPurpose::Build { .. } => ", or use smaller bricks (--brick)",
                MemoryPurpose::Verify { .. } | MemoryPurpose::Other(_) => "",
            };
            format!(
                "{needed} of memory are needed ({purpose}), --memory allows {allowed}. Allow more with --memory{bricks}"
            )
        }
        BuildError::NoSurface { iso, .. } => format!("--iso {iso}: {error}"),
        BuildError::LargeSurface { path, vertices, triangles } => format!(
            "{}: expected a surface of less than 2^32 vertices and triangles, found {vertices} and {triangles}. Take a part with \
             --box, or a coarser --level",
            path.display()
        ),
        _ => error.to_string(),
    }
}

/// Message of an output file that was refused or could not be written.
#[must_use]
pub fn output_message(error: &OutputError) -> String {
    match error {
        OutputError::Write { source, .. } if is_bound_to_place(source) => format!("{error} with -o"),
        OutputError::Exists { path } => format!("{} exists; --force overwrites it", path.display()),
        OutputError::OtherKind { path, expected, found } => format!(
            "{} exists: expected {expected} to replace, found {found}. --force replaces it; or choose another name",
            path.display()
        ),
        _ => error.to_string(),
    }
}

/// Text of a note on a finished build.
#[must_use]
pub fn note(note: &BuildNote) -> String {
    match note {
        BuildNote::Labels => {
            "these are labels: coarser levels hold the most frequent one, not the mean (--reduce)".into()
        }
        BuildNote::Changed { error } => format!("voxels are within {error} of the source's (--max-error)"),
        BuildNote::LabelsUnchanged => "labels are kept as they are: --max-error is not applied".into(),
        BuildNote::Unchanged => "voxels cannot be moved by so little: --max-error is not applied".into(),
        BuildNote::FewerThreads { threads, requested } => {
            format!("--memory suffices for {threads} of {requested} threads")
        }
        BuildNote::Reader(note) => with_flags(note),
        BuildNote::Continued { .. } => note.to_string(),
    }
}

/// A note of a container with flags of the command line for the options that it names.
#[must_use]
pub fn with_flags(note: &str) -> String {
    let note = note.replace("the option `nodata` with the value ", "--nodata ");
    // Notes of containers that were built without names of options have their fields.
    OPTIONS.iter().fold(note, |note, option| note.replace(&format!("`{}`", option.field()), flag(*option)))
}

#[cfg(test)]
mod tests {
    use std::io::{Error, ErrorKind};
    use std::path::Path;

    use super::*;

    /// Flags of the command line, which library messages must not contain.
    const FLAGS: [&str; 8] = ["--force", "--memory", "--brick", "--cache", "--iso", "--box", "--level", " -o"];

    #[test]
    fn libraries_name_no_flags_and_the_command_line_names_them() {
        let path = Path::new("v.svol");
        let exists = || OutputError::Exists { path: path.into() };
        let full = || BuildError::write(path, Error::from(ErrorKind::StorageFull));
        let kept = |error| BuildError::Kept {
            error: Box::new(error),
            kept: [path.into(), path.into()],
            written_bytes: 1 << 20,
            missing_bytes: 3 << 20,
        };
        let memory = |purpose| BuildError::Memory { needed_bytes: 3 << 30, allowed_bytes: 1 << 30, purpose };
        let build = MemoryPurpose::Build { table_bytes: 1, bricks: 2, thread_bytes: 3 };
        let spool = SourceError::spool(path, Error::from(ErrorKind::QuotaExceeded));
        let errors: [(BuildError, &[&str]); 11] = [
            (exists().into(), &["--force"]),
            (full(), &["free space, or write to another one with -o"]),
            (kept(full()), &["another one with -o. What was written is kept, about 1 MiB", "3 MiB more"]),
            (kept(spool.into()), &["another one with -o. What was written"]),
            (BuildError::Outdated { path: path.into(), what: "it is old".into() }, &["it is old. --force"]),
            (BuildError::NoCacheFolder, &["--cache"]),
            (BuildError::FolderInInput { input: path.into(), folder: path.into() }, &["Choose another with -o"]),
            (memory(build), &["3072 MiB", "--memory allows 1024 MiB", "(--brick)", "2 bricks"]),
            (memory(MemoryPurpose::Other("to look")), &["(to look)", "Allow more with --memory"]),
            (
                BuildError::NoSurface { path: path.into(), iso: 7.5, range: None },
                &["--iso 7.5: no surface", "no values"],
            ),
            (
                BuildError::LargeSurface { path: path.into(), vertices: 5, triangles: 9 },
                &["--box", "--level", "5 and 9"],
            ),
        ];
        for (error, parts) in errors {
            let (library, command) = (error.to_string(), message(&error));
            assert!(!FLAGS.iter().any(|flag| library.contains(flag)), "{library}");
            assert!(parts.iter().all(|part| command.contains(part)), "{command}");
        }
    }
}
