//! Looks up the transfer function's pieces, lane by lane.
//!
//! Up to [`FEW`] pieces fit into two registers, and a look-up takes one instruction. More pieces are gathered from memory.

use supervol_format::cast::narrow;
use supervol_scene::transfer_function::pieces::{CHANNELS, COLUMNS, Column, TransferPieces};

use super::simd::Simd;

/// Position of a value: its piece, and its distance from the piece's anchor.
#[derive(Clone, Copy)]
pub struct Place<S: Simd> {
    /// Number of the piece.
    pub piece: S::I,
    /// Value minus anchor.
    pub y: S::F,
}

/// A table of pieces for lanes.
pub trait PieceLookup {
    /// The column's number for each lane's piece.
    fn column<S: Simd>(&self, column: Column, channel: usize, piece: S::I) -> S::F;

    /// The piece of each lane's value: the last whose knot is not greater; 0 for NaN.
    fn piece_of<S: Simd>(&self, value: S::F) -> S::I;

    /// Piece and distance from its anchor.
    #[inline(always)]
    fn place<S: Simd>(&self, value: S::F) -> Place<S> {
        self.place_in::<S>(self.piece_of::<S>(value), value)
    }

    /// Distance from the anchor of its piece.
    #[inline(always)]
    fn place_in<S: Simd>(&self, piece: S::I, value: S::F) -> Place<S> {
        Place { piece, y: value - self.column::<S>(Column::Anchor, 0, piece) }
    }
}

/// Binary search among the knots, whose number is a power of two; the first is never compared.
#[inline(always)]
fn search<S: Simd, L: PieceLookup>(table: &L, length: usize, value: S::F) -> S::I {
    let mut piece = S::splat_int(0);
    let mut step = length / 2;
    while step > 0 {
        let candidate = piece + S::splat_int(narrow::<i32>(step));
        let knot = table.column::<S>(Column::Knot, 0, candidate);
        piece = S::select_int(S::le(knot, value), candidate, piece);
        step /= 2;
    }
    piece
}

/// Most pieces of [`FewPieces`]. A table of its own for 16, which fit into one register, saved no time
/// (0.97 to 1.02 in four pictures), and the crate took a fifth longer to compile.
pub const FEW: usize = 32;

/// Up to [`FEW`] pieces.
#[derive(Debug, Clone)]
#[repr(align(64))]
pub struct FewPieces {
    columns: [[f32; FEW]; COLUMNS],
}

impl FewPieces {
    /// The table, or `None` if there are more pieces.
    #[must_use]
    pub fn new(pieces: &TransferPieces) -> Option<Self> {
        let mut columns = [[0.0; FEW]; COLUMNS];
        columns[Column::Knot as usize] = [f32::INFINITY; FEW];
        for (into, from) in columns.iter_mut().zip(pieces.all_columns()) {
            into.get_mut(..from.len())?.copy_from_slice(from);
        }
        Some(Self { columns })
    }
}

impl PieceLookup for FewPieces {
    #[inline(always)]
    fn column<S: Simd>(&self, column: Column, channel: usize, piece: S::I) -> S::F {
        S::lookup32(&self.columns[column as usize + channel], piece)
    }

    #[inline(always)]
    fn piece_of<S: Simd>(&self, value: S::F) -> S::I {
        search::<S, _>(self, FEW, value)
    }
}

/// Any number of pieces.
#[derive(Debug, Clone)]
pub struct ManyPieces<'a> {
    pieces: &'a TransferPieces,
}

impl<'a> ManyPieces<'a> {
    /// The table.
    #[must_use]
    pub fn new(pieces: &'a TransferPieces) -> Self {
        Self { pieces }
    }
}

impl PieceLookup for ManyPieces<'_> {
    #[inline(always)]
    fn column<S: Simd>(&self, column: Column, channel: usize, piece: S::I) -> S::F {
        let column = self.pieces.column(column, channel);
        let last = S::splat_int(narrow::<i32>(column.len()) - 1);
        let bytes = S::and_int(piece, last) * S::splat_int(narrow::<i32>(size_of::<f32>()));
        // SAFETY: the length is a power of two, so that the masked piece is an index of the column.
        let bits = unsafe { S::gather(column.as_ptr().cast(), bytes, S::mask_from_bits(u32::MAX)) };
        S::float_from_bits(bits)
    }

    #[inline(always)]
    fn piece_of<S: Simd>(&self, value: S::F) -> S::I {
        search::<S, _>(self, self.pieces.stride(), value)
    }
}

/// Antiderivatives and values of all channels at a place.
#[derive(Clone, Copy)]
pub struct Channels<S: Simd> {
    /// Antiderivative at the piece's anchor.
    pub start: [S::F; CHANNELS],
    /// Antiderivative from the anchor on.
    pub rest: [S::F; CHANNELS],
    /// The channels themselves: extinction, and extinction times red, green, blue.
    pub value: [S::F; CHANNELS],
    /// A third of the channels' quadratic coefficients.
    pub third_bend: [S::F; CHANNELS],
    /// Greatest slope of a channel, and of extinction less an emission.
    pub slope: S::F,
}

/// The quadratics of all channels in a piece.
#[derive(Clone, Copy)]
pub struct Quadratics<S: Simd> {
    start: [S::F; CHANNELS],
    value: [S::F; CHANNELS],
    half_slope: [S::F; CHANNELS],
    third_bend: [S::F; CHANNELS],
}

/// Looks them up.
#[inline(always)]
pub fn quadratics<S: Simd, L: PieceLookup>(table: &L, piece: S::I) -> Quadratics<S> {
    let zero = [S::splat(0.0); CHANNELS];
    let mut found = Quadratics { start: zero, value: zero, half_slope: zero, third_bend: zero };
    for c in 0..CHANNELS {
        found.start[c] = table.column::<S>(Column::Start, c, piece);
        found.value[c] = table.column::<S>(Column::Value, c, piece);
        found.half_slope[c] = table.column::<S>(Column::HalfSlope, c, piece);
        found.third_bend[c] = table.column::<S>(Column::ThirdBend, c, piece);
    }
    found
}

impl<S: Simd> Quadratics<S> {
    /// All channels at a distance from the piece's anchor.
    #[inline(always)]
    pub fn at(&self, y: S::F) -> Channels<S> {
        let zero = [S::splat(0.0); CHANNELS];
        let Self { start, third_bend, .. } = *self;
        let mut out = Channels { start, rest: zero, value: zero, third_bend, slope: zero[0] };
        let y3 = S::splat(3.0) * y;
        let mut slopes = zero;
        for (c, slope) in slopes.iter_mut().enumerate() {
            let (value, half_slope, third_bend) = (self.value[c], self.half_slope[c], third_bend[c]);
            out.rest[c] = y * S::mul_add(y, S::mul_add(y, third_bend, half_slope), value);
            let half_there = S::mul_add(y3, third_bend, half_slope);
            *slope = half_there + half_there;
            out.value[c] = S::mul_add(y, half_slope + half_there, value);
        }
        out.slope = S::abs(slopes[0]);
        for emission in &slopes[1..] {
            out.slope = S::max(out.slope, S::max(S::abs(*emission), S::abs(slopes[0] - *emission)));
        }
        out
    }
}
