//! Conversion of a grid's numbers to voxels: one of several channels, the luminance of colours, or some bits of a word.
//! 64-bit integers become a smaller type that holds them; half-precision floats become f32 (exact).
//!
//! Numbers are converted when they are read. Only 64-bit integers are read once as a whole, on opening, to find a type
//! that holds all of them.

use std::path::Path;

use half::f16;
use supervol_format::file_order::boxes;
use supervol_format::voxel_type::{Voxel, voxels_as_f64};
use supervol_format::{Dims, VoxelBox, VoxelType, with_voxel};

use crate::cast::{self, index, low_8, low_16, single};
use crate::grid::layout::{GridLayout, SCRATCH_BYTES};
use crate::input::selection::{Selection, first_of};
use crate::{Message, ReadOption, SourceError};

/// Weights of red, green and blue in the luminance, in thousandths: Rec. 601, as in most programs that convert colours
/// to grey.
const LUMINANCE: [f64; 3] = [299.0, 587.0, 114.0];

/// Largest integer up to which a double represents all integers.
const EXACT_IN_DOUBLES: i128 = 1 << 53;

/// Largest number of absent 64-bit integers that are told apart.
const ABSENT_LIMIT: usize = 4;

/// Numbers that can be read box by box, in a file or in chunks.
pub(crate) trait NumberGrid {
    /// Dims and type of the numbers.
    fn layout(&self) -> &GridLayout;

    /// As [`crate::VolumeSource::read_box`].
    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError>;

    /// A box cut into small parts, in an order that reads nothing twice.
    fn parts(&self, voxels: VoxelBox) -> Box<dyn Iterator<Item = VoxelBox> + '_> {
        Box::new(boxes(voxels, (SCRATCH_BYTES / self.layout().voxel_type.bytes()) as u64, u64::MAX))
    }
}

/// Meaning of the numbers of one voxel, if there are several.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Meaning {
    /// Red, green, blue, and possibly others.
    Colours,
    /// Components of a vector, or real and imaginary parts: no single number represents all of them.
    Components,
}

/// Selection among the numbers of each voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Channels {
    /// Numbers per voxel.
    pub(crate) count: u64,
    /// Index of the number that is the voxel; `None`: the luminance of the first three.
    pub(crate) wanted: Option<u64>,
}

impl Channels {
    /// One number for each voxel.
    pub(crate) const ONE: Self = Self { count: 1, wanted: Some(0) };

    /// Channel that the user has selected, or the default: the luminance of colours.
    pub(crate) fn choose(
        path: &Path,
        count: u64,
        meaning: Meaning,
        selection: &Selection,
        notes: &mut Vec<Message>,
    ) -> Result<Self, SourceError> {
        if count <= 1 {
            selection.channel_of(path, 1)?;
            return Ok(Self::ONE);
        }
        if selection.channel.is_some() {
            return Ok(Self { count, wanted: Some(selection.channel_of(path, count)?) });
        }
        let last = count - 1;
        if meaning == Meaning::Components {
            let what = format!("{count} numbers per voxel; a volume has one");
            let advice = Message::from("choose one with ").option(ReadOption::Channel);
            return Err(SourceError::unsupported(path, what, advice.text(format_args!(" 0 to {last}"))));
        }
        if count >= 3 {
            let what = Message::from("colours: their luminance is used; ").option(ReadOption::Channel);
            notes.push(what.text(format_args!(" 0 to {last} takes one channel instead")));
            return Ok(Self { count, wanted: None });
        }
        notes.push(first_of(&format!("{count} channels"), ReadOption::Channel, count));
        Ok(Self { count, wanted: Some(0) })
    }
}

/// Volumes that follow one another along z, and the selected one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Frames {
    pub(crate) count: u64,
    pub(crate) wanted: u64,
}

impl Frames {
    /// A single volume.
    pub(crate) const ONE: Self = Self { count: 1, wanted: 0 };
}

/// Types of numbers in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Number {
    /// A voxel type.
    Voxel(VoxelType),
    /// 64-bit integer.
    Whole { signed: bool },
    /// 16-bit float (IEEE 754 binary16).
    Half,
}

impl Number {
    /// Voxel type of the same size that the grid uses for these numbers: f64 for 64-bit integers, u16 for
    /// half-precision floats.
    pub(crate) fn stored(self) -> VoxelType {
        match self {
            Self::Voxel(voxel_type) => voxel_type,
            Self::Whole { .. } => VoxelType::F64,
            Self::Half => VoxelType::U16,
        }
    }

    /// Values of little-endian numbers, as doubles.
    pub(crate) fn values(self, numbers: &[u8]) -> Vec<f64> {
        match self {
            Self::Voxel(voxel_type) => voxels_as_f64(voxel_type, numbers),
            Self::Whole { signed } => {
                numbers.as_chunks().0.iter().map(|number| whole(*number, signed) as f64).collect()
            }
            Self::Half => numbers.as_chunks().0.iter().map(|number| f16::from_le_bytes(*number).to_f64()).collect(),
        }
    }
}

/// Conversion of each number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Numbers {
    /// No conversion.
    AsStored,
    /// From an integer, `count` bits from bit `low` on.
    Bits { low: u32, count: u32, signed: bool },
    /// 64-bit integers, stored as [`VoxelType::F64`], become the voxels' type, which holds all of them.
    Whole { signed: bool },
    /// Half-precision floats, stored as [`VoxelType::U16`], become [`VoxelType::F32`].
    Half,
}

/// Absent 64-bit integers, which need not fit the type of the voxels, and the voxel that replaces them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct AbsentWhole {
    /// Absent numbers as doubles; unused places are NaN.
    values: [f64; ABSENT_LIMIT],
    /// Voxel of absent numbers.
    marker: f64,
}

impl AbsentWhole {
    /// Rule for these numbers, without a marker.
    fn of(absent: &[f64]) -> Self {
        let values = std::array::from_fn(|i| absent.get(i).copied().unwrap_or(f64::NAN));
        Self { values, marker: f64::NAN }
    }

    fn is_absent(&self, number: i128) -> bool {
        self.values.contains(&(number as f64))
    }
}

/// Conversion of a grid's numbers to voxels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Elements {
    pub(crate) channels: Channels,
    pub(crate) frames: Frames,
    pub(crate) numbers: Numbers,
    /// Absent 64-bit integers, if there are any.
    pub(crate) absent: Option<AbsentWhole>,
    /// Type of the voxels.
    pub(crate) voxel_type: VoxelType,
}

impl Elements {
    /// No conversion: the numbers are the voxels.
    pub(crate) fn plain(voxel_type: VoxelType) -> Self {
        Self { channels: Channels::ONE, frames: Frames::ONE, numbers: Numbers::AsStored, absent: None, voxel_type }
    }

    /// Layout of the grid of all numbers: `channels.count` numbers per voxel along x, `frames.count` volumes along z.
    pub(crate) fn widened(channels: Channels, frames: Frames, layout: GridLayout) -> GridLayout {
        let [x, y, z] = layout.dims.0;
        GridLayout { dims: Dims([x.saturating_mul(channels.count), y, z.saturating_mul(frames.count)]), ..layout }
    }

    /// Conversion for a grid of this number type. Reads all 64-bit integers once to find a type that holds them.
    pub(crate) fn of(
        path: &Path,
        grid: &impl NumberGrid,
        number: Number,
        (channels, frames): (Channels, Frames),
        notes: &mut Vec<Message>,
    ) -> Result<Self, SourceError> {
        Self::of_explained(path, grid, (number, &[]), (channels, frames), notes)
    }

    /// Voxel that stands for absent 64-bit integers, if there are any.
    pub(crate) fn marker(&self) -> Option<f64> {
        self.absent.map(|absent| absent.marker)
    }

    /// As [`Self::of`], for numbers of which some are absent: those of 64 bits need not fit the type of the others.
    pub(crate) fn of_explained(
        path: &Path,
        grid: &impl NumberGrid,
        (number, absent): (Number, &[f64]),
        (channels, frames): (Channels, Frames),
        notes: &mut Vec<Message>,
    ) -> Result<Self, SourceError> {
        let elements = Self { channels, frames, ..Self::plain(number.stored()) };
        match number {
            Number::Voxel(_) => Ok(elements),
            Number::Whole { signed } => elements.narrowed(path, grid, (signed, absent), notes),
            Number::Half => {
                notes.push("half-precision floats: kept as f32, which holds all of them".into());
                Ok(Self { numbers: Numbers::Half, voxel_type: VoxelType::F32, ..elements })
            }
        }
    }

    /// Dims of the volume in voxels.
    pub(crate) fn dims(&self, grid: &impl NumberGrid) -> Dims {
        let [x, y, z] = grid.layout().dims.0;
        Dims([x / self.channels.count, y, z / self.frames.count])
    }

    /// Converts 64-bit integers to the smallest type that holds all of them, and notes it. Reads every number once.
    fn narrowed(
        self,
        path: &Path,
        grid: &impl NumberGrid,
        (signed, absent): (bool, &[f64]),
        notes: &mut Vec<Message>,
    ) -> Result<Self, SourceError> {
        let mut absent = AbsentWhole::of(absent);
        let mut has_absent = false;
        let [mut least, mut greatest] = [i128::MAX, i128::MIN];
        for part in grid.parts(grid.layout().dims.full_box()) {
            let mut numbers = vec![0; part.voxels() * 8];
            grid.read_box(part, &mut numbers)?;
            for number in numbers.as_chunks::<8>().0 {
                let value = whole(*number, signed);
                if absent.is_absent(value) {
                    has_absent = true;
                    continue;
                }
                (least, greatest) = (least.min(value), greatest.max(value));
            }
        }
        if least > greatest {
            (least, greatest) = (0, 0);
        }
        // Absent numbers become a neighbour of the others: the one with the smaller type.
        let markers = if has_absent { vec![least - 1, greatest + 1] } else { vec![least] };
        let fitting = |marker: &i128| Some((fitting(least.min(*marker), greatest.max(*marker))?, *marker));
        let Some((voxel_type, marker)) = markers.iter().filter_map(fitting).min_by_key(|(fitting, _)| fitting.bytes())
        else {
            let what = format!("64-bit integers of {least} to {greatest} fit no voxel type");
            return Err(SourceError::unsupported(path, what, "subtract or divide what they have in common first"));
        };
        let name = if signed { "int64" } else { "uint64" };
        notes.push(format!("{name}, of {least} to {greatest}: kept as {voxel_type}, which holds all of them").into());
        absent.marker = marker as f64;
        let absent = has_absent.then_some(absent);
        Ok(Self { numbers: Numbers::Whole { signed }, absent, voxel_type, ..self })
    }

    /// As [`crate::VolumeSource::read_box`].
    pub(crate) fn read_box(&self, grid: &impl NumberGrid, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let stored = grid.layout().voxel_type;
        if out.is_empty() {
            return Ok(());
        }
        let slices = grid.layout().dims.0[2] / self.frames.count;
        let in_frame = |[x, y, z]: [u64; 3]| [x, y, z + self.frames.wanted * slices];
        let voxels = VoxelBox { start: in_frame(voxels.start), end: in_frame(voxels.end) };
        if self.channels == Channels::ONE && self.numbers == Numbers::AsStored {
            return grid.read_box(voxels, out);
        }
        let count = index(self.channels.count);
        let most = SCRATCH_BYTES / (count * stored.bytes());
        let mut rest = out;
        let mut scratch = Vec::new();
        for part in boxes(voxels, most as u64, u64::MAX) {
            let widened = |[x, y, z]: [u64; 3]| [x * count as u64, y, z];
            let numbers = VoxelBox { start: widened(part.start), end: widened(part.end) };
            scratch.resize(numbers.voxels() * stored.bytes(), 0);
            grid.read_box(numbers, &mut scratch)?;
            let (now, later) = rest.split_at_mut(part.voxels() * self.voxel_type.bytes());
            self.convert(stored, &scratch, now);
            rest = later;
        }
        Ok(())
    }

    /// Converts numbers to voxels.
    pub(crate) fn convert(&self, stored: VoxelType, numbers: &[u8], out: &mut [u8]) {
        if self.numbers == Numbers::Half {
            return self.convert_halves(numbers, out);
        }
        if (self.channels.wanted, stored, self.numbers) == (None, VoxelType::U8, Numbers::AsStored) {
            return luminances_of_bytes(numbers, index(self.channels.count), out);
        }
        let groups = numbers.chunks_exact(stored.bytes() * index(self.channels.count));
        let voxels = out.chunks_exact_mut(self.voxel_type.bytes());
        let picked = |group: &[u8], voxel: &mut [u8]| match self.channels.wanted {
            Some(channel) => voxel.copy_from_slice(&group[index(channel) * stored.bytes()..][..stored.bytes()]),
            None => with_voxel!(stored, V => {
                let colours = group.chunks_exact(size_of::<V>()).map(|number| V::read_le(number).to_f64());
                let thousandths: f64 = colours.zip(LUMINANCE).map(|(colour, share)| colour * share).sum();
                V::from_f64(thousandths / 1000.0).write_le(voxel);
            }),
        };
        if let Numbers::Whole { signed } = self.numbers {
            for (group, voxel) in groups.zip(voxels) {
                let mut number = [0; 8];
                picked(group, &mut number);
                let number = whole(number, signed);
                let value = match self.absent {
                    Some(absent) if absent.is_absent(number) => absent.marker,
                    _ => number as f64,
                };
                with_voxel!(self.voxel_type, V => V::from_f64(value).write_le(voxel));
            }
            return;
        }
        if self.channels == Channels::ONE {
            out.copy_from_slice(numbers);
        } else {
            groups.zip(voxels).for_each(|(group, voxel)| picked(group, voxel));
        }
        if let Numbers::Bits { low, count, signed } = self.numbers {
            let kept = |word| bits(word, low, count, signed);
            match stored.bytes() {
                1 => out.iter_mut().for_each(|voxel| *voxel = low_8(kept((*voxel).into()))),
                2 => out.as_chunks_mut::<2>().0.iter_mut().for_each(|voxel| {
                    *voxel = low_16(kept(u16::from_le_bytes(*voxel).into())).to_le_bytes();
                }),
                _ => out.as_chunks_mut::<4>().0.iter_mut().for_each(|voxel| {
                    *voxel = kept(u32::from_le_bytes(*voxel)).to_le_bytes();
                }),
            }
        }
    }
}

impl Elements {
    /// Converts little-endian half-precision floats to voxels.
    fn convert_halves(&self, numbers: &[u8], out: &mut [u8]) {
        let value = |number: &[u8; 2]| f16::from_le_bytes(*number).to_f32();
        let groups = numbers.as_chunks::<2>().0.chunks_exact(index(self.channels.count));
        for (group, voxel) in groups.zip(out.as_chunks_mut::<4>().0) {
            let found = match self.channels.wanted {
                Some(channel) => value(&group[index(channel)]),
                None => {
                    let parts = group.iter().zip(LUMINANCE).map(|(number, share)| f64::from(value(number)) * share);
                    single(parts.sum::<f64>() / 1000.0)
                }
            };
            *voxel = found.to_le_bytes();
        }
    }
}

/// Luminances of byte colours, three or more per voxel, in integers; the results equal those in doubles.
fn luminances_of_bytes(numbers: &[u8], count: usize, out: &mut [u8]) {
    let shares = LUMINANCE.map(cast::whole::<u32>);
    let luminance = |[red, green, blue]: [u8; 3]| {
        let thousandths = shares[0] * u32::from(red) + shares[1] * u32::from(green) + shares[2] * u32::from(blue);
        let (whole, rest) = (thousandths / 1000, thousandths % 1000);
        // Halves are rounded to even.
        low_8(whole + u32::from(rest + (whole & 1) > 500))
    };
    if count == 3 {
        numbers.as_chunks::<3>().0.iter().zip(out).for_each(|(colours, voxel)| *voxel = luminance(*colours));
        return;
    }
    for (group, voxel) in numbers.chunks_exact(count).zip(out) {
        *voxel = luminance([group[0], group[1], group[2]]);
    }
}

/// The smallest type that holds all integers of a range; doubles where they are exact.
fn fitting(least: i128, greatest: i128) -> Option<VoxelType> {
    let holds = |t: &VoxelType| {
        let (low, high) = t.limits();
        cast::whole::<i128>(low) <= least && greatest <= cast::whole::<i128>(high)
    };
    let is_exact = -EXACT_IN_DOUBLES <= least && greatest <= EXACT_IN_DOUBLES;
    let mut integers = VoxelType::ALL.into_iter().filter(|t| !t.is_float());
    integers.find(holds).or_else(|| is_exact.then_some(VoxelType::F64))
}

/// A 64-bit integer from its little-endian bytes.
fn whole(bytes: [u8; 8], signed: bool) -> i128 {
    if signed { i64::from_le_bytes(bytes).into() } else { u64::from_le_bytes(bytes).into() }
}

/// `count` bits of a word, from bit `low` on.
#[inline]
fn bits(word: u32, low: u32, count: u32, signed: bool) -> u32 {
    let word = word << (32 - low - count);
    if signed { (word.cast_signed() >> (32 - count)).cast_unsigned() } else { word >> (32 - count) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_of_words() {
        let kept = |word: u16, low, count, signed| bits(word.into(), low, count, signed) as u16;
        assert_eq!(kept(0xf123, 0, 12, false), 0x123);
        assert_eq!(kept(0x1830, 0, 13, true) as i16, 0x1830 - 0x2000);
        assert_eq!(kept(0x1230, 4, 12, false), 0x123);
        assert_eq!(kept(0x8000, 0, 16, true) as i16, i16::MIN);
    }

    #[test]
    fn absent_whole_numbers_become_a_neighbour_of_the_others() {
        assert_eq!(
            [fitting(0, 255), fitting(-1, 60), fitting(0, 1 << 40)],
            [Some(VoxelType::U8), Some(VoxelType::I8), Some(VoxelType::F64)]
        );
        let absent = AbsentWhole { marker: -1.0, ..AbsentWhole::of(&[i64::MIN as f64]) };
        let numbers = Numbers::Whole { signed: true };
        let elements = Elements { numbers, absent: Some(absent), ..Elements::plain(VoxelType::I8) };
        let bytes = [7, i64::MIN, i64::MIN + 2].map(i64::to_le_bytes);
        let mut out = [0; 3];
        elements.convert(VoxelType::F64, bytes.as_flattened(), &mut out);
        // Doubles cannot tell the fill value of netCDF from the least number.
        assert_eq!(out.map(u8::cast_signed), [7, -1, -1]);
    }

    #[test]
    fn half_floats_are_what_they_were() {
        // All half floats: f32 represents each exactly; only the bits of NaN differ.
        let all: Vec<u8> = (0..=u16::MAX).flat_map(u16::to_le_bytes).collect();
        let elements = Elements { numbers: Numbers::Half, ..Elements::plain(VoxelType::F32) };
        let mut out = vec![0; 2 * all.len()];
        elements.convert(VoxelType::U16, &all, &mut out);
        for (bits, voxel) in (0..=u16::MAX).zip(out.as_chunks::<4>().0) {
            let (found, expected) = (f32::from_le_bytes(*voxel), half_by_its_definition(bits));
            assert!(
                found.is_nan() && expected.is_nan() || f64::from(found) == expected,
                "{bits:04x}: {found} {expected}"
            );
            assert_eq!(found.is_sign_negative(), bits >> 15 == 1, "{bits:04x}");
        }
        // The colours 1, 2, 4: single channels, and the luminance.
        let colours = [0x3c00u16, 0x4000, 0x4400].map(u16::to_le_bytes);
        let convert = |wanted| {
            let mut out = [0; 4];
            let channels = Channels { count: 3, wanted };
            Elements { channels, ..elements }.convert(VoxelType::U16, colours.as_flattened(), &mut out);
            f32::from_le_bytes(out)
        };
        assert_eq!([convert(Some(1)), convert(None)], [2.0, 0.299 + 2.0 * 0.587 + 4.0 * 0.114]);
    }

    /// Value by IEEE 754-2008, 3.4: one sign bit, 5 exponent bits, 10 fraction bits.
    fn half_by_its_definition(bits: u16) -> f64 {
        let (exponent, fraction) = (i32::from(bits >> 10 & 31), f64::from(bits & 0x3ff) / 1024.0);
        let size = match exponent {
            0 => fraction * 2f64.powi(-14),
            31 if fraction == 0.0 => f64::INFINITY,
            31 => f64::NAN,
            _ => (1.0 + fraction) * 2f64.powi(exponent - 15),
        };
        if bits >> 15 == 1 { -size } else { size }
    }

    #[test]
    fn luminances_in_whole_numbers_are_those_in_doubles() {
        let colours: Vec<u8> = (0..1 << 18u32)
            .flat_map(|i| [(i & 63) * 4 + 3, (i >> 6 & 63) * 4 + (i & 3), (i >> 12) * 4 + 1].map(|colour| colour as u8))
            .collect();
        let mut found = vec![0; colours.len() / 3];
        luminances_of_bytes(&colours, 3, &mut found);
        for (group, found) in colours.as_chunks::<3>().0.iter().zip(found) {
            let thousandths: f64 = group.iter().zip(LUMINANCE).map(|(colour, share)| f64::from(*colour) * share).sum();
            assert_eq!(found, u8::from_f64(thousandths / 1000.0), "{group:?}");
        }
    }

    #[test]
    fn luminance_and_single_channels() {
        let convert = |wanted, numbers: &[u8]| {
            let channels = Channels { count: 4, wanted };
            let elements = Elements { channels, ..Elements::plain(VoxelType::U8) };
            let mut out = vec![0; numbers.len() / 4];
            elements.convert(VoxelType::U8, numbers, &mut out);
            out
        };
        let colours = [255, 255, 255, 9, 255, 0, 0, 9, 0, 255, 0, 9, 0, 0, 255, 9];
        assert_eq!(convert(None, &colours), [255, 76, 150, 29]);
        assert_eq!(convert(Some(3), &colours), [9; 4]);
        assert_eq!(convert(Some(1), &colours), [255, 0, 255, 0]);
    }
}
