#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! What the GPU backend promises besides pictures: huge coordinates, budgets, evictions, errors, a lost device.

mod gpu_support;

use gpu_support::{F32, TestVolume, U8, brick, gpu, greatest_difference, marschner_lobb, pyramid};
use supervol_format::{BrickIndex, BrickKey, Dims, Geometry, Lod, ValueRange};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::raycast::cpu::{CpuFrame, CpuQuality, Skipping, cast_pass};
use supervol_runtime::raycast::gpu::{
    GpuError, GpuOptions, GpuRenderer, GpuVolume, Insertion, PageEntry, VoxelStorage,
};
use supervol_runtime::raycast::volume::{BrickView, DecodedBrick, Resident, ValueMap};
use supervol_runtime::scene::{DataKind, Scene, VolumeFacts};

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
        if key == self.key { Resident::Brick(&self.brick) } else { Resident::Nothing }
    }
}

/// S39: sub-voxel error below 1/256 of a voxel, 2^23 voxels from the origin, also for rays that come all that way.
#[test]
fn huge_coordinates() {
    let Some(gpu) = gpu() else { return };
    let length = 1usize << 23;
    let pyramid = pyramid([length, 64, 64], 64);
    let key = BrickKey::new(Lod(0), BrickIndex([(length / 64 - 3) as u32, 0, 0]));
    let first = pyramid.core_box(key).start[0] as f64;
    // Linear in the position, which then is seen in the value.
    let at = |p: [usize; 3]| (0.4 * p[1] as f64 + 0.5 * p[2] as f64 + 0.1 * (p[0] as f64 - first)) / 64.0;
    let range = ValueRange { min: -0.1, max: 1.1 };
    let map = ValueMap::for_container(F32.voxel_type, 1.0, 0.0, None, range);
    let far = FarBrick { key, brick: brick(&pyramid, key, &at, F32, &map) };
    let facts = VolumeFacts {
        dims: Dims([length as u64, 64, 64]),
        geometry: Geometry::IDENTITY,
        value_range: range,
        percentiles: Vec::new(),
        kind: DataKind::Generic,
        has_zero_centre: false,
    };
    let near = format!(r#""eye": [{}, 90.3, 120.1], "target": [{}, 30, 31], "fov_y": 30"#, first - 70.7, first + 30.0);
    let along = format!(r#""eye": [-1000, 32.1, 31.9], "target": [{}, 41.3, 27.2], "height": 30"#, first + 30.0);
    for (name, camera) in [("near", near), ("along the whole volume", along)] {
        // Alpha equals the value: `mean` shows positions as grey levels.
        let json = format!(
            r#"{{"camera": {{{camera}, "up": [0, 1, 0]}}, "image": {{"width": 8, "height": 6}}, "mode": "mean",
                "transfer_function": {{"points": [{{"value": 0, "color": [1, 1, 1], "alpha": 0}},
                                                  {{"value": 1, "color": [1, 1, 1], "alpha": 1}}]}}}}"#
        );
        let scene = Scene::from_json(&json).unwrap().resolve(&facts).unwrap();
        let quality = CpuQuality { lod: FINEST, ..CpuQuality::default() };
        let frame = CpuFrame::new(&scene, &pyramid, &Geometry::IDENTITY, map, range, quality);
        let mut states = frame.begin();
        assert!(cast_pass(&far, &frame, &mut states).is_converged());
        let expected = frame.image(&states);

        let volume = GpuVolume {
            pyramid: &pyramid,
            geometry: &Geometry::IDENTITY,
            value_map: &map,
            value_range: range,
            storage: VoxelStorage::F32,
        };
        let options = GpuOptions { memory_bytes: 64 << 20, skipping: Skipping::On };
        let mut renderer = GpuRenderer::new(&gpu, &volume, &scene, FINEST, options).unwrap();
        for other in pyramid.keys_of(Lod(0)).filter(|&k| k != key) {
            renderer.set_state(other, PageEntry::Nothing);
        }
        let feedback = renderer.cast_pass().unwrap();
        assert_eq!(feedback.misses.iter().map(|m| m.key).collect::<Vec<_>>(), [key]);
        renderer.insert(&far.brick).unwrap();
        assert!(renderer.cast_pass().unwrap().is_converged());
        let image = renderer.image().unwrap();
        assert!(expected.pixels.iter().any(|p| p[3] > 0.1), "the brick is not in the picture");
        // Grey levels to voxels: the value changes by at least 0.1/64 per voxel along every axis.
        let voxels = greatest_difference(&image, &expected) / 255.0 * 64.0;
        println!("{name}: {voxels:.6} voxels");
        assert!(voxels < 1.0 / 256.0, "{name}: {voxels} voxels");
    }
}

#[test]
fn a_budget_too_small_says_what_is_needed() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let new = |memory_bytes| {
        let options = GpuOptions { memory_bytes, skipping: Skipping::On };
        GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options)
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
    let options = GpuOptions { memory_bytes, skipping: Skipping::On };
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options).unwrap();
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

    // Both were used in the same pass; either may leave, and its rays would wait for it again.
    let Insertion::Placed { evicted: Some(evicted) } = renderer.insert(&volume.bricks[&keys[2]]).unwrap() else {
        panic!("a third brick found room in two slots")
    };
    assert!(expected.contains(&evicted) && !renderer.is_resident(evicted) && renderer.is_resident(keys[2]));
    let stats = renderer.stats();
    assert_eq!((stats.insertions, stats.evictions, stats.slots_used, stats.passes), (3, 1, 2, 2));
}

#[test]
fn wrong_bricks_are_refused() {
    let Some(gpu) = gpu() else { return };
    let volume = volume();
    let scene = volume.scene(SCENE);
    let options = GpuOptions { memory_bytes: 16 << 20, skipping: Skipping::On };
    let mut renderer = GpuRenderer::new(&gpu, &volume.gpu_volume(), &scene, FINEST, options).unwrap();
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
    let options = GpuOptions { memory_bytes: 16 << 20, skipping: Skipping::On };
    let mut renderer = GpuRenderer::new(&lost, &volume.gpu_volume(), &scene, FINEST, options).unwrap();
    renderer.cast_pass().unwrap();
    lost.device.destroy();
    assert!(matches!(renderer.cast_pass(), Err(GpuError::DeviceLost { .. })));
    assert!(matches!(renderer.image(), Err(GpuError::DeviceLost { .. })));
    let again = GpuRenderer::new(&lost, &volume.gpu_volume(), &scene, FINEST, options);
    assert!(matches!(again, Err(GpuError::DeviceLost { .. })));

    let Some(fresh) = gpu() else { return };
    let (image, _) = volume.gpu_image(&fresh, &scene, FINEST, 8, Skipping::On);
    assert!(greatest_difference(&image, &volume.cpu_image(&scene, FINEST)) < 0.5);
}
