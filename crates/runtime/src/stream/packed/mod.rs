//! Packed voxels: a brick's voxels in fewer bits, without loss.
//!
//! ```text
//! brick -> layers that are no repetition -> blocks of 8^3 voxels -> least number + codes of equal width
//! ```
//!
//! - *Layers* that repeat their neighbour at the ends of an axis, as the apron at the grid's edge does, are left out. A
//!   brick that is one voxel thick stays one voxel thick.
//! - Each *block* keeps its least number, and for each voxel a *code* of so many bits as its greatest number needs: none if
//!   all are equal. Code i of a block lies `i * bits` bits behind its first, so that any voxel is found in constant time.
//! - Codes count in *steps* if the numbers of the brick have one: containers within a stated error have. Floats without a
//!   step are ordered by their bits.
//! - Holes of floats are code 0 in blocks that have some.
//!
//! Unpacked voxels have the same bits as before. This module knows neither files nor caches.

mod codes;
mod steps;

use codes::{Code, GROUP, PADDING};
use steps::{common_step, gcd, steps_of};
use supervol_format::cast::narrow;

use crate::stream::residency::Voxels;

/// Edge of a block, voxels.
const EDGE: usize = 8;
/// Groups of a whole block.
const GROUPS: usize = EDGE * EDGE * EDGE / GROUP;

/// The voxels of one brick, packed.
#[derive(Debug, Clone, PartialEq)]
pub struct PackedVoxels {
    numbers: Numbers,
    /// Voxels of the brick along each axis, apron included.
    extent: [usize; 3],
    /// Layers that are kept, along each axis.
    kept: [Kept; 3],
    /// x fastest.
    blocks: Vec<Block>,
    codes: Vec<u8>,
}

/// Layers of an axis that are kept; those before repeat the first, those behind repeat the last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Kept {
    first: usize,
    count: usize,
}

/// Meaning of codes.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Numbers {
    /// Number = least + code * step.
    U8 { step: u8 },
    /// Number = least + code * step.
    U16 { step: u16 },
    /// Value = (least + code) * step.
    Steps(f32),
    /// The value's rank among all floats = least + code.
    Ranks,
}

/// One block.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Block {
    least: u32,
    /// Place of the first code, bytes from the first of all.
    offset: u32,
    bits: u8,
    /// Code 0 is a hole; the least number has code 1.
    has_holes: bool,
}

/// Numbers of a block, the last group filled up with any of them.
type BlockOf<T> = [[T; GROUP]; GROUPS];

impl PackedVoxels {
    /// Packs the voxels of a brick of this extent, x fastest.
    ///
    /// # Panics
    /// If there is another number of voxels.
    #[must_use]
    pub fn new(voxels: &Voxels, extent: [usize; 3]) -> Self {
        match voxels {
            Voxels::U8(voxels) => {
                let step = narrow::<u8>(step_between(voxels.iter().map(|&v| u64::from(v))));
                Self::of(voxels, extent, Numbers::U8 { step }, |numbers, codes| {
                    encode_integers(numbers, codes, |code| code / step, |a, b| a - b)
                })
            }
            Voxels::U16(voxels) => {
                let step = narrow::<u16>(step_between(voxels.iter().map(|&v| u64::from(v))));
                Self::of(voxels, extent, Numbers::U16 { step }, |numbers, codes| {
                    encode_integers(numbers, codes, |code| code / step, |a, b| a - b)
                })
            }
            Voxels::F32(voxels) => match common_step(voxels).filter(|&step| are_steps(voxels, step)) {
                Some(step) => Self::of(voxels, extent, Numbers::Steps(step), |values, codes| {
                    // Holes have no number; any will do for them.
                    encode_floats(values, codes, |value| steps_of(value, step).unwrap_or(0))
                }),
                None => Self::of(voxels, extent, Numbers::Ranks, |values, codes| encode_floats(values, codes, rank_of)),
            },
        }
    }

    fn of<T: Default + SameBits, C: Code>(
        voxels: &[T],
        extent: [usize; 3],
        numbers: Numbers,
        encode: impl Fn(&BlockOf<T>, &mut BlockOf<C>) -> Encoded,
    ) -> Self {
        assert_eq!(voxels.len(), extent.iter().product::<usize>(), "voxels of a brick of {extent:?}");
        let kept = [0, 1, 2].map(|axis| kept_layers(voxels, extent, axis));
        let mut packed = Self { numbers, extent, kept, blocks: Vec::new(), codes: Vec::new() };
        let (mut numbers, mut codes) = ([[T::default(); GROUP]; GROUPS], [[C::default(); GROUP]; GROUPS]);
        packed.blocks.reserve_exact(packed.places().count());
        for place in packed.places() {
            let count = place.copy_from(voxels, extent, numbers.as_flattened_mut());
            let groups = count.div_ceil(GROUP);
            let first = numbers[0][0];
            numbers.as_flattened_mut()[count..].fill(first);
            let Encoded { least, most, has_holes } = encode(&numbers, &mut codes);
            let bits = u32::BITS - most.leading_zeros();
            let offset = narrow::<u32>(packed.codes.len());
            codes::pack(&codes[..groups], bits, &mut packed.codes);
            packed.blocks.push(Block { least, offset, bits: narrow::<u8>(bits), has_holes });
        }
        packed.codes.extend([0; PADDING]);
        packed.codes.shrink_to_fit();
        packed
    }

    /// The voxels, x fastest, in the memory of `spare` if it is of the same type.
    #[must_use]
    pub fn unpacked(&self, spare: Option<Voxels>) -> Voxels {
        match self.numbers {
            Numbers::U8 { step } => {
                let memory = if let Some(Voxels::U8(memory)) = spare { memory } else { Vec::new() };
                Voxels::U8(self.unpack(memory, |block, codes: &BlockOf<u8>, numbers| {
                    let least = block.least.to_le_bytes()[0];
                    for (number, code) in numbers.as_flattened_mut().iter_mut().zip(codes.as_flattened()) {
                        *number = least.wrapping_add(code.wrapping_mul(step));
                    }
                }))
            }
            Numbers::U16 { step } => {
                let memory = if let Some(Voxels::U16(memory)) = spare { memory } else { Vec::new() };
                Voxels::U16(self.unpack(memory, |block, codes: &BlockOf<u16>, numbers| {
                    let least = narrow::<u16>(block.least);
                    for (number, code) in numbers.as_flattened_mut().iter_mut().zip(codes.as_flattened()) {
                        *number = least.wrapping_add(code.wrapping_mul(step));
                    }
                }))
            }
            Numbers::Steps(step) => Voxels::F32(self.unpack(floats_of(spare), |block, codes, values| {
                decode_floats(block, codes, values, |number| number.cast_signed() as f32 * step);
            })),
            Numbers::Ranks => Voxels::F32(self.unpack(floats_of(spare), |block, codes, values| {
                decode_floats(block, codes, values, value_of_rank);
            })),
        }
    }

    fn unpack<T: Copy + Default, C: Code>(
        &self,
        mut voxels: Vec<T>,
        decode: impl Fn(&Block, &BlockOf<C>, &mut BlockOf<T>),
    ) -> Vec<T> {
        voxels.resize(self.extent.iter().product(), T::default());
        let (mut numbers, mut codes) = ([[T::default(); GROUP]; GROUPS], [[C::default(); GROUP]; GROUPS]);
        for (place, block) in self.places().zip(&self.blocks) {
            let groups = place.count.iter().product::<usize>().div_ceil(GROUP);
            C::unpack(&self.codes[block.offset as usize..], block.bits.into(), &mut codes[..groups]);
            decode(block, &codes, &mut numbers);
            place.copy_to(&mut voxels, self.extent, numbers.as_flattened());
        }
        repeat_layers(&mut voxels, self.extent, self.kept);
        voxels
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        (size_of_val(&self.blocks[..]) + self.codes.len()) as u64
    }

    /// The blocks' places in the brick, x fastest.
    fn places(&self) -> impl Iterator<Item = BlockPlace> + use<> {
        let kept = self.kept;
        let along = move |axis: usize| (0..kept[axis].count).step_by(EDGE);
        along(2).flat_map(move |z| {
            along(1).flat_map(move |y| {
                along(0).map(move |x| {
                    let from = [x, y, z];
                    BlockPlace {
                        first: std::array::from_fn(|axis| kept[axis].first + from[axis]),
                        count: std::array::from_fn(|axis| EDGE.min(kept[axis].count - from[axis])),
                    }
                })
            })
        })
    }
}

/// Voxels of a brick that form a block.
#[derive(Debug, Clone, Copy)]
struct BlockPlace {
    first: [usize; 3],
    count: [usize; 3],
}

impl BlockPlace {
    /// Places of the rows' first voxels in the brick.
    #[inline(always)]
    fn rows(self, [nx, ny, _]: [usize; 3]) -> impl Iterator<Item = usize> {
        let Self { first: [x, y, z], count: [_, rows, slices] } = self;
        (z..z + slices).flat_map(move |z| (y..y + rows).map(move |y| x + nx * (y + ny * z)))
    }

    /// Copies the block's voxels out of the brick; returns their number.
    fn copy_from<T: Copy>(self, voxels: &[T], extent: [usize; 3], to: &mut [T]) -> usize {
        let width = self.count[0];
        let mut count = 0;
        for row in self.rows(extent) {
            to[count..count + width].copy_from_slice(&voxels[row..row + width]);
            count += width;
        }
        count
    }

    /// Copies the block's voxels into the brick.
    #[inline(always)]
    fn copy_to<T: Copy>(self, voxels: &mut [T], extent: [usize; 3], from: &[T]) {
        let width = self.count[0];
        if width == EDGE {
            // The length is known to the compiler: one move instead of a call.
            for (row, numbers) in self.rows(extent).zip(from.chunks_exact(EDGE)) {
                voxels[row..row + EDGE].copy_from_slice(numbers);
            }
            return;
        }
        for (row, numbers) in self.rows(extent).zip(from.chunks_exact(width)) {
            voxels[row..row + width].copy_from_slice(numbers);
        }
    }
}

/// Least number and greatest code of a block.
struct Encoded {
    least: u32,
    most: u32,
    has_holes: bool,
}

fn encode_integers<T: Copy + Ord + Into<u32>>(
    numbers: &BlockOf<T>,
    codes: &mut BlockOf<T>,
    in_steps: impl Fn(T) -> T,
    minus: impl Fn(T, T) -> T,
) -> Encoded {
    let (mut least, mut most) = (numbers[0][0], numbers[0][0]);
    for &number in numbers.as_flattened() {
        (least, most) = (least.min(number), most.max(number));
    }
    for (code, &number) in codes.as_flattened_mut().iter_mut().zip(numbers.as_flattened()) {
        *code = in_steps(minus(number, least));
    }
    Encoded { least: least.into(), most: in_steps(minus(most, least)).into(), has_holes: false }
}

/// Whether this value is a hole as decoders write it: other values that are no numbers keep their bits.
#[inline(always)]
fn is_hole(value: f32) -> bool {
    value.to_bits() == f32::NAN.to_bits()
}

fn encode_floats(values: &BlockOf<f32>, codes: &mut BlockOf<u32>, number_of: impl Fn(f32) -> i32) -> Encoded {
    let (mut least, mut most, mut has_holes) = (i32::MAX, i32::MIN, false);
    for &value in values.as_flattened() {
        if is_hole(value) {
            has_holes = true;
        } else {
            let number = number_of(value);
            (least, most) = (least.min(number), most.max(number));
        }
    }
    // A block of nothing but holes.
    let (least, width) = if least > most { (0, 0) } else { (least, most.wrapping_sub(least).cast_unsigned()) };
    // Without room for another code, holes have ranks as all values do.
    let has_holes = has_holes && width < u32::MAX;
    let (least, most) = if has_holes { (least, width + 1) } else { (least, width) };
    for (code, &value) in codes.as_flattened_mut().iter_mut().zip(values.as_flattened()) {
        let number = || number_of(value).wrapping_sub(least).cast_unsigned();
        *code = match (has_holes, is_hole(value)) {
            (true, true) => 0,
            (true, false) => number() + 1,
            (false, _) => number(),
        };
    }
    Encoded { least: least.cast_unsigned(), most, has_holes }
}

#[inline(always)]
fn decode_floats(block: &Block, codes: &BlockOf<u32>, values: &mut BlockOf<f32>, value_of: impl Fn(u32) -> f32) {
    let pairs = values.as_flattened_mut().iter_mut().zip(codes.as_flattened());
    if block.has_holes {
        for (value, &code) in pairs {
            let number = block.least.wrapping_add(code).wrapping_sub(1);
            *value = if code == 0 { f32::NAN } else { value_of(number) };
        }
        return;
    }
    for (value, &code) in pairs {
        *value = value_of(block.least.wrapping_add(code));
    }
}

/// Rank of a value among all floats, by its bits: greater values have greater ranks.
#[inline(always)]
fn rank_of(value: f32) -> i32 {
    let bits = value.to_bits().cast_signed();
    if bits < 0 { bits ^ i32::MAX } else { bits }
}

/// The value of this rank.
#[inline(always)]
fn value_of_rank(rank: u32) -> f32 {
    let rank = rank.cast_signed();
    f32::from_bits((if rank < 0 { rank ^ i32::MAX } else { rank }).cast_unsigned())
}

fn are_steps(values: &[f32], step: f32) -> bool {
    values.iter().all(|&value| is_hole(value) || steps_of(value, step).is_some())
}

/// Greatest common divisor of the numbers' distances; 1 if all are equal.
fn step_between(mut numbers: impl Iterator<Item = u64>) -> u64 {
    let Some(first) = numbers.next() else { return 1 };
    let mut step = 0;
    for number in numbers {
        let distance = number.abs_diff(first);
        if distance != 0 {
            step = gcd(step, distance);
            if step == 1 {
                break;
            }
        }
    }
    step.max(1)
}

fn floats_of(spare: Option<Voxels>) -> Vec<f32> {
    if let Some(Voxels::F32(memory)) = spare { memory } else { Vec::new() }
}

/// Comparison of voxels by their bits: a hole equals a hole, and minus zero is not zero.
trait SameBits: Copy {
    fn is_same(self, other: Self) -> bool;
}

impl SameBits for u8 {
    fn is_same(self, other: Self) -> bool {
        self == other
    }
}

impl SameBits for u16 {
    fn is_same(self, other: Self) -> bool {
        self == other
    }
}

impl SameBits for f32 {
    fn is_same(self, other: Self) -> bool {
        self.to_bits() == other.to_bits()
    }
}

/// Layers of an axis without those that repeat the next at its ends.
fn kept_layers<T: SameBits>(voxels: &[T], extent: [usize; 3], axis: usize) -> Kept {
    let count = extent[axis];
    let repeats = |a: usize, b: usize| {
        let [nx, ny, nz] = extent;
        let strides = [1, nx, nx * ny];
        let others: [usize; 2] = [[1, 2], [0, 2], [0, 1]][axis];
        let [na, nb] = others.map(|other| [nx, ny, nz][other]);
        (0..nb).all(|j| {
            let row = j * strides[others[1]];
            (0..na).all(|i| {
                let at = row + i * strides[others[0]];
                voxels[at + a * strides[axis]].is_same(voxels[at + b * strides[axis]])
            })
        })
    };
    let first = (1..count).take_while(|&layer| repeats(layer - 1, layer)).count();
    let behind = (first + 1..count).rev().take_while(|&layer| repeats(layer, layer - 1)).count();
    Kept { first, count: count - first - behind }
}

/// Fills the layers that are not kept with those that they repeat: along x, then y, then z.
fn repeat_layers<T: Copy>(voxels: &mut [T], [nx, ny, nz]: [usize; 3], [x, y, z]: [Kept; 3]) {
    for k in z.first..z.first + z.count {
        let slice = &mut voxels[k * nx * ny..][..nx * ny];
        if x.count < nx {
            for row in slice.chunks_exact_mut(nx).skip(y.first).take(y.count) {
                let last = x.first + x.count - 1;
                let ends = [row[x.first], row[last]];
                row[..x.first].fill(ends[0]);
                row[last + 1..].fill(ends[1]);
            }
        }
        let last = y.first + y.count - 1;
        for j in (0..y.first).chain(last + 1..ny) {
            let from = if j < y.first { y.first } else { last };
            slice.copy_within(from * nx..(from + 1) * nx, j * nx);
        }
    }
    let last = z.first + z.count - 1;
    for k in (0..z.first).chain(last + 1..nz) {
        let from = if k < z.first { z.first } else { last };
        voxels.copy_within(from * nx * ny..(from + 1) * nx * ny, k * nx * ny);
    }
}

#[cfg(test)]
mod tests;
