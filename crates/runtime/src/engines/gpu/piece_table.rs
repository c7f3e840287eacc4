//! The transfer function's pieces in the form that shaders read: `shaders/shared/pieces.wgsl`.
//!
//! The table begins with a search tree. A texel of it holds three knots, which divide the pieces that are left by four; the fourth
//! word is unused. Level by level follow one texel, 4, 16 and so on. Behind the tree each piece has [`PIECE_TEXELS`] texels. Channels are in the
//! order red, green, blue, extinction. What is unbounded is the greatest number here, since shaders guarantee no infinities.

use supervol_format::cast::narrow;
use supervol_scene::transfer_function::TransferFunction;
use supervol_scene::transfer_function::pieces::{CHANNELS, Column, Limits, TransferPieces};
use supervol_scene::value_map::ValueMap;

use crate::engines::gpu::limits::PIECE_TEXELS;
use crate::engines::gpu::texels::VoxelStorage;
use crate::engines::packets::fetch::Stored;
use crate::engines::packets::tables::pieces_of;
use crate::engines::rules::STEEPEST_BIN;

/// Children of a node of the search tree.
const CHILDREN: usize = 4;
/// Texels of a cache line.
const LINE: usize = 4;
/// Equal parts of the function's width in each of which it must be smooth: see [`PieceTable::is_resolved`].
const BINS: f64 = 4096.0;

/// Table of the transfer function, see the module.
#[derive(Debug, Clone, PartialEq)]
pub struct PieceTable {
    /// The pieces. Values are relative to [`PieceTable::origin`].
    pub pieces: TransferPieces,
    /// Render value from which values are counted.
    pub origin: f32,
    /// Four words per texel.
    pub words: Vec<u32>,
    /// Texel of the first piece.
    pub first_piece: u32,
    /// Pieces from one knot to the next in the tree's first texel.
    pub search_step: u32,
    /// Whether `f32` resolves the function: it has no step, or nearly a step. If a ray grazes a step, only roots find it.
    pub is_resolved: bool,
}

impl PieceTable {
    /// The table of a function for pictures of this error; `shift` is subtracted from every data value.
    #[must_use]
    pub fn new(source: &TransferFunction, shift: f64, max_error: f64) -> Self {
        let (origin, pieces) = pieces_of(source, shift, max_error);
        let mut places = CHILDREN;
        while places < pieces.count() {
            places *= CHILDREN;
        }
        let mut texels = search_tree(&pieces, places);
        texels.resize(texels.len().next_multiple_of(LINE), [0.0; 4]);
        let first_piece = texels.len();
        texels.extend((0..pieces.count()).flat_map(|i| texels_of(&pieces, i)));
        let is_resolved = is_resolved(&pieces);
        Self {
            origin,
            words: texels.iter().flatten().map(|number| number.to_bits()).collect(),
            first_piece: narrow::<u32>(first_piece),
            search_step: narrow::<u32>(places / CHILDREN),
            is_resolved,
            pieces,
        }
    }

    /// Limits of means.
    #[must_use]
    pub fn limits(&self) -> Limits {
        self.pieces.limits
    }

    /// Texels of the table.
    #[must_use]
    pub fn texels(&self) -> usize {
        self.words.len() / 4
    }

    /// Centre, scale and offset: `value = (stored number - centre) * scale + offset`; for floats, of render values.
    #[must_use]
    pub fn values_of_stored(&self, storage: VoxelStorage, map: &ValueMap) -> [f32; 3] {
        let stored = match storage {
            VoxelStorage::U8 => Stored::U8,
            VoxelStorage::U16 => Stored::U16,
            VoxelStorage::F32 => Stored::F32,
        };
        stored.to_values_from(self.origin, map)
    }
}

/// The search tree over `places` pieces, a power of [`CHILDREN`]; those behind the last piece begin at the greatest number.
fn search_tree(pieces: &TransferPieces, places: usize) -> Vec<[f32; 4]> {
    let knots = &pieces.column(Column::Knot, 0)[..pieces.count()];
    let knot = |i: usize| knots.get(i).copied().unwrap_or(f32::MAX);
    let mut texels = Vec::new();
    let mut step = places / CHILDREN;
    while step > 0 {
        texels.extend((0..places).step_by(CHILDREN * step).map(|first| {
            let [a, b, c] = [1, 2, 3].map(|child| knot(first + child * step));
            [a, b, c, 0.0]
        }));
        step /= CHILDREN;
    }
    texels
}

/// The texels of a piece, in the order of `pieces.wgsl`.
fn texels_of(pieces: &TransferPieces, i: usize) -> [[f32; 4]; PIECE_TEXELS as usize] {
    let of = |column| finite(pieces.column(column, 0)[i]);
    let channels = |column| {
        let of: [f32; CHANNELS] = std::array::from_fn(|c| pieces.column(column, c)[i]);
        [of[1], of[2], of[3], of[0]]
    };
    let next_knot = pieces.column(Column::Knot, 0).get(i + 1).map_or(f32::MAX, |&knot| finite(knot));
    [
        [of(Column::Anchor), next_knot, of(Column::BendsPerValue), of(Column::ColorVariationPerValue)],
        channels(Column::Value),
        channels(Column::HalfSlope),
        channels(Column::ThirdBend),
        channels(Column::Start),
        [of(Column::Steps), of(Column::Bends), of(Column::Kinks), of(Column::ColorVariation)],
        [of(Column::Stretch), of(Column::BendOfStretch), of(Column::Curvatures), 0.0],
        [of(Column::KinkAbove), of(Column::ChangeAbove), of(Column::KinkBelow), of(Column::ChangeBelow)],
        channels(Column::ChangesAbove),
        channels(Column::ChangesBelow),
        [0.0; 4],
        [0.0; 4],
    ]
}

fn finite(number: f32) -> f32 {
    number.clamp(f32::MIN, f32::MAX)
}

/// See [`PieceTable::is_resolved`]: over a bin, no channel changes by more than a share of the greatest extinction.
fn is_resolved(pieces: &TransferPieces) -> bool {
    let count = pieces.count();
    let knots = &pieces.column(Column::Knot, 0)[..count];
    let anchors = pieces.column(Column::Anchor, 0);
    let bin = f64::from(knots[count - 1] - anchors[0]) / BINS;
    let mut steepest = 0.0f64;
    let mut most = f64::from(f32::MIN_POSITIVE);
    for (i, &anchor) in anchors[..count].iter().enumerate() {
        let end = knots.get(i + 1).map_or(0.0, |&next| f64::from(next) - f64::from(anchor));
        for c in 0..CHANNELS {
            let of = |column| f64::from(pieces.column(column, c)[i]);
            let (value, half_slope, third_bend) = (of(Column::Value), of(Column::HalfSlope), of(Column::ThirdBend));
            for y in [0.0, end] {
                steepest = steepest.max((2.0 * (half_slope + 3.0 * y * third_bend)).abs());
                most = most.max(value + y * (2.0 * half_slope + 3.0 * y * third_bend));
            }
        }
    }
    !pieces.has_steps() && steepest * bin <= STEEPEST_BIN * most
}

#[cfg(test)]
mod tests {
    use supervol_scene::transfer_function::ControlPoint;

    use super::*;

    fn table(points: &[(f64, f64)]) -> PieceTable {
        let points = points.iter().map(|&(value, alpha)| ControlPoint { value, color: [1.0, 0.5, 0.0], alpha });
        PieceTable::new(&TransferFunction::new(points.collect(), 1.0).unwrap(), 0.0, 0.5 / 255.0)
    }

    #[test]
    fn steps_and_narrow_spikes_are_not_resolved() {
        assert!(table(&[(0.0, 0.0), (255.0, 0.9)]).is_resolved);
        assert!(table(&[(0.0, 0.0), (96.0, 0.0), (100.0, 0.9), (104.0, 0.0), (255.0, 0.0)]).is_resolved);
        assert!(!table(&[(0.0, 0.0), (100.0, 0.0), (100.0, 0.9), (255.0, 0.9)]).is_resolved);
        // A tenth of a bin wide, within one bin.
        assert!(!table(&[(0.0, 0.0), (100.01, 0.0), (100.013, 0.9), (100.016, 0.0), (255.0, 0.0)]).is_resolved);
        assert!(table(&[(7.0, 0.5)]).is_resolved, "one colour has no step");
    }

    /// The search as `piece_of` in the shader does it, for every knot, just below it, and far outside.
    #[test]
    fn the_tree_finds_the_piece_of_every_value() {
        for count in [1, 2, 4, 5, 16, 17, 64, 65, 300] {
            let points: Vec<(f64, f64)> = (0..count).map(|i| (f64::from(i), f64::from(i % 3) * 0.3)).collect();
            let table = table(&points);
            let knots = &table.pieces.column(Column::Knot, 0)[..table.pieces.count()];
            let texel = |i: usize| [0, 1, 2].map(|c| f32::from_bits(table.words[4 * i + c]));
            let find = |value: f32| {
                let (mut piece, mut step, mut first) = (0, table.search_step as usize, 0);
                while step > 0 {
                    piece += step * texel(first + piece / (4 * step)).iter().filter(|&&knot| knot <= value).count();
                    (first, step) = (4 * first + 1, step / 4);
                }
                piece
            };
            for (i, &knot) in knots.iter().enumerate().skip(1) {
                assert_eq!(find(knot), i, "{count} points, at {knot}");
                assert_eq!(find(knot.next_down()), i - 1, "{count} points, below {knot}");
            }
            assert_eq!([find(-1e30), find(1e30)], [0, knots.len() - 1], "{count} points");
        }
    }

    /// Numbers are relative to the middle of a function far from zero: no bits are lost.
    #[test]
    fn stored_numbers_become_values() {
        let table = table(&[(30_000.0, 0.0), (30_016.0, 0.5)]);
        let range = supervol_format::ValueRange { min: 0.0, max: 65535.0 };
        let map = ValueMap::for_container(supervol_format::VoxelType::U16, 1.0, 0.0, None, range);
        let [centre, scale, offset] = table.values_of_stored(VoxelStorage::U16, &map);
        for stored in [30_000.0f32, 30_004.0, 30_016.0] {
            let value = f64::from((stored - centre) * scale + offset) + f64::from(table.origin);
            assert!((value - f64::from(stored)).abs() < 1e-3, "{stored}: {value}");
        }
    }
}
