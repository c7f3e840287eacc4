// Parts of rays without shading: the alternative to light_lit.wgsl.

fn lit_part(
    slot: Slot, local: LocalRay, s: Stretch, part: Part, walk: ptr<function, LightWalk>) -> Part {
    return part;
}

fn lit_surface(
    slot: Slot, local: LocalRay, s: Stretch, color: vec3<f32>, walk: ptr<function, LightWalk>) -> vec3<f32> {
    return color;
}
