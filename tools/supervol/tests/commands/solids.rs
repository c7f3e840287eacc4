//! Volumes cut by solids, and what is under a pixel.

use crate::support;
use support::Folder;

const RENDER: [&str; 8] = ["render", "v.svol", "--size", "48x36", "--backend", "cpu", "--force", "--camera"];
const PYRAMID: &str = "v 2 2 2\nv 13 2 2\nv 8 13 2\nv 8 8 20\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

impl Folder {
    /// Output: standard error if the code is not 0.
    fn render(&self, code: i32, options: &[&str]) -> String {
        self.expect(code, &[&RENDER[..], &["front"], options].concat())
    }

    /// Messages on standard error about a picture with these cuts.
    fn said_of(&self, cuts: &[&str]) -> String {
        let cuts: Vec<&str> = cuts.iter().flat_map(|cut| ["--clip", cut]).collect();
        let done = self.run(&[&RENDER[..], &["front", "-o", "p.png"], &cuts].concat());
        assert!(done.status.success(), "{cuts:?}: {done:?}");
        String::from_utf8_lossy(&done.stderr).into_owned()
    }
}

#[test]
fn solids_are_in_the_scene_that_is_printed() {
    let folder = Folder::with_ramp();
    std::fs::write(folder.path("hull.obj"), PYRAMID).expect("a temporary folder has room");
    let cuts = ["--clip", "outside-sphere:8,8,8,4", "--clip", "mesh:hull.obj", "--clip", "1,0,0,3"];
    let printed = folder.render(0, &[&cuts[..], &["--print-scene", "-o", "a.npy"]].concat());
    let scene: serde_json::Value = support::json(&printed);
    let solids = &scene["clip"]["solids"];
    assert_eq!((&solids[0]["keep"], &solids[0]["sphere"]["radius"]), (&"outside".into(), &4.0.into()));
    assert!(solids[1]["mesh"].as_str().is_some_and(|path| path.ends_with("hull.obj") && path.len() > 10), "{solids}");
    // From another folder, it draws the same picture.
    std::fs::create_dir(folder.path("sub")).expect("a temporary folder has room");
    std::fs::write(folder.path("sub/scene.json"), printed).expect("a temporary folder has room");
    folder.expect(0, &["render", "v.svol", "--backend", "cpu", "--scene", "sub/scene.json", "-o", "b.npy"]);
    let [a, b] = ["a.npy", "b.npy"].map(|name| std::fs::read(folder.path(name)).expect("a picture"));
    assert!(a == b, "another picture");
    // Files of a scene lie beside it, and are not overwritten.
    std::fs::write(folder.path("sub/m.obj"), PYRAMID).expect("a temporary folder has room");
    let beside = r#"{"clip": {"solids": [{"mesh": "m.obj"}]}}"#;
    std::fs::write(folder.path("sub/beside.json"), beside).expect("a temporary folder has room");
    folder.expect(0, &["render", "v.svol", "--backend", "cpu", "--scene", "sub/beside.json", "-o", "c.npy"]);
}

/// Also where several slices are drawn, each with a scene of its own.
#[cfg(unix)]
#[test]
fn meshes_that_cut_are_not_written_over() {
    let folder = Folder::with_ramp();
    std::fs::write(folder.path("s.obj"), PYRAMID).expect("a temporary folder has room");
    std::os::unix::fs::symlink("s.obj", folder.path("s.png")).expect("a link");
    let cut = ["--clip", "mesh:s.obj", "-o", "s.png"];
    for slices in [&[][..], &["--slice", "z=4"], &["--slice", "z=4", "--slice", "x=8"]] {
        let refused = folder.expect(2, &[&["render", "v.svol", "--backend", "cpu", "--force"], slices, &cut].concat());
        assert!(refused.contains("s.png"), "{refused}");
        assert_eq!(std::fs::read(folder.path("s.obj")).expect("the mesh"), PYRAMID.as_bytes());
    }
}

#[test]
fn what_cannot_be_cut_with_is_refused_with_a_reason() {
    let folder = Folder::with_ramp();
    std::fs::write(folder.path("open.obj"), PYRAMID.replace("f 3 1 4\n", "")).expect("a temporary folder has room");
    let refused = |options: &[&str]| folder.render(2, &[options, &["-o", "p.png"]].concat());
    assert!(refused(&["--clip", "mesh:open.obj"]).contains("open edge"));
    assert!(refused(&["--clip", "mesh:none.ply"]).contains("none.ply"));
    assert!(refused(&["--clip", "ball:1,2,3,4"]).contains("sphere:X,Y,Z,R"));
    assert!(refused(&["--clip", "sphere:1,2,3,-4"]).contains("clip.solids[0].sphere.radius"));
    let nothing = folder.said_of(&["sphere:900,8,8,4"]);
    assert!(nothing.contains("clip box, planes and solids leave nothing"), "{nothing}");
    assert!(!nothing.contains("cuts nothing off"), "{nothing}");
}

#[test]
fn what_is_cut_with_to_no_effect_is_said() {
    let folder = Folder::with_ramp();
    std::fs::write(folder.path("hull.obj"), PYRAMID).expect("a temporary folder has room");
    // Seen from the front, a pixel takes more than half a voxel: a ball of one voxel is still found.
    for cuts in [&["sphere:8,8,8,4"][..], &["outside-sphere:8,8,8,1", "1,0,0,3", "mesh:hull.obj"]] {
        let said = folder.said_of(cuts);
        assert!(!said.contains("warning"), "{cuts:?}: {said}");
    }
    let cases: [(&[&str], &[&str]); 3] = [
        (&["1,0,0,-3"], &["the clip plane cuts nothing off"]),
        (&["outside-sphere:900,8,8,4", "0,1,0,4"], &["the clip solid cuts nothing off"]),
        (&["sphere:8,8,8,4", "1,0,0,3", "1,0,0,-9", "sphere:8,8,8,900"], &["clip plane 2 of 2", "clip solid 2 of 2"]),
    ];
    for (cuts, idle) in cases {
        let said = folder.said_of(cuts);
        assert_eq!(said.matches("cuts nothing off").count(), idle.len(), "{cuts:?}: {said}");
        assert!(idle.iter().all(|name| said.contains(name)), "{cuts:?}: {said}");
    }
}

#[test]
fn the_point_under_a_pixel_is_said() {
    let folder = Folder::with_ramp();
    // Seen from the front, along y, the surface 10 i + j = 75 lies at the edge of what is framed.
    let text = folder.render(0, &["--iso", "75", "--pick", "28,18", "--pick", "0,0"]);
    assert!(text.starts_with("pixel 28,18: surface 0\n  value  75\n  world  "), "{text}");
    assert!(text.ends_with("pixel 0,0: nothing visible\n"), "{text}");
    let text = folder.render(0, &["--iso", "75", "--pick", "28,18", "--json"]);
    let found: serde_json::Value = support::json(&text);
    let picked = &found[0]["picked"];
    let index: Vec<f64> = (0..3).filter_map(|a| picked["index"][a].as_f64()).collect();
    assert!((10.0 * index[0] + index[1] - 75.0).abs() < 1e-3, "{text}");
    let world: Vec<f64> = (0..3).filter_map(|a| picked["world"][a].as_f64()).collect();
    assert!((0..3).all(|a| (world[a] - [1.0, 1.0, 2.0][a] * index[a]).abs() < 1e-9), "{text}");
    assert_eq!((&picked["on"]["surface"], &picked["level"]), (&0.into(), &0.into()));
    let refused = folder.render(2, &["--pick", "48,0"]);
    assert!(refused.contains("48 x 36"), "{refused}");
    let refused = folder.render(2, &["--mode", "mean", "--pick", "3,4"]);
    assert!(refused.contains("mean"), "{refused}");
}
