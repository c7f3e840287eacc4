// For tests: shader functions on given numbers. Compared with Rust twins.

struct TwinCase {
    low: vec4<f32>,
    high: vec4<f32>,
    // Beginning of a chord, and a render value.
    a_value: vec4<f32>,
    // End of the chord, and a number in (0, 1).
    b_u: vec4<f32>,
    // Two colours and their extinctions.
    near: vec4<f32>,
    far: vec4<f32>,
}

struct TwinResult {
    cubic: vec4<f32>,
    intervals: vec4<f32>,
    // Trilinear value at the chord's beginning, mean of the cubic, its extremes.
    field: vec4<f32>,
    rgba: vec4<f32>,
    // Variation, absorbance, opacity, extinction.
    light: vec4<f32>,
    pair: vec4<f32>,
    shaded: vec4<f32>,
    // Root in the first monotone interval (2 if there is none), visibility, first knot, number of knots.
    search: vec4<f32>,
    // Number of Gauss pairs for a variation, for a turning normal, and for a part of a chord.
    counts: vec4<f32>,
}

@group(2) @binding(0) var<storage, read> twin_cases: array<TwinCase>;
@group(2) @binding(1) var<storage, read_write> twin_results: array<TwinResult>;

@compute @workgroup_size(64)
fn test_twins(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x >= arrayLength(&twin_cases)) {
        return;
    }
    config = scene.config;
    let c = twin_cases[id.x];
    let a = c.a_value.xyz;
    let value = c.a_value.w;
    let u = c.b_u.w;
    let cubic = cubic_of_cell(c.low, c.high, a, c.b_u.xyz);
    let intervals = monotone_intervals(cubic);
    let knots = knots_in(value, value + u);
    let knot_count = knots.y - knots.x;
    var result: TwinResult;
    result.cubic = cubic;
    result.intervals = intervals;
    result.field = vec4<f32>(trilinear(c.low, c.high, a), cubic_mean(cubic), cubic_extremes(cubic, intervals));
    result.rgba = classify(value);
    result.light = vec4<f32>(variation(value, value + u), absorbance(u), opacity_of(4.0 * u), extinction(u));
    result.pair = integrate_pair(vec2<f32>(c.near.w, c.far.w), c.near.rgb, c.far.rgb, 4.0 * u);
    // A layer of corners serves as a gradient, the chord as the viewing direction.
    result.shaded = vec4<f32>(shade(c.near.rgb, c.low.xyz, normalize(a - c.b_u.xyz)), 0.0);
    result.search = vec4<f32>(
        min(monotone_root(cubic, intervals.x, intervals.y, value), 2.0),
        f32(is_visible(value, value + u)),
        f32(select(0u, knots.x, knot_count > 0u)),
        f32(knot_count),
    );
    // Squared, because small variations are most frequent.
    result.counts.x = f32(pair_count(c.near.x * c.near.x, 8.0 * c.near.y));
    let range = range_of_corners(Corners(c.low, c.high, vec4<f32>(1.0), vec4<f32>(1.0)));
    let view = cell_view(Corners(c.low, c.high, vec4<f32>(1.0), vec4<f32>(1.0)), range, Chord(a, c.b_u.xyz, 4.0));
    result.counts.z = f32(pairs_between(view, 0.2 * u, u, depth_between(view, 0.2 * u, u)));
    result.counts.y = f32(shaded_pair_count(2.0 * c.far.x, 8.0 * c.far.y));
    twin_results[id.x] = result;
}
