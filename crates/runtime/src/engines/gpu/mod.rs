//! The GPU backend; [`caster`] puts its parts together.
//!
//! Builds without the feature `gpu` have only errors, limits and a device type without values (`no_device.rs`).
//!
//! - [`error`], [`hardware`]: errors of the GPU backend; whether the machine may have a hardware GPU;
//! - [`limits`], `texels`: sizes that several files share; the packing of voxels into texels;
//! - `layout`, `borrowed`: every struct and constant that Rust and WGSL share, defined once;
//! - `shaders`: the WGSL files, in the order in which they are joined;
//! - `pipelines`, [`device`]: the compute pipelines and their bindings; choice of the adapter, its limits, wgpu's errors
//!   as ours;
//! - `piece_table`: the transfer function in the form that rays integrate;
//! - `memory`: bytes of everything, computed before anything is allocated;
//! - `rays`, `ray_parts`: pixels to rays without large numbers in an `f32`; parts of rays that solids leave, computed by
//!   the host;
//! - `table`, `scene_tables`: look-up tables of shaders; a scene in the form that shaders read;
//! - `slots`, `page_table`: bricks in slots and the order of eviction; the entry of each brick;
//! - `deviations`: errors of bricks from coarser levels;
//! - `bricks`, `cache`: contents of a slot; the cache textures, the page table and the macro ranges on the GPU;
//! - `feedback`: misses, uses and counters of a pass;
//! - `pixels`, `pass`, `read_back`: buffers of pixels, the dispatches of a pass, read-back of the finished rays;
//! - `options`, `picture`, `caster`, `errors`: one picture, the renderer that makes it, and its errors;
//! - `engine`: the renderer as an engine of frames;
//! - `twins`, `part_twins`: shader functions in Rust that only tests call.
//!
//! Only core WebGPU is required: no optional feature, eight storage buffers, 3D textures of unsigned integers.

#[cfg(feature = "gpu")]
mod borrowed;
#[cfg(feature = "gpu")]
mod bricks;
#[cfg(feature = "gpu")]
pub mod cache;
#[cfg(feature = "gpu")]
pub mod caster;
#[cfg(feature = "gpu")]
pub mod deviations;
#[cfg_attr(not(feature = "gpu"), path = "no_device.rs")]
pub mod device;
#[cfg(feature = "gpu")]
pub(crate) mod engine;
pub mod error;
#[cfg(feature = "gpu")]
pub mod errors;
#[cfg(feature = "gpu")]
pub mod feedback;
pub mod hardware;
#[cfg(feature = "gpu")]
pub mod layout;
pub mod limits;
#[cfg(feature = "gpu")]
pub mod memory;
#[cfg(feature = "gpu")]
pub mod options;
#[cfg(feature = "gpu")]
pub mod page_table;
#[cfg(feature = "gpu")]
pub mod part_twins;
#[cfg(feature = "gpu")]
mod pass;
#[cfg(feature = "gpu")]
pub mod picture;
#[cfg(feature = "gpu")]
pub mod piece_table;
#[cfg(feature = "gpu")]
pub mod pipelines;
#[cfg(feature = "gpu")]
mod pixels;
#[cfg(feature = "gpu")]
pub mod ray_parts;
#[cfg(feature = "gpu")]
pub mod rays;
#[cfg(feature = "gpu")]
mod read_back;
#[cfg(feature = "gpu")]
pub mod scene_tables;
#[cfg(feature = "gpu")]
pub mod shaders;
#[cfg(feature = "gpu")]
pub mod slots;
#[cfg(feature = "gpu")]
pub mod table;
#[cfg(feature = "gpu")]
pub mod texels;
#[cfg(feature = "gpu")]
pub mod twins;
