use supervol_format::random::Random;

use super::*;

/// The bits of voxels: holes and minus zero differ from other values.
fn bits(voxels: &Voxels) -> (usize, Vec<u32>) {
    match voxels {
        Voxels::U8(v) => (1, v.iter().map(|&v| v.into()).collect()),
        Voxels::U16(v) => (2, v.iter().map(|&v| v.into()).collect()),
        Voxels::F32(v) => (4, v.iter().map(|v| v.to_bits()).collect()),
    }
}

fn check(voxels: &Voxels, extent: [usize; 3]) -> PackedVoxels {
    let packed = PackedVoxels::new(voxels, extent);
    assert_eq!(bits(&packed.unpacked(None)), bits(voxels), "{extent:?}");
    // Memory of any type and contents.
    let spares = [Voxels::U8(vec![7; 9000]), Voxels::U16(vec![7; 3]), Voxels::F32(vec![f32::NAN; 9000])];
    for spare in spares {
        assert_eq!(bits(&packed.unpacked(Some(spare))), bits(voxels), "{extent:?}");
    }
    packed
}

fn volume(extent: [usize; 3], mut of: impl FnMut([usize; 3]) -> f64) -> Vec<f64> {
    let [nx, ny, nz] = extent;
    let places = (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / (nx * ny)]);
    places.map(&mut of).collect()
}

/// The same values as each storage holds them.
fn stored(values: &[f64]) -> [Voxels; 3] {
    [
        Voxels::U8(values.iter().map(|&v| v as u8).collect()),
        Voxels::U16(values.iter().map(|&v| v as u16).collect()),
        Voxels::F32(values.iter().map(|&v| v as f32).collect()),
    ]
}

#[test]
fn random_volumes_of_every_extent_and_width_come_back() {
    let mut random = Random::new(1);
    let extents = [[1, 1, 1], [5, 5, 5], [8, 8, 8], [9, 17, 4], [68, 3, 11], [1, 30, 2], [20, 1, 20], [13, 12, 68]];
    for extent in extents {
        for width in 0..=32 {
            let mask = 1u64.checked_shl(width).unwrap_or(0).wrapping_sub(1);
            let least = random.next_u64();
            let words: Vec<u64> = volume(extent, |_| 0.0).iter().map(|_| random.next_u64() & mask).collect();
            check(&Voxels::U8(words.iter().map(|w| (w.wrapping_add(least) & 0xff) as u8).collect()), extent);
            check(&Voxels::U16(words.iter().map(|w| (w.wrapping_add(least) & 0xffff) as u16).collect()), extent);
            // All floats: infinite ones, denormals, NaN of any payload.
            let any = |w: &u64| f32::from_bits((w.wrapping_add(least) & 0xffff_ffff) as u32);
            check(&Voxels::F32(words.iter().map(any).collect()), extent);
        }
    }
}

#[test]
fn holes_among_floats_come_back_with_and_without_a_step() {
    let mut random = Random::new(2);
    let extent = [20, 9, 11];
    for share in [0.01, 0.5, 1.0] {
        for step in [0.375f32, 1e-3] {
            let value = |random: &mut Random| {
                if random.unit() < share { f32::NAN } else { random.between(-500.0, 500.0).floor() as f32 * step }
            };
            let values: Vec<f32> = (0..20 * 9 * 11).map(|_| value(&mut random)).collect();
            check(&Voxels::F32(values), extent);
        }
    }
    // The widest blocks there are, with holes: least and greatest of all floats' bits.
    let ends = [u32::MAX, 0x7fff_ffff, f32::NAN.to_bits(), 0x8000_0000, 0];
    check(&Voxels::F32((0..512).map(|i| f32::from_bits(ends[i % 5])).collect()), [8; 3]);
}

#[test]
fn uniform_blocks_take_no_bits_and_others_their_own() {
    // Two blocks along x: one is 5 everywhere, the other has numbers from 100 to 107.
    let values = volume([16, 8, 8], |[x, y, z]| if x < 8 { 5.0 } else { 100.0 + ((x + 3 * y + 5 * z) % 8) as f64 });
    for voxels in stored(&values) {
        let packed = check(&voxels, [16, 8, 8]);
        assert_eq!(packed.kept[0], Kept { first: 7, count: 9 }, "the layers of 5 are one");
        let widths: Vec<u8> = packed.blocks.iter().map(|block| block.bits).collect();
        assert_eq!(widths, [7, 3], "kept layers: one of 5 and seven of 100 to 107, then one of these");
    }
    for voxels in stored(&volume([68; 3], |_| 9.0)) {
        assert_eq!(check(&voxels, [68; 3]).bytes(), (size_of::<Block>() + PADDING) as u64);
    }
}

#[test]
fn a_layer_that_repeats_its_neighbour_at_an_end_is_kept_once() {
    let [nx, ny, nz] = [20, 22, 5];
    let values = volume([nx, ny, nz], |[x, y, _]| ((x * x + 7 * y) % 200) as f64);
    for voxels in stored(&values) {
        let packed = check(&voxels, [nx, ny, nz]);
        assert_eq!(packed.kept[2].count, 1, "one voxel thick");
    }
    // The apron at an edge of the grid: two layers before the first.
    let values = volume([nx, ny, nz], |[x, y, z]| ((x.max(2) * 3 + y.min(19) * 7 + z * 11) % 251) as f64);
    for voxels in stored(&values) {
        let packed = check(&voxels, [nx, ny, nz]);
        assert_eq!(packed.kept, [(2, 18), (0, 20), (0, 5)].map(|(first, count)| Kept { first, count }));
    }
    // Zeros of two signs are no repetition.
    check(&Voxels::F32(vec![0.0, -0.0, 0.0, 0.0]), [2, 2, 1]);
    check(&Voxels::F32(vec![f32::NAN; 125]), [5; 3]);
}

#[test]
fn numbers_in_steps_need_the_bits_of_their_steps() {
    let mut random = Random::new(3);
    let steps: Vec<u64> = (0..512).map(|i| if i == 0 { 7 } else { random.below(8) }).collect();
    let widths = |packed: &PackedVoxels| packed.blocks.iter().map(|block| block.bits).collect::<Vec<_>>();
    let bytes = Voxels::U8(steps.iter().map(|&k| (20 + 31 * k) as u8).collect());
    assert_eq!(widths(&check(&bytes, [8; 3])), [3]);
    let words = Voxels::U16(steps.iter().map(|&k| (9 + 9001 * k) as u16).collect());
    assert_eq!(widths(&check(&words, [8; 3])), [3]);
    let floats = Voxels::F32(steps.iter().map(|&k| (k as f32 - 5.0) * 0.0625 * 1.25).collect());
    assert_eq!(widths(&check(&floats, [8; 3])), [3]);
    // One value between the steps: as many bits as ranks need, and all values as they were.
    let Voxels::F32(mut between) = floats else { unreachable!() };
    between[9] += 1e-6;
    assert!(widths(&check(&Voxels::F32(between), [8; 3]))[0] > 24);
}
