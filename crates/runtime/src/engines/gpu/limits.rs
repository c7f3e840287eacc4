//! Sizes and limits that several files of the GPU backend and its shaders share. They depend on no other file.

/// Most cache textures: the number of texture bindings in the shader.
pub const TEXTURE_LIMIT: usize = 4;

/// Texels of the light table from a bin to the next one: three, and one that fills the cache line of 64 bytes.
pub const BIN_TEXELS: usize = LIGHT_TEXELS as usize;
/// The same, as shaders know it.
pub const LIGHT_TEXELS: u32 = 4;

/// Greatest root of a channel's share of the greatest channel, in the second texel of a bin.
pub const GREATEST_ROOT: u32 = 65_535;

/// Beyond everything, in world lengths.
pub const FAR: f32 = 1e30;
/// Distance by which a leap ends beyond a face, in voxels: a few roundings.
pub const LEAP_MARGIN: f32 = 2e-5;

/// Default bytes of graphics memory for all adapters except graphics cards.
pub const SHARED_MEMORY: u64 = 256 << 20;
