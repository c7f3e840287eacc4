//! The comparison without a peer, and with a missing one. No network.

use std::path::Path;
use std::time::Duration;

use super::options::Sizes;
use super::*;
use crate::context::Scale;

const CARP: &[u8] = include_bytes!("../../../../tests/data/carp_ct.nii.gz");

fn compare_small(options: &Options) -> Comparison {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
    compare(&context, options).expect("our own side works")
}

fn alone() -> Options {
    let run = Run { threads: 2, same_sampling: SameSampling::No, sizes: Sizes::of(Scale::Small) };
    Options {
        peer: None,
        carp_nifti_gz: CARP,
        subject: Subject::Scenes(Vec::new()),
        looks: Looks::Both,
        edge: None,
        run,
    }
}

#[test]
fn our_own_side_is_measured_without_a_peer() {
    let comparison = compare_small(&alone());
    assert!(comparison.peer.is_none());
    let defaults: Vec<&Row> = comparison.rows.iter().filter(|row| row.ratio_to_default == 1.0).collect();
    let cases: Vec<_> = defaults.iter().map(|row| (row.scene.as_str(), row.shading)).collect();
    let all = ["marschner-lobb", "vessels"].map(|scene| [(scene, "unshaded"), (scene, "shaded")]).concat();
    assert_eq!(cases, all);
    for row in defaults {
        // The default promises half a grey level.
        let error = row.from_reference.expect("the volume is small");
        assert!(error.linf <= 0.5 && error.p999 <= error.linf && error.rmse <= error.p999, "{row:?}");
        assert_eq!((row.error_pixels, row.reference_capped_pieces), (300, 0));
        assert!(row.cost.cpu.median_ms > 0.0 && row.from_default.linf == 0.0, "{row:?}");
    }
}

#[test]
fn a_peer_without_python_is_said_and_the_rest_goes_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let nowhere = PeerOptions { python: "/nowhere/python3".into(), environment: folder.path().join("environment") };
    let subject = Subject::Scenes(vec!["vessels".into()]);
    let comparison = compare_small(&Options { peer: Some(nowhere), subject, ..alone() });
    let peer = comparison.peer.clone().expect("the peer was asked for");
    assert!(!peer.measured && peer.versions.is_none());
    let why = peer.why_not.expect("a reason");
    assert!(why.starts_with("no Python: /nowhere/python3: cannot be started"), "{why}");
    assert!(comparison.rows.iter().all(|row| row.program == ours::NAME) && comparison.rows.len() >= 2);

    report::write(&comparison, "supervol bench --peers", folder.path()).expect("a folder with room");
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("it was written");
    assert!(read("peers.md").contains("VTK not measured: no Python"), "{}", read("peers.md"));
    let json: serde_json::Value = serde_json::from_str(&read("peers.json")).expect("JSON");
    assert_eq!(json["peer"]["measured"], false);
    assert_eq!(json["command"], "supervol bench --peers");
    assert_eq!(json["rows"].as_array().map(Vec::len), Some(comparison.rows.len()));
    assert!(folder.path().join("vessels-shaded-supervol-default.png").exists());
}

#[test]
fn a_scene_that_is_none_is_a_wrong_command() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
    let error = compare(&context, &Options { subject: Subject::Scenes(vec!["teapot".into()]), ..alone() }).err();
    assert!(matches!(&error, Some(ChartError::Command(text)) if text.contains("teapot") && text.contains("vessels")));
}

/// All ways in which a started program can end.
#[cfg(unix)]
#[test]
fn programs_end_in_time_or_are_ended() {
    let sh = |script: &str, limit| environment::run(Path::new("/bin/sh"), &["-c", script], limit);
    let long = Duration::from_secs(60);
    assert_eq!(sh("echo good", long).as_deref(), Ok("good\n"));
    let why = sh("echo first >&2; echo last words >&2; exit 3", long).expect_err("it fails");
    assert!(why.contains("last words") && !why.contains("first"), "{why}");
    // More output than a pipe holds.
    assert!(sh("yes | head -c 1000000", long).is_ok_and(|said| said.len() <= 4096));
    let begun = std::time::Instant::now();
    let why = sh("exec sleep 50", Duration::from_millis(200)).expect_err("it is too slow");
    assert!(why.contains("not finished") && begun.elapsed() < Duration::from_secs(20), "{why}");
}

/// A Python that starts but cannot make environments.
#[cfg(unix)]
#[test]
fn a_python_without_environments_is_said() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let python = folder.path().join("python3");
    std::fs::write(&python, "#!/bin/sh\n[ \"$1\" = --version ] || { echo 'No module named venv' >&2; exit 1; }\n")
        .expect("a folder with room");
    std::fs::set_permissions(&python, std::fs::Permissions::from_mode(0o755)).expect("our own file");
    let options = PeerOptions { python, environment: folder.path().join("environment") };
    let peer = vtk::Peer::prepare(&options, &|_| ()).into_report();
    let why = peer.why_not.expect("a reason");
    assert!(why.contains("python3-venv") && why.contains("No module named venv"), "{why}");
}
