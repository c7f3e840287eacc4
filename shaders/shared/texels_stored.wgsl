// Frequently fetched tables and voxels as storage textures. They have no levels of detail, whose addresses software
// adapters compute at every fetch. The alternative is texels_sampled.wgsl.

// The transfer function in pieces (pieces.wgsl).
@group(0) @binding(4) var light_table: texture_storage_2d<rgba32uint, read>;

// Stored voxels of slots: integers biased to unsigned, floats as their bits. Unused textures hold one texel.
@group(0) @binding(8) var cache_0: texture_storage_3d<rgba32uint, read>;
@group(0) @binding(9) var cache_1: texture_storage_3d<rgba32uint, read>;
@group(0) @binding(10) var cache_2: texture_storage_3d<rgba32uint, read>;
@group(0) @binding(11) var cache_3: texture_storage_3d<rgba32uint, read>;

fn light_texel_at(texel: vec2<u32>) -> vec4<u32> {
    return textureLoad(light_table, texel);
}

fn cache_texel(number: u32, texel: vec3<i32>) -> vec4<u32> {
    switch min(number, TEXTURE_COUNT - 1u) {
        case 0u: { return textureLoad(cache_0, texel); }
        case 1u: { return textureLoad(cache_1, texel); }
        case 2u: { return textureLoad(cache_2, texel); }
        default: { return textureLoad(cache_3, texel); }
    }
}
