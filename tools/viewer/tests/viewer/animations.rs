//! Animations from the window: the pictures equal those of `render`, and an unfinished folder is continued.

use eframe::egui::{Key, Modifiers};
use supervol_scene::camera_path::turntable;
use supervol_scene::image::stored::StoredPixels;
use supervol_scene::preset::view::upright;
use supervol_scene::scene::Scene;
use supervol_viewer::worker::Message;

use crate::support;
use support::{Session, headless, pixels};

fn done(session: &mut Session) -> String {
    session.until("it is done", |s| s.viewer().message().is_some() && s.viewer().is_idle());
    // The picture on the screen goes on afterwards, and the message may move with the lines of the status below it.
    session.rest();
    match session.viewer().message() {
        Some(Message::Done(text)) => text.clone(),
        other => panic!("{other:?}"),
    }
}

/// Pixels of a picture file as `render` writes it.
fn drawn(session: &Session, scene: &Scene) -> StoredPixels {
    let path = session.folder.path().join("expected.png");
    headless(session.viewer(), scene).save(&path).expect("a file");
    pixels(&path)
}

#[test]
fn a_turntable_is_what_render_draws_and_goes_on_where_it_was() {
    let mut session = Session::of("vessels");
    session.rest();
    session.press(Modifiers::NONE, Key::ArrowUp);
    session.rest();
    session.press(Modifiers::COMMAND, Key::M);
    session.set("Pictures of one turn", 3.0);
    session.set("Width of pictures", 120.0);
    session.set("Height of pictures", 90.0);
    session.click("Make the pictures");
    assert!(done(&mut session).contains("3 of them drawn now"));
    let folder = session.folder.path().join("vessels.frames");
    let mut scene = session.viewer().scene().clone();
    (scene.image.width, scene.image.height) = (120, 90);
    let opened = session.viewer().opened().expect("open").clone();
    let cameras = turntable(scene.camera.as_ref().expect("a camera"), upright(opened.facts()), 3);
    for (frame, camera) in cameras.into_iter().enumerate() {
        let scene = Scene { camera: Some(camera), ..scene.clone() };
        let written = pixels(&folder.join(format!("frame-{frame:05}.png")));
        assert!(written == drawn(&session, &scene), "picture {frame}");
    }
    session.assert_is_as_rendered();

    // One picture is deleted: repeating the request draws only that one.
    std::fs::remove_file(folder.join("frame-00001.png")).expect("a file");
    let again = |session: &mut Session, pictures: f64| {
        session.press(Modifiers::COMMAND, Key::M);
        session.set("Pictures of one turn", pictures);
        session.set("Width of pictures", 120.0);
        session.set("Height of pictures", 90.0);
        session.click("Make the pictures");
    };
    session.click("OK");
    again(&mut session, 3.0);
    let said = done(&mut session);
    assert!(said.contains("1 of them drawn now"), "{said}");
    // Float pictures are added beside the others.
    session.click("OK");
    session.press(Modifiers::COMMAND, Key::M);
    session.click("EXR");
    session.screenshot("animation-exr");
    session.set("Pictures of one turn", 3.0);
    session.set("Width of pictures", 120.0);
    session.set("Height of pictures", 90.0);
    session.click("Make the pictures");
    assert!(done(&mut session).contains("3 of them drawn now"));
    let path = session.folder.path().join("expected.exr");
    let mut first = session.viewer().scene().clone();
    (first.image.width, first.image.height) = (120, 90);
    headless(session.viewer(), &first).save(&path).expect("a file");
    let [written, expected] = [folder.join("frame-00000.exr"), path].map(|p| pixels(&p));
    assert!(written == expected, "the first picture, as floats");
    // A different animation in the same folder is refused.
    session.click("OK");
    again(&mut session, 4.0);
    session.until(
        "it is refused",
        |s| matches!(s.viewer().message(), Some(Message::Failure(m)) if m.contains("something else")),
    );
    assert!(!folder.join("frame-00003.png").exists());
}

#[test]
fn views_are_taken_and_gone_through() {
    let mut session = Session::of("vessels");
    session.rest();
    session.press(Modifiers::COMMAND, Key::M);
    session.frames(6);
    session.click("Key frames");
    session.screenshot("animation");
    session.click("Take this view");
    let first = session.viewer().scene().camera.clone();
    for _ in 0..3 {
        session.press(Modifiers::NONE, Key::ArrowRight);
    }
    session.rest();
    session.click("Take this view");
    let last = session.viewer().scene().camera.clone();
    session.set("View 2, picture", 2.0);
    session.set("Width of pictures", 80.0);
    session.set("Height of pictures", 60.0);
    session.screenshot("animation-keys");
    session.click("Make the pictures");
    done(&mut session);
    let folder = session.folder.path().join("vessels.frames");
    for (frame, camera) in [(0, first), (2, last)] {
        let mut scene = Scene { camera, ..session.viewer().scene().clone() };
        (scene.image.width, scene.image.height) = (80, 60);
        let written = pixels(&folder.join(format!("frame-{frame:05}.png")));
        assert!(written == drawn(&session, &scene), "picture {frame}");
    }
    assert!(folder.join("frame-00001.png").exists() && !folder.join("frame-00003.png").exists());
}

#[test]
fn an_animation_can_be_given_up() {
    let mut session = Session::of("vessels");
    session.rest();
    session.press(Modifiers::COMMAND, Key::M);
    session.set("Pictures of one turn", 5000.0);
    session.click("Make the pictures");
    let folder = session.folder.path().join("vessels.frames");
    session.until("it has begun", |_| folder.join("frame-00000.png").exists());
    session.click("Stop");
    assert!(done(&mut session).contains("cancelled"));
    let pictures = std::fs::read_dir(&folder).expect("a folder").flatten().count();
    assert!(pictures < 2000, "{pictures} files");
    let left = std::fs::read_dir(&folder)
        .expect("a folder")
        .flatten()
        .any(|e| e.file_name().to_string_lossy().starts_with('.'));
    assert!(!left, "nothing half-written is left");
    session.assert_is_as_rendered();
}
