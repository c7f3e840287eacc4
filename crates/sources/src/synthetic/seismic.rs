//! A substitute for a migrated seismic survey. Layers are deposited flat, cut by channels, folded, faulted, and
//! recorded with a 25 Hz Ricker wavelet at 4 ms, plus noise.
//!
//! Layer thickness and wavelet are given in voxels (a larger survey has more layers, not thicker ones). Folds, faults
//! and channels scale with the volume. The voxel (x, y, z) shows the layered column at the depth
//!
//! ```text
//! u = z + fold(x, y) + growth(x, y) z / nz + sum over faults above it of throw(x, y)
//! amplitude = gain(x, y) (1 - s) trace(u) + s * channel(u) + noise(x, y, z)
//! ```
//!
//! where s is the share of channel fill. `trace` is a table of at most [`PERIOD_LIMIT`] voxels, after which the layers
//! repeat. Terms that depend on (x, y) alone are computed once per column. Depths are integers in units of 1/4096
//! voxel: exact at any depth, and the same on every machine.

use std::f64::consts::{PI, TAU};

use supervol_format::Dims;
use supervol_format::random::Random;

use super::noise::{numbers_for, row_hash, sign, voxel_noise};
use super::target::{CHUNK_VOXELS, Scale, Target};
use crate::cast::{self, index, low_32, signed, single};

/// Depth in voxels after which the layers repeat; a power of two.
pub const PERIOD_LIMIT: u64 = 1 << 16;

/// Fraction bits of a fixed-point depth in voxels.
const DEPTH_BITS: u32 = 12;

/// Log2 of the table entries per voxel of depth. Linear interpolation between them errs by 0.2 %.
const TABLE_BITS: u32 = 3;

/// Peak frequency of the wavelet in cycles per voxel: 25 Hz at 4 ms.
const RICKER_FREQUENCY: f64 = 0.1;

/// Half the wavelet's support in voxels; beyond it the envelope is below 1e-9.
const RICKER_SUPPORT: f64 = 16.0;

/// Root mean square of the trace. Peaks beyond 1 are clipped.
const TRACE_RMS: f64 = 0.22;

/// Greatest absolute noise.
const NOISE: f32 = 0.03;

const WAVES: usize = 5;
const FAULTS: usize = 4;
const CHANNELS: usize = 3;

/// Geology of the survey.
#[derive(Debug)]
pub struct Seismic {
    seed: u64,
    depth_voxels: f64,
    /// Amplitudes at 2^TABLE_BITS entries per voxel; the first entry is repeated at the end.
    trace: Vec<f32>,
    index_mask: u32,
    waves: [Wave; WAVES],
    faults: [Fault; FAULTS],
    channels: [Channel; CHANNELS],
}

/// A wave `sin(kx x + ky y + phase)`, and its effect on fold, growth and gain.
#[derive(Debug, Clone, Copy)]
struct Wave {
    k: [f64; 2],
    phase: f64,
    fold_voxels: f64,
    growth_voxels: f64,
    gain: f64,
}

/// Fault plane `z = z0 + slope * (distance across strike)`. Layers below it are displaced, most in its middle.
#[derive(Debug, Clone, Copy)]
struct Fault {
    centre: [f64; 2],
    /// Unit vector across strike.
    across: [f64; 2],
    z0: f64,
    slope: f64,
    throw_voxels: f64,
    half_length: f64,
}

/// A meandering channel at one layer.
#[derive(Debug, Clone, Copy)]
struct Channel {
    /// Depth of the channel's middle in layers, fixed point.
    depth: i32,
    half_thickness: i32,
    y0: f64,
    amplitude: [f64; 2],
    k: [f64; 2],
    phase: [f64; 2],
    half_width: f64,
    brightness: f32,
}

impl Seismic {
    /// The geology of this seed under a grid of these dims.
    #[must_use]
    pub fn new(dims: Dims, seed: u64) -> Self {
        let [nx, ny, nz] = dims.0.map(|n| n as f64);
        let width = nx.max(ny);
        // Room for the shifts of folds and faults, so that small volumes do not repeat.
        let period = (dims.0[2] * 2 + 256).next_power_of_two().min(PERIOD_LIMIT);
        let index_mask = low_32(period) << TABLE_BITS;
        let mut random = numbers_for(1, seed);
        Self {
            seed,
            depth_voxels: nz,
            trace: trace(index(period), &mut numbers_for(2, seed)),
            index_mask: index_mask - 1,
            waves: std::array::from_fn(|i| Wave::random(i, width, nz, &mut random)),
            faults: std::array::from_fn(|_| Fault::random([nx, ny, nz], &mut random)),
            channels: std::array::from_fn(|i| Channel::random(i, [nx, ny, nz], &mut random)),
        }
    }

    pub(super) fn fill(&self, target: &mut Target<'_>) {
        let scale = Scale::amplitude(target.voxel_type);
        let (voxels, voxel_type) = (target.voxels, target.voxel_type);
        let mut columns = Columns::new();
        let mut scratch = Scratch { depth: [0; CHUNK_VOXELS], amplitude: [0.0; CHUNK_VOXELS] };
        for (x, length) in target.chunks() {
            let along_x = AlongX::new(self, x, length);
            for y in voxels.start[1]..voxels.end[1] {
                columns.compute(self, &along_x, y as f64, length);
                for z in voxels.start[2]..voxels.end[2] {
                    self.fill_row(&columns, [x, y, z], length, &mut scratch);
                    scale.write_fast(&scratch.amplitude[..length], voxel_type, target.row([x, y, z], length));
                }
            }
        }
    }

    /// Amplitudes of one piece of a row. The loops over arrays are short, so that each compiles to vector code.
    fn fill_row(&self, columns: &Columns, [x, y, z]: [u64; 3], length: usize, scratch: &mut Scratch) {
        let depth = &mut scratch.depth[..length];
        let amplitude = &mut scratch.amplitude[..length];
        // Depths wrap at 2^32, a whole number of periods.
        let z_fixed = low_32(z).wrapping_shl(DEPTH_BITS).cast_signed();
        let below = single(z as f64 / self.depth_voxels);
        let z_signed = low_32(z).cast_signed();
        for ((depth, fold), growth) in depth.iter_mut().zip(&columns.fold).zip(&columns.growth) {
            *depth = z_fixed.wrapping_add(*fold).wrapping_add(cast::whole::<i32>(growth * below));
        }
        for fault in &columns.faults {
            for ((depth, top), throw) in depth.iter_mut().zip(&fault.top).zip(&fault.throw) {
                *depth = depth.wrapping_add(if z_signed > *top { *throw } else { 0 });
            }
        }
        const BELOW_ENTRY: u32 = DEPTH_BITS - TABLE_BITS;
        const TO_FRACTION: f32 = 1.0 / (1 << BELOW_ENTRY) as f32;
        for ((amplitude, depth), gain) in amplitude.iter_mut().zip(&*depth).zip(&columns.gain) {
            let depth = depth.cast_unsigned();
            let entry = (depth >> BELOW_ENTRY & self.index_mask) as usize;
            let fraction = (depth & ((1 << BELOW_ENTRY) - 1)) as f32 * TO_FRACTION;
            let (low, high) = (self.trace[entry], self.trace[entry + 1]);
            *amplitude = gain * (low + (high - low) * fraction);
        }
        for (channel, share) in self.channels.iter().zip(&columns.channels) {
            if share.is_empty {
                continue;
            }
            channel.fill(depth, &share.across, amplitude);
        }
        let row = row_hash(self.seed, y, z);
        for (amplitude, x) in amplitude.iter_mut().zip(low_32(x)..) {
            *amplitude = (*amplitude + NOISE * voxel_noise(row, x)).clamp(-1.0, 1.0);
        }
    }
}

/// The wavelet of Ricker (1953): `(1 - 2 a) exp(-a)`, `a = (pi f t)^2`.
fn ricker(voxels: f64) -> f64 {
    let a = (PI * RICKER_FREQUENCY * voxels).powi(2);
    (1.0 - 2.0 * a) * (-a).exp()
}

/// Random layers convolved with the wavelet, periodic with `period` voxels.
fn trace(period: usize, random: &mut Random) -> Vec<f32> {
    let per_voxel = f64::from(1 << TABLE_BITS);
    let entries = period << TABLE_BITS;
    let mut amplitudes = vec![0.0; entries];
    let mut depth = random.between(0.0, 4.0);
    let mut package = 1.0;
    while depth < period as f64 {
        // With probability 0.08 a new package of layers begins, quieter or louder than the one above.
        if random.between(0.0, 1.0) < 0.08 {
            package = random.between(0.25, 1.5);
        }
        let coefficient = package * random.between(0.1, 1.0) * sign(random);
        let first = cast::whole::<i64>(((depth - RICKER_SUPPORT) * per_voxel).ceil());
        let last = cast::whole::<i64>(((depth + RICKER_SUPPORT) * per_voxel).floor());
        for entry in first..=last {
            let at = index(entry.rem_euclid(signed(entries as u64)).cast_unsigned());
            amplitudes[at] += coefficient * ricker(entry as f64 / per_voxel - depth);
        }
        depth += random.between(2.0, 14.0);
    }
    let power: f64 = amplitudes.iter().map(|a| a * a).sum::<f64>() / entries as f64;
    let gain = TRACE_RMS / power.sqrt().max(f64::MIN_POSITIVE);
    let mut table: Vec<f32> = amplitudes.iter().map(|a| single(a * gain)).collect();
    table.push(table[0]);
    table
}

impl Wave {
    fn random(index: usize, width: f64, depth: f64, random: &mut Random) -> Self {
        // Longer waves are stronger; directions are spread over the half circle.
        let cycles = 0.5 + 0.8 * index as f64 * random.between(0.7, 1.3);
        let angle = random.between(0.0, PI);
        let k = TAU * cycles / width;
        // Bounded, so that fixed-point depths cannot overflow.
        let strength = (0.05 * depth).min(1500.0) / (1.0 + index as f64);
        Self {
            k: [k * angle.cos(), k * angle.sin()],
            phase: random.between(0.0, TAU),
            fold_voxels: strength * random.between(0.5, 1.0),
            growth_voxels: strength * random.between(-0.6, 0.6),
            gain: random.between(0.0, 0.1),
        }
    }
}

impl Fault {
    fn random([nx, ny, nz]: [f64; 3], random: &mut Random) -> Self {
        let angle = random.between(-0.6, 0.6);
        Self {
            centre: [nx * random.between(0.1, 0.9), ny * random.between(0.1, 0.9)],
            across: [angle.cos(), angle.sin()],
            z0: nz * random.between(0.2, 0.8),
            slope: sign(random) * random.between(1.2, 2.5),
            throw_voxels: sign(random) * (nz * random.between(0.015, 0.05)).clamp(2.0, 400.0),
            half_length: nx.max(ny) * random.between(0.3, 0.9),
        }
    }
}

impl Channel {
    fn random(index: usize, [nx, ny, nz]: [f64; 3], random: &mut Random) -> Self {
        let fixed = |voxels: f64| cast::whole::<i32>(voxels * f64::from(1 << DEPTH_BITS));
        let depth = nz * (index as f64 + random.between(0.3, 0.7)) / CHANNELS as f64;
        let k = TAU / nx.max(ny);
        Self {
            // Depths wrap like those of voxels; within one period they are exact.
            depth: low_32(cast::whole::<i64>(depth * f64::from(1 << DEPTH_BITS)).cast_unsigned()).cast_signed(),
            half_thickness: fixed((0.012 * nz).clamp(2.0, 12.0)),
            y0: ny * random.between(0.25, 0.75),
            amplitude: [ny * random.between(0.05, 0.15), ny * random.between(0.02, 0.06)],
            k: [k * random.between(0.8, 1.6), k * random.between(3.0, 6.0)],
            phase: [random.between(0.0, TAU), random.between(0.0, TAU)],
            half_width: (ny * random.between(0.015, 0.04)).max(1.5),
            brightness: single(random.between(0.6, 0.95) * sign(random)),
        }
    }

    /// The y position of the centreline at x, and the cosine of its angle to the x axis.
    fn centreline(&self, x: f64) -> (f64, f64) {
        let [slow, fast] = [0, 1].map(|i| (self.k[i] * x + self.phase[i], self.amplitude[i]));
        let y = self.y0 + slow.1 * slow.0.sin() + fast.1 * fast.0.sin();
        let slope = slow.1 * self.k[0] * slow.0.cos() + fast.1 * self.k[1] * fast.0.cos();
        (y, 1.0 / (1.0 + slope * slope).sqrt())
    }

    /// Blends channel fill into the layers where both shares, across the channel and along depth, are positive.
    fn fill(&self, depth: &[i32], across: &[f32], amplitude: &mut [f32]) {
        let to_unit = 1.0 / self.half_thickness as f32;
        for ((amplitude, depth), across) in amplitude.iter_mut().zip(depth).zip(across) {
            let t = depth.wrapping_sub(self.depth) as f32 * to_unit;
            let along = (1.0 - t * t).max(0.0);
            let share = across * along;
            // A bright base under a bright top of opposite sign; t (1 - t^2) is at most 1 / 2.6.
            *amplitude += share * (2.6 * self.brightness * t - *amplitude * 0.5);
        }
    }
}

/// Sines and centrelines by x, shared by the columns of all rows.
struct AlongX {
    x: u64,
    /// Sine and cosine of `kx x` for each wave.
    waves: [Vec<[f64; 2]>; WAVES],
    centrelines: [Vec<(f64, f64)>; CHANNELS],
}

impl AlongX {
    fn new(seismic: &Seismic, x: u64, length: usize) -> Self {
        let positions = || (x..x + length as u64).map(|x| x as f64);
        Self {
            x,
            waves: std::array::from_fn(|i| {
                let sine = |x: f64| <[f64; 2]>::from((seismic.waves[i].k[0] * x).sin_cos());
                positions().map(sine).collect()
            }),
            centrelines: std::array::from_fn(|i| positions().map(|x| seismic.channels[i].centreline(x)).collect()),
        }
    }
}

/// Terms that the voxels of a column share, for one piece of a row of columns. Depths are fixed point.
struct Columns {
    fold: [i32; CHUNK_VOXELS],
    growth: [f32; CHUNK_VOXELS],
    gain: [f32; CHUNK_VOXELS],
    faults: [FaultColumns; FAULTS],
    channels: [ChannelColumns; CHANNELS],
}

/// Depth in voxels at which a fault plane crosses each column, and the displacement of the layers below it.
#[derive(Clone, Copy)]
struct FaultColumns {
    top: [i32; CHUNK_VOXELS],
    throw: [i32; CHUNK_VOXELS],
}

/// Share of channel fill across the channel, 0 to 1.
#[derive(Clone, Copy)]
struct ChannelColumns {
    across: [f32; CHUNK_VOXELS],
    is_empty: bool,
}

struct Scratch {
    depth: [i32; CHUNK_VOXELS],
    amplitude: [f32; CHUNK_VOXELS],
}

impl Columns {
    fn new() -> Box<Self> {
        Box::new(Self {
            fold: [0; CHUNK_VOXELS],
            growth: [0.0; CHUNK_VOXELS],
            gain: [1.0; CHUNK_VOXELS],
            faults: [FaultColumns { top: [0; CHUNK_VOXELS], throw: [0; CHUNK_VOXELS] }; FAULTS],
            channels: [ChannelColumns { across: [0.0; CHUNK_VOXELS], is_empty: true }; CHANNELS],
        })
    }

    fn compute(&mut self, seismic: &Seismic, along_x: &AlongX, y: f64, length: usize) {
        self.compute_waves(seismic, along_x, y, length);
        for (columns, fault) in self.faults.iter_mut().zip(&seismic.faults) {
            columns.compute(fault, along_x.x, y, length);
        }
        for ((columns, channel), lines) in self.channels.iter_mut().zip(&seismic.channels).zip(&along_x.centrelines) {
            columns.compute(channel, lines, y);
        }
    }

    fn compute_waves(&mut self, seismic: &Seismic, along_x: &AlongX, y: f64, length: usize) {
        let fixed = f64::from(1 << DEPTH_BITS);
        let along_y: [(f64, f64); WAVES] =
            std::array::from_fn(|i| (seismic.waves[i].k[1] * y + seismic.waves[i].phase).sin_cos());
        for i in 0..length {
            let (mut fold, mut growth, mut gain) = (0.0, 0.0, 1.0);
            for (w, wave) in seismic.waves.iter().enumerate() {
                // sin(a + b) = sin a cos b + cos a sin b
                let [sin_x, cos_x] = along_x.waves[w][i];
                let value = sin_x * along_y[w].1 + cos_x * along_y[w].0;
                fold += wave.fold_voxels * value;
                growth += wave.growth_voxels * value;
                gain += wave.gain * value;
            }
            self.fold[i] = cast::whole::<i32>(fold * fixed);
            self.growth[i] = single(growth * fixed);
            self.gain[i] = single(gain);
        }
    }
}

impl FaultColumns {
    fn compute(&mut self, fault: &Fault, x: u64, y: f64, length: usize) {
        let fixed = f64::from(1 << DEPTH_BITS);
        for i in 0..length {
            let (dx, dy) = ((x + i as u64) as f64 - fault.centre[0], y - fault.centre[1]);
            let across = dx * fault.across[0] + dy * fault.across[1];
            let along = (dy * fault.across[0] - dx * fault.across[1]) / fault.half_length;
            // The displacement decreases to zero towards the fault's ends.
            let taper = (1.0 - along * along).max(0.0);
            self.top[i] = cast::whole::<i32>(fault.z0 + fault.slope * across);
            self.throw[i] = cast::whole::<i32>(fault.throw_voxels * taper * taper * fixed);
        }
    }
}

impl ChannelColumns {
    fn compute(&mut self, channel: &Channel, centrelines: &[(f64, f64)], y: f64) {
        self.is_empty = true;
        for (share, (centre, cosine)) in self.across.iter_mut().zip(centrelines) {
            let t = (y - centre) * cosine / channel.half_width;
            *share = single((1.0 - t * t).max(0.0));
            self.is_empty &= *share == 0.0;
        }
    }
}
