//! Random scene: a small volume and its scene members, generated from a seed and a number; and the same for volumes that
//! exist.
//!
//! Choices:
//! - fields: waves, white noise, the Marschner-Lobb signal, blobs in empty space;
//! - voxels: four types, cubes and cuboids, sometimes with holes;
//! - transfer functions: ramps, steps and spikes, faint to nearly opaque; of volumes that exist also much thinner ones,
//!   with values from the percentiles of the data;
//! - cameras: perspective from outside and inside, parallel rays, some along an axis;
//! - half of the scenes are shaded, a third clipped.
//!
//! Other modes than `dvr` use the same scenes: `iso` with surfaces, and modes without lighting without lights.

use std::f64::consts::TAU;

use glam::{DAffine3, DVec3};
use supervol_format::VoxelType;
use supervol_format::cast::index;
use supervol_format::random::{Random, mix};
use supervol_runtime::render::stats::mode_name;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::scene::Mode;
use supervol_sources::computed::Computed;

use crate::fixtures::{marschner_lobb_at, point};
use crate::volume::{Point, image_size, transfer_function};

/// Width and height of the picture, pixels; one ray per pixel.
pub const IMAGE: [u32; 2] = [20, 16];
/// Voxel types, used in turn.
const TYPES: [VoxelType; 4] = [VoxelType::F32, VoxelType::U8, VoxelType::U16, VoxelType::I16];
/// Value of absent voxels in integer volumes.
const NODATA: f64 = 0.0;

/// A volume and its scene.
#[derive(Debug)]
pub struct RandomScene {
    /// Number of the scene within its seed.
    pub number: u64,
    /// The volume.
    pub source: Computed,
    /// Members of the scene file.
    pub members: Vec<String>,
}

/// Properties of the volume that the scene depends on.
struct Shape {
    dims: [u64; 3],
    world_from_index: DAffine3,
    /// Least value, and width of the value range.
    values: [f64; 2],
}

impl Shape {
    /// World position of the centre of the domain.
    fn middle(&self) -> DVec3 {
        self.at([0.5; 3])
    }

    /// World position at these fractions of the domain.
    fn at(&self, shares: [f64; 3]) -> DVec3 {
        let index = std::array::from_fn(|a| shares[a] * self.dims[a] as f64 - 0.5);
        self.world_from_index.transform_point3(DVec3::from_array(index))
    }

    /// Half of the world diagonal.
    fn radius(&self) -> f64 {
        0.5 * self.world_from_index.transform_vector3(DVec3::from_array(self.dims.map(|n| n as f64))).length()
    }
}

impl RandomScene {
    /// Scene `number` of this seed in mode `dvr`. Equal on all machines, up to the last bits of sines.
    #[must_use]
    pub fn new(seed: u64, number: u64) -> Self {
        Self::in_mode(Mode::Dvr, seed, number)
    }

    /// The same volume, camera and transfer function in another mode.
    #[must_use]
    pub fn in_mode(mode: Mode, seed: u64, number: u64) -> Self {
        Self::with(mode, Feature::None, seed, number)
    }

    /// The same, with a feature.
    #[must_use]
    pub fn with(mode: Mode, feature: Feature, seed: u64, number: u64) -> Self {
        let mut random = Random::new(mix(seed) ^ mix(!number));
        let (source, shape) = volume(&mut random);
        let members = members(mode, &mut random, &shape, classification);
        Self { number, source, members: with_feature(members, feature, (seed, number), &shape) }
    }
}

/// Feature that each random scene has beside what chance gives it; only in mode `dvr`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Feature {
    /// No feature.
    None,
    /// Opacity by the gradient.
    GradientOpacity,
    /// Cuts of all kinds whose faces are lit by their own normals; a third of the scenes with opacity by the gradient, too.
    CutNormals,
}

/// Share of scenes with lit cuts that also have opacity by the gradient.
const CUTS_BY_GRADIENT: f64 = 0.3;

/// The members of a scene with a feature, from numbers of its own: all else of the scene stays as it is.
fn with_feature(mut members: Vec<String>, feature: Feature, (seed, number): (u64, u64), shape: &Shape) -> Vec<String> {
    let mut random = Random::new(mix(!seed) ^ mix(number));
    match feature {
        Feature::None => {}
        Feature::GradientOpacity => members.push(gradient_opacity(&mut random, shape)),
        Feature::CutNormals => {
            members.retain(|member| !member.starts_with(CLIP));
            members.extend([cuts(&mut random, shape), r#""cut_normals": true"#.to_owned()]);
            if random.unit() < CUTS_BY_GRADIENT {
                members.push(gradient_opacity(&mut random, shape));
            }
        }
    }
    members
}

/// Begins and widths of ramps of opacity by the gradient, in parts of the longest one: of noise, and of fields that are ever smoother.
const RAMPS: [f64; 5] = [0.5, 0.15, 0.05, 0.01, 0.001];

/// A random ramp of opacity by the gradient.
fn gradient_opacity(random: &mut Random, shape: &Shape) -> String {
    let index = |i: usize| shape.world_from_index.transform_vector3(DVec3::AXES[i]).length();
    let steepest = shape.values[1] / (0..3).map(index).fold(f64::INFINITY, f64::min);
    let mut part = || steepest * RAMPS[self::index(random.below(RAMPS.len() as u64))] * (0.2 + random.unit());
    let (from, width) = (part(), part());
    let from = if random.unit() < 0.3 { 0.0 } else { from };
    format!(r#""gradient_opacity": [{from:?}, {:?}]"#, from + width)
}

/// Members of scene `number` of this seed for a volume that exists.
#[must_use]
pub fn members_for(facts: &VolumeFacts, (mode, feature): (Mode, Feature), seed: u64, number: u64) -> Vec<String> {
    let mut random = Random::new(mix(seed) ^ mix(!number));
    let shape = Shape {
        dims: facts.dims.0,
        world_from_index: facts.geometry.world_from_index(),
        values: [facts.value_range.min, facts.value_range.width()],
    };
    let members = members(mode, &mut random, &shape, |random, _| classification_for(random, facts));
    with_feature(members, feature, (seed, number), &shape)
}

fn members(
    mode: Mode,
    random: &mut Random,
    shape: &Shape,
    classification: impl Fn(&mut Random, &Shape) -> String,
) -> Vec<String> {
    let mut members = vec![
        camera(random, shape),
        image_size(IMAGE[0], IMAGE[1]),
        classification(random, shape),
        shading(random),
        clip(random, shape),
    ];
    if !matches!(mode, Mode::Dvr | Mode::Iso) {
        members.retain(|member| !member.starts_with(SHADING));
    }
    if mode != Mode::Dvr {
        members.push(format!(r#""mode": "{}""#, mode_name(mode)));
    }
    if mode == Mode::Iso {
        members.push(surfaces(random, shape));
    }
    members.retain(|member| !member.is_empty());
    members
}

fn volume(random: &mut Random) -> (Computed, Shape) {
    let dims = [0; 3].map(|_| 14 + random.below(20));
    let voxel_type = TYPES[index(random.below(4))];
    // Integer volumes use some hundred or some ten thousand values.
    let values = match voxel_type {
        VoxelType::F32 => [[0.0, 1.0], [0.0, 1.0], [5000.0, 20.0]][index(random.below(3))],
        VoxelType::U8 => [1.0, 240.0],
        _ => [[1.0, 120.0], [2000.0, 25_000.0]][index(random.below(2))],
    };
    let is_cubic = random.unit() < 0.6;
    let spacing = [0; 3].map(|_| if is_cubic { 1.0 } else { 0.5 + 1.5 * random.unit() });
    let field = field(random, dims);
    let holes = if random.unit() < 0.1 { 2 + random.below(40) } else { 0 };
    let absent = if voxel_type == VoxelType::F32 { f64::NAN } else { NODATA };
    let value = move |voxel: [u64; 3]| {
        let is_hole = holes > 0 && hash(voxel, 1).is_multiple_of(holes);
        if is_hole { absent } else { values[0] + values[1] * field(voxel).clamp(0.0, 1.0) }
    };
    let source = Computed::new(dims, voxel_type, value).with_info(|info| {
        info.geometry.spacing = spacing;
        info.nodata = (holes > 0 && !absent.is_nan()).then_some(absent);
    });
    (source, Shape { dims, world_from_index: DAffine3::from_scale(DVec3::from_array(spacing)), values })
}

type Field = Box<dyn Fn([u64; 3]) -> f64 + Send + Sync>;

/// A random field with values from 0 to 1.
fn field(random: &mut Random, dims: [u64; 3]) -> Field {
    let frequency = 0.2 + random.unit();
    let wave = move |voxel: [u64; 3]| 0.5 + 0.5 * (frequency * point(voxel).dot(DVec3::new(1.0, 0.7, 1.3))).sin();
    match random.below(4) {
        0 => Box::new(wave),
        1 => Box::new(|voxel| (hash(voxel, 0) >> 11) as f64 / (1u64 << 53) as f64),
        2 => Box::new(move |voxel| {
            let extent = DVec3::from_array(dims.map(|n| (n - 1) as f64));
            marschner_lobb_at(point(voxel) * 2.0 / extent - DVec3::ONE)
        }),
        // Most voxels are exactly 0.
        _ => {
            let phase = TAU * random.unit();
            Box::new(move |voxel| {
                let cells = (0.35 * point(voxel) + DVec3::splat(phase)).to_array().map(f64::sin);
                (1.6 * cells[0] * cells[1] * cells[2]).max(0.0)
            })
        }
    }
}

fn hash(voxel: [u64; 3], what: u64) -> u64 {
    mix(voxel[0] ^ mix(voxel[1] ^ mix(voxel[2] ^ mix(what))))
}

/// Ramps, steps and spikes over all or few of the values.
fn classification(random: &mut Random, shape: &Shape) -> String {
    let width = [1.0, 1.0, 0.2, 0.02][index(random.below(4))];
    let first = (1.0 - width) * random.unit();
    let [least, reach] = shape.values;
    let values: Vec<f64> = (0..2 + random.below(5)).map(|_| least + reach * (first + width * random.unit())).collect();
    function_of(random, values, &[0.05, 0.3, 0.95], 1.0)
}

/// A transfer function with these values: some steps, some points that are clear, at most one of these opacities over some
/// units.
fn function_of(random: &mut Random, mut values: Vec<f64>, opacities: &[f64], unit: f64) -> String {
    values.sort_by(f64::total_cmp);
    if random.unit() < 0.4 {
        values[1] = values[0];
    }
    let greatest = opacities[index(random.below(opacities.len() as u64))];
    let points: Vec<Point> = values
        .into_iter()
        .map(|value| {
            let alpha = if random.unit() < 0.3 { 0.0 } else { greatest * random.unit() };
            (value, [0; 3].map(|_| random.unit()), alpha)
        })
        .collect();
    transfer_function(unit * [0.4, 1.0, 1.0, 3.0][index(random.below(4))], &points)
}

/// Greatest opacities over a smallest spacing: from so thin that a thousand voxels are needed to hide anything to nearly opaque.
const OPACITIES: [f64; 4] = [0.002, 0.04, 0.3, 0.95];
/// Shares of the value range within which all control points lie: ramps, and ever narrower spikes.
const WIDTHS: [f64; 4] = [1.0, 1.0, 0.1, 0.01];

/// A transfer function for a volume that exists. Half of its values are percentiles of the data, so that it shows something
/// even where few voxels lie far from all others.
fn classification_for(random: &mut Random, facts: &VolumeFacts) -> String {
    let width = facts.value_range.width() * WIDTHS[index(random.below(4))];
    let by_percentiles = random.unit() < 0.5 && !facts.percentiles.is_empty();
    let pick = |random: &mut Random| {
        if by_percentiles {
            facts.percentiles[index(random.below(facts.percentiles.len() as u64))].1
        } else {
            facts.value_range.min + facts.value_range.width() * random.unit()
        }
    };
    let middle = pick(random);
    let values: Vec<f64> = (0..2 + random.below(5))
        .map(|_| middle + (pick(random) - middle) * width / facts.value_range.width().max(f64::MIN_POSITIVE))
        .collect();
    function_of(random, values, &OPACITIES, facts.geometry.smallest_spacing())
}

fn camera(random: &mut Random, shape: &Shape) -> String {
    let radius = shape.radius();
    let along_axis = random.unit() < 0.2;
    let mut away = DVec3::from_array(random.direction());
    if along_axis {
        let axis = [DVec3::X, DVec3::Y, DVec3::Z][index(random.below(3))];
        away = axis * if random.unit() < 0.5 { 1.0 } else { -1.0 };
    }
    let target = shape.middle();
    let (eye, view) = match random.below(10) {
        // Perspective from inside the volume.
        0 => {
            let eye = shape.at([0; 3].map(|_| 0.1 + 0.8 * random.unit()));
            (eye, format!(r#""fov_y": {:?}"#, 40.0 + 50.0 * random.unit()))
        }
        1..=3 => {
            let height = (0.4 + 1.2 * random.unit()) * radius;
            (target + 2.0 * radius * away, format!(r#""height": {height:?}"#))
        }
        _ => {
            let distance = (1.3 + 2.5 * random.unit()) * radius;
            let fov_y = (1.6 * radius / distance).atan().to_degrees();
            (target + distance * away, format!(r#""fov_y": {fov_y:?}"#))
        }
    };
    // Never parallel to the view direction.
    let up = if away.z.abs() < 0.9 { DVec3::Z } else { DVec3::Y };
    let up = if along_axis { up } else { up + DVec3::new(0.1, 0.2, 0.05) };
    format!(
        r#""camera": {{"eye": {:?}, "target": {:?}, "up": {:?}, {view}}}"#,
        eye.to_array(),
        target.to_array(),
        up.to_array()
    )
}

/// One to three surfaces, some transparent.
fn surfaces(random: &mut Random, shape: &Shape) -> String {
    let [least, reach] = shape.values;
    let surfaces: Vec<String> = (0..1 + random.below(3))
        .map(|_| {
            let (value, color) = (least + reach * random.unit(), [0; 3].map(|_| random.unit()));
            let alpha = if random.unit() < 0.4 { 1.0 } else { random.unit() };
            format!(r#"{{"value": {value:?}, "color": {color:?}, "alpha": {alpha:?}}}"#)
        })
        .collect();
    format!(r#""iso": [{}]"#, surfaces.join(", "))
}

/// Start of the scene member for shading.
const SHADING: &str = r#""shading": "#;

/// No shading, the default, or one to three lights in any direction on a matt or shiny material.
fn shading(random: &mut Random) -> String {
    match random.below(10) {
        0..5 => return String::new(),
        5..7 => return r#""shading": {}"#.into(),
        _ => {}
    }
    let lights: Vec<String> = (0..1 + random.below(3))
        .map(|_| {
            let direction = random.direction();
            format!(r#"{{"direction": {direction:?}, "intensity": {:?}}}"#, random.unit())
        })
        .collect();
    let shininess = [1.0, 4.0, 32.0, 120.0][index(random.below(4))];
    let [ambient, diffuse, specular] = [0; 3].map(|_| random.unit());
    format!(
        r#""shading": {{"ambient": {ambient:?}, "diffuse": {diffuse:?}, "specular": {specular:?}, "shininess": {shininess:?}, "lights": [{}]}}"#,
        lights.join(", ")
    )
}

/// Start of the scene member for clipping.
const CLIP: &str = r#""clip": "#;

/// Cuts near the centre: at least one of a box, planes and solids.
fn cuts(random: &mut Random, shape: &Shape) -> String {
    let (middle, radius) = (shape.middle(), shape.radius());
    let [mut planes, mut solids] = [Vec::new(), Vec::new()];
    let has_box = random.unit() < 0.4;
    let mut parts = Vec::new();
    if has_box {
        let [low, high] = [[0.0, 0.45], [0.55, 0.5]]
            .map(|[from, reach]| shape.dims.map(|n| (from + reach * random.unit()) * n as f64 - 0.5));
        parts.push(format!(r#""box": [{low:?}, {high:?}]"#));
    }
    let near = |random: &mut Random, share: f64| middle + share * radius * DVec3::from_array(random.direction());
    for _ in 0..random.below(3) {
        let keep = ["inside", "outside"][index(random.below(2))];
        let size = (if keep == "inside" { 0.5 } else { 0.25 }) * radius;
        let sizes = [0; 3].map(|_| size * (0.7 + 0.8 * random.unit()));
        let away = 0.5 * random.unit();
        let center = near(random, away).to_array();
        let shape = match random.below(3) {
            0 => format!(r#""sphere": {{"center": {center:?}, "radius": {:?}}}"#, sizes[0]),
            1 => {
                let to = near(random, 0.9).to_array();
                format!(r#""cylinder": {{"from": {center:?}, "to": {to:?}, "radius": {:?}}}"#, sizes[0])
            }
            _ => {
                let axis = DVec3::from_array(random.direction());
                let (b, c) = axis.any_orthonormal_pair();
                let axes = [axis, b, c].map(|axis| axis.to_array());
                let edges = sizes.map(|size| 2.0 * size);
                format!(r#""box": {{"center": {center:?}, "edges": {edges:?}, "axes": {axes:?}}}"#)
            }
        };
        solids.push(format!(r#"{{"keep": "{keep}", {shape}}}"#));
    }
    let least = u64::from(!has_box && solids.is_empty());
    for _ in 0..least + random.below(2) {
        let normal = DVec3::from_array(random.direction());
        let offset = normal.dot(middle) + 0.3 * radius * (random.unit() - 0.7);
        planes.push(format!(r#"{{"normal": {:?}, "offset": {offset:?}}}"#, normal.to_array()));
    }
    parts.extend([format!(r#""planes": [{}]"#, planes.join(", ")), format!(r#""solids": [{}]"#, solids.join(", "))]);
    format!("{CLIP}{{{}}}", parts.join(", "))
}

/// No clipping, a box, one or two planes near the centre, or both.
fn clip(random: &mut Random, shape: &Shape) -> String {
    let mut parts = Vec::new();
    if random.unit() < 0.2 {
        let [low, high] = [[0.0, 0.45], [0.55, 0.45]]
            .map(|[from, reach]| shape.dims.map(|n| (from + reach * random.unit()) * n as f64 - 0.5));
        parts.push(format!(r#""box": [{low:?}, {high:?}]"#));
    }
    if random.unit() < 0.2 {
        let planes: Vec<String> = (0..1 + random.below(2))
            .map(|_| {
                let normal = DVec3::from_array(random.direction());
                let offset = normal.dot(shape.middle()) + 0.3 * shape.radius() * (random.unit() - 0.7);
                format!(r#"{{"normal": {:?}, "offset": {offset:?}}}"#, normal.to_array())
            })
            .collect();
        parts.push(format!(r#""planes": [{}]"#, planes.join(", ")));
    }
    if parts.is_empty() { String::new() } else { format!("{CLIP}{{{}}}", parts.join(", ")) }
}
