//! Every function of the shaders is compared with Rust, or listed here with the reason why not.
//!
//! Functions that the test shaders call are compared with numbers computed in Rust (`gpu_twins`, `gpu_walk_twins`,
//! `gpu_places`). Functions called by those are compared as a part of them. All calls are read from the parsed shaders,
//! so a new function fails here until it is compared or listed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use naga::{Block, Function, Module, Statement};
use supervol_runtime::engines::gpu::shaders::{DRAWING, ShaderModule, TESTING, TexelAccess};

/// Functions that only pictures test, by reason.
const WITHOUT_TWIN: [(&str, &[&str]); 6] = [
    ("tells the pipeline's constants", &["mode"]),
    (
        "adds to counters and lists that the host reads: a wrong one is a picture that never ends, or one that counts \
         what it did not do (gpu_contracts, streaming_gpu)",
        &["is_worked_off", "note_miss", "note_use", "add_to_group", "count_in_group", "count_in_feedback", "tile_of"],
    ),
    (
        "decides what is leapt over: without leaps the picture is the same (gpu_images)",
        &["is_shown", "shown_blocks", "sweep", "is_worth_a_visit", "is_near_surfaces", "leap_on"],
    ),
    (
        "leads rays from brick to brick and from cell to cell by what is compared: pictures beside the reference's and the \
         CPU's (gpu_images, gpu_contracts, pictures_agree, random scenes)",
        &[
            "cast_ray",
            "cast_page",
            "cast_resident",
            "local_ray",
            "begin_part",
            "cast_brick",
            "cast_macro_cell",
            "gather_cell",
            "gather_light",
            "gather_part",
            "split_at",
            "cast_brick_light",
            "next_stretch",
            "try_part",
            "is_in_cell",
            "lit_part",
            "allowed_of",
            "behind_part",
            "turns_of_try",
            "lit_surface",
            "gradient_of",
            "note_levels",
        ],
    ),
    (
        "asks for crossings in their order by what is compared: pictures of surfaces (inner_surfaces, gpu_images)",
        &[
            "gather_between_surfaces",
            "gather_surfaces",
            "find_crossings",
            "meet_surface",
            "no_crossings",
            "first_of_crossings",
            "next_crossing",
        ],
    ),
    (
        "loads, stores, compares, or adds a product",
        &[
            "stored_cell",
            "corners_along",
            "no_part",
            "no_errors",
            "shaded",
            "composite",
            "composite_surface",
            "gather_absent",
            "gather_skipped",
            "gather_uniform",
            "gather_jumps",
            "gather_value",
            "is_settled",
            "counts_by_value",
            "is_rounding",
        ],
    ),
];

/// Compared functions whose twins have another name in Rust, and the place of the comparison.
const OTHER_NAMES: [(&str, &[&str]); 5] = [
    (
        "gpu_places: rays, bricks and pages from the camera and the pyramid, in `f64`",
        &[
            "begin_ray",
            "ray_of_pixel",
            "ray_from",
            "ray_at_level",
            "point_from",
            "region_at",
            "region_leave",
            "page_of",
        ],
    ),
    ("gpu_places: `scalar::shade::ChordGradient`, from voxels of a picture", &["chord_gradient"]),
    ("gpu_errors: `RayDeviation::note_greatest` and `note_least`, in one", &["note_extreme"]),
    ("gpu_walk_twins: `cubic_of_cell` and `monotone_intervals`, put together", &["cell_view"]),
    ("gpu_twins: `range_of_corners`", &["range_in"]),
];

/// The functions of a module, by name, with the names of their callees; `""` is its entry point.
fn calls(module: &ShaderModule) -> BTreeMap<String, BTreeSet<String>> {
    let parsed = naga::front::wgsl::parse_str(&module.source(TexelAccess::Sampled)).expect("the shader is valid");
    let named = parsed.functions.iter().map(|(_, function)| (name_of(function), called_by(&parsed, function)));
    let entries = parsed.entry_points.iter().map(|entry| (String::new(), called_by(&parsed, &entry.function)));
    named.chain(entries).collect()
}

fn name_of(function: &Function) -> String {
    function.name.clone().expect("functions of WGSL have names")
}

fn called_by(module: &Module, function: &Function) -> BTreeSet<String> {
    let mut called = BTreeSet::new();
    gather_calls(module, &function.body, &mut called);
    called
}

fn gather_calls(module: &Module, block: &Block, called: &mut BTreeSet<String>) {
    for statement in block {
        match statement {
            Statement::Call { function, .. } => {
                called.insert(name_of(&module.functions[*function]));
            }
            Statement::Block(block) => gather_calls(module, block, called),
            Statement::If { accept, reject, .. } => {
                [accept, reject].into_iter().for_each(|block| gather_calls(module, block, called));
            }
            Statement::Loop { body, continuing, .. } => {
                [body, continuing].into_iter().for_each(|block| gather_calls(module, block, called));
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|case| gather_calls(module, &case.body, called)),
            _ => {}
        }
    }
}

/// Names of the functions that Rust defines, in the runtime, the scene and their tests.
fn names_in_rust() -> BTreeSet<String> {
    let mut names = BTreeSet::new();
    let runtime = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut folders = vec![runtime.to_path_buf(), runtime.join("../scene")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("the crate's folder").map(|entry| entry.expect("an entry")) {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = std::fs::read_to_string(&path).expect("a source file");
                let after_fn = text.split("fn ").skip(1);
                names.extend(
                    after_fn.map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()),
                );
            }
        }
    }
    names
}

/// All functions that these call, directly or indirectly.
fn reached(from: &BTreeSet<String>, calls: &BTreeMap<String, BTreeSet<String>>) -> BTreeSet<String> {
    let mut reached = BTreeSet::new();
    let mut next: Vec<&String> = from.iter().collect();
    while let Some(name) = next.pop() {
        if reached.insert(name.clone()) {
            next.extend(&calls[name]);
        }
    }
    reached
}

#[test]
fn every_shader_function_is_compared_or_excused() {
    let drawn: BTreeSet<String> =
        DRAWING.iter().flat_map(calls).map(|(name, _)| name).filter(|n| !n.is_empty()).collect();
    let (mut compared, mut as_parts) = (BTreeSet::new(), BTreeSet::new());
    for module in &TESTING {
        let calls = calls(module);
        // Functions of the test's own file are not functions of the shaders, but call them.
        let own = |name: &&String| !drawn.contains(*name);
        let by_helpers = calls[""].iter().filter(own).flat_map(|name| &calls[name]);
        let direct = calls[""].iter().chain(by_helpers).filter(|name| drawn.contains(*name)).cloned().collect();
        as_parts.extend(reached(&direct, &calls));
        compared.extend(direct);
    }
    let excused: Vec<&str> = WITHOUT_TWIN.iter().flat_map(|(_, names)| *names).copied().collect();
    let undecided: Vec<&String> =
        drawn.iter().filter(|name| !as_parts.contains(*name) && !excused.contains(&name.as_str())).collect();
    assert!(undecided.is_empty(), "neither compared with a twin nor listed: {undecided:?}");
    let stale: Vec<&&str> =
        excused.iter().filter(|name| as_parts.contains(**name) || !drawn.contains(**name)).collect();
    assert!(stale.is_empty(), "listed, but compared or gone: {stale:?}");

    let in_rust = names_in_rust();
    let renamed: Vec<&str> = OTHER_NAMES.iter().flat_map(|(_, names)| *names).copied().collect();
    let nameless: Vec<&String> =
        compared.iter().filter(|name| !in_rust.contains(*name) && !renamed.contains(&name.as_str())).collect();
    assert!(nameless.is_empty(), "compared, but nothing in Rust has their name: {nameless:?}");
    let stale: Vec<&&str> =
        renamed.iter().filter(|name| in_rust.contains(**name) || !compared.contains(**name)).collect();
    assert!(stale.is_empty(), "said to have another name in Rust: {stale:?}");
}
