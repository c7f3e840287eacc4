// Rays of pixels, and positions on them, without an absolute coordinate in a single f32.
//
// The origin of a ray and its stride (a fixed step along the ray) are fixed-point numbers that are linear in the pixel
// (engines/gpu/rays.rs). The point any number of strides from the origin is found exactly by integer arithmetic: a base
// point, given as voxel and fraction. The parameter t counts from the base point. So t, and the rounding error of
// `t * direction`, stay small however large the volume is.

// `whole + high * 2^-32 + low * 2^-64` for each axis.
struct Fixed3 {
    whole: vec3<i32>,
    high: vec3<u32>,
    low: vec3<u32>,
}

// One ray of the picture, in the index space of level 0.
struct PixelRay {
    origin: Fixed3,
    // Index offset of a stride, which is `config.stride` units of t.
    stride: Fixed3,
    // Index offset per unit of t, and its rounding error.
    direction: vec3<f32>,
    direction_low: vec3<f32>,
    // World length of one unit of t.
    length: f32,
}

// A ray in the index space of a level. Its points are `voxel + fraction + t * (direction + direction_low)`.
struct LevelRay {
    voxel: vec3<i32>,
    fraction: vec3<f32>,
    direction: vec3<f32>,
    direction_low: vec3<f32>,
    length: f32,
}

// Bits of a stride behind its binary point that are converted to a float at once. A stride is shorter than 16 voxels.
const STRIDE_BITS: u32 = 27u;

// The upper 32 bits of the 64 of each product.
fn high_product(a: vec3<u32>, n: u32) -> vec3<u32> {
    let half = vec3<u32>(0xffffu);
    let low = a & half;
    let high = a >> vec3<u32>(16u);
    let n_low = n & 0xffffu;
    let n_high = n >> 16u;
    let first = high * n_low + ((low * n_low) >> vec3<u32>(16u));
    let second = low * n_high + (first & half);
    return high * n_high + (first >> vec3<u32>(16u)) + (second >> vec3<u32>(16u));
}

// 1 if an unsigned sum is less than one of its terms, which means that it has overflowed, else 0.
fn carry_of(sum: vec3<u32>, summand: vec3<u32>) -> vec3<u32> {
    return select(vec3<u32>(0u), vec3<u32>(1u), sum < summand);
}

// `a + n * b`, exactly.
fn add_multiple(a: Fixed3, b: Fixed3, n: u32) -> Fixed3 {
    let low_product = b.low * n;
    let low = a.low + low_product;
    let high_product_low = b.high * n;
    let from_low = high_product(b.low, n);
    let carry = carry_of(low, low_product);
    let first = a.high + high_product_low;
    let second = first + from_low;
    let high = second + carry;
    let carries = carry_of(first, high_product_low) + carry_of(second, from_low) + carry_of(high, carry);
    let whole = a.whole + b.whole * i32(n) + vec3<i32>(high_product(b.high, n) + carries);
    return Fixed3(whole, high, low);
}

fn fixed_3(x: Fixed, y: Fixed, z: Fixed) -> Fixed3 {
    return Fixed3(vec3<i32>(x.whole, y.whole, z.whole), vec3<u32>(x.high, y.high, z.high), vec3<u32>(x.low, y.low, z.low));
}

// Three affine functions of the pixel, evaluated at a pixel.
fn at_pixel(x: Affine, y: Affine, z: Affine, pixel: vec2<u32>) -> Fixed3 {
    let row = add_multiple(fixed_3(x.base, y.base, z.base), fixed_3(x.per_y, y.per_y, z.per_y), pixel.y);
    return add_multiple(row, fixed_3(x.per_x, y.per_x, z.per_x), pixel.x);
}

// The fraction, in [0, 1).
fn fraction_of(f: Fixed3) -> vec3<f32> {
    // Only 24 bits, so that the conversion never rounds up to 1.
    return vec3<f32>(f.high >> vec3<u32>(8u)) * (1.0 / 16777216.0);
}

// Leading part of a stride that fits a float, and the rest; both in units of 2^-STRIDE_BITS.
fn split_stride(stride: Fixed3) -> array<vec3<f32>, 2> {
    let rest_bits = vec3<u32>(32u - STRIDE_BITS);
    let units = (stride.whole << vec3<u32>(STRIDE_BITS)) | vec3<i32>(stride.high >> rest_bits);
    let fraction = (stride.high << vec3<u32>(STRIDE_BITS)) | (stride.low >> rest_bits);
    let beyond = vec3<f32>(fraction) * (1.0 / 4294967296.0);
    let leading = vec3<f32>(units) + beyond;
    let whole = trunc(leading);
    return array<vec3<f32>, 2>(leading, vec3<f32>(units - vec3<i32>(whole)) + (beyond - (leading - whole)));
}

fn ray_of_pixel(pixel: vec2<u32>) -> PixelRay {
    let origin = at_pixel(scene.view.origin[0], scene.view.origin[1], scene.view.origin[2], pixel);
    let stride = at_pixel(scene.view.stride[0], scene.view.stride[1], scene.view.stride[2], pixel);
    let parts = split_stride(stride);
    let per_t = 1.0 / (f32(1u << STRIDE_BITS) * config.stride);
    let l = scene.view.length;
    let across = vec2<f32>(l.x + f32(pixel.x) * l.y, l.z + f32(pixel.y) * l.w);
    return PixelRay(origin, stride, parts[0] * per_t, parts[1] * per_t, sqrt(1.0 + dot(across, across)));
}

// The pixel of the ray with index `place`: tiles of 8 x 8, each in blocks of 4 x 2, row by row. Lanes that execute
// together then cast rays that are close to each other and pass through the same cells.
fn pixel_of(place: u32) -> vec2<u32> {
    let tile = place / WORKGROUP_RAYS;
    let lane = place % WORKGROUP_RAYS;
    let first = vec2<u32>(tile % scene.view.tiles_x, tile / scene.view.tiles_x) * 8u;
    let block = lane / 8u;
    let in_block = vec2<u32>(lane % 4u, lane / 4u % 2u);
    return first + vec2<u32>(block % 2u * 4u, block / 2u * 2u) + in_block + vec2<u32>(0u, scene.view.first_row);
}

// Index under which the ray of a pixel of the band is stored.
fn place_of(pixel: vec2<u32>) -> u32 {
    let in_band = pixel - vec2<u32>(0u, scene.view.first_row);
    let tile = in_band / 8u;
    let block = in_band / vec2<u32>(4u, 2u) % vec2<u32>(2u, 4u);
    let lane = 8u * (block.x + 2u * block.y) + 4u * (in_band.y % 2u) + in_band.x % 4u;
    return (tile.x + scene.view.tiles_x * tile.y) * WORKGROUP_RAYS + lane;
}

// The ray with its base point `strides` strides after its origin.
fn ray_from(ray: PixelRay, strides: u32) -> LevelRay {
    let base = add_multiple(ray.origin, ray.stride, strides);
    return LevelRay(base.whole, fraction_of(base), ray.direction, ray.direction_low, ray.length);
}

// The same ray in the index space of a coarser level: `(p + 1/2) / scale - 1/2`.
fn ray_at_level(ray: LevelRay, level: u32) -> LevelRay {
    let shift = scene.tables.levels[level].scale_log2;
    // Multiplication by a power of two is exact.
    let per_voxel = 1.0 / vec3<f32>(vec3<u32>(1u) << shift);
    // Shifting a signed integer right rounds down, also below zero.
    let voxel = ray.voxel >> shift;
    let rest = vec3<f32>(ray.voxel - (voxel << shift));
    let fraction = (rest + ray.fraction + 0.5) * per_voxel - 0.5;
    return LevelRay(voxel, fraction, ray.direction * per_voxel, ray.direction_low * per_voxel, ray.length);
}

// Base point of the ray relative to a voxel.
fn origin_from(ray: LevelRay, voxel: vec3<i32>) -> vec3<f32> {
    return vec3<f32>(ray.voxel - voxel) + ray.fraction;
}

// The leading 12 of the 24 significant bits of each number: products of two such numbers are exact.
fn leading_half(v: vec3<f32>) -> vec3<f32> {
    return bitcast<vec3<f32>>(bitcast<vec3<u32>>(v) & vec3<u32>(0xfffff000u));
}

// Point at t relative to a nearby voxel. The result has the rounding error of its own size, not of the distance: the
// large parts, an integer and an exact product, cancel exactly.
fn point_from(ray: LevelRay, voxel: vec3<i32>, t: f32) -> vec3<f32> {
    let t_high = leading_half(vec3<f32>(t));
    let t_low = t - t_high;
    let high = leading_half(ray.direction);
    let low = ray.direction - high;
    let near = vec3<f32>(ray.voxel - voxel) + t_high * high;
    return near + (ray.fraction + (t_high * low + t_low * ray.direction + t * ray.direction_low));
}

// Unit world vector along the ray.
fn world_direction(direction: vec3<f32>) -> vec3<f32> {
    return normalize(mat3x3<f32>(config.world_x, config.world_y, config.world_z) * direction);
}
