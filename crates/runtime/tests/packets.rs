//! Packets of rays: the error that is asked for is kept, with every set of instructions.

mod support;

use supervol_format::{Lod, VoxelType};
use supervol_runtime::lod::LodChoice;
use supervol_runtime::raycast::cpu::simd::InstructionSet;
use supervol_runtime::raycast::cpu::{Caster, CpuQuality, PacketRule, Skipping};
use supervol_runtime::scene::ResolvedScene;
use support::{Bricked, Random, Volume, difference, marschner_lobb, noise, points, reference, scene};

/// Random scenes of [`random_scenes_keep_the_error`], half of them shaded.
const SCENES: u64 = 80;
const SEED: u64 = 20_261_122;

fn quality(max_error: f64, instructions: Option<InstructionSet>) -> CpuQuality {
    let caster = Caster::Packets(PacketRule { max_error, instructions });
    CpuQuality { lod: LodChoice::Fixed(Lod(0)), skipping: Skipping::On, caster }
}

/// Waves, white noise, or Marschner and Lobb's signal, in a type of voxel that takes its turn.
fn random_volume(random: &mut Random) -> Volume {
    let dims = [0; 3].map(|_| 14 + random.below(20));
    let voxel_type = [VoxelType::F32, VoxelType::U8, VoxelType::U16, VoxelType::I16][random.below(4)];
    // Integers have some hundred values.
    let size = if voxel_type == VoxelType::F32 { 1.0 } else { 120.0 };
    let frequency = 0.2 + random.unit();
    match random.below(3) {
        0 => Volume::new(dims, voxel_type, move |p| {
            size * (0.5 + 0.5 * (frequency * (p[0] + 0.7 * p[1] + 1.3 * p[2])).sin())
        }),
        1 => Volume::new(dims, voxel_type, move |p| size * noise(p)),
        _ => Volume::new(dims, voxel_type, move |p| size * marschner_lobb(dims[0])(p)),
    }
}

/// Ramps, steps and spikes, faint and nearly opaque, seen from anywhere outside.
fn random_scene(random: &mut Random, volume: &Volume) -> ResolvedScene {
    let size = if volume.voxel_type == VoxelType::F32 { 1.0 } else { 120.0 };
    let mut values: Vec<f64> = (0..2 + random.below(5)).map(|_| size * random.unit()).collect();
    values.sort_by(f64::total_cmp);
    if random.unit() < 0.4 {
        values[1] = values[0];
    }
    let greatest = [0.05, 0.3, 0.95][random.below(3)];
    let points_of_tf: Vec<(f64, [f64; 3], f64)> = values
        .into_iter()
        .map(|value| {
            let alpha = if random.unit() < 0.3 { 0.0 } else { greatest * random.unit() };
            (value, [0; 3].map(|_| random.unit()), alpha)
        })
        .collect();
    let tf = points(1.0, &points_of_tf);
    let centre = volume.dims.map(|n| n as f64 / 2.0);
    let direction = [0; 3].map(|_| random.unit() - 0.5);
    let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt().max(0.01);
    let eye: [f64; 3] = std::array::from_fn(|a| centre[a] + 70.0 * direction[a] / length);
    let camera = format!(r#""eye": {eye:?}, "target": {centre:?}, "up": [0.1, 0.2, 1], "fov_y": 26"#);
    let image = r#""image": {"width": 20, "height": 16}"#;
    let shading = if random.unit() < 0.5 { random_shading(random) } else { String::new() };
    scene(volume, &format!(r#"{{"camera": {{{camera}}}, {image}, "transfer_function": {tf}{shading}}}"#))
}

/// The default, or one to three lights from anywhere on a material that is dull or shiny.
fn random_shading(random: &mut Random) -> String {
    if random.unit() < 0.4 {
        return r#", "shading": {}"#.to_owned();
    }
    let lights: Vec<String> = (0..1 + random.below(3))
        .map(|_| {
            let direction = [0; 3].map(|_| random.unit() - 0.501);
            format!(r#"{{"direction": {direction:?}, "intensity": {}}}"#, random.unit())
        })
        .collect();
    let shininess = [1.0, 4.0, 32.0, 120.0][random.below(4)];
    let [ambient, diffuse, specular] = [0; 3].map(|_| random.unit());
    format!(
        r#", "shading": {{"ambient": {ambient}, "diffuse": {diffuse}, "specular": {specular}, "shininess": {shininess}, "lights": [{}]}}"#,
        lights.join(", ")
    )
}

#[test]
fn random_scenes_keep_the_error() {
    let mut random = Random(SEED);
    let mut greatest = [0.0f64; 4];
    let levels = [0.1, 0.5, 2.0, 8.0];
    for i in 0..SCENES {
        let volume = random_volume(&mut random);
        let scene = random_scene(&mut random, &volume);
        let exact = reference(&volume, &scene);
        let bricked = Bricked::new(&volume, 16);
        for (level, greatest) in levels.into_iter().zip(&mut greatest) {
            let found = bricked.render_of(&scene, quality(level / 255.0, None)).0;
            let error = difference(&found, &exact);
            assert!(error <= level, "seed {SEED}, scene {i}, {:?}: {error} of {level} levels", volume.voxel_type);
            *greatest = greatest.max(error);
        }
    }
    println!(
        "seed {SEED}, {SCENES} scenes: errors asked for {levels:?}, largest found {greatest:?} of 255 grey levels"
    );
    assert!(greatest[3] > greatest[0], "the error that is asked for changes nothing");
}

#[test]
fn instruction_sets_agree() {
    let mut random = Random(SEED + 1);
    let sets: Vec<InstructionSet> = InstructionSet::available().collect();
    println!("instructions: {sets:?}");
    assert!(sets.contains(&InstructionSet::Portable));
    for i in 0..12 {
        let volume = random_volume(&mut random);
        let scene = random_scene(&mut random, &volume);
        let bricked = Bricked::new(&volume, 16);
        let error = PacketRule::DEFAULT.max_error;
        let first = bricked.render_of(&scene, quality(error, Some(InstructionSet::Portable))).0;
        for &set in &sets {
            // Fused sums round otherwise; a cell may then be refined or not: a quarter of the error.
            let change = difference(&bricked.render_of(&scene, quality(error, Some(set))).0, &first);
            assert!(change <= 0.125, "scene {i}, {}: {change}/255", set.name());
        }
    }
}
