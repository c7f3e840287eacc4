//! Small volumes, bricked in memory, and the scenes to look at them.
#![allow(dead_code, reason = "each test file uses its own part")]
#![allow(clippy::unwrap_used, reason = "test code; the lint does not see that in a module of its own")]

use std::collections::HashMap;
use std::sync::Mutex;

use supervol_format::codec::BrickShape;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickKey, BrickLayout, Dims, Geometry, Lod, Pyramid, ValueRange, VoxelType};
use supervol_runtime::engines::cpu::{CpuFrame, CpuQuality};
use supervol_runtime::engines::ray_scene::DrawnVolume;
use supervol_runtime::engines::reference::{ReferenceVolume, render_reference_counted};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::counters::RayCounters;
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::{ResolvedScene, Scene};
use supervol_scene::value_map::ValueMap;

/// A volume of data values; NaN is absent.
#[derive(Clone)]
pub struct Volume {
    pub dims: [usize; 3],
    pub geometry: Geometry,
    pub values: Vec<f64>,
    pub voxel_type: VoxelType,
    pub nodata: Option<f64>,
}

impl Volume {
    /// A field evaluated at voxel indices, rounded to the voxel type (f32, or u8 and u16 without scaling).
    pub fn new(dims: [usize; 3], voxel_type: VoxelType, field: impl Fn([f64; 3]) -> f64) -> Self {
        let mut values = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let v = field([i as f64, j as f64, k as f64]);
                    values.push(match voxel_type {
                        VoxelType::F32 => f64::from(v as f32),
                        VoxelType::F64 => v,
                        _ => v.round(),
                    });
                }
            }
        }
        Self { dims, geometry: Geometry::IDENTITY, values, voxel_type, nodata: None }
    }

    pub fn with_geometry(self, spacing: [f64; 3], origin: [f64; 3], direction: [f64; 9]) -> Self {
        Self { geometry: Geometry { spacing, origin, direction }, ..self }
    }

    pub fn with_holes(mut self, is_hole: impl Fn([usize; 3]) -> bool) -> Self {
        let [nx, ny, _] = self.dims;
        for (n, v) in self.values.iter_mut().enumerate() {
            if is_hole([n % nx, n / nx % ny, n / (nx * ny)]) {
                *v = f64::NAN;
            }
        }
        self
    }

    pub fn range(&self) -> ValueRange {
        let mut range = ValueRange::EMPTY;
        self.values.iter().filter(|v| !v.is_nan()).for_each(|&v| range.include(v));
        range
    }

    pub fn facts(&self) -> VolumeFacts {
        VolumeFacts::plain(Dims(self.dims.map(|n| n as u64)), self.geometry, self.range())
    }

    pub fn reference(&self) -> ReferenceVolume {
        ReferenceVolume {
            dims: self.dims,
            geometry: self.geometry,
            values: self.values.clone(),
            value_range: self.range(),
        }
    }

    /// Value of a voxel, indices clamped to the grid; NaN is absent.
    pub fn clamped(&self, p: [i64; 3]) -> f64 {
        let [i, j, k] = [0, 1, 2].map(|a| p[a].clamp(0, self.dims[a] as i64 - 1) as usize);
        self.values[i + self.dims[0] * (j + self.dims[1] * k)]
    }

    /// The next coarser level: means of present voxels.
    pub fn coarser(&self, factors: [usize; 3]) -> Self {
        let dims: [usize; 3] = std::array::from_fn(|a| self.dims[a].div_ceil(factors[a]));
        let voxel_type = self.voxel_type;
        let coarse = Self::new(dims, voxel_type, |p| {
            let (mut sum, mut count) = (0.0, 0.0);
            for corner in 0..8 {
                let bit = [corner & 1, corner >> 1 & 1, corner >> 2];
                let fine: [usize; 3] = std::array::from_fn(|a| p[a] as usize * factors[a] + bit[a]);
                if (0..3).all(|a| bit[a] < factors[a] && fine[a] < self.dims[a]) {
                    let v = self.clamped(fine.map(|i| i as i64));
                    if !v.is_nan() {
                        (sum, count) = (sum + v, count + 1.0);
                    }
                }
            }
            sum / count
        });
        let f = factors.map(|f| f as f64);
        let spacing = std::array::from_fn(|a| self.geometry.spacing[a] * f[a]);
        let world = self.geometry.world_from_index();
        let first = world.transform_point3(f.map(|f| 0.5 * f - 0.5).into());
        Self {
            geometry: Geometry { spacing, origin: first.to_array(), ..self.geometry },
            nodata: self.nodata,
            ..coarse
        }
    }
}

/// A volume's bricks, all of them in memory.
pub struct Bricked {
    pub pyramid: Pyramid,
    pub map: ValueMap,
    pub bricks: HashMap<BrickKey, DecodedBrick>,
    pub geometry: Geometry,
    pub range: ValueRange,
}

impl Bricked {
    pub fn new(volume: &Volume, core: u32) -> Self {
        Self::scaled(volume, core, [1.0, 0.0])
    }

    /// The same, with the data value `stored * scale + offset`.
    pub fn scaled(volume: &Volume, core: u32, [scale, offset]: [f64; 2]) -> Self {
        let layout = BrickLayout::new(core).unwrap();
        let mut levels = vec![volume.clone()];
        let mut factors = vec![];
        while levels.last().unwrap().dims.iter().any(|&n| n > core as usize) {
            let f = levels.last().unwrap().dims.map(|n| if n > core as usize { 2 } else { 1 });
            factors.push(f.map(|v| v as u32));
            levels.push(levels.last().unwrap().coarser(f));
        }
        let pyramid = Pyramid::new(Dims(volume.dims.map(|n| n as u64)), layout, &factors).unwrap();
        let (t, range) = (volume.voxel_type, volume.range());
        let map = ValueMap::for_container(t, scale, offset, volume.nodata, range);
        let mut bricks = HashMap::new();
        for (lod, level) in levels.iter().enumerate() {
            for key in pyramid.keys_of(Lod(lod as u8)) {
                bricks.insert(key, brick_of(level, &pyramid, key, &map));
            }
        }
        Self { pyramid, map, bricks, geometry: volume.geometry, range }
    }

    pub fn frame(&self, scene: &ResolvedScene, lod: LodChoice, skipping: Skipping) -> CpuFrame {
        self.frame_of(scene, CpuQuality { lod, skipping, ..CpuQuality::default() })
    }

    pub fn frame_of(&self, scene: &ResolvedScene, quality: CpuQuality) -> CpuFrame {
        let (pyramid, geometry) = (&self.pyramid, &self.geometry);
        let volume = DrawnVolume { pyramid, geometry, map: self.map, value_range: self.range };
        CpuFrame::new(scene, &volume, quality)
    }

    pub fn render_with(&self, scene: &ResolvedScene, lod: LodChoice, skipping: Skipping) -> (Image, RayCounters) {
        self.render_of(scene, CpuQuality { lod, skipping, ..CpuQuality::default() })
    }

    pub fn render_of(&self, scene: &ResolvedScene, quality: CpuQuality) -> (Image, RayCounters) {
        let frame = self.frame_of(scene, quality);
        let mut states = frame.begin();
        let feedback = states.cast_pass(self);
        assert!(feedback.is_converged());
        (states.image(), feedback.counters)
    }

    /// The finest level, skipping on.
    pub fn render(&self, scene: &ResolvedScene) -> Image {
        self.render_with(scene, LodChoice::Fixed(Lod(0)), Skipping::On).0
    }
}

impl BrickView for Bricked {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        self.bricks.get(&key).map_or(Resident::Missing, Resident::from)
    }
}

fn brick_of(level: &Volume, pyramid: &Pyramid, key: BrickKey, map: &ValueMap) -> DecodedBrick {
    let core = pyramid.core_box(key);
    let extent = pyramid.stored_extent(key);
    let start = core.start.map(|s| s as i64 - 2);
    let mut bytes = Vec::new();
    for z in 0..extent[2] as i64 {
        for y in 0..extent[1] as i64 {
            for x in 0..extent[0] as i64 {
                let v = level.clamped([start[0] + x, start[1] + y, start[2] + z]);
                let v = if v.is_nan() { level.nodata.unwrap_or(v) } else { v };
                match level.voxel_type {
                    VoxelType::U8 => bytes.push(v as u8),
                    VoxelType::U16 => bytes.extend((v as u16).to_le_bytes()),
                    VoxelType::I16 => bytes.extend((v as i16).to_le_bytes()),
                    VoxelType::F32 => bytes.extend((v as f32).to_le_bytes()),
                    VoxelType::F64 => bytes.extend(v.to_le_bytes()),
                    other => panic!("no test writes {other}"),
                }
            }
        }
    }
    let cells = pyramid.macro_cells(key);
    let mut ranges = Vec::new();
    for z in 0..cells[2] {
        for y in 0..cells[1] {
            for x in 0..cells[0] {
                let first = [x, y, z].map(|c| c as i64 * 8 - 1);
                let mut range = ValueRange::EMPTY;
                for n in 0..1000 {
                    let at = [n % 10, n / 10 % 10, n / 100];
                    let v = level.clamped(std::array::from_fn(|a| core.start[a] as i64 + first[a] + at[a]));
                    if !v.is_nan() {
                        range.include(v);
                    }
                }
                ranges.push([range.min, range.max]);
            }
        }
    }
    let absence = Absence { nodata: level.nodata };
    let shape = BrickShape { voxel_type: level.voxel_type, extent };
    DecodedBrick::from_stored(key, shape, &bytes, ranges.into_iter(), map, absence, None)
}

/// A view in which at most `limit` new bricks become resident between passes, and old ones may leave.
pub struct Trickle<'a> {
    pub all: &'a Bricked,
    pub resident: Mutex<Vec<BrickKey>>,
}

impl BrickView for Trickle<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        if self.resident.lock().unwrap().contains(&key) { self.all.lookup(key) } else { Resident::Missing }
    }
}

/// Greatest difference of any channel, in grey levels of 255; infinite if a pixel is not finite.
pub fn difference(a: &Image, b: &Image) -> f64 {
    a.distance(b)
}

/// The scene of a JSON text, for this volume.
pub fn scene(volume: &Volume, json: &str) -> ResolvedScene {
    Scene::from_json(json).unwrap_or_else(|e| panic!("{e}\n{json}")).resolve(&volume.facts()).unwrap()
}

/// The reference picture; it must have converged.
pub fn reference(volume: &Volume, scene: &ResolvedScene) -> Image {
    let picture = render_reference_counted(&volume.reference(), scene);
    assert_eq!(picture.capped_pieces, 0, "the reference did not converge");
    picture.image
}

/// JSON of a transfer function from (value, [r, g, b], alpha).
pub fn points(unit_distance: f64, points: &[(f64, [f64; 3], f64)]) -> String {
    let points: Vec<String> =
        points.iter().map(|(v, c, a)| format!(r#"{{"value": {v}, "color": {c:?}, "alpha": {a}}}"#)).collect();
    format!(r#"{{"unit_distance": {unit_distance}, "points": [{}]}}"#, points.join(", "))
}

/// Marschner and Lobb's test signal on [-1, 1]^3, in [0, 1]; f_M = 6, alpha = 0.25.
pub fn marschner_lobb(n: usize) -> impl Fn([f64; 3]) -> f64 {
    use std::f64::consts::PI;
    move |p| {
        let [x, y, z] = p.map(|v| 2.0 * v / (n as f64 - 1.0) - 1.0);
        let r = (x * x + y * y).sqrt();
        let rho = (12.0 * PI * (PI * r / 2.0).cos() / 2.0).cos();
        ((1.0 - (PI * z / 2.0).sin()) + 0.25 * (1.0 + rho)) / (2.0 * 1.25)
    }
}

/// Pixels at which the reference does not change when the eye moves by a ten-thousandth of a voxel: not on silhouettes.
pub fn stable(volume: &Volume, scene: &ResolvedScene, exact: &Image) -> Vec<bool> {
    let moved = [(1e-4, 0.0), (-1e-4, 0.0), (0.0, 1e-4), (0.0, -1e-4)].map(|(x, y)| {
        let mut moved = scene.clone();
        moved.camera.eye += x * scene.camera.right + y * scene.camera.up;
        reference(volume, &moved)
    });
    let agree = |i: usize, other: &Image| (0..4).all(|c| (other.pixels[i][c] - exact.pixels[i][c]).abs() < 0.01);
    (0..exact.pixels.len()).map(|i| moved.iter().all(|m| agree(i, m))).collect()
}

/// Noise in [0, 1), the same on every run.
pub fn noise(p: [f64; 3]) -> f64 {
    let mut h = p.iter().fold(0x9e37_79b9_7f4a_7c15u64, |h, &v| (h ^ v.to_bits()).wrapping_mul(0xd6e8_feb8_6659_fd93));
    h ^= h >> 32;
    h = h.wrapping_mul(0xd6e8_feb8_6659_fd93);
    h ^= h >> 32;
    (h >> 11) as f64 / (1u64 << 53) as f64
}
