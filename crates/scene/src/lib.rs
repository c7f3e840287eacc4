//! Description of a picture: a scene, and its meaning for one volume.
//!
//! A [`scene::Scene`] is the file that a user writes. [`scene::Scene::resolve`] fills in everything that it leaves
//! open, by the [`facts`] of the volume and the [`preset`] for its kind of data. Engines draw the result, a
//! [`scene::ResolvedScene`].
//!
//! Spaces: cameras, clip shapes and rays live in world space; a ray's parameter t is a length there. Fields live in
//! index space, with voxel (i, j, k) at the point (i, j, k). A volume with extreme numbers gets lengths and values in
//! [`units`] of its own. Values are in the data's units, except render values ([`value_map`]), which are what transfer
//! functions are applied to.
//!
//! This crate is pure: it starts no thread, knows no GPU, and opens no file but scenes, transfer functions, meshes and
//! images.

pub mod camera;
pub mod camera_path;
pub mod clip;
pub mod facts;
pub mod image;
pub mod preset;
pub mod scene;
pub mod slices;
pub mod transfer_function;
pub mod units;
pub mod value_map;
