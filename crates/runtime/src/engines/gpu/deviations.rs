//! Deviations of bricks for shaders: a table of all different ones; each page holds the number of its own.

use std::collections::HashMap;

use supervol_format::BrickKey;
use supervol_format::cast::{narrow, single};
use supervol_scene::scene::Mode;

use super::device::GpuDevice;
use super::layout::{DEVIATION_NONE, DEVIATION_UNKNOWN, GpuDeviation, RayErrors};
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::limits::FAR;
use crate::lod::deviation::{Deviation, RayDeviation};

/// Most deviations, the two fixed ones included; further bricks count as unknown.
pub const DEVIATION_LIMIT: usize = 1 << 14;
/// Factor against rounding: `f32` may round a bound down by this share.
const ROUNDING: f64 = 1.0 + 2.0 * f32::EPSILON as f64;

/// Error of a brick under a look, for pictures that state their error.
pub type DeviationOf = Box<dyn Fn(BrickKey) -> Deviation + Send + Sync>;

/// See the module.
#[derive(Debug)]
pub struct DeviationTable {
    gpu: GpuDevice,
    /// The buffer that shaders bind.
    pub buffer: wgpu::Buffer,
    /// Numbers of the deviations in the table, by their words.
    numbers: HashMap<[u32; WORDS], u32>,
    /// Deviations that are not written yet, in order.
    pending: Vec<GpuDeviation>,
    room: usize,
}

const WORDS: usize = size_of::<GpuDeviation>() / 4;

impl DeviationTable {
    /// Bytes of the table, with or without sums of errors.
    #[must_use]
    pub(super) const fn bytes(sums_errors: bool) -> u64 {
        (room(sums_errors) * size_of::<GpuDeviation>()) as u64
    }

    /// A table of the two fixed deviations: exact and unknown.
    ///
    /// # Errors
    /// If memory does not suffice.
    pub(super) fn new(gpu: &GpuDevice, sums_errors: bool) -> Result<Self, GpuError> {
        let buffer = gpu.buffer("deviations", Self::bytes(sums_errors), wgpu::BufferUsages::STORAGE)?;
        let room = room(sums_errors);
        let mut table = Self { gpu: gpu.clone(), buffer, numbers: HashMap::new(), pending: Vec::new(), room };
        table.clear();
        Ok(table)
    }

    /// Forgets all but the two fixed deviations.
    pub fn clear(&mut self) {
        self.numbers.clear();
        self.pending.clear();
        let first = [(Deviation::NONE, DEVIATION_NONE), (Deviation::UNKNOWN, DEVIATION_UNKNOWN)];
        for (deviation, number) in first {
            assert_eq!(self.number_of(&deviation, 0.0), number, "numbers that shaders know");
        }
    }

    /// Number of a deviation; `shift` is subtracted from every data value.
    pub fn number_of(&mut self, deviation: &Deviation, shift: f64) -> u32 {
        let deviation = on_device(deviation, shift);
        let next = self.numbers.len();
        let key: [u32; WORDS] = bytemuck::cast(deviation);
        if let Some(&number) = self.numbers.get(&key) {
            return number;
        }
        if next >= self.room {
            return DEVIATION_UNKNOWN;
        }
        self.numbers.insert(key, narrow::<u32>(next));
        self.pending.push(deviation);
        narrow::<u32>(next)
    }

    /// Writes the new deviations.
    pub fn flush(&mut self) {
        let pending = std::mem::take(&mut self.pending);
        if !pending.is_empty() {
            let written = (self.numbers.len() - pending.len()) * size_of::<GpuDeviation>();
            self.gpu.write_buffer(&self.buffer, written as u64, bytemuck::cast_slice(&pending));
        }
    }
}

const fn room(sums_errors: bool) -> usize {
    if sums_errors { DEVIATION_LIMIT } else { DEVIATION_UNKNOWN as usize + 1 }
}

/// The deviation in `f32`, never less; `shift` is subtracted from every data value.
#[must_use]
pub fn on_device(deviation: &Deviation, shift: f64) -> GpuDeviation {
    let up = |error: f64| single((error * ROUNDING).min(f64::from(FAR)));
    let value = |data: f64| (data - shift).clamp(-f64::from(FAR), f64::from(FAR));
    let Deviation { beneath, .. } = *deviation;
    let [least, greatest] = if beneath.is_empty() {
        [FAR, -FAR]
    } else {
        [single(value(beneath.min)).next_down(), single(value(beneath.max)).next_up()]
    };
    GpuDeviation {
        per_length: deviation.per_length.map(up),
        thinner: up(deviation.thinner),
        kappa_max: up(deviation.kappa_max),
        value: up(deviation.value),
        least,
        greatest,
        presence_may_change: u32::from(deviation.presence_may_change),
    }
}

/// The sums of a shader for one ray.
#[must_use]
pub fn of_ray(mode: Mode, errors: &RayErrors) -> RayDeviation {
    let known = |v: f32| if v >= FAR { f64::INFINITY } else { f64::from(v) };
    let [levels, bound] = [errors.levels, errors.bound].map(known);
    match mode {
        Mode::Mip | Mode::Minip => RayDeviation { below: levels, above: bound, ..RayDeviation::NONE },
        Mode::Dvr | Mode::Iso | Mode::Mean | Mode::Slice => RayDeviation { sum: levels, bound, ..RayDeviation::NONE },
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::ValueRange;

    use super::*;

    #[test]
    fn bounds_are_never_rounded_down_and_infinity_is_far() {
        let deviation = Deviation {
            per_length: [0.1, 0.2, 1e-9, 3.0, 0.0, 1e-40, 0.7, 0.3, 1.5, 1e-3, 1e5, 0.9],
            thinner: 1.0 / 3.0,
            kappa_max: f64::INFINITY,
            value: 0.3,
            beneath: ValueRange { min: 100.1, max: 200.3 },
            presence_may_change: true,
        };
        let found = on_device(&deviation, 100.0);
        for (found, exact) in found.per_length.iter().zip(deviation.per_length) {
            assert!(f64::from(*found) >= exact - f64::from(f32::MIN_POSITIVE), "{found} of {exact}");
        }
        assert!(f64::from(found.thinner) >= 1.0 / 3.0 && f64::from(found.value) >= 0.3 && found.kappa_max == FAR);
        assert!(f64::from(found.least) <= 0.1 && f64::from(found.greatest) >= 100.3 && found.presence_may_change == 1);
        let none = on_device(&Deviation::NONE, 5.0);
        assert!(none.least > none.greatest && none.value == 0.0);
    }
}
