//! Opacity by the gradient in the editor: its switch, its histogram, its handles and its numbers.

use eframe::egui::{Key, Modifiers, PointerButton, Vec2};
use egui_kittest::kittest::Queryable;
use supervol_preprocess::gradients::Gradients;
use supervol_scene::scene::{Mode, Scene};
use supervol_viewer::worker::{Message, Settings};

use crate::support::{Fault, ROOMY, SMALL, Session, container_in_bricks, npy_of};

const SWITCH: &str = "Opacity by the gradient";
const FROM: &str = "Gradient where opacity begins";
const TO: &str = "Gradient of full opacity";

/// A volume in mode `dvr`, in the smallest window, because pictures with the factor take long.
fn session(scene: Scene) -> Session {
    let mut session = Session::small_in_bricks("vessels", [32, 32], scene, Settings::default());
    session.rest();
    session
}

fn volume() -> Scene {
    Scene { mode: Some(Mode::Dvr), ..Scene::default() }
}

fn ramp(session: &Session) -> Option<[f64; 2]> {
    session.viewer().scene().gradient_opacity
}

fn drag_handle(session: &mut Session, name: &str, points: f32) {
    let name = format!("{name}, handle");
    session.node(&name).scroll_to_me();
    session.frames(10);
    let from = session.node(&name).rect().center();
    session.drag(from, Vec2::new(points, 0.0), PointerButton::Primary);
}

#[test]
fn the_switch_sets_a_ramp_that_handles_and_numbers_move_and_undo_restores() {
    let mut session = session(volume());
    let plain = session.viewer().scene().clone();
    let container = session.viewer().opened().expect("a volume").container().clone();
    let usual = Gradients::of(&container, &|_, _| ()).expect("bricks").usual_ramp().expect("gradients");
    session.click(SWITCH);
    session.rest();
    assert_eq!(ramp(&session), Some(usual), "from the 50th to the 95th percentile");
    session.assert_is_as_rendered();

    // The handle of the first end moves to the right, and the second one stays.
    drag_handle(&mut session, FROM, 6.0);
    let dragged = ramp(&session).expect("a ramp");
    assert!(dragged[0] > usual[0] && dragged[1] == usual[1], "{usual:?} became {dragged:?}");
    session.rest();
    session.assert_is_as_rendered();
    drag_handle(&mut session, TO, 20.0);
    let both = ramp(&session).expect("a ramp");
    assert!(both[0] == dragged[0] && both[1] > dragged[1], "{dragged:?} became {both:?}");
    session.set(TO, 0.5);
    let close = ramp(&session).expect("a ramp");
    assert!(close[1] > close[0] && close[1] < 1.01 * close[0].max(0.5), "{close:?}");
    session.set(FROM, 0.25);
    session.set(TO, 8.0);
    assert_eq!(ramp(&session), Some([0.25, 8.0]));

    for expected in [Some([0.25, close[1]]), Some(close), Some(both), Some(dragged), Some(usual), None] {
        session.press(Modifiers::COMMAND, Key::Z);
        assert_eq!(ramp(&session), expected);
    }
    assert_eq!(*session.viewer().scene(), plain);
    session.press(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    assert_eq!(ramp(&session), Some(usual));
}

#[test]
fn the_switch_removes_the_key_and_modes_and_the_switch_keep_the_ramp() {
    let mut session = session(Scene { gradient_opacity: Some([2.0, 20.0]), ..volume() });
    assert!(session.viewer().gradient_histogram().is_some(), "a scene that has it shows the histogram");
    session.click("Max");
    session.rest();
    assert_eq!(ramp(&session), None, "projections have no opacity");
    assert!(session.harness.query_by_label(SWITCH).is_none());
    session.click("Volume");
    session.rest();
    assert_eq!(ramp(&session), Some([2.0, 20.0]));
    session.click(SWITCH);
    session.rest();
    assert_eq!(ramp(&session), None);
    let text = serde_json::to_string(session.viewer().scene()).expect("a scene");
    assert!(!text.contains("gradient_opacity"), "{text}");
    assert!(session.harness.query_by_label(FROM).is_none());
    session.assert_is_as_rendered();
    session.click(SWITCH);
    assert_eq!(ramp(&session), Some([2.0, 20.0]));
}

/// A ramp of 6 per voxel: central differences are 6, and 3 at its ends, where voxels are repeated.
#[test]
fn the_histogram_counts_the_gradients_of_a_ramp() {
    let mut session = Session::of_file(|folder| npy_of(folder, "ramp", [20, 30, 40], |i| (6 * (i % 40)) as u8));
    session.click("Volume");
    session.rest();
    assert_eq!(session.viewer().gradient_histogram(), None, "nobody has asked for it");
    session.click(SWITCH);
    session.rest();
    let histogram = session.viewer().gradient_histogram().expect("it is counted");
    assert!((histogram.end - 6.0).abs() < 6.0 / 1024.0, "{}", histogram.end);
    let filled: Vec<(usize, u64)> = histogram.counts.iter().copied().enumerate().filter(|(_, n)| *n > 0).collect();
    let bars = histogram.counts.len();
    let [(half, ends), (last, inside)] = filled[..] else { panic!("{filled:?}") };
    assert_eq!((ends, inside), (2 * 20 * 30, 38 * 20 * 30));
    assert!(half.abs_diff(bars / 2) <= 1 && last == bars - 1, "{filled:?}");
    // All lengths are alike: the ramp begins at 0.
    let [from, to] = ramp(&session).expect("a ramp");
    assert!(from == 0.0 && (to - 6.0).abs() < 6.0 / 1024.0, "{from}, {to}");
}

#[test]
fn a_volume_without_gradients_or_with_an_unreadable_brick_says_so() {
    let mut session = Session::of_file(|folder| npy_of(folder, "even", [20, 30, 40], |_| 7));
    session.click("Volume");
    session.click(SWITCH);
    session.until(
        "it is refused",
        |s| matches!(s.viewer().message(), Some(Message::Failure(m)) if m.contains("no gradients")),
    );
    assert_eq!(ramp(&session), None);

    let path = container_in_bricks(session.folder.path(), "vessels", [64, 32]);
    session.harness.state_mut().open(&path);
    session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == path));
    session.rest();
    session.click("Volume");
    session.rest();
    let container = session.viewer().opened().expect("a volume").container().clone();
    let fault = Fault::new(&path, &container, 1);
    session.click(SWITCH);
    session.until(
        "it is refused",
        |s| matches!(s.viewer().message(), Some(Message::Failure(m)) if m.contains("vessels.svol") && m.contains("verify")),
    );
    assert_eq!((ramp(&session), session.viewer().gradient_histogram()), (None, None));
    // It is tried again, once the brick can be read.
    fault.mend();
    session.click(SWITCH);
    session.until("it is counted", |s| s.viewer().gradient_histogram().is_some());
    assert!(ramp(&session).is_some());
}

#[test]
fn the_controls_of_the_gradient_fit() {
    for (name, size) in [("gradient-1280x800", ROOMY), ("gradient-small", SMALL)] {
        let settings = Settings { max_error: 8.0 / 255.0, ..Settings::default() };
        let mut session = Session::in_window("vessels", (size, 1.0), settings);
        session.rest();
        session.click("Volume");
        session.click(SWITCH);
        session.rest();
        let numbers = session.node(TO).rect();
        let picture = session.node("Picture").rect().right();
        assert!(numbers.left() >= picture && numbers.right() <= size[0], "{name}: {numbers:?}");
        session.node(TO).scroll_to_me();
        session.frames(8);
        session.rest();
        session.screenshot(name);
    }
}
