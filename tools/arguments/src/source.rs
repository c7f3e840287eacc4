//! Options for volume files: values that a file does not contain, or contains wrongly.
//!
//! Every command that reads a volume file has these options, in the same words. [`SourceArguments::reading`] converts
//! them to the options of `supervol_sources`. Containers need none of them; commands refuse them for containers.

use std::path::Path;

use clap::{Args, Parser, ValueEnum};
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, Geometry};
use supervol_preprocess::BuildError;
use supervol_preprocess::kept::Reading;
use supervol_sources::formats::nrrd::Outside;
use supervol_sources::formats::raw::RawOptions;
use supervol_sources::formats::segy::{Duplicates, Offsets, SegyOptions};
use supervol_sources::grid::named::NamedSource;
use supervol_sources::grid::nulls::Nulls;
use supervol_sources::grid::placed::{Domain, Placing};
use supervol_sources::input::selection::Selection;
use supervol_sources::input::values::Values;
use supervol_sources::open::OpenOptions;
use supervol_sources::{Endian, ReadOption, VolumeSource};

use crate::failure::Failure;
use crate::quantity::{self, Dtype, Offset, Spacing};

/// Values that a volume file may lack.
#[derive(Debug, Args)]
pub struct SourceArguments {
    #[command(flatten)]
    place: PlaceArguments,
    #[command(flatten)]
    raw: RawArguments,
    #[command(flatten)]
    values: ValueArguments,
    #[command(flatten)]
    nrrd: NrrdArguments,
    #[command(flatten)]
    selection: SelectionArguments,
    #[command(flatten)]
    segy: SegyArguments,
}

/// Position, spacing and orientation, for any format.
#[derive(Debug, Args)]
#[command(next_help_heading = "Position and spacing, if the file lacks them or has wrong ones")]
struct PlaceArguments {
    /// Distance between voxels along x, y and z, with or without units, for example 0.7,0.7,1.2 or 1mm,1mm,2mm
    #[arg(long, value_name = "SX,SY,SZ", value_parser = quantity::spacing)]
    spacing: Option<Spacing>,
    /// World position of the first voxel, in world units
    #[arg(long, value_name = "X,Y,Z", value_parser = quantity::triple, allow_hyphen_values = true)]
    origin: Option<[f64; 3]>,
    /// Directions of the axes: a 3x3 matrix in row order; its columns are the directions of x, y and z
    #[arg(long, value_name = "D11,D12,...,D33", value_parser = quantity::matrix, allow_hyphen_values = true)]
    direction: Option<[f64; 9]>,
    /// Meaning of the third axis of a survey, if the text header does not state it
    #[arg(long, value_enum)]
    domain: Option<DomainName>,
    /// Unit of the axes (of a survey: of its third axis): nm, um, mm, cm, m, km, ft, s, ms or us
    ///
    /// The numbers along the axes stay the same.
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
    /// Number of voxels along x, y and z, for example 512,512,300 or 512x512x300
    #[arg(long, value_name = "NX,NY,NZ", value_parser = quantity::dims, requires = "dtype")]
    dims: Option<Dims>,
    /// Voxel type and byte order, for example u8, i16be, f32le, uint16 or float32; without one, little endian
    #[arg(long, value_name = "TYPE", value_parser = quantity::dtype, requires = "dims")]
    dtype: Option<Dtype>,
    /// Bytes before the first voxel [default: 0]; in unstacked SEG-Y, the offset to read
    ///
    /// For unstacked SEG-Y, N reads the traces of this source-receiver offset. `stack` reads the mean over all
    /// offsets.
    #[arg(long, value_name = "BYTES|N|stack", value_parser = quantity::offset, allow_hyphen_values = true)]
    offset: Option<Offset>,
}

/// Meaning of the numbers in the file.
#[derive(Debug, Args)]
#[command(next_help_heading = "Values, if the file lacks their meaning or has a wrong one")]
struct ValueArguments {
    /// Value of voxels without data, as `info` shows values, for example -999.25
    ///
    /// Voxels of this value are absent: they are not drawn and count in no statistics. Values that the file itself
    /// declares absent stay so.
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    nodata: Option<f64>,
    /// Read numbers as they are stored
    ///
    /// Fill values, valid ranges, scale, offset and unit that the file states are ignored: those of netCDF and Zarr (CF),
    /// GDAL, ImageJ, DICOM, NIfTI and MetaImage.
    #[arg(long)]
    stored_values: bool,
    /// Keep usual nulls as values
    ///
    /// Without this option, a usual null is absent if the file declares no other absent value: 1e30, 1e20, -999.25, -999,
    /// -9999, -32768 and the like. It must be frequent, and farther from all other values than these are from each other.
    /// A note says so.
    #[arg(long)]
    keep_nulls: bool,
}

/// Permissions of headers that name data files.
#[derive(Debug, Args)]
#[command(next_help_heading = "NRRD, MetaImage and folders")]
struct NrrdArguments {
    /// Allow data files outside the folder of the header or of the slices
    ///
    /// By default, a header may only name files below its own folder, and links may not lead out of a folder.
    #[arg(long)]
    allow_outside: bool,
}

/// Selection of one volume of an input that holds several.
#[derive(Debug, Args)]
#[command(next_help_heading = "Input with several volumes")]
struct SelectionArguments {
    /// Time point, echo or other count of volumes in the file, starting at 0
    #[arg(long, value_name = "T")]
    frame: Option<u64>,
    /// Channel, component, colour or segment, starting at 0 [default for colours: their luminance]
    #[arg(long, value_name = "C")]
    channel: Option<u64>,
    /// Level of the pyramid of the input (OME-Zarr, N5); 0 is the finest
    #[arg(long, value_name = "N")]
    source_level: Option<u64>,
    /// Number or UID of the DICOM series; number of the OME-TIFF series, starting at 0
    ///
    /// If a DICOM folder holds several series and none is given, the error message lists them.
    #[arg(long, value_name = "N|UID")]
    series: Option<String>,
    /// Names of the axes of an array (Zarr, N5, HDF5, NumPy), the slowest first, for example z,y,x or t,c,z,y,x
    ///
    /// They override the names in the file. x, y and z are the volume's axes, t is `--frame`, c is `--channel`. Arrays
    /// with axes inline, crossline, and time, depth or samples, in any order, are read as surveys.
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    axes: Vec<String>,
}

/// Values that SEG-Y headers may lack or have wrong.
#[derive(Debug, Args)]
#[command(next_help_heading = "SEG-Y input")]
struct SegyArguments {
    /// First byte of the inline number in the trace header, starting at 1
    #[arg(long, default_value_t = 189)]
    il_byte: u16,
    /// First byte of the crossline number in the trace header, starting at 1
    #[arg(long, default_value_t = 193)]
    xl_byte: u16,
    /// Sample format code, if the header has a wrong one
    #[arg(long, value_name = "N")]
    format: Option<u16>,
    /// Byte order, if it cannot be recognised
    #[arg(long, value_enum)]
    endian: Option<EndianName>,
    /// Number of samples of each trace, if the headers have a wrong one
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    /// Sample interval in ms or in units of depth, if the headers have a wrong one
    #[arg(long, value_name = "DT")]
    interval: Option<f64>,
    /// First byte of the source-receiver offset in the trace header, starting at 1; for --offset N or --offset stack
    #[arg(long, default_value_t = 37)]
    offset_byte: u16,
    /// Traces to leave out, by their numbers in the file from 1 on, for example 81 or 1-12,500
    ///
    /// For padding traces, and traces with wrong line numbers. Error messages name such traces.
    #[arg(long, value_name = "N|N-M,...", value_delimiter = ',', value_parser = quantity::traces)]
    skip_trace: Vec<[u64; 2]>,
    /// Trace to read where several have the same line numbers [default: refuse]
    #[arg(long, value_enum)]
    on_duplicate: Option<OnDuplicate>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum OnDuplicate {
    /// The first in the file
    First,
    /// The last in the file
    Last,
    /// The mean of all of them
    Mean,
    /// None: the file is refused
    Refuse,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum EndianName {
    Big,
    Little,
}

impl SourceArguments {
    /// True if the options describe a headerless file.
    pub fn is_raw(&self) -> bool {
        self.raw.dims.is_some()
    }

    /// Opens a volume file of any supported format. Compressed voxels are decoded into a file in `folder`.
    ///
    /// The source itself uses at most `memory_bytes`.
    ///
    /// # Errors
    /// If `--offset` of a headerless file is no number of bytes, or the file cannot be opened with these options.
    pub fn open(
        &self,
        input: &Path,
        folder: &Path,
        memory_bytes: u64,
    ) -> Result<(Box<dyn VolumeSource>, Source), Failure> {
        Ok(open(&self.reading(memory_bytes)?, input, folder)?)
    }

    /// Options of `supervol_sources`, with a memory limit.
    ///
    /// # Errors
    /// If `--offset` of a headerless file is no number of bytes.
    pub fn reading(&self, memory_bytes: u64) -> Result<Reading, Failure> {
        let raw = match (self.raw.dims, self.raw.dtype) {
            (Some(dims), Some(dtype)) => Some(RawOptions {
                dims,
                voxel_type: dtype.voxel_type,
                endian: dtype.endian,
                header_bytes: self.raw.offset.as_ref().map_or(Ok(0), Offset::bytes)?,
                geometry: Geometry::IDENTITY,
                nodata: self.values.nodata,
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
            skip_traces: self.segy.skip_trace.clone(),
            duplicates: match self.segy.on_duplicate {
                None | Some(OnDuplicate::Refuse) => Duplicates::Refuse,
                Some(OnDuplicate::First) => Duplicates::First,
                Some(OnDuplicate::Last) => Duplicates::Last,
                Some(OnDuplicate::Mean) => Duplicates::Mean,
            },
            memory_bytes,
            endian: self.segy.endian.map(|e| match e {
                EndianName::Big => Endian::Big,
                EndianName::Little => Endian::Little,
            }),
        };
        let outside = if self.nrrd.allow_outside { Outside::Allowed } else { Outside::Refused };
        let SelectionArguments { frame, channel, source_level, series, axes } = &self.selection;
        let (frame, channel, level) = (*frame, *channel, *source_level);
        let selection = Selection { frame, channel, level, series: series.clone(), array: None, axes: axes.clone() };
        let values = if self.values.stored_values { Values::Stored } else { Values::Explained };
        let nodata = self.values.nodata.filter(|_| raw.is_none());
        let nulls = if self.values.keep_nulls { Nulls::Kept } else { Nulls::Hidden };
        let options = OpenOptions { raw, outside, segy, selection, values, nodata, nulls, ..OpenOptions::default() };
        Ok(Reading { options, placing: self.place.placing() })
    }
}

/// Reading options of words of a command line such as `--dims=8,8,8`, for programs with fields for them.
///
/// # Errors
/// In words, if a word is no option, or its value is not valid.
pub fn reading_of_words(words: Vec<String>, memory_bytes: u64) -> Result<Reading, String> {
    #[derive(clap::Parser)]
    #[command(no_binary_name = true)]
    struct Reader {
        #[command(flatten)]
        source: SourceArguments,
    }
    let read = Reader::try_parse_from(words).map_err(|error| {
        // The first paragraph says what is wrong; usage and help are about command lines.
        let words = error.to_string();
        let first = words.split("\n\n").next().unwrap_or_default();
        first.trim_start_matches("error: ").to_owned()
    })?;
    read.source.reading(memory_bytes).map_err(|failure| failure.message().unwrap_or_default().to_owned())
}

/// Refuses options for volume files if the input is a container: they would change nothing.
///
/// # Errors
/// If there are such options.
pub fn refuse_for_container(reading: &Reading, container: &Path) -> Result<(), Failure> {
    if reading.is_default() {
        return Ok(());
    }
    let message =
        "expected a volume file, found a container: remove the options that describe volume files, they change nothing";
    Err(Failure::Command(format!("{}: {message}", container.display())))
}

/// Refuses options for volume files if no option names a volume file: they would change nothing.
///
/// # Errors
/// If there are such options.
pub fn refuse_without_file(reading: &Reading, option: &str) -> Result<(), Failure> {
    if reading.is_default() {
        return Ok(());
    }
    let message = format!("options that describe volume files need a file to describe: expected {option} FILE");
    Err(Failure::Command(message))
}

/// All options of the readers.
pub const OPTIONS: [ReadOption; 26] = [
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
    ReadOption::Nodata,
    ReadOption::Values,
    ReadOption::Nulls,
    ReadOption::Axes,
    ReadOption::SkipTraces,
    ReadOption::Duplicates,
];

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
        ReadOption::Nodata => "--nodata",
        ReadOption::Values => "--stored-values",
        ReadOption::Nulls => "--keep-nulls",
        ReadOption::Axes => "--axes",
        ReadOption::SkipTraces => "--skip-trace",
        ReadOption::Duplicates => "--on-duplicate",
    }
}

/// Opens a volume file. Returns the source and its identity. The notes of the source name the flags of the options.
///
/// # Errors
/// If the file cannot be opened with these options, or its files cannot be read for the identity.
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

    #[test]
    fn fields_are_read_as_the_command_line_is() {
        let words = |words: &[&str]| reading_of_words(words.iter().map(|word| (*word).to_owned()).collect(), 1 << 30);
        let reading = words(&["--dims=4,5,6", "--dtype=u16", "--nodata=-9"]).expect("valid");
        assert_eq!(reading.options.raw.map(|raw| (raw.dims.0, raw.nodata)), Some(([4, 5, 6], Some(-9.0))));
        assert!(words(&[]).expect("no options").is_default());
        let refused = words(&["--dims=4,5", "--dtype=u8"]).expect_err("two numbers");
        assert!(refused.contains("--dims") && !refused.contains("Usage") && !refused.contains("error:"), "{refused}");
        assert!(words(&["--dims=4,5,6"]).expect_err("no type").contains("--dtype"));
    }

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
