// Colour and opacity of a value, exact for any number of bins. Twin of crates/scene transfer_function/render.rs.

fn table_place(i: u32) -> vec2<u32> {
    return vec2<u32>(i % TABLE_WIDTH, i / TABLE_WIDTH);
}

// Red, green, blue and alpha at a point.
fn point_rgba(i: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(textureLoad(points, table_place(4u * i), 0));
}

// Change of each channel up to the next point.
fn point_delta(i: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(textureLoad(points, table_place(4u * i + 1u), 0));
}

// Value, 1 / width of the segment, variation before the segment, variation of the segment.
fn point_shape(i: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(textureLoad(points, table_place(4u * i + 2u), 0));
}

// Number of visible points before a point, and of knots up to it.
fn point_counts(i: u32) -> vec2<u32> {
    return textureLoad(points, table_place(4u * i + 3u), 0).xy;
}

// Index of the segment before the first control point.
const BEFORE_FIRST: u32 = 0xffffffffu;

// Index of the last point with a value not greater than `value`, or BEFORE_FIRST.
fn tf_segment(value: f32) -> u32 {
    let from_first = value - point_shape(0u).x;
    if (from_first < 0.0) {
        return BEFORE_FIRST;
    }
    // Clamped before the conversion: converting a value outside the range of u32 is undefined.
    let bin = u32(min(from_first * config.bins_per_value, f32(config.bin_count - 1u)));
    var i = textureLoad(transfer_index, table_place(bin), 0).x;
    while (i + 1u < config.point_count && value >= point_shape(i + 1u).x) {
        i += 1u;
        work += 1u;
    }
    return i;
}

// Position of a value in a segment: 0 at its left point, 1 at the next.
fn tf_position(segment: u32, value: f32) -> f32 {
    let shape = point_shape(segment);
    return min((value - shape.x) * shape.y, 1.0);
}

// Red, green, blue and alpha at a render value.
fn classify(value: f32) -> vec4<f32> {
    let i = tf_segment(value);
    if (i == BEFORE_FIRST) {
        return point_rgba(0u);
    }
    return point_rgba(i) + tf_position(i, value) * point_delta(i);
}

// Number of points with positive alpha up to and including a segment's left point.
fn visible_points_up_to(segment: u32) -> u32 {
    if (segment == BEFORE_FIRST) {
        return 0u;
    }
    if (segment + 1u < config.point_count) {
        return point_counts(segment + 1u).x;
    }
    return config.visible_points;
}

// Whether a value of the closed interval can have positive opacity; false for the empty interval `low > high`.
fn is_visible(low: f32, high: f32) -> bool {
    if (low > high || config.visible_points == 0u) {
        return false;
    }
    return classify(low).a > 0.0
        || classify(high).a > 0.0
        || visible_points_up_to(tf_segment(high)) > visible_points_up_to(tf_segment(low));
}

// Sum of the variation below a value.
fn tf_gathered(value: f32) -> f32 {
    let i = tf_segment(value);
    if (i == BEFORE_FIRST) {
        return 0.0;
    }
    let shape = point_shape(i);
    return shape.z + min((value - shape.x) * shape.y, 1.0) * shape.w;
}

// Total variation of alpha, and of colour weighted by its visibility, over the closed interval.
fn variation(low: f32, high: f32) -> f32 {
    return tf_gathered(high) - tf_gathered(low);
}

// Value of a knot.
fn knot(index: u32) -> f32 {
    return bitcast<f32>(textureLoad(transfer_index, table_place(config.bin_count + index), 0).x);
}

fn knots_up_to(value: f32) -> u32 {
    let i = tf_segment(value);
    if (i == BEFORE_FIRST) {
        return 0u;
    }
    return point_counts(i).y;
}

// Knots strictly between `low` and `high`: (first, one past the last).
fn knots_in(low: f32, high: f32) -> vec2<u32> {
    let start = knots_up_to(low);
    var end = knots_up_to(high);
    if (end > start && knot(end - 1u) >= high) {
        end -= 1u;
    }
    return vec2<u32>(start, max(start, end));
}

// `-ln(1 - alpha)`, accurate for small alpha, where `1 - alpha` would round the digits away.
fn absorbance(alpha: f32) -> f32 {
    if (alpha < 0.0625) {
        // Taylor series; the first omitted term is below 2^-24 of the sum.
        let terms = 1.0 / 2.0 + alpha * (1.0 / 3.0 + alpha * (1.0 / 4.0 + alpha * (1.0 / 5.0 + alpha * (1.0 / 6.0))));
        return alpha + alpha * alpha * terms;
    }
    return -log(1.0 - alpha);
}

// Extinction per world length of an opacity.
fn extinction(alpha: f32) -> f32 {
    return absorbance(min(alpha, config.alpha_limit)) * config.inverse_unit_distance;
}
