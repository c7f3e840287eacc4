// No iso surfaces: the alternative to light_surfaces.wgsl.

fn is_near_surfaces(number: u32, state: ptr<function, RayState>) -> bool {
    return false;
}

fn meet_surface(slot: Slot, local: LocalRay, s: Stretch, walk: ptr<function, LightWalk>) {
}

fn find_crossings(own: Corners, chord: Chord, walk: ptr<function, LightWalk>, state: ptr<function, RayState>) {
}
