//! OME-Zarr 0.4 (Zarr 2) writer: a folder with one level, in chunks compressed by zstd, one file per chunk.
//!
//! Chunks are cubes of [`CHUNK_EDGE`] voxels; those at the ends are padded. Spacing, origin and units are written; the
//! format has no axis directions. The folder gets its name when it is whole.

use std::path::Path;

use rayon::prelude::*;
use serde_json::{Value, json};
use supervol_files::unfinished::UnfinishedFolder;
use supervol_files::{Existing, OutputError, folder_of};
use supervol_format::level_reader::LevelReader;
use supervol_format::{Container, VoxelBox, VoxelType, cast};
use supervol_preprocess::error::BuildError;
use supervol_sources::open::is_chunked;

use super::headers::{Place, numpy_name};
use super::{Extraction, Plan, scaled};

/// Edge of a chunk in voxels, unless an axis is shorter.
const CHUNK_EDGE: u64 = 64;
/// At this level compression keeps up with the disk; higher levels save little more.
const ZSTD_LEVEL: i32 = 3;

pub(super) fn write(
    container: &Container,
    output: &Path,
    what: &Extraction,
    (voxels, place): (VoxelBox, &Place<'_>),
) -> Result<(), BuildError> {
    check_free(output, what.existing)?;
    let write_error = |e| BuildError::write(output, e);
    let folder = UnfinishedFolder::create_in(folder_of(output)).map_err(write_error)?;
    let write_json = |name: &str, value: Value| std::fs::write(folder.path().join(name), value.to_string());
    std::fs::create_dir(folder.path().join("0")).map_err(write_error)?;
    write_json(".zgroup", json!({ "zarr_format": 2 })).map_err(write_error)?;
    write_json(".zattrs", attributes(place)).map_err(write_error)?;
    let extent = voxels.extent().map(|n| n as u64);
    let chunk = extent.map(|n| n.min(CHUNK_EDGE));
    write_json("0/.zarray", array(place.voxel_type, extent, chunk)).map_err(write_error)?;

    let descriptor = container.descriptor();
    let chunk_voxels = chunk.iter().product::<u64>();
    let plan = Plan::of_boxes(descriptor, place.voxel_type, what.memory_bytes, chunk_voxels)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(plan.threads).build();
    let pool = pool.map_err(|source| BuildError::Threads { threads: plan.threads, source })?;
    let reader = LevelReader::new(container, what.lod, plan.cache_bytes);
    let counts: [u64; 3] = std::array::from_fn(|a| extent[a].div_ceil(chunk[a]));
    let write_chunk = |number: u64| {
        let at = [number % counts[0], number / counts[0] % counts[1], number / counts[0] / counts[1]];
        let start = std::array::from_fn(|a| voxels.start[a] + at[a] * chunk[a]);
        let end = std::array::from_fn(|a| (start[a] + chunk[a]).min(voxels.end[a]));
        let part = VoxelBox { start, end };
        let mut bytes = vec![0; part.voxels() * descriptor.voxel_type.bytes()];
        reader.read_box(part, &mut bytes).map_err(|e| BuildError::container(container.path(), e))?;
        if super::needs_scaling(descriptor, place.voxel_type) {
            bytes = scaled(descriptor, &bytes, place.voxel_type);
        }
        let whole = filled_up(bytes, part.extent(), chunk, place.voxel_type.bytes());
        let path = folder.path().join(format!("0/{}/{}", at[2], at[1]));
        std::fs::create_dir_all(&path).map_err(write_error)?;
        let encoded = zstd::bulk::compress(&whole, ZSTD_LEVEL).map_err(write_error)?;
        std::fs::write(path.join(at[0].to_string()), encoded).map_err(write_error)
    };
    pool.install(|| (0..counts.iter().product()).into_par_iter().try_for_each(write_chunk))?;
    if output.is_dir() {
        // `check_free` has found that it is another Zarr and may be replaced.
        std::fs::remove_dir_all(output).map_err(write_error)?;
    }
    folder.publish(output).map_err(write_error)
}

/// Checks that the folder does not exist, or is another Zarr that may be replaced.
fn check_free(output: &Path, existing: Existing) -> Result<(), BuildError> {
    match output.symlink_metadata() {
        Err(_) => Ok(()),
        Ok(_) if existing != Existing::Replace => Err(OutputError::Exists { path: output.into() }.into()),
        Ok(found) if found.is_dir() && is_chunked(output) => Ok(()),
        Ok(_) => {
            let found = "something else than a Zarr, which a folder does not replace";
            Err(OutputError::NoFile { path: output.into(), found: found.into() }.into())
        }
    }
}

/// Voxels of a chunk at the end of the volume, padded with zeros.
fn filled_up(bytes: Vec<u8>, extent: [usize; 3], chunk: [u64; 3], voxel: usize) -> Vec<u8> {
    let chunk = chunk.map(cast::index);
    if extent == chunk {
        return bytes;
    }
    let mut whole = vec![0; chunk.iter().product::<usize>() * voxel];
    for (row, from) in bytes.chunks_exact(extent[0] * voxel).enumerate() {
        let (y, z) = (row % extent[1], row / extent[1]);
        let at = (z * chunk[1] + y) * chunk[0] * voxel;
        whole[at..at + from.len()].copy_from_slice(from);
    }
    whole
}

fn array(voxel_type: VoxelType, extent: [u64; 3], chunk: [u64; 3]) -> Value {
    let dtype = numpy_name(voxel_type);
    let reversed = |[x, y, z]: [u64; 3]| [z, y, x];
    json!({
        "zarr_format": 2, "shape": reversed(extent), "chunks": reversed(chunk), "dtype": dtype, "order": "C", "fill_value": 0,
        "filters": null, "compressor": { "id": "zstd", "level": ZSTD_LEVEL }, "dimension_separator": "/"
    })
}

fn attributes(place: &Place<'_>) -> Value {
    let axis = |name: &str| match unit_of(place.unit) {
        Some(unit) => json!({ "name": name, "type": "space", "unit": unit }),
        None => json!({ "name": name, "type": "space" }),
    };
    let reversed = |[x, y, z]: [f64; 3]| [z, y, x];
    let transforms = json!([
        { "type": "scale", "scale": reversed(place.geometry.spacing) },
        { "type": "translation", "translation": reversed(place.geometry.origin) }
    ]);
    let axes = ["z", "y", "x"].map(axis);
    json!({ "multiscales": [{
        "version": "0.4",
        "axes": axes,
        "datasets": [{ "path": "0", "coordinateTransformations": transforms }]
    }] })
}

/// Names of units in OME-Zarr.
fn unit_of(unit: &str) -> Option<&'static str> {
    Some(match unit {
        "nm" => "nanometer",
        "um" => "micrometer",
        "mm" => "millimeter",
        "cm" => "centimeter",
        "m" => "meter",
        "km" => "kilometer",
        "in" => "inch",
        "ft" => "foot",
        "A" => "angstrom",
        _ => return None,
    })
}
