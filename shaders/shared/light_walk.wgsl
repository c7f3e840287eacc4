// Mode dvr: the walk of a ray through a brick, part by part.
//
// One loop without branches: whatever a ray does next, a cell, a part of a cell that one rule did not settle, or a leap, is
// one turn of it. Rays of a group then wait for each other only where the brick ends.

// Turns of the loop between two leaps.
const ROUND: u32 = 8u;
// No stored number.
const NO_NUMBER: u32 = 0xffffffffu;
// Shortest part, in cells.
const LEAST_PART: f32 = 1.0 / 4096.0;
// Most parts that a cell is cut into at once.
const PARTS_LIMIT: f32 = 64.0;
// Parts per square root of the error: what is left is then well below the tolerance.
const PARTS_PER_ROOT: f32 = 1.4;
// Least share of a cell's tolerance that a part may use up, however short it is.
const LEAST_SHARE: f32 = 0.25;
// Share of what is allowed, below which the next part is twice as long.
const EASY: f32 = 0.125;
// Multiple of what is allowed, from which the next part is a quarter as long, not half.
const HARD: f32 = 16.0;
// How far beyond a face a leap ends, in parts of t: a few roundings.
const LEAP_MARGIN: f32 = 2.0e-7;
// Beyond everything, in world lengths.
const FAR: f32 = 1.0e30;

// The field of a cell, in bins: corners with x = 0, as (y, z) = 00, 10, 01, 11, and how it rises along x.
struct LightCell {
    first: vec4<f32>,
    rise: vec4<f32>,
    // False where an absent voxel has weight on the ray's way.
    is_present: bool,
}

// Stored numbers as bins; absent ones are 0.
fn bins_of(bits: vec4<u32>) -> vec4<f32> {
    var numbers = vec4<f32>(bits);
    if (has_flag(FLAG_FLOAT)) {
        numbers = bitcast<vec4<f32>>(select(bits, vec4<u32>(0u), is_absent(bits)));
    }
    return (numbers - config.light_centre) * config.light_scale + config.light_offset;
}

fn is_absent(bits: vec4<u32>) -> vec4<bool> {
    if (has_flag(FLAG_FLOAT)) {
        return (bits & vec4<u32>(NON_FINITE)) == vec4<u32>(NON_FINITE);
    }
    return bits == vec4<u32>(select(NO_NUMBER, config.absent, has_flag(FLAG_ABSENT)));
}

// The cell that begins at a voxel, for a ray that crosses it from `a` to `b`.
fn light_cell(slot: Slot, voxel: vec3<i32>, a: vec3<f32>, b: vec3<f32>) -> LightCell {
    let x = vec3<i32>(1, 0, 0);
    let y = vec3<i32>(0, 1, 0);
    let z = vec3<i32>(0, 0, 1);
    let near = vec4<u32>(
        stored(slot, voxel), stored(slot, voxel + y), stored(slot, voxel + z), stored(slot, voxel + y + z));
    let far = vec4<u32>(
        stored(slot, voxel + x), stored(slot, voxel + x + y), stored(slot, voxel + x + z), stored(slot, voxel + x + y + z));
    let first = bins_of(near);
    let second = bins_of(far);
    if (!has_flag(FLAG_HOLES)) {
        return LightCell(first, second - first, true);
    }
    let present = 1.0 - vec4<f32>(is_absent(near));
    let far_present = 1.0 - vec4<f32>(is_absent(far));
    let corners = replace_unreached(
        Corners(
            vec4<f32>(first.x, second.x, first.y, second.y),
            vec4<f32>(first.z, second.z, first.w, second.w),
            vec4<f32>(present.x, far_present.x, present.y, far_present.y),
            vec4<f32>(present.z, far_present.z, present.w, far_present.w),
        ),
        a,
        b,
    );
    let reached = vec4<f32>(corners.low.xz, corners.high.xz);
    return LightCell(reached, vec4<f32>(corners.low.yw, corners.high.yw) - reached, !has_holes(corners));
}

fn value_in(cell: LightCell, p: vec3<f32>) -> f32 {
    let rows = cell.first + p.x * cell.rise;
    let layers = rows.xz + p.y * (rows.yw - rows.xz);
    return layers.x + p.z * (layers.y - layers.x);
}

// Coefficient of xyz.
fn twist_of(cell: LightCell) -> f32 {
    return (cell.rise.w - cell.rise.z) - (cell.rise.y - cell.rise.x);
}

fn cast_brick_light(slot: Slot, ray: LocalRay, leave: f32, state: ptr<function, RayState>) {
    let o = ray.origin;
    let d = ray.direction;
    let moves = d != vec3<f32>(0.0);
    let inverse = select(vec3<f32>(0.0), 1.0 / select(vec3<f32>(1.0), d, moves), moves);
    let offset = select(vec3<f32>(FAR), -o * inverse, moves);
    let ahead = select(vec3<f32>(0.0), vec3<f32>(1.0), d > vec3<f32>(0.0));
    let way_on = 2.0 * ahead - 1.0;
    let last_cell = f32(config.core) - 1.0;
    let last_macro = macro_edge() - 1;
    let extent_per_t = ray.level.length * config.inverse_unit_distance;
    var t = (*state).t;
    var transmittance = (*state).transmittance;
    var color = (*state).color;
    var cell = clamp(floor(o + t * d), vec3<f32>(-1.0), vec3<f32>(last_cell));
    var at = 0.0;
    var next = 1.0;
    while (t < leave && transmittance > config.transmittance_limit && (work < config.work_limit || at > 0.0)) {
        // Leaps, where nothing near shows anything.
        var is_near = at > 0.0;
        while (!is_near && t < leave) {
            let block = clamp(vec3<i32>(floor((o + t * d + 0.5) * (1.0 / f32(MACRO_CELL)))), vec3<i32>(0), vec3<i32>(last_macro));
            let reach = f32(proximity[macro_place(slot, block)]) - 1.0;
            is_near = reach < 0.0;
            if (!is_near) {
                let face = (vec3<f32>(block) + ahead + reach * way_on) * f32(MACRO_CELL) - 0.5;
                let exits = face * inverse + offset;
                // Rounding must not hold it.
                t = min(max(min(exits.x, min(exits.y, exits.z)), t) + max(t, 1.0) * LEAP_MARGIN, leave);
                cell = clamp(floor(o + t * d), vec3<f32>(-1.0), vec3<f32>(last_cell));
                macro_cells_skipped += 1u;
            }
            work += 1u;
        }
        macro_cells += 1u;
        work += ROUND;
        for (var i = 0u; i < ROUND; i += 1u) {
            let exits = (cell + ahead) * inverse + offset;
            let cell_leave = max(min(min(exits.x, exits.y), min(exits.z, leave)), t);
            let length = cell_leave - t;
            // The next part.
            let rest = 1.0 - at;
            let is_last = next + LEAST_PART >= rest;
            let size = select(next, rest, is_last);
            let end = select(at + size, 1.0, is_last);
            let entry = o + t * d - cell;
            let way = length * d;
            let field = light_cell(slot, vec3<i32>(cell), entry, entry + way);
            let begin_value = value_in(field, entry + at * way);
            let middle_value = value_in(field, entry + (at + 0.5 * size) * way);
            let end_value = value_in(field, entry + end * way);
            let part_way = size * way;
            let cubic = twist_of(field) * part_way.x * part_way.y * part_way.z;
            let chord = LightChord(vec3<f32>(begin_value, middle_value, end_value), cubic, length * extent_per_t * size);
            var part = integrate_chord(chord);
            if (!field.is_present) {
                part = LightPart(vec3<f32>(0.0), 1.0, 0.0);
            }
            let ratio = part.error * transmittance / config.cell_error;
            let allowed = max(size, LEAST_SHARE);
            let taken = ratio <= allowed || size <= LEAST_PART;
            if (taken) {
                color += transmittance * part.color;
                transmittance *= part.transmittance;
            }
            let parts = clamp(floor(PARTS_PER_ROOT * sqrt(min(ratio, 1.0e4))) + 1.0, 2.0, PARTS_LIMIT);
            let shorter = select(select(0.5, 0.25, ratio > allowed * HARD), 1.0 / parts, size == 1.0);
            let longer = select(1.0, 2.0, ratio < allowed * EASY);
            next = max(size * select(shorter, longer, taken), LEAST_PART);
            at = select(at, end, taken);
            if (at >= 1.0) {
                cell += select(vec3<f32>(0.0), way_on, exits <= vec3<f32>(cell_leave));
                t = cell_leave;
                at = 0.0;
                next = 1.0;
                cells += 1u;
            }
            samples += 2u;
            if (t >= leave || transmittance <= config.transmittance_limit) {
                break;
            }
        }
    }
    (*state).t = select(t, leave, transmittance <= config.transmittance_limit);
    (*state).transmittance = transmittance;
    (*state).color = color;
}
