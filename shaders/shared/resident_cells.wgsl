// Resident bricks by macro cells and roots (walk.wgsl). The alternative is resident_light.wgsl.

fn cast_resident(slot: Slot, ray: LocalRay, leave: f32, state: ptr<function, RayState>) {
    cast_brick(slot, ray, leave, state);
}
