//! `verify` on containers that break exactly one rule and have correct checksums: the message names the rule.

use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::container::checksum;
use supervol_format::container::manifest::Manifest;
use supervol_format::container::toc::BrickEntry;
use supervol_format::{BrickIndex, BrickKey, Lod, ValueRange, VoxelType};
use supervol_preprocess::BuildOptions;
use supervol_preprocess::verify::verify;
use supervol_tests::fields::{Content, Field, built, options};
use supervol_tests::forge::Forge;

/// A raw-coded container, so that voxels can be changed in place; one brick is uniform, one absent.
fn container() -> Forge {
    let field = Field::new([70, 20, 18], VoxelType::F32, |p| match p[0] {
        0..20 => 1000.0 + (p[0] * 31 + p[1] * 17 + p[2] * p[2]) as f64 * 0.37,
        20..50 => 12.0,
        _ => f64::NAN,
    });
    let built = built(&field, &BuildOptions { codec: CodecChoice::Only(Codec::Raw), ..options(16) });
    Forge::new(std::fs::read(&built.path).expect("the container was just built"))
}

fn key(lod: u8, brick: [u32; 3]) -> BrickKey {
    BrickKey::new(Lod(lod), BrickIndex(brick))
}

/// The message of `verify` for a forged container.
fn message(forge: &Forge) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("forged.svol");
    std::fs::write(&path, &forge.bytes).expect("room for a small file");
    match verify(&path, 1 << 26, &|_, _| ()) {
        Ok(_) => "accepted".into(),
        Err(error) => error.to_string(),
    }
}

fn assert_names(forge: &Forge, words: &[&str]) {
    let message = message(forge);
    assert!(words.iter().all(|w| message.contains(w)), "expected {words:?} in: {message}");
}

/// Breaks one field of one entry and checks the message.
fn assert_entry_rule(key: BrickKey, change: impl Fn(&mut BrickEntry), words: &[&str]) {
    let mut forge = container();
    let mut entry = forge.entry(key);
    change(&mut entry);
    forge.set_entry(key, &entry);
    assert_names(&forge, words);
}

const VARIED: [u32; 3] = [0, 0, 0];
const UNIFORM: [u32; 3] = [2, 0, 0];
const ABSENT: [u32; 3] = [4, 0, 0];

#[test]
fn the_container_itself_is_accepted() {
    let forge = container();
    assert_eq!(message(&forge), "accepted");
    assert_eq!(forge.entry(key(0, VARIED)).codec, Codec::Raw);
    assert!(forge.entry(key(0, UNIFORM)).uniform);
    assert!(forge.entry(key(0, ABSENT)).absent);
}

#[test]
fn value_ranges() {
    let name = key(0, VARIED).to_string();
    let words = ["value range", name.as_str()];
    assert_entry_rule(key(0, VARIED), |e| e.range.min += 0.01, &words);
    assert_entry_rule(key(0, VARIED), |e| e.range.min -= 0.01, &words);
    assert_entry_rule(key(0, VARIED), |e| e.range.max -= 0.01, &words);
    assert_entry_rule(key(0, VARIED), |e| e.range.max += 0.01, &words);
    assert_entry_rule(key(0, UNIFORM), |e| e.range.max += 1.0, &["value range"]);
    assert_entry_rule(key(0, ABSENT), |e| e.range = ValueRange { min: 0.0, max: 0.0 }, &["value range"]);
    assert_entry_rule(key(0, VARIED), |e| e.range.min = f64::NAN, &["value ranges", "no NaN", name.as_str()]);
    assert_entry_rule(key(0, VARIED), |e| e.range_beneath.max = f64::NAN, &["value ranges", "no NaN"]);
}

#[test]
fn ranges_beneath() {
    assert_entry_rule(key(1, VARIED), |e| e.range_beneath.max += 1.0, &["range beneath", "LOD 1"]);
    assert_entry_rule(key(1, VARIED), |e| e.range_beneath.min += 1.0, &["range beneath", "LOD 1"]);
    assert_entry_rule(key(0, VARIED), |e| e.range_beneath.min -= 1.0, &["range beneath", "LOD 0"]);
}

#[test]
fn flags() {
    assert_entry_rule(key(0, VARIED), |e| e.has_holes = !e.has_holes, &["flags", "LOD 0"]);
    assert_entry_rule(key(0, UNIFORM), |e| e.absent = true, &["flags"]);
    assert_entry_rule(key(0, UNIFORM), |e| e.has_holes = true, &["flags"]);
    assert_entry_rule(key(0, ABSENT), |e| e.has_holes = false, &["flags"]);
    // These contradict the entry itself.
    assert_entry_rule(key(0, VARIED), |e| e.uniform = true, &["TOC entry", "no fill"]);
    assert_entry_rule(key(0, VARIED), |e| e.absent = true, &["TOC entry", "absent"]);
    assert_entry_rule(key(0, UNIFORM), |e| e.uniform = false, &["TOC entry", "uniform"]);
}

#[test]
fn error_bounds() {
    let old = container().entry(key(1, VARIED)).error;
    assert!(old > 0.0, "the field is not linear");
    assert_entry_rule(key(1, VARIED), |e| e.error *= 0.999, &["error bound", "LOD 1"]);
    assert_entry_rule(key(1, VARIED), |e| e.error *= 1.001, &["error bound", "LOD 1"]);
    assert_entry_rule(key(2, VARIED), |e| e.error = old * 0.5, &["error", "LOD 2"]);
    assert_entry_rule(key(0, VARIED), |e| e.error = 0.1, &["error", "0 at level 0"]);
    assert_entry_rule(key(1, VARIED), |e| e.error = -1.0, &["error", "0 or more"]);
    assert_entry_rule(key(1, VARIED), |e| e.error = f64::NAN, &["error", "0 or more"]);
}

#[test]
fn fills() {
    // Another value is first detected in the neighbour's apron, which holds the old value.
    let other = |e: &mut BrickEntry| {
        e.fill = u64::from(13.0f32.to_bits());
        e.range = ValueRange { min: 13.0, max: 13.0 };
        e.range_beneath = e.range;
    };
    assert_entry_rule(key(0, UNIFORM), other, &["apron", "LOD 0"]);
    // Some readers use the range, others the fill: an entry in which they differ is refused.
    assert_entry_rule(
        key(0, UNIFORM),
        |e| e.fill = u64::from(13.0f32.to_bits()),
        &["TOC entry", "value range", "fill"],
    );
    // Bits above the voxel's four bytes.
    assert_entry_rule(key(0, UNIFORM), |e| e.fill |= 1 << 40, &["fill"]);
}

#[test]
fn macro_cells() {
    for (cell_byte, delta) in [(0, 1u8), (1, 255), (1, 1), (0, 255)] {
        let mut forge = container();
        let key = key(0, VARIED);
        let mut record = forge.record(key);
        // The second cell: its range lies inside the brick's range.
        let at = forge.entry(key).payload_bytes as usize + 2 + cell_byte;
        record[at] = record[at].wrapping_add(delta);
        forge.set_record(key, &record);
        assert_names(&forge, &["macro cell 1", "LOD 0"]);
    }
}

/// Bounds of macro cells are not too small, nor larger than they must be.
#[test]
fn error_bounds_of_macro_cells() {
    let key = key(1, VARIED);
    let container = container();
    let bounds = container.original.read_cell_errors(key, &container.entry(key)).expect("readable");
    let cell = bounds.iter().position(|&bound| bound > 0.0).expect("the field is not linear");
    for (delta, cell) in [(-1i8, cell), (-8, cell), (1, bounds.len() - 1)] {
        let mut forge = self::container();
        let mut record = forge.record(key);
        let at = record.len() - bounds.len() + cell;
        record[at] = record[at].wrapping_add_signed(delta);
        forge.set_record(key, &record);
        assert_names(&forge, &[&format!("error bound of macro cell {cell}"), "LOD 1"]);
    }
    // Damage is found by the checksum, before any rule.
    let mut forge = self::container();
    let at = forge.entry(key).offset as usize + forge.record(key).len() - 1;
    forge.bytes[at] ^= 1;
    assert_names(&forge, &["checksum of its record"]);
}

#[test]
fn aprons() {
    // A voxel on each side, edge and corner of the apron, between bricks and beyond the grid. The corners are used by
    // gradients, not by interpolation.
    let sides = (0..27).map(|i| [i % 3, i / 3 % 3, i / 9]).filter(|side| *side != [1; 3]);
    for (brick, side) in [VARIED, [1, 1, 1]].into_iter().flat_map(|brick| sides.clone().map(move |side| (brick, side)))
    {
        let key = key(0, brick);
        let mut forge = container();
        let extent = forge.original.shape(key).extent;
        let [x, y, z] = std::array::from_fn(|a| [side[a] % 2, extent[a] / 2, extent[a] - 1 - side[a] % 2][side[a]]);
        let at = 4 * (x + extent[0] * (y + extent[1] * z));
        let mut voxels = forge.original.read_brick(key, &forge.entry(key)).expect("the container is whole");
        voxels[at..at + 4].copy_from_slice(&1001.0f32.to_le_bytes());
        forge.set_voxels(key, &voxels);
        assert_names(&forge, &["apron", "LOD 0"]);
    }
}

#[test]
fn coarser_voxels() {
    let mut forge = container();
    let key = key(1, VARIED);
    let mut voxels = forge.original.read_brick(key, &forge.entry(key)).expect("the container is whole");
    let middle = 4 * (8 + 20 * (6 + forge.original.shape(key).extent[1] * 6));
    let old = f32::from_le_bytes(voxels[middle..middle + 4].try_into().expect("four bytes"));
    voxels[middle..middle + 4].copy_from_slice(&(old + 0.25).to_le_bytes());
    forge.set_voxels(key, &voxels);
    assert_names(&forge, &["mean of the finer level", "LOD 1"]);
}

#[test]
fn payloads_and_checksums() {
    let mut forge = container();
    let key = key(0, VARIED);
    let at = forge.entry(key).offset as usize + 100;
    forge.bytes[at] ^= 1;
    assert_names(&forge, &["checksum of its record", "LOD 0"]);

    let mut forge = container();
    let mut entry = forge.entry(key);
    entry.codec = Codec::Zstd;
    forge.set_entry(key, &entry);
    assert_names(&forge, &["zstd payload", "LOD 0"]);
}

#[test]
fn overlapping_and_unreachable_records() {
    // Two bricks of the same size share a record.
    let (first, second) = (key(0, [0, 0, 0]), key(0, [1, 0, 0]));
    let mut forge = container();
    let shared = forge.entry(first);
    assert_eq!(shared.record_bytes(), forge.entry(second).record_bytes());
    forge.set_entry(second, &BrickEntry { offset: shared.offset, checksum: shared.checksum, ..forge.entry(second) });
    assert_names(&forge, &["brick records", "a record that begins here"]);

    let mut forge = container();
    forge.insert_before_toc(b"sixteen bytes...");
    assert_names(&forge, &["brick records", "unreachable bytes"]);

    let mut forge = container();
    let entry = forge.entry(first);
    forge.set_entry(first, &BrickEntry { offset: entry.offset + 8, checksum: checksum(b""), ..entry });
    assert_names(&forge, &["brick records"]);
}

#[test]
fn reserved_bytes_and_unknown_codecs() {
    let unknown = u8::try_from(Codec::ALL.len()).expect("a tag is one byte");
    for (byte, value, word) in
        [(16, unknown, "newer"), (16, 99, "codec"), (17, 8, "flags"), (18, 1, "stored scale"), (20, 1, "reserved")]
    {
        let mut forge = container();
        let mut entry = forge.entry(key(0, VARIED)).encode();
        entry[byte] = value;
        forge.set_entry_bytes(key(0, VARIED), &entry);
        assert_names(&forge, &["TOC entry", word]);
    }
}

/// A container without any present voxel must obey every rule.
#[test]
fn nothing_is_a_container_too() {
    let field = Field::of(Content::Absent, [20, 3, 40], VoxelType::U8);
    let built = built(&field, &options(16));
    verify(&built.path, 1 << 26, &|_, _| ()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(built.container.manifest().value_range, None);
}

/// A manifest with a valid checksum that contradicts the voxels.
#[test]
fn false_manifests() {
    type Falsify = fn(&mut Manifest);
    let falsify: [(&str, Falsify); 8] = [
        ("value range", |m| m.value_range = Some(ValueRange { min: -1e9, max: 1e9 })),
        ("value range", |m| m.value_range = None),
        ("present voxels", |m| m.present_voxels += 1),
        ("percentiles", |m| m.percentiles.reverse()),
        ("percentiles", |m| m.percentiles.clear()),
        ("histogram", |m| m.histogram[0] += 1),
        ("distribution", |m| m.distribution.iter_mut().for_each(|d| d.distinct_values = Some(1))),
        ("errors of levels", |m| m.level_errors[1] *= 0.5),
    ];
    for (rule, falsify) in falsify {
        let mut forge = container();
        let mut manifest = forge.original.manifest().clone();
        falsify(&mut manifest);
        forge.set_manifest(&manifest);
        assert_names(&forge, &["manifest", rule]);
    }
}
