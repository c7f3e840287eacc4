//! `supervol info`: description of a container, of a volume file, or of a folder with unfinished files.

mod source;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use serde::Serialize;
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::flags;
use supervol_arguments::input::{Input, for_each};
use supervol_arguments::quantity::show_bytes;
use supervol_arguments::source::{SourceArguments, refuse_for_container};
use supervol_arguments::terminal::Format;
use supervol_files::unfinished;
use supervol_files::unfinished::{Leftover, Writer};
use supervol_format::container::manifest::{AxisName, Central, Json, Source};
use supervol_format::readable::Shortened;
use supervol_format::{Container, Dims, Geometry, ValueRange};
use supervol_preprocess::kept::{Reading, is_container};
use supervol_preprocess::manifest::{rms_kept_of, steps_of};
use supervol_scene::facts::kind;
use supervol_sources::{LineNumbers, Survey};

/// Inputs, and form of their description.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Containers, volume files or folders; - is a container from standard input
    ///
    /// For a folder, the command lists the unfinished files in it. If the folder is a volume, the command describes
    /// this, too.
    #[arg(value_name = "CONTAINER|FILE|FOLDER", required = true)]
    inputs: Vec<PathBuf>,
    /// Print JSON: one object for each input
    #[arg(long)]
    json: bool,
    /// Print only the text header of a SEG-Y file, or of the SEG-Y file that a container was built from
    #[arg(long, conflicts_with = "json")]
    text_header: bool,
    #[command(flatten)]
    source: SourceArguments,
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
    kind_certainty: &'static str,
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
    distinct_values: Option<u64>,
    central: Option<&'a Central>,
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
    /// Share of the amplitudes (RMS) that would remain if the level halved only x, y or z; `None` if not measured.
    rms_kept: Option<[f64; 3]>,
    /// Rounding of averages in data units; `None` if they are as exact as the voxel type.
    rounded_to: Option<f64>,
}

impl Arguments {
    /// Form of the description.
    fn format(&self) -> Format {
        if self.json { Format::Json } else { Format::Text }
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    for_each(&arguments.inputs, |path| {
        if arguments.inputs.len() > 1 && arguments.format() == Format::Text {
            writeln!(supervol_arguments::terminal::stdout(), "file       {}", path.display()).map_err(with_output)?;
        }
        describe(path, arguments)
    })
}

fn describe(path: &Path, arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { text_header, source, .. } = arguments;
    if path.is_dir() {
        return describe_folder(path, arguments);
    }
    let input = Input::named(path)?;
    let reading = source.reading(source::MEMORY_BYTES)?;
    let container = match Container::open(input.path()) {
        Err(_) if !is_container(input.path()) => {
            let described =
                source::Described::of(input.path(), &reading).map_err(|why| unknown_file_error(why, &reading))?;
            return if *text_header {
                print_text_header(path, described.survey())
            } else {
                described.print(arguments.format())
            };
        }
        opened => opened.map_err(|e| with_container(path, e))?,
    };
    refuse_for_container(&reading, path)?;
    let survey = Survey::of(container.manifest());
    if *text_header {
        return print_text_header(path, survey.as_ref());
    }
    let info = gather(&container).map_err(|e| with_container(path, e))?;
    let mut out = supervol_arguments::terminal::stdout();
    let printed = match arguments.format() {
        Format::Text => print(&info, &container, survey.as_ref(), &mut out),
        Format::Json => {
            serde_json::to_string_pretty(&info).map_err(std::io::Error::other).and_then(|text| writeln!(out, "{text}"))
        }
    };
    printed.map_err(with_output)
}

/// Error message for a file that is neither a container nor a volume file.
fn unknown_file_error(no_volume: Failure, reading: &Reading) -> Failure {
    match no_volume {
        Failure::Data(why) | Failure::Command(why) if reading.is_default() => Failure::Data(format!(
            "no Supervol container (`supervol build` makes one from a volume file), and no readable volume file: {why}"
        )),
        other => other,
    }
}

/// Describes the unfinished files of a folder, and the volume in it, if it is one.
fn describe_folder(folder: &Path, arguments: &Arguments) -> Result<(), Failure> {
    let Arguments { text_header, source, .. } = arguments;
    if *text_header {
        return print_text_header(folder, None);
    }
    // Most folders hold no volume, which is no error.
    let described = source::Described::of(folder, &source.reading(source::MEMORY_BYTES)?);
    list_unfinished(folder, arguments.format(), described.as_ref())?;
    match described {
        Ok(described) if arguments.format() == Format::Text => described.print(Format::Text),
        _ => Ok(()),
    }
}

fn print_text_header(path: &Path, survey: Option<&Survey>) -> Result<(), Failure> {
    let Some(survey) = survey else {
        let message = "--text-header: expected a SEG-Y file, or a container that was built from one";
        return Err(Failure::Command(format!("{}: {message}", path.display())));
    };
    let mut out = supervol_arguments::terminal::stdout();
    survey.text_header.lines().try_for_each(|line| writeln!(out, "{}", line.trim_end())).map_err(with_output)
}

/// Lists unfinished files of builds and other commands.
fn list_unfinished(folder: &Path, format: Format, volume: Result<&source::Described, &Failure>) -> Result<(), Failure> {
    let found =
        unfinished::list(folder).map_err(|e| Failure::Machine(format!("cannot read {}: {e}", folder.display())))?;
    let mut out = supervol_arguments::terminal::stdout();
    if format == Format::Json {
        let entry = |partial: &Leftover| {
            let (writer, _) = words_for(partial.writer);
            serde_json::json!({ "path": partial.path, "bytes": partial.bytes, "writer": writer })
        };
        let entries: Vec<_> = found.iter().map(entry).collect();
        let mut object = serde_json::json!({ "unfinished": entries });
        if let Ok(volume) = volume {
            object["volume"] = volume.to_json();
        }
        return writeln!(out, "{object:#}").map_err(with_output);
    }
    if let (true, Err(failure)) = (found.is_empty(), volume) {
        let why = match failure {
            Failure::Data(why) | Failure::Command(why) => format!("no volume and no unfinished files: {why}"),
            _ => "no unfinished files".into(),
        };
        return writeln!(out, "{}: the folder holds {why}", folder.display()).map_err(with_output);
    }
    found
        .iter()
        .try_for_each(|partial| {
            let (_, meaning) = words_for(partial.writer);
            writeln!(out, "unfinished {}, {}: {meaning}", partial.path.display(), show_bytes(partial.bytes))
        })
        .map_err(with_output)
}

/// State of the writer of an unfinished file: for JSON, and as text.
fn words_for(writer: Writer) -> (&'static str, &'static str) {
    match writer {
        Writer::Alive => ("alive", "a running command writes it"),
        Writer::Dead => (
            "dead",
            "its command has ended; the next build to this folder continues it if it is the same build, else removes it",
        ),
        Writer::Unknown => ("unknown", "its command may be running or not; remove the file if no command writes it"),
    }
}

fn gather(container: &Container) -> Result<Info<'_>, supervol_format::container::ContainerError> {
    let descriptor = container.descriptor();
    let manifest = container.manifest();
    let pyramid = container.pyramid();
    let recognised = kind::recognise(container);
    // Both lists start at level 1.
    let rms_kept = rms_kept_of(manifest).unwrap_or_default();
    let steps = steps_of(manifest, descriptor.voxel_type).unwrap_or_default();
    let mut levels = Vec::new();
    for (lod, level) in pyramid.lods().zip(pyramid.levels()) {
        let place = usize::from(lod.0).checked_sub(1);
        let mut info = LevelInfo {
            factors: level.factors,
            dims: level.dims.0,
            bricks: level.brick_count(),
            bytes: 0,
            error: 0.0,
            uniform_bricks: 0,
            absent_bricks: 0,
            rms_kept: place.and_then(|place| rms_kept.get(place).copied()),
            rounded_to: place
                .and_then(|place| steps.get(place).map(|step| step * descriptor.scale.abs()))
                .filter(|&step| step > 0.0),
        };
        for key in pyramid.keys_of(lod) {
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
        kind_certainty: recognised.certainty.name(),
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
        distinct_values: manifest.distribution.as_ref().and_then(|distribution| distribution.distinct_values),
        central: manifest.central(),
        source: &manifest.source,
        tool: &manifest.tool,
        parameters: &manifest.parameters,
        survey: manifest.survey.as_ref().map(Json::value),
        notes: &manifest.notes,
        container_bytes: container.file_bytes(),
        format_version: container.version(),
    })
}

/// Grid and axes of a container or of a volume file.
struct Place<'a> {
    dims: Dims,
    dtype: &'static str,
    /// Names and units.
    axes: [(&'a str, &'a str); 3],
    geometry: &'a Geometry,
    space: &'a str,
    survey: Option<&'a Survey>,
}

impl Place<'_> {
    fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        let [nx, ny, nz] = self.dims.0;
        let axes = self.axes.map(|(name, unit)| if unit.is_empty() { name.into() } else { format!("{name} ({unit})") });
        writeln!(out, "volume     {nx} x {ny} x {nz} {} voxels", self.dtype)?;
        writeln!(out, "axes       {}", axes.join(", "))?;
        let spacing = self.geometry.spacing;
        let origin: [f64; 3] = std::array::from_fn(|a| rounded(self.geometry.origin[a], spacing[a]));
        writeln!(out, "spacing    {:?}, origin {origin:?}", spacing.map(|length| rounded(length, length)))?;
        print_orientation(self, out)
    }
}

fn print(info: &Info<'_>, container: &Container, survey: Option<&Survey>, out: &mut impl Write) -> std::io::Result<()> {
    let place = Place {
        dims: Dims(info.dims),
        dtype: info.dtype,
        axes: info.axes.each_ref().map(|axis| (&*axis.name, &*axis.unit)),
        geometry: &container.descriptor().geometry,
        space: info.space,
        survey,
    };
    place.print(out)?;
    let descriptor = container.descriptor();
    let told = |value: f64| Shortened::data(value, descriptor.voxel_type, [descriptor.scale, descriptor.offset]);
    writeln!(out, "kind       {}: {} ({})", info.kind, info.kind_because, info.kind_certainty)?;
    match info.value_range {
        Some([min, max]) => {
            let [min, max] = [min, max].map(|value| told(value).number());
            writeln!(out, "values     {} {}", ValueRange { min, max }, info.unit)?;
        }
        None => writeln!(out, "values     none: all voxels are absent")?,
    }
    if let Some(nodata) = info.nodata {
        writeln!(out, "no data    {}", told(nodata))?;
    }
    if info.max_error > 0.0 {
        writeln!(out, "accuracy   voxels within {} of the source's", info.max_error)?;
    }
    writeln!(out, "present    {} of {} voxels", info.present_voxels, info.dims.iter().product::<u64>())?;
    writeln!(out, "source     {} ({}, {})", info.source.name, info.source.format, show_bytes(info.source.bytes))?;
    writeln!(
        out,
        "container  {}, bricks of {}, written by {}",
        show_bytes(info.container_bytes),
        info.brick,
        info.tool
    )?;
    for note in info.notes {
        writeln!(out, "note       {}", flags::with_flags(note))?;
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
    print_kept(&info.levels, out)?;
    let rounded = info.levels.iter().enumerate().filter_map(|(lod, level)| Some((lod, level.rounded_to?)));
    for (i, (lod, step)) in rounded.enumerate() {
        if i == 0 {
            writeln!(out, "\naverages are rounded to multiples of")?;
        }
        writeln!(out, "{lod:>5}  {step}")?;
    }
    Ok(())
}

/// Prints the share of amplitudes that halving each axis would keep, if the build measured it.
fn print_kept(levels: &[LevelInfo], out: &mut impl Write) -> std::io::Result<()> {
    let measured = levels.iter().enumerate().filter_map(|(lod, level)| Some((lod, level.rms_kept?)));
    for (i, (lod, [x, y, z])) in measured.enumerate() {
        if i == 0 {
            writeln!(out, "\nshare of amplitudes (RMS) that a level keeps if it halves only x, y, z")?;
        }
        writeln!(out, "{lod:>5}  {x:.3}  {y:.3}  {z:.3}")?;
    }
    Ok(())
}

/// Prints the orientation of the grid and the position of a survey.
fn print_orientation(place: &Place<'_>, out: &mut impl Write) -> std::io::Result<()> {
    let Place { geometry, space, survey, .. } = place;
    let d = geometry.direction;
    let d = d.map(|component| rounded(component, 1.0));
    let axes: Vec<String> = (0..3).map(|a| format!("({}, {}, {})", d[a], d[3 + a], d[6 + a])).collect();
    let hand = if geometry.is_left_handed() { "left" } else { "right" };
    let space = if space.is_empty() { String::new() } else { format!(", world {space}") };
    writeln!(out, "direction  x {}, y {}, z {}: {hand}-handed{space}", axes[0], axes[1], axes[2])?;
    let Some(survey) = survey else { return Ok(()) };
    let lines = |name: &str, lines: LineNumbers| {
        let last = i128::from(lines.first) + i128::from(lines.step) * (i128::from(lines.count) - 1);
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
        writeln!(
            out,
            "map        crossline numbers ascend towards {:.1} degrees from north, inline numbers towards {:.1}, to the {hand}",
            azimuth(1),
            azimuth(2)
        )?;
    }
    Ok(())
}

/// A length or component with the digits that matter: to a millionth of `unit` of a thousand voxels.
fn rounded(value: f64, unit: f64) -> f64 {
    Shortened::along(value, unit / 1000.0).number()
}

/// Names of the corners of a survey, in stored order.
const CORNERS: [&str; 4] = [
    "first inline, first crossline",
    "first inline, last crossline",
    "last inline, first crossline",
    "last inline, last crossline",
];
