#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! Positions on rays, the bricks that hold them, and the pages drawn there: `camera.wgsl` and `page_table.wgsl` against
//! `f64`.
//!
//! The twins of `ray_from`, `ray_at_level` and `point_from` are lines of `f64`. The twin of `region_at` and `page_of`
//! is the CPU ray caster itself: a ray that finds nothing resident waits for the brick that holds its position.

use std::collections::HashSet;

use bytemuck::{Pod, Zeroable};
use supervol_format::random::Random;
use supervol_format::{BrickIndex, BrickKey, Dims, Geometry, Lod, Pyramid, ValueRange};
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cells::shade::ChordGradient;
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::layout::{
    Dispatch, PAGE_FAILED, PAGE_MISSING, PAGE_REFINE, PAGE_RESIDENT, PAGE_UNIFORM, STATUS_ACTIVE, Scene as GpuScene,
    SlotGrid, View,
};
use supervol_runtime::engines::gpu::piece_table::PieceTable;
use supervol_runtime::engines::gpu::rays::{RayGrid, ViewLines};
use supervol_runtime::engines::gpu::scene_tables::{Exactness, FeedbackPlaces, GpuVolume};
use supervol_runtime::engines::gpu::texels::VoxelStorage;
use supervol_runtime::engines::gpu::{scene_tables, shaders};
use supervol_runtime::lod::{LodChoice, LodRule};
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::residency::{BrickView, Resident, Voxels};
use supervol_scene::camera::Projection;
use supervol_scene::clip::{IndexRay, Segment, clip_ray};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::greatest;
use supervol_scene::scene::{ResolvedScene, Scene};
use supervol_scene::value_map::ValueMap;

use crate::gpu_support;
use gpu_support::compute::{Resource, run};
use gpu_support::{F32, gpu, marschner_lobb, pyramid};
use supervol_runtime::engines::cells::frame::CellFrame;
use supervol_runtime::engines::cells::rays::CellRays;
use supervol_runtime::engines::ray_scene::{BrickChoice, DrawnVolume};

const SEED: u64 = 20_261_121;
/// Largest error of positions, voxels; also 2^26 voxels from the origin.
const PLACE_TOLERANCE: f64 = 5e-7;
/// Largest distance, voxels, between a face and the position at which a ray leaves a brick: t is an `f32` of some ten
/// voxels.
const FACE_TOLERANCE: f64 = 1e-4;
/// Largest error of differences of values between 0 and 1.
const GRADIENT_TOLERANCE: f64 = 2e-6;
const RANGE: ValueRange = ValueRange { min: 0.0, max: 1.0 };

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Case {
    pixel: [u32; 2],
    strides: u32,
    padding_0: u32,
    near: [i32; 3],
    level: u32,
    cell: [i32; 3],
    padding_1: u32,
    a: [f32; 3],
    t: f32,
    b: [f32; 3],
    padding_2: f32,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Found {
    voxel: [i32; 3],
    found: u32,
    fraction: [f32; 3],
    leave: f32,
    point: [f32; 3],
    payload: u32,
    region: [i32; 4],
    page: [i32; 4],
    /// Number and state.
    entry: [u32; 4],
    /// Gradients at three positions of the chord; w: whether there is one.
    gradients: [[f32; 4]; 3],
    /// Parameters at which the segment begins and ends, relative to base points `segment_strides` away.
    segment: [f32; 2],
    segment_strides: [u32; 2],
    length: f32,
    status: u32,
    place: u32,
    padding: u32,
}

/// A volume without voxels, and a camera.
struct Setting {
    pyramid: Pyramid,
    geometry: Geometry,
    map: ValueMap,
    scene: ResolvedScene,
    lod: LodChoice,
}

impl Setting {
    /// Levels are chosen so that voxels cover at most `voxel_pixels`: rays meet bricks of several levels.
    fn new(dims: [usize; 3], core: u32, geometry: Geometry, camera: &str, voxel_pixels: f64) -> Self {
        let facts = VolumeFacts::plain(Dims(dims.map(|n| n as u64)), geometry, RANGE);
        let json = format!(
            r#"{{"camera": {{{camera}}}, "image": {{"width": 64, "height": 64}}, "transfer_function": "grey",
                "shading": {{}}}}"#
        );
        let scene = Scene::from_json(&json).expect("a scene").resolve(&facts).expect("a scene for this volume");
        let map = ValueMap::for_container(F32.voxel_type, 1.0, 0.0, None, RANGE);
        let lod = LodChoice::Auto { voxel_pixels };
        Self { pyramid: pyramid(dims, core), geometry, map, scene, lod }
    }

    fn volume(&self) -> GpuVolume<'_> {
        let (pyramid, geometry, value_map) = (&self.pyramid, &self.geometry, &self.map);
        GpuVolume { pyramid, geometry, value_map, value_range: RANGE, storage: VoxelStorage::F32 }
    }

    /// State and payload of every brick; bricks of `failed` have failed.
    fn page_table(&self, failed: &HashSet<BrickKey>, random: &mut Random) -> Vec<[u32; 2]> {
        let rule = LodRule::new(self.lod, &self.scene.camera, &self.geometry);
        let page = |entry: u64| {
            let key = self.pyramid.key(entry).expect("entries below the count have keys");
            let states = [PAGE_MISSING, PAGE_UNIFORM, PAGE_RESIDENT];
            let state = if failed.contains(&key) { PAGE_FAILED } else { states[(random.next_u64() % 3) as usize] };
            let refine = if rule.is_fine_enough(&self.pyramid, key) { 0 } else { PAGE_REFINE };
            [state | refine, random.next_u64() as u32]
        };
        (0..self.pyramid.brick_count()).map(page).collect()
    }

    /// A level-0 index point in the index space of a level: `(p + 1/2) / scale - 1/2`.
    fn at_level(&self, p: [f64; 3], level: Lod) -> [f64; 3] {
        let scale = self.pyramid.level_at(level).scale;
        std::array::from_fn(|a| (p[a] + 0.5) / scale[a] as f64 - 0.5)
    }

    /// Distance of a level-0 index point from a brick, voxels of level 0; 0 inside.
    fn outside(&self, p: [f64; 3], key: BrickKey) -> f64 {
        let (level, core) = (self.pyramid.level_at(key.lod()), self.pyramid.layout().core() as f64);
        greatest((0..3).map(|a| {
            let edge = core * level.scale[a] as f64;
            let low = f64::from(key.brick().0[a]) * edge - 0.5;
            (low - p[a]).max(p[a] - low - edge).max(0.0)
        }))
    }

    /// The brick of level 0 that holds an index point.
    fn brick_at(&self, p: [f64; 3]) -> BrickKey {
        let core = self.pyramid.layout().core() as f64;
        let bricks = self.pyramid.level_at(Lod::FINEST).bricks;
        let index = std::array::from_fn(|a| (((p[a] + 0.5) / core) as u32).min(bricks[a] - 1));
        BrickKey::new(Lod::FINEST, BrickIndex(index))
    }

    /// World length at which a ray leaves a brick.
    fn leave(&self, ray: &IndexRay, key: BrickKey) -> f64 {
        let (level, core) = (self.pyramid.level_at(key.lod()), self.pyramid.layout().core() as f64);
        let leaves = (0..3).filter(|&a| ray.direction[a] != 0.0).map(|a| {
            let side = f64::from(key.brick().0[a]) + if ray.direction[a] > 0.0 { 1.0 } else { 0.0 };
            (side * core * level.scale[a] as f64 - 0.5 - ray.origin[a]) / ray.direction[a]
        });
        leaves.fold(f64::INFINITY, f64::min)
    }
}

/// A ray, and a position on it.
struct Place {
    pixel: usize,
    ray: IndexRay,
    segment: Segment,
    /// World lengths: the ray's origin, one unit of its parameter, the base point, and the position.
    origin: f64,
    unit: f64,
    base: f64,
    t: f64,
    is_at_face: bool,
    case: Case,
}

/// A position on every ray of the picture that meets the volume.
fn places(setting: &Setting, random: &mut Random) -> Vec<Place> {
    let camera = &setting.scene.camera;
    let core = setting.pyramid.layout().core() as f64;
    let dims = setting.pyramid.level_at(Lod::FINEST).dims;
    let lines = ViewLines::new(camera, &setting.geometry, dims);
    let place = |pixel: u32| {
        let ray = camera.ray(pixel % camera.width, pixel / camera.width);
        let index_ray = IndexRay::new(&ray, &setting.geometry);
        let segment = clip_ray(&ray, &index_ray, dims, &setting.scene.clip)?;
        // The GPU's rays are measured by depth, from the plane where they begin.
        let unit = 1.0 / ray.direction.dot(camera.forward);
        let (stride, origin) = (lines.stride() * unit, lines.depth() * unit);
        let strides_to = |t: f64| ((t - origin) / stride).floor().max(0.0) as u64;
        let first = strides_to(segment.t0);
        let strides = first + random.next_u64() % (strides_to(segment.t1) - first + 1);
        let base = origin + strides as f64 * stride;
        // A ray crosses a whole brick from one base point. Some positions lie in a face, as exactly as `f32` allows.
        let reach = stride * [1.0, 8.0][(random.next_u64() % 2) as usize];
        let least = (segment.t0 - base).max(0.0);
        let t = random.between(least, reach.min(segment.t1 - base).max(least));
        let is_at_face = random.next_u64().is_multiple_of(4);
        let t = if is_at_face { setting.leave(&index_ray, setting.brick_at(index_ray.at(base + t))) - base } else { t };
        // The value that the shader receives.
        let t = f64::from((t / unit) as f32) * unit;
        // At the end of the volume there is no next brick.
        if base + t > segment.t1 - 0.01 || base + t < segment.t0 {
            return None;
        }
        let level = Lod((random.next_u64() % setting.pyramid.levels().len() as u64) as u8);
        let near = setting.at_level(index_ray.at(base + t), level).map(|v| v.floor() as i32);
        // A chord in a face of the cell reaches four corners only.
        let chord: [[f32; 2]; 3] = std::array::from_fn(|_| {
            let ends = [random.between(0.0, 1.0), random.between(0.0, 1.0)];
            [ends, ends, [0.0; 2], [1.0; 2]][(random.next_u64() % 4) as usize].map(|end| end as f32)
        });
        let case = Case {
            pixel: [pixel % camera.width, pixel / camera.width],
            padding_0: 0,
            near,
            level: u32::from(level.0),
            cell: std::array::from_fn(|_| (random.next_u64() % (core as u64 + 1)) as i32 - 1),
            strides: strides as u32,
            a: chord.map(|ends| ends[0]),
            padding_1: 0,
            t: (t / unit) as f32,
            b: chord.map(|ends| ends[1]),
            padding_2: 0.0,
        };
        let pixel = pixel as usize;
        Some(Place { pixel, ray: index_ray, segment, origin, unit, base, t: base + t, is_at_face, case })
    };
    (0..camera.width * camera.height).filter_map(place).collect()
}

/// Nothing is resident; some bricks have failed.
struct Nothing<'a>(&'a HashSet<BrickKey>);

impl BrickView for Nothing<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        if self.0.contains(&key) { Resident::UseParent } else { Resident::Missing }
    }
}

/// The bricks that the CPU's rays wait for at these positions.
fn wanted(setting: &Setting, places: &[Place], failed: &HashSet<BrickKey>) -> Vec<BrickKey> {
    // The shader's twin, whose rays can be put anywhere.
    let Setting { pyramid, geometry, map, .. } = setting;
    let volume = DrawnVolume { pyramid, geometry, map: *map, value_range: RANGE };
    let bricks = BrickChoice { lod: setting.lod, skipping: Skipping::On };
    let mut rays = CellRays::new(CellFrame::new(&setting.scene, &volume, bricks, CellRule::DEFAULT));
    places.iter().for_each(|place| rays.states_mut()[place.pixel].t = place.t);
    rays.cast_pass(&Nothing(failed));
    places.iter().map(|place| rays.states()[place.pixel].waiting.expect("nothing is resident")).collect()
}

fn key([x, y, z, level]: [i32; 4]) -> BrickKey {
    BrickKey::new(Lod(level as u8), BrickIndex([x, y, z].map(|i| i as u32)))
}

/// The voxels of a brick with holes: values, and the bits of the absent one.
fn voxels(setting: &Setting) -> (Vec<f32>, u32) {
    let key = BrickKey::new(Lod::FINEST, BrickIndex([1, 0, 0]));
    let field = |p: [usize; 3]| {
        if (3 * p[0] + 5 * p[1] + 7 * p[2]).is_multiple_of(61) { f64::NAN } else { marschner_lobb(41)(p) }
    };
    let brick = gpu_support::brick(&setting.pyramid, key, &field, F32, &setting.map);
    let edge = setting.pyramid.layout().core() as u32 + 4;
    assert_eq!(brick.extent, [edge; 3], "a whole brick");
    let Voxels::F32(values) = brick.voxels else { panic!("f32 stays f32") };
    (values, edge)
}

fn gpu_results(
    gpu: &GpuDevice,
    setting: &Setting,
    pages: &[[u32; 2]],
    voxels: &(Vec<f32>, u32),
    cases: &[Case],
) -> Vec<Found> {
    let tf = supervol_scene::transfer_function::RenderTransferFunction::new(
        &setting.scene.transfer_function,
        setting.map.shift,
    );
    let unused = SlotGrid { slots: [1; 3], first: u32::MAX };
    let grids = [SlotGrid { slots: [1; 3], first: 0 }, unused, unused, unused];
    let volume = setting.volume();
    let places = FeedbackPlaces { grids, slots: 1, entries: 1 };
    let light = PieceTable::new(&setting.scene.transfer_function, setting.map.shift, 0.01);
    let exactness = Exactness { skipping: Skipping::On, max_error: 0.5 / 255.0, sums_errors: false };
    let mut config =
        scene_tables::config(&volume, &setting.scene, &tf, &light, exactness, places).expect("a configuration");
    let tables = scene_tables::tables(&volume, &setting.scene).expect("tables");
    let (camera, dims) = (&setting.scene.camera, setting.pyramid.level_at(Lod::FINEST).dims);
    let lines = ViewLines::new(camera, &setting.geometry, dims);
    let grid = RayGrid { width: camera.width, height: camera.height };
    let view = lines.view(camera, &setting.geometry, dims, &setting.scene.clip).expect("a view");
    let view = View { tiles_x: grid.tiles()[0], ..view };
    config.stride = lines.stride() as f32;
    let scene = GpuScene { config, tables, view, job: Dispatch::zeroed() };
    let group_0 = [
        (0, Resource::Storage(bytemuck::bytes_of(&scene))),
        (1, Resource::Storage(bytemuck::cast_slice(pages))),
        (8, Resource::Voxels(&voxels.0, voxels.1)),
        (9, Resource::Nothing),
        (10, Resource::Nothing),
        (11, Resource::Nothing),
    ];
    run(gpu, shaders::TEST_PLACES, &group_0, cases)
}

/// `ray_from`, `ray_at_level`, `point_from`: greatest distances from `f64`, voxels of the level.
fn check_points(setting: &Setting, places: &[Place], found: &[Found]) {
    let mut off = [0.0f64; 2];
    for (place, found) in places.iter().zip(found) {
        assert!(found.fraction.iter().all(|f| (0.0..=1.0).contains(f)), "{:?}", found.fraction);
        let base = place.ray.at(place.base);
        let from_base = (0..3).map(|a| f64::from(found.voxel[a]) + f64::from(found.fraction[a]) - base[a]);
        off[0] = greatest([off[0]].into_iter().chain(from_base));
        let level = Lod(place.case.level as u8);
        let exact = setting.at_level(place.ray.at(place.t), level);
        let from_point = (0..3).map(|a| f64::from(place.case.near[a]) + f64::from(found.point[a]) - exact[a]);
        off[1] = greatest([off[1]].into_iter().chain(from_point));
    }
    println!("  ray_from {:.1e}, point_from {:.1e} voxels off", off[0], off[1]);
    assert!(off.iter().all(|&off| off < PLACE_TOLERANCE), "{off:?} voxels");
}

/// `begin_ray`: begin and end of segments, voxels of level 0; and the length of one unit of t.
fn check_segments(setting: &Setting, places: &[Place], found: &[Found]) {
    let mut off = 0.0f64;
    let stride = {
        let dims = setting.pyramid.level_at(Lod::FINEST).dims;
        ViewLines::new(&setting.scene.camera, &setting.geometry, dims).stride()
    };
    for (place, found) in places.iter().zip(found) {
        assert_eq!(found.status, STATUS_ACTIVE, "a ray that meets the volume begins");
        let camera = &setting.scene.camera;
        let grid = RayGrid { width: camera.width, height: camera.height };
        assert_eq!(u64::from(found.place), grid.place_of(place.case.pixel), "a place of the pixel");
        assert!((f64::from(found.length) / place.unit - 1.0).abs() < 1e-6, "{} is not {}", found.length, place.unit);
        for (i, exact) in [place.segment.t0, place.segment.t1].into_iter().enumerate() {
            let t = f64::from(found.segment_strides[i]) * stride + f64::from(found.segment[i]);
            let length = place.origin + t * place.unit - exact;
            off = greatest([off].into_iter().chain(place.ray.direction.map(|d| d * length)));
        }
    }
    println!("  segments {off:.1e} voxels off");
    assert!(off < FACE_TOLERANCE, "{off}");
}

/// `region_at`, `region_leave`, `page_of`. At a face, rounding may decide for either brick.
fn check_bricks(setting: &Setting, places: &[Place], found: &[Found], failed: &HashSet<BrickKey>, pages: &[[u32; 2]]) {
    let regions = wanted(setting, places, &HashSet::new());
    let drawn = wanted(setting, places, failed);
    let (mut at_faces, mut from_parents, mut off) = (0, 0, 0.0f64);
    let mut levels = HashSet::new();
    for (i, (place, found)) in places.iter().zip(found).enumerate() {
        let at = place.ray.at(place.t);
        assert_eq!(found.found, 1, "the place {at:?} is in the volume");
        let region = key(found.region);
        assert!(setting.outside(at, region) < FACE_TOLERANCE, "{at:?} is not in {region}");
        assert!(found.leave > place.case.t, "a ray does not get on from {at:?}");
        let length = setting.leave(&place.ray, region) - place.base - f64::from(found.leave) * place.unit;
        off = greatest([off].into_iter().chain(place.ray.direction.map(|d| d * length)));
        let page = key(found.page);
        let entry = setting.pyramid.entry(page);
        assert_eq!(u64::from(found.entry[0]), entry, "{page}");
        let expected = pages[entry as usize];
        assert_eq!([found.entry[1] | expected[0] & PAGE_REFINE, found.payload], expected, "{page}");
        if region == regions[i] {
            assert_eq!(page, drawn[i], "what is drawn for {region}");
            from_parents += usize::from(page != region);
        } else {
            assert!(setting.outside(at, regions[i]) < FACE_TOLERANCE, "{at:?}: {region}, not {}", regions[i]);
            at_faces += usize::from(!place.is_at_face);
        }
        levels.insert(region.lod());
    }
    // An orthographic camera sees all bricks at one level.
    let is_perspective = matches!(setting.scene.camera.projection, Projection::Perspective { .. });
    assert_eq!(levels.len() > 1, is_perspective, "levels {levels:?}");
    println!(
        "  {} places in {} levels, {at_faces} decided by rounding, {from_parents} drawn from parents, leaves {off:.1e} voxels off",
        places.len(),
        levels.len()
    );
    assert!(at_faces * 200 < places.len(), "{at_faces} of {} places are decided by rounding", places.len());
    assert!(from_parents * 20 > places.len() && off < FACE_TOLERANCE, "{from_parents} from parents, {off} voxels");
}

/// The taps of the central differences, and their cubics along chords.
fn check_gradients(places: &[Place], found: &[Found], (voxels, edge): &(Vec<f32>, u32)) {
    let tap = |p: [i32; 3]| voxels[p.iter().rev().fold(0, |at, &i| at * *edge as usize + (i + 2) as usize)];
    let (mut present, mut off) = (0, 0.0f64);
    for (place, found) in places.iter().zip(found) {
        let Case { cell, a, b, .. } = place.case;
        let differences = [0, 1, 2].map(|axis| {
            std::array::from_fn(|corner| {
                let at: [i32; 3] = std::array::from_fn(|i| cell[i] + (corner >> i & 1) as i32);
                let step = |by: i32| std::array::from_fn(|i| at[i] + if i == axis { by } else { 0 });
                0.5 * (tap(step(1)) - tap(step(-1)))
            })
        });
        let exact = ChordGradient::new(differences, a.map(f64::from), b.map(f64::from));
        for (u, gradient) in [0.0, 0.5, 1.0].into_iter().zip(found.gradients) {
            assert_eq!(gradient[3], f32::from(u8::from(exact.is_some())), "{cell:?} from {a:?} to {b:?}");
            if let Some(exact) = exact {
                off = greatest([off].into_iter().chain((0..3).map(|c| f64::from(gradient[c] - exact.at(u)[c]))));
            }
        }
        present += usize::from(exact.is_some());
    }
    println!("  gradients {off:.1e} off, {present} of {} present", places.len());
    assert!(off < GRADIENT_TOLERANCE, "{off}");
    assert!((places.len() / 10..places.len() * 9 / 10).contains(&present), "{present} of {} present", places.len());
}

#[test]
fn places_bricks_and_gradients_equal_their_twins() {
    let Some(gpu) = gpu() else { return };
    println!("seed {SEED}");
    let oblique = Geometry {
        spacing: [0.5, 2.0, 1.0],
        origin: [6.5e6, -300.0, 12.0],
        direction: [0.6, -0.8, 0.1, 0.8, 0.6, 0.0, 0.0, 0.2, 1.0],
    };
    let [x, y, z] = oblique.world_from_index().transform_point3(glam::DVec3::new(60.0, 20.0, 25.0)).to_array();
    let inside =
        format!(r#""eye": [{x}, {y}, {z}], "target": [{}, {}, {z}], "up": [0, 0, 1], "fov_y": 85"#, x + 3.0, y + 4.0);
    let far = (1 << 22) as f64;
    let near = format!(
        r#""eye": [{}, 90, 140], "target": [{}, 30, 60], "up": [0, 1, 0], "fov_y": 60"#,
        far - 900.0,
        far - 500.0
    );
    let furthest = format!(
        r#""eye": [{}, 90, 140], "target": [{}, 30, 60], "up": [0, 1, 0], "fov_y": 60"#,
        16.0 * far - 900.0,
        16.0 * far - 500.0
    );
    let along = r#""eye": [-1000, 33.3, 61.7], "target": [4194304, 38.1, 60.2], "up": [0, 1, 0], "height": 60"#;
    let axis = r#""eye": [-70, 30.3, 25.2], "target": [10, 30.3, 25.2], "up": [0, 1, 0], "height": 50"#;
    let settings = [
        ("inside an oblique grid", Setting::new([150, 90, 60], 16, oblique, &inside, 9.0)),
        ("far end of a long volume", Setting::new([1 << 22, 70, 130], 64, Geometry::IDENTITY, &near, 1.0)),
        ("far end of the longest volume", Setting::new([1 << 26, 140, 260], 128, Geometry::IDENTITY, &furthest, 1.0)),
        ("all along it", Setting::new([1 << 22, 70, 130], 64, Geometry::IDENTITY, along, 1.0)),
        ("along an axis", Setting::new([70, 61, 50], 16, Geometry::IDENTITY, axis, 1.0)),
    ];
    for (i, (name, setting)) in settings.iter().enumerate() {
        println!("{name}:");
        let mut random = Random::new(SEED + i as u64);
        let failed: HashSet<BrickKey> = (0..setting.pyramid.brick_count())
            .filter_map(|entry| setting.pyramid.key(entry))
            .filter(|key| key.lod() != setting.pyramid.coarsest() && random.next_u64().is_multiple_of(3))
            .collect();
        let pages = setting.page_table(&failed, &mut random);
        let places = places(setting, &mut random);
        assert!(places.len() > 500, "{name}: {} rays meet the volume", places.len());
        let voxels = voxels(setting);
        let cases: Vec<Case> = places.iter().map(|place| place.case).collect();
        let found = gpu_results(&gpu, setting, &pages, &voxels, &cases);
        check_points(setting, &places, &found);
        check_segments(setting, &places, &found);
        check_bricks(setting, &places, &found, &failed, &pages);
        check_gradients(&places, &found, &voxels);
    }
}
