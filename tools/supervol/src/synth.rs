//! `supervol synth`: synthetic volumes, as a container or as a raw file.

use std::io::Write;

use clap::Args;
use supervol_format::container::manifest::Source;
use supervol_format::{Dims, VoxelBox};
use supervol_preprocess::BuildError;
use supervol_preprocess::output::OutputFile;
use supervol_preprocess::source::VolumeSource;
use supervol_preprocess::source::synthetic::{NAMES, Synthetic};

use crate::build::OutputArguments;
use crate::failure::Failure;
use crate::progress::Reporter;
use crate::quantity::{self, Dtype, show_bytes};

/// Which volume, how large.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Name of the volume
    #[arg(value_parser = NAMES)]
    name: String,
    /// Voxels along x, y, z
    #[arg(long, value_name = "NX,NY,NZ", value_parser = quantity::dims)]
    dims: Dims,
    /// Voxel type; each volume has its own default
    #[arg(long, value_name = "TYPE", value_parser = quantity::dtype)]
    dtype: Option<Dtype>,
    /// Seed of everything that is random
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
    if arguments.output.output.extension().is_some_and(|e| e == "raw") {
        return write_raw(arguments, &source);
    }
    let origin = Source::computed(format!("{} seed {}", arguments.name, arguments.seed));
    arguments.output.build(&source, origin)
}

/// Bytes of one slab, unless a single slice is larger.
const SLAB_BYTES: usize = 64 << 20;

/// Writes slabs of whole z slices, a few MiB at a time, under a temporary name that the finished file loses.
fn write_raw(arguments: &Arguments, source: &dyn VolumeSource) -> Result<(), Failure> {
    use rayon::prelude::*;
    let output = &arguments.output.output;
    let write_error = |e| Failure::from(BuildError::Write { path: output.clone(), source: e });
    let unfinished = OutputFile::begin(output, arguments.output.existing())?;
    let info = source.info();
    let [nx, ny, nz] = info.dims.0;
    let slice_bytes = (nx * ny) as usize * info.voxel_type.bytes();
    let slices = (SLAB_BYTES / slice_bytes).max(1) as u64;
    let bar = Reporter::over_slices();
    bar.set_length(nz);
    let mut z = 0;
    while z < nz {
        let end = (z + slices).min(nz);
        let mut bytes = vec![0; (end - z) as usize * slice_bytes];
        bytes
            .par_chunks_mut(slice_bytes)
            .enumerate()
            .try_for_each(|(i, slice)| {
                let z = z + i as u64;
                source.read_box(VoxelBox { start: [0, 0, z], end: [nx, ny, z + 1] }, slice)
            })
            .map_err(BuildError::from)?;
        unfinished.file().write_all(&bytes).map_err(write_error)?;
        z = end;
        bar.set_position(z);
    }
    bar.finish_and_clear();
    unfinished.publish()?;
    writeln!(
        crate::terminal::stdout(),
        "{}: {} of {}, {} voxels, little endian",
        output.display(),
        show_bytes(nz * slice_bytes as u64),
        info.voxel_type,
        info.dims
    )
    .map_err(crate::failure::with_output)
}
