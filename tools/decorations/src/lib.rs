//! Decorations of pictures, and folders of animations ([`frames`]); shared by the command line and the viewer.
//!
//! Decorations are a box with labelled axes (`axes`), orientation, a scale bar, a colour bar, and the volume's name and
//! kind of data.
//!
//! Edges on the far side of the box are drawn behind the volume, the others in front of it, according to the picture's
//! opacity. The picture has no depth, so an edge inside a transparent volume looks as if it were behind it.

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

mod axes;
mod canvas;
pub mod frames;

use glam::DVec3;
use supervol_format::Container;
use supervol_format::cast::whole;
use supervol_format::coordinates::Coordinates;
use supervol_scene::camera::{Camera, Projection};
use supervol_scene::facts::{Frame, VolumeFacts};
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};
use supervol_scene::slices::SliceColors;
use supervol_scene::units::Units;

use self::canvas::{Anchor, Canvas, Layer};

/// Pixels between decorations and the picture's border.
const MARGIN: i32 = 6;
/// Width of the colour bar in pixels, and its height as a share of the picture's height.
const BAR_WIDTH: i32 = 10;
/// Most letters of a number beside the colour bar.
const BAR_LETTERS: i32 = 8;
const BAR_SHARE: f64 = 0.4;
/// Greatest length of the scale bar, as a share of the picture's width.
const SCALE_SHARE: f64 = 0.25;
/// Least cosine between a named world direction and a direction of the picture at which the name is written at that
/// border.
const ALIGNED: f64 = 0.7;
/// Greatest difference from 1 of the cosine between a grid axis and the camera's direction, for a section across that
/// axis.
const FACE_ON: f64 = 1e-9;

/// Draws all decorations over a finished picture. `name` is the name of one picture among several; it is written below
/// the volume's name.
pub fn decorate(
    image: &mut Image,
    container: &Container,
    facts: &VolumeFacts,
    scene: &ResolvedScene,
    name: Option<&str>,
) {
    let camera = Camera {
        width: scene.image_size[0],
        height: scene.image_size[1],
        extent: scene.image_size.map(f64::from),
        ..scene.camera
    };
    // Shapes are drawn in units of the picture; numbers are written in world and data units.
    let units = Units::of(facts);
    let placed = &units.facts(facts);
    let shown = [0, 1, 2].map(|axis| scene.clip.slab_of(placed.dims, axis));
    let mut canvas = Canvas::new(image, scene.background);
    let edges = if shows_box(scene, placed, &camera) {
        axes::draw_box(&mut canvas, placed, shown, &camera)
    } else {
        Vec::new()
    };
    draw_orientation(&mut canvas, container, facts, &camera);
    if let Projection::Orthographic { height } = camera.projection {
        draw_scale(&mut canvas, container, units.length * height / camera.extent[1]);
    }
    let source = &container.manifest().source;
    canvas.text(&format!("{}  ({})", source.name, facts.kind.name()), [MARGIN, MARGIN], Anchor::TopLeft);
    if let Some(name) = name {
        canvas.text(name, [MARGIN, MARGIN + canvas::LETTER[1]], Anchor::TopLeft);
    }
    let coordinates = Coordinates::of(container);
    for edge in &edges {
        edge.label(&mut canvas, &axes::AxisEnds::of(&coordinates.axes()[edge.axis], edge.voxels()));
    }
    // The bar looks for a free place, so it comes last.
    if scene.mode != Mode::Iso {
        draw_colors(&mut canvas, container, scene, units.value);
    }
}

/// Whether the box is drawn. For an oblique section it is not, because it would lie askew behind the section.
fn shows_box(scene: &ResolvedScene, placed: &VolumeFacts, camera: &Camera) -> bool {
    let linear = placed.geometry.linear();
    let is_across = |axis: usize| linear.col(axis).normalize_or_zero().dot(camera.forward).abs() > 1.0 - FACE_ON;
    scene.mode != Mode::Slice || (0..3).any(is_across)
}

/// Names of the world directions at the borders of a picture: right, left, upper, lower. Directions with names are the
/// sides of a patient and the compass directions of a survey. `right` and `up` are the picture's unit vectors in world
/// space.
#[must_use]
pub fn named_borders(container: &Container, facts: &VolumeFacts, [right, up]: [DVec3; 2]) -> [Option<&'static str>; 4] {
    let named = directions(container, facts);
    [right, -right, up, -up].map(|way| {
        let best = named.iter().max_by(|a, b| a.1.dot(way).total_cmp(&b.1.dot(way)));
        best.filter(|(_, direction)| direction.dot(way) >= ALIGNED).map(|(name, _)| *name)
    })
}

/// Draws the names of world directions at the borders that they point to.
fn draw_orientation(canvas: &mut Canvas<'_>, container: &Container, facts: &VolumeFacts, camera: &Camera) {
    let [width, height] = canvas.size();
    let borders = [
        ([width - MARGIN, height / 2], Anchor::MiddleRight),
        ([MARGIN, height / 2], Anchor::MiddleLeft),
        ([width / 2, MARGIN], Anchor::TopMiddle),
        ([width / 2, height - MARGIN], Anchor::BottomMiddle),
    ];
    let names = named_borders(container, facts, [camera.right, camera.up]);
    for (name, (place, anchor)) in names.into_iter().zip(borders) {
        if let Some(name) = name {
            canvas.text(name, place, anchor);
        }
    }
}

/// World directions with names: sides of a patient, compass directions of a survey.
fn directions(container: &Container, facts: &VolumeFacts) -> Vec<(&'static str, DVec3)> {
    let both = |names: [&'static str; 2], way: DVec3| [(names[0], way), (names[1], -way)];
    let patient = |right: DVec3, front: DVec3| {
        [both(["R", "L"], right), both(["A", "P"], front), both(["H", "F"], DVec3::Z)].concat()
    };
    match facts.frame {
        Frame::RightAnteriorSuperior => patient(DVec3::X, DVec3::Y),
        Frame::LeftPosteriorSuperior => patient(DVec3::NEG_X, DVec3::NEG_Y),
        Frame::Survey => compass(container, facts)
            .map_or(Vec::new(), |[east, north]| [both(["E", "W"], east), both(["N", "S"], north)].concat()),
        Frame::Unknown => Vec::new(),
    }
}

/// World directions of east and north of the map, for a survey.
fn compass(container: &Container, facts: &VolumeFacts) -> Option<[DVec3; 2]> {
    let linear = facts.geometry.linear();
    Some(Coordinates::of(container).compass()?.map(|step| (linear * step).normalize_or_zero()))
}

/// Draws a scale bar of a round length.
fn draw_scale(canvas: &mut Canvas<'_>, container: &Container, world_per_pixel: f64) {
    let [width, height] = canvas.size();
    let length = round_below(SCALE_SHARE * f64::from(width) * world_per_pixel);
    let pixels = length / world_per_pixel;
    if !(length.is_finite() && pixels >= 1.0) {
        return;
    }
    let (left, y) = (f64::from(MARGIN), f64::from(height - MARGIN - 2));
    for offset in [0.0, 1.0] {
        canvas.line([left, y - offset], [left + pixels, y - offset], Layer::Before);
    }
    let unit = &container.manifest().axes[0].unit;
    canvas.text(format!("{} {unit}", short(length)).trim(), [MARGIN, height - MARGIN - 6], Anchor::BottomLeft);
}

/// The greatest number of the form 1, 2 or 5 times a power of ten that is at most `length`.
fn round_below(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|factor| factor * power).find(|l| *l <= length).unwrap_or(power)
}

/// A side of the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Left,
    Right,
}

/// Side and first row of a colour bar of this many rows, where bar and numbers cover the fewest pixels of the volume and
/// of other decorations. Of equal places, the one nearest to the middle of the right side.
fn place_of_bar(canvas: &Canvas<'_>, rows: i32) -> (Side, i32) {
    /// Number of places along each side.
    const PLACES: i32 = 9;
    /// Pixels of the volume that a covered text counts for.
    const TEXT: usize = 2000;
    let [width, height] = canvas.size();
    // The letters of the border lie beside the bar.
    let border = MARGIN + 2 * canvas::LETTER[0];
    let across = BAR_WIDTH + BAR_LETTERS * canvas::LETTER[0];
    // The unit above; half a number below.
    let [above, below] = [canvas::LETTER[1] + MARGIN, canvas::LETTER[1] / 2 + 1];
    let (middle, room) = ((height - rows) / 2, (height - rows - above - below).max(0));
    let shifted = (0..PLACES).map(|n| above + n * room / (PLACES - 1));
    let places = std::iter::once(middle).chain(shifted).flat_map(|top| [(Side::Right, top), (Side::Left, top)]);
    let cost = |&(side, top): &(Side, i32)| {
        let left = if side == Side::Right { width - border - across } else { border };
        let (at, size) = ([left, top - above], [across, above + rows + below]);
        let covered = canvas.covered(at, size) + TEXT * canvas.texts_in(at, size);
        (covered, (top - middle).abs(), side == Side::Left)
    };
    places.min_by_key(cost).unwrap_or((Side::Right, middle))
}

/// Draws the colour bar of the transfer function with values in data units; `value_unit` converts into these.
fn draw_colors(canvas: &mut Canvas<'_>, container: &Container, scene: &ResolvedScene, value_unit: f64) {
    // A slice alone has its own colours. With a filter that changes the meaning of values, no bar is drawn.
    let slice = scene.slices.first().filter(|_| scene.mode == Mode::Slice);
    if slice.is_some_and(|slice| slice.filter.is_some_and(|filter| !filter.kind.keeps_values())) {
        return;
    }
    let colors = match slice.and_then(|slice| slice.colors.as_ref()) {
        // Colours of labels have no order.
        Some(SliceColors::Labels { .. }) => return,
        Some(SliceColors::Values(colors)) => colors,
        None => &scene.transfer_function,
    };
    let points = colors.points();
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let (low, high) = (first.value, last.value);
    let [width, height] = canvas.size();
    let rows = whole::<i32>(BAR_SHARE * f64::from(height));
    if rows < 2 || high <= low {
        return;
    }
    let (side, top) = place_of_bar(canvas, rows);
    // Room for the letters at the border, beside which the bar is drawn.
    let border = MARGIN + 2 * canvas::LETTER[0];
    let left = if side == Side::Right { width - border - BAR_WIDTH } else { border };
    for row in 0..rows {
        let share = f64::from(row) / f64::from(rows - 1);
        let color = colors.classify(high * (1.0 - share) + low * share).0;
        canvas.row([left, top + row], BAR_WIDTH, color);
    }
    let unit = &container.manifest().unit;
    for (share, value) in [(0.0, high), (0.5, 0.5 * high + 0.5 * low), (1.0, low)] {
        let y = top + whole::<i32>((share * f64::from(rows - 1)).round());
        let (x, anchor) = match side {
            Side::Right => (left - 4, Anchor::MiddleRight),
            Side::Left => (left + BAR_WIDTH + 4, Anchor::MiddleLeft),
        };
        canvas.text(&short(value * value_unit), [x, y], anchor);
    }
    // A long unit would reach across a small picture; `info` shows it.
    let letters = i32::try_from(unit.chars().count()).unwrap_or(i32::MAX);
    if (2 * canvas::LETTER[0]).saturating_mul(letters) <= width {
        match side {
            Side::Right => canvas.text(unit, [left + BAR_WIDTH, top - 4], Anchor::BottomRight),
            Side::Left => canvas.text(unit, [left, top - 4], Anchor::BottomLeft),
        }
    }
}

/// A number as short text.
fn short(value: f64) -> String {
    let size = value.abs();
    if size != 0.0 && !(1e-3..1e6).contains(&size) {
        return format!("{value:.2e}");
    }
    let digits = if size >= 100.0 || value.fract() == 0.0 { 0 } else { 2 };
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_are_round_and_numbers_short() {
        assert_eq!([round_below(3.7), round_below(0.099), round_below(740.0)], [2.0, 0.05, 500.0]);
        assert_eq!(["0", "1.50", "1480", "2.00e7"], [0.0, 1.5, 1480.3, 2e7].map(short).each_ref().map(String::as_str));
    }
}
