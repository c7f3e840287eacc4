//! Invariances of a picture: skipping, brick size, threads, the order in which bricks arrive.

#![allow(clippy::print_stderr, reason = "tests show how much they skip")]

use std::sync::{Arc, Mutex};

use glam::DVec3;
use supervol_format::{BrickKey, Lod, ValueRange, VoxelType};
use supervol_runtime::engines::cpu::CpuQuality;
use supervol_runtime::engines::packets::BrickPlans;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::budget::MADE_LIMIT;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::residency::{BrickView, Resident};
use supervol_scene::scene::{Mode, ResolvedScene};

use crate::support;
use support::{Bricked, Trickle, Volume, marschner_lobb, noise, points, scene};

fn volumes() -> Vec<Volume> {
    vec![
        Volume::new([40, 50, 33], VoxelType::F32, |p| marschner_lobb(41)(p)),
        Volume::new([40, 50, 33], VoxelType::I16, |p| if p[0] + p[1] < 50.0 { 0.0 } else { noise(p) })
            .with_holes(|[i, j, _]| i == 20 && j > 25),
        Volume::new([31, 67, 37], VoxelType::F32, |p| if noise(p) > 0.98 { noise(p) } else { 0.1 })
            .with_holes(|p| p[2] > 30),
    ]
    .into_iter()
    .map(|v| Volume { nodata: (v.voxel_type == VoxelType::I16).then_some(-999.0), ..v })
    .collect()
}

/// Every mode, also shaded if the mode allows it; the transfer function makes much invisible.
fn scenes(volume: &Volume) -> Vec<ResolvedScene> {
    let c = [1.0, 0.7, 0.2];
    let tf = points(1.0, &[(0.4, c, 0.0), (0.5, [0.2, 0.7, 1.0], 0.6), (0.6, c, 0.0), (0.9, c, 0.0), (0.9, c, 0.5)]);
    let iso =
        r#", "iso": [{"value": 0.5, "color": [0.9, 0.7, 0.4], "alpha": 0.5}, {"value": 0.3, "color": [1, 1, 1]}]"#;
    let [unlit_iso, shaded_iso] = ["null", "{}"].map(|shading| format!(r#"{iso}, "shading": {shading}"#));
    let shaded = r#", "shading": {}"#;
    [("dvr", ""), ("dvr", shaded), ("mip", ""), ("minip", ""), ("mean", ""), ("iso", &unlit_iso), ("iso", &shaded_iso)]
        .map(|(mode, rest)| {
            let json = format!(
                r#"{{"camera": {{"eye": [95, -70, 62], "target": [20, 25, 18], "up": [0, 0, 1], "fov_y": 32}},
                    "image": {{"width": 60, "height": 50}}, "mode": "{mode}", "transfer_function": {tf}{rest}}}"#
            );
            scene(volume, &json)
        })
        .into()
}

const FINEST: LodChoice = LodChoice::Fixed(Lod(0));

/// Whether a trilinear cell whose corners span `low` to `high` (data values) may be visible, by the definition of the
/// model.
fn can_show(scene: &ResolvedScene, low: f64, high: f64) -> bool {
    let tf = &scene.transfer_function;
    let ends = || tf.classify(low).1 > 0.0 || tf.classify(high).1 > 0.0;
    let between = || tf.points().iter().any(|p| low <= p.value && p.value <= high && p.alpha > 0.0);
    match scene.mode {
        Mode::Dvr => ends() || between(),
        Mode::Iso => scene.iso.iter().any(|surface| low <= surface.value && surface.value <= high),
        Mode::Mip | Mode::Minip | Mode::Mean | Mode::Slice => true,
    }
}

/// The same bricks with the best possible ranges of macro cells: by brute force over the visible trilinear cells that
/// each meets; empty if there are none.
fn with_best_ranges(volume: &Volume, scene: &ResolvedScene, core: u32) -> Bricked {
    let mut bricked = Bricked::new(volume, core);
    for key in bricked.pyramid.keys_of(Lod(0)) {
        let (start, cells) = (bricked.pyramid.core_box(key).start, bricked.pyramid.macro_cells(key));
        let best = (0..cells.iter().product::<usize>()).map(|i| {
            let index = [i % cells[0], i / cells[0] % cells[1], i / (cells[0] * cells[1])];
            let first: [i64; 3] = std::array::from_fn(|a| start[a] as i64 + 8 * index[a] as i64 - 1);
            let mut range = ValueRange::EMPTY;
            for n in 0..729 {
                let cell = [n % 9, n / 9 % 9, n / 81];
                let corner = |c: i64| [0, 1, 2].map(|a| first[a] + cell[a] + (c >> a & 1));
                let corners: [f64; 8] = std::array::from_fn(|c| volume.clamped(corner(c as i64)));
                let (low, high) = corners.iter().fold((f64::MAX, f64::MIN), |(l, h), &v| (l.min(v), h.max(v)));
                if corners.iter().all(|v| !v.is_nan()) && can_show(scene, low, high) {
                    range.include(low);
                    range.include(high);
                }
            }
            if range.is_empty() {
                return [f32::INFINITY, f32::NEG_INFINITY];
            }
            [range.min, range.max].map(|v| bricked.map.from_container(volume.voxel_type, v))
        });
        let best: Vec<[f32; 2]> = best.collect();
        bricked.bricks.get_mut(&key).expect("every key has its brick").macro_ranges = best;
    }
    bricked
}

#[test]
fn what_is_made_of_bricks_need_not_be_kept() {
    let volume = &volumes()[0];
    let bricked = Bricked::new(volume, 16);
    for (i, scene) in scenes(volume).iter().enumerate() {
        let render =
            |made_bytes| bricked.render_of(scene, CpuQuality { lod: FINEST, made_bytes, ..CpuQuality::default() });
        assert_eq!(render(0), render(MADE_LIMIT), "scene {i}");
    }
}

/// Plans are passed from picture to picture, whatever changes, without any effect on a picture; plans stay valid for a
/// moving camera.
#[test]
fn what_is_made_of_bricks_may_be_kept() {
    let (mut kept, mut made) = (0, 0);
    for volume in &volumes() {
        let bricked = Bricked::new(volume, 16);
        let mut plans: Option<Arc<BrickPlans>> = None;
        for (i, scene) in scenes(volume).iter().enumerate() {
            // Twice, the second time from the other side.
            let mut behind = scene.clone();
            let (camera, middle) = (&mut behind.camera, DVec3::from_array(volume.dims.map(|n| 0.5 * n as f64)));
            camera.eye += 2.0 * (middle - camera.eye).dot(camera.forward) * camera.forward;
            (camera.forward, camera.right) = (-camera.forward, -camera.right);
            for (side, scene) in [scene, &behind, scene].into_iter().enumerate() {
                let quality = CpuQuality { lod: FINEST, plans: plans.clone(), ..CpuQuality::default() };
                let found = bricked.frame_of(scene, quality.clone()).plans();
                assert_eq!(found.is_some(), scene.mode == Mode::Dvr);
                let is_kept = plans.iter().zip(&found).any(|(before, now)| Arc::ptr_eq(before, now));
                assert!(is_kept || side == 0 || found.is_none(), "scene {i}: only the camera has moved");
                kept += u32::from(is_kept);
                made += u32::from(found.is_some() && !is_kept);
                let quality = CpuQuality { plans: found.clone(), ..quality };
                let anew = CpuQuality { plans: None, ..quality.clone() };
                assert_eq!(bricked.render_of(scene, quality).0, bricked.render_of(scene, anew).0, "scene {i}, {side}");
                plans = found;
            }
        }
    }
    assert!(kept > 10 && made > 5, "{kept} frames found plans that are still true, {made} made new ones");
}

/// S21. Skips at least four fifths of the cells that the best ranges would let the same rays skip.
#[test]
fn skipping_changes_no_bit_and_skips() {
    let (mut could_in_all, mut whole_in_all) = (0, 0);
    for (v, volume) in volumes().iter().enumerate() {
        let bricked = Bricked::new(volume, 32);
        for (i, scene) in scenes(volume).iter().enumerate() {
            let (on, counters) = bricked.render_with(scene, FINEST, Skipping::On);
            let (off, all) = bricked.render_with(scene, FINEST, Skipping::Off);
            assert_eq!(on, off, "volume {v}, scene {i}");
            assert_eq!(all.macro_cells_skipped, 0);
            let best = with_best_ranges(volume, scene, 32).render_with(scene, FINEST, Skipping::On).1;
            // Packets leap over macro cells and count cells; single rays test every macro cell.
            let (skipped, could, whole) = if all.macro_cells == 0 {
                (all.cells - counters.cells, all.cells - best.cells, all.cells)
            } else {
                let tiled = counters.macro_cells_skipped + counters.macro_cells;
                assert_eq!(tiled, all.macro_cells, "volume {v}, scene {i}: the ray is tiled");
                (counters.macro_cells_skipped, best.macro_cells_skipped, all.macro_cells)
            };
            eprintln!("volume {v}, scene {i}: {skipped} of {whole} skipped, {could} could be");
            assert!(skipped * 5 >= could * 4, "volume {v}, scene {i}: {skipped} of {could} are skipped");
            could_in_all += could;
            whole_in_all += whole;
        }
    }
    assert!(could_in_all * 5 > whole_in_all, "where little can be skipped, skipping it shows little");
}

/// Grey levels by which a picture may depend on the size of bricks. Packets compute positions in `f32` from the ray's
/// entry into a brick. In `dvr` they refine by the transmittance in front of a brick, and may use a quarter of the
/// requested error (docs/decisions/006-packets.md). Surfaces are found in `f64`.
fn tolerance(scene: &ResolvedScene) -> f64 {
    match scene.mode {
        Mode::Dvr => 0.125,
        Mode::Mip | Mode::Minip | Mode::Mean => 0.02,
        Mode::Iso | Mode::Slice => 0.0,
    }
}

/// S27.
#[test]
fn brick_size_changes_nothing_that_shows() {
    let mut worst = 0.0f64;
    for volume in volumes() {
        for (i, scene) in scenes(&volume).iter().enumerate() {
            let first = Bricked::new(&volume, 16).render(scene);
            for core in [32, 64, 128] {
                let other = Bricked::new(&volume, core).render(scene);
                let difference = support::difference(&other, &first);
                worst = worst.max(difference);
                eprintln!("scene {i}, bricks of {core}: {difference}/255");
                assert!(difference <= tolerance(scene), "scene {i}, bricks of {core}: {difference}/255");
            }
        }
    }
    assert!(worst > 0.0, "pictures by packets were among them");
    eprintln!("sizes of bricks change pictures by at most {worst}/255");
}

/// S44.
#[test]
fn threads_change_no_bit() {
    let volume = &volumes()[0];
    let bricked = Bricked::new(volume, 16);
    for scene in scenes(volume) {
        let render = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let frame = bricked.frame(&scene, FINEST, Skipping::On);
                let mut states = frame.begin();
                let feedback = states.cast_pass(&bricked);
                (states.image(), feedback)
            })
        };
        assert_eq!(render(1), render(8));
    }
}

/// Rays that wait and continue give the same picture as rays that never waited, although the cache holds few bricks.
#[test]
fn waiting_changes_no_bit() {
    let volume = &volumes()[0];
    let bricked = Bricked::new(volume, 16);
    for (scene, capacity) in scenes(volume).iter().zip([1, 2, 3, 5, 8, 13, 4]) {
        let frame = bricked.frame(scene, LodChoice::Auto { voxel_pixels: 1.0 }, Skipping::On);
        let mut states = frame.begin();
        let whole = {
            let mut states = frame.begin();
            assert!(states.cast_pass(&bricked).is_converged());
            states.image()
        };
        let view = Trickle { all: &bricked, resident: Mutex::new(vec![]) };
        let mut passes = 0;
        loop {
            let feedback = states.cast_pass(&view);
            assert_eq!(feedback.misses.iter().map(|m| m.rays).sum::<u64>(), states.waiting());
            if feedback.is_converged() {
                break;
            }
            // Only the bricks wanted now are kept, front to back.
            *view.resident.lock().unwrap() = feedback.misses.iter().take(capacity).map(|m| m.key).collect();
            passes += 1;
            assert!(passes < 1000, "no progress");
        }
        assert!(states.is_finished());
        assert_eq!(states.image(), whole, "{capacity} bricks, {passes} passes");
    }
}

/// A view in which some bricks have failed or hold one value.
struct Patched<'a> {
    all: &'a Bricked,
    patch: fn(BrickKey) -> Option<Resident<'static>>,
}

impl BrickView for Patched<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        (self.patch)(key).unwrap_or_else(|| self.all.lookup(key))
    }
}

#[test]
fn uniform_absent_and_failed_bricks() {
    let volume = Volume::new([40, 40, 40], VoxelType::F32, |_| 0.5);
    let bricked = Bricked::new(&volume, 16);
    // The data value 0.5 as a render value: a range of no width is moved to 0.
    assert_eq!(bricked.map.from_data(0.5), 0.0);
    let patches: [fn(BrickKey) -> Option<Resident<'static>>; 3] = [
        |key| key.brick().0[0].is_multiple_of(2).then_some(Resident::Uniform(0.0)),
        |key| (key.lod() == Lod(0) && key.brick().0[1] == 1).then_some(Resident::UseParent),
        |key| (key.lod() < Lod(2)).then_some(Resident::UseParent),
    ];
    for (i, scene) in scenes(&volume).into_iter().enumerate() {
        let frame = bricked.frame(&scene, FINEST, Skipping::On);
        let whole = bricked.render(&scene);
        for (p, patch) in patches.into_iter().enumerate() {
            let mut states = frame.begin();
            assert!(states.cast_pass(&Patched { all: &bricked, patch }).is_converged());
            let error = support::difference(&states.image(), &whole);
            // A uniform brick is one chord: a ray may end behind the opacity at which cells would have ended it.
            assert!(error < 0.128, "scene {i}, patch {p}: {error}/255");
        }
        let mut states = frame.begin();
        let nothing = Patched { all: &bricked, patch: |_| Some(Resident::Nothing) };
        assert!(states.cast_pass(&nothing).is_converged());
        assert!(states.image().pixels.iter().all(|p| *p == [0.0; 4]));
    }
}

#[test]
fn samples_per_pixel_are_block_means() {
    let volume = &volumes()[0];
    let json = |n: u32, size: [u32; 2]| {
        format!(
            r#"{{"camera": {{"eye": [95, -70, 62], "target": [20, 25, 18], "up": [0, 0, 1], "fov_y": 32}},
                "image": {{"width": {}, "height": {}}}, "transfer_function": "grey", "samples_per_pixel": {n}}}"#,
            size[0], size[1]
        )
    };
    let bricked = Bricked::new(volume, 64);
    let fine = bricked.render(&scene(volume, &json(1, [40, 32])));
    let averaged = bricked.render(&scene(volume, &json(4, [20, 16])));
    assert_eq!(averaged, fine.downsampled(2));
}
