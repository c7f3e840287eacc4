//! RICKER: a synthetic seismic cube with a known spectrum.
//!
//! White random reflectivity at 4 ms per voxel of z, convolved with a Ricker wavelet (Ricker 1953, "The form and laws
//! of propagation of seismic wavelets"). Layers dip along x and y; one fault displaces them. Values are f32 amplitudes
//! up to 3e4, optionally with spikes of 1e7 and dead traces. x and y number the traces; z (samples) points down.

use std::f64::consts::PI;

use supervol_format::VoxelType;
use supervol_format::cast::{single, whole};
use supervol_format::random::{Random, mix};
use supervol_sources::computed::Computed;

/// Seconds between neighbouring samples along z.
pub const SAMPLE_SECONDS: f64 = 0.004;
/// Greatest amplitude without spikes.
pub const AMPLITUDE: f64 = 3e4;
/// Amplitude of a spike, positive or negative.
pub const SPIKE: f64 = 1e7;
/// Table entries per sample of depth. Linear interpolation has an error of about 0.2 % of the amplitude.
const ENTRIES_PER_SAMPLE: usize = 8;
/// Increase of depth per trace along x and y, samples.
const DIP: [f64; 2] = [0.31, 0.17];
/// Displacement of the fault, samples.
const THROW: f64 = 6.4;
/// One trace in this many is dead.
const DEAD_TRACE_OF: u64 = 41;

/// Parameters of the cube.
#[derive(Debug, Clone, Copy)]
pub struct Ricker {
    /// Traces along x and y, samples along z.
    pub dims: [u64; 3],
    /// Peak frequency of the wavelet, Hz.
    pub peak_hz: f64,
    /// Fraction of the voxels that are spikes, 0 to 1.
    pub spikes: f64,
    /// Value of all samples of a dead trace; `None`: no trace is dead.
    pub dead: Option<f64>,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Ricker {
    /// The standard cube without defects: 25 Hz, no spikes, no dead traces.
    #[must_use]
    pub fn clean(dims: [u64; 3]) -> Self {
        Self { dims, peak_hz: 25.0, spikes: 0.0, dead: None, seed: 17 }
    }

    /// Source of the amplitudes of voxels `[x, y, z]`, by trace table.
    #[must_use]
    pub fn source(self) -> Computed {
        let trace = self.trace();
        Computed::new(self.dims, VoxelType::F32, move |v| self.value(&trace, v))
    }

    fn value(&self, trace: &[f32], [x, y, z]: [u64; 3]) -> f64 {
        let column = mix(self.seed ^ mix(x ^ mix(y)));
        if let Some(dead) = self.dead.filter(|_| column.is_multiple_of(DEAD_TRACE_OF)) {
            return dead;
        }
        let hash = mix(column ^ mix(z + 1));
        if ((hash >> 11) as f64) < self.spikes * (1u64 << 53) as f64 {
            return if hash & 1 == 0 { SPIKE } else { -SPIKE };
        }
        // The fault plane dips along z, so that it crosses levels and bricks.
        let across = x as f64 + 0.25 * z as f64 - 0.5 * (self.dims[0] as f64 + 0.25 * self.dims[2] as f64);
        let throw = if across > 0.0 { THROW } else { 0.0 };
        let depth = z as f64 + DIP[0] * x as f64 + DIP[1] * y as f64 + throw;
        let entry = depth * ENTRIES_PER_SAMPLE as f64;
        let (i, share) = (whole::<usize>(entry), entry.fract());
        AMPLITUDE * (f64::from(trace[i]) * (1.0 - share) + f64::from(trace[i + 1]) * share)
    }

    /// Reflectivity convolved with the wavelet, for every depth of a voxel; greatest magnitude 1.
    fn trace(&self) -> Vec<f32> {
        let deepest = self.dims[2] as f64 + DIP[0] * self.dims[0] as f64 + DIP[1] * self.dims[1] as f64 + THROW;
        let samples = whole::<usize>(deepest) + 2;
        let wavelet = |seconds: f64| {
            let squared = (PI * self.peak_hz * seconds).powi(2);
            (1.0 - 2.0 * squared) * (-squared).exp()
        };
        // Beyond this many samples the wavelet is below 1e-10.
        let support = whole::<usize>((5.2 / (PI * self.peak_hz * SAMPLE_SECONDS)).ceil());
        let mut random = Random::new(self.seed);
        let reflectivity: Vec<f64> = (0..samples + 2 * support).map(|_| 2.0 * random.unit() - 1.0).collect();
        let at = |entry: usize| {
            let depth = entry as f64 / ENTRIES_PER_SAMPLE as f64;
            let first = whole::<usize>(depth);
            (first..=first + 2 * support)
                .map(|k| reflectivity[k] * wavelet((depth - (k as f64 - support as f64)) * SAMPLE_SECONDS))
                .sum::<f64>()
        };
        let trace: Vec<f64> = (0..samples * ENTRIES_PER_SAMPLE - 1).map(at).collect();
        let greatest = trace.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        trace.iter().map(|v| single(v / greatest)).collect()
    }
}
