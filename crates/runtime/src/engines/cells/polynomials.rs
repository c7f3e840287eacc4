//! Polynomials on [-1, 1] with a bound on what they leave out: Taylor models (Makino and Berz 1996).
//!
//! A [`Model`] of a function is a polynomial `P(v)` and a number `rest`, so that the function is nowhere farther than `rest` from
//! P. Sums and products of models are models. For powers, logarithms and exponentials, P is the solution of a differential
//! equation as a series. What P does not solve of it is a polynomial, too, and bounds the distance (docs/bounds.md, section
//! 12). Roundings of `f64` are left out.

/// Terms of a polynomial: one for each power of v. With six, parts of cells are rarely halved.
pub(super) const TERMS: usize = 6;
/// Powers of v in a product.
const PRODUCT_TERMS: usize = 2 * TERMS - 1;

/// Control points of v^k on [-1, 1], by Bernstein: a polynomial lies within the hull of its control points.
const CONTROLS: [[f64; TERMS]; TERMS] = controls();

/// A function on [-1, 1]: see the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Model {
    /// Coefficients, that of 1 first.
    pub(super) terms: [f64; TERMS],
    /// Greatest distance of the function from the polynomial.
    pub(super) rest: f64,
}

impl Model {
    /// Nothing.
    pub(super) const ZERO: Self = Self { terms: [0.0; TERMS], rest: 0.0 };

    /// A constant.
    pub(super) fn constant(value: f64) -> Self {
        Self::ZERO.plus(value)
    }

    /// A cubic of u, between two values of u.
    pub(super) fn of_cubic(c: &[f64; 4], [begin, end]: [f64; 2]) -> Self {
        let (u, half) = (0.5 * (begin + end), 0.5 * (end - begin));
        let value = c[0] + u * (c[1] + u * (c[2] + u * c[3]));
        let slope = c[1] + u * (2.0 * c[2] + u * 3.0 * c[3]);
        let bow = c[2] + u * 3.0 * c[3];
        Self { terms: [value, half * slope, half * half * bow, half * half * half * c[3], 0.0, 0.0], rest: 0.0 }
    }

    /// The squared length of a vector of cubics.
    pub(super) fn squared_length(of: &[Self; 3]) -> Self {
        let product = of.iter().fold([0.0; PRODUCT_TERMS], |mut sum, axis| {
            for (i, a) in axis.terms[..4].iter().enumerate() {
                for (j, b) in axis.terms[..4].iter().enumerate() {
                    sum[i + j] += a * b;
                }
            }
            sum
        });
        Self::cut_off(&product)
    }

    /// The first terms of a longer polynomial; the others may add up.
    fn cut_off(long: &[f64; PRODUCT_TERMS]) -> Self {
        let (kept, left) = long.split_at(TERMS);
        Self { terms: std::array::from_fn(|k| kept[k]), rest: left.iter().map(|c| c.abs()).sum() }
    }

    /// The sum with a number.
    pub(super) fn plus(mut self, value: f64) -> Self {
        self.terms[0] += value;
        self
    }

    /// The sum with a function.
    pub(super) fn and(&self, other: &Self) -> Self {
        Self { terms: std::array::from_fn(|k| self.terms[k] + other.terms[k]), rest: self.rest + other.rest }
    }

    /// The product with a number.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self { terms: self.terms.map(|c| c * factor), rest: self.rest * factor.abs() }
    }

    /// The product with a function.
    pub(super) fn times(&self, other: &Self) -> Self {
        let mut product = [0.0; PRODUCT_TERMS];
        for (i, a) in self.terms.iter().enumerate() {
            for (j, b) in other.terms.iter().enumerate() {
                product[i + j] += a * b;
            }
        }
        let cut_off = Self::cut_off(&product);
        let of_rests = self.rest * other.size() + other.rest * (self.size() + self.rest);
        Self { rest: cut_off.rest + of_rests, ..cut_off }
    }

    /// Greatest size of the polynomial, at most.
    pub(super) fn size(&self) -> f64 {
        self.terms.iter().map(|c| c.abs()).sum()
    }

    /// Least and greatest value, at most: those of the control points.
    pub(super) fn range(&self) -> [f64; 2] {
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        for row in &CONTROLS {
            let control: f64 = row.iter().zip(&self.terms).map(|(a, b)| a * b).sum();
            range = [range[0].min(control), range[1].max(control)];
        }
        [range[0] - self.rest, range[1] + self.rest]
    }

    /// The power of a positive function; `None` unless it is certainly positive.
    ///
    /// `y = q^p` solves `q y' = p q' y`. If P leaves the residual r of it, then `(P / q^p)' = r / q^(p + 1)`.
    pub(super) fn power(&self, p: f64) -> Option<Self> {
        let [low, high] = self.range();
        if !(low > 0.0 && high.is_finite()) {
            return None;
        }
        let (q, mut y) = (&self.terms, [0.0; TERMS]);
        y[0] = raised(q[0], p);
        for k in 1..TERMS {
            let sum: f64 = (1..=k).map(|m| (p * m as f64 - (k - m) as f64) * q[m] * y[k - m]).sum();
            y[k] = sum / (k as f64 * q[0]);
        }
        let unsolved = unsolved(|i, j| q[i] * y[j] * (j as f64 - p * i as f64));
        let greatest = |exponent: f64| raised(if exponent < 0.0 { low } else { high }, exponent);
        let of_rest = if self.rest == 0.0 { 0.0 } else { p.abs() * greatest(p - 1.0) * self.rest };
        Some(Self { terms: y, rest: greatest(p) * greatest(-p - 1.0) * unsolved + of_rest })
    }

    /// Minus the logarithm of one minus a function, of which nothing is left out; `None` unless it is certainly below 1.
    ///
    /// `y = -ln(w)` solves `w y' = -w'`.
    pub(super) fn depth_of_opacity(&self) -> Option<Self> {
        let least = 1.0 - self.range()[1];
        if !(least > 0.0 && self.rest == 0.0) {
            return None;
        }
        let (mut w, mut y) = (self.terms.map(|c| -c), [0.0; TERMS]);
        w[0] += 1.0;
        y[0] = -(-self.terms[0]).ln_1p();
        for k in 1..TERMS {
            let sum: f64 = (1..k).map(|m| w[m] * (k - m) as f64 * y[k - m]).sum();
            y[k] = -(k as f64 * w[k] + sum) / (k as f64 * w[0]);
        }
        Some(Self { terms: y, rest: unsolved(|i, j| w[i] * y[j] * j as f64) / least })
    }

    /// The integral from -1 on, times a factor.
    pub(super) fn integral(&self, factor: f64) -> Self {
        let mut terms: [f64; TERMS] =
            std::array::from_fn(|k| if k == 0 { 0.0 } else { factor * self.terms[k - 1] / k as f64 });
        let beyond = factor * self.terms[TERMS - 1] / TERMS as f64;
        let at_begin: f64 = (1..TERMS).map(|k| if k % 2 == 0 { terms[k] } else { -terms[k] }).sum();
        terms[0] = -(at_begin + beyond);
        Self { terms, rest: beyond.abs() + 2.0 * factor.abs() * self.rest }
    }

    /// The integral from -1 to 1, and a bound on what it is off by.
    pub(super) fn whole(&self) -> [f64; 2] {
        let even = self.terms.iter().enumerate().step_by(2);
        [even.map(|(k, c)| 2.0 * c / (k + 1) as f64).sum(), 2.0 * self.rest]
    }

    /// The exponential of minus a function.
    ///
    /// `y = exp(-d)` solves `y' = -d' y`. If P leaves the residual r, then `(P exp(d))' = r exp(d)`.
    pub(super) fn passing(&self) -> Self {
        let (d, mut y) = (&self.terms, [0.0; TERMS]);
        y[0] = (-d[0]).exp();
        for k in 1..TERMS {
            let sum: f64 = (1..=k).map(|m| m as f64 * d[m] * y[k - m]).sum();
            y[k] = -sum / k as f64;
        }
        let [low, high] = self.range();
        let unsolved = unsolved(|i, j| d[i] * y[j] * i as f64);
        Self { terms: y, rest: (high - low).exp() * unsolved + (-low).exp() * self.rest.exp_m1() }
    }

    /// The function, but not below 0 and not above 1.
    pub(super) fn clamped(&self) -> Self {
        let above = self.range();
        let positive = match above {
            [low, _] if low >= 0.0 => *self,
            [low, high] if high <= 0.0 || high < -low => Self { rest: high.max(0.0), ..Self::ZERO },
            [low, _] => Self { rest: self.rest - low, ..*self },
        };
        match above {
            [_, high] if high <= 1.0 => positive,
            [low, high] if low >= 1.0 || 1.0 - low < high - 1.0 => {
                Self { rest: (1.0 - low).clamp(0.0, 1.0), ..Self::constant(1.0) }
            }
            [_, high] => Self { rest: positive.rest + high - 1.0, ..positive },
        }
    }

    /// The size of the function: its sign may change.
    pub(super) fn absolute(&self) -> Self {
        let [low, high] = self.range();
        if low >= 0.0 || -low <= high {
            Self { rest: self.rest + 2.0 * (-low).max(0.0), ..*self }
        } else {
            let turned = self.scaled(-1.0);
            Self { rest: turned.rest + 2.0 * high.max(0.0), ..turned }
        }
    }
}

/// A power of a positive number; those of roots are frequent, and need no logarithm.
fn raised(x: f64, p: f64) -> f64 {
    if p == 0.5 {
        x.sqrt()
    } else if p == -0.5 {
        1.0 / x.sqrt()
    } else if p == -1.5 {
        1.0 / (x * x.sqrt())
    } else {
        x.powf(p)
    }
}

/// Bound on the integral, from 0 to any v, of a residual whose lower powers vanish. `coefficient(i, j)` belongs to the power
/// `i + j - 1`, for the terms number i and j of two polynomials.
fn unsolved(coefficient: impl Fn(usize, usize) -> f64) -> f64 {
    let of_power = |power: usize| -> f64 {
        let sum: f64 = (power + 1 - (TERMS - 1)..TERMS).map(|i| coefficient(i, power + 1 - i)).sum();
        sum.abs() / (power + 1) as f64
    };
    (TERMS - 1..PRODUCT_TERMS - 1).map(of_power).sum()
}

/// See [`CONTROLS`]. Control point j of v^k is the mean of the products of k of n numbers, of which j are 1 and the others -1.
#[allow(clippy::cast_precision_loss, clippy::cast_lossless, reason = "small whole numbers, in a constant")]
const fn controls() -> [[f64; TERMS]; TERMS] {
    let mut all = [[0.0; TERMS]; TERMS];
    let mut j = 0;
    while j < TERMS {
        // Coefficients of (1 + z)^j (1 - z)^(n - j), and the binomial ones of (1 + z)^n.
        let mut products = [0i32; TERMS];
        let mut counts = [0i32; TERMS];
        products[0] = 1;
        counts[0] = 1;
        let mut factor = 0;
        while factor < TERMS - 1 {
            let number = if factor < j { 1 } else { -1 };
            let mut k = TERMS - 1;
            while k > 0 {
                products[k] += number * products[k - 1];
                counts[k] += counts[k - 1];
                k -= 1;
            }
            factor += 1;
        }
        let mut k = 0;
        while k < TERMS {
            all[j][k] = products[k] as f64 / counts[k] as f64;
            k += 1;
        }
        j += 1;
    }
    all
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(model: &Model, v: f64) -> f64 {
        model.terms.iter().rev().fold(0.0, |sum, c| sum * v + c)
    }

    /// Checks that a function is nowhere farther from its model than this states, up to rounding; returns the greatest distance.
    #[track_caller]
    fn check(model: &Model, function: impl Fn(f64) -> f64) -> f64 {
        let mut worst: f64 = 0.0;
        for i in 0..=64 {
            let v = f64::from(i) / 32.0 - 1.0;
            let (found, exact) = (at(model, v), function(v));
            let off = (found - exact).abs();
            assert!(
                off <= model.rest + 1e-12 * (1.0 + model.size()),
                "at {v}: {found} instead of {exact}, {}",
                model.rest
            );
            let [low, high] = model.range();
            assert!(low - 1e-12 <= exact && exact <= high + 1e-12, "{exact} is not in {low} to {high}");
            worst = worst.max(off);
        }
        worst
    }

    #[test]
    fn cubics_are_exact() {
        let cubic = [0.3, -1.2, 2.5, 0.7];
        let model = Model::of_cubic(&cubic, [0.2, 0.6]);
        check(&model, |v| {
            let u = 0.4 + 0.2 * v;
            cubic[0] + u * (cubic[1] + u * (cubic[2] + u * cubic[3]))
        });
        assert_eq!(model.rest, 0.0);
        assert_eq!(Model::constant(2.0).range(), [2.0; 2]);
    }

    /// The bound is one, and not far above the distance where a part is short.
    #[test]
    fn bounds_of_functions_hold_and_are_tight() {
        let q = Model { terms: [1.0, 0.2, 0.05, -0.02, 0.0, 0.0], rest: 0.0 };
        for (p, share) in [(0.5, 1.0), (-0.5, 1.0), (32.0, 0.1), (0.7, 1.0), (1.0, 1.0)] {
            let q = q.plus(-1.0).scaled(share).plus(1.0);
            let model = q.power(p).unwrap();
            let worst = check(&model, |v| at(&q, v).powf(p));
            assert!(model.rest <= 40.0 * worst.max(1e-9), "power {p}: {} for {worst}", model.rest);
        }
        let opacity = Model { terms: [0.6, 0.1, -0.02, 0.01, 0.0, 0.0], rest: 0.0 };
        let depth = opacity.depth_of_opacity().unwrap();
        let worst = check(&depth, |v| -(1.0 - at(&opacity, v)).ln());
        assert!(depth.rest <= 20.0 * worst, "{} for {worst}", depth.rest);
        let passing = q.integral(0.5).passing();
        let integral = |v: f64| {
            let of = |v: f64| v * (1.0 + v * (0.1 + v * (0.05 / 3.0 - v * 0.005)));
            0.5 * (of(v) - of(-1.0))
        };
        check(&q.integral(0.5), integral);
        let worst = check(&passing, |v| (-integral(v)).exp());
        assert!(passing.rest <= 50.0 * worst, "{} for {worst}", passing.rest);
        assert!((q.whole()[0] - 2.0 * integral(1.0)).abs() < 1e-15);
    }

    fn terms(size: f64) -> impl Strategy<Value = [f64; 4]> {
        prop::array::uniform4(-size..size)
    }

    proptest! {
        #[test]
        fn models_hold_their_functions(a in terms(1.0), b in terms(0.3), p in -2.0f64..40.0, rest in 0.0f64..0.01) {
            let model = |c: [f64; 4], rest| Model { terms: [c[0], c[1], c[2], c[3], 0.0, 0.0], rest };
            let (a, b) = (model(a, 0.0), model(b, 0.0).plus(0.6));
            check(&a.times(&b), |v| at(&a, v) * at(&b, v));
            check(&a.and(&b), |v| at(&a, v) + at(&b, v));
            check(&a.clamped(), |v| at(&a, v).clamp(0.0, 1.0));
            check(&a.absolute(), |v| at(&a, v).abs());
            check(&a.scaled(3.0).passing(), |v| (-3.0 * at(&a, v)).exp());
            check(&Model::squared_length(&[a, b, a]), |v| 2.0 * at(&a, v).powi(2) + at(&b, v).powi(2));
            if let Some(power) = b.power(p) {
                check(&power, |v| at(&b, v).powf(p));
            }
            if let Some(depth) = b.depth_of_opacity() {
                check(&depth, |v| -(1.0 - at(&b, v)).ln());
            }
            // A rest may be anything up to its size.
            for sign in [-1.0, 1.0] {
                let [a, b] = [Model { rest, ..a }, Model { rest, ..b }];
                let off = sign * rest;
                check(&a.times(&b), |v| (at(&a, v) + off) * (at(&b, v) - off));
                check(&a.clamped(), |v| (at(&a, v) + off).clamp(0.0, 1.0));
                check(&a.absolute(), |v| (at(&a, v) + off).abs());
                check(&a.passing(), |v| (-at(&a, v) - off).exp());
                if let Some(power) = b.power(p) {
                    check(&power, |v| (at(&b, v) + off).powf(p));
                }
            }
        }
    }
}
