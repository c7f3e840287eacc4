//! Sizes and limits that several files of the GPU backend and its shaders share. They depend on no other file.

/// Most cache textures: the number of texture bindings in the shader.
pub const TEXTURE_LIMIT: usize = 4;

/// Texels of a piece of the transfer function: three cache lines of 64 bytes, of which most cells read the first alone.
pub const PIECE_TEXELS: u32 = 12;

/// Beyond everything, in world lengths.
pub const FAR: f32 = 1e30;
/// Distance by which a leap ends beyond a face, in voxels: a few roundings.
pub const LEAP_MARGIN: f32 = 2e-5;

/// Default bytes of graphics memory for all adapters except graphics cards.
pub const SHARED_MEMORY: u64 = 256 << 20;
