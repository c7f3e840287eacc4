#![allow(clippy::print_stdout, reason = "measured errors are printed")]
//! Shader functions against their Rust twins, on random numbers with a fixed seed.

mod gpu_support;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use gpu_support::{F32, Random, TestVolume, gpu, marschner_lobb};
use supervol_format::Geometry;
use supervol_runtime::gpu::layout::SlotGrid;
use supervol_runtime::gpu::{scene_tables, shaders};
use supervol_runtime::raycast::cpu::Skipping;
use supervol_runtime::raycast::cpu::cell::{
    cubic_extremes, cubic_mean, cubic_of_cell, monotone_intervals, monotone_root, trilinear,
};
use supervol_runtime::raycast::cpu::quadrature::{integrate_pair, opacity_of};
use supervol_runtime::raycast::cpu::shade::{Lighting, shade};
use supervol_runtime::raycast::gpu::GpuDevice;
use supervol_runtime::transfer_function::RenderTransferFunction;
use supervol_runtime::transfer_function::render::absorbance;

const SEED: u64 = 20_261_120;
const CASES: usize = 4096;
/// Beyond this the shader says "never".
const NEVER: f32 = 1e38;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Case {
    low: [f32; 4],
    high: [f32; 4],
    a_value: [f32; 4],
    b_u: [f32; 4],
    near: [f32; 4],
    far: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Outcome {
    cubic: [f32; 4],
    intervals: [f32; 4],
    field: [f32; 4],
    rgba: [f32; 4],
    light: [f32; 4],
    pair: [f32; 4],
    shaded: [f32; 4],
    search: [f32; 4],
}

/// The same through the Rust functions.
fn outcome(case: &Case, tf: &RenderTransferFunction, lighting: &Lighting) -> Outcome {
    let corners: [f32; 8] = std::array::from_fn(|i| if i < 4 { case.low[i] } else { case.high[i - 4] });
    let [a, b] = [case.a_value, case.b_u].map(|v| [v[0], v[1], v[2]].map(f64::from));
    let (value, u) = (case.a_value[3], case.b_u[3]);
    let cubic = cubic_of_cell(&corners, a, b);
    let ends = monotone_intervals(&cubic);
    let ends = ends.as_slice();
    let extremes = cubic_extremes(&cubic, ends);
    let colors = [case.near, case.far].map(|c| [c[0], c[1], c[2]]);
    let (pair, opacity) = integrate_pair([case.near[3], case.far[3]], colors, 4.0 * u);
    let to_eye = Vec3::from_array(std::array::from_fn(|i| case.a_value[i] - case.b_u[i])).normalize();
    let shaded = shade(lighting, colors[0], Vec3::new(case.low[0], case.low[1], case.low[2]), to_eye);
    let knots = tf.knots_in(value, value + u);
    let first = tf.knots.iter().position(|k| knots.first() == Some(k)).map_or(f32::NAN, |i| i as f32);
    let mut intervals = [1.0; 4];
    ends.iter().enumerate().for_each(|(i, &e)| intervals[i] = e as f32);
    Outcome {
        cubic: cubic.map(|c| c as f32),
        intervals,
        field: [trilinear(&corners, a), cubic_mean(&cubic), extremes.0, extremes.1].map(|v| v as f32),
        rgba: tf.classify(value),
        light: [tf.variation(value, value + u), absorbance(u), opacity_of(4.0 * u), tf.extinction(u)],
        pair: [pair[0], pair[1], pair[2], opacity],
        shaded: [shaded[0], shaded[1], shaded[2], 0.0],
        search: [
            monotone_root(&cubic, ends[0], ends[1], f64::from(value)).map_or(f32::MAX, |r| r as f32),
            f32::from(u8::from(tf.is_visible(value, value + u))),
            first,
            first + knots.len() as f32,
        ],
    }
}

fn cases() -> Vec<Case> {
    let mut random = Random(SEED);
    println!("seed {SEED}");
    let mut number = |low: f64, high: f64| random.between(low, high) as f32;
    (0..CASES)
        .map(|_| {
            let mut four = |low, high| std::array::from_fn(|_| number(low, high));
            Case {
                low: four(0.0, 1.0),
                high: four(0.0, 1.0),
                a_value: four(0.0, 1.0),
                b_u: four(1e-3, 1.0),
                near: four(0.0, 1.0),
                far: four(0.0, 1.0),
            }
        })
        .collect()
}

fn run(gpu: &GpuDevice, buffers: &[(u32, &[u8], wgpu::BufferUsages)], cases: &[Case]) -> Vec<Outcome> {
    let device = &gpu.device;
    let make = |bytes: &[u8], usage| {
        let buffer = gpu.buffer("twins", bytes.len() as u64, usage).expect("a buffer");
        gpu.queue.write_buffer(&buffer, 0, bytes);
        buffer
    };
    let source = wgpu::ShaderSource::Wgsl(shaders::TEST_TWINS.source().into());
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("test_twins"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let tables: Vec<_> = buffers.iter().map(|&(binding, bytes, usage)| (binding, make(bytes, usage))).collect();
    let inputs = make(bytemuck::cast_slice(cases), storage);
    let bytes = (cases.len() * size_of::<Outcome>()) as u64;
    let outputs = gpu.buffer("outcomes", bytes, storage).expect("a buffer");
    let read_back = gpu.read_buffer("outcomes", bytes).expect("a buffer");
    let bind = |group: u32, buffers: &[(u32, &wgpu::Buffer)]| {
        let entries: Vec<_> = buffers
            .iter()
            .map(|(binding, b)| wgpu::BindGroupEntry { binding: *binding, resource: b.as_entire_binding() })
            .collect();
        let layout = pipeline.get_bind_group_layout(group);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries })
    };
    let group_0 = bind(0, &tables.iter().map(|(binding, buffer)| (*binding, buffer)).collect::<Vec<_>>());
    let group_1 = bind(1, &[]);
    let group_2 = bind(2, &[(0, &inputs), (1, &outputs)]);
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group_0, &[]);
        pass.set_bind_group(1, &group_1, &[]);
        pass.set_bind_group(2, &group_2, &[]);
        pass.dispatch_workgroups(cases.len().div_ceil(64) as u32, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&outputs, 0, &read_back, 0, bytes);
    gpu.queue.submit([encoder.finish()]);
    gpu.read(&read_back, bytes, bytemuck::pod_collect_to_vec).expect("outcomes")
}

#[test]
fn shader_functions_equal_their_twins() {
    let Some(gpu) = gpu() else { return };
    let volume = TestVolume::new([9; 3], 16, Geometry::IDENTITY, F32, marschner_lobb(9));
    let scene = volume.scene(
        r#"{"transfer_function": {"unit_distance": 2, "points": [
            {"value": 0.1, "color": [0, 0, 1], "alpha": 0}, {"value": 0.4, "color": [1, 0, 1], "alpha": 0.3},
            {"value": 0.4, "color": [0, 1, 0], "alpha": 0}, {"value": 0.6, "color": [0, 1, 1], "alpha": 0},
            {"value": 0.9, "color": [1, 1, 0], "alpha": 1}]},
            "shading": {"lights": [{"direction": [1, 2, 3], "intensity": 0.7}, {"direction": [-1, 0, 1]}]}}"#,
    );
    let tf = RenderTransferFunction::new(&scene.transfer_function, volume.map.shift);
    let shading = scene.shading.as_ref().expect("the scene is shaded");
    let lighting = Lighting::new(shading, &volume.geometry, volume.range.width());
    let grids = [SlotGrid { slots: [1; 3], first: 0 }; 4];
    let config = scene_tables::config(&volume.gpu_volume(), &scene, &tf, Skipping::On, grids).expect("a configuration");
    let tables = scene_tables::tables(&volume.gpu_volume(), &scene).expect("tables");
    let (points, index) = (scene_tables::points(&tf), scene_tables::transfer_index(&tf));
    let (uniform, storage) = (wgpu::BufferUsages::UNIFORM, wgpu::BufferUsages::STORAGE);
    let buffers = [
        (0, bytemuck::bytes_of(&config), uniform),
        (1, bytemuck::bytes_of(&tables), uniform),
        (3, bytemuck::cast_slice(&points), storage),
        (4, bytemuck::cast_slice(&index), storage),
    ];
    let cases = cases();
    let found = run(&gpu, &buffers, &cases);

    let names = ["cubic", "intervals", "field", "rgba", "light", "pair", "shaded", "search"];
    // Roots and turning points are ill-conditioned where the cubic is flat.
    let tolerances = [2e-6, 2e-3, 2e-6, 2e-6, 4e-6, 4e-6, 2e-5, 2e-3];
    let mut greatest = [0.0f32; 8];
    for (case, found) in cases.iter().zip(&found) {
        let expected = outcome(case, &tf, &lighting);
        let (found, expected): ([[f32; 4]; 8], [[f32; 4]; 8]) = (bytemuck::cast(*found), bytemuck::cast(expected));
        for i in 0..8 {
            for c in 0..4 {
                let (f, e) = (found[i][c], expected[i][c]);
                // Where no knot is found, the first one's number means nothing.
                let is_void = e.is_nan() || (f > NEVER && e > NEVER);
                if !is_void {
                    greatest[i] = greatest[i].max((f - e).abs());
                }
            }
        }
    }
    for i in 0..8 {
        println!("{}: {:e}", names[i], greatest[i]);
    }
    for i in 0..8 {
        assert!(greatest[i] <= tolerances[i], "{}: {} exceeds {}", names[i], greatest[i], tolerances[i]);
    }
}
