//! From a brick's voxels to the eight corners of each lane's cell, in stored numbers.

use super::simd::Simd;
use crate::raycast::volume::ValueMap;

/// Corners of a cell: corner c has the offsets `(c & 1, c >> 1 & 1, c >> 2)`.
pub const CORNERS: usize = 8;

/// What gathers bring: one word per row of two voxels, or per voxel.
pub type Raw<S> = [<S as Simd>::I; CORNERS];

/// How bricks store voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stored {
    /// Stored numbers of one byte.
    U8,
    /// Stored numbers of two bytes.
    U16,
    /// Render values.
    F32,
}

impl Stored {
    /// Bytes of a voxel.
    #[inline(always)]
    #[must_use]
    pub fn bytes(self) -> i32 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    /// Centre, scale and offset: render value - origin = (stored number - centre) * scale + offset.
    #[must_use]
    pub fn to_values_from(self, origin: f32, map: &ValueMap) -> [f32; 3] {
        match self {
            Self::U8 | Self::U16 => {
                // The number whose render value is nearest to the origin; `as` maps NaN to 0.
                let (scale, offset) = (f64::from(map.scale), f64::from(map.offset) - f64::from(origin));
                let centre = f64::from((-offset / scale).round() as u16);
                [centre as f32, map.scale, (offset + centre * scale) as f32]
            }
            Self::F32 => [origin, 1.0, 0.0],
        }
    }

    /// Gathers the cells whose first corners lie at `base`, in voxels from `voxels`; `strides` are those of y and z.
    ///
    /// Which kind it is, is asked for every cell: the processor foresees the answer, and one kernel serves all kinds.
    ///
    /// # Safety
    /// In every lane, all corners lie in the array, and two voxels after each row's first.
    #[inline(always)]
    pub unsafe fn gather<S: Simd>(self, voxels: *const u8, base: S::I, strides: [i32; 2]) -> Raw<S> {
        let mut raw = [S::splat_int(0); CORNERS];
        let size = self.bytes();
        let bytes = base * S::splat_int(size);
        let all = S::mask_from_bits(u32::MAX);
        for (row, offset) in [0, strides[0], strides[1], strides[0] + strides[1]].into_iter().enumerate() {
            // SAFETY: the caller's promise; a word holds both voxels of a row, or one.
            raw[row] = unsafe { S::gather(voxels, bytes + S::splat_int(offset * size), all) };
        }
        if self == Self::F32 {
            for (row, offset) in [0, strides[0], strides[1], strides[0] + strides[1]].into_iter().enumerate() {
                // SAFETY: as above.
                raw[4 + row] = unsafe { S::gather(voxels, bytes + S::splat_int((offset + 1) * size), all) };
            }
        }
        raw
    }

    /// Stored numbers of what was gathered, less `centre`; NaN where a number is `absent`.
    ///
    /// Numbers may all lie near 32768, where an `f32` has 8 bits behind the point.
    #[inline(always)]
    pub fn cell<S: Simd>(self, raw: &Raw<S>, absent: Option<u16>, centre: f32) -> Cell<S> {
        let mut first = [S::splat(0.0); 4];
        let mut second = first;
        for row in 0..4 {
            let words = match self {
                Self::U8 => split::<S, 8>(raw[row]),
                Self::U16 => split::<S, 16>(raw[row]),
                Self::F32 => {
                    first[row] = S::float_from_bits(raw[row]) - S::splat(centre);
                    second[row] = S::float_from_bits(raw[4 + row]) - S::splat(centre);
                    continue;
                }
            };
            [first[row], second[row]] = [S::to_float(words[0]), S::to_float(words[1])];
            if centre != 0.0 {
                first[row] = first[row] - S::splat(centre);
                second[row] = second[row] - S::splat(centre);
            }
            if let Some(absent) = absent {
                let (hole, nan) = (S::splat_int(i32::from(absent)), S::splat(f32::NAN));
                first[row] = S::select(S::eq_int(words[0], hole), nan, first[row]);
                second[row] = S::select(S::eq_int(words[1], hole), nan, second[row]);
            }
        }
        let mut rise = first;
        for row in 0..4 {
            rise[row] = second[row] - first[row];
        }
        Cell { first, rise }
    }
}

/// The two lowest voxels of a word, `BITS` bits each.
#[inline(always)]
fn split<S: Simd, const BITS: u32>(word: S::I) -> [S::I; 2] {
    let low_bits = S::splat_int((1 << BITS) - 1);
    [S::and_int(word, low_bits), S::and_int(S::shift_right::<BITS>(word), low_bits)]
}

/// Corners as trilinear interpolation wants them: the four rows' first voxels, and their differences along x.
#[derive(Clone, Copy)]
pub struct Cell<S: Simd> {
    first: [S::F; 4],
    rise: [S::F; 4],
}

impl<S: Simd> Cell<S> {
    /// The value at fractions of the cell.
    #[inline(always)]
    pub fn at(&self, [x, y, z]: [S::F; 3]) -> S::F {
        let row = |r: usize| S::mul_add(x, self.rise[r], self.first[r]);
        let (r0, r1, r2, r3) = (row(0), row(1), row(2), row(3));
        let (near, far) = (S::mul_add(y, r1 - r0, r0), S::mul_add(y, r3 - r2, r2));
        S::mul_add(z, far - near, near)
    }

    /// Bound on the change of the value per cell, summed over the axes.
    #[inline(always)]
    pub fn steepness(&self) -> S::F {
        let between = |a: usize, b: usize| S::abs(self.first[b] - self.first[a]);
        let along_x =
            S::max(S::abs(self.rise[0]), S::abs(self.rise[3])) + S::max(S::abs(self.rise[1]), S::abs(self.rise[2]));
        along_x + S::max(between(0, 1), between(2, 3)) + S::max(between(0, 2), between(1, 3))
    }

    /// Coefficient of xyz.
    #[inline(always)]
    pub fn twist(&self) -> S::F {
        (self.rise[3] - self.rise[2]) - (self.rise[1] - self.rise[0])
    }
}
