//! Emission and absorption along a part of a ray, to a tolerance for the whole ray.
//!
//! Light is sampled at Gauss points. The depth in front of each point is the integral of the polynomial through the
//! extinctions, as in Gauss's methods for differential equations (Butcher 1964). This is of order 10 for smooth light.
//! A part is halved until two halvings in turn change nothing: one may do so by chance, beside a kink.
//!
//! *Tolerance.* A part may be off by its share of the ray's length, divided by the transmittance in front of it. So all
//! parts together are off by at most the ray's tolerance.

use glam::DVec3;

/// Gauss points of a part.
const POINTS: usize = 5;
/// Newton steps from the usual first guess to a root of a Legendre polynomial: each doubles the digits.
const ROOT_STEPS: usize = 8;
/// Most halvings of a part; reaching it is counted.
const DEPTH_LIMIT: u32 = 50;
/// Change that counts as none: a ray has some ten thousand parts at most that need it. Where light jumps, and rounding decides on
/// which side a sample lies, a part is that small within [`DEPTH_LIMIT`] halvings.
const ROUNDING: f64 = 1e-11;

/// Premultiplied colour and transmittance.
pub(super) type Seen = (DVec3, f64);

/// Nothing: no colour, all light passes.
pub(super) const CLEAR: Seen = (DVec3::ZERO, 1.0);

/// Colour and transmittance of `far` seen through `near`.
pub(super) fn behind(near: Seen, far: Seen) -> Seen {
    (near.0 + near.1 * far.0, near.1 * far.1)
}

/// Light along a part of a ray; its parameter runs over any interval.
pub(super) trait Light {
    /// Extinction per world length, and colour.
    fn at(&self, place: f64) -> (f64, DVec3);
    /// Greatest change of light that may lie between samples of an interval, unseen by them: 1 is anything.
    fn hidden(&self, interval: [f64; 2]) -> f64;
    /// World length of one unit of the parameter.
    fn scale(&self) -> f64;
}

/// Gauss's rule on [0, 1].
#[derive(Debug)]
pub(super) struct GaussRule {
    places: [f64; POINTS],
    weights: [f64; POINTS],
    /// Integral from 0 to place i of the polynomial that is 1 at place j and 0 at the others.
    before: [[f64; POINTS]; POINTS],
}

impl GaussRule {
    /// The rule, from the roots of the Legendre polynomial.
    pub(super) fn new() -> Self {
        let (mut places, mut weights) = ([0.0; POINTS], [0.0; POINTS]);
        for i in 0..POINTS {
            let mut x = -(std::f64::consts::PI * (i as f64 + 0.75) / (POINTS as f64 + 0.5)).cos();
            for _ in 0..ROOT_STEPS {
                let (value, slope) = legendre(x);
                x -= value / slope;
            }
            let slope = legendre(x).1;
            places[i] = 0.5 * (1.0 + x);
            weights[i] = 1.0 / ((1.0 - x * x) * slope * slope);
        }
        let basis = |j: usize, x: f64| {
            let others = (0..POINTS).filter(|k| *k != j);
            others.map(|k| (x - places[k]) / (places[j] - places[k])).product::<f64>()
        };
        // The rule is exact for polynomials of this degree, over any interval.
        let integral = |i: usize, j: usize| {
            let end = places[i];
            (0..POINTS).map(|k| end * weights[k] * basis(j, end * places[k])).sum()
        };
        let before = std::array::from_fn(|i| std::array::from_fn(|j| integral(i, j)));
        Self { places, weights, before }
    }

    /// Colour and transmittance of an interval, and an error that this certainly has: white light would have the opacity
    /// as its colour.
    fn part(&self, light: &impl Light, [begin, end]: [f64; 2]) -> (Seen, f64) {
        let samples = self.places.map(|place| light.at(begin + place * (end - begin)));
        let length = light.scale() * (end - begin);
        let weighted = |weights: &[f64; POINTS]| {
            length * weights.iter().zip(&samples).map(|(weight, (kappa, _))| weight * kappa).sum::<f64>()
        };
        let depth = weighted(&self.weights);
        if depth <= 0.0 {
            return (CLEAR, 0.0);
        }
        let (mut color, mut white) = (DVec3::ZERO, 0.0);
        for (i, (kappa, of_sample)) in samples.iter().enumerate() {
            let emitted = length * self.weights[i] * kappa * (-weighted(&self.before[i])).exp();
            color += emitted * *of_sample;
            white += emitted;
        }
        let opacity = -(-depth).exp_m1();
        ((color, 1.0 - opacity), (white - opacity).abs())
    }
}

/// The Legendre polynomial of degree [`POINTS`] and its derivative.
fn legendre(x: f64) -> (f64, f64) {
    let (mut last, mut value) = (1.0, x);
    for degree in 2..=POINTS {
        let n = degree as f64;
        (last, value) = (value, ((2.0 * n - 1.0) * x * value - (n - 1.0) * last) / n);
    }
    (value, POINTS as f64 * (x * value - last) / (x * x - 1.0))
}

/// Integration of one piece of a ray.
pub(super) struct Integral<'a, L> {
    /// The rule.
    pub rule: &'a GaussRule,
    /// Light of the piece.
    pub light: &'a L,
    /// Error that the piece may have per unit of the parameter, as a share of full scale behind nothing.
    pub tolerance: f64,
    /// Called at each part that has not converged at the limit of halvings.
    pub capped: &'a dyn Fn(),
}

impl<L: Light> Integral<'_, L> {
    /// Colour and transmittance of the piece between ascending cuts, behind this transmittance.
    pub(super) fn over(&self, cuts: &[f64], front: f64) -> Seen {
        let mut seen = CLEAR;
        for cut in cuts.windows(2).filter(|cut| cut[0] < cut[1]) {
            let interval = [cut[0], cut[1]];
            let (whole, _) = self.rule.part(self.light, interval);
            seen = behind(seen, self.refined(interval, whole, false, front * seen.1, DEPTH_LIMIT));
        }
        seen
    }

    /// An interval. `whole` is what one part finds; `agreed` tells whether the interval of twice the length agreed with
    /// its halves.
    fn refined(&self, interval: [f64; 2], whole: Seen, agreed: bool, front: f64, depth: u32) -> Seen {
        let [begin, end] = interval;
        let middle = 0.5 * (begin + end);
        let [first, second] = [[begin, middle], [middle, end]];
        let (near, off_near) = self.rule.part(self.light, first);
        let (far, off_far) = self.rule.part(self.light, second);
        let halves = behind(near, far);
        let change = (halves.0 - whole.0).abs().max_element().max((halves.1 - whole.1).abs());
        let change = change.max(off_near + near.1 * off_far);
        let allowed = (self.tolerance * (end - begin) / front).max(ROUNDING);
        let agrees = change <= allowed;
        let opacity = 1.0 - halves.1;
        if agrees && (opacity <= allowed || agreed && opacity * self.light.hidden(interval) <= allowed) {
            return halves;
        }
        if depth == 0 {
            (self.capped)();
            return halves;
        }
        let near = self.refined(first, near, agrees, front, depth - 1);
        behind(near, self.refined(second, far, agrees, front * near.1, depth - 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rule_is_exact_for_polynomials() {
        let rule = GaussRule::new();
        for power in 0..2 * POINTS {
            let n = power as i32;
            let found: f64 = (0..POINTS).map(|i| rule.weights[i] * rule.places[i].powi(n)).sum();
            assert!((found * f64::from(n + 1) - 1.0).abs() < 1e-14, "power {power}: {found}");
        }
        for (i, row) in rule.before.iter().enumerate() {
            for power in 0..POINTS {
                let n = power as i32;
                let found: f64 = (0..POINTS).map(|j| row[j] * rule.places[j].powi(n)).sum();
                let expected = rule.places[i].powi(n + 1) / f64::from(n + 1);
                assert!((found - expected).abs() < 1e-15, "place {i}, power {power}: {found}, expected {expected}");
            }
        }
    }

    /// Extinction `k` and colour `u` over one unit: the closed form of the colour is `1/k - (1 + 1/k) exp(-k)`.
    struct Ramp(f64);

    impl Light for Ramp {
        fn at(&self, place: f64) -> (f64, DVec3) {
            (self.0, DVec3::splat(place))
        }
        fn hidden(&self, _: [f64; 2]) -> f64 {
            0.0
        }
        fn scale(&self) -> f64 {
            1.0
        }
    }

    #[test]
    fn even_extinction_of_any_depth_has_its_closed_form() {
        let rule = GaussRule::new();
        for k in [1e-9, 1e-3, 0.5, 7.0, 1e3, 1e6] {
            let integral = Integral { rule: &rule, light: &Ramp(k), tolerance: 1e-9, capped: &|| panic!("capped") };
            let (color, transmittance) = integral.over(&[0.0, 1.0], 1.0);
            let series = k * (0.5 - k / 3.0 + k * k / 8.0);
            let expected = if k < 1e-2 { series } else { 1.0 / k - (1.0 + 1.0 / k) * (-k).exp() };
            assert!((color.x - expected).abs() < 1e-9, "{k}: {color}, expected {expected}");
            assert!((transmittance - (-k).exp()).abs() < 1e-12, "{k}: {transmittance}");
        }
    }
}
