//! One slice of a volume, face on: as the mean over a thin box where it lies across an axis of the grid, else as a plane
//! ([`crate::slices`]).

use glam::DVec3;

use super::domain;
use super::view::{Framed, View};
use crate::camera::unit_vector;
use crate::facts::VolumeFacts;
use crate::scene::{Mode, PointsSpec, Scene, TransferFunctionSpec};
use crate::slices::SliceSpec;
use crate::transfer_function::ControlPoint;

/// Share of a voxel across a slice without a slab: a slice is where it is said to be, and not beside it.
const SLICE_VOXELS: f64 = 0.1;
/// Rays along each edge of a pixel of a slice.
const SLICE_SUPERSAMPLING: u32 = 4;
/// The same of planes, whose values change smoothly.
const PLANE_SUPERSAMPLING: u32 = 2;

/// Which slice.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slice {
    /// The grid's axis that it lies across.
    pub axis: usize,
    /// Where on it, voxels.
    pub at: f64,
    /// Voxels across it that the mean is taken over; `None`: the slice alone.
    pub slab: Option<f64>,
    /// How many times as large as it would fit.
    pub zoom: f64,
}

impl Slice {
    /// The scene with nothing but this slice of what its clip box leaves, face on; in these colours where it has none of its own.
    /// `None` where the clip box leaves nothing of it.
    #[must_use]
    pub fn of(&self, scene: &Scene, facts: &VolumeFacts, colors: &[ControlPoint]) -> Option<Scene> {
        let (axis, half) = (self.axis, 0.5 * self.slab.unwrap_or(SLICE_VOXELS));
        let [mut low, mut high] = scene.clip.index_box.unwrap_or_else(|| domain(facts));
        (low[axis], high[axis]) = (low[axis].max(self.at - half), high[axis].min(self.at + half));
        if low[axis] >= high[axis] {
            return None;
        }
        let mut scene = Scene { mode: Some(Mode::Mean), iso: Vec::new(), shading: Some(None), ..scene.clone() };
        scene.clip.index_box = Some([low, high]);
        let spec = || TransferFunctionSpec::Points(PointsSpec::of(colors, facts.geometry.smallest_spacing()));
        scene.transfer_function.get_or_insert_with(spec);
        scene.samples_per_pixel.get_or_insert(SLICE_SUPERSAMPLING * SLICE_SUPERSAMPLING);
        let view = View { zoom: self.zoom, ..View::section(facts, axis) };
        scene.camera = Some(view.camera(&scene.framed(facts, None), [scene.image.width, scene.image.height]));
        Some(scene)
    }
}

/// The plane across an axis of the grid at an index coordinate: its unit normal and offset, world.
#[must_use]
pub fn plane_across(facts: &VolumeFacts, axis: usize, at: f64) -> ([f64; 3], f64) {
    // Index coordinate `axis` of a world point is a row of the inverse times that point.
    let across = facts.geometry.linear().inverse().transpose().col(axis);
    let normal = unit_vector(across).unwrap_or(DVec3::Z);
    let mut index = DVec3::ZERO;
    index[axis] = at;
    (normal.to_array(), normal.dot(facts.geometry.world_from_index().transform_point3(index)))
}

/// The scene with nothing but one plane of what its clip box leaves, face on, so many times as large as it would fit. `None` where the
/// clip box leaves nothing of it.
#[must_use]
pub fn face_on(scene: &Scene, facts: &VolumeFacts, slice: SliceSpec, zoom: f64) -> Option<Scene> {
    let normal = unit_vector(slice.normal.into())?;
    let outline = outline(facts, scene.clip.index_box.unwrap_or_else(|| domain(facts)), &slice);
    if outline.len() < 3 {
        return None;
    }
    let linear = facts.geometry.linear();
    let along = |axis: usize| linear.col(axis).normalize_or_zero().dot(normal).abs();
    let nearest = (0..3).max_by(|&a, &b| along(a).total_cmp(&along(b)))?;
    // As a section across the nearest axis is seen, tilted.
    let section = View::section(facts, nearest);
    let outward = if normal.dot(section.outward) < 0.0 { -normal } else { normal };
    let up = (section.up - section.up.dot(outward) * outward).normalize();
    let middle = outline.iter().sum::<DVec3>() / outline.len() as f64;
    let framed = Framed::boxes(facts, middle, outline, [0.0; 3]);
    let view = View { outward, up, zoom, ..section };
    let mut scene = Scene {
        mode: Some(Mode::Slice),
        slices: vec![slice],
        iso: Vec::new(),
        shading: Some(None),
        camera: Some(view.camera(&framed, [scene.image.width, scene.image.height])),
        ..scene.clone()
    };
    scene.samples_per_pixel.get_or_insert(PLANE_SUPERSAMPLING * PLANE_SUPERSAMPLING);
    Some(scene)
}

/// Corners of what a box of index coordinates leaves of a plane, index coordinates, in no order.
fn outline(facts: &VolumeFacts, [low, high]: [[f64; 3]; 2], slice: &SliceSpec) -> Vec<DVec3> {
    let world = facts.geometry.world_from_index();
    let corner = |n: usize| DVec3::from_array(std::array::from_fn(|a| if n >> a & 1 == 0 { low[a] } else { high[a] }));
    let normal = DVec3::from_array(slice.normal);
    let beyond = |p: DVec3| normal.dot(world.transform_point3(p)) - slice.offset;
    let edges = (0..8usize).flat_map(|n| (0..3).filter(move |a| n >> a & 1 == 0).map(move |a| (n, n | 1 << a)));
    let cut = |(from, to): (usize, usize)| {
        let (from, to) = (corner(from), corner(to));
        let (before, after) = (beyond(from), beyond(to));
        let share = before / (before - after);
        (before != after && (0.0..=1.0).contains(&share)).then(|| from + share * (to - from))
    };
    edges.filter_map(cut).collect()
}
