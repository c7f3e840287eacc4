//! One sample of the field, at any ray parameter t inside a macro cell.

use glam::Vec3;
use supervol_format::cast::{narrow, single, whole};
use supervol_runtime::engines::cells::cell::{Cell, trilinear};
use supervol_runtime::engines::cells::walk::CellBox;
use supervol_runtime::engines::cells::{BrickVisit, StoredVoxel, cells_of_macro_cell};

use super::gradient::gradient_at_voxel;
use super::reconstruction::{bspline_weights, catmull_rom_weights, tricubic};
use super::{GradientOperator, Reconstruction, Sampling};

/// Number of fractions per axis that a texture unit distinguishes.
const TEXTURE_FRACTIONS: f64 = 256.0;

/// Sample queries along a ray.
pub(crate) trait Probe {
    /// Render value at t; `None` if the value is absent.
    fn value(&self, t: f64) -> Option<f32>;

    /// Colour and opacity at t, classified before interpolation; `None` if the value is absent.
    fn classified(&self, t: f64) -> Option<[f32; 4]>;

    /// Gradient at t, index space of the level; `None` if it is unknown.
    fn gradient(&self, t: f64) -> Option<Vec3>;
}

/// A uniform brick: all voxels have one value.
pub(crate) struct UniformProbe {
    pub(crate) value: f32,
    pub(crate) rgba: [f32; 4],
}

impl Probe for UniformProbe {
    fn value(&self, _t: f64) -> Option<f32> {
        Some(self.value)
    }

    fn classified(&self, _t: f64) -> Option<[f32; 4]> {
        Some(self.rgba)
    }

    fn gradient(&self, _t: f64) -> Option<Vec3> {
        None
    }
}

/// A macro cell of a resident brick.
pub(crate) struct BrickProbe<'a, T> {
    visit: &'a BrickVisit<'a>,
    voxels: &'a [T],
    cells: CellBox,
    sampling: &'a Sampling,
}

impl<'a, T: StoredVoxel> BrickProbe<'a, T> {
    pub(crate) fn new(
        visit: &'a BrickVisit<'a>,
        voxels: &'a [T],
        macro_cell: [i64; 3],
        sampling: &'a Sampling,
    ) -> Self {
        Self { visit, voxels, cells: cells_of_macro_cell(macro_cell), sampling }
    }

    /// Index of the trilinear cell at t, and the fractions inside it.
    fn place(&self, t: f64) -> ([i64; 3], [f64; 3]) {
        self.visit.cell_at(&self.cells, t)
    }

    fn trilinear(&self, cell: [i64; 3], p: [f64; 3]) -> Option<f64> {
        let corners = self.visit.corners(self.voxels, self.visit.base(cell));
        interpolate(corners, p)
    }

    fn cubic(&self, cell: [i64; 3], p: [f64; 3], weights: fn(f64) -> [f64; 4]) -> Option<f64> {
        let base = self.visit.base(cell);
        let values: [f64; 64] = std::array::from_fn(|i| {
            let offset = [i & 3, i >> 2 & 3, i >> 4].map(|o| narrow::<i32>(o) - 1);
            f64::from(self.visit.value(self.voxels, base, offset))
        });
        let value = tricubic(&values, p.map(weights));
        (!value.is_nan()).then_some(value)
    }

    fn nearest(&self, cell: [i64; 3], p: [f64; 3]) -> Option<f64> {
        let offset = p.map(|f| i32::from(f >= 0.5));
        let value = self.visit.value(self.voxels, self.visit.base(cell), offset);
        (!value.is_nan()).then_some(f64::from(value))
    }

    /// Differences of the interpolated field, half a voxel to either side.
    fn intermediate(&self, cell: [i64; 3], p: [f64; 3]) -> Option<Vec3> {
        let mut gradient = Vec3::ZERO;
        for axis in 0..3 {
            let tap = |step: f64| {
                let (mut cell, mut p) = (cell, p);
                let moved = p[axis] + step;
                let floor = moved.floor();
                cell[axis] += whole::<i64>(floor);
                p[axis] = moved - floor;
                self.trilinear(cell, p)
            };
            gradient[axis] = single(tap(0.5)? - tap(-0.5)?);
        }
        Some(gradient)
    }

    /// Gradients at the voxels, interpolated.
    fn interpolated_gradient(&self, cell: [i64; 3], p: [f64; 3]) -> Option<Vec3> {
        let base = self.visit.base(cell);
        let components = match self.sampling.gradient {
            GradientOperator::Sobel => {
                let corner_gradients: [[f64; 3]; 8] = std::array::from_fn(|corner| {
                    let at = [corner & 1, corner >> 1 & 1, corner >> 2].map(narrow::<i32>);
                    gradient_at_voxel(GradientOperator::Sobel, |offset| {
                        let offset = std::array::from_fn(|a| at[a] + offset[a]);
                        f64::from(self.visit.value(self.voxels, base, offset))
                    })
                });
                std::array::from_fn(|axis| corner_gradients.map(|gradient| single(gradient[axis])))
            }
            GradientOperator::Central | GradientOperator::Intermediate => {
                self.visit.gradient_corners(self.voxels, base)
            }
        };
        let mut gradient = Vec3::ZERO;
        for axis in 0..3 {
            gradient[axis] = single(interpolate(components[axis], p)?);
        }
        Some(gradient)
    }
}

/// Trilinear interpolation; `None` if an absent corner has weight.
fn interpolate(corners: [f32; 8], p: [f64; 3]) -> Option<f64> {
    if corners.iter().any(|c| c.is_nan()) {
        return Cell::new(corners, p, p).map(|cell| trilinear(&cell.corners, p));
    }
    Some(trilinear(&corners, p))
}

impl<T: StoredVoxel> Probe for BrickProbe<'_, T> {
    fn value(&self, t: f64) -> Option<f32> {
        let (cell, p) = self.place(t);
        let value = match self.sampling.reconstruction {
            Reconstruction::Nearest => self.nearest(cell, p),
            Reconstruction::Trilinear => self.trilinear(cell, p),
            Reconstruction::TrilinearByteFractions => {
                self.trilinear(cell, p.map(|f| (f * TEXTURE_FRACTIONS).round() / TEXTURE_FRACTIONS))
            }
            Reconstruction::CatmullRom => self.cubic(cell, p, catmull_rom_weights),
            Reconstruction::CubicBSpline => self.cubic(cell, p, bspline_weights),
        };
        value.map(single)
    }

    fn classified(&self, t: f64) -> Option<[f32; 4]> {
        let (cell, p) = self.place(t);
        let corners = self.visit.corners(self.voxels, self.visit.base(cell));
        let colors = corners.map(|value| {
            let [r, g, b, alpha] = self.visit.level().transfer_function().classify(value);
            // Colours are weighted by their opacity: a transparent voxel contributes no colour.
            if value.is_nan() { [f32::NAN; 4] } else { [r * alpha, g * alpha, b * alpha, alpha] }
        });
        let mut sum = [0.0; 4];
        for (channel, sum) in sum.iter_mut().enumerate() {
            *sum = single(interpolate(colors.map(|rgba| rgba[channel]), p)?);
        }
        let [r, g, b, alpha] = sum;
        Some(if alpha > 0.0 { [r / alpha, g / alpha, b / alpha, alpha] } else { [0.0; 4] })
    }

    fn gradient(&self, t: f64) -> Option<Vec3> {
        let (cell, p) = self.place(t);
        match self.sampling.gradient {
            GradientOperator::Intermediate => self.intermediate(cell, p),
            GradientOperator::Central | GradientOperator::Sobel => self.interpolated_gradient(cell, p),
        }
    }
}
