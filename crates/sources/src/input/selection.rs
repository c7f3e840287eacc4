//! Selection of one volume of a file that holds several: time points, channels, series, arrays.

use std::path::Path;

use super::text::shortened;
use crate::error::SourceError;
use crate::{Message, ReadOption};

/// Largest number of channels that a note names.
const NAMED_CHANNELS: u64 = 8;

/// The user's selection in a file that holds several volumes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Selection {
    /// Time point, or another sequence of volumes, counted from 0.
    pub frame: Option<u64>,
    /// Channel, colour or component, counted from 0.
    pub channel: Option<u64>,
    /// Number or UID of a DICOM series, or number of an OME-TIFF series, counted from 0.
    pub series: Option<String>,
    /// Array in a file that holds several.
    pub array: Option<String>,
    /// Level of the file's own pyramid, 0 is the finest.
    pub level: Option<u64>,
    /// Names of the axes of an array, slowest first, that override those of the file; empty to keep these.
    pub axes: Vec<String>,
}

/// A part of a file that formats have or lack as a whole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choice {
    /// Levels of a pyramid.
    Level,
    /// Series.
    Series,
    /// Named arrays.
    Array,
    /// Names of the axes.
    Axes,
}

impl Selection {
    /// The selected time point out of `count`; by default the first.
    pub(crate) fn frame_of(&self, path: &Path, count: u64) -> Result<u64, SourceError> {
        pick(path, ReadOption::Frame, self.frame, count)
    }

    /// The selected channel out of `count`; by default the first.
    pub(crate) fn channel_of(&self, path: &Path, count: u64) -> Result<u64, SourceError> {
        pick(path, ReadOption::Channel, self.channel, count)
    }

    /// As [`Self::channel_of`], with a note: the available channels if none is selected, else the selected channel's
    /// name. `names` are the file's names of the channels; it may be empty.
    pub(crate) fn noted_channel(
        &self,
        path: &Path,
        count: u64,
        names: &[String],
        notes: &mut Vec<Message>,
    ) -> Result<u64, SourceError> {
        let channel = self.channel_of(path, count)?;
        let name_of = |n: u64| usize::try_from(n).ok().and_then(|n| names.get(n)).filter(|name| !name.is_empty());
        if self.channel.is_some() {
            notes.extend(name_of(channel).map(|name| format!("channel {channel} is {}", shortened(name)).into()));
        } else if count > 1 {
            let named: Vec<String> = (0..count.min(NAMED_CHANNELS)).filter_map(name_of).map(|n| shortened(n)).collect();
            let names = if named.is_empty() { String::new() } else { format!(" ({})", named.join(", ")) };
            notes.push(first_of(&format!("{count} channels{names}"), ReadOption::Channel, count));
        }
        Ok(channel)
    }

    /// The selected level out of `count`; by default the finest.
    pub(crate) fn level_of(&self, path: &Path, count: u64) -> Result<u64, SourceError> {
        pick(path, ReadOption::Level, self.level, count)
    }

    /// As [`Self::frame_of`], with a note on the available frames if none is selected. `what` is their noun, such as
    /// `time points`.
    pub(crate) fn noted_frame(
        &self,
        path: &Path,
        count: u64,
        what: &str,
        notes: &mut Vec<Message>,
    ) -> Result<u64, SourceError> {
        if count > 1 && self.frame.is_none() {
            notes.push(first_of(&format!("{count} {what}"), ReadOption::Frame, count));
        }
        self.frame_of(path, count)
    }

    /// Refuses a selection that files of a format never have; `choices` lists those that they may have.
    pub(crate) fn refuse_beyond(&self, path: &Path, choices: &[Choice]) -> Result<(), SourceError> {
        if !choices.contains(&Choice::Level) {
            self.level_of(path, 1)?;
        }
        if !choices.contains(&Choice::Series) {
            self.refuse_series(path)?;
        }
        if !choices.contains(&Choice::Array) {
            self.refuse_array(path)?;
        }
        if !choices.contains(&Choice::Axes) && !self.axes.is_empty() {
            let what = format!(": {} is no array; only Zarr, N5, HDF5 and NumPy have axes to name", path.display());
            return Err(SourceError::options(Message::from(ReadOption::Axes).text(what)));
        }
        Ok(())
    }

    /// Refuses names of the axes whose number is not `count`, or of which two are equal.
    pub(crate) fn check_axes(&self, path: &Path, count: usize) -> Result<(), SourceError> {
        let refused = |what: String| {
            let names = self.axes.join(",");
            let what = format!(" {}: {}: {what}", shortened(&names), path.display());
            Err(SourceError::options(Message::from(ReadOption::Axes).text(what)))
        };
        if self.axes.len() != count {
            return refused(format!("expected {count} names, one for each axis of the array, the slowest first"));
        }
        if (1..count).any(|i| self.axes[..i].contains(&self.axes[i])) {
            return refused("expected different names".into());
        }
        Ok(())
    }

    /// Refuses a selection, for formats that hold one volume.
    pub(crate) fn refuse_all(&self, path: &Path) -> Result<(), SourceError> {
        self.frame_of(path, 1)?;
        self.channel_of(path, 1)?;
        self.refuse_series(path)?;
        self.refuse_array(path)
    }

    /// Refuses the selection of a series, for formats without series.
    pub(crate) fn refuse_series(&self, path: &Path) -> Result<(), SourceError> {
        if self.series.is_none() {
            return Ok(());
        }
        let what = format_args!(": {} is no DICOM or OME-TIFF; only DICOM and OME-TIFF have series", path.display());
        Err(SourceError::options(Message::from(ReadOption::Series).text(what)))
    }

    /// Refuses the name of an array, for formats that hold one volume.
    pub(crate) fn refuse_array(&self, path: &Path) -> Result<(), SourceError> {
        let Some(array) = &self.array else { return Ok(()) };
        let what = format!("{} holds no arrays that could be named; leave `:/{array}` out", path.display());
        Err(SourceError::options(what))
    }
}

/// Suffix of the volume's name in containers, as the options follow the file name on the command line; empty if nothing
/// is selected. Containers store this text, so it must not change.
impl std::fmt::Display for Selection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { frame, channel, series, array, level, axes } = self;
        array.iter().try_for_each(|array| write!(f, ":/{array}"))?;
        series.iter().try_for_each(|series| write!(f, " --series {series}"))?;
        frame.iter().try_for_each(|frame| write!(f, " --frame {frame}"))?;
        channel.iter().try_for_each(|channel| write!(f, " --channel {channel}"))?;
        level.iter().try_for_each(|level| write!(f, " --source-level {level}"))?;
        if axes.is_empty() { Ok(()) } else { write!(f, " --axes {}", axes.join(",")) }
    }
}

/// Note that the first of `count` parts is used. `what` names the parts.
pub(crate) fn first_of(what: &str, option: ReadOption, count: u64) -> Message {
    let start = Message::from(format!("{what}; the first is used; ")).option(option);
    start.text(format_args!(" 0 to {} takes another", count - 1))
}

fn pick(path: &Path, option: ReadOption, wanted: Option<u64>, count: u64) -> Result<u64, SourceError> {
    let wanted = wanted.unwrap_or(0);
    if wanted < count {
        return Ok(wanted);
    }
    Err(SourceError::NoSuchPart { path: path.into(), option, wanted, count })
}
