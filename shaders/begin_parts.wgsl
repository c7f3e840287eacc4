// Begins the next part of each listed ray, one ray per invocation.

@group(1) @binding(0) var<storage, read_write> states: array<RayState>;
@group(1) @binding(1) var<storage, read> parts: array<RayPart>;

@compute @workgroup_size(64)
fn begin_parts(@builtin(global_invocation_id) id: vec3<u32>) {
    config = scene.config;
    let part = parts[id.x];
    if (part.place < scene.view.places) {
        var state = states[part.place];
        begin_part(part, &state);
        states[part.place] = state;
    }
}
