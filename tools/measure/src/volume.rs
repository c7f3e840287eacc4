//! Volume built into a container file; its scenes and pictures.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glam::DVec3;
use supervol_format::codec::CodecChoice;
use supervol_format::container::manifest::Source;
use supervol_format::{BrickLayout, Container, Lod};
use supervol_preprocess::downsample::Reduce;
use supervol_preprocess::lod_axes::LodAxes;
use supervol_preprocess::{BuildOptions, Existing, build};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::engines::gpu::error::GpuError;
use supervol_runtime::engines::maps::Maps;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::{render_on_device, render_with_maps};
use supervol_runtime::render::stats::FrameStats;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::Image;
use supervol_scene::scene::{ResolvedScene, Scene};
use supervol_sources::VolumeSource;

use crate::context::{ChartError, Context};

/// Memory limit of a measured picture, bytes, unless the measurement sets its own.
pub const HOST_MEMORY_BYTES: u64 = 2 << 30;

/// Control point of a transfer function: data value, colour, alpha.
pub type Point = (f64, [f64; 3], f64);

/// A volume built into a container.
#[derive(Debug)]
pub struct Volume {
    /// Name, for tables and messages.
    pub name: String,
    /// The open container.
    pub container: Arc<Container>,
    /// Path of the container file.
    pub path: PathBuf,
    /// Facts that scenes are resolved against.
    pub facts: VolumeFacts,
}

/// Build options for measurements: bricks with this core; default settings otherwise.
///
/// # Panics
/// If `core` is not an allowed size.
#[must_use]
pub fn build_options(core: u32) -> BuildOptions {
    BuildOptions {
        layout: BrickLayout::new(core).expect("measurements use one of the core sizes"),
        codec: CodecChoice::Smallest,
        lod_axes: LodAxes::Xyz,
        reduce: Some(Reduce::Mean),
        existing: Existing::Replace,
        ..BuildOptions::default()
    }
}

impl Volume {
    /// Builds `FOLDER/NAME.svol` (spaces and slashes become dashes) and opens it.
    ///
    /// # Errors
    /// If the build fails.
    pub fn build(
        context: &Context<'_>,
        name: &str,
        source: &dyn VolumeSource,
        options: &BuildOptions,
    ) -> Result<Self, ChartError> {
        let path = context.folder.join(format!("{}.svol", name.replace([' ', '/'], "-")));
        let origin = Source { format: source.info().format.into(), ..Source::computed(name) };
        build(source, origin, &path, options, &|_| ())?;
        Self::open(name, &path)
    }

    /// Opens a container.
    ///
    /// # Errors
    /// If the file is not a valid container.
    pub fn open(name: &str, path: &Path) -> Result<Self, ChartError> {
        Ok(Self { path: path.into(), ..Self::of(name, Arc::new(Container::open(path)?)) })
    }

    /// Volume of an open container.
    #[must_use]
    pub fn of(name: &str, container: Arc<Container>) -> Self {
        let facts = VolumeFacts::of(&container);
        Self { name: name.into(), container, path: PathBuf::new(), facts }
    }

    /// Data value at this fraction of the value range.
    #[must_use]
    pub fn value(&self, fraction: f64) -> f64 {
        self.facts.value_range.min + fraction * self.facts.value_range.width()
    }

    /// World position of a point given in index coordinates.
    #[must_use]
    pub fn world(&self, index: [f64; 3]) -> DVec3 {
        self.facts.geometry.world_from_index().transform_point3(index.into())
    }

    /// Index coordinates of the centre of the domain.
    #[must_use]
    pub fn middle(&self) -> [f64; 3] {
        self.facts.dims.0.map(|n| (n as f64 - 1.0) / 2.0)
    }

    /// Half of the world diagonal of the domain.
    #[must_use]
    pub fn radius(&self) -> f64 {
        let extent = DVec3::from_array(self.facts.dims.0.map(|n| n as f64));
        0.5 * (self.facts.geometry.linear() * extent).length()
    }

    /// `"camera"`: perspective, from outside, slightly oblique; sees the whole volume.
    #[must_use]
    pub fn outside(&self) -> String {
        self.looking_from(DVec3::new(0.57, -0.71, 0.41), 2.7)
    }

    /// `"camera"`: perspective, looking at the centre. `direction` points from the centre to the eye; the distance is
    /// `radii` times the radius.
    #[must_use]
    pub fn looking_from(&self, direction: DVec3, radii: f64) -> String {
        let target = self.world(self.middle());
        let eye = target + direction.normalize() * self.radius() * radii;
        let (eye, target) = (eye.to_array(), target.to_array());
        format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.02, 0.013, 1], "fov_y": 38}}"#)
    }

    /// The scene with these JSON members.
    ///
    /// # Errors
    /// If the members are not a valid scene.
    pub fn scene(&self, members: &[&str]) -> Result<ResolvedScene, ChartError> {
        let scene = Scene::from_json(&format!("{{{}}}", members.join(", ")))?;
        Ok(scene.resolve(&self.facts)?)
    }

    /// The picture and its cost. It must have converged without a failed brick.
    ///
    /// # Errors
    /// If the picture cannot be drawn, did not converge, or holds values that are not finite.
    pub fn render(&self, scene: &ResolvedScene, options: &RenderOptions) -> Result<(Image, FrameStats), ChartError> {
        let (image, _, stats) = self.render_with_maps(scene, options)?;
        self.check_whole(&image, &stats)?;
        Ok((image, stats))
    }

    /// A picture with its maps, whether or not it has converged. Pictures by backend `gpu` share a [`device`].
    ///
    /// # Errors
    /// As [`render_with_maps`].
    pub fn render_with_maps(
        &self,
        scene: &ResolvedScene,
        options: &RenderOptions,
    ) -> Result<(Image, Maps, FrameStats), RenderError> {
        match options.backend {
            Backend::Gpu => render_on_device(device()?, &self.container, scene, options),
            _ => render_with_maps(&self.container, scene, options),
        }
    }

    /// Refuses a picture that did not converge without a failed brick, or holds values that are not finite.
    ///
    /// # Errors
    /// [`ChartError::Broken`], if the picture is such a one.
    pub fn check_whole(&self, image: &Image, stats: &FrameStats) -> Result<(), ChartError> {
        // Several distance measures treat NaN as no difference, so check here.
        let is_whole = stats.converged && stats.bricks_failed == 0 && stats.device.anomalies == 0 && image.is_finite();
        if is_whole && stats.reference_capped_pieces == 0 {
            return Ok(());
        }
        Err(ChartError::Broken(format!("a picture of {} did not converge to numbers: {stats:?}", self.name)))
    }

    /// The picture of level 0 by the default method of a backend.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn finest(&self, scene: &ResolvedScene, backend: Backend) -> Result<Image, ChartError> {
        Ok(self.render(scene, &finest(backend))?.0)
    }
}

/// The device of this process: opened once, because each device compiles its pipelines anew.
///
/// # Errors
/// If there is none.
pub fn device() -> Result<GpuDevice, GpuError> {
    static DEVICE: OnceLock<GpuDevice> = OnceLock::new();
    if let Some(device) = DEVICE.get() {
        return Ok(device.clone());
    }
    let device = GpuDevice::open()?;
    Ok(DEVICE.get_or_init(|| device).clone())
}

/// Options for level 0 on one backend.
#[must_use]
pub fn finest(backend: Backend) -> RenderOptions {
    RenderOptions {
        backend,
        level: LevelChoice::Fixed(Lod(0)),
        host_memory_bytes: HOST_MEMORY_BYTES,
        ..RenderOptions::default()
    }
}

/// `"transfer_function"` with these control points; `unit_distance` is a world length.
#[must_use]
pub fn transfer_function(unit_distance: f64, points: &[Point]) -> String {
    let point =
        |&(value, color, alpha): &Point| format!(r#"{{"value": {value:?}, "color": {color:?}, "alpha": {alpha:?}}}"#);
    let points = points.iter().map(point).collect::<Vec<_>>().join(", ");
    format!(r#""transfer_function": {{"unit_distance": {unit_distance:?}, "points": [{points}]}}"#)
}

/// `"image"` of this size over black.
#[must_use]
pub fn image_size(width: u32, height: u32) -> String {
    format!(r#""image": {{"width": {width}, "height": {height}}}"#)
}
