//! Options for a SEG-Y file whose headers are incomplete or wrong.

use super::samples::SampleFormat;
use crate::{Endian, Message, ReadOption, SourceError};

/// Last byte of a trace header at which a four-byte word can begin.
const LAST_WORD_BYTE: u16 = 237;

/// Options for a SEG-Y file whose headers are incomplete or wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct SegyOptions {
    /// Byte of the trace header, from 1, at which the four-byte inline number begins; 189 by the standard.
    pub inline_byte: u16,
    /// The same for the crossline number; 193 by the standard.
    pub crossline_byte: u16,
    /// Sample format code that overrides bytes 3225-3226. The samples are not checked against it.
    pub format: Option<u16>,
    /// Byte order, if detection from the headers fails.
    pub endian: Option<Endian>,
    /// Samples of each trace; overrides the headers.
    pub samples: Option<u32>,
    /// Sample interval, in ms or in units of depth; overrides the headers.
    pub interval: Option<f64>,
    /// Byte of the trace header, from 1, at which the four-byte source-receiver offset begins; 37 by the standard.
    pub offset_byte: u16,
    /// Selected traces of a pre-stack file, which has several offsets at one place.
    pub offsets: Offsets,
    /// Traces to leave out: ranges of trace numbers, counted from 1, with their last ones.
    pub skip_traces: Vec<[u64; 2]>,
    /// Rule for several traces at one place.
    pub duplicates: Duplicates,
    /// Largest memory for the table of traces, in bytes. A file that needs more is refused.
    pub memory_bytes: u64,
}

/// Traces of a pre-stack file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Offsets {
    /// There must be one trace at each place.
    #[default]
    Single,
    /// The traces with this offset.
    One(i32),
    /// The mean over all offsets.
    Stack,
}

/// Rule for several traces with the same line numbers. A live trace always precedes a dead one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Duplicates {
    /// The file is refused.
    #[default]
    Refuse,
    /// The first of them in the file is read.
    First,
    /// The last of them in the file is read.
    Last,
    /// Their mean is read.
    Mean,
}

impl Duplicates {
    /// Name, as in a command line and in containers.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Refuse => "refuse",
            Self::First => "first",
            Self::Last => "last",
            Self::Mean => "mean",
        }
    }
}

impl Default for SegyOptions {
    fn default() -> Self {
        Self {
            inline_byte: 189,
            crossline_byte: 193,
            format: None,
            endian: None,
            samples: None,
            interval: None,
            offset_byte: 37,
            offsets: Offsets::Single,
            skip_traces: Vec::new(),
            duplicates: Duplicates::Refuse,
            memory_bytes: u64::MAX,
        }
    }
}

impl SegyOptions {
    /// Options that determine the voxel values.
    pub(super) fn describe(&self) -> Vec<(&'static str, String)> {
        let offset = match self.offsets {
            Offsets::Single => None,
            Offsets::One(number) => Some(number.to_string()),
            Offsets::Stack => Some("stack".into()),
        };
        let overruled = [
            ("format", self.format.map(|code| code.to_string())),
            ("endian", self.endian.map(|endian| endian.name().into())),
            ("samples", self.samples.map(|samples| samples.to_string())),
            ("interval", self.interval.map(|interval| interval.to_string())),
            ("offset_byte", offset.is_some().then(|| self.offset_byte.to_string())),
            ("offset", offset),
            ("skip_trace", (!self.skip_traces.is_empty()).then(|| self.said_skips())),
            ("on_duplicate", (self.duplicates != Duplicates::Refuse).then(|| self.duplicates.name().into())),
        ];
        let places = [("il_byte", self.inline_byte.to_string()), ("xl_byte", self.crossline_byte.to_string())];
        places.into_iter().chain(overruled.into_iter().filter_map(|(name, said)| Some((name, said?)))).collect()
    }

    /// Whether a trace, counted from 0, is left out.
    pub(super) fn skips(&self, trace: u64) -> bool {
        self.skip_traces.iter().any(|[first, last]| (*first..=*last).contains(&(trace + 1)))
    }

    /// The traces that are left out, as in a command line.
    fn said_skips(&self) -> String {
        let range =
            |[first, last]: &[u64; 2]| if first == last { first.to_string() } else { format!("{first}-{last}") };
        self.skip_traces.iter().map(range).collect::<Vec<_>>().join(",")
    }

    /// Error for a table of traces that needs more memory than allowed.
    pub(super) fn too_little_memory(&self, needed_bytes: u64) -> SourceError {
        SourceError::Memory {
            what: "the table of traces, which follow no order".into(),
            needed_bytes,
            allowed_bytes: self.memory_bytes,
        }
    }

    /// Refuses options that no file can satisfy.
    pub(super) fn check(&self) -> Result<(), SourceError> {
        let wrong = |option: ReadOption, what: std::fmt::Arguments<'_>| {
            Err(SourceError::options(Message::from(option).text(format_args!(" {what}"))))
        };
        let bytes = [
            (ReadOption::InlineByte, self.inline_byte),
            (ReadOption::CrosslineByte, self.crossline_byte),
            (ReadOption::OffsetByte, self.offset_byte),
        ];
        for (option, byte) in bytes {
            if !(1..=LAST_WORD_BYTE).contains(&byte) {
                let expected = format_args!("{byte}: expected a byte of the trace header from 1 to {LAST_WORD_BYTE}");
                return wrong(option, expected);
            }
        }
        if self.inline_byte == self.crossline_byte {
            let both = Message::from(ReadOption::InlineByte).text(" and ").option(ReadOption::CrosslineByte);
            let what = format_args!(" are both {}: expected two places", self.inline_byte);
            return Err(SourceError::options(both.text(what)));
        }
        if self.samples == Some(0) {
            return wrong(ReadOption::Samples, format_args!("0: expected at least 1"));
        }
        if let Some(interval) = self.interval.filter(|i| !(i.is_finite() && *i > 0.0)) {
            return wrong(ReadOption::Interval, format_args!("{interval}: expected a number above 0"));
        }
        if let Some([first, last]) = self.skip_traces.iter().find(|[first, last]| *first == 0 || first > last) {
            let expected = format_args!("{first}-{last}: expected trace numbers from 1 on, the smaller one first");
            return wrong(ReadOption::SkipTraces, expected);
        }
        match self.format {
            Some(code) if SampleFormat::from_code(code).is_none() => {
                wrong(ReadOption::SampleFormat, format_args!("{code}: expected 1 to 12, 15 or 16"))
            }
            _ => Ok(()),
        }
    }
}
