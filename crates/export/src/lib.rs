//! Parts of a container as files for other programs.
//!
//! - [`extract`]: a box of voxels of one level, as a volume file;
//! - [`mesh`]: an isosurface, as a triangle mesh.
//!
//! Memory is bounded by a number of bytes. Output files appear only when they are whole (`supervol_files`).

pub mod extract;
pub mod mesh;
