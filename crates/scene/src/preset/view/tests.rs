use supervol_format::{Dims, Geometry, ValueRange};

use super::*;
use crate::preset::{domain, domain_corners};
use crate::units::Units;

fn facts(frame: Frame, dims: [u64; 3], direction: [f64; 9]) -> VolumeFacts {
    VolumeFacts {
        frame,
        ..VolumeFacts::plain(
            Dims(dims),
            Geometry { spacing: [2.0, 1.0, 0.5], origin: [10.0, -20.0, 5.0], direction },
            ValueRange { min: 0.0, max: 1.0 },
        )
    }
}

const STRAIGHT: [f64; 9] = Geometry::IDENTITY.direction;
const Y_TURNED: [f64; 9] = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0];

/// Position of an index point in the picture: right and up, in half heights of the picture.
fn seen(facts: &VolumeFacts, view: &View, point: [f64; 3]) -> [f64; 2] {
    let camera =
        view.camera(&Framed::whole(facts, domain(facts)), [640, 480]).camera(&Units::WORLD, [640, 480]).unwrap();
    let p = facts.geometry.world_from_index().transform_point3(point.into()) - camera.eye;
    let depth = match camera.projection {
        crate::camera::Projection::Perspective { fov_y } => p.dot(camera.forward) * (fov_y.to_radians() / 2.0).tan(),
        crate::camera::Projection::Orthographic { height } => height / 2.0,
    };
    [p.dot(camera.right) / depth, p.dot(camera.up) / depth]
}

/// Signs of the picture direction (right, up) from the first voxel to its neighbour along an axis.
fn way(facts: &VolumeFacts, view: &View, axis: usize) -> [i32; 2] {
    let mut next = [0.0; 3];
    next[axis] = 1.0;
    let (from, to) = (seen(facts, view, [0.0; 3]), seen(facts, view, next));
    [0, 1].map(|i| if (to[i] - from[i]).abs() < 1e-9 { 0 } else { (to[i] - from[i]).signum() as i32 })
}

#[test]
fn a_survey_seen_from_above_is_its_map_and_not_the_mirror_image() {
    // Inlines ascend against y: if inlines run north and crosslines east, inline numbers ascend to the left of the
    // crosslines.
    let north = facts(Frame::Survey, [40, 50, 60], Y_TURNED);
    let top = View::from(&north, Direction::Top);
    assert_eq!((way(&north, &top, 0), way(&north, &top, 1)), ([1, 0], [0, 1]));
    let south = facts(Frame::Survey, [40, 50, 60], STRAIGHT);
    let top = View::from(&south, Direction::Top);
    assert_eq!((way(&south, &top, 0), way(&south, &top, 1)), ([1, 0], [0, -1]));
    for survey in [north, south] {
        assert_eq!(way(&survey, &View::from(&survey, Direction::Front), 2), [0, -1], "depth points down");
        assert!(way(&survey, &View::of(&survey), 2)[1] < 0);
    }
}

#[test]
fn sections_of_surveys_have_depth_downwards_and_lines_to_the_right() {
    for direction in [STRAIGHT, Y_TURNED] {
        let inline = facts(Frame::Survey, [40, 1, 60], direction);
        let view = View::of(&inline);
        assert!(view.is_face_on);
        assert_eq!((way(&inline, &view, 0), way(&inline, &view, 2)), ([1, 0], [0, -1]));
        let crossline = facts(Frame::Survey, [1, 40, 60], direction);
        let view = View::of(&crossline);
        assert_eq!((way(&crossline, &view, 1), way(&crossline, &view, 2)), ([1, 0], [0, -1]));
    }
}

#[test]
fn a_patient_looks_the_same_in_either_frame_of_the_world() {
    let right = facts(Frame::RightAnteriorSuperior, [40, 50, 60], STRAIGHT);
    // The same voxels with the world's x and y reversed.
    let turned = [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0];
    let mut left = facts(Frame::LeftPosteriorSuperior, [40, 50, 60], turned);
    left.geometry.origin = [-10.0, 20.0, 5.0];
    let directions = [Direction::Front, Direction::Left, Direction::Top, Direction::Angles([20.0, 10.0])];
    for direction in directions {
        for point in [[0.0, 0.0, 0.0], [39.0, 0.0, 7.0], [3.0, 49.0, 59.0]] {
            let a = seen(&right, &View::from(&right, direction), point);
            let b = seen(&left, &View::from(&left, direction), point);
            assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-9, "{direction:?} {point:?}: {a:?}, {b:?}");
        }
    }
    // From the front, the patient's right is on the left and the head up. From the left, the front is on the left.
    let front = View::from(&right, Direction::Front);
    assert_eq!((way(&right, &front, 0)[0], way(&right, &front, 2)[1]), (-1, 1));
    let side = View::from(&right, Direction::Left);
    assert_eq!((way(&right, &side, 1)[0], way(&right, &side, 2)[1]), (-1, 1));
    let axial = View::section(&right, 2);
    assert_eq!((way(&right, &axial, 0), way(&right, &axial, 1)), ([-1, 0], [0, 1]));
}

#[test]
fn images_lie_as_they_are_stored_and_everything_is_framed() {
    let image = facts(Frame::Unknown, [40, 50, 1], STRAIGHT);
    let view = View::of(&image);
    assert_eq!((way(&image, &view, 0), way(&image, &view, 1)), ([1, 0], [0, -1]));
    for direction in [STRAIGHT, Y_TURNED, [0.0, 1.0, 0.0, 0.6, 0.0, 0.8, -0.8, 0.0, 0.6]] {
        for frame in [Frame::Unknown, Frame::Survey, Frame::RightAnteriorSuperior] {
            let volume = facts(frame, [40, 50, 60], direction);
            for view in [View::of(&volume), View::from(&volume, Direction::Top), View::from(&volume, Direction::Back)] {
                let corners = domain_corners(&volume).map(|world| {
                    let index = volume.geometry.index_from_world().transform_point3(world);
                    seen(&volume, &view, index.to_array())
                });
                let most = |i: usize, aspect: f64| corners.iter().map(|c| c[i].abs() / aspect).fold(0.0, f64::max);
                let greatest = most(0, 4.0 / 3.0).max(most(1, 1.0));
                assert!(greatest < 0.961 && greatest > 0.9, "{frame:?} {view:?}: {greatest}");
            }
        }
    }
}

#[test]
fn a_camera_that_goes_around_sees_everything_from_every_side() {
    for (frame, dims) in [(Frame::Survey, [40, 90, 60]), (Frame::Unknown, [100, 10, 30])] {
        let facts = facts(frame, dims, Y_TURNED);
        let framed = Framed::whole(&facts, domain(&facts));
        for view in [View::of(&facts), View::from(&facts, Direction::Front), View::from(&facts, Direction::Top)] {
            let start = view.turning_camera(&framed, [640, 480], upright(&facts));
            let mut fullest: f64 = 0.0;
            for camera in crate::camera_path::turntable(&start, upright(&facts), 36) {
                let camera = camera.camera(&Units::WORLD, [640, 480]).unwrap();
                for corner in domain_corners(&facts) {
                    let p = corner - camera.eye;
                    let depth = match camera.projection {
                        crate::camera::Projection::Perspective { fov_y } => {
                            p.dot(camera.forward) * (fov_y.to_radians() / 2.0).tan()
                        }
                        crate::camera::Projection::Orthographic { height } => height / 2.0,
                    };
                    let [x, y] = [p.dot(camera.right) / depth * 0.75, p.dot(camera.up) / depth].map(f64::abs);
                    assert!(x < 1.0 && y < 1.0, "{view:?}: {x}, {y}");
                    fullest = fullest.max(x).max(y);
                }
            }
            assert!(fullest > 0.85, "{view:?}: {fullest}");
        }
    }
}

/// A ball behind a wall is seen from another side. A ball in front of a wall, and a patient, are not.
#[test]
fn a_wall_does_not_hide_the_rest() {
    let facts = |frame| VolumeFacts { geometry: Geometry::IDENTITY, ..facts(frame, [40; 3], STRAIGHT) };
    let usual = View::of(&facts(Frame::Unknown));
    let along = usual.outward - usual.outward.dot(DVec3::Z) * DVec3::Z;
    let along = along.normalize();
    let across = along.cross(DVec3::Z);
    let framed = |side: f64, height: f64| {
        let mut centres = Vec::new();
        let up = height * DVec3::Z;
        for i in -10..=10 {
            for j in -10..=10 {
                centres.push(side * 10.0 * along + f64::from(i) * across + f64::from(j) * up);
                // The ball is thicker than the wall.
                for k in (-6..=6).filter(|k| i * i + j * j + k * k <= 36) {
                    centres.push(f64::from(i) * across + f64::from(j) * up + f64::from(k) * along);
                }
            }
        }
        Framed::boxes(&facts(Frame::Unknown), DVec3::ZERO, centres, [0.5; 3])
    };
    let faced = |side, height, frame| View::facing(&facts(frame), &framed(side, height)).outward.dot(along);
    let seen = |side: f64, frame: Frame| faced(side, 1.0, frame);
    assert!(seen(1.0, Frame::Unknown) < 0.1, "{}", seen(1.0, Frame::Unknown));
    // Voxels may be higher than wide.
    assert!(faced(1.0, 2.5, Frame::Unknown) < 0.1, "{}", faced(1.0, 2.5, Frame::Unknown));
    assert_eq!(seen(-1.0, Frame::Unknown), usual.outward.dot(along));
    let patient = Frame::LeftPosteriorSuperior;
    assert_eq!(seen(1.0, patient), View::of(&facts(patient)).outward.dot(along));
}
