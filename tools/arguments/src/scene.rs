//! Scenes on the command line: a scene file, or the scene itself, and names of modes.

use std::path::Path;

use clap::ValueEnum;
use supervol_scene::scene::{Mode, Scene};

use crate::failure::Failure;

/// Rendering modes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ModeName {
    /// Direct volume rendering: emission and absorption
    Dvr,
    /// Maximum value along the ray
    Mip,
    /// Minimum value along the ray
    Minip,
    /// Mean value along the ray
    Mean,
    /// Isosurfaces
    Iso,
    /// Slices alone, without the volume
    Slice,
}

impl From<ModeName> for Mode {
    fn from(name: ModeName) -> Self {
        match name {
            ModeName::Dvr => Self::Dvr,
            ModeName::Mip => Self::Mip,
            ModeName::Minip => Self::Minip,
            ModeName::Mean => Self::Mean,
            ModeName::Iso => Self::Iso,
            ModeName::Slice => Self::Slice,
        }
    }
}

/// Text of a scene that is given in place of a file name.
fn written_out(file: &Path) -> Option<&str> {
    file.to_str().filter(|text| text.trim_start().starts_with('{'))
}

/// Name of the scene for error messages.
pub fn name_of_scene(file: &Path) -> &Path {
    if written_out(file).is_some() { Path::new("--scene") } else { file }
}

/// Reads a scene from a file or from the command line.
///
/// # Errors
/// If the file cannot be read, or its text is no scene.
pub fn read_scene(file: &Path) -> Result<Scene, Failure> {
    let text = match written_out(file) {
        Some(text) => text.to_owned(),
        None => crate::input::read_text(file, "a scene")?,
    };
    let file = name_of_scene(file);
    let scene = Scene::from_json(&text).map_err(|e| Failure::Command(format!("{}: {e}", file.display())));
    // Relative paths in a scene start at the folder of the scene file, wherever the printed scene is used.
    scene.map(|mut scene| {
        let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        scene.make_paths_relative_to(file.parent().unwrap_or_else(|| Path::new("")));
        scene
    })
}
