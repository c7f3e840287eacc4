//! Constants of the shaders that stand beside the Rust code they belong to: the packets' rules above all.

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::single;

use super::limits;
use crate::engines::blocks::BLOCK;
use crate::engines::cells::quadrature;
use crate::engines::packets::blocks::OVERSHOOT;
use crate::engines::packets::{highlight, shade, turn};
use crate::engines::rules;
use crate::lod::deviation::PER_OPACITY;

/// Name, WGSL type and value of a constant.
pub(super) type Constant = (&'static str, &'static str, String);

/// Numbers of the rules, under their own names.
macro_rules! of_rules {
    ($($name:ident)*) => {
        [$((stringify!($name), rules::$name)),*]
    };
}

/// All of them.
pub(super) fn constants() -> Vec<Constant> {
    let whole = [("APRON", APRON), ("MACRO_CELL", MACRO_CELL), ("BLOCK", BLOCK)];
    let counts = [
        ("SHARES", PER_OPACITY.len().to_string()),
        ("KNOT_LIMIT", quadrature::KNOT_LIMIT.to_string()),
        ("PAIR_LIMIT", quadrature::PAIR_LIMIT.to_string()),
        ("ISO_LIMIT", supervol_scene::scene::ISO_LIMIT.to_string()),
    ];
    let numbers = OF_RULES.into_iter().chain(OF_LIGHT).chain(of_places());
    let shares = PER_OPACITY.map(|a| format!("{a:?}")).join(", ");
    let whole = whole.map(|(name, value)| (name, "i32", value.to_string()));
    let counts = counts.map(|(name, value)| (name, "u32", format!("{value}u")));
    let numbers = numbers.map(|(name, value)| (name, "f32", format!("{value:?}")));
    let arrays = [("PER_OPACITY", "array<f32, SHARES>", format!("array<f32, SHARES>({shares})"))];
    whole.into_iter().chain(counts).chain(numbers).chain(arrays).collect()
}

/// Tolerances of the integral.
const OF_RULES: [(&str, f32); 45] = of_rules! {
    POSITION_ERROR PAIR_VARIATION PAIRS_PER_VARIATION PAIR_VARIATION_DEPTH PAIR_NORMAL_CHANGE PAIR_NORMAL_DEPTH
    MIN_WEIGHT LEAST_PART SHORTEST PARTS_LIMIT PARTS_PER_ROOT LEAST_SHARE EASY HARD AVERAGE_OF_BUMP
    AVERAGE_OF_CUBIC GREATEST_OF_CUBIC ORDER_SQUARE SQUARE_OF_BUMP SQUARE_OF_CUBIC SWING_OF_BUMP SWING_OF_CUBIC
    ORDER_CUBE MOST_OF_ORDER SERIES_UP_TO ORDER_OF_DEPTH ORDER_OF_TILT LEAST_TILT OPAQUE_TILT TILT_LIMIT
    LEAN_SQUARE SPREAD_SQUARE OF_CURVE OF_CURVES OF_KINK OF_UNSETTLED_KINK OF_BENDS OF_ANY_BENDS MOMENT_OF_KINK
    OF_STEP RESERVE_SHARE PARTS_SHARE ROUNDED_BELOW VALUE_ERROR SHORT_BESIDE_NOISE
};

/// Bounds of light: see `packets/turn.rs` and `packets/highlight.rs`.
const OF_LIGHT: [(&str, f32); 13] = [
    ("OF_FIRST", shade::OF_FIRST),
    ("TURN_SECOND", turn::SECOND),
    ("TURN_THIRD", turn::THIRD),
    ("TURN_FOURTH", turn::FOURTH),
    ("KERNEL_AT_END", turn::KERNEL[0]),
    ("KERNEL_IN_MIDDLE", turn::KERNEL[1]),
    ("OF_SECOND", turn::OF_SECOND),
    ("OF_THIRD", turn::OF_THIRD),
    ("AWAY_OF_SQUARE", turn::AWAY[0]),
    ("AWAY_OF_CUBE", turn::AWAY[1]),
    ("SMOOTH_FROM", highlight::SMOOTH_FROM),
    ("LEAST_COSINE", highlight::LEAST_COSINE),
    ("VERTICAL", highlight::VERTICAL),
];

/// Places and numbers of `f32`.
fn of_places() -> [(&'static str, f32); 8] {
    [
        ("GAUSS_OFFSET", single(quadrature::GAUSS_OFFSET)),
        ("GAUSS_DISTANCE", quadrature::GAUSS_DISTANCE),
        ("FAR", limits::FAR),
        ("LEAP_MARGIN", limits::LEAP_MARGIN),
        ("EPSILON", f32::EPSILON),
        ("LEAST_NORMAL", f32::MIN_POSITIVE),
        ("LEAST_LENGTH", f32::MIN_POSITIVE.sqrt()),
        ("OVERSHOOT", OVERSHOOT),
    ]
}
