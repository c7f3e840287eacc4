//! Description of a volume by its source: grid, voxels, placement in the world, notes.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use supervol_format::space::WorldSpace;
use supervol_format::survey::Survey;
use supervol_format::{Dims, Geometry, VoxelType};

use crate::Message;
use crate::input::file::SourceFile;

/// Description of a volume.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceInfo {
    /// `raw`, `nrrd`, `segy`, `nifti`, `npy`, `npz`, `metaimage`, `tiff`, `dicom`, `pictures`, `vtk`,
    /// `zarr`, `ome-zarr`, `n5`, `hdf5`, `bdv` or `synth`.
    pub format: &'static str,
    /// Number of voxels along x, y, z.
    pub dims: Dims,
    /// Type of the voxels that `read_box` hands out.
    pub voxel_type: VoxelType,
    /// Placement of the grid in the world.
    pub geometry: Geometry,
    /// Meaning of the world's axes.
    pub space: WorldSpace,
    /// Value = stored * scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Stored value that means "no data". NaN voxels are absent with or without it.
    pub nodata: Option<f64>,
    /// Unit of the values; empty if unknown.
    pub unit: String,
    /// Reason why the values are labels, if the file says so, as the end of a sentence.
    pub labels: Option<&'static str>,
    /// The three axes, x first.
    pub axes: [Axis; 3],
    /// Geometry of the seismic survey, for seismic data.
    pub survey: Option<Survey>,
    /// Axes in storage order, slowest first. Reading whole runs along the last one is cheapest.
    pub access_order: AccessOrder,
    /// Observations of the reader for the user: missing traces, an overridden header value, the default of a selection.
    pub notes: Vec<Message>,
    /// Memory of the open source, in bytes.
    pub memory_bytes: u64,
    /// Files of the volume, the opened one first; none for computed volumes.
    pub files: Vec<SourceFile>,
    /// The opened folder, if the volume is a folder.
    pub folder: Option<PathBuf>,
    /// Options that determine the voxel values, as (name, value): byte order, skipped bytes, places of line numbers. Also
    /// the `modality` of a DICOM file, which names the kind of data.
    /// A build continues an earlier build only if these are equal. Manifests contain them.
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
            labels: None,
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
    /// Unit of the spacing along this axis: `mm`, `ms`, `m`, ...; empty if unknown.
    pub unit: String,
}

/// Order of the axes in the file, slowest first: `[2, 1, 0]` is x fastest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AccessOrder(pub [usize; 3]);

impl AccessOrder {
    /// x runs fastest, z slowest: raw, NRRD, NIfTI.
    pub const X_FASTEST: Self = Self([2, 1, 0]);
}
