//! The backend of a renderer: the device or processor that casts the rays.

use std::sync::Arc;

use supervol_format::Container;
use supervol_scene::image::Image;
use supervol_scene::scene::{Mode, ResolvedScene};

use crate::engines::engine::Engine;
use crate::engines::error::EngineError;
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::hardware::may_have_hardware;
use crate::engines::gpu::limits::SHARED_MEMORY;
use crate::render::drawing::Drawing;
use crate::render::drawing::device::Device;
use crate::render::drawing::slices::SlicedDrawing;
use crate::render::drawing::staged::StagedDrawing;
use crate::render::drawing::whole::{WholeBy, WholeDrawing};
use crate::render::error::RenderError;
use crate::render::options::{Backend, RenderOptions};
use crate::render::stats::{FrameStats, mode_name};

/// Message for the usual case that no GPU is present ([`FrameStats::no_gpu_because`]); printed only on request.
pub const NO_DEVICE: &str = "no graphics device is there";

/// Makes an engine of one's own for each picture of a [`Renderer`](super::Renderer). Closures with these arguments are
/// one.
pub trait MakeEngine: Send {
    /// The engine of one picture of this scene.
    ///
    /// # Errors
    /// If a device fails.
    fn make(
        &mut self,
        container: &Arc<Container>,
        scene: &ResolvedScene,
        options: &RenderOptions,
    ) -> Result<Box<dyn Engine + Send>, EngineError>;
}

impl<F> MakeEngine for F
where
    F: FnMut(&Arc<Container>, &ResolvedScene, &RenderOptions) -> Result<Box<dyn Engine + Send>, EngineError> + Send,
{
    fn make(
        &mut self,
        container: &Arc<Container>,
        scene: &ResolvedScene,
        options: &RenderOptions,
    ) -> Result<Box<dyn Engine + Send>, EngineError> {
        self(container, scene, options)
    }
}

/// The device or processor that casts the rays.
pub(super) enum Chosen {
    /// The CPU, with the reason why not the GPU.
    Cpu { no_gpu_because: Option<String> },
    /// A device; if it fails, the CPU if `or_cpu` allows it.
    Gpu { device: Box<Device>, or_cpu: bool },
    /// The reference integrator.
    Reference,
    /// Engines from outside.
    Outside(Box<dyn MakeEngine>),
}

impl Chosen {
    /// The backend of the options. For `auto`: a hardware GPU if there is one, else the CPU.
    ///
    /// # Errors
    /// If the options ask for a GPU and there is none.
    pub(super) fn new(backend: Backend, pool: &rayon::ThreadPool) -> Result<Self, RenderError> {
        let no_gpu = |why: String| Self::Cpu { no_gpu_because: Some(why) };
        Ok(match backend {
            Backend::Cpu => Self::Cpu { no_gpu_because: None },
            Backend::Gpu => Self::on_device(pool.install(GpuDevice::open)?),
            Backend::Reference => Self::Reference,
            Backend::Auto if !may_have_hardware() => no_gpu(NO_DEVICE.into()),
            Backend::Auto => match GpuDevice::open() {
                Ok(device) if device.is_software() => no_gpu(format!("{} is a processor", device.name())),
                Ok(device) => Self::Gpu { device: Box::new(Device::new(device)), or_cpu: true },
                Err(error) => no_gpu(error.to_string()),
            },
        })
    }

    /// An open device, without the CPU in its place.
    pub(super) fn on_device(device: GpuDevice) -> Self {
        Self::Gpu { device: Box::new(Device::new(device)), or_cpu: false }
    }

    /// Begins a picture.
    ///
    /// # Errors
    /// If the options choose a CPU engine that this backend or scene does not have, or an engine from outside cannot be
    /// made.
    pub(super) fn begin(
        &mut self,
        container: &Arc<Container>,
        scene: &ResolvedScene,
        options: &RenderOptions,
    ) -> Result<Box<dyn Drawing>, RenderError> {
        let own_scene = scene.clone();
        Ok(match self {
            Self::Reference => Box::new(WholeDrawing::new(own_scene, WholeBy::Reference)),
            Self::Outside(maker) => {
                let engine = maker.make(container, scene, options)?;
                Box::new(WholeDrawing::new(own_scene, WholeBy::Engine(engine)))
            }
            Self::Cpu { .. } | Self::Gpu { .. } if !scene.slices.is_empty() => {
                if !options.caster.is_default() {
                    return Err(RenderError::Method { backend: options.backend, mode: "slices" });
                }
                // A sheet of sections shows no volume between them.
                let is_by_device = matches!(self, Self::Gpu { .. }) && scene.mode != Mode::Slice && suits_device(scene);
                Box::new(SlicedDrawing::new(scene, container, is_by_device))
            }
            Self::Gpu { .. } if suits_device(scene) => Box::new(StagedDrawing::by_device(own_scene)),
            Self::Gpu { .. } => Box::new(StagedDrawing::by_packets(own_scene)),
            Self::Cpu { .. } if options.caster.is_default() => Box::new(StagedDrawing::by_packets(own_scene)),
            Self::Cpu { .. } => Box::new(WholeDrawing::new(own_scene, WholeBy::Cpu)),
        })
    }

    /// The device.
    pub(super) fn device(&mut self) -> Option<&mut Device> {
        match self {
            Self::Gpu { device, .. } => Some(device),
            _ => None,
        }
    }

    /// Whether the CPU takes over if the device fails.
    pub(super) fn is_replaceable(&self) -> bool {
        matches!(self, Self::Gpu { or_cpu: true, .. })
    }

    /// Whether the CPU casts the rays.
    pub(super) fn is_cpu(&self) -> bool {
        matches!(self, Self::Cpu { .. })
    }

    /// Keeps the memory of a picture that is no longer needed, if the next one can reuse it.
    pub(super) fn take_back(&mut self, memory: Option<Image>) {
        if let (Self::Gpu { device, .. }, Some(memory)) = (self, memory) {
            device.backend.take_back(memory);
        }
    }

    /// Device memory to use by default, bytes.
    pub(super) fn default_memory(&self) -> u64 {
        match self {
            Self::Gpu { device, .. } => device.backend.default_memory(),
            _ => SHARED_MEMORY,
        }
    }

    /// Adds the facts about the device to statistics.
    pub(super) fn describe(&self, stats: &mut FrameStats) {
        match self {
            Self::Cpu { no_gpu_because } => stats.no_gpu_because.clone_from(no_gpu_because),
            Self::Gpu { .. } if stats.backend == "cpu" => {
                let drawn = "sections (mode slice), opacity by the gradient and light by the normals of cuts are drawn by the \
                             processor";
                stats.no_gpu_because = Some(drawn.to_owned());
            }
            Self::Gpu { device, .. } => stats.adapter_is_software = device.backend.device().is_software(),
            Self::Reference | Self::Outside(_) => {}
        }
    }
}

/// Whether a device can draw a scene of another mode than `slice`.
pub(super) fn suits_device(scene: &ResolvedScene) -> bool {
    scene.gradient_opacity.is_none() && scene.cut_normals.is_none()
}

/// Checks that the backend has the engine that the options choose, for this scene.
///
/// # Errors
/// If it does not.
pub(super) fn check(scene: &ResolvedScene, options: &RenderOptions) -> Result<(), RenderError> {
    let backend = options.backend;
    if !options.caster.is_default()
        && (backend != Backend::Cpu || scene.mode != Mode::Dvr || scene.has_inner_surfaces())
    {
        return Err(RenderError::Method { backend, mode: mode_name(scene.mode) });
    }
    for (is_asked, mode, on_device) in [
        (scene.gradient_opacity.is_some(), "dvr with gradient_opacity", RenderError::GradientsOnGpu),
        (scene.cut_normals.is_some(), "dvr with cut_normals", RenderError::CutNormalsOnGpu),
    ] {
        if is_asked && !options.caster.is_default() {
            return Err(RenderError::Method { backend, mode });
        }
        if is_asked && backend == Backend::Gpu {
            return Err(on_device);
        }
    }
    if backend == Backend::Gpu && scene.mode == Mode::Slice {
        return Err(RenderError::SlicesOnGpu);
    }
    Ok(())
}
