//! What pictures of the command line and of the viewer share: decorations, and folders of animations ([`frames`]).
//!
//! Decorations are what a person wants to see beside the volume: its box with the ends of its axes, which way it is turned, a scale, what the
//! colours mean, and what it is.
//!
//! Edges of the box that the volume hides are drawn behind it, the others before it, by the opacity of the picture: what lies
//! between is not known, so that an edge inside of something clear looks as if it were behind it.

mod canvas;
pub mod frames;

use glam::DVec3;
use supervol_format::Container;
use supervol_preprocess::source::Survey;
use supervol_runtime::camera::{Camera, Projection};
use supervol_runtime::facts::{Frame, VolumeFacts};
use supervol_runtime::image::Image;
use supervol_runtime::preset::domain_corners;
use supervol_runtime::scene::{Mode, ResolvedScene};
use supervol_runtime::units::Units;

use self::canvas::{Anchor, Canvas, Layer};

/// Pixels between what is drawn and the picture's border.
const MARGIN: i32 = 6;
/// Pixels of the colour bar across, and its share of the picture's height.
const BAR_WIDTH: i32 = 10;
const BAR_SHARE: f64 = 0.4;
/// Greatest share of the picture's width that the scale bar takes.
const SCALE_SHARE: f64 = 0.25;
/// Cosine between a direction of the world and one of the picture from which on the one is written at the other's border.
const ALIGNED: f64 = 0.7;

/// Draws all decorations over a finished picture. `name` is that of one picture among several; it stands below the volume's.
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
    // What is drawn is in units of its own; what is written beside it is not.
    let units = Units::of(facts);
    let placed = &units.facts(facts);
    let mut canvas = Canvas::new(image, scene.background);
    let is_face_on = matches!(camera.projection, Projection::Orthographic { .. });
    if !is_face_on {
        draw_box(&mut canvas, container, (facts, placed), &camera);
    }
    draw_orientation(&mut canvas, container, facts, &camera);
    if let Projection::Orthographic { height } = camera.projection {
        draw_scale(&mut canvas, container, units.length * height / camera.extent[1]);
    }
    if scene.mode != Mode::Iso {
        draw_colors(&mut canvas, container, scene, units.value);
    }
    let source = &container.manifest().source;
    canvas.text(&format!("{}  ({})", source.name, facts.kind.name()), [MARGIN, MARGIN], Anchor::TopLeft);
    if let Some(name) = name {
        canvas.text(name, [MARGIN, MARGIN + canvas::LETTER[1]], Anchor::TopLeft);
    }
}

/// Where a world point lies in the picture, pixels; `None` behind the camera.
fn project(camera: &Camera, point: DVec3) -> Option<[f64; 2]> {
    let p = point - camera.eye;
    let half = match camera.projection {
        Projection::Perspective { fov_y } => p.dot(camera.forward) * (fov_y.to_radians() / 2.0).tan(),
        Projection::Orthographic { height } => height / 2.0,
    };
    let [width, height] = camera.extent;
    let x = p.dot(camera.right) / (half * width / height);
    let y = p.dot(camera.up) / half;
    (half > 0.0).then_some([0.5 * (x + 1.0) * width, 0.5 * (1.0 - y) * height])
}

/// The box of the grid, and the first and last place along each axis.
fn draw_box(
    canvas: &mut Canvas<'_>,
    container: &Container,
    (facts, placed): (&VolumeFacts, &VolumeFacts),
    camera: &Camera,
) {
    let corners = domain_corners(placed);
    let centre = corners.iter().sum::<DVec3>() / 8.0;
    // A face is seen from outside where the camera lies before it: its middle, and the way out of the box.
    let is_seen = |axis: usize, side: usize| {
        let face = (0..8).filter(|c| c >> axis & 1 == side);
        let middle = face.map(|c| corners[c]).sum::<DVec3>() / 4.0;
        let [a, b] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| corners[1 << other] - corners[0]);
        let normal = a.cross(b);
        let outward = if normal.dot(middle - centre) < 0.0 { -normal } else { normal };
        outward.dot(camera.eye - middle) > 0.0
    };
    let seen: [[bool; 2]; 3] = std::array::from_fn(|axis| [is_seen(axis, 0), is_seen(axis, 1)]);
    for axis in 0..3 {
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let mut outline = None;
        for corner in (0..8usize).filter(|corner| corner >> axis & 1 == 0) {
            let faces = [seen[b][corner >> b & 1], seen[c][corner >> c & 1]];
            let layer = if faces == [false, false] { Layer::Behind } else { Layer::Before };
            let ends = [corner, corner | 1 << axis].map(|end| project(camera, corners[end]));
            let [Some(from), Some(to)] = ends else { continue };
            canvas.line(from, to, layer);
            // The lowest edge of the outline has room for words below it.
            let low = from[1] + to[1];
            if faces[0] != faces[1] && outline.is_none_or(|(_, _, lowest)| low > lowest) {
                outline = Some((from, to, low));
            }
        }
        if let Some((from, to, _)) = outline {
            label_edge(canvas, &AxisEnds::of(container, facts, axis), from, to);
        }
    }
}

fn label_edge(canvas: &mut Canvas<'_>, ends: &AxisEnds, from: [f64; 2], to: [f64; 2]) {
    let at = |share: f64| [0, 1].map(|i| (from[i] * (1.0 - share) + to[i] * share).round() as i32);
    let below = |[x, y]: [i32; 2]| [x, y + 2];
    canvas.text(&short(ends.first), below(at(0.06)), Anchor::TopMiddle);
    canvas.text(&ends.name, below(at(0.5)), Anchor::TopMiddle);
    canvas.text(&short(ends.last), below(at(0.94)), Anchor::TopMiddle);
}

/// What the ends of an axis are called: line numbers, times, or lengths from the first voxel on.
struct AxisEnds {
    name: String,
    first: f64,
    last: f64,
}

impl AxisEnds {
    fn of(container: &Container, facts: &VolumeFacts, axis: usize) -> Self {
        let manifest = container.manifest();
        let survey = Survey::of(manifest);
        let steps = facts.dims.0[axis] as f64 - 1.0;
        let named = &manifest.axes[axis];
        let with_unit =
            if named.unit.is_empty() { named.name.clone() } else { format!("{} [{}]", named.name, named.unit) };
        let lines = survey.as_ref().map(|survey| [survey.crossline, survey.inline]);
        match (survey, lines, axis) {
            (Some(survey), _, 2) => {
                let last = survey.first_sample + steps * survey.sample_interval;
                Self { name: with_unit, first: survey.first_sample, last }
            }
            (_, Some(lines), _) => {
                let line = lines[axis.min(1)];
                let first = line.first as f64;
                Self { name: named.name.clone(), first, last: first + steps * line.step as f64 }
            }
            _ => Self { name: with_unit, first: 0.0, last: steps * facts.geometry.spacing[axis] },
        }
    }
}

/// Names of the world's directions, where they have some, at the borders that they point to.
fn draw_orientation(canvas: &mut Canvas<'_>, container: &Container, facts: &VolumeFacts, camera: &Camera) {
    let [width, height] = canvas.size();
    let borders = [
        (camera.right, [width - MARGIN, height / 2], Anchor::MiddleRight),
        (-camera.right, [MARGIN, height / 2], Anchor::MiddleLeft),
        (camera.up, [width / 2, MARGIN], Anchor::TopMiddle),
        (-camera.up, [width / 2, height - MARGIN], Anchor::BottomMiddle),
    ];
    for (way, place, anchor) in borders {
        let named = directions(container, facts);
        let best = named.iter().max_by(|a, b| a.1.dot(way).total_cmp(&b.1.dot(way)));
        if let Some((name, _)) = best.filter(|(_, direction)| direction.dot(way) >= ALIGNED) {
            canvas.text(name, place, anchor);
        }
    }
}

/// Directions of the world that have names: a patient's sides, a survey's points of the compass.
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

/// East and north of the map, in the world of the survey.
fn compass(container: &Container, facts: &VolumeFacts) -> Option<[DVec3; 2]> {
    let survey = Survey::of(container.manifest())?;
    let corners = survey.corners?;
    let [x, y] = [0, 1].map(|k| corners[1][k] - corners[0][k]);
    let length = x.hypot(y);
    if length <= 0.0 || survey.crossline.count < 2 {
        return None;
    }
    // The world's x runs along the crosslines' way, (x, y) on the map; its y is a quarter turn clockwise from that.
    let [east_share, north_share] = [x / length, y / length];
    let along = facts.geometry.linear().x_axis.normalize_or_zero();
    let right_of = DVec3::Z.cross(along);
    Some([east_share * along + north_share * right_of, north_share * along - east_share * right_of])
}

/// A bar of a round length.
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

/// The greatest of 1, 2 and 5 times a power of ten that is not above.
fn round_below(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    [5.0, 2.0, 1.0].into_iter().map(|factor| factor * power).find(|l| *l <= length).unwrap_or(power)
}

/// The colours of the transfer function with the values that they stand for, in units of `value_unit`.
fn draw_colors(canvas: &mut Canvas<'_>, container: &Container, scene: &ResolvedScene, value_unit: f64) {
    // A slice alone is shown in colours of its own, which stand for values unless a filter has made something else of them.
    let slice = scene.slices.first().filter(|_| scene.mode == Mode::Slice);
    if slice.is_some_and(|slice| slice.filter.is_some_and(|filter| !filter.kind.keeps_values())) {
        return;
    }
    let colors = slice.and_then(|slice| slice.colors.as_ref()).unwrap_or(&scene.transfer_function);
    let points = colors.points();
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let (low, high) = (first.value, last.value);
    let [width, height] = canvas.size();
    let rows = (BAR_SHARE * f64::from(height)) as i32;
    let (left, top) = (width - MARGIN - BAR_WIDTH, (height - rows) / 2);
    if rows < 2 || high <= low {
        return;
    }
    // Letters for the right border stand in the middle: the bar leaves that room to them.
    let left = left - 2 * canvas::LETTER[0];
    for row in 0..rows {
        let share = f64::from(row) / f64::from(rows - 1);
        let color = colors.classify(high * (1.0 - share) + low * share).0;
        canvas.row([left, top + row], BAR_WIDTH, color);
    }
    let unit = &container.manifest().unit;
    for (share, value) in [(0.0, high), (0.5, 0.5 * high + 0.5 * low), (1.0, low)] {
        let y = top + (share * f64::from(rows - 1)).round() as i32;
        canvas.text(&short(value * value_unit), [left - 4, y], Anchor::MiddleRight);
    }
    // A long unit would lie across a small picture; `info` says it.
    if 2 * canvas::LETTER[0] * unit.chars().count() as i32 <= width {
        canvas.text(unit, [left + BAR_WIDTH, top - 4], Anchor::BottomRight);
    }
}

/// A number in few digits.
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
