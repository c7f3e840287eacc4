//! Looking ahead: bricks of the next picture are read while no picture is in progress. A new request has priority.

use eframe::egui::{Key, Modifiers};
use supervol_scene::scene::{CameraSpec, Mode, Scene};
use supervol_viewer::worker::Settings;

use crate::support;
use support::Session;

/// Voxels along an edge of the volume and of its bricks: many bricks, of which a view from inside needs few.
const EDGE: u64 = 128;
const BRICK: u32 = 16;
/// Number of turns with the arrow key.
const TURNS: usize = 8;

/// A camera inside the volume, so that a turn needs new bricks.
fn from_within() -> Scene {
    let camera = CameraSpec {
        eye: [40.0, 64.0, 60.0],
        target: [52.0, 70.0, 63.0],
        up: [0.0, 0.0, 1.0],
        fov_y: Some(30.0),
        height: None,
    };
    Scene { camera: Some(camera), mode: Some(Mode::Mean), ..Scene::default() }
}

fn session() -> Session {
    Session::small_in_bricks("marschner-lobb", [EDGE, u64::from(BRICK)], from_within(), Settings::default())
}

#[test]
fn a_view_that_goes_on_turning_finds_its_bricks_in_memory() {
    let mut session = session();
    session.rest();
    assert_eq!(session.viewer().looked_ahead().map_or(0, |ahead| ahead.page_ins), 0, "the camera has not moved");
    let (mut ahead_in_all, mut of_pictures) = (0, 0);
    for turn in 0..TURNS {
        session.press(Modifiers::NONE, Key::ArrowRight);
        session.rest();
        if turn > 0 {
            of_pictures += session.viewer().picture().expect("a picture").stats.streaming.page_ins;
        }
        session.until("all that the next picture wants is there", |session| {
            session.viewer().looked_ahead().is_some_and(|ahead| ahead.is_complete)
        });
        ahead_in_all += session.viewer().looked_ahead().map_or(0, |ahead| ahead.page_ins);
        session.assert_is_as_rendered();
    }
    assert!(ahead_in_all > 10, "{ahead_in_all} bricks were read ahead: the test turns too little");
    assert!(of_pictures * 4 <= ahead_in_all, "pictures read {of_pictures} bricks, {ahead_in_all} were read ahead");
}

/// Requests at different times: looking ahead never delays one, and no picture is lost.
#[test]
fn a_new_request_interrupts_looking_ahead() {
    let mut session = session();
    session.rest();
    for turn in 0..3 * TURNS {
        let key = if turn % 5 == 0 { Key::ArrowUp } else { Key::ArrowRight };
        session.press(Modifiers::NONE, key);
        session.rest();
        // From no frame to as many as looking ahead takes.
        session.frames(turn % 7);
    }
    session.assert_is_as_rendered();
    assert!(session.viewer().message().is_none(), "{:?}", session.viewer().message());
    let stats = &session.viewer().picture().expect("a picture").stats;
    assert!(stats.host_cache_peak_bytes <= stats.host_cache_budget_bytes);
}
