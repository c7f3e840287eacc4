// Mode dvr with shading: the effect of light on the colour of a part of a ray, from three positions, with a bound on the error. Twin
// of engines/packets/shade.rs, turn.rs and highlight.rs; docs/bounds.md, section 4, has the proofs.

// Least square of |n.h|: a normal number.
const LEAST_SQUARE: f32 = 1.0e-37;

// Light at the beginning, the middle and the end of a part.
struct Lit {
    // One column per position, in world space.
    gradients: mat3x3<f32>,
    // 1 / length of the gradients; 0 if a gradient is too short for a normal.
    inverse: vec3<f32>,
    // A colour c becomes c * diffuse + specular.
    diffuse: vec3<f32>,
    specular: vec3<f32>,
    // Greatest |n.h| over all lights.
    nearest: vec3<f32>,
}

// Length of a gradient below which there is no normal.
fn gradient_floor() -> f32 {
    return max(config.gradient_floor, LEAST_LENGTH);
}

// `gradients`: one column per position, in world space.
fn lit_along(gradients: mat3x3<f32>, to_eye: vec3<f32>) -> Lit {
    let lengths = vec3<f32>(length(gradients[0]), length(gradients[1]), length(gradients[2]));
    let floor = gradient_floor();
    let has_normal = lengths >= vec3<f32>(floor);
    let inverse = select(vec3<f32>(0.0), 1.0 / max(lengths, vec3<f32>(floor)), has_normal);
    var lit = Lit(gradients, inverse, vec3<f32>(config.ambient), vec3<f32>(0.0), vec3<f32>(0.0));
    for (var i = 0u; i < config.light_count; i += 1u) {
        let light = scene.tables.lights[i];
        let along_light = light.to_light * gradients;
        lit.diffuse += config.diffuse * light.intensity * abs(along_light * inverse);
        let facing = (along_light + to_eye * gradients) * (inverse_of_sum(light.to_light, to_eye) * inverse);
        lit.nearest = max(lit.nearest, abs(facing));
        lit.specular += config.specular * light.intensity * highlights(min(facing * facing, vec3<f32>(1.0)));
    }
    lit.diffuse = select(vec3<f32>(1.0), lit.diffuse, has_normal);
    lit.specular = select(vec3<f32>(0.0), lit.specular, has_normal);
    return lit;
}

// Inverse of the length of the sum of two unit vectors; 0 if the sum vanishes.
fn inverse_of_sum(a: vec3<f32>, b: vec3<f32>) -> f32 {
    let square = 2.0 * dot(a, b) + 2.0;
    let is_there = square > 1.0e-12;
    return select(0.0, inverseSqrt(select(1.0, square, is_there)), is_there);
}

// |n.h| to the power of the shininess, from the square of |n.h|.
fn highlights(squares: vec3<f32>) -> vec3<f32> {
    if (config.whole_half == 0u) {
        return pow(max(squares, vec3<f32>(LEAST_SQUARE)), vec3<f32>(0.5 * config.shininess));
    }
    // Products are more accurate than the built-in function must be. No loop, since software adapters count its turns.
    let by_2 = squares * squares;
    let by_4 = by_2 * by_2;
    let by_8 = by_4 * by_4;
    let by_16 = by_8 * by_8;
    let by_32 = by_16 * by_16;
    let by_64 = by_32 * by_32;
    let low = factor_of(squares, 1u) * factor_of(by_2, 2u) * factor_of(by_4, 4u) * factor_of(by_8, 8u);
    let high = factor_of(by_16, 16u) * factor_of(by_32, 32u) * factor_of(by_64, 64u) * factor_of(by_64 * by_64, 128u);
    return low * high;
}

// A power, if half the shininess has this bit; else 1.
fn factor_of(power: vec3<f32>, bit: u32) -> vec3<f32> {
    return select(vec3<f32>(1.0), power, (config.whole_half & bit) != 0u);
}

fn least_of(v: vec3<f32>) -> f32 {
    return min(min(v.x, v.y), v.z);
}

fn greatest_of(v: vec3<f32>) -> f32 {
    return max(max(v.x, v.y), v.z);
}

// Bounds of the lengths of the normal's derivatives at a place, from the first order to the fourth; from those of the gradient's
// first three, and the inverse of its least length.
fn derivatives(orders: vec3<f32>, inverse: f32) -> vec4<f32> {
    let r = orders * inverse;
    let square = r.x * r.x;
    return vec4<f32>(
        r.x,
        square * TURN_SECOND + r.y,
        r.x * (square * TURN_THIRD + 3.0 * TURN_SECOND * r.y) + r.z,
        square * (square * TURN_FOURTH + 6.0 * TURN_THIRD * r.y) + (3.0 * r.y * r.y + 4.0 * r.x * r.z) * TURN_SECOND,
    );
}

// Bounds of the normal's derivatives along a part.
struct Turn {
    // At the beginning, in the middle and at the end, as the kernel of Simpson's rule weighs them; and anywhere.
    begin: vec4<f32>,
    middle: vec4<f32>,
    end: vec4<f32>,
    anywhere: vec4<f32>,
    // The mean bound of first order.
    mean_first: f32,
    // Whether the gradient nowhere is too short for a normal, and whether it is so everywhere.
    is_known: bool,
    is_dark: bool,
    // Inverse of the least length of the gradient where it is known, else 0.
    inverse: f32,
}

// Bounds along a part from its three gradients and their cubic coefficient.
fn turn_along(lit: Lit, cubic: vec3<f32>) -> Turn {
    let g = lit.gradients;
    let bow = 2.0 * ((g[0] - g[1]) + (g[2] - g[1]));
    let slope = (g[2] - g[0]) - 0.25 * cubic;
    let of_bow = length(bow);
    let of_cubic = length(cubic);
    let steepest = max(length(slope + bow), length(slope - bow));
    let first = of_cubic * 0.75 + steepest;
    let orders = vec3<f32>(first, of_cubic * 3.0 + 2.0 * of_bow, of_cubic * 6.0);
    // The gradient is at least as long as its part along the middle one.
    let axis = g[1] * lit.inverse.y;
    let aside = abs(dot(cubic, axis)) * AWAY_OF_CUBE + abs(dot(bow, axis)) * AWAY_OF_SQUARE;
    let lengths = axis * g - aside;
    let floor = gradient_floor();
    let is_known = floor + config.gradient_noise < least_of(lengths);
    let longest = max(max(length(g[0]), length(g[1])), length(g[2]));
    let reach = of_cubic * AWAY_OF_CUBE + of_bow * AWAY_OF_SQUARE;
    let inverses = 1.0 / select(vec3<f32>(1.0), lengths, is_known);
    return Turn(
        derivatives(orders, inverses.x),
        derivatives(orders, inverses.y),
        derivatives(orders, inverses.z),
        derivatives(orders, greatest_of(inverses)),
        first * 0.25 * (inverses.x + inverses.z + 2.0 * inverses.y),
        is_known,
        longest + reach < floor - config.gradient_noise,
        select(0.0, greatest_of(inverses), is_known),
    );
}

// Error of Simpson's rule for a function, from bounds of its fourth derivative at the three places.
fn simpson_misses(fourth: vec3<f32>) -> f32 {
    return (fourth.x + fourth.z) * KERNEL_AT_END + fourth.y * KERNEL_IN_MIDDLE;
}

// Bounds of a highlight along a part, of one light of intensity 1.
struct HighlightBounds {
    // Errors of Simpson's rule, and of a quadratic's first moment about the middle, times 12.
    missed: f32,
    of_moment: f32,
    // First derivative, anywhere and in the mean.
    first: f32,
    mean_first: f32,
}

// Bounds where |n.h| is at most `nearest`, and `power` its power.
fn highlight_along(turn: Turn, nearest: f32, power: f32) -> HighlightBounds {
    let s = config.shininess;
    if (s < SMOOTH_FROM) {
        let steepness = select(s, VERTICAL, s < 1.0);
        let first = turn.anywhere.x * steepness;
        // Any function with this slope.
        return HighlightBounds(
            min(first * OF_FIRST, power), min(first * 0.5, power * 3.0), first, turn.mean_first * steepness);
    }
    let per = 1.0 / nearest;
    let square = power * per * per;
    let fourth = square * per * per;
    let brackets = min(vec4<f32>(power * per, square, square * per, fourth), config.brackets);
    let powers = min(vec2<f32>(power * per, fourth), vec2<f32>(1.0));
    let n = turn.anywhere;
    let second = s * (s * n.x * (n.x * brackets.y) + n.y * powers.x);
    let third = s * s * s * n.x * n.x * (n.x * brackets.z) + (3.0 * s * s * n.x * n.y + s * n.z) * powers.y;
    let fourths = vec3<f32>(
        fourth_of_highlight(turn.begin, brackets, powers.y),
        fourth_of_highlight(turn.middle, brackets, powers.y),
        fourth_of_highlight(turn.end, brackets, powers.y),
    );
    return HighlightBounds(
        min(min(simpson_misses(fourths), second * OF_SECOND), power),
        min(third * OF_THIRD, power * 3.0),
        s * n.x * brackets.x,
        s * turn.mean_first * brackets.x,
    );
}

// Bound of the fourth derivative of a highlight, from those of the normal.
fn fourth_of_highlight(n: vec4<f32>, brackets: vec4<f32>, power: f32) -> f32 {
    let s = config.shininess;
    let square = n.x * n.x;
    let of_power = s * s * (4.0 * n.x * n.z + 3.0 * n.y * n.y) + s * n.w;
    return of_power * power + 6.0 * s * s * s * square * n.y * brackets.z + s * s * s * s * square * square * brackets.w;
}

// Two bounds where there is a normal, where there may be one, and where there is none.
fn choose(turn: Turn, known: vec2<f32>, unknown: vec2<f32>, dark: f32) -> vec2<f32> {
    return select(select(unknown, known, turn.is_known), vec2<f32>(dark), turn.is_dark);
}

// Greatest cosine within an angle of a direction with this one; not below `LEAST_COSINE`, and at most 1.
fn nearest_within(cosine: f32, angle: f32) -> f32 {
    let c = min(cosine, 1.0);
    let sine = sqrt(max(1.0 - c * c, 0.0));
    return clamp(angle * sine + c, LEAST_COSINE, 1.0);
}

// Bounds of the light anywhere along a part.
struct LightBetween {
    // Least and greatest diffuse, and specular, light.
    diffuse: vec2<f32>,
    specular: vec2<f32>,
    // Change of both together over the part, there and back.
    change: f32,
    highlight: HighlightBounds,
}

fn light_between(lit: Lit, turn: Turn) -> LightBetween {
    let diffuse = config.diffuse * config.light_sum;
    let specular = config.specular * config.light_sum;
    // No place is further from one of the three than a quarter. Nor is a cosine further from the line between two of them.
    let angle = 0.25 * turn.anywhere.x;
    let reach = min(angle, turn.anywhere.y * (1.0 / 32.0));
    let seen = greatest_of(lit.nearest);
    let nearest = min(nearest_within(seen, angle), max(seen + reach, LEAST_COSINE));
    let power = highlights(vec3<f32>(nearest * nearest)).x;
    let highlight = highlight_along(turn, nearest, power);
    let most = min(reach * diffuse + greatest_of(lit.diffuse), config.ambient + diffuse);
    let least = max(least_of(lit.diffuse) - reach * diffuse, config.ambient);
    let dimmer = 0.25 * highlight.first * specular;
    let least_shine = max(least_of(lit.specular) - dimmer, 0.0);
    // Without a normal there is the colour itself.
    let unknown = vec2<f32>(min(config.ambient, 1.0), max(config.ambient + diffuse, 1.0));
    return LightBetween(
        choose(turn, vec2<f32>(least, most), unknown, 1.0),
        choose(turn, vec2<f32>(least_shine, power * specular), vec2<f32>(0.0, specular), 0.0),
        turn.mean_first * diffuse + highlight.mean_first * specular,
        highlight,
    );
}

// Error of the diffuse light by three places, for a density with this sum and this moment.
fn error_of_diffuse(lit: Lit, turn: Turn, sum: f32, moment: f32) -> f32 {
    let n = turn.anywhere;
    let of_moment = min(n.z * OF_THIRD, n.y * (1.0 / 16.0));
    let by_fourth = simpson_misses(vec3<f32>(turn.begin.w, turn.middle.w, turn.end.w));
    let even = sum * min(by_fourth, n.y * OF_SECOND) + moment * of_moment;
    let any = n.x * (sum * OF_FIRST + moment * 0.5);
    var error = 0.0;
    for (var i = 0u; i < config.light_count; i += 1u) {
        let light = scene.tables.lights[i];
        let cosines = (light.to_light * lit.gradients) * lit.inverse;
        // Between two places the cosine is off their line by at most an eighth of the square of the way.
        let bow = n.y * (1.0 / 32.0);
        // The part of it that may lie on the other side.
        let over = max(min(bow - least_of(cosines), greatest_of(cosines) + bow), 0.0);
        let kinked = min(2.0 * over * (sum + moment) + even, any);
        error += select(even, kinked, over > 0.0) * config.diffuse * light.intensity;
    }
    return error;
}

// Cuts colours off at 1; returns the error of doing so after averaging.
fn cut_off(plain: Part, between: LightBetween, color: ptr<function, vec3<f32>>) -> f32 {
    let opacity = 1.0 - plain.transmittance;
    let own = plain.color / max(opacity, LEAST_NORMAL);
    let strongest = min(greatest_of(own) + plain.colors, 1.0);
    if (strongest * between.diffuse.y + between.specular.y <= 1.0) {
        return 0.0;
    }
    let least = max(own - plain.colors, vec3<f32>(0.0)) * between.diffuse.x + between.specular.x;
    let most = min(own + plain.colors, vec3<f32>(1.0)) * between.diffuse.y + between.specular.y;
    let error = max(min(most - 1.0, 1.0 - least), vec3<f32>(0.0));
    *color = min(select(*color, vec3<f32>(opacity), least > vec3<f32>(1.0)), vec3<f32>(opacity));
    return greatest_of(error) * opacity;
}

// A part of a ray after shading, from its gradients in world space and their cubic coefficient.
fn shade_part(plain: Part, gradients: mat3x3<f32>, cubic: vec3<f32>, to_eye: vec3<f32>) -> Part {
    let lit = lit_along(gradients, to_eye);
    let opacity = 1.0 - plain.transmittance;
    let of_specular = plain.moments.w * (lit.specular.z - lit.specular.x) + opacity * mean_of_three(lit.specular);
    var color = plain.color * mean_of_three(lit.diffuse) + plain.moments.rgb * (lit.diffuse.z - lit.diffuse.x) + of_specular;
    let turn = turn_along(lit, cubic);
    let between = light_between(lit, turn);
    // Errors of three places, for a density that is linear.
    let of_diffuse = error_of_diffuse(lit, turn, greatest_of(plain.color), greatest_of(abs(plain.moments.rgb)));
    let of_highlight = opacity * between.highlight.missed + abs(plain.moments.w) * between.highlight.of_moment;
    let known = of_diffuse + of_highlight * config.specular * config.light_sum + plain.misplaced * between.change;
    let of_place = select(select(1.0, known, turn.is_known), 0.0, turn.is_dark);
    let of_cut = cut_off(plain, between, &color);
    // Opacity itself is not lit.
    let of_part = plain.error * max(between.diffuse.y + between.specular.y, 1.0);
    var part = plain;
    part.color = color;
    let of_noise = opacity * light_of_noise(turn.inverse);
    part.error = min(of_place + of_cut, opacity) + of_part + of_noise;
    part.rounding += of_noise;
    return part;
}

// Light that the noise of a gradient may change, whose inverse length is at most this: the normal turns by at most twice the share of
// the noise.
fn light_of_noise(inverse: f32) -> f32 {
    // The steepest slope of a power of a cosine is at most the root of the exponent; of exponents below 1 it has no limit.
    let steepest = select(sqrt(config.shininess), VERTICAL, config.shininess < 1.0);
    let angle = 2.0 * config.gradient_noise * inverse;
    let highlight = min(angle * steepest, 1.0) * config.specular * config.light_sum;
    return min(angle * config.diffuse * config.light_sum + highlight, 1.0);
}

// Mean of a quadratic from its values at the beginning, the middle and the end.
fn mean_of_three(f: vec3<f32>) -> f32 {
    return f.y * (4.0 / 6.0) + (f.x + f.z) * (1.0 / 6.0);
}
