//! Runs a test shader once for each of some inputs.

use bytemuck::Pod;
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::shaders::ShaderModule;
use supervol_runtime::engines::gpu::table::Table;
use supervol_runtime::engines::gpu::texels::{TEXEL_BYTES, VoxelStorage};

/// A resource that a test shader reads in group 0, by binding.
pub enum Resource<'a> {
    Storage(&'a [u8]),
    /// A table's words, and the number of words per texel.
    Table(&'a [u32], usize),
    /// Voxels of a cube of one slot, x fastest; its edge.
    Voxels(&'a [f32], u32),
    /// One texel, for bindings that are not read.
    Nothing,
}

/// The outputs of a module with one entry point: group 0 as given, group 2 the inputs and the outputs.
pub fn run<I: Pod, O: Pod>(
    gpu: &GpuDevice,
    module: ShaderModule,
    group_0: &[(u32, Resource<'_>)],
    inputs: &[I],
) -> Vec<O> {
    let device = &gpu.device;
    let source = wgpu::ShaderSource::Wgsl(module.source(gpu.texels()).into());
    let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &shader,
        entry_point: None,
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let storage = wgpu::BufferUsages::STORAGE;
    let bytes = size_of::<O>() as u64 * inputs.len() as u64;
    let outputs = gpu.buffer("outputs", bytes, storage).expect("a buffer");
    let read_back = gpu.read_buffer("outputs", bytes).expect("a buffer");
    let tables: Vec<(u32, Bound)> = group_0.iter().map(|(binding, r)| (*binding, bound(gpu, r))).collect();
    let inputs_buffer = Bound::Buffer(buffer(gpu, bytemuck::cast_slice(inputs), storage));
    let bind = |group: u32, resources: &[(u32, &Bound)]| {
        let entries: Vec<_> = resources
            .iter()
            .map(|&(binding, resource)| wgpu::BindGroupEntry { binding, resource: resource.binding() })
            .collect();
        let layout = pipeline.get_bind_group_layout(group);
        device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries })
    };
    let groups = [
        bind(0, &tables.iter().map(|(binding, table)| (*binding, table)).collect::<Vec<_>>()),
        bind(1, &[]),
        bind(2, &[(0, &inputs_buffer), (1, &Bound::Buffer(outputs.clone()))]),
    ];
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        (0u32..).zip(&groups).for_each(|(i, group)| pass.set_bind_group(i, group, &[]));
        pass.dispatch_workgroups(inputs.len().div_ceil(64) as u32, 1, 1);
    }
    encoder.copy_buffer_to_buffer(&outputs, 0, &read_back, 0, bytes);
    gpu.submit(encoder);
    gpu.read(&read_back, bytes, bytemuck::pod_collect_to_vec).expect("outputs")
}

enum Bound {
    Buffer(wgpu::Buffer),
    View(wgpu::TextureView),
}

impl Bound {
    fn binding(&self) -> wgpu::BindingResource<'_> {
        match self {
            Self::Buffer(buffer) => buffer.as_entire_binding(),
            Self::View(view) => wgpu::BindingResource::TextureView(view),
        }
    }
}

fn bound(gpu: &GpuDevice, resource: &Resource<'_>) -> Bound {
    match resource {
        Resource::Storage(bytes) => Bound::Buffer(buffer(gpu, bytes, wgpu::BufferUsages::STORAGE)),
        Resource::Table(words, texel_words) => {
            let mut table = Table::new(gpu, "a table", words.len() / texel_words, *texel_words).expect("a table");
            table.write(gpu, words);
            Bound::View(table.view)
        }
        Resource::Voxels(voxels, edge) => {
            let texels = VoxelStorage::F32.packed([*edge; 3], bytemuck::cast_slice(voxels));
            Bound::View(texture(gpu, &texels, VoxelStorage::F32.texels([*edge; 3])))
        }
        Resource::Nothing => Bound::View(texture(gpu, &[0; TEXEL_BYTES], [1; 3])),
    }
}

fn buffer(gpu: &GpuDevice, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let buffer = gpu.buffer("inputs", bytes.len() as u64, usage).expect("a buffer");
    gpu.write_buffer(&buffer, 0, bytes);
    buffer
}

fn texture(gpu: &GpuDevice, texels: &[u8], [width, height, depth_or_array_layers]: [u32; 3]) -> wgpu::TextureView {
    let size = wgpu::Extent3d { width, height, depth_or_array_layers };
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba32Uint,
        usage: gpu.texels().usage() | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.write_texture(texture.as_image_copy(), texels, size);
    texture.create_view(&wgpu::TextureViewDescriptor::default())
}
