//! Options for volume files: what a file does not say about itself, or says wrong.
//!
//! Every command that takes a volume file has these options, in the same words. [`SourceArguments::reading`] makes of
//! them what `supervol_sources` is told. Containers need none of them, and commands refuse them there.

use std::path::Path;

use clap::{Args, ValueEnum};
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, Geometry};
use supervol_preprocess::BuildError;
use supervol_preprocess::kept::Reading;
use supervol_sources::formats::nrrd::Outside;
use supervol_sources::formats::raw::RawOptions;
use supervol_sources::formats::segy::{Offsets, SegyOptions};
use supervol_sources::grid::named::NamedSource;
use supervol_sources::grid::placed::{Domain, Placing};
use supervol_sources::input::selection::Selection;
use supervol_sources::open::OpenOptions;
use supervol_sources::{Endian, ReadOption, VolumeSource};

use crate::failure::Failure;
use crate::quantity::{self, Dtype, Offset, Spacing};

/// What a volume file may not say about itself.
#[derive(Debug, Args)]
pub struct SourceArguments {
    #[command(flatten)]
    place: PlaceArguments,
    #[command(flatten)]
    raw: RawArguments,
    #[command(flatten)]
    nrrd: NrrdArguments,
    #[command(flatten)]
    selection: SelectionArguments,
    #[command(flatten)]
    segy: SegyArguments,
}

/// Where the volume lies, for any format.
#[derive(Debug, Args)]
#[command(next_help_heading = "Place, where the file does not say it or says it wrong")]
struct PlaceArguments {
    /// World length between voxels, with units or without: 0.7,0.7,1.2 or 1mm,1mm,2mm
    #[arg(long, value_name = "SX,SY,SZ", value_parser = quantity::spacing)]
    spacing: Option<Spacing>,
    /// World position of the first voxel
    #[arg(long, value_name = "X,Y,Z", value_parser = quantity::triple, allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
    /// Directions of the axes: the rows of a 3x3 matrix, whose columns are the axes'
    #[arg(long, value_name = "D11,D12,...,D33", value_parser = quantity::matrix, allow_hyphen_values = true)]
    direction: Option<[f64; 9]>,
    /// What the third axis of a survey is, where its text header does not say it
    #[arg(long, value_enum)]
    domain: Option<DomainName>,
    /// Unit of the numbers along the axes, of a survey's along its third one: nm, um, mm, cm, m, km, ft, or s, ms, us. Numbers stay
    /// what they are
    #[arg(long, value_name = "UNIT", value_parser = quantity::unit)]
    unit: Option<String>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum DomainName {
    Time,
    Depth,
}

impl PlaceArguments {
    fn placing(&self) -> Option<Placing> {
        let of_spacing = self.spacing.as_ref().map(|s| s.unit.clone()).filter(|unit| !unit.is_empty());
        let placing = Placing {
            spacing: self.spacing.as_ref().map(|s| s.lengths),
            unit: of_spacing,
            axis_unit: self.unit.clone(),
            domain: self.domain.map(|domain| match domain {
                DomainName::Time => Domain::Time,
                DomainName::Depth => Domain::Depth,
            }),
            origin: self.origin,
            direction: self.direction,
        };
        (placing != Placing::default()).then_some(placing)
    }
}

/// Shape of a headerless file.
#[derive(Debug, Args)]
#[command(next_help_heading = "Raw input")]
struct RawArguments {
    /// Voxels along x, y, z: 512,512,300 or 512x512x300
    #[arg(long, value_name = "NX,NY,NZ", value_parser = quantity::dims, requires = "dtype")]
    dims: Option<Dims>,
    /// Voxel type, with byte order: u8, i16be, f32le, uint16, float32, ...
    #[arg(long, value_name = "TYPE", value_parser = quantity::dtype, requires = "dims")]
    dtype: Option<Dtype>,
    /// Bytes before the first voxel, 0 where nothing is said. Of SEG-Y that has not been stacked: the offset whose traces
    /// are read, or `stack` for the mean over all of them
    #[arg(long, value_name = "BYTES|N|stack", value_parser = quantity::offset, allow_hyphen_values = true)]
    offset: Option<Offset>,
    /// Value that means "no data"
    #[arg(long, value_name = "V", requires = "dims", allow_hyphen_values = true)]
    nodata: Option<f64>,
}

/// What is allowed to headers that name data files.
#[derive(Debug, Args)]
#[command(next_help_heading = "NRRD, MetaImage and folders")]
struct NrrdArguments {
    /// Let a header name data files outside its folder, and links of a folder lead out of it; without it, only files
    /// below the folder are read
    #[arg(long)]
    allow_outside: bool,
}

/// Which volume, where the input holds several.
#[derive(Debug, Args)]
#[command(next_help_heading = "Input with several volumes")]
struct SelectionArguments {
    /// Time point, echo, or whatever the file counts its volumes by; the first is 0
    #[arg(long, value_name = "T")]
    frame: Option<u64>,
    /// Channel, component, or colour; the first is 0. Without it, the luminance of colours
    #[arg(long, value_name = "C")]
    channel: Option<u64>,
    /// Level of the input's own pyramid (OME-Zarr, N5); the finest is 0
    #[arg(long, value_name = "N")]
    source_level: Option<u64>,
    /// Number or UID of the DICOM series; all are listed where none is given. Of an OME-TIFF, the number of the series; the first is 0
    #[arg(long, value_name = "N|UID")]
    series: Option<String>,
}

/// What SEG-Y headers may not say, or say wrong.
#[derive(Debug, Args)]
#[command(next_help_heading = "SEG-Y input")]
struct SegyArguments {
    /// Byte of the trace header where the inline number begins
    #[arg(long, default_value_t = 189)]
    il_byte: u16,
    /// Byte of the trace header where the crossline number begins
    #[arg(long, default_value_t = 193)]
    xl_byte: u16,
    /// Sample format code, where the header lies
    #[arg(long, value_name = "N")]
    format: Option<u16>,
    /// Byte order, where it cannot be told
    #[arg(long, value_enum)]
    endian: Option<EndianName>,
    /// Samples of each trace, where the headers say it wrong
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    /// Sample interval in ms, or in units of depth, where the headers say it wrong
    #[arg(long, value_name = "DT")]
    interval: Option<f64>,
    /// Byte of the trace header where the offset from source to receiver begins; with --offset N or --offset stack
    #[arg(long, default_value_t = 37)]
    offset_byte: u16,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EndianName {
    Big,
    Little,
}

impl SourceArguments {
    /// Whether they describe a headerless file.
    pub fn is_raw(&self) -> bool {
        self.raw.dims.is_some()
    }

    /// Opens a volume file of any format that is read; compressed voxels are decoded into a file in `folder`.
    ///
    /// The source itself takes at most `memory_bytes`.
    pub fn open(
        &self,
        input: &Path,
        folder: &Path,
        memory_bytes: u64,
    ) -> Result<(Box<dyn VolumeSource>, Source), Failure> {
        Ok(open(&self.reading(memory_bytes)?, input, folder)?)
    }

    /// How a volume file is read, within so many bytes.
    pub fn reading(&self, memory_bytes: u64) -> Result<Reading, Failure> {
        let raw = match (self.raw.dims, self.raw.dtype) {
            (Some(dims), Some(dtype)) => Some(RawOptions {
                dims,
                voxel_type: dtype.voxel_type,
                endian: dtype.endian,
                header_bytes: self.raw.offset.as_ref().map_or(Ok(0), Offset::bytes)?,
                geometry: Geometry::IDENTITY,
                nodata: self.raw.nodata,
            }),
            _ => None,
        };
        let segy = SegyOptions {
            inline_byte: self.segy.il_byte,
            crossline_byte: self.segy.xl_byte,
            format: self.segy.format,
            samples: self.segy.samples,
            interval: self.segy.interval,
            offset_byte: self.segy.offset_byte,
            offsets: if raw.is_some() {
                Offsets::Single
            } else {
                self.raw.offset.as_ref().map_or(Offsets::Single, Offset::traces)
            },
            memory_bytes,
            endian: self.segy.endian.map(|e| match e {
                EndianName::Big => Endian::Big,
                EndianName::Little => Endian::Little,
            }),
        };
        let outside = if self.nrrd.allow_outside { Outside::Allowed } else { Outside::Refused };
        let SelectionArguments { frame, channel, source_level, series } = &self.selection;
        let (frame, channel, level) = (*frame, *channel, *source_level);
        let selection = Selection { frame, channel, level, series: series.clone(), array: None };
        let options = OpenOptions { raw, outside, segy, selection, ..OpenOptions::default() };
        Ok(Reading { options, placing: self.place.placing() })
    }
}

/// A container says all about itself: what is said of how volume files are read would change nothing.
pub fn refuse_for_container(reading: &Reading, container: &Path) -> Result<(), Failure> {
    if reading.is_default() {
        return Ok(());
    }
    let message = "a container says all about itself: options for volume files change nothing";
    Err(Failure::Command(format!("{}: {message}", container.display())))
}

/// Where no file is named by an option that would name one: what is said of how it is read would change nothing.
pub fn refuse_without_file(reading: &Reading, option: &str) -> Result<(), Failure> {
    if reading.is_default() {
        return Ok(());
    }
    let message = format!("options for volume files say how {option} is read: expected {option} FILE");
    Err(Failure::Command(message))
}

/// The flag of an option of the readers.
pub fn flag(option: ReadOption) -> &'static str {
    match option {
        ReadOption::Dims => "--dims",
        ReadOption::VoxelType => "--dtype",
        ReadOption::HeaderBytes | ReadOption::Offsets => "--offset",
        ReadOption::Frame => "--frame",
        ReadOption::Channel => "--channel",
        ReadOption::Series => "--series",
        ReadOption::Level => "--source-level",
        ReadOption::Outside => "--allow-outside",
        ReadOption::Spacing => "--spacing",
        ReadOption::Domain => "--domain",
        ReadOption::AxisUnit => "--unit",
        ReadOption::MemoryBytes => "--memory",
        ReadOption::SampleFormat => "--format",
        ReadOption::Endian => "--endian",
        ReadOption::Samples => "--samples",
        ReadOption::Interval => "--interval",
        ReadOption::InlineByte => "--il-byte",
        ReadOption::CrosslineByte => "--xl-byte",
        ReadOption::OffsetByte => "--offset-byte",
    }
}

/// Opens a volume file, and says which one it is. Its notes name the flags of the options.
pub fn open(reading: &Reading, input: &Path, folder: &Path) -> Result<(Box<dyn VolumeSource>, Source), BuildError> {
    let source: Box<dyn VolumeSource> = Box::new(NamedSource::new(reading.open(input, folder)?, flag));
    let origin = supervol_preprocess::identify_source(input, &reading.options.selection, source.as_ref())?;
    Ok((source, origin))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[derive(clap::Parser)]
    struct Reader {
        #[command(flatten)]
        source: SourceArguments,
    }

    const OPTIONS: [ReadOption; 20] = [
        ReadOption::Dims,
        ReadOption::VoxelType,
        ReadOption::HeaderBytes,
        ReadOption::Frame,
        ReadOption::Channel,
        ReadOption::Series,
        ReadOption::Level,
        ReadOption::Outside,
        ReadOption::Spacing,
        ReadOption::Domain,
        ReadOption::AxisUnit,
        ReadOption::MemoryBytes,
        ReadOption::SampleFormat,
        ReadOption::Endian,
        ReadOption::Samples,
        ReadOption::Interval,
        ReadOption::InlineByte,
        ReadOption::CrosslineByte,
        ReadOption::OffsetByte,
        ReadOption::Offsets,
    ];

    /// Commands define `--memory` themselves.
    #[test]
    fn each_flag_is_an_argument() {
        let command = Reader::command();
        let known: Vec<&str> = command.get_arguments().filter_map(clap::Arg::get_long).collect();
        for option in OPTIONS {
            let name = flag(option).strip_prefix("--").expect("flags begin with two hyphens");
            assert!(name == "memory" || known.contains(&name), "{option:?}: {name}");
        }
    }
}
