//! Which volume of a file that holds several: time points, channels, series, arrays.

use std::path::Path;

use super::text::shortened;
use crate::error::SourceError;

/// Most channels that are named in a note.
const NAMED_CHANNELS: u64 = 8;

/// What a person chooses, where a file holds more than one volume.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Selection {
    /// Time point, or whatever the file counts its volumes by, from 0 on.
    pub frame: Option<u64>,
    /// Channel, colour or component, from 0 on.
    pub channel: Option<u64>,
    /// Number or UID of a DICOM series; number of a series of OME-TIFF, 0 the first.
    pub series: Option<String>,
    /// Array of a file that holds several.
    pub array: Option<String>,
    /// Level of the file's own pyramid, 0 the finest.
    pub level: Option<u64>,
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
}

impl Selection {
    /// The time point that is wanted of `count`, the first where nobody says.
    pub(crate) fn frame_of(&self, path: &Path, count: u64) -> Result<u64, SourceError> {
        pick(path, "--frame", self.frame, count)
    }

    /// The channel that is wanted of `count`, the first where nobody says.
    pub(crate) fn channel_of(&self, path: &Path, count: u64) -> Result<u64, SourceError> {
        pick(path, "--channel", self.channel, count)
    }

    /// As [`Self::channel_of`]; the notes say which channels there are where nobody has chosen, else what the one that is chosen is
    /// called. `names` are those that the file says, empty where it says none.
    pub(crate) fn noted_channel(
        &self,
        path: &Path,
        count: u64,
        names: &[String],
        notes: &mut Vec<String>,
    ) -> Result<u64, SourceError> {
        let channel = self.channel_of(path, count)?;
        let name_of = |n: u64| usize::try_from(n).ok().and_then(|n| names.get(n)).filter(|name| !name.is_empty());
        if self.channel.is_some() {
            notes.extend(name_of(channel).map(|name| format!("channel {channel} is {}", shortened(name))));
        } else if count > 1 {
            let named: Vec<String> = (0..count.min(NAMED_CHANNELS)).filter_map(name_of).map(|n| shortened(n)).collect();
            let names = if named.is_empty() { String::new() } else { format!(" ({})", named.join(", ")) };
            notes.push(format!(
                "{count} channels{names}; the first is used; --channel 0 to {} takes another",
                count - 1
            ));
        }
        Ok(channel)
    }

    /// The level that is wanted of `count`, the finest where nobody says.
    pub(crate) fn level_of(&self, path: &Path, count: u64) -> Result<u64, SourceError> {
        pick(path, "--source-level", self.level, count)
    }

    /// As [`Self::frame_of`]; the notes say what there is where nobody has chosen. `what` names them: `time points`.
    pub(crate) fn noted_frame(
        &self,
        path: &Path,
        count: u64,
        what: &str,
        notes: &mut Vec<String>,
    ) -> Result<u64, SourceError> {
        if count > 1 && self.frame.is_none() {
            notes.push(format!("{count} {what}; the first is used; --frame 0 to {} takes another", count - 1));
        }
        self.frame_of(path, count)
    }

    /// Refuses a choice that files of a format do not have; `choices` are those that they may have.
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
        Ok(())
    }

    /// Refuses a choice where there is none: for formats that hold one volume.
    pub(crate) fn refuse_all(&self, path: &Path) -> Result<(), SourceError> {
        self.frame_of(path, 1)?;
        self.channel_of(path, 1)?;
        self.refuse_series(path)?;
        self.refuse_array(path)
    }

    /// Refuses `--series` for what has no series.
    pub(crate) fn refuse_series(&self, path: &Path) -> Result<(), SourceError> {
        if self.series.is_none() {
            return Ok(());
        }
        Err(SourceError::Options(format!(
            "--series: {} is no DICOM or OME-TIFF; only DICOM and OME-TIFF have series",
            path.display()
        )))
    }

    /// Refuses the name of an array for what holds one volume.
    pub(crate) fn refuse_array(&self, path: &Path) -> Result<(), SourceError> {
        let Some(array) = &self.array else { return Ok(()) };
        let what = format!("{} holds no arrays that could be named; leave `:/{array}` out", path.display());
        Err(SourceError::Options(what))
    }
}

/// What follows the name of the file, nothing where nothing was chosen.
impl std::fmt::Display for Selection {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { frame, channel, series, array, level } = self;
        array.iter().try_for_each(|array| write!(f, ":/{array}"))?;
        series.iter().try_for_each(|series| write!(f, " --series {series}"))?;
        frame.iter().try_for_each(|frame| write!(f, " --frame {frame}"))?;
        channel.iter().try_for_each(|channel| write!(f, " --channel {channel}"))?;
        level.iter().try_for_each(|level| write!(f, " --source-level {level}"))
    }
}

fn pick(path: &Path, option: &str, wanted: Option<u64>, count: u64) -> Result<u64, SourceError> {
    let wanted = wanted.unwrap_or(0);
    if wanted < count {
        return Ok(wanted);
    }
    let there = if count == 1 {
        "one, which is number 0".into()
    } else {
        format!("{count}, of which the last is number {}", count - 1)
    };
    Err(SourceError::Options(format!("{option} {wanted}: {} has {there}", path.display())))
}
