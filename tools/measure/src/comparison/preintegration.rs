//! Pre-integration: the exact integral of the transfer function over an interval in which the value is linear.
//!
//! The value s is linear from s_f to s_b over the length h. The optical depth is
//! `tau = h (K(s_b) - K(s_f)) / (s_b - s_f)`, K the integral of kappa (Engel, Kraus, Ertl 2001, "High-Quality
//! Pre-Integrated Volume Rendering", eq. 7). The colour `C = (int c kappa ds / int kappa ds) (1 - exp(-tau))` is the
//! average colour, attenuated as if it were spread evenly. Two one-dimensional prefix sums replace the two-dimensional
//! table, so the cost does not grow with the bit depth of the values. The method wins where the value is linear inside
//! an interval, however steep the transfer function is. It loses where the value bends.
//!
//! Data values are `f64`. Within one bin of the sums, K is a cubic Hermite polynomial with exact ends and slopes.

use supervol_format::cast::whole;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::transfer_function::render::with_limit_points;

/// Bins of one linear piece of the transfer function; fewer if there are many pieces.
const PIECE_BINS: usize = 256;
/// Largest total number of bins.
const BIN_LIMIT: usize = 1 << 17;
/// Smallest difference of end values, as a fraction of the transfer function's width. Closer values count as equal,
/// because the difference of the sums would be mostly rounding.
const POINT_WIDTH: f64 = 1e-7;
/// Gauss-Legendre points and weights on [0, 1].
const GAUSS: [(f64, f64); 3] =
    [(0.112_701_665_379_258_3, 5.0 / 18.0), (0.5, 8.0 / 18.0), (0.887_298_334_620_741_7, 5.0 / 18.0)];

/// Attenuation inside an interval of the light emitted in it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Attenuation {
    /// With attenuation.
    Included,
    /// Without attenuation (Engel et al. 2001, eq. 9): colours are too bright where tau is large.
    Neglected,
}

/// Red, green and blue times kappa, and kappa.
type Emission = [f64; 4];

/// One linear piece of the transfer function.
#[derive(Debug, Clone)]
struct Piece {
    low: f64,
    bin_width: f64,
    first_bin: usize,
    bins: usize,
}

/// Edge of a bin: integral up to this value, and integrand at it.
#[derive(Debug, Clone, Copy)]
struct BinEdge {
    integral: Emission,
    integrand: Emission,
}

/// Prefix sums of a transfer function.
#[derive(Debug, Clone)]
pub struct PreIntegration {
    source: TransferFunction,
    pieces: Vec<Piece>,
    /// `bins + 1` edges for each piece.
    edges: Vec<BinEdge>,
    low: f64,
    high: f64,
}

impl PreIntegration {
    /// Prefix sums of a transfer function.
    #[must_use]
    pub fn new(source: &TransferFunction) -> Self {
        let points = with_limit_points(source.points());
        let straight = points.windows(2).filter(|pair| pair[0].value < pair[1].value);
        let bins = (BIN_LIMIT / points.len()).clamp(1, PIECE_BINS);
        let (low, high) = (points[0].value, points[points.len() - 1].value);
        let mut table = Self { source: source.clone(), pieces: Vec::new(), edges: Vec::new(), low, high };
        let mut sum = [0.0; 4];
        for pair in straight {
            let emission = |x: f64| {
                let mix = |a: f64, b: f64| a + x * (b - a);
                let kappa = source.kappa(mix(pair[0].alpha, pair[1].alpha));
                let [r, g, b] = std::array::from_fn(|c| mix(pair[0].color[c], pair[1].color[c]));
                [r * kappa, g * kappa, b * kappa, kappa]
            };
            let bin_width = (pair[1].value - pair[0].value) / bins as f64;
            let first_bin = table.edges.len();
            table.pieces.push(Piece { low: pair[0].value, bin_width, first_bin, bins });
            table.edges.push(BinEdge { integral: sum, integrand: emission(0.0) });
            for bin in 0..bins {
                for (x, weight) in GAUSS {
                    let e = emission((bin as f64 + x) / bins as f64);
                    (0..4).for_each(|c| sum[c] += weight * bin_width * e[c]);
                }
                table.edges.push(BinEdge { integral: sum, integrand: emission((bin + 1) as f64 / bins as f64) });
            }
        }
        table
    }

    /// Integral of kappa times colour, and of kappa, from the first control point to `value`; negative below it.
    fn integral(&self, value: f64) -> Emission {
        let inside = value.clamp(self.low, self.high);
        let mut sum = self.integral_inside(inside);
        if value != inside {
            let ([r, g, b], alpha) = self.source.classify(value);
            let kappa = self.source.kappa(alpha);
            let beyond = value - inside;
            for (s, e) in sum.iter_mut().zip([r * kappa, g * kappa, b * kappa, kappa]) {
                *s += e * beyond;
            }
        }
        sum
    }

    fn integral_inside(&self, value: f64) -> Emission {
        let after = self.pieces.partition_point(|p| p.low <= value);
        let Some(piece) = after.checked_sub(1).map(|i| &self.pieces[i]) else { return [0.0; 4] };
        let bins = (value - piece.low) / piece.bin_width;
        let bin = whole::<usize>(bins).min(piece.bins - 1);
        let (x, w) = (bins - bin as f64, piece.bin_width);
        let (a, b) = (&self.edges[piece.first_bin + bin], &self.edges[piece.first_bin + bin + 1]);
        let (x2, x3) = (x * x, x * x * x);
        let (toward_b, slope_a, slope_b) = (3.0 * x2 - 2.0 * x3, x3 - 2.0 * x2 + x, x3 - x2);
        std::array::from_fn(|c| {
            let rise = b.integral[c] - a.integral[c];
            a.integral[c] + toward_b * rise + w * (slope_a * a.integrand[c] + slope_b * b.integrand[c])
        })
    }

    /// Premultiplied colour and opacity of an interval of world length `h` with end values `front` and `back`.
    #[must_use]
    pub fn interval(&self, front: f64, back: f64, h: f64, attenuation: Attenuation) -> ([f64; 3], f64) {
        let width = back - front;
        let (color, tau) = if width.abs() <= POINT_WIDTH * (self.high - self.low) {
            let (color, alpha) = self.source.classify(0.5 * (front + back));
            (color, self.source.kappa(alpha) * h)
        } else {
            let (a, b) = (self.integral(front), self.integral(back));
            let kappa = b[3] - a[3];
            if kappa == 0.0 {
                return ([0.0; 3], 0.0);
            }
            (std::array::from_fn(|c| (b[c] - a[c]) / kappa), kappa / width * h)
        };
        let opacity = -(-tau).exp_m1();
        let emitted = match attenuation {
            Attenuation::Included => opacity,
            Attenuation::Neglected => tau,
        };
        (color.map(|c| c * emitted), opacity)
    }
}

#[cfg(test)]
mod tests {
    use supervol_scene::transfer_function::ControlPoint;

    use super::*;

    fn function(points: &[(f64, f64, f64)]) -> TransferFunction {
        let points = points.iter().map(|&(value, red, alpha)| ControlPoint { value, color: [red, 0.5, 1.0], alpha });
        TransferFunction::new(points.collect(), 1.5).unwrap()
    }

    /// Integral by many midpoint samples.
    fn brute_force(tf: &TransferFunction, front: f64, back: f64, h: f64) -> (f64, f64) {
        let n = 200_000;
        let (mut red, mut tau) = (0.0, 0.0);
        for i in 0..n {
            let value = front + (back - front) * (f64::from(i) + 0.5) / f64::from(n);
            let (color, alpha) = tf.classify(value);
            let kappa = tf.kappa(alpha) * h / f64::from(n);
            red += color[0] * kappa;
            tau += kappa;
        }
        (red, tau)
    }

    #[test]
    fn intervals_have_the_integrals_of_their_transfer_function() {
        let tf = function(&[(0.0, 0.9, 0.0), (1.0, 0.1, 0.8), (1.0, 0.7, 0.05), (1.25, 0.2, 0.3), (3.0, 1.0, 0.99)]);
        let table = PreIntegration::new(&tf);
        for (front, back) in [(-1.0, 4.0), (0.2, 0.7), (0.9, 1.1), (3.5, 1.2), (1.0, 0.0), (-2.0, -1.0), (5.0, 3.0)] {
            let (red, tau) = brute_force(&tf, front, back, 0.7);
            let (color, opacity) = table.interval(front, back, 0.7, Attenuation::Included);
            assert!((opacity + (-tau).exp_m1()).abs() < 2e-5, "{front} {back}: {opacity} {tau}");
            let expected = if tau > 0.0 { red / tau * opacity } else { 0.0 };
            assert!((color[0] - expected).abs() < 2e-5, "{front} {back}: {color:?} {expected}");
            let (bright, _) = table.interval(front, back, 0.7, Attenuation::Neglected);
            assert!((bright[0] - red).abs() < 2e-5 * (1.0 + red), "{front} {back}");
        }
    }

    /// S02: the brightness factor is tau over `1 - exp(-tau)`.
    #[test]
    fn neglecting_attenuation_is_too_bright_by_the_known_factor() {
        for (tau, factor) in [(0.05, 1.025), (0.5, 1.271), (2.0, 2.313)] {
            let alpha = -(-tau * 1.5f64).exp_m1();
            let table = PreIntegration::new(&function(&[(0.0, 1.0, alpha)]));
            let [true_red, neglected] = [Attenuation::Included, Attenuation::Neglected]
                .map(|attenuation| table.interval(0.3, 0.3, 1.0, attenuation).0[0]);
            assert!((neglected / true_red - factor).abs() < 1e-3);
        }
    }

    #[test]
    fn close_values_do_not_cancel() {
        let table = PreIntegration::new(&function(&[(0.0, 0.0, 0.1), (1e6, 1.0, 0.9)]));
        let at = |width: f64| table.interval(4e5, 4e5 + width, 1.0, Attenuation::Included).1;
        for width in [0.0, 1e-9, 0.05, 0.11, 1.0] {
            assert!((at(width) - at(0.0)).abs() < 1e-6, "{width}: {} {}", at(width), at(0.0));
        }
    }
}
