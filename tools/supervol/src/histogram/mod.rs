//! `supervol histogram`: number of voxels by value, and the opacity that the default picture gives to each value; or number of
//! voxels by the length of the gradient.

mod drawing;
mod gradients;

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use supervol_arguments::cache::CacheArguments;
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::output::{Force, TextFile};
use supervol_arguments::source::SourceArguments;
use supervol_files::check_distinct;
use supervol_format::Container;
use supervol_format::cast::whole;
use supervol_format::container::manifest::Central;
use supervol_preprocess::{BuildOptions, Existing};
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::Look;
use supervol_scene::transfer_function::TransferFunction;

use self::drawing::Drawing;

/// Characters of the longest bar.
const BAR: f64 = 56.0;
/// Most rows.
const MOST_ROWS: usize = 128;

/// Volume, and form of its histogram.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container or volume file
    ///
    /// For a volume file, a container is built into the cache folder first.
    #[arg(value_name = "CONTAINER|FILE")]
    volume: PathBuf,
    /// Write the histogram as an SVG drawing instead of text
    ///
    /// The drawing has 256 bars in the colours of the default picture. A line shows the opacity. Marks show the 1st,
    /// 50th and 99th percentile.
    #[arg(short, long, value_name = "H.svg", value_parser = svg_file)]
    output: Option<PathBuf>,
    #[command(flatten)]
    force: Force,
    /// Number of rows of the text: 2 to 128; each covers an equal part of the value range
    ///
    /// Values far from all others are outside this range. Their numbers follow below the rows.
    #[arg(long, default_value_t = 32, value_parser = rows, conflicts_with = "output")]
    rows: usize,
    /// Count lengths of the gradient, in data units per world unit, instead of values
    ///
    /// For the numbers of `render --gradient-opacity`: below G0 nothing shows, above G1 all. Rows go up to the 99.9th
    /// percentile. Percentiles follow below the rows. It reads every voxel once.
    #[arg(long, conflicts_with = "output")]
    gradient: bool,
    /// Print the counts as JSON
    #[arg(long, requires = "gradient")]
    json: bool,
    /// Draw bars by count instead of by the logarithm of the count
    #[arg(long)]
    linear: bool,
    /// Kind of data, if it is not recognised correctly; see `render`
    #[arg(long, value_name = "KIND", visible_alias = "preset")]
    kind: Option<DataKind>,
    #[command(flatten)]
    cache: CacheArguments,
    #[command(flatten)]
    source: SourceArguments,
}

fn rows(text: &str) -> Result<usize, String> {
    let rows = text.parse().ok().filter(|n| (2..=MOST_ROWS).contains(n));
    rows.ok_or_else(|| format!("'{text}': expected 2 to {MOST_ROWS} rows"))
}

fn svg_file(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let is_svg = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("svg"));
    if is_svg { Ok(path) } else { Err(format!("'{text}': expected a file name that ends in .svg")) }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let memory_bytes = BuildOptions::default().memory_bytes;
    let reading = arguments.source.reading(memory_bytes)?;
    let path = &arguments.cache.container_of(&arguments.volume, &reading, (None, memory_bytes), None)?;
    let container = Container::open(path).map_err(|e| with_container(path, e))?;
    if arguments.gradient {
        return gradients::print(path, &container, arguments);
    }
    let of_kind = |kind| VolumeFacts::of_kind(&container, kind);
    let facts = arguments.kind.map_or_else(|| VolumeFacts::of(&container), of_kind);
    if facts.histogram.is_empty() {
        return Err(Failure::Data(format!("{}: the container holds no histogram", path.display())));
    }
    let look = Look::of(&facts).transfer_function;
    let shown =
        TransferFunction::new(look.control_points(), look.unit_distance.unwrap_or(1.0)).map_err(Failure::command)?;
    let unit = &container.manifest().unit;
    let Some(output) = &arguments.output else {
        return write(arguments, &facts, container.manifest().central(), (&shown, unit)).map_err(with_output);
    };
    check_distinct(output, [path.as_path(), arguments.volume.as_path()])?;
    let file = TextFile::begin(output, arguments.force.or(Existing::ReplacePicture))?;
    let name = &container.manifest().source.name;
    let drawing = Drawing { name, unit, facts: &facts, shown: &shown, linear: arguments.linear };
    file.write(&drawing.svg().map_err(Failure::Machine)?)?;
    writeln!(supervol_arguments::terminal::remarks(), "{}: kind {}", output.display(), facts.kind.name())
        .map_err(with_output)
}

fn write(
    arguments: &Arguments,
    facts: &VolumeFacts,
    central: Option<&Central>,
    (shown, unit): (&TransferFunction, &str),
) -> std::io::Result<()> {
    let (bins, range) = (facts.histogram.len(), facts.central_range);
    let first_bin = |row: usize| row * bins / arguments.rows;
    let count = |row: usize| facts.histogram[first_bin(row)..first_bin(row + 1)].iter().sum::<u64>();
    let length = |count: u64| if arguments.linear { count as f64 } else { (count as f64 + 1.0).ln() };
    let longest = (0..arguments.rows).map(|row| length(count(row))).fold(f64::MIN_POSITIVE, f64::max);
    let mut out = supervol_arguments::terminal::stdout();
    let scale = if arguments.linear { "counts" } else { "logarithms of counts" };
    writeln!(out, "{:>14}  {:>14}  opacity  {scale}, kind {}", format!("value {unit}"), "voxels", facts.kind.name())?;
    for row in 0..arguments.rows {
        let share = first_bin(row) as f64 / bins as f64;
        let value = range.min * (1.0 - share) + range.max * share;
        let bar = "#".repeat(whole::<usize>((BAR * length(count(row)) / longest).round()));
        let opacity = shown.classify(value).1;
        writeln!(out, "{:>14}  {:>14}  {opacity:>7.3}  {bar}", short(value), count(row))?;
    }
    let Some(central) = central else { return Ok(()) };
    let all = facts.value_range;
    for (count, place, end) in [(central.below, "below", all.min), (central.above, "above", all.max)] {
        if count > 0 {
            writeln!(out, "{:>14}  {count:>14}  far {place} these values, to {}", "", short(end))?;
        }
    }
    Ok(())
}

/// Formats a number with few digits.
fn short(value: f64) -> String {
    if value != 0.0 && !(1e-3..1e7).contains(&value.abs()) { format!("{value:.4e}") } else { format!("{value:.4}") }
}
