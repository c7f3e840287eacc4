//! The machinery of the GPU backend; `raycast::gpu` puts it together.
//!
//! - [`error`]: errors of the GPU backend;
//! - [`limits`], [`texels`]: sizes that several files share; how voxels are packed into texels;
//! - [`layout`]: every struct and constant that Rust and WGSL share, defined once;
//! - [`shaders`]: the WGSL files, in the order in which they are joined;
//! - [`pipelines`], [`device`]: the compute pipelines and what they bind; which adapter, which limits, and wgpu's errors as ours;
//! - [`light_table`], [`light`]: the transfer function as rays integrate it, and the twins of the shader that does so;
//! - [`memory`]: bytes of everything, computed before anything is allocated;
//! - [`rays`], [`ray_parts`]: pixels to rays that hold no large number in an `f32`; what solids leave of rays, found by the host;
//! - [`table`], [`scene_tables`]: what shaders look up at any place; a scene as the shaders read it;
//! - [`slots`], [`page_table`]: which brick sits in which slot, and who must leave; which entry is whose;
//! - [`deviations`]: what bricks may be off by;
//! - [`cache`]: the cache textures, the page table and the macro ranges on the GPU;
//! - [`feedback`]: what the rays say: misses, uses, counters;
//! - `pixels`, `pass`, `read_back`: buffers of pixels, the dispatches of a pass, what rays have gathered;
//! - [`options`], [`picture`], [`caster`], [`errors`]: one picture, the renderer that makes it, and what it may be off by;
//! - [`twins`]: shader functions in Rust that nothing but tests calls.
//!
//! Only core WebGPU is required: no optional feature, eight storage buffers, 3D textures of unsigned integers.

mod bricks;
pub mod cache;
pub mod caster;
pub mod deviations;
pub mod device;
pub mod error;
pub mod errors;
pub mod feedback;
pub mod layout;
pub mod light;
pub mod light_table;
pub mod limits;
pub mod memory;
pub mod options;
pub mod page_table;
mod pass;
pub mod picture;
pub mod pipelines;
mod pixels;
pub mod ray_parts;
pub mod rays;
mod read_back;
pub mod scene_tables;
pub mod shaders;
pub mod slots;
pub mod table;
pub mod texels;
pub mod twins;
