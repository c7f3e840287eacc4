//! Time of one converged picture: 400 x 300, level 0, from a container in the page cache, CPU backend.

#![allow(missing_docs, reason = "a bench has no callers")]

use std::sync::Arc;

use divan::Bencher;
use supervol_format::container::manifest::Source;
use supervol_format::{Container, Dims, Lod, VoxelType};
use supervol_preprocess::{BuildOptions, Existing, build};
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::render;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::scene::Scene;
use supervol_sources::synthetic::Synthetic;

#[divan::bench(args = ["seismic", "vessels", "marschner-lobb"], consts = [false, true], sample_count = 5, sample_size = 1)]
fn picture<const SHADED: bool>(bencher: Bencher<'_, '_>, name: &str) {
    let source = Synthetic::new(name, Dims([128; 3]), Some(VoxelType::U8), 1).expect("a known volume");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = folder.path().join("bench.svol");
    let options =
        BuildOptions { memory_bytes: 256 << 20, existing: Existing::Replace, threads: 2, ..BuildOptions::default() };
    let origin = Source::computed(name);
    build(&source, origin, &output, &options, &|_| ()).expect("a temporary folder has room");
    let container = Arc::new(Container::open(&output).expect("what was built opens"));
    let json =
        format!(r#"{{"image": {{"width": 400, "height": 300}}{}}}"#, if SHADED { r#", "shading": {}"# } else { "" });
    let scene =
        Scene::from_json(&json).expect("a valid scene").resolve(&VolumeFacts::of(&container)).expect("a valid scene");
    let options =
        RenderOptions { backend: Backend::Cpu, level: LevelChoice::Fixed(Lod::FINEST), ..RenderOptions::default() };
    bencher.bench_local(|| render(&container, &scene, &options).expect("memory suffices"));
}

fn main() {
    divan::main();
}
