//! Small volumes cut into decoded bricks, and a loop that feeds them to the GPU ray caster.

#![allow(dead_code, reason = "each test file uses a part")]

pub mod compute;

use std::collections::HashMap;
use std::sync::OnceLock;

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::codec::BrickShape;
use supervol_format::random::Random;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickKey, BrickLayout, Dims, Geometry, Lod, Pyramid, ValueRange, VoxelType};
use supervol_runtime::engines::cpu::{CpuFrame, CpuQuality};
use supervol_runtime::engines::gpu::caster::{GpuRenderer, Insertion, PageEntry};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::engines::gpu::options::GpuOptions;
use supervol_runtime::engines::gpu::scene_tables::GpuVolume;
use supervol_runtime::engines::gpu::texels::VoxelStorage;
use supervol_runtime::engines::ray_scene::DrawnVolume;
use supervol_runtime::engines::reference::{ReferenceVolume, render_reference};
use supervol_runtime::engines::totals::GpuStats;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::{ResolvedScene, Scene};
use supervol_scene::value_map::ValueMap;

/// A new GPU, or `None` with a printed message if there is none; with `SUPERVOL_REQUIRE_GPU=1` that is a failure.
#[allow(clippy::print_stderr, reason = "a skipped test must be seen")]
pub fn gpu() -> Option<GpuDevice> {
    match GpuDevice::open() {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1") => {
            panic!("SUPERVOL_REQUIRE_GPU=1, but {error}")
        }
        Err(error) => {
            eprintln!("SKIPPED: no GPU adapter ({error})");
            None
        }
    }
}

/// As [`gpu`], but one device for all tests of a process: each device compiles its pipelines anew. Its counters of
/// traffic mix if tests run at the same time.
pub fn shared_gpu() -> Option<GpuDevice> {
    static GPU: OnceLock<Option<GpuDevice>> = OnceLock::new();
    GPU.get_or_init(gpu).clone()
}

/// A volume in memory, all its levels, and all its bricks.
pub struct TestVolume {
    pub pyramid: Pyramid,
    pub geometry: Geometry,
    pub map: ValueMap,
    pub range: ValueRange,
    pub storage: VoxelStorage,
    pub reference: ReferenceVolume,
    pub bricks: HashMap<BrickKey, DecodedBrick>,
    /// Bricks with another state than "its voxels".
    pub states: HashMap<BrickKey, PageEntry>,
}

/// How a test volume is stored.
#[derive(Clone, Copy)]
pub struct Storage {
    pub voxel_type: VoxelType,
    pub scale: f64,
    pub offset: f64,
    pub nodata: Option<f64>,
}

pub const F32: Storage = Storage { voxel_type: VoxelType::F32, scale: 1.0, offset: 0.0, nodata: None };
pub const U8: Storage = Storage { voxel_type: VoxelType::U8, scale: 1.0 / 255.0, offset: 0.0, nodata: None };
pub const I16: Storage =
    Storage { voxel_type: VoxelType::I16, scale: 1.0 / 4096.0, offset: 0.25, nodata: Some(-32768.0) };

impl TestVolume {
    /// A volume of a function of the voxel (NaN: absent), stored and rounded as `storage` says.
    pub fn new(
        dims: [usize; 3],
        core: u32,
        geometry: Geometry,
        storage: Storage,
        f: impl Fn([usize; 3]) -> f64,
    ) -> Self {
        let Storage { voxel_type, scale, offset, nodata } = storage;
        let container = |value: f64| {
            let stored = (value - offset) / scale;
            match voxel_type {
                _ if value.is_nan() => nodata.unwrap_or(f64::NAN),
                VoxelType::F32 => f64::from(stored as f32),
                _ => stored.round().clamp(voxel_type.limits().0 + f64::from(nodata.is_some()), voxel_type.limits().1),
            }
        };
        let mut level0 = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                level0.extend((0..dims[0]).map(|x| container(f([x, y, z]))));
            }
        }
        let absence = Absence { nodata };
        let data = |stored: f64| if absence.is_absent(stored) { f64::NAN } else { stored * scale + offset };
        let values: Vec<f64> = level0.iter().map(|&v| data(v)).collect();
        let mut range = ValueRange::EMPTY;
        values.iter().filter(|v| !v.is_nan()).for_each(|&v| range.include(v));
        let map = ValueMap::for_container(voxel_type, scale, offset, nodata, range);
        let pyramid = pyramid(dims, core);
        let reference = ReferenceVolume { dims, geometry, values, value_range: range };
        let mut bricks = HashMap::new();
        let mut level = (dims, level0);
        for lod in 0..pyramid.levels().len() {
            if lod > 0 {
                level = halved(&level.0, &level.1, absence, voxel_type);
            }
            for key in pyramid.keys_of(Lod(lod as u8)) {
                let at = |p: [usize; 3]| level.1[p[0] + level.0[0] * (p[1] + level.0[1] * p[2])];
                bricks.insert(key, brick(&pyramid, key, &at, storage, &map));
            }
        }
        let storage = match voxel_type {
            VoxelType::U8 | VoxelType::I8 => VoxelStorage::U8,
            VoxelType::U16 | VoxelType::I16 => VoxelStorage::U16,
            _ => VoxelStorage::F32,
        };
        Self { pyramid, geometry, map, range, storage, reference, bricks, states: HashMap::new() }
    }

    pub fn scene(&self, json: &str) -> ResolvedScene {
        let facts = VolumeFacts::plain(Dims(self.reference.dims.map(|n| n as u64)), self.geometry, self.range);
        Scene::from_json(json).expect("a valid scene").resolve(&facts).expect("a scene for this volume")
    }

    pub fn gpu_volume(&self) -> GpuVolume<'_> {
        GpuVolume {
            pyramid: &self.pyramid,
            geometry: &self.geometry,
            value_map: &self.map,
            value_range: self.range,
            storage: self.storage,
        }
    }

    pub fn reference_image(&self, scene: &ResolvedScene) -> Image {
        render_reference(&self.reference, scene)
    }

    pub fn cpu_image(&self, scene: &ResolvedScene, lod: LodChoice) -> Image {
        let quality = CpuQuality { lod, ..CpuQuality::default() };
        let (pyramid, geometry) = (&self.pyramid, &self.geometry);
        let volume = DrawnVolume { pyramid, geometry, map: self.map, value_range: self.range };
        let frame = CpuFrame::new(scene, &volume, quality);
        let mut states = frame.begin();
        let feedback = states.cast_pass(self);
        assert!(feedback.is_converged());
        states.image()
    }

    /// The GPU's picture with room for `slots` bricks at least, its statistics, and the passes it took.
    pub fn gpu_image(
        &self,
        gpu: &GpuDevice,
        scene: &ResolvedScene,
        lod: LodChoice,
        slots: u64,
        skipping: Skipping,
    ) -> (Image, GpuStats) {
        let memory_bytes = self.memory_for(gpu, scene, lod, slots);
        let options = GpuOptions { memory_bytes, skipping, ..GpuOptions::default() };
        let mut renderer = GpuRenderer::new(gpu, &self.gpu_volume(), scene, lod, options, None).expect("a renderer");
        for (&key, &state) in &self.states {
            renderer.set_state(key, state);
        }
        let pass_limit = 200 + 64 * self.bricks.len();
        for _ in 0..pass_limit {
            let feedback = renderer.cast_pass().expect("a pass");
            assert_eq!(feedback.device.anomalies, 0, "anomalies");
            if feedback.is_converged() {
                assert!(feedback.misses.is_empty());
                return (renderer.image().expect("an image"), renderer.stats());
            }
            assert!(!feedback.misses.is_empty(), "{} rays wait for nothing", feedback.unfinished_rays);
            for miss in &feedback.misses {
                assert!(!renderer.is_resident(miss.key), "{} is resident", miss.key);
                if renderer.insert(&self.bricks[&miss.key]).expect("an upload") == Insertion::NoRoom {
                    break;
                }
            }
        }
        panic!("not converged after {pass_limit} passes: {:?}", renderer.stats());
    }

    /// The least budget that fits this many slots.
    pub fn memory_for(&self, gpu: &GpuDevice, scene: &ResolvedScene, lod: LodChoice, slots: u64) -> u64 {
        let options = GpuOptions { memory_bytes: 0, ..GpuOptions::default() };
        match GpuRenderer::new(gpu, &self.gpu_volume(), scene, lod, options, None) {
            Err(GpuError::Budget { needed, slot_bytes, min_slots, .. }) => {
                needed + slots.saturating_sub(min_slots) * slot_bytes * 16 / 15 + 16 * u64::from(slots > min_slots)
            }
            Err(error) => panic!("{error}"),
            Ok(_) => panic!("a renderer without memory"),
        }
    }
}

impl BrickView for TestVolume {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        match self.states.get(&key) {
            Some(PageEntry::Nothing) => Resident::Nothing,
            Some(PageEntry::TooCoarse) => Resident::TooCoarse,
            Some(PageEntry::Uniform(value)) => Resident::Uniform(*value),
            Some(PageEntry::Failed) => Resident::UseParent,
            Some(PageEntry::Missing) | None => self.bricks.get(&key).map_or(Resident::Missing, Resident::from),
        }
    }
}

pub fn pyramid(dims: [usize; 3], core: u32) -> Pyramid {
    let mut size = dims;
    let mut factors = Vec::new();
    while size.iter().any(|&n| n > core as usize) {
        factors.push(size.map(|n| if n > 1 { 2 } else { 1 }));
        size = size.map(|n| n.div_ceil(2));
    }
    let layout = BrickLayout::new(core).expect("a core size");
    Pyramid::new(Dims(dims.map(|n| n as u64)), layout, &factors).expect("a pyramid")
}

fn halved(dims: &[usize; 3], values: &[f64], absence: Absence, voxel_type: VoxelType) -> ([usize; 3], Vec<f64>) {
    let size = dims.map(|n| n.div_ceil(2));
    let mut out = Vec::new();
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                let (mut sum, mut count) = (0.0, 0.0);
                for corner in 0..8 {
                    let p = [2 * x + (corner & 1), 2 * y + (corner >> 1 & 1), 2 * z + (corner >> 2)];
                    if (0..3).all(|a| p[a] < dims[a]) {
                        let value = values[p[0] + dims[0] * (p[1] + dims[1] * p[2])];
                        if !absence.is_absent(value) {
                            sum += value;
                            count += 1.0;
                        }
                    }
                }
                let mean = if count > 0.0 { sum / count } else { absence.marker() };
                out.push(if voxel_type.is_float() || count == 0.0 { mean } else { mean.round() });
            }
        }
    }
    (size, out)
}

/// The decoded brick of a key; `at` is the stored value of a voxel of its level.
pub fn brick(
    pyramid: &Pyramid,
    key: BrickKey,
    at: &dyn Fn([usize; 3]) -> f64,
    storage: Storage,
    map: &ValueMap,
) -> DecodedBrick {
    let start = pyramid.core_box(key).start;
    let extent = pyramid.stored_extent(key);
    let dims = pyramid.level_at(key.lod()).dims.0;
    let voxel = |p: [usize; 3]| {
        at(std::array::from_fn(|a| (start[a] as usize + p[a]).saturating_sub(APRON).min(dims[a] as usize - 1)))
    };
    let mut bytes = Vec::new();
    for z in 0..extent[2] {
        for y in 0..extent[1] {
            for x in 0..extent[0] {
                supervol_format::with_voxel!(storage.voxel_type, V => {
                    use supervol_format::voxel_type::Voxel;
                    let mut out = [0; size_of::<V>()];
                    V::from_f64(voxel([x, y, z])).write_le(&mut out);
                    bytes.extend_from_slice(&out);
                });
            }
        }
    }
    let absence = Absence { nodata: storage.nodata };
    let cells = pyramid.macro_cells(key);
    let mut ranges = Vec::new();
    for i in 0..cells.iter().product::<usize>() {
        let cell = [i % cells[0], i / cells[0] % cells[1], i / (cells[0] * cells[1])];
        // Interpolation in [8m - 1/2, 8m + 15/2] reaches voxels 8m - 1 to 8m + 8; the apron shifts them by 2.
        let mut range = ValueRange::EMPTY;
        let low = cell.map(|m| m * MACRO_CELL + APRON - 1);
        for z in low[2]..(low[2] + 10).min(extent[2]) {
            for y in low[1]..(low[1] + 10).min(extent[1]) {
                for x in low[0]..(low[0] + 10).min(extent[0]) {
                    let value = voxel([x, y, z]);
                    if !absence.is_absent(value) {
                        range.include(value);
                    }
                }
            }
        }
        ranges.push([range.min, range.max]);
    }
    let shape = BrickShape { voxel_type: storage.voxel_type, extent };
    DecodedBrick::from_stored(key, shape, &bytes, ranges.into_iter(), map, absence, None)
}

/// The Marschner-Lobb signal on n^3 voxels, values 0 to 1.
pub fn marschner_lobb(n: usize) -> impl Fn([usize; 3]) -> f64 {
    move |voxel| {
        let [x, y, z] = voxel.map(|i| 2.0 * i as f64 / (n as f64 - 1.0) - 1.0);
        let pi = std::f64::consts::PI;
        let rho = (2.0 * pi * 6.0 * (pi * (x * x + y * y).sqrt() / 2.0).cos()).cos();
        (1.0 - (pi * z / 2.0).sin() + 0.25 * (1.0 + rho)) / (2.0 * 1.25)
    }
}

/// Noise in [0, 1), the same for the same voxel.
pub fn noise(voxel: [usize; 3]) -> f64 {
    let [x, y, z] = voxel.map(|i| i as u64);
    Random::new(x | y << 20 | z << 40).unit()
}

/// The greatest difference of a channel, in 1/255; infinite if a pixel is not finite.
pub fn greatest_difference(a: &Image, b: &Image) -> f64 {
    a.distance(b)
}
