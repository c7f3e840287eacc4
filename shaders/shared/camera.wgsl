// Rays in the index space of a level, without ever holding an absolute coordinate in one f32.
//
// A point of a ray is `voxel + fraction + t * (direction + direction_low)`: the voxel is an integer, so that the offset
// to a nearby brick is exact. A ray moves its base point forward by whole strides of `config.stride_world`, a power of
// two: t, and with it the rounding of `t * direction`, stays small however large the volume is.

struct LevelRay {
    voxel: vec3<i32>,
    fraction: vec3<f32>,
    // Index offset per world length, and what its rounding took away.
    direction: vec3<f32>,
    direction_low: vec3<f32>,
}

// Bits of a stride's fraction that are multiplied as integers.
const STRIDE_BITS: u32 = 10u;

// The ray from its base point `strides` strides after its first point, at level 0.
fn ray_from(ray: GpuRay, strides: u32) -> LevelRay {
    // Multiplying by a power of two is exact, and so is splitting the product: into a whole number, some leading bits
    // of the fraction, and a rest so small that its rounding does not matter even millions of strides on. All three
    // have the stride's sign: rounding down would turn a small negative stride into -1 and a rounded fraction.
    let stride = ray.direction * config.stride_world;
    let whole = trunc(stride);
    let leading = trunc((stride - whole) * f32(1u << STRIDE_BITS));
    let rest = (stride - whole) - leading / f32(1u << STRIDE_BITS) + ray.direction_low * config.stride_world;
    let units = i32(strides) * vec3<i32>(leading);
    let part = vec3<f32>(units & vec3<i32>((1 << STRIDE_BITS) - 1)) / f32(1u << STRIDE_BITS);
    let fraction = ray.fraction + (part + f32(strides) * rest);
    let carry = floor(fraction);
    let voxel = ray.voxel
        + i32(strides) * vec3<i32>(whole)
        + vec3<i32>(units >> vec3<u32>(STRIDE_BITS))
        + vec3<i32>(carry);
    return LevelRay(voxel, fraction - carry, ray.direction, ray.direction_low);
}

// The same ray in the index space of a coarser level: `(p + 1/2) / scale - 1/2`.
fn ray_at_level(ray: LevelRay, level: u32) -> LevelRay {
    let shift = tables.levels[level].scale_log2;
    let scale = vec3<f32>(vec3<u32>(1u) << shift);
    // Shifting signed integers right rounds down, also below zero.
    let voxel = ray.voxel >> shift;
    let rest = vec3<f32>(ray.voxel - (voxel << shift));
    let fraction = (rest + ray.fraction + 0.5) / scale - 0.5;
    return LevelRay(voxel, fraction, ray.direction / scale, ray.direction_low / scale);
}

// Origin of the ray relative to a voxel.
fn origin_from(ray: LevelRay, voxel: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(ray.voxel - voxel) + ray.fraction;
}

// The leading 12 of the 24 bits of each number: products of two such numbers are exact.
fn leading_half(v: vec3<f32>) -> vec3<f32> {
    return bitcast<vec3<f32>>(bitcast<vec3<u32>>(v) & vec3<u32>(0xfffff000u));
}

// Point at t relative to a voxel nearby, with the rounding of the result rather than of the distance: the large parts,
// an integer and an exact product, cancel exactly.
fn point_from(ray: LevelRay, voxel: vec3<i32>, t: f32) -> vec3<f32> {
    let t_high = leading_half(vec3<f32>(t));
    let t_low = t - t_high;
    let high = leading_half(ray.direction);
    let low = ray.direction - high;
    let near = vec3<f32>(ray.voxel - voxel) + t_high * high;
    return near + (ray.fraction + (t_high * low + t_low * ray.direction + t * ray.direction_low));
}

// World length from the base point to the end of the ray's segment.
fn segment_end(ray: GpuRay, strides: u32) -> f32 {
    return f32(ray.strides - strides) * config.stride_world + ray.rest;
}

// Unit world vector along the ray.
fn world_direction(direction: vec3<f32>) -> vec3<f32> {
    return normalize(mat3x3<f32>(config.world_x, config.world_y, config.world_z) * direction);
}
