//! Box of the visible part of the volume, with labels along its axes: first and last coordinate, and round numbers in
//! between. The visible part is the volume's domain inside the clip box.
//!
//! Each axis is labelled at one of its four edges: the lowest edge of the box's outline (the left one of two equally
//! low edges). There the labels have room. They are on the side of the edge that faces away from the box.

use glam::DVec3;
use supervol_format::cast::whole;
use supervol_format::coordinates::{AxisScale, ScaleKind};
use supervol_scene::camera::{Camera, Projection};
use supervol_scene::facts::VolumeFacts;

use crate::canvas::{Anchor, Canvas, Layer};
use crate::short;

/// Length of a tick, in pixels.
const TICK: f64 = 4.0;
/// Pixels from an edge to the middle of its labels.
const BESIDE: f64 = 8.0;
/// Least distance between ticks, in pixels.
const TICK_ROOM: f64 = 48.0;
/// Possible positions of the axis name, as shares of the edge's length.
const NAME_PLACES: [f64; 3] = [0.5, 0.35, 0.65];
/// Most ticks of an edge.
const TICK_LIMIT: usize = 20;
/// Cosine between a face's normal and the line of sight below which the face is seen edge-on.
const EDGE_ON: f64 = 1e-9;
/// Pixels by which an edge must be lower to count as lower than another one.
const LOWER: f64 = 1.0;

/// An edge of the box with labels.
pub struct LabelledEdge {
    /// The axis parallel to the edge: 0, 1 or 2.
    pub axis: usize,
    /// World positions of both ends.
    ends: [DVec3; 2],
    /// Index coordinates of both ends on the axis.
    range: [f64; 2],
    /// Unit vector in the picture that points away from the box.
    outward: [f64; 2],
    camera: Camera,
}

/// Position of a world point in the picture, in pixels; `None` behind the camera.
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

/// Draws the box of a part of the volume, given by its ranges of index coordinates. Returns the edges to label after
/// everything else is drawn.
pub fn draw_box(
    canvas: &mut Canvas<'_>,
    placed: &VolumeFacts,
    shown: [[f64; 2]; 3],
    camera: &Camera,
) -> Vec<LabelledEdge> {
    let world = placed.geometry.world_from_index();
    let corners: [DVec3; 8] = std::array::from_fn(|corner| {
        world.transform_point3(DVec3::from_array(std::array::from_fn(|axis| shown[axis][corner >> axis & 1])))
    });
    let seen: [[bool; 2]; 3] = std::array::from_fn(|axis| [0, 1].map(|side| is_seen(&corners, camera, axis, side)));
    let middle = project(camera, corners.iter().sum::<DVec3>() / 8.0);
    let mut labelled = Vec::new();
    for axis in 0..3 {
        let [b, c] = [(axis + 1) % 3, (axis + 2) % 3];
        let mut outline: Option<([f64; 2], [DVec3; 2])> = None;
        for corner in (0..8usize).filter(|corner| corner >> axis & 1 == 0) {
            let faces = [seen[b][corner >> b & 1], seen[c][corner >> c & 1]];
            let layer = if faces == [false, false] { Layer::Behind } else { Layer::Before };
            let ends = [corners[corner], corners[corner | 1 << axis]];
            let [Some(from), Some(to)] = ends.map(|end| project(camera, end)) else { continue };
            canvas.line(from, to, layer);
            let at = [0, 1].map(|i| 0.5 * (from[i] + to[i]));
            let is_lower = |before: [f64; 2]| {
                at[1] > before[1] + LOWER || ((at[1] - before[1]).abs() <= LOWER && at[0] < before[0])
            };
            if faces[0] != faces[1] && outline.is_none_or(|(before, _)| is_lower(before)) {
                outline = Some((at, ends));
            }
        }
        if let (Some((at, ends)), Some(middle)) = (outline, middle) {
            let away = [at[0] - middle[0], at[1] - middle[1]];
            let length = away[0].hypot(away[1]).max(f64::MIN_POSITIVE);
            let outward = away.map(|x| x / length);
            labelled.push(LabelledEdge { axis, ends, range: shown[axis], outward, camera: *camera });
        }
    }
    labelled
}

/// Whether the outside of a face of the box is visible.
fn is_seen(corners: &[DVec3; 8], camera: &Camera, axis: usize, side: usize) -> bool {
    let middle_of = |side: usize| (0..8).filter(|c| c >> axis & 1 == side).map(|c| corners[c]).sum::<DVec3>() / 4.0;
    let [a, b] = [(axis + 1) % 3, (axis + 2) % 3].map(|other| corners[1 << other] - corners[0]);
    let (normal, out) = (a.cross(b).normalize_or_zero(), middle_of(side) - middle_of(1 - side));
    let outward = if normal.dot(out) < 0.0 { -normal } else { normal };
    let towards = match camera.projection {
        Projection::Perspective { .. } => (middle_of(side) - camera.eye).normalize_or_zero(),
        Projection::Orthographic { .. } => camera.forward,
    };
    outward.dot(towards) < -EDGE_ON
}

impl LabelledEdge {
    /// Index coordinates of the first and the last voxel of the edge; both are the middle of an edge without a voxel.
    pub fn voxels(&self) -> [f64; 2] {
        let [low, high] = self.range;
        let ends = [low.ceil(), high.floor()].map(|end| end + 0.0);
        if ends[0] <= ends[1] { ends } else { [0.5 * (low + high); 2] }
    }

    /// Position in the picture at a share of the way from the first to the last voxel.
    fn at(&self, share: f64) -> Option<[f64; 2]> {
        let ([low, high], [first, last]) = (self.range, self.voxels());
        let along = (first + share * (last - first) - low) / (high - low);
        project(&self.camera, self.ends[0] + along * (self.ends[1] - self.ends[0]))
    }

    /// Writes the first and the last coordinate, the axis name, and round numbers in between, as far as there is room.
    pub fn label(&self, canvas: &mut Canvas<'_>, ends: &AxisEnds) {
        let (Some(first), Some(last)) = (self.at(0.0), self.at(1.0)) else { return };
        self.write(canvas, first, &short(ends.first));
        if ends.first != ends.last {
            self.write(canvas, last, &short(ends.last));
        }
        // In the middle of the edge, or at another position with room.
        NAME_PLACES.iter().any(|share| self.at(*share).is_some_and(|at| self.write(canvas, at, &ends.name)));
        let pixels = (last[0] - first[0]).hypot(last[1] - first[1]);
        for (value, text) in ends.ticks(pixels) {
            let share = (value - ends.first) / (ends.last - ends.first);
            let Some(at) = self.at(share) else { continue };
            let tip = [0, 1].map(|i| at[i] + TICK * self.outward[i]);
            canvas.line(at, tip, Layer::Before);
            self.write(canvas, at, &text);
        }
    }

    /// Writes a text beside the edge unless another text is there. Returns whether it was written.
    fn write(&self, canvas: &mut Canvas<'_>, at: [f64; 2], text: &str) -> bool {
        let [x, y] = [0, 1].map(|i| whole::<i32>((at[i] + BESIDE * self.outward[i]).round()));
        let anchor = match self.outward {
            [x, y] if x.abs() > y.abs() && x > 0.0 => Anchor::MiddleLeft,
            [x, y] if x.abs() > y.abs() => Anchor::MiddleRight,
            [_, y] if y > 0.0 => Anchor::TopMiddle,
            _ => Anchor::BottomMiddle,
        };
        canvas.text_where_free(text, [x, y], anchor)
    }
}

/// Coordinates of the ends of an axis.
pub struct AxisEnds {
    name: String,
    first: f64,
    last: f64,
    /// Whether only whole numbers are valid coordinates.
    is_counted: bool,
}

impl AxisEnds {
    /// Coordinates of the first and the last voxel along an axis of the grid, whose index coordinates are given.
    pub fn of(scale: &AxisScale, voxels: [f64; 2]) -> Self {
        let AxisScale { name, unit, kind, .. } = scale;
        let name = if unit.is_empty() { name.clone() } else { format!("{name} [{unit}]") };
        let [first, last] = voxels.map(|voxel| scale.place(voxel));
        Self { name, first, last, is_counted: *kind == ScaleKind::Counted }
    }

    /// Round numbers between the ends, and their texts. `pixels`, the length of the edge, limits their density.
    fn ticks(&self, pixels: f64) -> Vec<(f64, String)> {
        let (low, high) = (self.first.min(self.last), self.first.max(self.last));
        let least = (high - low) * TICK_ROOM / pixels;
        let step = round_above(if self.is_counted { least.max(1.0) } else { least });
        if !(step.is_finite() && step > 0.0 && pixels > TICK_ROOM) {
            return Vec::new();
        }
        let digits = whole::<usize>((-step.log10().floor()).clamp(0.0, 12.0));
        let numbers = (0..TICK_LIMIT).map(|n| ((low / step).ceil() + n as f64) * step);
        let within = numbers.take_while(|value| *value <= high);
        within
            .map(|value| (value, if value.abs() < 1e6 { format!("{value:.digits$}") } else { short(value) }))
            .collect()
    }
}

/// The least number of the form 1, 2 or 5 times a power of ten that is at least `length`.
fn round_above(length: f64) -> f64 {
    let power = 10f64.powf(length.log10().floor());
    [1.0, 2.0, 5.0].into_iter().map(|factor| factor * power).find(|l| *l >= length).unwrap_or(10.0 * power)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ticks(first: f64, last: f64, is_counted: bool, pixels: f64) -> Vec<String> {
        let ends = AxisEnds { name: String::new(), first, last, is_counted };
        ends.ticks(pixels).into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_and_have_room() {
        assert_eq!(ticks(111.0, 133.0, true, 300.0), ["115", "120", "125", "130"]);
        assert_eq!(ticks(4.0, 1848.0, false, 200.0), ["500", "1000", "1500"]);
        assert_eq!(ticks(0.0, 0.75, false, 400.0), ["0.0", "0.1", "0.2", "0.3", "0.4", "0.5", "0.6", "0.7"]);
        assert_eq!(ticks(1.0, 3.0, true, 900.0), ["1", "2", "3"]);
        // No ticks: zero length, too little room, or a coordinate that is not finite.
        assert!(ticks(5.0, 5.0, false, 300.0).is_empty() && ticks(0.0, 9.0, false, 30.0).is_empty());
        assert!(ticks(0.0, f64::NAN, false, 300.0).is_empty() && ticks(0.0, 1.0, false, f64::NAN).is_empty());
        let far = ticks(1e9, 1e9 + 100.0, false, 500.0);
        assert!(far.len() <= TICK_LIMIT, "{far:?}");
    }

    #[test]
    fn numbers_are_rounded_up() {
        assert_eq!(
            [round_above(3.7), round_above(0.099), round_above(740.0), round_above(2.0)],
            [5.0, 0.1, 1000.0, 2.0]
        );
    }
}
