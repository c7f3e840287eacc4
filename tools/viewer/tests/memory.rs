//! Memory test: a long session stays within its budget, and nothing leaks from volume to volume. An allocator counts
//! the bytes, because the system's numbers of a process depend on other activity.

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "tests use small numbers"
)]

mod support;

use eframe::egui::{Key, Modifiers};
use supervol_tests::counting::{self, Counting};

use support::Session;

#[global_allocator]
static COUNTING: Counting = Counting;

const BUDGET: usize = 64 << 20;
/// Pictures in transfer and on the screen, the window, its fonts.
const WINDOW: usize = 48 << 20;
/// Permitted growth over several volumes: history, persistent settings, tables.
const SLACK: usize = 2 << 20;
const ROUNDS: u32 = 10;

/// Views, edits, modes and volumes in turn, with a budget for few bricks. Memory stays within it, nothing leaks, no
/// brick fails, and the final picture is right.
#[test]
fn a_long_session_stays_within_its_budget() {
    let mut session = Session::with_budget("vessels", BUDGET as u64);
    session.rest();
    let other = support::container(session.folder.path(), "sphere", 48);
    let first = session.folder.path().join("vessels.svol");
    let mut at_rest = Vec::new();
    for round in 0..ROUNDS {
        let (file, name) = if round % 2 == 0 { (&other, "sphere.svol") } else { (&first, "vessels.svol") };
        session.harness.state_mut().open(file);
        session.until("it is open", |s| s.viewer().opened().is_some_and(|o| o.source.ends_with(name)));
        if round == 2 {
            counting::forget_peak();
        }
        for key in [Key::ArrowRight, Key::Plus, Key::P, Key::Num5, Key::ArrowUp, Key::Minus, Key::Num0] {
            session.press(Modifiers::NONE, key);
            session.frames(3);
        }
        session.edit(|scene| scene.image.background = [0.05 * f64::from(round); 3]);
        session.click("Max");
        session.click("Volume");
        session.rest();
        let stats = session.viewer().picture().expect("a picture").stats.clone();
        assert!(
            stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes && stats.host_budget_bytes == BUDGET as u64
        );
        assert_eq!(stats.bricks_failed, 0);
        // The test harness keeps undrawn frames.
        session.screenshot("session");
        at_rest.push(counting::now());
    }
    let peak = counting::peak();
    assert!(peak <= BUDGET + WINDOW, "{peak} bytes at the peak; at rest {at_rest:?}");
    // The same volume after eight further openings.
    let growth = at_rest[9].saturating_sub(at_rest[1]);
    assert!(growth <= SLACK, "{growth} bytes more after eight volumes: {at_rest:?}");
    session.assert_is_as_rendered();
}
