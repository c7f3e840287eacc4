//! Bricks in the host cache: plain or packed, and the one way from both to plain voxels.
//!
//! Ray casters read plain voxels only. A packed brick is unpacked as a whole when rays enter it, into a small store of
//! unpacked bricks ([`UnpackedBricks`]) that all casting threads share. So every caster, panel and upload draws the same
//! bits from either form.

use std::ops::Deref;
use std::sync::Arc;

use crate::stream::cache::unpacked::{Unpacked, UnpackedBricks};
use crate::stream::field::FieldBrick;
use crate::stream::packed::PackedVoxels;
use crate::stream::residency::{DecodedBrick, Voxels};

/// Choice of the form of bricks in the host cache. Pictures are the same.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum BrickForm {
    /// Plain while the bricks of a frame fit into the cache, packed otherwise.
    #[default]
    ByBudget,
    /// Always plain.
    Plain,
    /// Always packed, where that is smaller.
    Packed,
}

/// One brick with packed voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct PackedBrick {
    /// The brick without its voxels.
    brick: DecodedBrick,
    voxels: PackedVoxels,
    plain_bytes: u64,
}

impl PackedBrick {
    /// Packs a brick; `None` if that makes it no smaller. Bricks whose render values are rounded stay plain: they hold
    /// their voxels twice.
    #[must_use]
    pub fn new(brick: &DecodedBrick) -> Option<Self> {
        if brick.unrounded.is_some() {
            return None;
        }
        let (plain_bytes, extent) = (brick.bytes(), brick.extent.map(|n| n as usize));
        let voxels = PackedVoxels::new(&brick.voxels, extent);
        let packed = Self { brick: brick.without_voxels(), voxels, plain_bytes };
        (packed.bytes() < plain_bytes).then_some(packed)
    }

    /// The plain brick, in the memory of another one.
    #[must_use]
    pub fn unpacked(&self, spare: Option<DecodedBrick>) -> DecodedBrick {
        DecodedBrick { voxels: self.voxels.unpacked(spare.map(|spare| spare.voxels)), ..self.brick.clone() }
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.voxels.bytes() + self.brick.bytes()
    }

    /// Bytes that the plain brick holds.
    #[must_use]
    pub fn plain_bytes(&self) -> u64 {
        self.plain_bytes
    }
}

/// One brick in the host cache.
#[derive(Debug, Clone, PartialEq)]
pub enum HeldBrick {
    /// Plain voxels.
    Plain(DecodedBrick),
    /// Packed voxels.
    Packed(PackedBrick),
}

impl HeldBrick {
    /// The plain brick, if it is plain.
    #[must_use]
    pub fn into_plain(self) -> Option<DecodedBrick> {
        if let Self::Plain(brick) = self { Some(brick) } else { None }
    }
}

/// A resident brick in either form.
#[derive(Debug, Clone, Copy)]
pub enum BrickRef<'a> {
    /// Plain voxels.
    Plain(&'a DecodedBrick),
    /// Packed voxels, and the store for unpacked ones.
    Packed(FieldBrick, &'a PackedBrick, &'a UnpackedBricks),
}

impl<'a> BrickRef<'a> {
    /// The brick with plain voxels; unpacks them, if nobody has lately.
    #[must_use]
    pub fn read(self) -> ReadBrick<'a> {
        match self {
            Self::Plain(brick) => ReadBrick::Borrowed(brick),
            Self::Packed(key, packed, store) => ReadBrick::Shared(store.get(key, packed)),
        }
    }

    /// All but the voxels: those may be empty.
    #[must_use]
    pub fn facts(self) -> &'a DecodedBrick {
        match self {
            Self::Plain(brick) => brick,
            Self::Packed(_, packed, _) => &packed.brick,
        }
    }
}

/// A brick with plain voxels, for reading.
#[derive(Debug, Clone)]
pub enum ReadBrick<'a> {
    /// Lies in the host cache.
    Borrowed(&'a DecodedBrick),
    /// Was unpacked.
    Shared(Arc<Unpacked>),
}

impl Deref for ReadBrick<'_> {
    type Target = DecodedBrick;

    #[inline]
    fn deref(&self) -> &DecodedBrick {
        match self {
            Self::Borrowed(brick) => brick,
            Self::Shared(unpacked) => unpacked.get().expect("it was unpacked before it was handed out"),
        }
    }
}

impl DecodedBrick {
    /// The same brick with no voxels.
    fn without_voxels(&self) -> Self {
        let Self { key, extent, ref macro_ranges, rounding, ref macro_errors, .. } = *self;
        let voxels = match self.voxels {
            Voxels::U8(_) => Voxels::U8(Vec::new()),
            Voxels::U16(_) => Voxels::U16(Vec::new()),
            Voxels::F32(_) => Voxels::F32(Vec::new()),
        };
        let (macro_ranges, macro_errors) = (macro_ranges.clone(), macro_errors.clone());
        Self { key, extent, voxels, macro_ranges, rounding, unrounded: None, macro_errors }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::codec::BrickShape;
    use supervol_format::voxel_type::Absence;
    use supervol_format::{BrickIndex, BrickKey, Lod, ValueRange, VoxelType};
    use supervol_scene::value_map::ValueMap;

    use super::*;

    fn brick(voxel_type: VoxelType, voxels: &[u8], scale: f64) -> DecodedBrick {
        let shape = BrickShape { voxel_type, extent: [voxels.len() / voxel_type.bytes() / 64, 8, 8] };
        let map = ValueMap::for_container(voxel_type, scale, 0.0, None, ValueRange { min: 0.0, max: 255.0 });
        let key = BrickKey::new(Lod(1), BrickIndex([3, 2, 1]));
        let ranges = [[1.0, 2.0], [3.0, 9.0]].into_iter();
        let brick = DecodedBrick::from_stored(key, shape, voxels, ranges, &map, Absence { nodata: None }, None);
        brick.with_macro_errors(&[4, 5])
    }

    #[test]
    fn an_unpacked_brick_is_the_plain_one_and_a_packed_one_counts_its_own_bytes() {
        let voxels: Vec<u8> = (0..1024u32).map(|i| (i % 13) as u8).collect();
        let plain = brick(VoxelType::U8, &voxels, 1.0);
        let packed = PackedBrick::new(&plain).unwrap();
        assert_eq!(packed.unpacked(None), plain);
        assert_eq!(packed.unpacked(Some(brick(VoxelType::U8, &[3; 64], 1.0))), plain);
        assert_eq!(packed.plain_bytes(), plain.bytes());
        // Two blocks of 512 codes of 4 bits.
        assert_eq!(packed.bytes(), packed.voxels.bytes() + 2 * 8 + 2);
        assert!((512..600).contains(&packed.voxels.bytes()), "{}", packed.voxels.bytes());
    }

    #[test]
    fn noise_stays_plain_and_so_do_rounded_values() {
        let mut random = supervol_format::random::Random::new(1);
        let noise: Vec<u8> = (0..1024).map(|_| random.below(256) as u8).collect();
        assert_eq!(PackedBrick::new(&brick(VoxelType::U8, &noise, 1.0)), None);
        let values: Vec<u8> = (0..64u32).flat_map(|i| f64::from(i % 2).to_le_bytes()).collect();
        let rounded = brick(VoxelType::F64, &values, 1.0 / 3.0);
        assert!(rounded.unrounded.is_some());
        assert_eq!(PackedBrick::new(&rounded), None);
    }
}
