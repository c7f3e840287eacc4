//! How the CPU ray caster integrates along a ray: the method that users get, and what it is compared with.
//!
//! Every method walks the same bricks and macro cells, skips the same ones, reads through the same streamer and cache,
//! and ends at the same scene: only what happens inside a visible macro cell differs.

use super::comparison::Sampling;
use super::cpu::TERMINATION_OPACITY;

/// How a frame integrates in mode `dvr`. All other modes know one method only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    /// Cell by cell: the default (docs/decisions/001-cells-not-steps.md).
    Cells(CellRule),
    /// Sample by sample, as most other ray casters do: for comparison, never the default.
    Sampled(Sampling),
}

impl Method {
    /// What users get.
    pub const DEFAULT: Self = Self::Cells(CellRule::DEFAULT);

    /// Opacity at which a ray ends in mode `dvr`.
    #[inline]
    #[must_use]
    pub fn termination_opacity(&self) -> f64 {
        match self {
            Self::Cells(rule) => rule.termination_opacity,
            Self::Sampled(sampling) => sampling.termination_opacity,
        }
    }
}

impl Default for Method {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// How finely cells are integrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CellRule {
    /// Gauss pairs between two splits of a chord.
    pub pairs: Pairs,
    /// A ray ends when its opacity reaches this; above 1, never.
    pub termination_opacity: f64,
}

impl CellRule {
    /// What users get.
    pub const DEFAULT: Self =
        Self { pairs: Pairs::Adaptive { density: 1.0 }, termination_opacity: TERMINATION_OPACITY };
}

impl Default for CellRule {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Number of Gauss pairs between two splits of a chord.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pairs {
    /// As many as the transfer function's variation and the shading want, times `density`.
    Adaptive {
        /// 1 is what users get.
        density: f32,
    },
    /// Always this many.
    Fixed(u32),
}
