// Copies the results of a band's rays into pixel order, row by row: one ray per invocation.

@group(1) @binding(0) var<storage, read> states: array<RayState>;
@group(1) @binding(1) var<storage, read> errors: array<RayErrors>;
// Colour and transmittance. In modes `mip`, `minip` and `mean`: value, present length, 0, transmittance.
@group(1) @binding(2) var<storage, read_write> gathered: array<vec4<f32>>;
// Errors in the same order, if `FLAG_ERRORS` is set.
@group(1) @binding(3) var<storage, read_write> gathered_errors: array<RayErrors>;

@compute @workgroup_size(64)
fn gather_pixels(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    config = scene.config;
    let number = id.y * groups.x * WORKGROUP_RAYS + id.x;
    let in_band = scene.job.first_pixel + number;
    let place = place_of(vec2<u32>(in_band % scene.view.width, in_band / scene.view.width + scene.view.first_row));
    if (number < arrayLength(&gathered) && place < scene.view.places) {
        let state = states[place];
        let values = vec4<f32>(state.color.x, state.present, 0.0, state.transmittance);
        gathered[number] = select(vec4<f32>(state.color, state.transmittance), values, counts_by_value());
        if (has_flag(FLAG_ERRORS)) {
            gathered_errors[number] = errors[place];
        }
    }
}
