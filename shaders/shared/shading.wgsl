// Gradients of a cell, and two-sided Blinn-Phong shading (RENDERING-MODEL, section 5). Twin of engines/cells/shade.rs.
//
// Central differences at the eight corners, from the 32 voxels around the cell, are interpolated. The result equals
// differences of the interpolant one voxel apart. Vectors are in world space.

// The gradient along a chord: one cubic per index axis.
struct ChordGradient {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
    // 0 if there is no gradient: an absent voxel has weight on the chord, or nothing is shaded.
    present: u32,
}

// The gradient of a cell along a chord; `corners` are the cell's own, absent ones not replaced.
fn chord_gradient(slot: Slot, cell: vec3<i32>, corners: Corners, chord: Chord) -> ChordGradient {
    if (!has_flag(FLAG_SHADED)) {
        return ChordGradient(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), 0u);
    }
    var x = x_differences(slot, cell, corners);
    var y = y_differences(slot, cell, corners);
    var z = z_differences(slot, cell, corners);
    if (has_flag(FLAG_HOLES) && (has_holes(x) || has_holes(y) || has_holes(z))) {
        x = replace_unreached(x, chord.a, chord.b);
        y = replace_unreached(y, chord.a, chord.b);
        z = replace_unreached(z, chord.a, chord.b);
        if (has_holes(x) || has_holes(y) || has_holes(z)) {
            return ChordGradient(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0), 0u);
        }
    }
    return ChordGradient(
        cubic_of_cell(x.low, x.high, chord.a, chord.b),
        cubic_of_cell(y.low, y.high, chord.a, chord.b),
        cubic_of_cell(z.low, z.high, chord.a, chord.b),
        1u,
    );
}

// Central differences along x at the corners.
fn x_differences(slot: Slot, cell: vec3<i32>, c: Corners) -> Corners {
    // Voxels beside the cell's faces: x = 0 of the cell before, x = 1 of the cell behind.
    let before = corners_of(slot, cell - vec3<i32>(1, 0, 0));
    let behind = corners_of(slot, cell + vec3<i32>(1, 0, 0));
    return Corners(
        0.5 * vec4<f32>(c.low.y - before.low.x, behind.low.y - c.low.x, c.low.w - before.low.z, behind.low.w - c.low.z),
        0.5 * vec4<f32>(
            c.high.y - before.high.x, behind.high.y - c.high.x, c.high.w - before.high.z, behind.high.w - c.high.z),
        c.low_present.yxwz
            * vec4<f32>(before.low_present.x, behind.low_present.y, before.low_present.z, behind.low_present.w),
        c.high_present.yxwz
            * vec4<f32>(before.high_present.x, behind.high_present.y, before.high_present.z, behind.high_present.w),
    );
}

// Central differences along y at the corners.
fn y_differences(slot: Slot, cell: vec3<i32>, c: Corners) -> Corners {
    // y = 0 of the cell before, y = 1 of the cell behind.
    let before = corners_of(slot, cell - vec3<i32>(0, 1, 0));
    let behind = corners_of(slot, cell + vec3<i32>(0, 1, 0));
    return Corners(
        0.5 * vec4<f32>(c.low.zw - before.low.xy, behind.low.zw - c.low.xy),
        0.5 * vec4<f32>(c.high.zw - before.high.xy, behind.high.zw - c.high.xy),
        c.low_present.zwxy * vec4<f32>(before.low_present.xy, behind.low_present.zw),
        c.high_present.zwxy * vec4<f32>(before.high_present.xy, behind.high_present.zw),
    );
}

// Central differences along z at the corners.
fn z_differences(slot: Slot, cell: vec3<i32>, c: Corners) -> Corners {
    let before = layer_of(slot, cell - vec3<i32>(0, 0, 1));
    let behind = layer_of(slot, cell + vec3<i32>(0, 0, 2));
    return Corners(
        0.5 * (c.high - before.value),
        0.5 * (behind.value - c.low),
        c.high_present * before.present,
        c.low_present * behind.present,
    );
}

// World-space gradient at u of the chord.
fn gradient_at(gradient: ChordGradient, u: f32, ray: LocalRay) -> vec3<f32> {
    let index = vec3<f32>(cubic_at(gradient.x, u), cubic_at(gradient.y, u), cubic_at(gradient.z, u));
    let matrix = mat3x3<f32>(config.gradient_x, config.gradient_y, config.gradient_z);
    return matrix * (index * ray.gradient_scale);
}

// Coefficient of the third power of the world-space gradient along the chord.
fn cubic_of_gradient(gradient: ChordGradient, ray: LocalRay) -> vec3<f32> {
    let matrix = mat3x3<f32>(config.gradient_x, config.gradient_y, config.gradient_z);
    return matrix * (vec3<f32>(gradient.x.w, gradient.y.w, gradient.z.w) * ray.gradient_scale);
}

fn normal_at(gradient: ChordGradient, u: f32, ray: LocalRay) -> vec3<f32> {
    let g = gradient_at(gradient, u, ray);
    return g / max(length(g), TINY);
}

// Number of Gauss pairs that shading needs between two parameters of a chord of optical depth tau, from the turn of the
// normal.
fn shaded_pairs(gradient: ChordGradient, u0: f32, u1: f32, ray: LocalRay, tau: f32) -> u32 {
    if (gradient.present == 0u) {
        return 1u;
    }
    let middle = normal_at(gradient, 0.5 * (u0 + u1), ray);
    let turn = distance(normal_at(gradient, u0, ray), middle) + distance(middle, normal_at(gradient, u1, ray));
    return shaded_pair_count(turn, tau);
}

// A colour after shading at u of the chord.
fn shaded(gradient: ChordGradient, u: f32, ray: LocalRay, color: vec3<f32>) -> vec3<f32> {
    if (gradient.present == 0u) {
        return color;
    }
    return shade(color, gradient_at(gradient, u, ray), ray.to_eye);
}

// The colour after shading; `gradient` in world space, `to_eye` a unit world vector.
fn shade(color: vec3<f32>, gradient: vec3<f32>, to_eye: vec3<f32>) -> vec3<f32> {
    let size = length(gradient);
    if (size == 0.0 || size < config.gradient_floor) {
        return color;
    }
    let normal = gradient * (-1.0 / size);
    var diffuse = config.ambient;
    var specular = 0.0;
    work += config.light_count;
    for (var i = 0u; i < config.light_count; i += 1u) {
        let light = scene.tables.lights[i];
        diffuse += config.diffuse * abs(dot(normal, light.to_light)) * light.intensity;
        let between = light.to_light + to_eye;
        let facing = abs(dot(normal, between)) / max(length(between), TINY);
        // 0 to a power is 0, but pow takes the logarithm of 0.
        if (facing > 0.0) {
            specular += config.specular * pow(facing, config.shininess) * light.intensity;
        }
    }
    return clamp(color * diffuse + specular, vec3<f32>(0.0), vec3<f32>(1.0));
}
