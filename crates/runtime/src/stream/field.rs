//! Fields and [`FieldBrick`]: the key of states, caches and page tables.
//!
//! A *field* is one quantity over the whole grid: a channel, or one time step of a channel. A [`BrickKey`] says where a
//! brick lies, and bricks of two fields lie at the same places. Data that outlives the picture of one field is keyed by
//! [`FieldBrick`]. Code that draws one field uses [`BrickKey`]; its view says which field that is. A container holds
//! one field today.

use std::fmt;
use std::hash::{Hash, Hasher};

use supervol_format::{BrickKey, Lod};

/// Number of a field, from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Field(pub u16);

impl Field {
    /// The first field: a container's only one.
    pub const FIRST: Self = Self(0);

    /// The brick of this field at this place.
    #[inline]
    #[must_use]
    pub const fn brick(self, brick: BrickKey) -> FieldBrick {
        FieldBrick { field: self, brick }
    }

    /// The bricks of this field at these places, in the same order.
    #[must_use]
    pub fn bricks(self, bricks: impl IntoIterator<Item = BrickKey>) -> Vec<FieldBrick> {
        bricks.into_iter().map(|brick| self.brick(brick)).collect()
    }
}

/// Name of one brick of one field. Ordered by field, then by key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct FieldBrick {
    /// The field.
    pub field: Field,
    /// Level and place of the brick in the field.
    pub brick: BrickKey,
}

/// 2^64 divided by pi, made odd: separates the hashes of different fields.
const INVERSE_PI: u64 = 0x517c_c1b7_2722_0a95;

impl FieldBrick {
    /// Level of detail.
    #[must_use]
    pub fn lod(self) -> Lod {
        self.brick.lod()
    }
}

impl Hash for FieldBrick {
    /// Hashes one word: a second one would cost a second round of the hash at every look-up.
    #[inline]
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u64(self.brick.bits() ^ u64::from(self.field.0).wrapping_mul(INVERSE_PI));
    }
}

impl fmt::Display for FieldBrick {
    /// The first field is not printed.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.field {
            Field::FIRST => self.brick.fmt(f),
            Field(number) => write!(f, "{} of field {number}", self.brick),
        }
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::BrickIndex;

    use super::*;

    #[test]
    fn people_are_told_the_field_where_it_is_not_the_first() {
        let brick = BrickKey::new(Lod(2), BrickIndex([3, 4, 5]));
        assert_eq!(Field::FIRST.brick(brick).to_string(), "brick (3, 4, 5) of LOD 2");
        assert_eq!(Field(7).brick(brick).to_string(), "brick (3, 4, 5) of LOD 2 of field 7");
    }
}
