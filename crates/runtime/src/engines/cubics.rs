//! Fields along a ray that are known exactly: what tests of either backend's integration compare with.

use supervol_scene::transfer_function::TransferFunction;

/// A cubic by its coefficients, and the world length it goes over.
pub(crate) type Cubic = ([f64; 4], f64);

/// The value at a share of the way.
pub(crate) fn cubic(k: [f64; 4], u: f64) -> f64 {
    k[0] + u * (k[1] + u * (k[2] + u * k[3]))
}

/// Colour and transmittance of cubics one behind the other, by 20,000 steps in all.
pub(crate) fn exact(tf: &TransferFunction, cubics: &[Cubic]) -> [f64; 4] {
    let steps = 20_000 / cubics.len();
    let (mut color, mut transmittance) = ([0.0; 3], 1.0);
    for &(k, length) in cubics {
        let h = length / steps as f64;
        for i in 0..steps {
            let (c, alpha) = tf.classify(cubic(k, (i as f64 + 0.5) / steps as f64));
            let through = (-tf.kappa(alpha) * h).exp();
            (0..3).for_each(|i| color[i] += transmittance * (1.0 - through) * c[i]);
            transmittance *= through;
        }
    }
    [color[0], color[1], color[2], transmittance]
}
