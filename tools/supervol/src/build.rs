//! `supervol build`: builds a container from a volume file.

use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::flags;
use supervol_arguments::input::{Input, is_piped};
use supervol_arguments::progress::Reporter;
use supervol_arguments::quantity::{self, ErrorBound, show_bytes};
use supervol_arguments::source::SourceArguments;
use supervol_arguments::terminal::Format;
use supervol_files::{check_distinct, folder_of};
use supervol_format::BrickLayout;
use supervol_format::cast::whole;
use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::container::manifest::Source;
use supervol_format::readable::counted;
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::naming::container_beside;
use supervol_preprocess::report::BuildReport;
use supervol_preprocess::{BuildError, BuildOptions, Existing, MaxError};
use supervol_scene::facts::DataKind;
use supervol_sources::VolumeSource;
use supervol_sources::formats;
use supervol_sources::open::split_array;

/// Input, output and options of a build.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Volume file, folder of slices, or - for standard input
    #[arg(required_unless_present = "batch", conflicts_with = "batch", long_help = input_help())]
    input: Option<PathBuf>,
    /// Build many volumes into the folder -o: those in a text file (one path a line, - for standard input), or those
    /// in a folder
    ///
    /// The file results.jsonl in that folder gets one line for each volume. If the same command runs again, it builds
    /// the missing containers. It also checks that finished sources and containers are unchanged.
    #[arg(long, value_name = "LIST|DIR")]
    batch: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArguments,
    #[command(flatten)]
    source: SourceArguments,
}

/// Options of every command that writes a container.
#[derive(Debug, Args)]
pub struct OutputArguments {
    /// Container to write [default: NAME.svol beside the input]; with --batch, the folder for the containers
    #[arg(short, long, value_name = "OUT.svol")]
    output: Option<PathBuf>,
    /// Edge of a brick in voxels, without its apron: 16, 32, 64 or 128
    #[arg(long, default_value = "64", value_parser = brick_layout)]
    brick: BrickLayout,
    /// Codec of the bricks; auto selects the smallest result for each brick
    #[arg(long, default_value = "auto", value_enum)]
    codec: CodecName,
    /// Largest allowed error of a voxel: in data units, or in percent of the value range, for example 0.5 or 0.1%
    /// [default: 0]
    ///
    /// Labels always stay exact.
    #[arg(long, value_name = "E|P%", value_parser = quantity::error_bound)]
    max_error: Option<ErrorBound>,
    /// Axes that coarser levels halve; auto selects them from the data
    ///
    /// With auto, averages of float voxels are rounded to the precision that the error bound justifies.
    #[arg(long, default_value = "auto", value_enum)]
    lod_axes: LodAxesName,
    /// Kind of data, if it is not recognised correctly, for example labels; see `render`
    ///
    /// Labels are whole numbers that name objects. Coarser levels hold the most frequent one, and no voxel changes.
    #[arg(long, value_name = "KIND")]
    kind: Option<DataKind>,
    /// How coarser levels combine voxels; auto uses the majority for labels, and the mean for all other data
    #[arg(long, default_value = "auto", value_enum)]
    reduce: ReduceName,
    /// Memory limit, for example 4GiB
    #[arg(long, default_value = "1GiB", value_parser = quantity::bytes)]
    memory: u64,
    /// Number of threads: 1 to 1024 [default: all processors]
    #[arg(long, value_parser = quantity::threads)]
    threads: Option<NonZero<usize>>,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
    /// Print progress and report as JSON lines on standard output
    #[arg(long)]
    json: bool,
}

/// Codecs to choose from. `trimmed` is none of these: rle and zstd use it by themselves if layers of apron repeat.
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

/// Long help of the input, with the formats of the table.
fn input_help() -> String {
    format!(
        "Volume file, folder of slices, or - for standard input\n\n\
         Formats: {}; raw with --dims and --dtype. FILE:/NAME is one of several arrays in a file, FOLDER:/NAME one in \
         a Zarr or N5 folder. Folders: a DICOM series, SEG-Y with one file per line, or pictures (PNG, JPEG, TIFF) in \
         natural order. Standard input is first copied to a temporary file beside the output.",
        formats::titles().collect::<Vec<_>>().join(", ")
    )
}

fn brick_layout(text: &str) -> Result<BrickLayout, String> {
    text.parse().ok().and_then(BrickLayout::new).ok_or_else(|| format!("'{text}': expected 16, 32, 64 or 128"))
}

impl OutputArguments {
    /// Rule for an existing output.
    pub fn existing(&self) -> Existing {
        if self.force { Existing::Replace } else { Existing::Keep }
    }

    /// Required output path; `what` names the expected file in the error message.
    pub fn named(&self, what: &str) -> Result<&Path, Failure> {
        self.output.as_deref().ok_or_else(|| Failure::command(format!("expected {what} to write: add -o")))
    }

    /// Value of `--memory`, bytes.
    pub fn memory_bytes(&self) -> u64 {
        self.memory
    }

    /// Options of the build.
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
            kind: self.kind.map(|kind| kind.name().into()),
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

    /// Form of progress and results.
    pub fn format(&self) -> Format {
        if self.json { Format::Json } else { Format::Text }
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
        let reporter = Reporter::over_bytes(self.format());
        let result = supervol_preprocess::build(source, origin, output, &options, &|progress| reporter.show(progress));
        reporter.finish();
        result
    }

    /// Builds a container from an open source, with progress and a report.
    pub fn build(&self, output: &Path, source: &dyn VolumeSource, origin: Source) -> Result<(), Failure> {
        let report = self.build_at(output, self.existing(), source, origin)?;
        if self.json {
            let mut out = supervol_arguments::terminal::stdout();
            let mut line = serde_json::json!({ "report": report });
            line["report"]["notes"] = report.notes.iter().map(flags::note).collect();
            writeln!(out, "{line}").map_err(with_output)
        } else {
            print(&report, output, &mut supervol_arguments::terminal::remarks()).map_err(with_output)
        }
    }
}

fn print(report: &BuildReport, output: &Path, out: &mut impl Write) -> std::io::Result<()> {
    for note in &report.notes {
        writeln!(out, "note: {}", flags::note(note))?;
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
        show_bytes(whole::<u64>(report.bytes_per_second)),
    )
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { input, batch, output, source } = arguments;
    let Some(input) = input else {
        let batch = batch.as_ref().ok_or_else(|| Failure::command("expected a volume file, or --batch"))?;
        return crate::batch::run(batch, output, source);
    };
    // Decoded copies of compressed inputs go to the folder of the output: its disk has room for a volume.
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
