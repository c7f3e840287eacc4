// Emission and absorption on a chord by antiderivatives of the transfer function, with an error bound. Twin of
// engines/gpu/twins.rs; engines/packets/integrate.rs derives the rule and its error.
//
// Values are counted in bins of the light table (engines/gpu/light_table.rs), extents in unit distances.

// Width of an interval, in bins, up to which its mean is taken from its two ends.
const NARROW: f32 = 1.0;
// 1 / (greatest stored root squared).
const PER_SQUARE: f32 = 1.0 / (f32(GREATEST_ROOT) * f32(GREATEST_ROOT));

// The channels at a value: red, green, blue (each times extinction), extinction.
struct LightAt {
    // Antiderivatives: at the beginning of the bin, and from there to the value.
    start: vec4<i32>,
    rest: vec4<f32>,
    // The channels themselves.
    value: vec4<f32>,
}

// The bin of a value; values outside the table get the bin before the first or behind the last.
fn light_bin(value: f32) -> f32 {
    return clamp(floor(value), -1.0, f32(LIGHT_BINS));
}

// The first texel of a bin.
fn light_texel(bin: f32) -> vec2<u32> {
    let number = LIGHT_TEXELS * u32(bin + 1.0);
    return vec2<u32>(number % TABLE_WIDTH, number / TABLE_WIDTH);
}

// Four 16-bit halves of two words: low and high half of the first, then of the second.
fn halves_of(words: vec2<u32>) -> vec4<f32> {
    return vec4<f32>(vec4<u32>(words.x, words.x >> 16u, words.y, words.y >> 16u) & vec4<u32>(0xffffu));
}

fn light_at(value: f32) -> LightAt {
    let bin = light_bin(value);
    let texel = light_texel(bin);
    let y = value - max(bin, 0.0);
    let start = light_texel_at(texel);
    let ends = light_texel_at(texel + vec2<u32>(1u, 0u));
    let left_root = halves_of(ends.xy);
    let right_root = halves_of(ends.zw);
    let share = config.light_most * PER_SQUARE;
    let left = share * left_root * left_root;
    let rise = share * right_root * right_root - left;
    return LightAt(bitcast<vec4<i32>>(start), y * (left + (0.5 * y) * rise), left + y * rise);
}

// Sums for the bin of a value (`behind` = 0) or the bin after it (`behind` = 1). Components: bends below the bin,
// colour variation below it, colour variation in it, and in the bin before it.
fn light_sums(value: f32, behind: f32) -> vec4<f32> {
    let texel = light_texel(min(light_bin(value) + behind, f32(LIGHT_BINS)));
    return bitcast<vec4<f32>>(light_texel_at(texel + vec2<u32>(2u, 0u)));
}

// The field along a part of a ray: values at its beginning, middle and end, and the coefficient of the third power.
struct LightChord {
    values: vec3<f32>,
    cubic: f32,
    extent: f32,
}

// The contribution of a part of a ray.
struct LightPart {
    // Premultiplied colour, and transmittance of the part.
    color: vec3<f32>,
    transmittance: f32,
    // Bound on the error of both, without `fit`.
    error: f32,
    // Error of the table: linear interpolation in bins, and rounding to integers. Splitting the part does not reduce
    // it.
    fit: f32,
    // Light from the front end as a share of the light from both ends, if it varies linearly between them.
    front_share: f32,
    // Share of the part by which linearly varying light may be misplaced.
    misplaced: f32,
    // Variation of colour over the part.
    colors: f32,
}

// An empty part.
fn no_part() -> LightPart {
    return LightPart(vec3<f32>(0.0), 1.0, 0.0, 0.0, 0.0, 0.0, 0.0);
}

// A line that approximates the field along a part of a ray, with bounds on the distance between both.
struct LightLine {
    begin: f32,
    end: f32,
    // Bounds of both the field and the line.
    low: f32,
    high: f32,
    // Greatest distance of the field from the line, and a bound on the mean distance.
    most: f32,
    average: f32,
    extent: f32,
}

// The line of an empty part.
fn no_line() -> LightLine {
    return LightLine(0.0, 0.0, FAR, -FAR, -FAR, 0.0, 0.0);
}

// The line with the field's mean and the difference of its end values.
fn line_of(chord: LightChord) -> LightLine {
    let first = chord.values.x;
    let middle = chord.values.y;
    let last = chord.values.z;
    let rise = last - first;
    let mean = middle * (4.0 / 6.0) + (first + last) * (1.0 / 6.0);
    let bump = abs(middle - 0.5 * (first + last));
    let cubic = abs(chord.cubic);
    let most = (2.0 / 3.0) * bump + GREATEST_OF_CUBIC * cubic;
    let margin = most + GREATEST_OF_CUBIC * cubic;
    let low = min(min(first, last), middle) - margin;
    let high = max(max(first, last), middle) + margin;
    let average = AVERAGE_OF_BUMP * bump + AVERAGE_OF_CUBIC * cubic;
    return LightLine(mean - 0.5 * rise, mean + 0.5 * rise, low, high, most, average, chord.extent);
}

// The line that approximates the field along two consecutive parts. Its distance from each part's own line is linear
// from end to end. Adding that distance to the part's own bounds gives the bounds of the common line.
fn line_over(a: LightLine, b: LightLine) -> LightLine {
    let extent = a.extent + b.extent;
    let share = a.extent / max(extent, TINY);
    let mean = 0.5 * (share * (a.begin + a.end) + (1.0 - share) * (b.begin + b.end));
    let rise = (a.end - a.begin) + (b.end - b.begin);
    let begin = mean - 0.5 * rise;
    let end = mean + 0.5 * rise;
    let joint = begin + share * rise;
    let of_a = vec2<f32>(a.begin - begin, a.end - joint);
    let of_b = vec2<f32>(b.begin - joint, b.end - end);
    let most_a = a.most + max(abs(of_a.x), abs(of_a.y));
    let most_b = b.most + max(abs(of_b.x), abs(of_b.y));
    let average_a = a.average + mean_distance(of_a);
    let average_b = b.average + mean_distance(of_b);
    let low = min(min(a.low, b.low), min(begin, end));
    let high = max(max(a.high, b.high), max(begin, end));
    return LightLine(begin, end, low, high, max(most_a, most_b), share * average_a + (1.0 - share) * average_b, extent);
}

// Bound on the mean magnitude of a number that varies linearly between two ends.
fn mean_distance(ends: vec2<f32>) -> f32 {
    return 0.25 * (abs(ends.x) + abs(ends.y) + abs(ends.x + ends.y));
}

// Share of the light that may come in another order than along a line that approximates several parts.
fn disorder_of(line: LightLine) -> f32 {
    return min(2.0 * line.most / max(abs(line.end - line.begin), TINY), 1.0);
}

// Integrates a chord.
fn integrate_chord(chord: LightChord) -> LightPart {
    return integrate_line(line_of(chord), 0.0);
}

// Integrates along a line. `disorder` is `disorder_of` for several parts, else 0.
fn integrate_line(line: LightLine, disorder: f32) -> LightPart {
    let begin = line.begin;
    let end = line.end;
    let rise = end - begin;
    let a = light_at(begin);
    let b = light_at(end);
    // Also within one bin: far outside the table, antiderivatives would cancel.
    let is_narrow = abs(rise) <= NARROW || light_bin(begin) == light_bin(end);
    let per_rise = 1.0 / select(rise, 1.0, is_narrow);
    let of_sums = (vec4<f32>(b.start - a.start) * config.light_unit + (b.rest - a.rest)) * per_rise;
    let means = max(select(of_sums, 0.5 * (a.value + b.value), is_narrow), vec4<f32>(0.0));
    let extent = line.extent;
    let kappa = means.w;
    let tau = kappa * extent;
    let transmittance = exp(-tau);
    let opacity = 1.0 - transmittance;
    let is_clear = tau < 1.0e-6;
    let emitting = select(opacity / select(kappa, 1.0, is_clear), extent, is_clear);
    let order = extent * extent / (12.0 + tau * (6.0 + ORDER_SQUARE * tau));
    let between = b.value - a.value;
    let ordered = order * (between.rgb * kappa - means.rgb * between.w);

    // Error of the line.
    let low = line.low;
    let high = line.high;
    let sums_high = light_sums(high, 1.0);
    let sums_low = light_sums(low, 0.0);
    let sums = sums_high.xy - sums_low.xy;
    let of_mean = 0.5 * sums.x * line.average * extent;
    // The order of colours cannot have a greater effect with colour differences this small.
    let reach = opacity * (1.0 - 0.5 * transmittance);
    let greatest = vec3<f32>(0.5 * min(sums.y, 1.0) * reach * reach);
    let emitted = means.rgb * emitting - clamp(ordered, -greatest, greatest);
    let color = clamp(emitted, vec3<f32>(0.0), vec3<f32>(opacity));
    let uneven = min(0.25 * sums.x * abs(rise) / max(kappa, 1.0e-12), 1.0);
    // Uneven colour variation is bounded by the variation minus the even share. Beyond the last bin colour does not
    // change.
    let slope_high = select(sums_high.w, 0.0, high >= f32(LIGHT_BINS));
    let even_colors = min(sums_low.z, slope_high) * (light_bin(high) + 1.0 - light_bin(low));
    let out_of_order = OUT_OF_ORDER * max(sums.y * max(uneven, disorder), sums.y - even_colors) + ORDER_REST * sums.y;
    let of_order = opacity * out_of_order * tau / (4.0 + tau);
    let error = clamp(of_mean, 0.0, 1.0) + of_order;
    // Error within a bin: bends are approximated by a line, whose ends are rounded roots.
    let of_bin = 0.5 * sums.x + 2.0 * sqrt(kappa * config.light_most) * (1.0 / f32(GREATEST_ROOT)) + config.light_unit;
    let fit = min(of_bin * extent / max(abs(rise), 1.0), 1.0);
    // If both ends are dark, the light in between can come from anywhere.
    let dim = 1.0e-3 * kappa + TINY;
    let at_front = max(a.value.w, 0.0) + dim;
    let at_back = max(b.value.w, 0.0) * transmittance + dim;
    // In a nearly opaque part, light does not decrease linearly from end to end.
    let fall = FALL_MISPLACED * tau * tau / (1.0 + FALL_END * tau * tau);
    let front_share = at_front / (at_front + at_back);
    return LightPart(color, transmittance, error, fit, front_share, UNEVEN_MISPLACED * uneven + fall, min(sums.y, 1.0));
}
