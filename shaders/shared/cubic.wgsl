// The field along a chord of a trilinear cell. Twin of engines/cells/cell.rs.
//
// s(u) = c.x + c.y u + c.z u^2 + c.w u^3, u from 0 to 1. Corner c of a cell has the offsets
// (c & 1, c >> 1 & 1, c >> 2). `low` holds the corners with z = 0, `high` those with z = 1. Interpolation is written
// with differences, so that equal corners are reproduced exactly.

// Most steps of the bracketed search for a root; bisection alone takes 24 to the last bit.
const ROOT_STEPS: u32 = 24u;
// Width of the bracket, in u, at which the search ends: about one ulp.
const ROOT_TOLERANCE: f32 = 1.0e-7;

// Coefficients of 1, x, y, z (`first`) and of xy, xz, yz, xyz (`second`) of the interpolant.
struct Monomials {
    first: vec4<f32>,
    second: vec4<f32>,
}

fn monomials(low: vec4<f32>, high: vec4<f32>) -> Monomials {
    let x = vec4<f32>(low.y - low.x, low.w - low.z, high.y - high.x, high.w - high.z);
    let xy = vec2<f32>(x.y - x.x, x.w - x.z);
    let y = low.z - low.x;
    return Monomials(
        vec4<f32>(low.x, x.x, y, high.x - low.x),
        vec4<f32>(xy.x, x.z - x.x, (high.z - high.x) - y, xy.y - xy.x),
    );
}

fn trilinear(low: vec4<f32>, high: vec4<f32>, p: vec3<f32>) -> f32 {
    let m = monomials(low, high);
    return m.first.x
        + p.x * (m.first.y + p.y * (m.second.x + p.z * m.second.w))
        + p.y * (m.first.z + p.z * m.second.z)
        + p.z * (m.first.w + p.x * m.second.y);
}

// The cubic along the chord from `a` to `b`, both in [0, 1]^3.
fn cubic_of_cell(low: vec4<f32>, high: vec4<f32>, a: vec3<f32>, b: vec3<f32>) -> vec4<f32> {
    let m = monomials(low, high);
    let d = b - a;
    // Coefficients of u and u^2 in xy, xz, yz and xyz.
    let linear = vec4<f32>(
        a.x * d.y + a.y * d.x,
        a.x * d.z + a.z * d.x,
        a.y * d.z + a.z * d.y,
        a.x * a.y * d.z + a.x * a.z * d.y + a.y * a.z * d.x,
    );
    let quadratic = vec4<f32>(
        d.x * d.y,
        d.x * d.z,
        d.y * d.z,
        a.x * d.y * d.z + a.y * d.x * d.z + a.z * d.x * d.y,
    );
    return vec4<f32>(
        trilinear(low, high, a),
        dot(m.first.yzw, d) + dot(m.second, linear),
        dot(m.second, quadratic),
        m.second.w * d.x * d.y * d.z,
    );
}

fn cubic_at(c: vec4<f32>, u: f32) -> f32 {
    return c.x + u * (c.y + u * (c.z + u * c.w));
}

// Mean of the cubic over [0, 1].
fn cubic_mean(c: vec4<f32>) -> f32 {
    return c.x + c.y * (1.0 / 2.0) + c.z * (1.0 / 3.0) + c.w * (1.0 / 4.0);
}

// Ends of the intervals of [0, 1] in which the cubic is monotone, ascending; unused ones are 1.
fn monotone_intervals(c: vec4<f32>) -> vec4<f32> {
    let size = max(abs(c.y), max(abs(c.z), abs(c.w)));
    if (size == 0.0) {
        return vec4<f32>(0.0, 1.0, 1.0, 1.0);
    }
    // s'(u) = c.y + 2 c.z u + 3 c.w u^2, scaled so that squares neither overflow nor underflow. The stable form of the
    // two roots never subtracts nearly equal numbers.
    let a = 3.0 * (c.w / size);
    let half_b = c.z / size;
    let constant = c.y / size;
    let discriminant = half_b * half_b - a * constant;
    if (discriminant <= 0.0) {
        return vec4<f32>(0.0, 1.0, 1.0, 1.0);
    }
    let q = -(half_b + select(-1.0, 1.0, half_b >= 0.0) * sqrt(discriminant));
    let u = vec2<f32>(unit_ratio(q, a), unit_ratio(constant, q));
    return vec4<f32>(0.0, min(u.x, u.y), max(u.x, u.y), 1.0);
}

// `a / b` if it lies in (0, 1), else 1.
fn unit_ratio(a: f32, b: f32) -> f32 {
    let inside = a * b > 0.0 && abs(a) < abs(b);
    return select(1.0, a / select(1.0, b, inside), inside);
}

// (least, greatest) value of the cubic.
fn cubic_extremes(c: vec4<f32>, intervals: vec4<f32>) -> vec2<f32> {
    let s = vec4<f32>(c.x, cubic_at(c, intervals.y), cubic_at(c, intervals.z), cubic_at(c, 1.0));
    return vec2<f32>(min(min(s.x, s.y), min(s.z, s.w)), max(max(s.x, s.y), max(s.z, s.w)));
}

// The u in the monotone interval [first, last] at which the side of `value` changes, or NEVER; values equal to it count
// as above. Newton's method inside a shrinking bracket, with bisection if Newton's step leaves the bracket.
fn monotone_root(c: vec4<f32>, first: f32, last: f32, value: f32) -> f32 {
    var low = first;
    var high = last;
    let low_above = cubic_at(c, low) >= value;
    if (low_above == (cubic_at(c, high) >= value)) {
        return NEVER;
    }
    var u = 0.5 * (low + high);
    for (var i = 0u; i < ROOT_STEPS; i += 1u) {
        work += 1u;
        let excess = cubic_at(c, u) - value;
        if ((excess >= 0.0) == low_above) {
            low = u;
        } else {
            high = u;
        }
        let slope = c.y + u * (2.0 * c.z + u * 3.0 * c.w);
        var next = 0.5 * (low + high);
        // Newton's step must stay inside the bracket. If the slope vanishes, nothing is divided by it.
        let newton = u - excess / select(slope, 1.0, slope == 0.0);
        if (slope != 0.0 && newton > low && newton < high) {
            next = newton;
        }
        let settled = abs(next - u) < ROOT_TOLERANCE;
        u = next;
        if (settled || high - low < ROOT_TOLERANCE) {
            break;
        }
    }
    return u;
}
