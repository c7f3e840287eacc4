//! Fetches the eight corner voxels of each lane's cell from a brick, as stored numbers.

use std::marker::PhantomData;

use supervol_format::brick::APRON;
use supervol_format::cast::{narrow, single, whole};
use supervol_scene::value_map::ValueMap;

use super::simd::{Places, Simd};
use crate::stream::residency::{DecodedBrick, Voxels};

/// Corners of a cell: corner c has the offsets `(c & 1, c >> 1 & 1, c >> 2)`.
pub const CORNERS: usize = 8;

/// Result of gathers: one word per row of two voxels, or per voxel.
pub type Raw<S> = [<S as Simd>::I; CORNERS];

/// Words of a cell's four rows, from the voxel before its first corner to the one after the second; bytes only.
pub type Rows<S> = [<S as Simd>::I; CORNERS / 2];

/// The first and the second voxel of a cell's four rows.
pub type Corners<S> = [[<S as Simd>::F; CORNERS / 2]; 2];

/// Storage of voxels in bricks.
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
                let centre = f64::from(whole::<u16>((-offset / scale).round()));
                [single(centre), map.scale, single(offset + centre * scale)]
            }
            Self::F32 => [origin, 1.0, 0.0],
        }
    }

    /// The cell of [`Stored::corners`].
    #[inline(always)]
    pub fn cell<S: Simd>(self, raw: &Raw<S>, absent: Option<u16>, centre: f32) -> LaneCell<S> {
        LaneCell::new(&self.corners::<S>(raw, absent, centre))
    }

    /// Stored numbers of gathered words, minus `centre`; NaN where a number is `absent`.
    ///
    /// All numbers may be near 32768, where an `f32` has only 8 bits after the point.
    #[inline(always)]
    pub fn corners<S: Simd>(self, raw: &Raw<S>, absent: Option<u16>, centre: f32) -> Corners<S> {
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
        [first, second]
    }
}

/// The voxels of a brick, its apron included, x fastest: their number is checked once, so that gathers need not.
#[derive(Clone, Copy)]
pub struct BrickVoxels<'a> {
    first: *const u8,
    stored: Stored,
    /// Voxels between neighbours along y and z.
    strides: [i32; 2],
    brick: PhantomData<&'a DecodedBrick>,
}

impl<'a> BrickVoxels<'a> {
    /// Voxels of a decoded brick whose core has `core` voxels along each axis.
    ///
    /// # Panics
    /// If the brick has another extent or another number of voxels.
    #[must_use]
    pub fn new(brick: &'a DecodedBrick, core: [usize; 3]) -> Self {
        let extent = brick.extent.map(|n| n as usize);
        assert_eq!(extent, core.map(|n| n + 2 * APRON), "stored extent of {}", brick.key);
        let (first, stored, count): (*const u8, _, _) = match &brick.voxels {
            Voxels::U8(v) => (v.as_ptr(), Stored::U8, v.len()),
            Voxels::U16(v) => (v.as_ptr().cast(), Stored::U16, v.len()),
            Voxels::F32(v) => (v.as_ptr().cast(), Stored::F32, v.len()),
        };
        assert_eq!(count, extent.iter().product::<usize>(), "voxels of {}", brick.key);
        Self { first, stored, strides: strides_of(core), brick: PhantomData }
    }

    /// Storage type of the voxels.
    #[inline(always)]
    #[must_use]
    pub fn stored(&self) -> Stored {
        self.stored
    }

    /// Voxels between neighbours along y and z.
    #[inline(always)]
    #[must_use]
    pub fn strides(&self) -> [i32; 2] {
        self.strides
    }

    /// Prefetches a voxel. Any offset is allowed: invalid addresses are not loaded.
    #[inline(always)]
    pub fn prefetch<S: Simd>(&self, place: i32) {
        S::prefetch(self.first.wrapping_offset((place * self.stored.bytes()) as isize));
    }

    /// Gathers words that begin at `N` distances from each place, less `before`, all in voxels.
    ///
    /// The storage is tested for every cell: the processor predicts the branch, and one kernel serves all kinds.
    ///
    /// # Safety
    /// As for [`Simd::gather_around`].
    #[inline(always)]
    unsafe fn words<S: Simd, const N: usize>(&self, places: &Places, distances: [i32; N], before: i32) -> [S::I; N] {
        let first = self.first.wrapping_offset(-((before * self.stored.bytes()) as isize));
        // SAFETY: the caller's promise.
        unsafe {
            match self.stored {
                Stored::U8 => S::gather_around(first, 1, places, distances),
                Stored::U16 => S::gather_around(first, 2, places, distances),
                Stored::F32 => S::gather_around(first, 4, places, distances),
            }
        }
    }

    /// Gathers the cells whose first corners lie at `base`, in voxels from the first.
    ///
    /// # Safety
    /// In every lane, it is a cell of the brick: from -1 to the last voxel of its core along each axis. The apron holds its corners,
    /// and two voxels after each row's first.
    #[inline(always)]
    pub unsafe fn gather<S: Simd>(&self, base: &Places) -> Raw<S> {
        // SAFETY: the caller's promise.
        unsafe { self.gather_before::<S>(base, 0) }
    }

    /// The same, `before` voxels earlier.
    ///
    /// # Safety
    /// The same as for [`Self::gather`], which also holds `before` voxels before each row's first.
    #[inline(always)]
    unsafe fn gather_before<S: Simd>(&self, base: &Places, before: i32) -> Raw<S> {
        let [dy, dz] = self.strides;
        let mut raw = [S::splat_int(0); CORNERS];
        // SAFETY: the caller's promise; a word holds both voxels of a row, or one.
        let words = unsafe { self.words::<S, 4>(base, [0, dy, dz, dy + dz], before) };
        raw[..CORNERS / 2].copy_from_slice(&words);
        if self.stored == Stored::F32 {
            // SAFETY: as above.
            let words = unsafe { self.words::<S, 4>(base, [1, dy + 1, dz + 1, dy + dz + 1], before) };
            raw[CORNERS / 2..].copy_from_slice(&words);
        }
        raw
    }

    /// Gathers as [`Self::gather`] does, of bytes with the voxels before and behind, which shading wants.
    ///
    /// # Safety
    /// As for [`Self::gather`]: the apron holds one voxel before each row's first, too.
    #[inline(always)]
    pub unsafe fn gather_rows<S: Simd>(&self, base: &Places, rows: &mut Option<Rows<S>>) -> Raw<S> {
        if self.stored != Stored::U8 {
            // SAFETY: the caller's promise.
            return unsafe { self.gather::<S>(base) };
        }
        // SAFETY: the caller's promise.
        let mut raw = unsafe { self.gather_before::<S>(base, 1) };
        *rows = Some([raw[0], raw[1], raw[2], raw[3]]);
        for word in &mut raw[..CORNERS / 2] {
            *word = S::shift_right::<8>(*word);
        }
        raw
    }

    /// The voxels around cells whose first corners lie at `base`; `absent`: stored number of holes.
    #[inline(always)]
    pub fn around<S: Simd>(&self, base: S::I, absent: Option<u16>) -> VoxelNeighbourhood<'a, S> {
        VoxelNeighbourhood { voxels: *self, base, absent }
    }
}

/// Voxels between neighbours along y and z of a brick whose core has so many along each axis.
#[must_use]
pub fn strides_of(core: [usize; 3]) -> [i32; 2] {
    let [nx, ny, _] = core.map(|n| n + 2 * APRON);
    [narrow::<i32>(nx), narrow::<i32>(nx * ny)]
}

/// The voxels around cells whose first corners lie at `base`.
#[derive(Clone, Copy)]
pub struct VoxelNeighbourhood<'a, S: Simd> {
    voxels: BrickVoxels<'a>,
    /// In voxels from the brick's first.
    base: S::I,
    /// Stored number of holes.
    absent: Option<u16>,
}

impl<S: Simd> VoxelNeighbourhood<'_, S> {
    /// Differences of stored numbers over two voxels along each axis, at the eight corners of the cells; NaN where one is
    /// absent. `rows` are those of the cells, if they are known.
    ///
    /// # Safety
    /// As for [`BrickVoxels::gather`]: the apron holds one voxel further on every side.
    #[inline(always)]
    pub unsafe fn slopes(&self, rows: Option<&Rows<S>>) -> [LaneCell<S>; 3] {
        let [dy, dz] = self.voxels.strides;
        // SAFETY: the caller's promise: rows from one voxel before the corners to one behind, and rows of two beside.
        let (rows, y, z) = unsafe {
            (
                match rows {
                    Some(&[a, b, c, d]) => [self.bytes(a), self.bytes(b), self.bytes(c), self.bytes(d)],
                    None => [self.four(-1), self.four(dy - 1), self.four(dz - 1), self.four(dy + dz - 1)],
                },
                [self.two(-dy), self.two(2 * dy), self.two(dz - dy), self.two(dz + 2 * dy)],
                [self.two(-dz), self.two(dy - dz), self.two(2 * dz), self.two(dy + 2 * dz)],
            )
        };
        let (mut low, mut inner, mut high) = (y, y, y);
        for row in 0..4 {
            let [before, first, second, after] = rows[row];
            low[row] = [before, first];
            inner[row] = [first, second];
            high[row] = [second, after];
        }
        // Rows 0 and 2 lie at y = 0, rows 0 and 1 at z = 0.
        [
            LaneCell::difference(high, low),
            LaneCell::difference([inner[1], y[1], inner[3], y[3]], [y[0], inner[0], y[2], inner[2]]),
            LaneCell::difference([inner[2], inner[3], z[2], z[3]], [z[0], z[1], inner[0], inner[1]]),
        ]
    }

    /// The word that begins with the voxel at `offset` from the cells.
    ///
    /// # Safety
    /// In every lane, it lies in the array.
    #[inline(always)]
    unsafe fn word(&self, offset: i32) -> S::I {
        let bytes = (self.base + S::splat_int(offset)) * S::splat_int(self.voxels.stored.bytes());
        // SAFETY: the caller's promise.
        unsafe { S::gather(self.voxels.first, bytes, S::mask_from_bits(u32::MAX)) }
    }

    /// The voxels at `offset` and `offset + 1`.
    ///
    /// # Safety
    /// In every lane, both lie in the array, and so do four bytes from the first on.
    #[inline(always)]
    unsafe fn two(&self, offset: i32) -> [S::F; 2] {
        // SAFETY: the caller's promise.
        let word = unsafe { self.word(offset) };
        match self.voxels.stored {
            Stored::U8 => self.numbers(split::<S, 8>(word)),
            Stored::U16 => self.numbers(split::<S, 16>(word)),
            // SAFETY: the caller's promise.
            Stored::F32 => [S::float_from_bits(word), S::float_from_bits(unsafe { self.word(offset + 1) })],
        }
    }

    /// Four voxels from `offset` on.
    ///
    /// # Safety
    /// In every lane, all four lie in the array.
    #[inline(always)]
    unsafe fn four(&self, offset: i32) -> [S::F; 4] {
        if self.voxels.stored == Stored::U8 {
            // SAFETY: the caller's promise.
            return self.bytes(unsafe { self.word(offset) });
        }
        // SAFETY: the caller's promise.
        let ([first, second], [third, fourth]) = unsafe { (self.two(offset), self.two(offset + 2)) };
        [first, second, third, fourth]
    }

    /// Four voxels of a word.
    #[inline(always)]
    fn bytes(&self, word: S::I) -> [S::F; 4] {
        let [first, second] = self.numbers(split::<S, 8>(word));
        let [third, fourth] = self.numbers(split::<S, 8>(S::shift_right::<16>(word)));
        [first, second, third, fourth]
    }

    /// Stored numbers as floats.
    #[inline(always)]
    fn numbers(&self, [a, b]: [S::I; 2]) -> [S::F; 2] {
        let (first, second) = (S::to_float(a), S::to_float(b));
        let Some(absent) = self.absent else { return [first, second] };
        let (hole, nan) = (S::splat_int(i32::from(absent)), S::splat(f32::NAN));
        [S::select(S::eq_int(a, hole), nan, first), S::select(S::eq_int(b, hole), nan, second)]
    }
}

/// The two lowest voxels of a word, `BITS` bits each.
#[inline(always)]
fn split<S: Simd, const BITS: u32>(word: S::I) -> [S::I; 2] {
    let low_bits = S::splat_int((1 << BITS) - 1);
    [S::and_int(word, low_bits), S::and_int(S::shift_right::<BITS>(word), low_bits)]
}

/// Corners in the form for trilinear interpolation: the four rows' first voxels, and their differences along x.
#[derive(Clone, Copy)]
pub struct LaneCell<S: Simd> {
    first: [S::F; 4],
    rise: [S::F; 4],
}

impl<S: Simd> LaneCell<S> {
    /// The difference of two rows, corner by corner.
    #[inline(always)]
    fn difference(a: [[S::F; 2]; 4], b: [[S::F; 2]; 4]) -> Self {
        let mut cell = Self { first: [S::splat(0.0); 4], rise: [S::splat(0.0); 4] };
        for row in 0..4 {
            cell.first[row] = a[row][0] - b[row][0];
            cell.rise[row] = (a[row][1] - b[row][1]) - cell.first[row];
        }
        cell
    }

    /// The cell between these corners.
    #[inline(always)]
    pub fn new([first, second]: &Corners<S>) -> Self {
        let mut rise = *first;
        for row in 0..4 {
            rise[row] = second[row] - first[row];
        }
        Self { first: *first, rise }
    }

    /// The value at fractions of the cell.
    #[inline(always)]
    pub fn at(&self, [x, y, z]: [S::F; 3]) -> S::F {
        let mut rows = self.first;
        for row in 0..4 {
            rows[row] = S::mul_add(x, self.rise[row], self.first[row]);
        }
        let near = S::mul_add(y, rows[1] - rows[0], rows[0]);
        let far = S::mul_add(y, rows[3] - rows[2], rows[2]);
        S::mul_add(z, far - near, near)
    }

    /// Bound on the change of the value per cell, summed over the axes.
    #[inline(always)]
    pub fn steepness(&self) -> S::F {
        let (first, rise) = (&self.first, &self.rise);
        let along_x = S::max(S::abs(rise[0]), S::abs(rise[3])) + S::max(S::abs(rise[1]), S::abs(rise[2]));
        let along_y = S::max(S::abs(first[1] - first[0]), S::abs(first[3] - first[2]));
        let along_z = S::max(S::abs(first[2] - first[0]), S::abs(first[3] - first[1]));
        along_x + along_y + along_z
    }

    /// Least and greatest corner.
    #[inline(always)]
    pub fn range(&self) -> [S::F; 2] {
        let (mut low, mut high) = (self.first[0], self.first[0]);
        for row in 0..4 {
            let [a, b] = [self.first[row], self.first[row] + self.rise[row]];
            low = S::min(low, S::min(a, b));
            high = S::max(high, S::max(a, b));
        }
        [low, high]
    }

    /// Coefficient of xyz.
    #[inline(always)]
    pub fn twist(&self) -> S::F {
        (self.rise[3] - self.rise[2]) - (self.rise[1] - self.rise[0])
    }
}
