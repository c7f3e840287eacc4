//! The parts of a renderer that its drawings share.

use std::sync::Arc;

use supervol_format::Container;
use supervol_scene::scene::ResolvedScene;

use super::device::Device;
use super::loaded::LoadedVolume;
use crate::render::error::RenderError;
use crate::render::frame::on_device::device_bytes;
use crate::render::options::RenderOptions;
use crate::stream::budget::{DeadlineReserve, EngineBytes};

/// The parts of a renderer that outlive its pictures.
pub(crate) struct Means<'a> {
    /// The volume.
    pub(crate) container: &'a Arc<Container>,
    /// Options of the picture.
    pub(crate) options: &'a RenderOptions,
    /// The device that casts the rays; `None`: the CPU.
    pub(crate) device: Option<&'a mut Device>,
    /// Loaded data; `None` before the first picture.
    pub(crate) resident: &'a mut Option<LoadedVolume>,
    /// Memory for deadlines.
    pub(crate) reserve: DeadlineReserve,
}

/// The same, with memory divided for one picture.
pub(crate) struct Tools<'a> {
    /// Options of the picture.
    pub(crate) options: &'a RenderOptions,
    /// The device that casts the rays; `None`: the CPU.
    pub(crate) device: Option<&'a mut Device>,
    /// Loaded data.
    pub(crate) resident: &'a mut LoadedVolume,
}

impl Tools<'_> {
    /// The device of a drawing that is by a device.
    pub(crate) fn device(&mut self) -> &mut Device {
        self.device_and_volume().0
    }

    /// The device, as [`Self::device`], and the loaded data.
    pub(crate) fn device_and_volume(&mut self) -> (&mut Device, &mut LoadedVolume) {
        let device = self.device.as_deref_mut().expect("a drawing by a device is advanced with its device");
        (device, self.resident)
    }
}

impl<'a> Means<'a> {
    /// Divides the memory for a picture of this scene by an engine that takes `bytes`.
    ///
    /// # Errors
    /// If the host budget is too small.
    pub(crate) fn for_picture(self, scene: &ResolvedScene, bytes: EngineBytes) -> Result<Tools<'a>, RenderError> {
        let Self { container, options, device, resident, reserve } = self;
        let resident = LoadedVolume::fitting(resident, container, (scene, options), bytes, reserve)?;
        Ok(Tools { options, device, resident })
    }

    /// Host memory of the device's engine, or of the CPU's.
    pub(crate) fn engine_bytes(&self) -> EngineBytes {
        let core = self.container.pyramid().layout().core();
        match self.device {
            Some(_) => device_bytes(self.options, core),
            None => self.options.ray_caster().bytes(core),
        }
    }
}
