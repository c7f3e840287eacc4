// Mode dvr with shading: the effect of light on the colour of a part of a ray, from three positions, with an error
// bound. Does the same as engines/packets/shade.rs, which derives the rule and its error; engines/gpu/light.rs compares
// both.

// Least square that is a normal number, as pow takes the logarithm.
const LEAST_SQUARE: f32 = 1.0e-37;

// Shading at the beginning, the middle and the end of a part.
struct Lit {
    // 1 / length of the gradients; 0 if a gradient is too short for a normal.
    inverse: vec3<f32>,
    // A colour c becomes c * diffuse + specular.
    diffuse: vec3<f32>,
    specular: vec3<f32>,
    // Greatest |n.h| over all lights.
    nearest: vec3<f32>,
    // Error bound of light if the lit side of the surface changes between two positions; whether it changes.
    of_sides: f32,
    goes_over: bool,
}

// `gradients`: one column per position, in world space.
fn lit_along(gradients: mat3x3<f32>, to_eye: vec3<f32>) -> Lit {
    let lengths = vec3<f32>(length(gradients[0]), length(gradients[1]), length(gradients[2]));
    let floor = max(config.gradient_floor, TINY);
    let has_normal = lengths >= vec3<f32>(floor);
    let inverse = select(vec3<f32>(0.0), 1.0 / max(lengths, vec3<f32>(floor)), has_normal);
    var lit = Lit(inverse, vec3<f32>(config.ambient), vec3<f32>(0.0), vec3<f32>(0.0), 0.0, false);
    for (var i = 0u; i < config.light_count; i += 1u) {
        let light = scene.tables.lights[i];
        let cosines = (light.to_light * gradients) * inverse;
        lit.diffuse += config.diffuse * light.intensity * abs(cosines);
        let dips = dips_between(cosines, abs(cosines));
        lit.of_sides += config.diffuse * light.intensity * (dips.x + dips.y);
        lit.goes_over = lit.goes_over || any(cosines.xy * cosines.yz < vec2<f32>(0.0));
        let between = light.to_light + to_eye;
        let facing = (between * gradients) * inverse / max(length(between), TINY);
        lit.nearest = max(lit.nearest, abs(facing));
        let powers = highlights(min(facing * facing, vec3<f32>(1.0)));
        lit.specular += config.specular * light.intensity * powers;
        if (config.shininess < KINKED_BELOW) {
            let dips = dips_between(facing, powers);
            lit.of_sides += config.specular * light.intensity * (dips.x + dips.y);
            lit.goes_over = lit.goes_over || any(facing.xy * facing.yz < vec2<f32>(0.0));
        }
    }
    lit.diffuse = select(vec3<f32>(1.0), lit.diffuse, has_normal);
    lit.specular = select(vec3<f32>(0.0), lit.specular, has_normal);
    return lit;
}

// Difference between the mean of the linear interpolation of a light and its true mean, if its cosine changes sign
// between two positions. The cosine then passes zero on a line, and the light dips to zero there. The triangle of each
// half is returned.
fn dips_between(cosines: vec3<f32>, lights: vec3<f32>) -> vec2<f32> {
    let triangles = 0.5 * lights.xy * lights.yz / max(lights.xy + lights.yz, vec2<f32>(TINY));
    return select(vec2<f32>(0.0), triangles, cosines.xy * cosines.yz < vec2<f32>(0.0));
}

// |n.h| to the power of the shininess, from the square of |n.h|.
fn highlights(squares: vec3<f32>) -> vec3<f32> {
    return pow(max(squares, vec3<f32>(LEAST_SQUARE)), vec3<f32>(0.5 * config.shininess));
}

// Mean over a part of a quantity that varies as a quadratic, weighted by the distribution of light along the part.
fn mean_along(f: vec3<f32>, front_share: f32) -> f32 {
    return (f.z + front_share * (f.x - f.z) + 2.0 * f.y) * (1.0 / 3.0);
}

fn least_of(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn greatest_of(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

fn range_of(f: vec3<f32>) -> f32 {
    return greatest_of(f) - least_of(f);
}

// Magnitude of the second difference.
fn bend_of(f: vec3<f32>) -> f32 {
    return abs((f.x - f.y) + (f.z - f.y));
}

// Error of the mean of a smooth function, as a share of its second difference; from the inverse lengths of gradients.
fn share_of_bend(inverse: vec3<f32>) -> f32 {
    return select(BEND_SHARE, STEEP_SHARE, least_of(inverse) < STEEP_FALL * greatest_of(inverse));
}

// Error of the mean of highlights, as a share of their strength. `turn` is the square of the normal's turn, `widths`
// the turn in widths of a highlight. A wide highlight behaves like diffuse light.
fn error_of_highlight(turn: f32, widths: f32) -> f32 {
    return min(HIGHLIGHT_SHARE * widths * widths + TURN_SHARE * turn * turn, 1.0);
}

// Error from clamping to 1 the mean of colours instead of the colours themselves.
fn cut_from_colors(range: f32, low: f32, most: f32) -> f32 {
    let apart = max(max(1.0 - most, low - 1.0), 0.0);
    let reach = max(range - apart, 0.0);
    return CUT_SHARE * reach * reach / max(range, TINY);
}

// A part of a ray after shading.
fn shade_part(plain: LightPart, gradients: mat3x3<f32>, to_eye: vec3<f32>) -> LightPart {
    let lit = lit_along(gradients, to_eye);
    let opacity = 1.0 - plain.transmittance;
    let color = plain.color / max(opacity, TINY);
    var part = plain;
    let of_specular = opacity * mean_along(lit.specular, plain.front_share);
    part.color = plain.color * mean_along(lit.diffuse, plain.front_share) + of_specular;

    // Range and second difference of a channel are convex in its colour: greatest at the brightest channel, or at
    // black.
    let brightest = greatest_of(color) * lit.diffuse + lit.specular;
    let range = max(range_of(brightest), range_of(lit.specular));
    let bend = max(bend_of(brightest), bend_of(lit.specular));
    let uneven = COLOR_SHARE * plain.colors + plain.misplaced;
    let has_kink = lit.goes_over || lit.inverse.x * lit.inverse.y * lit.inverse.z <= 0.0;
    var of_place = select(share_of_bend(lit.inverse), KINK_SHARE, has_kink) * bend + range * uneven;
    let most = greatest_of(brightest);
    let spread = plain.colors * greatest_of(lit.diffuse);
    if (most + spread > 1.0) {
        for (var c = 0u; c < 3u; c += 1u) {
            let f = min(color[c] * lit.diffuse + lit.specular, vec3<f32>(1.0));
            part.color[c] = opacity * mean_along(f, plain.front_share);
        }
        let low = least_of(least_of(color) * lit.diffuse + lit.specular);
        let is_cut = most + 0.5 * spread > 1.0 && low < 1.0 + 0.5 * spread;
        let of_cut = KINK_SHARE * (0.5 * range + bend) + range * uneven;
        of_place = select(of_place, of_cut, is_cut) + cut_from_colors(spread, low, most);
    }
    of_place = max(of_place, lit.of_sides) + error_of_turn(gradients, lit);
    // The part's own error is scaled like its light; its opacity is not.
    let gain = max(greatest_of(lit.diffuse + lit.specular), 1.0);
    part.error = opacity * min(of_place, 1.0) + plain.error * gain;
    part.fit = plain.fit * gain;
    return part;
}

// Light that three positions can miss between them. The first cause is a highlight where the normal turns. The second
// is a gradient whose length passes the least length for a normal only between two positions.
fn error_of_turn(gradients: mat3x3<f32>, lit: Lit) -> f32 {
    // Products of the first two and of the last two gradients.
    let ab = vec2<f32>(dot(gradients[0], gradients[1]), dot(gradients[1], gradients[2]));
    let squares = vec3<f32>(
        dot(gradients[0], gradients[0]), dot(gradients[1], gradients[1]), dot(gradients[2], gradients[2]));
    let scale = lit.inverse.xy * lit.inverse.yz;
    let between = select(vec2<f32>(0.0), max(2.0 - 2.0 * ab * scale, vec2<f32>(0.0)), scale > vec2<f32>(0.0));
    // A turn there and back between two positions.
    let second = length((gradients[0] - gradients[1]) + (gradients[2] - gradients[1]));
    let aside = DEPARTURE_SHARE * second * greatest_of(lit.inverse);
    let turns = min(between + vec2<f32>(aside * aside), vec2<f32>(GREATEST_TURN));
    let turn = turns.x + turns.y;
    let widths = turn * config.shininess;
    let reach = greatest_of(lit.nearest) + HIGHLIGHT_REACH * sqrt(max(turns.x, turns.y));
    let seen = highlights(vec3<f32>(min(reach * reach, 1.0))).x;
    let of_highlight = error_of_highlight(turn, widths) * seen * config.specular * config.light_sum;
    let of_turn = turn * turn * TURN_SHARE * config.diffuse * config.light_sum;
    // Share of the part in which the gradient may be too short. A gradient that varies linearly passes through a sphere
    // on a chord; the sphere's radius is doubled because the variation is not quite linear.
    let floor = 2.0 * max(config.gradient_floor, TINY);
    let way = max(squares.xy + squares.yz - 2.0 * ab, vec2<f32>(LEAST_SQUARE));
    let nearest = max(squares.xy * squares.yz - ab * ab, vec2<f32>(0.0)) / way;
    // A half without a normal at either end is already handled; but there may be a normal in between.
    let lacks = (lit.inverse.xy + lit.inverse.yz) <= vec2<f32>(0.0);
    let is_passed = (ab < squares.xy) & (ab < squares.yz) & (nearest < vec2<f32>(floor * floor)) & !lacks;
    let flat = select(vec2<f32>(0.0), min(floor * inverseSqrt(way), vec2<f32>(1.0)), is_passed);
    let bow = BOW_SHARE * second;
    let reach_between = sqrt(max(squares.xy, squares.yz)) + vec2<f32>(bow);
    let is_hidden = lacks & (reach_between >= vec2<f32>(0.5 * floor));
    let uncertain = flat + select(vec2<f32>(0.0), vec2<f32>(0.5), is_hidden);
    let gain = max(config.ambient + (config.diffuse + config.specular) * config.light_sum, 1.0);
    return of_highlight + of_turn + gain * (uncertain.x + uncertain.y);
}
