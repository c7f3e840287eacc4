//! `supervol mesh`: the surface where a container has one value, as a mesh.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;
use supervol_format::{Container, Lod};
use supervol_preprocess::Existing;
use supervol_preprocess::mesh::{MeshOptions, MeshReport, mesh};
use supervol_preprocess::output::check_distinct;

use crate::failure::{Failure, with_container, with_output};
use crate::quantity::{self, WrittenBox};

/// Which surface, and where to.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container
    container: PathBuf,
    /// Value of the surface, in the data's own units
    #[arg(long, value_name = "V", allow_hyphen_values = true)]
    iso: f64,
    /// Level of detail, 0 the finest
    #[arg(long, default_value_t = 0)]
    level: u8,
    /// Voxels of that level, ends not included; all by default. What is left out is all that there is
    #[arg(long = "box", value_name = "I0:I1,J0:J1,K0:K1", value_parser = quantity::voxel_box)]
    voxels: Option<WrittenBox>,
    /// File to write: .ply, .stl (both binary) or .obj, in world coordinates
    #[arg(short, long)]
    output: PathBuf,
    /// Most memory to use
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
    /// Overwrite the output
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
    let options = MeshOptions {
        iso: arguments.iso,
        lod: Lod(arguments.level),
        voxels: arguments.voxels.map(|voxels| voxels.of_level(&container, Lod(arguments.level))),
        existing: if arguments.force { Existing::Replace } else { Existing::Keep },
        memory_bytes: arguments.memory,
    };
    check_distinct(&arguments.output, [path.as_path()])?;
    let MeshReport { vertices, triangles } = mesh(&container, &arguments.output, &options)?;
    let output = arguments.output.display();
    writeln!(crate::terminal::remarks(), "{output}: {triangles} triangles, {vertices} vertices").map_err(with_output)
}
