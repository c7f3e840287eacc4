//! Positions of default and named cameras.
//!
//! A world frame has a front and an up direction. Default cameras look from the front. Azimuth turns the camera from
//! the front towards the viewer's right; elevation lifts it; both are in degrees. Patients are seen from the front with
//! the head up, surveys with depth downwards, other volumes with z upwards. Sections are seen face on, as usual in
//! their field.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use supervol_format::cast::whole;

use crate::camera::{Camera, unit_vector};
use crate::facts::{DataKind, Frame, VolumeFacts};
use crate::spec::CameraSpec;

/// Default vertical angle of view of a perspective camera, in degrees.
const FOV_Y: f64 = 30.0;
/// Share of the picture that the framed region fills: perspective, and face on.
const FILL: f64 = 0.92;
const FILL_FACE_ON: f64 = 0.96;
/// Default azimuth and elevation in degrees: general, and for patients.
const THREE_QUARTERS: [f64; 2] = [36.253_837, 28.263_1];
const PATIENT: [f64; 2] = [20.0, 10.0];
/// A patient volume that is deeper than wide by at least this factor is seen from the side, for example an animal on
/// its belly.
const LONG: f64 = 1.6;
const LONG_SIDE: [f64; 2] = [65.0, 15.0];

/// Another side is tried if more than the first share of the visible region is hidden. It is taken if the hidden share
/// there is less than the second factor times as much.
const MUCH_HIDDEN: f64 = 0.3;
const UNCOVERED: f64 = 0.6;
/// Least gap between the hiding and the hidden part, as a share of the middle extent. Hollow objects are not counted as
/// hiding.
const WALL_GAP: f64 = 0.1;
/// Lines of sight across the greatest extent.
const WALL_CELLS: f64 = 24.0;
/// Approximate limit of the boxes that are examined; they take some milliseconds.
const WALL_BOXES: usize = 1 << 15;

/// Directions for which a turning camera is fitted.
const TURNS: u32 = 72;

/// World direction, a unit vector, that points up in the default view.
#[must_use]
pub fn upright(facts: &VolumeFacts) -> DVec3 {
    front_and_up(facts).1
}

/// A viewing direction with its up vector, projection and distance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// World direction from the framed region to the camera; a unit vector.
    pub outward: DVec3,
    /// World direction that points up in the picture; not parallel to `outward`.
    pub up: DVec3,
    /// Whether the projection is orthographic, as for sections and maps; otherwise perspective.
    pub is_face_on: bool,
    /// World distance of the camera from the middle of the framed region; `None`: the region just fits.
    pub distance: Option<f64>,
    /// Magnification relative to a region that just fits.
    pub zoom: f64,
}

/// Named viewing directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Direction {
    /// From the front: the face of a patient, the first inlines of a survey.
    Front,
    /// From behind.
    Back,
    /// From the left: a patient's own left, otherwise the viewer's left.
    Left,
    /// From the right.
    Right,
    /// From above.
    Top,
    /// From below.
    Bottom,
    /// Azimuth and elevation, degrees.
    Angles([f64; 2]),
}

impl View {
    /// The default view of a volume.
    #[must_use]
    pub fn of(facts: &VolumeFacts) -> Self {
        if let Some(axis) = facts.section_axis() {
            return Self::section(facts, axis);
        }
        match (facts.frame, facts.kind) {
            // The usual projection of a stack of images: x to the right, y down.
            (Frame::Unknown, DataKind::Fluorescence) => Self::section(facts, 2),
            (frame, _) if frame.is_patient() => Self::from(facts, Direction::Angles(patient_angles(facts))),
            _ => Self::from(facts, Direction::Angles(THREE_QUARTERS)),
        }
    }

    /// The default view of the visible region. In a world frame without a known front, it avoids directions in which a
    /// wall hides the rest. The usual direction is kept unless much is hidden and one or two quarter turns uncover it.
    #[must_use]
    pub fn facing(facts: &VolumeFacts, framed: &Framed) -> Self {
        let usual = Self::of(facts);
        if facts.frame != Frame::Unknown || usual.is_face_on {
            return usual;
        }
        let (_, up) = front_and_up(facts);
        let turned = |quarter: u32| {
            let turn = DQuat::from_axis_angle(up, TAU / 4.0 * f64::from(quarter));
            Self { outward: turn * usual.outward, up: turn * usual.up, ..usual }
        };
        let [_, middle, size] = framed.extents();
        // The middle extent: a long volume must not have wider gaps for its length.
        let hidden = |view: &Self| framed.hidden(view, size, WALL_GAP * middle);
        let by_usual = hidden(&usual);
        if by_usual <= MUCH_HIDDEN {
            return usual;
        }
        let others = (1..4).map(turned).map(|view| (hidden(&view), view));
        let open = others.min_by(|a, b| a.0.total_cmp(&b.0));
        open.filter(|(share, _)| *share <= UNCOVERED * by_usual).map_or(usual, |(_, view)| view)
    }

    /// The view from a direction.
    #[must_use]
    pub fn from(facts: &VolumeFacts, direction: Direction) -> Self {
        let (front, up) = front_and_up(facts);
        // Seen from the front, a patient's left is on the viewer's right.
        let left = if facts.frame.is_patient() { 90.0 } else { -90.0 };
        let [azimuth, elevation] = match direction {
            Direction::Front => [0.0, 0.0],
            Direction::Back => [180.0, 0.0],
            Direction::Left => [left, 0.0],
            Direction::Right => [-left, 0.0],
            Direction::Top => [0.0, 90.0],
            Direction::Bottom => [0.0, -90.0],
            Direction::Angles(angles) => angles,
        };
        let right = up.cross(front);
        let (sin_a, cos_a) = azimuth.to_radians().sin_cos();
        let (sin_e, cos_e) = elevation.to_radians().sin_cos();
        let level = cos_a * front + sin_a * right;
        let outward = (cos_e * level + sin_e * up).normalize();
        let is_face_on = direction == Direction::Top || direction == Direction::Bottom;
        // Straight from above or below, the picture's up direction is north, or points away from the front, as on a map.
        // For patients it points to the front.
        let up = match (cos_e.abs() < 1e-6, facts.frame.is_patient(), facts.north) {
            (false, ..) => up,
            (true, true, _) => level,
            (true, false, Some(north)) if is_face_on => north.into(),
            (true, false, _) => -level * sin_e.signum(),
        };
        Self { outward, up, is_face_on, distance: None, zoom: 1.0 }
    }

    /// The view that shows a plane across an axis of the grid face on.
    #[must_use]
    pub fn section(facts: &VolumeFacts, axis: usize) -> Self {
        let along = axes(facts);
        let (right, up) = match facts.frame {
            // A map, seen from above.
            Frame::Survey if axis == 2 && facts.north.is_some() => {
                let north = facts.north.map_or(along[1], DVec3::from_array);
                (north.cross(front_and_up(facts).1), north)
            }
            Frame::Survey if axis == 2 => (along[0], front_and_up(facts).0 * -1.0),
            Frame::Survey => (along[1 - axis], -along[2]),
            Frame::RightAnteriorSuperior | Frame::LeftPosteriorSuperior => patient_section(facts, along[axis]),
            Frame::Unknown if axis == 2 => (along[0], -along[1]),
            Frame::Unknown => (along[1 - axis], along[2]),
        };
        // In sheared grids, up is made perpendicular to right.
        let up = (up - up.dot(right) * right).try_normalize().unwrap_or_else(|| right.any_orthonormal_vector());
        Self { outward: right.cross(up), up, is_face_on: true, distance: None, zoom: 1.0 }
    }

    /// The camera that just sees all of the framed region, unless distance or zoom is set. `size` is the picture's
    /// width and height in pixels.
    ///
    /// Let (x, y, z) be a point in the camera's frame around the middle. An eye at (cx, cy, -d) has it inside the
    /// picture if `|x - cx| <= k (d + z)` with `k = FILL tan_x`, and likewise for y. Take the greatest `x / k - z` and
    /// `-x / k - z` of all points: cx is k times half their difference, d is half their sum. Orthographic cameras have
    /// no z term.
    #[must_use]
    pub fn camera(&self, framed: &Framed, size: [u32; 2]) -> CameraSpec {
        let ([right, up], slopes) = self.picture_plane(size);
        let [r, l, t, b] = self.reach(framed, size);
        let centre = framed.middle + 0.5 * slopes[0] * (r - l) * right + 0.5 * slopes[1] * (t - b) * up;
        let fits = (0.5 * (r + l)).max(0.5 * (t + b));
        self.looking_at(centre, fits, framed)
    }

    /// The camera that sees all of the framed region from every side while it turns around the region's middle about a
    /// world axis. `size` is in pixels.
    #[must_use]
    pub fn turning_camera(&self, framed: &Framed, size: [u32; 2], axis: DVec3) -> CameraSpec {
        let fits = (0..TURNS).map(|i| {
            let turn = DQuat::from_axis_angle(axis, TAU * f64::from(i) / f64::from(TURNS));
            let turned = Self { outward: turn * self.outward, up: turn * self.up, ..*self };
            turned.reach(framed, size).into_iter().fold(0.0, f64::max)
        });
        self.looking_at(framed.middle, fits.fold(0.0, f64::max), framed)
    }

    /// Right and up vectors of the picture. The factors give half the picture's width and height, per distance or per
    /// half height.
    fn picture_plane(&self, size: [u32; 2]) -> ([DVec3; 2], [f64; 2]) {
        let forward = -self.outward;
        let right = forward.cross(self.up).normalize();
        let slope = if self.is_face_on { FILL_FACE_ON } else { FILL * (FOV_Y.to_radians() / 2.0).tan() };
        ([right, right.cross(forward)], [slope * f64::from(size[0]) / f64::from(size[1]), slope])
    }

    /// Reach of the framed region to the right, left, top and bottom: see [`Self::camera`].
    fn reach(&self, framed: &Framed, size: [u32; 2]) -> [f64; 4] {
        let (across, slopes) = self.picture_plane(size);
        let depth = if self.is_face_on { 0.0 } else { 1.0 };
        let normals = across.map(|across| [1.0, -1.0].map(|side| side * across));
        framed.greatest(std::array::from_fn(|i| normals[i / 2][i % 2] / slopes[i / 2] + depth * self.outward))
    }

    /// The camera that looks at a point from a distance, or with a height, at which the framed region fits.
    fn looking_at(&self, centre: DVec3, fits: f64, framed: &Framed) -> CameraSpec {
        let (fov_y, height, distance) = if self.is_face_on {
            let away = framed.greatest([self.outward; 4])[0].abs();
            (None, Some(2.0 * fits / self.zoom), self.distance.unwrap_or(2.0 * fits + away))
        } else {
            let fov_y = 2.0 * ((FOV_Y.to_radians() / 2.0).tan() / self.zoom).atan().to_degrees();
            (Some(fov_y), None, self.distance.unwrap_or(fits))
        };
        let eye = centre + distance * self.outward;
        let up = self.picture_plane([1; 2]).0[1];
        CameraSpec { eye: eye.to_array(), target: centre.to_array(), up: up.to_array(), fov_y, height }
    }
}

/// The region that a camera shows: equal boxes in world space.
#[derive(Debug, Clone)]
pub struct Framed {
    /// World position near the middle of all boxes.
    middle: DVec3,
    /// Centres of the boxes relative to `middle`.
    centres: Vec<DVec3>,
    /// Vectors of half a box's edges.
    half_edges: [DVec3; 3],
}

impl Framed {
    /// A region of one box in index coordinates.
    #[must_use]
    pub fn whole(facts: &VolumeFacts, [low, high]: [[f64; 3]; 2]) -> Self {
        let middle = DVec3::from_array(std::array::from_fn(|a| 0.5 * low[a] + 0.5 * high[a]));
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * high[a] - 0.5 * low[a]);
        Self::boxes(facts, middle, vec![middle], half)
    }

    /// Boxes around these index points, each extending by `half` to both sides along each axis.
    #[must_use]
    pub fn boxes(facts: &VolumeFacts, middle: DVec3, mut centres: Vec<DVec3>, half: [f64; 3]) -> Self {
        let linear = facts.geometry.linear();
        centres.iter_mut().for_each(|p| *p = linear * (*p - middle));
        let middle = facts.geometry.world_from_index().transform_point3(middle);
        let half_edges = [linear.x_axis * half[0], linear.y_axis * half[1], linear.z_axis * half[2]];
        Self { middle, centres, half_edges }
    }

    /// Edges of the bounding box of all boxes, in ascending order, as world lengths.
    fn extents(&self) -> [f64; 3] {
        let mut extents = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let [high, low, ..] = self.greatest([axis, -axis, axis, -axis]);
            high + low
        });
        extents.sort_by(f64::total_cmp);
        extents
    }

    /// Rays along one edge of a pixel that do not miss this region: more than one if it is thinner than two pixels, yet
    /// long. A region that is small in all directions is far away; it may vanish.
    #[must_use]
    pub fn subgrid_of_thin(&self, camera: &Camera) -> u32 {
        /// Directions in the picture in which the width is measured, over half a turn.
        const DIRECTIONS: u32 = 36;
        /// Rays across the least width, most rays along the edge of a pixel, and least length in pixels.
        const ACROSS: f64 = 2.0;
        const MOST: f64 = 16.0;
        const LONG: f64 = 16.0;
        // At the region's nearest part: beside the camera, nothing is thin.
        let reach = self.half_edges.iter().map(|edge| edge.length()).sum::<f64>();
        let distance = |centre: &DVec3| (self.middle + *centre - camera.eye).length() - reach;
        let nearest = self.centres.iter().map(distance).fold(f64::INFINITY, f64::min);
        let pixel = camera.pixel_size_at(camera.eye + nearest.max(0.0) * camera.forward);
        let width = |turn: u32| {
            let (sin, cos) = (TAU * 0.5 * f64::from(turn) / f64::from(DIRECTIONS)).sin_cos();
            let across = cos * camera.right + sin * camera.up;
            let [one, other, ..] = self.greatest([across, -across, across, -across]);
            (one + other) / pixel
        };
        let widths: Vec<f64> = (0..DIRECTIONS).map(width).collect();
        let (least, longest) = widths.iter().fold((f64::INFINITY, 0.0f64), |(a, b), w| (a.min(*w), b.max(*w)));
        let is_thin = least < 1.0 && longest >= LONG && longest.is_finite() && least > 0.0;
        if is_thin { whole::<u32>((ACROSS / least).ceil().min(MOST)) } else { 1 }
    }

    /// Share of the boxes that lie behind others with a gap of at least `gap` in between. Lines of sight are parallel
    /// and `size / WALL_CELLS` wide.
    fn hidden(&self, view: &View, size: f64, gap: f64) -> f64 {
        let right = view.up.cross(view.outward).normalize();
        let up = view.outward.cross(right);
        let cell = |at: f64| whole::<i64>((at / size * WALL_CELLS).floor());
        let mut lines: BTreeMap<(i64, i64), Vec<f64>> = BTreeMap::new();
        // An odd step, so that even rows are not systematically skipped.
        let step = (self.centres.len() / WALL_BOXES) | 1;
        for centre in self.centres.iter().step_by(step) {
            lines.entry((cell(centre.dot(right)), cell(centre.dot(up)))).or_default().push(-centre.dot(view.outward));
        }
        let behind = |depths: &mut Vec<f64>| {
            depths.sort_by(f64::total_cmp);
            let first = depths.windows(2).position(|pair| pair[1] - pair[0] > gap);
            first.map_or(0, |last| depths.len() - last - 1)
        };
        let hidden: usize = lines.values_mut().map(behind).sum();
        hidden as f64 / self.centres.len().div_ceil(step).max(1) as f64
    }

    /// The maximum of each functional (a scalar product with a vector) over all boxes, relative to the middle.
    fn greatest(&self, functionals: [DVec3; 4]) -> [f64; 4] {
        let mut greatest = [f64::NEG_INFINITY; 4];
        for centre in &self.centres {
            for (most, functional) in greatest.iter_mut().zip(functionals) {
                *most = most.max(centre.dot(functional));
            }
        }
        std::array::from_fn(|i| {
            greatest[i] + self.half_edges.iter().map(|edge| edge.dot(functionals[i]).abs()).sum::<f64>()
        })
    }
}

/// Unit vectors along the grid's axes, in world space.
fn axes(facts: &VolumeFacts) -> [DVec3; 3] {
    let linear = facts.geometry.linear();
    [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| unit_vector(axis).unwrap_or(DVec3::X))
}

/// World directions from the volume to a viewer in front of it, and up. Unit vectors, perpendicular.
fn front_and_up(facts: &VolumeFacts) -> (DVec3, DVec3) {
    let up = match facts.frame {
        Frame::Survey => -axes(facts)[2],
        _ => DVec3::Z,
    };
    let front = match facts.frame {
        Frame::RightAnteriorSuperior => DVec3::Y,
        Frame::LeftPosteriorSuperior => DVec3::NEG_Y,
        // x points to the right, unless x is the vertical axis itself.
        Frame::Survey | Frame::Unknown => {
            let reference = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
            (reference - reference.dot(up) * up).normalize().cross(up)
        }
    };
    (front, up)
}

/// Default azimuth and elevation in a patient's frame: from the front, or almost from the side for long volumes.
fn patient_angles(facts: &VolumeFacts) -> [f64; 2] {
    let linear = facts.geometry.linear();
    let edges: [DVec3; 3] = std::array::from_fn(|a| linear.col(a) * facts.dims.0[a] as f64);
    let extent = |axis: usize| edges.iter().map(|edge| edge[axis].abs()).sum::<f64>();
    if extent(1) >= LONG * extent(0).max(extent(2)) { LONG_SIDE } else { PATIENT }
}

/// Right and up of a section across `across`, in the radiological convention: the patient's right is on the left.
fn patient_section(facts: &VolumeFacts, across: DVec3) -> (DVec3, DVec3) {
    let (front, head) = front_and_up(facts);
    let left = head.cross(front);
    let [sagittal, coronal, axial] = [left, front, head].map(|d| across.dot(d).abs());
    let (right, up) = if axial >= sagittal.max(coronal) {
        (left, front)
    } else if coronal >= sagittal {
        (left, head)
    } else {
        (-front, head)
    };
    // Oblique sections: both vectors are projected into the plane.
    let in_plane = |d: DVec3| (d - d.dot(across) * across).normalize_or(across.any_orthonormal_vector());
    (in_plane(right), in_plane(up))
}

#[cfg(test)]
mod tests;
