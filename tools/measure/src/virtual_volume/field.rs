//! Voxel values of a virtual volume: a function of position that repeats every [`PERIOD`] bricks of its level.

use std::collections::HashMap;
use std::f64::consts::TAU;

use supervol_format::brick::MACRO_CELL;
use supervol_format::cast::{narrow, whole};
use supervol_format::{BrickIndex, BrickKey, Lod, Pyramid, ValueRange, VoxelType};

/// Period along each axis, in bricks. It is odd, so no power of two is a multiple of it.
pub const PERIOD: u32 = 5;

/// Number of different brick numbers in one level.
const NUMBERS: u32 = PERIOD.pow(3);
/// Amplitude of each of the three waves: their sum stays within the range of `i16`.
const AMPLITUDE: f64 = 10_000.0;

/// Function that gives the voxel values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Each voxel (`u8`) names its brick: twice the brick's number ([`number`]), plus one in every other macro cell
    /// ([`value`]). No brick larger than a macro cell is uniform, and a misplaced brick shows in the picture. Coarser
    /// voxels name their own brick instead of averaging finer ones, so their error is the whole range of values.
    BrickId,
    /// Sum of three waves (`i16`), one along each axis. Coarser voxels sample the same waves at their own centres.
    /// Their error is small on fine levels and four times as large on each next level, as for smooth data. The error
    /// bounds are closed forms.
    Waves,
}

/// The number of a brick, 0 to 124. Two bricks of one level share a number only if their positions are congruent modulo
/// 5 on every axis. So a misplaced neighbour shows. A position that is wrong by a power of two (an overflow, a lost
/// bit) shows too: no power of two is divisible by 5. Each level shifts the numbers by 31.
#[must_use]
pub fn number(key: BrickKey) -> u32 {
    let [x, y, z] = key.brick().0.map(|i| i % PERIOD);
    (57 * (x + PERIOD * (y + PERIOD * z)) + 31 * u32::from(key.lod().0)) % NUMBERS
}

/// Value of a voxel of [`Field::BrickId`]. `voxel` is in voxels of its level; `core` is the core of the bricks, voxels.
#[must_use]
pub fn value(core: u64, lod: Lod, voxel: [u64; 3]) -> u8 {
    let brick = BrickKey::new(lod, BrickIndex(voxel.map(|v| narrow::<u32>(v / core))));
    // At most 2 * 124 + 1.
    narrow::<u8>(2 * number(brick)) + cell_parity(voxel)
}

fn cell_parity(voxel: [u64; 3]) -> u8 {
    (voxel.iter().map(|v| v / MACRO_CELL as u64).sum::<u64>() % 2) as u8
}

impl Field {
    /// Name for messages and manifests.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::BrickId => "BRICKID",
            Self::Waves => "WAVES",
        }
    }

    /// Description for the manifest.
    #[must_use]
    pub fn note(self) -> &'static str {
        match self {
            Self::BrickId => "Computed on read; coarser voxels are no averages: each names its own brick.",
            Self::Waves => "Computed on read; coarser voxels are samples at their middles.",
        }
    }

    /// Type of the voxels.
    #[must_use]
    pub fn voxel_type(self) -> VoxelType {
        match self {
            Self::BrickId => VoxelType::U8,
            Self::Waves => VoxelType::I16,
        }
    }

    /// Value of a voxel; `voxel` is in voxels of the level.
    #[must_use]
    pub fn value(self, pyramid: &Pyramid, lod: Lod, voxel: [u64; 3]) -> f64 {
        match self {
            Self::BrickId => f64::from(value(pyramid.layout().core() as u64, lod, voxel)),
            Self::Waves => {
                let [x, y, z] = std::array::from_fn(|a| wave(pyramid, lod, a, voxel[a]));
                sum(x, y, z)
            }
        }
    }

    /// Values at all combinations of these coordinates (voxels of the level); little endian, x fastest.
    #[must_use]
    pub fn voxels(self, pyramid: &Pyramid, lod: Lod, along: &[Vec<u64>; 3]) -> Vec<u8> {
        match self {
            Self::BrickId => brick_numbers(pyramid.layout().core() as u64, lod, along),
            Self::Waves => {
                let waves: [Vec<f64>; 3] =
                    std::array::from_fn(|a| along[a].iter().map(|&v| wave(pyramid, lod, a, v)).collect());
                let [xs, ys, zs] = &waves;
                let rows = zs.iter().flat_map(|&z| ys.iter().map(move |&y| (y, z)));
                rows.flat_map(|(y, z)| xs.iter().map(move |&x| whole::<i16>(sum(x, y, z))))
                    .flat_map(i16::to_le_bytes)
                    .collect()
            }
        }
    }

    /// Range of the voxels from `start` to `end` (both included, voxels of the level). The axes are searched one by
    /// one.
    #[must_use]
    pub fn range(self, pyramid: &Pyramid, lod: Lod, start: [u64; 3], end: [u64; 3]) -> ValueRange {
        let along: [Vec<u64>; 3] = std::array::from_fn(|a| match self {
            // Values change only at borders of macro cells: two cells of the core and one voxel on either side suffice.
            Self::BrickId => {
                let first = start[a].next_multiple_of(MACRO_CELL as u64);
                [start[a], first, first + MACRO_CELL as u64, end[a]].map(|v| v.min(end[a])).to_vec()
            }
            Self::Waves => {
                let by_value = |p: &u64, q: &u64| wave(pyramid, lod, a, *p).total_cmp(&wave(pyramid, lod, a, *q));
                let all = start[a]..=end[a];
                [all.clone().min_by(by_value), all.max_by(by_value)].into_iter().flatten().collect()
            }
        });
        let mut range = ValueRange::EMPTY;
        for (&x, &y, &z) in along[2]
            .iter()
            .flat_map(|z| along[1].iter().map(move |y| (y, z)))
            .flat_map(|(y, z)| along[0].iter().map(move |x| (x, y, z)))
        {
            range.include(self.value(pyramid, lod, [x, y, z]));
        }
        range
    }

    /// Error bound of a brick of level 1 or more against level 0. `beneath`: range of its values and of all finer ones.
    #[must_use]
    pub fn error(self, pyramid: &Pyramid, key: BrickKey, beneath: ValueRange) -> f64 {
        match self {
            Self::BrickId => beneath.width(),
            // Both levels are rounded to whole numbers.
            Self::Waves => {
                let waves: f64 = (0..3).map(|a| wave_error(pyramid, key, a)).sum();
                (waves + 1.0).min(beneath.width())
            }
        }
    }
}

/// Voxel values of brick numbers. Rows in the same bricks and macro cells across x are equal and are computed once.
fn brick_numbers(core: u64, lod: Lod, along: &[Vec<u64>; 3]) -> Vec<u8> {
    let mut rows: HashMap<[u64; 3], Vec<u8>> = HashMap::new();
    let mut out = Vec::with_capacity(along.iter().map(Vec::len).product());
    for &z in &along[2] {
        for &y in &along[1] {
            let parity = (y / MACRO_CELL as u64 + z / MACRO_CELL as u64) % 2;
            let row = rows
                .entry([y / core, z / core, parity])
                .or_insert_with(|| along[0].iter().map(|&x| value(core, lod, [x, y, z])).collect());
            out.extend_from_slice(row);
        }
    }
    out
}

/// Sum of three waves, always added in the same order, so that sums of extremes are extremes of sums.
fn sum(x: f64, y: f64, z: f64) -> f64 {
    (x + y + z).round()
}

/// Wavelength, in voxels of level 0.
fn wavelength(pyramid: &Pyramid) -> u64 {
    u64::from(PERIOD) * pyramid.layout().core() as u64
}

/// One wave at the centre of a voxel of a level. Positions are whole half voxels, so repetitions agree to the last bit.
fn wave(pyramid: &Pyramid, lod: Lod, axis: usize, voxel: u64) -> f64 {
    let (half_voxels, period) = ((2 * voxel + 1) * pyramid.level_at(lod).scale[axis], 2 * wavelength(pyramid));
    AMPLITUDE * (TAU * (half_voxels % period) as f64 / period as f64).sin()
}

/// Largest difference between a wave interpolated at this level and at level 0. Beyond the centre of the outermost
/// voxel the value is constant.
fn wave_error(pyramid: &Pyramid, key: BrickKey, axis: usize) -> f64 {
    let level = pyramid.level_at(key.lod());
    let (h, k) = (level.scale[axis] as f64, TAU / wavelength(pyramid) as f64);
    if level.scale[axis] == 1 {
        return 0.0;
    }
    let is_outermost = key.brick().0[axis] == 0 || u64::from(key.brick().0[axis]) + 2 >= u64::from(level.bricks[axis]);
    let beside = if is_outermost { 0.5 * h * k } else { 0.0 };
    let between = 0.125 * (h * h + 1.0) * k * k;
    AMPLITUDE * (between + beside).min(2.0)
}
