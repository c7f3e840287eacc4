//! `supervol mesh`: writes an isosurface of a container as a mesh.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::quantity;
use supervol_export::mesh::{MeshOptions, MeshReport, mesh};
use supervol_files::check_distinct;
use supervol_format::Container;
use supervol_preprocess::Existing;

use crate::extract::Region;

/// Surface, and the file for it.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container to read
    container: PathBuf,
    /// Data value of the surface, in the units of the data
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    iso: f64,
    #[command(flatten)]
    region: Region,
    /// File to write, in world coordinates: .ply, .stl (both binary) or .obj
    #[arg(short, long)]
    output: PathBuf,
    /// Memory limit, for example 4GiB
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.container;
    if !arguments.iso.is_finite() {
        return Err(Failure::Command(format!("--iso {}: expected a finite number", arguments.iso)));
    }
    let container = Container::open(path).map_err(|e| with_container(path, e))?;
    let (lod, voxels) = arguments.region.of(&container);
    let options = MeshOptions {
        iso: arguments.iso,
        lod,
        voxels,
        existing: if arguments.force { Existing::Replace } else { Existing::Keep },
        memory_bytes: arguments.memory,
    };
    check_distinct(&arguments.output, [path.as_path()])?;
    let MeshReport { vertices, triangles } = mesh(&container, &arguments.output, &options)?;
    let output = arguments.output.display();
    writeln!(supervol_arguments::terminal::remarks(), "{output}: {triangles} triangles, {vertices} vertices")
        .map_err(with_output)
}
