//! Online half of Supervol: what picture is wanted, and the ray casters that make it from resident bricks.
//!
//! Spaces: a ray runs in world space and its parameter t is a world length; fields live in index space, voxel
//! (i, j, k) at the point (i, j, k). Where a volume's numbers are extreme, lengths and values of a resolved scene have [`units`]
//! of their own. Values are in the data's own units, except inside a ray caster, where they are
//! *render values*: the same numbers moved by a constant so that `f32` resolves them ([`raycast::volume::ValueMap`]).
//!
//! In the order of the data path:
//! - [`volume`], [`facts`]: an open container, and what its header says of it; [`units`]: the units its pictures are computed in;
//! - [`scene`], [`preset`]: the scene file, and what it means for a given volume;
//! - [`slices`]: planes within the picture, and what image filters make of them;
//! - [`camera`], [`clip`]: pixels to rays, rays to segments;
//! - [`transfer_function`]: values to colour and opacity;
//! - [`lod`]: how fine a brick must be, by its size on screen and by its error;
//! - [`raycast`]: the reference integrator and the CPU ray caster;
//! - [`field`]: of which field a brick is: what the next two, and a device's page table, are keyed by;
//! - [`streamer`], [`cache`]: which bricks are wanted, reading and decoding them, where they are kept;
//! - [`options`], [`error`]: how pictures are made, and why there is none;
//! - [`frame`]: one frame: what it is made with, who makes it, and its passes;
//! - [`renderer`]: pictures one after the other, for whoever wants some; the only module that knows all the others;
//! - [`stop`]: when work stops that can be given up;
//! - [`counters`], [`stats`], [`process`]: what is counted, and what a frame cost;
//! - [`image`]: what a ray caster returns, and its files.
//!
//! This crate's ray casters open no file, wait for nothing, and never change what is resident.

pub mod cache;
pub mod camera;
pub mod camera_path;
pub mod clip;
pub mod counters;
pub mod error;
pub mod facts;
pub mod field;
pub mod frame;
pub mod gpu;
pub mod image;
pub mod lod;
pub mod options;
pub mod preset;
pub mod process;
pub mod raycast;
pub mod renderer;
pub mod scene;
pub mod slices;
pub mod stats;
pub mod stop;
pub mod streamer;
pub mod transfer_function;
pub mod units;
pub mod volume;
