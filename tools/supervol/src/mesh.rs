//! `supervol mesh`: writes an isosurface of a container as a mesh.

use std::io::Write;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::quantity;
use supervol_export::mesh::{MeshOptions, MeshReport, mesh};
use supervol_files::check_distinct;
use supervol_format::Container;
use supervol_format::coordinates::Coordinates;
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
    /// File to write: .ply, .stl (both binary) or .obj
    #[arg(short, long)]
    output: PathBuf,
    /// Coordinates of the vertices of surveys; other volumes have world coordinates
    #[arg(long, value_enum, default_value = "map")]
    coordinates: CoordinatesName,
    /// Memory limit, for example 4GiB
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    memory: u64,
    /// Overwrite the output file
    #[arg(long)]
    force: bool,
}

/// Coordinates of a survey.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum CoordinatesName {
    /// Easting, northing, and time or depth downwards, if the survey has positions on the map; else local
    Map,
    /// Lengths from the first line, as in pictures and in meshes for --clip of `render`
    Local,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.container;
    if !arguments.iso.is_finite() {
        return Err(Failure::Command(format!("--iso {}: expected a finite number", arguments.iso)));
    }
    let container = Container::open(path).map_err(|e| with_container(path, e))?;
    let (lod, voxels) = arguments.region.of(&container)?;
    let options = MeshOptions {
        iso: arguments.iso,
        lod,
        voxels,
        existing: if arguments.force { Existing::Replace } else { Existing::Keep },
        memory_bytes: arguments.memory,
    };
    check_distinct(&arguments.output, [path.as_path()])?;
    let map = Coordinates::of(&container).map().filter(|_| arguments.coordinates == CoordinatesName::Map);
    let container = match map {
        Some(map) => container.placed(map),
        None => container,
    };
    let MeshReport { vertices, triangles } = mesh(&container, &arguments.output, &options)?;
    let output = arguments.output.display();
    writeln!(supervol_arguments::terminal::remarks(), "{output}: {triangles} triangles, {vertices} vertices")
        .map_err(with_output)
}
