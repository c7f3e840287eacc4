//! State of the dialog of a file that needs options, and its fields: those of the command line.

use std::path::PathBuf;

use supervol_sources::{Part, PartName};

use crate::worker::{OpenVolume, Refused};

/// A field of the dialog: flag, label, example or choices.
pub(crate) struct Field {
    pub(crate) flag: &'static str,
    pub(crate) label: &'static str,
    pub(crate) content: Content,
}

/// Content of a field.
pub(crate) enum Content {
    /// Text, with an example.
    Text(&'static str),
    /// One of these words, or none.
    Choice(&'static [&'static str]),
}

const fn text(flag: &'static str, label: &'static str, example: &'static str) -> Field {
    Field { flag, label, content: Content::Text(example) }
}

const fn choice(flag: &'static str, label: &'static str, words: &'static [&'static str]) -> Field {
    Field { flag, label, content: Content::Choice(words) }
}

/// All fields by heading.
pub(crate) const FIELDS: [(&str, &[Field]); 4] = [
    (
        "Which volume",
        &[
            text("--series", "Series", "number or UID"),
            text("--frame", "Time point", "0"),
            text("--channel", "Channel", "0"),
            text("--axes", "Axes, slowest first", "z,y,x or inline,crossline,time"),
        ],
    ),
    (
        "File without a header",
        &[
            text("--dims", "Voxels along x, y, z", "512,512,300"),
            text("--dtype", "Type of the voxels", "u8, i16be, f32 ..."),
            text("--offset", "Bytes before the first voxel", "0"),
        ],
    ),
    (
        "Survey",
        &[
            choice("--domain", "Third axis", &["time", "depth"]),
            text("--il-byte", "Byte of the inline number", "189"),
            text("--xl-byte", "Byte of the crossline number", "193"),
            text("--skip-trace", "Traces to leave out", "81 or 1-12"),
            choice("--on-duplicate", "Traces at one place", &["first", "last", "mean", "refuse"]),
        ],
    ),
    (
        "Values and places",
        &[
            text("--nodata", "Value of voxels without data", "-999.25"),
            text("--spacing", "Distance between voxels", "1mm,1mm,2mm"),
            text("--unit", "Unit of the axes", "m"),
        ],
    ),
];

/// State of the dialog.
pub(crate) struct FileOptions {
    pub(crate) path: String,
    /// Reason why the file was refused; empty if the user opened the dialog.
    pub(crate) why: String,
    pub(crate) choices: Vec<Part>,
    /// Texts of all fields, in order.
    pub(crate) texts: Vec<String>,
    /// Reason why the options are refused.
    pub(crate) trouble: Option<String>,
}

impl FileOptions {
    /// The dialog for a file that was refused.
    pub(crate) fn refused(refused: Refused) -> Self {
        let Refused { source, why, choices } = refused;
        Self { why, choices, ..Self::of(source) }
    }

    /// The dialog for an open file.
    pub(crate) fn opened(opened: &OpenVolume) -> Self {
        Self::of(opened.source.clone())
    }

    fn of(source: PathBuf) -> Self {
        let count = FIELDS.iter().map(|(_, fields)| fields.len()).sum();
        let path = source.display().to_string();
        Self { path, why: String::new(), choices: Vec::new(), texts: vec![String::new(); count], trouble: None }
    }

    /// The options as words of the command line.
    pub(crate) fn words(&self) -> Vec<String> {
        let flags = FIELDS.iter().flat_map(|(_, fields)| fields.iter().map(|field| field.flag));
        let given = flags.zip(&self.texts).filter(|(_, text)| !text.trim().is_empty());
        given.map(|(flag, text)| format!("{flag}={}", text.trim())).collect()
    }

    /// Takes a choice over into the fields.
    pub(crate) fn take(&mut self, choice: &PartName) {
        match choice {
            PartName::Path(path) => self.path = path.display().to_string(),
            PartName::Series(series) => self.texts[0].clone_from(series),
        }
    }
}
