//! Every option of every command is tried by some test; and those that no other test tries.

use std::collections::BTreeSet;
use std::path::Path;

use crate::support;
use support::{Folder, json};

/// Options that no test gives, and why.
const NOT_TRIED: [(&str, &str); 1] = [("same-sampling", "of `bench --peers`, which installs another program")];

/// The commands, and the long options that the help of each names.
fn options_of_commands(folder: &Folder) -> Vec<(String, BTreeSet<String>)> {
    let help = folder.expect(0, &["--help"]);
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    // Descriptions that go on in the next line are indented further.
    let commands = commands.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names = commands.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help");
    let options = |name: &str| {
        let help = folder.expect(0, &[name, "--help"]);
        // `--option` or `-o, --option` at the beginning of a line.
        let first = help.lines().filter_map(|line| line.split_whitespace().find(|word| !word.ends_with(',')));
        let long = first.filter_map(|word| word.strip_prefix("--"));
        // `--decorate[=<WHEN>]`.
        let named = |word: &str| word.split(|c: char| !c.is_alphanumeric() && c != '-').next().map(str::to_owned);
        (name.to_owned(), long.filter_map(named).collect())
    };
    names.map(options).collect()
}

/// All tests that run the program, as text.
fn tests() -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let folders = [
        "tests/tests",
        "tests/tests/contracts",
        "tests/tests/drawn",
        "tests/src",
        "tools/supervol/tests/commands",
        "tools/viewer/tests/viewer",
        "tools/measure/tests",
    ];
    let files = folders.iter().flat_map(|folder| std::fs::read_dir(root.join(folder)).expect("a folder of tests"));
    let files = files.map(|file| file.expect("a file").path());
    let sources = files.filter(|path| path.extension().is_some_and(|ending| ending == "rs"));
    sources.map(|path| std::fs::read_to_string(path).expect("text")).collect()
}

#[test]
fn every_option_is_tried() {
    let (folder, tests) = (Folder::new(), tests());
    let commands = options_of_commands(&folder);
    let all: BTreeSet<&String> = commands.iter().flat_map(|(_, options)| options).collect();
    assert!(commands.len() > 12 && all.len() > 100 && all.contains(&"output".to_owned()), "{commands:?}");
    let is_tried = |option: &str| tests.contains(&format!("\"--{option}\""));
    let is_excused = |option: &str| NOT_TRIED.iter().any(|(name, _)| *name == option);
    for (command, options) in &commands {
        let untried: Vec<_> = options.iter().filter(|option| !is_tried(option) && !is_excused(option)).collect();
        assert!(untried.is_empty(), "supervol {command}: no test gives {untried:?}");
    }
    for (option, why) in NOT_TRIED {
        assert!(!is_tried(option), "--{option} is tried, although it is said not to be: {why}");
    }
}

/// A SEG-Y file of 2 inlines, 3 crosslines and 8 samples, floats. Sample k of a trace is 100 times the offset, plus
/// 10 times the inline, plus the crossline, plus k.
struct Segy {
    /// Bytes of inline, crossline and offset in the trace header, from 1.
    at: [usize; 3],
    offsets: Vec<i32>,
    format: i16,
    samples: i16,
    interval_us: i16,
    is_little: bool,
}

impl Default for Segy {
    fn default() -> Self {
        Self { at: [189, 193, 37], offsets: vec![0], format: 5, samples: 8, interval_us: 4000, is_little: false }
    }
}

impl Segy {
    fn write(&self, path: &str) {
        let short = |value: i16| if self.is_little { value.to_le_bytes() } else { value.to_be_bytes() };
        let long = |value: u32| if self.is_little { value.to_le_bytes() } else { value.to_be_bytes() };
        let mut file = vec![b' '; 3200];
        let mut header = [0u8; 400];
        for (at, value) in [(17, self.interval_us), (21, self.samples), (25, self.format)] {
            header[at - 1..at + 1].copy_from_slice(&short(value));
        }
        file.extend(header);
        for (line, offset) in (0..6).flat_map(|line| self.offsets.iter().map(move |&offset| (line, offset))) {
            let (inline, crossline) = (1 + line / 3, 1 + line % 3);
            let mut header = [0u8; 240];
            for (at, value) in self.at.into_iter().zip([inline, crossline, offset]) {
                header[at - 1..at + 3].copy_from_slice(&long(value as u32));
            }
            for (at, value) in [(115, self.samples), (117, self.interval_us)] {
                header[at - 1..at + 1].copy_from_slice(&short(value));
            }
            file.extend(header);
            let first = 100 * offset + 10 * inline + crossline;
            file.extend((first..first + 8).flat_map(|sample| long((sample as f32).to_bits())));
        }
        std::fs::write(path, file).expect("room");
    }
}

impl Folder {
    /// Output of `info` for a container that is built from this file with these options.
    fn built(&self, file: &str, options: &[&str]) -> serde_json::Value {
        self.expect(0, &[&["build", file, "-o", "v.svol", "--force"], options].concat());
        json(&self.expect(0, &["info", "v.svol", "--json"]))
    }

    fn refused(&self, file: &str, options: &[&str], words: &[&str]) {
        let message = self.expect(1, &[&["build", file, "-o", "refused.svol"], options].concat());
        words.iter().for_each(|words| assert!(message.contains(words), "no '{words}' in: {message}"));
        assert!(!Path::new(&self.path("refused.svol")).exists());
    }
}

/// Name of an option in the manifest.
fn reader_parameter(option: &str) -> String {
    option.replace("--", "reader_").replace('-', "_")
}

#[test]
fn survey_files_whose_headers_say_it_elsewhere_or_wrong() {
    let folder = Folder::new();
    let file = folder.path("a.sgy");
    let is_the_grid = |options: &[&str]| {
        let info = folder.built("a.sgy", options);
        assert_eq!(info["dims"], serde_json::json!([3, 2, 8]), "{options:?}");
        assert_eq!(info["value_range"], serde_json::json!([11.0, 30.0]), "{options:?}");
        assert_eq!(info["spacing"][2], 4.0, "{options:?}");
        for said in options.chunks(2) {
            assert_eq!(info["parameters"][reader_parameter(said[0])], said[1], "{options:?}");
        }
        assert!(info["parameters"]["reader_il_byte"].is_string(), "{options:?}");
    };
    Segy::default().write(&file);
    is_the_grid(&[]);
    Segy { at: [9, 21, 37], ..Segy::default() }.write(&file);
    folder.refused("a.sgy", &[], &["--il-byte 9 --xl-byte 21"]);
    is_the_grid(&["--il-byte", "9", "--xl-byte", "21"]);
    Segy { format: 0, ..Segy::default() }.write(&file);
    folder.refused("a.sgy", &[], &["--format N"]);
    is_the_grid(&["--format", "5"]);
    Segy { is_little: true, ..Segy::default() }.write(&file);
    folder.refused("a.sgy", &["--endian", "big"], &["big endian, as asked"]);
    is_the_grid(&["--endian", "little"]);
    Segy { samples: 0, interval_us: 0, ..Segy::default() }.write(&file);
    folder.refused("a.sgy", &[], &["samples per trace"]);
    is_the_grid(&["--samples", "8", "--interval", "4"]);
}

#[test]
fn gathers_of_several_offsets() {
    let folder = Folder::new();
    let gathers = Segy { offsets: vec![1, 2], ..Segy::default() };
    gathers.write(&folder.path("a.sgy"));
    folder.refused("a.sgy", &[], &["pre-stack gather", "--offset 1", "--offset stack"]);
    let range = |options: &[&str]| {
        let info = folder.built("a.sgy", options);
        assert_eq!(info["parameters"]["reader_offset"], options[1]);
        info["value_range"].clone()
    };
    assert_eq!(range(&["--offset", "2"]), serde_json::json!([211.0, 230.0]));
    assert_eq!(range(&["--offset", "stack"]), serde_json::json!([161.0, 180.0]));
    // Nobody gets a volume of which nothing is there.
    folder.refused("a.sgy", &["--offset", "7"], &["no trace has offset 7 (byte 37)", "1 to 2"]);
    Segy { at: [189, 193, 41], ..gathers }.write(&folder.path("a.sgy"));
    folder.refused("a.sgy", &["--offset", "2"], &["all have 0", "--offset-byte"]);
    assert_eq!(range(&["--offset", "2", "--offset-byte", "41"]), serde_json::json!([211.0, 230.0]));
}

#[test]
fn absent_voxels_and_what_coarser_levels_are() {
    let folder = Folder::new();
    let voxels: Vec<u8> = (0..70 * 70 * 70u32).map(|i| if i % 2 == 0 { 200 } else { 1 + (i % 97) as u8 }).collect();
    std::fs::write(folder.path("a.raw"), voxels).expect("room");
    let raw = ["--dims", "70,70,70", "--dtype", "u8", "--brick", "32"];
    let built = |options: &[&str]| folder.built("a.raw", &[&raw, options].concat());
    let plain = built(&[]);
    assert_eq!((&plain["value_range"][1], &plain["nodata"]), (&200.0.into(), &serde_json::Value::Null));
    let holed = built(&["--nodata", "200"]);
    assert_eq!((&holed["value_range"][1], &holed["nodata"]), (&97.0.into(), &200.0.into()));
    assert_eq!(holed["present_voxels"], 35 * 70 * 70);
    let said = ["reader_dims", "reader_dtype", "reader_nodata"].map(|name| &holed["parameters"][name]);
    assert_eq!(said, ["70,70,70", "u8", "200"]);
    assert_eq!(plain["parameters"]["reader_nodata"], serde_json::Value::Null);
    let dims = |info: &serde_json::Value| info["levels"][1]["dims"].clone();
    assert_eq!(dims(&built(&["--lod-axes", "xyz"])), serde_json::json!([35, 35, 35]));
    assert_eq!(dims(&built(&["--lod-axes", "xy"])), serde_json::json!([35, 35, 70]));
    // One of two voxels along x has the greatest value.
    let greatest = built(&["--reduce", "max", "--lod-axes", "xyz"]);
    assert_eq!(greatest["parameters"]["reduce"], "max");
    folder.expect(0, &["extract", "v.svol", "-o", "coarse.raw", "--level", "1"]);
    let coarse = std::fs::read(folder.path("coarse.raw")).expect("extract wrote it");
    assert!(coarse.len() == 35 * 35 * 35 && coarse.iter().all(|&voxel| voxel == 200));
}

#[test]
fn one_channel_or_one_level_of_what_a_file_holds() {
    let folder = Folder::new();
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementNumberOfChannels = 2\nElementType = MET_UCHAR\n\
                  ElementDataFile = a.raw\n";
    std::fs::write(folder.path("a.mhd"), header).expect("room");
    std::fs::write(folder.path("a.raw"), (0..128).map(|i| if i % 2 == 0 { 10 } else { i as u8 }).collect::<Vec<_>>())
        .expect("room");
    assert_eq!(folder.built("a.mhd", &["--channel", "1"])["value_range"], serde_json::json!([1.0, 127.0]));
    assert_eq!(folder.built("a.mhd", &["--channel", "0"])["value_range"], serde_json::json!([10.0, 10.0]));
    // OME-Zarr 0.4 with two levels, one chunk each.
    let group = |name: &str, text: &str| {
        let path = folder.path(name);
        std::fs::create_dir_all(Path::new(&path).parent().expect("a folder")).expect("room");
        std::fs::write(path, text).expect("room");
    };
    let scale = |n: u32| format!(r#"[{{"type": "scale", "scale": [{n}, {n}, {n}]}}]"#);
    let axes = ["z", "y", "x"].map(|name| format!(r#"{{"name": "{name}", "type": "space"}}"#)).join(", ");
    let levels = [0, 1].map(|l| format!(r#"{{"path": "{l}", "coordinateTransformations": {}}}"#, scale(1 + l)));
    let multiscales = format!(r#"{{"version": "0.4", "axes": [{axes}], "datasets": [{}]}}"#, levels.join(", "));
    group("a.zarr/.zgroup", r#"{"zarr_format": 2}"#);
    group("a.zarr/.zattrs", &format!(r#"{{"multiscales": [{multiscales}]}}"#));
    for (level, n, voxel) in [(0, 8, 'a'), (1, 4, 'b')] {
        let array = format!(
            r#"{{"zarr_format": 2, "shape": [{n}, {n}, {n}], "chunks": [{n}, {n}, {n}], "dtype": "|u1", "compressor": null,
                "fill_value": 0, "order": "C", "filters": null, "dimension_separator": "/"}}"#
        );
        group(&format!("a.zarr/{level}/.zarray"), &array);
        group(&format!("a.zarr/{level}/0/0/0"), &voxel.to_string().repeat(n * n * n));
    }
    assert_eq!(folder.built("a.zarr", &[])["dims"], serde_json::json!([8, 8, 8]));
    let coarse = folder.built("a.zarr", &["--source-level", "1"]);
    assert_eq!((&coarse["dims"], &coarse["value_range"][0]), (&serde_json::json!([4, 4, 4]), &98.0.into()));
}

/// Traces that are left out, and several at one place.
#[test]
fn traces_out_of_place() {
    let folder = Folder::new();
    Segy::default().write(&folder.path("a.sgy"));
    let plain = folder.built("a.sgy", &[]);
    // The file once more behind itself: each place has two traces.
    let bytes = std::fs::read(folder.path("a.sgy")).expect("it was written");
    std::fs::write(folder.path("b.sgy"), [&bytes[..], &bytes[3600..]].concat()).expect("room");
    folder.refused("b.sgy", &[], &["--on-duplicate first, last or mean", "--skip-trace"]);
    for which in ["first", "last", "mean"] {
        let found = folder.built("b.sgy", &["--on-duplicate", which]);
        assert_eq!((&found["dims"], &found["value_range"]), (&plain["dims"], &plain["value_range"]), "{which}");
        assert_eq!(found["parameters"]["reader_on_duplicate"], which);
    }
    folder.refused("b.sgy", &["--on-duplicate", "refuse"], &["--on-duplicate"]);
    let traces = (bytes.len() - 3600) / (240 + 4 * 8);
    let copies = format!("{}-{}", traces + 1, 2 * traces);
    let found = folder.built("b.sgy", &["--skip-trace", &copies]);
    assert_eq!((&found["dims"], &found["value_range"]), (&plain["dims"], &plain["value_range"]));
    assert_eq!(found["parameters"]["reader_skip_trace"], copies);
    folder.expect(2, &["build", "b.sgy", "--skip-trace", "0", "-o", "v.svol"]);
}

/// A file that needs options, and these options.
fn files_that_need_options(folder: &Folder) -> Vec<(&'static str, Vec<&'static str>)> {
    let words = |text: &'static str| text.split(' ').collect::<Vec<_>>();
    let elsewhere =
        Segy { at: [9, 21, 41], offsets: vec![1, 2], format: 0, samples: 0, interval_us: 0, is_little: true };
    elsewhere.write(&folder.path("a.sgy"));
    let voxels = |count: usize| (0..count).map(|i| (i / 7) as u8).collect::<Vec<_>>();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path(name), bytes).expect("room");
    write("a.raw", &voxels(10 + 12 * 10 * 8));
    std::fs::create_dir(folder.path("in")).expect("room");
    let header = "ObjectType = Image\nNDims = 4\nDimSize = 8 6 5 3\nElementNumberOfChannels = 2\nElementType = MET_UCHAR\n\
                  ElementDataFile = ../a.bin\n";
    write("in/a.mhd", header.as_bytes());
    write("a.bin", &voxels(8 * 6 * 5 * 3 * 2));
    let header = format!("{:<117}\n", "{'descr': '|u1', 'fortran_order': False, 'shape': (9, 8, 7), }");
    write("a.npy", &[&b"\x93NUMPY\x01\x00\x76\x00"[..], header.as_bytes(), &voxels(9 * 8 * 7)].concat());
    vec![
        (
            "a.sgy",
            words(
                "--il-byte 9 --xl-byte 21 --format 5 --endian little --samples 8 --interval 4 --offset 2 --offset-byte 41 \
                 --domain depth --unit ft",
            ),
        ),
        (
            "a.raw",
            words(
                "--dims 12,10,8 --dtype u8 --offset 10 --nodata 3 --spacing 1,1,2 --origin 5,6,7 --direction 0,1,0,-1,0,0,0,0,1 \
                 --unit mm",
            ),
        ),
        ("in/a.mhd", words("--allow-outside --frame 2 --channel 1")),
        ("a.npy", ["--axes", "x,y,z", "--nodata", "7", "--stored-values"].into()),
    ]
}

/// Options for volume files mean the same to every command that reads one.
#[test]
fn every_command_reads_files_alike() {
    let folder = Folder::new();
    for (file, options) in files_that_need_options(&folder) {
        let with = |command: &[&'static str]| [command, &[file], &options[..]].concat();
        folder.expect(0, &[&with(&["build"])[..], &["-o", "v.svol", "--force"]].concat());
        let of_container = json(&folder.expect(0, &["info", "v.svol", "--json"]));
        let of_file = json(&folder.expect(0, &[&with(&["info"])[..], &["--json"]].concat()));
        for key in ["dims", "dtype", "spacing", "origin", "direction", "axes", "nodata", "left_handed"] {
            assert!(!of_container[key].is_null() || key == "nodata", "{file}: {key}");
            assert_eq!(of_file[key], of_container[key], "{file}: {key}");
        }
        let equal = folder.expect(0, &with(&["verify", "v.svol", "--memory", "64MiB", "--source"]));
        assert!(equal.contains("are equal to the source's"), "{file}: {equal}");
        let written = |command: &[&str], name: &str| {
            folder.expect(0, &[command, &["-o", name, "--force"]].concat());
            std::fs::read(folder.path(name)).expect("it was written")
        };
        let cache = ["--cache", "kept", "--cache-limit", "1MiB"];
        let drawn = written(&["histogram", "v.svol"], "h.svg");
        assert!(written(&[&with(&["histogram"])[..], &cache].concat(), "h.svg") == drawn, "{file}");
        let size = ["--size", "16x12", "--backend", "cpu"];
        let drawn = written(&[&["render", "v.svol"][..], &size].concat(), "p.npy");
        assert!(written(&[&with(&["render"])[..], &cache, &size].concat(), "p.npy") == drawn, "{file}");
        let measured = folder.expect(0, &[&["bench", "--quick", "--pixels", "20"][..], &with(&["--volume"])].concat());
        let dims: Vec<_> = of_container["dims"].as_array().expect("three").iter().map(ToString::to_string).collect();
        assert!(measured.contains(&dims.join(" x ")), "{file}: {measured}");
    }
}

/// Nobody believes that something was understood which nothing came of.
#[test]
fn options_for_volume_files_belong_to_one() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "ramp", "--dims", "8,8,8", "-o", "v.svol", "--quiet"]);
    let container = ["v.svol", "--il-byte", "9"];
    for command in
        [&["info"][..], &["histogram"], &["render", "-o", "p.npy"], &["view"], &["bench", "--quick", "--volume"]]
    {
        let message = folder.expect(2, &[command, &container].concat());
        assert!(message.contains("expected a volume file, found a container"), "{command:?}: {message}");
    }
    let message = folder.expect(2, &["view", "--dims", "8,8,8", "--dtype", "u8"]);
    assert!(message.contains("name the file, too"), "{message}");
    for measured in
        [&["--quick"][..], &["--path", "orbit", "--virtual", "128"], &["--random-scenes", "1"], &["--leaping"]]
    {
        let message = folder.expect(2, &[&["bench"], measured, &["--frame", "1"]].concat());
        assert!(message.contains("expected --volume FILE"), "{measured:?}: {message}");
    }
    let message = folder.expect(2, &["verify", "v.svol", "--series", "3"]);
    assert!(message.contains("expected --source FILE"), "{message}");
}

/// Options of commands that make volumes, meshes and demonstrations.
#[test]
fn what_is_made_is_made_as_it_is_said() {
    let folder = Folder::new();
    let bounded = ["--codec", "wavelet", "--max-error", "2", "--lod-axes", "xy", "--reduce", "max"];
    let synth = ["synth", "marschner-lobb", "--dims", "40,40,40", "-o", "v.svol", "--brick", "16", "--quiet"];
    let quiet = folder.run(&[&synth[..], &bounded].concat());
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty(), "{quiet:?}");
    let info = json(&folder.expect(0, &["info", "v.svol", "--json"]));
    assert_eq!((&info["parameters"]["reduce"], &info["max_error"]), (&"max".into(), &2.0.into()));
    assert_eq!(info["levels"][1]["dims"], serde_json::json!([20, 20, 40]));
    assert!(folder.expect(2, &synth).contains("--force"));
    folder.expect(0, &[&synth[..], &["--force"]].concat());
    assert_eq!(json(&folder.expect(0, &["info", "v.svol", "--json"]))["max_error"], 0.0);

    let mesh = |options: &[&str]| {
        let fixed = ["mesh", "v.svol", "--iso", "128", "-o", "m.ply", "--force", "--quiet", "--memory", "64MiB"];
        folder.expect(0, &[&fixed[..], options].concat());
        std::fs::metadata(folder.path("m.ply")).expect("mesh wrote it").len()
    };
    let whole = mesh(&[]);
    let (part, coarse) = (mesh(&["--box", "0:20,:,:"]), mesh(&["--level", "1"]));
    assert!(part < whole && coarse < whole, "{whole}, {part} and {coarse} bytes");

    let drawn = folder.expect(0, &["histogram", "v.svol", "--kind", "ct"]);
    assert!(drawn.contains("ct"), "{drawn}");
    let frames =
        ["bench", "--quick", "--path", "orbit", "--scene", "vessels", "--max-error", "2/255", "--backend", "cpu"];
    let memory = ["--cache", "4MiB", "--host-memory", "64MiB", "--quiet"];
    assert!(folder.expect(0, &[&frames[..], &memory].concat()).contains("| vessels"));
}

#[test]
fn how_a_picture_is_made_and_what_it_may_take() {
    let folder = Folder::new();
    folder.expect(0, &["synth", "vessels", "--dims", "48,48,48", "-o", "v.svol", "--brick", "16"]);
    let drawn = |options: &[&str]| {
        let fixed =
            ["render", "v.svol", "-o", "p.npy", "--size", "40x30", "--backend", "cpu", "--level", "0", "--force"];
        folder.expect(0, &[&fixed[..], &["--stats", "s.json"], options].concat());
        let picture = std::fs::read(folder.path("p.npy")).expect("render wrote it");
        (json(&std::fs::read_to_string(folder.path("s.json")).expect("render wrote it")), picture)
    };
    let (usual, picture) = drawn(&[]);
    let (all, same) = drawn(&["--skipping", "off"]);
    let skipped = |stats: &serde_json::Value| stats["macro_cells_skipped"].as_u64().expect("a number");
    assert!(same == picture && skipped(&usual) > 0 && skipped(&all) == 0, "{} and {}", skipped(&usual), skipped(&all));
    let (portable, _) = drawn(&["--instructions", "portable"]);
    assert_eq!(portable["instructions"], "portable");
    let (small, same) = drawn(&["--gpu-memory", "128MiB"]);
    assert!(same == picture && small["gpu_budget_bytes"] == 128 << 20);
    let quiet = folder.run(&["render", "v.svol", "-o", "q.npy", "--size", "40x30", "--backend", "cpu", "--quiet"]);
    assert!(quiet.status.success() && quiet.stdout.is_empty() && quiet.stderr.is_empty(), "{quiet:?}");
}

#[test]
fn benches_of_paths_and_leaps() {
    let folder = Folder::new();
    let bench = |options: &[&str]| folder.expect(0, &[&["bench", "--quick"], options].concat());
    let frames = bench(&["--path", "orbit", "--scene", "vessels", "--frame-budget", "30", "--ahead", "5"]);
    assert!(frames.contains("handed over after 30 ms") && frames.contains("| vessels"), "{frames}");
    let computed = bench(&["--path", "orbit", "--virtual", "128"]);
    assert!(computed.contains("BRICKID 128 x 128 x 128"), "{computed}");
    let smooth = bench(&["--path", "orbit", "--virtual", "128", "--field", "waves"]);
    assert!(smooth.contains("WAVES 128 x 128 x 128"), "{smooth}");
    let leaps = bench(&["--leaping", "--scene", "vessels"]);
    assert!(leaps.contains("blocks, nearest ahead"), "{leaps}");
}
