//! Voxels as integer multiples of a step ([`super::quantize`]), transformed within the brick, as tokens, compressed by
//! Zstandard. The codec is lossless: for a bounded error the voxels are moved before.
//!
//! Each brick is independent: decoding needs no parent and no neighbour (docs/decisions/016-wavelets-within-bricks.md).
//!
//! Payload, all numbers little endian:
//!
//! | offset | size | meaning |
//! |---|---|---|
//! | 0 | 1 | transform: 0 differences, 1 lifting (`transform.rs`) |
//! | 1 | 1 | bits 0 to 5: repeated ends, as in [`super::trimmed`]; bit 6: there are holes |
//! | 2 | 8 | f64: the step |
//! | 10 | 8 | only with holes: the bits of the voxel in every hole |
//! | | | only with holes: chunks of the mask (1 in a hole, else 0), transformed by differences |
//! | | | chunks of the transformed indices; a hole has the index of the previous voxel |
//!
//! Coefficients are ordered band by band, coarsest first, x fastest inside a band. Differences are one band. A chunk
//! holds whole bands: as few as together have [`CHUNK_COEFFICIENTS`], so that bands of different statistics get their
//! own Huffman tables (`codec/chunks.rs`).

pub(super) mod transform;

use std::borrow::Cow;

use transform::{Band, bands};

use super::chunks::{ChunkReader, Chunks};
use super::payload::{BrickShape, CodecError};
use super::quantize::{Quantizer, common_step};
use super::repeats::{Places, Repeats};
use super::sample::Sample;
use crate::vectors::{Vectorized, vectorized};
use crate::voxel_type::{Absence, Voxel};
use crate::with_voxel;

/// Largest memory of the encoder in bytes per voxel, for any voxel type, besides two copies of the voxels and the
/// payload. It holds holes and coefficients; then either the coefficients without repeated layers, or tokens and bits.
pub const ENCODING_BYTES_PER_VOXEL: usize = 4 + 4 + (1 + 4);
/// The same for the decoder: holes, coefficients, those of a chunk, tokens and bits.
pub const DECODING_BYTES_PER_VOXEL: usize = 4 + 4 + 4 + 1 + 4;

/// A chunk collects bands until it has at least this many coefficients.
pub const CHUNK_COEFFICIENTS: usize = 4096;
/// Edge in voxels of the part that decides between the transforms.
const PROBED: usize = 32;
const HEAD_BYTES: usize = 10;
const FLAG_HOLES: u8 = 1 << 6;

/// Transform from indices to coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Transform {
    Differences = 0,
    Lifting = 1,
}

impl Transform {
    fn apply<S: Sample>(self, samples: &mut [S], extent: [usize; 3]) {
        vectorized(Transforming { transform: self, way: Way::There, samples, extent });
    }

    fn undo<S: Sample>(self, samples: &mut [S], extent: [usize; 3]) {
        vectorized(Transforming { transform: self, way: Way::Back, samples, extent });
    }

    /// Bands in coding order.
    fn bands(self, extent: [usize; 3]) -> Vec<Band> {
        match self {
            Self::Differences => vec![Band { start: [0; 3], end: extent }],
            Self::Lifting => bands(extent),
        }
    }

    /// Bands in coding order, grouped into chunks.
    fn chunks(self, extent: [usize; 3]) -> Vec<Vec<Band>> {
        let mut chunks: Vec<Vec<Band>> = Vec::new();
        let mut filled = CHUNK_COEFFICIENTS;
        for band in self.bands(extent) {
            if filled >= CHUNK_COEFFICIENTS {
                chunks.push(Vec::new());
                filled = 0;
            }
            filled += band.samples();
            chunks.last_mut().expect("one has been pushed").push(band);
        }
        chunks
    }
}

enum Way {
    There,
    Back,
}

/// Task that applies or reverses a transform.
struct Transforming<'a, S> {
    transform: Transform,
    way: Way,
    samples: &'a mut [S],
    extent: [usize; 3],
}

impl<S: Sample> Vectorized for Transforming<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { transform, way, samples, extent } = self;
        match (transform, way) {
            (Transform::Differences, Way::There) => transform::difference(samples, extent),
            (Transform::Differences, Way::Back) => transform::undo_difference(samples, extent),
            (Transform::Lifting, Way::There) => transform::lift(samples, extent),
            (Transform::Lifting, Way::Back) => transform::unlift(samples, extent),
        }
    }
}

/// Encodes the voxels of a brick as multiples of `step`, or of their longest common step. Returns `None` if some voxels
/// are not multiples, if holes differ from each other, or if the payload is not smaller than `limit` bytes.
///
/// # Errors
/// If Zstandard cannot get memory.
pub fn encode_if_smaller(
    shape: BrickShape,
    voxels: &[u8],
    absence: Absence,
    step: Option<Quantizer>,
    limit: usize,
) -> Result<Option<Vec<u8>>, CodecError> {
    with_voxel!(shape.voxel_type, V => {
        let voxels = to_voxels::<V>(voxels);
        if V::TYPE.bytes() == 1 {
            encode_typed::<V, i16>(shape.extent, &voxels, absence, step, limit)
        } else {
            encode_typed::<V, i32>(shape.extent, &voxels, absence, step, limit)
        }
    })
}

/// Little-endian bytes as voxels; without a copy if the bytes are aligned like voxels.
pub(super) fn to_voxels<V: Voxel>(bytes: &[u8]) -> Cow<'_, [V]> {
    match bytemuck::try_cast_slice(bytes) {
        Ok(voxels) if cfg!(target_endian = "little") => Cow::Borrowed(voxels),
        _ => bytes.chunks_exact(size_of::<V>()).map(V::read_le).collect(),
    }
}

fn encode_typed<V: Voxel, S: Sample>(
    extent: [usize; 3],
    voxels: &[V],
    absence: Absence,
    step: Option<Quantizer>,
    limit: usize,
) -> Result<Option<Vec<u8>>, CodecError> {
    let Some(quantizer) = step.or_else(|| common_step(voxels, absence)) else { return Ok(None) };
    let Some(Indices::<S> { samples, holes }) = Indices::of(voxels, quantizer, absence) else { return Ok(None) };
    let of_samples = Repeats::of(&samples, extent);
    let repeats = holes.iter().fold(of_samples, |repeats, (_, mask)| repeats.and(Repeats::of(mask, extent)));
    let (start, coded) = repeats.coded(extent);
    let part = Band { start, end: std::array::from_fn(|a| start[a] + coded[a]) };
    let mut samples = cut_off(samples, extent, part);
    let transform = choose(&samples, coded);
    transform.apply(&mut samples, coded);

    let mut payload = vec![transform as u8, repeats.bits()];
    payload.extend(quantizer.step().to_le_bytes());
    let mut writer = ChunkWriter { chunks: Chunks::after(payload), limit };
    if let Some((fill, mask)) = holes {
        writer.chunks.payload[1] |= FLAG_HOLES;
        writer.chunks.payload.extend(fill.to_le_bytes());
        let mut mask = cut_off(mask, extent, part);
        Transform::Differences.apply(&mut mask, coded);
        if !writer.push_all(Transform::Differences, &mask, coded)? {
            return Ok(None);
        }
    }
    Ok(writer.push_all(transform, &samples, coded)?.then_some(writer.chunks.payload))
}

/// Indices of the voxels of a brick.
pub(super) struct Indices<S> {
    pub samples: Vec<S>,
    /// Bits of the voxel in every hole, and the mask: 1 in a hole, else 0.
    pub holes: Option<(u64, Vec<S>)>,
}

impl<S: Sample> Indices<S> {
    /// `None` if a voxel is not a multiple of the step, or holes differ.
    pub fn of<V: Voxel>(voxels: &[V], quantizer: Quantizer, absence: Absence) -> Option<Self> {
        let bits = |v: &V| {
            let mut bytes = [0; 8];
            v.write_le(&mut bytes[..size_of::<V>()]);
            u64::from_le_bytes(bytes)
        };
        let holes_possible = absence.possible(V::TYPE);
        if !holes_possible || absence.nodata.is_none() {
            // NaN is not a multiple either, so this attempt fails if there are holes.
            let mut samples = vec![S::default(); voxels.len()];
            if vectorized(Indexing { voxels, quantizer, samples: &mut samples }) {
                return Some(Self { samples, holes: None });
            }
        }
        let is_hole = |v: &V| holes_possible && absence.is_absent(v.to_f64());
        let mut samples = Vec::with_capacity(voxels.len());
        let mut fill = None;
        let mut before = 0;
        for voxel in voxels {
            if is_hole(voxel) {
                if *fill.get_or_insert(bits(voxel)) != bits(voxel) {
                    return None;
                }
            } else {
                before = quantizer.exact_index(*voxel)?;
            }
            samples.push(S::wrap(before));
        }
        let mask = || voxels.iter().map(|v| S::wrap(i32::from(is_hole(v)))).collect();
        Some(Self { samples, holes: fill.map(|fill| (fill, mask())) })
    }
}

/// Task that computes the indices of voxels; false if a voxel is not a multiple of the step.
pub(super) struct Indexing<'a, V, S> {
    pub voxels: &'a [V],
    pub quantizer: Quantizer,
    pub samples: &'a mut [S],
}

impl<V: Voxel, S: Sample> Vectorized for Indexing<'_, V, S> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { voxels, quantizer, samples } = self;
        if quantizer == Quantizer::WHOLE && V::TYPE.bytes() <= 2 {
            // Each voxel is its own index.
            samples.iter_mut().zip(voxels).for_each(|(sample, voxel)| *sample = S::wrap(voxel.to_word()));
            return true;
        }
        let mut others = 0u8;
        for (sample, &voxel) in samples.iter_mut().zip(voxels) {
            let (index, is_exact) = quantizer.indexed(voxel);
            others |= u8::from(!is_exact);
            *sample = S::wrap(index);
        }
        others == 0
    }
}

/// Copy of a part of a box.
fn cut<S: Sample>(samples: &[S], extent: [usize; 3], part: Band) -> Vec<S> {
    let mut out = Vec::with_capacity(part.samples());
    rows_of(part, extent).for_each(|row| out.extend_from_slice(&samples[row]));
    out
}

/// A part of a box, without a copy if the part is the whole box.
fn cut_off<S: Sample>(samples: Vec<S>, extent: [usize; 3], part: Band) -> Vec<S> {
    if part.extent() == extent { samples } else { cut(&samples, extent, part) }
}

/// Rows of a part, as ranges of the box's samples.
fn rows_of(part: Band, extent: [usize; 3]) -> impl Iterator<Item = std::ops::Range<usize>> {
    let Band { start, end } = part;
    (start[2]..end[2]).flat_map(move |z| {
        (start[1]..end[1]).map(move |y| {
            let row = (z * extent[1] + y) * extent[0];
            row + start[0]..row + end[0]
        })
    })
}

/// The transform whose coefficients need fewer bits, estimated in the middle of the box.
fn choose<S: Sample>(samples: &[S], extent: [usize; 3]) -> Transform {
    let start = extent.map(|n| n.saturating_sub(PROBED) / 2);
    let middle = Band { start, end: std::array::from_fn(|a| start[a] + extent[a].min(PROBED)) };
    let probe = cut(samples, extent, middle);
    let bits = |transform: Transform| {
        let mut coefficients = probe.clone();
        transform.apply(&mut coefficients, middle.extent());
        estimate(transform, &coefficients, middle.extent())
    };
    if bits(Transform::Lifting) < bits(Transform::Differences) { Transform::Lifting } else { Transform::Differences }
}

/// Estimated bits of the coefficients, if those of each slice of a band have a geometric distribution.
fn estimate<S: Sample>(transform: Transform, coefficients: &[S], extent: [usize; 3]) -> f64 {
    let of_slice = |slice: Band| {
        let of_row = |row: std::ops::Range<usize>| {
            coefficients[row].iter().map(|c| 2 * u64::from(c.number().unsigned_abs())).sum::<u64>()
        };
        let mean = rows_of(slice, extent).map(of_row).sum::<u64>() as f64 / slice.samples() as f64;
        let bits = if mean == 0.0 { 0.0 } else { (mean + 1.0) * (mean + 1.0).log2() - mean * mean.log2() };
        slice.samples() as f64 * bits
    };
    let slice_of =
        |band: Band, z| Band { start: [band.start[0], band.start[1], z], end: [band.end[0], band.end[1], z + 1] };
    let of_band = |band: Band| (band.start[2]..band.end[2]).map(|z| of_slice(slice_of(band, z))).sum::<f64>();
    transform.bands(extent).into_iter().map(of_band).sum()
}

/// Samples that are copied for any shorter rest of a row. The next row overwrites the surplus. A copy of fixed length
/// costs less than one of the row's length.
const COPIED_AT_ONCE: usize = 16;

/// Samples of some bands, band after band, in the memory of `out`.
fn gather<'a, S: Sample>(samples: &[S], extent: [usize; 3], bands: &[Band], out: &'a mut Vec<S>) -> &'a [S] {
    let count = bands.iter().map(|band| band.samples()).sum::<usize>();
    out.resize(out.len().max(count + COPIED_AT_ONCE), S::default());
    let mut end = 0;
    for row in bands.iter().flat_map(|&band| rows_of(band, extent)) {
        for from in row.clone().step_by(COPIED_AT_ONCE) {
            let to = &mut out[end + from - row.start..];
            match (samples[from..].first_chunk::<COPIED_AT_ONCE>(), to.first_chunk_mut()) {
                (Some(part), Some(to)) => *to = *part,
                _ => to[..row.end - from].copy_from_slice(&samples[from..row.end]),
            }
        }
        end += row.len();
    }
    &out[..count]
}

struct ChunkWriter {
    chunks: Chunks,
    limit: usize,
}

impl ChunkWriter {
    /// Writes all coefficients; false as soon as the payload is not smaller than the limit.
    fn push_all<S: Sample>(
        &mut self,
        transform: Transform,
        coefficients: &[S],
        extent: [usize; 3],
    ) -> Result<bool, CodecError> {
        let mut gathered = Vec::new();
        self.chunks.choose_anew();
        for chunk in transform.chunks(extent) {
            let is_whole_box = chunk.iter().any(|band| band.extent() == extent);
            let coefficients =
                if is_whole_box { coefficients } else { gather(coefficients, extent, &chunk, &mut gathered) };
            self.chunks.push(coefficients)?;
            if self.chunks.payload.len() >= self.limit {
                return Ok(false);
            }
        }
        Ok(true)
    }
}

/// Decodes into a buffer of exactly the brick's size.
///
/// # Errors
/// If the payload is not one that [`encode_if_smaller`] makes for this shape.
pub fn decode_into(shape: BrickShape, payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    with_voxel!(shape.voxel_type, V => {
        if V::TYPE.bytes() == 1 {
            decode_typed::<V, i16>(shape, payload, out)
        } else {
            decode_typed::<V, i32>(shape, payload, out)
        }
    })
}

fn decode_typed<V: Voxel, S: Sample>(shape: BrickShape, payload: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
    let wrong = |reason: String| CodecError::Wavelet { reason };
    let Some((&[tag, flags, ref step @ ..], mut rest)) = payload.split_first_chunk::<HEAD_BYTES>() else {
        return Err(wrong(format!("{} bytes; expected at least {HEAD_BYTES}", payload.len())));
    };
    let transform = [Transform::Differences, Transform::Lifting]
        .into_iter()
        .find(|t| *t as u8 == tag)
        .ok_or_else(|| wrong(format!("transform {tag}; expected 0 or 1")))?;
    let step = f64::from_le_bytes(*step);
    let quantizer = Quantizer::new(shape.voxel_type, step)
        .ok_or_else(|| wrong(format!("step {step}; expected a positive one of {}", shape.voxel_type)))?;
    let repeats = Repeats::from_bits(flags & !FLAG_HOLES, shape.extent)
        .ok_or_else(|| wrong(format!("flags {flags:#010b}; expected those of {:?} voxels", shape.extent)))?;
    let (from, coded) = repeats.coded(shape.extent);
    let mut reader = ChunkReader::default();
    let holes = if flags & FLAG_HOLES == 0 {
        None
    } else {
        let (fill, behind) = rest.split_first_chunk::<8>().ok_or_else(|| wrong("no voxel for its holes".into()))?;
        rest = behind;
        Some((*fill, take_all::<S>(&mut reader, &mut rest, Transform::Differences, coded)?))
    };
    let samples = take_all::<S>(&mut reader, &mut rest, transform, coded)?;
    if !rest.is_empty() {
        return Err(wrong(format!("{} bytes behind the last chunk; expected none", rest.len())));
    }
    let places = Places { from, coded, extent: shape.extent };
    // A branch of its own, so that the compiler optimizes the common case without a step.
    if quantizer == Quantizer::WHOLE {
        vectorized(Writing { places: &places, samples: &samples, out, voxel: V::from_word });
    } else {
        vectorized(Writing { places: &places, samples: &samples, out, voxel: quantizer.voxels::<V>() });
    }
    if let Some((fill, mask)) = holes {
        fill_holes(&places, &mask, &fill[..size_of::<V>()], out);
    }
    Ok(())
}

/// Reads the coefficients of a box, reverses the transform, and advances `payload`.
fn take_all<S: Sample>(
    reader: &mut ChunkReader,
    payload: &mut &[u8],
    transform: Transform,
    extent: [usize; 3],
) -> Result<Vec<S>, CodecError> {
    let wrong = |reason: String| CodecError::Wavelet { reason };
    let mut samples = vec![S::default(); extent.iter().product()];
    let mut gathered = Vec::new();
    for chunk in transform.chunks(extent) {
        if chunk.iter().any(|band| band.extent() == extent) {
            reader.take(payload, &mut samples).map_err(wrong)?;
            continue;
        }
        gathered.clear();
        gathered.resize(chunk.iter().map(|band| band.samples()).sum(), S::default());
        reader.take(payload, &mut gathered).map_err(wrong)?;
        let mut at = 0;
        for row in chunk.into_iter().flat_map(|band| rows_of(band, extent)) {
            let length = row.len();
            samples[row].copy_from_slice(&gathered[at..at + length]);
            at += length;
        }
    }
    transform.undo(&mut samples, extent);
    Ok(samples)
}

/// Task that writes the voxels of samples, and repeats along x those that are not coded.
struct Writing<'a, S, F> {
    places: &'a Places,
    samples: &'a [S],
    out: &'a mut [u8],
    voxel: F,
}

impl<S: Sample, V: Voxel, F: Fn(i32) -> V> Vectorized for Writing<'_, S, F> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { places, samples, out, voxel } = self;
        let size = size_of::<V>();
        let [low, n] = [places.from[0], places.coded[0]];
        for (row, first) in out.chunks_exact_mut(places.extent[0] * size).zip(places.rows()) {
            let coded = row[low * size..(low + n) * size].chunks_exact_mut(size);
            for (bytes, &index) in coded.zip(&samples[first..first + n]) {
                voxel(index.number()).write_le(bytes);
            }
            places.repeat_along(row, size);
        }
    }
}

fn fill_holes<S: Sample>(places: &Places, mask: &[S], fill: &[u8], out: &mut [u8]) {
    for (row, first) in out.chunks_exact_mut(places.extent[0] * fill.len()).zip(places.rows()) {
        for (x, voxel) in row.chunks_exact_mut(fill.len()).enumerate() {
            if mask[first + places.source(0, x)] != S::default() {
                voxel.copy_from_slice(fill);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::VoxelType;

    const NODATA: Absence = Absence { nodata: Some(-999.0) };

    fn shape(extent: [usize; 3]) -> BrickShape {
        BrickShape { voxel_type: VoxelType::F32, extent }
    }

    /// Brick of floats that are computed from their positions.
    fn brick(extent: [usize; 3], value: impl Fn([usize; 3]) -> f32) -> Vec<u8> {
        let places = (0..extent.iter().product())
            .map(|i: usize| [i % extent[0], i / extent[0] % extent[1], i / (extent[0] * extent[1])]);
        places.flat_map(|p| value(p).to_le_bytes()).collect()
    }

    fn encode(extent: [usize; 3], voxels: &[u8], step: Option<Quantizer>) -> Option<Vec<u8>> {
        encode_if_smaller(shape(extent), voxels, NODATA, step, usize::MAX).expect("encoding needs only memory")
    }

    fn round_trip(extent: [usize; 3], voxels: &[u8], step: Option<Quantizer>) -> Vec<u8> {
        let payload = encode(extent, voxels, step).expect("voxels are multiples of a step");
        let mut out = vec![0xa5; voxels.len()];
        decode_into(shape(extent), &payload, &mut out).expect("what was encoded decodes");
        assert!(out == voxels, "{extent:?}");
        payload
    }

    /// Whole numbers; none of them is a hole or -0.
    fn wave([x, y, z]: [usize; 3]) -> f32 {
        (1000.0 * ((0.3 * x as f32).sin() + (0.2 * y as f32).cos() + 0.1 * z as f32)).round() + 5000.0
    }

    #[test]
    fn layers_that_repeat_cost_nothing() {
        let section = |n: usize| brick([40, n, 40], |[x, _, z]| wave([x, 0, z]));
        let [one, five] = [1, 5].map(|n| round_trip([40, n, 40], &section(n), None).len());
        assert!(five <= one, "one layer takes {one} bytes, five that are the same {five}");
        // At one end only, and with ends where only one of the two layers repeats.
        let clamped = |low: usize, high: usize| brick([20, 21, 22], move |[x, y, z]| wave([x.clamp(low, high), y, z]));
        let repeats = |payload: Vec<u8>| payload[1];
        assert_eq!(repeats(round_trip([20, 21, 22], &clamped(2, 99), None)), 0b01);
        assert_eq!(repeats(round_trip([20, 21, 22], &clamped(0, 17), None)), 0b10);
        assert_eq!(repeats(round_trip([20, 21, 22], &clamped(1, 18), None)), 0);
    }

    #[test]
    fn holes_come_back_if_they_are_all_alike() {
        let extent = [20, 20, 20];
        let with = |hole: fn(usize) -> f32| {
            brick(extent, move |p| if p[0] < 7 || p[1] * p[2] % 11 == 3 { hole(p[2]) } else { wave(p) })
        };
        for hole in [(|_| f32::NAN) as fn(usize) -> f32, |_| -999.0, |_| f32::NEG_INFINITY] {
            round_trip(extent, &with(hole), None);
        }
        assert_eq!(encode(extent, &with(|z| if z < 9 { f32::NAN } else { -999.0 }), None), None);
    }

    #[test]
    fn what_is_no_multiple_is_not_coded() {
        let extent = [8, 8, 8];
        assert_eq!(encode(extent, &brick(extent, |[x, y, z]| 0.1f32.powi((x + y * z) as i32)), None), None);
        let halves = brick(extent, |p| wave(p) + 0.5);
        assert_eq!(encode(extent, &halves, Some(Quantizer::WHOLE)), None);
        let step = round_trip(extent, &halves, None)[2..10].try_into().expect("eight bytes");
        assert_eq!(f64::from_le_bytes(step), 0.5);
        assert_eq!(encode(extent, &brick(extent, |p| if p == [3, 3, 3] { -0.0 } else { wave(p) }), None), None);
    }

    #[test]
    fn stored_bytes_stay_as_they_are() {
        let shape = BrickShape { voxel_type: VoxelType::U8, extent: [4, 1, 1] };
        let payload = encode_if_smaller(shape, &[105, 105, 105, 104], Absence::NON_FINITE_ONLY, None, usize::MAX);
        let payload = payload.expect("encoding needs only memory").expect("integers are whole numbers");
        let mut out = [0; 4];
        decode_into(shape, &payload, &mut out).expect("what was encoded decodes");
        assert_eq!(out, [105, 105, 105, 104]);
        // Differences 105, 0, 0, -1: zigzag 210, whose lowest five bits are extra bits; a run of 2; zigzag 1.
        let (head, chunk) = payload.split_at(HEAD_BYTES);
        assert_eq!(head, [0, 0, 0, 0, 0, 0, 0, 0, 0xf0, 0x3f]);
        let frame_bytes = usize::from(chunk[4]);
        assert_eq!((chunk[0], chunk[8], chunk.len()), (3, 1, 12 + frame_bytes + 1));
        let tokens = ::zstd::bulk::decompress(&chunk[12..12 + frame_bytes], 3).expect("a frame");
        assert_eq!(tokens, [128 + 4 + 2, 1, 64]);
        assert_eq!(chunk[12 + frame_bytes..], [17]);
    }

    #[test]
    fn wrong_heads_and_lengths_are_refused_by_name() {
        let extent = [9, 9, 9];
        let good = round_trip(extent, &brick(extent, wave), None);
        let said = |change: &dyn Fn(&mut Vec<u8>)| {
            let mut payload = good.clone();
            change(&mut payload);
            let refused = decode_into(shape(extent), &payload, &mut vec![0; 9 * 9 * 9 * 4]);
            refused.expect_err("it is none that is written").to_string()
        };
        assert!(said(&|p| p.truncate(9)).contains("at least 10"));
        assert!(said(&|p| p[0] = 2).contains("transform 2"));
        assert!(said(&|p| p[1] |= 0x80).contains("flags"));
        assert!(!said(&|p| p[1] |= FLAG_HOLES).is_empty());
        assert!(said(&|p| p[2..10].copy_from_slice(&(-1.0f64).to_le_bytes())).contains("step -1"));
        assert!(said(&|p| p[10..14].fill(0xff)).contains("coefficients"));
        assert!(said(&|p| p.push(0)).contains("behind the last chunk"));
        assert!(said(&|p| p.truncate(p.len() - 1)).contains("cut short"));
        // A line has no layers of apron.
        let line = BrickShape { voxel_type: VoxelType::F32, extent: [4, 1, 1] };
        let flags = decode_into(line, &[&[0, 1][..], &1f64.to_le_bytes()].concat(), &mut [0; 16]);
        assert!(flags.is_err_and(|e| e.to_string().contains("flags")));
    }
}
