//! `supervol build`: a volume file to a container.

use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use supervol_files::{check_distinct, folder_of};
use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::container::manifest::Source;
use supervol_format::readable::counted;
use supervol_format::{BrickLayout, Dims, Geometry};
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::kept::Reading;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::naming::container_beside;
use supervol_preprocess::report::BuildReport;
use supervol_preprocess::{BuildError, BuildOptions, Existing, MaxError};
use supervol_sources::VolumeSource;
use supervol_sources::formats::nrrd::Outside;
use supervol_sources::formats::raw::RawOptions;
use supervol_sources::formats::segy::{Offsets, SegyOptions};
use supervol_sources::grid::placed::{Domain, Placing};
use supervol_sources::input::selection::Selection;
use supervol_sources::open::{OpenOptions, split_array};

use crate::failure::{Failure, with_output};
use crate::input::{Input, is_piped};
use crate::progress::Reporter;
use crate::quantity::{self, Dtype, ErrorBound, Offset, Spacing, show_bytes};

/// What to build, from what, and how.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Volume file: SEG-Y, DICOM, NRRD, NIfTI, MetaImage, VTK, TIFF, npy, npz, or raw with --dims and --dtype; an
    /// OME-Zarr, Zarr or N5 (FOLDER:/NAME is an array in it); or a folder with the slices of one volume: a DICOM series, or
    /// pictures (PNG, JPEG, TIFF) in natural order; or - for what standard input gives, which is kept beside the output meanwhile
    #[arg(required_unless_present = "batch", conflicts_with = "batch")]
    input: Option<PathBuf>,
    /// Build many volumes into the folder -o: those that a text file names, one path a line (- is standard input), or those that
    /// a folder holds. What came of each is a line of results.jsonl there. The same command again builds what is not done,
    /// and checks what is: source and container must be what they were
    #[arg(long, value_name = "LIST|DIR")]
    batch: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArguments,
    #[command(flatten)]
    source: SourceArguments,
}

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

/// What every command that writes a container takes.
#[derive(Debug, Args)]
pub struct OutputArguments {
    /// Container to write; of a volume file, that is NAME.svol beside it where nothing is said. Of several (--batch), the folder that
    /// they go to
    #[arg(short, long, value_name = "OUT.svol")]
    output: Option<PathBuf>,
    /// Core voxels of a brick along each axis: 16, 32, 64 or 128
    #[arg(long, default_value = "64", value_parser = brick_layout)]
    brick: BrickLayout,
    /// How bricks are coded; auto takes what is smallest, brick by brick
    #[arg(long, default_value = "auto", value_enum)]
    codec: CodecName,
    /// Largest error of a voxel, in the data's units or in percent of their range; labels are kept as they are [default: 0]
    #[arg(long, value_name = "E|P%", value_parser = quantity::error_bound)]
    max_error: Option<ErrorBound>,
    /// Axes that coarser levels halve; auto measures the data, and rounds means of floats to what they are worth keeping
    #[arg(long, default_value = "auto", value_enum)]
    lod_axes: LodAxesName,
    /// What stands for several voxels in coarser levels: auto is the majority of labels, the mean of all else
    #[arg(long, default_value = "auto", value_enum)]
    reduce: ReduceName,
    /// Most memory to use
    #[arg(long, default_value = "1GiB", value_parser = quantity::bytes)]
    memory: u64,
    /// Threads; all processors by default
    #[arg(long, value_parser = quantity::threads)]
    threads: Option<NonZero<usize>>,
    /// Overwrite the output
    #[arg(long)]
    force: bool,
    /// Progress and report as JSON lines on standard output
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CodecName {
    Auto,
    Raw,
    Rle,
    Zstd,
    Wavelet,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum ReduceName {
    Auto,
    Mean,
    Max,
    Majority,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LodAxesName {
    Auto,
    Xyz,
    Xy,
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

fn brick_layout(text: &str) -> Result<BrickLayout, String> {
    text.parse().ok().and_then(BrickLayout::new).ok_or_else(|| format!("'{text}': expected 16, 32, 64 or 128"))
}

impl OutputArguments {
    /// What `--force` says about an output that exists.
    pub fn existing(&self) -> Existing {
        if self.force { Existing::Replace } else { Existing::Keep }
    }

    /// Where the output is to go, where somebody must say it; `what` it is to be.
    pub fn named(&self, what: &str) -> Result<&Path, Failure> {
        self.output.as_deref().ok_or_else(|| Failure::command(format!("expected {what} to write to: name it with -o")))
    }

    /// What `--memory` allows.
    pub fn memory_bytes(&self) -> u64 {
        self.memory
    }

    /// How to build.
    pub fn build_options(&self) -> BuildOptions {
        let codec = match self.codec {
            CodecName::Auto => CodecChoice::Smallest,
            CodecName::Raw => CodecChoice::Only(Codec::Raw),
            CodecName::Rle => CodecChoice::Only(Codec::Rle),
            CodecName::Zstd => CodecChoice::Only(Codec::Zstd),
            CodecName::Wavelet => CodecChoice::Only(Codec::Wavelet),
        };
        let max_error = match self.max_error {
            None | Some(ErrorBound::Absolute(0.0) | ErrorBound::Percent(0.0)) => MaxError::Exact,
            Some(ErrorBound::Absolute(error)) => MaxError::Value(error),
            Some(ErrorBound::Percent(percent)) => MaxError::Percent(percent),
        };
        let lod_axes = match self.lod_axes {
            LodAxesName::Auto => LodAxes::Auto,
            LodAxesName::Xyz => LodAxes::Xyz,
            LodAxesName::Xy => LodAxes::Xy,
        };
        let default = BuildOptions::default();
        BuildOptions {
            layout: self.brick,
            codec,
            max_error,
            lod_axes,
            reduce: match self.reduce {
                ReduceName::Auto => None,
                ReduceName::Mean => Some(Reduce::Mean),
                ReduceName::Max => Some(Reduce::Max),
                ReduceName::Majority => Some(Reduce::Majority),
            },
            memory_bytes: self.memory,
            threads: self.threads.map_or(default.threads, NonZero::get),
            existing: self.existing(),
            canceller: default.canceller,
        }
    }

    /// Whether programs read what is said.
    pub fn is_json(&self) -> bool {
        self.json
    }

    /// Builds a container from an open source, with progress.
    pub fn build_at(
        &self,
        output: &Path,
        existing: Existing,
        source: &dyn VolumeSource,
        origin: Source,
    ) -> Result<BuildReport, BuildError> {
        let options = BuildOptions { existing, ..self.build_options() };
        let reporter = Reporter::over_bytes(self.json);
        let result = supervol_preprocess::build(source, origin, output, &options, &|progress| reporter.show(progress));
        reporter.finish();
        result
    }

    /// Builds a container from an open source, with progress and a report.
    pub fn build(&self, output: &Path, source: &dyn VolumeSource, origin: Source) -> Result<(), Failure> {
        let report = self.build_at(output, self.existing(), source, origin)?;
        if self.json {
            let mut out = crate::terminal::stdout();
            writeln!(out, "{}", serde_json::json!({ "report": report })).map_err(with_output)
        } else {
            print(&report, output, &mut crate::terminal::remarks()).map_err(with_output)
        }
    }
}

fn print(report: &BuildReport, output: &Path, out: &mut impl Write) -> std::io::Result<()> {
    for note in &report.notes {
        writeln!(out, "note: {note}")?;
    }
    writeln!(
        out,
        "{}: {} from {} of voxels ({:.1} %), {} in {}, {:.1} s, {}/s",
        output.display(),
        show_bytes(report.container_bytes),
        show_bytes(report.source_bytes),
        100.0 * report.container_bytes as f64 / report.source_bytes as f64,
        counted(report.bricks, "brick"),
        counted(report.levels.len() as u64, "level"),
        report.wall_ms / 1e3,
        show_bytes(report.bytes_per_second as u64),
    )
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
        use supervol_sources::Endian;
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

/// Opens a volume file, and says which one it is.
pub fn open(reading: &Reading, input: &Path, folder: &Path) -> Result<(Box<dyn VolumeSource>, Source), BuildError> {
    let source = reading.open(input, folder)?;
    let origin = supervol_preprocess::identify_source(input, &reading.options.selection, source.as_ref())?;
    Ok((source, origin))
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { input, batch, output, source } = arguments;
    let Some(input) = input else {
        let batch = batch.as_ref().ok_or_else(|| Failure::command("expected a volume file, or --batch"))?;
        return crate::batch::run(batch, output, source);
    };
    // Decoded copies of compressed inputs go where the output goes: that disk has room for a volume.
    let path = match &output.output {
        Some(path) => path.clone(),
        None if is_piped(input) => output.named("a container (OUT.svol)")?.into(),
        None => container_beside(input),
    };
    let folder = folder_of(&path);
    check_distinct(&path, [split_array(input).0.as_path()])?;
    let file = Input::kept_in(input, folder)?;
    let (source, mut origin) = source.open(file.path(), folder, output.memory)?;
    if is_piped(input) {
        origin.name = "standard input".into();
    }
    output.build(&path, source.as_ref(), origin)
}
