// Error bounds of a ray, summed up while it is cast. Twin of lod/deviation.rs, which derives the bounds for coarser
// bricks. FAR stands for infinity, because WGSL does not guarantee infinities.

// Errors of this invocation's ray, if `FLAG_ERRORS` is set.
var<private> ray_errors: RayErrors;

// Greatest optical depth that is distinguished from greater ones.
const MOST_DEPTH: f32 = 80.0;

// Errors of a new ray: none.
fn no_errors() -> RayErrors {
    return RayErrors(0.0, 0.0, select(1.0, 0.0, counts_by_value()), 0.0, 0u);
}

// Greatest difference by which a brick's exact optical depth may be below the drawn one. The ray passes through
// `length` of the brick with transmittance `through`.
fn thinner(deviation: GpuDeviation, length: f32, through: f32) -> f32 {
    return min(min(deviation.thinner * length, -log(max(through, TINY))), MOST_DEPTH);
}

// Greatest error of such a ray, relative to the transmittance in front of the brick.
fn of_ray(deviation: GpuDeviation, length: f32, through: f32) -> f32 {
    let opacity = 1.0 - through;
    // A bound above 1 is useless.
    var integral = 1.0;
    for (var i = 0u; i < SHARES; i += 1u) {
        integral = min(integral, PER_OPACITY[i] * opacity + deviation.per_length[i] * length);
    }
    return min(integral * exp(thinner(deviation, length, through)), of_nothing(deviation, length));
}

// The same bound if nothing of the brick is drawn.
fn of_nothing(deviation: GpuDeviation, length: f32) -> f32 {
    return 1.0 - exp(-min(deviation.kappa_max * length, MOST_DEPTH));
}

// Modes dvr and iso: records that the ray has passed through `length` of a brick, and its transmittance changed from
// `before` to `after`.
fn note_brick(before: f32, after: f32, is_drawn: bool, length: f32, deviation: GpuDeviation) {
    if (before <= 0.0) {
        return;
    }
    ray_errors.bound = min(ray_errors.bound, ray_errors.levels + before);
    let in_front = min(before * exp(ray_errors.thinner), 1.0);
    if (!is_drawn) {
        ray_errors.levels += in_front * of_nothing(deviation, length);
        return;
    }
    let through = min(after / before, 1.0);
    ray_errors.levels += in_front * of_ray(deviation, length, through);
    ray_errors.thinner = min(ray_errors.thinner + thinner(deviation, length, through), MOST_DEPTH);
}

// A ray's value, if it has one.
struct Extreme {
    value: f32,
    is_there: bool,
}

// Modes mip and minip: records that a brick may have changed the ray's greatest or least value.
fn note_extreme(before: Extreme, after: Extreme, is_greatest: bool, deviation: GpuDeviation) {
    let away = select(after.value - deviation.least, deviation.greatest - after.value, is_greatest);
    let beyond = select(deviation.value, clamp(away, 0.0, deviation.value), after.is_there);
    let is_changed = !before.is_there || before.value != after.value;
    var below = ray_errors.levels;
    var above = ray_errors.bound;
    if (is_greatest) {
        above = max(above, beyond);
        below = select(below, deviation.value, is_changed);
    } else {
        below = max(below, beyond);
        above = select(above, deviation.value, is_changed);
    }
    ray_errors.levels = below;
    ray_errors.bound = above;
}

// Mode mean: records that a brick has added to the integral of the ray's values.
fn note_mean(length: f32, deviation: GpuDeviation) {
    let so_far = min(ray_errors.levels + deviation.value * length, FAR);
    ray_errors.levels = select(so_far, FAR, deviation.value >= FAR);
}

// Records the errors of a brick that is not exact: the ray was in the state `before` and has passed through `length` of
// it.
fn note_levels(page: Page, before: RayState, length: f32, state: ptr<function, RayState>) {
    let deviation = deviations[page.deviation];
    ray_errors.presence_may_change |= deviation.presence_may_change;
    let was = Extreme(before.color.x, before.present > 0.0);
    let is = Extreme((*state).color.x, (*state).present > 0.0);
    switch mode() {
        case MODE_MIP: { note_extreme(was, is, true, deviation); }
        case MODE_MINIP: { note_extreme(was, is, false, deviation); }
        case MODE_MEAN: { note_mean(length, deviation); }
        default: {
            // The transmittance of drawn surfaces says nothing about surfaces at other positions.
            let has_surface = mode() == MODE_ISO || deviation.kappa_max >= FAR;
            let is_drawn = (page.state == PAGE_RESIDENT || page.state == PAGE_UNIFORM) && !has_surface;
            note_brick(before.transmittance, (*state).transmittance, is_drawn, length, deviation);
        }
    }
}
