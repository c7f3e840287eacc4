//! The transfer function as emission and extinction in closed form: the look-up table of ray packets.
//!
//! The function is cut into *pieces* along the value axis. On each piece four channels are quadratic: extinction kappa,
//! and kappa times red, green and blue (the emission). Their antiderivatives are cubic. So the mean of a channel over
//! an interval of values is a difference of two look-ups divided by the interval's width. This holds whatever steps and
//! bends lie inside. Pre-integration (Engel, Kraus, Ertl 2001, "High-quality pre-integrated volume rendering") reduces
//! to this if attenuation inside the interval is left out. Here it is not left out; see `engines::packets` in
//! `supervol-runtime`.
//!
//! A piece ends where a quadratic would deviate from the definition by more than a tolerance times the extinction.
//! Several control points share a piece if one quadratic fits them.
//!
//! The table also holds running sums over the pieces: heights of steps, changes of slope, and variation of colour.
//! Their differences over an interval bound the error of a quadrature rule in it.

use supervol_format::cast::single;

use super::fit::{Fitter, Segment, channels_between};
use super::render::with_limit_points;
use super::{ControlPoint, TransferFunction};

/// Number of channels: extinction, and extinction times red, green, blue.
pub const CHANNELS: usize = 4;
/// Columns are padded to a power of two, at least this.
pub const LEAST_STRIDE: usize = 16;

/// Columns of the table: the quantities of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Column {
    /// The piece's least value; infinity in rows beyond the last piece.
    Knot,
    /// The value relative to which the polynomials are given: the knot. For the first piece, the knot of the second
    /// one.
    Anchor,
    /// Antiderivative of channel 0 at the anchor; the other three channels follow.
    Start,
    /// Channel 0 at the anchor; the other three follow.
    Value = Column::Start as usize + CHANNELS,
    /// Half the slope of channel 0 at the anchor; the other three follow.
    HalfSlope = Column::Value as usize + CHANNELS,
    /// A third of the quadratic coefficient of channel 0; the other three follow.
    ThirdBend = Column::HalfSlope as usize + CHANNELS,
    /// The next control point above the piece; infinity if there is none.
    KinkAbove = Column::ThirdBend as usize + CHANNELS,
    /// Greatest change of slope there.
    ChangeAbove,
    /// Change of slope of channel 0 there; the other three follow.
    ChangesAbove,
    /// The last control point that is not above the piece's knot; minus infinity if there is none.
    KinkBelow = Column::ChangesAbove as usize + CHANNELS,
    /// Greatest change of slope there.
    ChangeBelow,
    /// Change of slope of channel 0 there; the other three follow.
    ChangesBelow,
    /// Sum of the heights of all steps up to the anchor; each counts with its greatest channel.
    Steps = Column::ChangesBelow as usize + CHANNELS,
    /// Sum of the changes of slope up to the anchor; each counts with its greatest channel.
    Bends,
    /// Change of slope per unit of value.
    BendsPerValue,
    /// Sum of the changes of slope at knots, up to the anchor: a part of the bends.
    Kinks,
    /// Number of the piece's *stretch*: the pieces between two control points, or one piece over several.
    Stretch,
    /// Greatest change of slope per unit of value in the stretch.
    BendOfStretch,
    /// Sum of the changes of curvature, the second derivative, at the stretch's knots, up to the piece's own.
    Curvatures,
    /// Variation of visible colour up to the anchor.
    ColorVariation,
    /// Variation of visible colour per unit of value.
    ColorVariationPerValue,
}

/// Number of columns.
pub const COLUMNS: usize = Column::ColorVariationPerValue as usize + 1;

/// The table; see the module. Values are render values; extinction is per world length.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferPieces {
    /// Column by column, each [`TransferPieces::stride`] long.
    columns: Vec<f32>,
    stride: usize,
    count: usize,
    /// Limits of the means of its channels.
    pub limits: Limits,
    /// An interval strictly inside which values are transparent: the values below the function's first point if they
    /// are transparent, else the widest such interval. `[inf, -inf]` if there is none.
    pub clear: [f32; 2],
}

/// Limits of means over intervals of values, which are differences of antiderivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Width of an interval below which the mean is taken from its two ends: the difference would cancel.
    pub narrow: f32,
    /// Bound on the error of a difference: it falls on the mean over the interval's width.
    pub difference: f32,
    /// Greatest change of slope per unit of value in any piece.
    pub bend: f32,
    /// Bounds on what roundings take from a difference of sums of bends, and of kinks.
    pub rounded: [f32; 2],
}

/// Error of a difference of two rounded antiderivatives, in parts of the greatest: half a unit in the last place of each, as much of
/// the difference, and twice as much of the polynomials.
const ROUNDED_DIFFERENCE: f64 = 2.0 * f32::EPSILON as f64;

/// One piece during construction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Piece {
    pub(super) knot: f64,
    pub(super) anchor: f64,
    /// Coefficients of 1, y, y^2 for each channel, y the distance from the anchor.
    pub(super) channels: [[f64; 3]; CHANNELS],
    pub(super) color_slope: f64,
    /// Whether it begins at a control point.
    pub(super) begins_at_point: bool,
}

impl TransferPieces {
    /// The pieces of a transfer function. `shift` is subtracted from every data value. Extinction and emission are
    /// exact to `tolerance` times the extinction, the opacity of a ray to a third of that.
    #[must_use]
    pub fn new(source: &TransferFunction, shift: f64, tolerance: f64) -> Self {
        let pieces = pieces_of(source, shift, tolerance);
        let count = pieces.len();
        let stride = count.next_power_of_two().max(LEAST_STRIDE);
        let (first, last) = (pieces[0].anchor, pieces[count - 1].anchor);
        let bend = single(pieces.iter().map(bend_of).fold(0.0, f64::max));
        let narrow = single(NARROW_SHARE * (last - first));
        let limits = Limits { narrow, difference: 0.0, bend, rounded: [0.0; 2] };
        let columns = vec![0.0; stride * COLUMNS];
        let mut table = Self { columns, stride, count, limits, clear: clear_interval(&pieces) };
        table.columns[..stride].fill(f32::INFINITY);
        let mut sums = Sums::default();
        for (i, piece) in pieces.iter().enumerate() {
            if let Some(before) = i.checked_sub(1).map(|b| &pieces[b]) {
                sums.cross(before, piece, tolerance);
            }
            table.write(i, piece, &sums);
            table.write_stretch(&pieces, i);
            if let Some(next) = pieces.get(i + 1) {
                sums.advance(piece, next.knot - piece.anchor);
            }
        }
        table.write_kinks(&pieces);
        // Emission is never greater than extinction.
        table.limits.difference = single(ROUNDED_DIFFERENCE * sums.antiderivative[0]);
        table.limits.rounded = [sums.bends, sums.kinks].map(|sum| single(ROUNDED_DIFFERENCE * sum));
        table
    }

    /// Number of pieces.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether the function has steps.
    #[must_use]
    pub fn has_steps(&self) -> bool {
        self.column(Column::Steps, 0)[self.count - 1] > 0.0
    }

    /// Length of a column; a power of two, at least [`LEAST_STRIDE`].
    #[must_use]
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// One column. `column` names channel 0; `channel` is added to its index.
    #[inline]
    #[must_use]
    pub fn column(&self, column: Column, channel: usize) -> &[f32] {
        let first = (column as usize + channel) * self.stride;
        &self.columns[first..first + self.stride]
    }

    /// All columns, in the order of [`Column`].
    pub fn all_columns(&self) -> impl Iterator<Item = &[f32]> {
        self.columns.chunks_exact(self.stride)
    }

    fn write(&mut self, i: usize, piece: &Piece, sums: &Sums) {
        let stride = self.stride;
        let mut set = |column: Column, channel: usize, value: f64| {
            self.columns[(column as usize + channel) * stride + i] = single(value);
        };
        set(Column::Knot, 0, piece.knot);
        set(Column::Anchor, 0, piece.anchor);
        for (c, [value, slope, bend]) in piece.channels.into_iter().enumerate() {
            set(Column::Start, c, sums.antiderivative[c]);
            set(Column::Value, c, value);
            set(Column::HalfSlope, c, slope / 2.0);
            set(Column::ThirdBend, c, bend / 3.0);
        }
        set(Column::Steps, 0, sums.steps);
        set(Column::Bends, 0, sums.bends);
        set(Column::Kinks, 0, sums.kinks);
        set(Column::BendsPerValue, 0, bend_of(piece));
        set(Column::ColorVariation, 0, sums.color);
        set(Column::ColorVariationPerValue, 0, piece.color_slope);
    }

    fn write_stretch(&mut self, pieces: &[Piece], i: usize) {
        let number = pieces[..=i].iter().filter(|piece| piece.begins_at_point).count();
        let before = pieces[..=i].iter().rposition(|piece| piece.begins_at_point).unwrap_or(0);
        let behind = pieces[i + 1..].iter().position(|piece| piece.begins_at_point).map_or(pieces.len(), |n| i + 1 + n);
        let bend = pieces[before..behind].iter().map(bend_of).fold(0.0, f64::max);
        let curvature = |at: usize| greatest(changes_at(&pieces[at - 1], &pieces[at]).map(|change| change[2]));
        let curvatures: f64 = (before + 1..=i).map(curvature).sum();
        self.columns[Column::Stretch as usize * self.stride + i] = single(number as f64);
        self.columns[Column::BendOfStretch as usize * self.stride + i] = single(bend);
        self.columns[Column::Curvatures as usize * self.stride + i] = single(curvatures);
    }

    /// Writes the control points next to each piece, where slopes change. Other knots lie where a smooth function is cut: what little
    /// changes there is a part of [`Column::Kinks`].
    fn write_kinks(&mut self, pieces: &[Piece]) {
        let is_kink = |i: &usize| *i > 0 && pieces[*i].begins_at_point;
        for i in 0..pieces.len() {
            let above = (i + 1..pieces.len()).find(is_kink);
            self.write_kink((i, above), pieces, [Column::KinkAbove, Column::ChangeAbove, Column::ChangesAbove]);
            let below = (0..=i).rev().find(is_kink);
            self.write_kink((i, below), pieces, [Column::KinkBelow, Column::ChangeBelow, Column::ChangesBelow]);
        }
        let none = f32::NEG_INFINITY;
        (pieces.len()..self.stride).for_each(|i| self.columns[Column::KinkBelow as usize * self.stride + i] = none);
    }

    /// Writes the kink where a piece begins into columns of another: place, greatest change of slope, and changes.
    fn write_kink(&mut self, (i, kink): (usize, Option<usize>), pieces: &[Piece], [at, most, changes]: [Column; 3]) {
        let Some(kink) = kink else {
            let none = if at == Column::KinkAbove { f32::INFINITY } else { f32::NEG_INFINITY };
            self.columns[at as usize * self.stride + i] = none;
            return;
        };
        let found = changes_at(&pieces[kink - 1], &pieces[kink]).map(|change| change[1]);
        self.columns[at as usize * self.stride + i] = single(pieces[kink].knot);
        self.columns[most as usize * self.stride + i] = single(greatest(found));
        for (c, change) in found.into_iter().enumerate() {
            self.columns[(changes as usize + c) * self.stride + i] = single(change);
        }
    }
}

/// See [`TransferPieces::clear`].
fn clear_interval(pieces: &[Piece]) -> [f32; 2] {
    let is_clear = |piece: &Piece| piece.channels.iter().flatten().all(|&c| c == 0.0);
    let mut best = [f64::INFINITY, f64::NEG_INFINITY];
    let mut begin = None;
    for (i, piece) in pieces.iter().enumerate() {
        if !is_clear(piece) {
            begin = None;
            continue;
        }
        let begin = *begin.get_or_insert(piece.knot);
        let end = pieces.get(i + 1).map_or(f64::INFINITY, |next| next.knot);
        // An interval that begins below the first point is infinitely wide: none is wider.
        if begin == best[0] || end - begin > best[1] - best[0] {
            best = [begin, end];
        }
    }
    best.map(single)
}

/// Intervals below this share of the function's width are narrow.
const NARROW_SHARE: f64 = 5e-5;

/// Running sums over the pieces before a piece.
#[derive(Default)]
struct Sums {
    antiderivative: [f64; CHANNELS],
    steps: f64,
    bends: f64,
    kinks: f64,
    color: f64,
}

impl Sums {
    /// Crosses the knot between two pieces.
    fn cross(&mut self, before: &Piece, after: &Piece, tolerance: f64) {
        let changes = changes_at(before, after);
        let [step, bend] = [0, 1].map(|order| greatest(changes.map(|change| change[order])));
        // The misfit between two pieces of one segment is not a step.
        let scale = before.channels[0][0].abs().max(after.channels[0][0].abs());
        if step > 4.0 * tolerance * scale {
            self.steps += step;
            self.color += color_step(before, after, after.knot - before.anchor);
        }
        self.bends += bend;
        self.kinks += bend;
    }

    /// Advances by `y` within a piece, in units of value.
    fn advance(&mut self, piece: &Piece, y: f64) {
        for (sum, [value, slope, bend]) in self.antiderivative.iter_mut().zip(piece.channels) {
            *sum += y * (value + y * (slope / 2.0 + y * bend / 3.0));
        }
        self.bends += y * bend_of(piece);
        self.color += y * piece.color_slope;
    }
}

/// Changes of value, slope and curvature of the channels between two neighbouring pieces.
fn changes_at(before: &Piece, after: &Piece) -> [[f64; 3]; CHANNELS] {
    let y = after.knot - before.anchor;
    std::array::from_fn(|c| {
        let ([v0, s0, b0], [v1, s1, b1]) = (before.channels[c], after.channels[c]);
        [v1 - (v0 + y * (s0 + y * b0)), s1 - (s0 + 2.0 * y * b0), 2.0 * (b1 - b0)]
    })
}

/// Greatest of a quantity that every channel has, and of the same of what is absorbed and not emitted: extinction less emission. An
/// error of one is seen in front of black, an error of the other in front of white.
fn greatest([extinction, emission @ ..]: [f64; CHANNELS]) -> f64 {
    emission.iter().flat_map(|e| [e.abs(), (extinction - e).abs()]).fold(extinction.abs(), f64::max)
}

fn bend_of(piece: &Piece) -> f64 {
    greatest(piece.channels.map(|[_, _, bend]| 2.0 * bend))
}

/// Greatest change of a colour channel across a knot; 0 if one side is invisible, because no wrong colour can show.
fn color_step(before: &Piece, after: &Piece, y: f64) -> f64 {
    let at = |c: &[f64; 3], y: f64| c[0] + y * (c[1] + y * c[2]);
    let kappas = [at(&before.channels[0], y), after.channels[0][0]];
    if kappas.iter().any(|&k| k <= 0.0) {
        return 0.0;
    }
    let change = |c: usize| (at(&before.channels[c], y) / kappas[0] - after.channels[c][0] / kappas[1]).abs();
    (1..CHANNELS).map(change).fold(0.0, f64::max)
}

pub(super) fn pieces_of(source: &TransferFunction, shift: f64, tolerance: f64) -> Vec<Piece> {
    let points = with_limit_points(source.points());
    let values: Vec<f64> = points.iter().map(|p| f64::from(single(p.value - shift))).collect();
    let constant = |knot: f64, anchor: f64, point: ControlPoint| Piece {
        knot,
        anchor,
        channels: channels_between(source, &[point, point], 0.0).map(|v| [v, 0.0, 0.0]),
        color_slope: 0.0,
        begins_at_point: true,
    };
    let segments: Vec<Segment> = (1..points.len())
        .filter(|&i| values[i - 1] < values[i])
        .map(|i| Segment { ends: [points[i - 1], points[i]], values: [values[i - 1], values[i]] })
        .collect();
    let last = points.len() - 1;
    let mut pieces = vec![constant(f64::NEG_INFINITY, values[0], points[0])];
    let mut fitter = Fitter { source, segments: &segments, tolerance };
    let mut begin = values[0];
    while let Some(piece) = fitter.next_piece(&mut begin) {
        pieces.push(piece);
    }
    pieces.push(constant(values[last], values[last], points[last]));
    pieces
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn function(points: &[(f64, f64)]) -> TransferFunction {
        let color = |a: f64| [a, 0.5, 1.0 - a];
        let points = points.iter().map(|&(value, alpha)| ControlPoint { value, color: color(alpha), alpha });
        TransferFunction::new(points.collect(), 1.5).unwrap()
    }

    fn piece_at(table: &TransferPieces, value: f32) -> usize {
        table.column(Column::Knot, 0)[..table.count()].iter().rposition(|&k| k <= value).unwrap()
    }

    fn channel(table: &TransferPieces, value: f32, c: usize) -> (f64, f64) {
        let i = piece_at(table, value);
        let of = |column| f64::from(table.column(column, c)[i]);
        let y = f64::from(value - table.column(Column::Anchor, 0)[i]);
        let (start, v, a, b) = (of(Column::Start), of(Column::Value), of(Column::HalfSlope), of(Column::ThirdBend));
        (start + y * (v + y * (a + y * b)), v + y * (2.0 * a + y * 3.0 * b))
    }

    #[test]
    fn a_ramp_to_full_opacity_takes_few_pieces() {
        let ramp = TransferPieces::new(&function(&[(0.0, 0.0), (255.0, 0.3)]), 0.0, 1e-3);
        assert!(ramp.count() <= 6, "{}", ramp.count());
        let full = TransferPieces::new(&function(&[(0.0, 0.0), (255.0, 1.0)]), 0.0, 1e-3);
        assert!(full.count() <= 32, "{}", full.count());
    }

    #[test]
    fn what_shows_nothing_is_known() {
        let clear = |points: &[(f64, f64)]| TransferPieces::new(&function(points), 0.0, 1e-3).clear;
        assert_eq!(clear(&[(10.0, 0.0), (20.0, 0.5)]), [f32::NEG_INFINITY, 10.0]);
        assert_eq!(clear(&[(10.0, 0.0), (12.0, 0.0), (20.0, 0.5), (30.0, 0.0)]), [f32::NEG_INFINITY, 12.0]);
        // Two transparent gaps: the wider one counts.
        let wings = [(0.0, 0.9), (5.0, 0.0), (6.0, 0.0), (7.0, 0.3), (8.0, 0.0), (20.0, 0.0), (30.0, 0.9)];
        assert_eq!(clear(&wings), [8.0, 20.0]);
        assert_eq!(clear(&[(0.0, 0.5), (20.0, 0.0)]), [20.0, f32::INFINITY]);
        assert_eq!(clear(&[(0.0, 0.5), (20.0, 0.1)]), [f32::INFINITY, f32::NEG_INFINITY]);
    }

    #[test]
    fn many_control_points_of_a_smooth_function_share_pieces() {
        let points: Vec<(f64, f64)> = (0..=255).map(|i| (f64::from(i), 0.3 * (f64::from(i) / 255.0).powi(2))).collect();
        let table = TransferPieces::new(&function(&points), 0.0, 1e-3);
        assert!(table.count() <= 32, "{}", table.count());
    }

    #[test]
    fn a_narrow_spike_far_from_zero_is_fitted() {
        let tf = function(&[(126.5, 0.0), (127.5, 0.9), (128.5, 0.0)]);
        let table = TransferPieces::new(&tf, 0.0, 1e-3);
        assert!(table.count() <= 32, "{}", table.count());
        for i in 1..2000 {
            let value = 126.5 + i as f32 / 1000.0;
            let exact = tf.kappa(tf.classify(f64::from(value)).1);
            let found = channel(&table, value, 0).1;
            assert!((found - exact).abs() <= 1.5e-3 * exact + 1e-5, "{value} {found} {exact}");
        }
    }

    proptest! {
        #[test]
        fn pieces_are_the_transfer_function_and_its_antiderivative(
            mut points in prop::collection::vec((0u8..64, prop::sample::select(vec![0.0, 0.0, 0.25, 0.5, 1.0])), 1..12),
            values in prop::collection::vec(-4.0f32..70.0, 8),
        ) {
            points.sort_by_key(|p| p.0);
            let points: Vec<(f64, f64)> = points.iter().map(|p| (f64::from(p.0), p.1)).collect();
            let tf = function(&points);
            let table = TransferPieces::new(&tf, 0.0, 1e-3);
            for &value in &values {
                let (color, alpha) = tf.classify(f64::from(value));
                let kappa = tf.kappa(alpha);
                let exact = [kappa, kappa * color[0], kappa * color[1], kappa * color[2]];
                for (c, exact) in exact.into_iter().enumerate() {
                    let found = channel(&table, value, c).1;
                    prop_assert!((found - exact).abs() <= 1.5e-3 * kappa + 1e-5, "{value} {c} {found}");
                }
            }
            // Against the midpoint rule.
            let (low, high) = (-2.0f32, 66.0f32);
            let n = 40_000;
            let h = f64::from(high - low) / f64::from(n);
            let exact: f64 = (0..n).map(|i| {
                h * tf.kappa(tf.classify(f64::from(low) + (f64::from(i) + 0.5) * h).1)
            }).sum();
            let found = channel(&table, high, 0).0 - channel(&table, low, 0).0;
            prop_assert!((found - exact).abs() <= 1e-3 * exact + 0.04, "{found} {exact}");
        }
    }
}
