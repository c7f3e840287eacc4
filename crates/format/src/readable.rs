//! Formatting of numbers for messages and listings.

use std::fmt::{Display, Formatter, Result};

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
    fn amounts_are_rounded_up() {
        let cases = [(0, "0 MiB"), (1, "0.001 MiB"), (1 << 20, "1 MiB"), ((1 << 20) + 1, "1.1 MiB")];
        for (bytes, expected) in cases.into_iter().chain([(10 << 20, "10 MiB"), ((700 << 20) + 1, "701 MiB")]) {
            assert_eq!(Mib(bytes).to_string(), expected);
        }
        assert_eq!(Mib(u64::MAX).to_string(), "17592186044416 MiB");
    }
}
