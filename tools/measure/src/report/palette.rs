//! Colours and marks: one combination per family of methods, the same in every figure.
//!
//! The colours are those of Okabe and Ito (2008, "Color Universal Design"), distinguishable with any colour vision.
//! Shapes distinguish families of equal colour.

use plotters::style::RGBColor;

use super::html::escape;

/// Shape of a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A filled circle.
    Circle,
    /// A filled square.
    Square,
    /// A filled triangle.
    Triangle,
    /// A filled diamond.
    Diamond,
    /// A cross.
    Cross,
}

/// Style of a family.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Colour.
    pub color: RGBColor,
    /// Shape.
    pub mark: Mark,
    /// Whether a line joins the points in the order of their parameters.
    pub joined: bool,
}

/// Black.
pub const BLACK: RGBColor = RGBColor(0, 0, 0);
/// Grey for guides and expected values.
pub const GREY: RGBColor = RGBColor(110, 118, 129);
const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const YELLOW: RGBColor = RGBColor(200, 180, 0);
/// Blue for the default.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// Vermillion for limits.
pub const VERMILLION: RGBColor = RGBColor(213, 94, 0);
const PURPLE: RGBColor = RGBColor(204, 121, 167);

/// All families of the chart, in legend order; the names are those of [`crate::methods`].
pub const FAMILIES: [(&str, Look); 20] = [
    ("default", joined(BLUE, Mark::Circle)),
    ("cells, adaptive", joined(SKY, Mark::Diamond)),
    ("cells, fixed", joined(SKY, Mark::Circle)),
    ("midpoint samples", joined(ORANGE, Mark::Square)),
    ("midpoint samples, jittered", joined(YELLOW, Mark::Square)),
    ("left samples", joined(VERMILLION, Mark::Square)),
    ("pre-integrated", joined(GREEN, Mark::Triangle)),
    ("pre-integrated, no self-attenuation", joined(PURPLE, Mark::Triangle)),
    ("pre-classified", joined(GREY, Mark::Triangle)),
    ("opacity not corrected for the step", joined(BLACK, Mark::Triangle)),
    ("reconstruction", loose(ORANGE, Mark::Diamond)),
    ("gradient operator", loose(GREEN, Mark::Diamond)),
    ("accumulation", loose(PURPLE, Mark::Diamond)),
    ("early ray termination", loose(VERMILLION, Mark::Cross)),
    ("level of detail", loose(GREY, Mark::Diamond)),
    ("codec", loose(GREEN, Mark::Cross)),
    ("bounded codec", loose(SKY, Mark::Cross)),
    ("storage", loose(ORANGE, Mark::Cross)),
    ("without skipping", loose(BLACK, Mark::Cross)),
    ("GPU backend", loose(PURPLE, Mark::Cross)),
];

/// The error that a picture states, in figures of errors.
pub const STATED: (&str, Look) = ("default: error that the picture states", loose(BLUE, Mark::Diamond));
/// The requested error, in figures of errors.
pub const ASKED: (&str, Look) = ("default: error asked for", loose(BLUE, Mark::Cross));

const fn joined(color: RGBColor, mark: Mark) -> Look {
    Look { color, mark, joined: true }
}

const fn loose(color: RGBColor, mark: Mark) -> Look {
    Look { color, mark, joined: false }
}

/// Colours and shapes for other names: 35 different looks before the first repeats.
const OTHER_COLORS: [RGBColor; 7] = [ORANGE, GREEN, PURPLE, SKY, VERMILLION, BLACK, YELLOW];
const OTHER_MARKS: [Mark; 5] = [Mark::Square, Mark::Triangle, Mark::Diamond, Mark::Circle, Mark::Cross];

/// Style of a family; other names get a style by their position in the figure.
#[must_use]
pub fn look(name: &str, place: usize) -> Look {
    let found = FAMILIES.iter().find(|(known, _)| *known == name);
    let other = joined(OTHER_COLORS[place % OTHER_COLORS.len()], OTHER_MARKS[place % OTHER_MARKS.len()]);
    found.map_or(other, |(_, look)| Look { joined: true, ..*look })
}

/// A mark as a small SVG, for legends outside figures.
#[must_use]
pub fn swatch(look: Look) -> String {
    let RGBColor(r, g, b) = look.color;
    let color = format!("rgb({r},{g},{b})");
    let line = if look.joined {
        format!("<line x1=\"0\" y1=\"7\" x2=\"26\" y2=\"7\" stroke=\"{color}\" stroke-opacity=\".5\"/>")
    } else {
        String::new()
    };
    let mark = match look.mark {
        Mark::Circle => format!("<circle cx=\"13\" cy=\"7\" r=\"4\" fill=\"{color}\"/>"),
        Mark::Square => format!("<rect x=\"9.5\" y=\"3.5\" width=\"7\" height=\"7\" fill=\"{color}\"/>"),
        Mark::Triangle => format!("<path d=\"M13 2l5 9h-10z\" fill=\"{color}\"/>"),
        Mark::Diamond => format!("<path d=\"M13 2l5 5l-5 5l-5-5z\" fill=\"{color}\"/>"),
        Mark::Cross => format!("<path d=\"M9 3l8 8m0-8l-8 8\" stroke=\"{color}\" stroke-width=\"2\" fill=\"none\"/>"),
    };
    format!("<svg viewBox=\"0 0 26 14\">{line}{mark}</svg>")
}

/// Marks and names side by side; empty without items.
#[must_use]
pub fn legend(items: &[(&str, Look)]) -> String {
    if items.is_empty() {
        return String::new();
    }
    let item = |(name, look): &(&str, Look)| format!("<span>{} {}</span>", swatch(*look), escape(name));
    format!("<div class=\"legend\">{}</div>\n", items.iter().map(item).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_family_of_the_chart_has_a_look_of_its_own() {
        for method in crate::methods::methods() {
            assert!(FAMILIES.iter().any(|(name, _)| *name == method.method), "{} has no colour", method.method);
        }
        for (i, (a, look)) in FAMILIES.iter().enumerate() {
            for (b, other) in &FAMILIES[..i] {
                assert!((look.color, look.mark) != (other.color, other.mark), "{a} looks like {b}");
            }
        }
    }
}
