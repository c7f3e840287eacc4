//! Writes voxels of a container to plain files: npy, raw, NRRD, NIfTI, MetaImage, TIFF, VTK, OME-Zarr, SEG-Y.
//! `headers.rs` tells which placement each format states.
//!
//! Voxels are in the data's own units. Without a scale they have the stored type. Scaled 32- and 64-bit integer and
//! 64-bit float voxels become f64, all others f32, which holds every scaled 8- or 16-bit voxel to 24 bits. Absent
//! voxels of scaled volumes become NaN; unscaled ones keep the nodata value. Voxels are written within a memory limit,
//! whatever the box's shape: brick by brick (`by_brick`), or in file order where the output is compressed or a stream. The file has a temporary name until it is whole.

mod by_brick;
mod headers;
mod segy;
mod zarr;

use std::io::{BufWriter, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use supervol_files::{Existing, OutputFile};
use supervol_format::container::header::Descriptor;
use supervol_format::file_order::boxes;
use supervol_format::level_reader::LevelReader;
use supervol_format::space::WorldSpace;
use supervol_format::voxel_type::{Voxel, voxels_as_f64};
use supervol_format::{Container, Geometry, Lod, VoxelBox, VoxelType, cast};
use supervol_preprocess::error::{BuildError, MemoryPurpose};
use supervol_preprocess::level_reader::by_all_threads;
use supervol_preprocess::memory::left_for_data;

use headers::{Format, Place, TIFF_SLICES_LIMIT};

/// Size of the output buffer in bytes.
const WRITE_BUFFER_BYTES: usize = 1 << 20;
/// Smallest memory for voxels in flight, in bytes.
const LEAST_BOX_BYTES: u64 = 64 << 10;

/// Options of an extraction.
#[derive(Debug, Clone, Copy)]
pub struct Extraction {
    /// Level of detail.
    pub lod: Lod,
    /// Box in voxels of that level; `None`: all voxels.
    pub voxels: Option<VoxelBox>,
    /// Reaction to an existing output.
    pub existing: Existing,
    /// Largest memory to use, in bytes.
    pub memory_bytes: u64,
}

/// Writes voxels to `output`, whose extension determines the format. Returns the box and the voxel type written.
///
/// # Errors
/// If the level or box does not exist, the extension is unknown, a brick is unreadable or the output is not writable.
pub fn extract(container: &Container, output: &Path, what: &Extraction) -> Result<(VoxelBox, VoxelType), BuildError> {
    let name = output.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
    let Some((format, is_compressed)) = Format::of_name(&name) else {
        return Err(BuildError::Options(format!(
            "{}: expected an output ending in .npy, .raw, .nrrd, .nii, .nii.gz, .mha, .tif, .vti, .zarr or .sgy, found {}",
            output.display(),
            output.extension().map_or("none".into(), |end| format!(".{}", end.display()))
        )));
    };
    let voxels = checked_box(container, what.lod, what.voxels)?;
    let written_type = output_type(container.descriptor());
    let manifest = container.manifest();
    let place = Place {
        voxel_type: written_type,
        sizes: voxels.extent(),
        geometry: level_geometry(container, what.lod, voxels),
        space: WorldSpace::from_name(&manifest.space),
        unit: &manifest.axes[0].unit,
    };
    if format == Format::Tiff && place.sizes[2] > TIFF_SLICES_LIMIT {
        let found = place.sizes[2];
        let message = format!("{}: a TIFF has at most {TIFF_SLICES_LIMIT} slices, found {found}", output.display());
        return Err(BuildError::Options(message));
    }
    match format {
        Format::Zarr => return zarr::write(container, output, what, (voxels, &place)).map(|()| (voxels, written_type)),
        Format::Segy => return segy::write(container, output, what, (voxels, &place)).map(|()| (voxels, written_type)),
        _ => {}
    }
    let write_error = |e| BuildError::write(output, e);
    let file = OutputFile::begin(output, what.existing)?;
    // A TIFF's directories stay in memory until they are written.
    let trailer = place.trailer(format);
    let memory_bytes = what.memory_bytes.saturating_sub(trailer.len() as u64);
    let part = Extraction { memory_bytes, ..*what };
    if is_compressed || file.is_stream() {
        let mut plain = BufWriter::with_capacity(WRITE_BUFFER_BYTES, file.file());
        let whole = |out: &mut (dyn Write + Send)| {
            out.write_all(&place.header(format)).map_err(write_error)?;
            write_in_order(container, &part, (voxels, written_type), &mut |bytes| {
                out.write_all(bytes).map_err(write_error)
            })?;
            out.write_all(&trailer).map_err(write_error)
        };
        if is_compressed {
            let mut gzip = GzEncoder::new(&mut plain, Compression::fast());
            whole(&mut gzip)?;
            gzip.finish().map_err(write_error)?;
        } else {
            whole(&mut plain)?;
        }
        plain.flush().map_err(write_error)?;
    } else {
        let mut out = file.file();
        out.write_all(&place.header(format)).map_err(write_error)?;
        by_brick::write_bricks(container, &part, (voxels, written_type), &mut out, &write_error)?;
        out.write_all(&trailer).map_err(write_error)?;
    }
    file.publish()?;
    Ok((voxels, written_type))
}

/// The requested box of a level; by default the whole level.
///
/// # Errors
/// If the level does not exist, or the box is empty or leaves the level.
pub(crate) fn checked_box(container: &Container, lod: Lod, voxels: Option<VoxelBox>) -> Result<VoxelBox, BuildError> {
    let levels = container.pyramid().levels();
    let Some(level) = levels.get(usize::from(lod.0)) else {
        return Err(BuildError::Options(format!(
            "level {}: this container has levels 0 to {}",
            lod.0,
            levels.len() - 1
        )));
    };
    let voxels = voxels.unwrap_or(level.dims.full_box());
    if (0..3).any(|a| voxels.start[a] >= voxels.end[a] || voxels.end[a] > level.dims.0[a]) {
        return Err(BuildError::Options(format!(
            "box {voxels:?}: level {} has {} voxels, and a box needs some",
            lod.0, level.dims
        )));
    }
    Ok(voxels)
}

/// Voxel type of the output.
fn output_type(descriptor: &Descriptor) -> VoxelType {
    let unscaled = descriptor.scale == 1.0 && descriptor.offset == 0.0;
    match descriptor.voxel_type {
        t if unscaled => t,
        VoxelType::F64 | VoxelType::U32 | VoxelType::I32 => VoxelType::F64,
        _ => VoxelType::F32,
    }
}

/// Whether the written voxels differ from the stored ones.
fn needs_scaling(descriptor: &Descriptor, written_type: VoxelType) -> bool {
    written_type != descriptor.voxel_type || descriptor.scale != 1.0 || descriptor.offset != 0.0
}

/// Number of threads, and the division of the memory among the buffers.
struct Plan {
    threads: usize,
    /// Bytes of decoded bricks, besides those that threads work on.
    cache_bytes: usize,
    /// Voxels of a box that is read, scaled and written as one.
    box_voxels: u64,
}

impl Plan {
    /// Plan for formats that are written in boxes of at least `voxels` voxels, one box per thread.
    fn of_boxes(
        descriptor: &Descriptor,
        written_type: VoxelType,
        memory_bytes: u64,
        voxels: u64,
    ) -> Result<Self, BuildError> {
        // As stored, as doubles, as written, padded and encoded.
        let voxel = (descriptor.voxel_type.bytes() + size_of::<f64>() + 3 * written_type.bytes()) as u64;
        let fixed = |threads: usize| {
            LevelReader::working_bytes(descriptor, threads)
                + WRITE_BUFFER_BYTES as u64
                + threads as u64 * voxels * voxel
        };
        let (threads, rest) = Self::share_out(memory_bytes, LEAST_BOX_BYTES, fixed)?;
        Ok(Self { threads, cache_bytes: cast::index(rest / 2), box_voxels: voxels.max(rest / 2 / voxel) })
    }

    fn new(descriptor: &Descriptor, written_type: VoxelType, memory_bytes: u64) -> Result<Self, BuildError> {
        let fixed = |threads: usize| LevelReader::working_bytes(descriptor, threads) + WRITE_BUFFER_BYTES as u64;
        let (threads, rest) = Self::share_out(memory_bytes, 2 * LEAST_BOX_BYTES, fixed)?;
        // Scaled voxels exist as stored, as doubles and as written.
        let voxel = descriptor.voxel_type.bytes() + size_of::<f64>() + written_type.bytes();
        Ok(Self { threads, cache_bytes: cast::index(rest / 2), box_voxels: rest / 2 / voxel as u64 })
    }

    /// Number of threads that fit into the memory, and the bytes left for the cache and for voxels in flight, at least
    /// `least`. `fixed` gives the bytes that a number of threads takes.
    fn share_out(memory_bytes: u64, least: u64, fixed: impl Fn(usize) -> u64) -> Result<(usize, u64), BuildError> {
        let needed = fixed(1) + least;
        let purpose = MemoryPurpose::Other("to decode bricks on one thread and to write");
        let memory_bytes = left_for_data(memory_bytes, needed, purpose)?;
        // The threads take at most half of the memory.
        let fits = |threads: &usize| *threads == 1 || fixed(*threads) <= memory_bytes / 2;
        let threads = (1..=rayon::current_num_threads()).rev().find(fits).unwrap_or(1);
        Ok((threads, memory_bytes - fixed(threads)))
    }
}

/// Writes voxels in file order: for what cannot be sought.
fn write_in_order(
    container: &Container,
    what: &Extraction,
    (voxels, written_type): (VoxelBox, VoxelType),
    write: &mut (dyn FnMut(&[u8]) -> Result<(), BuildError> + Send),
) -> Result<(), BuildError> {
    let descriptor = container.descriptor();
    let size = descriptor.voxel_type.bytes();
    let plan = Plan::new(descriptor, written_type, what.memory_bytes)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build();
    let pool = pool.map_err(|source| BuildError::Threads { threads: plan.threads, source })?;
    let reader = by_all_threads(container, what.lod, plan.cache_bytes);
    pool.install(|| {
        for part in boxes(voxels, plan.box_voxels, container.pyramid().layout().core() as u64) {
            let mut bytes = vec![0; part.voxels() * size];
            reader.read_box(part, &mut bytes).map_err(|e| BuildError::container(container.path(), e))?;
            if needs_scaling(descriptor, written_type) {
                bytes = scaled(descriptor, &bytes, written_type);
            }
            write(&bytes)?;
        }
        Ok(())
    })
}

#[expect(clippy::cast_possible_truncation, reason = "rounding to the written type is wanted")]
fn scaled(descriptor: &Descriptor, stored: &[u8], written_type: VoxelType) -> Vec<u8> {
    let mut out = vec![0; stored.len() / descriptor.voxel_type.bytes() * written_type.bytes()];
    let values = voxels_as_f64(descriptor.voxel_type, stored)
        .into_iter()
        .map(|v| if descriptor.absence.is_absent(v) { f64::NAN } else { descriptor.value(v) });
    for (value, target) in values.zip(out.chunks_exact_mut(written_type.bytes())) {
        match written_type {
            VoxelType::F64 => value.write_le(target),
            _ => (value as f32).write_le(target),
        }
    }
    out
}

/// Geometry of a box of a level: the position of its first voxel, and the level's spacing.
pub(crate) fn level_geometry(container: &Container, lod: Lod, voxels: VoxelBox) -> Geometry {
    let base = container.descriptor().geometry;
    let scale = container.pyramid().level_at(lod).scale;
    // Level index point p lies at the level-0 point (p + 1/2) * scale - 1/2.
    let index: [f64; 3] = std::array::from_fn(|a| (voxels.start[a] as f64 + 0.5) * scale[a] as f64 - 0.5);
    let origin = base.world_from_index().transform_point3(glam::DVec3::from_array(index)).to_array();
    Geometry { spacing: std::array::from_fn(|a| base.spacing[a] * scale[a] as f64), origin, direction: base.direction }
}
