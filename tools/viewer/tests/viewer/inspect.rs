//! Diagnostic displays: bricks, errors, failures. None of them is part of an exported picture.

use eframe::egui::{Key, Modifiers};
use supervol::{Backend, Options, errors_in_colors, work_in_colors};
use supervol_preprocess::Existing;
use supervol_scene::preset::slices::plane_across;
use supervol_scene::scene::Scene;
use supervol_scene::scene::section::face_on;
use supervol_scene::slices::{Interpolation, SliceSpec};
use supervol_viewer::worker::{Export, Message, Settings};

use crate::support;
use support::{Fault, Session};

fn session() -> Session {
    let settings = Settings { threads: Some(2), ..Settings::default() };
    Session::in_bricks("marschner-lobb", [64, 16], Scene::default(), settings)
}

#[test]
fn bricks_are_outlined_by_level_and_the_picture_stays() {
    let mut session = session();
    session.rest();
    let plain = session.pixels();
    assert!(session.viewer().picture().expect("a picture").marks.is_empty());
    session.click("bricks");
    session.rest();
    let picture = session.viewer().picture().expect("a picture");
    let there: u64 = picture.stats.bricks_by_level.iter().map(|level| level.resident).sum();
    assert_eq!(picture.marks.len() as u64, there, "every brick in memory");
    assert!(there > 8 && picture.marks.iter().all(|mark| !mark.is_failed));
    for mark in &picture.marks {
        let edge = mark.corners[1][0] - mark.corners[0][0];
        assert!(edge > 0.0 && edge <= 16.0 * f64::from(1 << mark.level), "{mark:?}");
    }
    assert_eq!(session.pixels(), plain);
    session.screenshot("inspect-bricks");
    session.assert_is_as_rendered();
}

#[test]
fn errors_are_those_that_render_writes() {
    let mut session = session();
    session.rest();
    session.set("Error target", 4.0);
    session.click("errors");
    session.rest();
    let viewer = session.viewer();
    let picture = support::headless(viewer, viewer.scene());
    let errors = picture.error_map().expect("errors are stated").clone();
    let expected = errors_in_colors(errors).to_rgb8(picture.resolved().background);
    let shown: Vec<u8> = session.pixels().iter().flat_map(|p| [p.r(), p.g(), p.b()]).collect();
    assert!(shown == expected, "another map");
    session.screenshot("inspect-errors");
    session.click("nothing");
    session.rest();
    session.assert_is_as_rendered();
}

#[test]
fn work_is_what_render_writes() {
    let mut session = session();
    session.rest();
    let plain = session.pixels();
    session.click("work");
    session.rest();
    let viewer = session.viewer();
    let options = Options {
        backend: Backend::Cpu,
        max_error: viewer.settings().max_error,
        count_work: true,
        ..Options::default()
    };
    let volume = &viewer.opened().expect("open").volume;
    let picture = volume.draw(viewer.scene(), &options).expect("a picture");
    let work = picture.work_map().expect("work is counted").clone();
    let expected = work_in_colors(work).to_rgb8(picture.resolved().background);
    let shown: Vec<u8> = session.pixels().iter().flat_map(|p| [p.r(), p.g(), p.b()]).collect();
    assert!(shown == expected, "another map");
    session.screenshot("inspect-work");
    session.click("nothing");
    session.rest();
    assert_eq!(session.pixels(), plain);
}

#[test]
fn bricks_that_fail_are_marked_until_they_can_be_read() {
    let mut session = session();
    session.rest();
    let other = support::container_in_bricks(session.folder.path(), "ramp", [64, 16]);
    let container = supervol_format::Container::open(&other).expect("a container");
    let fault = Fault::new(&other, &container, 5);
    session.harness.state_mut().open(&other);
    session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == other));
    session.click("Mean");
    session.rest();
    let picture = session.viewer().picture().expect("a picture");
    assert_eq!(picture.stats.bricks_failed, 1, "{:?}", picture.stats.failures);
    let failed: Vec<_> = picture.marks.iter().filter(|mark| mark.is_failed).collect();
    assert!(failed.len() == 1 && failed[0].level == 0, "{failed:?}");
    session.screenshot("inspect-failed");
    fault.mend();
    // The brick is retried after some time and succeeds.
    for _ in 0..40 {
        session.press(Modifiers::NONE, Key::ArrowRight);
        session.rest();
        if session.viewer().picture().is_some_and(|picture| picture.stats.bricks_failed == 0) {
            break;
        }
    }
    assert!(session.viewer().picture().expect("a picture").marks.is_empty());
    session.assert_is_as_rendered();
}

/// Sections are drawn by the CPU. Switching back to the CPU gives the same picture, bit for bit.
#[test]
fn pictures_may_be_drawn_by_a_graphics_device() {
    let mut session = session();
    session.rest();
    let plain = session.pixels();
    session.click("GPU");
    session.rest();
    let picture = session.viewer().picture().expect("a picture");
    assert_eq!((picture.stats.backend, picture.is_converged), ("gpu", true));
    let drawn = session.pixels();
    let largest = plain.iter().zip(&drawn).flat_map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c]))).max();
    assert!(largest <= Some(1), "{largest:?} of 255 from the processor's");
    session.press(Modifiers::NONE, Key::ArrowRight);
    session.rest();
    assert!(session.pixels() != drawn);
    assert_eq!(session.viewer().picture().expect("a picture").stats.backend, "gpu");
    session.press(Modifiers::COMMAND | Modifiers::SHIFT, Key::C);
    assert!(matches!(session.viewer().message(), Some(Message::Done(line)) if line.contains("--backend gpu")));
    let volume = session.viewer().scene().clone();
    let opened = session.viewer().opened().expect("open").clone();
    let (normal, offset) = plane_across(opened.facts(), 2, 30.0);
    let interpolation = Interpolation::Linear;
    let slice =
        SliceSpec { normal, offset, opacity: 1.0, interpolation, filter: None, colors: Vec::new(), labels: false };
    let open = Scene { image: volume.image.clone(), ..Scene::default() };
    let section =
        face_on(&open, opened.facts(), slice, 1.0).expect("there is a section").complete(opened.facts(), None);
    // A section is exported while a GPU draws the picture.
    let path = session.folder.path().join("section.png");
    session.export(Export { scene: section.clone(), path: path.clone(), existing: Existing::Keep });
    session.until("the section is written", |s| path.exists() && s.viewer().is_idle());
    for (scene, backend) in [(section, "cpu"), (volume, "gpu")] {
        session.edit(|edited| *edited = scene);
        session.rest();
        assert_eq!(session.viewer().picture().expect("a picture").stats.backend, backend);
    }
    session.click("CPU");
    session.rest();
    session.assert_is_as_rendered();
}
