//! Export of parts of a container to files for other programs.
//!
//! - [`extract`]: a box of voxels of one level, as a volume file;
//! - [`mesh`]: an isosurface, as a triangle mesh.
//!
//! The memory limit is a number of bytes. Output files appear only when they are whole (`supervol_files`).

pub mod extract;
pub mod mesh;
