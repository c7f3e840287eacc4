// Emission and absorption along a chord. Twin of engines/cells/quadrature.rs.
//
// Between bends and steps of the transfer function, kappa and colour are smooth in u, so that a two-point Gauss rule is
// of fourth order. `extent` is a world length, kappa an extinction per world length. The constants are in layout.wgsl,
// shared with the CPU.

// Optical depth beyond which the farther Gauss point has no weight.
const DEPTH_LIMIT: f32 = 80.0;

// `1 - exp(-tau)`, accurate for small tau.
fn opacity_of(tau: f32) -> f32 {
    if (tau < 0.0625) {
        // Taylor series; the first omitted term is below 2^-24 of the sum.
        return tau - tau * tau * (1.0 / 2.0 - tau * (1.0 / 6.0 - tau * (1.0 / 24.0 - tau * (1.0 / 120.0))));
    }
    return 1.0 - exp(-tau);
}

// Premultiplied colour and opacity of an interval from its two Gauss points, the nearer one first. The opacity is
// `1 - exp(-tau)` with the Gauss value `tau = (kappa_1 + kappa_2) extent / 2`. The colour is the mean of both colours,
// weighted by the emission that leaves the interval, `kappa_i T_i`, where `T_2 / T_1 = exp(-tau / sqrt(3))`.
fn integrate_pair(kappa: vec2<f32>, near_color: vec3<f32>, far_color: vec3<f32>, extent: f32) -> vec4<f32> {
    let tau = 0.5 * (kappa.x + kappa.y) * extent;
    if (!(tau > 0.0)) {
        return vec4<f32>(0.0);
    }
    let opacity = opacity_of(tau);
    let far = kappa.y * max(exp(-min(tau * GAUSS_DISTANCE, DEPTH_LIMIT)), MIN_WEIGHT);
    let share = opacity / (kappa.x + far);
    return vec4<f32>(share * (kappa.x * near_color + far * far_color), opacity);
}

// Number of Gauss pairs for an interval with this variation of the transfer function and optical depth tau.
fn pair_count(change: f32, tau: f32) -> u32 {
    let root = sqrt(sqrt(change * (1.0 / PAIR_VARIATION)));
    let wanted = root + change * (PAIRS_PER_VARIATION + tau * (1.0 / PAIR_VARIATION_DEPTH));
    return u32(clamp(ceil(wanted), 1.0, f32(PAIR_LIMIT)));
}

// Number of Gauss pairs for an interval in which the normal turns by `turn` (a length of difference vectors), of
// optical depth tau.
fn shaded_pair_count(turn: f32, tau: f32) -> u32 {
    let wanted = turn * (1.0 / PAIR_NORMAL_CHANGE) + turn * tau * (1.0 / PAIR_NORMAL_DEPTH);
    return u32(clamp(ceil(wanted), 1.0, f32(PAIR_LIMIT)));
}

// Optical depth between two parameters of a chord, from the extinction in the middle.
fn depth_between(view: CellView, u0: f32, u1: f32) -> f32 {
    return extinction(classify(value_at(view, 0.5 * (u0 + u1))).a) * view.extent * (u1 - u0);
}

// Number of Gauss pairs between two splits, from the values at both ends and in the middle, and the optical depth.
fn pairs_between(view: CellView, u0: f32, u1: f32, tau: f32) -> u32 {
    let first = value_at(view, u0);
    let middle = value_at(view, 0.5 * (u0 + u1));
    let last = value_at(view, u1);
    let change = variation(min(min(first, middle), last), max(max(first, middle), last));
    if (change == 0.0) {
        return 1u;
    }
    return pair_count(change, tau);
}
