// Resident bricks by parts of cells (light_walk.wgsl), for `FLAG_LIGHT`. The alternative is resident_cells.wgsl. The
// files are separate because drivers compile every function that a shader calls, whatever its constants are.

fn cast_resident(slot: Slot, ray: LocalRay, leave: f32, state: ptr<function, RayState>) {
    cast_brick_light(slot, ray, leave, state);
}
