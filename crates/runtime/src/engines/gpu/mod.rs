//! The machinery of the GPU backend; `raycast::gpu` puts it together.
//!
//! - [`error`]: errors of the GPU backend;
//! - [`device`]: which adapter, which limits, and wgpu's errors as ours;
//! - [`layout`]: every struct and constant that Rust and WGSL share, defined once;
//! - [`shaders`]: the WGSL files, in the order in which they are joined;
//! - [`light_table`], [`light`]: the transfer function as rays integrate it, and the twins of the shader that does so;
//! - [`memory`]: bytes of everything, computed before anything is allocated;
//! - [`pipelines`]: the compute pipelines and what they bind;
//! - [`ray_parts`]: what solids leave of rays, found by the host;
//! - [`rays`]: pixels to rays that hold no large number in an `f32`;
//! - [`scene_tables`]: a scene as the shaders read it;
//! - [`slots`]: which brick sits in which slot, and who must leave;
//! - [`page_table`]: which of its entries is whose;
//! - [`cache`]: the cache textures, the page table and the macro ranges on the GPU;
//! - [`deviations`]: what bricks may be off by;
//! - [`table`]: what shaders look up at any place;
//! - [`twins`]: shader functions in Rust that nothing but tests calls;
//! - [`feedback`]: what the rays say: misses, uses, counters.
//!
//! Only core WebGPU is required: no optional feature, eight storage buffers, 3D textures of unsigned integers.

mod bricks;
pub mod cache;
pub mod caster;
pub mod deviations;
pub mod device;
pub mod error;
mod errors;
pub mod feedback;
pub mod layout;
pub mod light;
pub mod light_table;
pub mod memory;
pub mod page_table;
mod pass;
pub mod pipelines;
mod pixels;
pub mod ray_parts;
pub mod rays;
pub mod scene_tables;
pub mod shaders;
pub mod slots;
pub mod table;
pub mod twins;
