//! Frames on a device in builds without the feature `gpu`: there is no device, and no such frame.

use std::sync::Arc;

use supervol_format::Container;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;

use super::on_device::{GpuDrawn, GpuPicture};
use crate::engines::gpu::device::GpuDevice;
use crate::engines::gpu::error::GpuError;
use crate::render::error::RenderError;
use crate::render::options::RenderOptions;
use crate::render::stats::FrameStats;
use crate::stream::streamer::Streamer;

/// A device, and what it holds: no value of this type exists.
pub(crate) struct GpuBackend(GpuDevice);

impl GpuBackend {
    /// See the type.
    pub(crate) fn new(device: GpuDevice) -> Self {
        Self(device)
    }

    /// See the type.
    pub(crate) fn default_memory(&self) -> u64 {
        match self.0.0 {}
    }

    /// See the type.
    pub(crate) fn device(&self) -> &GpuDevice {
        &self.0
    }

    /// See the type.
    pub(crate) fn take_back(&mut self, _picture: Image) {
        match self.0.0 {}
    }

    /// See the type.
    pub(crate) fn enlarged(&mut self, _picture: Image, _factor: u32, _size: [u32; 2]) -> Image {
        match self.0.0 {}
    }

    /// See the type.
    pub(crate) fn draw(
        &mut self,
        _streamer: &mut Streamer,
        _picture: &GpuPicture<'_>,
        _reopen: &dyn Fn() -> Result<GpuDevice, GpuError>,
    ) -> Result<GpuDrawn, RenderError> {
        match self.0.0 {}
    }
}

/// One picture on a device, which does not exist.
///
/// # Errors
/// Never: nobody has a device.
pub fn render_gpu_surviving(
    device: GpuDevice,
    _reopen: &dyn Fn() -> Result<GpuDevice, GpuError>,
    _container: &Arc<Container>,
    _scene: &ResolvedScene,
    _options: &RenderOptions,
) -> Result<(Image, FrameStats), RenderError> {
    match device.0 {}
}
