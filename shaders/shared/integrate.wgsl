// Emission and absorption along a line of values by antiderivatives of the transfer function, with a bound on the error. Twin of
// engines/packets/integrate.rs, uneven.rs and chord.rs; docs/bounds.md, sections 2 and 3, has the proofs.

// Extinction below which colours are not known.
const LEAST_KAPPA: f32 = 1.0e-20;
// Greatest number that stands for one without a bound.
const GREATEST: f32 = 3.0e38;

// The field along a part of a ray: three values and the coefficient of the third power.
struct LightChord {
    values: vec3<f32>,
    cubic: f32,
    // World length.
    extent: f32,
    // Bound on the rounding of the values.
    noise: f32,
    // Bounds of the field by the corners of its cell.
    bounds: vec2<f32>,
}

// The line that replaces the field along a part of a ray, or along several consecutive parts; r is the field less the line.
struct Line {
    ends: vec2<f32>,
    // Bounds of field and line.
    range: vec2<f32>,
    // Greatest |r|, and bounds of the mean of |r| and of r^2.
    most: f32,
    average: f32,
    square: f32,
    // Greatest integral of r from the beginning to anywhere, and bound on the mean of its size.
    swing: vec2<f32>,
    // Mean of r^2, and of (u - 1/2) r, of one part.
    moments: vec2<f32>,
    // Signed bump and cubic coefficient, of one part.
    bow: vec2<f32>,
    // Greatest slope of r.
    turn: f32,
    is_span: bool,
    // World length.
    extent: f32,
    // Bound on the rounding of the field.
    noise: f32,
}

// The contribution of a part of a ray.
struct Part {
    // Premultiplied colour, and share of light from behind that passes.
    color: vec3<f32>,
    transmittance: f32,
    // Bound on the error of both, and the share of it that rounding makes.
    error: f32,
    rounding: f32,
    // Origin of the colours and of opacity along the part: first moments about its middle.
    moments: vec4<f32>,
    // Bound on how far each of the four is from a linear density with its sum and its moment.
    misplaced: f32,
    // Variation of colour over the part.
    colors: f32,
}

// An empty part.
fn no_part() -> Part {
    return Part(vec3<f32>(0.0), 1.0, 0.0, 0.0, vec4<f32>(0.0), 0.0, 0.0);
}

// The line of an empty part.
fn no_line() -> Line {
    let none = vec2<f32>(0.0);
    return Line(none, vec2<f32>(FAR, -FAR), -FAR, 0.0, 0.0, none, none, none, 0.0, false, 0.0, 0.0);
}

// The line with the field's mean and the difference of its end values.
fn line_of(chord: LightChord) -> Line {
    let first = chord.values.x;
    let middle = chord.values.y;
    let last = chord.values.z;
    let rise = last - first;
    let mean = middle * (4.0 / 6.0) + (first + last) * (1.0 / 6.0);
    let signed_bump = middle - 0.5 * (first + last);
    let bump = abs(signed_bump);
    let cubic = abs(chord.cubic);
    let ends = vec2<f32>(mean - 0.5 * rise, mean + 0.5 * rise);
    // Between its three values the field leaves the connecting lines by a quarter of the bump, plus the cubic part.
    let of_cubic = GREATEST_OF_CUBIC * cubic + chord.noise;
    let low = min(min(first, last), middle) - (0.25 * max(-signed_bump, 0.0) + of_cubic);
    let high = max(max(first, last), middle) + (0.25 * max(signed_bump, 0.0) + of_cubic);
    let range = vec2<f32>(
        max(min(low, min(ends.x, ends.y)), chord.bounds.x), min(max(high, max(ends.x, ends.y)), chord.bounds.y));
    return Line(
        ends,
        range,
        (2.0 / 3.0) * bump + of_cubic,
        AVERAGE_OF_BUMP * bump + AVERAGE_OF_CUBIC * cubic,
        SQUARE_OF_BUMP * bump * bump + SQUARE_OF_CUBIC * cubic * cubic,
        vec2<f32>(SWING_OF_BUMP * bump + SWING_OF_CUBIC * cubic, bump * (1.0 / 24.0) + cubic * (1.0 / 120.0)),
        vec2<f32>(SQUARE_OF_BUMP * bump * bump + SQUARE_OF_CUBIC * cubic * cubic, chord.cubic * (-1.0 / 120.0)),
        vec2<f32>(signed_bump, chord.cubic),
        4.0 * bump + 0.5 * cubic,
        false,
        chord.extent,
        chord.noise,
    );
}

// The line that replaces the field along two consecutive parts. Its distance from each part's own line is linear from end to end.
// Adding that distance to the part's own bounds gives the bounds of the common line.
fn line_over(a: Line, b: Line) -> Line {
    let extent = a.extent + b.extent;
    let share = a.extent / max(extent, TINY);
    let mean = 0.5 * (share * (a.ends.x + a.ends.y) + (1.0 - share) * (b.ends.x + b.ends.y));
    let rise = (a.ends.y - a.ends.x) + (b.ends.y - b.ends.x);
    let ends = vec2<f32>(mean - 0.5 * rise, mean + 0.5 * rise);
    let joint = ends.x + share * rise;
    let of_a = vec2<f32>(a.ends.x - ends.x, a.ends.y - joint);
    let of_b = vec2<f32>(b.ends.x - joint, b.ends.y - ends.y);
    let most = max(a.most + max(abs(of_a.x), abs(of_a.y)), b.most + max(abs(of_b.x), abs(of_b.y)));
    let average = share * (a.average + mean_distance(of_a)) + (1.0 - share) * (b.average + mean_distance(of_b));
    let range = vec2<f32>(
        min(min(a.range.x, b.range.x), min(ends.x, ends.y)), max(max(a.range.y, b.range.y), max(ends.x, ends.y)));
    let none = vec2<f32>(0.0);
    let noise = max(a.noise, b.noise);
    return Line(
        ends, range, most, average, most * average, vec2<f32>(0.5 * average), none, none, GREATEST, true, extent, noise);
}

// Bound on the mean magnitude of a number that varies linearly between two ends.
fn mean_distance(ends: vec2<f32>) -> f32 {
    return 0.25 * (abs(ends.x) + abs(ends.y) + abs(ends.x + ends.y));
}

// A line at its places in the table. The field is monotone if its slope along the line has one sign.
struct LineInTable {
    line: Line,
    a: Place,
    b: Place,
    low: Place,
    high: Place,
    // Whether the range reaches over a knot.
    has_knots: bool,
    // Signed and absolute distance of the line's ends, and the inverse of the latter.
    width: f32,
    rise: f32,
    per_rise: f32,
    is_monotone: bool,
    // If it is, the inverse of its least slope.
    per_slope: f32,
}

// Looks up a line. The line's ends lie in its range.
fn locate(line: Line) -> LineInTable {
    let piece = piece_of(line.range.x);
    let extent = extent_of(piece);
    let has_knots = extent.y <= line.range.y;
    var at: LineInTable;
    at.line = line;
    at.a = Place(piece, line.ends.x - extent.x);
    at.b = Place(piece, line.ends.y - extent.x);
    at.low = Place(piece, line.range.x - extent.x);
    at.high = Place(piece, line.range.y - extent.x);
    if (has_knots) {
        at.a = place_in(piece_of(line.ends.x), line.ends.x);
        at.b = place_in(piece_of(line.ends.y), line.ends.y);
        at.high = place_in(piece_of(line.range.y), line.range.y);
    }
    at.has_knots = has_knots;
    at.width = line.ends.y - line.ends.x;
    at.rise = abs(at.width);
    at.per_rise = 1.0 / max(at.rise, TINY);
    at.is_monotone = line.turn < at.rise;
    at.per_slope = 1.0 / max(at.rise - line.turn, TINY);
    return at;
}

// A product of distances of values. Beside values of 1e20 it overflows, although curvature is 0 there.
fn finite(product: f32) -> f32 {
    return clamp(product, -GREATEST, GREATEST);
}

// Bound on the effect of a kink, for a change of slope of 1, where the field is on its other side than the line. If the field is
// monotone, that is one triangle at most.
fn beside_kink(at: LineInTable) -> f32 {
    let triangle = min(0.5 * at.line.most * (at.line.most * at.per_slope), at.line.average);
    return select(at.line.average, triangle, at.is_monotone);
}

// Kinks between the ends of a line whose effects are computed: the first and the last one.
struct Kinks {
    // First moments of the channels about the middle, less those of lines with the same rise.
    moments: vec4<f32>,
    // Changes of slope of these kinks, of both together and of every channel.
    settled: f32,
    first: vec4<f32>,
    last: vec4<f32>,
    // Bound on what the means are still off by.
    error: f32,
}

fn no_kinks() -> Kinks {
    let none = vec4<f32>(0.0);
    return Kinks(none, 0.0, none, none, 0.0);
}

// Finds them, and adds to the means what the field's distance from the line does at them.
fn kinks_inside(at: LineInTable, means: ptr<function, vec4<f32>>) -> Kinks {
    var found = no_kinks();
    let ascends = at.width > 0.0;
    let lower = select(at.b.piece, at.a.piece, ascends);
    let upper = select(at.a.piece, at.b.piece, ascends);
    let above = kinks_beside(lower).xy;
    let below = kinks_beside(upper).zw;
    if (!(above.x <= below.x && at.is_monotone)) {
        return found;
    }
    found.first = changes_above(lower);
    add_kink(at, above, found.first, means, &found);
    if (above.x < below.x) {
        found.last = changes_below(upper);
        add_kink(at, below, found.last, means, &found);
    }
    return found;
}

// Adds one kink: its place and greatest change of slope, and the changes of all channels.
fn add_kink(
    at: LineInTable, kink: vec2<f32>, slopes: vec4<f32>, means: ptr<function, vec4<f32>>, found: ptr<function, Kinks>) {
    let p = clamp((kink.x - at.line.ends.x) * select(-at.per_rise, at.per_rise, at.width > 0.0), 0.0, 1.0);
    let both = p * (1.0 - p);
    let aside = 1.0 - 2.0 * p;
    let swing = both * (0.25 * at.line.bow.y * both - (2.0 / 3.0) * at.line.bow.x * aside);
    let r = 0.5 * at.line.bow.y * both * aside + 4.0 * at.line.bow.x * (both - 1.0 / 6.0);
    let second = 0.5 * r * (r * at.per_rise);
    let to_mean = second + select(swing, -swing, at.width > 0.0);
    let to_moment = at.rise * both * aside * (1.0 / 12.0);
    *means = max(*means + slopes * to_mean, vec4<f32>(0.0));
    (*found).moments += slopes * to_moment;
    (*found).settled += kink.y;
    // The second term is smaller, or missing, if the field crosses the kink beyond the part's ends.
    let is_inside = abs(r) <= (at.rise - at.line.turn) * both;
    let share = select(1.0, at.line.turn * at.per_rise, is_inside);
    let most = min(0.5 * r * (r * at.per_slope), at.line.average);
    (*found).error += kink.y * (most * share + abs(to_mean) * (4.0 * EPSILON));
}

// The transfer function over the range of a part: sums of what is uneven in it.
struct Around {
    // Heights of steps.
    steps: f32,
    // Changes of slope in all, those at knots whose effect is not computed, and those whose effect is.
    bends: f32,
    kinks: f32,
    settled: f32,
    // Changes of slope at those knots of the former that the line does not reach.
    beyond: f32,
    // Bound on what the means are off by at the latter.
    left: f32,
    // Whether the range lies between two control points.
    is_one_stretch: bool,
    // Greatest curvature, and its greatest distance from the mean of those at the line's ends; from 0 if the range is no one stretch.
    bend: f32,
    curvature: f32,
    // Variation of colour.
    colors: f32,
}

// All of it but what kinks do, which `add_settled` adds.
fn around_of(at: LineInTable) -> Around {
    let low = extent_of(at.low.piece);
    let stretch = stretch_of(at.low.piece);
    let wide = at.high.y - at.low.y;
    var around: Around;
    around.bends = wide * low.z;
    around.colors = wide * low.w;
    around.is_one_stretch = true;
    around.bend = stretch.y;
    around.curvature = 0.0;
    if (at.has_knots) {
        let high = extent_of(at.high.piece);
        let to = stretch_of(at.high.piece);
        let of_a = stretch_of(at.a.piece).z;
        let of_b = stretch_of(at.b.piece).z;
        let numbers = to.x - stretch.x;
        around.is_one_stretch = numbers < 0.5;
        around.bend = select(config.greatest_bend, max(stretch.y, to.y), numbers < 1.5);
        let away = (to.z - stretch.z) - 0.5 * abs(of_b - of_a);
        around.curvature = select(around.bend, min(away, 2.0 * around.bend), around.is_one_stretch);
        let below = sums_of(at.low.piece);
        let above = sums_of(at.high.piece);
        around.steps = above.x - below.x;
        around.bends = ((above.y + at.high.y * high.z) - (below.y + at.low.y * low.z)) + config.rounded_bends;
        around.colors = (above.w + at.high.y * high.w) - (below.w + at.low.y * low.w);
        around.kinks = above.z - below.z;
    }
    return around;
}

// Takes the kinks whose effect is computed from the others.
fn add_settled(at: LineInTable, settled: Kinks, around: ptr<function, Around>) {
    let inside = abs(sums_of(at.b.piece).z - sums_of(at.a.piece).z);
    (*around).beyond = (*around).kinks - inside;
    (*around).kinks = max(inside - settled.settled, 0.0) + config.rounded_kinks;
    (*around).settled = settled.settled;
    (*around).left = settled.error;
}

// Bound on what the mean of a channel is off by.
fn error_of_mean(at: LineInTable, around: Around, by_ends: bool) -> f32 {
    if (!at.has_knots && !at.line.is_span) {
        return 0.0;
    }
    let curvature = select(around.curvature, around.bend, at.line.is_span);
    let of_curve = curvature * finite(0.5 * at.line.square + at.rise * at.line.swing.y);
    if (!at.has_knots) {
        return of_curve;
    }
    // A narrow interval has the mean of its ends, wherever a step or a kink lies in between.
    let of_steps = around.steps * min((2.0 * at.line.most + config.narrow) * at.per_rise, 1.0);
    let beside = beside_kink(at);
    let any = 0.5 * at.line.average;
    let of_kinks = around.kinks * select(any, beside + at.line.swing.x, at.is_monotone) + around.left;
    let of_beyond = around.beyond * select(any, beside, at.is_monotone);
    let of_ends = (around.kinks + around.settled) * (config.narrow * 0.125);
    let rounded = select(config.rounded_difference * at.per_rise, 0.0, by_ends);
    return of_steps + of_curve + of_kinks + of_beyond + of_ends + rounded;
}

// Bound on what is missed of the effect of order. `numbers`: optical depth, 1 / extinction, opacity, rise of extinction.
fn error_of_order(at: LineInTable, around: Around, at_a: Channels, numbers: vec4<f32>, turn: f32, twist: f32) -> f32 {
    let tau = numbers.x;
    let per_kappa = numbers.y;
    let opacity = numbers.z;
    let slope = at_a.slope + around.bends;
    let curve = around.bend * finite(at.rise * at.rise);
    let kink = around.kinks * at.rise;
    let tilt = abs(numbers.w) * per_kappa;
    // How far extinction, relative to its mean, is from a line; and how far light comes from elsewhere than evenly.
    let of_kinks = (around.settled * at.rise + kink) * (1.0 / 16.0);
    let shape = min(curve * 0.0322 + of_kinks, around.bends * at.rise * (1.0 / 16.0));
    let rest = min((shape + slope * at.line.average + around.steps) * per_kappa, 2.0);
    let elsewhere = min(tau * 0.6 + (tilt * 0.25 + rest) * (tau * 0.6 + 1.0), 1.0);
    let origin = select(1.0, elsewhere, tau <= 1.0);
    // The integral of what emission and extinction, each, are from lines: where the field is one, and where it is not.
    let bow = (slope * origin + around.bends) * at.line.swing.x;
    let moment = select(abs(at.line.moments.y), at.line.swing.y, at.line.is_span);
    var near = 0.5 * around.bend * at.line.square + (bow + slope * moment);
    if (at.has_knots) {
        let of_kinks = kink * min(origin * OF_BENDS + MOMENT_OF_KINK, OF_BENDS);
        near += around.curvature * finite(at.rise * at.rise) * OF_CURVE + of_kinks;
        near += (around.kinks + around.beyond + around.settled) * beside_kink(at);
    }
    let any = around.bends * at.rise * OF_ANY_BENDS + slope * at.line.average;
    let of_steps = around.steps * (0.25 + min(2.0 * at.line.most * at.per_rise, 1.0));
    let uneven = min(twist * origin + near, any) + of_steps;
    // Error of what the line counts of order.
    let of_depth = select(tau * tau * tau * ORDER_OF_DEPTH, 0.0, SERIES_UP_TO < tau);
    let of_tilt = tilt * max(tilt, LEAST_TILT) * ORDER_OF_TILT;
    let of_line = (min(tau, OPAQUE_TILT) * of_tilt + of_depth) * (opacity * tau);
    let of_rest = 0.125 * tau * rest * (tau * 0.25 + 1.0);
    let limit = select(TILT_LIMIT, 2.0, OPAQUE_TILT < tau);
    let bound = turn * per_kappa * at.line.extent * (of_line + of_rest) + opacity * at.line.extent * uneven;
    return select(GREATEST, bound, tilt < limit);
}

// Unevenness of emissions less their mean shares of the extinction, between the ends of a line.
fn twist_of_line(at: LineInTable, bends: vec4<f32>, kinks: Kinks, shares: vec3<f32>) -> f32 {
    let of_curve = (3.0 * OF_CURVE) * finite(at.rise * at.rise) * less_share(bends, shares);
    return of_curve + OF_KINK * at.rise * (less_share(kinks.first, shares) + less_share(kinks.last, shares));
}

// Greatest of the emissions less these shares of the extinction.
fn less_share(channels: vec4<f32>, shares: vec3<f32>) -> f32 {
    return greatest_of(abs(channels.rgb - shares * channels.w));
}

// Bound on how far the densities of light are from linear ones: see `Part`.
fn misplaced_of(at: LineInTable, around: Around, at_a: Channels, kappa: f32, opacity: f32) -> f32 {
    let slope = at_a.slope + around.bends;
    let square_of_rise = finite(at.rise * at.rise);
    let moment = select(abs(at.line.moments.y), at.line.swing.y, at.line.is_span);
    // The transfer function along the line, and what the field's distance from it does.
    var curve = around.bend * OF_CURVE * square_of_rise;
    let bow = (3.0 * around.bends + slope) * at.line.swing.x;
    var off = 0.5 * around.bend * at.line.square + (bow + slope * moment);
    if (at.has_knots) {
        curve += around.curvature * square_of_rise * (OF_CURVES - OF_CURVE);
        curve += at.rise * (around.kinks * OF_UNSETTLED_KINK + around.settled * OF_KINK);
        off += (around.kinks + around.beyond + around.settled) * beside_kink(at);
    }
    let any = around.bends * at.rise * (1.0 / 8.0) + 2.0 * slope * at.line.average;
    let moved = min((2.0 * at.line.most + config.narrow) * at.per_rise, 1.0);
    let extent = at.line.extent;
    let of_field = (min(curve + off, any) + around.steps * (OF_STEP + moved)) * extent;
    // Light from behind is dimmed: the density bends, although emission may not.
    let changed = extent * (slope * (2.0 * at.line.most + at.rise) + around.steps);
    let tau = kappa * extent;
    let deepest = tau + changed;
    let of_depth = OF_CURVE * deepest * (deepest * deepest + 3.0 * changed);
    let of_moment = changed * (opacity * tau * 0.03 + changed * 0.0075);
    let turned = changed * 0.125 + of_field;
    let of_turned = opacity * (turned * turned + of_field);
    let fourth = tau * tau * tau * tau;
    let of_fit = opacity * fourth * tau * 1.0e-5 + changed * fourth * 5.0e-5;
    let near = of_field * (1.0 + opacity) + (of_depth + of_moment + of_turned + of_fit);
    // No density is further from any line whose moment is at most half of its sum.
    return min(near, opacity * 1.5);
}

// Means of the channels over the line.
fn means_of(at: LineInTable, at_a: Channels, at_b: Channels, by_ends: bool) -> vec4<f32> {
    let square = finite(at.width * at.width);
    let of_ends = max(0.5 * ((at_a.value + at_b.value) - at_a.third_bend * square), vec4<f32>(0.0));
    if (by_ends) {
        return of_ends;
    }
    let per_width = select(-at.per_rise, at.per_rise, at.width > 0.0);
    let between = (starts(at.b.piece) - starts(at.a.piece)) + (at_b.rest - at_a.rest);
    return max(between * per_width, vec4<f32>(0.0));
}

// `(tau - 2 + (tau + 2) exp(-tau)) / (2 tau^3)`, for small tau by its series.
fn order_of_even(tau: f32, transmittance: f32) -> f32 {
    let series = 12.0 + tau * (6.0 + tau * (ORDER_SQUARE + tau * ORDER_CUBE));
    let is_deep = SERIES_UP_TO < tau;
    let above = select(1.0, (tau - 2.0) + (tau + 2.0) * transmittance, is_deep);
    return above / select(series, 2.0 * tau * tau * tau, is_deep);
}

// First moments of densities with these sums; at most half of them, as any has.
fn moments_of(sums: vec4<f32>, lean: f32, of_rise: vec4<f32>) -> vec4<f32> {
    return clamp(sums * lean + of_rise, -0.5 * sums, 0.5 * sums);
}

// Integrates a chord.
fn integrate_chord(chord: LightChord) -> Part {
    return integrate_line(line_of(chord));
}

// Integrates along a line.
fn integrate_line(line: Line) -> Part {
    let at = locate(line);
    let of_a = quadratics(at.a.piece);
    var of_b = of_a;
    if (at.has_knots) {
        of_b = quadratics(at.b.piece);
    }
    let at_a = channels_at(of_a, at.a.y);
    let at_b = channels_at(of_b, at.b.y);
    let by_ends = at.a.piece == at.b.piece || at.rise <= config.narrow;
    var means = means_of(at, at_a, at_b, by_ends);
    var around = around_of(at);
    // Curvature, as far as it is even.
    let missed = finite(1.5 * line.moments.x + 3.0 * (at.width * line.moments.y));
    let bends = at_a.third_bend + at_b.third_bend;
    means = max(means + bends * select(0.0, missed, around.is_one_stretch), vec4<f32>(0.0));
    var kinks = no_kinks();
    if (at.has_knots) {
        kinks = kinks_inside(at, &means);
        add_settled(at, kinks, &around);
    }

    let h = line.extent;
    let kappa = means.w;
    let tau = kappa * h;
    let transmittance = exp_minus(tau);
    let opacity = 1.0 - transmittance;
    let per_kappa = 1.0 / max(kappa, LEAST_KAPPA);
    let emitting = select(opacity * per_kappa, h, tau < 1.0e-6);
    let between = at_b.value - at_a.value;
    let rises = between + 12.0 * kinks.moments;
    let order = h * h * (between.w * h * 0.05 + 1.0) * order_of_even(tau, transmittance);
    let square = finite(tau * tau);
    let most = around.colors * (square / (MOST_OF_ORDER * tau + (square + 8.0)));
    let of_color = rises.rgb * kappa - means.rgb * rises.w;
    let ordered = clamp(order * of_color, vec3<f32>(-most), vec3<f32>(most));
    let color = clamp(means.rgb * emitting - ordered, vec3<f32>(0.0), vec3<f32>(opacity));

    let of_ends = max(at_a.value.w, 0.0) + max(at_b.value.w, 0.0) + 2.0 * kappa;
    let slope = at_a.slope + around.bends;
    let noise_share = line.noise * at.per_rise;
    // Beyond its ends the function may grow.
    let by_moved_ends = (of_ends + 2.0 * line.noise * slope) * at.per_rise * (1.0 + 4.0 * noise_share);
    let is_long = noise_share <= SHORT_BESIDE_NOISE;
    let of_noise = line.noise * select(slope, min(slope, by_moved_ends), is_long);
    let of_mean = (error_of_mean(at, around, by_ends) + of_noise) * h;
    let misplaced_steps = min((2.0 * line.noise + config.narrow) * at.per_rise, 1.0);
    let of_rounded_steps = around.steps * select(1.0, misplaced_steps, is_long);
    let shares = min(means.rgb * per_kappa, vec3<f32>(1.0));
    let twist = twist_of_line(at, bends, kinks, shares);
    let turn = greatest_of(abs(of_color));
    let close = error_of_order(at, around, at_a, vec4<f32>(tau, per_kappa, opacity, between.w), turn, twist);
    let of_order = min(close, most + greatest_of(abs(ordered)));
    // An error of a mean shows less in a part that is opaque.
    let least = max(tau - of_mean, 0.0);
    let error = min(of_mean / max(0.5 * least, 1.0), 1.0) + of_order;

    var part = Part(color, transmittance, error, 0.0, vec4<f32>(0.0), 0.0, min(around.colors, 1.0));
    part.rounding = (of_rounded_steps + of_noise) * h * transmittance;
    if (has_flag(FLAG_SHADED)) {
        let lean = -tau / (12.0 + LEAN_SQUARE * square);
        let of_rise = emitting / (12.0 + SPREAD_SQUARE * square);
        part.moments = moments_of(vec4<f32>(color, opacity), lean, of_rise * rises);
        part.misplaced = misplaced_of(at, around, at_a, kappa, opacity + error);
    }
    return part;
}

// `exp(-a)` for a >= 0, error at most 2e-7; 0 from a = 87 on. `2^(n + x)` with integer n and x in [-1/2, 1/2], by the Taylor series
// of `2^x`: the accuracy of the built-in function is not known well enough.
fn exp_minus(a: f32) -> f32 {
    let z = max(a * -1.442695, -126.0);
    let n = floor(z + 0.5);
    let x = z - n;
    var p = 1.540353e-4;
    p = p * x + 1.3333558e-3;
    p = p * x + 9.618129e-3;
    p = p * x + 5.55041e-2;
    p = p * x + 0.2402265;
    p = p * x + 0.6931472;
    p = p * x + 1.0;
    return p * bitcast<f32>((i32(n) + 127) << 23u);
}
