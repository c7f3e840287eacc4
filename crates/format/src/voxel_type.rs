//! The eight voxel types, and conversion of voxels from and to bytes.
//!
//! Voxels in memory and in containers are little endian, packed without padding, x fastest.
//! A voxel is *absent* if it equals the declared nodata value, or if it is a NaN or an infinity. Those cannot be
//! interpolated (0 * inf is not 0), so both are holes ([`Absence`]).

use serde::{Deserialize, Serialize};

/// Type of one stored voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[repr(u8)]
pub enum VoxelType {
    /// 8-bit unsigned integer.
    U8 = 1,
    /// 8-bit signed integer.
    I8 = 2,
    /// 16-bit unsigned integer.
    U16 = 3,
    /// 16-bit signed integer.
    I16 = 4,
    /// 32-bit unsigned integer.
    U32 = 5,
    /// 32-bit signed integer.
    I32 = 6,
    /// IEEE 754 single precision.
    F32 = 7,
    /// IEEE 754 double precision.
    F64 = 8,
}

impl VoxelType {
    /// Every type, in tag order.
    pub const ALL: [Self; 8] = [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32, Self::F64];

    /// Bytes of one voxel: 1, 2, 4 or 8.
    // Loops over voxels call this: if it were not inlined, the compiler would not vectorize them.
    #[inline]
    #[must_use]
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Name, as on the command line and in `info --json`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::U8 => "u8",
            Self::I8 => "i8",
            Self::U16 => "u16",
            Self::I16 => "i16",
            Self::U32 => "u32",
            Self::I32 => "i32",
            Self::F32 => "f32",
            Self::F64 => "f64",
        }
    }

    /// The type with this name, or `None`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.name() == name)
    }

    /// The type with this tag in a container, or `None`.
    #[must_use]
    pub fn from_tag(tag: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|t| *t as u32 == tag)
    }

    /// Whether the type has NaNs and infinities.
    #[inline]
    #[must_use]
    pub const fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Least and greatest finite value.
    #[inline]
    #[must_use]
    pub const fn limits(self) -> (f64, f64) {
        match self {
            Self::U8 => (0.0, u8::MAX as f64),
            Self::I8 => (i8::MIN as f64, i8::MAX as f64),
            Self::U16 => (0.0, u16::MAX as f64),
            Self::I16 => (i16::MIN as f64, i16::MAX as f64),
            Self::U32 => (0.0, u32::MAX as f64),
            Self::I32 => (i32::MIN as f64, i32::MAX as f64),
            Self::F32 => (f32::MIN as f64, f32::MAX as f64),
            Self::F64 => (f64::MIN, f64::MAX),
        }
    }
}

impl std::fmt::Display for VoxelType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// Rust type of a stored voxel.
pub trait Voxel: bytemuck::Pod + PartialEq + PartialOrd + Send + Sync + 'static {
    /// Voxel type of this Rust type.
    const TYPE: VoxelType;
    /// The value as a double; exact for every voxel type.
    fn to_f64(self) -> f64;
    /// The nearest value of this type (ties to even, saturating); NaN becomes 0 for integers.
    fn from_f64(value: f64) -> Self;
    /// The nearest value of this type to a whole number (saturating; for floats ties to even).
    fn from_whole(value: i64) -> Self;
    /// As [`Voxel::from_whole`], from 32 bits, of which a vector register holds more.
    fn from_word(value: i32) -> Self;
    /// The value of an integer of at most 16 bits; for wider types the `as i32` conversion, which may lose bits.
    fn to_word(self) -> i32;
    /// Reads one voxel from exactly `size_of::<Self>()` little-endian bytes.
    fn read_le(bytes: &[u8]) -> Self;
    /// Writes the voxel as little-endian bytes.
    fn write_le(self, out: &mut [u8]);
}

macro_rules! voxel {
    ($t:ty, $tag:ident, |$v:ident| $from:expr, |$w:ident| $from_whole:expr, |$i:ident| $from_word:expr) => {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "saturating or rounding, as the trait promises; the promise of `to_word` allows lost bits"
        )]
        impl Voxel for $t {
            const TYPE: VoxelType = VoxelType::$tag;
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn from_f64($v: f64) -> Self {
                $from
            }
            #[inline(always)]
            fn from_whole($w: i64) -> Self {
                $from_whole
            }
            #[inline(always)]
            fn from_word($i: i32) -> Self {
                $from_word
            }
            #[inline(always)]
            fn to_word(self) -> i32 {
                self as i32
            }
            #[inline(always)]
            fn read_le(bytes: &[u8]) -> Self {
                Self::from_le_bytes(bytes.try_into().expect("the caller hands exactly one voxel's bytes"))
            }
            #[inline(always)]
            fn write_le(self, out: &mut [u8]) {
                out.copy_from_slice(&self.to_le_bytes());
            }
        }
    };
}
// `as` from float to integer saturates and maps NaN to 0, as the trait promises.
macro_rules! whole_voxel {
    ($t:ty, $tag:ident, |$i:ident| $from_word:expr) => {
        voxel!(
            $t,
            $tag,
            |v| v.round_ties_even() as $t,
            |w| w.clamp(i64::from(<$t>::MIN), i64::from(<$t>::MAX)) as $t,
            |$i| $from_word
        );
    };
}
whole_voxel!(u8, U8, |i| i.clamp(u8::MIN.into(), u8::MAX.into()) as u8);
whole_voxel!(i8, I8, |i| i.clamp(i8::MIN.into(), i8::MAX.into()) as i8);
whole_voxel!(u16, U16, |i| i.clamp(u16::MIN.into(), u16::MAX.into()) as u16);
whole_voxel!(i16, I16, |i| i.clamp(i16::MIN.into(), i16::MAX.into()) as i16);
whole_voxel!(u32, U32, |i| i.max(0) as u32);
whole_voxel!(i32, I32, |i| i);
voxel!(f32, F32, |v| v as f32, |w| w as f32, |i| i as f32);
voxel!(f64, F64, |v| v, |w| w as f64, |i| f64::from(i));

/// Evaluates an expression with the Rust type of a [`VoxelType`]: `with_voxel!(t, V => f::<V>(x))`.
#[macro_export]
macro_rules! with_voxel {
    ($voxel_type:expr, $v:ident => $body:expr) => {
        match $voxel_type {
            $crate::VoxelType::U8 => {
                type $v = u8;
                $body
            }
            $crate::VoxelType::I8 => {
                type $v = i8;
                $body
            }
            $crate::VoxelType::U16 => {
                type $v = u16;
                $body
            }
            $crate::VoxelType::I16 => {
                type $v = i16;
                $body
            }
            $crate::VoxelType::U32 => {
                type $v = u32;
                $body
            }
            $crate::VoxelType::I32 => {
                type $v = i32;
                $body
            }
            $crate::VoxelType::F32 => {
                type $v = f32;
                $body
            }
            $crate::VoxelType::F64 => {
                type $v = f64;
                $body
            }
        }
    };
}

/// Rule that tells present voxels from absent ones; one per container.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Absence {
    /// Stored value that means "no data", if the source declares one. NaN is always absent and is never declared here.
    pub nodata: Option<f64>,
}

impl Absence {
    /// Only NaN and infinities are absent.
    pub const NON_FINITE_ONLY: Self = Self { nodata: None };

    /// Rule for a volume of this type whose source declares `nodata`.
    ///
    /// Voxels are compared after rounding to their type, so the value is rounded, too. In a file of floats, 1e30 is the
    /// float next to 1e30. A value that is not finite is ignored, because it is absent anyway.
    #[must_use]
    pub fn declared(nodata: Option<f64>, voxel_type: VoxelType) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "rounding to the type is wanted")]
        let round = |v: f64| if voxel_type == VoxelType::F32 { f64::from(v as f32) } else { v };
        Self { nodata: nodata.map(round).filter(|v| v.is_finite()) }
    }

    /// Whether this stored value is absent.
    #[inline(always)]
    #[must_use]
    pub fn is_absent(self, stored: f64) -> bool {
        !stored.is_finite() | (self.nodata == Some(stored))
    }

    /// Stored value that marks a hole at coarser levels: a coarser voxel is a hole if all its finer voxels are absent.
    ///
    /// Integer volumes without a nodata value have no holes; the marker is never used for them.
    #[must_use]
    pub fn marker(self) -> f64 {
        self.nodata.unwrap_or(f64::NAN)
    }

    /// Whether a volume of this type can have holes.
    #[must_use]
    pub fn possible(self, voxel_type: VoxelType) -> bool {
        voxel_type.is_float() || self.nodata.is_some()
    }
}

/// The voxels of a little-endian byte slice as doubles, in the order of the slice.
///
/// # Panics
/// If the slice is not a whole number of voxels.
pub fn voxels_as_f64(voxel_type: VoxelType, bytes: &[u8]) -> Vec<f64> {
    assert_eq!(bytes.len() % voxel_type.bytes(), 0, "{} bytes are no whole number of {voxel_type} voxels", bytes.len());
    with_voxel!(voxel_type, V => bytes.chunks_exact(size_of::<V>()).map(|b| V::read_le(b).to_f64()).collect())
}
