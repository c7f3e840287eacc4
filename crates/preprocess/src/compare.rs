//! Comparison of a container's level 0 with its source, voxel by voxel.
//!
//! 1. Grid, voxel type, geometry, scale and offset are the same.
//! 2. Every voxel of an exact container is equal; with a step, every voxel is within its bound. Absent voxels are
//!    absent in both, whatever their bits.
//! 3. No brick's error bound is less than the greatest distance of a voxel that it owns. [`crate::verify`] cannot check
//!    this.
//!
//! Memory: the source's own, its voxels of some bricks, and one brick of the container with the decoder's buffers.

use std::path::Path;

use supervol_format::cast::index;
use supervol_format::codec::wavelet::DECODING_BYTES_PER_VOXEL;
use supervol_format::container::header::Descriptor;
use supervol_format::level_reader::BrickStore;
use supervol_format::voxel_type::voxels_as_f64;
use supervol_format::{BrickKey, Container, Lod, VoxelBox};
use supervol_sources::VolumeSource;

use crate::error::{BuildError, MemoryPurpose};
use crate::pipeline::plan::memory::{left_for_data, read_bytes};
use crate::pipeline::plan::tiles::tiles;

/// Bricks held at once: a record, its decompressed bytes, and the voxels; a row as doubles is smaller.
const BRICKS_AT_HAND: u64 = 3;

/// Result of a successful comparison.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compared {
    /// Number of voxels of level 0; all have been compared.
    pub voxels: u64,
    /// Greatest distance from the source in data units.
    pub greatest: f64,
    /// Largest distance that the container allows, in data units; 0 if it is exact.
    pub bound: f64,
}

/// Compares a container with its source. `on_progress` receives the number of compared bricks and of all bricks.
///
/// # Errors
/// The first voxel that differs by more than the container allows; a failure to read; too little memory.
pub fn compare(
    path: &Path,
    container: &Container,
    source: &dyn VolumeSource,
    memory_bytes: u64,
    on_progress: &dyn Fn(u64, u64),
) -> Result<Compared, BuildError> {
    let descriptor = container.descriptor();
    same_volume(path, descriptor, source)?;
    let (pyramid, voxel_type) = (&descriptor.pyramid, descriptor.voxel_type);
    let level = pyramid.level_at(Lod::FINEST);
    let brick = pyramid.largest_brick_bytes(voxel_type);
    let decoding = DECODING_BYTES_PER_VOXEL as u64 * brick / voxel_type.bytes() as u64;
    let fixed = source.info().memory_bytes + BRICKS_AT_HAND * brick + decoding;
    let of_tile = |size| read_bytes(pyramid, level, [1; 3], size, voxel_type);
    let needed = fixed + of_tile([1; 3]);
    let purpose = MemoryPurpose::Other("for the source, voxels of a brick from it, and the brick");
    let memory_bytes = left_for_data(memory_bytes, needed, purpose)?;
    let (mut done, total) = (0, level.brick_count());
    let mut compared = Compared { voxels: 0, greatest: 0.0, bound: descriptor.voxel_error() * descriptor.scale.abs() };
    for tile in tiles(level, source.info().access_order, &|size| fixed + of_tile(size) <= memory_bytes) {
        let voxels = tile.voxels(pyramid.layout().core(), level.dims, 0);
        let mut bytes = vec![0; voxels.voxels() * voxel_type.bytes()];
        source.read_box(voxels, &mut bytes)?;
        for brick in tile.bricks() {
            let key = BrickKey::new(Lod::FINEST, brick);
            let greatest = compare_brick(path, container, key, voxels, &bytes)?;
            compared.greatest = compared.greatest.max(greatest * descriptor.scale.abs());
            done += 1;
            on_progress(done, total);
        }
        compared.voxels += voxels.voxels() as u64;
    }
    Ok(compared)
}

/// Rule 1.
fn same_volume(path: &Path, descriptor: &Descriptor, source: &dyn VolumeSource) -> Result<(), BuildError> {
    let info = source.info();
    let said = [
        ("voxels", descriptor.dims().to_string(), info.dims.to_string()),
        ("type of voxels", descriptor.voxel_type.to_string(), info.voxel_type.to_string()),
        ("place in the world", format!("{:?}", descriptor.geometry), format!("{:?}", info.geometry)),
        ("scale of values", descriptor.scale.to_string(), info.scale.to_string()),
        ("offset of values", descriptor.offset.to_string(), info.offset.to_string()),
    ];
    match said.into_iter().find(|(_, found, expected)| found != expected) {
        None => Ok(()),
        Some((what, found, expected)) => {
            let rule = format!("level 0 against its source: {what}");
            Err(BuildError::Broken { path: path.into(), rule, expected, found })
        }
    }
}

/// Rules 2 and 3 for the voxels that a brick owns. Returns their greatest distance in stored units. `bytes` are the
/// source's voxels of the box `around`, which contains the brick's core.
fn compare_brick(
    path: &Path,
    container: &Container,
    key: BrickKey,
    around: VoxelBox,
    bytes: &[u8],
) -> Result<f64, BuildError> {
    let descriptor = container.descriptor();
    let (voxel_type, absence, size) = (descriptor.voxel_type, descriptor.absence, descriptor.voxel_type.bytes());
    let entry = container.entry(key).map_err(|e| BuildError::container(path, e))?;
    let stored = BrickStore::read_brick(container, key, Vec::new()).map_err(|e| BuildError::container(path, e))?;
    let [stored_x, stored_y, _] = container.pyramid().stored_extent(key);
    let core = container.pyramid().core_box(key);
    let apron = supervol_format::brick::APRON;
    let bound = descriptor.voxel_error();
    let mut greatest = 0.0f64;
    for z in core.start[2]..core.end[2] {
        for y in core.start[1]..core.end[1] {
            let theirs = row(around, [core.start[0], y, z]) * size;
            let [in_y, in_z] = [y - core.start[1], z - core.start[2]].map(index);
            let ours = (((in_z + apron) * stored_y + in_y + apron) * stored_x + apron) * size;
            let row_bytes = core.extent()[0] * size;
            let (theirs, ours) = (&bytes[theirs..theirs + row_bytes], &stored[ours..ours + row_bytes]);
            if theirs == ours {
                continue;
            }
            let values = voxels_as_f64(voxel_type, theirs).into_iter().zip(voxels_as_f64(voxel_type, ours));
            for (x, (expected, found)) in (core.start[0]..).zip(values) {
                let distance = match (absence.is_absent(expected), absence.is_absent(found)) {
                    (true, true) => 0.0,
                    (false, false) if expected == found => 0.0,
                    (false, false) => (expected - found).abs(),
                    _ => f64::INFINITY,
                };
                // Negated, so that a NaN distance counts as an error.
                if !(distance <= bound && distance <= entry.error) {
                    let rule = format!("{key}: voxel [{x}, {y}, {z}] against its source");
                    let within = if distance <= bound { entry.error } else { bound };
                    let expected = if within > 0.0 {
                        format!("{expected}, or at most {within} off")
                    } else {
                        expected.to_string()
                    };
                    return Err(BuildError::Broken { path: path.into(), rule, expected, found: found.to_string() });
                }
                greatest = greatest.max(distance);
            }
        }
    }
    Ok(greatest)
}

/// Number of a voxel in a box, x fastest.
fn row(around: VoxelBox, voxel: [u64; 3]) -> usize {
    let [nx, ny, _] = around.extent();
    let [x, y, z]: [usize; 3] = std::array::from_fn(|a| index(voxel[a] - around.start[a]));
    (z * ny + y) * nx + x
}
