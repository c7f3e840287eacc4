// For tests against Rust twins: position on a ray, its brick, the page drawn there, and gradients of a cell.

struct PlaceCase {
    pixel: vec2<u32>,
    // Strides to the ray's base point.
    strides: u32,
    padding_0: u32,
    near: vec3<i32>,
    level: u32,
    cell: vec3<i32>,
    padding_1: u32,
    a: vec3<f32>,
    // Parameter of the position, relative to the base point.
    t: f32,
    b: vec3<f32>,
    padding_2: f32,
}

struct PlaceResult {
    voxel: vec3<i32>,
    found: u32,
    fraction: vec3<f32>,
    leave: f32,
    point: vec3<f32>,
    payload: u32,
    region: vec4<i32>,
    page: vec4<i32>,
    entry: vec4<u32>,
    // Index-space gradients at the beginning, the middle and the end of the chord; w: whether they are present.
    gradients: array<vec4<f32>, 3>,
    // Beginning and end of the segment.
    segment: vec2<f32>,
    segment_strides: vec2<u32>,
    length: f32,
    status: u32,
    place: u32,
    padding: u32,
}

@group(2) @binding(0) var<storage, read> place_cases: array<PlaceCase>;
@group(2) @binding(1) var<storage, read_write> place_results: array<PlaceResult>;

fn index_gradient(gradient: ChordGradient, u: f32) -> vec4<f32> {
    return vec4<f32>(cubic_at(gradient.x, u), cubic_at(gradient.y, u), cubic_at(gradient.z, u), f32(gradient.present));
}

@compute @workgroup_size(64)
fn test_places(@builtin(global_invocation_id) id: vec3<u32>) {
    // Invocations beyond the last case repeat the last one and write the same result.
    let number = min(id.x, arrayLength(&place_cases) - 1u);
    let c = place_cases[number];
    config = scene.config;
    let begin = begin_ray(c.pixel);
    let base = ray_from(ray_of_pixel(c.pixel), c.strides);
    let region = region_at(base, c.t);
    let slot = slot_at(0u);
    let gradient = chord_gradient(slot, c.cell, corners_of(slot, c.cell), Chord(c.a, c.b, 1.0));
    var result: PlaceResult;
    result.voxel = base.voxel;
    result.found = region.found;
    result.fraction = base.fraction;
    result.point = point_from(ray_at_level(base, c.level), c.near, c.t);
    result.region = vec4<i32>(region.brick, i32(region.level));
    if (region.found != 0u) {
        let page = page_of(region);
        result.leave = region_leave(base, region);
        result.page = vec4<i32>(page.brick, i32(page.level));
        result.entry = vec4<u32>(page.entry, page.state, 0u, 0u);
        result.payload = page.payload;
    }
    for (var i = 0; i < 3; i += 1) {
        result.gradients[i] = index_gradient(gradient, 0.5 * f32(i));
    }
    result.segment = vec2<f32>(begin.t, begin.end_rest);
    result.segment_strides = vec2<u32>(begin.strides, begin.end_strides);
    result.length = base.length;
    result.status = begin.status;
    result.place = place_of(c.pixel);
    place_results[number] = result;
}
