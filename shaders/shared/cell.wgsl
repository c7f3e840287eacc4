// One trilinear cell: the contribution of its chord to a ray.

// The ray's chord in a cell: entry and exit in [0, 1]^3, and the world length in between.
struct Chord {
    a: vec3<f32>,
    b: vec3<f32>,
    extent: f32,
}

// The field and its gradient along a chord.
struct CellView {
    // (least, greatest) corner.
    range: vec2<f32>,
    // The field is `pivot + cubic(u)`. The pivot is one of the cell's values. So the cubic has only the rounding error
    // of differences inside the cell, and crosses steps of the transfer function at the right position.
    pivot: f32,
    cubic: vec4<f32>,
    intervals: vec4<f32>,
    gradient: ChordGradient,
    extent: f32,
}

// s(u), clamped to the corners' range: rounding must not produce a value that the range excludes.
fn value_at(view: CellView, u: f32) -> f32 {
    return clamp(view.pivot + cubic_at(view.cubic, u), view.range.x, view.range.y);
}

// A cell's corners, with absent ones replaced if they have no weight on the chord.
fn corners_along(own: Corners, chord: Chord) -> Corners {
    if (has_flag(FLAG_HOLES) && has_holes(own)) {
        return replace_unreached(own, chord.a, chord.b);
    }
    return own;
}

fn gather_cell(slot: Slot, cell: vec3<i32>, chord: Chord, ray: LocalRay, state: ptr<function, RayState>) {
    let own = corners_of(slot, cell);
    let corners = corners_along(own, chord);
    if (has_flag(FLAG_HOLES) && has_holes(corners)) {
        gather_absent(state);
        return;
    }
    let range = range_of_corners(corners);
    let is_clear = mode() == MODE_DVR && !has_flag(FLAG_SURFACES) && !is_visible(range.x, range.y);
    if (is_clear || !is_worth_a_visit(range, state)) {
        gather_skipped(range, state);
        return;
    }
    var view = cell_view(corners, range, chord);
    switch mode() {
        case MODE_DVR: {
            view.gradient = chord_gradient(slot, cell, own, chord);
            gather_between_surfaces(view, ray, state);
        }
        case MODE_ISO: {
            view.gradient = chord_gradient(slot, cell, own, chord);
            gather_surfaces(view, ray, state);
        }
        default: {
            if (is_rounding(chord.b - chord.a)) {
                return;
            }
            let extremes = view.pivot + cubic_extremes(view.cubic, view.intervals);
            let mean = view.pivot + cubic_mean(view.cubic);
            gather_value(clamp(extremes, view.range.xx, view.range.yy), mean, chord.extent, state);
        }
    }
}

// (least, greatest) corner.
fn range_of_corners(corners: Corners) -> vec2<f32> {
    let least = min(corners.low, corners.high);
    let greatest = max(corners.low, corners.high);
    return vec2<f32>(
        min(min(least.x, least.y), min(least.z, least.w)),
        max(max(greatest.x, greatest.y), max(greatest.z, greatest.w)),
    );
}

// The field along a chord, without its gradient.
fn cell_view(corners: Corners, range: vec2<f32>, chord: Chord) -> CellView {
    var view: CellView;
    view.range = range;
    view.pivot = corners.low.x;
    view.cubic = cubic_of_cell(corners.low - view.pivot, corners.high - view.pivot, chord.a, chord.b);
    view.intervals = monotone_intervals(view.cubic);
    view.extent = chord.extent;
    return view;
}

// Mode dvr: alternately volume up to the next surface, and the surface itself.
fn gather_between_surfaces(view: CellView, ray: LocalRay, state: ptr<function, RayState>) {
    var left = no_crossings();
    if (has_flag(FLAG_SURFACES)) {
        if (meets_surfaces(view.range, state)) {
            left = first_of_crossings(view, state);
        } else {
            gather_skipped(view.range, state);
        }
    }
    var begin = 0.0;
    var goes_on = true;
    while (goes_on) {
        let end = min(left.u, 1.0);
        gather_light(view, begin, end, ray, state);
        begin = end;
        goes_on = left.u <= 1.0;
        if (goes_on) {
            let iso = scene.tables.isos[left.surface];
            composite_surface(shaded(view.gradient, left.u, ray, iso.color), iso.alpha, state);
            next_crossing(view, &left);
        }
    }
}

// Integrates a stretch of the chord, split where its cubic crosses a knot of the transfer function.
fn gather_light(view: CellView, first: f32, last: f32, ray: LocalRay, state: ptr<function, RayState>) {
    let knots = knots_in(view.range.x, view.range.y);
    let count = select(0u, knots.y - knots.x, knots.y - knots.x <= KNOT_LIMIT);
    // One loop with one call for split and unsplit chords, because compilers inline a function at every call.
    let splits = 3u * count;
    var begin = first;
    for (var i = 0u; i <= splits; i += 1u) {
        work += 1u;
        var end = last;
        if (i < splits) {
            end = split_at(view, knots, i / count, i % count);
        }
        if (end > begin && (end < last || i == splits)) {
            gather_part(view, begin, end, ray, state);
            begin = end;
        }
    }
}

// The u at which a monotone piece of the cubic crosses the i-th of the given knots, or NEVER.
fn split_at(view: CellView, knots: vec2<u32>, piece: u32, i: u32) -> f32 {
    let first = view.intervals[piece];
    let last = view.intervals[piece + 1u];
    if (first >= last) {
        return NEVER;
    }
    // A monotone piece crosses the knots in ascending or in descending order.
    let rises = cubic_at(view.cubic, last) > cubic_at(view.cubic, first);
    let index = select(knots.y - 1u - i, knots.x + i, rises);
    return monotone_root(view.cubic, first, last, knot(index) - view.pivot);
}

// Integrates a part of the chord with as many Gauss pairs as the variation of the transfer function requires.
fn gather_part(view: CellView, u0: f32, u1: f32, ray: LocalRay, state: ptr<function, RayState>) {
    let tau = depth_between(view, u0, u1);
    let for_half_a_level = f32(max(pairs_between(view, u0, u1, tau), shaded_pairs(view.gradient, u0, u1, ray, tau)));
    let pairs = u32(clamp(ceil(for_half_a_level * config.pair_share), 1.0, f32(PAIR_LIMIT)));
    let width = (u1 - u0) / f32(pairs);
    work += pairs;
    for (var i = 0u; i < pairs; i += 1u) {
        let begin = u0 + f32(i) * width;
        var kappa = vec2<f32>(0.0);
        var near_color = vec3<f32>(0.0);
        var far_color = vec3<f32>(0.0);
        for (var point = 0u; point < 2u; point += 1u) {
            let u = begin + select(1.0 - GAUSS_OFFSET, GAUSS_OFFSET, point == 0u) * width;
            let rgba = classify(value_at(view, u));
            near_color = far_color;
            far_color = shaded(view.gradient, u, ray, rgba.rgb);
            kappa = vec2<f32>(kappa.y, extinction(rgba.a));
        }
        samples += 2u;
        if (kappa.x > 0.0 || kappa.y > 0.0) {
            composite(integrate_pair(kappa, near_color, far_color, width * view.extent), state);
        }
    }
}

// Mode iso: surfaces that the ray crosses for the first time, in their order along the ray.
fn gather_surfaces(view: CellView, ray: LocalRay, state: ptr<function, RayState>) {
    let known = (*state).present > 0.0;
    for (var n = 0u; n < config.iso_count; n += 1u) {
        work += config.iso_count;
        var nearest = NEVER;
        var surface = 0u;
        for (var i = 0u; i < config.iso_count; i += 1u) {
            let bit = 1u << i;
            if (((*state).crossed & bit) == 0u) {
                let value = scene.tables.isos[i].value;
                let before = select(value_at(view, 0.0) >= value, ((*state).sides & bit) != 0u, known);
                let u = first_change(view, value, before);
                if (u < nearest) {
                    nearest = u;
                    surface = i;
                }
            }
        }
        if (nearest > 1.0) {
            break;
        }
        let iso = scene.tables.isos[surface];
        composite_surface(shaded(view.gradient, nearest, ray, iso.color), iso.alpha, state);
        (*state).crossed |= 1u << surface;
    }
    (*state).sides = sides_of(value_at(view, 1.0));
    (*state).present = 1.0;
}

// The first u at which the cubic lies on the other side of a value than `before` says, or NEVER.
fn first_change(view: CellView, value: f32, before: bool) -> f32 {
    if ((value_at(view, 0.0) >= value) != before) {
        return 0.0;
    }
    if (value < view.range.x || value > view.range.y) {
        return NEVER;
    }
    for (var piece = 0u; piece < 3u; piece += 1u) {
        let u = monotone_root(view.cubic, view.intervals[piece], view.intervals[piece + 1u], value - view.pivot);
        if (u <= 1.0) {
            return u;
        }
    }
    // Rounding may hide a crossing just before the beginning or behind the end. The end that is nearer to the value is
    // taken.
    if ((value_at(view, 1.0) >= value) != before) {
        let begin = abs(view.pivot + cubic_at(view.cubic, 0.0) - value);
        let end = abs(view.pivot + cubic_at(view.cubic, 1.0) - value);
        return select(1.0, 0.0, begin < end);
    }
    return NEVER;
}
