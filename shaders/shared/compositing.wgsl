// Compositing, front to back (RENDERING-MODEL, section 4): adds emission, absorption, surfaces and values to a ray's
// state.

// Adds an interval: premultiplied colour and opacity.
fn composite(rgba: vec4<f32>, state: ptr<function, RayState>) {
    (*state).color += (*state).transmittance * rgba.rgb;
    (*state).transmittance *= 1.0 - rgba.a;
    (*state).weight *= 1.0 - rgba.a;
}

// Adds a surface.
fn composite_surface(color: vec3<f32>, alpha: f32, state: ptr<function, RayState>) {
    (*state).color += (*state).transmittance * alpha * color;
    (*state).transmittance *= 1.0 - alpha;
    (*state).weight *= 1.0 - alpha;
}

// One bit for each iso surface.
fn all_surfaces() -> u32 {
    return select((1u << config.iso_count) - 1u, 0xffffffffu, config.iso_count >= ISO_LIMIT);
}

// Whether nothing further along the ray can change its result.
fn is_settled(state: ptr<function, RayState>) -> bool {
    let opaque = (*state).transmittance <= config.transmittance_limit;
    return opaque || (mode() == MODE_ISO && (*state).crossed == all_surfaces());
}

// Surfaces whose iso value is at most `value`, one bit each.
fn sides_of(value: f32) -> u32 {
    var sides = 0u;
    work += config.iso_count;
    for (var i = 0u; i < config.iso_count; i += 1u) {
        sides |= select(0u, 1u << i, value >= scene.tables.isos[i].value);
    }
    return sides;
}

// Passes a part of the ray without present voxels.
fn gather_absent(state: ptr<function, RayState>) {
    if (has_flag(FLAG_SURFACES)) {
        // A crossing needs a value on both sides.
        (*state).present = 0.0;
    }
}

// Passes a macro cell that need not be visited.
fn gather_skipped(range: vec2<f32>, state: ptr<function, RayState>) {
    if (range.x > range.y) {
        gather_absent(state);
    } else if (has_flag(FLAG_SURFACES)) {
        (*state).sides = sides_of(range.x);
        (*state).present = 1.0;
    }
}

// Whether a region with this range of values can be visible at all.
fn is_shown(range: vec2<f32>) -> bool {
    if (!has_flag(FLAG_SKIPPING)) {
        return true;
    }
    if (range.x > range.y || mode() != MODE_DVR) {
        return range.x <= range.y;
    }
    if (has_flag(FLAG_SURFACES) && (has_flag(FLAG_HOLES) || sides_of(range.x) != sides_of(range.y))) {
        // With absent voxels, a ray forgets its side of the surfaces inside this cell. It must not leap over the cell
        // together with transparent ones.
        return true;
    }
    return is_visible(range.x, range.y);
}

// Whether a macro cell with this range can change the ray's result.
fn is_worth_a_visit(range: vec2<f32>, state: ptr<function, RayState>) -> bool {
    if (!has_flag(FLAG_SKIPPING)) {
        return true;
    }
    if (range.x > range.y) {
        return false;
    }
    let present = (*state).present > 0.0;
    switch mode() {
        case MODE_MIP: { return !present || range.y > (*state).color.x; }
        case MODE_MINIP: { return !present || range.x < (*state).color.x; }
        case MODE_MEAN: { return true; }
        case MODE_ISO: { return meets_surfaces(range, state); }
        default: { return !has_flag(FLAG_SURFACES) || is_visible(range.x, range.y) || meets_surfaces(range, state); }
    }
}

// Whether surfaces lie in a macro cell with this range, or at its front face, where values may jump.
fn meets_surfaces(range: vec2<f32>, state: ptr<function, RayState>) -> bool {
    let below = sides_of(range.x);
    let inside = sides_of(range.y) & ~below;
    let jumped = select(0u, (*state).sides ^ below, (*state).present > 0.0);
    return ((inside | jumped) & ~(*state).crossed & all_surfaces()) != 0u;
}

// Adds a part of the ray with one constant value and no gradient.
fn gather_uniform(value: f32, extent: f32, state: ptr<function, RayState>) {
    switch mode() {
        case MODE_DVR: {
            if (has_flag(FLAG_SURFACES)) {
                gather_jumps(sides_of(value), state);
            }
            let rgba = classify(value);
            samples += 1u;
            let opacity = opacity_of(extinction(rgba.a) * extent);
            composite(vec4<f32>(opacity * rgba.rgb, opacity), state);
        }
        case MODE_ISO: { gather_jumps(sides_of(value), state); }
        default: { gather_value(vec2<f32>(value), value, extent, state); }
    }
}

// Adds the surfaces between the ray's sides and these sides, across which the value jumps.
fn gather_jumps(sides: u32, state: ptr<function, RayState>) {
    let jumped = select(0u, (*state).sides ^ sides, (*state).present > 0.0) & ~(*state).crossed;
    for (var i = 0u; i < config.iso_count; i += 1u) {
        if ((jumped & (1u << i)) != 0u) {
            composite_surface(scene.tables.isos[i].color, scene.tables.isos[i].alpha, state);
        }
    }
    // In mode `dvr`, every crossing counts, also repeated ones.
    (*state).crossed |= select(0u, jumped, mode() == MODE_ISO);
    (*state).sides = sides;
    (*state).present = 1.0;
}

// Whether the mode counts a value whatever the length of its chord.
fn counts_by_value() -> bool {
    return mode() == MODE_MIP || mode() == MODE_MINIP || mode() == MODE_MEAN;
}

// Whether a length, in cells along each axis, may be a rounding error, for example the rest of a cell beside a clip
// plane. Modes `mip`, `minip` and `mean` ignore such parts.
fn is_rounding(way: vec3<f32>) -> bool {
    return all(abs(way) <= vec3<f32>(POSITION_ERROR));
}

// Modes `mip`, `minip` and `mean`: adds a part with these (least, greatest) values and this mean.
fn gather_value(extremes: vec2<f32>, mean: f32, extent: f32, state: ptr<function, RayState>) {
    switch mode() {
        case MODE_MIP: { (*state).color.x = max((*state).color.x, extremes.y); }
        case MODE_MINIP: { (*state).color.x = min((*state).color.x, extremes.x); }
        default: { (*state).color.x += mean * extent; }
    }
    (*state).present += extent;
}
