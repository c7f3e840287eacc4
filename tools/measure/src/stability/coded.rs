//! Regimes of coded voxels: S19 (wavelets overshoot), S20 (quantised coefficients). Skipping uses value bounds; they
//! must hold for the decoded voxels, which are the ones drawn.
//!
//! Each corner of each cell of decoded voxels is checked against the bounds of its brick and of its macro cells.

use supervol_format::brick::{APRON, MACRO_CELL};
use supervol_format::cast::{index, narrow};
use supervol_format::codec::{Codec, CodecChoice};
use supervol_format::container::toc::BrickEntry;
use supervol_format::random::mix;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickKey, Container, Lod, ValueRange, VoxelType};
use supervol_preprocess::{BuildOptions, MaxError};
use supervol_sources::computed::Computed;

use super::regime::{CurvePoint, Gate, Outcome, Regime};
use crate::context::{ChartError, Context};
use crate::volume::{Volume, build_options};

/// The regimes of this module.
pub const REGIMES: &[Regime] = &[
    Regime {
        id: "S19",
        title: "Wavelets overshoot",
        recipe: "STEP and the corner of a box as wavelets, exactly and within 0.1 to 20 % of the range, all levels decoded. Beside \
                 it, in closed form, what is left of them when the finest band is dropped.",
        x_label: "greatest error, percent of the range; for dropped bands, axes along which there is an edge",
        y_label: "cells outside of their bounds, share; for dropped bands, overshoot, share of the edge's height",
        run: overshoot,
    },
    Regime {
        id: "S20",
        title: "Bounds of quantised voxels",
        recipe: "Noise of variance 1 as wavelets of voxels moved to multiples of 0.05, 0.2 and 0.5, all levels decoded; held \
                 against the bounds that the container has, and against those that the exact voxels had.",
        x_label: "step, standard deviations of the noise",
        y_label: "cells outside of their bounds, share",
        run: quantised,
    },
];

/// Least number of cells that each regime checks, at full and at small scale.
const CELLS: [f64; 2] = [1e7, 1e5];
/// Least number of wavelet bricks, at full and at small scale: most bricks of S19's edges are uniform.
const CODED: [f64; 2] = [20.0, 10.0];
/// Step of a macro cell's stored bounds, as a fraction of the brick's range.
const QUANTUM: f64 = 1.0 / 255.0;

/// Findings in the cells of a container.
#[derive(Debug, Clone, Copy, Default)]
struct Findings {
    cells: f64,
    /// Cells with a corner outside the bounds of their brick or of one of their macro cells.
    escapes: f64,
    /// Macro cells and bricks with bounds wider than their values by more than outward rounding.
    loose: f64,
    /// Bricks coded as wavelets.
    wavelets: f64,
}

impl Findings {
    fn add(self, other: Self) -> Self {
        Self {
            cells: self.cells + other.cells,
            escapes: self.escapes + other.escapes,
            loose: self.loose + other.loose,
            wavelets: self.wavelets + other.wavelets,
        }
    }

    fn gates(self, context: &Context<'_>) -> Vec<Gate> {
        vec![
            Gate::at_most("cells outside of the bounds of their brick or macro cell", self.escapes, 0.0),
            Gate::at_least("cells looked at", self.cells, context.pick(CELLS[0], CELLS[1])),
            Gate::at_least("bricks that are coded as wavelets", self.wavelets, context.pick(CODED[0], CODED[1])),
            Gate::at_most("bricks and macro cells with bounds wider than rounding makes them", self.loose, 0.0),
        ]
    }
}

/// A decoded brick and its container entry.
struct Decoded {
    entry: BrickEntry,
    extent: [usize; 3],
    values: Vec<f64>,
    macro_cells: [usize; 3],
    bounds: Vec<ValueRange>,
}

impl Decoded {
    fn read(container: &Container, key: BrickKey) -> Result<Self, ChartError> {
        let entry = container.entry(key)?;
        let mut record = vec![0; index(entry.record_bytes())];
        container.read_at(entry.offset, &mut record)?;
        let shape = container.shape(key);
        let mut voxels = vec![0; shape.bytes()];
        container.decode_brick(key, &entry, &record, &mut voxels)?;
        Ok(Self {
            entry,
            extent: shape.extent,
            values: voxels_as_f64(shape.voxel_type, &voxels),
            macro_cells: container.pyramid().macro_cells(key),
            bounds: container.macro_cells(key, &entry, &record),
        })
    }

    /// Macro cells on an axis that contain the cell between stored voxels `i` and `i + 1`: the owners of the two
    /// voxels. At the ends it is the nearest macro cell.
    fn owners(&self, axis: usize, i: usize) -> [usize; 2] {
        [i, i + 1].map(|voxel| (voxel.saturating_sub(APRON) / MACRO_CELL).min(self.macro_cells[axis] - 1))
    }

    /// Range of the corners of the cell that begins at this stored voxel.
    fn corners(&self, [x, y, z]: [usize; 3]) -> ValueRange {
        let [nx, ny, _] = self.extent;
        let mut range = ValueRange::EMPTY;
        for row in [(z, y), (z, y + 1), (z + 1, y), (z + 1, y + 1)].map(|(z, y)| (z * ny + y) * nx + x) {
            range.include(self.values[row]);
            range.include(self.values[row + 1]);
        }
        range
    }

    /// Checks every cell that a ray inside the brick's core, or half a voxel around it, may use.
    fn findings(&self) -> Findings {
        let drawn = self.extent.map(|n| APRON - 1..n - APRON);
        let mut held = vec![ValueRange::EMPTY; self.bounds.len()];
        let wavelets = if self.entry.codec == Codec::Wavelet { 1.0 } else { 0.0 };
        let mut found = Findings { wavelets, ..Findings::default() };
        for z in drawn[2].clone() {
            for y in drawn[1].clone() {
                for x in drawn[0].clone() {
                    let corners = self.corners([x, y, z]);
                    let mut is_held = self.entry.range.holds(corners);
                    let [xs, ys, zs] = [self.owners(0, x), self.owners(1, y), self.owners(2, z)];
                    for (cx, cy, cz) in zs.into_iter().flat_map(|z| ys.map(|y| xs.map(|x| (x, y, z)))).flatten() {
                        let cell = (cz * self.macro_cells[1] + cy) * self.macro_cells[0] + cx;
                        is_held &= self.bounds[cell].holds(corners);
                        held[cell] = held[cell].union(corners);
                    }
                    found.cells += 1.0;
                    found.escapes += if is_held { 0.0 } else { 1.0 };
                }
            }
        }
        let all = held.iter().fold(ValueRange::EMPTY, |a, b| a.union(*b));
        // One step outward at each end, plus rounding in `f64`.
        let slack = 2.001 * QUANTUM * all.width();
        let is_loose = |(bounds, held): (&ValueRange, &ValueRange)| bounds.width() > held.width() + slack;
        found.loose = self.bounds.iter().zip(&held).filter(|pair| is_loose(*pair)).count() as f64;
        found.loose += if all == self.entry.range { 0.0 } else { 1.0 };
        found
    }
}

/// A container with wavelet coding.
fn coded(context: &Context<'_>, name: &str, field: &Computed, max_error: MaxError) -> Result<Volume, ChartError> {
    let codec = CodecChoice::Only(Codec::Wavelet);
    let core = context.pick(64, 32);
    Volume::build(context, name, field, &BuildOptions { codec, max_error, ..build_options(core) })
}

/// Checks all cells of all levels, brick by brick.
fn findings(volume: &Volume) -> Result<Findings, ChartError> {
    let container = &volume.container;
    let mut found = Findings::default();
    for lod in container.pyramid().lods() {
        for key in container.pyramid().keys_of(lod) {
            found = found.add(Decoded::read(container, key)?.findings());
        }
    }
    Ok(found)
}

/// STEP along x, or the corner of a box. Edges lie on odd and even voxels; the height is no multiple of the steps.
fn edge(dims: [u64; 3], axes: usize, voxel_type: VoxelType) -> Computed {
    let from = dims.map(|n| (n / 3) | 1);
    Computed::new(dims, voxel_type, move |v| if (0..axes).all(|a| v[a] >= from[a]) { 113.0 } else { -14.0 })
}

fn overshoot(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let dims = context.pick([110, 100, 90], [40, 37, 34]);
    let mut curve = Vec::new();
    let mut all = Findings::default();
    for percent in [0.0, 0.1, 1.0, 5.0, 20.0] {
        let mut here = Findings::default();
        for (axes, voxel_type) in [(1, VoxelType::I8), (1, VoxelType::F32), (3, VoxelType::I16), (3, VoxelType::F32)] {
            let name = format!("S19 {axes} {voxel_type} {percent}");
            let max_error = if percent > 0.0 { MaxError::Percent(percent) } else { MaxError::Exact };
            let volume = coded(context, &name, &edge(dims, axes, voxel_type), max_error)?;
            here = here.add(findings(&volume)?);
        }
        curve.push(CurvePoint::new("default", percent, here.escapes / here.cells, Some(0.0)));
        all = all.add(here);
    }
    for axes in 1..=3 {
        // An edge along several axes is a product, and so is its overshoot.
        let of_a_product = |along_one: f64| (1.0 + along_one).powi(axes) - 1.0;
        let expected = [Some(0.125), None, Some(0.42)][narrow::<usize>(axes) - 1];
        let lifted = of_a_product(overshoot_of_lifting());
        curve.push(CurvePoint::new("5/3 without its finest band", f64::from(axes), lifted, expected));
        curve.push(CurvePoint::new("Haar without its finest band", f64::from(axes), of_a_product(0.0), Some(0.0)));
    }
    let note = format!(
        "{} cells between eight voxels, of all levels. The codec drops no band: voxels are moved before they are coded, so that \
         nothing overshoots, and bounds are those of the moved voxels. Dropped bands are what a codec would do that saves details \
         of coefficients: its bounds must be taken after decoding.",
        all.cells
    );
    Ok(Outcome { curve, gates: all.gates(context), note })
}

/// Overshoot of a step of height 1 after one 5/3 lifting step without its details.
fn overshoot_of_lifting() -> f64 {
    let worst = |edge: usize| {
        let x: Vec<f64> = (0..32).map(|i| if i >= edge { 1.0 } else { 0.0 }).collect();
        let at = |v: &[f64], i: usize| v[i.min(v.len() - 1)];
        let even: Vec<f64> = x.iter().copied().step_by(2).collect();
        let details: Vec<f64> = (0..16).map(|i| x[2 * i + 1] - 0.5 * (at(&even, i) + at(&even, i + 1))).collect();
        let kept: Vec<f64> =
            (0..16usize).map(|i| even[i] + 0.25 * (details[i.saturating_sub(1)] + details[i])).collect();
        // Without details, kept samples are unchanged, and samples between them are their means, so no greater.
        kept.into_iter().fold(0.0, f64::max) - 1.0
    };
    (8..24).map(worst).fold(0.0, f64::max)
}

/// Noise of variance 1 (Box and Muller 1958).
fn noise([x, y, z]: [u64; 3]) -> f64 {
    let bits = mix(x ^ mix(y ^ mix(z ^ 20)));
    let [a, b] = [bits >> 32, bits & 0xffff_ffff].map(|half| (half as f64 + 0.5) / 2f64.powi(32));
    (-2.0 * a.ln()).sqrt() * (std::f64::consts::TAU * b).cos()
}

fn quantised(context: &Context<'_>) -> Result<Outcome, ChartError> {
    let dims = context.pick([160, 150, 140], [48, 44, 40]);
    let field = Computed::new(dims, VoxelType::F32, noise);
    let exact = coded(context, "S20 exact", &field, MaxError::Exact)?;
    let mut curve = Vec::new();
    let mut all = findings(&exact)?;
    for step in [0.05, 0.2, 0.5] {
        let volume = coded(context, &format!("S20 {step}"), &field, MaxError::Value(0.5 * step))?;
        let found = findings(&volume)?;
        curve.push(CurvePoint::new("default", step, found.escapes / found.cells, Some(0.0)));
        let escaped = escaped_macro_cells(&exact, |v| moved(&volume, v))?;
        // Rounding keeps the order of voxels: in 3 of 4 cases the greatest moves up or the least moves down.
        curve.push(CurvePoint::new("voxels moved, bounds of exact ones", step, escaped, Some(0.75)));
        let escaped = escaped_macro_cells(&exact, |brick| quantised_coefficients(brick, step))?;
        curve.push(CurvePoint::new("coefficients (Haar) quantised, bounds of exact voxels", step, escaped, None));
        all = all.add(found);
    }
    let note = format!(
        "{} cells between eight voxels, of all levels. Shares against the bounds of exact voxels are of macro cells of 8^3 voxels, of \
         level 0: bounds that are not widened, as they are where they are taken before coding. Computed independently for quantised \
         coefficients: 75 to 91 %.",
        all.cells
    );
    Ok(Outcome { curve, gates: all.gates(context), note })
}

/// Voxels of the same brick in another container.
fn moved(volume: &Volume, brick: &(BrickKey, Decoded)) -> Result<Vec<f64>, ChartError> {
    Ok(Decoded::read(&volume.container, brick.0)?.values)
}

/// Voxels of a brick after quantisation of its coefficients: one step of an orthonormal Haar transform.
fn quantised_coefficients((_, brick): &(BrickKey, Decoded), step: f64) -> Result<Vec<f64>, ChartError> {
    let mut values = brick.values.clone();
    haar(&mut values, brick.extent);
    values.iter_mut().for_each(|c| *c = (*c / step).round() * step);
    haar(&mut values, brick.extent);
    Ok(values)
}

/// Sums and differences of pairs along each axis, times sqrt(1/2): its own inverse. A last single voxel stays.
fn haar(values: &mut [f64], extent: [usize; 3]) {
    let strides = [1, extent[0], extent[0] * extent[1]];
    for axis in 0..3 {
        for i in 0..values.len() {
            let place = i / strides[axis] % extent[axis];
            if place.is_multiple_of(2) && place + 1 < extent[axis] {
                let [a, b] = [values[i], values[i + strides[axis]]];
                values[i] = (a + b) * std::f64::consts::FRAC_1_SQRT_2;
                values[i + strides[axis]] = (a - b) * std::f64::consts::FRAC_1_SQRT_2;
            }
        }
    }
}

/// Fraction of the macro cells of level 0 whose voxels, after `change`, leave their former range.
fn escaped_macro_cells(
    exact: &Volume,
    change: impl Fn(&(BrickKey, Decoded)) -> Result<Vec<f64>, ChartError>,
) -> Result<f64, ChartError> {
    let (mut cells, mut escaped) = (0.0, 0.0);
    for key in exact.container.pyramid().keys_of(Lod(0)) {
        let brick = (key, Decoded::read(&exact.container, key)?);
        let changed = change(&brick)?;
        let before = reached(&brick.1, &brick.1.values);
        let after = reached(&brick.1, &changed);
        cells += before.len() as f64;
        escaped += before.iter().zip(&after).filter(|(before, after)| !before.holds(**after)).count() as f64;
    }
    Ok(escaped / cells)
}

/// Ranges of the values that interpolation reaches in each macro cell.
fn reached(brick: &Decoded, values: &[f64]) -> Vec<ValueRange> {
    let [mx, my, mz] = brick.macro_cells;
    let along = |axis: usize, cell: usize| {
        let first = cell * MACRO_CELL + APRON - 1;
        first..(first + MACRO_CELL + 2).min(brick.extent[axis] - APRON + 1)
    };
    let mut out = Vec::with_capacity(mx * my * mz);
    for (cz, cy, cx) in (0..mz).flat_map(|z| (0..my).flat_map(move |y| (0..mx).map(move |x| (z, y, x)))) {
        let mut range = ValueRange::EMPTY;
        for z in along(2, cz) {
            for y in along(1, cy) {
                let row = (z * brick.extent[1] + y) * brick.extent[0];
                along(0, cx).for_each(|x| range.include(values[row + x]));
            }
        }
        out.push(range);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::context::Scale;

    /// The regimes find bounds that are too narrow or too wide by one step.
    #[test]
    fn wrong_bounds_are_found() {
        let folder = tempfile::tempdir().expect("tests need a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let field = Computed::new([30, 20, 17], VoxelType::F32, noise);
        let volume = coded(&context, "wrong", &field, MaxError::Value(0.1)).expect("it is built");
        let key = volume.container.pyramid().keys_of(Lod(0)).next().expect("a brick");
        let read = || Decoded::read(&volume.container, key).expect("it is read");
        let right = read().findings();
        assert_eq!((right.escapes, right.loose, right.wavelets), (0.0, 0.0, 1.0));
        assert_eq!(right.cells, 31.0 * 21.0 * 18.0);
        for cell in 0..read().bounds.len() {
            let mut narrow = read();
            narrow.bounds[cell].max -= 2.001 * QUANTUM * narrow.entry.range.width();
            assert!(narrow.findings().escapes > 0.0, "macro cell {cell} is too narrow");
            let mut wide = read();
            wide.bounds[cell].min -= 2.1 * QUANTUM * wide.entry.range.width();
            assert_eq!(wide.findings().loose, 1.0, "macro cell {cell} is too wide");
        }
        let mut brick = read();
        brick.entry.range.max -= 0.1;
        assert!(brick.findings().escapes > 0.0, "the brick's range is too narrow");
    }
}
