// Crossings of axis-parallel planes: the exits of a ray from a brick, a macro cell or a trilinear cell.
//
// A crossing is `(plane - origin) / direction`. Both sides of a face use the same expression and get the same t, so
// that no length is lost or counted twice.

// A parameter beyond every segment.
const NEVER: f32 = 3.0e38;
// Lower bound of divisors, against division by zero.
const TINY: f32 = 1.0e-30;

// Parameters at which the ray crosses three planes, one per axis; NEVER if it is parallel.
fn crossings(planes: vec3<f32>, origin: vec3<f32>, direction: vec3<f32>) -> vec3<f32> {
    return select((planes - origin) / direction, vec3<f32>(NEVER), direction == vec3<f32>(0.0));
}

// The least of three crossings.
fn first_crossing(t: vec3<f32>) -> f32 {
    return min(t.x, min(t.y, t.z));
}

// 1 on the axis of the least crossing, 0 on the others; the first axis wins a tie.
fn first_axis(t: vec3<f32>) -> vec3<i32> {
    if (t.x <= t.y && t.x <= t.z) {
        return vec3<i32>(1, 0, 0);
    }
    if (t.y <= t.z) {
        return vec3<i32>(0, 1, 0);
    }
    return vec3<i32>(0, 0, 1);
}

// 1 if the direction is positive, else 0: the side of a cell through which the ray leaves it.
fn leaving_side(direction: vec3<f32>) -> vec3<i32> {
    return select(vec3<i32>(0), vec3<i32>(1), direction > vec3<f32>(0.0));
}

// +1 if the direction is positive, else -1.
fn step_of(direction: vec3<f32>) -> vec3<i32> {
    return 2 * leaving_side(direction) - 1;
}
