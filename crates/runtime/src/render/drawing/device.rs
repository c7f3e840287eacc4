//! A device, with its data and its speed.
//!
//! Graphics hardware may draw a whole picture before the deadline. So [`Pace`] remembers drawing times across scenes,
//! and the first picture begins with the pixel size that fitted last time.

use std::collections::BTreeMap;
use std::time::Duration;

use crate::engines::gpu::device::GpuDevice;
use crate::render::frame::gpu::GpuBackend;

/// Share of the remaining time that a picture may be expected to take.
pub(super) const LEAST_SURE_SHARE: f64 = 0.6;

/// A device with its data, and its speed.
pub(crate) struct Device {
    /// The device and the data on it.
    pub(crate) backend: GpuBackend,
    pub(super) pace: Pace,
}

impl Device {
    /// A device of unknown speed.
    #[must_use]
    pub(crate) fn new(device: GpuDevice) -> Self {
        Self { backend: GpuBackend::new(device), pace: Pace::default() }
    }
}

/// Drawing times of the last pictures by pixel size, without fetching bricks.
#[derive(Debug, Default)]
pub(super) struct Pace {
    /// Size of the full picture, pixels.
    size: [u32; 2],
    took: BTreeMap<u32, Duration>,
}

impl Pace {
    /// Notes the drawing time of a picture.
    pub(super) fn note(&mut self, size: [u32; 2], pixel: u32, took: Duration) {
        if self.size != size {
            *self = Self { size, took: BTreeMap::new() };
        }
        self.took.insert(pixel, took);
    }

    /// The smallest pixel size whose picture fits into the time left, with its drawing time; `None` if none is known.
    pub(super) fn fitting(&self, size: [u32; 2], left: Duration) -> Option<(u32, Duration)> {
        let sure = left.mul_f64(LEAST_SURE_SHARE);
        let fitting = self.took.iter().find(|(_, took)| **took <= sure).filter(|_| self.size == size);
        fitting.map(|(pixel, took)| (*pixel, *took))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_pixels_that_fit_are_taken_first() {
        let ms = Duration::from_millis;
        let (size, mut pace) = ([1920, 1080], Pace::default());
        assert_eq!(pace.fitting(size, ms(1_000)), None);
        [(16, 2), (8, 3), (4, 4), (1, 9)].into_iter().for_each(|(pixel, took)| pace.note(size, pixel, ms(took)));
        assert_eq!(pace.fitting(size, ms(16)), Some((1, ms(9))));
        assert_eq!(pace.fitting(size, ms(14)), Some((4, ms(4))), "9 of 14 ms are not sure enough");
        assert_eq!(pace.fitting(size, ms(1)), None);
        pace.note(size, 1, ms(30));
        assert_eq!(pace.fitting(size, ms(16)), Some((4, ms(4))), "what it took last");
        assert_eq!(pace.fitting([64, 64], ms(16)), None, "another picture");
        pace.note([64, 64], 2, ms(1));
        assert_eq!(pace.fitting(size, ms(1_000)), None, "one size is remembered");
    }
}
