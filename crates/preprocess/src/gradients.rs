//! Lengths of the gradient at the voxels of a container, for a choice of the ramp of `gradient_opacity`.
//!
//! The gradient is that of the rendering model, section 5: central differences one voxel apart, in data units per world
//! unit. It is computed in one pass over the bricks of level 0, from their own voxels, in bounded memory: a brick and a sketch of
//! lengths ([`super::statistics`]). The result does not depend on the order of bricks.

use supervol_format::brick::APRON;
use supervol_format::canceller::Canceller;
use supervol_format::cast::whole;
use supervol_format::container::ContainerError;
use supervol_format::container::manifest::Manifest;
use supervol_format::voxel_type::Voxel;
use supervol_format::{BrickKey, Container, Lod, VoxelType, with_voxel};

use crate::statistics::{Interval, Sketch};

/// Percentile at which histograms of lengths end: a few steep places would make all other lengths one bar.
const HISTOGRAM_END: f64 = 99.9;
/// Percentiles of the lengths above 0 between which the usual ramp rises. The shorter half is mostly noise and slow change inside
/// of things; the steepest twentieth is boundaries. Lengths of 0 do not count: most volumes have much empty space.
const RAMP: [f64; 2] = [50.0, 95.0];
/// Least distance of these percentiles as a share of the greater one. If they are closer, all lengths are alike, and the ramp
/// begins at 0.
const LEAST_RAMP: f64 = 0.01;

/// Lengths of the gradient at all voxels that have one.
#[derive(Debug, Clone)]
pub struct Gradients {
    /// Occupied intervals of lengths, ascending.
    intervals: Vec<Interval>,
    /// Voxels that have a gradient.
    pub known: u64,
    /// Voxels among them whose gradient is 0.
    pub flat: u64,
    /// Present voxels without a gradient: a neighbour is absent.
    pub unknown: u64,
    /// Greatest length.
    pub greatest: f64,
}

impl Gradients {
    /// The gradients of a container's finest level. `on_progress` receives the number of finished bricks and of all bricks.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    ///
    /// # Panics
    /// Never: nothing cancels the count.
    pub fn of(container: &Container, on_progress: &dyn Fn(u64, u64)) -> Result<Self, ContainerError> {
        let counted = Self::unless_cancelled(container, &Canceller::default(), on_progress)?;
        Ok(counted.expect("nobody else has the canceller"))
    }

    /// As [`Self::of`]; `None` if `canceller` was cancelled before the last brick.
    ///
    /// # Errors
    /// If a brick cannot be read or decoded.
    pub fn unless_cancelled(
        container: &Container,
        canceller: &Canceller,
        on_progress: &dyn Fn(u64, u64),
    ) -> Result<Option<Self>, ContainerError> {
        let descriptor = container.descriptor();
        let mut counted = Counted { sketch: Sketch::new(VoxelType::F64), known: 0, flat: 0, unknown: 0, greatest: 0.0 };
        let (mut brick, mut done) = (Vec::new(), 0);
        let total = descriptor.pyramid.level_at(Lod::FINEST).brick_count();
        for key in descriptor.pyramid.keys_of(Lod::FINEST) {
            if canceller.is_cancelled() {
                return Ok(None);
            }
            let entry = container.entry(key)?;
            if !entry.absent {
                brick = container.read_brick_into(key, &entry, brick)?;
                counted.add(container, key, &brick);
            }
            done += 1;
            on_progress(done, total);
        }
        let Counted { sketch, known, flat, unknown, greatest } = counted;
        Ok(Some(Self { intervals: sketch.intervals(), known, flat, unknown, greatest }))
    }

    /// The length below which this percentage of the voxels lies; 0 without voxels.
    #[must_use]
    pub fn percentile(&self, percent: f64) -> f64 {
        self.length_above(self.known as f64 * percent / 100.0)
    }

    /// Length at which histograms end: the 99.9th percentile, or the greatest length if that percentile is 0.
    #[must_use]
    pub fn histogram_end(&self) -> f64 {
        let end = self.percentile(HISTOGRAM_END);
        if end > 0.0 { end } else { self.greatest }
    }

    /// Ends of a ramp of opacity that suits most volumes: the 50th and the 95th percentile of the lengths above 0. `None` if all
    /// gradients are 0.
    #[must_use]
    pub fn usual_ramp(&self) -> Option<[f64; 2]> {
        let steep = (self.known - self.flat) as f64;
        let [from, to] = RAMP.map(|percent| self.length_above(self.flat as f64 + steep * percent / 100.0));
        let is_wide = to - from >= LEAST_RAMP * to;
        (to > 0.0).then_some([if is_wide { from } else { 0.0 }, to])
    }

    /// The length below which this number of voxels lies.
    fn length_above(&self, wanted: f64) -> f64 {
        let mut below = 0;
        let reached = self.intervals.iter().find(|interval| {
            below += interval.count;
            below as f64 >= wanted
        });
        reached.map_or(0.0, |interval| interval.middle().min(self.greatest))
    }

    /// Voxels in equal parts of the lengths from 0 to `end`, and those beyond it.
    #[must_use]
    pub fn counts(&self, parts: usize, end: f64) -> (Vec<u64>, u64) {
        let (mut counts, mut beyond) = (vec![0; parts], 0);
        for interval in &self.intervals {
            let length = interval.middle();
            let share = if end > 0.0 { length / end } else { 0.0 };
            if share > 1.0 {
                beyond += interval.count;
            } else {
                counts[whole::<usize>(share * parts as f64).min(parts - 1)] += interval.count;
            }
        }
        (counts, beyond)
    }
}

/// Unit of lengths of the gradient: data unit per world unit, for example `HU per mm`.
#[must_use]
pub fn unit(manifest: &Manifest) -> String {
    let [x, y, z] = manifest.axes.each_ref().map(|axis| axis.unit.as_str());
    let world = if x == y && y == z && !x.is_empty() { x } else { "world unit" };
    let data = if manifest.unit.is_empty() { "data unit" } else { &manifest.unit };
    format!("{data} per {world}")
}

/// Gradients so far.
struct Counted {
    sketch: Sketch,
    known: u64,
    flat: u64,
    unknown: u64,
    greatest: f64,
}

impl Counted {
    /// Adds the voxels of a brick's core.
    fn add(&mut self, container: &Container, key: BrickKey, brick: &[u8]) {
        let descriptor = container.descriptor();
        with_voxel!(descriptor.voxel_type, V => self.add_typed::<V>(container, key, brick));
    }

    fn add_typed<V: Voxel>(&mut self, container: &Container, key: BrickKey, brick: &[u8]) {
        let descriptor = container.descriptor();
        let core = descriptor.pyramid.core_box(key).extent();
        let stored = descriptor.pyramid.stored_extent(key);
        let steps = [1, stored[0], stored[0] * stored[1]];
        // Columns of the matrix from differences of stored values two voxels apart.
        let to_world =
            descriptor.geometry.world_from_index_gradient().to_cols_array().map(|m| 0.5 * descriptor.scale * m);
        let absence = descriptor.absence;
        let value = |at: usize| {
            let value = V::read_le(&brick[at * size_of::<V>()..][..size_of::<V>()]).to_f64();
            if absence.is_absent(value) { f64::NAN } else { value }
        };
        for z in 0..core[2] {
            for y in 0..core[1] {
                let row = (z + APRON) * steps[2] + (y + APRON) * steps[1] + APRON;
                for at in row..row + core[0] {
                    let differences = steps.map(|step| value(at + step) - value(at - step));
                    if value(at).is_nan() {
                        continue;
                    }
                    let component =
                        |row: usize| (0..3).map(|column| to_world[3 * column + row] * differences[column]).sum();
                    let [x, y, z]: [f64; 3] = [0, 1, 2].map(component);
                    let length = x.hypot(y).hypot(z);
                    if length.is_finite() {
                        self.known += 1;
                        self.flat += u64::from(length == 0.0);
                        self.greatest = self.greatest.max(length);
                        self.sketch.add(length);
                    } else {
                        self.unknown += 1;
                    }
                }
            }
        }
    }
}
