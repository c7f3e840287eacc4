//! Messages for users that name options of this crate. A program shows them with its own names of the options.
//!
//! A [`Message`] is text with [`ReadOption`]s in it. `Display` writes each option as its field name in backticks.
//! [`Message::named`] writes it as the caller names it: a command line as its flag, a window as the label of a field.

use std::fmt::{Display, Formatter, Write};

/// An option that decides how a file is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ReadOption {
    /// Number of voxels of a headerless file or of a synthetic volume.
    Dims,
    /// Voxel type of a headerless file.
    VoxelType,
    /// Bytes before the first voxel of a headerless file.
    HeaderBytes,
    /// Time point of a file that holds several volumes.
    Frame,
    /// Channel of a file that holds several numbers per voxel.
    Channel,
    /// DICOM or OME-TIFF series.
    Series,
    /// Level of the file's own pyramid.
    Level,
    /// Permission to read files outside the folder of the opened file.
    Outside,
    /// World distance between neighbouring voxels.
    Spacing,
    /// Meaning of the third axis of a survey.
    Domain,
    /// Unit of the third axis of a survey, otherwise of all three axes.
    AxisUnit,
    /// Largest memory of a reader.
    MemoryBytes,
    /// SEG-Y sample format.
    SampleFormat,
    /// Byte order of a SEG-Y file.
    Endian,
    /// Samples per trace of a SEG-Y file.
    Samples,
    /// Sample interval of a SEG-Y file.
    Interval,
    /// Place of the inline number in SEG-Y trace headers.
    InlineByte,
    /// Place of the crossline number in SEG-Y trace headers.
    CrosslineByte,
    /// Place of the source-receiver offset in SEG-Y trace headers.
    OffsetByte,
    /// Source-receiver offset to read, or the mean over all.
    Offsets,
    /// Value that is absent.
    Nodata,
    /// Use of the attributes that explain the numbers of a file.
    Values,
    /// Rule for usual nulls.
    Nulls,
    /// Names of the axes of an array.
    Axes,
    /// SEG-Y traces to leave out.
    SkipTraces,
    /// Rule for several SEG-Y traces at one place.
    Duplicates,
}

impl ReadOption {
    /// Name of the option's field in [`OpenOptions`](crate::open::OpenOptions), in one of its parts, or in
    /// [`Placing`](crate::grid::placed::Placing).
    #[must_use]
    pub const fn field(self) -> &'static str {
        match self {
            Self::Dims => "dims",
            Self::VoxelType => "voxel_type",
            Self::HeaderBytes => "header_bytes",
            Self::Frame => "frame",
            Self::Channel => "channel",
            Self::Series => "series",
            Self::Level => "level",
            Self::Outside => "outside",
            Self::Spacing => "spacing",
            Self::Domain => "domain",
            Self::AxisUnit => "axis_unit",
            Self::MemoryBytes => "memory_bytes",
            Self::SampleFormat => "format",
            Self::Endian => "endian",
            Self::Samples => "samples",
            Self::Interval => "interval",
            Self::InlineByte => "inline_byte",
            Self::CrosslineByte => "crossline_byte",
            Self::OffsetByte => "offset_byte",
            Self::Offsets => "offsets",
            Self::Nodata => "nodata",
            Self::Values => "values",
            Self::Nulls => "nulls",
            Self::Axes => "axes",
            Self::SkipTraces => "skip_traces",
            Self::Duplicates => "duplicates",
        }
    }
}

/// The name of an option in a program.
pub type OptionName = fn(ReadOption) -> &'static str;

/// Text for the user that may name options.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Message(Vec<Part>);

/// Part of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Text(String),
    Option(ReadOption),
}

impl Message {
    /// Appends text.
    #[must_use]
    pub fn text(mut self, text: impl Display) -> Self {
        match self.0.last_mut() {
            Some(Part::Text(last)) => write!(last, "{text}").expect("writing to a string does not fail"),
            _ => self.0.push(Part::Text(text.to_string())),
        }
        self
    }

    /// Appends the name of an option.
    #[must_use]
    pub fn option(mut self, option: ReadOption) -> Self {
        self.0.push(Part::Option(option));
        self
    }

    /// Appends another message.
    #[must_use]
    pub fn message(mut self, other: Self) -> Self {
        self.0.extend(other.0);
        self
    }

    /// Options that the message names, in the order of the text.
    pub fn options(&self) -> impl Iterator<Item = ReadOption> {
        self.0.iter().filter_map(|part| match part {
            Part::Text(_) => None,
            Part::Option(option) => Some(*option),
        })
    }

    /// The text with the names that a program gives to the options.
    #[must_use]
    pub fn named(&self, name: OptionName) -> String {
        let part = |part: &Part| match part {
            Part::Text(text) => text.clone(),
            Part::Option(option) => name(*option).to_owned(),
        };
        self.0.iter().map(part).collect()
    }
}

impl Display for Message {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.0.iter().try_for_each(|part| match part {
            Part::Text(text) => f.write_str(text),
            Part::Option(option) => write!(f, "`{}`", option.field()),
        })
    }
}

impl From<String> for Message {
    fn from(text: String) -> Self {
        Self(vec![Part::Text(text)])
    }
}

impl From<&str> for Message {
    fn from(text: &str) -> Self {
        text.to_owned().into()
    }
}

impl From<ReadOption> for Message {
    fn from(option: ReadOption) -> Self {
        Self(vec![Part::Option(option)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_names_the_options() {
        let message = Message::from("choose one with ").option(ReadOption::Channel).text(" 0 to ").text(2);
        assert_eq!(message.to_string(), "choose one with `channel` 0 to 2");
        assert_eq!(message.named(|_| "Channel"), "choose one with Channel 0 to 2");
        assert_eq!(message.options().collect::<Vec<_>>(), [ReadOption::Channel]);
    }
}
