//! One slice of a volume, face on. Across an axis of the grid it is the mean, the maximum or the minimum over a box, in
//! any other direction a plane ([`crate::slices`]).

use glam::DVec3;

use super::Scene;
use crate::camera::unit_vector;
use crate::facts::VolumeFacts;
use crate::preset::domain;
use crate::preset::view::{Framed, View};
use crate::slices::SliceSpec;
use crate::spec::{Mode, PointsSpec, TransferFunctionSpec};
use crate::transfer_function::ControlPoint;

/// Thickness of a slice without a slab, in voxels: thin, so that the slice is exactly at its position.
pub const SLICE_VOXELS: f64 = 0.1;
/// Rays along each edge of a pixel for a slice as a thin box.
const SLICE_SUPERSAMPLING: u32 = 4;
/// Rays along each edge of a pixel for a plane, whose values change smoothly.
const PLANE_SUPERSAMPLING: u32 = 2;

/// Quantity that a slab shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SlabMode {
    /// Mean across the slab.
    #[default]
    Mean,
    /// Greatest value across the slab.
    Max,
    /// Least value across the slab.
    Min,
}

impl From<SlabMode> for Mode {
    fn from(mode: SlabMode) -> Self {
        match mode {
            SlabMode::Mean => Self::Mean,
            SlabMode::Max => Self::Mip,
            SlabMode::Min => Self::Minip,
        }
    }
}

/// A slab: layer of the volume that a slice shows as one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slab {
    /// Thickness in voxels.
    pub thickness: f64,
    /// Quantity that the slab shows.
    pub mode: SlabMode,
}

/// Position of a slice across an axis of the grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slice {
    /// The grid's axis that is perpendicular to the slice: 0, 1 or 2.
    pub axis: usize,
    /// Index coordinate on the axis, in voxels.
    pub at: f64,
    /// Slab around the position; `None`: a thin slice.
    pub slab: Option<Slab>,
    /// Magnification relative to a slice that just fits into the picture.
    pub zoom: f64,
}

impl Slice {
    /// The scene with only this slice, inside its clip box, face on. `colors` are used if the scene has no transfer
    /// function. `None` if the clip box leaves nothing of the slice.
    #[must_use]
    pub fn of(&self, scene: &Scene, facts: &VolumeFacts, colors: &[ControlPoint]) -> Option<Scene> {
        let Slab { thickness, mode } = self.slab.unwrap_or(Slab { thickness: SLICE_VOXELS, mode: SlabMode::Mean });
        let (axis, half) = (self.axis, 0.5 * thickness);
        let [mut low, mut high] = scene.clip.index_box.unwrap_or_else(|| domain(facts));
        (low[axis], high[axis]) = (low[axis].max(self.at - half), high[axis].min(self.at + half));
        if low[axis] >= high[axis] {
            return None;
        }
        let mut scene = Scene { mode: Some(mode.into()), ..without_light(scene) };
        scene.clip.index_box = Some([low, high]);
        let spec = || TransferFunctionSpec::Points(PointsSpec::of(colors, facts.geometry.smallest_spacing()));
        scene.transfer_function.get_or_insert_with(spec);
        scene.samples_per_pixel.get_or_insert(SLICE_SUPERSAMPLING * SLICE_SUPERSAMPLING);
        let view = View { zoom: self.zoom, ..View::section(facts, axis) };
        scene.camera = Some(view.camera(&scene.framed(facts, None), [scene.image.width, scene.image.height]));
        Some(scene)
    }
}

/// The scene with only one plane, inside its clip box, face on, magnified by `zoom` relative to a plane that just fits.
/// `None` if the clip box leaves nothing of the plane.
#[must_use]
pub fn face_on(scene: &Scene, facts: &VolumeFacts, slice: SliceSpec, zoom: f64) -> Option<Scene> {
    let normal = unit_vector(slice.normal.into())?;
    let is_labels = slice.labels;
    let outline = outline(facts, scene.clip.index_box.unwrap_or_else(|| domain(facts)), &slice);
    if outline.len() < 3 {
        return None;
    }
    let linear = facts.geometry.linear();
    let along = |axis: usize| linear.col(axis).normalize_or_zero().dot(normal).abs();
    let nearest = (0..3).max_by(|&a, &b| along(a).total_cmp(&along(b)))?;
    // The orientation of a section across the nearest axis, tilted into the plane.
    let section = View::section(facts, nearest);
    let outward = if normal.dot(section.outward) < 0.0 { -normal } else { normal };
    let up = (section.up - section.up.dot(outward) * outward).normalize();
    let middle = outline.iter().sum::<DVec3>() / outline.len() as f64;
    let framed = Framed::boxes(facts, middle, outline, [0.0; 3]);
    let view = View { outward, up, zoom, ..section };
    let mut scene = Scene {
        mode: Some(Mode::Slice),
        slices: vec![slice],
        camera: Some(view.camera(&framed, [scene.image.width, scene.image.height])),
        ..without_light(scene)
    };
    // Rays of two labels would give a colour between them.
    let rays = if is_labels { 1 } else { PLANE_SUPERSAMPLING * PLANE_SUPERSAMPLING };
    scene.samples_per_pixel.get_or_insert(rays);
    Some(scene)
}

/// The scene without what only volumes and surfaces have.
fn without_light(scene: &Scene) -> Scene {
    Scene { iso: Vec::new(), shading: Some(None), gradient_opacity: None, cut_normals: false, ..scene.clone() }
}

/// Corners of the part of a plane inside a box, in index coordinates, in no particular order.
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
