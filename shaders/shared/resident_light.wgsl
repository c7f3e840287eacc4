// Bricks by parts of cells (light_walk.wgsl): where `FLAG_LIGHT` is set. A file of its own, and so is its
// alternative: drivers compile all that a shader calls, whether or not its constants let it.

fn cast_resident(slot: Slot, ray: LocalRay, leave: f32, state: ptr<function, RayState>) {
    cast_brick_light(slot, ray, leave, state);
}
