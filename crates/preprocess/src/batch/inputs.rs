//! Volumes of a batch, from a list or from a folder.
//!
//! A folder is searched with all its subfolders, in natural order. Each of these is one input:
//! - a Zarr or N5;
//! - a folder with DICOM slices;
//! - a folder with nothing but pictures (PNG, JPEG);
//! - any other file whose first bytes or name a reader knows. If the options of headerless files are given, only files
//!   with the ending `.raw` are inputs.
//!
//! Data files and N5 folders that a `BigDataViewer` file names are not inputs of their own. Names that begin with a dot
//! are skipped, and so are links: a target inside the folder is found by itself.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use supervol_sources::SourceError;
use supervol_sources::formats::bigdataviewer::data_of;
use supervol_sources::input::folder::natural;
use supervol_sources::open::{Found, is_chunked, look_at};

use crate::error::BuildError;

/// Largest depth of subfolders that are searched.
const DEPTH_LIMIT: usize = 64;
/// Largest number of volumes of a batch.
pub const INPUTS_LIMIT: usize = 1_000_000;
/// Ending of the names of headerless files.
const RAW_ENDING: &str = "raw";
/// Endings of a pair of files (data, header). The header is the input.
const PAIRS: [(&str, &str); 2] = [("img", "hdr"), ("img.gz", "hdr.gz")];

/// Volumes of a batch, and a count of the other files.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Inputs {
    /// Files and folders that are one volume each, in build order, without duplicates.
    pub paths: Vec<PathBuf>,
    /// Number of files and links that are not volumes.
    pub passed_over: u64,
}

/// Treatment of files whose contents do not identify a format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Headerless {
    /// Files with the ending `.raw` are volumes.
    Taken,
    /// No such file is a volume.
    PassedOver,
}

/// The paths of a list, one per line; empty lines are skipped.
#[must_use]
pub fn of_list(text: &str) -> Inputs {
    let mut inputs = Inputs::default();
    let mut seen = BTreeSet::new();
    for line in text.lines().filter(|line| !line.trim().is_empty()) {
        if seen.insert(line) {
            inputs.paths.push(line.into());
        }
    }
    inputs
}

/// The volumes of a folder, except those in `output`.
///
/// # Errors
/// If the folder cannot be read, or there are more than [`INPUTS_LIMIT`]. An unreadable subfolder becomes an input,
/// which fails at its turn.
pub fn of_folder(folder: &Path, output: &Path, headerless: Headerless) -> Result<Inputs, BuildError> {
    let named = BTreeSet::new();
    let mut search = Search { output: std::fs::canonicalize(output).ok(), headerless, named };
    let mut inputs = Inputs::default();
    search.folder(folder, DEPTH_LIMIT, &mut inputs)?;
    Ok(inputs)
}

struct Search {
    output: Option<PathBuf>,
    headerless: Headerless,
    /// Data files that XML files name; the XML files are the inputs.
    named: BTreeSet<PathBuf>,
}

impl Search {
    fn folder(&mut self, folder: &Path, depth: usize, inputs: &mut Inputs) -> Result<(), BuildError> {
        if inputs.paths.len() > INPUTS_LIMIT {
            let what = format!("{}: expected at most {INPUTS_LIMIT} volumes, found more", folder.display());
            return Err(SourceError::options(what).into());
        }
        if is_chunked(folder) {
            inputs.paths.push(folder.into());
            return Ok(());
        }
        let Entries { files, folders, links } = Entries::of(folder)?;
        inputs.passed_over += links;
        // A file that cannot be examined becomes an input: its build fails with its name.
        let found: Vec<Found> = files.iter().map(|file| self.look_at(file)).collect();
        let described = files.iter().zip(&found).filter(|(file, found)| **found == Found::Volume && is_xml(file));
        self.named.extend(described.filter_map(|(file, _)| data_of(file)));
        let count = |kind| found.iter().filter(|found| **found == kind).count();
        let is_series = count(Found::DicomSlice) > 0;
        let is_stack = count(Found::Picture) > 0 && count(Found::Picture) == files.len() && folders.is_empty();
        if is_series || is_stack {
            inputs.paths.push(folder.into());
        }
        for (file, found) in files.into_iter().zip(found) {
            match found {
                Found::Volume if is_second_of_pair(&file) || self.named.contains(&file) => {}
                Found::Volume => inputs.paths.push(file),
                Found::DicomSlice => {}
                Found::Picture if is_stack => {}
                Found::Picture | Found::Other => inputs.passed_over += 1,
            }
        }
        // The subfolders of a series belong to it.
        for inner in folders.into_iter().filter(|_| !is_series) {
            let is_output = std::fs::canonicalize(&inner).ok().is_some_and(|whole| Some(whole) == self.output);
            if is_output || self.named.contains(&inner) {
                continue;
            }
            if depth == 0 || (!is_chunked(&inner) && std::fs::read_dir(&inner).is_err()) {
                inputs.paths.push(inner);
                continue;
            }
            self.folder(&inner, depth - 1, inputs)?;
        }
        Ok(())
    }

    fn look_at(&self, file: &Path) -> Found {
        if self.headerless == Headerless::Taken {
            let is_raw = file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(RAW_ENDING));
            return if is_raw { Found::Volume } else { Found::Other };
        }
        look_at(file).unwrap_or(Found::Volume)
    }
}

/// Contents of a folder, in natural order, without names that begin with a dot.
#[derive(Default)]
struct Entries {
    files: Vec<PathBuf>,
    folders: Vec<PathBuf>,
    links: u64,
}

impl Entries {
    fn of(folder: &Path) -> Result<Self, BuildError> {
        let mut found = Self::default();
        for entry in std::fs::read_dir(folder).map_err(|e| SourceError::io(folder, e))? {
            let entry = entry.map_err(|e| SourceError::io(folder, e))?;
            if entry.file_name().as_encoded_bytes().starts_with(b".") {
                continue;
            }
            let kind = entry.file_type().map_err(|e| SourceError::io(folder, e))?;
            if kind.is_dir() {
                found.folders.push(entry.path());
            } else if kind.is_file() {
                found.files.push(entry.path());
            } else {
                found.links += 1;
            }
        }
        found.files.sort_by(|a, b| natural(a, b));
        found.folders.sort_by(|a, b| natural(a, b));
        Ok(found)
    }
}

fn is_xml(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xml"))
}

/// Whether the file is the data of a header and data pair, and the header exists.
fn is_second_of_pair(file: &Path) -> bool {
    let name = file.file_name().map(OsStr::to_string_lossy).unwrap_or_default();
    let header = PAIRS.iter().find_map(|(second, first)| Some(format!("{}{first}", name.strip_suffix(second)?)));
    header.is_some_and(|header| file.with_file_name(header).is_file())
}

/// Calls `run` for every file of a folder and its subfolders, in the order of their names. Links to folders are not
/// followed.
pub(super) fn for_each_file(
    folder: &Path,
    run: &mut dyn FnMut(&Path) -> Result<(), BuildError>,
) -> Result<(), BuildError> {
    let mut waiting = vec![folder.to_path_buf()];
    while let Some(path) = waiting.pop() {
        if !path.is_dir() {
            run(&path)?;
            continue;
        }
        let mut inner = Vec::new();
        for entry in std::fs::read_dir(&path).map_err(|e| SourceError::io(&path, e))? {
            let entry = entry.map_err(|e| SourceError::io(&path, e))?;
            let is_linked_folder = entry.path().is_symlink() && entry.path().is_dir();
            let is_partial = entry.file_name().as_encoded_bytes().starts_with(b".supervol-");
            if !is_linked_folder && !is_partial {
                inner.push(entry.path());
            }
        }
        inner.sort_by(|a, b| b.cmp(a));
        waiting.extend(inner);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_searched_for_what_readers_take() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let write = |name: &str, bytes: &[u8]| {
            let path = root.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, bytes).unwrap();
        };
        let dicom = [&[0; 128][..], b"DICM"].concat();
        write("ct/s1", &dicom);
        write("ct/s2", &dicom);
        write("ct/inner/s3", &dicom);
        write("ct/notes.txt", b"Cut off");
        write("slices/a1.png", b"\x89PNG\r\n\x1a\n");
        write("slices/a2.png", b"\x89PNG\r\n\x1a\n");
        write("mixed/preview.png", b"\x89PNG\r\n\x1a\n");
        write("mixed/v10.nrrd", b"NRRD0004\n");
        write("mixed/v9.nrrd", b"NRRD0004\n");
        write("mixed/CHANGES", b"C is what this begins with");
        write("mixed/line", b"C 1 CLIENT");
        write("pair/b.hdr", b"");
        write("pair/b.img", b"");
        write("store.zarr/.zgroup", b"{}");
        write("store.zarr/0/.zarray", b"{}");
        // Two BigDataViewer data sets, each an XML file and its data.
        let data_set = |loader: &str, kind: &str, data: &str| {
            format!(
                "<SpimData><BasePath>.</BasePath><ImageLoader format=\"{loader}\"><{kind} type=\"relative\">{data}</{kind}>\
                 </ImageLoader></SpimData>"
            )
        };
        write("viewer/a.xml", data_set("bdv.hdf5", "hdf5", "data/a.h5").as_bytes());
        write("viewer/data/a.h5", b"\x89HDF\r\n\x1a\n");
        write("viewer/b.h5", b"\x89HDF\r\n\x1a\n");
        write("viewer/c.xml", data_set("bdv.n5", "n5", "c.n5").as_bytes());
        write("viewer/c.n5/attributes.json", b"{\"n5\": \"2.5.1\"}");
        write("out/done.npy", b"");
        write("headerless.raw", b"");
        write(".hidden/x.npy", b"");
        #[cfg(unix)]
        std::os::unix::fs::symlink(root, root.join("round")).unwrap();
        let found = of_folder(root, &root.join("out"), Headerless::PassedOver).unwrap();
        let names: Vec<_> = found.paths.iter().map(|p| p.strip_prefix(root).unwrap().to_str().unwrap()).collect();
        let expected = ["ct", "mixed/line", "mixed/v9.nrrd", "mixed/v10.nrrd", "pair/b.hdr", "slices", "store.zarr"];
        let viewers = ["viewer/a.xml", "viewer/b.h5", "viewer/c.xml"];
        assert_eq!(names, [&expected[..], &viewers].concat());
        // notes.txt, preview.png, CHANGES, headerless.raw, and the link.
        assert_eq!(found.passed_over, if cfg!(unix) { 5 } else { 4 });
        let raw = of_folder(root, &root.join("out"), Headerless::Taken).unwrap();
        // No XML file is an input now, so the N5 is one.
        assert_eq!(raw.paths, ["headerless.raw", "store.zarr", "viewer/c.n5"].map(|name| root.join(name)));
    }

    #[test]
    fn lists_name_each_input_once() {
        let found = of_list("a b.sgy\r\n\n  \nc\na b.sgy\n");
        assert_eq!(found.paths, ["a b.sgy", "c"].map(PathBuf::from));
    }
}
