//! Formatting of numbers for messages and listings.

use std::fmt::{Display, Formatter, Result};

use crate::VoxelType;

/// Displays a number with the fewest digits that parse to the same value; very large and very small ones get an
/// exponent.
#[derive(Debug, Clone, Copy)]
pub struct Number(pub f64);

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let Self(value) = self;
        let short = *value == 0.0 || !value.is_finite() || (1e-5..1e16).contains(&value.abs());
        if short { write!(f, "{value}") } else { write!(f, "{value:e}") }
    }
}

/// Displays a number by the fewest decimals that are within a tolerance of it, for example -47.67 for a sum that is
/// rounded to -47.670000000000016.
#[derive(Debug, Clone, Copy)]
pub struct Shortened {
    /// The number.
    pub value: f64,
    /// Greatest difference of the displayed number; not negative.
    pub tolerance: f64,
}

impl Shortened {
    /// Share of the voxel distance up to which a coordinate may be rounded.
    const SHARE: f64 = 1e-6;
    /// Largest relative rounding of single precision, for which the shortest number is unique.
    const HALF_SINGLE: f64 = 2.9e-8;

    /// A coordinate along an axis whose voxels are `spacing` apart.
    #[must_use]
    pub fn along(value: f64, spacing: f64) -> Self {
        Self { value, tolerance: Self::SHARE * spacing.abs() }
    }

    /// A data value that a file stores with this type, times `scale`, plus an offset.
    #[must_use]
    pub fn data(value: f64, voxel_type: VoxelType, [scale, offset]: [f64; 2]) -> Self {
        let is_plain = scale == 1.0 && offset == 0.0;
        let tolerance = match voxel_type {
            // Half the distance to the next number in single precision, less rounding.
            VoxelType::F32 => Self::HALF_SINGLE * value.abs(),
            _ if is_plain => 0.0,
            VoxelType::F64 => f64::EPSILON * value.abs().max(offset.abs()),
            _ => Self::SHARE * scale.abs(),
        };
        Self { value, tolerance }
    }

    /// The displayed number.
    #[must_use]
    pub fn number(self) -> f64 {
        self.to_string().parse().unwrap_or(self.value)
    }
}

impl Display for Shortened {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let Self { value, tolerance } = *self;
        let is_near = |text: &String| text.parse().is_ok_and(|shown: f64| (shown - value).abs() <= tolerance);
        let has_exponent = value != 0.0 && tolerance < value.abs() && !(1e-5..1e16).contains(&value.abs());
        let shown =
            |digits: usize| if has_exponent { format!("{value:.digits$e}") } else { format!("{value:.digits$}") };
        match (0..=17).map(shown).find(is_near).filter(|_| value.is_finite()) {
            Some(text) if text.parse() == Ok(0.0) => write!(f, "0"),
            Some(text) => f.write_str(&text),
            None => Number(value).fmt(f),
        }
    }
}

/// Displays bytes as MiB, rounded up, because messages name sizes that must suffice. Small sizes have decimals.
#[derive(Debug, Clone, Copy)]
pub struct Mib(pub u64);

impl Display for Mib {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let Self(bytes) = *self;
        let parts_of_a_mib =
            |parts: u64| (u128::from(bytes) * u128::from(parts)).div_ceil(1 << 20) as f64 / parts as f64;
        match bytes {
            0..0x10_0000 => write!(f, "{} MiB", parts_of_a_mib(1000)),
            0x10_0000..0xA0_0000 => write!(f, "{} MiB", parts_of_a_mib(10)),
            _ => write!(f, "{} MiB", parts_of_a_mib(1)),
        }
    }
}

/// A count with its noun: `1 brick`, `2 bricks`.
#[must_use]
pub fn counted(count: u64, thing: &str) -> String {
    if count == 1 { format!("1 {thing}") } else { format!("{count} {thing}s") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        let cases = [(0.0, "0"), (-0.25, "-0.25"), (4095.0, "4095"), (1e15, "1000000000000000"), (1e-45, "1e-45")];
        for (value, expected) in cases.into_iter().chain([(-1.5e300, "-1.5e300"), (f64::INFINITY, "inf")]) {
            assert_eq!(Number(value).to_string(), expected);
        }
    }

    #[test]
    fn rounded_numbers_are_shortened_to_their_precision() {
        let told = |value: f64, spacing: f64| Shortened::along(value, spacing).to_string();
        assert_eq!(told(-47.670_000_000_000_016, 3.0), "-47.67");
        assert_eq!(told(-51.057_766_681_258_3, 6.933), "-51.05777");
        assert_eq!([told(1e-17, 1.0), told(-0.0, 0.0), told(10_123.0, 4.0)], ["0", "0", "10123"]);
        assert_eq!([told(1e300, 1.0), told(1.25e-20, 1e-20)], ["1e300", "1.25e-20"]);
        let data = |value: f64, voxel_type, scale| Shortened::data(value, voxel_type, scale).to_string();
        assert_eq!(data(280.0 - 32_767.0 * 0.01, VoxelType::I16, [0.01, 280.0]), "-47.67");
        assert_eq!(data(f64::from(1480.1f32), VoxelType::F32, [1.0, 0.0]), "1480.1");
        assert_eq!(data(f64::from(1e30f32), VoxelType::F32, [1.0, 0.0]), "1e30");
        assert_eq!(data(0.1 + 0.2, VoxelType::F64, [1.0, 0.0]), "0.30000000000000004");
    }

    #[test]
    fn amounts_are_rounded_up() {
        let cases = [(0, "0 MiB"), (1, "0.001 MiB"), (1 << 20, "1 MiB"), ((1 << 20) + 1, "1.1 MiB")];
        for (bytes, expected) in cases.into_iter().chain([(10 << 20, "10 MiB"), ((700 << 20) + 1, "701 MiB")]) {
            assert_eq!(Mib(bytes).to_string(), expected);
        }
        assert_eq!(Mib(u64::MAX).to_string(), "17592186044416 MiB");
    }
}
