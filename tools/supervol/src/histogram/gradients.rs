//! Number of voxels by the length of the gradient: rows of text, or JSON.

use std::io::Write;
use std::path::Path;

use serde_json::json;
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_format::Container;
use supervol_format::cast::whole;
use supervol_preprocess::gradients::Gradients;
use supervol_preprocess::statistics::PERCENTS;

use super::{Arguments, BAR, short};

/// Counts the gradients of a container, and prints them.
pub fn print(path: &Path, container: &Container, arguments: &Arguments) -> Result<(), Failure> {
    let gradients = Gradients::of(container, &|_, _| ()).map_err(|e| with_container(path, e))?;
    let end = gradients.histogram_end();
    let (counts, beyond) = gradients.counts(arguments.rows, end);
    let low = |row: usize| end * row as f64 / arguments.rows as f64;
    let manifest = container.manifest();
    let mut out = supervol_arguments::terminal::stdout();
    if arguments.json {
        let rows: Vec<_> =
            counts.iter().enumerate().map(|(row, count)| json!({"from": low(row), "voxels": count})).collect();
        let percentiles: Vec<_> = PERCENTS.iter().map(|&percent| [percent, gradients.percentile(percent)]).collect();
        let found = json!({
            "gradient": {
                "data_unit": manifest.unit, "world_units": manifest.axes.each_ref().map(|axis| &axis.unit),
                "end": end, "rows": rows, "beyond": beyond,
                "greatest": gradients.greatest, "percentiles": percentiles, "usual_ramp": gradients.usual_ramp(),
                "known_voxels": gradients.known, "flat_voxels": gradients.flat, "unknown_voxels": gradients.unknown,
            }
        });
        return writeln!(out, "{found:#}").map_err(with_output);
    }
    write(&mut out, arguments, (&gradients, &counts, beyond), low).map_err(with_output)
}

fn write(
    out: &mut impl Write,
    arguments: &Arguments,
    (gradients, counts, beyond): (&Gradients, &[u64], u64),
    low: impl Fn(usize) -> f64,
) -> std::io::Result<()> {
    let size = |count: u64| if arguments.linear { count as f64 } else { (count as f64 + 1.0).ln() };
    let longest = counts.iter().map(|&count| size(count)).fold(f64::MIN_POSITIVE, f64::max);
    let scale = if arguments.linear { "counts" } else { "logarithms of counts" };
    writeln!(out, "{:>14}  {:>14}  {scale}; data units per world unit", "|gradient|", "voxels")?;
    for (row, &count) in counts.iter().enumerate() {
        let bar = "#".repeat(whole::<usize>((BAR * size(count) / longest).round()));
        writeln!(out, "{:>14}  {count:>14}  {bar}", short(low(row)))?;
    }
    if beyond > 0 {
        writeln!(out, "{:>14}  {beyond:>14}  steeper, up to {}", "", short(gradients.greatest))?;
    }
    if gradients.unknown > 0 {
        writeln!(out, "{:>14}  {:>14}  unknown beside absent voxels: they show nothing", "", gradients.unknown)?;
    }
    for percent in PERCENTS {
        writeln!(out, "{percent:>13} %  {:>14}", short(gradients.percentile(percent)))?;
    }
    if let Some([from, to]) = gradients.usual_ramp() {
        writeln!(out, "usual ramp: --gradient-opacity {},{}", short(from), short(to))?;
    }
    Ok(())
}
