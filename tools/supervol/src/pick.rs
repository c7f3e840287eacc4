//! `supervol render --pick X,Y`: prints the point under pixels of the picture, as text or JSON.

use std::io::Write;

use serde_json::{Map, Value, json};
use supervol::Volume;
use supervol_arguments::failure::{Failure, with_output};
use supervol_arguments::terminal::Format;
use supervol_format::cast::whole;
use supervol_format::coordinates::Coordinates;
use supervol_format::readable::Number;
use supervol_runtime::render::options::RenderOptions;
use supervol_runtime::render::renderer::{Picked, PickedOn};
use supervol_scene::scene::Scene;

use crate::picture::with_picture;

/// Digits of a value after the first one.
const SINGLE_DIGITS: f64 = 6.0;
/// Decimal digits of a position, relative to the voxel size.
const PLACE_DIGITS: f64 = 3.0;

/// Prints the points under these pixels of a picture of `scene`: a line or more for each pixel, or a JSON array with an
/// object for each pixel.
pub fn run(
    (volume, scene): (&Volume, &Scene),
    options: &RenderOptions,
    pixels: &[[u32; 2]],
    format: Format,
) -> Result<(), Failure> {
    let mut renderer = volume.renderer(options.clone()).map_err(with_picture)?;
    renderer.set_scene(scene).map_err(with_picture)?;
    let placed = volume.placed_for(scene).map_err(with_picture)?;
    let coordinates = Coordinates::of(placed.container());
    let mut found = Vec::with_capacity(pixels.len());
    for &pixel in pixels {
        let mut picked = renderer.pick(pixel).map_err(with_picture)?;
        let lines = picked.as_mut().map_or_else(Vec::new, |picked| {
            // Without vertical exaggeration, as on axes.
            picked.world = coordinates.world(picked.index);
            lines(picked.index, &coordinates)
        });
        found.push((pixel, picked, lines));
    }
    let written = match format {
        Format::Text => {
            let spacing = placed.facts().geometry.smallest_spacing();
            found.iter().map(|(pixel, picked, lines)| text(*pixel, picked.as_ref(), lines, spacing)).collect()
        }
        Format::Json => {
            let objects: Vec<Value> =
                found.iter().map(|(pixel, picked, lines)| object(*pixel, picked.as_ref(), lines)).collect();
            serde_json::to_string_pretty(&objects).map_err(|e| Failure::Machine(e.to_string()))? + "\n"
        }
    };
    write!(supervol_arguments::terminal::stdout(), "{written}").map_err(with_output)
}

/// Names and coordinates of a point in a survey: lines, time or depth, and the position on the map; else empty.
fn lines(index: [f64; 3], coordinates: &Coordinates) -> Vec<(String, f64)> {
    if !coordinates.are_lines() {
        return Vec::new();
    }
    let axes = coordinates.axes();
    let mut lines: Vec<_> = [1, 0, 2].map(|a: usize| (axes[a].name.clone(), axes[a].place(index[a]))).into();
    if coordinates.map().is_some() {
        let [easting, northing, _] = coordinates.point(index);
        lines.extend([easting, northing].map(|(name, place)| (name.to_owned(), place)));
    }
    lines
}

/// Formats a point with the significant digits: values in single precision, positions to a thousandth of the voxel
/// size `spacing`.
fn text([x, y]: [u32; 2], picked: Option<&Picked>, lines: &[(String, f64)], spacing: f64) -> String {
    let Some(picked) = picked else { return format!("pixel {x},{y}: nothing visible\n") };
    let list = |numbers: [f64; 3], digits: f64| numbers.map(|n| short(n, digits)).join(", ");
    let on = match picked.on {
        PickedOn::Volume => "volume".into(),
        PickedOn::Surface(number) => format!("surface {number}"),
        PickedOn::Extreme => "extreme".into(),
        PickedOn::Slice(number) => format!("slice {number}"),
    };
    let mut text = format!(
        "pixel {x},{y}: {on}\n  value  {}\n  world  {}\n  index  {} (level 0)\n",
        short(picked.value, SINGLE_DIGITS - picked.value.abs().log10().floor()),
        list(picked.world, PLACE_DIGITS - spacing.log10().floor()),
        list(picked.index, PLACE_DIGITS)
    );
    for (name, place) in lines {
        text += &format!("  {name}  {}\n", short(*place, PLACE_DIGITS));
    }
    text
}

/// Formats a number with this number of decimals, without trailing zeros. If there are too many decimals or none,
/// prints the number in full.
fn short(value: f64, digits: f64) -> String {
    if !(1.0..=17.0).contains(&digits) {
        return Number(value).to_string();
    }
    let text = format!("{value:.*}", whole::<usize>(digits));
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// JSON object `{"pixel": [x, y], "picked": null}`, or with the found point and its position in the survey.
fn object(pixel: [u32; 2], picked: Option<&Picked>, lines: &[(String, f64)]) -> Value {
    let mut object = json!({ "pixel": pixel, "picked": picked });
    if !lines.is_empty() {
        object["survey"] = lines.iter().map(|(name, place)| (name.clone(), json!(place))).collect::<Map<_, _>>().into();
    }
    object
}
