//! Folders of pictures by a camera that moves: what they hold, how they go on, what they refuse.

use crate::support;
use support::Folder;

const SMALL: [&str; 4] = ["--size", "24x18", "--backend", "cpu"];

fn with_vessels() -> Folder {
    let folder = Folder::new();
    folder.expect(0, &["synth", "vessels", "--dims", "20,30,40", "-o", "v.svol"]);
    folder
}

fn names(folder: &Folder) -> Vec<String> {
    let entries = std::fs::read_dir(folder.path("f")).expect("the folder was made");
    let mut names: Vec<_> =
        entries.map(|e| e.expect("an entry").file_name().into_string().expect("a plain name")).collect();
    names.sort();
    names
}

#[test]
fn a_turntable_goes_on_with_what_is_missing() {
    let folder = with_vessels();
    let turn = [&["render", "v.svol", "--turntable", "4", "-o", "f"], &SMALL[..]].concat();
    folder.expect(0, &turn);
    let frames: Vec<_> = (0..4).map(|i| format!("frame-{i:05}.png")).collect();
    assert_eq!(names(&folder), [&frames[..], &["sequence.json".into()]].concat());
    let read = |frame: &String| std::fs::read(folder.path(&format!("f/{frame}"))).expect("a picture");
    let pictures: Vec<_> = frames.iter().map(read).collect();
    assert!(pictures[1..].iter().all(|picture| *picture != pictures[0]), "the camera moves");

    std::fs::remove_file(folder.path("f/frame-00002.png")).expect("it is there");
    std::fs::write(folder.path("f/frame-00001.png"), "kept").expect("room");
    assert!(folder.expect(0, &turn).contains("1 of them drawn"));
    assert_eq!(read(&frames[2]), pictures[2]);
    assert_eq!(read(&frames[1]), b"kept", "what is there is not drawn again");

    // The same folder for something else: only where that is said.
    for other in [&["--mode", "minip"][..], &["--camera", "left"], &["--decorate"], &["--max-error", "2/255"]] {
        assert!(folder.expect(2, &[&turn[..], other].concat()).contains("--force"), "{other:?}");
    }
    folder.expect(0, &[&turn[..], &["--force"]].concat());
    assert_eq!(frames.iter().map(read).collect::<Vec<_>>(), pictures);
}

/// Pictures of the same animation in another format go beside the existing ones. Pictures of another animation are
/// refused.
#[test]
fn sequences_are_written_as_floats_too() {
    let folder = with_vessels();
    let turn = [&["render", "v.svol", "--turntable", "2", "-o", "f"], &SMALL[..]].concat();
    folder.expect(0, &turn);
    let as_format = |format| [&turn[..], &["--frame-format", format]].concat();
    assert!(folder.expect(0, &as_format("exr")).contains("frame-%05d.exr"));
    assert!(!folder.expect(0, &as_format("npy")).contains("ffmpeg"));
    let of_frame = |i: usize| ["exr", "npy", "png"].map(|ending| format!("frame-{i:05}.{ending}"));
    assert_eq!(names(&folder), [&of_frame(0)[..], &of_frame(1), &["sequence.json".into()]].concat());
    // Each is the picture that is drawn by itself.
    let printed = folder.expect(0, &["render", "v.svol", "--size", "24x18", "--print-scene"]);
    let plan = support::json(&std::fs::read_to_string(folder.path("f/sequence.json")).expect("a plan"));
    let mut scene = support::json(&printed);
    scene["camera"] = plan["scene"]["camera"].clone();
    std::fs::write(folder.path("s.json"), scene.to_string()).expect("room");
    for ending in ["exr", "npy"] {
        let one = format!("one.{ending}");
        folder.expect(0, &["render", "v.svol", "--scene", "s.json", "-o", &one, "--backend", "cpu"]);
        let read = |path: &str| std::fs::read(folder.path(path)).expect("a picture");
        assert!(read(&one) == read(&format!("f/frame-00000.{ending}")), "{ending}");
    }
    std::fs::remove_file(folder.path("f/frame-00001.exr")).expect("it is there");
    assert!(folder.expect(0, &as_format("exr")).contains("1 of them drawn"));
    let other = [&as_format("exr")[..], &["--mode", "mean"]].concat();
    assert!(folder.expect(2, &other).contains("--force"));
    folder.expect(0, &[&other[..], &["--force"]].concat());
    assert_eq!(names(&folder), ["frame-00000.exr", "frame-00001.exr", "sequence.json"]);
    for alone in [&["-o", "p.png"][..], &["-o", "p.exr"]] {
        let message = folder.expect(2, &[&["render", "v.svol", "--frame-format", "exr"], alone].concat());
        assert!(message.contains("--turntable"), "{message}");
    }
}

#[test]
fn key_frames_begin_and_end_with_their_cameras() {
    let folder = with_vessels();
    let camera = |x: f64| format!(r#"{{"eye": [{x}, -80, 50], "target": [10, 15, 20], "up": [0, 0, 1], "fov_y": 40}}"#);
    let keys = [(0, -60.0), (3, 90.0)].map(|(at, x)| format!(r#"{{"frame": {at}, "camera": {}}}"#, camera(x)));
    std::fs::write(folder.path("keys.json"), format!(r#"{{"keys": [{}]}}"#, keys.join(","))).expect("room");
    folder.expect(0, &[&["render", "v.svol", "--path", "keys.json", "-o", "f"], &SMALL[..]].concat());
    assert_eq!(names(&folder).len(), 5);
    for (frame, x) in [(0, -60.0), (3, 90.0)] {
        std::fs::write(folder.path("s.json"), format!(r#"{{"camera": {}}}"#, camera(x))).expect("room");
        folder
            .expect(0, &[&["render", "v.svol", "--scene", "s.json", "-o", "one.png", "--force"], &SMALL[..]].concat());
        let [one, of_path] = ["one.png".into(), format!("f/frame-{frame:05}.png")].map(|name| folder.path(&name));
        assert!(std::fs::read(one).expect("a picture") == std::fs::read(of_path).expect("a picture"), "{frame}");
    }
}

#[test]
fn paths_that_are_none_and_options_of_one_picture_are_refused() {
    let folder = with_vessels();
    std::fs::write(folder.path("keys.json"), r#"{"keys": []}"#).expect("room");
    let path = ["render", "v.svol", "-o", "f", "--path", "keys.json"];
    let message = folder.expect(2, &path);
    assert!(message.contains("keys.json") && message.contains("frame 0"), "{message}");
    folder.expect(2, &["render", "v.svol", "-o", "f", "--turntable", "0"]);
    for option in [
        &["--stats", "s.json"][..],
        &["--check"],
        &["--time-budget", "100"],
        &["--error-map", "e.png"],
        &["--work-map", "w.png"],
    ] {
        folder.expect(2, &[&["render", "v.svol", "-o", "f", "--turntable", "3"], option].concat());
    }
    assert!(!std::path::Path::new(&folder.path("f")).exists(), "nothing is made for what is refused");
}
