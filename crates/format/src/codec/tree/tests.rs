use proptest::prelude::*;

use super::*;
use crate::VoxelType;
use crate::codec::{CodecChoice, encode};
use crate::random::Random;

const NO_HOLES: Absence = Absence::NON_FINITE_ONLY;
const NODATA: Absence = Absence { nodata: Some(-999.0) };

/// A box of voxels and its coarser voxels.
struct Family {
    shape: BrickShape,
    voxels: Vec<u8>,
    parents: Vec<u8>,
    factors: [u32; 3],
    absence: Absence,
}

impl Family {
    /// Voxels computed from their positions. Coarser ones are rounded means of the 8 voxels they stand for.
    fn of<V: Voxel>(extent: [usize; 3], factors: [u32; 3], value: impl Fn([usize; 3]) -> f64) -> Self {
        let shape = BrickShape { voxel_type: V::TYPE, extent };
        let coarse = Coarser::extent(factors, extent);
        let mean = |p: [usize; 3]| {
            let part = |axis: usize, corner: usize| {
                let by = if factors[axis] == 2 { corner >> axis & 1 } else { 0 };
                (p[axis] * factors[axis] as usize + by).min(extent[axis] - 1)
            };
            let sum: f64 = (0..8).map(|corner| V::from_f64(value([0, 1, 2].map(|a| part(a, corner)))).to_f64()).sum();
            (sum / 8.0).round_ties_even()
        };
        let [voxels, parents] = [bytes_of::<V>(extent, &value), bytes_of::<V>(coarse, &mean)];
        Self { shape, voxels, parents, factors, absence: NO_HOLES }
    }

    fn coarser(&self) -> Coarser<'_> {
        Coarser { voxels: &self.parents, factors: self.factors, absence: self.absence }
    }

    fn encode(&self, step: Option<Quantizer>) -> Option<Vec<u8>> {
        let coded = encode_if_smaller(self.shape, &self.voxels, self.coarser(), step, usize::MAX);
        coded.expect("encoding needs only memory")
    }

    fn decode(&self, payload: &[u8]) -> Result<Vec<u8>, CodecError> {
        let mut out = vec![0xa5; self.voxels.len()];
        decode_into(self.shape, payload, self.coarser(), &mut out).map(|()| out)
    }

    fn round_trip(&self, step: Option<Quantizer>) -> Vec<u8> {
        let payload = self.encode(step).expect("voxels are multiples of a step");
        let decoded = self.decode(&payload).expect("what was encoded decodes");
        assert!(decoded == self.voxels, "{:?} by {:?}", self.shape, self.factors);
        payload
    }
}

fn bytes_of<V: Voxel>(extent: [usize; 3], value: impl Fn([usize; 3]) -> f64) -> Vec<u8> {
    let mut bytes = vec![0; extent.iter().product::<usize>() * size_of::<V>()];
    for (i, voxel) in bytes.chunks_exact_mut(size_of::<V>()).enumerate() {
        V::from_f64(value([i % extent[0], i / extent[0] % extent[1], i / extent[0] / extent[1]])).write_le(voxel);
    }
    bytes
}

/// Smooth, with noise of some units.
fn field(p: [usize; 3]) -> f64 {
    let [x, y, z] = p.map(|i| i as f64);
    let mut random = Random::new((p[0] + 1000 * p[1] + 1_000_000 * p[2]) as u64);
    (100.0 + 40.0 * (0.15 * x).sin() + 30.0 * (0.11 * y + 0.2 * z).cos() + 4.0 * random.unit()).round()
}

const EXTENTS: [[usize; 3]; 8] =
    [[1, 1, 1], [2, 1, 1], [1, 1, 5], [4, 5, 6], [3, 3, 3], [17, 1, 9], [36, 33, 20], [68, 7, 34]];
const FACTORS: [[u32; 3]; 5] = [[2, 2, 2], [2, 2, 1], [1, 2, 2], [2, 1, 1], [1, 1, 2]];

#[test]
fn all_types_extents_and_factors_survive() {
    for (i, extent) in EXTENTS.into_iter().enumerate() {
        for factors in FACTORS {
            Family::of::<u8>(extent, factors, field).round_trip(None);
            Family::of::<u16>(extent, factors, field).round_trip(None);
            if i % 2 == 0 {
                Family::of::<i8>(extent, factors, |p| field(p) - 100.0).round_trip(None);
                Family::of::<i16>(extent, factors, |p| field(p) - 100.0).round_trip(None);
                Family::of::<u32>(extent, factors, field).round_trip(None);
                Family::of::<i32>(extent, factors, field).round_trip(None);
                Family::of::<f32>(extent, factors, |p| 0.25 * field(p)).round_trip(None);
                Family::of::<f64>(extent, factors, |p| 0.25 * field(p)).round_trip(None);
            }
        }
    }
}

#[test]
fn extremes_survive_with_any_coarser_voxels() {
    let mut random = Random::new(3);
    for voxel_type in VoxelType::ALL.into_iter().filter(|t| !t.is_float()) {
        let (least, greatest) = voxel_type.limits();
        for extent in EXTENTS {
            let mut extremes = |extent: [usize; 3]| {
                with_voxel!(voxel_type, V => {
                    let values: Vec<f64> = (0..extent.iter().product::<usize>())
                        .map(|_| random.of(&[least, greatest, 0.0, least + 1.0]))
                        .collect();
                    bytes_of::<V>(extent, |[x, y, z]| values[(z * extent[1] + y) * extent[0] + x])
                })
            };
            let factors = [2; 3];
            let (voxels, parents) = (extremes(extent), extremes(Coarser::extent(factors, extent)));
            let shape = BrickShape { voxel_type, extent };
            // Indices of 32-bit integers beyond 2^29 are not coded.
            let family = Family { shape, voxels, parents, factors, absence: NO_HOLES };
            match family.encode(Some(Quantizer::WHOLE)) {
                Some(payload) => assert!(family.decode(&payload).expect("what was encoded decodes") == family.voxels),
                None => assert_eq!(voxel_type.bytes(), 4),
            }
        }
    }
}

/// The mean of 10 and 13 is 11.5: a tie, rounded to 12. The difference of -3 makes the voxels 11 and 14 around 12. Their sum
/// of 25 is a tie, which follows a mean of 12, so the shift would be 0; the true one is one less.
#[test]
fn stored_bytes_stay_as_they_are() {
    let shape = BrickShape { voxel_type: VoxelType::U8, extent: [2, 1, 1] };
    let factors = [2, 1, 1];
    let family = Family { shape, voxels: vec![10, 13], parents: vec![12], factors, absence: NO_HOLES };
    let payload = family.round_trip(Some(Quantizer::WHOLE));
    let (head, rest) = payload.split_at(HEAD_BYTES);
    assert_eq!(head, [0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f], "no holes; step 1");
    // A chunk of one token without extra bits, and what follows it.
    let chunk = |bytes: &[u8]| {
        let frame_bytes = usize::from(bytes[4]);
        assert_eq!((bytes[0], bytes[8]), (1, 0));
        (
            ::zstd::bulk::decompress(&bytes[12..12 + frame_bytes], 1).expect("a frame"),
            bytes[12 + frame_bytes..].to_vec(),
        )
    };
    let (weights, rest) = rest.split_at(2 * TERMS);
    assert_eq!((weights, rest[0]), (&[0; 2 * TERMS][..], 0), "no weights, no classes");
    let (detail, rest) = chunk(&rest[1..]);
    assert_eq!(detail, [68], "-3");
    let (correction, rest) = chunk(&rest);
    assert_eq!((correction, rest), (vec![64], Vec::new()), "-1");
}

/// The formulas of the module head, literally, on pairs of slices.
#[test]
fn pairs_become_averages_and_differences() {
    let extent = [5, 3, 6];
    let value = |[x, y, z]: [usize; 3]| (7 * x * x + 5 * y * z) as i32 - (z * z * z) as i32;
    let samples: Vec<i32> = (0..90).map(|i| value([i % 5, i / 5 % 3, i / 15])).collect();
    let grid = to_grid(extent, &samples);
    for halving in Halving::all(extent, [1, 1, 2]) {
        let averages = halving.fold(&grid, average);
        assert_eq!(averages.extent(), [5, 3, 3]);
        let mut details = vec![0; averages.width()];
        for [y, z] in rows_of([5, 3, 3]) {
            halving.details(&grid, [y, z], &mut details);
            for (x, (average, detail)) in averages.row(y, z).iter().zip(&details).enumerate() {
                let [a, b] = [value([x, y, 2 * z]), value([x, y, 2 * z + 1])];
                assert_eq!((*average, *detail), ((a + b).div_euclid(2), a - b));
            }
        }
    }
}

/// Only ties have corrections if coarser voxels are rounded means, however ties were rounded.
#[test]
fn shifts_of_means_follow_from_the_voxels() {
    let (extent, factors) = ([20, 13, 6], [2; 3]);
    let halvings = Halving::all(extent, factors);
    let samples: Vec<i32> = (0..20 * 13 * 6).map(|i: usize| field([i % 20, i / 20 % 13, i / 260]) as i32).collect();
    let voxels = to_grid(extent, &samples);
    let sums = halvings.iter().fold(voxels.clone(), |grid, halving| halving.fold(&grid, grid::sum));
    let averages = halvings.iter().fold(voxels.clone(), |grid, halving| halving.fold(&grid, average));
    let ties = sums_of(&sums).filter(|sum| sum.rem_euclid(8) == 4).count();
    assert!(ties > 20, "{ties} ties");
    for up in [3, 4] {
        let means = to_grid(sums.extent(), &sums_of(&sums).map(|sum| (sum + up).div_euclid(8)).collect::<Vec<_>>());
        let true_shifts = differences(&averages, &means);
        let back: Vec<i32> = true_shifts.iter().map(|shift| -shift).collect();
        let shifted = Moving { grid: &voxels, shifts: &back, factors }.run();
        let found = Shifting { means: &means, shifted: &shifted, halvings: &halvings }.run();
        assert_eq!(found.counts()[0], ties);
        for ((found, shift), is_tie) in found.shifts.iter().zip(&true_shifts).zip(&found.are_ties) {
            assert_eq!(found - shift, i32::from(*is_tie && up == 4));
        }
    }
}

fn sums_of(sums: &Grid<i32>) -> impl Iterator<Item = i32> + '_ {
    rows_of(sums.extent()).flat_map(|[y, z]| sums.row(y, z).iter().copied())
}

#[test]
fn ramps_cost_next_to_nothing_and_noise_less_than_alone() {
    let extent = [64; 3];
    let ramp = Family::of::<u16>(extent, [2; 3], |[x, y, z]| (4 * x + 8 * y + 16 * z) as f64).round_trip(None);
    assert!(ramp.len() < 2000, "{} bytes for {} voxels", ramp.len(), 64 * 64 * 64);
    let family = Family::of::<u8>(extent, [2; 3], field);
    let tree = family.round_trip(None).len();
    let alone =
        encode(CodecChoice::Smallest, family.shape, &family.voxels).expect("encoding needs only memory").1.len();
    // A brick alone also codes the coarser voxels: an eighth of the numbers, but means of noise, which have fewer bits.
    assert!(10 * tree < 9 * alone, "{tree} bytes; alone {alone}");
}

/// Flat and busy parts have codes of their own, unless all parts are alike.
#[test]
fn classes_are_used_where_parts_differ() {
    let extent = [64, 32, 32];
    let is_divided = |value: &dyn Fn([usize; 3]) -> f64| {
        let place = |i: usize| [i % 64, i / 64 % 32, i / (64 * 32)];
        let samples: Vec<i16> = (0..extent.iter().product()).map(|i| value(place(i)) as i16).collect();
        let grid = to_grid(extent, &samples);
        let halving = Halving::all(extent, [2; 3])[0];
        let averages = halving.fold(&grid, average);
        let numbers = vectorized(Predicting { halving, grid: &grid, averages: &averages, weights: &[0; TERMS] });
        let mut chunks = Chunks::after(Vec::new());
        let band = Band(halving);
        push_band(&mut chunks, band, &numbers, &averages).expect("there is memory");
        chunks.payload[0] == 1
    };
    let noise = |p: [usize; 3], spread: f64| {
        let mut random = Random::new((p[0] + 1000 * p[1] + 1_000_000 * p[2]) as u64);
        (spread * random.unit()).floor() + 20.0
    };
    let halves = |p: [usize; 3]| if p[2] < 16 { noise(p, 2.0) } else { noise(p, 200.0) };
    assert!(is_divided(&halves));
    assert!(!is_divided(&|p| noise(p, 200.0)));
}

#[test]
fn holes_come_back_if_they_are_all_alike() {
    let extent = [20, 21, 22];
    let with = |hole: fn(usize) -> f64| {
        let value = move |p: [usize; 3]| if p[0] < 7 || p[1] * p[2] % 11 == 3 { hole(p[2]) } else { field(p) };
        Family { absence: NODATA, ..Family::of::<f32>(extent, [2; 3], value) }
    };
    for hole in [(|_| f64::NAN) as fn(usize) -> f64, |_| -999.0, |_| f64::NEG_INFINITY] {
        with(hole).round_trip(None);
    }
    assert_eq!(with(|z| if z < 9 { f64::NAN } else { -999.0 }).encode(None), None);
}

#[test]
fn what_is_no_multiple_or_not_smaller_is_not_coded() {
    let family = Family::of::<f32>([8; 3], [2; 3], |p| field(p) + 0.5);
    assert_eq!(family.encode(Some(Quantizer::WHOLE)), None);
    let payload = family.round_trip(None);
    assert_eq!(payload[1..9], 0.5f64.to_le_bytes());
    let within = |limit| {
        encode_if_smaller(family.shape, &family.voxels, family.coarser(), None, limit).expect("there is memory")
    };
    assert_eq!([within(payload.len()), within(payload.len() + 1)], [None, Some(payload)]);
}

/// The bytes must not depend on the processor.
#[test]
fn vectors_change_no_bit() {
    fn compare<S: Sample + std::fmt::Debug>() {
        let extent = [37, 22, 18];
        let samples: Vec<S> = (0..extent.iter().product())
            .map(|i: usize| S::wrap(field([i % 37, i / 37 % 22, i / (37 * 22)]) as i32))
            .collect();
        let mut grid = to_grid(extent, &samples);
        for halving in Halving::all(extent, [2; 3]) {
            let averages = halving.fold(&grid, average);
            let (grid_of, averages_of) = (&grid, &averages);
            let fitting = || Fitting { halving, grid: grid_of, averages: averages_of };
            let weights = vectorized(fitting());
            assert_eq!(weights, fitting().run());
            assert_ne!(weights, [0; TERMS]);
            let predicting = || Predicting { halving, grid: grid_of, averages: averages_of, weights: &weights };
            assert_eq!(vectorized(predicting()), predicting().run());
            let band = Band(halving);
            let measuring = || Measuring { band, averages: averages_of };
            assert_eq!(vectorized(measuring()), measuring().run());
            let dividing = || {
                let mut left = Divided::undivided(band);
                let numbers = vectorized(predicting());
                left.numbers[0][..numbers.len()].copy_from_slice(&numbers);
                Dividing { halving, averages: averages_of, weights: &weights, left }
            };
            let divided = vectorized(dividing());
            assert!(divided == dividing().run() && divided == grid, "axis {}", halving.axis);
            grid = averages;
        }
    }
    compare::<i16>();
    compare::<i32>();
}

#[test]
fn wrong_payloads_are_refused_by_name() {
    let family = Family::of::<f32>([36, 20, 18], [2; 3], field);
    let good = family.round_trip(None);
    let said = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut payload = good.clone();
        change(&mut payload);
        family.decode(&payload).expect_err("it is none that is written").to_string()
    };
    assert!(said(&|p| p.truncate(8)).contains("at least 9"));
    assert!(said(&|p| p[0] = 2).contains("flags"));
    assert!(said(&|p| p[1..9].copy_from_slice(&(-1.0f64).to_le_bytes())).contains("step -1"));
    let first_band = HEAD_BYTES + 2 * TERMS;
    assert!(said(&|p| p.truncate(first_band - 1)).contains("weights are cut short"));
    assert!(said(&|p| p.truncate(first_band)).contains("a band is missing"));
    assert!(said(&|p| p[first_band] = 2).contains("thresholds"));
    assert!(said(&|p| p.push(0)).contains("behind the last band"));
    assert!(said(&|p| p.truncate(p.len() - 1)).contains("cut short"));
    // Truncation anywhere gives an error.
    for length in 0..good.len() {
        assert!(family.decode(&good[..length]).is_err(), "{length} of {} bytes", good.len());
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_voxels_and_coarser_voxels_survive(
        seed in any::<u64>(), t in 0usize..6, f in 0usize..5, extent in proptest::array::uniform3(1usize..20), range in 0u32..17
    ) {
        let mut random = Random::new(seed);
        let (voxel_type, factors) = (VoxelType::ALL[t], FACTORS[f]);
        let mut noise = |extent| {
            let shape = BrickShape { voxel_type, extent };
            with_voxel!(voxel_type, V => {
                let values: Vec<f64> = (0..shape.voxels()).map(|_| random.below(1 << range) as f64).collect();
                bytes_of::<V>(extent, |[x, y, z]| values[(z * extent[1] + y) * extent[0] + x])
            })
        };
        let (voxels, parents) = (noise(extent), noise(Coarser::extent(factors, extent)));
        let shape = BrickShape { voxel_type, extent };
        Family { shape, voxels, parents, factors, absence: NO_HOLES }.round_trip(None);
    }

    #[test]
    fn damaged_payloads_never_panic(flips in proptest::collection::vec(any::<usize>(), 1..4), t in 0usize..2, parent in any::<u8>()) {
        let extent = [34, 20, 9];
        let mut family = if t == 0 {
            Family::of::<u8>(extent, [2; 3], field)
        } else {
            Family { absence: NODATA, ..Family::of::<f32>(extent, [2; 3], |p| if p[0] < 9 { -999.0 } else { field(p) }) }
        };
        let mut payload = family.encode(None).expect("voxels are multiples of a step");
        for flip in flips {
            let bit = flip % (payload.len() * 8);
            payload[bit / 8] ^= 1 << (bit % 8);
        }
        // The result may be an error, but never a panic or an overrun.
        let _ = family.decode(&payload);
        family.parents.fill(parent);
        let _ = family.decode(&payload);
    }
}
