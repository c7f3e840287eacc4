// The walk of one ray: brick by brick, macro cell by macro cell, trilinear cell by trilinear cell.

// Moves the base point of a ray forward, so that t stays small (camera.wgsl).
fn rebase(state: ptr<function, RayState>) {
    let strides = u32((*state).t / config.stride);
    (*state).strides += strides;
    (*state).t -= f32(strides) * config.stride;
}

// Casts a ray until it is finished, lacks a brick, or reaches the work limit. Sets its status.
fn cast_ray(ray: PixelRay, state: ptr<function, RayState>) {
    var is_inside = (*state).status == STATUS_INSIDE;
    var base = ray_from(ray, (*state).strides);
    while (!is_worked_off()) {
        let region = region_at(base, (*state).t);
        let is_over = (*state).t >= segment_end(state) || is_settled(state);
        if (is_over || region.found == 0u) {
            (*state).status = STATUS_DONE;
            return;
        }
        let page = page_of(region);
        fallbacks += u32(page.level != region.level);
        if (page.state == PAGE_MISSING) {
            (*state).status = STATUS_WAITING;
            note_miss(page.entry);
            return;
        }
        // The base point moves only when the ray enters a brick that is present. At its face, t equals the end of the
        // last brick to the last bit. A ray that stopped inside a brick continues from the same base point as if
        // uninterrupted.
        if (!is_inside) {
            rebase(state);
            base = ray_from(ray, (*state).strides);
        }
        let leave = min(region_leave(base, region), segment_end(state));
        let before = *state;
        cast_page(page, base, leave, state);
        if (has_flag(FLAG_ERRORS) && page.deviation != DEVIATION_NONE) {
            note_levels(page, before, ((*state).t - before.t) * base.length, state);
        }
        is_inside = (*state).t < leave;
        (*state).status = select(STATUS_ACTIVE, STATUS_INSIDE, is_inside);
    }
}

// Casts the part of a ray that lies in one page.
fn cast_page(page: Page, base: LevelRay, leave: f32, state: ptr<function, RayState>) {
    bricks_entered += 1u;
    switch page.state {
        case PAGE_RESIDENT: {
            note_use(page.payload);
            cast_resident(slot_at(page.payload), local_ray(page, base), leave, state);
        }
        case PAGE_UNIFORM: {
            let way = leave - (*state).t;
            if (!counts_by_value() || !is_rounding(way * base.direction)) {
                gather_uniform(bitcast<f32>(page.payload), way * base.length, state);
            }
            (*state).t = leave;
        }
        default: {
            lost += u32(page.state == PAGE_FAILED);
            gather_absent(state);
            (*state).t = leave;
        }
    }
}

// A ray in brick-local index space.
struct LocalRay {
    // Position relative to the core's first voxel.
    origin: vec3<f32>,
    // Index offset per world length.
    direction: vec3<f32>,
    // The ray at the brick's level, and the core's first voxel at that level.
    level: LevelRay,
    first: vec3<i32>,
    // Unit world vector to the eye.
    to_eye: vec3<f32>,
    // Factors from gradients per voxel of this level to gradients per voxel of level 0.
    gradient_scale: vec3<f32>,
}

fn local_ray(page: Page, base: LevelRay) -> LocalRay {
    let ray = ray_at_level(base, page.level);
    let first = page.brick * i32(config.core);
    let scale = vec3<f32>(vec3<u32>(1u) << scene.tables.levels[page.level].scale_log2);
    let to_eye = -world_direction(base.direction);
    return LocalRay(origin_from(ray, first), ray.direction, ray, first, to_eye, 1.0 / scale);
}

fn local_at(ray: LocalRay, t: f32) -> vec3<f32> {
    return ray.origin + t * ray.direction;
}

fn macro_cell_at(ray: LocalRay, t: f32) -> vec3<i32> {
    return vec3<i32>(floor((local_at(ray, t) + 0.5) / f32(MACRO_CELL)));
}

// Walks through the macro cells of a brick. Stops between two of them when the work limit is reached.
fn cast_brick(slot: Slot, ray: LocalRay, leave: f32, state: ptr<function, RayState>) {
    let last = macro_edge() - 1;
    let side = leaving_side(ray.direction);
    let step = step_of(ray.direction);
    var cell = clamp(macro_cell_at(ray, (*state).t), vec3<i32>(0), vec3<i32>(last));
    // A ray enters at most three macro cells per layer, and may begin one cell too early on each axis.
    let limit = 3 * (last + 2);
    for (var i = 0; i < limit; i += 1) {
        work += 1u;
        let place = macro_place(slot, cell);
        let range = macro_ranges[place];
        let distance = i32(proximity[place] & NEAREST);
        // A skipped cell is invisible, but values may jump across a surface at its front face.
        let is_visited = (distance == 0 || has_flag(FLAG_SURFACES)) && is_worth_a_visit(range, state);
        // Nothing nearer than the distance is visible: the ray leaps over all of it.
        let reach = select(max(distance - 1, 0), 0, is_visited);
        let leaves = crossings(vec3<f32>((cell + side + reach * step) * MACRO_CELL) - 0.5, ray.origin, ray.direction);
        let cell_leave = min(first_crossing(leaves), leave);
        if (cell_leave > (*state).t) {
            if (is_visited) {
                macro_cells += 1u;
                cast_macro_cell(slot, ray, cell * MACRO_CELL, cell_leave, state);
                if (is_worked_off()) {
                    return;
                }
            } else {
                macro_cells_skipped += 1u;
                gather_skipped(range, state);
            }
            (*state).t = cell_leave;
        }
        if (cell_leave >= leave || is_settled(state) || is_worked_off()) {
            return;
        }
        let axis = first_axis(leaves);
        let there = clamp(macro_cell_at(ray, cell_leave), cell - reach, cell + reach);
        cell = select(there, cell + (reach + 1) * step, axis == vec3<i32>(1));
        if (any(cell < vec3<i32>(0)) || any(cell > vec3<i32>(last))) {
            // Only rounding can lead out of the brick before its face.
            (*state).t = leave;
            return;
        }
    }
    anomalies += 1u;
    (*state).t = leave;
}

// Integrates the trilinear cells of one macro cell, whose faces are at integers from `first - 1` to `first + 7`. The
// ray's t advances cell by cell, so that the ray can stop after any of them.
fn cast_macro_cell(slot: Slot, ray: LocalRay, first: vec3<i32>, leave: f32, state: ptr<function, RayState>) {
    let low = first - 1;
    let high = first + MACRO_CELL - 1;
    let side = leaving_side(ray.direction);
    var cell = clamp(vec3<i32>(floor(local_at(ray, (*state).t))), low, high);
    for (var i = 0; i < 3 * (MACRO_CELL + 2); i += 1) {
        work += 1u;
        let t = (*state).t;
        let leaves = crossings(vec3<f32>(cell + side), ray.origin, ray.direction);
        let cell_leave = min(first_crossing(leaves), leave);
        if (cell_leave > t) {
            cells += 1u;
            let corner = ray.first + cell;
            let chord = Chord(
                clamp(point_from(ray.level, corner, t), vec3<f32>(0.0), vec3<f32>(1.0)),
                clamp(point_from(ray.level, corner, cell_leave), vec3<f32>(0.0), vec3<f32>(1.0)),
                (cell_leave - t) * ray.level.length,
            );
            gather_cell(slot, cell, chord, ray, state);
            (*state).t = cell_leave;
        }
        if (cell_leave >= leave || is_settled(state) || is_worked_off()) {
            return;
        }
        cell += first_axis(leaves) * step_of(ray.direction);
        if (any(cell < low) || any(cell > high)) {
            // Only rounding can lead out of the macro cell before its face.
            return;
        }
    }
    anomalies += 1u;
}
