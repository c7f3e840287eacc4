//! `supervol extract`: writes voxels of a container to a file of another format.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::quantity;
use supervol_export::extract::{Extraction, extract};
use supervol_files::check_distinct;
use supervol_format::{Container, Lod, VoxelBox};
use supervol_preprocess::Existing;

use crate::look::places::{self, Crop};

/// Voxels to extract, and the file for them.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container to read
    container: PathBuf,
    #[command(flatten)]
    region: Region,
    /// File to write; its name ending selects the format: .npy, .raw, .nrrd, .nii, .nii.gz, .mha, .vti, .tif, .zarr
    /// or .sgy
    ///
    /// .npy has C order [z, y, x]. .raw is little endian. .tif keeps spacings, but neither origin nor directions.
    /// .zarr is an OME-Zarr folder, without directions. .sgy has traces along z, and the lines and coordinates of a
    /// survey.
    #[arg(short, long)]
    output: PathBuf,
    /// Memory limit, for example 4GiB
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Voxels of a container: a level and a box.
#[derive(Debug, Clone, Args)]
pub struct Region {
    /// Level of detail; 0 is the finest
    #[arg(long, default_value_t = 0)]
    level: u8,
    /// Box of voxels of that level, ends excluded, or ranges AXIS=FROM:TO,..., ends included [default: all]
    ///
    /// In a box, a missing start or end means the border of the volume. One number means one voxel: :,:,50 is a slice.
    /// Axes are those of --crop of `render`, for example inline=100:200,time=1000:1500. Voxels are taken if their
    /// centres lie in the range.
    #[arg(long = "box", value_name = "BOX", value_parser = places::crop, allow_hyphen_values = true)]
    voxels: Option<Crop>,
}

impl Region {
    /// Level and box; `None` means the whole level. The reader checks that the container has them.
    ///
    /// # Errors
    /// If a range names no axis, or holds no voxel.
    pub fn of(&self, container: &Container) -> Result<(Lod, Option<VoxelBox>), Failure> {
        let (lod, pyramid) = (Lod(self.level), container.pyramid());
        let level = pyramid.level_at(lod.min(pyramid.coarsest()));
        let voxels = self.voxels.as_ref().map(|voxels| voxels.of_level(container, level)).transpose()?;
        Ok((lod, voxels))
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.container;
    let container = Container::open(path).map_err(|e| with_container(path, e))?;
    let (lod, voxels) = arguments.region.of(&container)?;
    let what = Extraction {
        lod,
        voxels,
        existing: if arguments.force { Existing::Replace } else { Existing::Keep },
        memory_bytes: arguments.memory,
    };
    check_distinct(&arguments.output, [path.as_path()])?;
    let (voxels, voxel_type) = extract(&container, &arguments.output, &what)?;
    let [x, y, z] = voxels.extent();
    writeln!(
        supervol_arguments::terminal::remarks(),
        "{}: {x} x {y} x {z} {voxel_type} voxels",
        arguments.output.display()
    )
    .map_err(with_output)
}
