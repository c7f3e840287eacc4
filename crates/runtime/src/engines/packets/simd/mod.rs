//! SIMD lanes: the one place that knows instruction sets.
//!
//! [`Simd`] has [`Simd::LANES`] lanes of `f32` and `i32`, and masks over them. An algorithm is written once, generic
//! over it, with `#[inline(always)]` on all its functions; [`dispatch`] calls it with the processor's features switched
//! on. There are three sets: AVX-512 (16 lanes), AVX2 with FMA (8), and plain arrays for the compiler's vectoriser (4;
//! correct everywhere). Lanes are independent: a lane's result does not depend on its neighbours or their number.
//! Results differ between sets only where one fuses a multiplication and an addition.
//!
//! All `unsafe` of the runtime is in this folder and on the way to its gathers:
//! - `fetch` (voxels), `leap` (clouds and ranges) and `lookup` (tables) own the arrays and check their lengths.
//! - `walk` keeps rays inside their brick.
//! - `packet`, `span`, `shaded_cells`, `values` and `surfaces` gather along these walks.
//! - `visit`, `value_tiles` and `trace` start the walks.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Not, Sub};
use std::str::FromStr;

pub use portable::Portable;

/// Most lanes of any set.
pub const LANES_LIMIT: usize = 16;

/// One width and instruction set. See the module.
pub trait Simd: Copy + Send + Sync + 'static {
    /// Lanes; at most [`LANES_LIMIT`].
    const LANES: usize;
    /// One `f32` per lane.
    type F: Copy + Add<Output = Self::F> + Sub<Output = Self::F> + Mul<Output = Self::F> + Div<Output = Self::F>;
    /// One `i32` per lane; sums and products wrap.
    type I: Copy + Add<Output = Self::I> + Mul<Output = Self::I>;
    /// One boolean per lane.
    type M: Copy + BitAnd<Output = Self::M> + BitOr<Output = Self::M> + Not<Output = Self::M>;

    /// The same number in every lane.
    fn splat(value: f32) -> Self::F;
    /// See [`Simd::splat`].
    fn splat_int(value: i32) -> Self::I;
    /// The first lanes of an array.
    fn load(values: &[f32; LANES_LIMIT]) -> Self::F;
    /// See [`Simd::load`].
    fn load_int(values: &[i32; LANES_LIMIT]) -> Self::I;
    /// Stores into the first lanes of an array.
    fn store(values: Self::F, into: &mut [f32; LANES_LIMIT]);
    /// See [`Simd::store`].
    fn store_int(values: Self::I, into: &mut [i32; LANES_LIMIT]);
    /// Stores the lanes of the mask at the beginning of an array, in their order; the rest is arbitrary.
    fn compress(values: Self::F, mask: Self::M, into: &mut [f32; LANES_LIMIT]);
    /// Moves the first values into the lanes of the mask, in their order; the other lanes come from `others`.
    fn expand(values: Self::F, mask: Self::M, others: Self::F) -> Self::F;

    /// `a * b + c`.
    fn mul_add(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// The lesser; the second where one is NaN.
    fn min(a: Self::F, b: Self::F) -> Self::F;
    /// The greater; the second where one is NaN.
    fn max(a: Self::F, b: Self::F) -> Self::F;
    /// Magnitude.
    fn abs(a: Self::F) -> Self::F;
    /// Sum of all lanes.
    fn sum(a: Self::F) -> f32;
    /// Square root.
    fn sqrt(a: Self::F) -> Self::F;
    /// The greatest integer that is not above.
    fn floor(a: Self::F) -> Self::F;
    /// `2^n` for integers n in [-126, 127].
    fn exp2_whole(n: Self::F) -> Self::F;
    /// Exact for integers; others round toward zero.
    fn to_int(a: Self::F) -> Self::I;
    /// Exact up to 2^24.
    fn to_float(a: Self::I) -> Self::F;
    /// `a >> SHIFT`, the sign kept.
    fn shift_right<const SHIFT: u32>(a: Self::I) -> Self::I;
    /// Bits in both.
    fn and_int(a: Self::I, b: Self::I) -> Self::I;

    /// `a < b`; false where one is NaN.
    fn lt(a: Self::F, b: Self::F) -> Self::M;
    /// `a <= b`; false where one is NaN.
    fn le(a: Self::F, b: Self::F) -> Self::M;
    /// Lanes where a is NaN.
    fn is_nan(a: Self::F) -> Self::M;
    /// `a < b`.
    fn lt_int(a: Self::I, b: Self::I) -> Self::M;
    /// `a == b`.
    fn eq_int(a: Self::I, b: Self::I) -> Self::M;
    /// `a` where the mask holds, else `b`.
    fn select(mask: Self::M, a: Self::F, b: Self::F) -> Self::F;
    /// See [`Simd::select`].
    fn select_int(mask: Self::M, a: Self::I, b: Self::I) -> Self::I;
    /// Lane l from bit l.
    fn mask_from_bits(bits: u32) -> Self::M;
    /// Bit l from lane l; all higher bits are zero.
    fn bits(mask: Self::M) -> u32;

    /// `table[index]` for a table of 16; only the index's low 4 bits count.
    fn lookup16(table: &[f32; 16], index: Self::I) -> Self::F;
    /// `table[index]` for a table of 32; only the index's low 5 bits count.
    fn lookup32(table: &[f32; 32], index: Self::I) -> Self::F;

    /// The 4 bytes at each byte offset from `base`, lowest first, where the mask holds; 0 elsewhere.
    ///
    /// # Safety
    /// The 4 bytes at the offset of every lane of the mask can be read.
    unsafe fn gather(base: *const u8, offsets: Self::I, mask: Self::M) -> Self::I;
    /// The 4 bytes at each of `N` distances from each of the first places, lowest first. Places and distances are in
    /// items of `size` bytes from `base`.
    ///
    /// Reads word by word, with places in memory: two thirds of the time of as many gathers on Zen 5, whose gathers are
    /// microcode.
    ///
    /// # Safety
    /// The 4 bytes at all distances from the first [`Simd::LANES`] places can be read.
    #[inline(always)]
    unsafe fn gather_around<const N: usize>(
        base: *const u8,
        size: i32,
        places: &Places,
        distances: [i32; N],
    ) -> [Self::I; N] {
        let mut rows = [base; N];
        for (row, distance) in rows.iter_mut().zip(distances) {
            // The pointer may lie outside of the array: the words do not.
            *row = base.wrapping_offset((distance * size) as isize);
        }
        let mut words = [[0; LANES_LIMIT]; N];
        for (lane, &place) in places.iter().enumerate().take(Self::LANES) {
            for (words, row) in words.iter_mut().zip(rows) {
                let word = row.wrapping_offset((place * size) as isize).cast::<Word>();
                // Volatile, because compilers turn it into a gather in some builds.
                // SAFETY: the caller's promise; a `Word` may lie anywhere.
                words[lane] = i32::from_le(unsafe { word.read_volatile() }.0);
            }
        }
        let mut out = [Self::splat_int(0); N];
        for (out, words) in out.iter_mut().zip(&words) {
            *out = Self::load_int(words);
        }
        out
    }
    /// Begins to load the memory around an address, if it is valid.
    #[inline(always)]
    fn prefetch(_address: *const u8) {}
    /// The bits of integers as floats.
    fn float_from_bits(a: Self::I) -> Self::F;
    /// The bits of floats as integers.
    fn bits_from_float(a: Self::F) -> Self::I;

    /// Runs a task as a function of its own, so that its registers do not displace its caller's.
    fn apart<T: TaskOf<Self>>(task: T) -> T::Output;
}

/// Four bytes at any address.
#[derive(Clone, Copy)]
#[repr(C, packed)]
struct Word(i32);

/// The lanes of a mask, from its bits.
pub fn lanes(mask: u32) -> impl Iterator<Item = usize> {
    (0..LANES_LIMIT).filter(move |lane| mask >> lane & 1 == 1)
}

/// Integers of one packet, lane by lane.
pub type Places = [i32; LANES_LIMIT];

/// Stores integers in memory, for [`Simd::gather_around`]. It hides the values from the compiler, which would otherwise
/// extract them from registers lane by lane and lose the gain.
#[inline(always)]
pub fn hidden_in_memory<S: Simd, const N: usize>(integers: [S::I; N]) -> [Places; N] {
    let mut places = [[0; LANES_LIMIT]; N];
    for (into, from) in places.iter_mut().zip(integers) {
        S::store_int(from, into);
    }
    std::hint::black_box(&mut places);
    places
}

/// Numbers from number `first` on.
///
/// # Panics
/// If there are none for the last lanes of any set.
#[inline(always)]
pub fn load_from<S: Simd>(numbers: &[f32], first: usize) -> S::F {
    S::load(numbers[first..].first_chunk().expect("there is room for all lanes behind the last number"))
}

/// A task for any number of lanes.
pub trait Task {
    /// Its result.
    type Output;
    /// Runs the task. This function and all it calls with lanes must be `#[inline(always)]`, so that they are compiled
    /// for the set.
    fn run<S: Simd>(self) -> Self::Output;
}

/// A task for the lanes of one set.
pub trait TaskOf<S: Simd> {
    /// Its result.
    type Output;
    /// See [`Task::run`].
    fn run_lanes(self) -> Self::Output;
}

impl<S: Simd, T: Task> TaskOf<S> for T {
    type Output = T::Output;

    #[inline(always)]
    fn run_lanes(self) -> T::Output {
        self.run::<S>()
    }
}

/// An instruction set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum InstructionSet {
    /// AVX-512 F, BW, DQ and VL: 16 lanes.
    Avx512,
    /// AVX2 and FMA: 8 lanes.
    Avx2,
    /// Arrays of 4, vectorised by the compiler.
    Portable,
}

impl InstructionSet {
    /// All of them, the fastest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Its name on the command line and in statistics.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Portable => "portable",
        }
    }

    /// Whether this processor has it.
    #[must_use]
    pub fn is_available(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        let (avx512, avx2) = (avx512::is_available(), avx2::is_available());
        #[cfg(not(target_arch = "x86_64"))]
        let (avx512, avx2) = (false, false);
        match self {
            Self::Avx512 => avx512,
            Self::Avx2 => avx2,
            Self::Portable => true,
        }
    }

    /// The fastest set of this processor.
    #[must_use]
    pub fn best() -> Self {
        Self::ALL.into_iter().find(|set| set.is_available()).unwrap_or(Self::Portable)
    }

    /// The sets of this processor, the fastest first.
    pub fn available() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|set| set.is_available())
    }
}

impl Default for InstructionSet {
    fn default() -> Self {
        Self::best()
    }
}

impl FromStr for InstructionSet {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let set = Self::ALL.into_iter().find(|set| set.name() == name);
        let set = set.ok_or_else(|| format!("'{name}' is no instruction set; expected avx512, avx2 or portable"))?;
        if set.is_available() { Ok(set) } else { Err(format!("this processor has no {name}")) }
    }
}

/// An array of one value per axis (or place, or channel). With `[0, 1, 2].map(closure)` the compiler would decide
/// whether the closure has the set's instructions.
macro_rules! for_three {
    ($i:ident => $value:expr) => {
        [
            {
                let $i = 0;
                $value
            },
            {
                let $i = 1;
                $value
            },
            {
                let $i = 2;
                $value
            },
        ]
    };
}
pub(crate) use for_three;

/// Runs a task with a set of instructions.
///
/// # Panics
/// If this processor has no such set.
pub fn dispatch<T: Task>(set: InstructionSet, task: T) -> T::Output {
    assert!(set.is_available(), "this processor has no {}", set.name());
    match set {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the set was just seen to be available.
        InstructionSet::Avx512 => unsafe { avx512::run(task) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: as above.
        InstructionSet::Avx2 => unsafe { avx2::run(task) },
        _ => task.run::<Portable>(),
    }
}

/// `exp(-a)` for a >= 0, error at most 2e-7; 0 from a = 87 on.
///
/// `2^(n + x)` with integer n and x in [-1/2, 1/2]; Taylor series of `2^x`, whose first omitted term is below 2e-8.
#[inline(always)]
pub fn exp_minus<S: Simd>(a: S::F) -> S::F {
    let z = S::max(a * S::splat(-std::f32::consts::LOG2_E), S::splat(-126.0));
    let n = S::floor(z + S::splat(0.5));
    let x = z - n;
    let mut p = S::splat(1.540_353e-4);
    for coefficient in [1.333_355_8e-3, 9.618_129e-3, 5.550_41e-2, 0.240_226_5, std::f32::consts::LN_2, 1.0] {
        p = S::mul_add(p, x, S::splat(coefficient));
    }
    p * S::exp2_whole(n)
}

/// `-ln(a)` for a in [2^-126, 1], relative error at most 3e-7 plus 2e-7 absolute.
///
/// `a = 2^n m` with m in [sqrt(1/2), sqrt(2)]; series of `ln((1 + z) / (1 - z))`, whose first omitted term is below
/// 3e-8.
#[inline(always)]
pub fn minus_ln<S: Simd>(a: S::F) -> S::F {
    const ONE_BITS: i32 = 0x3f80_0000;
    const FRACTION_BITS: u32 = 23;
    let bits = S::bits_from_float(a);
    let fraction = S::and_int(bits, S::splat_int((1 << FRACTION_BITS) - 1));
    let m = S::float_from_bits(fraction + S::splat_int(ONE_BITS));
    let n = S::to_float(S::shift_right::<FRACTION_BITS>(bits) + S::splat_int(-(ONE_BITS >> FRACTION_BITS)));
    let is_high = S::lt(S::splat(std::f32::consts::SQRT_2), m);
    let m = S::select(is_high, m * S::splat(0.5), m);
    let n = S::select(is_high, n + S::splat(1.0), n);
    let z = (m - S::splat(1.0)) / (m + S::splat(1.0));
    let z2 = z * z;
    let mut p = S::splat(2.0 / 7.0);
    for coefficient in [2.0 / 5.0, 2.0 / 3.0, 2.0] {
        p = S::mul_add(p, z2, S::splat(coefficient));
    }
    S::splat(0.0) - S::mul_add(n, S::splat(std::f32::consts::LN_2), z * p)
}

#[cfg(test)]
mod tests;
