//! `supervol synth`: writes a synthetic volume as a container or a raw file.

use std::io::Write;
use std::path::Path;

use clap::Args;
use supervol_arguments::failure::Failure;
use supervol_arguments::progress::Reporter;
use supervol_arguments::quantity::{self, Dtype, show_bytes};
use supervol_files::OutputFile;
use supervol_format::container::manifest::Source;
use supervol_format::file_order::boxes;
use supervol_format::{Dims, VoxelBox};
use supervol_preprocess::BuildError;
use supervol_sources::VolumeSource;
use supervol_sources::synthetic::{NAMES, Synthetic};

use crate::build::OutputArguments;

/// Synthetic volume, and its size.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Name of the volume
    #[arg(value_parser = NAMES)]
    name: String,
    /// Number of voxels along x, y and z, for example 512,512,300 or 512x512x300
    #[arg(long, value_name = "NX,NY,NZ", value_parser = quantity::dims)]
    dims: Dims,
    /// Voxel type, for example u8 or f32 [default: by volume]
    #[arg(long, value_name = "TYPE", value_parser = quantity::dtype)]
    dtype: Option<Dtype>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    output: OutputArguments,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let voxel_type = arguments.dtype.map(|d| d.voxel_type);
    let source =
        Synthetic::new(&arguments.name, arguments.dims, voxel_type, arguments.seed).map_err(BuildError::from)?;
    let output = arguments.output.named("a container (OUT.svol) or a raw file (OUT.raw)")?;
    if output.extension().is_some_and(|e| e == "raw") {
        return write_raw(arguments, output, &source);
    }
    let origin = Source::computed(format!("{} seed {}", arguments.name, arguments.seed));
    arguments.output.build(output, &source, origin)
}

/// Least and greatest number of bytes computed before they are written. More is not faster; less is slower.
const BATCH_BYTES: [u64; 2] = [64 << 10, 64 << 20];

/// Computes one box for each thread at a time. The file has a temporary name until it is complete.
fn write_raw(arguments: &Arguments, output: &Path, source: &dyn VolumeSource) -> Result<(), Failure> {
    use rayon::prelude::*;
    let write_error = |e| Failure::from(BuildError::write(output, e));
    let unfinished = OutputFile::begin(output, arguments.output.existing())?;
    let info = source.info();
    let voxel_bytes = info.voxel_type.bytes();
    let threads = rayon::current_num_threads();
    let batch_bytes = arguments.output.memory_bytes().clamp(BATCH_BYTES[0], BATCH_BYTES[1]);
    let mut boxes = boxes(info.dims.full_box(), batch_bytes / threads as u64 / voxel_bytes as u64, u64::MAX);
    let bar = Reporter::over_slices();
    bar.set_length(info.dims.0[2]);
    loop {
        let batch: Vec<VoxelBox> = boxes.by_ref().take(threads).collect();
        let Some(last) = batch.last() else { break };
        let make = |part: &VoxelBox| {
            let mut bytes = vec![0; part.voxels() * voxel_bytes];
            source.read_box(*part, &mut bytes).map(|()| bytes)
        };
        let made: Result<Vec<_>, _> = batch.par_iter().map(make).collect();
        for bytes in made.map_err(BuildError::from)? {
            unfinished.file().write_all(&bytes).map_err(write_error)?;
        }
        bar.set_position(last.end[2]);
    }
    bar.finish_and_clear();
    unfinished.publish()?;
    writeln!(
        supervol_arguments::terminal::remarks(),
        "{}: {} of {}, {} voxels, little endian",
        output.display(),
        show_bytes(info.dims.bytes(info.voxel_type).unwrap_or(u64::MAX)),
        info.voxel_type,
        info.dims
    )
    .map_err(supervol_arguments::failure::with_output)
}
