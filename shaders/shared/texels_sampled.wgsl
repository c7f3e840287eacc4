// Frequently fetched tables and voxels as sampled textures, which GPUs read through larger caches than storage
// textures. The alternative is texels_stored.wgsl.

// The transfer function in pieces (pieces.wgsl).
@group(0) @binding(4) var light_table: texture_2d<u32>;

// Stored voxels of slots: integers biased to unsigned, floats as their bits. Unused textures hold one texel.
@group(0) @binding(8) var cache_0: texture_3d<u32>;
@group(0) @binding(9) var cache_1: texture_3d<u32>;
@group(0) @binding(10) var cache_2: texture_3d<u32>;
@group(0) @binding(11) var cache_3: texture_3d<u32>;

fn light_texel_at(texel: vec2<u32>) -> vec4<u32> {
    return textureLoad(light_table, texel, 0);
}

fn cache_texel(number: u32, texel: vec3<i32>) -> vec4<u32> {
    switch min(number, TEXTURE_COUNT - 1u) {
        case 0u: { return textureLoad(cache_0, texel, 0); }
        case 1u: { return textureLoad(cache_1, texel, 0); }
        case 2u: { return textureLoad(cache_2, texel, 0); }
        default: { return textureLoad(cache_3, texel, 0); }
    }
}
