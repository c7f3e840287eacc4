//! Reading of a source's box by several threads, a z-slab each, if the file stores slabs one behind the other.
//!
//! The reading threads do not belong to the encoding pool. Encoding threads would otherwise wait for the disk while
//! there are bricks to encode.

use supervol_format::VoxelBox;
use supervol_sources::VolumeSource;

use crate::error::BuildError;

/// Fills `bytes` with the voxels of a box, as [`VolumeSource::read_box`] does.
///
/// # Errors
/// If the source cannot be read, or a thread cannot be started.
pub(crate) fn read_in_slabs(
    source: &dyn VolumeSource,
    threads: usize,
    voxels: VoxelBox,
    bytes: &mut [u8],
) -> Result<(), BuildError> {
    let [nx, ny, nz] = voxels.extent();
    if source.info().access_order.0[0] != 2 {
        return Ok(source.read_box(voxels, bytes)?);
    }
    let slab = nz.div_ceil(threads);
    let slab_bytes = slab * nx * ny * source.info().voxel_type.bytes();
    std::thread::scope(|scope| {
        let begin = |(i, part): (usize, _)| {
            let mut slab_box = voxels;
            slab_box.start[2] += (i * slab) as u64;
            slab_box.end[2] = (slab_box.start[2] + slab as u64).min(voxels.end[2]);
            let read = move || source.read_box(slab_box, part);
            std::thread::Builder::new().spawn_scoped(scope, read).map_err(BuildError::Thread)
        };
        let readers: Vec<_> = bytes.chunks_mut(slab_bytes).enumerate().map(begin).collect::<Result<_, _>>()?;
        readers.into_iter().try_for_each(|reader| match reader.join() {
            Ok(read) => Ok(read?),
            Err(panic) => std::panic::resume_unwind(panic),
        })
    })
}

#[cfg(test)]
mod tests {
    use supervol_format::VoxelType;
    use supervol_sources::computed::Computed;

    use super::*;

    #[test]
    fn slabs_are_what_is_read_at_once() {
        let source = Computed::new([9, 8, 7], VoxelType::U16, |[x, y, z]| (x + 10 * y + 100 * z) as f64);
        let voxels = VoxelBox { start: [1, 2, 1], end: [9, 7, 6] };
        let mut whole = vec![0; 2 * voxels.voxels()];
        source.read_box(voxels, &mut whole).expect("it is computed");
        for threads in 1..8 {
            let mut bytes = vec![0; whole.len()];
            read_in_slabs(&source, threads, voxels, &mut bytes).expect("it is computed");
            assert_eq!(bytes, whole, "{threads} threads");
        }
    }
}
