//! Fields along a ray that are known exactly: what tests of either backend's integration compare with.

use supervol_scene::transfer_function::TransferFunction;

/// A cubic by its coefficients, and the world length it goes over.
pub(crate) type Cubic = ([f64; 4], f64);

/// The value at a share of the way.
pub(crate) fn cubic(k: [f64; 4], u: f64) -> f64 {
    k[0] + u * (k[1] + u * (k[2] + u * k[3]))
}

/// Shares of the way, ascending, at which a cubic turns round or passes one of these values.
fn breaks(k: [f64; 4], values: impl Iterator<Item = f64> + Clone) -> Vec<f64> {
    let [_, slope, square, cube] = k;
    let root = (square * square - 3.0 * slope * cube).sqrt();
    let turns = [(-square - root) / (3.0 * cube), (-square + root) / (3.0 * cube), -0.5 * slope / square];
    let mut ends: Vec<f64> = turns.into_iter().filter(|u| (0.0..1.0).contains(u)).chain([0.0, 1.0]).collect();
    ends.sort_by(f64::total_cmp);
    let mut found = ends.clone();
    for (pair, value) in ends.windows(2).flat_map(|pair| values.clone().map(move |value| (pair, value))) {
        let is_above = |u: f64| cubic(k, u) > value;
        let (mut low, mut high) = (pair[0], pair[1]);
        if is_above(low) == is_above(high) {
            continue;
        }
        let begins_above = is_above(low);
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if is_above(middle) == begins_above { low = middle } else { high = middle }
        }
        found.push(low);
    }
    found.sort_by(f64::total_cmp);
    found
}

/// Colour and transmittance of a cubic between two shares of the way, between which it passes no control point: by the midpoint
/// rule with so many steps.
fn by_steps(tf: &TransferFunction, (k, length): Cubic, [from, to]: [f64; 2], steps: u32) -> [f64; 4] {
    let (mut color, mut depth) = ([0.0; 3], 0.0f64);
    let width = (to - from) / f64::from(steps);
    for i in 0..steps {
        let (c, alpha) = tf.classify(cubic(k, from + (f64::from(i) + 0.5) * width));
        let of_step = tf.kappa(alpha) * length * width;
        let shown = (-depth).exp() * -(-of_step).exp_m1();
        (0..3).for_each(|i| color[i] += shown * c[i]);
        depth += of_step;
    }
    [color[0], color[1], color[2], (-depth).exp()]
}

/// Colour and transmittance of cubics one behind the other: the midpoint rule between control points, extrapolated (Richardson
/// 1911).
pub(crate) fn exact(tf: &TransferFunction, cubics: &[Cubic]) -> [f64; 4] {
    const STEPS: u32 = 128;
    let mut sum = [0.0, 0.0, 0.0, 1.0];
    for &(k, length) in cubics {
        let breaks = breaks(k, tf.points().iter().map(|point| point.value));
        for pair in breaks.windows(2).filter(|pair| pair[1] - pair[0] > 1e-12) {
            let of = |steps| by_steps(tf, (k, length), [pair[0], pair[1]], steps);
            let (coarse, fine) = (of(STEPS / 2), of(STEPS));
            let part: [f64; 4] = std::array::from_fn(|c| fine[c] + (fine[c] - coarse[c]) / 3.0);
            (0..3).for_each(|c| sum[c] += sum[3] * part[c]);
            sum[3] *= part[3];
        }
    }
    sum
}
