// Bricks by macro cells and roots (walk.wgsl): the alternative to resident_light.wgsl.

fn cast_resident(slot: Slot, ray: LocalRay, leave: f32, state: ptr<function, RayState>) {
    cast_brick(slot, ray, leave, state);
}
