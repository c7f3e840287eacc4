//! Compute pipelines and what they bind; the order of the bindings is that of `shaders/shared/config.wgsl`.

use super::device::{GpuDevice, GpuError};
use super::memory::TEXTURE_LIMIT;
use super::shaders::{GATHER_MISSES, RAYCAST, ShaderModule};

/// Both pipelines and both layouts.
pub struct Pipelines {
    /// Bindings that live as long as the renderer.
    pub scene_layout: wgpu::BindGroupLayout,
    /// Bindings of one chunk of rays.
    pub chunk_layout: wgpu::BindGroupLayout,
    /// `raycast.wgsl`
    pub raycast: wgpu::ComputePipeline,
    /// `gather_misses.wgsl`
    pub gather_misses: wgpu::ComputePipeline,
}

/// What group 0 binds.
pub struct SceneBindings<'a> {
    /// `Config`
    pub config: &'a wgpu::Buffer,
    /// `Tables`
    pub tables: &'a wgpu::Buffer,
    /// Page table.
    pub page_table: &'a wgpu::Buffer,
    /// Control points.
    pub points: &'a wgpu::Buffer,
    /// Bins and knots.
    pub transfer_index: &'a wgpu::Buffer,
    /// Macro ranges.
    pub macro_ranges: &'a wgpu::Buffer,
    /// Feedback.
    pub feedback: &'a wgpu::Buffer,
    /// Miss counters.
    pub miss_counts: &'a wgpu::Buffer,
    /// Cache textures, [`TEXTURE_LIMIT`] of them.
    pub textures: &'a [wgpu::TextureView],
}

#[derive(Clone, Copy)]
enum Access {
    Uniform,
    Read,
    ReadWrite,
}

const SCENE_BUFFERS: [Access; 8] = [
    Access::Uniform,
    Access::Uniform,
    Access::Read,
    Access::Read,
    Access::Read,
    Access::Read,
    Access::ReadWrite,
    Access::ReadWrite,
];
const CHUNK_BUFFERS: [Access; 3] = [Access::Uniform, Access::Read, Access::ReadWrite];

impl Pipelines {
    /// Compiles the shaders.
    ///
    /// # Errors
    /// If the driver refuses one.
    pub fn new(gpu: &GpuDevice) -> Result<Self, GpuError> {
        let mut scene_entries: Vec<_> = (0..).zip(SCENE_BUFFERS).map(|(i, access)| buffer_entry(i, access)).collect();
        scene_entries.extend((SCENE_BUFFERS.len() as u32..).take(TEXTURE_LIMIT).map(texture_entry));
        let chunk_entries: Vec<_> = (0..).zip(CHUNK_BUFFERS).map(|(i, access)| buffer_entry(i, access)).collect();
        let layout = |entries: &[wgpu::BindGroupLayoutEntry]| {
            gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries })
        };
        gpu.checked("the compute pipelines", || {
            let (scene_layout, chunk_layout) = (layout(&scene_entries), layout(&chunk_entries));
            let pipeline_layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &[Some(&scene_layout), Some(&chunk_layout)],
                immediate_size: 0,
            });
            let raycast = pipeline(gpu, &pipeline_layout, &RAYCAST);
            let gather_misses = pipeline(gpu, &pipeline_layout, &GATHER_MISSES);
            Self { scene_layout, chunk_layout, raycast, gather_misses }
        })
    }

    /// Group 0.
    ///
    /// # Errors
    /// If the device refuses it.
    pub fn bind_scene(&self, gpu: &GpuDevice, bindings: &SceneBindings<'_>) -> Result<wgpu::BindGroup, GpuError> {
        let b = bindings;
        let buffers =
            [b.config, b.tables, b.page_table, b.points, b.transfer_index, b.macro_ranges, b.feedback, b.miss_counts];
        let mut resources: Vec<_> = buffers.iter().map(|buffer| buffer.as_entire_binding()).collect();
        resources.extend(b.textures.iter().map(wgpu::BindingResource::TextureView));
        bind(gpu, &self.scene_layout, resources)
    }

    /// Group 1.
    ///
    /// # Errors
    /// If the device refuses it.
    pub fn bind_chunk(
        &self,
        gpu: &GpuDevice,
        job: &wgpu::Buffer,
        rays: &wgpu::Buffer,
        states: &wgpu::Buffer,
    ) -> Result<wgpu::BindGroup, GpuError> {
        let resources = [job, rays, states].map(|buffer| buffer.as_entire_binding());
        bind(gpu, &self.chunk_layout, resources.into())
    }
}

fn bind(
    gpu: &GpuDevice,
    layout: &wgpu::BindGroupLayout,
    resources: Vec<wgpu::BindingResource<'_>>,
) -> Result<wgpu::BindGroup, GpuError> {
    let entries: Vec<_> =
        (0..).zip(resources).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
    gpu.checked("the bindings", || {
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
    })
}

fn pipeline(gpu: &GpuDevice, layout: &wgpu::PipelineLayout, shader: &ShaderModule) -> wgpu::ComputePipeline {
    let source = wgpu::ShaderSource::Wgsl(shader.source().into());
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(shader.name), source });
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(shader.name),
        layout: Some(layout),
        module: &module,
        entry_point: Some(shader.name),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    })
}

fn buffer_entry(binding: u32, access: Access) -> wgpu::BindGroupLayoutEntry {
    let ty = match access {
        Access::Uniform => wgpu::BufferBindingType::Uniform,
        Access::Read => wgpu::BufferBindingType::Storage { read_only: true },
        Access::ReadWrite => wgpu::BufferBindingType::Storage { read_only: false },
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}

fn texture_entry(binding: u32) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Texture {
            sample_type: wgpu::TextureSampleType::Uint,
            view_dimension: wgpu::TextureViewDimension::D3,
            multisampled: false,
        },
        count: None,
    }
}
