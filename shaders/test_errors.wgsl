// For tests: errors of rays drawn from coarser bricks, on given numbers. Compared with lod/deviation.rs.

// Three bricks of a ray.
struct ErrorCase {
    // Numbers of the bricks' deviations. Bit i of the last component: whether brick i is drawn.
    bricks: vec4<u32>,
    lengths: vec4<f32>,
    // Transmittance of the ray in front of the first brick and behind each.
    transmittance: vec4<f32>,
    // The ray's value at the same places. Bit i of `there`: whether value i exists.
    values: vec4<f32>,
    there: u32,
}

struct ErrorResult {
    dvr: RayErrors,
    mip: RayErrors,
    minip: RayErrors,
    mean: RayErrors,
}

@group(2) @binding(0) var<storage, read> error_cases: array<ErrorCase>;
@group(2) @binding(1) var<storage, read_write> error_results: array<ErrorResult>;

fn extreme_of(c: ErrorCase, i: u32) -> Extreme {
    return Extreme(c.values[i], (c.there >> i & 1u) != 0u);
}

@compute @workgroup_size(64)
fn test_errors(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= arrayLength(&error_cases)) {
        return;
    }
    config = scene.config;
    let c = error_cases[id.x];
    var result: ErrorResult;
    let by_value = RayErrors(0.0, 0.0, 0.0, 0.0, 0u);
    ray_errors = RayErrors(0.0, 0.0, 1.0, 0.0, 0u);
    for (var i = 0u; i < 3u; i += 1u) {
        let is_drawn = (c.bricks.w >> i & 1u) != 0u;
        note_brick(c.transmittance[i], c.transmittance[i + 1u], is_drawn, c.lengths[i], deviations[c.bricks[i]]);
    }
    result.dvr = ray_errors;
    ray_errors = by_value;
    for (var i = 0u; i < 3u; i += 1u) {
        note_extreme(extreme_of(c, i), extreme_of(c, i + 1u), true, deviations[c.bricks[i]]);
    }
    result.mip = ray_errors;
    ray_errors = by_value;
    for (var i = 0u; i < 3u; i += 1u) {
        note_extreme(extreme_of(c, i), extreme_of(c, i + 1u), false, deviations[c.bricks[i]]);
    }
    result.minip = ray_errors;
    ray_errors = by_value;
    for (var i = 0u; i < 3u; i += 1u) {
        note_mean(c.lengths[i], deviations[c.bricks[i]]);
    }
    result.mean = ray_errors;
    error_results[id.x] = result;
}
