//! Virtual volumes are valid containers, are cheap at any size, and give the same pictures as the same voxels stored.

use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use supervol_format::VoxelType;
use supervol_format::byte_source::ByteSource;
use supervol_format::container::toc::ENTRIES_PER_PAGE;
use supervol_format::container::validate::{check_brick, check_coverage};
use supervol_format::random::Random;
use supervol_runtime::render::frame::setting::{plan_host, streamer_for};
use supervol_runtime::render::options::Backend;
use supervol_runtime::stop::Stop;
use supervol_runtime::stream::state::BrickState;
use supervol_runtime::stream::streamer::Room;
use supervol_sources::computed::Computed;

use super::*;
use crate::volume::{build_options, finest, image_size, transfer_function};
use crate::{Context, Scale};

fn container(field: Field, dims: [u64; 3], core: u32) -> Container {
    let source = VirtualVolume::new(field, dims, core, Geometry::IDENTITY).expect("the dims are within the limits");
    Container::from_source(Arc::new(source)).expect("a computed container opens")
}

fn key(lod: u8, brick: [u32; 3]) -> BrickKey {
    BrickKey::new(Lod(lod), BrickIndex(brick))
}

/// All stored voxels, computed one by one.
fn voxels_one_by_one(field: Field, container: &Container, key: BrickKey) -> Vec<u8> {
    let pyramid = container.pyramid();
    let (core, dims) = (pyramid.core_box(key), pyramid.level_at(key.lod()).dims.0);
    let [nx, ny, nz] = pyramid.stored_extent(key);
    let at = |a: usize, i: usize| (core.start[a] + i as u64).max(2).min(dims[a] + 1) - 2;
    let places = (0..nx * ny * nz).map(|i| [at(0, i % nx), at(1, i / nx % ny), at(2, i / nx / ny)]);
    let values = places.map(|place| field.value(pyramid, key.lod(), place));
    match field {
        Field::BrickId => values.map(|v| v as u8).collect(),
        Field::Waves => values.flat_map(|v| (v as i16).to_le_bytes()).collect(),
    }
}

#[test]
fn every_brick_of_a_small_volume_keeps_the_rules_of_a_container() {
    let all_dims = [[100, 65, 17], [160, 33, 48], [64, 64, 64], [17, 1, 200]];
    for (field, dims) in [Field::BrickId, Field::Waves].into_iter().flat_map(|field| all_dims.map(|dims| (field, dims)))
    {
        let container = container(field, dims, 16);
        for entry in 0..container.pyramid().brick_count() {
            let key = container.pyramid().key(entry).expect("entries below the count have keys");
            let (entry, voxels) = check_brick(&container, key).expect("a computed brick keeps the rules");
            assert_eq!(voxels, voxels_one_by_one(field, &container, key), "{key} of {dims:?}");
            assert!(
                !entry.uniform
                    || field == Field::Waves
                    || container.pyramid().core_box(key).extent().iter().all(|&n| n <= 8),
                "{key}"
            );
        }
    }
    check_coverage(&container(Field::BrickId, [64; 3], 16)).expect("full bricks tile the file");
}

#[test]
fn a_volume_of_65_536_voxels_along_each_axis_opens_and_its_bricks_are_right() {
    for field in [Field::BrickId, Field::Waves] {
        let start = Instant::now();
        let container = container(field, [65_536; 3], 64);
        assert!(container.pyramid().brick_count() > 1_200_000_000);
        let coarsest = container.pyramid().coarsest().0;
        let last = [1023; 3];
        for key in [key(0, [0; 3]), key(0, last), key(0, [512, 3, 777]), key(1, [511, 0, 256]), key(coarsest, [0; 3])] {
            let (_, voxels) = check_brick(&container, key).expect("a computed brick keeps the rules");
            assert_eq!(voxels, voxels_one_by_one(field, &container, key), "{key}");
        }
        // Five bricks with eight children each, on ten pages. Several seconds would mean that whole pages are sealed.
        // Waves are excluded: each sealed brick takes longer.
        assert!(field == Field::Waves || start.elapsed().as_secs_f64() < 5.0, "{:?}", start.elapsed());
    }
}

/// The interpolated field of a level, at a point in index coordinates of level 0.
fn between(pyramid: &Pyramid, lod: Lod, place: [f64; 3]) -> f64 {
    let level = pyramid.level_at(lod);
    let along: [[(u64, f64); 2]; 3] = std::array::from_fn(|a| {
        let last = level.dims.0[a] as f64 - 1.0;
        let at = ((place[a] + 0.5) / level.scale[a] as f64 - 0.5).clamp(0.0, last);
        let first = at.floor().min((last - 1.0).max(0.0));
        [(first as u64, first + 1.0 - at), ((first + 1.0).min(last) as u64, at - first)]
    });
    let corners = (0..8usize).map(|i| [0, 1, 2].map(|a| along[a][i >> a & 1]));
    corners.map(|c| c[0].1 * c[1].1 * c[2].1 * Field::Waves.value(pyramid, lod, c.map(|(v, _)| v))).sum()
}

/// Error bounds of coarse waves hold at random points and in the corners, and are nearly reached somewhere.
#[test]
fn the_errors_of_waves_are_bounds() {
    let container = container(Field::Waves, [320, 160, 96], 16);
    let pyramid = container.pyramid();
    let mut random = Random::new(5);
    for lod in (1..=pyramid.coarsest().0).map(Lod) {
        let mut largest_share = 0.0f64;
        for _ in 0..20_000 {
            let place =
                pyramid.level_at(Lod::FINEST).dims.0.map(|n| (n as f64 * random.unit()).floor() + random.unit() - 0.5);
            let level = pyramid.level_at(lod);
            let brick = [0, 1, 2].map(|a| ((place[a] + 0.5) as u64 / level.scale[a] / 16) as u32);
            let error = container.entry(BrickKey::new(lod, BrickIndex(brick))).expect("readable").error;
            let off = (between(pyramid, lod, place) - between(pyramid, Lod::FINEST, place)).abs();
            assert!(off <= error, "level {}: {off} at {place:?} where {error} is stated", lod.0);
            largest_share = largest_share.max(off / error);
        }
        assert!(largest_share > 0.2, "level {}: {largest_share} of what is stated", lod.0);
    }
}

#[test]
fn neighbours_levels_and_places_off_by_a_power_of_two_have_other_values() {
    let here = key(3, [1000, 2000, 3000]);
    for shift in 0..19 {
        for axis in 0..3 {
            let mut place = here.brick().0;
            place[axis] ^= 1 << shift;
            assert_ne!(number(key(3, place)), number(here), "bit {shift} of axis {axis}");
        }
    }
    for lod in 0..20 {
        assert!(lod == 3 || number(key(lod, here.brick().0)) != number(here), "level {lod}");
    }
}

#[test]
fn its_picture_is_that_of_the_same_voxels_stored() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
    let dims = [256, 256, 256];
    let (computed, source) = VirtualVolume::open(Field::BrickId, dims, 32).expect("the dims are within the limits");
    let voxels = Computed::new(dims, VoxelType::U8, |voxel| f64::from(value(32, Lod::FINEST, voxel)));
    let stored = Volume::build(&context, "stored", &voxels, &build_options(32)).expect("it can be built");
    assert_eq!(computed.facts.value_range, stored.facts.value_range);
    let tf = transfer_function(20.0, &[(0.0, [0.1, 0.2, 0.9], 0.02), (249.0, [1.0, 0.8, 0.1], 0.6)]);
    let members = [stored.outside(), image_size(40, 30), tf];
    let members: Vec<&str> = members.iter().map(String::as_str).collect();
    let scene = stored.scene(&members).expect("the scene is valid");
    let picture = |volume: &Volume| volume.finest(&scene, Backend::Cpu).expect("it converges");
    assert!(picture(&computed) == picture(&stored), "pictures of the same voxels differ");
    assert!(source.records() >= 512 && source.reads() > 3);
}

#[test]
fn entries_of_what_is_wanted_first_are_read_first_and_no_more_when_it_is_to_stop() {
    let container = container(Field::BrickId, [65_536; 3], 64);
    let pyramid = container.pyramid();
    // 150 pages, the last one first.
    let wanted: Vec<BrickKey> =
        (0..150).rev().map(|page| pyramid.key(page * ENTRIES_PER_PAGE as u64).expect("a brick")).collect();
    let known = |container: &Container| wanted.iter().filter(|&&key| container.has_entry(key)).count();
    container.read_entries_ahead(wanted.iter().copied(), || false).expect("readable");
    let first = known(&container);
    assert!((1..wanted.len()).contains(&first), "one request at least, and not all: {first}");
    assert!(wanted[..first].iter().all(|&key| container.has_entry(key)), "those that are wanted first");
    container.read_entries_ahead(wanted.iter().copied(), || true).expect("readable");
    assert_eq!(known(&container), wanted.len());
}

/// A source whose table of contents times out after it has been opened.
struct Stumbling {
    volume: VirtualVolume,
    is_open: AtomicBool,
    stumbles: AtomicU64,
}

impl ByteSource for Stumbling {
    fn len(&self) -> io::Result<u64> {
        self.volume.len()
    }

    fn read_exact_at(&self, offset: u64, buffer: &mut [u8]) -> io::Result<()> {
        if offset >= self.volume.sections.toc_offset && self.is_open.load(Ordering::Relaxed) {
            self.stumbles.fetch_add(1, Ordering::Relaxed);
            return Err(io::ErrorKind::TimedOut.into());
        }
        self.volume.read_exact_at(offset, buffer)
    }
}

#[test]
fn a_table_of_contents_that_times_out_costs_a_deadline_no_brick() {
    let volume = VirtualVolume::new(Field::BrickId, [400; 3], 16, Geometry::IDENTITY).expect("within the limits");
    let source = Arc::new(Stumbling { volume, is_open: AtomicBool::new(false), stumbles: AtomicU64::new(0) });
    let container = Container::from_source(source.clone()).expect("it opens");
    let volume = Volume::of("stumbling", Arc::new(container));
    let tf = transfer_function(20.0, &[(0.0, [0.1, 0.2, 0.9], 0.02), (249.0, [1.0, 0.8, 0.1], 0.6)]);
    let scene = volume.scene(&[&volume.outside(), &image_size(40, 30), &tf]).expect("the scene is valid");
    let options = finest(Backend::Cpu);
    let plan = plan_host(&volume.container, &scene, &options).expect("two gigabytes are enough");
    let mut streamer = streamer_for(&volume.container, &scene, &options, plan);
    source.is_open.store(true, Ordering::Relaxed);
    let wanted = [[0; 3], [24; 3]].map(|place| supervol_runtime::stream::field::Field::FIRST.brick(key(0, place)));
    let room = |deadline| Room { bricks: usize::MAX, stop: Stop::at(deadline), patience: None };

    let late = streamer.fetch(&wanted, room(Some(Instant::now()))).expect("there is room");
    assert!(source.stumbles.load(Ordering::Relaxed) > 0, "the finest level's entries did not come with the tail");
    assert_eq!((late.is_progress(), late.left), (false, wanted.len()), "they wait");
    assert!(wanted.iter().all(|&key| streamer.states().state(key) == BrickState::Unknown), "and have not failed");
    // Without a deadline, a page that fails three times has failed for good.
    let failed = streamer.fetch(&wanted, room(None)).expect("there is room");
    assert_eq!(failed.answered.len(), wanted.len());
}
