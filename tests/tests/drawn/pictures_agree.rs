//! Acceptance test of pictures: real containers, every mode, every backend, and options that must not change a picture.
//!
//! The reference integrator defines the right picture. Backends agree pairwise within the requested error, by default
//! half a grey level ([`BOUND`]). Options without effect by design change no bit on the CPU. `--nocapture` prints every
//! distance. `UPDATE_ACCEPTANCE=1` writes the distances of the backends to `docs/acceptance.md`.

#![allow(clippy::print_stdout, reason = "the distances measured are what these tests are for")]

use std::fmt::Write as _;
use std::path::Path;

use supervol_format::random::mix;
use supervol_format::{Dims, Lod, VoxelBox, VoxelType};
use supervol_runtime::engines::cells::CellRule;
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::engines::error::EngineError;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::lod::by_error::ANY_ERROR;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{Renderer, render};
use supervol_runtime::stream::classify::Skipping;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::ResolvedScene;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::synthetic::Synthetic;
use supervol_tests::fields::{Field, options};
use supervol_tests::pictures::{
    BOUND, EYE_SHIFT_VOXELS, SubBox, Subject, covered, distance, finest, gpu_name, mean_distance, new_renderer,
    stable_pixels, stored_file,
};

const SIZE: &str = r#""image": {"width": 64, "height": 48}"#;
const SMALL: &str = r#""image": {"width": 40, "height": 32}"#;
const SHADED: &str = r#""shading": {}"#;
/// Requested errors, in grey levels.
const ASKED: [f64; 3] = [0.1, BOUND, 2.0];
/// Below this the GPU aims at the requested error, but its tables do not guarantee it (decision 017).
const LEAST_KEPT: f64 = 0.25;
/// Greatest share of pixels that may lie on silhouettes.
const SILHOUETTE_SHARE: f64 = 0.02;
/// Additional error of a uniform brick. It is integrated as one chord, so that a ray may end beyond the opacity at
/// which single cells would have ended it. That is 0.0003 of opacity.
const ONE_CHORD: f64 = 0.0765;

const BLUE: [f64; 3] = [0.1, 0.3, 0.9];
const GOLD: [f64; 3] = [1.0, 0.75, 0.2];
const RED: [f64; 3] = [0.9, 0.15, 0.1];

fn smooth(subject: &Subject) -> String {
    if subject.name.starts_with("seismic") {
        let white = [0.9, 0.9, 0.9];
        return subject.transfer_function(&[(0.0, BLUE, 0.3), (0.5, white, 0.0), (1.0, RED, 0.3)]);
    }
    subject.transfer_function(&[(0.0, BLUE, 0.0), (0.3, BLUE, 0.01), (0.6, GOLD, 0.08), (1.0, RED, 0.3)])
}

/// A step from almost transparent to almost opaque.
fn step(subject: &Subject) -> String {
    subject.transfer_function(&[(0.0, BLUE, 0.01), (0.4871, BLUE, 0.01), (0.4871, GOLD, 0.7), (1.0, RED, 0.9)])
}

/// A peak one twentieth of the value range wide.
fn hat(subject: &Subject) -> String {
    let points = [(0.0, GOLD, 0.0), (0.462, GOLD, 0.0), (0.487, BLUE, 0.8), (0.512, GOLD, 0.0), (1.0, GOLD, 0.0)];
    subject.transfer_function(&points)
}

/// Two iso surfaces, the outer one semi-transparent.
fn surfaces(subject: &Subject) -> String {
    let (outer, inner) = (subject.value(0.4137), subject.value(0.6619));
    format!(
        r#""mode": "iso", "iso": [{{"value": {outer:?}, "color": [0.9, 0.7, 0.4], "alpha": 0.5}},
            {{"value": {inner:?}, "color": [0.3, 0.7, 0.9]}}]"#
    )
}

/// Name and JSON members of every mode.
fn modes(subject: &Subject) -> Vec<(&'static str, String)> {
    let iso = surfaces(subject);
    vec![
        ("dvr", r#""mode": "dvr""#.into()),
        ("dvr shaded", format!(r#""mode": "dvr", {SHADED}"#)),
        ("mip", r#""mode": "mip""#.into()),
        ("minip", r#""mode": "minip""#.into()),
        ("mean", r#""mode": "mean""#.into()),
        ("iso shaded", format!("{iso}, {SHADED}")),
        ("iso", format!(r#"{iso}, "shading": null"#)),
    ]
}

fn synthetic(name: &str, edge: u64, voxel_type: VoxelType) -> Subject {
    let source = Synthetic::new(name, Dims([edge; 3]), Some(voxel_type), 7).expect("these names and dims are allowed");
    Subject::new(&format!("{name} {edge}^3 {voxel_type}"), &source, &options(16))
}

/// The middle of the carp's head.
fn carp() -> Subject {
    let whole = open(&stored_file("carp_ct.nii.gz"), &OpenOptions::default()).expect("the file is a NIfTI");
    let start = [96, 128, 96];
    let head = SubBox::new(whole, VoxelBox { start, end: start.map(|s| s + 64) });
    Subject::new("carp CT 64^3 u8", &head, &options(32))
}

/// Draws pictures of level 0, one after the other. Bricks and GPU pipelines are reused.
struct Drawer(Renderer);

impl Drawer {
    fn new(subject: &Subject, backend: Backend) -> Self {
        Self(new_renderer(subject, finest(backend)))
    }

    /// The picture with a requested error in grey levels.
    fn draw(&mut self, scene: &ResolvedScene, asked: f64) -> Image {
        let options = RenderOptions { max_error: asked / GREY_LEVELS, ..self.0.options().clone() };
        self.0.set_options(options).expect("options are right");
        self.0.set_scene(scene.clone());
        let step = self.0.advance(None).unwrap_or_else(|e| panic!("{e}"));
        let stats = self.0.stats();
        let is_whole = step.is_finished && stats.bricks_failed == 0 && stats.device.anomalies == 0;
        assert!(is_whole, "{stats:#?}");
        self.0.picture().expect("it has converged").into_owned()
    }
}

/// Distances between two backends, one per error in [`ASKED`].
type Distances = [f64; ASKED.len()];

/// Distances between the pictures of one scene by all backends.
struct Row {
    scene: String,
    mode: String,
    cpu_reference: Distances,
    gpu_reference: Option<Distances>,
    gpu_cpu: Option<Distances>,
    not_judged: usize,
    pixels: usize,
}

impl Row {
    fn distances(&self) -> impl Iterator<Item = Distances> {
        [Some(self.cpu_reference), self.gpu_reference, self.gpu_cpu].into_iter().flatten()
    }

    fn markdown(&self) -> String {
        let number = |d: &f64| format!("{d:.4}");
        let numbers =
            |d: Option<Distances>| d.map_or(vec!["-".into(); ASKED.len()], |d| d.iter().map(number).collect());
        let Self { scene, mode, not_judged, pixels, .. } = self;
        let distances = [Some(self.cpu_reference), self.gpu_reference, self.gpu_cpu].map(numbers).concat().join(" | ");
        let silhouettes = if mode.starts_with("iso") { format!("{not_judged} of {pixels}") } else { "-".into() };
        format!("| {scene} | {mode} | {distances} | {silhouettes} |")
    }
}

/// Draws one scene with the reference, the CPU and, if there is one, the GPU.
fn compare(subject: &Subject, drawers: &mut [Drawer], mode: &str, scene: &ResolvedScene) -> Row {
    let exact = subject.finest(scene, Backend::Reference);
    let name = format!("{}, {mode}", subject.name);
    // In `minip`, the least value of nearly every ray may be transparent.
    let shows = covered(&exact) > 0.02 || mode == "minip";
    assert!(shows, "{name}: only {} of the picture shows anything", covered(&exact));
    let stable =
        if mode.starts_with("iso") { stable_pixels(subject, scene, &exact) } else { vec![true; exact.pixels.len()] };
    let between = |a: &Image, b: &Image| a.distance_where(b, |i| stable[i]);
    let pictures: Vec<_> = drawers.iter_mut().map(|drawer| ASKED.map(|asked| drawer.draw(scene, asked))).collect();
    let from_reference = |pictures: &[Image; ASKED.len()]| pictures.each_ref().map(|picture| between(picture, &exact));
    let gpu = pictures.get(1);
    let row = Row {
        scene: subject.name.clone(),
        mode: mode.into(),
        cpu_reference: from_reference(&pictures[0]),
        gpu_reference: gpu.map(from_reference),
        gpu_cpu: gpu.map(|gpu| std::array::from_fn(|i| between(&gpu[i], &pictures[0][i]))),
        not_judged: stable.iter().filter(|stable| !**stable).count(),
        pixels: stable.len(),
    };
    println!("{}", row.markdown());
    row
}

fn check(row: &Row) {
    let name = format!("{}, {}", row.scene, row.mode);
    for (i, asked) in ASKED.into_iter().enumerate() {
        let (worst, bound) = (greatest(row.distances().map(|d| d[i])), asked.max(LEAST_KEPT));
        assert!(worst <= bound, "{name} at an error of {asked}: {worst}/255, bound {bound}/255");
    }
    let share = row.not_judged as f64 / row.pixels as f64;
    assert!(share <= SILHOUETTE_SHARE, "{name}: {} of {} pixels are not judged", row.not_judged, row.pixels);
}

#[test]
fn backends_agree_in_every_mode() {
    let gpu = gpu_name();
    let backends = [Some(Backend::Cpu), gpu.as_ref().map(|_| Backend::Gpu)];
    let subjects = vec![
        synthetic("marschner-lobb", 41, VoxelType::U8),
        synthetic("seismic", 48, VoxelType::F32),
        synthetic("vessels", 64, VoxelType::U16),
        carp(),
    ];
    let mut rows = Vec::new();
    for subject in &subjects {
        let mut drawers: Vec<_> = backends.into_iter().flatten().map(|backend| Drawer::new(subject, backend)).collect();
        let camera = subject.outside();
        for (mode, members) in modes(subject) {
            let scene = subject.scene(&[&camera, SIZE, &smooth(subject), &members]);
            rows.push(compare(subject, &mut drawers, mode, &scene));
        }
        for (mode, tf) in [("dvr, step", step(subject)), ("dvr, hat", hat(subject))] {
            rows.push(compare(subject, &mut drawers, mode, &subject.scene(&[&camera, SIZE, &tf])));
            let shaded = subject.scene(&[&camera, SIZE, &tf, SHADED]);
            rows.push(compare(subject, &mut drawers, &format!("{mode}, shaded"), &shaded));
        }
    }
    if std::env::var_os("UPDATE_ACCEPTANCE").is_some_and(|v| v == "1") {
        write_table(&rows, gpu.as_deref());
    }
    rows.iter().for_each(check);
}

const WRITES: &str = "strings take everything";

/// The table as a Markdown document.
fn write_table(rows: &[Row], gpu: Option<&str>) {
    let mut text = String::from("# Acceptance of the pictures\n\n");
    let gpu = gpu.unwrap_or("none");
    let worst: [String; ASKED.len()] =
        std::array::from_fn(|i| format!("{:.4}", greatest(rows.iter().flat_map(Row::distances).map(|d| d[i]))));
    let worst = worst.join(", ");
    let asked = ASKED.map(|asked| asked.to_string());
    let [asked_for, columns] = [", ", " | "].map(|between| asked.join(between));
    let intro = format!(
        "Greatest difference of a colour channel or of opacity between two backends, in grey levels (1/255), level 0, \
         64 x 48 pixels, at errors of {asked_for} that are asked for (`--max-error`): each is the bound, or {LEAST_KEPT} where \
         it is less; the worst are {worst}. GPU adapter: {gpu}. Made by\n\n    \
         UPDATE_ACCEPTANCE=1 cargo test -p supervol-tests --test drawn backends_agree -- --nocapture\n\n\
         Not judged are, in mode iso only, pixels at which the reference itself changes by more than the bound when \
         the eye moves by {EYE_SHIFT_VOXELS} voxels: silhouettes, where the right picture jumps. They may be at most \
         {:.0} % of a picture. Steep transfer functions: *step* goes from opacity 0.01 to 0.7 at one value, *hat* is a \
         peak of a twentieth of the value range.\n\n",
        SILHOUETTE_SHARE * 100.0
    );
    text += &intro;
    writeln!(
        text,
        "| scene | mode | CPU - reference: {columns} | GPU - reference: {columns} | GPU - CPU: {columns} | not judged |"
    )
    .expect(WRITES);
    writeln!(text, "|---|---|{}---|", "---|".repeat(3 * ASKED.len())).expect(WRITES);
    for row in rows {
        writeln!(text, "{}", row.markdown()).expect(WRITES);
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/acceptance.md");
    std::fs::write(&path, text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
}

/// Waves of about ten voxels with a little noise, whole numbers from 1 to 120, which every voxel type can hold.
fn waves(p: [u64; 3]) -> f64 {
    let [x, y, z] = p.map(|v| v as f64);
    let wave = (x * 0.61).sin() + (y * 0.47 + 1.0).sin() + (z * 0.71 + x * 0.2).cos();
    let noise = (mix(p[0] ^ mix(p[1] ^ mix(p[2]))) % 7) as f64;
    (60.0 + 17.0 * wave + noise).round()
}

fn waves_of(dims: [u64; 3], voxel_type: VoxelType, core: u32) -> Subject {
    let name = format!("waves {dims:?} {voxel_type}, bricks of {core}");
    Subject::new(&name, &Field::new(dims, voxel_type, waves), &options(core))
}

/// Scenes in every mode, seen from outside.
fn scenes(subject: &Subject) -> Vec<(&'static str, ResolvedScene)> {
    let (camera, tf) = (subject.outside(), smooth(subject));
    let scene = |(mode, members): (_, String)| (mode, subject.scene(&[&camera, SMALL, &tf, &members]));
    modes(subject).into_iter().map(scene).collect()
}

/// Whether a mode is tested on the GPU in [`scenes`]; few modes, because software adapters compile pipelines slowly.
fn is_for_gpu(mode: &str) -> bool {
    matches!(mode, "dvr shaded" | "mean")
}

fn report(name: &str, distance: f64, bound: f64) {
    println!("{name}: {distance:.4}/255");
    assert!(distance <= bound, "{name}: {distance}/255, bound {bound}/255");
}

/// Greatest effect of the brick size, in grey levels. Packets compute positions in `f32` relative to a ray's entry into
/// a brick. In `dvr` they refine cells according to the transmittance in front of the brick
/// (docs/decisions/006-packets.md). Surfaces are found in `f64`.
fn brick_size_bound(mode: &str) -> f64 {
    match mode {
        "mip" | "minip" | "mean" => 0.001,
        _ if mode.starts_with("dvr") => 0.125,
        _ => 0.0,
    }
}

#[test]
fn skipping_changes_no_bit_and_brick_size_nothing_that_shows() {
    let subjects = [16, 32, 64, 128].map(|core| waves_of([70, 45, 50], VoxelType::I16, core));
    for (mode, scene) in scenes(&subjects[0]) {
        let first = subjects[0].finest(&scene, Backend::Cpu);
        for subject in &subjects {
            let expected = subject.finest(&scene, Backend::Cpu);
            report(&format!("{}, {mode}", subject.name), distance(&expected, &first), brick_size_bound(mode));
            let options = RenderOptions { skipping: Skipping::Off, ..finest(Backend::Cpu) };
            assert!(subject.render(&scene, &options).0 == expected, "{}, {mode}, no skipping", subject.name);
        }
    }
}

/// Much of `vessels` is exactly zero: whole bricks are uniform, and the brick size decides which ones.
#[test]
fn brick_size_and_skipping_of_a_sparse_volume() {
    let source = Synthetic::new("vessels", Dims([64; 3]), Some(VoxelType::U16), 7).expect("allowed");
    let subjects = [16, 32, 64, 128].map(|core| Subject::new(&format!("vessels/{core}"), &source, &options(core)));
    for (mode, scene) in scenes(&subjects[0]) {
        let expected = subjects[0].finest(&scene, Backend::Cpu);
        let pictures = subjects.iter().flat_map(|subject| {
            [Skipping::On, Skipping::Off].map(|skipping| {
                let options = RenderOptions { skipping, ..finest(Backend::Cpu) };
                subject.render(&scene, &options).0
            })
        });
        let worst = greatest(pictures.map(|picture| distance(&picture, &expected)));
        report(&format!("vessels, brick sizes and skipping, {mode}"), worst, ONE_CHORD);
    }
}

#[test]
fn memory_and_threads_change_no_bit() {
    let subject = waves_of([97, 80, 90], VoxelType::F32, 16);
    for (mode, scene) in scenes(&subject) {
        let (expected, all) = subject.render(&scene, &finest(Backend::Cpu));
        let one_thread = RenderOptions { threads: Some(1), ..finest(Backend::Cpu) };
        let tiny = RenderOptions { host_memory_bytes: 1, ..one_thread.clone() };
        let Err(RenderError::Budget(least)) = render(&subject.container, &scene, &tiny) else {
            panic!("one byte of host memory suffices");
        };
        for host_memory_bytes in [least.needed_bytes, 16 << 20, 4 << 30] {
            let options = RenderOptions { host_memory_bytes, ..one_thread.clone() };
            let (image, stats) = subject.render(&scene, &options);
            assert!(image == expected, "{mode}, {host_memory_bytes} bytes");
            assert!(stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes, "{stats:#?}");
            if host_memory_bytes == least.needed_bytes {
                assert!(
                    stats.streaming.evictions > 0 && stats.passes > all.passes,
                    "{mode}: a least cache is no test: {stats:#?}"
                );
            }
        }
        let eight = RenderOptions { threads: Some(8), ..one_thread };
        assert!(subject.render(&scene, &eight).0 == expected, "{mode}, 8 threads");
    }
}

#[test]
fn sixteen_slots_on_the_gpu_draw_what_all_do() {
    if gpu_name().is_none() {
        return;
    }
    let subject = waves_of([97, 80, 90], VoxelType::U8, 16);
    for (mode, scene) in scenes(&subject).into_iter().filter(|(mode, _)| is_for_gpu(mode)) {
        let expected = subject.finest(&scene, Backend::Cpu);
        let tiny = RenderOptions { gpu_memory_bytes: Some(1), ..finest(Backend::Gpu) };
        let (slot_bytes, min_slots, needed) = match subject.render_with_maps(&scene, &tiny) {
            Err(RenderError::Engine(EngineError::Gpu(GpuError::Budget { slot_bytes, min_slots, needed, .. }))) => {
                (slot_bytes, min_slots, needed)
            }
            other => panic!("one byte of GPU memory suffices, or another error: {:?}", other.err()),
        };
        // A sixteenth of the spare memory becomes staging memory.
        let few = needed + (16 - min_slots) * slot_bytes * 16 / 15;
        for gpu_memory_bytes in [few, 256 << 20] {
            let options = RenderOptions { gpu_memory_bytes: Some(gpu_memory_bytes), ..finest(Backend::Gpu) };
            let (image, stats) = subject.render(&scene, &options);
            let name = format!("{mode}, {gpu_memory_bytes} bytes on the GPU, {} passes", stats.passes);
            assert!(stats.gpu_bytes <= gpu_memory_bytes, "{stats:#?}");
            assert!(stats.device.page_ins > 32 && (stats.passes > 4 || gpu_memory_bytes > few), "{stats:#?}");
            report(&name, distance(&image, &expected), BOUND);
        }
    }
}

/// Compares the CPU and, in two modes, the GPU with the reference.
fn agrees(subject: &Subject, name: &str, members: &[&str], with_gpu: bool) {
    let tf = smooth(subject);
    for (mode, more) in modes(subject).into_iter().filter(|(mode, _)| !mode.starts_with("iso")) {
        let members: Vec<&str> = members.iter().copied().chain([tf.as_str(), more.as_str()]).collect();
        let scene = subject.scene(&members);
        let exact = subject.finest(&scene, Backend::Reference);
        let name = format!("{}, {name}, {mode}", subject.name);
        report(&format!("{name}, cpu"), distance(&subject.finest(&scene, Backend::Cpu), &exact), BOUND);
        if with_gpu && mode == "dvr shaded" {
            report(&format!("{name}, gpu"), distance(&subject.finest(&scene, Backend::Gpu), &exact), BOUND);
        }
    }
}

#[test]
fn eyes_inside_and_rays_along_the_axes() {
    let has_gpu = gpu_name().is_some();
    let subject = waves_of([37, 41, 33], VoxelType::U16, 16);
    let inside = r#""camera": {"eye": [15.5, 20, 16], "target": [40, 29, 18.5], "up": [0, 0, 1], "fov_y": 95}"#;
    agrees(&subject, "eye inside", &[inside, SMALL], has_gpu);
    // 32 pixels over 32 voxels. Every ray of the first camera lies in two planes of voxels. Rays of the second one also
    // lie in faces of bricks and macro cells.
    for (name, eye) in [("voxel planes", [16.5, 16.5, 16.0]), ("brick faces", [16.0, 16.0, 15.5])] {
        for (axis, up) in [([0.0, 0.0, 1.0], [0, 1, 0]), ([0.0, -1.0, 0.0], [0, 0, 1]), ([1.0, 0.0, 0.0], [0, 0, 1])] {
            let target: [f64; 3] = std::array::from_fn(|a| eye[a] + axis[a]);
            let camera = format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": {up:?}, "height": 32}}"#);
            let with_gpu = has_gpu && axis[2] > 0.0;
            agrees(&subject, &format!("along {axis:?} in {name}"), &[&camera, SMALL], with_gpu);
        }
    }
}

#[test]
fn odd_sizes() {
    let has_gpu = gpu_name().is_some();
    let sizes = [([1, 1, 9], 16), ([2, 2, 2], 16), ([31, 67, 127], 32), ([65, 5, 5], 64), ([17, 17, 17], 16)];
    for (dims, core) in sizes {
        let subject = waves_of(dims, VoxelType::U8, core);
        agrees(&subject, "outside", &[&subject.outside(), SMALL], has_gpu && dims != [2, 2, 2]);
    }
}

#[test]
fn anisotropic_spacing_and_rotated_axes() {
    let field = Field::new([37, 41, 33], VoxelType::I16, waves).with_info(|info| {
        info.geometry.spacing = [0.4, 1.7, 0.9];
        info.geometry.origin = [5e5, -3e6, 12.0];
        info.geometry.direction = [0.8, -0.6, 0.0, 0.6, 0.8, 0.0, 0.0, 0.0, 1.0];
    });
    let subject = Subject::new("waves, rotated and stretched", &field, &options(16));
    agrees(&subject, "outside", &[&subject.outside(), SMALL], gpu_name().is_some());
}

/// A value with absent voxels: single ones, a slab, a ball.
fn holed(p: [u64; 3]) -> Option<f64> {
    let from_middle: u64 = p.iter().map(|v| v.abs_diff(20).pow(2)).sum();
    let is_hole = mix(p[0] ^ mix(p[1] ^ mix(p[2] ^ 5))).is_multiple_of(31) || p[2] == 9 || from_middle < 50;
    (!is_hole).then(|| waves(p))
}

#[test]
fn not_a_number_and_nodata_are_the_same_holes() {
    let dims = [41, 37, 33];
    let nan = Field::new(dims, VoxelType::F32, |p| holed(p).unwrap_or(f64::NAN));
    let nan = Subject::new("waves with NaN", &nan, &options(16));
    let nodata = Field::new(dims, VoxelType::I16, |p| holed(p).unwrap_or(-9.0)).with_info(|i| i.nodata = Some(-9.0));
    let nodata = Subject::new("waves with nodata", &nodata, &options(16));
    assert_eq!(nan.facts.value_range, nodata.facts.value_range);
    let has_gpu = gpu_name().is_some();
    for subject in [&nan, &nodata] {
        agrees(subject, "outside", &[&subject.outside(), SMALL], has_gpu);
    }
    for (mode, scene) in scenes(&nan) {
        let pictures = [&nan, &nodata].map(|subject| subject.finest(&scene, Backend::Cpu));
        assert!(pictures[0] == pictures[1], "{mode}: {}/255", distance(&pictures[0], &pictures[1]));
    }
}

#[test]
fn every_voxel_type_gives_the_same_picture() {
    let has_gpu = gpu_name().is_some();
    let subjects = VoxelType::ALL.map(|voxel_type| waves_of([40, 33, 37], voxel_type, 16));
    for (mode, scene) in scenes(&subjects[0]) {
        let expected = subjects[0].finest(&scene, Backend::Cpu);
        for subject in &subjects[1..] {
            let image = subject.finest(&scene, Backend::Cpu);
            assert!(image == expected, "{}, {mode}: {}/255", subject.name, distance(&image, &expected));
        }
        // One type per storage format of voxels on the GPU.
        for subject in [&subjects[1], &subjects[3], &subjects[7]] {
            if has_gpu && mode == "dvr shaded" {
                let image = subject.finest(&scene, Backend::Gpu);
                report(&format!("{}, {mode}, gpu", subject.name), distance(&image, &expected), BOUND);
            }
        }
    }
}

/// Pictures far smaller than the volume, with levels chosen by the size of voxels alone. The numbers are the greatest
/// and the mean distance from level 0.
///
/// In the sphere, means of voxels are field values almost everywhere, but its edge is as wide as a coarse voxel. The
/// Marschner-Lobb signal oscillates within a pixel. Coarse levels average its values before classification, level 0
/// averages colours. This is the cost of choosing levels, not a bug.
const AUTOMATIC: [(&str, f64, f64); 2] = [("sphere", 6.0, 0.2), ("marschner-lobb", 70.0, 3.0)];

#[test]
fn automatic_levels_read_less_and_stay_close() {
    for (name, greatest, mean) in AUTOMATIC {
        let subject = synthetic(name, 128, VoxelType::U8);
        let image = r#""image": {"width": 40, "height": 30}, "samples_per_pixel": 1"#;
        let scene = subject.scene(&[&subject.outside(), image, &smooth(&subject)]);
        let averaged =
            subject.scene(&[&subject.outside(), &image.replace("pixel\": 1", "pixel\": 16"), &smooth(&subject)]);
        // The cell caster: packets would also integrate with any error.
        let caster = Caster::Cells(CellRule::DEFAULT);
        let automatic =
            RenderOptions { level: LevelChoice::Auto, max_error: ANY_ERROR, caster, ..finest(Backend::Cpu) };
        let (fine, all) = subject.render(&averaged, &finest(Backend::Cpu));
        let (coarse, few) = subject.render(&scene, &automatic);
        println!(
            "{name}: level 0 reads {} bytes, automatic levels {}",
            all.streaming.bytes_read, few.streaming.bytes_read
        );
        assert!(few.streaming.bytes_read * 20 < all.streaming.bytes_read, "{few:#?}");
        assert!(few.error_bound > 0.0 && all.error_bound == 0.0);
        let name = format!("{name}, automatic levels, 40 x 30 pixels");
        report(&name, distance(&coarse, &fine), greatest);
        report(&format!("{name}, mean"), mean_distance(&coarse, &fine), mean);
        // With the default error, the same rays show the same as level 0.
        let careful = RenderOptions { max_error: RenderOptions::default().max_error, ..automatic };
        let picture = subject.render(&scene, &careful).0;
        report(&format!("{name}, default error"), distance(&picture, &subject.finest(&scene, Backend::Cpu)), BOUND);
    }
}

#[test]
fn a_volume_seen_one_to_one_is_drawn_from_level_0() {
    let subject = synthetic("marschner-lobb", 64, VoxelType::U8);
    // 64 pixels over 64 voxels, straight on.
    let camera = r#""camera": {"eye": [31.5, 31.5, 200], "target": [31.5, 31.5, 0], "up": [0, 1, 0], "height": 64}"#;
    let image = r#""image": {"width": 64, "height": 64}"#;
    let scene = subject.scene(&[camera, image, &smooth(&subject)]);
    let automatic = RenderOptions { level: LevelChoice::Auto, ..finest(Backend::Cpu) };
    let (picture, stats) = subject.render(&scene, &automatic);
    assert!(stats.bricks_by_level[1..].iter().all(|level| level.page_ins == 0), "{stats:#?}");
    assert!(stats.bricks_by_level[0].page_ins > 0 && stats.error_bound == 0.0, "{stats:#?}");
    assert!(picture == subject.finest(&scene, Backend::Cpu));
    // Twice as far away, a pixel is two voxels wide. That suffices for level 1 with any error, but not with the default
    // error.
    let careful = automatic.clone();
    let automatic = RenderOptions { max_error: ANY_ERROR, ..automatic };
    let far = camera.replace(r#""height": 64"#, r#""height": 128"#);
    let (_, stats) = subject.render(&subject.scene(&[&far, image, &smooth(&subject)]), &automatic);
    assert!(stats.bricks_by_level[0].page_ins == 0 && stats.bricks_by_level[1].page_ins > 0, "{stats:#?}");
    let level = RenderOptions { level: LevelChoice::Fixed(Lod(1)), ..automatic.clone() };
    let far = subject.scene(&[&far, image, &smooth(&subject)]);
    assert!(subject.render(&far, &automatic).0 == subject.render(&far, &level).0);
    assert!(subject.render(&far, &careful).0 == subject.finest(&far, Backend::Cpu));
}
