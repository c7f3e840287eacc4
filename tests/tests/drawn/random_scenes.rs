//! Random scenes drawn by ray packets: the requested and the predicted error are kept, with every instruction set.
//!
//! The scenes are the first ones of `supervol bench --random-scenes 1000`.

#![allow(clippy::print_stdout, reason = "the distances measured are what these tests are for")]

use supervol_measure::random_scenes::{ERRORS, Feature, Found, Options, RandomScene, aimed_at, run};
use supervol_measure::{Context, Scale};
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::engines::packets::PacketRule;
use supervol_runtime::engines::packets::simd::InstructionSet;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_scene::scene::Mode;
use supervol_tests::pictures::{distance, gpu_name};

const SCENES: u64 = 80;
/// Number of scenes in each mode other than `dvr`.
const SCENES_OF_MODE: u64 = 20;
/// Number of scenes with opacity by the gradient.
const GRADIENT_SCENES: u64 = 40;
/// Number of scenes with cuts that are lit by their own normals.
const CUT_SCENES: u64 = 60;
/// Fewer on the GPU: software adapters take a second per scene.
const GPU_SCENES: u64 = 20;
const SEED: u64 = 1;

fn with_context<T>(test: impl FnOnce(&Context<'_>) -> T) -> T {
    let folder = tempfile::tempdir().expect("tests need a temporary folder");
    test(&Context { scale: Scale::Small, folder: folder.path(), say: &|_| () })
}

#[test]
fn random_scenes_keep_the_error() {
    let options = Options {
        seed: SEED,
        first: 0,
        scenes: SCENES,
        mode: Mode::Dvr,
        feature: Feature::None,
        threads: 2,
        backend: Backend::Cpu,
    };
    let found = with_context(|context| run(context, options, None)).unwrap_or_else(|e| panic!("seed {SEED}: {e}"));
    println!("{found:#?}");
    assert!(found.scenes_above().is_empty(), "further off than was asked for: {found:#?}");
    assert!(found.scenes_not_judged.is_empty(), "the reference did not converge: {found:#?}");
    assert!(found.scenes_that_show_something > SCENES / 2, "{found:#?}");
    for at in &found.errors {
        let predicted = at.predicted.as_ref().unwrap_or_else(|| panic!("nothing was predicted: {at:#?}"));
        assert!(predicted.scenes_above.is_empty(), "further off than predicted: {at:#?}");
        // A prediction that is far too large is useless.
        assert!(predicted.largest_share > 0.05, "{at:#?}");
    }
    assert_no_more_is_stated_than_asked(&found);
    for at in &found.stated {
        assert!(at.scenes_above_stated.is_empty(), "further off than is stated of a pixel: {at:#?}");
        assert!(at.pixels > 300 && at.largest_share_of_stated > 0.05, "{at:#?}");
    }
    let [smallest, greatest] = [0, ERRORS.len() - 1].map(|i| found.errors[i].largest_grey_levels);
    assert!(greatest > smallest && smallest > 0.0, "the error that is asked for changes nothing: {found:#?}");
}

/// With opacity by the gradient, cells are integrated in `f64` and state a bound.
#[test]
fn random_scenes_with_opacity_by_the_gradient_keep_the_error() {
    keeps_the_error(Feature::GradientOpacity, GRADIENT_SCENES);
}

/// Behind cut faces that are lit by their own normals, cells are integrated in `f64` and state a bound; packets gather the rest.
#[test]
fn random_scenes_with_normals_of_cuts_keep_the_error() {
    keeps_the_error(Feature::CutNormals, CUT_SCENES);
}

/// Scenes with a feature keep the error that is asked for and the one that is stated.
#[track_caller]
fn keeps_the_error(feature: Feature, scenes: u64) {
    let mode = Mode::Dvr;
    let options = Options { seed: SEED, first: 0, scenes, mode, feature, threads: 2, backend: Backend::Cpu };
    let found = with_context(|context| run(context, options, None)).unwrap_or_else(|e| panic!("seed {SEED}: {e}"));
    println!("{found:#?}");
    assert!(found.scenes_above().is_empty(), "further off than was asked for: {found:#?}");
    assert!(found.scenes_not_judged.is_empty(), "the reference did not converge: {found:#?}");
    assert!(found.scenes_that_show_something > scenes / 2, "{found:#?}");
    assert_no_more_is_stated_than_asked(&found);
    for at in &found.stated {
        assert!(at.scenes_above_stated.is_empty(), "further off than is stated of a pixel: {at:#?}");
    }
    let coarser = found.stated.iter().find(|at| at.level == 1).expect("level 1 is drawn");
    assert!(coarser.pixels > 300, "hardly a pixel changes with the level: {coarser:#?}");
}

/// Asserts that no pixel of the finest level states more than was asked for.
fn assert_no_more_is_stated_than_asked(found: &Found) {
    for at in found.stated.iter().filter(|at| at.level == 0) {
        assert!(at.largest_stated_grey_levels <= at.asked_grey_levels, "more is stated than asked for: {at:#?}");
    }
}

/// In every mode, the stated error of pixels from coarser levels holds, and half a grey level holds at level 0.
#[test]
fn random_scenes_keep_what_is_stated_in_every_mode() {
    for mode in [Mode::Mip, Mode::Minip, Mode::Mean, Mode::Iso] {
        let options = Options {
            seed: SEED,
            first: 0,
            scenes: SCENES_OF_MODE,
            mode,
            feature: Feature::None,
            threads: 2,
            backend: Backend::Cpu,
        };
        let found = with_context(|context| run(context, options, None)).unwrap_or_else(|e| panic!("{mode:?}: {e}"));
        println!("{found:#?}");
        assert!(found.scenes_that_show_something > SCENES_OF_MODE / 2, "{found:#?}");
        assert!(found.errors.iter().all(|at| at.largest_grey_levels <= 0.5), "{found:#?}");
        for at in &found.stated {
            assert!(at.scenes_above_stated.is_empty(), "{mode:?}: further off than is stated of a pixel: {at:#?}");
        }
        let coarser = found.stated.iter().find(|at| at.level == 1).expect("level 1 is drawn");
        assert!(coarser.pixels > 300, "hardly a pixel changes with the level: {coarser:#?}");
    }
}

/// Scenes (seed/number) that were found to exceed the requested or the stated error. Causes:
/// - 1/978: a gradient that becomes too short for a normal between the end of a cell and the next light sample. The
///   indivisible rest of the cell had a rule that does not detect this. Also a wide highlight that passes from one side
///   to the other;
/// - 1/423: colours that are cut off at 1, where one pair of points and two agreed by chance;
/// - 1/554: opacities that are not known well add up to more than 1, and so did shares of the budget that go by them;
/// - 1/934: a chord on which colour is constant at first and then changes, estimated as changing all along;
/// - 1/330: a normal that reverses within a two-hundredth of a cell, with light sampled at equal distances by the root
///   rule;
/// - 1/999: almost all of a normal's turn close to the point at which the gradient almost vanishes;
/// - 2/564, 2/991: as 330, missed by the reference;
/// - 2/10, 2/546: colours that differ by more than their mean differs from white, some of them clamped at 1;
/// - 3/191, 3/648: a normal that reverses between a cell's end and its first light sample;
/// - 5/835, 6/737, 6/860: a normal that turns aside and back between two samples;
/// - 5/655: a root rule with a fixed error of half a grey level, whatever error was requested;
/// - 3/147, 3/304, 3/883: a thin shell in a long chord, for which the effect of the order of colours was overestimated.
#[test]
fn scenes_that_were_further_off_than_asked_or_stated() {
    let scenes: [(u64, &[u64]); 5] = [
        (1, &[330, 423, 554, 934, 978, 999]),
        (2, &[10, 546, 564, 991]),
        (3, &[147, 191, 304, 648, 883]),
        (5, &[655, 835]),
        (6, &[737, 860]),
    ];
    for (seed, first) in scenes.iter().flat_map(|(seed, scenes)| scenes.iter().map(|&scene| (*seed, scene))) {
        let options = Options {
            seed,
            first,
            scenes: 1,
            mode: Mode::Dvr,
            feature: Feature::None,
            threads: 2,
            backend: Backend::Cpu,
        };
        let found =
            with_context(|context| run(context, options, None)).unwrap_or_else(|e| panic!("scene {first}: {e}"));
        println!("{found:#?}");
        assert!(found.scenes_above().is_empty(), "{seed}/{first} is further off than was asked for: {found:#?}");
        assert!(found.scenes_not_judged.is_empty(), "{seed}/{first}: the reference did not converge: {found:#?}");
        let is_stated = found.stated.iter().all(|at| at.scenes_above_stated.is_empty());
        assert!(is_stated, "{seed}/{first} is further off than is stated of a pixel: {found:#?}");
        assert_no_more_is_stated_than_asked(&found);
    }
}

/// The CPU casts again what the GPU cannot settle.
#[test]
fn random_scenes_keep_the_error_on_the_gpu() {
    if gpu_name().is_none() {
        return;
    }
    let options = Options {
        seed: SEED,
        first: 0,
        scenes: GPU_SCENES,
        mode: Mode::Dvr,
        feature: Feature::None,
        threads: 2,
        backend: Backend::Gpu,
    };
    let found = with_context(|context| run(context, options, None)).unwrap_or_else(|e| panic!("seed {SEED}: {e}"));
    println!("{found:#?}");
    assert!(found.scenes_that_show_something > GPU_SCENES / 2, "{found:#?}");
    for at in &found.errors {
        assert!(at.scenes_above.is_empty(), "further off than was asked for: {at:#?}");
        let predicted = at.predicted.as_ref().unwrap_or_else(|| panic!("nothing was predicted: {at:#?}"));
        assert!(predicted.scenes_above.is_empty(), "further off than predicted: {at:#?}");
    }
    for at in &found.stated {
        assert!(at.scenes_above_stated.is_empty(), "further off than is stated of a pixel: {at:#?}");
        // Hardly a pixel is off by anything where a tenth of a level is asked for.
        assert!(at.pixels > 300 || at.asked_grey_levels < 0.5, "{at:#?}");
        assert!(at.largest_share_of_stated > 0.05, "{at:#?}");
    }
    assert_no_more_is_stated_than_asked(&found);
    let [smallest, greatest] = [0, ERRORS.len() - 1].map(|i| found.errors[i].largest_grey_levels);
    assert!(greatest > smallest && smallest > 0.0, "the error that is asked for changes nothing: {found:#?}");
}

/// 7/197: values two million bins away from a narrow function, at which antiderivatives cancelled without a finer
/// division.
#[test]
fn scenes_that_were_further_off_on_the_gpu() {
    if gpu_name().is_none() {
        return;
    }
    let options = Options {
        seed: 7,
        first: 197,
        scenes: 1,
        mode: Mode::Dvr,
        feature: Feature::None,
        threads: 2,
        backend: Backend::Gpu,
    };
    let found = with_context(|context| run(context, options, None)).unwrap_or_else(|e| panic!("scene 197: {e}"));
    println!("{found:#?}");
    assert!(found.scenes_above().is_empty(), "further off than was asked for: {found:#?}");
    assert!(found.stated.iter().all(|at| at.scenes_above_stated.is_empty()), "further off than is stated: {found:#?}");
}

#[test]
fn instruction_sets_agree() {
    let sets: Vec<InstructionSet> = InstructionSet::available().collect();
    println!("instructions: {sets:?}");
    assert!(sets.contains(&InstructionSet::Portable));
    with_context(|context| {
        for number in 0..12 {
            let built = RandomScene::new(SEED + 1, number).build(context);
            let (volume, scene) = built.unwrap_or_else(|e| panic!("scene {number}: {e}"));
            let picture = |set: InstructionSet| {
                let caster = Caster::Packets(PacketRule { instructions: Some(set), ..PacketRule::DEFAULT });
                let rendered = volume.render(&scene, &RenderOptions { caster, ..aimed_at(0.5, 2) });
                rendered.unwrap_or_else(|e| panic!("scene {number}, {}: {e}", set.name())).0
            };
            let first = picture(InstructionSet::Portable);
            for &set in &sets {
                // Fused sums round differently, so that a cell may be refined or not: a quarter of the error.
                let change = distance(&picture(set), &first);
                assert!(change <= 0.125, "scene {number}, {}: {change}/255", set.name());
            }
        }
    });
}
