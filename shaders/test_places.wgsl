// For the tests: where a ray is, which brick that is, what is drawn there, and the gradients of a cell, to be compared
// with their Rust twins.

struct PlaceCase {
    ray: GpuRay,
    // Voxel of `level` near the place.
    near: vec3<i32>,
    level: u32,
    // Cell of the brick in slot 0.
    cell: vec3<i32>,
    // Strides to the ray's base point.
    strides: u32,
    // A chord of the cell, from `a` to `b`.
    a: vec3<f32>,
    // World length from the base point to the place.
    t: f32,
    b: vec3<f32>,
    padding: f32,
}

struct PlaceResult {
    // Base point.
    voxel: vec3<i32>,
    // Whether the place lies in a brick.
    found: u32,
    fraction: vec3<f32>,
    // Where the ray leaves the brick that holds the place, world length from the base point.
    leave: f32,
    // The place relative to `near`, in the index space of `level`.
    point: vec3<f32>,
    payload: u32,
    // Brick and level of detail that hold the place, and those that are drawn for them.
    region: vec4<i32>,
    page: vec4<i32>,
    // Number and state of the page.
    entry: vec4<u32>,
    // Index-space gradients at the begin, the middle and the end of the chord, and whether there are any.
    gradient_a: vec4<f32>,
    gradient_middle: vec4<f32>,
    gradient_b: vec4<f32>,
}

@group(2) @binding(0) var<storage, read> place_cases: array<PlaceCase>;
@group(2) @binding(1) var<storage, read_write> place_results: array<PlaceResult>;

fn index_gradient(gradient: ChordGradient, u: f32) -> vec4<f32> {
    let g = vec3<f32>(cubic_at(gradient.x, u), cubic_at(gradient.y, u), cubic_at(gradient.z, u));
    return vec4<f32>(g, f32(gradient.present));
}

@compute @workgroup_size(64)
fn test_places(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= arrayLength(&place_cases)) {
        return;
    }
    let c = place_cases[id.x];
    let base = ray_from(c.ray, c.strides);
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
    result.gradient_a = index_gradient(gradient, 0.0);
    result.gradient_middle = index_gradient(gradient, 0.5);
    result.gradient_b = index_gradient(gradient, 1.0);
    place_results[id.x] = result;
}
