//! Volumes computed from coordinates, and containers built from them.

use std::path::{Path, PathBuf};

use supervol_format::codec::CodecChoice;
use supervol_format::container::manifest::Source;
use supervol_format::random::mix;
use supervol_format::{BrickLayout, Container, VoxelBox, VoxelType};
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::report::BuildReport;
use supervol_preprocess::{BuildError, BuildOptions, Existing, MaxError, build};
use supervol_sources::computed::Computed;
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

/// Content of a field; values are in stored units and rounded to the voxel type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// 42 everywhere.
    Constant,
    /// Independent values over most of the type's range.
    Noise,
    /// Waves with a length of about ten voxels, and a little noise.
    Smooth,
    /// Waves with absent voxels: single ones, a slab, a ball. NaN and infinities in float types, the nodata value in
    /// integers.
    Holes,
    /// No present voxel.
    Absent,
    /// Zero except for thin shells.
    Shells,
}

impl Content {
    /// All contents.
    pub const ALL: [Self; 6] = [Self::Constant, Self::Noise, Self::Smooth, Self::Holes, Self::Absent, Self::Shells];
}

/// The nodata value of fields with absent voxels; every voxel type can represent it.
pub const NODATA: f64 = 17.0;

/// A volume computed voxel by voxel.
#[derive(Debug)]
pub struct Field(Computed);

impl Field {
    /// A field of any function of the voxel's coordinates.
    #[must_use]
    pub fn new(dims: [u64; 3], voxel_type: VoxelType, value: impl Fn([u64; 3]) -> f64 + Send + Sync + 'static) -> Self {
        Self(Computed::new(dims, voxel_type, value))
    }

    /// A field with this content.
    #[must_use]
    pub fn of(content: Content, dims: [u64; 3], voxel_type: VoxelType) -> Self {
        let (low, high) = amplitude(voxel_type);
        let noise = move |p: [u64; 3]| low + (high - low) * unit_noise(p);
        let smooth = move |p: [u64; 3]| {
            let [x, y, z] = p.map(|v| v as f64);
            let wave = (x * 0.61).sin() + (y * 0.47 + 1.0).sin() + (z * 0.71 + x * 0.2).cos();
            let share = 0.5 + 0.15 * wave + 0.01 * unit_noise(p);
            low + (high - low) * share
        };
        let holes = move |p: [u64; 3]| hole_at(p, dims, voxel_type).unwrap_or_else(|| away_from_nodata(smooth(p)));
        let shells = move |p: [u64; 3]| {
            let r2: u64 = p.iter().map(|v| v * v).sum();
            if r2 % 97 < 4 { high } else { 0.0 }
        };
        let nothing = if voxel_type.is_float() { f64::NAN } else { NODATA };
        let field = match content {
            Content::Constant => Self::new(dims, voxel_type, |_| 42.0),
            Content::Noise => Self::new(dims, voxel_type, noise),
            Content::Smooth => Self::new(dims, voxel_type, smooth),
            Content::Holes => Self::new(dims, voxel_type, holes),
            Content::Absent => Self::new(dims, voxel_type, move |_| nothing),
            Content::Shells => Self::new(dims, voxel_type, shells),
        };
        if matches!(content, Content::Holes | Content::Absent) {
            return field.with_info(|info| info.nodata = Some(NODATA));
        }
        field
    }

    /// The same field with changed metadata.
    #[must_use]
    pub fn with_info(self, change: impl FnOnce(&mut SourceInfo)) -> Self {
        Self(self.0.with_info(change))
    }

    /// All voxels, little endian, x fastest.
    ///
    /// # Panics
    /// Never: computed fields do not fail.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let all = self.info().dims.full_box();
        let mut out = vec![0; all.voxels() * self.info().voxel_type.bytes()];
        self.read_box(all, &mut out).expect("computing does not fail");
        out
    }
}

impl VolumeSource for Field {
    fn info(&self) -> &SourceInfo {
        self.0.info()
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        self.0.read_box(voxels, out)
    }
}

/// Most of the type's range. Floats are limited to values for which 24 bits resolve thousandths.
fn amplitude(voxel_type: VoxelType) -> (f64, f64) {
    if voxel_type.is_float() { (-5000.0, 5000.0) } else { voxel_type.limits() }
}

/// A value in `[0, 1)` that depends on the coordinates alone.
fn unit_noise(p: [u64; 3]) -> f64 {
    (mix(p[0] ^ mix(p[1] ^ mix(p[2]))) >> 11) as f64 / (1u64 << 53) as f64
}

fn away_from_nodata(value: f64) -> f64 {
    if (value - NODATA).abs() < 1.0 { NODATA + 2.0 } else { value }
}

/// The absent voxel at `p`, if there is one. Absent are one voxel in 31, a slab of three layers, and a ball.
fn hole_at(p: [u64; 3], dims: [u64; 3], voxel_type: VoxelType) -> Option<f64> {
    let from_middle: u64 = (0..3).map(|a| p[a].abs_diff(dims[a] / 2).pow(2)).sum();
    let hash = mix(p[0].wrapping_mul(3) ^ mix(p[1] ^ mix(p[2] ^ 5)));
    let in_slab = dims[2] > 12 && (9..12).contains(&p[2]);
    if !(hash.is_multiple_of(31) || in_slab || (dims[0] > 30 && from_middle < 100)) {
        return None;
    }
    let choices: &[f64] =
        if voxel_type.is_float() { &[f64::NAN, f64::INFINITY, f64::NEG_INFINITY, NODATA] } else { &[NODATA] };
    Some(choices[(hash >> 32) as usize % choices.len()])
}

/// Options that suit small test volumes.
#[must_use]
pub fn options(core: u32) -> BuildOptions {
    BuildOptions {
        layout: BrickLayout::new(core).expect("tests use one of the core sizes"),
        codec: CodecChoice::Smallest,
        max_error: MaxError::Exact,
        lod_axes: LodAxes::Xyz,
        reduce: Some(Reduce::Mean),
        memory_bytes: 1 << 30,
        threads: 2,
        existing: Existing::Keep,
        ..BuildOptions::default()
    }
}

/// Origin for the manifest of a synthetic volume.
#[must_use]
pub fn origin() -> Source {
    Source::computed("field")
}

/// A built container in a temporary folder, which is removed with it.
#[derive(Debug)]
pub struct Built {
    /// The folder.
    pub folder: tempfile::TempDir,
    /// Path of the container file.
    pub path: PathBuf,
    /// The open container.
    pub container: Container,
    /// Report of the build.
    pub report: BuildReport,
}

/// Builds a container of a volume.
///
/// # Errors
/// If the build fails or its result does not open.
pub fn try_build(source: &dyn VolumeSource, options: &BuildOptions) -> Result<Built, BuildError> {
    let folder = tempfile::tempdir().expect("tests need a temporary folder");
    let path = folder.path().join("out.svol");
    let report = build(source, origin(), &path, options, &|_| ())?;
    let container = open(&path)?;
    Ok(Built { folder, path, container, report })
}

fn open(path: &Path) -> Result<Container, BuildError> {
    Container::open(path).map_err(|source| BuildError::Container { path: path.into(), source })
}

/// As [`try_build`], for volumes whose build must succeed.
///
/// # Panics
/// If the build fails, with its message.
#[must_use]
pub fn built(source: &dyn VolumeSource, options: &BuildOptions) -> Built {
    try_build(source, options).unwrap_or_else(|e| panic!("{:?} with {options:?}: {e}", source.info()))
}
