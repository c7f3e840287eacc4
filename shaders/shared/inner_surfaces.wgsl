// Mode dvr with iso surfaces: every crossing of every surface, in order (docs/decisions/025-surfaces-in-volumes.md).
//
// The ray's side of each surface is carried from cell to cell. Adjacent cells may round their common value differently;
// with the carried sides no crossing is lost or counted twice.

// Share of a cell's range by which values may jump between cells without a crossing. Surfaces are located to the same
// share of a voxel.
const JUMP_SHARE: f32 = 1.0e-4;

// The remaining crossings of a ray in a cell.
struct Crossings {
    // Parameter of the next crossing, or NEVER, and its surface.
    u: f32,
    surface: u32,
    // The ray's sides after the next crossing.
    sides: u32,
    // Surfaces that are crossed by a jump at the cell's beginning.
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

// No crossings.
fn no_crossings() -> Crossings {
    return Crossings(NEVER, 0u, 0u, 0u, 0u);
}

// The first crossing in a cell. Sets the ray's sides to those at the cell's end.
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

// Moves on to the next crossing.
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
                // If rounding hides the root, the crossing is at the interval's beginning.
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
