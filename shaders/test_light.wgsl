// For tests: integration of a part of a ray by antiderivatives, and its shading, on given numbers. Compared with Rust
// twins.

// Numbers in [0, 1], as in test_twins.wgsl.
struct LightCase {
    low: vec4<f32>,
    high: vec4<f32>,
    a_value: vec4<f32>,
    b_u: vec4<f32>,
    near: vec4<f32>,
    far: vec4<f32>,
}

struct LightResult {
    // A cell: value, twist, corners. A chord, and it after shading. Two chords in one line. Bounds of all three, and of misplaced light.
    cell: vec4<f32>,
    channels: vec4<f32>,
    part: vec4<f32>,
    moments: vec4<f32>,
    lit: vec4<f32>,
    both: vec4<f32>,
    line: vec4<f32>,
    errors: vec4<f32>,
}

@group(2) @binding(0) var<storage, read> light_cases: array<LightCase>;
@group(2) @binding(1) var<storage, read_write> light_results: array<LightResult>;

@compute @workgroup_size(64)
fn test_light(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= arrayLength(&light_cases)) {
        return;
    }
    config = scene.config;
    let c = light_cases[id.x];
    let a = c.a_value.xyz;
    let u = c.b_u.w;
    var result: LightResult;
    // Chords within one piece up to chords over all of them, also outside the table.
    let all = 1.2 * c.low - 0.1;
    let piece = piece_of(all.w);
    let spread = c.high.w * c.high.w * c.high.w * c.high.w;
    let values = mix(all.xxx, all.xyz, spread);
    let free = vec2<f32>(-FAR, FAR);
    let noise = 1.0e-4 * c.near.w;
    let chord = LightChord(values, 0.1 * spread * c.high.x, 4.0 * u, noise, free);
    let part = integrate_chord(chord);
    // Another part behind the first one, merged with it into one line.
    let behind_values = values.zyx + 0.1 * (values.yxz - values.xxx);
    let behind = LightChord(behind_values, 0.05 * spread * c.high.y, 2.0 * c.near.x, noise, free);
    let line = line_over(line_over(no_line(), line_of(chord)), line_of(behind));
    let both = integrate_line(line);
    let field = LightCell(vec4<f32>(c.low.xz, c.high.xz), vec4<f32>(c.low.yw - c.low.xz, c.high.yw - c.high.xz), true);
    result.part = vec4<f32>(part.color, part.transmittance);
    result.cell = vec4<f32>(value_in(field, a), twist_of(field), range_in(field));
    result.channels = channels_at(quadratics(piece), place_in(piece, all.w).y).value;
    result.moments = part.moments;
    // Normals in all directions, some of which turn little; some gradients are too short for a normal.
    let begin = c.low.xyz - 0.5;
    let turn = c.far.x * c.far.x;
    let size = select(1.0, 1.0e-8, c.far.y < 0.1);
    let gradients = mat3x3<f32>(begin, begin + turn * (c.high.xyz - 0.5), size * (begin + turn * (c.near.xyz - 0.5)));
    let cubic = 0.1 * turn * (c.far.xyz - 0.5);
    let lit = shade_part(part, gradients, cubic, normalize(a - c.b_u.xyz));
    result.lit = vec4<f32>(lit.color, part.colors);
    result.both = vec4<f32>(both.color, both.transmittance);
    result.line = vec4<f32>(line.average, line.most, line.range.y - line.range.x, part.rounding);
    result.errors = vec4<f32>(part.error, lit.error, both.error, part.misplaced);
    light_results[id.x] = result;
}
