// Mode dvr: the walk of a ray through a brick, part by part.
//
// One loop without branches. An iteration integrates the ray's next stretch: a cell, several cells of a smooth field,
// or a part of a refused cell. Leaps come between rounds of iterations. So the rays of a group wait for each other only
// at the end of the brick. Loops exit only at the end of the body: software adapters execute the code behind any other
// exit once more with all lanes masked.
//
// Shading and surfaces are in files of their own, each with an empty alternative. Drivers compile every function that a
// shader calls, whatever its constants are.

// Iterations of the loop between two leaps. Two of them can fail to make progress, and again in the next round. One is
// a cell of zero length, if rounding puts the ray before the face that it has left. The other is a refused span of
// cells.
const ROUND: u32 = 8u;
const_assert ROUND > 2u;
// Most cells that one line covers.
const LONGEST_SPAN: f32 = 4.0;
// Error, in parts of what a span may spend, up to which the next span has twice as many cells. In a smooth field, doubling
// increases the error eightfold.
const EASY_SPAN: f32 = 0.1;
// Error, in parts of what its cells may spend, up to which a span is accepted. The same cells one by one would have a far
// smaller error.
const SPAN_SHARE: f32 = 0.5;
// Turns of loops that a part takes beside the lights: searches in the transfer function.
const TURNS_OF_SEARCH: u32 = 8u;
// Turns after which parts of a cell become no shorter than `ROUNDED_BELOW`. A ray is not interrupted inside a cell, and software
// adapters end loops after some thousand turns.
const TURNS_LIMIT: u32 = 4096u;
// Share of the reserve that is never given up: a ray that cannot keep its error says so, and does not cut all of its cells as
// finely as can be.
const LEAST_LEFT: f32 = 0.015625;
// A value that no voxel stores.
const NO_NUMBER: u32 = 0xffffffffu;

// The field of a cell, in values as the table counts them. Corners with x = 0 in the order (y, z) = 00, 10, 01, 11, and the differences to x = 1.
struct LightCell {
    first: vec4<f32>,
    rise: vec4<f32>,
    // False if an absent voxel has weight on the chord.
    is_present: bool,
}

// Stored numbers as values; absent ones are 0.
fn values_of(bits: vec4<u32>) -> vec4<f32> {
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

// Stored numbers at a cell's corners: those with x = 0 in the order (y, z) = 00, 10, 01, 11, and those with x = 1.
struct StoredCell {
    near: vec4<u32>,
    far: vec4<u32>,
}

// The cell that begins at a voxel.
fn stored_cell(slot: Slot, voxel: vec3<i32>) -> StoredCell {
    let low = stored_square(slot, voxel);
    let high = stored_square(slot, voxel + vec3<i32>(0, 0, 1));
    return StoredCell(vec4<u32>(low.xz, high.xz), vec4<u32>(low.yw, high.yw));
}

// The render values of a cell's corners.
fn corners_of_stored(cell: StoredCell) -> Corners {
    let n0 = value_of(cell.near.x);
    let n1 = value_of(cell.near.y);
    let n2 = value_of(cell.near.z);
    let n3 = value_of(cell.near.w);
    let f0 = value_of(cell.far.x);
    let f1 = value_of(cell.far.y);
    let f2 = value_of(cell.far.z);
    let f3 = value_of(cell.far.w);
    return Corners(
        vec4<f32>(n0.x, f0.x, n1.x, f1.x),
        vec4<f32>(n2.x, f2.x, n3.x, f3.x),
        vec4<f32>(n0.y, f0.y, n1.y, f1.y),
        vec4<f32>(n2.y, f2.y, n3.y, f3.y),
    );
}

// The field in a cell, for a chord from `a` to `b`.
fn light_cell(cell: StoredCell, a: vec3<f32>, b: vec3<f32>) -> LightCell {
    let near = cell.near;
    let far = cell.far;
    let first = values_of(near);
    let second = values_of(far);
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

// Least and greatest corner.
fn range_in(cell: LightCell) -> vec2<f32> {
    let last = cell.first + cell.rise;
    let low = min(cell.first, last);
    let high = max(cell.first, last);
    return vec2<f32>(min(min(low.x, low.y), min(low.z, low.w)), max(max(high.x, high.y), max(high.z, high.w)));
}

// Coefficient of xyz in the trilinear field.
fn twist_of(cell: LightCell) -> f32 {
    return (cell.rise.w - cell.rise.z) - (cell.rise.y - cell.rise.x);
}

// A ray in a brick in a form in which a crossing costs one product and one sum.
struct LightRay {
    origin: vec3<f32>,
    direction: vec3<f32>,
    // Parameter per voxel, and parameter of plane 0; FAR if the ray is parallel to the plane.
    inverse: vec3<f32>,
    offset: vec3<f32>,
    // 1 if the ray ascends, else 0: offset from the cell to the plane ahead. And the step: 1 or -1.
    ahead: vec3<f32>,
    step: vec3<f32>,
    // World length per unit of t.
    extent_per_t: f32,
    // Distance in t by which a leap goes beyond a face.
    margin: f32,
    // Parameter at which the ray leaves the brick.
    leave: f32,
}

fn light_ray(ray: LocalRay, leave: f32) -> LightRay {
    let d = ray.direction;
    let moves = d != vec3<f32>(0.0);
    let inverse = select(vec3<f32>(0.0), 1.0 / select(vec3<f32>(1.0), d, moves), moves);
    let offset = select(vec3<f32>(FAR), -ray.origin * inverse, moves);
    let ahead = vec3<f32>(d > vec3<f32>(0.0));
    let margin = LEAP_MARGIN / max(max(abs(d.x), abs(d.y)), abs(d.z));
    return LightRay(ray.origin, d, inverse, offset, ahead, 2.0 * ahead - 1.0, ray.level.length, margin, leave);
}

// Progress of a ray in a brick, and its accumulated result.
struct LightWalk {
    t: f32,
    transmittance: f32,
    color: vec3<f32>,
    // First corner of the current cell.
    cell: vec3<f32>,
    // Finished share of the cell, and length of the next part in cells; 1 or more means whole cells.
    at: f32,
    next: f32,
    // Budget of error (engines/packets/budget.rs): the rest of the reserve, and an upper bound on the light from behind that passes
    // to the eye.
    left: f32,
    weight: f32,
    // The cell's allowance: by its opacity, and of the reserve; whether both are known.
    allowed: vec2<f32>,
    has_allowance: bool,
    // Error that its finished parts have spent, and the turns that all tried ones took.
    spent: f32,
    turns: u32,
    // Most cells of a span in this round.
    longest: f32,
    // Gradient along the chord of the current cell, fetched on demand and reused for all its parts.
    gradient: ChordGradient,
    has_gradient: bool,
    // With surfaces: the field along the chord and the remaining crossings on it, computed on demand.
    view: CellView,
    crossings: Crossings,
    has_crossings: bool,
}

fn cell_at(ray: LightRay, t: f32) -> vec3<f32> {
    return clamp(floor(ray.origin + t * ray.direction), vec3<f32>(-1.0), vec3<f32>(f32(config.core) - 1.0));
}

// Whether the ray is inside a cell. This includes a cell of which no part is finished but the next part is already
// shortened. A round must not start such a cell anew. Otherwise the walk might never end, because finding a short
// enough part may take more iterations than a round has.
fn is_in_cell(walk: ptr<function, LightWalk>) -> bool {
    return (*walk).at > 0.0 || (*walk).next < 1.0 || (*walk).has_crossings;
}

// Leaps over invisible macro cells and blocks, up to a visible one or the end of the brick.
fn leap_on(slot: Slot, ray: LightRay, walk: ptr<function, LightWalk>, state: ptr<function, RayState>) {
    let last = vec3<i32>(2 * macro_edge() - 1);
    var is_near = is_in_cell(walk);
    loop {
        if (!is_near && (*walk).t < ray.leave) {
            work += 1u;
            let place = (ray.origin + (*walk).t * ray.direction) * (1.0 / f32(BLOCK));
            let block = clamp(vec3<i32>(floor(place)), vec3<i32>(0), last);
            let cell = block >> vec3<u32>(1u);
            let number = macro_place(slot, cell);
            let near = proximity[number];
            let reach = f32(near & NEAREST);
            let half = block & vec3<i32>(1);
            is_near = (near & (FIRST_BLOCK << u32(half.x + 2 * half.y + 4 * half.z))) != 0u;
            var is_block = reach == 0.0;
            if (has_flag(FLAG_SURFACES)) {
                is_near = is_near_surfaces(number, state);
                is_block = false;
            }
            if (!is_near) {
                // Nothing nearer than the distance is visible: the ray leaps over all of it.
                let cells = (vec3<f32>(cell) + ray.ahead + max(reach - 1.0, 0.0) * ray.step) * f32(MACRO_CELL);
                let ahead = select(cells, (vec3<f32>(block) + ray.ahead) * f32(BLOCK), is_block);
                // The first cell of a brick begins one voxel before its blocks.
                let face = ahead - vec3<f32>(ahead <= vec3<f32>(0.0)) * (1.0 - ray.ahead);
                let exit = first_crossing(face * ray.inverse + ray.offset);
                // The margin ensures progress in spite of rounding.
                (*walk).t = min(max(exit, (*walk).t) + ray.margin, ray.leave);
                macro_cells_skipped += 1u;
            }
        }
        if (is_near || (*walk).t >= ray.leave) {
            break;
        }
    }
}

// The part of a ray that one iteration integrates: a part of a cell, or consecutive whole cells.
struct Stretch {
    line: Line,
    cells: f32,
    // False if an absent voxel has weight on the stretch.
    is_present: bool,
    // The last cell, the parameter at which the ray leaves it, and the parameters of the planes ahead.
    cell: vec3<f32>,
    leave: f32,
    exits: vec3<f32>,
    // The ray's entry into that cell and its way through it; length of the part and its end, as shares of the way.
    entry: vec3<f32>,
    way: vec3<f32>,
    size: f32,
    end: f32,
    voxels: StoredCell,
}

// Takes the next part of a cell, or the next cells, and fits a line to the field.
fn next_stretch(slot: Slot, ray: LightRay, walk: ptr<function, LightWalk>, state: ptr<function, RayState>) -> Stretch {
    let at = (*walk).at;
    var s: Stretch;
    s.line = no_line();
    s.cells = 0.0;
    s.is_present = true;
    s.cell = (*walk).cell;
    var t = (*walk).t;
    loop {
        s.exits = (s.cell + ray.ahead) * ray.inverse + ray.offset;
        s.leave = max(min(first_crossing(s.exits), ray.leave), t);
        let length = s.leave - t;
        s.entry = ray.origin + t * ray.direction - s.cell;
        s.way = length * ray.direction;
        s.voxels = stored_cell(slot, vec3<i32>(s.cell));
        if (has_flag(FLAG_SURFACES) && !(*walk).has_crossings) {
            find_crossings(corners_of_stored(s.voxels), Chord(s.entry, s.entry + s.way, 0.0), walk, state);
        }
        // Parts end at surfaces. A rest that is shorter than the shortest part is included.
        let stop = select(1.0, min((*walk).crossings.u, 1.0), has_flag(FLAG_SURFACES));
        let is_last = (*walk).next + LEAST_PART >= stop - at;
        s.size = select((*walk).next, stop - at, is_last);
        s.end = select(at + s.size, stop, is_last);
        let field = light_cell(s.voxels, s.entry, s.entry + s.way);
        let values = vec3<f32>(
            value_in(field, s.entry + at * s.way),
            value_in(field, s.entry + (at + 0.5 * s.size) * s.way),
            value_in(field, s.entry + s.end * s.way),
        );
        let part_way = s.size * s.way;
        let cubic = twist_of(field) * part_way.x * part_way.y * part_way.z;
        let range = range_in(field);
        let wide = range.y - range.x;
        let of_place = (3.0 * POSITION_ERROR) * wide;
        let noise = VALUE_ERROR * max(abs(range.x), abs(range.y)) + of_place + config.rounding;
        let bounds = range + vec2<f32>(-1.0, 1.0) * (OVERSHOOT * wide + noise);
        let line = line_of(LightChord(values, cubic, length * ray.extent_per_t * s.size, noise, bounds));
        if (s.cells == 0.0) {
            s.line = line;
        } else {
            s.line = line_over(s.line, line);
        }
        s.is_present = s.is_present && field.is_present;
        s.cells += 1.0;
        if (s.cells >= (*walk).next || s.leave >= ray.leave) {
            break;
        }
        // The first cell is counted with the round.
        work += 1u;
        s.cell += select(vec3<f32>(0.0), ray.step, s.exits <= vec3<f32>(s.leave));
        t = s.leave;
    }
    return s;
}

// Integrates the next stretch; accepts it, or retries with a shorter one. After the last part of a cell, moves to the
// next cell.
fn try_part(
    slot: Slot, local: LocalRay, ray: LightRay, walk: ptr<function, LightWalk>, state: ptr<function, RayState>) {
    let at = (*walk).at;
    let s = next_stretch(slot, ray, walk, state);
    let is_span = s.cells > 1.0;
    var part = no_part();
    if (s.is_present) {
        part = integrate_line(s.line);
    }
    samples += 2u;
    let weight = (*walk).weight;
    let opacity = 1.0 - part.transmittance;
    if (is_span || !(*walk).has_allowance) {
        (*walk).allowed = allowed_of(part, s.cells, walk);
        (*walk).has_allowance = !is_span;
    }
    let most = (*walk).allowed.x + (*walk).allowed.y;
    let shows = (opacity + part.error) * weight > min(config.least_shaded, most);
    let is_lit = has_flag(FLAG_SHADED) && (shows || s.size < 1.0);
    if (is_lit && !is_span) {
        part = lit_part(slot, local, s, part, walk);
    } else if (has_flag(FLAG_SHADED)) {
        // The light of a part that is not shaded may be anything.
        part.error += opacity;
    }

    let is_whole = s.size == 1.0;
    let spent = part.error * weight;
    // Parts of a cell get a part of what is left of the cell's allowance.
    let unused = max(PARTS_SHARE * most - (*walk).spent, 0.0);
    // Where the shortest part has taken all of it, others still get their share: what is too much is stated, and taken from others.
    let of_parts = max(unused * max(s.size / max(1.0 - at, LEAST_PART), LEAST_SHARE), PARTS_SHARE * most * s.size);
    let limit = select(select(of_parts, most, is_whole), SPAN_SHARE * most, is_span);
    // Shorter parts are rounded as much; and there is an end to all tries. The last part of a cell may be a little longer.
    (*walk).turns += turns_of_try();
    let is_last_try = (*walk).turns > TURNS_LIMIT;
    let is_in_vain = 2.0 * part.rounding > part.error || is_last_try;
    let is_settled = spent <= limit || s.size <= SHORTEST || (is_in_vain && s.size <= 2.0 * ROUNDED_BELOW);
    // Three positions do not settle the shading of several cells, and a span with absent voxels must be split.
    let is_taken = is_settled && !(is_span && (is_lit || !s.is_present));
    let ratio = min(spent / max(limit, TINY), FAR);
    let grows = is_taken && s.is_present && !is_lit && spent <= EASY_SPAN * most && !has_flag(FLAG_SURFACES);
    let cells_next = select(1.0, min(2.0 * s.cells, (*walk).longest), grows);
    (*walk).longest = select((*walk).longest, 1.0, is_span && !is_taken);
    let size_next = select(next_size(s.size, ratio, is_taken), ROUNDED_BELOW, is_last_try);
    (*walk).next = select(size_next, cells_next, is_whole && (is_taken || is_span));
    if (is_taken) {
        if (has_flag(FLAG_ERRORS)) {
            ray_errors.cells += spent;
        }
        (*walk).color += (*walk).transmittance * part.color;
        (*walk).transmittance *= part.transmittance;
        (*walk).weight = behind_part(weight, part);
        (*walk).spent += spent;
        (*walk).at = s.end;
    }
    let is_met = has_flag(FLAG_SURFACES) && (*walk).at >= (*walk).crossings.u;
    if (is_met) {
        meet_surface(slot, local, s, walk);
    }
    if ((*walk).at >= 1.0 && !is_met) {
        (*walk).cell = s.cell + select(vec3<f32>(0.0), ray.step, s.exits <= vec3<f32>(s.leave));
        (*walk).t = s.leave;
        (*walk).at = 0.0;
        (*walk).next = select(1.0, (*walk).next, is_whole);
        (*walk).has_gradient = false;
        (*walk).has_crossings = false;
        (*walk).left -= max((*walk).spent - (*walk).allowed.x, 0.0);
        (*walk).spent = 0.0;
        (*walk).turns = 0u;
        (*walk).has_allowance = false;
        cells += u32(s.cells);
    }
}

// Turns of loops that a part takes.
fn turns_of_try() -> u32 {
    return TURNS_OF_SEARCH + 2u * config.light_count;
}

// Allowance of some cells together, whose contribution is this part: by their opacity, and of the reserve.
fn allowed_of(part: Part, count: f32, walk: ptr<function, LightWalk>) -> vec2<f32> {
    let opacity = max(1.0 - part.transmittance - part.error, 0.0);
    let left = max((*walk).left, LEAST_LEFT * config.reserve);
    return vec2<f32>(config.by_opacity * opacity * (*walk).weight, left * (RESERVE_SHARE * count));
}

// Upper bound on the light from behind a part that passes to the eye.
fn behind_part(weight: f32, part: Part) -> f32 {
    let through = select(1.0, min(part.transmittance + part.error, 1.0), part.error < 1.0);
    return max(weight * through, config.transmittance_limit);
}

// Length of the next part after a part of this size was accepted or refused; `ratio` is its error in parts of what it may spend.
fn next_size(size: f32, ratio: f32, is_taken: bool) -> f32 {
    // The error of a whole cell decreases with the square of the number of parts.
    let root = sqrt(min(ratio, PARTS_LIMIT * PARTS_LIMIT));
    let parts = clamp(floor(PARTS_PER_ROOT * root) + 1.0, 2.0, PARTS_LIMIT);
    let shorter = select(select(0.5, 0.25, ratio > HARD), 1.0 / parts, size == 1.0);
    let longer = select(1.0, 2.0, ratio < EASY);
    return max(size * select(shorter, longer, is_taken), LEAST_PART);
}

// Walks through a brick. Stops between two cells when the work limit is reached.
fn cast_brick_light(slot: Slot, local: LocalRay, leave: f32, state: ptr<function, RayState>) {
    let ray = light_ray(local, leave);
    let begin = (*state).t;
    var walk: LightWalk;
    walk.t = begin;
    walk.transmittance = (*state).transmittance;
    walk.color = (*state).color;
    walk.next = 1.0;
    walk.left = (*state).left;
    walk.weight = (*state).weight;
    if (begin < leave) {
        loop {
            leap_on(slot, ray, &walk, state);
            // Each round begins in the same way as after an interruption, so that pictures do not depend on where rays
            // are interrupted. Rays are never interrupted inside a cell.
            let begins = !is_in_cell(&walk);
            walk.cell = select(walk.cell, cell_at(ray, walk.t), begins);
            walk.next = select(walk.next, 1.0, begins);
            walk.longest = select(walk.longest, LONGEST_SPAN, begins);
            macro_cells += 1u;
            work += ROUND * turns_of_try() / TURNS_OF_SEARCH;
            var turns = 0u;
            var goes_on = true;
            var is_round_over = false;
            loop {
                let was_in_cell = is_in_cell(&walk);
                try_part(slot, local, ray, &walk, state);
                // A round ends behind a cell in parts: there are few places between two cells where a ray can stop.
                is_round_over = was_in_cell && !is_in_cell(&walk);
                goes_on = walk.t < leave && walk.transmittance > config.transmittance_limit;
                turns += 1u;
                if (!goes_on || turns >= ROUND || is_round_over) {
                    break;
                }
            }
            if (!goes_on || (is_worked_off() && !is_in_cell(&walk))) {
                break;
            }
        }
    }
    (*state).t = walk.t;
    (*state).transmittance = walk.transmittance;
    (*state).color = walk.color;
    (*state).left = walk.left;
    (*state).weight = walk.weight;
}
