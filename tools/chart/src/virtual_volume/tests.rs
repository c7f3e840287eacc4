//! BRICKID is a true container, cheap at any size, and shows what the same voxels show when they are stored.

use std::time::Instant;

use supervol_format::container::validate::{check_brick, check_coverage};
use supervol_preprocess::source::computed::Computed;
use supervol_runtime::frame::Backend;

use super::*;
use crate::volume::{build_options, image_size, transfer_function};
use crate::{Context, Scale};

fn container(dims: [u64; 3], core: u32) -> Container {
    let source = BrickId::new(dims, core, Geometry::IDENTITY).expect("the dims are within the limits");
    Container::from_source(Arc::new(source)).expect("a computed container opens")
}

fn key(lod: u8, brick: [u32; 3]) -> BrickKey {
    BrickKey::new(Lod(lod), BrickIndex(brick))
}

/// Every stored voxel, asked one by one.
fn voxels_one_by_one(container: &Container, key: BrickKey) -> Vec<u8> {
    let pyramid = container.pyramid();
    let (core, dims) = (pyramid.core_box(key), pyramid.level_at(key.lod()).dims.0);
    let [nx, ny, nz] = pyramid.stored_extent(key);
    let at = |a: usize, i: usize| (core.start[a] + i as u64).max(2).min(dims[a] + 1) - 2;
    let edge = pyramid.layout().core() as u64;
    (0..nx * ny * nz).map(|i| value(edge, key.lod(), [at(0, i % nx), at(1, i / nx % ny), at(2, i / nx / ny)])).collect()
}

#[test]
fn every_brick_of_a_small_volume_keeps_the_rules_of_a_container() {
    for dims in [[100, 65, 17], [160, 33, 48], [64, 64, 64], [17, 1, 200]] {
        let container = container(dims, 16);
        for entry in 0..container.pyramid().brick_count() {
            let key = container.pyramid().key(entry).expect("entries below the count have keys");
            let (entry, voxels) = check_brick(&container, key).expect("a computed brick keeps the rules");
            assert_eq!(voxels, voxels_one_by_one(&container, key), "{key} of {dims:?}");
            assert!(!entry.uniform || container.pyramid().core_box(key).extent().iter().all(|&n| n <= 8), "{key}");
        }
    }
    check_coverage(&container([64; 3], 16)).expect("full bricks tile the file");
}

#[test]
fn a_volume_of_65_536_voxels_along_each_axis_opens_and_its_bricks_are_right() {
    let start = Instant::now();
    let container = container([65_536; 3], 64);
    assert!(container.pyramid().brick_count() > 1_200_000_000);
    let coarsest = container.pyramid().coarsest().0;
    let last = [1023; 3];
    for key in [key(0, [0; 3]), key(0, last), key(0, [512, 3, 777]), key(1, [511, 0, 256]), key(coarsest, [0; 3])] {
        let (_, voxels) = check_brick(&container, key).expect("a computed brick keeps the rules");
        assert_eq!(voxels, voxels_one_by_one(&container, key), "{key}");
    }
    // Five bricks, each with its eight children, on ten pages: seconds would mean that whole pages are sealed.
    assert!(start.elapsed().as_secs_f64() < 5.0, "{:?}", start.elapsed());
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
    let (computed, source) = BrickId::open(dims, 32).expect("the dims are within the limits");
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
