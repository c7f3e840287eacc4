//! Packets in the modes `mip`, `minip`, `mean` and `iso`: against the reference and the scalar caster, for all
//! instruction sets, levels, holes and failures. `dvr` is tested with these, too.

#![allow(clippy::print_stderr, reason = "tests show the errors they measure")]

use supervol_format::random::Random;
use supervol_format::{BrickKey, Lod, VoxelType};
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cpu::{Caster, CpuQuality};
use supervol_runtime::engines::packets::PacketRule;
use supervol_runtime::engines::packets::simd::InstructionSet;
use supervol_runtime::lod::LodChoice;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::residency::{BrickView, Resident};
use supervol_scene::scene::{Mode, ResolvedScene};

use crate::support;
use support::{Bricked, Volume, difference, marschner_lobb, noise, points, reference, scene, stable};

const SEED: u64 = 20_261_123;
/// Grey levels between packets and the scalar caster, for values; both find surfaces in `f64`.
const VALUE_BOUND: f64 = 0.01;
/// The same for shaded surfaces: chords are cut elsewhere, so that roots round otherwise.
const SHADED_BOUND: f64 = 0.001;
/// The same for gathered light: the requested error.
const LIGHT_BOUND: f64 = PacketRule::DEFAULT.max_error * 255.0;
const FINEST: LodChoice = LodChoice::Fixed(Lod(0));

const TYPES: [VoxelType; 4] = [VoxelType::F32, VoxelType::U8, VoxelType::U16, VoxelType::I16];

/// Greatest value of a volume of this type; integers have about a hundred values.
fn greatest_of(voxel_type: VoxelType) -> f64 {
    if voxel_type == VoxelType::F32 { 1.0 } else { 120.0 }
}

/// Waves, white noise, plateaus, or Marschner and Lobb's signal; every second one with holes, every third one oblique.
fn random_volume(random: &mut Random, index: usize) -> Volume {
    let dims = [0; 3].map(|_| 18 + random.index(34));
    let voxel_type = TYPES[index % TYPES.len()];
    let size = greatest_of(voxel_type);
    let frequency = random.between(0.2, 0.9);
    let wave = move |p: [f64; 3]| 0.5 + 0.5 * (frequency * (p[0] + 0.7 * p[1] + 1.3 * p[2])).sin();
    let volume = match random.index(4) {
        0 => Volume::new(dims, voxel_type, move |p| size * wave(p)),
        1 => Volume::new(dims, voxel_type, move |p| size * noise(p)),
        2 => Volume::new(dims, voxel_type, move |p| size * (8.0 * wave(p)).floor() / 8.0),
        _ => Volume::new(dims, voxel_type, move |p| size * marschner_lobb(dims[0])(p)),
    };
    let volume = if index.is_multiple_of(2) {
        volume
    } else {
        let (plane, phase) = (random.index(dims[0]), random.index(40));
        Volume { nodata: Some(121.0), ..volume }.with_holes(move |[i, j, k]| {
            i == plane || (3 * i + 5 * j + 7 * k + phase).is_multiple_of(41) || k + 3 < j / 2
        })
    };
    if index.is_multiple_of(3) {
        volume.with_geometry([1.5, 0.75, 1.0], [40.0, -20.0, 5.0], [0.8, -0.6, 0.1, 0.6, 0.8, 0.0, 0.0, 0.2, 1.0])
    } else {
        volume
    }
}

/// A ramp of opacity and colour over the values, so that every value differs from its neighbours; surfaces on integer
/// values and between them.
fn members(random: &mut Random, volume: &Volume, mode: &str) -> String {
    let size = greatest_of(volume.voxel_type);
    let tf =
        points(1.0, &[(0.0, [0.1, 0.2, 0.9], 0.2), (0.5 * size, [0.9, 0.8, 0.1], 0.6), (size, [1.0, 0.1, 0.3], 1.0)]);
    let mut surfaces = String::new();
    if mode.starts_with("iso") {
        let value = |random: &mut Random| {
            let value = size * random.between(0.1, 0.9);
            if size > 1.0 && random.index(2) == 0 { value.round() } else { value }
        };
        let of =
            |value: f64, alpha: f64| format!(r#"{{"value": {value}, "color": [0.9, 0.7, {alpha}], "alpha": {alpha}}}"#);
        let all: Vec<String> = [0.3, 0.55, 1.0].map(|alpha| of(value(random), alpha)).into();
        surfaces = format!(r#", "iso": [{}]"#, all[..1 + random.index(3)].join(", "));
    }
    let shading = if mode.ends_with("shaded") { r#", "shading": {}"# } else { r#", "shading": null"# };
    let mode = mode.split(' ').next().expect("a mode has a name");
    format!(r#""mode": "{mode}", "transfer_function": {tf}{surfaces}{shading}"#)
}

/// From anywhere, inside included; both projections; every third picture is clipped.
fn random_scene(random: &mut Random, volume: &Volume, mode: &str) -> ResolvedScene {
    let world = volume.geometry.world_from_index();
    let centre = volume.dims.map(|n| n as f64 / 2.0);
    let direction = [0; 3].map(|_| random.unit() - 0.5);
    let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(0.01);
    let far = [70.0, 45.0, 6.0][random.index(3)];
    let eye: [f64; 3] = std::array::from_fn(|a| centre[a] + far * direction[a] / length);
    let [eye, target] = [eye, centre].map(|p| world.transform_point3(p.into()).to_array());
    let lens = if random.index(3) == 0 { r#""height": 40"# } else { r#""fov_y": 40"# };
    let camera = format!(r#""eye": {eye:?}, "target": {target:?}, "up": [0.1, 0.2, 1], {lens}"#);
    let mut clip = String::new();
    if random.index(3) == 0 {
        let normal = [1.0, 0.3, -0.2];
        let offset = (0..3).map(|a| normal[a] * target[a]).sum::<f64>() - 4.0;
        let high = volume.dims[1] as f64 - 5.5;
        clip = format!(
            r#", "clip": {{"box": [[2.25, -3, 1], [99, {high}, 99]], "planes": [{{"normal": {normal:?}, "offset": {offset}}}]}}"#
        );
    }
    let members = members(random, volume, mode);
    let image = r#""image": {"width": 22, "height": 18}"#;
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, {members}{clip}}}"#))
}

const MODES: [&str; 5] = ["mip", "minip", "mean", "iso", "iso shaded"];

fn packets(lod: LodChoice, skipping: Skipping, instructions: Option<InstructionSet>) -> CpuQuality {
    CpuQuality {
        lod,
        skipping,
        caster: Caster::Packets(PacketRule { instructions, ..PacketRule::DEFAULT }),
        ..CpuQuality::default()
    }
}

fn cells(lod: LodChoice) -> CpuQuality {
    CpuQuality { lod, skipping: Skipping::On, caster: Caster::Cells(CellRule::DEFAULT), ..CpuQuality::default() }
}

/// Grey levels by which packets may differ from the scalar caster.
fn bound(scene: &ResolvedScene) -> f64 {
    match (scene.mode, &scene.shading) {
        (Mode::Iso, None) => 0.0,
        (Mode::Iso, Some(_)) => SHADED_BOUND,
        (Mode::Dvr, _) => LIGHT_BOUND,
        _ => VALUE_BOUND,
    }
}

#[test]
fn random_scenes_agree_with_the_reference_and_with_the_scalar_caster() {
    let mut random = Random::new(SEED);
    let (mut judged, mut pixels) = (0, 0);
    for index in 0..24 {
        let volume = random_volume(&mut random, index);
        let bricked = Bricked::new(&volume, 16);
        for mode in MODES {
            let scene = random_scene(&mut random, &volume, mode);
            let name = format!("seed {SEED}, scene {index}, {mode}, {:?}", volume.voxel_type);
            let (found, counters) = bricked.render_of(&scene, packets(FINEST, Skipping::On, None));
            assert!(found.is_finite(), "{name}: what is no number");
            assert_eq!(counters.macro_cells, 0, "{name}: packets do not count macro cells");
            let change = difference(&found, &bricked.render_of(&scene, cells(FINEST)).0);
            let exact = reference(&volume, &scene);
            let is_stable = stable(&volume, &scene, &exact);
            let error = found.distance_where(&exact, |i| is_stable[i]);
            eprintln!("{name}: {change:.6}/255 from the scalar caster, {error:.6}/255 from the reference");
            assert!(change <= bound(&scene), "{name}: {change}/255 from the scalar caster");
            assert!(error <= 0.1, "{name}: {error}/255 from the reference");
            judged += is_stable.iter().filter(|stable| **stable).count();
            pixels += is_stable.len();
        }
    }
    assert!(judged * 100 > pixels * 98, "{judged} of {pixels} pixels are judged");
}

#[test]
fn instruction_sets_agree() {
    let mut random = Random::new(SEED + 1);
    let sets: Vec<InstructionSet> = InstructionSet::available().collect();
    eprintln!("instructions: {sets:?}");
    assert!(sets.contains(&InstructionSet::Portable));
    for index in 0..8 {
        let volume = random_volume(&mut random, index);
        let bricked = Bricked::new(&volume, 16);
        for mode in MODES {
            let scene = random_scene(&mut random, &volume, mode);
            let render = |set| bricked.render_of(&scene, packets(FINEST, Skipping::On, Some(set))).0;
            let first = render(InstructionSet::Portable);
            for &set in &sets {
                let change = difference(&render(set), &first);
                assert!(change <= bound(&scene), "scene {index}, {mode}, {}: {change}/255", set.name());
            }
        }
    }
}

/// Values that fall where stored numbers rise, and lie between integers.
#[test]
fn scaled_values_agree_with_the_scalar_caster() {
    let mut random = Random::new(SEED + 3);
    for index in 0..16 {
        let volume = random_volume(&mut random, index);
        let size = greatest_of(volume.voxel_type);
        let scaling = [[-1.0, size], [-0.7, 0.9 * size], [0.37, 0.1 * size]][index % 3];
        let bricked = Bricked::scaled(&volume, 16, scaling);
        for mode in MODES {
            let scene = random_scene(&mut random, &volume, mode);
            let found = bricked.render_of(&scene, packets(FINEST, Skipping::On, None)).0;
            let name = format!("seed {SEED}, scene {index}, {mode}, {:?}, {scaling:?}", volume.voxel_type);
            let change = difference(&found, &bricked.render_of(&scene, cells(FINEST)).0);
            eprintln!("{name}: {change:.6}/255 from the scalar caster");
            assert!(change <= bound(&scene), "{name}: {change}/255 from the scalar caster");
            assert_eq!(found, bricked.render_of(&scene, packets(FINEST, Skipping::Off, None)).0, "{name}: skipping");
            assert!(found.pixels.iter().any(|p| p[3] > 0.0) || mode.starts_with("iso"), "{name}: nothing is seen");
        }
    }
}

/// Bricks of all levels beside each other; some have failed, are uniform or empty: sides of surfaces jump.
struct Patchwork<'a> {
    all: &'a Bricked,
    seed: u64,
}

impl Patchwork<'_> {
    fn lot(&self, key: BrickKey) -> u64 {
        let [x, y, z] = key.brick().0.map(u64::from);
        let mixed = (self.seed + x + 8 * y + 64 * z + 512 * u64::from(key.lod().0)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        (mixed >> 40) % 16
    }
}

impl BrickView for Patchwork<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        match (self.lot(key), key.lod()) {
            (0..9, lod) if lod > Lod::FINEST => Resident::TooCoarse,
            (9, _) => Resident::Nothing,
            (10, _) => Resident::Uniform(self.all.bricks[&key].macro_ranges[0][0].min(1e6)),
            (11 | 12, _) => Resident::UseParent,
            _ => self.all.lookup(key),
        }
    }

    fn stand_in(&self, key: BrickKey) -> Resident<'_> {
        self.all.lookup(key)
    }
}

#[test]
fn levels_failures_and_uniform_bricks_agree_with_the_scalar_caster() {
    let mut random = Random::new(SEED + 2);
    let coarsest = LodChoice::Auto { voxel_pixels: 1e6 };
    let mut pictures_with_something = 0;
    for index in 0..40 {
        let volume = random_volume(&mut random, index);
        let bricked = Bricked::new(&volume, 16);
        let view = Patchwork { all: &bricked, seed: index as u64 };
        for mode in MODES.into_iter().chain(["dvr", "dvr shaded"]) {
            let scene = random_scene(&mut random, &volume, mode);
            let render = |quality: CpuQuality| {
                let frame = bricked.frame_of(&scene, quality);
                let mut rays = frame.begin();
                assert!(rays.cast_pass(&view).is_converged());
                rays.image()
            };
            let found = render(packets(coarsest, Skipping::On, None));
            let name = format!("seed {SEED}, scene {index}, {mode}, {:?}", volume.voxel_type);
            let change = difference(&found, &render(cells(coarsest)));
            assert!(change <= bound(&scene), "{name}: {change}/255 from the scalar caster");
            assert_eq!(found, render(packets(coarsest, Skipping::Off, None)), "{name}: skipping");
            pictures_with_something += usize::from(found.pixels.iter().any(|p| p[3] > 0.0));
        }
    }
    assert!(pictures_with_something > 210, "{pictures_with_something} of 280 pictures show something");
}

/// Below the first surface, then absent over several empty macro cells, then above it. No ray crosses the surface,
/// although the absent part is leapt over, ends with a brick, or holds uniform bricks. A second surface lies behind.
#[test]
fn no_surface_is_seen_across_what_is_absent() {
    for voxel_type in [VoxelType::F32, VoxelType::U8] {
        let size = greatest_of(voxel_type);
        let field = move |p: [f64; 3]| {
            let shares = if p[0] < 40.0 { 0.2 } else { 0.8 + if p[0] > 90.0 { 0.002 * (p[0] - 90.0) } else { 0.0 } };
            size * shares
        };
        let volume = Volume::new([128, 40, 40], voxel_type, field).with_holes(|[i, _, _]| (18..70).contains(&i));
        let volume = Volume { nodata: (voxel_type == VoxelType::U8).then_some(255.0), ..volume };
        let surfaces = |last: f64| {
            let of = |value: f64| format!(r#"{{"value": {value}, "color": [1, 1, 1]}}"#);
            format!(r#""mode": "iso", "iso": [{}, {}]"#, of(0.5 * size), of(last * size))
        };
        let tf = points(1.0, &[(0.0, [1.0; 3], 1.0)]);
        let camera = r#""camera": {"eye": [-40, 31, 33], "target": [64, 20, 20], "up": [0, 0, 1], "fov_y": 16}"#;
        let image = r#""image": {"width": 20, "height": 20}"#;
        let json = |last: f64| format!(r#"{{{camera}, {image}, {}, "transfer_function": {tf}}}"#, surfaces(last));
        for core in [16, 32, 64, 128] {
            let bricked = Bricked::new(&volume, core);
            let never = bricked.render(&scene(&volume, &json(0.99)));
            assert!(never.pixels.iter().all(|p| p[3] == 0.0), "{voxel_type:?}, bricks of {core}: a surface is seen");
            let behind = scene(&volume, &json(0.84));
            let found = bricked.render_of(&behind, packets(FINEST, Skipping::On, None)).0;
            assert!(found.pixels.iter().any(|p| p[3] == 1.0), "{voxel_type:?}, bricks of {core}: nothing is seen");
            assert_eq!(found, bricked.render_of(&behind, cells(FINEST)).0, "{voxel_type:?}, bricks of {core}");
        }
        // From the first brick's absent end into a uniform brick.
        let bricked = Bricked::new(&volume, 64);
        let value = bricked.map.from_data(0.8 * size);
        let frame = bricked.frame(&scene(&volume, &json(0.99)), FINEST, Skipping::On);
        let mut rays = frame.begin();
        assert!(rays.cast_pass(&SecondIsUniform { all: &bricked, value }).is_converged());
        assert!(rays.image().pixels.iter().all(|p| p[3] == 0.0), "{voxel_type:?}: a surface before one value");
    }
}

/// A value on the surface counts as above it: rays that only come down to it do not cross it, rays that only come up to
/// it do. On whole planes of voxels the field has the iso value up to rounding.
#[test]
fn planes_that_have_the_iso_value_are_above_it() {
    let camera = r#""camera": {"eye": [-40, 31, 33], "target": [16, 10, 10], "up": [0, 0, 1], "fov_y": 9}"#;
    let tf = points(1.0, &[(0.0, [1.0; 3], 1.0)]);
    let iso = r#""mode": "iso", "iso": [{"value": 128, "color": [1, 1, 1]}]"#;
    let json = format!(r#"{{{camera}, "image": {{"width": 24, "height": 24}}, {iso}, "transfer_function": {tf}}}"#);
    let down = |p: [f64; 3]| if p[0] % 2.0 == 0.0 { 128.0 } else { 129.0 + 70.0 * noise(p).round() };
    let up = |p: [f64; 3]| if p[0] >= 15.0 { 128.0 } else { 60.0 + (67.0 * noise(p)).round() };
    type Field<'a> = &'a dyn Fn([f64; 3]) -> f64;
    for (field, opacity) in [(&down as Field<'_>, 0.0), (&up, 1.0)] {
        for voxel_type in [VoxelType::U8, VoxelType::F32] {
            let volume = Volume::new([32, 32, 32], voxel_type, field);
            let scene = scene(&volume, &json);
            for core in [16, 64] {
                let bricked = Bricked::new(&volume, core);
                let cells_walked = CpuQuality { skipping: Skipping::Off, ..cells(FINEST) };
                for quality in [
                    packets(FINEST, Skipping::On, None),
                    packets(FINEST, Skipping::Off, None),
                    cells(FINEST),
                    cells_walked,
                ] {
                    let name = format!("{voxel_type:?}, opacity {opacity}, bricks of {core}, {quality:?}");
                    let found = bricked.render_of(&scene, quality).0;
                    assert!(found.pixels.iter().all(|p| p[3] == opacity), "{name}");
                }
            }
        }
    }
}

/// A surface on a plane of voxels is met there, and nowhere else on the chords on either side, whichever way they
/// round.
#[test]
fn surfaces_in_planes_of_voxels_are_lit_where_they_are() {
    let tf = points(1.0, &[(0.0, [1.0; 3], 1.0)]);
    let iso = r#""mode": "iso", "shading": {}, "iso": [{"value": 72, "color": [1, 1, 1]}]"#;
    for (eye, voxel_type) in [([3.0, 50.0, -40.0], VoxelType::F32), ([20.0, 71.0, 70.0], VoxelType::U8)] {
        let field =
            |p: [f64; 3]| (72.0 + (14.0 - p[2]) * (4.0 + 2.0 * (1.3 * p[1] + 0.4 * p[0]).sin())).clamp(0.0, 255.0);
        let volume = Volume::new([30, 40, 28], voxel_type, field);
        let camera = format!(r#""camera": {{"eye": {eye:?}, "target": [15, 20, 14], "up": [0, 1, 0], "fov_y": 30}}"#);
        let image = r#""image": {"width": 60, "height": 60}"#;
        let scene = scene(&volume, &format!(r#"{{{camera}, {image}, {iso}, "transfer_function": {tf}}}"#));
        let exact = reference(&volume, &scene);
        let is_stable = stable(&volume, &scene, &exact);
        let seen = (0..exact.pixels.len()).filter(|&i| is_stable[i] && exact.pixels[i][3] > 0.0).count();
        assert!(seen > 500, "{voxel_type:?}: {seen} pixels see the surface");
        for core in [16, 64] {
            for quality in [packets(FINEST, Skipping::On, None), cells(FINEST)] {
                let found = Bricked::new(&volume, core).render_of(&scene, quality).0;
                let error = found.distance_where(&exact, |i| is_stable[i]);
                assert!(error <= 0.1, "{voxel_type:?}, bricks of {core}: {error}/255 from the reference");
            }
        }
    }
}

/// The second brick along x is uniform.
struct SecondIsUniform<'a> {
    all: &'a Bricked,
    value: f32,
}

impl BrickView for SecondIsUniform<'_> {
    fn lookup(&self, key: BrickKey) -> Resident<'_> {
        if key.brick().0[0] == 1 { Resident::Uniform(self.value) } else { self.all.lookup(key) }
    }
}

/// Clipped on a plane of voxels behind which all is absent: cells in front of it that exist only by rounding are not
/// visible.
#[test]
fn nothing_is_seen_of_what_is_cut_off_beside_holes() {
    for axis in 0..3 {
        for voxel_type in [VoxelType::F32, VoxelType::U8] {
            let size = greatest_of(voxel_type);
            let volume = Volume::new([40, 41, 42], voxel_type, move |p| size * noise(p)).with_holes(|p| p[axis] >= 12);
            let volume = Volume { nodata: (voxel_type == VoxelType::U8).then_some(255.0), ..volume };
            let mut low = [-1.0; 3];
            low[axis] = 11.0;
            let tf = points(1.0, &[(0.0, [1.0; 3], 1.0), (size, [1.0; 3], 1.0)]);
            let json = |mode: &str| {
                format!(
                    r#"{{"camera": {{"eye": [90, 80, 70], "target": [20, 20, 14], "up": [0, 0, 1], "fov_y": 30}},
                        "image": {{"width": 60, "height": 60}}, "mode": "{mode}", "transfer_function": {tf},
                        "clip": {{"box": [{low:?}, [99, 99, 99]]}}}}"#
                )
            };
            for mode in ["mip", "minip", "mean"] {
                let scene = scene(&volume, &json(mode));
                for core in [16, 64] {
                    let bricked = Bricked::new(&volume, core);
                    for quality in
                        [packets(FINEST, Skipping::On, None), packets(FINEST, Skipping::Off, None), cells(FINEST)]
                    {
                        let seen = bricked.render_of(&scene, quality).0.pixels.iter().filter(|p| p[3] > 0.0).count();
                        assert_eq!(
                            seen, 0,
                            "axis {axis}, {voxel_type:?}, {mode}, bricks of {core}: pixels with something"
                        );
                    }
                }
            }
        }
    }
}

/// Rays on planes of voxels and on faces of macro cells: holes beside them have no weight.
#[test]
fn holes_beside_rays_in_planes_of_voxels() {
    let axes =
        [([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]), ([0.0, -1.0, 0.0], [0.0, 0.0, 1.0]), ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])];
    for voxel_type in [VoxelType::F32, VoxelType::U8] {
        let size = greatest_of(voxel_type);
        let volume =
            Volume::new([20, 19, 17], voxel_type, move |p| size * noise(p)).with_holes(|[_, j, k]| j == 9 || k == 12);
        let volume = Volume { nodata: (voxel_type == VoxelType::U8).then_some(255.0), ..volume };
        let bricked = Bricked::new(&volume, 16);
        let tf = points(1.0, &[(0.0, [0.1, 0.2, 0.9], 0.2), (size, [1.0, 0.1, 0.3], 1.0)]);
        let iso = format!(r#", "iso": [{{"value": {}, "color": [1, 1, 0]}}]"#, 0.47 * size);
        for (mode, rest) in [("mip", ""), ("minip", ""), ("mean", ""), ("iso", iso.as_str())] {
            for (forward, up) in axes {
                for height in [16.0, 8.0] {
                    let eye = [8.0; 3];
                    let target: [f64; 3] = std::array::from_fn(|a| eye[a] + forward[a]);
                    let camera = format!(
                        r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": {up:?}, "height": {height}}}"#
                    );
                    let image = r#""image": {"width": 17, "height": 16}"#;
                    let json = format!(r#"{{{camera}, {image}, "mode": "{mode}", "transfer_function": {tf}{rest}}}"#);
                    let scene = scene(&volume, &json);
                    let name = format!("{voxel_type:?} {mode} along {forward:?}, {height}");
                    let (found, counters) = bricked.render_of(&scene, packets(FINEST, Skipping::On, None));
                    assert!(found.is_finite() && counters.cells_exact > 0, "{name}: nothing was settled exactly");
                    let change = difference(&found, &bricked.render_of(&scene, cells(FINEST)).0);
                    assert!(change <= bound(&scene), "{name}: {change}/255 from the scalar caster");
                    let error = difference(&found, &reference(&volume, &scene));
                    eprintln!("{name}: {change:.6}/255 from the scalar caster, {error:.6}/255 from the reference");
                    assert!(error <= 0.1, "{name}: {error}/255 from the reference");
                }
            }
        }
    }
}

/// Rays along an axis through the voxels of a column see the greatest and the least of them, bit for bit, even if a
/// transfer function steps there.
#[test]
fn extremes_on_voxels_are_exact() {
    for voxel_type in [VoxelType::F32, VoxelType::U8, VoxelType::U16, VoxelType::I16, VoxelType::F64] {
        let unit = if matches!(voxel_type, VoxelType::F32 | VoxelType::F64) { 0.0137 } else { 1.0 };
        // Columns along z have their greatest value, 210 or 211 units, and their least, 3 or 4, in one voxel each.
        let field = move |[x, y, z]: [f64; 3]| {
            let (odd, at) = ((x + y) % 2.0, (7.0 * x + 3.0 * y) % 37.0);
            let units = if z == at {
                210.0 + odd
            } else if z == (at + 11.0) % 37.0 {
                3.0 + odd
            } else {
                100.0 + 60.0 * noise([x, y, z]).round()
            };
            units * unit
        };
        let volume = Volume::new([16, 16, 37], voxel_type, field);
        for (spacing, (mode, value)) in
            [[1.0; 3], [0.7, 0.7, 0.37]].into_iter().flat_map(|s| [("mip", 211.0), ("minip", 4.0)].map(|m| (s, m)))
        {
            let volume = volume.clone().with_geometry(spacing, [0.0; 3], [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
            let bricked = Bricked::new(&volume, 16);
            let (middle, height) = (7.5 * spacing[0], 16.0 * spacing[0]);
            // The value as stored in the voxel, not as computed.
            let value = if voxel_type == VoxelType::F32 { f64::from((value * unit) as f32) } else { value * unit };
            let tf = points(1.0, &[(-1e3, [1.0; 3], 0.0), (value, [1.0; 3], 0.0), (value, [1.0; 3], 1.0)]);
            for z in [-9.0, 50.0] {
                let (eye, target) = ([middle, middle, z], [middle, middle, 0.0]);
                let camera = format!(
                    r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0, 1, 0], "height": {height}}}"#
                );
                let image = r#""image": {"width": 16, "height": 16}"#;
                let scene =
                    scene(&volume, &format!(r#"{{{camera}, {image}, "mode": "{mode}", "transfer_function": {tf}}}"#));
                let (picture, _) = bricked.render_of(&scene, packets(FINEST, Skipping::On, None));
                assert!(picture.is_finite());
                for (i, pixel) in picture.pixels.iter().enumerate() {
                    // The columns of a row alternate, mirrored left to right or not: 16 is even.
                    let (x, y) = (i % 16, 15 - i / 16);
                    let x = if z < 0.0 { 15 - x } else { x };
                    let expected = ((x + y) % 2) as f32;
                    assert_eq!(pixel[3], expected, "{voxel_type:?} {mode} {spacing:?} from {z}, column {x}, {y}");
                }
            }
        }
    }
}
