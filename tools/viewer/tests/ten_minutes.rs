//! Long scripted session: turning, editing, cutting, slicing, panels, one volume after the other, with bricks that are
//! unreadable for a time. Memory stays within its budget, nothing leaks, no brick is lost, and the picture is right.
//!
//! `cargo test -p supervol-viewer --test ten_minutes -- --ignored` runs for ten minutes; without `--ignored`, a few
//! rounds.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]

mod support;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui::{Key, Modifiers, PointerButton, Vec2};
use supervol_format::Container;
use supervol_format::random::Random;
use supervol_scene::scene::Scene;
use supervol_tests::counting::{self, Counting};
use supervol_viewer::worker::Settings;

use support::{Fault, Session};

#[global_allocator]
static COUNTING: Counting = Counting;

const BUDGET: usize = 64 << 20;
/// Pictures in transfer and on the screen, those of the panels, the window, its fonts.
const WINDOW: usize = 72 << 20;
/// Permitted growth for the same volume, rounds later: history, persistent settings, tables.
const SLACK: usize = 4 << 20;
const ROUNDS: usize = 6;
const SEED: u64 = 20_261_123;

/// One random action of a user.
fn act(session: &mut Session, dice: &mut Random) {
    const KEYS: [Key; 10] =
        [Key::ArrowRight, Key::ArrowUp, Key::Plus, Key::Minus, Key::P, Key::Num4, Key::Num0, Key::T, Key::B, Key::W];
    match dice.index(9) {
        0..=2 => session.press(Modifiers::NONE, KEYS[dice.index(KEYS.len())]),
        3 => {
            let middle = session.node("Picture").rect().center();
            session.drag(
                middle,
                Vec2::new(dice.index(120) as f32 - 60.0, dice.index(60) as f32),
                PointerButton::Primary,
            );
        }
        4 => session.click(["Max", "Volume", "Iso", "Mean"][dice.index(4)]),
        5 => session.set(["x, first voxel", "y, last voxel"][dice.index(2)], dice.index(40) as f64 + 4.0),
        6 => session.press(Modifiers::COMMAND, [Key::Z, Key::Y][dice.index(2)]),
        7 => {
            let level = dice.index(10) as f64 / 20.0;
            session.edit(|scene| scene.image.background = [level; 3]);
        }
        _ => {
            // Slices in the volume, if the mode has depth. At most one: the budget holds few pictures.
            session.click("Volume");
            if session.viewer().scene().slices.is_empty() {
                session.click("+ z");
            } else {
                session.click("Slice 1, remove");
            }
        }
    }
    session.frames(dice.index(6));
}

/// Returns to the volume's default picture and waits until everything is read.
fn clean(session: &mut Session) {
    session.click("Picture alone");
    session.click("Show all");
    session.edit(|scene| {
        scene.slices.clear();
        scene.clip = Default::default();
    });
    session.click("Max");
    session.press(Modifiers::NONE, Key::Num0);
    session.rest();
}

fn use_it(is_over: impl Fn(usize) -> bool) {
    let settings = Settings { host_memory_bytes: BUDGET as u64, ..Settings::default() };
    let mut session = Session::in_bricks("vessels", [64, 16], Scene::default(), settings);
    session.rest();
    let folder = session.folder.path().to_path_buf();
    let others = [("marschner-lobb", 48), ("sphere", 40)]
        .map(|(name, edge)| support::container_in_bricks(&folder, name, [edge, 16]));
    let files: Vec<PathBuf> = [folder.join("vessels.svol")].into_iter().chain(others).collect();
    let mut dice = Random::new(SEED);
    let mut at_rest: Vec<Vec<usize>> = vec![Vec::new(); files.len()];
    let mut met = 0;
    for round in 0.. {
        if is_over(round) {
            break;
        }
        let number = round % files.len();
        let file = &files[number];
        if round == files.len() {
            counting::forget_peak();
        }
        let container = Container::open(file).expect("a container");
        let fault = (round % 2 == 1).then(|| Fault::new(file, &container, dice.index(1000)));
        session.harness.state_mut().open(file);
        session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == *file));
        for _ in 0..8 {
            act(&mut session, &mut dice);
        }
        if let Some(fault) = fault {
            // Every brick is looked at.
            session.click("Mean");
            session.rest();
            met += session.viewer().picture().expect("a picture").stats.bricks_failed;
            fault.mend();
        }
        for _ in 0..4 {
            act(&mut session, &mut dice);
        }
        clean(&mut session);
        // Failed bricks are retried after some time.
        let failed = |session: &Session| session.viewer().picture().expect("a picture").stats.bricks_failed;
        for _ in 0..60 {
            if failed(&session) == 0 {
                break;
            }
            session.press(Modifiers::NONE, Key::ArrowRight);
            session.rest();
        }
        assert_eq!(failed(&session), 0, "round {round}, seed {SEED}: bricks are lost");
        session.assert_is_as_rendered();
        let stats = &session.viewer().picture().expect("a picture").stats;
        assert!(stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes, "round {round}");
        // The test harness keeps undrawn frames.
        session.screenshot("ten-minutes");
        at_rest[number].push(counting::now());
    }
    assert!(met > 0, "no brick failed: the test tests nothing");
    let peak = counting::peak();
    assert!(peak <= BUDGET + WINDOW, "{peak} bytes at the peak; at rest {at_rest:?}");
    for of_file in at_rest {
        let growth = of_file[of_file.len() - 1].saturating_sub(of_file[0]);
        assert!(growth <= SLACK, "{growth} bytes more: {of_file:?}");
    }
}

#[test]
fn some_rounds_of_everything_lose_nothing() {
    use_it(|round| round >= ROUNDS);
}

#[test]
#[ignore = "takes ten minutes"]
fn ten_minutes_of_everything_lose_nothing() {
    let start = Instant::now();
    use_it(|round| round >= ROUNDS && start.elapsed() > Duration::from_secs(600));
}
