//! Pictures that others can check: records, proofs by `verify`, and fidelity.

use std::fs;
use std::path::Path;

use serde_json::Value;
use supervol_format::Container;
use supervol_format::container::identity::Covers;
use supervol_format::random::Random;
use supervol_runtime::render::accuracy::proof::{ProofOptions, Prover};
use supervol_scene::image::stored::{StoredPicture, StoredPixels, record_path};
use supervol_scene::image::{Image, ImageFormat};

use crate::support;
use support::{Folder, json};

const SAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/data/carp_ct.nii.gz");
const SMALL: [&str; 6] = ["--backend", "cpu", "--size", "32x24", "--force", "--decorate=off"];
const MESH: &str = "v 2 2 2\nv 13 2 2\nv 8 13 2\nv 8 8 20\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

impl Folder {
    fn draw(&self, name: &str, options: &[&str]) {
        self.expect(0, &[&["render", "v.svol", "-o", name][..], &SMALL, options].concat());
    }

    fn verify(&self, code: i32, name: &str, options: &[&str]) -> String {
        self.expect(code, &[&["verify", name, "--container", "v.svol"][..], options].concat())
    }

    fn record(&self, name: &str) -> Value {
        json(&self.stored(name).record.expect("a record"))
    }

    fn stored(&self, name: &str) -> StoredPicture {
        StoredPicture::read(Path::new(&self.path(name))).expect("a picture")
    }

    /// Writes a picture anew, with or without its record, after a change of its pixels.
    fn rewrite(&self, name: &str, to: &str, keep_record: KeepRecord, change: impl FnOnce(&mut [[u8; 3]])) {
        let StoredPicture { size: [width, height], pixels, record, .. } = self.stored(name);
        let StoredPixels::Rgb8(mut pixels) = pixels else { panic!("8-bit pixels") };
        change(&mut pixels);
        let channels = |[r, g, b]: [u8; 3]| [r, g, b, 255].map(|v| f32::from(v) / 255.0);
        let image = Image { width, height, pixels: pixels.into_iter().map(channels).collect() };
        let record = record.expect("a record");
        let text = move |_| record.clone();
        let kept: Option<supervol_scene::image::RecordText<'_>> = match keep_record {
            KeepRecord::Yes => Some(&text),
            KeepRecord::No => None,
        };
        image.write_with(Path::new(&self.path(to)), [0.0; 3], kept).expect("a file");
    }
}

#[derive(Clone, Copy)]
enum KeepRecord {
    Yes,
    No,
}

#[test]
fn a_picture_of_the_sample_is_proved_and_refuted_once_a_pixel_is_changed() {
    let folder = Folder::new();
    folder.expect(0, &["build", SAMPLE, "-o", "v.svol"]);
    folder.draw("a.png", &["--record"]);
    let proved = folder.verify(0, "a.png", &["--rays", "200"]);
    assert!(proved.contains("200 of 768 pixels") && proved.contains("requested error of 0.5"), "{proved}");
    assert!(proved.contains("stated error of"), "{proved}");
    // One pixel by three grey levels.
    let at = 12 * 32 + 16;
    let change = |pixels: &mut [[u8; 3]]| pixels[at][1] = pixels[at][1].checked_add(3).unwrap_or(pixels[at][1] - 3);
    folder.rewrite("a.png", "b.png", KeepRecord::Yes, change);
    let refuted = folder.verify(1, "b.png", &["--rays", "all"]);
    assert!(refuted.contains("1 of 768 pixels") && refuted.contains("pixel 16,12, green: found"), "{refuted}");
    assert!(refuted.contains("within 1"), "half a level is requested, half is rounding: {refuted}");
    // A sample that misses the pixel is told by the checksum of the pixels.
    let missed = folder.verify(1, "b.png", &["--rays", "5", "--seed", "1"]);
    assert!(missed.contains("not those that were written") && missed.contains("--rays all"), "{missed}");
    // Another program that keeps pixels and record changes nothing.
    folder.rewrite("a.png", "c.png", KeepRecord::Yes, |_| ());
    folder.verify(0, "c.png", &["--rays", "20"]);
}

#[test]
fn every_format_carries_the_same_record_and_is_proved() {
    let folder = Folder::with_ramp();
    let mut records = Vec::new();
    for name in ["a.png", "a.exr", "a.npy"] {
        folder.draw(name, &["--record"]);
        let mut record = folder.record(name);
        assert_eq!(record["pixels"]["format"].as_str(), Path::new(name).extension().and_then(|e| e.to_str()));
        record["pixels"] = Value::Null;
        records.push(record);
        folder.verify(0, name, &["--rays", "200"]);
    }
    assert!(records[0] == records[1] && records[1] == records[2], "{records:#?}");
    let record = &records[0];
    assert_eq!((&record["record_version"], &record["container"]["name"]), (&1.into(), &"v.svol".into()));
    assert_eq!((&record["converged"], &record["requested_grey_levels"]), (&true.into(), &0.5.into()));
    assert!(record["stated"]["largest_grey_levels"].is_f64() && record["scene"]["camera"].is_object(), "{record:#}");
    // Without the option, the record is there as well, but states no error, and NumPy files have none.
    folder.draw("b.png", &[]);
    assert_eq!(folder.record("b.png")["stated"], Value::Null);
    folder.verify(0, "b.png", &[]);
    folder.draw("b.npy", &[]);
    assert!(!record_path(Path::new(&folder.path("b.npy"))).exists());
    assert!(folder.verify(1, "b.npy", &[]).contains(".npy with --record"));
    // Floats that are a little off.
    let path = folder.path("a.npy");
    let mut bytes = fs::read(&path).expect("a picture");
    let at = bytes.len() - 16 * (32 * 24 - (12 * 32 + 16));
    let value = f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")) + 1.0 / 255.0;
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    fs::write(&path, bytes).expect("a file");
    let refuted = folder.verify(1, "a.npy", &["--rays", "all"]);
    assert!(refuted.contains("pixel 16,12, red"), "{refuted}");
}

#[test]
fn the_same_command_gives_the_same_bytes() {
    let folder = Folder::with_ramp();
    for name in ["a.png", "a.exr", "a.npy.json"] {
        let picture = name.trim_end_matches(".json");
        let [one, other] = [0, 1].map(|_| {
            folder.draw(picture, &["--record", "--threads", "2"]);
            fs::read(folder.path(name)).expect("a file")
        });
        assert!(one == other, "{name}");
    }
    // The place of the command is in no record.
    let text = folder.stored("a.png").record.expect("a record");
    assert!(!text.contains(&*folder.0.path().to_string_lossy()), "{text}");
}

#[test]
fn other_files_and_other_containers_are_refused_with_advice() {
    let folder = Folder::with_ramp();
    folder.draw("a.png", &[]);
    let told = folder.expect(2, &["verify", "a.png"]);
    assert!(told.contains("--container FILE"), "{told}");
    folder.expect(0, &["synth", "sphere", "--dims", "16,16,12", "-o", "w.svol"]);
    let told = folder.expect(1, &["verify", "a.png", "--container", "w.svol"]);
    assert!(told.contains("another container") && told.contains("v.svol") && told.contains("checksum"), "{told}");
    folder.rewrite("a.png", "b.png", KeepRecord::No, |_| ());
    assert!(folder.verify(1, "b.png", &[]).contains("no record"));
    let bytes = fs::read(folder.path("a.png")).expect("a picture");
    for length in [bytes.len() / 2, bytes.len() - 20] {
        fs::write(folder.path("c.png"), &bytes[..length]).expect("a file");
        assert!(folder.verify(1, "c.png", &[]).contains("cut short"), "{length}");
    }
    assert!(folder.verify(1, "v.svol", &[]).contains("expected a picture"));
    assert!(folder.verify(2, "none.png", &[]).contains("no such file"));
    folder.expect(2, &["verify", "a.png", "--container", "none.svol"]);
    // Several pictures: the others are still proved.
    let output = folder.run(&["verify", "b.png", "a.png", "--container", "v.svol"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("a.png: proved"), "{output:?}");
    let told = folder.verify(2, "a.png", &["--memory", "1KiB"]);
    assert!(told.contains("--memory"), "{told}");
}

#[test]
fn decorations_are_left_out_and_named() {
    let folder = Folder::with_ramp();
    let picture = ["render", "v.svol", "-o", "a.png", "--size", "160x120", "--decorate=on", "--backend", "cpu"];
    folder.expect(0, &picture);
    let runs = folder.record("a.png")["pixels"]["decorated_runs"].as_array().expect("a list").len();
    assert!(runs > 10, "{runs} runs");
    let proved = folder.verify(0, "a.png", &["--rays", "300"]);
    assert!(proved.contains("lie under decorations") && !proved.contains("300 of 19200"), "{proved}");
    let told = folder.expect(2, &["render", "v.svol", "-o", "b.png", "--record", "--turntable", "2"]);
    assert!(told.contains("--record"), "{told}");
}

#[test]
fn meshes_are_found_by_name_and_checksum() {
    let folder = Folder::with_ramp();
    for place in ["meshes", "elsewhere"] {
        fs::create_dir(folder.path(place)).expect("room");
    }
    fs::write(folder.path("meshes/hull.obj"), MESH).expect("room");
    folder.draw("a.png", &["--clip", "mesh:meshes/hull.obj"]);
    assert_eq!(folder.record("a.png")["scene"]["clip"]["solids"][0]["mesh"], "hull.obj");
    let told = folder.verify(1, "a.png", &[]);
    assert!(told.contains("hull.obj") && told.contains("no such file") && told.contains("--files"), "{told}");
    folder.verify(0, "a.png", &["--files", "meshes"]);
    fs::write(folder.path("elsewhere/hull.obj"), MESH.replace("13", "12")).expect("room");
    assert!(folder.verify(1, "a.png", &["--files", "elsewhere"]).contains("expected checksum"));
}

#[test]
fn pictures_that_claim_nothing_are_not_proved() {
    let folder = Folder::new();
    folder.expect(0, &["build", SAMPLE, "-o", "v.svol"]);
    let late = ["render", "v.svol", "-o", "a.png", "--backend", "cpu", "--size", "640x480", "--time-budget", "1"];
    folder.expect(0, &late);
    let told = folder.verify(1, "a.png", &[]);
    assert!(told.contains("claims no error") && told.contains("converged"), "{told}");
    // For a coarser level, the requested error holds against that level.
    folder.draw("b.png", &["--level", "2", "--record"]);
    assert!(folder.verify(0, "b.png", &["--rays", "100"]).contains("against level 2"));
}

#[test]
fn fidelity_says_what_is_reduced() {
    let folder = Folder::with_ramp();
    let along = |file: &str, dimension: &str| {
        let fidelity = json(&fs::read_to_string(folder.path(file)).expect("a file"));
        let dimensions = fidelity["dimensions"].as_array().expect("a list").clone();
        assert_eq!(dimensions.len(), 7);
        dimensions.into_iter().find(|d| d["dimension"] == dimension).expect("the dimension")
    };
    folder.draw("a.png", &["--level", "0", "--fidelity", "f.json"]);
    let fidelity = json(&fs::read_to_string(folder.path("f.json")).expect("a file"));
    assert_eq!((&fidelity["lossiness"], &fidelity["waiting_helps"]), (&"terminally_lossy".into(), &false.into()));
    let reduced: Vec<&Value> =
        fidelity["dimensions"].as_array().expect("a list").iter().filter(|d| d["is_reduced"] == true).collect();
    assert_eq!(reduced.len(), 1, "only the 8 bits: {reduced:#?}");
    let bits = along("f.json", "pixel_value_quantisation");
    assert_eq!((&bits["grey_levels"], &bits["is_bound"]), (&0.5.into(), &true.into()));
    assert_eq!(bits["reductions"][0]["cause"], "output_format");
    assert!(along("f.json", "sampling_density")["grey_levels"].as_f64().is_some_and(|error| error > 0.0));
    // Floats of the finest level lack nothing.
    folder.draw("a.exr", &["--level", "0", "--fidelity", "f.json"]);
    let fidelity = json(&fs::read_to_string(folder.path("f.json")).expect("a file"));
    assert_eq!((&fidelity["lossiness"], &fidelity["is_reduced"]), (&"never_lossy".into(), &false.into()));
    assert!(fidelity["in_words"].as_str().is_some_and(|words| words.contains("Nothing is reduced")), "{fidelity:#}");
    // A coarse level that was asked for, and an error.
    folder.expect(0, &["synth", "vessels", "--dims", "96,96,96", "-o", "v.svol", "--force"]);
    folder.draw("b.png", &["--mode", "dvr", "--level", "1", "--max-error", "8/255", "--fidelity", "g.json"]);
    let data = along("g.json", "data_resolution");
    assert_eq!(
        (&data["reductions"][0]["cause"], &data["lossiness"]),
        (&"requested".into(), &"terminally_lossy".into())
    );
    assert_eq!(data["reductions"][0]["magnitude"], "decimated volume x/2, y/2, z/2");
    assert!(data["is_bound"] == true && data["grey_levels"].as_f64().is_some_and(|error| error > 0.0), "{data:#}");
    assert_eq!(along("g.json", "sampling_density")["reductions"][0]["cause"], "requested");
    // Only fidelity is replaced by fidelity.
    fs::write(folder.path("notes.json"), "{}").expect("room");
    folder.expect(2, &["render", "v.svol", "-o", "c.png", "--fidelity", "notes.json"]);
    folder.expect(0, &["render", "v.svol", "-o", "c.png", "--size", "32x24", "--fidelity", "g.json"]);
}

/// Records come from outside: whatever stands in them, a proof ends with a result or an error.
#[test]
fn mangled_records_do_no_harm() {
    let folder = Folder::with_ramp();
    fs::write(folder.path("hull.obj"), MESH).expect("room");
    folder.draw("a.png", &["--record", "--clip", "mesh:hull.obj"]);
    let container = Container::open(Path::new(&folder.path("v.svol"))).expect("a container");
    let stored = folder.stored("a.png");
    let record = stored.record.clone().expect("a record");
    let options = ProofOptions { pixels: 2, folders: vec![folder.0.path().into()], ..ProofOptions::default() };
    let mut random = Random::new(42);
    let (mut read, mut proved) = (0, 0);
    for _ in 0..3000 {
        let mut bytes = record.clone().into_bytes();
        for _ in 0..1 + random.below(3) {
            let at = random.below(bytes.len() as u64) as usize;
            match random.below(4) {
                0 => bytes[at] = random.of(b"0123456789-.eE\"{}[],:"),
                1 => drop(bytes.drain(at..(at + random.below(9) as usize).min(bytes.len()))),
                2 => bytes.insert(at, b'9'),
                _ => bytes[at] = random.below(128) as u8,
            }
        }
        let mangled = StoredPicture { record: Some(String::from_utf8(bytes).expect("ASCII")), ..stored.clone() };
        if let Ok(prover) = Prover::new(&container, &mangled, &options) {
            read += 1;
            // Sizes and samples are those of the picture, so that no proof takes long.
            let is_small = prover.record().scene.samples_per_pixel.is_none_or(|samples| samples < 100);
            proved += u64::from(is_small && prover.prove(&|_| {}).is_ok());
        }
    }
    assert!(read > 100 && proved > 100, "{read} records were read, {proved} proofs ended");
    for path in ["/etc/hostname", "../hull.obj", "a/b.obj", ".."] {
        let text = record.replace("\"hull.obj\"", &format!("\"{path}\""));
        let outside = StoredPicture { record: Some(text), ..stored.clone() };
        let refused = Prover::new(&container, &outside, &options).expect_err("no such name").to_string();
        assert!(refused.contains("without folders"), "{path}: {refused}");
    }
}

#[test]
fn no_record_is_written_over_by_something_else() {
    let folder = Folder::with_ramp();
    let picture = ["render", "v.svol", "-o", "a.npy", "--size", "16x12", "--record"];
    fs::write(folder.path("a.npy.json"), "my notes").expect("room");
    assert!(folder.expect(2, &picture).contains("a.npy.json"));
    fs::remove_file(folder.path("a.npy.json")).expect("a file");
    folder.expect(0, &picture);
    folder.expect(0, &picture);
    assert_eq!(folder.stored("a.npy").format, ImageFormat::Npy);
}

/// Two containers with the same sizes, ranges and histogram, which differ by two voxels that changed places.
#[test]
fn the_identity_of_a_container_is_that_of_every_voxel() {
    let folder = Folder::with_ramp();
    let mut voxels = fs::read(folder.path("v.raw")).expect("voxels");
    voxels.swap(5, 2000);
    fs::write(folder.path("w.raw"), &voxels).expect("room");
    let shape = ["--dims", "16x16x12", "--dtype", "u8", "--spacing", "1,1,2", "--codec", "raw"];
    let identity = |raw: &str, to: &str| {
        folder.expect(0, &[&["build", raw, "-o", to, "--force"][..], &shape].concat());
        let container = Container::open(Path::new(&folder.path(to))).expect("a container");
        (container.identity().expect("it is readable"), container.file_bytes())
    };
    let [one, again, other] =
        [("v.raw", "a.svol"), ("v.raw", "b.svol"), ("w.raw", "a.svol")].map(|(raw, to)| identity(raw, to));
    assert_eq!(one, again, "a name is no content");
    assert!(one.1 == other.1 && one.0.checksum != other.0.checksum, "{one:?}, {other:?}");
    assert_eq!(one.0.covers, Covers::Content);
}
