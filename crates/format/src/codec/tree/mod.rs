//! Voxels of a box as details of the coarser voxels that were made of them: a critically sampled wavelet pyramid. Decoding
//! needs the coarser voxels. The codec is lossless: for a bounded error the voxels are moved before ([`super::quantize`]).
//!
//! Voxels are multiples of a step. One axis after the other, x before y before z, replaces each pair a, b by its average
//! and its difference (S transform; Said, Pearlman 1996):
//!
//! ```text
//! l = floor((a + b) / 2)     h = a - b     so that b = l - floor(h / 2) and a = b + h
//! ```
//!
//! The rest of 2, 4 or 8 voxels is an average that was rounded down once for each axis. The coarser voxel m, their mean
//! rounded once, takes its place: that shifts all of them by one number, which the decoder finds again (`shifts.rs`). So 8
//! voxels become 7 details. Coarser voxels that are no means are allowed, too, and only cost bits. Details are predicted
//! (`prediction.rs`), and the differences are coded in classes (`classes.rs`).
//!
//! An axis whose factor is 1 is not halved. At the end of an odd axis a single voxel is a pair with itself; it has no
//! detail.
//!
//! Payload, all numbers little endian:
//!
//! | offset | size | meaning |
//! |---|---|---|
//! | 0 | 1 | 1 if there are holes, else 0 |
//! | 1 | 8 | f64: the step |
//! | 9 | 8 | only with holes: the bits of the voxel in every hole |
//! | | | only with holes: chunk of the mask (1 in a hole, else 0), transformed by differences |
//! | | | for each halved axis, z first: 11 x i16, the weights of the prediction in units of 1/256; band of its details |
//! | | | corrections of the shifts: a chunk of those at ties, a chunk of the others; none if it has no number |
//!
//! | size | meaning of a band |
//! |---|---|
//! | 1 | 1 if it is divided into classes, else 0 |
//! | 12 | only with classes: 3 x u32, their thresholds |
//! | | a chunk (`codec/chunks.rs`); with classes, one for each that is not empty |
//!
//! A coarser voxel has the index of the nearest multiple of the step; a hole that of the voxel before it. A hole among the
//! voxels has the index of its coarser voxel.
//!
//! No container uses this codec yet (docs/decisions/049-a-tree-of-details.md). All buffers have sizes that follow from the
//! shape of the box, whatever a payload says.

mod classes;
mod grid;
mod prediction;
mod shifts;

use classes::{Band, CLASSES, Divided, Thresholds, are_smaller, divide};
use grid::{Grid, Halving, average, rows_of};
use prediction::{Around, Fit, TERMS, Visitor, Weights, for_each_row};
use shifts::{Shifting, Shifts, shift_row};

use super::chunks::{ChunkReader, Chunks};
use super::payload::{BrickShape, CodecError};
use super::quantize::{Quantizer, common_step};
use super::sample::Sample;
use super::wavelet::{Indexing, Indices, to_voxels, transform};
use crate::vectors::{Vectorized, vectorized};
use crate::voxel_type::{Absence, Voxel};
use crate::with_voxel;

const HEAD_BYTES: usize = 9;
const FLAG_HOLES: u8 = 1;
/// Rounds of the fit of weights.
const ROUNDS: usize = 2;

/// The coarser voxels of a box.
#[derive(Debug, Clone, Copy)]
pub struct Coarser<'a> {
    /// Voxels, little endian, x fastest, of the same type. Voxel c of a halved axis stands for the voxels 2c and 2c + 1 of
    /// the box, or for 2c alone at the end.
    pub voxels: &'a [u8],
    /// 1 or 2 per axis: voxels of the box per coarser voxel.
    pub factors: [u32; 3],
    /// Rule for absent voxels of both levels.
    pub absence: Absence,
}

impl Coarser<'_> {
    /// Number of coarser voxels along each axis of a box.
    #[must_use]
    pub fn extent(factors: [u32; 3], extent: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| if factors[a] == 2 { extent[a].div_ceil(2) } else { extent[a] })
    }

    fn check(&self, shape: BrickShape) {
        assert!(self.factors.iter().all(|f| [1, 2].contains(f)), "factors {:?}", self.factors);
        let bytes = BrickShape { extent: Self::extent(self.factors, shape.extent), ..shape }.bytes();
        assert_eq!(self.voxels.len(), bytes, "coarser voxels of {:?} by {:?}", shape.extent, self.factors);
    }

    /// Indices of the coarser voxels.
    fn indices<V: Voxel, S: Sample>(&self, quantizer: Quantizer) -> Vec<S> {
        let voxels = to_voxels::<V>(self.voxels);
        let mut samples = vec![S::default(); voxels.len()];
        let holes_possible = self.absence.possible(V::TYPE);
        if (!holes_possible || self.absence.nodata.is_none())
            && vectorized(Indexing { voxels: &voxels, quantizer, samples: &mut samples })
        {
            return samples;
        }
        let mut before = S::default();
        for (sample, &voxel) in samples.iter_mut().zip(voxels.iter()) {
            if !(holes_possible && self.absence.is_absent(voxel.to_f64())) {
                before = S::wrap(quantizer.index(voxel));
            }
            *sample = before;
        }
        samples
    }

    /// Indices of the coarser voxels of a box.
    fn means<V: Voxel, S: Sample>(&self, quantizer: Quantizer, extent: [usize; 3]) -> Grid<S> {
        to_grid(Self::extent(self.factors, extent), &self.indices::<V, S>(quantizer))
    }
}

/// Encodes the voxels of a box as multiples of `step`, or of their longest common step. Returns `None` if some voxels are
/// not multiples, if holes differ from each other, or if the payload is not smaller than `limit` bytes.
///
/// # Errors
/// If Zstandard cannot get memory.
///
/// # Panics
/// If the number of voxels or coarser voxels is not that of the box.
pub fn encode_if_smaller(
    shape: BrickShape,
    voxels: &[u8],
    coarser: Coarser<'_>,
    step: Option<Quantizer>,
    limit: usize,
) -> Result<Option<Vec<u8>>, CodecError> {
    assert_eq!(voxels.len(), shape.bytes(), "a box of {:?} {} has other bytes", shape.extent, shape.voxel_type);
    coarser.check(shape);
    with_voxel!(shape.voxel_type, V => {
        let voxels = to_voxels::<V>(voxels);
        if V::TYPE.bytes() == 1 {
            encode_typed::<V, i16>(shape.extent, &voxels, coarser, step, limit)
        } else {
            encode_typed::<V, i32>(shape.extent, &voxels, coarser, step, limit)
        }
    })
}

fn encode_typed<V: Voxel, S: Sample>(
    extent: [usize; 3],
    voxels: &[V],
    coarser: Coarser<'_>,
    step: Option<Quantizer>,
    limit: usize,
) -> Result<Option<Vec<u8>>, CodecError> {
    let absence = coarser.absence;
    let Some(quantizer) = step.or_else(|| common_step(voxels, absence)) else { return Ok(None) };
    let Some(Indices::<S> { mut samples, holes }) = Indices::of(voxels, quantizer, absence) else { return Ok(None) };
    let means = coarser.means::<V, S>(quantizer, extent);
    let mut payload = vec![u8::from(holes.is_some()) * FLAG_HOLES];
    payload.extend(quantizer.step().to_le_bytes());
    let mut chunks = Chunks::after(payload);
    if let Some((fill, mut mask)) = holes {
        fill_in(&mut samples, &mask, extent, coarser.factors, &coarser.indices::<V, S>(quantizer));
        chunks.payload.extend(fill.to_le_bytes());
        transform::difference(&mut mask, extent);
        chunks.push(&mask)?;
        chunks.choose_anew();
    }
    let halvings = Halving::all(extent, coarser.factors);
    let voxels = to_grid(extent, &samples);
    let averages =
        halvings.iter().fold(None, |grid, halving| Some(halving.fold(grid.as_ref().unwrap_or(&voxels), average)));
    let shifts = differences(averages.as_ref().unwrap_or(&voxels), &means);
    let back: Vec<S> = shifts.iter().map(|shift| S::default().minus(*shift)).collect();
    let mut grids = vec![vectorized(Moving { grid: &voxels, shifts: &back, factors: coarser.factors })];
    for halving in &halvings {
        grids.push(halving.fold(grids.last().expect("there is the box"), average));
    }
    for (&halving, pair) in halvings.iter().zip(grids.windows(2)).rev() {
        if chunks.payload.len() >= limit {
            return Ok(None);
        }
        let (grid, averages) = (&pair[0], &pair[1]);
        let weights = vectorized(Fitting { halving, grid, averages });
        let rest = vectorized(Predicting { halving, grid, averages, weights: &weights });
        chunks.payload.extend(weights.iter().flat_map(|weight| weight.to_le_bytes()));
        push_band(&mut chunks, Band(halving), &rest, averages)?;
    }
    let found = vectorized(Shifting { means: &means, shifted: &grids[0], halvings: &halvings });
    let corrections: Vec<S> = shifts.iter().zip(&found.shifts).map(|(shift, found)| shift.minus(*found)).collect();
    chunks.choose_anew();
    found.parts(&corrections).iter().filter(|part| !part.is_empty()).try_for_each(|part| chunks.push(part))?;
    Ok((chunks.payload.len() < limit).then_some(chunks.payload))
}

/// Gives each hole the index of its coarser voxel.
fn fill_in<S: Sample>(samples: &mut [S], mask: &[S], extent: [usize; 3], factors: [u32; 3], coarser: &[S]) {
    let [nx, ny, _] = Coarser::extent(factors, extent);
    let at = |axis: usize, i: usize| if factors[axis] == 2 { i / 2 } else { i };
    for (i, (sample, hole)) in samples.iter_mut().zip(mask).enumerate() {
        if *hole != S::default() {
            let [x, y, z] = [i % extent[0], i / extent[0] % extent[1], i / extent[0] / extent[1]];
            *sample = coarser[(at(2, z) * ny + at(1, y)) * nx + at(0, x)];
        }
    }
}

fn to_grid<S: Sample>(extent: [usize; 3], samples: &[S]) -> Grid<S> {
    let mut grid = Grid::zeros(extent);
    for (row, samples) in samples.chunks_exact(extent[0]).enumerate() {
        let [y, z] = [row % extent[1], row / extent[1]];
        grid.row_mut(y, z).copy_from_slice(samples);
        grid.repeat_ends(y, z);
    }
    grid
}

/// Differences of the samples of two boxes.
fn differences<S: Sample>(one: &Grid<S>, other: &Grid<S>) -> Vec<S> {
    let rows = rows_of(one.extent());
    rows.flat_map(|[y, z]| one.row(y, z).iter().zip(other.row(y, z)).map(|(a, b)| a.minus(*b))).collect()
}

/// Row of the coarser voxels over a row of a box.
fn coarser_row([y, z]: [usize; 2], factors: [u32; 3]) -> [usize; 2] {
    let at = |axis: usize, i: usize| if factors[axis] == 2 { i / 2 } else { i };
    [at(1, y), at(2, z)]
}

/// The shifts of the groups over a row of a box.
#[inline(always)]
fn shifts_of<S>(shifts: &[S], at: [usize; 2], factors: [u32; 3], extent: [usize; 3]) -> &[S] {
    let [n, rows, _] = Coarser::extent(factors, extent);
    let [y, z] = coarser_row(at, factors);
    &shifts[(z * rows + y) * n..][..n]
}

/// Task that shifts the groups of a box.
struct Moving<'a, S> {
    grid: &'a Grid<S>,
    shifts: &'a [S],
    factors: [u32; 3],
}

impl<S: Sample> Vectorized for Moving<'_, S> {
    type Output = Grid<S>;

    #[inline(always)]
    fn run(self) -> Grid<S> {
        let Self { grid, shifts, factors } = self;
        let mut moved = Grid::zeros(grid.extent());
        for [y, z] in rows_of(grid.extent()) {
            let shifts = shifts_of(shifts, [y, z], factors, grid.extent());
            shift_row(grid.row(y, z), shifts, factors[0], moved.row_mut(y, z));
            moved.repeat_ends(y, z);
        }
        moved
    }
}

/// Task that fits the weights of a halving.
struct Fitting<'a, S> {
    halving: Halving,
    grid: &'a Grid<S>,
    averages: &'a Grid<S>,
}

impl<S: Sample> Vectorized for Fitting<'_, S> {
    type Output = Weights;

    #[inline(always)]
    fn run(self) -> Weights {
        let Self { halving, averages, .. } = self;
        let mut fit = Fit::new();
        for _ in 0..ROUNDS {
            for_each_row(averages, halving, &mut Looking { of: &self, fit: &mut fit });
            fit.solve();
        }
        fit.weights()
    }
}

/// Visitor that adds details to a fit.
struct Looking<'a, S> {
    of: &'a Fitting<'a, S>,
    fit: &'a mut Fit,
}

impl<S: Sample> Visitor<S> for Looking<'_, S> {
    #[inline(always)]
    fn visit(&mut self, at: [usize; 2], around: &Around<'_, S>, details: &mut [S]) {
        let Fitting { halving, grid, .. } = self.of;
        halving.details(grid, at, details);
        if Fit::looks_at(at) {
            self.fit.add(around, details, halving.pairs(at));
        }
    }
}

/// Task that computes what predictions leave of all details.
struct Predicting<'a, S> {
    halving: Halving,
    grid: &'a Grid<S>,
    averages: &'a Grid<S>,
    weights: &'a Weights,
}

impl<S: Sample> Vectorized for Predicting<'_, S> {
    type Output = Vec<S>;

    #[inline(always)]
    fn run(self) -> Vec<S> {
        let Self { halving, averages, .. } = self;
        let rest = Vec::with_capacity(halving.half.iter().product());
        let mut visitor = Leaving { of: &self, predicted: vec![S::default(); averages.width()], rest };
        for_each_row(averages, halving, &mut visitor);
        visitor.rest
    }
}

/// Visitor that subtracts predictions from details.
struct Leaving<'a, S> {
    of: &'a Predicting<'a, S>,
    predicted: Vec<S>,
    rest: Vec<S>,
}

impl<S: Sample> Visitor<S> for Leaving<'_, S> {
    #[inline(always)]
    fn visit(&mut self, at: [usize; 2], around: &Around<'_, S>, details: &mut [S]) {
        let Predicting { halving, grid, weights, .. } = self.of;
        halving.details(grid, at, details);
        around.predict(weights, &mut self.predicted);
        let pairs = halving.pairs(at);
        self.rest.extend(details[..pairs].iter().zip(&self.predicted).map(|(d, p)| d.minus(*p)));
    }
}

/// Task that computes the activities of a band's groups.
struct Measuring<'a, S> {
    band: Band,
    averages: &'a Grid<S>,
}

impl<S: Sample> Vectorized for Measuring<'_, S> {
    type Output = Vec<u32>;

    #[inline(always)]
    fn run(self) -> Vec<u32> {
        self.band.activities(self.averages)
    }
}

/// Appends the numbers of a band. Classes depend on `averages`.
fn push_band<S: Sample>(chunks: &mut Chunks, band: Band, numbers: &[S], averages: &Grid<S>) -> Result<(), CodecError> {
    let activities = vectorized(Measuring { band, averages });
    let thresholds = Thresholds::quantiles(&activities);
    let classes = divide(band, numbers, &activities, thresholds);
    let are_divided = are_smaller(&classes, numbers);
    chunks.payload.push(u8::from(are_divided));
    chunks.choose_anew();
    if !are_divided {
        return chunks.push(numbers);
    }
    chunks.payload.extend(thresholds.0.iter().flat_map(|threshold| threshold.to_le_bytes()));
    classes.iter().filter(|class| !class.is_empty()).try_for_each(|class| chunks.push(class))
}

/// Decodes into a buffer of exactly the box's size.
///
/// # Errors
/// If the payload is not one that [`encode_if_smaller`] makes for this shape and these factors.
///
/// # Panics
/// If the length of `out` or the number of coarser voxels is not that of the box.
pub fn decode_into(shape: BrickShape, payload: &[u8], coarser: Coarser<'_>, out: &mut [u8]) -> Result<(), CodecError> {
    assert_eq!(out.len(), shape.bytes(), "a box of {:?} {} has other bytes", shape.extent, shape.voxel_type);
    coarser.check(shape);
    with_voxel!(shape.voxel_type, V => {
        if V::TYPE.bytes() == 1 {
            decode_typed::<V, i16>(shape, payload, coarser, out)
        } else {
            decode_typed::<V, i32>(shape, payload, coarser, out)
        }
    })
}

fn wrong(reason: String) -> CodecError {
    CodecError::Tree { reason }
}

fn decode_typed<V: Voxel, S: Sample>(
    shape: BrickShape,
    payload: &[u8],
    coarser: Coarser<'_>,
    out: &mut [u8],
) -> Result<(), CodecError> {
    let Some((&[flags, ref step @ ..], mut rest)) = payload.split_first_chunk::<HEAD_BYTES>() else {
        return Err(wrong(format!("{} bytes; expected at least {HEAD_BYTES}", payload.len())));
    };
    if flags > FLAG_HOLES {
        return Err(wrong(format!("flags {flags:#010b}; expected 0 or {FLAG_HOLES}")));
    }
    let step = f64::from_le_bytes(*step);
    let quantizer = Quantizer::new(shape.voxel_type, step)
        .ok_or_else(|| wrong(format!("step {step}; expected a positive one of {}", shape.voxel_type)))?;
    let mut reader = ChunkReader::default();
    let mut holes = None;
    if flags == FLAG_HOLES {
        let (fill, behind) = rest.split_first_chunk::<8>().ok_or_else(|| wrong("no voxel for its holes".into()))?;
        rest = behind;
        let mut mask = vec![S::default(); shape.voxels()];
        reader.take(&mut rest, &mut mask).map_err(wrong)?;
        transform::undo_difference(&mut mask, shape.extent);
        holes = Some((*fill, mask));
    }
    let means = coarser.means::<V, S>(quantizer, shape.extent);
    let halvings = Halving::all(shape.extent, coarser.factors);
    let mut shifted = None;
    for &halving in halvings.iter().rev() {
        let averages = shifted.as_ref().unwrap_or(&means);
        let weights = take_weights(&mut rest).ok_or_else(|| wrong("weights are cut short".into()))?;
        let left = take_band(&mut reader, &mut rest, Band(halving), averages).map_err(wrong)?;
        shifted = Some(vectorized(Dividing { halving, averages, weights: &weights, left }));
    }
    let grid = shifted.as_ref().unwrap_or(&means);
    let mut shifts = vectorized(Shifting { means: &means, shifted: grid, halvings: &halvings });
    take_corrections(&mut reader, &mut rest, &mut shifts).map_err(wrong)?;
    if !rest.is_empty() {
        return Err(wrong(format!("{} bytes behind the last band; expected none", rest.len())));
    }
    // A branch of its own, so that the compiler optimizes the common case without a step.
    let (shifts, factors) = (&shifts.shifts[..], coarser.factors);
    if quantizer == Quantizer::WHOLE {
        vectorized(Writing { grid, shifts, factors, out, voxel: V::from_word });
    } else {
        vectorized(Writing { grid, shifts, factors, out, voxel: quantizer.voxels::<V>() });
    }
    if let Some((fill, mask)) = holes {
        let fill = &fill[..size_of::<V>()];
        for (voxel, hole) in out.chunks_exact_mut(fill.len()).zip(mask) {
            if hole != S::default() {
                voxel.copy_from_slice(fill);
            }
        }
    }
    Ok(())
}

fn take_weights(payload: &mut &[u8]) -> Option<Weights> {
    let (bytes, rest) = payload.split_first_chunk::<{ 2 * TERMS }>()?;
    *payload = rest;
    Some(std::array::from_fn(|i| i16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]])))
}

/// Reads the corrections of shifts and adds them. An error is a sentence.
fn take_corrections<S: Sample>(
    reader: &mut ChunkReader,
    payload: &mut &[u8],
    shifts: &mut Shifts<S>,
) -> Result<(), String> {
    let mut parts = shifts.counts().map(|count| vec![S::default(); count]);
    for part in parts.iter_mut().filter(|part| !part.is_empty()) {
        reader.take(payload, part)?;
    }
    shifts.correct(&parts);
    Ok(())
}

/// Reads the numbers of a band, in the order of the rows, and advances `payload`. An error is a sentence.
fn take_band<S: Sample>(
    reader: &mut ChunkReader,
    payload: &mut &[u8],
    band: Band,
    averages: &Grid<S>,
) -> Result<Divided<S>, String> {
    let (&is_divided, behind) = payload.split_first().ok_or("a band is missing")?;
    *payload = behind;
    if is_divided == 0 {
        let mut numbers = Divided::undivided(band);
        reader.take(payload, &mut numbers.numbers[0][..band.count()])?;
        return Ok(numbers);
    }
    let (thresholds, behind) =
        payload.split_first_chunk::<{ 4 * (CLASSES - 1) }>().filter(|_| is_divided == 1).ok_or("no thresholds")?;
    *payload = behind;
    let thresholds =
        Thresholds(std::array::from_fn(|i| u32::from_le_bytes(std::array::from_fn(|byte| thresholds[4 * i + byte]))));
    let activities = vectorized(Measuring { band, averages });
    let mut numbers = Divided::by(band, &activities, thresholds);
    for (class, count) in numbers.counts().into_iter().enumerate().filter(|(_, count)| *count > 0) {
        reader.take(payload, &mut numbers.numbers[class][..count])?;
    }
    Ok(numbers)
}

/// Task that makes a box of its averages and details.
struct Dividing<'a, S> {
    halving: Halving,
    averages: &'a Grid<S>,
    weights: &'a Weights,
    /// Details without their predictions.
    left: Divided<S>,
}

impl<S: Sample> Vectorized for Dividing<'_, S> {
    type Output = Grid<S>;

    #[inline(always)]
    fn run(self) -> Grid<S> {
        let Self { halving, averages, weights, left } = self;
        let mut visitor = Putting { halving, averages, weights, left, grid: Grid::zeros(halving.whole) };
        for_each_row(averages, halving, &mut visitor);
        visitor.grid
    }
}

/// Visitor that computes details and writes the pairs.
struct Putting<'a, S> {
    halving: Halving,
    averages: &'a Grid<S>,
    weights: &'a Weights,
    left: Divided<S>,
    grid: Grid<S>,
}

impl<S: Sample> Visitor<S> for Putting<'_, S> {
    #[inline(always)]
    fn visit(&mut self, at: [usize; 2], around: &Around<'_, S>, details: &mut [S]) {
        let pairs = self.halving.pairs(at);
        around.predict(self.weights, details);
        self.left.add_to(details, pairs);
        details[pairs..].fill(S::default());
        self.halving.put(&mut self.grid, self.averages, at, details);
    }
}

/// Task that writes voxels, shifted with their groups.
struct Writing<'a, S, F> {
    grid: &'a Grid<S>,
    shifts: &'a [S],
    factors: [u32; 3],
    out: &'a mut [u8],
    voxel: F,
}

impl<S: Sample, V: Voxel, F: Fn(i32) -> V> Vectorized for Writing<'_, S, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { grid, shifts, factors, out, voxel } = self;
        let n = grid.extent()[0];
        let mut samples = vec![S::default(); n];
        for ([y, z], out) in rows_of(grid.extent()).zip(out.chunks_exact_mut(n * size_of::<V>())) {
            let shifts = shifts_of(shifts, [y, z], factors, grid.extent());
            shift_row(grid.row(y, z), shifts, factors[0], &mut samples);
            for (bytes, &index) in out.chunks_exact_mut(size_of::<V>()).zip(&samples) {
                voxel(index.number()).write_le(bytes);
            }
        }
    }
}

#[cfg(test)]
mod tests;
