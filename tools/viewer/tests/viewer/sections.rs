//! Sections in panels: they equal the pictures of `render`, one cursor links them, and values under the mouse are those
//! of the container.

use std::path::Path;

use eframe::egui::{
    Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, Rect, TouchPhase, Vec2,
};
use supervol::Picked;
use supervol_export::extract::{Extraction, extract};
use supervol_format::{Lod, VoxelBox, VoxelType};
use supervol_preprocess::Existing;
use supervol_scene::scene::{CameraSpec, IsoSpec, Mode, Scene};
use supervol_scene::slices::Interpolation;
use supervol_viewer::sections::{Layout, describe_point, place, short};

use crate::support;
use support::{ROOMY, Session};

/// Names of the panels of synthetic volumes, by axis.
const NAMES: [&str; 3] = ["Section x", "Section y", "Section z"];

fn at_rest_with_three() -> Session {
    let mut session = Session::of("sphere");
    session.rest();
    session.press(Modifiers::NONE, Key::T);
    session.rest();
    session
}

fn wheel(session: &mut Session, at: Pos2, notches: f32, modifiers: Modifiers) {
    session.harness.hover_at(at);
    session.harness.event(Event::ModifiersChanged(modifiers));
    session.harness.event(Event::MouseWheel {
        unit: MouseWheelUnit::Line,
        delta: Vec2::new(0.0, notches),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers,
    });
    session.frames(12);
    session.harness.event(Event::ModifiersChanged(Modifiers::NONE));
    session.rest();
}

#[test]
fn three_panels_and_the_picture_are_what_render_draws() {
    let mut session = at_rest_with_three();
    session.harness.set_size(ROOMY.into());
    session.rest();
    assert_eq!(session.viewer().sections().cursor(), [32.0; 3]);
    for axis in 0..3 {
        assert_eq!(
            session.viewer().sections().panel(axis).expect("a panel").scene().expect("a scene").mode,
            Some(Mode::Slice)
        );
        session.assert_section_is_as_rendered(axis);
    }
    session.assert_is_as_rendered();
    // The panels do not overlap and fill the room.
    let rects: Vec<Rect> = NAMES.iter().chain(&["Picture"]).map(|name| session.node(name).rect()).collect();
    for (i, a) in rects.iter().enumerate() {
        assert!(a.width() > 200.0 && a.height() > 200.0, "{a:?}");
        assert!(rects[i + 1..].iter().all(|b| !a.intersects(*b)), "{rects:?}");
    }
    session.click("Panel y");
    session.rest();
    assert_eq!(session.viewer().sections().layout(), Layout::One(1));
    session.assert_section_is_as_rendered(1);
    session.assert_is_as_rendered();
    session.click("Picture alone");
    session.rest();
    assert!((0..3).all(|axis| session.viewer().sections().panel(axis).is_none()));
    session.assert_is_as_rendered();
}

#[test]
fn the_cursor_links_the_panels() {
    let mut session = at_rest_with_three();
    let camera = session.viewer().scene().camera.clone();
    let panel = session.node(NAMES[2]).rect();
    // A drag in the section across z moves the cursor along x and y, and with it the other two sections.
    session.drag(panel.center(), Vec2::new(40.0, 30.0), PointerButton::Primary);
    session.rest();
    let [x, y, z] = session.viewer().sections().cursor();
    assert!(x != 32.0 && y != 32.0 && z == 32.0, "{:?}", [x, y, z]);
    let opened = session.viewer().opened().expect("open").clone();
    let of = |axis: usize, session: &Session| {
        let scene = session.viewer().sections().panel(axis).expect("a panel").scene().expect("a scene").clone();
        scene.slices[0].offset
    };
    assert_eq!((of(0, &session), of(1, &session), of(2, &session)), (x, y, z), "voxels of 1 at the origin");
    // The cross lies at the end of the drag, to half a voxel.
    let pixels_a_voxel = f64::from(panel.width().min(panel.height())) / 64.0;
    let place = session.viewer().sections().place_of(2, [x, y, z], opened.facts()).expect("on the panel");
    let shown = panel.min + Vec2::new(0.5 * (1.0 + place[0] as f32), 0.5 * (1.0 - place[1] as f32)) * panel.size();
    let expected = panel.center() + Vec2::new(40.0, 30.0);
    assert!(f64::from((shown - expected).length()) < pixels_a_voxel, "{shown:?} {expected:?}");
    (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));

    let over_y = session.node(NAMES[1]).rect().center();
    wheel(&mut session, over_y, 5.0, Modifiers::NONE);
    assert_eq!(session.viewer().sections().cursor(), [x, y + 5.0, z]);
    wheel(&mut session, over_y, -500.0, Modifiers::NONE);
    assert_eq!(session.viewer().sections().cursor(), [x, 0.0, z], "no farther than the volume");
    session.set("Cursor, z", 11.0);
    session.rest();
    assert_eq!(session.viewer().sections().cursor(), [x, 0.0, 11.0]);
    (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
    assert_eq!(session.viewer().scene().camera, camera, "the camera of the picture is another one");
}

#[test]
fn sections_are_moved_and_brought_nearer_one_by_one() {
    let mut session = at_rest_with_three();
    let camera = |session: &Session, axis: usize| {
        let scene = session.viewer().sections().panel(axis).expect("a panel").scene().expect("a scene");
        scene.camera.clone().expect("a camera")
    };
    let before = [0, 1, 2].map(|axis| camera(&session, axis));
    let over_z = session.node(NAMES[2]).rect().center();
    wheel(&mut session, over_z, 3.0, Modifiers::CTRL);
    assert!(camera(&session, 2).height < before[2].height);
    session.drag(over_z, Vec2::new(20.0, 0.0), PointerButton::Secondary);
    session.rest();
    assert!(camera(&session, 2).target[0] != before[2].target[0]);
    assert_eq!((camera(&session, 0), camera(&session, 1)), (before[0].clone(), before[1].clone()));
    session.assert_section_is_as_rendered(2);
    // The next section shows the same part.
    let nearer = camera(&session, 2);
    wheel(&mut session, over_z, 2.0, Modifiers::NONE);
    assert_eq!(camera(&session, 2).height, nearer.height);
    assert_eq!(camera(&session, 2).target[2], nearer.target[2] + 2.0);
    session.assert_section_is_as_rendered(2);
}

/// The value of a voxel, from the container itself.
fn stored(session: &Session, voxel: [u64; 3]) -> f64 {
    let path = session.folder.path().join("voxel.npy");
    let what = Extraction {
        lod: Lod::FINEST,
        voxels: Some(VoxelBox { start: voxel, end: voxel.map(|v| v + 1) }),
        existing: Existing::Replace,
        memory_bytes: 64 << 20,
    };
    let container = session.viewer().opened().expect("open").container();
    let (_, voxel_type) = extract(container, &path, &what).expect("it is extracted");
    let bytes = std::fs::read(&path).expect("a file");
    let last = &bytes[bytes.len() - voxel_type.bytes()..];
    match voxel_type {
        VoxelType::U8 => last[0].into(),
        VoxelType::I16 => i16::from_le_bytes([last[0], last[1]]).into(),
        VoxelType::U16 => u16::from_le_bytes([last[0], last[1]]).into(),
        VoxelType::F32 => f32::from_le_bytes([last[0], last[1], last[2], last[3]]).into(),
        other => panic!("synthetic volumes are no {other:?}"),
    }
}

#[test]
fn the_point_under_the_mouse_is_told_with_its_value() {
    let mut session = at_rest_with_three();
    let panel = session.node(NAMES[2]).rect();
    session.harness.hover_at(panel.center() + Vec2::new(31.0, -17.0));
    session.until("it is known", |s| s.viewer().sections().probed().is_some_and(|p| p.probe.panel == Some(2)));
    let picked =
        session.viewer().sections().probed().expect("an answer").found.clone().expect("no error").expect("a point");
    assert_eq!(picked.index[2], 32.0);
    assert!(picked.index[0] > 33.0 && picked.index[1] != 32.0, "{picked:?}");
    // The reported position is the one under the mouse, to one pixel.
    let opened = session.viewer().opened().expect("open").clone();
    let place = session.viewer().sections().place_of(2, picked.index, opened.facts()).expect("on the panel");
    let shown = panel.min + Vec2::new(0.5 * (1.0 + place[0] as f32), 0.5 * (1.0 - place[1] as f32)) * panel.size();
    assert!((shown - (panel.center() + Vec2::new(31.0, -17.0))).length() < 1.5, "{shown:?}");
    // With `nearest`, values are those of the container.
    session.click("Panels, interpolation");
    session.click("nearest");
    session.rest();
    session.harness.hover_at(panel.center() + Vec2::new(30.0, -17.0));
    session.frames(2);
    session.until("it is known", |s| s.viewer().sections().probed().is_some_and(|p| p.probe.panel == Some(2)));
    let picked =
        session.viewer().sections().probed().expect("an answer").found.clone().expect("no error").expect("a point");
    let voxel = picked.index.map(|i| (i + 0.5).floor() as u64);
    assert!((picked.value - stored(&session, voxel)).abs() < 1e-6, "{picked:?}");
    session.assert_section_is_as_rendered(2);

    // The same holds in the converged picture; a click moves the cursor there.
    let picture = session.node("Picture").rect();
    session.harness.hover_at(picture.center());
    session.frames(2);
    session.until("it is known", |s| s.viewer().sections().probed().is_some_and(|p| p.probe.panel.is_none()));
    let found = session.viewer().sections().probed().expect("an answer").found.clone();
    let picked = found.expect("no error").expect("the sphere is in the middle");
    let pressed = |pressed| Event::PointerButton {
        pos: picture.center(),
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    session.harness.event(pressed(true));
    session.frames(1);
    session.harness.event(pressed(false));
    session.until("the cursor is there", |s| s.viewer().sections().cursor() == picked.index.map(f64::round));
    session.rest();
    (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
}

/// The point under a resting mouse, when it is known.
fn point_at_rest(session: &mut Session) -> Picked {
    session.rest();
    session.until("it is known", |s| s.viewer().sections().probed().is_some());
    session.viewer().sections().probed().expect("an answer").found.clone().expect("no error").expect("a point")
}

#[test]
fn the_value_follows_the_section_under_a_resting_mouse() {
    let mut session = Session::of("ramp");
    session.rest();
    session.press(Modifiers::NONE, Key::T);
    session.rest();
    // The ramp rises along x, so the panel across x shows one value everywhere.
    let over = session.node(NAMES[0]).rect().center() + Vec2::new(20.0, 9.0);
    session.harness.hover_at(over);
    let first = point_at_rest(&mut session);
    assert_eq!(first.index[0], 32.0);
    let check = |session: &mut Session, at: f64, what: &str| {
        let picked = point_at_rest(session);
        assert_eq!((picked.index[0], session.viewer().sections().cursor()[0]), (at, at), "{what}");
        let voxel = [at, 20.0, 20.0].map(|i| i as u64);
        assert!((picked.value - stored(session, voxel)).abs() < 1e-6, "{what}: {picked:?}");
        assert!(picked.value != first.value, "{what}: {picked:?}");
    };
    wheel(&mut session, over, 5.0, Modifiers::NONE);
    check(&mut session, 37.0, "wheel");
    session.set("Cursor, x", 11.0);
    check(&mut session, 11.0, "slider");
    // No frame tells the value of another section than the requested one.
    for cursor in (12..40).map(f64::from) {
        session.set("Cursor, x", cursor);
        let probed = session.viewer().sections().probed();
        let told = probed.map(|probed| probed.found.clone().expect("no error").expect("a point").index[0]);
        assert!(told.is_none_or(|at| at == cursor), "{told:?} at {cursor}");
    }
    // The picture: another surface, another clip plane.
    session.press(Modifiers::NONE, Key::T);
    session.rest();
    let surface = |value: f64| {
        move |scene: &mut Scene| {
            scene.mode = Some(Mode::Iso);
            scene.iso = vec![IsoSpec { value, color: [1.0; 3], alpha: 1.0 }];
        }
    };
    session.edit(surface(first.value));
    session.harness.hover_at(session.node("Picture").rect().center());
    let before = point_at_rest(&mut session);
    assert!((before.value - first.value).abs() < 1e-6, "{before:?}");
    session.edit(surface(0.9 * first.value));
    let after = point_at_rest(&mut session);
    assert!((after.value - 0.9 * first.value).abs() < 1e-6 && after.index[0] < before.index[0], "{after:?}");
    let camera = session.viewer().scene().camera.clone().expect("a camera");
    session.edit(|scene| scene.camera = Some(CameraSpec { eye: camera.eye.map(|x| 1.1 * x), ..camera }));
    let moved = point_at_rest(&mut session);
    assert!(moved.index != after.index, "{moved:?}");
}

#[test]
fn panels_have_a_look_of_their_own_and_are_shown_in_the_volume() {
    let mut session = at_rest_with_three();
    for (box_, choice) in
        [("Panels, interpolation", "cubic"), ("Panels, colours", "viridis"), ("Panels, filter", "sobel")]
    {
        session.click(box_);
        session.frames(3);
        session.click(choice);
        session.rest();
        (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
    }
    session.click("Volume");
    session.click("Show them in the volume");
    session.rest();
    let slices = session.viewer().scene().slices.clone();
    assert_eq!(slices.len(), 3);
    assert!(slices.iter().all(|slice| slice.interpolation == Interpolation::Cubic && slice.filter.is_some()));
    session.assert_is_as_rendered();
    // Slices at the cursor move with it; a second click adds nothing.
    session.set("Cursor, x", 20.0);
    session.click("Show them in the volume");
    session.rest();
    assert_eq!(
        session.viewer().scene().slices.iter().map(|slice| slice.offset).collect::<Vec<_>>(),
        [20.0, 32.0, 32.0]
    );
    session.assert_is_as_rendered();
}

#[test]
fn windows_slabs_and_gamma_of_panels_are_what_render_draws() {
    let mut session = at_rest_with_three();
    let window = |session: &Session| {
        let opened = session.viewer().opened().expect("open").clone();
        session.viewer().sections().window(opened.facts()).expect("a window")
    };
    let cursor = session.viewer().sections().cursor();
    let [low, high] = window(&session);
    let over = session.node(NAMES[2]).rect().center();
    // With Ctrl, to the right is wider, and the level stays.
    session.harness.event(Event::ModifiersChanged(Modifiers::COMMAND));
    session.drag(over, Vec2::new(40.0, 0.0), PointerButton::Primary);
    session.harness.event(Event::ModifiersChanged(Modifiers::NONE));
    session.rest();
    let wider = window(&session);
    assert!(wider[1] - wider[0] > 1.05 * (high - low), "{wider:?}");
    assert!((wider[0] + wider[1] - low - high).abs() < 1e-6 * (high - low), "{wider:?}");
    assert_eq!(session.viewer().sections().cursor(), cursor, "a drag with Ctrl moves no cursor");
    (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
    // Up is brighter: a lower level, at the same width.
    session.click("Drag sets the window");
    session.drag(over, Vec2::new(0.0, -30.0), PointerButton::Primary);
    session.rest();
    let brighter = window(&session);
    assert!(brighter[0] < wider[0], "{brighter:?}");
    assert!((brighter[1] - brighter[0] - wider[1] + wider[0]).abs() < 1e-6 * (high - low), "{brighter:?}");
    assert_eq!(session.viewer().sections().cursor(), cursor);
    session.set("Panels, gamma", 0.5);
    session.rest();
    session.assert_section_is_as_rendered(2);
    session.click("Slab");
    session.frames(3);
    session.set("Panels, thickness of the slab", 9.0);
    for (quantity, mode) in [("maximum", Mode::Mip), ("minimum", Mode::Minip), ("mean", Mode::Mean)] {
        session.click("Panels, quantity of the slab");
        session.frames(3);
        session.click(quantity);
        session.rest();
        let scene = session.viewer().sections().panel(2).expect("a panel").scene().expect("a scene").clone();
        assert_eq!(
            (scene.mode, scene.clip.index_box.map(|ends| ends.map(|end| end[2]))),
            (Some(mode), Some([27.5, 36.5]))
        );
        (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
        session.harness.hover_at(over);
        let picked = point_at_rest(&mut session);
        assert!((27.5..=36.5).contains(&picked.index[2]), "{quantity}: {picked:?}");
    }
    session.click("Default window");
    session.rest();
    assert_eq!(window(&session), [low, high]);
}

#[test]
fn the_cine_shows_one_slice_after_the_other() {
    let mut session = at_rest_with_three();
    session.set("Cursor, z", 62.0);
    session.rest();
    session.press(Modifiers::NONE, Key::C);
    assert!(session.viewer().cine().is_running());
    let mut seen = vec![62.0];
    session.until("it has gone round", |s| {
        let [_, _, z] = s.viewer().sections().cursor();
        if seen.last() != Some(&z) {
            seen.push(z);
        }
        seen.len() >= 5
    });
    assert_eq!(seen, [62.0, 63.0, 0.0, 1.0, 2.0], "no slice is left out, and after the last comes the first");
    session.press(Modifiers::NONE, Key::C);
    session.rest();
    session.assert_section_is_as_rendered(2);
    // The slice in place of the volume, too.
    session.press(Modifiers::NONE, Key::T);
    session.click("y");
    session.rest();
    let place = |s: &Session| s.viewer().scene().clip.index_box.expect("a thin box")[0][1];
    let before = place(&session);
    session.click("Play cine");
    session.until("it moves", |s| place(s) > before + 1.5);
    session.click("Stop cine");
    session.rest();
    session.assert_is_as_rendered();
}

#[test]
fn slices_alone_and_slices_in_a_fainter_volume() {
    let mut session = Session::of("ramp");
    session.rest();
    let opaque = session.viewer().scene().transfer_function.clone();
    session.click("+ x");
    session.rest();
    let fainter = session.viewer().scene().transfer_function.clone();
    assert_ne!(fainter, opaque, "an opaque volume would hide the slice");
    session.assert_is_as_rendered();
    session.click("Slice 1, remove");
    session.rest();
    assert_eq!(session.viewer().scene().transfer_function, opaque);
    session.click("Slices only");
    session.rest();
    assert_eq!((session.viewer().scene().mode, session.viewer().scene().slices.len()), (Some(Mode::Slice), 3));
    session.assert_is_as_rendered();
    session.click("Volume");
    session.rest();
    assert_eq!((session.viewer().scene().mode, session.viewer().scene().slices.len()), (Some(Mode::Dvr), 3));
    session.assert_is_as_rendered();
}

#[test]
fn panels_fit_at_every_size() {
    for (name, size, scale) in
        [("panels-1280x800", ROOMY, 1.0), ("panels-scale2", ROOMY, 2.0), ("panels-small", [800.0, 500.0], 1.0)]
    {
        let mut session = Session::sized("vessels", size, scale);
        session.rest();
        session.press(Modifiers::NONE, Key::T);
        session.rest();
        let window = Rect::from_min_size(Pos2::ZERO, size.into());
        for label in NAMES {
            let rect = session.node(label).rect();
            assert!(window.contains_rect(rect) && rect.width() >= 100.0 && rect.height() >= 100.0, "{name}: {rect:?}");
        }
        let over = session.node(NAMES[2]).rect().center();
        session.harness.hover_at(over);
        session.until("it is known", |s| s.viewer().sections().probed().is_some());
        session.frames(4);
        session.screenshot(name);
        session.node("Panels, colours").scroll_to_me();
        session.frames(8);
        session.screenshot(&format!("{name}-controls"));
    }
}

/// Opening another volume shows nothing of the old one in the panels.
#[test]
fn panels_follow_the_volume_that_is_opened() {
    let mut session = at_rest_with_three();
    let other = support::container(session.folder.path(), "vessels", 48);
    session.harness.state_mut().open(&other);
    session.until("it is open", |s| s.viewer().opened().is_some_and(|o| o.source == other));
    session.rest();
    assert_eq!(session.viewer().sections().cursor(), [24.0; 3]);
    (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
    session.set("Vertical exaggeration", 2.0);
    session.until("it is placed anew", |s| s.viewer().opened().is_some_and(|o| o.exaggeration == 2.0));
    session.rest();
    (0..3).for_each(|axis| session.assert_section_is_as_rendered(axis));
    session.assert_is_as_rendered();
}

/// A survey with the values inline + crossline / 100 + sample / 100,000.
#[test]
#[allow(clippy::print_stderr, reason = "what is skipped is said")]
fn a_survey_is_told_with_its_line_numbers() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/segy/odd/small.sgy");
    if !file.exists() {
        eprintln!("SKIPPED: {} is not there", file.display());
        return;
    }
    let mut session = Session::of_file(|_| file);
    session.click("Three panels");
    session.click("Panels, interpolation");
    session.frames(3);
    session.click("nearest");
    session.rest();
    let opened = session.viewer().opened().expect("open").clone();
    let scales = opened.survey.as_ref().expect("a survey").scales();
    for axis in 0..3 {
        let name = format!("Section {}", supervol_viewer::planes::axis_name(&opened, axis));
        let at = session.node(&name).rect().center() + Vec2::new(17.0, -11.0);
        session.harness.hover_at(at);
        session.frames(2);
        session.until("it is known", |s| s.viewer().sections().probed().is_some_and(|p| p.probe.panel == Some(axis)));
        let found = session.viewer().sections().probed().expect("an answer").found.clone();
        let picked = found.expect("no error").expect("a point");
        let voxel = picked.index.map(|i| (i + 0.5).floor());
        let [crossline, inline, _] = [0, 1, 2].map(|a| scales[a][0] + scales[a][1] * voxel[a]);
        let expected = inline + crossline / 100.0 + voxel[2] / 1e5;
        assert!((picked.value - expected).abs() < 1e-4, "{picked:?}: expected {expected}");
        let told = describe_point(&picked, &opened);
        let [at_crossline, at_inline] = [0, 1].map(|a| scales[a][0] + scales[a][1] * picked.index[a]);
        let lines = format!("\ninline {}, crossline {}, ", place(at_inline, 1.0), place(at_crossline, 1.0));
        let value = format!("value {}", short(picked.value));
        assert!(told.contains(&lines) && told.starts_with(&value) && told.ends_with(" ms"), "{told}");
    }
    session.screenshot("survey-panels");
}

#[test]
fn a_section_is_saved_and_exported_as_it_is_shown() {
    let mut session = at_rest_with_three();
    let over = session.node(NAMES[1]).rect().center();
    wheel(&mut session, over, 4.0, Modifiers::NONE);
    let right_click = |session: &mut Session| {
        session.harness.hover_at(over);
        session.frames(1);
        for pressed in [true, false] {
            let (pos, button, modifiers) = (over, PointerButton::Secondary, Modifiers::NONE);
            session.harness.event(Event::PointerButton { pos, button, pressed, modifiers });
            session.frames(2);
        }
    };
    right_click(&mut session);
    session.click("Save the scene of this section ...");
    session.click("Save");
    let written = std::fs::read_to_string(session.folder.path().join("sphere.section.json")).expect("a scene file");
    let scene = Scene::from_json(&written).expect("a scene");
    assert_eq!(Some(&scene), session.viewer().sections().panel(1).expect("a panel").scene());
    session.click("OK");
    right_click(&mut session);
    session.click("Export this section ...");
    session.click("Export");
    let exported = session.folder.path().join("sphere.section.png");
    session.until("it is written", |s| exported.exists() && s.viewer().is_idle());
    let expected = session.folder.path().join("expected.png");
    support::headless(session.viewer(), &scene).save(&expected).expect("a file");
    assert!(support::pixels(&exported) == support::pixels(&expected), "other pixels");
    session.assert_section_is_as_rendered(1);
}
