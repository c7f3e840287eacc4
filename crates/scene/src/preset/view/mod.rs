//! Where default and named cameras stand.
//!
//! A frame of the world has a front, from which things are looked at unless somebody says otherwise, and an up. Azimuth
//! turns the camera from the front towards the viewer's right, elevation lifts it, both in degrees. Patients are seen
//! from the front, head up; surveys with depth downwards; what says nothing of itself with z upwards. A section is seen
//! face on, as its field prints it.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use glam::{DQuat, DVec3};

use crate::camera::unit_vector;
use crate::facts::{DataKind, Frame, VolumeFacts};
use crate::scene::CameraSpec;

/// Vertical angle of view of cameras that are not asked for another, degrees.
const FOV_Y: f64 = 30.0;
/// Share of the picture that what is framed fills: in perspective, and face on.
const FILL: f64 = 0.92;
const FILL_FACE_ON: f64 = 0.96;
/// Where a camera stands by default, azimuth and elevation in degrees: for anything, and for patients.
const THREE_QUARTERS: [f64; 2] = [36.253_837, 28.263_1];
const PATIENT: [f64; 2] = [20.0, 10.0];
/// What is so many times as deep as it is wide, front to back, is seen from its side: an animal on its belly.
const LONG: f64 = 1.6;
const LONG_SIDE: [f64; 2] = [65.0, 15.0];

/// Share of what can be seen that may lie hidden behind something else before another side is looked for, and by which factor less
/// has to be hidden there.
const MUCH_HIDDEN: f64 = 0.3;
const UNCOVERED: f64 = 0.6;
/// Share of the middle extent that lies empty between what hides and what is hidden: hollow things hide nothing of interest.
const WALL_GAP: f64 = 0.1;
/// Lines of sight along the extent.
const WALL_CELLS: f64 = 24.0;
/// About as many boxes are looked at, at most: some milliseconds.
const WALL_BOXES: usize = 1 << 15;

/// Directions in which a camera that goes around is to see everything.
const TURNS: u32 = 72;

/// World direction that is upright in the default view: a unit vector.
#[must_use]
pub fn upright(facts: &VolumeFacts) -> DVec3 {
    front_and_up(facts).1
}

/// A direction to look from, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// World direction from what is shown to the camera; a unit vector.
    pub outward: DVec3,
    /// World direction that is up in the picture; not parallel to `outward`.
    pub up: DVec3,
    /// Parallel rays, for sections and maps; otherwise perspective.
    pub is_face_on: bool,
    /// World distance from the middle of what is shown; `None`: so that all of it is seen.
    pub distance: Option<f64>,
    /// How many times as large as all of it fits.
    pub zoom: f64,
}

/// Named directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Direction {
    /// From the front: a patient's face, a survey's side of the first inlines.
    Front,
    /// From behind.
    Back,
    /// From the left: a patient's own left, else the viewer's.
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
            // As a stack of images is projected: x to the right, y down.
            (Frame::Unknown, DataKind::Fluorescence) => Self::section(facts, 2),
            (frame, _) if frame.is_patient() => Self::from(facts, Direction::Angles(patient_angles(facts))),
            _ => Self::from(facts, Direction::Angles(THREE_QUARTERS)),
        }
    }

    /// The default view of what can be seen of a volume. Where nothing says which side is the front, one from which no wall hides the
    /// rest: the usual direction, unless much lies hidden and a quarter turn or two uncover it.
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
        // A volume that is long in one direction has no wider gaps for that.
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
        // A patient's left is at the right of who looks at the face.
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
        // Straight from above or below, up is away from the front as on a map; a patient's front is up.
        let up = match (cos_e.abs() < 1e-6, facts.frame.is_patient()) {
            (false, _) => up,
            (true, true) => level,
            (true, false) => -level * sin_e.signum(),
        };
        let is_face_on = direction == Direction::Top || direction == Direction::Bottom;
        Self { outward, up, is_face_on, distance: None, zoom: 1.0 }
    }

    /// The view that shows a plane across an axis of the grid face on.
    #[must_use]
    pub fn section(facts: &VolumeFacts, axis: usize) -> Self {
        let along = axes(facts);
        let (right, up) = match facts.frame {
            Frame::Survey if axis == 2 => (along[0], front_and_up(facts).0 * -1.0),
            Frame::Survey => (along[1 - axis], -along[2]),
            Frame::RightAnteriorSuperior | Frame::LeftPosteriorSuperior => patient_section(facts, along[axis]),
            Frame::Unknown if axis == 2 => (along[0], -along[1]),
            Frame::Unknown => (along[1 - axis], along[2]),
        };
        // Sheared grids: up is made perpendicular to right.
        let up = (up - up.dot(right) * right).try_normalize().unwrap_or_else(|| right.any_orthonormal_vector());
        Self { outward: right.cross(up), up, is_face_on: true, distance: None, zoom: 1.0 }
    }

    /// The camera of a picture of `size` pixels that just sees all of what is framed, unless distance or zoom say otherwise.
    ///
    /// Let (x, y, z) be a point in the camera's frame around the middle. An eye at (cx, cy, -d) has it inside the picture where
    /// `|x - cx| <= k (d + z)` with `k = FILL tan_x`, and likewise y. So the greatest `x / k - z` and `-x / k - z` of all points
    /// say where the eye has to be: cx is k times half their difference, d half their sum. Parallel rays have no z in it.
    #[must_use]
    pub fn camera(&self, framed: &Framed, size: [u32; 2]) -> CameraSpec {
        let ([right, up], slopes) = self.picture_plane(size);
        let [r, l, t, b] = self.reach(framed, size);
        let centre = framed.middle + 0.5 * slopes[0] * (r - l) * right + 0.5 * slopes[1] * (t - b) * up;
        let fits = (0.5 * (r + l)).max(0.5 * (t + b));
        self.looking_at(centre, fits, framed)
    }

    /// The camera of a picture of `size` pixels that sees all of what is framed from every side, when it goes around the middle
    /// of that about a world axis.
    #[must_use]
    pub fn turning_camera(&self, framed: &Framed, size: [u32; 2], axis: DVec3) -> CameraSpec {
        let fits = (0..TURNS).map(|i| {
            let turn = DQuat::from_axis_angle(axis, TAU * f64::from(i) / f64::from(TURNS));
            let turned = Self { outward: turn * self.outward, up: turn * self.up, ..*self };
            turned.reach(framed, size).into_iter().fold(0.0, f64::max)
        });
        self.looking_at(framed.middle, fits.fold(0.0, f64::max), framed)
    }

    /// Right and up in the picture, and by how much of the distance, or of the half height, the picture reaches along them.
    fn picture_plane(&self, size: [u32; 2]) -> ([DVec3; 2], [f64; 2]) {
        let forward = -self.outward;
        let right = forward.cross(self.up).normalize();
        let slope = if self.is_face_on { FILL_FACE_ON } else { FILL * (FOV_Y.to_radians() / 2.0).tan() };
        ([right, right.cross(forward)], [slope * f64::from(size[0]) / f64::from(size[1]), slope])
    }

    /// How far what is framed reaches to the right, left, top and bottom: see [`Self::camera`].
    fn reach(&self, framed: &Framed, size: [u32; 2]) -> [f64; 4] {
        let (across, slopes) = self.picture_plane(size);
        let depth = if self.is_face_on { 0.0 } else { 1.0 };
        let normals = across.map(|across| [1.0, -1.0].map(|side| side * across));
        framed.greatest(std::array::from_fn(|i| normals[i / 2][i % 2] / slopes[i / 2] + depth * self.outward))
    }

    /// The camera that looks at a point, so far away, or with so much height, that what is framed fits.
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

/// What a camera has in its picture: boxes of one size, in world space.
#[derive(Debug, Clone)]
pub struct Framed {
    /// A point in the midst of them.
    middle: DVec3,
    /// The boxes' centres, relative to it.
    centres: Vec<DVec3>,
    /// Half the boxes' edges.
    half_edges: [DVec3; 3],
}

impl Framed {
    /// One box in index coordinates.
    #[must_use]
    pub fn whole(facts: &VolumeFacts, [low, high]: [[f64; 3]; 2]) -> Self {
        let middle = DVec3::from_array(std::array::from_fn(|a| 0.5 * low[a] + 0.5 * high[a]));
        let half: [f64; 3] = std::array::from_fn(|a| 0.5 * high[a] - 0.5 * low[a]);
        Self::boxes(facts, middle, vec![middle], half)
    }

    /// Boxes around these index points, each reaching `half` to both sides of its own.
    #[must_use]
    pub fn boxes(facts: &VolumeFacts, middle: DVec3, mut centres: Vec<DVec3>, half: [f64; 3]) -> Self {
        let linear = facts.geometry.linear();
        centres.iter_mut().for_each(|p| *p = linear * (*p - middle));
        let middle = facts.geometry.world_from_index().transform_point3(middle);
        let half_edges = [linear.x_axis * half[0], linear.y_axis * half[1], linear.z_axis * half[2]];
        Self { middle, centres, half_edges }
    }

    /// Sides of the box around the boxes, the shortest first.
    fn extents(&self) -> [f64; 3] {
        let mut extents = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let [high, low, ..] = self.greatest([axis, -axis, axis, -axis]);
            high + low
        });
        extents.sort_by(f64::total_cmp);
        extents
    }

    /// Share of the boxes that lie behind others and behind a gap of at least `gap`, by parallel rays of `size / WALL_CELLS` across.
    fn hidden(&self, view: &View, size: f64, gap: f64) -> f64 {
        let right = view.up.cross(view.outward).normalize();
        let up = view.outward.cross(right);
        let cell = |at: f64| (at / size * WALL_CELLS).floor() as i64;
        let mut lines: BTreeMap<(i64, i64), Vec<f64>> = BTreeMap::new();
        // An odd step: neither every row nor every other one is passed over.
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

    /// The greatest value that each of these has on all boxes, relative to the middle.
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

/// Unit vectors along the grid's axes, world space.
fn axes(facts: &VolumeFacts) -> [DVec3; 3] {
    let linear = facts.geometry.linear();
    [linear.x_axis, linear.y_axis, linear.z_axis].map(|axis| unit_vector(axis).unwrap_or(DVec3::X))
}

/// World directions: from the volume to who looks at it from the front, and up. Unit vectors, perpendicular.
fn front_and_up(facts: &VolumeFacts) -> (DVec3, DVec3) {
    let up = match facts.frame {
        Frame::Survey => -axes(facts)[2],
        _ => DVec3::Z,
    };
    let front = match facts.frame {
        Frame::RightAnteriorSuperior => DVec3::Y,
        Frame::LeftPosteriorSuperior => DVec3::NEG_Y,
        // The world's x runs to the right where it is not upright itself.
        Frame::Survey | Frame::Unknown => {
            let reference = if up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
            (reference - reference.dot(up) * up).normalize().cross(up)
        }
    };
    (front, up)
}

/// From where something in a patient's frame is seen: from the front, or nearly from its side where it is long.
fn patient_angles(facts: &VolumeFacts) -> [f64; 2] {
    let linear = facts.geometry.linear();
    let edges: [DVec3; 3] = std::array::from_fn(|a| linear.col(a) * facts.dims.0[a] as f64);
    let extent = |axis: usize| edges.iter().map(|edge| edge[axis].abs()).sum::<f64>();
    if extent(1) >= LONG * extent(0).max(extent(2)) { LONG_SIDE } else { PATIENT }
}

/// Right and up of a section across `across`, as radiologists hold it: the patient's right at the left.
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
    // Oblique sections: both in the plane.
    let in_plane = |d: DVec3| (d - d.dot(across) * across).normalize_or(across.any_orthonormal_vector());
    (in_plane(right), in_plane(up))
}

#[cfg(test)]
mod tests;
