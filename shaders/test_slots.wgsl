// For tests: texel positions, surface bits and strides, on given numbers. Compared with Rust twins.

// Same layout as `WalkCase` in test_walk.wgsl.
struct SlotCase {
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

struct SlotResult {
    // Slot: texture and first texel. Square: four bytes of a texel.
    slot: vec4<u32>,
    square: vec4<u32>,
    // Two 16-bit numbers of a texel; pixel of a stored ray.
    pair: vec4<u32>,
    // Sides of a value, bits of all surfaces, whether surfaces are met, index of the macro cell.
    surfaces: vec4<u32>,
    // Which numbers are absent, as bits; strides of the rebased ray.
    marks: vec4<u32>,
    // End of the segment; remaining parameter of the rebased ray.
    along: vec4<f32>,
}

@group(2) @binding(0) var<storage, read> slot_cases: array<SlotCase>;
@group(2) @binding(1) var<storage, read_write> slot_results: array<SlotResult>;

@compute @workgroup_size(64)
fn test_slots(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= arrayLength(&slot_cases)) {
        return;
    }
    config = scene.config;
    let c = slot_cases[id.x];
    let slot = slot_at(c.slot);
    let range = range_of_corners(Corners(c.low, c.high, vec4<f32>(1.0), vec4<f32>(1.0)));
    var state: RayState;
    state.t = 3.5 * config.stride * c.b_u.w;
    state.strides = c.strides;
    state.end_strides = c.strides + c.place.x;
    state.end_rest = c.a_value.w;
    state.sides = c.sides;
    state.crossed = c.crossed;
    state.present = f32(c.present);
    let absent = vec4<u32>(is_absent(c.texel & vec4<u32>(0xffu)));
    let meets = u32(meets_surfaces(range, &state));
    let end = segment_end(&state);
    rebase(&state);
    slot_results[id.x] = SlotResult(
        vec4<u32>(slot.texture, vec3<u32>(slot.first)),
        bytes_of_square(c.texel, c.place),
        vec4<u32>(halves_of_pair(c.texel, c.place_in_row), pixel_of(c.ray)),
        vec4<u32>(sides_of(c.a_value.w), all_surfaces(), meets, macro_place(slot, vec3<i32>(c.macro_cell))),
        vec4<u32>(dot(absent, vec4<u32>(1u, 2u, 4u, 8u)), state.strides, 0u, 0u),
        vec4<f32>(end, state.t, 0.0, 0.0),
    );
}
