// Emission and absorption on a chord by antiderivatives of the transfer function, with what the rule can miss; twin of
// gpu/twins.rs. raycast/cpu/integrate.rs derives the rule and its error.
//
// Values are bins of the transfer function (gpu/light_table.rs), extents are in unit distances.

// Width, in bins, up to which the mean of an interval is that of its ends.
const NARROW: f32 = 1.0;
// 1 over the square of the greatest root.
const PER_SQUARE: f32 = 1.0 / (f32(GREATEST_ROOT) * f32(GREATEST_ROOT));

// The channels at a value: red, green, blue (times extinction), extinction.
struct LightAt {
    // Antiderivatives: where the bin begins, and from there on.
    start: vec4<i32>,
    rest: vec4<f32>,
    // The channels themselves.
    value: vec4<f32>,
}

// The bin of a value, one on either side for those beyond.
fn light_bin(value: f32) -> f32 {
    return clamp(floor(value), -1.0, f32(LIGHT_BINS));
}

// The first texel of a bin.
fn light_texel(bin: f32) -> vec2<u32> {
    let number = LIGHT_TEXELS * u32(bin + 1.0);
    return vec2<u32>(number % TABLE_WIDTH, number / TABLE_WIDTH);
}

// The lower 16 bits of two words, and their upper ones, in turn.
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

// Bends and variation of colour below a value's bin, or below the bin behind it; variation of colour in that bin, and in the one before it.
fn light_sums(value: f32, behind: f32) -> vec4<f32> {
    let texel = light_texel(min(light_bin(value) + behind, f32(LIGHT_BINS)));
    return bitcast<vec4<f32>>(light_texel_at(texel + vec2<u32>(2u, 0u)));
}

// The field along a part of a ray: at its beginning, middle and end, and the coefficient of the third power.
struct LightChord {
    values: vec3<f32>,
    cubic: f32,
    extent: f32,
}

// What a part of a ray adds.
struct LightPart {
    // Premultiplied colour, and the share of light from behind that gets through.
    color: vec3<f32>,
    transmittance: f32,
    // Bound on the error of both, beside `fit`.
    error: f32,
    // What the table may be off by: bins are blunt, and whole numbers rounded. Shorter parts are off by as much.
    fit: f32,
    // Light from the front end, over that from both, if it varies evenly between them.
    front_share: f32,
    // By what share of the part light that varies evenly may be misplaced.
    misplaced: f32,
    // Variation of colour over the part.
    colors: f32,
}

// Nothing at all.
fn no_part() -> LightPart {
    return LightPart(vec3<f32>(0.0), 1.0, 0.0, 0.0, 0.0, 0.0, 0.0);
}

// The line that stands for the field along a part of a ray, and how far the field is from it.
struct LightLine {
    begin: f32,
    end: f32,
    // Bounds of the field, and of the line.
    low: f32,
    high: f32,
    // Greatest distance of the field from the line, and a bound on its mean.
    most: f32,
    average: f32,
    extent: f32,
}

// That of nothing yet.
fn no_line() -> LightLine {
    return LightLine(0.0, 0.0, FAR, -FAR, -FAR, 0.0, 0.0);
}

// The line with the field's mean and the difference between its ends.
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

// The line that stands for the field along two parts, one behind the other. Its distance from each of theirs
// goes evenly from end to end: so what is known of their distances from the field says how far the field is from this one.
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

// Bound on the mean distance from 0 of what goes evenly from one number to another.
fn mean_distance(ends: vec2<f32>) -> f32 {
    return 0.25 * (abs(ends.x) + abs(ends.y) + abs(ends.x + ends.y));
}

// Share of the light that may come in another order than along a line that stands for several parts.
fn disorder_of(line: LightLine) -> f32 {
    return min(2.0 * line.most / max(abs(line.end - line.begin), TINY), 1.0);
}

// Integrates a chord.
fn integrate_chord(chord: LightChord) -> LightPart {
    return integrate_line(line_of(chord), 0.0);
}

// Integrates along a line; of several parts, `disorder` is `disorder_of`, else 0.
fn integrate_line(line: LightLine, disorder: f32) -> LightPart {
    let begin = line.begin;
    let end = line.end;
    let rise = end - begin;
    let a = light_at(begin);
    let b = light_at(end);
    // In one bin as well: far outside of all, antiderivatives would cancel.
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

    // What the line misses.
    let low = line.low;
    let high = line.high;
    let sums_high = light_sums(high, 1.0);
    let sums_low = light_sums(low, 0.0);
    let sums = sums_high.xy - sums_low.xy;
    let of_mean = 0.5 * sums.x * line.average * extent;
    // No more than order can do to colours that differ so much.
    let reach = opacity * (1.0 - 0.5 * transmittance);
    let greatest = vec3<f32>(0.5 * min(sums.y, 1.0) * reach * reach);
    let emitted = means.rgb * emitting - clamp(ordered, -greatest, greatest);
    let color = clamp(emitted, vec3<f32>(0.0), vec3<f32>(opacity));
    let uneven = min(0.25 * sums.x * abs(rise) / max(kappa, 1.0e-12), 1.0);
    // Colour may also be the uneven one: even, and then not. Beyond the last bin it does not change.
    let slope_high = select(sums_high.w, 0.0, high >= f32(LIGHT_BINS));
    let even_colors = min(sums_low.z, slope_high) * (light_bin(high) + 1.0 - light_bin(low));
    let out_of_order = OUT_OF_ORDER * max(sums.y * max(uneven, disorder), sums.y - even_colors) + ORDER_REST * sums.y;
    let of_order = opacity * out_of_order * tau / (4.0 + tau);
    let error = clamp(of_mean, 0.0, 1.0) + of_order;
    // Within a bin a line stands for what bends there; its ends are rounded roots.
    let of_bin = 0.5 * sums.x + 2.0 * sqrt(kappa * config.light_most) * (1.0 / f32(GREATEST_ROOT)) + config.light_unit;
    let fit = min(of_bin * extent / max(abs(rise), 1.0), 1.0);
    // Where both ends are dark, the light in between comes from anywhere.
    let dim = 1.0e-3 * kappa + TINY;
    let at_front = max(a.value.w, 0.0) + dim;
    let at_back = max(b.value.w, 0.0) * transmittance + dim;
    // Evenly from end to end is not how light falls off in a part that is nearly opaque.
    let fall = FALL_MISPLACED * tau * tau / (1.0 + FALL_END * tau * tau);
    let front_share = at_front / (at_front + at_back);
    return LightPart(color, transmittance, error, fit, front_share, UNEVEN_MISPLACED * uneven + fall, min(sums.y, 1.0));
}
