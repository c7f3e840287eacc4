// Conversion of stored bits to render values, and the corners of cells.

// (render value, 1), or (0, 0) for an absent voxel.
fn value_of(bits: u32) -> vec2<f32> {
    if (has_flag(FLAG_FLOAT)) {
        return select(vec2<f32>(bitcast<f32>(bits), 1.0), vec2<f32>(0.0), is_non_finite(bits));
    }
    let present = vec2<f32>(f32(bits) * config.value_scale + config.value_offset, 1.0);
    return select(present, vec2<f32>(0.0), has_flag(FLAG_ABSENT) && bits == config.absent);
}

// A number at each corner of a cell (order: cubic.wgsl), and 1 or 0 for present or absent.
struct Corners {
    low: vec4<f32>,
    high: vec4<f32>,
    low_present: vec4<f32>,
    high_present: vec4<f32>,
}

// Four voxels of a layer, as (x, y) = 00, 10, 01, 11.
struct Layer {
    value: vec4<f32>,
    present: vec4<f32>,
}

// The voxel at `first` and its neighbours in its layer.
fn layer_of(slot: Slot, first: vec3<i32>) -> Layer {
    let bits = stored_square(slot, first);
    let v0 = value_of(bits.x);
    let v1 = value_of(bits.y);
    let v2 = value_of(bits.z);
    let v3 = value_of(bits.w);
    return Layer(vec4<f32>(v0.x, v1.x, v2.x, v3.x), vec4<f32>(v0.y, v1.y, v2.y, v3.y));
}

fn corners_of(slot: Slot, cell: vec3<i32>) -> Corners {
    let low = layer_of(slot, cell);
    let high = layer_of(slot, cell + vec3<i32>(0, 0, 1));
    return Corners(low.value, high.value, low.present, high.present);
}

// Replaces corners whose weight is zero all along the chord from `a` to `b` by their mirror images, which changes no
// value on the chord. So absent voxels do not disturb a ray that runs exactly in the neighbouring plane of voxels.
fn replace_unreached(corners: Corners, a: vec3<f32>, b: vec3<f32>) -> Corners {
    var c = corners;
    let zero = (a == vec3<f32>(0.0)) & (b == vec3<f32>(0.0));
    let one = (a == vec3<f32>(1.0)) & (b == vec3<f32>(1.0));
    if (zero.x) {
        c = Corners(c.low.xxzz, c.high.xxzz, c.low_present.xxzz, c.high_present.xxzz);
    } else if (one.x) {
        c = Corners(c.low.yyww, c.high.yyww, c.low_present.yyww, c.high_present.yyww);
    }
    if (zero.y) {
        c = Corners(c.low.xyxy, c.high.xyxy, c.low_present.xyxy, c.high_present.xyxy);
    } else if (one.y) {
        c = Corners(c.low.zwzw, c.high.zwzw, c.low_present.zwzw, c.high_present.zwzw);
    }
    if (zero.z) {
        c = Corners(c.low, c.low, c.low_present, c.low_present);
    } else if (one.z) {
        c = Corners(c.high, c.high, c.high_present, c.high_present);
    }
    return c;
}

fn has_holes(corners: Corners) -> bool {
    return any(corners.low_present * corners.high_present == vec4<f32>(0.0));
}
