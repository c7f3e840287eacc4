// Writes the number of waiting rays beside each listed miss.

@compute @workgroup_size(64)
fn gather_misses(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let count = min(atomicLoad(&feedback.miss_count), scene.config.miss_limit);
    for (var i = id.x; i < count; i += groups.x * WORKGROUP_RAYS) {
        let word = scene.config.miss_words + 2u * i;
        let entry = atomicLoad(&feedback.words[word]);
        let waiting = atomicLoad(&feedback.words[scene.config.wait_words + entry]);
        atomicStore(&feedback.words[word + 1u], waiting);
    }
}
