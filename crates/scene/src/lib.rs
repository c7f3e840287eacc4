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
//! Modules, in the order in which they may use each other:
//!
//! - [`camera`], [`clip`], [`transfer_function`], [`slices`]: geometry and classification;
//! - [`facts`], [`units`], [`value_map`]: the volume, its units, and the values that engines see;
//! - [`spec`]: parts of a scene as JSON; [`camera_path`]: cameras of an animation;
//! - [`preset`]: defaults for everything that a scene leaves open;
//! - [`scene`]: the scene file, its checks, and its meaning for one volume;
//! - [`image`](mod@image): pictures and image files.
//!
//! This crate is pure: it starts no thread, knows no GPU, and opens no file but scenes, transfer functions, meshes and
//! images.

#![cfg_attr(
    test,
    allow(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        clippy::cast_sign_loss,
        reason = "tests use small numbers"
    )
)]

pub mod camera;
pub mod camera_path;
pub mod clip;
pub mod facts;
pub mod image;
pub mod preset;
pub mod scene;
pub mod slices;
pub mod spec;
pub mod transfer_function;
pub mod units;
pub mod value_map;
