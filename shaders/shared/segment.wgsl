// The drawn segment of a ray: inside the volume's domain, the clip box and all clip planes. If solids leave several
// segments, the host computes them (engines/gpu/ray_parts.rs) and passes one after the other.
//
// The segment is computed in two steps: roughly, in strides from the ray's origin, then exactly, from a base point near
// each end.

// Error of the rough search in strides: an absolute part and a relative part.
const ROUGH_STRIDES: f32 = 2.0;
const ROUGH_SHARE: f32 = 1.0e-6;
// More strides than a ray takes through the largest volume.
const MOST_STRIDES: f32 = 1.0e9;

// Parameters at which a line enters and leaves the kept region; empty if enter > leave.
struct Interval {
    enter: f32,
    leave: f32,
}

// The part of an interval in which `height + t * rate >= 0`.
fn cut(interval: Interval, height: f32, rate: f32) -> Interval {
    if (rate == 0.0) {
        return Interval(interval.enter, select(-NEVER, interval.leave, height >= 0.0));
    }
    let t = -height / rate;
    return Interval(select(interval.enter, max(interval.enter, t), rate > 0.0), select(min(interval.leave, t), interval.leave, rate > 0.0));
}

// Height above a clip plane at a number of strides, and its change per stride.
fn above_plane(plane: u32, pixel: vec2<u32>, strides: u32) -> vec2<f32> {
    let line = scene.view.planes[plane];
    // The same arithmetic as for positions, with all three components equal.
    let stride = at_pixel(line.stride, line.stride, line.stride, pixel);
    let height = add_multiple(at_pixel(line.origin, line.origin, line.origin, pixel), stride, strides);
    let rate = split_stride(stride)[0].x * (1.0 / f32(1u << STRIDE_BITS));
    return vec2<f32>(f32(height.whole.x) + fraction_of(height).x, rate);
}

// The kept interval of a ray, in strides relative to a base point.
fn kept_from(ray: PixelRay, pixel: vec2<u32>, strides: u32) -> Interval {
    let base = ray_from(ray, strides);
    let rate = ray.direction * config.stride;
    let above = vec3<f32>(base.voxel - scene.view.box_low) + (base.fraction - scene.view.box_low_rest);
    let below = vec3<f32>(scene.view.box_high - base.voxel) + (scene.view.box_high_rest - base.fraction);
    var kept = Interval(-NEVER, NEVER);
    for (var axis = 0u; axis < 3u; axis += 1u) {
        kept = cut(cut(kept, above[axis], rate[axis]), below[axis], -rate[axis]);
    }
    if (CUT_BY_PLANES) {
        for (var i = 0u; i < scene.view.plane_count; i += 1u) {
            let height = above_plane(i, pixel, strides);
            kept = cut(kept, height.x, height.y);
        }
    }
    return kept;
}

// Number of whole strides that surely ends before a position n strides away.
fn strides_before(n: f32) -> u32 {
    return u32(clamp(n - ROUGH_STRIDES - abs(n) * ROUGH_SHARE, 0.0, MOST_STRIDES));
}

// Initial state of a pixel's ray.
fn begin_ray(pixel: vec2<u32>) -> RayState {
    var state: RayState;
    state.color.x = scene.view.first_value;
    state.transmittance = 1.0;
    state.left = config.reserve;
    state.weight = 1.0;
    state.status = STATUS_DONE;
    if (pixel.x >= scene.view.width || pixel.y >= scene.view.height || scene.view.in_parts != 0u) {
        return state;
    }
    let ray = ray_of_pixel(pixel);
    let rough = kept_from(ray, pixel, 0u);
    let most = max(rough.enter, 0.0);
    if (rough.leave < -ROUGH_STRIDES || most > rough.leave + ROUGH_STRIDES + 2.0 * abs(most) * ROUGH_SHARE) {
        return state;
    }
    state.strides = strides_before(rough.enter);
    state.end_strides = max(state.strides, strides_before(rough.leave));
    // Perspective rays do not begin before their origin.
    let first = select(-NEVER, 0.0, state.strides == 0u);
    let enter = max(kept_from(ray, pixel, state.strides).enter, first);
    let leave = kept_from(ray, pixel, state.end_strides).leave;
    state.t = enter * config.stride;
    state.end_rest = leave * config.stride;
    if (leave > -NEVER && enter < f32(state.end_strides - state.strides) + leave) {
        state.status = STATUS_ACTIVE;
    }
    return state;
}

// Continues a ray in another part of it, unless the ray is already opaque.
fn begin_part(part: RayPart, state: ptr<function, RayState>) {
    if (is_settled(state)) {
        return;
    }
    // A surface needs a value on both sides of it; there is none across a gap.
    gather_absent(state);
    (*state).t = part.t;
    (*state).strides = part.strides;
    (*state).end_strides = part.end_strides;
    (*state).end_rest = part.end_rest;
    (*state).status = STATUS_ACTIVE;
}

// Parameter from the base point to the end of the ray's segment.
fn segment_end(state: ptr<function, RayState>) -> f32 {
    // The base point of the end may lie before the ray's own base point.
    return f32(i32((*state).end_strides - (*state).strides)) * config.stride + (*state).end_rest;
}
