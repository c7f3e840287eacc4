//! Interactive clipping: faces of the crop box, clip planes and slices with their normals, solids with centre and size.
//! World space; each result is the `clip` and the `slices` of a scene.

use glam::DVec3;
use supervol_format::cast::whole;
use supervol_scene::camera::unit_vector;
use supervol_scene::clip::solids::{Keep, SOLID_LIMIT};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::preset::{domain, domain_corners};
use supervol_scene::scene::{
    BoxSpec, CameraSpec, ClipSpec, CylinderSpec, PLANE_LIMIT, PlaneSpec, Scene, SolidSpec, SphereSpec,
};
use supervol_scene::slices::SliceSpec;

use crate::{edit, navigate, planes};

/// Length of the arrow that turns a plane, and initial radius of a solid, in diagonals of the volume.
const ARROW: f64 = 0.15;
const RADIUS: f64 = 0.2;
/// Distance between the handles of planes through one point, in diagonals of the volume.
const BESIDE: f64 = 0.05;
/// Least size of a solid set by hand, in diagonals of the volume.
const LEAST_RADIUS: f64 = 1e-4;
/// Least share of a direction that must be perpendicular to the view for a drag along it.
const LEAST_ACROSS: f64 = 0.1;

/// A quantity that a handle changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HandleKind {
    /// A face of the crop box: axis of the grid; lower (0) or upper (1) face.
    Face(usize, usize),
    /// Offset of a clip plane, by its index.
    Plane(usize),
    /// Normal of a clip plane.
    Arrow(usize),
    /// Offset of a slice in the volume, by its index.
    Slice(usize),
    /// Normal of an oblique slice.
    SliceArrow(usize),
    /// Centre of a solid, by its index.
    Middle(usize),
    /// Size of a solid.
    Size(usize),
}

/// A handle in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Handle {
    /// The quantity that it changes.
    pub kind: HandleKind,
    /// World position.
    pub at: DVec3,
    /// World position of the point that a line connects with the handle, if there is one.
    pub root: Option<DVec3>,
}

/// Kind of a solid to add.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NewSolid {
    /// A sphere.
    Sphere,
    /// A box with edges along the world's axes.
    Cuboid,
    /// A cylinder along the world's z axis.
    Cylinder,
}

fn middle(facts: &VolumeFacts) -> DVec3 {
    let [first, .., last] = domain_corners(facts);
    0.5 * (first + last)
}

fn diagonal(facts: &VolumeFacts) -> f64 {
    edit::stage(facts).diagonal
}

/// Adds a clip plane through the volume's middle that removes the half towards the camera, so that the cut is visible.
///
/// # Errors
/// If the scene has the most clip planes already.
pub fn add_plane(scene: &mut Scene, facts: &VolumeFacts) -> Result<(), String> {
    if scene.clip.planes.len() >= PLANE_LIMIT {
        return Err(format!("expected at most {PLANE_LIMIT} clip planes"));
    }
    let forward = scene.camera.as_ref().map(|camera| DVec3::from_array(camera.target) - DVec3::from_array(camera.eye));
    let normal = forward.and_then(unit_vector).unwrap_or(DVec3::Z);
    scene.clip.planes.push(PlaneSpec { normal: normal.to_array(), offset: normal.dot(middle(facts)) });
    Ok(())
}

/// Adds a solid in the volume's middle that removes its inside, so that the cut is visible.
///
/// # Errors
/// If the scene has the most solids already.
pub fn add_solid(scene: &mut Scene, facts: &VolumeFacts, kind: NewSolid) -> Result<(), String> {
    let (center, radius) = (middle(facts), RADIUS * diagonal(facts));
    let mut solid = SolidSpec { keep: Keep::Outside, ..SolidSpec::default() };
    match kind {
        NewSolid::Sphere => solid.sphere = Some(SphereSpec { center: center.to_array(), radius }),
        NewSolid::Cuboid => {
            let axes = DVec3::AXES.map(|axis| axis.to_array());
            solid.cuboid = Some(BoxSpec { center: center.to_array(), edges: [2.0 * radius; 3], axes });
        }
        NewSolid::Cylinder => {
            let half = radius * DVec3::Z;
            let [from, to] = [center - half, center + half].map(|end| end.to_array());
            solid.cylinder = Some(CylinderSpec { from, to, radius: 0.5 * radius });
        }
    }
    push_solid(scene, solid)
}

/// Adds a given solid.
///
/// # Errors
/// If the scene has the most solids already.
pub fn push_solid(scene: &mut Scene, solid: SolidSpec) -> Result<(), String> {
    if scene.clip.solids.len() >= SOLID_LIMIT {
        return Err(format!("expected at most {SOLID_LIMIT} solids"));
    }
    scene.clip.solids.push(solid);
    Ok(())
}

/// The corners of the crop box in index coordinates: least, greatest.
fn crop(clip: &ClipSpec, facts: &VolumeFacts) -> [[f64; 3]; 2] {
    clip.index_box.unwrap_or_else(|| domain(facts))
}

/// The eight world corners of the crop box. Bit `a` of a corner's index tells its end along axis `a`.
#[must_use]
pub fn crop_corners(clip: &ClipSpec, facts: &VolumeFacts) -> [DVec3; 8] {
    let (ends, world) = (crop(clip, facts), facts.geometry.world_from_index());
    std::array::from_fn(|n| {
        let corner: [f64; 3] = std::array::from_fn(|a| ends[n >> a & 1][a]);
        world.transform_point3(corner.into())
    })
}

/// The plane of a slice.
fn plane_of(slice: &SliceSpec) -> PlaneSpec {
    PlaneSpec { normal: slice.normal, offset: slice.offset }
}

/// The point of a plane that is nearest to the volume's middle, and the unit normal.
fn foot(plane: &PlaneSpec, facts: &VolumeFacts) -> Option<(DVec3, DVec3)> {
    let normal = unit_vector(plane.normal.into())?;
    let offset = plane.offset / DVec3::from_array(plane.normal).length();
    let middle = middle(facts);
    Some((middle + (offset - normal.dot(middle)) * normal, normal))
}

/// Centre of a solid, and world distance of its size handle; `None` for a mesh.
fn extent(solid: &SolidSpec) -> Option<(DVec3, f64)> {
    if let Some(sphere) = &solid.sphere {
        return Some((sphere.center.into(), sphere.radius));
    }
    if let Some(cuboid) = &solid.cuboid {
        return Some((cuboid.center.into(), 0.5 * DVec3::from_array(cuboid.edges).min_element()));
    }
    let cylinder = solid.cylinder.as_ref()?;
    Some((0.5 * (DVec3::from_array(cylinder.from) + DVec3::from_array(cylinder.to)), cylinder.radius))
}

/// Handles of crop box, planes, slices and solids, as seen by a camera.
#[must_use]
pub fn handles(scene: &Scene, facts: &VolumeFacts, camera: &CameraSpec) -> Vec<Handle> {
    let clip = &scene.clip;
    let (ends, world) = (crop(clip, facts), facts.geometry.world_from_index());
    let mut found = Vec::new();
    for axis in 0..3 {
        for end in 0..2 {
            let mut face: [f64; 3] = std::array::from_fn(|a| 0.5 * (ends[0][a] + ends[1][a]));
            face[axis] = ends[end][axis];
            found.push(Handle {
                kind: HandleKind::Face(axis, end),
                at: world.transform_point3(face.into()),
                root: None,
            });
        }
    }
    let (arrow, right) = (ARROW * diagonal(facts), navigate::right_of(camera));
    // Planes initially pass through the volume's middle: their handles are placed beside each other.
    let mut beside = (1..).map(|n| BESIDE * f64::from(n) * diagonal(facts));
    let mut grasp = |plane: &PlaneSpec| {
        let (foot, normal) = foot(plane, facts)?;
        let along = unit_vector(right - right.dot(normal) * normal).unwrap_or(normal.any_orthonormal_vector());
        Some((foot + beside.next()? * along, normal))
    };
    for (i, slice) in scene.slices.iter().enumerate() {
        let Some((foot, normal)) = grasp(&plane_of(slice)) else { continue };
        found.push(Handle { kind: HandleKind::Slice(i), at: foot, root: None });
        if planes::place_of(slice, facts).axis.is_none() {
            found.push(Handle { kind: HandleKind::SliceArrow(i), at: foot + arrow * normal, root: Some(foot) });
        }
    }
    for (i, plane) in clip.planes.iter().enumerate() {
        let Some((foot, normal)) = grasp(plane) else { continue };
        found.push(Handle { kind: HandleKind::Plane(i), at: foot, root: None });
        found.push(Handle { kind: HandleKind::Arrow(i), at: foot + arrow * normal, root: Some(foot) });
    }
    for (i, solid) in clip.solids.iter().enumerate() {
        let Some((center, reach)) = extent(solid) else { continue };
        found.push(Handle { kind: HandleKind::Middle(i), at: center, root: None });
        found.push(Handle { kind: HandleKind::Size(i), at: center + reach * right, root: Some(center) });
    }
    found
}

/// The scene after a handle was dragged. `by` is a world vector perpendicular to the camera's view direction, from the
/// start of the drag.
#[must_use]
pub fn moved(scene: &Scene, facts: &VolumeFacts, camera: &CameraSpec, handle: &Handle, by: DVec3) -> Scene {
    let mut after = scene.clone();
    let forward = navigate::forward_of(camera);
    // Distance along a direction that corresponds to the drag across the view.
    let along = |direction: DVec3| {
        let across = direction - direction.dot(forward) * forward;
        if across.length() < LEAST_ACROSS { 0.0 } else { by.dot(across) / across.length_squared() }
    };
    match handle.kind {
        HandleKind::Face(axis, end) => {
            let edge = facts.geometry.linear().col(axis);
            let voxels = along(edge.normalize_or_zero()) / edge.length();
            let mut kept = edit::kept_voxels(scene, facts);
            let last = (facts.dims.0[axis] - 1) as f64;
            let place = whole::<u64>((kept[axis][end] as f64 + voxels).round().clamp(0.0, last));
            // A face cannot pass the opposite face.
            kept[axis][end] = if end == 0 { place.min(kept[axis][1]) } else { place.max(kept[axis][0]) };
            edit::keep_voxels(&mut after, facts, kept);
        }
        HandleKind::Plane(i) => {
            if let Some(plane) = after.clip.planes.get_mut(i) {
                let normal = DVec3::from_array(plane.normal);
                plane.offset += along(normal.normalize_or_zero()) * normal.length();
            }
        }
        HandleKind::Arrow(i) => {
            if let (Some(plane), Some(turned)) = (after.clip.planes.get_mut(i), turned(handle, by)) {
                *plane = turned;
            }
        }
        HandleKind::Slice(i) => {
            if let Some(slice) = after.slices.get_mut(i) {
                let place = planes::place_of(slice, facts);
                let way = along(DVec3::from_array(slice.normal).normalize_or_zero());
                match place.axis {
                    // A slice across an axis moves from voxel to voxel.
                    Some(axis) => {
                        let index = facts.geometry.linear().inverse()
                            * (way * DVec3::from_array(slice.normal).normalize_or_zero());
                        let [least, most] = place.range;
                        planes::move_to(slice, facts, (place.at + index[axis]).round().clamp(least, most));
                    }
                    None => planes::move_to(slice, facts, place.at + way),
                }
            }
        }
        HandleKind::SliceArrow(i) => {
            if let (Some(slice), Some(turned)) = (after.slices.get_mut(i), turned(handle, by)) {
                (slice.normal, slice.offset) = (turned.normal, turned.offset);
            }
        }
        HandleKind::Middle(i) => after.clip.solids.get_mut(i).into_iter().for_each(|solid| shift(solid, by)),
        HandleKind::Size(i) => {
            let least = LEAST_RADIUS * diagonal(facts);
            let by = by.dot(navigate::right_of(camera));
            after.clip.solids.get_mut(i).into_iter().for_each(|solid| resize(solid, by, least));
        }
    }
    after
}

/// The plane through the root of its arrow after the tip was moved.
fn turned(handle: &Handle, by: DVec3) -> Option<PlaneSpec> {
    let foot = handle.root?;
    let normal = unit_vector(handle.at + by - foot)?;
    Some(PlaneSpec { normal: normal.to_array(), offset: normal.dot(foot) })
}

fn shift(solid: &mut SolidSpec, by: DVec3) {
    let shifted = |point: &mut [f64; 3]| *point = (DVec3::from_array(*point) + by).to_array();
    solid.sphere.iter_mut().for_each(|sphere| shifted(&mut sphere.center));
    solid.cuboid.iter_mut().for_each(|cuboid| shifted(&mut cuboid.center));
    if let Some(cylinder) = &mut solid.cylinder {
        shifted(&mut cylinder.from);
        shifted(&mut cylinder.to);
    }
}

fn resize(solid: &mut SolidSpec, by: f64, least: f64) {
    let Some((_, reach)) = extent(solid) else { return };
    let factor = (reach + by).max(least) / reach;
    solid.sphere.iter_mut().for_each(|sphere| sphere.radius *= factor);
    solid.cuboid.iter_mut().for_each(|cuboid| cuboid.edges = cuboid.edges.map(|edge| edge * factor));
    solid.cylinder.iter_mut().for_each(|cylinder| cylinder.radius *= factor);
}

#[cfg(test)]
mod tests {
    use supervol_format::{Dims, Geometry, ValueRange};
    use supervol_scene::scene::Mode;

    use super::*;

    fn facts() -> VolumeFacts {
        VolumeFacts::plain(
            Dims([10, 20, 40]),
            Geometry { spacing: [2.0, 1.0, 0.5], ..Geometry::IDENTITY },
            ValueRange { min: 0.0, max: 1.0 },
        )
    }

    /// Looks along y: x to the right, z up.
    fn camera() -> CameraSpec {
        CameraSpec {
            eye: [9.0, -50.0, 10.0],
            target: [9.0, 10.0, 10.0],
            up: [0.0, 0.0, 1.0],
            fov_y: None,
            height: Some(30.0),
        }
    }

    fn handle(scene: &Scene, kind: HandleKind) -> Handle {
        let found = handles(scene, &facts(), &camera());
        *found.iter().find(|handle| handle.kind == kind).expect("it is there")
    }

    fn drag(scene: &mut Scene, kind: HandleKind, by: [f64; 3]) {
        *scene = moved(scene, &facts(), &camera(), &handle(scene, kind), by.into());
        scene.validate().expect("a scene");
    }

    #[test]
    fn faces_of_the_crop_box_are_moved_voxel_by_voxel() {
        let mut scene = Scene::default();
        assert_eq!(handle(&scene, HandleKind::Face(0, 1)).at, DVec3::new(19.0, 9.5, 9.75));
        drag(&mut scene, HandleKind::Face(0, 1), [-6.3, 0.0, 0.0]);
        assert_eq!(edit::kept_voxels(&scene, &facts()), [[0, 6], [0, 19], [0, 39]]);
        drag(&mut scene, HandleKind::Face(0, 0), [100.0, 0.0, 0.0]);
        assert_eq!(edit::kept_voxels(&scene, &facts())[0], [6, 6], "no farther than the other face");
        drag(&mut scene, HandleKind::Face(2, 0), [0.0, 0.0, 2.0]);
        assert_eq!(edit::kept_voxels(&scene, &facts())[2], [4, 39]);
        let before = scene.clone();
        drag(&mut scene, HandleKind::Face(1, 0), [3.0, 0.0, 3.0]);
        assert_eq!(scene, before, "along the view nothing can be moved");
        let corners = crop_corners(&scene.clip, &facts());
        assert_eq!((corners[0], corners[7]), (DVec3::new(11.0, -0.5, 1.75), DVec3::new(13.0, 19.5, 19.75)));
    }

    #[test]
    fn planes_are_moved_along_their_normal_and_turned_about_their_foot() {
        let mut scene = Scene { camera: Some(camera()), ..Scene::default() };
        add_plane(&mut scene, &facts()).unwrap();
        assert_eq!(scene.clip.planes[0], PlaneSpec { normal: [0.0, 1.0, 0.0], offset: 9.5 });
        drag(&mut scene, HandleKind::Plane(0), [5.0, 0.0, 5.0]);
        assert_eq!(scene.clip.planes[0].offset, 9.5, "along the view nothing can be moved");
        // Turns the plane by moving the arrow's tip as far as it is long.
        let tip = handle(&scene, HandleKind::Arrow(0));
        let length = (tip.at - tip.root.unwrap()).length();
        drag(&mut scene, HandleKind::Arrow(0), [length, 0.0, 0.0]);
        let PlaneSpec { normal, offset } = scene.clip.planes[0];
        let half = 0.5f64.sqrt();
        assert!((DVec3::from_array(normal) - DVec3::new(half, half, 0.0)).length() < 1e-12);
        assert!((offset - DVec3::from_array(normal).dot(tip.root.unwrap())).abs() < 1e-12, "its root stays");
        // For a plane seen at an angle, the handle stays under the mouse.
        let before = handle(&scene, HandleKind::Plane(0)).at;
        drag(&mut scene, HandleKind::Plane(0), [3.0, 0.0, 0.0]);
        assert!((handle(&scene, HandleKind::Plane(0)).at.x - before.x - 3.0).abs() < 1e-9);
        (1..PLANE_LIMIT).for_each(|_| add_plane(&mut scene, &facts()).unwrap());
        assert!(add_plane(&mut scene, &facts()).unwrap_err().contains("at most"));
    }

    #[test]
    fn slices_are_moved_voxel_by_voxel_or_along_their_normal() {
        let mut scene = Scene { mode: Some(Mode::Dvr), ..Scene::default() };
        planes::add(&mut scene, &facts(), Some(2)).unwrap();
        planes::add(&mut scene, &facts(), None).unwrap();
        drag(&mut scene, HandleKind::Slice(0), [9.0, 0.0, 1.2]);
        // Voxels are half as high as long; the slice was at voxel 20.
        assert_eq!(planes::place_of(&scene.slices[0], &facts()).at, 22.0);
        drag(&mut scene, HandleKind::Slice(0), [0.0, 0.0, 1e6]);
        assert_eq!(planes::place_of(&scene.slices[0], &facts()).at, 39.0, "no farther than the volume");
        let found = handles(&scene, &facts(), &camera());
        assert!(!found.iter().any(|handle| handle.kind == HandleKind::SliceArrow(0)), "it stays across its axis");
        let before = scene.slices[1].clone();
        drag(&mut scene, HandleKind::SliceArrow(1), [0.0, 0.0, 2.0]);
        assert!(scene.slices[1].normal[2] > before.normal[2]);
        let place = planes::place_of(&scene.slices[1], &facts()).at;
        drag(&mut scene, HandleKind::Slice(1), [0.0, 0.0, 1.0]);
        assert!(planes::place_of(&scene.slices[1], &facts()).at > place);
    }

    #[test]
    fn solids_are_moved_and_made_larger() {
        for kind in [NewSolid::Sphere, NewSolid::Cuboid, NewSolid::Cylinder] {
            let mut scene = Scene::default();
            add_solid(&mut scene, &facts(), kind).unwrap();
            let (center, reach) = extent(&scene.clip.solids[0]).unwrap();
            drag(&mut scene, HandleKind::Middle(0), [1.0, 0.0, -2.0]);
            let (moved, same) = extent(&scene.clip.solids[0]).unwrap();
            assert!((moved - center - DVec3::new(1.0, 0.0, -2.0)).length() < 1e-12 && same == reach, "{kind:?}");
            drag(&mut scene, HandleKind::Size(0), [0.5 * reach, 0.0, 7.0]);
            assert!((extent(&scene.clip.solids[0]).unwrap().1 - 1.5 * reach).abs() < 1e-9, "{kind:?}");
            drag(&mut scene, HandleKind::Size(0), [-100.0 * reach, 0.0, 0.0]);
            assert!(extent(&scene.clip.solids[0]).unwrap().1 > 0.0, "{kind:?}");
        }
    }
}
