//! The GPU backend; [`caster`] puts its parts together.
//!
//! Builds without the feature `gpu` have no device (`no_device.rs`), errors and limits, and nothing else of this.
//!
//! - [`error`], [`hardware`]: errors of the GPU backend; whether it is worth asking for a device;
//! - [`limits`], `texels`: sizes that several files share; how voxels are packed into texels;
//! - `layout`: every struct and constant that Rust and WGSL share, defined once;
//! - `shaders`: the WGSL files, in the order in which they are joined;
//! - `pipelines`, [`device`]: the compute pipelines and what they bind; which adapter, which limits, and wgpu's errors as ours;
//! - `light_table`, `light`: the transfer function as rays integrate it, and the twins of the shader that does so;
//! - `memory`: bytes of everything, computed before anything is allocated;
//! - `rays`, `ray_parts`: pixels to rays that hold no large number in an `f32`; what solids leave of rays, found by the host;
//! - `table`, `scene_tables`: what shaders look up at any place; a scene as the shaders read it;
//! - `slots`, `page_table`: which brick sits in which slot, and who must leave; which entry is whose;
//! - `deviations`: what bricks may be off by;
//! - `cache`: the cache textures, the page table and the macro ranges on the GPU;
//! - `feedback`: what the rays say: misses, uses, counters;
//! - `pixels`, `pass`, `read_back`: buffers of pixels, the dispatches of a pass, what rays have gathered;
//! - `options`, `picture`, `caster`, `errors`: one picture, the renderer that makes it, and what it may be off by;
//! - `engine`: the renderer as an engine of frames;
//! - `twins`: shader functions in Rust that nothing but tests calls.
//!
//! Only core WebGPU is required: no optional feature, eight storage buffers, 3D textures of unsigned integers.

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
#[cfg(feature = "gpu")]
pub mod light;
#[cfg(feature = "gpu")]
pub mod light_table;
pub mod limits;
#[cfg(feature = "gpu")]
pub mod memory;
#[cfg(feature = "gpu")]
pub mod options;
#[cfg(feature = "gpu")]
pub mod page_table;
#[cfg(feature = "gpu")]
mod pass;
#[cfg(feature = "gpu")]
pub mod picture;
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
