//! Kind of a file, from its contents, not from its name. It decides whether a file may be replaced without
//! [`Existing::Replace`](crate::Existing::Replace).

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use supervol_format::container::header::MAGIC;

/// Bytes that are examined of a binary file.
const HEAD_BYTES: u64 = 4096;
/// Longest text that is examined, in bytes.
const TEXT_LIMIT_BYTES: u64 = 64 << 20;
/// Characters of a report's kind that messages show.
const SHOWN_CHARACTERS: usize = 60;
/// Keys that only statistics of a picture have.
const STATISTICS_KEYS: [&str; 3] = ["render_ms", "page_ins", "peak_rss_bytes"];
/// Keys that only records of pictures have.
const RECORD_KEYS: [&str; 3] = ["record_version", "container", "scene"];
/// Keys that only reports of a picture's fidelity have.
const FIDELITY_KEYS: [&str; 3] = ["fidelity_version", "lossiness", "dimensions"];

/// Contents of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FileKind {
    /// An empty file.
    Empty,
    /// A `.svol` container.
    Container,
    /// A picture: PNG, OpenEXR, SVG as it is written here, or a NumPy array of (height, width, 4) floats.
    Picture,
    /// Statistics of a picture, as JSON.
    Statistics,
    /// Record of a picture, as JSON beside it.
    Record,
    /// Fidelity of a picture, as JSON.
    Fidelity,
    /// A page, table or record, with the text that all of its kind share: title, columns or keys.
    Report(String),
    /// Anything else.
    Other,
}

impl std::fmt::Display for FileKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Empty => "an empty file",
            Self::Container => "a container",
            Self::Picture => "a picture",
            Self::Statistics => "statistics of a picture",
            Self::Record => "the record of a picture",
            Self::Fidelity => "the fidelity of a picture",
            Self::Report(text) => return write!(f, "a text or table of the kind `{}`", shortened(text)),
            Self::Other => "neither a picture nor statistics",
        })
    }
}

/// The first characters of a text, for messages. A shortened text ends with its length, so that two texts that begin
/// alike usually look different.
fn shortened(text: &str) -> String {
    let start: String = text.chars().take(SHOWN_CHARACTERS).flat_map(char::escape_debug).collect();
    match text.chars().count() {
        0..=SHOWN_CHARACTERS => start,
        count => format!("{start}... ({count} characters)"),
    }
}

impl FileKind {
    /// Kind of a file.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(path: &Path) -> io::Result<Self> {
        let mut file = File::open(path)?;
        let mut bytes = Vec::new();
        file.by_ref().take(HEAD_BYTES).read_to_end(&mut bytes)?;
        if bytes.contains(&0) || file.metadata()?.len() > TEXT_LIMIT_BYTES {
            return Ok(Self::of_bytes(&bytes));
        }
        file.take(TEXT_LIMIT_BYTES).read_to_end(&mut bytes)?;
        Ok(Self::of_bytes(&bytes))
    }

    /// Kind of a file with these bytes; for binary files the first 4096 suffice.
    #[must_use]
    pub fn of_bytes(bytes: &[u8]) -> Self {
        match bytes {
            [] => Self::Empty,
            _ if bytes.starts_with(&MAGIC) => Self::Container,
            _ if bytes.starts_with(b"\x89PNG\r\n\x1a\n") || bytes.starts_with(b"\x76\x2f\x31\x01") => Self::Picture,
            _ if is_numpy_picture(bytes) || bytes.starts_with(b"<svg") => Self::Picture,
            _ => std::str::from_utf8(bytes).ok().and_then(of_text).unwrap_or(Self::Other),
        }
    }
}

/// Whether this is a NumPy array with the shape and type of a picture; volumes have others.
fn is_numpy_picture(bytes: &[u8]) -> bool {
    let Some(rest) = bytes.strip_prefix(b"\x93NUMPY\x01\x00") else { return false };
    let header = String::from_utf8_lossy(rest.split(|b| *b == b'\n').next().unwrap_or_default());
    let shape = header.split_once("'shape': (").and_then(|(_, shape)| shape.split_once(')'));
    let sizes: Vec<_> = shape.map(|(sizes, _)| sizes.split(',').map(str::trim).collect()).unwrap_or_default();
    header.contains("'descr': '<f4'") && header.contains("'fortran_order': False") && matches!(sizes[..], [_, _, "4"])
}

fn of_text(text: &str) -> Option<FileKind> {
    if text.contains('\0') {
        return None;
    }
    if let Ok(value) = serde_json::from_str::<serde_json::Value>(text) {
        let object = value.as_object().or_else(|| value.as_array()?.first()?.as_object())?;
        let known = [
            (STATISTICS_KEYS, FileKind::Statistics),
            (RECORD_KEYS, FileKind::Record),
            (FIDELITY_KEYS, FileKind::Fidelity),
        ];
        let has_all = |keys: &[&str]| keys.iter().all(|key| object.contains_key(*key));
        if let Some((_, kind)) = known.into_iter().find(|(keys, _)| has_all(keys)) {
            return Some(kind);
        }
        let keys: BTreeSet<&str> = object.keys().map(String::as_str).collect();
        return Some(FileKind::Report(keys.into_iter().collect::<Vec<_>>().join(" ")));
    }
    let title = text.split_once("<title>").and_then(|(_, rest)| rest.split_once("</title>")).map(|(title, _)| title);
    let first = title.or_else(|| text.lines().next()).unwrap_or_default();
    let words: Vec<&str> = first.split_whitespace().collect();
    let line = words.join(" ");
    // Dates and counts differ between reports of a kind. A comma followed by a blank separates sentences, not columns
    // of a table.
    let before_number = line.split(" ").take_while(|word| !word.starts_with(|c: char| c.is_ascii_digit()));
    let line = before_number.collect::<Vec<_>>().join(" ");
    Some(FileKind::Report(line.split(", ").next().unwrap_or_default().into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_what_they_hold() {
        let numpy = |header: &str| [b"\x93NUMPY\x01\x00\x76\x00", header.as_bytes(), b"\n\0\0\0"].concat();
        let picture = "{'descr': '<f4', 'fortran_order': False, 'shape': (30, 40, 4), }   ";
        assert_eq!(FileKind::of_bytes(&numpy(picture)), FileKind::Picture);
        for volume in [
            "{'descr': '|u1', 'fortran_order': False, 'shape': (30, 40, 4), }",
            "{'descr': '<f4', 'fortran_order': True, 'shape': (30, 40, 4), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (30, 40, 44), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (30, 40), }",
        ] {
            assert_eq!(FileKind::of_bytes(&numpy(volume)), FileKind::Other, "{volume}");
        }
        assert_eq!(FileKind::of_bytes(b"\x89PNG\r\n\x1a\nrest"), FileKind::Picture);
        assert_eq!(FileKind::of_bytes(&[&MAGIC[..], &[0; 9]].concat()), FileKind::Container);
        let statistics = r#"{"render_ms": 1, "page_ins": 2, "peak_rss_bytes": 3}"#;
        assert_eq!(FileKind::of_bytes(statistics.as_bytes()), FileKind::Statistics);
        let record = br#"{"record_version": 1, "container": {}, "scene": {}}"#;
        assert_eq!(FileKind::of_bytes(record), FileKind::Record);
        let fidelity = br#"{"fidelity_version": 1, "lossiness": "never_lossy", "dimensions": []}"#;
        assert_eq!(FileKind::of_bytes(fidelity), FileKind::Fidelity);
        assert_ne!(FileKind::of_bytes(br#"{"camera": {}, "mode": "mip"}"#), FileKind::Statistics);
    }

    #[test]
    fn reports_of_one_kind_differ_in_dates_and_counts_only() {
        let same = |a: &str, b: &str| FileKind::of_bytes(a.as_bytes()) == FileKind::of_bytes(b.as_bytes());
        assert!(same("# Frames along the path orbit, 2026-11-20\n", "# Frames along the path orbit, 2026-11-21\n\nx"));
        assert!(same("Random scenes 2 to 4 of seed 5", "Random scenes 0 to 9 of seed 1"));
        assert!(same("<html><title>A, 1</title>", "<html><title>A, 2</title>"));
        assert!(same(r#"[{"a": 1, "b": 2}]"#, r#"[{"b": 1, "a": 3}, {"c": 1}]"#));
        assert!(same("a,b1,c\n1,2,3", "a,b1,c\n"));
        assert!(!same("a,b1,c\n1,2,3", "a,b1,d\n"));
        assert!(!same("# Frames along the path orbit", "# My notes"));
        assert!(!same(r#"{"a": 1}"#, r#"{"b": 1}"#));
    }

    #[test]
    fn messages_tell_reports_apart() {
        let shown = |text: &str| FileKind::of_bytes(text.as_bytes()).to_string();
        assert_eq!(shown("# My notes\n"), "a text or table of the kind `# My notes`");
        assert_eq!(shown("# A \u{1b}[31m"), "a text or table of the kind `# A \\u{1b}[31m`");
        let columns = |n: usize| (0..n).map(|i| format!("column_{i}")).collect::<Vec<_>>().join(",");
        assert!(shown(&columns(20)).ends_with("... (189 characters)`"), "{}", shown(&columns(20)));
        assert_ne!(shown(&columns(20)), shown(&columns(21)));
    }
}
