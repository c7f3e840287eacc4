//! The trilinear cell: the cube between eight voxels, and the cubic along a ray in it.
//!
//! Corner c of a cell has the offsets `(c & 1, c >> 1 & 1, c >> 2)` along x, y, z. Positions in a cell are fractions in
//! [0, 1]; a *chord* runs from fraction `a` to fraction `b`, its parameter u from 0 to 1. Values are render values.
//! All interpolation is written with differences, so that equal corners interpolate to themselves exactly.

/// Number type of cubics. If a ray grazes a step of the transfer function, an error e of s moves the crossings by the
/// square root of e. `f32` is then wrong by half a grey level, which the shader twins accept.
pub type Real = f64;

/// Newton steps in a bracket; bisection alone would take 30.
const ROOT_STEPS: usize = 40;
/// Width of a bracket, in u, at which a root is found.
const ROOT_TOLERANCE: Real = 1e-9;

/// The eight corner values of a cell, and their bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Render values; finite.
    pub corners: [f32; 8],
    /// Least corner.
    pub low: f32,
    /// Greatest corner.
    pub high: f32,
}

impl Cell {
    /// The cell with these corners; NaN corners are absent. `None` if an absent corner has a weight other than zero on
    /// the chord from `a` to `b`.
    #[inline]
    #[must_use]
    pub fn new(mut corners: [f32; 8], a: [Real; 3], b: [Real; 3]) -> Option<Self> {
        if corners.iter().any(|c| c.is_nan()) {
            replace_unreached(&mut corners, a, b);
            if corners.iter().any(|c| c.is_nan()) {
                return None;
            }
        }
        let low = corners.iter().copied().fold(f32::INFINITY, f32::min);
        let high = corners.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Some(Self { corners, low, high })
    }
}

/// Replaces corners whose weight is zero along the whole chord by their mirror images, which changes no value.
///
/// So a ray exactly in a plane of voxels is not affected by holes in the next plane.
#[cold]
pub fn replace_unreached<V: Copy>(corners: &mut [V; 8], a: [Real; 3], b: [Real; 3]) {
    for axis in 0..3 {
        let reached_side = match (a[axis], b[axis]) {
            (0.0, 0.0) => 0,
            (1.0, 1.0) => 1,
            _ => continue,
        };
        for corner in 0..8 {
            if corner >> axis & 1 != reached_side {
                corners[corner] = corners[corner ^ (1 << axis)];
            }
        }
    }
}

/// Coefficients of 1, x, y, z, xy, xz, yz, xyz of the interpolant.
#[inline]
fn monomials<V: Copy + Into<Real>>(corners: &[V; 8]) -> [Real; 8] {
    let c = corners.map(V::into);
    let (x0, x1, x2, x3) = (c[1] - c[0], c[3] - c[2], c[5] - c[4], c[7] - c[6]);
    let (xy0, xy1) = (x1 - x0, x3 - x2);
    [c[0], x0, c[2] - c[0], c[4] - c[0], xy0, x2 - x0, (c[6] - c[4]) - (c[2] - c[0]), xy1 - xy0]
}

/// Trilinear interpolation at the fractions `p`.
#[inline]
#[must_use]
pub fn trilinear<V: Copy + Into<Real>>(corners: &[V; 8], p: [Real; 3]) -> Real {
    let [k, kx, ky, kz, kxy, kxz, kyz, kxyz] = monomials(corners);
    let [x, y, z] = p;
    k + x * (kx + y * (kxy + z * kxyz)) + y * (ky + z * kyz) + z * (kz + x * kxz)
}

/// Coefficients, lowest power first, of s(u) along the chord from `a` to `b`.
#[inline]
#[must_use]
pub fn cubic_of_cell<V: Copy + Into<Real>>(corners: &[V; 8], a: [Real; 3], b: [Real; 3]) -> [Real; 4] {
    let [_, kx, ky, kz, kxy, kxz, kyz, kxyz] = monomials(corners);
    let [ax, ay, az] = a;
    let [dx, dy, dz] = [b[0] - ax, b[1] - ay, b[2] - az];
    let linear = kx * dx
        + ky * dy
        + kz * dz
        + kxy * (ax * dy + ay * dx)
        + kxz * (ax * dz + az * dx)
        + kyz * (ay * dz + az * dy)
        + kxyz * (ax * ay * dz + ax * az * dy + ay * az * dx);
    let quadratic = kxy * dx * dy + kxz * dx * dz + kyz * dy * dz + kxyz * (ax * dy * dz + ay * dx * dz + az * dx * dy);
    [trilinear(corners, a), linear, quadratic, kxyz * dx * dy * dz]
}

/// The cubic at u.
#[inline]
#[must_use]
pub fn cubic_at(c: &[Real; 4], u: Real) -> Real {
    c[0] + u * (c[1] + u * (c[2] + u * c[3]))
}

/// Mean of the cubic over [0, 1].
#[inline]
#[must_use]
pub fn cubic_mean(c: &[Real; 4]) -> Real {
    c[0] + c[1] * (1.0 / 2.0) + c[2] * (1.0 / 3.0) + c[3] * (1.0 / 4.0)
}

/// A short list of parameters u on a chord.
#[derive(Debug, Clone, Copy)]
pub struct Parameters<const N: usize> {
    values: [Real; N],
    length: usize,
}

impl<const N: usize> Parameters<N> {
    /// No parameters yet.
    #[inline]
    #[must_use]
    pub fn new() -> Self {
        Self { values: [0.0; N], length: 0 }
    }

    /// Inserts in ascending order.
    ///
    /// # Panics
    /// If the list is full: its size is the largest possible number.
    #[inline]
    pub fn insert(&mut self, u: Real) {
        assert!(self.length < N, "a list of {N} parameters is full");
        let mut at = self.length;
        while at > 0 && self.values[at - 1] > u {
            self.values[at] = self.values[at - 1];
            at -= 1;
        }
        self.values[at] = u;
        self.length += 1;
    }

    /// The parameters, ascending.
    #[inline]
    #[must_use]
    pub fn as_slice(&self) -> &[Real] {
        &self.values[..self.length]
    }
}

impl<const N: usize> Default for Parameters<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Ends of the intervals of [0, 1] in which the cubic is monotone: 0, its critical points inside, 1.
#[inline]
#[must_use]
pub fn monotone_intervals(c: &[Real; 4]) -> Parameters<4> {
    let mut ends = Parameters::new();
    ends.insert(0.0);
    // s'(u) = c1 + 2 c2 u + 3 c3 u^2; the stable form of the two roots never subtracts equal numbers.
    let (a, half_b, constant) = (3.0 * c[3], c[2], c[1]);
    let discriminant = half_b * half_b - a * constant;
    if discriminant > 0.0 {
        let q = -(half_b + discriminant.sqrt().copysign(half_b));
        for u in [q / a, constant / q] {
            // Not in (0, 1): this includes infinities and NaN, from a quadratic that is a line or a constant.
            if u > 0.0 && u < 1.0 {
                ends.insert(u);
            }
        }
    }
    ends.insert(1.0);
    ends
}

/// Least and greatest value of the cubic over the intervals of [`monotone_intervals`].
#[inline]
#[must_use]
pub fn cubic_extremes(c: &[Real; 4], intervals: &[Real]) -> (Real, Real) {
    intervals
        .iter()
        .map(|&u| cubic_at(c, u))
        .fold((Real::INFINITY, Real::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)))
}

/// Inserts into `out` every u in (0, 1) at which the cubic passes `value`: at most 3.
#[inline]
pub fn cubic_roots<const N: usize>(c: &[Real; 4], intervals: &[Real], value: Real, out: &mut Parameters<N>) {
    for pair in intervals.windows(2) {
        if let Some(u) = monotone_root(c, pair[0], pair[1], value)
            && u > 0.0
            && u < 1.0
        {
            out.insert(u);
        }
    }
}

/// The u in the monotone interval `[low, high]` at which the side of `value` changes; values equal to it are above.
///
/// Newton's method inside a shrinking bracket, with bisection where Newton leaves it.
#[inline]
#[must_use]
pub fn monotone_root(c: &[Real; 4], mut low: Real, mut high: Real, value: Real) -> Option<Real> {
    let is_above = |u: Real| cubic_at(c, u) >= value;
    let low_above = is_above(low);
    if low_above == is_above(high) {
        return None;
    }
    let mut u = 0.5 * (low + high);
    for _ in 0..ROOT_STEPS {
        let excess = cubic_at(c, u) - value;
        if (excess >= 0.0) == low_above {
            low = u
        } else {
            high = u
        }
        let slope = c[1] + u * (2.0 * c[2] + u * 3.0 * c[3]);
        let next = u - excess / slope;
        let inside = next > low && next < high;
        let next = if inside { next } else { 0.5 * (low + high) };
        let settled = (next - u).abs() < ROOT_TOLERANCE;
        u = next;
        if settled || high - low < ROOT_TOLERANCE {
            break;
        }
    }
    Some(u)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn unit() -> impl Strategy<Value = [Real; 3]> {
        prop::array::uniform3(0.0f64..=1.0)
    }

    proptest! {
        #[test]
        fn the_cubic_is_the_interpolant_along_the_chord(
            corners in prop::array::uniform8(-1.0f32..1.0), a in unit(), b in unit(), u in 0.0f64..=1.0,
        ) {
            let cubic = cubic_of_cell(&corners, a, b);
            let p: [Real; 3] = std::array::from_fn(|i| a[i] + u * (b[i] - a[i]));
            let mut expected = 0.0;
            for (corner, &value) in corners.iter().enumerate() {
                let weight = |i: usize| if corner >> i & 1 == 1 { p[i] } else { 1.0 - p[i] };
                expected += f64::from(value) * weight(0) * weight(1) * weight(2);
            }
            prop_assert!((cubic_at(&cubic, u) - expected).abs() < 1e-12);
            prop_assert!((trilinear(&corners, p) - expected).abs() < 1e-12);
        }

        #[test]
        fn roots_are_found_and_are_roots(c in prop::array::uniform4(-2.0f64..2.0), value in -1.0f64..1.0) {
            let intervals = monotone_intervals(&c);
            let mut roots = Parameters::<3>::new();
            cubic_roots(&c, intervals.as_slice(), value, &mut roots);
            for &u in roots.as_slice() {
                prop_assert!((cubic_at(&c, u) - value).abs() < 1e-7, "{u}");
            }
            let sides: Vec<bool> = (0..=1000).map(|i| cubic_at(&c, f64::from(i) / 1000.0) > value).collect();
            let changes = sides.windows(2).filter(|s| s[0] != s[1]).count();
            prop_assert!(roots.as_slice().len() >= changes);
            let (low, high) = cubic_extremes(&c, intervals.as_slice());
            for i in 0..=1000 {
                let s = cubic_at(&c, f64::from(i) / 1000.0);
                prop_assert!(s >= low - 1e-9 && s <= high + 1e-9);
            }
        }
    }

    #[test]
    fn holes_count_only_where_they_have_weight() {
        let mut corners = [1.0; 8];
        corners[4] = f32::NAN;
        corners[7] = f32::NAN;
        assert!(Cell::new(corners, [0.2, 0.0, 0.0], [0.3, 1.0, 0.0]).is_some());
        assert!(Cell::new(corners, [0.2, 0.0, 1.0], [0.3, 1.0, 1.0]).is_none());
        assert!(Cell::new(corners, [0.2, 0.0, 0.0], [0.3, 1.0, 1e-30]).is_none());
        assert!(Cell::new(corners, [1.0, 0.0, 1.0], [1.0, 0.0, 1.0]).is_some());
    }

    #[test]
    fn equal_corners_interpolate_to_themselves() {
        let cubic = cubic_of_cell(&[0.1f32; 8], [0.3, 0.7, 0.2], [0.9, 0.1, 0.5]);
        assert_eq!(cubic, [Real::from(0.1f32), 0.0, 0.0, 0.0]);
    }
}
