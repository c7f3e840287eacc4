// Clips the rays of a band and sets their initial state, one ray per invocation.

@group(1) @binding(0) var<storage, read_write> states: array<RayState>;
@group(1) @binding(1) var<storage, read_write> errors: array<RayErrors>;

@compute @workgroup_size(64)
fn begin_rays(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    config = scene.config;
    let place = id.y * groups.x * WORKGROUP_RAYS + id.x;
    if (place < scene.view.places) {
        states[place] = begin_ray(pixel_of(place));
        if (has_flag(FLAG_ERRORS)) {
            errors[place] = no_errors();
        }
    }
}
