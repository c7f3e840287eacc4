//! Containers that the window builds from source files: cancelled, continued, and ended with the window.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use egui_kittest::kittest::Queryable;
use supervol_format::{Dims, Geometry, VoxelType};
use supervol_preprocess::kept::Reading;
use supervol_scene::scene::Scene;
use supervol_sources::Endian;
use supervol_sources::formats::raw::RawOptions;
use supervol_sources::open::OpenOptions;
use supervol_viewer::worker::{Message, Settings};

use crate::support;
use support::{ROOMY, Session, npy_of};

/// Voxels along each edge: the build takes long enough to press a button.
const EDGE: usize = 320;
/// Longest time for closing a window: one second, doubled for a busy machine.
const CLOSING: Duration = Duration::from_secs(2);

/// Noise, which codecs cannot compress quickly.
fn noise(folder: &Path) -> PathBuf {
    npy_of(folder, "noise", [EDGE; 3], |i| (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).to_be_bytes()[0])
}

/// Starts to open a file of noise while a volume is open.
fn opening() -> Session {
    let mut session = Session::of("sphere");
    session.rest();
    let file = noise(session.folder.path());
    session.harness.state_mut().open(&file);
    session
}

/// Waits for the Cancel button and for a text about the activity.
fn until_building(session: &mut Session, words: &str) {
    session.until("the build can be cancelled", |s| {
        s.harness.query_by_label("Cancel").is_some() && s.harness.query_by_label_contains(words).is_some()
    });
}

fn told(session: &Session) -> String {
    match session.viewer().message() {
        Some(Message::Done(text)) => text.clone(),
        other => panic!("told {other:?}"),
    }
}

/// Number of unfinished build files.
fn unfinished(session: &Session) -> usize {
    let Ok(kept) = std::fs::read_dir(session.cache().join("containers")) else { return 0 };
    kept.filter(|entry| entry.as_ref().is_ok_and(|e| e.file_name().to_string_lossy().ends_with(".partial"))).count()
}

#[test]
fn a_build_that_is_cancelled_goes_on_when_its_file_is_opened_again() {
    let mut session = opening();
    until_building(&mut session, "building");
    session.screenshot("build");
    session.click("Cancel");
    session.until("it has stopped", |s| s.viewer().message().is_some() && s.viewer().is_idle());
    let words = told(&session);
    assert!(words.contains("noise.npy") && words.contains("open the file again to continue"), "{words}");
    assert_eq!(unfinished(&session), 2, "the container and its list");
    session.screenshot("build_cancelled");
    // The open volume stays and can be turned.
    session.press(eframe::egui::Modifiers::NONE, eframe::egui::Key::ArrowRight);
    session.rest();
    session.assert_is_as_rendered();
    let file = session.folder.path().join("noise.npy");
    session.harness.state_mut().open(&file);
    session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == file));
    session.rest();
    let notes = &session.viewer().opened().expect("open").container().manifest().notes;
    assert!(
        !notes.iter().any(|note| note.contains("interrupted")),
        "the same bytes as of a build in one go: {notes:?}"
    );
    assert_eq!(unfinished(&session), 0);
}

#[test]
fn another_file_ends_a_build_and_nothing_waits_for_it() {
    let mut session = opening();
    session.until("it is under way", |s| s.harness.query_by_label("Cancel").is_some());
    let other = support::npy(session.folder.path());
    session.harness.state_mut().open(&other);
    session.until("the other one is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == other));
    session.rest();
    session.assert_is_as_rendered();
    let built = std::fs::read_dir(session.cache().join("containers")).expect("a folder").flatten();
    let names: Vec<_> = built.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    assert!(!names.iter().any(|name| name.starts_with("noise")), "the first was built all the same: {names:?}");
}

#[test]
fn a_window_that_closes_ends_its_build() {
    let mut session = opening();
    until_building(&mut session, "building");
    let Session { harness, folder, .. } = session;
    let began = Instant::now();
    drop(harness);
    let took = began.elapsed();
    assert!(took < CLOSING, "the window took {took:?} to close");
    let left = std::fs::read_dir(folder.path().join("cache/containers")).expect("a folder").flatten();
    let names: Vec<_> = left.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    assert!(names.len() == 2 && names.iter().all(|name| name.ends_with(".partial")), "{names:?}");
}

#[test]
fn a_headerless_file_is_read_as_the_command_line_says() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("a.raw");
    let voxels: Vec<u8> = (0..40 * 30 * 20u32).map(|i| if i % 40 < 20 { 10 } else { 200 }).collect();
    std::fs::write(&file, voxels).expect("room");
    let raw = RawOptions {
        dims: Dims([40, 30, 20]),
        voxel_type: VoxelType::U8,
        endian: Endian::Little,
        header_bytes: 0,
        geometry: Geometry::IDENTITY,
        nodata: None,
    };
    let reading = Reading { options: OpenOptions { raw: Some(raw), ..OpenOptions::default() }, placing: None };
    let window = (ROOMY, 1.0);
    let mut session = Session::launched(folder, (file.clone(), reading), Scene::default(), window, Settings::default());
    session.rest();
    assert_eq!(session.viewer().opened().expect("open").facts().dims.0, [40, 30, 20]);
    session.assert_is_as_rendered();
    // After a change of exaggeration it is the same file, read with the same options.
    session.harness.state_mut().set_exaggeration(2.0);
    session.until("it is placed anew", |s| s.viewer().opened().is_some_and(|o| o.exaggeration == 2.0));
    session.rest();
    session.assert_is_as_rendered();
    // Dropped into the window, the file has no options.
    session.harness.state_mut().open(&file);
    session.until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(_))));
    let Some(Message::Failure(words)) = session.viewer().message() else { unreachable!("it was one") };
    assert!(words.contains("--dims") && words.contains("File options") && words.contains("a.raw"), "{words}");
}

/// A file of 6 x 5 x 4 bytes without a header is opened with options of the window, and a wrong one is refused with a
/// reason.
#[test]
fn a_file_without_a_header_gets_its_options_in_the_window() {
    let mut session = Session::of("sphere");
    session.rest();
    let file = session.folder.path().join("b.raw");
    std::fs::write(&file, (0..120).collect::<Vec<u8>>()).unwrap();
    session.harness.state_mut().open(&file);
    session.until("it is refused", |s| s.harness.query_by_label("Open with these options").is_some());
    session.type_over("Voxels along x, y, z", "6,5");
    session.type_over("Type of the voxels", "u8");
    session.click("Open with these options");
    session.screenshot("file-options");
    assert!(session.harness.query_by_label_contains("'6,5'").is_some(), "the reason names the option");
    session.type_over("Voxels along x, y, z", "6,5,4");
    session.click("Open with these options");
    session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.source == file));
    session.rest();
    assert_eq!(session.viewer().opened().expect("open").facts().dims.0, [6, 5, 4]);
    session.assert_is_as_rendered();
    // Options of the open file: other dimensions.
    session.click("File options ...");
    session.type_over("Voxels along x, y, z", "5,6,4");
    session.type_over("Type of the voxels", "u8");
    session.click("Open with these options");
    session.until("it is open", |s| s.viewer().opened().is_some_and(|opened| opened.facts().dims.0 == [5, 6, 4]));
}

#[test]
fn a_file_that_is_not_there_ends_with_a_sentence() {
    let mut session = Session::of("sphere");
    session.rest();
    let file = session.folder.path().join("none.nii");
    session.harness.state_mut().open(&file);
    session.until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(_))));
    let Some(Message::Failure(words)) = session.viewer().message() else { unreachable!("it was one") };
    assert!(words.contains("none.nii does not exist.") && !words.contains("options"), "{words}");
    assert!(session.harness.query_by_label("Open with these options").is_none());
}

/// Two arrays in one file: the window offers both.
#[test]
#[allow(clippy::print_stderr, reason = "what is skipped is said")]
fn datasets_are_chosen_in_the_window() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/hdf5/aneurysm_sense40.h5");
    if !file.exists() {
        eprintln!("SKIPPED: {} is not there", file.display());
        return;
    }
    let mut session = Session::of("sphere");
    session.rest();
    session.harness.state_mut().open(&file);
    session.until("it is refused", |s| s.harness.query_by_label("volume_1 (69 x 84 x 84)").is_some());
    session.click("volume_1 (69 x 84 x 84)");
    session.until("it is open", |s| {
        s.viewer().opened().is_some_and(|opened| opened.source.display().to_string().ends_with(":/volume_1"))
    });
    session.rest();
    assert_eq!(session.viewer().opened().expect("open").facts().dims.0, [84, 84, 69]);
}

/// Floats with a usual null: the note of the build stands in the window.
#[test]
fn notes_of_the_build_stand_in_the_window() {
    let null = |folder: &Path| {
        let path = folder.join("null.nrrd");
        let value = |i: usize| if i.is_multiple_of(4) { -999.25f32 } else { (i % 100) as f32 };
        let mut bytes =
            b"NRRD0004\ntype: float\ndimension: 3\nsizes: 12 12 12\nencoding: raw\nendian: little\n\n".to_vec();
        bytes.extend((0..12 * 12 * 12).flat_map(|i| value(i).to_le_bytes()));
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let session = Session::of_file(null);
    assert!(session.harness.query_by_label_contains("-999.25 are absent").is_some());
    assert!(session.harness.query_by_label_contains("--keep-nulls").is_some());
    let range = session.viewer().opened().expect("open").facts().value_range;
    assert_eq!([range.min, range.max], [1.0, 99.0]);
}

/// A volume that is large enough for a preview: every fourth voxel along x, every second along y and z.
fn large(folder: &Path) -> PathBuf {
    npy_of(folder, "large", [256, 272, 512], |i| {
        let place = [i % 512, i / 512 % 272, i / 512 / 272].map(|n| n as f64);
        let away = place.iter().zip([256.0, 136.0, 128.0]).map(|(p, m)| (p - m) * (p - m)).sum::<f64>().sqrt();
        // A ball in faint noise, which takes long to encode.
        let noise = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).to_be_bytes()[0] & 63;
        if away < 100.0 { 200 } else { noise }
    })
}

#[test]
fn a_large_volume_is_looked_at_while_it_is_built() {
    let mut session = Session::of("sphere");
    session.rest();
    let file = large(session.folder.path());
    session.harness.state_mut().open(&file);
    session.until("there is a preview", |s| s.viewer().is_preview() && s.viewer().picture().is_some());
    // The preview can be turned, cropped and coloured while the container is built; writing pictures is refused.
    session.press(eframe::egui::Modifiers::NONE, eframe::egui::Key::ArrowRight);
    let mut scene = session.viewer().scene().clone();
    scene.clip.index_box = Some([[-0.5, 20.5, -0.5], [127.5, 135.5, 127.5]]);
    session.harness.state_mut().set_scene(scene.clone());
    session.press(eframe::egui::Modifiers::COMMAND, eframe::egui::Key::E);
    session.until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(_))));
    session.screenshot("preview");
    let turned = session.viewer().scene().camera.clone();
    session.until("the volume is there", |s| !s.viewer().is_preview());
    session.rest();
    let opened = session.viewer().opened().expect("open").clone();
    assert_eq!((opened.facts().dims.0, opened.preview_of), ([512, 272, 256], None));
    let shown = session.viewer().scene();
    assert_eq!(shown.camera, turned);
    assert_eq!(shown.clip.index_box, Some([[-0.5, 41.5, -0.5], [511.5, 271.5, 255.5]]));
    assert_eq!(shown.transfer_function, scene.transfer_function);
    session.assert_is_as_rendered();
    session.screenshot("preview_taken_over");
}

#[test]
fn an_untouched_preview_becomes_the_default_picture_and_a_cancelled_one_stays() {
    let mut session = Session::of("sphere");
    session.rest();
    let file = large(session.folder.path());
    session.harness.state_mut().open(&file);
    session.until("there is a preview", |s| s.viewer().is_preview() && s.viewer().picture().is_some());
    session.click("Cancel");
    session.until("it has stopped", |s| s.viewer().message().is_some() && s.viewer().is_idle());
    assert!(session.viewer().is_preview(), "the preview goes on being shown");
    let camera = session.viewer().scene().camera.clone();
    session.harness.state_mut().open(&file);
    session.until("the volume is there", |s| !s.viewer().is_preview());
    session.rest();
    let opened = session.viewer().opened().expect("open").clone();
    let scene = session.viewer().scene();
    assert_eq!(scene.transfer_function, opened.scene.transfer_function, "the volume's own look, not the preview's");
    assert_eq!(scene.camera, camera, "nothing jumps");
    session.assert_is_as_rendered();
}

/// A MetaImage with three channels: a ramp and two constant ones.
fn colours(folder: &Path) -> PathBuf {
    let path = folder.join("colours.mha");
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 16 10 8\nElementType = MET_UCHAR\nElementNumberOfChannels = 3\n\
                  ElementDataFile = LOCAL\n";
    let voxels = (0..16 * 10 * 8).flat_map(|i| [10 * (i % 16) as u8, 50, 200]);
    std::fs::write(&path, [header.as_bytes(), &voxels.collect::<Vec<u8>>()].concat()).expect("room");
    path
}

#[test]
fn channels_of_a_file_are_switched_between_and_what_is_not_there_is_refused() {
    let mut session = Session::of_file(colours);
    let range = |s: &Session| {
        let opened = s.viewer().opened().expect("a volume is open");
        (opened.reading.options.selection.channel, opened.facts().value_range.min, opened.facts().value_range.max)
    };
    let (_, least, most) = range(&session);
    assert!(least > 50.0 && most < 120.0, "luminances, found {least} to {most}");
    let camera = session.viewer().scene().camera.clone();
    for expected in [(Some(0), 0.0, 150.0), (Some(1), 50.0, 50.0), (Some(2), 200.0, 200.0)] {
        session.click("Channel, next");
        session.until("the channel is open", |s| range(s) == expected);
        session.rest();
        assert_eq!(session.viewer().scene().camera, camera, "seen from the same side");
    }
    session.click("Channel, next");
    session.until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(_))));
    let Some(Message::Failure(message)) = session.viewer().message() else { unreachable!() };
    assert!(message.contains("--channel 3") && message.contains("the last is number 2"), "{message}");
    assert_eq!(range(&session).0, Some(2));
    session.click("Channel, previous");
    session.until("the one before is open", |s| range(s).0 == Some(1));
    session.rest();
    session.set("Channel", -1.0);
    session.until("all colours are", |s| range(s) == (None, least, most));
    session.rest();
    session.set("Time point", 4.0);
    session.until("it is refused", |s| matches!(s.viewer().message(), Some(Message::Failure(_))));
}
