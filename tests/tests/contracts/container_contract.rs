//! Contract of a built container, checked against the definitions in [`supervol_tests::oracle`]: every voxel type,
//! every brick size, odd dims, absent voxels, noise, constants.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use rayon::prelude::*;
use supervol_export::extract::{Extraction, extract};
use supervol_format::container::header::{PAGE_BYTES, VERSION, VERSION_BRICK_ERRORS, VERSION_EXACT, VERSION_QUANTIZED};
use supervol_format::container::reader::TAIL_BYTES;
use supervol_format::container::toc::{BrickEntry, ENTRIES_PER_PAGE};
use supervol_format::random::{Random, mix};
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickIndex, BrickKey, Container, Lod, VoxelType};
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::verify::verify;
use supervol_preprocess::{BuildOptions, Existing, MaxError};
use supervol_sources::VolumeSource;
use supervol_tests::faults::CountingBytes;
use supervol_tests::fields::{Built, Content, Field, built, options};
use supervol_tests::forge::{as_written_by, with_version};
use supervol_tests::oracle::Grid;

/// Random points at which each brick is sampled.
const POINTS: usize = 150;

/// Odd dims of different kinds for a brick size.
fn odd_dims(core: u32) -> [[u64; 3]; 4] {
    let more = u64::from(core) + 1;
    let one_more = if core <= 32 { [more; 3] } else { [more, 5, more] };
    [[1, 1, 97], [2, 2, 2], [31, 67, 127], one_more]
}

fn check(content: Content, dims: [u64; 3], voxel_type: VoxelType, core: u32) {
    let what = format!("{content:?} {dims:?} {voxel_type} bricks of {core}");
    let field = Field::of(content, dims, voxel_type);
    let built = built(&field, &options(core));
    verify(&built.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("{what}: {e}"));
    check_extraction(&field, &built, &what);
    check_levels(&built.container, None, &what);
}

/// Extracting level 0 returns the source's voxels.
fn check_extraction(field: &Field, built: &Built, what: &str) {
    let output = built.folder.path().join("level0.raw");
    let extraction = Extraction { lod: Lod(0), voxels: None, existing: Existing::Keep, memory_bytes: 1 << 26 };
    let (_, written_type) = extract(&built.container, &output, &extraction).unwrap_or_else(|e| panic!("{what}: {e}"));
    assert_eq!(written_type, field.info().voxel_type, "{what}");
    let extracted = std::fs::read(&output).expect("it was just written");
    assert!(extracted == field.bytes(), "{what}: level 0 is not the source");
}

/// Checks every brick of a container against `source`, or without one against the container's own level 0.
fn check_levels(container: &Container, source: Option<&Grid>, what: &str) {
    let levels = container.pyramid().levels().len();
    let grids: Vec<Grid> = (0..levels).map(|l| Grid::of_level(container, Lod(l as u8))).collect();
    let source = source.unwrap_or(&grids[0]);
    for (lod, grid) in grids.iter().enumerate() {
        for key in container.pyramid().keys_of(Lod(lod as u8)) {
            let entry = container.entry(key).unwrap_or_else(|e| panic!("{what}: {e}"));
            check_range(container, key, &entry, grid, what);
            check_macro_cells(container, key, &entry, grid, what);
            check_points(container, key, &entry, (&grids, source), what);
        }
    }
}

/// First and last core voxel of a brick.
fn core_ends(container: &Container, key: BrickKey) -> ([i64; 3], [i64; 3]) {
    let core = container.pyramid().core_box(key);
    (core.start.map(|v| v as i64), core.end.map(|v| v as i64 - 1))
}

/// The value range is exactly that of the voxels that interpolation reaches: the core and one voxel around it.
fn check_range(container: &Container, key: BrickKey, entry: &BrickEntry, grid: &Grid, what: &str) {
    let (first, last) = core_ends(container, key);
    let (core_range, _) = grid.range(first, last);
    let (reached, holes) = grid.range(first.map(|v| v - 1), last.map(|v| v + 1));
    assert_eq!(entry.absent, core_range.is_none(), "{what}: {key}: absent");
    assert_eq!(entry.has_holes, holes, "{what}: {key}: has holes");
    if entry.absent {
        assert!(entry.range.is_empty(), "{what}: {key}: range of an absent brick");
    } else {
        assert_eq!(Some((entry.range.min, entry.range.max)), reached, "{what}: {key}: range");
    }
}

/// A macro cell's range contains the voxels that it reaches, and is at most one quantum wider at either end.
fn check_macro_cells(container: &Container, key: BrickKey, entry: &BrickEntry, grid: &Grid, what: &str) {
    let mut record = vec![0; entry.record_bytes() as usize];
    container.read_at(entry.offset, &mut record).unwrap_or_else(|e| panic!("{what}: {e}"));
    let cells = container.macro_cells(key, entry, &record);
    let counts = container.pyramid().macro_cells(key);
    assert_eq!(cells.len(), counts.iter().product::<usize>());
    let (first, last) = core_ends(container, key);
    let quantum = entry.range.width() / 255.0 * (1.0 + 1e-9);
    for (i, cell) in cells.iter().enumerate() {
        let at = [i % counts[0], i / counts[0] % counts[1], i / counts[0] / counts[1]];
        let low: [i64; 3] = std::array::from_fn(|a| first[a] + 8 * at[a] as i64 - 1);
        let high: [i64; 3] = std::array::from_fn(|a| (low[a] + 9).min(last[a] + 1));
        let (reached, _) = grid.range(low, high);
        match reached.filter(|_| !entry.absent) {
            None => assert!(cell.is_empty(), "{what}: {key}: macro cell {at:?} holds {cell:?} and reaches nothing"),
            Some((min, max)) => {
                let tight =
                    cell.min <= min && max <= cell.max && min - cell.min <= quantum && cell.max - max <= quantum;
                assert!(tight, "{what}: {key}: macro cell {at:?} is {cell:?}, reaches {min} to {max}");
            }
        }
    }
}

/// At random points of the brick's region, the sample lies in the range and differs from the source by at most the bounds
/// of the brick and of its macro cell.
fn check_points(
    container: &Container,
    key: BrickKey,
    entry: &BrickEntry,
    (grids, source): (&[Grid], &Grid),
    what: &str,
) {
    let (first, last) = core_ends(container, key);
    let (own, finest) = (&grids[usize::from(key.lod().0)], &grids[0]);
    let scale = container.pyramid().level_at(key.lod()).scale;
    // Rounding error of our own interpolation: eight products and sums of values up to the magnitude.
    let slack = 32.0 * f64::EPSILON * finest.magnitude();
    let of_cells = container.read_cell_errors(key, entry).unwrap_or_else(|e| panic!("{what}: {e}"));
    let cells = container.pyramid().macro_cells(key);
    assert!(of_cells.iter().all(|&error| error <= entry.error), "{what}: {key}: {of_cells:?}");
    let mut random = Random::new(mix(key.bits()));
    for _ in 0..POINTS {
        // Points on a lattice of quarters hit the corners of both grids; other points lie anywhere.
        let on_lattice = random.below(2) == 0;
        let p: [f64; 3] = std::array::from_fn(|a| {
            let (low, width) = (first[a] as f64 - 0.5, (last[a] - first[a] + 1) as f64);
            // Multiples of 1/1024 are exact in the coordinates of every level.
            let steps = if on_lattice { 4.0 } else { 1024.0 };
            low + (random.unit() * (width * steps + 1.0)).floor() / steps
        });
        let Some(value) = own.sample(p) else { continue };
        let inside = entry.range.min - slack <= value && value <= entry.range.max + slack;
        assert!(inside, "{what}: {key}: {value} at {p:?} is outside {:?}", entry.range);
        let fine_p = std::array::from_fn(|a| (p[a] + 0.5) * scale[a] as f64 - 0.5);
        if !grids[..=usize::from(key.lod().0)].iter().enumerate().all(|(l, g)| present_at(container, g, l, fine_p)) {
            continue;
        }
        let (Some(stored), Some(exact)) = (finest.sample(fine_p), source.sample(fine_p)) else { continue };
        let beneath = entry.range_beneath;
        assert!(beneath.min - slack <= stored && stored <= beneath.max + slack, "{what}: {key}: {stored} beneath");
        let distance = (value - exact).abs();
        assert!(distance <= entry.error + slack, "{what}: {key}: {distance} at {p:?} exceeds {}", entry.error);
        let [x, y, z]: [usize; 3] = std::array::from_fn(|a| {
            // A point on a face belongs to the cells on both sides.
            (((p[a] - first[a] as f64 + 0.5) / 8.0).floor() as usize).min(cells[a] - 1)
        });
        let of_cell = of_cells[(z * cells[1] + y) * cells[0] + x];
        assert!(distance <= of_cell + slack, "{what}: {key}: {distance} at {p:?} exceeds {of_cell} of its macro cell");
    }
}

/// Whether level `lod` is present at a point of level 0. The bound is promised only where all levels in between are
/// present.
fn present_at(container: &Container, grid: &Grid, lod: usize, fine_p: [f64; 3]) -> bool {
    grid.sample(container.pyramid().levels()[lod].from_level_0(fine_p)).is_some()
}

fn check_all(core: u32, contents: &[Content]) {
    let cases: Vec<_> = VoxelType::ALL
        .iter()
        .flat_map(|&t| odd_dims(core).into_iter().flat_map(move |d| contents.iter().map(move |&c| (c, d, t))))
        .collect();
    cases.par_iter().for_each(|&(content, dims, voxel_type)| check(content, dims, voxel_type, core));
}

const SMALL: [Content; 4] = [Content::Constant, Content::Noise, Content::Holes, Content::Absent];

#[test]
fn bricks_of_16() {
    check_all(16, &Content::ALL);
}

#[test]
fn bricks_of_32() {
    check_all(32, &SMALL);
}

#[test]
fn bricks_of_64() {
    check_all(64, &SMALL);
}

#[test]
fn bricks_of_128() {
    check_all(128, &[Content::Smooth, Content::Holes]);
}

/// Values at the ends of their type: ranges, errors and the manifest must be right although widths overflow.
#[test]
fn extremes_of_every_type() {
    for voxel_type in VoxelType::ALL {
        let (low, high) = voxel_type.limits();
        let field = Field::new([37, 18, 17], voxel_type, move |p| match mix(p[0] ^ mix(p[1] ^ mix(p[2]))) % 5 {
            0 => low,
            1 => high,
            2 => 0.0,
            3 => low / 3.0,
            _ => high / 7.0,
        });
        let what = format!("extremes of {voxel_type}");
        let built = built(&field, &options(16));
        verify(&built.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("{what}: {e}"));
        check_extraction(&field, &built, &what);
        for key in (0..built.container.pyramid().brick_count()).filter_map(|n| built.container.pyramid().key(n)) {
            let entry = built.container.entry(key).unwrap_or_else(|e| panic!("{what}: {e}"));
            let mut record = vec![0; entry.record_bytes() as usize];
            built.container.read_at(entry.offset, &mut record).unwrap_or_else(|e| panic!("{what}: {e}"));
            for cell in built.container.macro_cells(key, &entry, &record) {
                assert!(entry.range.holds(cell), "{what}: {key}: macro cell {cell:?} leaves {:?}", entry.range);
            }
        }
        let manifest = built.container.manifest();
        assert!(manifest.percentiles.iter().flatten().all(|v| v.is_finite()), "{what}: {:?}", manifest.percentiles);
        assert_eq!(manifest.histogram.iter().sum::<u64>(), manifest.present_voxels, "{what}");
    }
}

/// Quantised voxels and rounded means: at every level, bricks state their distance from the source.
#[test]
fn bricks_of_moved_voxels_are_held_against_the_source() {
    let moved = [
        BuildOptions { lod_axes: LodAxes::Auto, ..options(16) },
        BuildOptions { max_error: MaxError::Percent(2.0), ..options(16) },
        BuildOptions { max_error: MaxError::Percent(0.1), lod_axes: LodAxes::Auto, ..options(16) },
    ];
    let types = [VoxelType::U8, VoxelType::I16, VoxelType::F32, VoxelType::F64];
    for (voxel_type, content) in types.into_iter().flat_map(|t| Content::ALL.map(|c| (t, c))) {
        for options in &moved {
            let what = format!("{content:?} of {voxel_type}, {:?}, {:?}", options.lod_axes, options.max_error);
            let field = Field::of(content, [67, 31, 45], voxel_type);
            let built = built(&field, options);
            let source = Grid {
                dims: field.info().dims.0.map(|n| n as usize),
                values: voxels_as_f64(voxel_type, &field.bytes()),
                absence: built.container.descriptor().absence,
            };
            check_levels(&built.container, Some(&source), &what);
        }
    }
}

/// A nodata value is compared in the volume's voxel type: 1e30 as a float differs from 1e30 as a double.
#[test]
fn nodata_is_rounded_to_the_voxel_type() {
    for nodata in [1e30, 0.1, f64::NAN, f64::INFINITY, -0.0] {
        let field = Field::new([40, 20, 18], VoxelType::F32, move |p| match p[2] {
            4..10 => nodata,
            10..14 => f64::NAN,
            z => 5.0 + (p[0] + z) as f64,
        });
        let field = field.with_info(|info| info.nodata = Some(nodata));
        let built = built(&field, &options(16));
        verify(&built.path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("nodata {nodata}: {e}"));
        let container = &built.container;
        assert_eq!(container.manifest().present_voxels, 40 * 20 * 8, "nodata {nodata}");
        for lod in 0..container.pyramid().levels().len() {
            let (range, _) = Grid::of_level(container, Lod(lod as u8)).range([0; 3], [39, 19, 17]);
            let (min, max) = range.expect("something is present");
            assert!(min >= 5.0 && max <= 61.0, "nodata {nodata}: level {lod} reaches {min} to {max}");
        }
        check_levels(container, None, &format!("nodata {nodata}"));
    }
}

/// Absent voxels in a steep field: the bound holds at all points where every level up to the brick's is present.
#[test]
fn error_bounds_hold_beside_holes() {
    for shift in 0..8 {
        let field = Field::new([70, 66, 68], VoxelType::F32, move |p| {
            let r2: i64 = p.iter().map(|&v| (v as i64 - 30 - shift).pow(2)).sum();
            match r2 {
                0..150 => f64::NAN,
                150..220 => ((r2 * 7919) % 1000) as f64,
                _ => 500.0,
            }
        });
        let built = built(&field, &options(16));
        check_levels(&built.container, None, &format!("hole at {shift}"));
        let boundary: Vec<Grid> = (0..built.container.pyramid().levels().len())
            .map(|l| Grid::of_level(&built.container, Lod(l as u8)))
            .collect();
        let coarsest = built.container.pyramid().coarsest();
        for lod in 1..=coarsest.0 {
            for key in built.container.pyramid().keys_of(Lod(lod)) {
                let entry = built.container.entry(key).expect("a built container is whole");
                check_lattice(&built.container, key, &entry, &boundary);
            }
        }
    }
}

/// Checks every point of a lattice of quarter voxels of level 0 near the absent voxels.
fn check_lattice(container: &Container, key: BrickKey, entry: &BrickEntry, grids: &[Grid]) {
    let (first, last) = core_ends(container, key);
    let (own, finest) = (&grids[usize::from(key.lod().0)], &grids[0]);
    let scale = container.pyramid().level_at(key.lod()).scale[0] as f64;
    let steps: [Vec<f64>; 3] = std::array::from_fn(|a| {
        let (low, high) = (first[a] as f64 - 0.5, last[a] as f64 + 0.5);
        let count = ((high - low) * scale) as usize;
        let at = |i: usize| low + (i as f64 + 0.25) / scale;
        (0..count).map(at).filter(|p| ((p + 0.5) * scale - 0.5 - 34.0).abs() < 20.0).collect()
    });
    for p in steps[2]
        .iter()
        .flat_map(|&z| steps[1].iter().flat_map(move |&y| [(y, z)]))
        .flat_map(|(y, z)| steps[0].iter().map(move |&x| [x, y, z]))
    {
        let Some(value) = own.sample(p) else { continue };
        let fine_p = p.map(|c| (c + 0.5) * scale - 0.5);
        let Some(exact) = finest.sample(fine_p) else { continue };
        let between = &grids[1..usize::from(key.lod().0)];
        let covered = between.iter().enumerate().all(|(l, g)| present_at(container, g, l + 1, fine_p));
        let distance = (value - exact).abs();
        if covered {
            assert!(distance <= entry.error + 1e-9, "{key}: {distance} at {p:?} exceeds {}", entry.error);
        }
    }
}

/// Remote sources get few requests: one to open the container, one for all entries that are wanted together.
#[test]
fn opening_takes_one_request_and_entries_come_together() {
    let field = Field::of(Content::Noise, [259, 150, 161], VoxelType::U8);
    let bytes = std::fs::read(&built(&field, &options(16)).path).expect("it was just built");
    let source = Arc::new(CountingBytes::new(bytes));
    let requests = || source.reads.load(Ordering::Relaxed);
    let container = Container::from_source(source.clone()).expect("it is whole");
    assert_eq!(requests(), 1);
    assert!(source.bytes.load(Ordering::Relaxed) <= TAIL_BYTES + PAGE_BYTES as u64);

    let pyramid = container.pyramid();
    let coarsest = pyramid.keys_of(pyramid.coarsest()).next().expect("a level has bricks");
    container.entry(coarsest).expect("its page lies at the end");
    assert_eq!(requests(), 1, "the entries of the coarsest level came with the tail");

    let finest: Vec<BrickKey> = pyramid.keys_of(Lod(0)).collect();
    assert!(finest.len() > ENTRIES_PER_PAGE, "several pages");
    container.read_entries_ahead(finest.iter().copied(), || true).expect("readable");
    assert_eq!(requests(), 2);
    finest.iter().for_each(|&key| assert!(container.entry(key).is_ok(), "{key}"));
    container.read_entries_ahead(finest.iter().copied(), || true).expect("readable");
    assert_eq!(requests(), 2, "they are in memory");
}

/// Versions 1 and 2: the last page of the TOC is full, and version 2 marks quantised voxels. Version 3 has one error bound
/// for each brick.
#[test]
fn containers_of_older_versions_are_read() {
    let field = Field::of(Content::Smooth, [90, 80, 70], VoxelType::I16);
    let versions = [
        (MaxError::Exact, VERSION_EXACT),
        (MaxError::Value(3.0), VERSION_QUANTIZED),
        (MaxError::Exact, VERSION_BRICK_ERRORS),
        (MaxError::Value(3.0), VERSION_BRICK_ERRORS),
    ];
    for (max_error, version) in versions {
        let new = built(&field, &BuildOptions { max_error, ..options(16) });
        let bytes = std::fs::read(&new.path).expect("it was just built");
        let path = new.folder.path().join("old.svol");
        std::fs::write(&path, as_written_by(&bytes, version)).expect("room");
        let old = verify(&path, 1 << 28, &|_, _| ()).unwrap_or_else(|e| panic!("version {version}: {e}"));
        assert_eq!((old.version(), new.container.version()), (version, VERSION));
        assert_eq!((old.descriptor(), old.manifest()), (new.container.descriptor(), new.container.manifest()));
        let keys = || (0..old.pyramid().levels().len()).flat_map(|lod| old.pyramid().keys_of(Lod(lod as u8)));
        for key in keys() {
            let [old_entry, new_entry] = [&old, &new.container].map(|container| container.entry(key).expect("whole"));
            assert_eq!((old_entry.range, old_entry.error), (new_entry.range, new_entry.error), "{key}");
            let of_cells = old.read_cell_errors(key, &old_entry).expect("readable");
            assert!(
                of_cells.iter().all(|&error| error == old_entry.error),
                "{key}: the brick's bound holds everywhere"
            );
        }
        if version == VERSION_BRICK_ERRORS {
            let error = Container::from_source(Arc::new(with_version(bytes.clone(), version))).map(|container| {
                let coarse = BrickKey::new(Lod(1), BrickIndex([0; 3]));
                container.entry(coarse).expect_err("a record of another length")
            });
            assert!(error.expect("the tables are those of version 4").to_string().contains("bytes of macro cells"));
            continue;
        }
        // A reader of one version refuses the TOC of the other.
        for (bytes, version) in [(std::fs::read(&path).expect("it is there"), VERSION), (bytes.clone(), version)] {
            let error = Container::from_source(Arc::new(with_version(bytes, version)))
                .expect_err("a table too long or too short");
            assert!(error.to_string().contains("a TOC of"), "{error}");
        }
    }
}
