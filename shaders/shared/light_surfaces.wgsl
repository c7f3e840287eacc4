// Iso surfaces along a ray, for `FLAG_SURFACES`. The alternative is light_no_surfaces.wgsl.

// Whether a macro cell must be visited. A skipped cell is invisible, but values may jump across a surface at its front
// face.
fn is_near_surfaces(number: u32, state: ptr<function, RayState>) -> bool {
    let is_near = is_worth_a_visit(macro_ranges[number], state);
    if (!is_near) {
        gather_skipped(macro_ranges[number], state);
    }
    return is_near;
}

// Composites the surface at which a part of a cell ends, and finds the next crossing.
fn meet_surface(slot: Slot, local: LocalRay, s: Stretch, walk: ptr<function, LightWalk>) {
    let iso = scene.tables.isos[(*walk).crossings.surface];
    let color = lit_surface(slot, local, s, iso.color, walk);
    (*walk).color += (*walk).transmittance * iso.alpha * color;
    (*walk).transmittance *= 1.0 - iso.alpha;
    (*walk).weight *= 1.0 - iso.alpha;
    (*walk).next = 1.0;
    var left = (*walk).crossings;
    next_crossing((*walk).view, &left);
    (*walk).crossings = left;
}

// Finds the surfaces that the ray crosses in a cell.
fn find_crossings(own: Corners, chord: Chord, walk: ptr<function, LightWalk>, state: ptr<function, RayState>) {
    (*walk).has_crossings = true;
    (*walk).crossings = no_crossings();
    let corners = corners_along(own, chord);
    if (has_flag(FLAG_HOLES) && has_holes(corners)) {
        gather_absent(state);
        return;
    }
    let range = range_of_corners(corners);
    if (meets_surfaces(range, state)) {
        (*walk).view = cell_view(corners, range, chord);
        (*walk).crossings = first_of_crossings((*walk).view, state);
    } else {
        gather_skipped(range, state);
    }
}
