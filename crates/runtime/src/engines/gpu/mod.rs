//! The GPU backend; [`caster`] puts its parts together.
//!
//! - [`device`]: choice of the adapter, its limits, and wgpu's errors as ours;
//! - [`layout`]: every struct and constant that Rust and WGSL share, defined once;
//! - [`shaders`]: the WGSL files, in the order in which they are joined;
//! - [`light_table`], [`light`]: the transfer function in integrable form, and the twins of the shader that integrates
//!   it;
//! - [`memory`]: bytes of everything, computed before anything is allocated;
//! - [`pipelines`]: the compute pipelines and their bindings;
//! - [`ray_parts`]: parts of rays that solids leave, computed by the host;
//! - [`rays`]: rays of pixels, without large numbers in an `f32`;
//! - [`scene_tables`]: a scene in the form that shaders read;
//! - [`slots`]: bricks in slots, and eviction;
//! - [`page_table`]: entries of the page table by brick;
//! - [`cache`]: the cache textures, the page table and the macro ranges on the GPU;
//! - [`deviations`]: deviations of bricks from level 0;
//! - [`table`]: look-up tables of shaders;
//! - [`twins`]: Rust versions of shader functions, for tests only;
//! - [`feedback`]: misses, uses and counters of the rays.
//!
//! Only core WebGPU is required: no optional feature, eight storage buffers, 3D textures of unsigned integers.

mod bricks;
pub mod cache;
pub mod caster;
pub mod deviations;
pub mod device;
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
