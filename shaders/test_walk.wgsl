// For tests: arithmetic of a ray's walk through bricks, on given numbers. Compared with Rust twins.

struct WalkCase {
    low: vec4<f32>,
    high: vec4<f32>,
    a_value: vec4<f32>,
    b_u: vec4<f32>,
    texel: vec4<u32>,
    slot: u32,
    place: vec2<u32>,
    place_in_row: u32,
    macro_cell: vec3<u32>,
    ray: u32,
    sides: u32,
    crossed: u32,
    present: u32,
    strides: u32,
}

struct WalkResult {
    // Sides of surfaces at u of a chord; number of Gauss pairs for shading.
    counts: vec4<u32>,
    values: vec4<f32>,
    // A ray in a brick: parameter per voxel and leap margin; parameter of plane 0 and extent per unit of t.
    inverse: vec4<f32>,
    offset: vec4<f32>,
    // The cell at a position and the length of the next part; the macro cell at that position.
    cell: vec4<f32>,
    macro_cell: vec4<f32>,
    // (least, greatest) corner, the field at u, and the u at which it first changes sides (2 if it does not).
    field: vec4<f32>,
    // The field of a cell of stored numbers, as values of the pieces and in render values.
    stored: vec4<f32>,
    gradient: vec4<f32>,
    cubic: vec4<f32>,
    normal: vec4<f32>,
    direction: vec4<f32>,
}

@group(2) @binding(0) var<storage, read> walk_cases: array<WalkCase>;
@group(2) @binding(1) var<storage, read_write> walk_results: array<WalkResult>;

fn ray_of_case(c: WalkCase) -> LocalRay {
    let level = LevelRay(vec3<i32>(0), vec3<f32>(0.0), c.b_u.xyz - 0.5, vec3<f32>(0.0), 1.0 + c.b_u.w);
    // Three of four rays run parallel to a plane.
    let direction = select(level.direction, vec3<f32>(0.0), vec3<u32>(0u, 1u, 2u) == vec3<u32>(c.ray % 4u));
    return LocalRay(32.0 * c.a_value.xyz - 1.0, direction, level, vec3<i32>(0), normalize(c.b_u.xyz), c.low.xyz);
}

@compute @workgroup_size(64)
fn test_walk(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= arrayLength(&walk_cases)) {
        return;
    }
    config = scene.config;
    let c = walk_cases[id.x];
    let u = c.b_u.w;
    let local = ray_of_case(c);
    let ray = light_ray(local, 40.0);
    let range = range_of_corners(Corners(c.low, c.high, c.low, c.high));
    let view = cell_view(Corners(c.low, c.high, c.low, c.high), range, Chord(c.a_value.xyz, c.b_u.xyz, 1.0));
    let gradient = ChordGradient(c.low, c.high, c.a_value, 1u);
    let cell = StoredCell(c.texel & vec4<u32>(0xffu), (c.texel >> vec4<u32>(8u)) & vec4<u32>(0xffu));
    let numbers = corners_of_stored(cell);
    let field = light_cell(cell, c.a_value.xyz, c.b_u.xyz);
    walk_results[id.x] = WalkResult(
        vec4<u32>(sides_at(view, u), shaded_pairs(gradient, 0.2 * u, u, local, c.a_value.w), 0u, 0u),
        values_of(cell.near),
        vec4<f32>(ray.inverse, ray.margin),
        vec4<f32>(ray.offset, ray.extent_per_t),
        vec4<f32>(cell_at(ray, 40.0 * u), next_size(c.low.x, 20.0 * c.low.y * c.low.y, c.low.z > 0.5)),
        vec4<f32>(vec3<f32>(macro_cell_at(local, 40.0 * u)), 0.0),
        vec4<f32>(range, value_at(view, u), min(first_change(view, c.a_value.w, c.present != 0u), 2.0)),
        vec4<f32>(value_in(field, c.a_value.xyz), trilinear(numbers.low, numbers.high, c.a_value.xyz), 0.0, 0.0),
        vec4<f32>(gradient_at(gradient, u, local), 0.0),
        vec4<f32>(cubic_of_gradient(gradient, local), 0.0),
        vec4<f32>(normal_at(gradient, u, local), 0.0),
        vec4<f32>(world_direction(local.level.direction), 0.0),
    );
}
