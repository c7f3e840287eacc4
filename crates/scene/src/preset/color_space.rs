//! Colour spaces in which ParaView interpolates colour maps: RGB, HSV, CIE Lab, and Moreland's diverging maps.
//!
//! K. Moreland, Diverging Color Maps for Scientific Visualization, 2009: Msh is Lab in polar coordinates. A map between
//! two saturated colours of different hue passes through an unsaturated one. Channels are sRGB in [0, 1]; white is D65.

use std::f64::consts::{PI, TAU};
use std::str::FromStr;

/// A space of interpolation; see the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColorSpace {
    /// Linear in RGB.
    Rgb,
    /// Linear in hue, saturation and value; hue takes the shorter way round.
    Hsv,
    /// Linear in CIE L*a*b*.
    Lab,
    /// Moreland's Msh, passing through white or grey.
    Diverging,
    /// No interpolation: the colour of the point before.
    Step,
}

impl FromStr for ColorSpace {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "RGB" => Ok(Self::Rgb),
            "HSV" => Ok(Self::Hsv),
            "Lab" | "CIELAB" => Ok(Self::Lab),
            "Diverging" => Ok(Self::Diverging),
            "Step" => Ok(Self::Step),
            _ => Err(format!("`ColorSpace`: expected RGB, HSV, Lab, Diverging or Step, found '{name}'")),
        }
    }
}

/// XYZ tristimulus values of white.
const WHITE: [f64; 3] = [0.9505, 1.0, 1.089];
/// Matrices between linear sRGB and XYZ, row by row.
const XYZ_FROM_RGB: [[f64; 3]; 3] = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
const RGB_FROM_XYZ: [[f64; 3]; 3] = [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]];
/// Msh saturation below which a colour has no hue, and least angle between two hues at which white is inserted between
/// them.
const UNSATURATED: f64 = 0.05;
const DIFFERENT_HUES: f64 = PI / 3.0;
/// Least magnitude of the white that is inserted.
const WHITE_MAGNITUDE: f64 = 88.0;

impl ColorSpace {
    /// The colour at a share in [0, 1] of the way between two colours.
    #[must_use]
    pub fn between(self, from: [f64; 3], to: [f64; 3], share: f64) -> [f64; 3] {
        let straight = |a: [f64; 3], b: [f64; 3], share: f64| -> [f64; 3] {
            std::array::from_fn(|c| a[c] + share * (b[c] - a[c]))
        };
        match self {
            Self::Rgb => straight(from, to, share),
            Self::Step => from,
            Self::Lab => rgb_from_lab(straight(lab_from_rgb(from), lab_from_rgb(to), share)),
            Self::Hsv => {
                let [mut a, mut b] = [hsv_from_rgb(from), hsv_from_rgb(to)];
                if b[0] - a[0] > 0.5 {
                    a[0] += 1.0;
                } else if a[0] - b[0] > 0.5 {
                    b[0] += 1.0;
                }
                rgb_from_hsv(straight(a, b, share))
            }
            Self::Diverging => diverging(from, to, share),
        }
    }
}

fn times(matrix: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    matrix.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn lab_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    let linear = rgb.map(|c| if c > 0.04045 { ((c + 0.055) / 1.055).powf(2.4) } else { c / 12.92 });
    let xyz = times(XYZ_FROM_RGB, linear);
    let [x, y, z] = std::array::from_fn(|c| {
        let t: f64 = xyz[c] / WHITE[c];
        if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 }
    });
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn rgb_from_lab([l, a, b]: [f64; 3]) -> [f64; 3] {
    let y = (l + 16.0) / 116.0;
    let f = [a / 500.0 + y, y, y - b / 200.0];
    let xyz = std::array::from_fn(|c| {
        let cube = f[c].powi(3);
        WHITE[c] * if cube > 0.008_856 { cube } else { (f[c] - 16.0 / 116.0) / 7.787 }
    });
    let encoded = |c: f64| if c > 0.003_130_8 { 1.055 * c.powf(1.0 / 2.4) - 0.055 } else { 12.92 * c };
    let rgb = times(RGB_FROM_XYZ, xyz).map(encoded);
    // Colours beyond the display's gamut are made as light as possible with the same hue.
    let most = rgb.iter().copied().fold(1.0, f64::max);
    rgb.map(|c| (c / most).clamp(0.0, 1.0))
}

fn hsv_from_rgb([r, g, b]: [f64; 3]) -> [f64; 3] {
    let (most, least) = (r.max(g).max(b), r.min(g).min(b));
    let width = most - least;
    if width <= 0.0 {
        return [0.0, 0.0, most];
    }
    let sixths = if most == r {
        (g - b) / width
    } else if most == g {
        2.0 + (b - r) / width
    } else {
        4.0 + (r - g) / width
    };
    [(sixths / 6.0).rem_euclid(1.0), width / most, most]
}

fn rgb_from_hsv([h, s, v]: [f64; 3]) -> [f64; 3] {
    [5.0, 3.0, 1.0].map(|offset| {
        let k = (offset + 6.0 * h).rem_euclid(6.0);
        v - v * s * k.min(4.0 - k).clamp(0.0, 1.0)
    })
}

/// Msh of a colour: magnitude, saturation (an angle), hue (an angle).
fn msh_from_rgb(rgb: [f64; 3]) -> [f64; 3] {
    let [l, a, b] = lab_from_rgb(rgb);
    let m = (l * l + a * a + b * b).sqrt();
    let s = if m > 0.001 { (l / m).clamp(-1.0, 1.0).acos() } else { 0.0 };
    [m, s, if s > 0.001 { b.atan2(a) } else { 0.0 }]
}

fn rgb_from_msh([m, s, h]: [f64; 3]) -> [f64; 3] {
    rgb_from_lab([m * s.cos(), m * s.sin() * h.cos(), m * s.sin() * h.sin()])
}

/// The hue of an unsaturated colour of magnitude `unsaturated` beside a saturated colour (Moreland, section 5).
fn adjusted_hue([m, s, h]: [f64; 3], unsaturated: f64) -> f64 {
    if m >= unsaturated - 0.1 {
        return h;
    }
    let spin = s * (unsaturated * unsaturated - m * m).sqrt() / (m * s.sin());
    if h > -0.3 * PI { h + spin } else { h - spin }
}

fn diverging(from: [f64; 3], to: [f64; 3], share: f64) -> [f64; 3] {
    let (mut a, mut b, mut share) = (msh_from_rgb(from), msh_from_rgb(to), share);
    let angle = (a[2] - b[2]).rem_euclid(TAU);
    let apart = angle.min(TAU - angle);
    if a[1] > UNSATURATED && b[1] > UNSATURATED && apart > DIFFERENT_HUES {
        let white = [a[0].max(b[0]).max(WHITE_MAGNITUDE), 0.0, 0.0];
        if share < 0.5 {
            (b, share) = (white, 2.0 * share);
        } else {
            (a, share) = (white, 2.0 * share - 1.0);
        }
    }
    if a[1] < UNSATURATED && b[1] > UNSATURATED {
        a[2] = adjusted_hue(b, a[0]);
    } else if b[1] < UNSATURATED && a[1] > UNSATURATED {
        b[2] = adjusted_hue(a, b[0]);
    }
    rgb_from_msh(std::array::from_fn(|c| a[c] + share * (b[c] - a[c])))
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLORS: [[f64; 3]; 5] =
        [[0.231_373, 0.298_039, 0.752_941], [0.705_882, 0.015_686, 0.149_02], [1.0; 3], [0.2, 0.8, 0.1], [0.0; 3]];

    fn near(a: [f64; 3], b: [f64; 3], room: f64) -> bool {
        (0..3).all(|c| (a[c] - b[c]).abs() <= room)
    }

    #[test]
    fn every_space_begins_and_ends_with_its_colours() {
        for space in ["RGB", "HSV", "Lab", "Diverging"].map(|name| name.parse::<ColorSpace>().unwrap()) {
            for from in COLORS {
                for to in COLORS {
                    // The matrices have four digits.
                    assert!(near(space.between(from, to, 0.0), from, 2e-3), "{space:?} {from:?}");
                    assert!(near(space.between(from, to, 1.0), to, 2e-3), "{space:?} {to:?}");
                    let middle = space.between(from, to, 0.37);
                    assert!(middle.iter().all(|c| (0.0..=1.0).contains(c)), "{space:?} {from:?} {to:?} {middle:?}");
                }
            }
        }
        assert!("Lab/CIEDE2000".parse::<ColorSpace>().unwrap_err().contains("ColorSpace"));
    }

    /// From Moreland's table of the cool-to-warm map with 33 points: (221, 221, 221) in the middle, (141, 176, 254) at
    /// a quarter.
    #[test]
    fn cool_to_warm_is_as_it_was_published() {
        let at = |share| ColorSpace::Diverging.between(COLORS[0], COLORS[1], share);
        assert!(near(at(0.5), [221.0 / 255.0; 3], 0.01), "{:?}", at(0.5));
        assert!(near(at(0.25), [141.0 / 255.0, 176.0 / 255.0, 254.0 / 255.0], 0.01), "{:?}", at(0.25));
        assert!(near(at(0.75), [244.0 / 255.0, 154.0 / 255.0, 123.0 / 255.0], 0.01), "{:?}", at(0.75));
    }

    #[test]
    fn hues_go_the_short_way_round() {
        let (red, magenta) = ([1.0, 0.0, 0.0], [1.0, 0.0, 1.0]);
        assert!(near(ColorSpace::Hsv.between(red, magenta, 0.5), [1.0, 0.0, 0.5], 1e-12));
        assert!(near(ColorSpace::Hsv.between(magenta, red, 0.5), [1.0, 0.0, 0.5], 1e-12));
        let green = [0.0, 1.0, 0.0];
        assert!(near(ColorSpace::Hsv.between(red, green, 0.5), [1.0, 1.0, 0.0], 1e-12));
    }
}
