//! Damaged containers (STABILITY, S41): truncated, with flipped bits, with corrected checksums. `verify` detects all
//! relevant damage, nothing panics, and every brick that is returned is the original one.

use std::os::unix::fs::FileExt;
use std::sync::Arc;

use rayon::prelude::*;
use supervol_format::container::header::PAGE_BYTES;
use supervol_format::container::toc::{self, ENTRY_BYTES};
use supervol_format::random::{Random, mix};
use supervol_format::{BrickKey, Container, VoxelType};
use supervol_preprocess::verify::verify;
use supervol_tests::faults::{CountingBytes, FailingBytes, ShortBytes};
use supervol_tests::fields::{Field, built, options};
use supervol_tests::forge::{Forge, reseal};

/// Number of flips over the whole file, and again over header, TOC entries, manifest and footer.
const FLIPS: u64 = 5000;
const SEED: u64 = 41;

/// A small container with every codec, absent voxels, uniform and absent bricks, and four levels. The bricks along x
/// are noise (raw), waves (zstd), one single voxel (rle), a constant (uniform), half absent, and completely absent.
/// This includes their two apron voxels on either side.
fn small_container() -> Forge {
    let field = Field::new([97, 16, 11], VoxelType::I16, |p| match p[0] {
        0..18 => (mix(p[0] ^ mix(p[1] ^ mix(p[2]))) % 65_536) as f64 - 32_768.0,
        18..30 => 3000.0 * ((p[1] as f64) * 0.4).sin() + 2000.0 * ((p[2] + p[0]) as f64 * 0.3).cos(),
        40 if p == [40, 8, 5] => 500.0,
        30..72 => 0.0,
        _ => 17.0,
    })
    .with_info(|info| info.nodata = Some(17.0));
    let built = built(&field, &options(16));
    Forge::new(std::fs::read(&built.path).expect("the container was just built"))
}

fn keys(container: &Container) -> impl Iterator<Item = BrickKey> + '_ {
    (0..container.pyramid().brick_count()).filter_map(|n| container.pyramid().key(n))
}

/// Opens damaged bytes and compares every returned brick with the original.
fn assert_nothing_wrong_is_handed_out(original: &Container, damaged: Vec<u8>, what: &str) {
    let Ok(container) = Container::from_source(Arc::new(damaged)) else { return };
    assert_eq!(container.descriptor(), original.descriptor(), "{what}");
    for key in keys(original) {
        let Ok(entry) = container.entry(key) else { continue };
        let expected = original.entry(key).expect("the original is whole");
        assert_eq!(entry, expected, "{what}: a wrong entry of {key}");
        if let Ok(voxels) = container.read_brick(key, &entry) {
            let right = original.read_brick(key, &expected).expect("the original is whole");
            assert!(voxels == right, "{what}: a wrong {key}");
        }
    }
}

/// A file on disk that is changed in place and read by `verify`.
struct OnDisk {
    path: tempfile::TempPath,
    file: std::fs::File,
}

impl OnDisk {
    fn new(bytes: &[u8]) -> Self {
        let (file, path) = tempfile::NamedTempFile::new().expect("a temporary file").into_parts();
        file.write_all_at(bytes, 0).expect("room for a small file");
        Self { path, file }
    }

    fn verifies(&self) -> bool {
        verify(&self.path, 1 << 26, &|_, _| ()).is_ok()
    }

    /// Whether `verify` accepts the file with these bytes written at an offset. The original bytes are restored
    /// afterwards.
    fn verifies_with(&self, original: &[u8], at: usize, changed: &[u8]) -> bool {
        self.file.write_all_at(changed, at as u64).expect("the file can be written");
        let accepted = self.verifies();
        self.file.write_all_at(&original[at..at + changed.len()], at as u64).expect("the file can be written");
        accepted
    }
}

#[test]
fn truncation_is_always_noticed() {
    let forge = small_container();
    let whole = forge.bytes.len();
    let sections = forge.original.sections();
    let mut cuts = vec![0, 1, 7, 8, PAGE_BYTES, 2 * PAGE_BYTES, whole - PAGE_BYTES, whole - 1];
    for offset in [sections.toc_offset, sections.manifest_offset, sections.toc_offset + 65_536] {
        cuts.push(offset as usize);
    }
    for key in keys(&forge.original) {
        let entry = forge.entry(key);
        cuts.extend([entry.offset, entry.offset + entry.record_bytes() / 2].map(|o| o as usize));
    }
    let cuts: Vec<usize> = cuts.iter().flat_map(|&c| [c.saturating_sub(1), c, c + 1]).filter(|&c| c < whole).collect();
    cuts.par_iter().for_each(|&cut| {
        let error = Container::from_source(Arc::new(forge.bytes[..cut].to_vec()))
            .err()
            .unwrap_or_else(|| panic!("{cut} of {whole} bytes open as a container"));
        assert!(!error.to_string().is_empty());
    });
    // Truncated after opening: readable data are right, unreadable data give an error.
    for cut in cuts.iter().step_by(7) {
        let short = ShortBytes { inner: forge.bytes.clone(), readable: *cut as u64 };
        assert!(Container::from_source(Arc::new(short)).is_err(), "opened with {cut} readable bytes");
    }
}

#[test]
fn flipped_bits_are_noticed_and_nothing_wrong_is_handed_out() {
    let forge = small_container();
    let (bytes, sections) = (&forge.bytes, forge.original.sections());
    let entries = forge.original.pyramid().brick_count() * ENTRY_BYTES as u64;
    let page = PAGE_BYTES as u64;
    let dense = [
        (0, 440),
        (page - 8, 8),
        (page, sections.toc_offset - page),
        (sections.toc_offset, entries),
        (sections.toc_offset + sections.toc_bytes - 8, 8),
        (sections.manifest_offset, sections.manifest_bytes),
        (bytes.len() as u64 - page, 440),
    ];
    let threads = rayon::current_num_threads() as u64;
    (0..threads * 4).into_par_iter().for_each(|part| {
        let disk = OnDisk::new(bytes);
        assert!(disk.verifies(), "the undamaged container is whole");
        let mut random = Random::new(SEED + part);
        for round in 0..2 * FLIPS / (threads * 4) + 1 {
            let at = if round % 2 == 0 {
                random.below(bytes.len() as u64)
            } else {
                let (start, length) = dense[random.below(dense.len() as u64) as usize];
                start + random.below(length)
            } as usize;
            let flipped = bytes[at] ^ 1 << random.below(8);
            let what = format!("byte {at} changed from {:#04x} to {flipped:#04x}, seed {SEED}", bytes[at]);
            assert!(!disk.verifies_with(bytes, at, &[flipped]), "{what}: not noticed");
            let mut damaged = bytes.clone();
            damaged[at] = flipped;
            assert_nothing_wrong_is_handed_out(&forge.original, damaged, &what);
        }
    });
}

/// Every bit of every TOC entry is protected by a rule, even if the page's checksum is corrected. The only exception is
/// the sign of a zero, which changes no value.
#[test]
fn every_bit_of_every_entry_is_under_a_rule() {
    let forge = small_container();
    let sections = forge.original.sections();
    let (toc, toc_bytes) = (sections.toc_offset as usize, sections.toc_bytes as usize);
    assert!(toc_bytes < toc::PAGE_BYTES, "one page");
    // One brick per level and kind.
    let mut bricks: Vec<BrickKey> = keys(&forge.original).collect();
    let kind = |key: &BrickKey| (key.lod(), forge.entry(*key).codec as u8, forge.entry(*key).absent);
    bricks.sort_by_key(kind);
    bricks.dedup_by_key(|key| kind(key));
    assert!(bricks.len() >= 6, "{bricks:?} are too few kinds");
    bricks.par_iter().for_each(|&key| {
        let disk = OnDisk::new(&forge.bytes);
        let at = forge.entry_at(key) - toc;
        for bit in 0..ENTRY_BYTES * 8 {
            let mut page = toc::uncut(forge.bytes[toc..toc + toc_bytes].to_vec());
            page[at + bit / 8] ^= 1 << (bit % 8);
            reseal(&mut page);
            let field = (bit / 64 * 8)..(bit / 64 * 8 + 8);
            let sign_of_zero =
                bit >= 40 * 8 && bit % 64 == 63 && forge.bytes[toc + at + field.start..toc + at + field.end] == [0; 8];
            let accepted = disk.verifies_with(&forge.bytes, toc, &toc::cut(page, toc_bytes));
            assert_eq!(accepted, sign_of_zero, "{key}: bit {} of byte {} of its entry", bit % 8, bit / 8);
        }
    });
}

/// Random damage with all page checksums corrected, also of header and footer: no answer is a panic.
#[test]
fn mended_damage_never_panics() {
    let forge = small_container();
    (0..3000u64).into_par_iter().for_each(|round| {
        let mut random = Random::new(SEED ^ round << 32);
        let mut damaged = Forge::new(forge.bytes.clone());
        let footer = damaged.bytes.len() - PAGE_BYTES;
        for _ in 0..=random.below(3) {
            let (at, value) = (random.below(440) as usize, random.next_u64() as u8);
            let value = if random.below(2) == 0 { damaged.bytes[at] ^ 1 << random.below(8) } else { value };
            // Header and footer get the same damage; otherwise they contradict each other and later code is not
            // reached.
            damaged.bytes[footer + at] = value;
            if at < 400 {
                damaged.bytes[at] = value;
            }
        }
        damaged.reseal_pages();
        let disk = OnDisk::new(&damaged.bytes);
        disk.verifies();
        let Ok(container) = Container::from_source(Arc::new(damaged.bytes)) else { return };
        for key in keys(&container).take(50) {
            if let Ok(entry) = container.entry(key) {
                let _ = container.read_brick(key, &entry);
            }
        }
    });
}

/// A header with the largest grid must be refused; computing its size must not overflow.
#[test]
fn the_largest_grid_is_refused_without_overflow() {
    let mut forge = small_container();
    let footer = forge.bytes.len() - PAGE_BYTES;
    for page in [0, footer] {
        let page = &mut forge.bytes[page..page + PAGE_BYTES];
        (0..3).for_each(|a| page[40 + 8 * a..48 + 8 * a].copy_from_slice(&(1u64 << 23).to_le_bytes()));
        page[32..36].copy_from_slice(&20u32.to_le_bytes());
        page[208..208 + 57].fill(2);
    }
    forge.reseal_pages();
    let error = Container::from_source(Arc::new(forge.bytes)).expect_err("no such container fits a file");
    assert!(error.to_string().contains("bricks"), "{error}");
}

#[test]
fn a_failed_read_names_what_was_read_and_harms_nothing_else() {
    let forge = small_container();
    let counting = Arc::new(CountingBytes::new(forge.bytes.clone()));
    let read_all = |container: &Container| -> Vec<Result<Vec<u8>, String>> {
        keys(&forge.original)
            .map(|key| {
                let entry = container.entry(key).map_err(|e| e.to_string())?;
                container.read_brick(key, &entry).map_err(|e| format!("{key}|{e}"))
            })
            .collect()
    };
    let right = read_all(&Container::from_source(counting.clone()).expect("the container is whole"));
    let reads = counting.reads.load(std::sync::atomic::Ordering::Relaxed);
    for fail_at in 0..reads {
        let failing = Arc::new(FailingBytes::new(forge.bytes.clone(), fail_at));
        let Ok(container) = Container::from_source(failing) else {
            assert!(fail_at < 3, "read {fail_at} is none that opening does");
            continue;
        };
        for (result, right) in read_all(&container).iter().zip(&right) {
            match result {
                Ok(voxels) => assert!(Ok(voxels) == right.as_ref(), "read {fail_at} failed: other voxels"),
                Err(message) => {
                    assert!(message.contains("injected read failure"), "{message}");
                    if let Some((key, error)) = message.split_once('|') {
                        assert!(error.contains(key), "the message does not name {key}: {error}");
                    }
                }
            }
        }
        assert_eq!(read_all(&container), right, "read {fail_at} failed once; later reads must succeed");
    }
}
