// Twin of raycast/scalar/quadrature.rs: emission and absorption along a chord.
//
// Between the values at which the transfer function bends or steps, kappa and colour are smooth in u, so that a
// two-point Gauss rule is of fourth order. `extent` is a world length, kappa extinction per world length. The constants
// stand in layout.wgsl: both backends have the same ones.

// Optical depth beyond which the farther Gauss point has no weight.
const DEPTH_LIMIT: f32 = 80.0;

// `1 - exp(-tau)`, accurate for small tau.
fn opacity_of(tau: f32) -> f32 {
    if (tau < 0.0625) {
        // Taylor's series; the first term left out is below 2^-24 of the sum.
        return tau - tau * tau * (1.0 / 2.0 - tau * (1.0 / 6.0 - tau * (1.0 / 24.0 - tau * (1.0 / 120.0))));
    }
    return 1.0 - exp(-tau);
}

// Premultiplied colour and opacity of an interval from its two Gauss points, nearer one first. The opacity is
// `1 - exp(-tau)` with Gauss's `tau = (kappa_1 + kappa_2) extent / 2`; the colour is the mean of the two colours with
// Gauss's weights for the emission that gets out, `kappa_i T_i`, where `T_2 / T_1 = exp(-tau / sqrt(3))`.
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

// Number of Gauss pairs for an interval over which the transfer function varies this much, of optical depth tau.
fn pair_count(change: f32, tau: f32) -> u32 {
    let root = sqrt(sqrt(change * (1.0 / PAIR_VARIATION)));
    let wanted = root + change * (PAIRS_PER_VARIATION + tau * (1.0 / PAIR_VARIATION_DEPTH));
    return u32(clamp(ceil(wanted), 1.0, f32(PAIR_LIMIT)));
}

// Number of Gauss pairs for an interval in which the normal turns this far (a length), of optical depth tau.
fn shaded_pair_count(turn: f32, tau: f32) -> u32 {
    let wanted = turn * (1.0 / PAIR_NORMAL_CHANGE) + turn * tau * (1.0 / PAIR_NORMAL_DEPTH);
    return u32(clamp(ceil(wanted), 1.0, f32(PAIR_LIMIT)));
}

// Optical depth between two parameters of a chord, as if all of it were as in the middle.
fn depth_between(view: CellView, u0: f32, u1: f32) -> f32 {
    return extinction(classify(value_at(view, 0.5 * (u0 + u1))).a) * view.extent * (u1 - u0);
}

// Number of Gauss pairs between two splits, from the values there and in the middle, and the depth between them.
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
