// Casts one ray per invocation: on from where it stopped, until it is finished, lacks a brick, or has done its share.

@compute @workgroup_size(64)
fn raycast(@builtin(global_invocation_id) id: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    // A ray that has nothing to do adds nothing to the counters either.
    if (id.x < job.ray_count) {
        let index = job.first_ray + id.x;
        var state = states[index];
        if (state.status == STATUS_ACTIVE || (state.status == STATUS_WAITING && job.first_round != 0u)) {
            cast_ray(rays[index], &state);
            states[index] = state;
            count_in_group(state.status);
        }
    }
    workgroupBarrier();
    count_in_feedback(lane);
}
