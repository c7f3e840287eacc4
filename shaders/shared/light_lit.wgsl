// Shading of parts of rays, for `FLAG_SHADED`. The alternative is light_unlit.wgsl.

// Shades a part of a cell.
fn lit_part(
    slot: Slot, local: LocalRay, s: Stretch, part: Part, walk: ptr<function, LightWalk>) -> Part {
    let gradient = gradient_of(slot, s.voxels, s.entry, s.way, walk);
    if (gradient.present == 0u) {
        // The colour itself.
        return part;
    }
    let at = (*walk).at;
    let middle = gradient_at(gradient, at + 0.5 * s.size, local);
    let gradients = mat3x3<f32>(gradient_at(gradient, at, local), middle, gradient_at(gradient, s.end, local));
    let cube = s.size * s.size * s.size;
    return shade_part(part, gradients, cube * cubic_of_gradient(gradient, local), local.to_eye);
}

// Shaded colour of a surface at the end of a part of a cell.
fn lit_surface(
    slot: Slot, local: LocalRay, s: Stretch, color: vec3<f32>, walk: ptr<function, LightWalk>) -> vec3<f32> {
    return shaded(gradient_of(slot, s.voxels, s.entry, s.way, walk), (*walk).at, local, color);
}

// The gradient along the chord of a cell, fetched on first use.
fn gradient_of(
    slot: Slot, voxels: StoredCell, entry: vec3<f32>, way: vec3<f32>, walk: ptr<function, LightWalk>) -> ChordGradient {
    if (!(*walk).has_gradient) {
        let chord = Chord(entry, entry + way, 0.0);
        (*walk).gradient = chord_gradient(slot, vec3<i32>((*walk).cell), corners_of_stored(voxels), chord);
        (*walk).has_gradient = true;
    }
    return (*walk).gradient;
}
