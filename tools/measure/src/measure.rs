//! Distance between two pictures, on linear premultiplied RGBA without background; spread of repeated times.
//!
//! All distances except FLIP are fractions of full scale: 1/255 is a grey level. FLIP (Andersson et al. 2020, "FLIP: A
//! Difference Evaluator for Alternating Images") models human vision: pictures over black, 8 bit; 0 (equal) to 1.

use serde::Serialize;
use supervol_format::cast::whole;
pub use supervol_scene::image::GREY_LEVELS;
use supervol_scene::image::Image;

/// Tolerance between pictures that should be equal, grey levels of 255.
pub const HALF_A_LEVEL: f64 = 0.5;
/// The same tolerance as a fraction of full scale: invisible in 8-bit pictures.
pub const INVISIBLE: f64 = HALF_A_LEVEL / GREY_LEVELS;

/// Median and extremes of repeated measurements, milliseconds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Median.
    pub median_ms: f64,
    /// Fastest.
    pub least_ms: f64,
    /// Slowest.
    pub greatest_ms: f64,
}

impl Spread {
    /// Median and extremes of at least one measurement, in the unit of the measurements.
    ///
    /// # Panics
    /// If `measured` is empty.
    #[must_use]
    pub fn of(measured: &[f64]) -> Self {
        assert!(!measured.is_empty(), "a median of nothing");
        let mut sorted = measured.to_vec();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        let median_ms = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
        Self { median_ms, least_ms: sorted[0], greatest_ms: sorted[n - 1] }
    }
}

/// Distance of a picture from the exact picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Distance {
    /// Greatest difference of any channel of any pixel.
    pub linf: f64,
    /// 99.9th percentile of the differences of all channels of all pixels.
    pub p999: f64,
    /// Root mean square difference.
    pub rmse: f64,
    /// `-20 log10(rmse)`; infinite for equal pictures.
    pub psnr_db: f64,
    /// Mean signed difference, picture minus exact picture.
    pub bias: f64,
}

/// Distance of a picture from the exact one.
///
/// A channel that is not finite counts as infinitely far.
///
/// # Panics
/// If the pictures differ in size.
#[must_use]
pub fn distance(picture: &Image, exact: &Image) -> Distance {
    assert_eq!((picture.width, picture.height), (exact.width, exact.height), "sizes of two pictures to compare");
    distance_of(picture.pixels.as_flattened(), exact.pixels.as_flattened())
}

/// Distance of two lists of channels.
///
/// # Panics
/// If the lists differ in length or are empty.
#[must_use]
pub fn distance_of(channels: &[f32], exact: &[f32]) -> Distance {
    assert_eq!(channels.len(), exact.len(), "channels of two pictures to compare");
    assert!(!channels.is_empty(), "pictures without pixels");
    let signed = channels.iter().zip(exact).map(|(a, b)| f64::from(*a) - f64::from(*b));
    let mut sizes: Vec<f64> = signed.clone().map(|d| if d.is_nan() { f64::INFINITY } else { d.abs() }).collect();
    sizes.sort_by(f64::total_cmp);
    let n = sizes.len();
    let rmse = (sizes.iter().map(|d| d * d).sum::<f64>() / n as f64).sqrt();
    Distance {
        linf: sizes[n - 1],
        p999: sizes[whole::<usize>((n as f64 * 0.999).ceil()).clamp(1, n) - 1],
        rmse,
        psnr_db: -20.0 * rmse.log10(),
        bias: signed.sum::<f64>() / n as f64,
    }
}

/// FLIP between two pictures over black, mean over all pixels (Andersson et al. 2020).
///
/// # Panics
/// If the pictures differ in size.
#[must_use]
#[cfg(feature = "flip")]
pub fn flip(picture: &Image, exact: &Image) -> Option<f64> {
    assert_eq!((picture.width, picture.height), (exact.width, exact.height), "sizes of two pictures to compare");
    let as_flip =
        |image: &Image| nv_flip::FlipImageRgb8::with_data(image.width, image.height, &image.to_rgb8([0.0; 3]));
    let map = nv_flip::flip(as_flip(exact), as_flip(picture), nv_flip::DEFAULT_PIXELS_PER_DEGREE);
    Some(f64::from(nv_flip::FlipPool::from_image(&map).mean()))
}

/// Always `None`: the crate was built without the feature `flip`.
#[must_use]
#[cfg(not(feature = "flip"))]
pub fn flip(_: &Image, _: &Image) -> Option<f64> {
    None
}

/// Observed order of convergence: the negative slope of the least-squares line through (log cost, log error).
///
/// `None` for fewer than two points.
#[must_use]
pub fn order_of(points: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> =
        points.iter().filter(|(n, e)| *n > 0.0 && *e > 0.0).map(|(n, e)| (n.ln(), e.ln())).collect();
    if logs.len() < 2 {
        return None;
    }
    let mean = |f: fn(&(f64, f64)) -> f64| logs.iter().map(f).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let covariance: f64 = logs.iter().map(|p| (p.0 - x) * (p.1 - y)).sum();
    let variance: f64 = logs.iter().map(|p| (p.0 - x) * (p.0 - x)).sum();
    (variance > 0.0).then(|| -covariance / variance)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(f: impl Fn(usize) -> [f32; 4]) -> Image {
        Image { width: 50, height: 40, pixels: (0..2000).map(f).collect() }
    }

    #[test]
    fn distances_have_their_definitions() {
        let exact = image(|i| [i as f32 / 2000.0; 4]);
        let mut picture = exact.clone();
        picture.pixels[7][2] += 0.5;
        picture.pixels[9][1] -= 0.25;
        let d = distance(&picture, &exact);
        assert!((d.linf - 0.5).abs() < 1e-6 && d.p999 < 1e-6);
        assert!((d.bias - 0.25 / 8000.0).abs() < 1e-9);
        let rmse = ((0.25 + 0.0625) / 8000.0f64).sqrt();
        assert!((d.rmse - rmse).abs() < 1e-8 && (d.psnr_db + 20.0 * rmse.log10()).abs() < 1e-4);
        assert_eq!(distance(&exact, &exact).psnr_db, f64::INFINITY);
        picture.pixels[0][0] = f32::NAN;
        assert_eq!(distance(&picture, &exact).linf, f64::INFINITY);
    }

    #[test]
    #[cfg(feature = "flip")]
    fn flip_is_zero_for_equal_pictures_only() {
        let exact = image(|i| [(i % 50) as f32 / 50.0, 0.2, 0.4, 1.0]);
        let other = image(|i| [(i % 50) as f32 / 60.0, 0.2, 0.4, 1.0]);
        assert_eq!(flip(&exact, &exact), Some(0.0));
        let difference = flip(&other, &exact).unwrap();
        assert!(difference > 1e-3 && difference < 1.0, "{difference}");
    }

    #[test]
    fn the_order_of_a_power_law_is_its_exponent() {
        let points: Vec<(f64, f64)> =
            (1..6).map(|i| (f64::from(1 << i), 3.0 * f64::from(1 << i).powf(-1.77))).collect();
        assert!((order_of(&points).unwrap() - 1.77).abs() < 1e-9);
        assert_eq!(order_of(&points[..1]), None);
    }
}
