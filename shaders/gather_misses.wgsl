// Writes beside every listed miss how many rays wait for it.

@compute @workgroup_size(64)
fn gather_misses(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = min(atomicLoad(&feedback.miss_count), scene.config.miss_limit);
    if (id.x < count) {
        let entry = atomicLoad(&feedback.words[2u * id.x]);
        let waiting = atomicLoad(&feedback.words[scene.config.wait_words + entry]);
        atomicStore(&feedback.words[2u * id.x + 1u], waiting);
    }
}
