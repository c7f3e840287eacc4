//! Data files that a header lists or names by a pattern: search, access rules, layout.

use std::fs::File;
use std::path::{Component, Path, PathBuf};

use supervol_files::folder_of;

use super::file::SourceFile;
use super::text::shortened;
use crate::cast::signed;
use crate::error::SourceError;
use crate::{Message, ReadOption};

/// Largest width of a number in a file-name pattern, in digits.
const PATTERN_WIDTH_LIMIT: usize = 32;

/// Largest number of data files of a header.
pub(crate) const FILES_LIMIT: usize = 1 << 16;

/// Whether a header's data files may lie outside its folder. A header from someone else could name any file of the
/// machine and expose its bytes as voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outside {
    /// Only files below the header's folder.
    #[default]
    Refused,
    /// Any file.
    Allowed,
}

/// Paths of the data files. They must lie below the header's folder, unless `outside` allows others.
pub(crate) fn find_all(header: &Path, names: &[String], outside: Outside) -> Result<Vec<PathBuf>, SourceError> {
    let folder = folder_of(header);
    let folder_is = std::fs::canonicalize(folder).map_err(|e| SourceError::io(folder, e))?;
    let find = |name: &String| {
        let file = folder.join(name);
        let is_below = match std::fs::canonicalize(&file) {
            Ok(file_is) => file_is.starts_with(&folder_is),
            // The file does not exist or is not accessible. Only for names below the folder may a message tell which.
            Err(_) => Path::new(name).components().all(|part| matches!(part, Component::Normal(_))),
        };
        if is_below || outside == Outside::Allowed {
            return Ok(file);
        }
        let what = format!("its data file `{}` lies outside the folder of the header", shortened(name));
        let advice = Message::from("give ").option(ReadOption::Outside);
        Err(SourceError::unsupported(header, what, advice.text(" if you know where the header comes from")))
    };
    names.iter().map(find).collect()
}

/// Examines a data file. A missing file, or a path that is not a file, is reported as an error of the header, not as an
/// I/O error.
pub(crate) fn look_at(header: &Path, path: &Path) -> Result<SourceFile, SourceError> {
    SourceFile::of(path).map_err(|error| {
        let SourceError::Io { source, .. } = &error else { return error };
        let found = match source.kind() {
            std::io::ErrorKind::NotFound => "no such file".to_owned(),
            std::io::ErrorKind::InvalidInput => source.to_string(),
            _ => return error,
        };
        SourceError::invalid(header, "data file", format!("the data file {}", path.display()), found)
    })
}

/// Notes, at most once, that a data file has bytes behind its voxels.
pub(crate) fn note_excess(path: &Path, excess: u64, notes: &mut Vec<Message>) {
    if excess > 0 && notes.iter().all(|n| !n.to_string().contains("goes on after the voxels")) {
        // The name without its folder: notes must not depend on the location of a file.
        let name = path.file_name().unwrap_or_default().display();
        notes.push(format!("{name} goes on after the voxels; bytes not read: {excess}").into());
    }
}

/// Opens a data file that [`look_at`] has examined.
pub(crate) fn open_data(path: &Path) -> Result<File, SourceError> {
    File::open(path).map_err(|e| SourceError::io(path, e))
}

/// File names that `pattern` gives for the numbers from minimum to maximum in steps. Supports `%d`, `%03d` and `%%`, as
/// in printf.
pub(crate) fn pattern_names(path: &Path, pattern: &str, numbers: [&str; 3]) -> Result<Vec<String>, SourceError> {
    let wrong = |expected: &str| {
        let found = format!("`{} {}`", shortened(pattern), numbers.map(shortened).join(" "));
        SourceError::invalid(path, "data file", expected, found)
    };
    let [Ok(min), Ok(max), Ok(step)] = numbers.map(str::parse::<i64>) else {
        return Err(wrong("whole numbers `min max step` behind a file-name pattern"));
    };
    let count = if step == 0 { None } else { max.checked_sub(min).and_then(|d| d.checked_div(step)) };
    let Some(count) = count.filter(|c| (0..signed(FILES_LIMIT as u64)).contains(c)) else {
        return Err(wrong("min, max and step of 1 to 65536 files"));
    };
    let parts =
        split_pattern(pattern).ok_or_else(|| wrong("one %d in the file-name pattern, such as `slice%03d.raw`"))?;
    // Cannot overflow: |index * step| is at most |max - min|.
    Ok((0..=count).map(|index| parts.name(min + index * step)).collect())
}

/// File-name pattern, split around its one number.
struct Pattern {
    before: String,
    after: String,
    width: usize,
    zeros: bool,
}

impl Pattern {
    fn name(&self, number: i64) -> String {
        let Self { before, after, width, zeros } = self;
        if *zeros { format!("{before}{number:0width$}{after}") } else { format!("{before}{number:width$}{after}") }
    }
}

fn split_pattern(pattern: &str) -> Option<Pattern> {
    // `%%` is a percent sign; replace it, so that its `%` is not taken for the number's.
    let hidden = pattern.replace("%%", "\0");
    let (before, rest) = hidden.split_once('%')?;
    let letter = rest.find(|c: char| !c.is_ascii_digit())?;
    let (digits, after) = rest.split_at(letter);
    let after = after.strip_prefix(['d', 'i', 'u'])?;
    let width = if digits.is_empty() { 0 } else { digits.parse().ok().filter(|w| *w <= PATTERN_WIDTH_LIMIT)? };
    let shown = |text: &str| text.replace('\0', "%");
    let one_number = !after.contains('%');
    one_number.then(|| Pattern { before: shown(before), after: shown(after), width, zeros: digits.starts_with('0') })
}
