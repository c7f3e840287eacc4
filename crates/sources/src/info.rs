//! Description of a volume by its source: grid, voxels, place in the world, notes.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use supervol_format::space::WorldSpace;
use supervol_format::{Dims, Geometry, VoxelType};

use crate::input::file::SourceFile;
use crate::survey::Survey;

/// What a source says about itself.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceInfo {
    /// `raw`, `nrrd`, `segy`, `nifti`, `npy`, `npz`, `metaimage`, `tiff`, `dicom`, `pictures`, `vtk`,
    /// `zarr`, `ome-zarr`, `n5`, `hdf5`, `bdv` or `synth`.
    pub format: &'static str,
    /// Voxels along x, y, z.
    pub dims: Dims,
    /// Type of the voxels that `read_box` hands out.
    pub voxel_type: VoxelType,
    /// Place in the world.
    pub geometry: Geometry,
    /// What the world's axes mean.
    pub space: WorldSpace,
    /// Value = stored * scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Stored value that means "no data". NaN voxels are absent with or without it.
    pub nodata: Option<f64>,
    /// Unit of the values, empty where unknown.
    pub unit: String,
    /// The three axes, x first.
    pub axes: [Axis; 3],
    /// Geometry of a seismic survey, where there is one.
    pub survey: Option<Survey>,
    /// Axes in the order in which the file stores them, slowest first: reading whole runs of the last is cheapest.
    pub access_order: AccessOrder,
    /// What the reader noticed and a person should know, one sentence each: traces missing, header overridden, ...
    pub notes: Vec<String>,
    /// Bytes of memory that it takes as long as it is open.
    pub memory_bytes: u64,
    /// The files it is read from, the one that was asked for first; none where it is computed.
    pub files: Vec<SourceFile>,
    /// The folder that was asked for, where it is not a file.
    pub folder: Option<PathBuf>,
    /// What was said of how the files are to be read, where that decides what the voxels are: byte order, bytes that are left
    /// out, where line numbers stand; by the names of the command line's options. Builds that differ in it do not go on with one
    /// another, and manifests tell it.
    pub reading: Vec<(&'static str, String)>,
}

impl SourceInfo {
    /// A plain grid: identity geometry, no scale, x fastest, axes named x, y, z.
    #[must_use]
    pub fn plain(format: &'static str, dims: Dims, voxel_type: VoxelType) -> Self {
        Self {
            format,
            dims,
            voxel_type,
            geometry: Geometry::IDENTITY,
            space: WorldSpace::Unknown,
            scale: 1.0,
            offset: 0.0,
            nodata: None,
            unit: String::new(),
            axes: ["x", "y", "z"].map(|name| Axis { name: name.into(), unit: String::new() }),
            survey: None,
            access_order: AccessOrder::X_FASTEST,
            notes: Vec::new(),
            memory_bytes: 0,
            files: Vec::new(),
            folder: None,
            reading: Vec::new(),
        }
    }
}

/// Name and unit of one axis.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Axis {
    /// `x`, `inline`, `time`, ...
    pub name: String,
    /// Unit of the spacing along this axis: `mm`, `ms`, `m`, ...; empty where unknown.
    pub unit: String,
}

/// Axes from the slowest in the file to the fastest: `[2, 1, 0]` is x fastest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AccessOrder(pub [usize; 3]);

impl AccessOrder {
    /// x runs fastest, z slowest: raw, NRRD, NIfTI.
    pub const X_FASTEST: Self = Self([2, 1, 0]);
}
