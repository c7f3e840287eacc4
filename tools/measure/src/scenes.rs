//! Scenes of the chart, as data: six volumes, four shapes of transfer function, with and without shading.
//!
//! Each volume is loaded into memory as a [`Grid`] of data values with one world unit per voxel, for any spacing of the
//! source. The chart stores it again in each compared way: see [`Grid::source`]. Transfer functions use fractions of
//! the volume's value range; opacities are per voxel length. A volume without its file is left out with a message:
//! [`Loaded::Missing`].

use std::path::{Path, PathBuf};
use std::sync::Arc;

use supervol_format::cast::index;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{Dims, VoxelBox, VoxelType};
use supervol_sources::VolumeSource;
use supervol_sources::computed::Computed;
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::formats::segy::{SegyOptions, SegySource};
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::synthetic::Synthetic;

use crate::comparison::reconstruction::bspline_coefficients;
use crate::context::{ChartError, Context};
use crate::fixtures;
use crate::volume::Point;

/// CT of a carp; scan by M. Scheuring, University of Erlangen; BSD-2-Clause; see `tests/data/README.md`.
pub(crate) const CARP: &[u8] = include_bytes!("../../../tests/data/carp_ct.nii.gz");
/// First voxel of the loaded box of the carp: at the gills, so that half of the box is air.
const CARP_START: [u64; 3] = [32, 384, 96];
/// Part of block F3, Dutch North Sea (dGB Earth Sciences, TNO; CC BY-SA), in the developers' data folder.
const F3: &str = "segy/real/f3_int16_be.sgy";
/// Seed of the synthetic volumes.
const SEED: u64 = 1;
/// Largest stored value of each integer storage.
const BYTE_MAX: f64 = u8::MAX as f64;
const WORD_MAX: f64 = u16::MAX as f64;

/// A volume in memory.
#[derive(Debug, Clone)]
pub struct Grid {
    /// Voxels along x, y, z.
    pub dims: [u64; 3],
    /// Data values, x fastest.
    pub values: Arc<Vec<f64>>,
}

/// Result of loading a scene's volume.
#[derive(Debug)]
pub enum Loaded {
    /// The volume.
    Grid(Grid),
    /// Reason why the volume is missing, one sentence.
    Missing(String),
}

/// Storage of the voxels of a volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Storage {
    /// 32-bit floating point.
    Float,
    /// 16-bit integers over the value range.
    Word,
    /// 8-bit integers over the value range.
    Byte,
    /// Coefficients of the cubic B-spline through the voxels, 32-bit floating point.
    SplineCoefficients,
}

/// One volume of the chart.
#[derive(Debug)]
pub struct SceneSpec {
    /// Name, for the command line and for tables.
    pub name: &'static str,
    /// Short description for the reader: one clause.
    pub about: &'static str,
    /// Loads the volume. `edge`: voxels along each axis, for volumes of selectable size.
    pub load: fn(&Context<'_>, edge: u64) -> Result<Loaded, ChartError>,
    /// Positions of the transfer functions.
    pub values: Values,
}

/// Positions of the transfer functions, as fractions of the value range.
#[derive(Debug, Clone, Copy)]
pub struct Values {
    /// `smooth` rises from opacity 0 to full opacity between these values.
    pub ramp: [f64; 2],
    /// Centre and half width of `hat`.
    pub hat: [f64; 2],
    /// `step` is transparent below this value and opaque above it.
    pub step: f64,
    /// Centre of `spike`.
    pub spike: f64,
    /// Greatest opacity of `smooth`, per voxel length; the other opacities are derived from it.
    pub alpha: f64,
}

/// Half width of `spike`, as a fraction of the value range: one of 256 grey values.
pub const SPIKE_HALF_WIDTH: f64 = 0.5 / 128.0;

/// Shape of a transfer function.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// One long ramp: easy for all methods.
    Smooth,
    /// A triangle with a width of some tenths of the value range.
    Hat,
    /// A step from transparent to opaque: a surface.
    Step,
    /// A triangle with a width of two of 256 grey values: a thin shell.
    Spike,
}

/// Shading on or off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shading {
    /// Emission and absorption only.
    Off,
    /// The default light.
    On,
}

/// A transfer function with or without shading: one plot of the chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Look {
    /// Shape of the transfer function.
    pub shape: Shape,
    /// Shading on or off.
    pub shading: Shading,
}

impl Look {
    /// All eight looks.
    pub const ALL: [Self; 8] = [
        Self { shape: Shape::Smooth, shading: Shading::Off },
        Self { shape: Shape::Smooth, shading: Shading::On },
        Self { shape: Shape::Hat, shading: Shading::Off },
        Self { shape: Shape::Hat, shading: Shading::On },
        Self { shape: Shape::Step, shading: Shading::Off },
        Self { shape: Shape::Step, shading: Shading::On },
        Self { shape: Shape::Spike, shading: Shading::Off },
        Self { shape: Shape::Spike, shading: Shading::On },
    ];
    /// Looks of `--quick`.
    pub const QUICK: [Self; 3] = [
        Self { shape: Shape::Smooth, shading: Shading::Off },
        Self { shape: Shape::Smooth, shading: Shading::On },
        Self { shape: Shape::Spike, shading: Shading::Off },
    ];

    /// `smooth`, `spike shaded`, ...
    #[must_use]
    pub fn name(self) -> &'static str {
        match (self.shape, self.shading) {
            (Shape::Smooth, Shading::Off) => "smooth",
            (Shape::Smooth, Shading::On) => "smooth shaded",
            (Shape::Hat, Shading::Off) => "hat",
            (Shape::Hat, Shading::On) => "hat shaded",
            (Shape::Step, Shading::Off) => "step",
            (Shape::Step, Shading::On) => "step shaded",
            (Shape::Spike, Shading::Off) => "spike",
            (Shape::Spike, Shading::On) => "spike shaded",
        }
    }
}

/// All scenes.
pub const SCENES: &[SceneSpec] = &[
    SceneSpec {
        name: "marschner-lobb",
        about: "the Marschner-Lobb signal (1994), computed: ripples at the edge of what the grid can hold",
        load: |_, edge| Ok(Loaded::Grid(Grid::of(&fixtures::marschner_lobb(edge))?)),
        values: Values { ramp: [0.3, 1.0], hat: [0.5, 0.2], step: 0.5, spike: 0.5, alpha: 0.1 },
    },
    SceneSpec {
        name: "seismic",
        about: "a synthetic seismic survey: folded layers, faults, channels",
        load: |_, edge| synthetic("seismic", edge),
        values: Values { ramp: [0.55, 1.0], hat: [0.7, 0.1], step: 0.72, spike: 0.66, alpha: 0.3 },
    },
    SceneSpec {
        name: "vessels",
        about: "synthetic vessels: thin bright tubes in nearly empty space",
        load: |_, edge| synthetic("vessels", edge),
        values: Values { ramp: [0.05, 1.0], hat: [0.4, 0.2], step: 0.4, spike: 0.5, alpha: 0.5 },
    },
    SceneSpec {
        name: "carp",
        about: "real computed tomography: a box from the scan of a carp (M. Scheuring, University of Erlangen)",
        load: carp,
        values: Values { ramp: [0.2, 0.9], hat: [0.3, 0.08], step: 0.4, spike: 0.45, alpha: 0.15 },
    },
    SceneSpec {
        name: "f3",
        about: "real seismic: a piece of block F3, Dutch North Sea (dGB Earth Sciences, TNO; CC BY-SA)",
        load: f3,
        values: Values { ramp: [0.55, 1.0], hat: [0.65, 0.1], step: 0.65, spike: 0.62, alpha: 0.3 },
    },
    SceneSpec {
        name: "thin",
        about: "sheets, lines and points one voxel wide, computed: features no coarser grid can hold",
        load: |_, edge| Ok(Loaded::Grid(Grid::of(&thin(edge))?)),
        values: Values { ramp: [0.05, 1.0], hat: [0.6, 0.2], step: 0.5, spike: 0.5, alpha: 0.6 },
    },
];

/// The scene with this name.
#[must_use]
pub fn scene(name: &str) -> Option<&'static SceneSpec> {
    SCENES.iter().find(|scene| scene.name == name)
}

fn synthetic(name: &str, edge: u64) -> Result<Loaded, ChartError> {
    let source = Synthetic::new(name, Dims([edge; 3]), Some(VoxelType::F32), SEED)?;
    Ok(Loaded::Grid(Grid::of(&source)?))
}

fn carp(context: &Context<'_>, edge: u64) -> Result<Loaded, ChartError> {
    let path = context.folder.join("carp_ct.nii.gz");
    std::fs::write(&path, CARP).map_err(|source| ChartError::Write { path: path.clone(), source })?;
    let source = NiftiSource::open(&path, &SpoolFolder::at(context.folder))?;
    Ok(Loaded::Grid(Grid::of_box(&source, CARP_START, [edge; 3])?))
}

fn f3(_: &Context<'_>, edge: u64) -> Result<Loaded, ChartError> {
    let Some(path) = data_file(F3) else {
        return Ok(Loaded::Missing(format!(
            "scene f3 is left out: {F3} is in no data folder (name one in the environment variable SUPERVOL_DATA)"
        )));
    };
    let source = SegySource::open(&path, &SegyOptions::default())?;
    Ok(Loaded::Grid(Grid::of_box(&source, [0; 3], [edge; 3])?))
}

/// A file of the developers' data folder: `$SUPERVOL_DATA`, or `shared/data` beside the working folder or workspace.
pub(crate) fn data_file(name: &str) -> Option<PathBuf> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let beside = ["../../shared/data", "../../../shared/data", "../../../../shared/data"].map(|p| manifest.join(p));
    let here = ["shared/data", "../shared/data"].map(PathBuf::from);
    let folders = std::env::var_os("SUPERVOL_DATA").map(PathBuf::from).into_iter().chain(here).chain(beside);
    folders.map(|folder| folder.join(name)).find(|path| path.exists())
}

/// Three oblique and upright sheets, lines along each axis, and scattered points: value 1 in a background of 0.
fn thin(edge: u64) -> Computed {
    Computed::new([edge; 3], VoxelType::F32, move |[x, y, z]| {
        let third = edge / 3;
        let is_sheet = x == third || (x + y + z == 2 * edge && x > third);
        let is_line = (x == 2 * third && y == third)
            || (y == 2 * third && z == third)
            || (z == 2 * third && x == y && x > third)
            || (x + y == edge && z == edge / 2);
        let is_point = x % 8 == 5 && y % 8 == 3 && z % 8 == 6;
        if is_sheet || is_line || is_point { 1.0 } else { 0.0 }
    })
}

impl Grid {
    /// All voxels of a source.
    fn of(source: &dyn VolumeSource) -> Result<Self, ChartError> {
        Self::of_box(source, [0; 3], source.info().dims.0)
    }

    /// The voxels of a box that begins at `start` and has at most `extent` voxels. Absent voxels have the value 0.
    fn of_box(source: &dyn VolumeSource, start: [u64; 3], extent: [u64; 3]) -> Result<Self, ChartError> {
        let info = source.info();
        let end = std::array::from_fn(|a| (start[a] + extent[a]).min(info.dims.0[a]));
        if (0..3).any(|a| end[a] <= start[a]) {
            let message = format!("the box from {start:?} lies outside a volume of {} voxels", info.dims);
            return Err(ChartError::Broken(message));
        }
        let voxels = VoxelBox { start, end };
        let mut bytes = vec![0; voxels.voxels() * info.voxel_type.bytes()];
        source.read_box(voxels, &mut bytes)?;
        let value = |stored: f64| if stored.is_finite() { stored * info.scale + info.offset } else { 0.0 };
        let values = voxels_as_f64(info.voxel_type, &bytes).into_iter().map(value).collect();
        Ok(Self { dims: std::array::from_fn(|a| end[a] - start[a]), values: Arc::new(values) })
    }

    /// Least and greatest data value.
    #[must_use]
    pub fn range(&self) -> [f64; 2] {
        let fold = |f: fn(f64, f64) -> f64, start| self.values.iter().copied().fold(start, f);
        [fold(f64::min, f64::INFINITY), fold(f64::max, f64::NEG_INFINITY)]
    }

    /// The volume in this storage. Its values are equal up to the rounding of the storage.
    #[must_use]
    pub fn source(&self, storage: Storage) -> Computed {
        match storage {
            Storage::Float => self.computed(self.values.clone(), VoxelType::F32),
            Storage::Word => self.quantised(VoxelType::U16, WORD_MAX),
            Storage::Byte => self.quantised(VoxelType::U8, BYTE_MAX),
            Storage::SplineCoefficients => {
                let dims = self.dims.map(index);
                let mut coefficients = (*self.values).clone();
                bspline_coefficients(dims, &mut coefficients);
                self.computed(Arc::new(coefficients), VoxelType::F32)
            }
        }
    }

    fn quantised(&self, voxel_type: VoxelType, greatest: f64) -> Computed {
        let [min, max] = self.range();
        let scale = if max > min { (max - min) / greatest } else { 1.0 };
        let stored = Arc::new(self.values.iter().map(|v| (v - min) / scale).collect());
        self.computed(stored, voxel_type).with_info(|info| (info.scale, info.offset) = (scale, min))
    }

    fn computed(&self, stored: Arc<Vec<f64>>, voxel_type: VoxelType) -> Computed {
        let [nx, ny, _] = self.dims;
        Computed::new(self.dims, voxel_type, move |[x, y, z]| stored[index((z * ny + y) * nx + x)])
    }
}

impl Values {
    /// Control points of a transfer function over data with this value range.
    #[must_use]
    pub fn points(&self, shape: Shape, [min, max]: [f64; 2]) -> Vec<Point> {
        const DARK: [f64; 3] = [0.25, 0.45, 0.8];
        const BRIGHT: [f64; 3] = [1.0, 0.85, 0.5];
        let at = |share: f64| min + share * (max - min);
        let opaque = |factor: f64| (self.alpha * factor).min(0.95);
        let triangle = |middle: f64, half: f64, alpha: f64| {
            vec![(at(middle - half), DARK, 0.0), (at(middle), BRIGHT, alpha), (at(middle + half), DARK, 0.0)]
        };
        match shape {
            Shape::Smooth => vec![(at(self.ramp[0]), DARK, 0.0), (at(self.ramp[1]), BRIGHT, opaque(1.0))],
            Shape::Hat => triangle(self.hat[0], self.hat[1], opaque(1.5)),
            Shape::Step => vec![
                (at(0.0), DARK, 0.0),
                (at(self.step), DARK, 0.0),
                (at(self.step), DARK, opaque(3.0)),
                (at(1.0), BRIGHT, opaque(3.0)),
            ],
            Shape::Spike => triangle(self.spike, SPIKE_HALF_WIDTH, 0.9),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn context<'a>(folder: &'a Path) -> Context<'a> {
        Context { scale: crate::Scale::Small, folder, say: &|_| () }
    }

    #[test]
    fn every_scene_loads_or_says_why_not() {
        let folder = tempfile::tempdir().unwrap();
        for scene in SCENES {
            match (scene.load)(&context(folder.path()), 24).unwrap() {
                Loaded::Grid(grid) => {
                    let [min, max] = grid.range();
                    assert!(min.is_finite() && max > min, "{}: {min} to {max}", scene.name);
                    assert_eq!(grid.values.len() as u64, grid.dims.iter().product::<u64>(), "{}", scene.name);
                }
                Loaded::Missing(why) => assert!(why.contains(scene.name) && why.contains("SUPERVOL_DATA"), "{why}"),
            }
        }
        assert!(scene("thin").is_some() && scene("none").is_none());
    }

    #[test]
    fn storage_rounds_values_to_its_own_steps_and_no_further() {
        let grid = Grid::of(&fixtures::marschner_lobb(9)).unwrap();
        let [min, max] = grid.range();
        for (storage, steps) in [(Storage::Byte, BYTE_MAX), (Storage::Word, WORD_MAX), (Storage::Float, 1e7)] {
            let again = Grid::of(&grid.source(storage)).unwrap();
            let bound = 0.5001 * (max - min) / steps;
            let off = again.values.iter().zip(&*grid.values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off <= bound && (storage == Storage::Float || off > 0.5 * bound), "{storage:?}: {off} {bound}");
        }
    }

    #[test]
    fn control_points_are_sorted_and_in_range() {
        for scene in SCENES {
            for shape in [Shape::Smooth, Shape::Hat, Shape::Step, Shape::Spike] {
                let points = scene.values.points(shape, [-2.0, 6.0]);
                assert!(points.windows(2).all(|p| p[0].0 <= p[1].0), "{} {shape:?}", scene.name);
                assert!(points.iter().all(|p| (-2.0..=6.0).contains(&p.0) && (0.0..1.0).contains(&p.2)));
                assert!(points.iter().any(|p| p.2 > 0.05));
            }
        }
    }
}
