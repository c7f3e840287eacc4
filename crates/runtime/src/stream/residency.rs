//! Decoded bricks, and the view of resident bricks that ray casters read.
//!
//! Voxels are stored numbers of a [`ValueMap`]; voxel types with more than 16 bits are render values.
//!
//! Bricks include their apron, x fastest. Macro cells cover the core from its first voxel, x fastest.

use supervol_format::cast::{narrow, single};
use supervol_format::codec::BrickShape;
use supervol_format::container::toc::BrickEntry;
use supervol_format::voxel_type::{Absence, Voxel};
use supervol_format::{BrickKey, VoxelType, with_voxel};
use supervol_scene::value_map::ValueMap;

use crate::lod::deviation::Holes;
use crate::stream::held::BrickRef;

/// Voxels of one brick, apron included, x fastest.
#[derive(Debug, Clone, PartialEq)]
pub enum Voxels {
    /// Stored u8; i8 with 128 added.
    U8(Vec<u8>),
    /// Stored u16; i16 with 32768 added.
    U16(Vec<u16>),
    /// Render values of all other types; NaN is a hole.
    F32(Vec<f32>),
}

impl Voxels {
    /// Whether a voxel is absent.
    #[must_use]
    pub fn has_holes(&self, map: &ValueMap) -> bool {
        match self {
            Self::U8(voxels) => map.absent.is_some_and(|absent| voxels.iter().any(|&v| u16::from(v) == absent)),
            Self::U16(voxels) => map.absent.is_some_and(|absent| voxels.contains(&absent)),
            Self::F32(voxels) => voxels.iter().any(|voxel| voxel.is_nan()),
        }
    }

    /// The `u8` memory; empty for other types.
    fn into_u8(self) -> Vec<u8> {
        if let Self::U8(voxels) = self { voxels } else { Vec::new() }
    }

    /// The `u16` memory; empty for other types.
    fn into_u16(self) -> Vec<u16> {
        if let Self::U16(voxels) = self { voxels } else { Vec::new() }
    }

    /// The `f32` memory; empty for other types.
    fn into_f32(self) -> Vec<f32> {
        if let Self::F32(voxels) = self { voxels } else { Vec::new() }
    }
}

/// Voxels of one brick as the container stores them.
#[derive(Debug, Clone, PartialEq)]
pub struct Unrounded {
    voxel_type: VoxelType,
    bytes_le: Vec<u8>,
}

impl Unrounded {
    /// Data value of a voxel.
    ///
    /// # Panics
    /// If the brick has fewer voxels.
    #[must_use]
    pub fn data_value(&self, voxel: usize, map: &ValueMap) -> f64 {
        let number = with_voxel!(self.voxel_type, V => {
            V::read_le(&self.bytes_le[voxel * size_of::<V>()..][..size_of::<V>()]).to_f64()
        });
        map.data_of_container(number)
    }
}

/// One brick in the form that ray casters read.
#[derive(Debug, Clone, PartialEq)]
pub struct DecodedBrick {
    /// The brick's key.
    pub key: BrickKey,
    /// Voxels along each axis, including the apron of 2 on both sides.
    pub extent: [u32; 3],
    /// The voxels.
    pub voxels: Voxels,
    /// Least and greatest render value that interpolation can reach in each macro cell of the core, x fastest. `min >
    /// max` means that nothing is present.
    pub macro_ranges: Vec<[f32; 2]>,
    /// Bound on what render values are off by the data, because they are rounded.
    pub rounding: f32,
    /// The voxels as the container stores them, if render values are rounded.
    pub unrounded: Option<Unrounded>,
    /// Error bound of each macro cell of the core, x fastest, as bytes ([`supervol_format::cell_errors`]); empty if the
    /// brick's bound holds in all of them.
    pub macro_errors: Vec<u8>,
}

impl DecodedBrick {
    /// Builds a brick from a container's voxels (little endian, packed) and macro-cell ranges (container values). It
    /// reuses the memory of `spare`, a brick of the same voxel type, and overwrites its contents.
    ///
    /// # Panics
    /// If the byte count does not match the voxels of this shape: decoders have checked that.
    #[must_use]
    pub fn from_stored(
        key: BrickKey,
        shape: BrickShape,
        bytes_le: &[u8],
        macro_ranges_stored: impl Iterator<Item = [f64; 2]>,
        map: &ValueMap,
        absence: Absence,
        spare: Option<Self>,
    ) -> Self {
        let BrickShape { voxel_type, extent } = shape;
        assert_eq!(bytes_le.len(), shape.bytes(), "{key}: bytes of {extent:?} {voxel_type} voxels");
        let no_memory = (Voxels::U8(Vec::new()), Vec::new(), None);
        let (spare, macro_ranges, unrounded) =
            spare.map_or(no_memory, |spare| (spare.voxels, spare.macro_ranges, spare.unrounded));
        let voxels = match voxel_type {
            VoxelType::U8 => Voxels::U8(refilled(spare.into_u8(), bytes_le.iter().copied())),
            VoxelType::I8 => Voxels::U8(refilled(spare.into_u8(), bytes_le.iter().map(|b| b ^ 0x80))),
            VoxelType::U16 => Voxels::U16(refilled(spare.into_u16(), words(bytes_le, 0))),
            VoxelType::I16 => Voxels::U16(refilled(spare.into_u16(), words(bytes_le, 0x8000))),
            _ => {
                with_voxel!(voxel_type, V => Voxels::F32(refilled(spare.into_f32(), bytes_le.chunks_exact(size_of::<V>()).map(|b| {
                    let stored = V::read_le(b).to_f64();
                    if absence.is_absent(stored) { f32::NAN } else { map.from_container(voxel_type, stored) }
                }))))
            }
        };
        let render_range = |[low, high]: [f64; 2]| {
            if low > high {
                return [f32::INFINITY, f32::NEG_INFINITY];
            }
            let (a, b) = (map.from_container(voxel_type, low), map.from_container(voxel_type, high));
            [a.min(b), a.max(b)]
        };
        let macro_ranges = refilled(macro_ranges, macro_ranges_stored.map(render_range));
        let rounding = if map.is_rounded { rounding_of(&voxels, (voxel_type, bytes_le), map) } else { 0.0 };
        let unrounded = (rounding > 0.0).then(|| {
            let memory = unrounded.map_or_else(Vec::new, |unrounded| unrounded.bytes_le);
            Unrounded { voxel_type, bytes_le: refilled(memory, bytes_le.iter().copied()) }
        });
        // A stored extent is at most 132 voxels.
        let (extent, macro_errors) = (extent.map(narrow::<u32>), Vec::new());
        Self { key, extent, voxels, macro_ranges, rounding, unrounded, macro_errors }
    }

    /// The same brick with the error bounds of its macro cells.
    #[must_use]
    pub fn with_macro_errors(self, errors: &[u8]) -> Self {
        Self { macro_errors: errors.to_vec(), ..self }
    }

    /// Bytes held by the voxels, rounded and not, and by the ranges.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let voxels = match &self.voxels {
            Voxels::U8(v) => size_of_val(&v[..]),
            Voxels::U16(v) => size_of_val(&v[..]),
            Voxels::F32(v) => size_of_val(&v[..]),
        };
        let unrounded = self.unrounded.as_ref().map_or(0, |unrounded| unrounded.bytes_le.len());
        (voxels + unrounded + size_of_val(&self.macro_ranges[..]) + self.macro_errors.len()) as u64
    }
}

/// Greatest distance of these render values from the data, rounded up.
fn rounding_of(voxels: &Voxels, (voxel_type, bytes_le): (VoxelType, &[u8]), map: &ValueMap) -> f32 {
    let Voxels::F32(rounded) = voxels else { return 0.0 };
    let most = with_voxel!(voxel_type, V => {
        let exact = bytes_le.chunks_exact(size_of::<V>()).map(|b| map.data_of_container(V::read_le(b).to_f64()));
        // Absent voxels are NaN, which no maximum takes.
        rounded.iter().zip(exact).fold(0.0, |most: f64, (&rounded, exact)| most.max((map.to_data(rounded) - exact).abs()))
    });
    single(most) * (1.0 + f32::EPSILON)
}

/// Fills the memory of another vector with these items.
fn refilled<T>(mut memory: Vec<T>, items: impl Iterator<Item = T>) -> Vec<T> {
    memory.clear();
    memory.extend(items);
    memory
}

fn words(bytes_le: &[u8], flip: u16) -> impl Iterator<Item = u16> {
    bytes_le.chunks_exact(2).map(move |b| u16::from_le_bytes([b[0], b[1]]) ^ flip)
}

/// Answer to a look-up of a brick's key.
#[derive(Debug, Clone, Copy)]
pub enum Resident<'a> {
    /// The brick itself.
    Brick(BrickRef<'a>),
    /// All voxels, apron included, have this render value.
    Uniform(f32),
    /// The brick contributes nothing: it is absent, or invisible under the transfer function. In all modes but `dvr`,
    /// only absent bricks may be answered so.
    Nothing,
    /// The brick would change the picture too much: the ray continues in its children. Only from [`BrickView::lookup`].
    TooCoarse,
    /// The brick has failed: its parent stands in.
    UseParent,
    /// The brick is not resident: the ray waits for it.
    Missing,
}

impl<'a> From<&'a DecodedBrick> for Resident<'a> {
    fn from(brick: &'a DecodedBrick) -> Self {
        Self::Brick(BrickRef::Plain(brick))
    }
}

/// The bricks that a pass may read; constant during the pass.
pub trait BrickView: Sync {
    /// The resident data of this key.
    fn lookup(&self, key: BrickKey) -> Resident<'_>;

    /// The resident data of a brick that stands in for a failed child. Never [`Resident::TooCoarse`], because nothing
    /// finer is available.
    fn stand_in(&self, key: BrickKey) -> Resident<'_> {
        self.lookup(key)
    }

    /// The TOC entry of a brick, if it is known; may read it from the container.
    fn entry(&self, _key: BrickKey) -> Option<KnownEntry> {
        None
    }
}

/// A brick's entry in the table of contents, and whether it may have holes.
#[derive(Debug, Clone, Copy)]
pub struct KnownEntry {
    /// The entry.
    pub entry: BrickEntry,
    /// Whether interpolation in the brick, or in one beneath it, may reach an absent voxel.
    pub holes: Holes,
}

#[cfg(test)]
mod tests {
    use supervol_format::{BrickIndex, Lod, ValueRange};

    use super::*;

    const FULL: ValueRange = ValueRange { min: -1000.0, max: 1000.0 };

    fn brick(t: VoxelType, bytes: &[u8], ranges: &[[f64; 2]], map: &ValueMap, nodata: Option<f64>) -> DecodedBrick {
        let shape = BrickShape { voxel_type: t, extent: [bytes.len() / t.bytes(), 1, 1] };
        let key = BrickKey::new(Lod(0), BrickIndex([0; 3]));
        let ranges = ranges.iter().copied();
        let fresh = DecodedBrick::from_stored(key, shape, bytes, ranges.clone(), map, Absence { nodata }, None);
        let elsewhere = BrickKey::new(Lod(3), BrickIndex([1; 3]));
        let spare = DecodedBrick { key: elsewhere, macro_ranges: vec![[7.0; 2]; 5], ..fresh.clone() };
        let (voxels, cells) = (fresh.bytes(), spare.macro_ranges.as_ptr());
        let again = DecodedBrick::from_stored(key, shape, bytes, ranges, map, Absence { nodata }, Some(spare));
        assert_eq!((again.bytes(), again.macro_ranges.as_ptr()), (voxels, cells), "in the same memory");
        assert_eq!(format!("{again:?}"), format!("{fresh:?}"), "whatever it held");
        fresh
    }

    #[test]
    fn signed_integers_are_biased_and_keep_their_values() {
        let map = ValueMap::for_container(VoxelType::I16, -0.5, 3.0, Some(-32768.0), FULL);
        let bytes: Vec<u8> = [-32768i16, -7, 0, 32767].iter().flat_map(|v| v.to_le_bytes()).collect();
        let b = brick(VoxelType::I16, &bytes, &[[-7.0, 32767.0], [1.0, 0.0]], &map, Some(-32768.0));
        let Voxels::U16(numbers) = &b.voxels else { panic!("i16 is stored as u16") };
        assert_eq!(map.absent, Some(numbers[0]));
        let data: Vec<f64> = numbers.iter().map(|&n| map.to_data(map.from_stored_number(f32::from(n)))).collect();
        assert_eq!(&data[1..], &[6.5, 3.0, 3.0 - 0.5 * 32767.0]);
        assert_eq!(b.macro_ranges[0], [3.0 - 0.5 * 32767.0, 6.5]);
        assert!(b.macro_ranges[1][0] > b.macro_ranges[1][1]);
        assert_eq!(b.bytes(), 8 + 16);
        let map = ValueMap::for_container(VoxelType::I8, 1.0, 0.0, None, FULL);
        let b = brick(VoxelType::I8, &[0x80, 0xff, 5], &[], &map, None);
        assert_eq!(b.voxels, Voxels::U8(vec![0, 127, 133]));
        assert_eq!(map.from_stored_number(0.0), -128.0);
    }

    #[test]
    fn values_far_from_zero_are_resolved() {
        let range = ValueRange { min: 1e9, max: 1e9 + 100.0 };
        let map = ValueMap::for_container(VoxelType::F64, 1.0, 0.0, Some(7.0), range);
        let bytes: Vec<u8> = [1e9, 1e9 + 0.001, f64::INFINITY, 7.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let b = brick(VoxelType::F64, &bytes, &[[1e9, 1e9 + 100.0]], &map, Some(7.0));
        let Voxels::F32(values) = &b.voxels else { panic!("f64 is rendered as f32") };
        assert!((map.to_data(values[1]) - map.to_data(values[0]) - 0.001).abs() < 1e-5);
        assert!(values[2].is_nan() && values[3].is_nan());
        assert_eq!(b.macro_ranges[0], [-50.0, 50.0]);
    }
}
