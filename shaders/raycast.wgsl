// Casts one ray per invocation from where it stopped, until it is finished, lacks a brick, or has used up its work
// limit. A workgroup casts the rays of one listed tile.

@group(1) @binding(0) var<storage, read_write> states: array<RayState>;
@group(1) @binding(1) var<storage, read_write> errors: array<RayErrors>;

@compute @workgroup_size(64)
fn raycast(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    config = scene.config;
    // A ray that is finished or waiting adds nothing to the counters.
    let place = tile_of(group.x) * WORKGROUP_RAYS + lane;
    if (place < scene.view.places) {
        var state = states[place];
        let waits = state.status == STATUS_WAITING && scene.job.later_round != 0u;
        if (state.status != STATUS_DONE && !waits) {
            if (has_flag(FLAG_ERRORS)) {
                ray_errors = errors[place];
            }
            cast_ray(ray_of_pixel(pixel_of(place)), &state);
            states[place] = state;
            if (has_flag(FLAG_ERRORS)) {
                errors[place] = ray_errors;
            }
            count_in_group(state.status);
        }
    }
    workgroupBarrier();
    count_in_feedback(group.x, lane);
}
