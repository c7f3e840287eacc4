//! Preview of a volume while its container is built: every n-th voxel, read once, in memory.
//!
//! A build has coarser levels only after it has read everything. Voxels at equal distances are available at once: they
//! need only a few slices of the source. They are samples, not averages: thin structures between them are missing, and
//! high frequencies are aliased. The viewer must label such a picture as a preview.

use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

use supervol_files::unfinished::UnfinishedFolder;
use supervol_format::canceller::Canceller;
use supervol_format::cast::{index, narrow};
use supervol_format::container::manifest::Source;
use supervol_format::file_order::boxes;
use supervol_format::{Container, Dims, VoxelBox};
use supervol_sources::input::file::SourceFile;
use supervol_sources::stop::check;
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

use crate::error::BuildError;
use crate::pipeline::build;
use crate::pipeline::options::BuildOptions;

/// Largest number of voxels of a preview: 4 Mi, built and drawn in a fraction of a second.
const VOXELS_LIMIT: u64 = 1 << 22;
/// Smaller volumes, by this factor, are built about as fast as a preview.
const WORTH_FACTOR: u64 = 8;
/// Time limit for reading a preview: some files deliver slices no faster than the whole volume.
const TIME_LIMIT: Duration = Duration::from_secs(4);
/// Largest read of the source in bytes; at least one row.
const BYTES_LIMIT: u64 = 16 << 20;

/// Every n-th voxel of a volume.
#[derive(Debug)]
pub struct Preview {
    /// The voxels, in memory, at their world positions in the volume.
    pub container: Container,
    /// Distance between preview voxels on each axis in voxels of the volume; voxel 0 is the volume's voxel 0.
    pub strides: [u64; 3],
}

impl Preview {
    /// Preview of a source; `None` if its container is built as fast, or reading is too slow. Temporary files go to
    /// `folder` and are removed.
    ///
    /// # Errors
    /// If the source cannot be read, the folder is not writable, or the canceller is set.
    pub fn of(source: &dyn VolumeSource, folder: &Path, canceller: &Canceller) -> Result<Option<Self>, BuildError> {
        let dims = source.info().dims;
        if dims.0.iter().map(|&n| u128::from(n)).product::<u128>() < u128::from(VOXELS_LIMIT * WORTH_FACTOR) {
            return Ok(None);
        }
        let strides = strides_of(dims);
        let Some(thinned) = Thinned::read(source, strides, Instant::now() + TIME_LIMIT, canceller)? else {
            return Ok(None);
        };
        let working = UnfinishedFolder::create_in(folder).map_err(|e| BuildError::write(folder, e))?;
        let path = working.path().join("preview.svol");
        let first = source.info().files.first().map(SourceFile::path).and_then(Path::file_name);
        let name = first.map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let origin = Source { format: source.info().format.into(), ..Source::computed(name) };
        let options = BuildOptions { canceller: canceller.clone(), ..BuildOptions::default() };
        build(&thinned, origin, &path, &options, &|_| ())?;
        let bytes = std::fs::read(&path).map_err(|e| BuildError::write(&path, e))?;
        let container = Container::from_source(Arc::new(bytes)).map_err(|e| BuildError::container(&path, e))?;
        Ok(Some(Self { container, strides }))
    }
}

/// Distances between preview voxels. The longest remaining axis is halved until the preview is small enough.
fn strides_of(dims: Dims) -> [u64; 3] {
    let mut strides = [1; 3];
    loop {
        let left: [u64; 3] = std::array::from_fn(|a| dims.0[a].div_ceil(strides[a]));
        if left.iter().map(|&n| u128::from(n)).product::<u128>() <= u128::from(VOXELS_LIMIT) {
            return strides;
        }
        let longest = (0..3).max_by_key(|&a| left[a]).expect("there are three axes");
        strides[longest] *= 2;
    }
}

/// Every n-th voxel of a source, in memory.
struct Thinned {
    info: SourceInfo,
    /// Packed, x fastest.
    voxels: Vec<u8>,
}

impl Thinned {
    /// Reads every n-th slice along the file's slowest axis and keeps every n-th voxel of it; `None` if that takes too
    /// long.
    fn read(
        source: &dyn VolumeSource,
        strides: [u64; 3],
        until: Instant,
        canceller: &Canceller,
    ) -> Result<Option<Self>, SourceError> {
        let info = thinned_info(source.info(), strides);
        let bytes = info.voxel_type.bytes();
        let dims = info.dims.0.map(index);
        let mut voxels = vec![0; dims.iter().product::<usize>() * bytes];
        let slowest = info.access_order.0[0];
        let whole = source.info().dims.full_box();
        let mut buffer = Vec::new();
        for slice in 0..info.dims.0[slowest] {
            let mut of_slice = whole;
            of_slice.start[slowest] = slice * strides[slowest];
            of_slice.end[slowest] = of_slice.start[slowest] + 1;
            for part in boxes(of_slice, BYTES_LIMIT / bytes as u64, u64::MAX) {
                check(canceller)?;
                if Instant::now() > until {
                    return Ok(None);
                }
                buffer.resize(part.voxels() * bytes, 0);
                source.read_box(part, &mut buffer)?;
                thin(part, &buffer, strides, (dims, bytes), &mut voxels);
            }
        }
        Ok(Some(Self { info, voxels }))
    }
}

/// Copies the voxels of a box at multiples of the strides.
fn thin(part: VoxelBox, from: &[u8], strides: [u64; 3], (dims, bytes): ([usize; 3], usize), to: &mut [u8]) {
    let extent = part.extent();
    let met = |a: usize| (part.start[a].div_ceil(strides[a])..).take_while(move |&k| k * strides[a] < part.end[a]);
    for z in met(2) {
        for y in met(1) {
            let [y_from, z_from] = [y * strides[1] - part.start[1], z * strides[2] - part.start[2]].map(index);
            let (row_from, row_to) =
                ((z_from * extent[1] + y_from) * extent[0], (index(z) * dims[1] + index(y)) * dims[0]);
            for x in met(0) {
                let at = (row_from + index(x * strides[0] - part.start[0])) * bytes;
                let target = (row_to + index(x)) * bytes;
                to[target..target + bytes].copy_from_slice(&from[at..at + bytes]);
            }
        }
    }
}

/// Description of a source after thinning.
fn thinned_info(info: &SourceInfo, strides: [u64; 3]) -> SourceInfo {
    let mut info = SourceInfo { files: Vec::new(), folder: None, memory_bytes: 0, ..info.clone() };
    for (a, stride) in strides.into_iter().enumerate() {
        info.dims.0[a] = info.dims.0[a].div_ceil(stride);
        info.geometry.spacing[a] *= stride as f64;
    }
    if let Some(survey) = &mut info.survey {
        for (lines, a) in [(&mut survey.crossline, 0), (&mut survey.inline, 1)] {
            lines.step *= narrow::<i64>(strides[a]);
            lines.count = info.dims.0[a];
        }
        survey.sample_interval *= strides[2] as f64;
        // The last line of the survey may be missing after thinning.
        survey.corners = None;
    }
    let [x, y, z] = strides;
    info.notes.push(format!("a preview: one of {x} x {y} x {z} voxels of the volume").into());
    info
}

impl VolumeSource for Thinned {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let (dims, bytes) = (self.info.dims.0, self.info.voxel_type.bytes());
        let row_bytes = voxels.extent()[0] * bytes;
        let rows = (voxels.start[2]..voxels.end[2]).flat_map(|z| (voxels.start[1]..voxels.end[1]).map(move |y| (y, z)));
        for (row, (y, z)) in out.chunks_exact_mut(row_bytes).zip(rows) {
            let at = index((z * dims[1] + y) * dims[0] + voxels.start[0]) * bytes;
            row.copy_from_slice(&self.voxels[at..at + row_bytes]);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use supervol_format::level_reader::LevelReader;
    use supervol_format::{Geometry, Lod, VoxelType};
    use supervol_sources::computed::Computed;
    use supervol_sources::{AccessOrder, LineNumbers, Survey};

    use super::*;

    /// 512 x 320 x 260 voxels whose values encode their positions.
    fn volume(order: [usize; 3]) -> Computed {
        let lines = |first, count| LineNumbers { first, step: 2, count };
        let survey = Survey {
            inline: lines(100, 320),
            crossline: lines(300, 512),
            corners: Some([[0.0, 0.0], [511.0, 0.0], [0.0, 319.0], [511.0, 319.0]]),
            first_sample: 8.0,
            ..Survey::plain([512, 320], 4.0)
        };
        Computed::new([512, 320, 260], VoxelType::U32, |[x, y, z]| (x + 1000 * y + 1_000_000 * z) as f64).with_info(
            |info| {
                info.access_order = AccessOrder(order);
                info.geometry = Geometry { spacing: [2.0, 3.0, 5.0], origin: [7.0, 8.0, 9.0], ..Geometry::IDENTITY };
                info.survey = Some(survey);
            },
        )
    }

    #[test]
    fn a_preview_has_voxels_of_the_volume_where_they_are() {
        let folder = tempfile::tempdir().unwrap();
        for order in [[2, 1, 0], [1, 0, 2]] {
            let source = volume(order);
            let preview = Preview::of(&source, folder.path(), &Canceller::default()).unwrap().unwrap();
            assert_eq!(preview.strides, [4, 2, 2]);
            let container = &preview.container;
            let level = container.pyramid().level_at(Lod(0));
            assert_eq!(level.dims, Dims([128, 160, 130]));
            let geometry = container.descriptor().geometry;
            assert_eq!((geometry.spacing, geometry.origin), ([8.0, 6.0, 10.0], [7.0, 8.0, 9.0]));
            let survey = Survey::of(container.manifest()).unwrap();
            assert_eq!(survey.scales(), [[300.0, 8.0], [100.0, 4.0], [8.0, 8.0]]);
            let place = VoxelBox { start: [65, 126, 60], end: [68, 160, 67] };
            let mut bytes = vec![0; place.voxels() * 4];
            LevelReader::new(container, Lod(0), 1 << 20).read_box(place, &mut bytes).unwrap();
            let [nx, ny, _] = place.extent();
            for (i, voxel) in bytes.chunks_exact(4).enumerate() {
                let local = [i % nx, i / nx % ny, i / nx / ny];
                let at: [u64; 3] = std::array::from_fn(|a| (place.start[a] + local[a] as u64) * preview.strides[a]);
                let expected = at[0] + 1000 * at[1] + 1_000_000 * at[2];
                assert_eq!(u64::from(u32::from_le_bytes(voxel.try_into().unwrap())), expected, "{at:?}, {order:?}");
            }
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "something is left");
    }

    #[test]
    fn there_is_none_of_what_is_small_or_slow() {
        let folder = tempfile::tempdir().unwrap();
        let small = Computed::new([256, 256, 256], VoxelType::U8, |_| 1.0);
        assert!(Preview::of(&small, folder.path(), &Canceller::default()).unwrap().is_none());
        let source = volume([2, 1, 0]);
        let read = Thinned::read(&source, [4, 2, 2], Instant::now() - Duration::from_secs(1), &Canceller::default());
        assert!(read.unwrap().is_none());
        let canceller = Canceller::default();
        canceller.cancel();
        assert!(Preview::of(&source, folder.path(), &canceller).unwrap_err().is_stopped());
    }
}
