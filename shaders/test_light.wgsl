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
    // One chord: colour and transmittance; error, then value and twist of a cell; channels at a value.
    part: vec4<f32>,
    cell: vec4<f32>,
    channels: vec4<f32>,
    // The same part after shading: colour and error.
    lit: vec4<f32>,
    // Two chords merged into one line: colour and transmittance; error, then mean and greatest distance and width, as
    // shares of the table.
    both: vec4<f32>,
    line: vec4<f32>,
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
    // Chords within one bin up to chords over all bins, also outside the table.
    let bins = f32(LIGHT_BINS) * (1.2 * c.low - 0.1);
    let spread = c.high.w * c.high.w * c.high.w * c.high.w;
    let values = mix(bins.xxx, bins.xyz, spread);
    let part = integrate_chord(LightChord(values, 100.0 * spread * c.high.x, 4.0 * u));
    // Another part behind the first one, merged with it into one line.
    let behind = LightChord(values.zyx + 0.1 * (values.yxz - values.xxx), 50.0 * spread * c.high.y, 2.0 * c.near.x);
    let first = line_over(no_line(), line_of(LightChord(values, 100.0 * spread * c.high.x, 4.0 * u)));
    let line = line_over(first, line_of(behind));
    let both = integrate_line(line, disorder_of(line));
    let field = LightCell(vec4<f32>(c.low.xz, c.high.xz), vec4<f32>(c.low.yw - c.low.xz, c.high.yw - c.high.xz), true);
    result.part = vec4<f32>(part.color, part.transmittance);
    result.cell = vec4<f32>(part.error, value_in(field, a), twist_of(field), 0.0);
    result.channels = light_at(bins.w).value;
    // Normals in all directions, some of which turn little; some gradients are too short for a normal.
    let begin = c.low.xyz - 0.5;
    let turn = c.far.x * c.far.x;
    let size = select(1.0, 1.0e-8, c.far.y < 0.1);
    let gradients = mat3x3<f32>(begin, begin + turn * (c.high.xyz - 0.5), size * (begin + turn * (c.near.xyz - 0.5)));
    let lit = shade_part(part, gradients, normalize(a - c.b_u.xyz));
    result.lit = vec4<f32>(lit.color, lit.error);
    result.both = vec4<f32>(both.color, both.transmittance);
    result.line = vec4<f32>(both.error, vec3<f32>(line.average, line.most, line.high - line.low) * (1.0 / f32(LIGHT_BINS)));
    light_results[id.x] = result;
}
