// Mode dvr with iso values: every crossing of every surface, in order (docs/decisions/025-surfaces-in-volumes.md).
//
// Which side of each surface a ray is on is kept from cell to cell: where cells meet, and round their common value in their own ways, no
// crossing is lost, and none counted twice.

// Share of a cell's range by which values may jump from cell to cell without crossing anything: surfaces are located to as much of a voxel.
const JUMP_SHARE: f32 = 1.0e-4;

// What is left of a ray's crossings in a cell.
struct Crossings {
    // Where the next one is, or NEVER, and its surface.
    u: f32,
    surface: u32,
    // Sides on which the ray is behind it.
    sides: u32,
    // Surfaces that are crossed where the cell begins.
    jumped: u32,
    // Monotone interval of the cubic that is searched next.
    interval: u32,
}

// Whether the field at u lies on the upper side of a surface.
fn is_above(view: CellView, u: f32, value: f32) -> bool {
    return value <= view.range.x || (value <= view.range.y && cubic_at(view.cubic, u) >= value - view.pivot);
}

// One bit for each surface on whose upper side the field lies at u.
fn sides_at(view: CellView, u: f32) -> u32 {
    var sides = 0u;
    work += config.iso_count;
    for (var i = 0u; i < config.iso_count; i += 1u) {
        sides |= select(0u, 1u << i, is_above(view, u, scene.tables.isos[i].value));
    }
    return sides;
}

// None at all.
fn no_crossings() -> Crossings {
    return Crossings(NEVER, 0u, 0u, 0u, 0u);
}

// The first crossing in a cell; the ray's sides become those on which it leaves the cell.
fn first_of_crossings(view: CellView, state: ptr<function, RayState>) -> Crossings {
    let begin = sides_at(view, 0.0);
    var left = Crossings(NEVER, 0u, select(begin, (*state).sides, (*state).present > 0.0), 0u, 0u);
    let jump = JUMP_SHARE * (view.range.y - view.range.x);
    for (var i = 0u; i < config.iso_count; i += 1u) {
        let height = abs(view.cubic.x - (scene.tables.isos[i].value - view.pivot));
        left.jumped |= select(0u, (1u << i) & (left.sides ^ begin), height > jump);
    }
    (*state).sides = sides_at(view, 1.0);
    (*state).present = 1.0;
    next_crossing(view, &left);
    return left;
}

// Goes on to the next crossing.
fn next_crossing(view: CellView, left: ptr<function, Crossings>) {
    (*left).u = NEVER;
    if ((*left).jumped != 0u) {
        (*left).u = 0.0;
        (*left).surface = firstTrailingBit((*left).jumped);
        (*left).jumped &= (*left).jumped - 1u;
    }
    while ((*left).u > 1.0 && (*left).interval < 3u) {
        let begin = view.intervals[(*left).interval];
        let end = view.intervals[(*left).interval + 1u];
        let crossed = (*left).sides ^ sides_at(view, end);
        for (var i = 0u; i < config.iso_count; i += 1u) {
            if ((crossed & (1u << i)) != 0u) {
                let root = monotone_root(view.cubic, begin, end, scene.tables.isos[i].value - view.pivot);
                // Where rounding hides it, it is where the interval begins.
                let u = select(begin, root, root <= 1.0);
                if (u < (*left).u) {
                    (*left).u = u;
                    (*left).surface = i;
                }
            }
        }
        (*left).interval += select(0u, 1u, crossed == 0u);
    }
    (*left).sides ^= select(0u, 1u << (*left).surface, (*left).u <= 1.0);
}
