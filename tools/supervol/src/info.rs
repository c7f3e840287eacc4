//! `supervol info`: what a container holds.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use supervol_format::container::manifest::{AxisName, Json, Source};
use supervol_format::{Container, Lod, ValueRange};
use supervol_preprocess::output::unfinished::{self, Leftover, Writer};
use supervol_preprocess::source::{LineNumbers, Survey};
use supervol_runtime::facts::kind;

use crate::failure::{Failure, with_container, with_output};
use crate::input::{Input, for_each};
use crate::quantity::show_bytes;

/// Which containers.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Containers, - for what standard input gives; or folders, to learn which unfinished files lie in them
    #[arg(value_name = "CONTAINER|FOLDER", required = true)]
    containers: Vec<PathBuf>,
    /// As JSON: an object for each
    #[arg(long)]
    json: bool,
    /// The text header of the SEG-Y file that the container was built from, and nothing else
    #[arg(long, conflicts_with = "json")]
    text_header: bool,
}

/// The JSON that `--json` prints; its keys are a contract.
#[derive(Debug, Serialize)]
struct Info<'a> {
    dims: [u64; 3],
    spacing: [f64; 3],
    origin: [f64; 3],
    direction: [f64; 9],
    left_handed: bool,
    space: &'a str,
    kind: &'static str,
    kind_because: String,
    dtype: &'static str,
    scale: f64,
    offset: f64,
    value_range: Option<[f64; 2]>,
    unit: &'a str,
    axes: &'a [AxisName; 3],
    brick: usize,
    bricks: u64,
    levels: Vec<LevelInfo>,
    nodata: Option<f64>,
    max_error: f64,
    present_voxels: u64,
    percentiles: &'a [[f64; 2]],
    histogram: &'a [u64],
    source: &'a Source,
    tool: &'a str,
    parameters: &'a std::collections::BTreeMap<String, String>,
    survey: Option<serde_json::Value>,
    notes: &'a [String],
    container_bytes: u64,
    format_version: u32,
}

#[derive(Debug, Serialize)]
struct LevelInfo {
    factors: [u32; 3],
    dims: [u64; 3],
    bricks: u64,
    bytes: u64,
    error: f64,
    uniform_bricks: u64,
    absent_bricks: u64,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    for_each(&arguments.containers, |path| {
        if arguments.containers.len() > 1 && !arguments.json {
            writeln!(crate::terminal::stdout(), "file       {}", path.display()).map_err(with_output)?;
        }
        describe(path, arguments)
    })
}

fn describe(path: &Path, arguments: &Arguments) -> Result<(), Failure> {
    if path.is_dir() {
        return list_unfinished(path, arguments.json);
    }
    let input = Input::named(path)?;
    let container = Container::open(input.path()).map_err(|e| with_container(path, e))?;
    if arguments.text_header {
        return print_text_header(path, &container);
    }
    let info = gather(&container).map_err(|e| with_container(path, e))?;
    let mut out = crate::terminal::stdout();
    let printed = if arguments.json {
        serde_json::to_string_pretty(&info).map_err(std::io::Error::other).and_then(|text| writeln!(out, "{text}"))
    } else {
        print(&info, Survey::of(container.manifest()), &mut out)
    };
    printed.map_err(with_output)
}

fn print_text_header(path: &Path, container: &Container) -> Result<(), Failure> {
    let Some(survey) = Survey::of(container.manifest()) else {
        let message = "--text-header: the container was not built from a SEG-Y file";
        return Err(Failure::Command(format!("{}: {message}", path.display())));
    };
    let mut out = crate::terminal::stdout();
    survey.text_header.lines().try_for_each(|line| writeln!(out, "{}", line.trim_end())).map_err(with_output)
}

/// Names what builds and other commands have not finished, or never will.
fn list_unfinished(folder: &Path, json: bool) -> Result<(), Failure> {
    let found =
        unfinished::list(folder).map_err(|e| Failure::Machine(format!("cannot read {}: {e}", folder.display())))?;
    let mut out = crate::terminal::stdout();
    if json {
        let entry = |partial: &Leftover| {
            let (writer, _) = words_for(partial.writer);
            serde_json::json!({ "path": partial.path, "bytes": partial.bytes, "writer": writer })
        };
        let entries: Vec<_> = found.iter().map(entry).collect();
        return writeln!(out, "{:#}", serde_json::json!({ "unfinished": entries })).map_err(with_output);
    }
    if found.is_empty() {
        return writeln!(out, "{}: a folder without unfinished files", folder.display()).map_err(with_output);
    }
    found
        .iter()
        .try_for_each(|partial| {
            let (_, meaning) = words_for(partial.writer);
            writeln!(out, "unfinished {}, {}: {meaning}", partial.path.display(), show_bytes(partial.bytes))
        })
        .map_err(with_output)
}

/// The state of a partial's writer, for programs and for people.
fn words_for(writer: Writer) -> (&'static str, &'static str) {
    match writer {
        Writer::Alive => ("alive", "a command is writing it"),
        Writer::Dead => (
            "dead",
            "its command was ended; the next build to this folder goes on with it if it is the same, else removes it",
        ),
        Writer::Unknown => ("unknown", "whether a command is writing it cannot be told; remove it if none is"),
    }
}

fn gather(container: &Container) -> Result<Info<'_>, supervol_format::container::ContainerError> {
    let descriptor = container.descriptor();
    let manifest = container.manifest();
    let pyramid = container.pyramid();
    let recognised = kind::recognise(container);
    let mut levels = Vec::new();
    for (lod, level) in pyramid.levels().iter().enumerate() {
        let mut info = LevelInfo {
            factors: level.factors,
            dims: level.dims.0,
            bricks: level.brick_count(),
            bytes: 0,
            error: 0.0,
            uniform_bricks: 0,
            absent_bricks: 0,
        };
        for key in pyramid.keys_of(Lod(lod as u8)) {
            let entry = container.entry(key)?;
            info.bytes += entry.record_bytes();
            info.error = info.error.max(entry.error * descriptor.scale.abs());
            info.uniform_bricks += u64::from(entry.uniform);
            info.absent_bricks += u64::from(entry.absent);
        }
        levels.push(info);
    }
    Ok(Info {
        dims: descriptor.dims().0,
        spacing: descriptor.geometry.spacing,
        origin: descriptor.geometry.origin,
        direction: descriptor.geometry.direction,
        left_handed: descriptor.geometry.is_left_handed(),
        space: &manifest.space,
        kind: recognised.kind.name(),
        kind_because: recognised.because,
        dtype: descriptor.voxel_type.name(),
        scale: descriptor.scale,
        offset: descriptor.offset,
        value_range: manifest.value_range.map(|r| [r.min, r.max]),
        unit: &manifest.unit,
        axes: &manifest.axes,
        brick: pyramid.layout().core(),
        bricks: pyramid.brick_count(),
        levels,
        nodata: descriptor.absence.nodata.map(|v| descriptor.value(v)),
        max_error: descriptor.voxel_error() * descriptor.scale.abs(),
        present_voxels: manifest.present_voxels,
        percentiles: &manifest.percentiles,
        histogram: &manifest.histogram,
        source: &manifest.source,
        tool: &manifest.tool,
        parameters: &manifest.parameters,
        survey: manifest.survey.as_ref().map(Json::value),
        notes: &manifest.notes,
        container_bytes: container.file_bytes(),
        format_version: descriptor.version(),
    })
}

fn print(info: &Info<'_>, survey: Option<Survey>, out: &mut impl Write) -> std::io::Result<()> {
    let [nx, ny, nz] = info.dims;
    let axes =
        info.axes.iter().map(|a| if a.unit.is_empty() { a.name.clone() } else { format!("{} ({})", a.name, a.unit) });
    writeln!(out, "volume     {nx} x {ny} x {nz} {} voxels", info.dtype)?;
    writeln!(out, "axes       {}", axes.collect::<Vec<_>>().join(", "))?;
    writeln!(out, "spacing    {:?}, origin {:?}", info.spacing, info.origin)?;
    print_orientation(info, survey, out)?;
    writeln!(out, "kind       {}: {}", info.kind, info.kind_because)?;
    match info.value_range {
        Some([min, max]) => writeln!(out, "values     {} {}", ValueRange { min, max }, info.unit)?,
        None => writeln!(out, "values     none present")?,
    }
    if let Some(nodata) = info.nodata {
        writeln!(out, "no data    {nodata}")?;
    }
    if info.max_error > 0.0 {
        writeln!(out, "accuracy   voxels within {} of the source's", info.max_error)?;
    }
    let total = nx * ny * nz;
    writeln!(out, "present    {} of {total} voxels", info.present_voxels)?;
    writeln!(out, "source     {} ({}, {})", info.source.name, info.source.format, show_bytes(info.source.bytes))?;
    writeln!(
        out,
        "container  {}, bricks of {}, written by {}",
        show_bytes(info.container_bytes),
        info.brick,
        info.tool
    )?;
    for note in info.notes {
        writeln!(out, "note       {note}")?;
    }
    writeln!(
        out,
        "\nlevel  factors        dims                   bricks   uniform    absent         size  error bound"
    )?;
    for (lod, level) in info.levels.iter().enumerate() {
        let [x, y, z] = level.dims;
        writeln!(
            out,
            "{lod:>5}  {:<13}  {:<18}  {:>9} {:>9} {:>9} {:>12}  {:.6}",
            format!("{:?}", level.factors),
            format!("{x} x {y} x {z}"),
            level.bricks,
            level.uniform_bricks,
            level.absent_bricks,
            show_bytes(level.bytes),
            level.error
        )?;
    }
    Ok(())
}

/// Which way the grid lies, and where the survey is.
fn print_orientation(info: &Info<'_>, survey: Option<Survey>, out: &mut impl Write) -> std::io::Result<()> {
    let d = info.direction;
    let axes: Vec<String> = (0..3).map(|a| format!("({}, {}, {})", d[a], d[3 + a], d[6 + a])).collect();
    let hand = if info.left_handed { "left" } else { "right" };
    let space = if info.space.is_empty() { String::new() } else { format!(", world {}", info.space) };
    writeln!(out, "direction  x {}, y {}, z {}: {hand}-handed{space}", axes[0], axes[1], axes[2])?;
    let Some(survey) = survey else { return Ok(()) };
    let lines = |name: &str, lines: LineNumbers| {
        let last = lines.first + lines.step * (lines.count as i64 - 1);
        format!("{name} {} to {last} in steps of {}", lines.first, lines.step)
    };
    writeln!(out, "survey     {}, {}", lines("inlines", survey.inline), lines("crosslines", survey.crossline))?;
    let Some(corners) = survey.corners else { return Ok(()) };
    for (corner, name) in corners.iter().zip(CORNERS) {
        writeln!(out, "corner     {name}: {:.2}, {:.2}", corner[0], corner[1])?;
    }
    if survey.inline.count > 1 && survey.crossline.count > 1 {
        let azimuth = |to: usize| {
            let [east, north] = [0, 1].map(|k| corners[to][k] - corners[0][k]);
            east.atan2(north).to_degrees().rem_euclid(360.0)
        };
        let turn = if info.left_handed { "left" } else { "right" };
        writeln!(
            out,
            "map        crosslines ascend towards {:.1} degrees from north, inlines towards {:.1}: to the {turn} of it",
            azimuth(1),
            azimuth(2)
        )?;
    }
    Ok(())
}

/// Names of a survey's corners, in the order in which they are kept.
const CORNERS: [&str; 4] = [
    "first inline, first crossline",
    "first inline, last crossline",
    "last inline, first crossline",
    "last inline, last crossline",
];
