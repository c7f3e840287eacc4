//! Compute pipelines and their bindings, in the order of `shaders/shared/config.wgsl`.

use std::sync::OnceLock;

use supervol_format::cast::narrow;

use super::device::GpuDevice;
use super::shaders::{
    BEGIN_PARTS, BEGIN_RAYS, CLASSIFY_CELLS, GATHER_MISSES, GATHER_PIXELS, ShaderModule, TexelAccess, raycast_for,
};
use crate::engines::gpu::error::GpuError;
use crate::engines::gpu::limits::TEXTURE_LIMIT;

/// Parameters that pipelines are compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Variant {
    /// `MODE_...`
    pub mode: u32,
    /// `FLAG_...`
    pub flags: u32,
    /// Cache textures that hold bricks.
    pub textures: u32,
}

/// All pipelines and their layouts.
#[derive(Debug)]
pub struct Pipelines {
    variant: Variant,
    scene_layout: wgpu::BindGroupLayout,
    /// Layout of `Scene` alone: the number of buffers per shader is limited, and some shaders need more of their own.
    view_layout: wgpu::BindGroupLayout,
    /// `begin_rays.wgsl` without and with clip planes: made on first use.
    begin_rays: [OnceLock<Pipeline>; 2],
    /// `begin_parts.wgsl`, likewise.
    begin_parts: OnceLock<Pipeline>,
    /// `classify_cells.wgsl`
    pub classify_cells: Pipeline,
    /// `raycast.wgsl`
    pub raycast: Pipeline,
    /// `gather_misses.wgsl`
    pub gather_misses: Pipeline,
    /// `gather_pixels.wgsl`, with group 0 of [`Self::bind_view`].
    pub gather_pixels: Pipeline,
}

/// A pipeline, with the layout of its own bindings.
#[derive(Debug)]
pub struct Pipeline {
    /// The pipeline.
    pub pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

/// Bindings of group 0.
#[derive(Debug)]
pub struct SceneBindings<'a> {
    /// `Scene`
    pub scene: &'a wgpu::Buffer,
    /// Page table.
    pub page_table: &'a wgpu::Buffer,
    /// Control points.
    pub points: &'a wgpu::TextureView,
    /// Bins and knots.
    pub transfer_index: &'a wgpu::TextureView,
    /// Extinction and emission by bins.
    pub light: &'a wgpu::TextureView,
    /// Macro ranges.
    pub macro_ranges: &'a wgpu::Buffer,
    /// Proximity.
    pub proximity: &'a wgpu::Buffer,
    /// Feedback.
    pub feedback: &'a wgpu::Buffer,
    /// Cache textures, [`TEXTURE_LIMIT`] of them.
    pub textures: &'a [wgpu::TextureView],
    /// Deviations of bricks.
    pub deviations: &'a wgpu::Buffer,
}

#[derive(Clone, Copy)]
enum Access {
    Read,
    ReadWrite,
    /// A sampled texture, of which texels are fetched.
    Table,
    /// A texture that is read in the device's preferred way: [`TexelAccess`].
    Texels(wgpu::TextureViewDimension),
}

/// Bindings of group 0 before the cache textures.
const SCENE_TABLES: [Access; 8] = [
    Access::Read,
    Access::Read,
    Access::Table,
    Access::Table,
    Access::Texels(wgpu::TextureViewDimension::D2),
    Access::Read,
    Access::ReadWrite,
    Access::ReadWrite,
];

impl Pipelines {
    /// Compiles the shaders.
    ///
    /// # Errors
    /// If the driver refuses one.
    pub fn new(gpu: &GpuDevice, variant: Variant) -> Result<Self, GpuError> {
        let texels = gpu.texels();
        let mut scene_entries: Vec<_> = (0..).zip(SCENE_TABLES).map(|(i, access)| entry(texels, i, access)).collect();
        let cache = (narrow::<u32>(SCENE_TABLES.len())..).take(TEXTURE_LIMIT);
        scene_entries.extend(cache.map(|i| entry(texels, i, Access::Texels(wgpu::TextureViewDimension::D3))));
        scene_entries.push(entry(texels, narrow::<u32>(scene_entries.len()), Access::Read));
        gpu.checked("the compute pipelines", || {
            let scene_layout = layout(gpu, &scene_entries);
            let view_layout = layout(gpu, &scene_entries[..1]);
            let make_on = |group_0: &wgpu::BindGroupLayout, shader: &ShaderModule, buffers: &[Access]| {
                make(gpu, group_0, shader, buffers, variant, false)
            };
            let make = |shader: &ShaderModule, buffers: &[Access]| make_on(&scene_layout, shader, buffers);
            let [read, write] = [Access::Read, Access::ReadWrite];
            Self {
                variant,
                begin_rays: Default::default(),
                begin_parts: OnceLock::new(),
                classify_cells: make(&CLASSIFY_CELLS, &[read, read]),
                raycast: make(&raycast_for(variant.flags), &[write, write]),
                gather_misses: make(&GATHER_MISSES, &[]),
                gather_pixels: make_on(&view_layout, &GATHER_PIXELS, &[read, read, write, write]),
                scene_layout,
                view_layout,
            }
        })
    }

    /// `begin_rays.wgsl`, for rays with or without clip planes.
    ///
    /// # Errors
    /// If the driver refuses it.
    pub(super) fn begin_rays(&self, gpu: &GpuDevice, is_cut: bool) -> Result<&Pipeline, GpuError> {
        let place = &self.begin_rays[usize::from(is_cut)];
        self.wanted(gpu, place, &BEGIN_RAYS, &[Access::ReadWrite, Access::ReadWrite], is_cut)
    }

    /// `begin_parts.wgsl`
    ///
    /// # Errors
    /// If the driver refuses it.
    pub fn begin_parts(&self, gpu: &GpuDevice) -> Result<&Pipeline, GpuError> {
        self.wanted(gpu, &self.begin_parts, &BEGIN_PARTS, &[Access::ReadWrite, Access::Read], false)
    }

    /// The pipeline in `place`, made on first use.
    fn wanted<'p>(
        &self,
        gpu: &GpuDevice,
        place: &'p OnceLock<Pipeline>,
        shader: &ShaderModule,
        buffers: &[Access],
        is_cut: bool,
    ) -> Result<&'p Pipeline, GpuError> {
        if let Some(pipeline) = place.get() {
            return Ok(pipeline);
        }
        let made =
            gpu.checked("a compute pipeline", || make(gpu, &self.scene_layout, shader, buffers, self.variant, is_cut))?;
        Ok(place.get_or_init(|| made))
    }

    /// Group 0.
    ///
    /// # Errors
    /// If the device refuses it.
    pub fn bind_scene(&self, gpu: &GpuDevice, bindings: &SceneBindings<'_>) -> Result<wgpu::BindGroup, GpuError> {
        let b = bindings;
        let tables = [b.points, b.transfer_index, b.light].map(wgpu::BindingResource::TextureView);
        let (first, last) = ([b.scene, b.page_table], [b.macro_ranges, b.proximity, b.feedback]);
        let mut resources: Vec<_> = first.map(wgpu::Buffer::as_entire_binding).into_iter().chain(tables).collect();
        resources.extend(last.map(wgpu::Buffer::as_entire_binding));
        resources.extend(b.textures.iter().map(wgpu::BindingResource::TextureView));
        resources.push(b.deviations.as_entire_binding());
        bind(gpu, &self.scene_layout, resources)
    }

    /// Group 0 with `Scene` alone.
    ///
    /// # Errors
    /// If the device refuses it.
    pub fn bind_view(&self, gpu: &GpuDevice, scene: &wgpu::Buffer) -> Result<wgpu::BindGroup, GpuError> {
        bind(gpu, &self.view_layout, vec![scene.as_entire_binding()])
    }
}

impl Pipeline {
    /// Group 1: whole buffers.
    ///
    /// # Errors
    /// If the device refuses it.
    pub fn bind(&self, gpu: &GpuDevice, buffers: &[&wgpu::Buffer]) -> Result<wgpu::BindGroup, GpuError> {
        bind(gpu, &self.layout, buffers.iter().map(|buffer| buffer.as_entire_binding()).collect())
    }
}

/// A pipeline with these buffers of its own.
fn make(
    gpu: &GpuDevice,
    scene_layout: &wgpu::BindGroupLayout,
    shader: &ShaderModule,
    buffers: &[Access],
    variant: Variant,
    is_cut: bool,
) -> Pipeline {
    let entries: Vec<_> = (0..).zip(buffers).map(|(i, access)| entry(gpu.texels(), i, *access)).collect();
    let layout = layout(gpu, &entries);
    Pipeline { pipeline: pipeline(gpu, [scene_layout, &layout], shader, variant, is_cut), layout }
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

fn layout(gpu: &GpuDevice, entries: &[wgpu::BindGroupLayoutEntry]) -> wgpu::BindGroupLayout {
    gpu.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label: None, entries })
}

fn pipeline(
    gpu: &GpuDevice,
    layouts: [&wgpu::BindGroupLayout; 2],
    shader: &ShaderModule,
    variant: Variant,
    is_cut: bool,
) -> wgpu::ComputePipeline {
    let source = wgpu::ShaderSource::Wgsl(shader.source(gpu.texels()).into());
    let module = gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(shader.name), source });
    let layout = gpu.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &layouts.map(Some),
        immediate_size: 0,
    });
    gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(shader.name),
        layout: Some(&layout),
        module: &module,
        entry_point: Some(shader.name),
        compilation_options: wgpu::PipelineCompilationOptions {
            constants: &[
                ("ONLY_MODE", f64::from(variant.mode)),
                ("ONLY_FLAGS", f64::from(variant.flags)),
                ("TEXTURE_COUNT", f64::from(variant.textures)),
                ("CUT_BY_PLANES", f64::from(u8::from(is_cut))),
            ],
            ..Default::default()
        },
        cache: None,
    })
}

fn entry(texels: TexelAccess, binding: u32, access: Access) -> wgpu::BindGroupLayoutEntry {
    let sampled = |view_dimension| wgpu::BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Uint,
        view_dimension,
        multisampled: false,
    };
    let buffer = |read_only| wgpu::BindingType::Buffer {
        ty: wgpu::BufferBindingType::Storage { read_only },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let ty = match access {
        Access::Read => buffer(true),
        Access::ReadWrite => buffer(false),
        Access::Table => sampled(wgpu::TextureViewDimension::D2),
        Access::Texels(view_dimension) => match texels {
            TexelAccess::Stored => wgpu::BindingType::StorageTexture {
                access: wgpu::StorageTextureAccess::ReadOnly,
                format: wgpu::TextureFormat::Rgba32Uint,
                view_dimension,
            },
            TexelAccess::Sampled => sampled(view_dimension),
        },
    };
    wgpu::BindGroupLayoutEntry { binding, visibility: wgpu::ShaderStages::COMPUTE, ty, count: None }
}
