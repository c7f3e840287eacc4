//! Error budget of a ray: its cells spend it, front to back, and never more than there is.
//!
//! All errors are absolute: shares of full scale of the pixel. At most `weight` of the light behind a place passes to the eye. A cell
//! of an opacity of at least `a` lowers it by `a weight`. Over a whole ray these sum up to 1, so that each cell may spend
//! [`BY_OPACITY`](crate::engines::rules::BY_OPACITY) of E times that, however many cells there are. A cell that needs more
//! takes it from a reserve, of which `left` is there:
//!
//! ```text
//! allowed = BY_OPACITY E a weight + RESERVE_SHARE left
//! ```
//!
//! Several cells that are integrated at once get as many shares. No cell may take all that is left, so that the reserve never
//! ends, and no ray spends more than `BY_OPACITY E` and the reserve together: docs/bounds.md, section 1.
//!
//! Lit cells are charged all that they may spend, since rounds of cells are shaded together. What they did not need is given back
//! [`ROUND`] visible cells later ([`Late`]). So a ray's budget does not depend on how its cells are grouped into rounds, which
//! depends on leaps.

use super::integrate::Passed;
use super::simd::Simd;
use super::walk::ROUND;
use crate::engines::rules::RESERVE_SHARE;

/// Budget of the rays of a packet.
#[derive(Clone, Copy)]
pub struct Budget<S: Simd> {
    /// Rest of the reserve.
    pub left: S::F,
    /// Upper bound on the light from behind that passes to the eye; not below the transmittance at which rays end.
    pub weight: S::F,
    /// Rests of the last visible cells, which are still to be given back.
    pub late: Late<S>,
    last: S::F,
    /// Error per opacity.
    by_opacity: S::F,
}

/// Rests that the last [`ROUND`] visible cells of each ray did not need, the earliest first.
#[derive(Clone, Copy)]
pub struct Late<S: Simd>([S::F; ROUND]);

impl<S: Simd> Late<S> {
    /// Nothing.
    #[inline(always)]
    fn nothing() -> Self {
        Self([S::splat(0.0); ROUND])
    }

    /// Takes what the earliest cell did not need, in these lanes.
    #[inline(always)]
    pub fn take(&mut self, lanes: S::M) -> S::F {
        let earliest = S::select(lanes, self.0[0], S::splat(0.0));
        self.add(lanes, S::splat(0.0));
        earliest
    }

    /// Adds a cell in these lanes, in place of the earliest.
    #[inline(always)]
    pub fn add(&mut self, lanes: S::M, rest: S::F) {
        for i in 1..ROUND {
            self.0[i - 1] = S::select(lanes, self.0[i], self.0[i - 1]);
        }
        self.0[ROUND - 1] = S::select(lanes, rest, self.0[ROUND - 1]);
    }

    /// All of it.
    #[inline(always)]
    pub fn sum(&self) -> S::F {
        self.0.into_iter().fold(S::splat(0.0), |sum, rest| sum + rest)
    }
}

/// Allowance of a cell: a share by its opacity, and one of the reserve.
#[derive(Clone, Copy)]
pub struct Allowed<S: Simd> {
    by_opacity: S::F,
    reserve: S::F,
}

impl<S: Simd> Allowed<S> {
    /// Nothing.
    #[inline(always)]
    pub fn nothing() -> Self {
        Self { by_opacity: S::splat(0.0), reserve: S::splat(0.0) }
    }

    /// Both together.
    #[inline(always)]
    pub fn sum(&self) -> S::F {
        self.by_opacity + self.reserve
    }

    /// Part of the reserve that a cell takes which spends so much. NaN takes nothing.
    #[inline(always)]
    pub fn of_reserve(&self, spent: S::F) -> S::F {
        S::max(spent - self.by_opacity, S::splat(0.0))
    }
}

impl<S: Simd> Budget<S> {
    /// The budget of rays that begin behind this transmittance with this reserve, and end at `last`.
    #[inline(always)]
    pub fn new(left: S::F, front: S::F, [by_opacity, last]: [f32; 2]) -> Self {
        let last = S::splat(last);
        Self { left, weight: S::max(front, last), late: Late::nothing(), last, by_opacity: S::splat(by_opacity) }
    }

    /// Allowance of some cells together, whose contribution is this part.
    #[inline(always)]
    pub fn allowed(&self, part: Passed<S>, cells: usize) -> Allowed<S> {
        // The least opacity: the weight falls by this share of it ([`Budget::pass`]), so that these sums end at 1.
        let opacity = S::max(S::splat(1.0) - part.transmittance - part.error, S::splat(0.0));
        let by_opacity = self.by_opacity * opacity * self.weight;
        Allowed { by_opacity, reserve: self.left * S::splat(RESERVE_SHARE * cells as f32) }
    }

    /// Takes away what a cell spends, which is not more than it may.
    #[inline(always)]
    pub fn spend(&mut self, spent: S::F, allowed: &Allowed<S>) {
        self.left = self.left - allowed.of_reserve(spent);
    }

    /// Goes behind a part, which lets at most its transmittance plus its error through.
    #[inline(always)]
    pub fn pass(&mut self, part: Passed<S>) {
        let one = S::splat(1.0);
        let most = S::min(part.transmittance + part.error, one);
        let through = S::select(S::lt(part.error, one), most, one);
        self.weight = S::max(self.weight * through, self.last);
    }
}
