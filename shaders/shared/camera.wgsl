// Rays in the index space of a level, without ever holding an absolute coordinate in one f32.
//
// A point of a ray is `voxel + fraction + t * direction`: the voxel is an integer, so that the offset to a nearby brick
// is exact. Long rays move their base point forward by whole strides of `config.stride_world`, a power of two: t, and
// with it the rounding of `t * direction`, stays small however large the volume is.

struct LevelRay {
    voxel: vec3<i32>,
    fraction: vec3<f32>,
    // Index offset per world length.
    direction: vec3<f32>,
}

// The ray from its base point `strides` strides after its first point, at level 0.
fn ray_from(ray: GpuRay, strides: u32) -> LevelRay {
    // Multiplying by a power of two is exact, and so is splitting the product.
    let stride = ray.direction * config.stride_world;
    let whole = floor(stride);
    let part = (stride - whole) + ray.direction_low * config.stride_world;
    let count = f32(strides);
    let offset = count * part;
    let carry = floor(ray.fraction + offset);
    let voxel = ray.voxel + i32(strides) * vec3<i32>(whole) + vec3<i32>(carry);
    return LevelRay(voxel, (ray.fraction + offset) - carry, ray.direction);
}

// The same ray in the index space of a coarser level: `(p + 1/2) / scale - 1/2`.
fn ray_at_level(ray: LevelRay, level: u32) -> LevelRay {
    let shift = tables.levels[level].scale_log2;
    let scale = vec3<f32>(vec3<u32>(1u) << shift);
    // Shifting signed integers right rounds down, also below zero.
    let voxel = ray.voxel >> shift;
    let rest = vec3<f32>(ray.voxel - (voxel << shift));
    return LevelRay(voxel, (rest + ray.fraction + 0.5) / scale - 0.5, ray.direction / scale);
}

// Origin of the ray relative to a voxel.
fn origin_from(ray: LevelRay, voxel: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(ray.voxel - voxel) + ray.fraction;
}

// World length from the base point to the end of the ray's segment.
fn segment_end(ray: GpuRay, strides: u32) -> f32 {
    return f32(ray.strides - strides) * config.stride_world + ray.rest;
}

// Unit world vector along the ray.
fn world_direction(direction: vec3<f32>) -> vec3<f32> {
    return normalize(mat3x3<f32>(config.world_x, config.world_y, config.world_z) * direction);
}
