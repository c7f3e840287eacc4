//! Errors of sources.

use std::error::Error;
use std::fmt::{Display, Formatter};
use std::io;
use std::path::{Path, PathBuf};

use supervol_format::readable::Mib;
use supervol_format::{Dims, VoxelType};

use crate::message::{Message, OptionName, ReadOption};

/// Error of opening or reading a volume. The message of each variant is complete; callers add only their own context.
///
/// `Display` names options by their field names, [`Self::named`] by the names of a program.
#[derive(Debug)]
pub enum SourceError {
    /// The machine failed to read the file.
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The machine failed to store decoded voxels.
    Spool {
        /// Folder of the temporary file.
        folder: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// The file breaks the rules of its format.
    Invalid {
        /// Path of the file.
        path: PathBuf,
        /// Place of the mistake in the file.
        location: String,
        /// Rule of the format, and the option to use if the file is right.
        expected: Message,
        /// Content of the file.
        found: String,
    },
    /// A headerless file does not have the length that its options require.
    RawLength {
        /// Path of the file.
        path: PathBuf,
        /// Number of voxels along x, y, z, from the options.
        dims: Dims,
        /// Type of the voxels, from the options.
        voxel_type: VoxelType,
        /// Bytes before the first voxel, from the options.
        header_bytes: u64,
        /// Bytes of the voxels.
        voxel_bytes: u64,
        /// Length of the file in bytes.
        found_bytes: u64,
        /// Options that would fit the length.
        advice: Message,
    },
    /// The file is valid, but it is not supported or not one volume.
    Unsupported {
        /// Path of the file.
        path: PathBuf,
        /// Content of the file.
        what: String,
        /// Action for the user.
        advice: Message,
        /// Volumes of the file, if it holds several and the user must choose.
        choices: Vec<Part>,
    },
    /// Another program wrote to the file while it was read.
    Changed {
        /// Path of the file.
        path: PathBuf,
        /// Change that was noticed.
        what: String,
    },
    /// The work was cancelled ([`crate::stop`]).
    Stopped,
    /// The file has fewer frames, channels or levels than an option selects.
    NoSuchPart {
        /// Path of the file.
        path: PathBuf,
        /// Option that selects the part.
        option: ReadOption,
        /// Selected number, counted from 0.
        wanted: u64,
        /// Number of parts in the file.
        count: u64,
    },
    /// Reading needs more memory than the options allow.
    Memory {
        /// Purpose of the memory.
        what: String,
        /// Memory that suffices, in bytes.
        needed_bytes: u64,
        /// Memory that the options allow, in bytes.
        allowed_bytes: u64,
    },
    /// The options contradict the file or each other.
    Options(Message),
}

/// A volume of a file that holds several.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Part {
    /// The way to choose it.
    pub by: PartName,
    /// Description of the volume, for the user.
    pub words: String,
}

/// The way to choose a volume of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PartName {
    /// Path with the name of an array in the file: `FILE:/NAME`.
    Path(PathBuf),
    /// Number or UID of a series.
    Series(String),
}

impl Part {
    /// A choice of an array by its name in a file.
    pub(crate) fn of_array(file: &Path, name: &str, words: impl Into<String>) -> Self {
        let path = PathBuf::from(format!("{}:/{}", file.display(), name.trim_start_matches('/')));
        Self { by: PartName::Path(path), words: words.into() }
    }
}

impl SourceError {
    /// Shorthand for [`SourceError::Invalid`].
    pub fn invalid(
        path: &Path,
        location: impl Into<String>,
        expected: impl Into<Message>,
        found: impl Into<String>,
    ) -> Self {
        Self::Invalid { path: path.into(), location: location.into(), expected: expected.into(), found: found.into() }
    }

    /// Shorthand for [`SourceError::Unsupported`].
    pub fn unsupported(path: &Path, what: impl Into<String>, advice: impl Into<Message>) -> Self {
        Self::Unsupported { path: path.into(), what: what.into(), advice: advice.into(), choices: Vec::new() }
    }

    /// The error with the volumes among which the user must choose; only for [`SourceError::Unsupported`].
    #[must_use]
    pub(crate) fn with_choices(mut self, all: impl IntoIterator<Item = Part>) -> Self {
        if let Self::Unsupported { choices, .. } = &mut self {
            choices.extend(all);
        }
        self
    }

    /// Volumes of the file, if it holds several and the user must choose.
    #[must_use]
    pub fn choices(&self) -> &[Part] {
        match self {
            Self::Unsupported { choices, .. } => choices,
            _ => &[],
        }
    }

    /// Shorthand for [`SourceError::Spool`].
    #[must_use]
    pub fn spool(folder: &Path, source: io::Error) -> Self {
        Self::Spool { folder: folder.into(), source }
    }

    /// Shorthand for [`SourceError::Io`].
    #[must_use]
    pub fn io(path: &Path, source: io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }

    /// Shorthand for [`SourceError::Options`].
    pub fn options(message: impl Into<Message>) -> Self {
        Self::Options(message.into())
    }

    /// Whether other options are needed, rather than another file or machine.
    #[must_use]
    pub fn is_wrong_option(&self) -> bool {
        matches!(self, Self::Options(_) | Self::NoSuchPart { .. } | Self::Memory { .. })
    }

    /// The message with the names that a program gives to the options.
    #[must_use]
    pub fn named(&self, name: OptionName) -> String {
        self.message().named(name)
    }

    /// The whole message.
    #[must_use]
    pub fn message(&self) -> Message {
        match self {
            Self::Io { path, source } => format!("cannot read {}: {source}", path.display()).into(),
            Self::Spool { folder, source } => {
                let advice = supervol_files::advice(source);
                format!("cannot keep decoded voxels in {}: {source}{advice}", folder.display()).into()
            }
            Self::Invalid { path, location, expected, found } => {
                let start = Message::from(format!("{}: {location}: expected ", path.display()));
                start.message(expected.clone()).text(format_args!(", found {found}"))
            }
            Self::RawLength { path, dims, voxel_type, header_bytes, voxel_bytes, found_bytes, advice } => {
                let total = u128::from(*header_bytes) + u128::from(*voxel_bytes);
                let start = Message::from(format!(
                    "{}: length of the file: expected {total} bytes ({dims} voxels of {voxel_type} after \
                     {header_bytes} bytes of header), found {found_bytes} bytes (",
                    path.display()
                ));
                start.message(advice.clone()).text(")")
            }
            Self::Unsupported { path, what, advice, .. } => {
                Message::from(format!("{}: {what}; ", path.display())).message(advice.clone())
            }
            Self::Changed { path, what } => {
                let path = path.display();
                format!("{path} changed while it was read: {what}. Build again when nothing writes to it").into()
            }
            Self::Stopped => "stopped before anything was finished; nothing is kept".into(),
            Self::NoSuchPart { path, option, wanted, count } => {
                let start = Message::from(*option).text(format_args!(" {wanted}: {} has ", path.display()));
                match count {
                    1 => start.text("one, which is number 0"),
                    _ => start.text(format_args!("{count}, of which the last is number {}", count.saturating_sub(1))),
                }
            }
            Self::Memory { what, needed_bytes, allowed_bytes } => {
                // Whole MiB, so that the user can give the printed number.
                let needed = Mib(needed_bytes.checked_next_multiple_of(1 << 20).unwrap_or(*needed_bytes));
                let start = Message::from(format!("{needed} of memory suffice for {what}; "));
                start.option(ReadOption::MemoryBytes).text(format_args!(" allows {}", Mib(*allowed_bytes)))
            }
            Self::Options(message) => message.clone(),
        }
    }
}

impl Display for SourceError {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.message().fmt(f)
    }
}

impl Error for SourceError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            Self::Io { source, .. } | Self::Spool { source, .. } => Some(source),
            _ => None,
        }
    }
}
