//! Volume files behind one trait: where voxels come from.
//!
//! A source knows its grid, its voxel type and its place in the world, and hands out any box of voxels. Voxels are
//! handed out little endian and packed, x fastest, whatever the file's own order is; nothing is rescaled (scale and
//! offset travel as metadata). A reader checks every length against the file before it allocates, and answers a wrong
//! file with what was expected, what was found, and where: never a panic.
//!
//! `read_box` may be called from several threads at once, and for boxes in any order; [`AccessOrder`] says which order
//! the file likes.

pub mod computed;
pub mod formats;
pub mod grid;
pub mod input;
pub mod open;
pub mod stop;
pub mod synthetic;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use supervol_format::container::manifest::Manifest;
use supervol_format::space::WorldSpace;
use supervol_format::{Dims, Geometry, VoxelBox, VoxelType};

use crate::input::file::SourceFile;

/// Byte order of the numbers in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Endian {
    /// Least significant byte first.
    Little,
    /// Most significant byte first.
    Big,
}

impl Endian {
    /// As options call it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Little => "little",
            Self::Big => "big",
        }
    }
}

impl std::fmt::Display for Endian {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} endian", self.name())
    }
}

/// A volume that can be read box by box.
pub trait VolumeSource: Send + Sync {
    /// What the source says about itself; constant.
    fn info(&self) -> &SourceInfo;

    /// Fills `out` with the voxels of `voxels`, little endian, packed, x fastest.
    ///
    /// # Errors
    /// If the file cannot be read, or holds something its header does not allow.
    ///
    /// # Panics
    /// If the box is not inside the grid or `out` has not exactly the box's bytes: both are the caller's mistakes.
    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError>;
}

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

/// Geometry of a seismic survey, as the trace headers give it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Survey {
    /// First inline number and step: inline of row j is `first + j * step`, step positive.
    pub inline: LineNumbers,
    /// The same for crosslines, along x.
    pub crossline: LineNumbers,
    /// World positions (CDP x, y, scaled) of the grid's corners (first il, first xl), (first il, last xl),
    /// (last il, first xl), (last il, last xl), where the headers give them.
    pub corners: Option<[[f64; 2]; 4]>,
    /// Sample interval along z, in the z axis's unit.
    pub sample_interval: f64,
    /// Position of the first sample along z (delay), in the z axis's unit.
    pub first_sample: f64,
    /// Traces of the grid that the file does not have.
    pub missing_traces: u64,
    /// Traces marked dead in their header (trace identification code 2).
    pub dead_traces: u64,
    /// The text header, 40 lines of 80 characters, decoded.
    pub text_header: String,
}

impl Survey {
    /// So many traces along x and y, of lines that are numbered from 1 on, in places that nobody has said; samples begin at 0.
    #[must_use]
    pub fn plain([crosslines, inlines]: [u64; 2], sample_interval: f64) -> Self {
        let lines = |count| LineNumbers { first: 1, step: 1, count };
        Self {
            inline: lines(inlines),
            crossline: lines(crosslines),
            corners: None,
            sample_interval,
            first_sample: 0.0,
            missing_traces: 0,
            dead_traces: 0,
            text_header: String::new(),
        }
    }

    /// The survey of a container; `None` where it holds none, or one that this program does not know.
    #[must_use]
    pub fn of(manifest: &Manifest) -> Option<Self> {
        manifest.survey.as_ref().and_then(|json| serde_json::from_value(json.value()).ok())
    }

    /// What each axis of the grid counts in, as (of index 0, from index to index): crossline numbers, inline numbers, and times or
    /// depths in the third axis's unit.
    #[must_use]
    pub fn scales(&self) -> [[f64; 2]; 3] {
        let lines = |lines: LineNumbers| [lines.first as f64, lines.step as f64];
        [lines(self.crossline), lines(self.inline), [self.first_sample, self.sample_interval]]
    }
}

/// Arithmetic progression of line numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineNumbers {
    /// Smallest number.
    pub first: i64,
    /// Distance between neighbours, positive.
    pub step: i64,
    /// How many.
    pub count: u64,
}

/// Why a file cannot be used. The message of each variant is complete; callers add nothing but the context they own.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum SourceError {
    /// The machine failed: exit code 3.
    #[error("cannot read {path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    /// Decoded voxels could not be kept: exit code 3.
    #[error("cannot keep decoded voxels in {folder}: {source}{}", supervol_files::advice(source))]
    Spool { folder: PathBuf, source: std::io::Error },
    /// The file breaks its format's rules: exit code 1.
    #[error("{path}: {location}: expected {expected}, found {found}")]
    Invalid { path: PathBuf, location: String, expected: String, found: String },
    /// The file is right but is not what we read; `advice` says what to do: exit code 1.
    #[error("{path}: {what}; {advice}")]
    Unsupported { path: PathBuf, what: String, advice: String },
    /// The file was not left alone: exit code 1.
    #[error("{path} changed while it was read: {what}. Build again when nothing writes to it")]
    Changed { path: PathBuf, what: String },
    /// Somebody wanted it to stop ([`crate::stop`]).
    #[error("stopped before anything was finished; nothing is kept")]
    Stopped,
    /// The options given contradict the file or each other: exit code 2.
    #[error("{0}")]
    Options(String),
}

impl SourceError {
    /// Shorthand for [`SourceError::Invalid`].
    pub fn invalid(
        path: &Path,
        location: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> Self {
        Self::Invalid { path: path.into(), location: location.into(), expected: expected.into(), found: found.into() }
    }

    /// Shorthand for [`SourceError::Unsupported`].
    pub fn unsupported(path: &Path, what: impl Into<String>, advice: impl Into<String>) -> Self {
        Self::Unsupported { path: path.into(), what: what.into(), advice: advice.into() }
    }

    /// Shorthand for [`SourceError::Spool`].
    pub fn spool(folder: &Path, source: std::io::Error) -> Self {
        Self::Spool { folder: folder.into(), source }
    }

    /// Shorthand for [`SourceError::Io`].
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), source }
    }
}
