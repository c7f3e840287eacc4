//! Handles in the picture: dragging them changes the scene, and `render` draws the same picture.

use eframe::egui::{Key, Modifiers, PointerButton, Vec2};
use supervol_scene::clip::solids::Keep;

use crate::support;
use support::{ROOMY, Session};

fn with_handles() -> Session {
    let mut session = Session::of("sphere");
    session.rest();
    session.press(Modifiers::NONE, Key::B);
    session.frames(2);
    session
}

/// Drags the widget with this label.
fn drag(session: &mut Session, name: &str, by: Vec2) {
    let at = session.node(name).rect().center();
    session.drag(at, by, PointerButton::Primary);
    session.rest();
}

#[test]
fn faces_of_the_crop_box_are_dragged_in_the_picture() {
    let mut session = with_handles();
    let camera = session.viewer().scene().camera.clone();
    let plain = session.pixels();
    for name in ["Crop x, first", "Crop y, last", "Crop z, last"] {
        let middle = session.node("Picture").rect().center();
        let at = session.node(name).rect().center();
        // Half of the way to the middle of the picture.
        drag(&mut session, name, 0.5 * (middle - at));
    }
    let [low, high] = session.viewer().scene().clip.index_box.expect("a box");
    assert!(low[0] > 5.0 && high[1] < 58.0 && high[2] < 58.0, "{low:?} {high:?}");
    assert_eq!((low[1], low[2], high[0]), (-0.5, -0.5, 63.5), "the other faces stay");
    assert!(low.iter().chain(&high).all(|face| (face + 0.5).fract() == 0.0), "faces lie between voxels");
    assert_eq!(session.viewer().scene().camera, camera, "the handle was dragged, and not the picture");
    assert_ne!(session.pixels(), plain);
    session.assert_is_as_rendered();
    // Three drags are three edits.
    for _ in 0..3 {
        session.press(Modifiers::COMMAND, Key::Z);
    }
    session.rest();
    assert_eq!(session.viewer().scene().clip.index_box, None);
    assert_eq!(session.pixels(), plain);
}

#[test]
fn clip_planes_are_added_dragged_and_turned() {
    let mut session = with_handles();
    let plain = session.pixels();
    session.click("+ plane");
    session.rest();
    let first = session.viewer().scene().clip.planes[0];
    assert_ne!(session.pixels(), plain);
    session.assert_is_as_rendered();
    // Seen from another side, the plane moves along its normal.
    for _ in 0..6 {
        session.press(Modifiers::NONE, Key::ArrowRight);
    }
    session.rest();
    drag(&mut session, "Plane 1, move", Vec2::new(-40.0, 0.0));
    let moved = session.viewer().scene().clip.planes[0];
    assert!(moved.normal == first.normal && moved.offset != first.offset);
    drag(&mut session, "Plane 1, turn", Vec2::new(0.0, -50.0));
    let turned = session.viewer().scene().clip.planes[0];
    assert_ne!(turned.normal, moved.normal);
    session.assert_is_as_rendered();
    session.click("flip");
    session.rest();
    assert_eq!(session.viewer().scene().clip.planes[0].offset, -turned.offset);
    session.assert_is_as_rendered();
    session.click("Plane 1, remove");
    session.rest();
    assert!(session.viewer().scene().clip.planes.is_empty());
}

#[test]
fn solids_are_added_dragged_and_turned_inside_out() {
    let mut session = with_handles();
    for (i, button) in ["+ sphere", "+ box", "+ cylinder"].into_iter().enumerate() {
        session.click(button);
        session.rest();
        session.assert_is_as_rendered();
        drag(&mut session, &format!("Solid {}, move", i + 1), Vec2::new(60.0 - 60.0 * i as f32, 40.0));
    }
    let before = session.viewer().scene().clip.solids[0].sphere.expect("a sphere");
    drag(&mut session, "Solid 1, size", Vec2::new(25.0, 0.0));
    let after = session.viewer().scene().clip.solids[0].sphere.expect("a sphere");
    assert!(after.radius > before.radius && after.center == before.center);
    session.assert_is_as_rendered();
    session.click("Solid 1, keep inside");
    session.set("Solid 1, radius", 20.0);
    session.rest();
    let solid = &session.viewer().scene().clip.solids[0];
    assert_eq!((solid.keep, solid.sphere.expect("a sphere").radius), (Keep::Inside, 20.0));
    session.assert_is_as_rendered();
    session.click("Solid 2: box, remove");
    session.rest();
    assert_eq!(session.viewer().scene().clip.solids.len(), 2);
    session.assert_is_as_rendered();
}

#[test]
fn a_mesh_that_is_no_closed_one_is_refused_in_words() {
    let mut session = with_handles();
    let folder = session.folder.path().to_path_buf();
    let tetrahedron = "v 10 10 10\nv 60 10 10\nv 10 60 10\nv 10 10 60\n";
    std::fs::write(folder.join("closed.obj"), format!("{tetrahedron}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"))
        .expect("a file");
    std::fs::write(folder.join("open.obj"), format!("{tetrahedron}f 1 3 2\nf 1 2 4\nf 2 3 4\n")).expect("a file");
    let plain = session.pixels();
    for name in ["closed.obj", "open.obj"] {
        session.click("+ mesh ...");
        session.type_over("File to open", &folder.join(name).display().to_string());
        session.click("Open");
        if name == "closed.obj" {
            session.rest();
            assert_ne!(session.pixels(), plain);
            session.assert_is_as_rendered();
        }
    }
    session.until("it is refused", |s| {
        matches!(s.viewer().message(), Some(supervol_viewer::worker::Message::Failure(m)) if m.contains("open.obj"))
    });
    session.click("Solid 2: mesh, remove");
    session.rest();
    session.assert_is_as_rendered();
}

#[test]
fn handles_and_controls_fit() {
    for (name, scale) in [("cutting-1280x800", 1.0), ("cutting-scale2", 2.0)] {
        let mut session = Session::sized("vessels", ROOMY, scale);
        session.rest();
        session.press(Modifiers::NONE, Key::B);
        session.click("+ plane");
        session.click("+ sphere");
        session.rest();
        let picture = session.node("Picture").rect();
        for label in ["Solid 1, middle z", "Plane 1, normal z", "Solid 1, keep outside"] {
            let rect = session.node(label).rect();
            assert!(
                rect.right() <= picture.left(),
                "{name}: {label} at {rect:?} reaches into the picture at {picture:?}"
            );
        }
        session.node("Solid 1, radius").scroll_to_me();
        session.frames(8);
        session.rest();
        session.screenshot(name);
    }
}

#[test]
fn slices_are_dragged_in_the_picture() {
    let mut session = with_handles();
    session.click("+ z");
    session.click("+ oblique");
    session.rest();
    let before = session.viewer().scene().slices.clone();
    drag(&mut session, "Slice 1, move", Vec2::new(0.0, -60.0));
    let z = session.viewer().scene().slices[0].offset;
    assert!(z > before[0].offset && z.fract() == 0.0, "voxel by voxel, upwards: {z}");
    session.assert_is_as_rendered();
    drag(&mut session, "Slice 2, turn", Vec2::new(30.0, 20.0));
    assert_ne!(session.viewer().scene().slices[1].normal, before[1].normal);
    drag(&mut session, "Slice 2, move", Vec2::new(0.0, 25.0));
    session.assert_is_as_rendered();
    session.screenshot("slices-with-handles");
}
