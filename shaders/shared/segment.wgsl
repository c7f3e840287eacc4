// The one segment of a ray that is drawn: in the volume's domain, the clip box and above all clip planes. Where solids leave several, the
// host finds them all (gpu/ray_parts.rs), and says one after the other.
//
// It is found twice: roughly, in strides from the ray's origin, and then from a base point nearby, to the last bit.

// Of the rough search, strides: what rounding may take from a stride count, beside a share of it.
const ROUGH_STRIDES: f32 = 2.0;
const ROUGH_SHARE: f32 = 1.0e-6;
// More strides than a ray through the largest volume takes.
const MOST_STRIDES: f32 = 1.0e9;

// Where a line enters and leaves what is kept; empty where it enters behind where it leaves.
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

// Height above a clip plane after so many strides, and for each further one.
fn above_plane(plane: u32, pixel: vec2<u32>, strides: u32) -> vec2<f32> {
    let line = scene.view.planes[plane];
    // The same arithmetic as for places, three times over.
    let stride = at_pixel(line.stride, line.stride, line.stride, pixel);
    let height = add_multiple(at_pixel(line.origin, line.origin, line.origin, pixel), stride, strides);
    let rate = split_stride(stride)[0].x * (1.0 / f32(1u << STRIDE_BITS));
    return vec2<f32>(f32(height.whole.x) + fraction_of(height).x, rate);
}

// What is kept of a ray seen from a base point, in strides from there.
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

// Whole strides that surely lie before a place so many strides away.
fn strides_before(n: f32) -> u32 {
    return u32(clamp(n - ROUGH_STRIDES - abs(n) * ROUGH_SHARE, 0.0, MOST_STRIDES));
}

// The state in which a ray begins.
fn begin_ray(pixel: vec2<u32>) -> RayState {
    var state: RayState;
    state.color.x = scene.view.first_value;
    state.transmittance = 1.0;
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
    // Rays do not begin before their origin.
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

// Sets a ray on its way through another part, unless nothing behind what it has gathered can be seen.
fn begin_part(part: RayPart, state: ptr<function, RayState>) {
    if (is_settled(state)) {
        return;
    }
    // What lies in front of a gap has no side behind it.
    gather_absent(state);
    (*state).t = part.t;
    (*state).strides = part.strides;
    (*state).end_strides = part.end_strides;
    (*state).end_rest = part.end_rest;
    (*state).status = STATUS_ACTIVE;
}

// Parameter from the base point to the end of the ray's segment.
fn segment_end(state: ptr<function, RayState>) -> f32 {
    // The last base point may lie behind the ray's.
    return f32(i32((*state).end_strides - (*state).strides)) * config.stride + (*state).end_rest;
}
