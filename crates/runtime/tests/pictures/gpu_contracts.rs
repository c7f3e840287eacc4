#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! Contracts of the GPU backend besides pictures: huge coordinates, budgets, evictions, errors, a lost device.

use std::time::Instant;

use supervol_format::{BrickIndex, BrickKey, Dims, Geometry, Lod, Pyramid, ValueRange};
use supervol_runtime::engines::cpu::{CpuFrame, CpuQuality};
use supervol_runtime::engines::gpu::caster::{GpuRenderer, Insertion, KnownAnswers, PageEntry};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::engines::gpu::options::GpuOptions;
use supervol_runtime::engines::gpu::scene_tables::GpuVolume;
use supervol_runtime::engines::gpu::texels::VoxelStorage;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stop::Stop;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::residency::{BrickView, DecodedBrick, Resident};
use supervol_scene::clip::{IndexRay, clip_slab};
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::{Image, greatest};
use supervol_scene::scene::{ResolvedScene, Scene};
use supervol_scene::value_map::ValueMap;

use crate::gpu_support;
use gpu_support::{F32, TestVolume, U8, brick, gpu, greatest_difference, marschner_lobb, pyramid};
use supervol_runtime::engines::ray_scene::DrawnVolume;

const FINEST: LodChoice = LodChoice::Fixed(Lod::FINEST);
const SCENE: &str = r#"{
    "camera": {"eye": [75, 55, 95], "target": [20, 20, 20], "up": [0, 1, 0], "fov_y": 30},
    "image": {"width": 32, "height": 24},
    "transfer_function": {"unit_distance": 4, "points": [
        {"value": 0, "color": [0, 0, 1], "alpha": 0.01}, {"value": 1, "color": [1, 0.5, 0], "alpha": 0.3}]}}"#;

fn volume() -> TestVolume {
    TestVolume::new([41; 3], 16, Geometry::IDENTITY, U8, marschner_lobb(41))
}

/// One brick of 64^3 at the far end of a very long volume; all others are absent.
struct FarBrick {
    key: BrickKey,
    brick: DecodedBrick,
}

impl BrickView for FarBrick {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        if key == self.key { Resident::from(&self.brick) } else { Resident::Nothing }
    }
}

/// Change of values per voxel of a brick of this edge, along one axis. Values stay between 0 and 1; alpha equals the
/// value.
fn value_per_voxel(edge: u32) -> f64 {
    1.0 / f64::from(edge + 2)
}

/// The position on a ray that the picture shows, for a field that measures positions along one axis, in voxels behind
/// the brick's first one.
///
/// In closed form: the ray's line meets the brick's cube, in which the field is linear. It is constant in the outer
/// half voxels across the volume.
fn place_seen(ray: &IndexRay, start: [f64; 3], edge: u32, axis: usize, mode: &str) -> Option<f64> {
    let slab = |interval, a: usize| {
        let end = start[a] + if a == 0 { f64::from(edge) } else { 64.0 };
        clip_slab(ray.origin[a], ray.direction[a], start[a] - 0.5, end - 0.5, interval)
    };
    let (t0, t1) = (0..3).try_fold((0.0, f64::INFINITY), slab)?;
    let at = |t: f64| {
        let place = ray.at(t)[axis] - start[axis];
        if axis == 0 { place } else { place.clamp(0.0, 63.0) }
    };
    Some(match mode {
        "mip" => at(t0).max(at(t1)),
        "minip" => at(t0).min(at(t1)),
        // Along x nothing is clamped: the mean is that of the ends.
        _ => 0.5 * (at(t0) + at(t1)),
    })
}

/// S39: no position on a ray is off by 1/256 of a voxel along any axis, 2^23 voxels from the origin, also for rays that
/// come all that way. The same holds 2^26 voxels from the origin, the limit of brick keys, for rays that a clip box
/// lets begin near the end. Each axis is measured by a field of its own, against the closed form; so is the CPU.
#[test]
fn huge_coordinates() {
    let Some(gpu) = gpu() else { return };
    places_in_a_volume_of(&gpu, 1 << 23, 64, false);
    places_in_a_volume_of(&gpu, 1 << 26, 128, true);
}

fn places_in_a_volume_of(gpu: &GpuDevice, length: usize, edge: u32, is_clipped: bool) {
    let pyramid = pyramid([length, 64, 64], edge);
    let key = BrickKey::new(Lod(0), BrickIndex([length as u32 / edge - 3, 0, 0]));
    let value_per_voxel = value_per_voxel(edge);
    let start = pyramid.core_box(key).start.map(|s| s as f64);
    let range = ValueRange { min: -0.1, max: 1.1 };
    let map = ValueMap::for_container(F32.voxel_type, 1.0, 0.0, None, range);
    let near =
        format!(r#""eye": [{}, 90.3, 120.1], "target": [{}, 30, 31], "fov_y": 30"#, start[0] - 70.7, start[0] + 30.0);
    let along = format!(r#""eye": [-1000, 32.1, 31.9], "target": [{}, 41.3, 27.2], "height": 30"#, start[0] + 30.0);
    for (axis, mode) in ["mean", "mip", "minip"].into_iter().enumerate() {
        let at = |p: [usize; 3]| (1.0 + p[axis] as f64 - start[axis]) * value_per_voxel;
        let far = FarBrick { key, brick: brick(&pyramid, key, &at, F32, &map) };
        for (name, camera) in [("near", &near), ("along the whole volume", &along)] {
            let clip = format!(r#", "clip": {{"box": [[{}, -1, -1], [{length}, 64, 64]]}}"#, start[0] - 500.0);
            let scene = far_scene(camera, mode, length, range, if is_clipped { &clip } else { "" });
            let images = [
                cpu_far_image(&far, &scene, &pyramid, map, range),
                gpu_far_image(gpu, &far, &scene, &pyramid, &map, range),
            ];
            let mut off = [0.0f64; 2];
            let mut seen = 0;
            for pixel in 0..images[0].pixels.len() {
                let [x, y] = [pixel as u32 % images[0].width, pixel as u32 / images[0].width];
                let ray = IndexRay::new(&scene.camera.ray(x, y), &Geometry::IDENTITY);
                let place = place_seen(&ray, start, edge, axis, mode);
                seen += usize::from(place.is_some());
                for (off, image) in off.iter_mut().zip(&images) {
                    let alpha = f64::from(image.pixels[pixel][3]);
                    // A ray that misses the brick must show nothing; one thousandth of a value is 1/15 of a voxel.
                    let voxels = place.map_or(alpha, |place| alpha / value_per_voxel - 1.0 - place);
                    *off = greatest([*off, voxels]);
                }
            }
            println!("{length} voxels, {name}, axis {axis}, {mode}: CPU {:.6}, GPU {:.6} voxels", off[0], off[1]);
            assert!(seen > 10, "{name}: the brick is not in the picture");
            assert!(off.iter().all(|&voxels| voxels < 1.0 / 256.0), "{name}, axis {axis}, {mode}: {off:?} voxels");
        }
    }
}

/// Alpha equals the value; level 0.
fn far_scene(camera: &str, mode: &str, length: usize, value_range: ValueRange, clip: &str) -> ResolvedScene {
    let json = format!(
        r#"{{"camera": {{{camera}, "up": [0, 1, 0]}}, "image": {{"width": 8, "height": 6}}, "mode": "{mode}"{clip},
            "transfer_function": {{"points": [{{"value": 0, "color": [1, 1, 1], "alpha": 0}},
                                              {{"value": 1, "color": [1, 1, 1], "alpha": 1}}]}}}}"#
    );
    let facts = VolumeFacts::plain(Dims([length as u64, 64, 64]), Geometry::IDENTITY, value_range);
    Scene::from_json(&json).expect("a valid scene").resolve(&facts).expect("a scene for this volume")
}

fn cpu_far_image(far: &FarBrick, scene: &ResolvedScene, pyramid: &Pyramid, map: ValueMap, range: ValueRange) -> Image {
    let quality = CpuQuality { lod: FINEST, ..CpuQuality::default() };
    let volume = DrawnVolume { pyramid, geometry: &Geometry::IDENTITY, map, value_range: range };
    let frame = CpuFrame::new(scene, &volume, quality);
    let mut states = frame.begin();
    assert!(states.cast_pass(far).is_converged());
    states.image()
}

fn gpu_far_image(
    gpu: &GpuDevice,
    far: &FarBrick,
    scene: &ResolvedScene,
    pyramid: &Pyramid,
    value_map: &ValueMap,
    value_range: ValueRange,
) -> Image {
    let geometry = &Geometry::IDENTITY;
    let volume = GpuVolume { pyramid, geometry, value_map, value_range, storage: VoxelStorage::F32 };
    let options = GpuOptions { memory_bytes: 64 << 20, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(gpu, &volume, scene, FINEST, options, None).expect("a renderer");
    for other in pyramid.keys_of(Lod(0)).filter(|&k| k != far.key) {
        renderer.set_state(other, PageEntry::Nothing);
    }
    let feedback = renderer.cast_pass().expect("a pass");
    assert_eq!(feedback.misses.iter().map(|m| m.key).collect::<Vec<_>>(), [far.key]);
    renderer.insert(&far.brick).expect("an upload");
    assert!(renderer.cast_pass().expect("a pass").is_converged());
    renderer.image().expect("an image")
}

#[test]
fn a_budget_too_small_says_what_is_needed() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let new = |memory_bytes| {
        let options = GpuOptions { memory_bytes, ..GpuOptions::default() };
        GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None)
    };
    let Err(GpuError::Budget { needed, min_slots: 2, .. }) = new(1000) else { panic!("1000 bytes were enough") };
    assert!(matches!(new(needed - 1), Err(GpuError::Budget { .. })));
    let renderer = new(needed).unwrap();
    assert_eq!(renderer.slot_capacity(), 2);
    assert!(renderer.stats().planned_bytes <= needed);
    assert_eq!(new(1 << 30).unwrap().slot_capacity(), 36, "never more slots than bricks");
}

#[test]
fn feedback_names_misses_uses_and_evictions() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let memory_bytes = volume.memory_for(&gpu, &scene, FINEST, 2);
    let options = GpuOptions { memory_bytes, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
    let first = renderer.cast_pass().unwrap();
    assert!(first.misses.len() > 2 && first.uses.is_empty());
    assert_eq!(first.misses.iter().map(|m| m.rays).sum::<u64>(), first.unfinished_rays);
    assert_eq!(first.counters.rays_waiting, first.unfinished_rays);
    assert!(first.misses.windows(2).all(|m| m[0].nearest <= m[1].nearest));

    let keys: Vec<BrickKey> = first.misses.iter().map(|m| m.key).collect();
    let placed = Insertion::Placed { evicted: None };
    assert_eq!(renderer.insert(&volume.bricks[&keys[0]]).unwrap(), placed);
    assert_eq!(renderer.insert(&volume.bricks[&keys[1]]).unwrap(), placed);
    assert_eq!(renderer.insert(&volume.bricks[&keys[2]]).unwrap(), Insertion::NoRoom);
    let second = renderer.cast_pass().unwrap();
    let mut uses = second.uses.clone();
    uses.sort();
    let mut expected = keys[..2].to_vec();
    expected.sort();
    assert_eq!(uses, expected);
    assert!(second.misses.iter().all(|m| !expected.contains(&m.key)));
    assert!(second.counters.cells > 0 && second.counters.samples > 0);

    // Both were used in the same pass, so either may be evicted, and its rays would wait for it again.
    let Insertion::Placed { evicted: Some(evicted) } = renderer.insert(&volume.bricks[&keys[2]]).unwrap() else {
        panic!("a third brick found room in two slots")
    };
    assert!(expected.contains(&evicted) && !renderer.is_resident(evicted) && renderer.is_resident(keys[2]));
    let stats = renderer.stats();
    let did = &stats.counters;
    assert_eq!((did.page_ins, did.evictions, stats.slots_used, did.passes), (3, 1, 2, 2));
}

/// Grey levels of 255: rays that waited for bricks began again at faces of cells.
const ROUNDING: f64 = 1e-3;

/// Another camera, transfer function or mode uploads some kilobytes of tables, and no brick.
#[test]
fn another_look_or_view_uploads_no_brick() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let options = GpuOptions { memory_bytes: 64 << 20, ..GpuOptions::default() };
    let first = volume.scene(SCENE);
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &first, FINEST, options, None).unwrap();
    volume.bricks.values().for_each(|brick| assert!(matches!(renderer.insert(brick), Ok(Insertion::Placed { .. }))));
    let bytes = renderer.stats().counters.upload_bytes;
    let view = SCENE.replace("[75, 55, 95]", "[-60, 70, 40]");
    let look = view.replace(r#""alpha": 0.01"#, r#""alpha": 0"#).replace("0.5, 0]", "0.2, 0.9]");
    let mode = look.replacen('{', r#"{"mode": "mip", "#, 1);
    for (name, json) in [("the same", SCENE), ("view", &view), ("look", &look), ("mode", &mode)] {
        for known in [KnownAnswers::Forget, KnownAnswers::Keep] {
            let scene = volume.scene(json);
            assert!(renderer.set_scene(&volume.gpu_volume(), &scene, FINEST, known).unwrap(), "{name}");
            assert!(renderer.cast_pass().unwrap().is_converged(), "{name}: a brick is missing");
            let (fresh, _) = volume.gpu_image(&gpu, &scene, FINEST, 64, Skipping::On);
            let difference = greatest_difference(&renderer.image().unwrap(), &fresh);
            assert!(difference < ROUNDING, "{name}: {difference}");
        }
    }
    assert_eq!(renderer.stats().counters.upload_bytes, bytes);
    let larger = volume.scene(&SCENE.replace(r#""width": 32"#, r#""width": 320"#));
    assert!(
        !renderer.set_scene(&volume.gpu_volume(), &larger, FINEST, KnownAnswers::Keep).unwrap(),
        "there is no room for its rays"
    );
}

/// All bytes written to the device and read back are counted exactly.
#[test]
fn traffic_is_counted() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let options = GpuOptions { memory_bytes: 64 << 20, ..GpuOptions::default() };
    let scene = volume.scene(SCENE);
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
    volume.bricks.values().for_each(|brick| assert!(matches!(renderer.insert(brick), Ok(Insertion::Placed { .. }))));
    let loaded = renderer.stats().counters;
    assert!(
        loaded.upload_bytes > 0 && loaded.written_bytes > loaded.upload_bytes && loaded.read_bytes == 0,
        "{loaded:?}"
    );
    renderer.cast_pass().unwrap();
    let cast = renderer.stats().counters.since(&loaded);
    // Three further submits: feedback is cleared, cells are classified, and a new shader runs without rays. Misses are
    // gathered with the last run.
    assert!(cast.dispatches > 0 && cast.submits == cast.dispatches + 3, "{cast:?}");
    assert!(cast.upload_bytes == 0 && cast.read_bytes > 0, "{cast:?}");
    let before = renderer.stats().counters;
    renderer.image().unwrap();
    let read = renderer.stats().counters.since(&before);
    assert_eq!(
        (read.read_bytes, read.written_bytes, read.submits),
        (32 * 24 * 16, 16, 1),
        "16 bytes a ray, and which they are"
    );
    // Another view alone uploads some kilobytes.
    let view = volume.scene(&SCENE.replace("[75, 55, 95]", "[-60, 70, 40]"));
    let before = renderer.stats().counters;
    assert!(renderer.set_scene(&volume.gpu_volume(), &view, FINEST, KnownAnswers::Keep).unwrap());
    let view = renderer.stats().counters.since(&before);
    assert!(view.written_bytes < 32 << 10, "{view:?}");
    // The counters of a new renderer begin at zero, whatever the device has done.
    let next = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap().stats().counters;
    assert_eq!((next.read_bytes, next.submits), (0, 1), "{next:?}");
}

/// Rays that were not cast because the pass was stopped are unfinished, and continue.
#[test]
fn a_pass_that_is_stopped_goes_on() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let large = SCENE.replace(r#""width": 32, "height": 24"#, r#""width": 128, "height": 96"#);
    let scene = volume.scene(&large);
    let options = GpuOptions { memory_bytes: 64 << 20, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
    volume.bricks.values().for_each(|brick| assert!(matches!(renderer.insert(brick), Ok(Insertion::Placed { .. }))));
    let stopped = renderer.cast_pass_until(&Stop::at(Some(Instant::now()))).unwrap();
    // A fast adapter casts all of them at once.
    assert!(stopped.is_stopped || !gpu.is_software());
    assert!(!renderer.cast_pass().unwrap().is_stopped);
    let (fresh, _) = volume.gpu_image(&gpu, &scene, FINEST, 64, Skipping::On);
    assert!(greatest_difference(&renderer.image().unwrap(), &fresh) < ROUNDING);
}

/// Bands of a picture are its rows.
#[test]
fn bands_are_rows_of_the_picture() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let options = GpuOptions { memory_bytes: 64 << 20, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
    volume.bricks.values().for_each(|brick| assert!(matches!(renderer.insert(brick), Ok(Insertion::Placed { .. }))));
    renderer.cast_pass().unwrap();
    let whole = renderer.image().unwrap();
    let mut banded = Vec::new();
    for rows in [0..8, 8..11, 11..24] {
        renderer.begin(rows);
        assert!(renderer.cast_pass().unwrap().is_converged());
        banded.extend(renderer.image().unwrap().pixels);
    }
    assert_eq!(banded, whole.pixels);
}

/// Resident memory of this process, bytes; `None` if the system does not tell.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
}

/// Draws pictures from changing sides and looks, with this many passes each. Returns the growth of memory after the
/// first tenth of them, and the number of dispatches.
fn memory_growth(gpu: &GpuDevice, frames: u64, passes: u64) -> Option<(u64, u64)> {
    let volume = volume();
    let options = GpuOptions { memory_bytes: 16 << 20, ..GpuOptions::default() };
    let mut renderer =
        GpuRenderer::new(gpu, &volume.gpu_volume(), &volume.scene(SCENE), FINEST, options, None).expect("a renderer");
    volume.bricks.values().for_each(|brick| assert!(matches!(renderer.insert(brick), Ok(Insertion::Placed { .. }))));
    let mut before = 0;
    for frame in 0..frames {
        let angle = frame as f64 * 0.1;
        let eye = format!("[{}, 55, {}]", 20.0 + 90.0 * angle.sin(), 20.0 + 90.0 * angle.cos());
        let json = SCENE.replace("[75, 55, 95]", &eye).replace("0.3}", &format!("{}}}", 0.3 + 0.3 * angle.sin()));
        renderer.set_scene(&volume.gpu_volume(), &volume.scene(&json), FINEST, KnownAnswers::Forget).expect("a scene");
        for _ in 0..passes {
            renderer.begin(0..24);
            assert!(renderer.cast_pass().expect("a pass").is_converged());
        }
        if frame == frames / 10 {
            before = resident_bytes()?;
        }
    }
    Some((resident_bytes()?.saturating_sub(before), renderer.stats().counters.dispatches))
}

/// Limit of memory growth: more is a leak. A shader that is compiled at every dispatch takes 4 MiB.
const GROWTH_LIMIT: u64 = 16 << 20;

#[test]
fn memory_does_not_grow_with_pictures() {
    let Some(gpu) = gpu() else { return };
    let Some((growth, dispatches)) = memory_growth(&gpu, 60, 3) else { return };
    println!("{growth} bytes in {dispatches} dispatches");
    assert!(growth < GROWTH_LIMIT && dispatches >= 180, "{growth} bytes in {dispatches} dispatches");
}

#[test]
#[ignore = "minutes: 1000 pictures, 100,000 dispatches"]
fn memory_does_not_grow_with_a_thousand_pictures() {
    let Some(gpu) = gpu() else { return };
    let Some((growth, dispatches)) = memory_growth(&gpu, 1000, 100) else { return };
    println!("{growth} bytes in {dispatches} dispatches");
    assert!(growth < GROWTH_LIMIT && dispatches >= 100_000, "{growth} bytes in {dispatches} dispatches");
}

#[test]
fn wrong_bricks_are_refused() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let options = GpuOptions { memory_bytes: 16 << 20, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
    let good = &volume.bricks[&BrickKey::new(Lod(0), BrickIndex([0; 3]))];
    let refused = |renderer: &mut GpuRenderer, brick: &DecodedBrick| {
        assert!(matches!(renderer.insert(brick), Err(GpuError::Brick { .. })));
    };
    refused(&mut renderer, &DecodedBrick { extent: [20, 20, 19], ..good.clone() });
    refused(&mut renderer, &DecodedBrick { macro_ranges: vec![[0.0, 1.0]], ..good.clone() });
    refused(&mut renderer, &DecodedBrick { key: BrickKey::new(Lod(9), BrickIndex([0; 3])), ..good.clone() });
    let float = TestVolume::new([41; 3], 16, Geometry::IDENTITY, F32, marschner_lobb(41));
    refused(&mut renderer, &float.bricks[&good.key]);
    assert_eq!(renderer.stats().slots_used, 0);
    assert!(renderer.insert(good).is_ok());
}

/// S42: a lost device is an error at every later call, and a new device draws the picture.
#[test]
fn a_lost_device_is_reported_and_replaced() {
    let Some(lost) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let options = GpuOptions { memory_bytes: 16 << 20, ..GpuOptions::default() };
    let mut renderer = GpuRenderer::new(&lost, &volume.gpu_volume(), &scene, FINEST, options, None).unwrap();
    renderer.cast_pass().unwrap();
    lost.destroy();
    assert!(matches!(renderer.cast_pass(), Err(GpuError::DeviceLost { .. })));
    assert!(matches!(renderer.image(), Err(GpuError::DeviceLost { .. })));
    let again = GpuRenderer::new(&lost, &volume.gpu_volume(), &scene, FINEST, options, None);
    assert!(matches!(again, Err(GpuError::DeviceLost { .. })));

    let Some(fresh) = gpu() else { return };
    let (image, _) = volume.gpu_image(&fresh, &scene, FINEST, 8, Skipping::On);
    assert!(greatest_difference(&image, &volume.cpu_image(&scene, FINEST)) < 0.5);
}
