//! Containers built of volume files and of voxels in memory.

use std::path::Path;

use supervol_files::folder_of;
use supervol_format::container::manifest::Source;
use supervol_format::voxel_type::Voxel;
use supervol_format::{Dims, VoxelBox, VoxelType, cast};
use supervol_preprocess::kept::Reading;
use supervol_preprocess::report::{BuildReport, Progress};
use supervol_preprocess::{BuildError, BuildOptions, build, identify_source};
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

use crate::error::Error;

/// Name of the format of voxels in memory, as manifests give it.
const IN_MEMORY: &str = "memory";

/// Builds a container of a volume file, or of a folder that is a volume.
///
/// `FILE:/NAME` names one array of a file that holds several. Compressed voxels are decoded into a file beside the output.
/// `on_progress` is called from any thread, many times a second.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let [input, output] = ["ramp.npy", "ramp.svol"].map(|name| folder.path().join(name));
/// # let header = b"\x93NUMPY\x01\x00\x76\x00{'descr': '|u1', 'fortran_order': False, 'shape': (4, 4, 4), }                                                          \n";
/// # std::fs::write(&input, [&header[..], &[7; 64]].concat())?;
/// use supervol::{BuildOptions, Volume};
///
/// let report = supervol::build_file(&input, &output, &BuildOptions::default(), &|_| {})?;
/// assert_eq!(report.levels[0].dims, [4, 4, 4]);
/// assert_eq!(Volume::open(&output)?.dims().0, [4, 4, 4]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If no reader knows the file, it cannot be read, the output exists or cannot be written, or the memory does not suffice.
pub fn build_file(
    input: impl AsRef<Path>,
    output: impl AsRef<Path>,
    options: &BuildOptions,
    on_progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuildReport, Error> {
    let (input, output) = (input.as_ref(), output.as_ref());
    let reading = Reading::default();
    let source = reading.open(input, folder_of(output)).map_err(BuildError::from)?;
    let origin = identify_source(input, &reading.options.selection, source.as_ref())?;
    Ok(build(source.as_ref(), origin, output, options, on_progress)?)
}

/// Builds a container of any [`VolumeSource`]; `name` is what the container's manifest calls it.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// # let output = folder.path().join("ramp.svol");
/// use supervol::{ArraySource, BuildOptions};
///
/// let voxels: Vec<u16> = (0..10 * 8 * 6).collect();
/// let source = ArraySource::new([10, 8, 6], voxels)?;
/// let report = supervol::build_source(&source, "ramp", &output, &BuildOptions::default(), &|_| {})?;
/// assert_eq!(report.source_bytes, 960);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// If the source cannot be read, the output exists or cannot be written, or the memory does not suffice.
pub fn build_source(
    source: &dyn VolumeSource,
    name: &str,
    output: impl AsRef<Path>,
    options: &BuildOptions,
    on_progress: &(dyn Fn(Progress) + Sync),
) -> Result<BuildReport, Error> {
    Ok(build(source, Source::computed(name), output.as_ref(), options, on_progress)?)
}

/// A volume whose voxels lie in memory, x contiguous, then y, then z.
///
/// ```
/// use supervol::ArraySource;
///
/// let source = ArraySource::new([2, 2, 2], vec![0.0f32; 8])?.with_info(|info| {
///     info.geometry.spacing = [0.7, 0.7, 1.2];
///     info.unit = "HU".into();
/// });
/// assert!(ArraySource::new([2, 2, 2], vec![0u8; 7]).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct ArraySource<V> {
    info: SourceInfo,
    voxels: Vec<V>,
}

impl<V: Voxel> ArraySource<V> {
    /// A volume of `dims` voxels along x, y and z.
    ///
    /// # Errors
    /// [`Error::Voxels`], if there are more or fewer voxels than the dims need.
    pub fn new(dims: [u64; 3], voxels: Vec<V>) -> Result<Self, Error> {
        let dims = Dims(dims);
        let (expected, found) = (dims.voxels().unwrap_or(u64::MAX), voxels.len() as u64);
        if expected != found {
            return Err(Error::Voxels { dims, expected, found });
        }
        let mut info = SourceInfo::plain(IN_MEMORY, dims, V::TYPE);
        info.memory_bytes = std::mem::size_of_val(&voxels[..]) as u64;
        Ok(Self { info, voxels })
    }

    /// The same volume with its description changed: spacing, unit, scale, nodata.
    ///
    /// Dims and voxel type stay what the voxels are.
    #[must_use]
    pub fn with_info(mut self, change: impl FnOnce(&mut SourceInfo)) -> Self {
        let (dims, voxel_type): (Dims, VoxelType) = (self.info.dims, self.info.voxel_type);
        change(&mut self.info);
        (self.info.dims, self.info.voxel_type) = (dims, voxel_type);
        self
    }
}

impl<V: Voxel> VolumeSource for ArraySource<V> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let [nx, ny, _] = self.info.dims.0;
        let [sx, sy, sz] = voxels.extent();
        let mut rows = out.chunks_exact_mut(sx * size_of::<V>());
        for (z, y) in (0..sz as u64).flat_map(|z| (0..sy as u64).map(move |y| (z, y))) {
            let [x, y, z] = [voxels.start[0], voxels.start[1] + y, voxels.start[2] + z];
            let first = cast::index(x + nx * (y + ny * z));
            let row = rows.next().expect("the caller's buffer holds exactly the box");
            for (voxel, to) in self.voxels[first..first + sx].iter().zip(row.chunks_exact_mut(size_of::<V>())) {
                voxel.write_le(to);
            }
        }
        Ok(())
    }
}
