//! The viewer as a user operates it, without a display. Frames are run one by one; keys and mouse are events. Pictures
//! on the screen are compared with `render`.

use crate::support;

use eframe::egui::{Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton, Pos2, TouchPhase, Vec2};
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use supervol_preprocess::Existing;
use supervol_scene::image::stored::StoredPicture;
use supervol_scene::scene::{CameraSpec, Mode, Scene, ShadingSpec, TransferFunctionSpec};
use supervol_scene::slices::Interpolation;
use supervol_scene::slices::filter::{FilterKind, FilterSpec};
use supervol_viewer::command::{BINDINGS, Command};
use supervol_viewer::worker::{Message, Settings};

use support::{ROOMY, SMALL, Session, headless};

#[test]
fn a_container_is_shown_as_render_draws_it() {
    let mut session = Session::sized("vessels", ROOMY, 1.0);
    session.rest();
    session.assert_is_as_rendered();
    let viewer = session.viewer();
    let image = &viewer.scene().image;
    assert!(image.width > 600 && image.height > 600, "the picture takes the room that is left: {image:?}");
    assert!(viewer.picture().is_some_and(|p| p.stats.error_stated.is_some()), "the error is stated");
}

#[test]
fn dragging_turns_and_moves_and_the_wheel_brings_nearer() {
    let mut session = Session::of("vessels");
    session.rest();
    let first = session.viewer().scene().camera.clone().expect("a camera");
    let middle = session.node("Picture").rect().center();

    session.drag(middle, Vec2::new(60.0, 20.0), PointerButton::Primary);
    let turned = session.viewer().scene().camera.clone().expect("a camera");
    assert_eq!(turned.target, first.target, "turning keeps the target");
    assert_ne!(turned.eye, first.eye);
    session.drag(middle, Vec2::new(60.0, 20.0), PointerButton::Secondary);
    let moved = session.viewer().scene().camera.clone().expect("a camera");
    assert_ne!(moved.target, turned.target, "moving moves the target");
    session.harness.hover_at(middle + Vec2::new(40.0, 0.0));
    session.harness.event(Event::MouseWheel {
        unit: MouseWheelUnit::Line,
        delta: Vec2::new(0.0, 3.0),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers: Modifiers::NONE,
    });
    session.rest();
    let nearer = session.viewer().scene().camera.clone().expect("a camera");
    // Rays of the default picture come together in the eye, which comes nearer.
    let distance = |camera: &CameraSpec| DVec3::from(camera.eye).distance(DVec3::from(camera.target));
    assert!(nearer.height.is_none() && distance(&nearer) < 0.95 * distance(&moved));
    session.assert_is_as_rendered();
    assert!(!session.viewer().latencies_ms().is_empty());
}

#[test]
fn the_title_names_the_file_and_says_whether_work_goes_on() {
    let mut session = Session::of("vessels");
    let titles = |session: &Session| -> Vec<String> {
        session.told.iter().filter(|command| command.starts_with("Title(")).cloned().collect()
    };
    let [working, done] = [" (working)", ""].map(|work| format!("Title(\"vessels.svol{work} - Supervol\")"));
    session.rest();
    // The first picture may be there as soon as the volume is: then no work was ever to be seen.
    let first = titles(&session);
    assert!(first.last() == Some(&done) && first.iter().all(|title| [&working, &done].contains(&title)), "{first:?}");
    session.drag(session.node("Picture").rect().center(), Vec2::new(60.0, 20.0), PointerButton::Primary);
    session.rest();
    // The frame that changes a scene says so, however fast the picture is drawn.
    let then = &titles(&session)[first.len()..];
    assert_eq!((then.first(), then.last()), (Some(&working), Some(&done)), "a changed scene is worked on");
}

/// Every key of the list has an effect, and every command has a key.
#[test]
fn every_key_does_what_the_list_says() {
    let mut session = Session::of("vessels");
    session.rest();
    for binding in BINDINGS {
        for key in binding.keys {
            session.begin_anew();
            if matches!(binding.command, Command::DefaultView | Command::Undo | Command::Redo) {
                session.press(Modifiers::NONE, Key::Num4);
                session.edit(|scene| scene.image.background = [0.25; 3]);
            }
            if binding.command == Command::Redo {
                session.press(Modifiers::COMMAND, Key::Z);
            }
            let before = session.fingerprint();
            session.press(key.modifiers, key.logical_key);
            assert_ne!(session.fingerprint(), before, "{} by {key:?}", binding.words);
        }
    }
}

#[test]
fn undo_takes_back_motions_of_the_camera() {
    let mut session = Session::of("sphere");
    session.rest();
    let first = session.viewer().scene().camera.clone();
    let over = session.node("Picture").rect().center();
    session.drag(over, Vec2::new(60.0, 20.0), PointerButton::Primary);
    session.rest();
    let turned = session.viewer().scene().camera.clone();
    assert_ne!(turned, first);
    session.edit(|scene| scene.image.background = [0.25; 3]);
    session.rest();
    session.press(Modifiers::COMMAND, Key::Z);
    assert_eq!((session.viewer().scene().image.background, &session.viewer().scene().camera), ([0.0; 3], &turned));
    session.press(Modifiers::COMMAND, Key::Z);
    session.rest();
    assert_eq!(session.viewer().scene().camera, first);
    session.assert_is_as_rendered();
}

#[test]
fn each_mode_is_drawn_as_render_draws_its_scene_and_is_kept_when_it_is_left() {
    let mut session = Session::of("sphere");
    session.rest();
    let first = session.viewer().scene().clone();
    for (label, mode) in
        [("Max", Mode::Mip), ("Min", Mode::Minip), ("Mean", Mode::Mean), ("Iso", Mode::Iso), ("Volume", Mode::Dvr)]
    {
        session.click(label);
        session.rest();
        assert_eq!(session.viewer().scene().mode, Some(mode));
        session.assert_is_as_rendered();
    }
    assert_eq!(*session.viewer().scene(), first, "back where it was");
}

#[test]
fn a_point_that_is_dragged_changes_the_picture_and_undo_takes_it_back() {
    let mut session = Session::of("vessels");
    session.rest();
    let first = session.viewer().scene().clone();
    let before = session.pixels();
    let editor = session.node("Transfer function").rect();
    // Control points are found where the editor draws them; the preset's last one is at the right.
    let grid = (0..40).flat_map(|x| (0..20).map(move |y| (x, y)));
    for (x, y) in grid {
        let at = editor.min + Vec2::new((x as f32 + 0.5) / 40.0, (y as f32 + 0.5) / 20.0) * editor.size();
        session.drag(at, Vec2::new(0.0, 30.0), PointerButton::Primary);
        if *session.viewer().scene() != first {
            break;
        }
    }
    session.rest();
    assert_ne!(session.viewer().scene().transfer_function, first.transfer_function, "no point could be dragged");
    assert_ne!(session.pixels(), before);
    session.assert_is_as_rendered();
    session.press(Modifiers::COMMAND, Key::Z);
    session.rest();
    assert_eq!(*session.viewer().scene(), first);
    assert_eq!(session.pixels(), before, "the same picture, bit for bit");
}

#[test]
fn a_saved_scene_and_the_copied_command_mean_the_picture() {
    let mut session = Session::of("sphere");
    session.rest();
    session.press(Modifiers::NONE, Key::ArrowRight);
    session.press(Modifiers::COMMAND, Key::S);
    session.click("Save");
    let written = session.folder.path().join("sphere.scene.json");
    let saved = Scene::from_json(&std::fs::read_to_string(written).expect("a scene file")).expect("a scene");
    assert_eq!(saved, *session.viewer().scene());
    session.press(Modifiers::COMMAND, Key::S);
    assert!(session.harness.query_by_label("Overwrite the existing file").is_some());
    session.press(Modifiers::NONE, Key::Escape);

    session.press(Modifiers::COMMAND | Modifiers::SHIFT, Key::C);
    let Some(Message::Done(line)) = session.viewer().message() else { panic!("nothing was copied") };
    let scene = line.split_whitespace().skip_while(|word| *word != "--scene").nth(1).expect("a scene file");
    let named = Scene::from_json(&std::fs::read_to_string(scene).expect("it is there")).expect("a scene");
    assert_eq!(named, saved);
    assert!(line.contains("supervol render") && line.contains("sphere.svol"), "{line}");
}

#[test]
fn an_exported_picture_is_the_one_that_render_writes() {
    let mut session = Session::of("vessels");
    session.rest();
    session.press(Modifiers::COMMAND, Key::E);
    session.click("Export");
    let written = session.folder.path().join("vessels.png");
    session.until("the file is written", |session| written.exists() && session.viewer().is_idle());
    let expected = session.folder.path().join("expected.png");
    headless(session.viewer(), session.viewer().scene()).save(&expected).expect("a file");
    let [written, expected] = [written, expected].map(|path| StoredPicture::read(&path).expect("a picture"));
    assert!(written.pixels == expected.pixels, "other pixels");
    assert_eq!(written.record, expected.record);
    session.assert_is_as_rendered();
}

#[test]
fn settings_change_how_pictures_are_made() {
    let mut session = Session::of("vessels");
    session.rest();
    session.set("Error target", 8.0);
    session.set("Memory", 128.0);
    session.set("Time for interaction", 50.0);
    session.rest();
    let stats = &session.viewer().picture().expect("a picture").stats;
    assert_eq!(stats.host_budget_bytes, 128 << 20);
    assert!((stats.max_error_requested * 255.0 - 8.0).abs() < 0.1, "{}", stats.max_error_requested);
    assert_eq!(session.viewer().settings().interaction_ms, 50);
    // A value outside a control's range stays until the user changes it.
    session.click("Volume");
    session.edit(|scene| scene.shading = Some(Some(ShadingSpec { specular: 5.0, ..ShadingSpec::default() })));
    session.rest();
    assert_eq!(session.viewer().scene().shading.as_ref().and_then(|s| s.as_ref()).map(|s| s.specular), Some(5.0));
    session.assert_is_as_rendered();
}

#[test]
fn crops_and_exaggerations_are_those_of_the_scene_and_the_command() {
    let mut session = Session::of("vessels");
    session.rest();
    session.set("x, first voxel", 20.0);
    session.set("y, last voxel", 30.0);
    session.rest();
    assert_eq!(session.viewer().scene().clip.index_box, Some([[19.5, -0.5, -0.5], [63.5, 30.5, 63.5]]));
    session.assert_is_as_rendered();
    session.set("Vertical exaggeration", 3.0);
    session.until("the volume is placed anew", |s| s.viewer().opened().is_some_and(|o| o.exaggeration == 3.0));
    session.rest();
    assert_eq!(session.viewer().opened().expect("open").facts().geometry.spacing[2], 3.0);
    assert!(session.viewer().scene().clip.index_box.is_some(), "the crop stays");
    session.assert_is_as_rendered();
    // An older scene is drawn at the new place of the volume, as the scene and the command say.
    session.press(Modifiers::COMMAND, Key::Z);
    session.rest();
    assert_eq!(session.viewer().scene().vertical_exaggeration, Some(3.0));
    session.assert_is_as_rendered();
}

#[test]
fn what_is_no_volume_is_refused_in_words_and_the_open_one_stays() {
    let mut session = Session::of("sphere");
    session.rest();
    let text = session.folder.path().join("notes.txt");
    std::fs::write(&text, "no volume").expect("a file");
    for (path, words) in [
        (text, "SEG-Y"),
        (session.folder.path().join("missing.svol"), "missing.svol"),
        (session.folder.path().to_path_buf(), "folder"),
    ] {
        session.harness.state_mut().open(&path);
        session
            .until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(m)) if m.contains(words)));
    }
    session.press(Modifiers::NONE, Key::ArrowRight);
    session.rest();
    session.assert_is_as_rendered();
}

#[test]
fn a_source_file_is_built_into_the_cache_once() {
    let mut session = Session::of("sphere");
    session.rest();
    let source = support::npy(session.folder.path());
    for _ in 0..2 {
        // The second time, the file is open already.
        let before = session.viewer().opened().map(|o| o.number);
        session.harness.state_mut().open(&source);
        session.until("it is open", |s| {
            s.viewer().opened().is_some_and(|o| o.source == source && Some(o.number) != before)
        });
        session.rest();
        session.assert_is_as_rendered();
    }
    let built = std::fs::read_dir(session.cache().join("containers")).expect("a cache folder");
    assert_eq!(built.flatten().filter(|e| e.path().extension().is_some_and(|e| e == "svol")).count(), 1);
}

#[test]
fn every_panel_fits_at_its_least_and_at_scale_2() {
    for (name, size, scale) in [("1280x800", ROOMY, 1.0), ("scale2", ROOMY, 2.0), ("small", SMALL, 1.0)] {
        let mut session = Session::sized("vessels", size, scale);
        session.rest();
        let window = eframe::egui::Rect::from_min_size(Pos2::ZERO, size.into());
        for label in ["Open ...", "Default view", "Picture", "Transfer function", "Kind", "converged"] {
            let rect = session.node(label).rect();
            assert!(window.expand(0.5).contains_rect(rect), "{name}: {label} lies at {rect:?}");
        }
        let picture = session.node("Picture").rect();
        assert!(picture.width() >= 200.0 && picture.height() >= 300.0, "{name}: {picture:?}");
        assert_eq!(session.viewer().scene().image.width, (picture.width() * scale).round() as u32);
        session.screenshot(name);
        for (key, what) in [(Key::Questionmark, "keys"), (Key::O, "open"), (Key::E, "export")] {
            let modifiers = if key == Key::Questionmark { Modifiers::NONE } else { Modifiers::COMMAND };
            session.press(modifiers, key);
            session.frames(8);
            session.screenshot(&format!("{name}-{what}"));
            session.press(Modifiers::NONE, Key::Escape);
        }
    }
}

#[test]
fn surfaces_stand_in_the_semi_transparent_volume() {
    let mut session = Session::of("sphere");
    session.rest();
    session.click("Volume");
    session.rest();
    let plain = session.pixels();
    session.click("+ surface");
    session.rest();
    let scene = session.viewer().scene().clone();
    assert_eq!((scene.mode, scene.iso.len()), (Some(Mode::Dvr), 1));
    assert!(matches!(scene.shading, Some(Some(_))), "nobody sees the shape of an unlit surface");
    assert_ne!(session.pixels(), plain);
    session.assert_is_as_rendered();
    session.click("+ surface");
    session.rest();
    let values: Vec<f64> = session.viewer().scene().iso.iter().map(|iso| iso.value).collect();
    assert!(values.len() == 2 && values[0] < values[1], "{values:?}");
    session.assert_is_as_rendered();
    for _ in 0..2 {
        session.press(Modifiers::COMMAND, Key::Z);
    }
    session.rest();
    assert!(session.viewer().scene().iso.is_empty());
    assert_eq!(session.pixels(), plain);
}

#[test]
fn slices_are_shown_face_on_and_the_volume_comes_back() {
    let mut session = Session::of("sphere");
    session.rest();
    let first = session.viewer().scene().clone();
    session.click("z");
    session.rest();
    let slice = session.viewer().scene().clone();
    assert_eq!(slice.mode, Some(Mode::Mean));
    assert_eq!(slice.clip.index_box, Some([[-0.5, -0.5, 31.95], [63.5, 63.5, 32.05]]));
    session.assert_is_as_rendered();
    session.press(Modifiers::NONE, Key::Plus);
    session.set("Place of the slice", 10.0);
    session.rest();
    let other = session.viewer().scene().clone();
    assert_eq!(other.clip.index_box.expect("a slice")[0][2], 9.95);
    assert!(other.camera.expect("a camera").height < slice.camera.expect("a camera").height, "the zoom stays");
    session.assert_is_as_rendered();
    session.click("None");
    session.rest();
    assert_eq!(*session.viewer().scene(), first);
    session.assert_is_as_rendered();
}

/// Turns the wheel over the picture while Alt is held.
fn wheel_with_alt(session: &mut Session, notches: f32) {
    let middle = session.node("Picture").rect().center();
    session.harness.hover_at(middle);
    session.harness.event(Event::ModifiersChanged(Modifiers::ALT));
    session.harness.event(Event::MouseWheel {
        unit: MouseWheelUnit::Line,
        delta: Vec2::new(0.0, notches),
        phase: TouchPhase::Move,
        source: MouseWheelSource::Wheel,
        modifiers: Modifiers::ALT,
    });
    session.frames(12);
    session.harness.event(Event::ModifiersChanged(Modifiers::NONE));
    session.frames(3);
}

#[test]
fn slices_in_the_volume_are_planes_of_the_scene_at_their_depth() {
    let mut session = Session::of("sphere");
    session.rest();
    let (plain, camera) = (session.pixels(), session.viewer().scene().camera.clone());
    session.click("+ z");
    session.set("Slice 1, place", 20.0);
    session.rest();
    assert_ne!(session.pixels(), plain);
    session.assert_is_as_rendered();
    let slices = session.viewer().scene().slices.clone();
    assert_eq!((slices[0].normal, slices[0].offset), ([0.0, 0.0, 1.0], 20.0));

    session.click("+ oblique");
    session.set("Slice 2, opacity", 0.5);
    session.set("Slice 2, normal x", 0.0);
    session.rest();
    let oblique = session.viewer().scene().slices[1].clone();
    assert!(
        oblique.opacity == 0.5
            && oblique.normal[0] == 0.0
            && (oblique.normal[1].hypot(oblique.normal[2]) - 1.0).abs() < 1e-12
    );
    session.assert_is_as_rendered();
    // The wheel moves the slice that was added last, not the camera.
    wheel_with_alt(&mut session, 3.0);
    session.rest();
    assert_ne!(session.viewer().scene().slices[1].offset, oblique.offset);
    assert_eq!(session.viewer().scene().slices[0], slices[0]);
    session.click("1: z");
    wheel_with_alt(&mut session, -3.0);
    session.rest();
    assert_eq!(session.viewer().scene().slices[0].offset, 17.0);
    assert_eq!(session.viewer().scene().camera, camera, "the wheel with Alt is the slice's");
    session.assert_is_as_rendered();

    // Projections have no slices; the slices come back afterwards.
    let both = session.viewer().scene().slices.clone();
    session.click("Max");
    session.rest();
    assert!(session.viewer().scene().slices.is_empty() && session.viewer().message().is_none());
    session.assert_is_as_rendered();
    session.click("Volume");
    session.rest();
    assert_eq!(session.viewer().scene().slices, both);
    session.set("Vertical exaggeration", 2.0);
    session.until("the volume is placed anew", |s| s.viewer().opened().is_some_and(|o| o.exaggeration == 2.0));
    session.rest();
    assert_eq!(session.viewer().scene().slices[0].offset / session.viewer().scene().slices[0].normal[2], 34.0);
    session.assert_is_as_rendered();
}

#[test]
fn slices_have_filters_colours_and_interpolations() {
    let mut session = Session::of("sphere");
    session.rest();
    session.click("+ x");
    for (box_, choice) in [
        ("Slice 1, interpolation", "cubic"),
        ("Slice 1, colours", "viridis"),
        ("Slice 1, filter", "median"),
        ("Slice 1, filter", "sobel"),
    ] {
        session.click(box_);
        session.frames(3);
        session.click(choice);
        session.rest();
        session.assert_is_as_rendered();
    }
    let slice = session.viewer().scene().slices[0].clone();
    assert_eq!(slice.interpolation, Interpolation::Cubic);
    assert_eq!(slice.filter, Some(FilterSpec { kind: FilterKind::Sobel, size: None }));
    assert!(slice.colors.is_empty(), "colours of values are none of slopes");
    session.press(Modifiers::COMMAND, Key::Z);
    session.rest();
    let before = session.viewer().scene().slices[0].clone();
    assert_eq!(before.filter, Some(FilterSpec { kind: FilterKind::Median, size: Some(1.0) }));
    assert!(before.colors.len() > 2);
    session.assert_is_as_rendered();
    let picture = session.pixels();
    session.click("Slice 1, remove");
    session.rest();
    assert_ne!(session.pixels(), picture);
}

#[test]
fn the_controls_of_slices_fit() {
    for (name, scale) in [("slices-1280x800", 1.0), ("slices-scale2", 2.0)] {
        // Pictures between slices take more memory than the default for a window of this size.
        let settings = Settings { host_memory_bytes: 2 << 30, ..Settings::default() };
        let mut session = Session::in_window("vessels", (ROOMY, scale), settings);
        session.rest();
        session.click("Volume");
        session.click("+ y");
        session.click("+ oblique");
        session.rest();
        let last = session.node("Slice 2, colours").rect();
        let panel = session.node("Picture").rect().left();
        assert!(last.right() <= panel, "{name}: {last:?} reaches into the picture at {panel}");
        session.node("Slice 2, colours").scroll_to_me();
        session.frames(8);
        session.rest();
        session.screenshot(name);
    }
}

#[test]
fn decorations_are_those_of_render() {
    let mut session = Session::of("sphere");
    session.rest();
    let plain = session.pixels();
    session.click("Box, scale, colours");
    session.rest();
    let viewer = session.viewer();
    let picture = headless(viewer, viewer.scene());
    let (mut image, placed, scene) = (picture.image().clone(), picture.volume(), picture.resolved());
    supervol_decorations::decorate(&mut image, placed.container(), placed.facts(), scene, None);
    let expected = image.to_rgb8(scene.background);
    let shown: Vec<u8> = session.pixels().iter().flat_map(|p| [p.r(), p.g(), p.b()]).collect();
    assert!(shown == expected && session.pixels() != plain);
    session.press(Modifiers::COMMAND | Modifiers::SHIFT, Key::C);
    assert!(matches!(session.viewer().message(), Some(Message::Done(line)) if line.contains("--decorate")));
}

/// Overwriting follows the rules of all commands.
#[test]
fn nothing_that_is_no_picture_is_replaced() {
    let mut session = Session::of("sphere");
    session.rest();
    let path = session.folder.path().join("sphere.png");
    std::fs::copy(session.folder.path().join("sphere.svol"), &path).expect("a file");
    let scene = session.viewer().scene().clone();
    session.export(supervol_viewer::worker::Export { scene, path: path.clone(), existing: Existing::ReplacePicture });
    session.until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(_))));
    assert_eq!(std::fs::read(&path).expect("a file")[1..5], *b"SVOL");

    // An open file is never overwritten, under any name.
    session.press(Modifiers::COMMAND, Key::S);
    let volume = session.folder.path().join("sphere.svol");
    session.type_over("Scene file", &volume.display().to_string());
    session.click("Overwrite the existing file");
    session.click("Save");
    assert!(matches!(session.viewer().message(), Some(Message::Failure(m)) if m.contains("sphere.svol")));
    assert_eq!(std::fs::read(&volume).expect("a file")[1..5], *b"SVOL");
}

/// Loaded files give the same picture as `--tf` and `--colormap`.
#[test]
fn transfer_functions_are_loaded_saved_and_kept_by_name() {
    let mut session = Session::of("vessels");
    session.rest();
    session.click("Volume");
    session.rest();
    let first = session.viewer().scene().clone();
    let points = |session: &Session| match &session.viewer().scene().transfer_function {
        Some(TransferFunctionSpec::Points(spec)) => spec.clone(),
        other => panic!("no points: {other:?}"),
    };
    let unit_distance = points(&session).unit_distance;
    session.click("Save as ...");
    session.type_over("Name to keep it by", "first look");
    session.click("Keep");
    session
        .until("it is written", |s| matches!(s.viewer().message(), Some(Message::Done(m)) if m.contains("first look")));

    let folder = session.folder.path().to_path_buf();
    std::fs::write(folder.join("ramp.1dt"), "2\n0 0 0 0\n1 1 0 0.5\n").expect("a file");
    std::fs::write(folder.join("colours.json"), r#"[{"RGBPoints": [0, 0, 0, 1, 9, 1, 0, 0]}]"#).expect("a file");
    std::fs::write(folder.join("wrong.json"), "[1]").expect("a file");
    let load = |session: &mut Session, name: &str| {
        session.click("Load ...");
        session.type_over("File to open", &folder.join(name).display().to_string());
        session.click("Open");
    };
    load(&mut session, "ramp.1dt");
    session.until("it is loaded", |s| s.viewer().scene().transfer_function != first.transfer_function);
    session.rest();
    let ramp = points(&session);
    assert_eq!(ramp.points.iter().map(|p| p.alpha).collect::<Vec<_>>(), [0.0, 0.5]);
    assert_eq!((ramp.points[1].color, ramp.unit_distance), ([1.0, 1.0, 0.0], unit_distance));
    session.assert_is_as_rendered();
    load(&mut session, "colours.json");
    session.until("it is painted", |s| points(s) != ramp);
    session.rest();
    let painted = points(&session);
    assert_eq!(
        painted.points.iter().map(|p| (p.color, p.alpha)).collect::<Vec<_>>(),
        [([0.0, 0.0, 1.0], 0.0), ([1.0, 0.0, 0.0], 0.5)]
    );
    session.assert_is_as_rendered();
    load(&mut session, "wrong.json");
    session.until(
        "it is refused",
        |s| matches!(s.viewer().message(), Some(Message::Failure(m)) if m.contains("wrong.json")),
    );
    assert_eq!(points(&session), painted);

    session.click("Named transfer functions");
    session.frames(3);
    session.click("first look");
    session.until("it is there again", |s| s.viewer().scene().transfer_function == first.transfer_function);
    session.rest();
    session.assert_is_as_rendered();
    session.press(Modifiers::COMMAND, Key::Z);
    assert_eq!(points(&session), painted, "loading is an edit");
}

/// The status of a converged picture must not change the picture's room, or it would be drawn again without end.
#[test]
fn a_finished_picture_stays_finished_at_every_width() {
    for width in (860..=1140).step_by(40) {
        let mut session = Session::sized("sphere", [width as f32, 500.0], 1.0);
        session.rest();
        // The status line may have grown once.
        session.frames(5);
        session.rest();
        let number = session.viewer().picture().expect("a picture").number;
        session.frames(30);
        session.rest();
        assert_eq!(session.viewer().picture().expect("a picture").number, number, "{width} points across");
    }
}
