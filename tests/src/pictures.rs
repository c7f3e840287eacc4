//! Pictures of whole containers, for acceptance tests.
//!
//! A [`Subject`] is a volume built into a real container. Distances are the greatest difference of a channel, in grey
//! levels (1/255). [`stable_pixels`] excludes pixels at which the exact picture itself jumps (silhouettes).

use std::path::{Path, PathBuf};

use glam::DVec3;
use supervol_format::{Dims, Lod, VoxelBox};
use supervol_measure::volume::{Volume, device};
use supervol_measure::{Context, Scale};
use supervol_preprocess::BuildOptions;
use supervol_runtime::render::error::RenderError;
use supervol_runtime::render::options::{Backend, LevelChoice, RenderOptions};
use supervol_runtime::render::renderer::Renderer;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_scene::image::Image;
use supervol_scene::scene::ResolvedScene;
use supervol_sources::{SourceError, SourceInfo, VolumeSource};

use crate::skipped;

/// Greatest accepted distance between two backends, in grey levels.
pub const BOUND: f64 = 0.5;
/// Shift of the eye for detecting silhouettes, in voxels of level 0.
pub const EYE_SHIFT_VOXELS: f64 = 1e-4;

/// A part of another volume, cut out while reading. It keeps its position in the world.
pub struct SubBox {
    inner: Box<dyn VolumeSource>,
    start: [u64; 3],
    info: SourceInfo,
}

impl SubBox {
    /// The voxels in the box `kept`.
    ///
    /// # Panics
    /// If the box reaches beyond the grid of `inner`.
    pub fn new(inner: Box<dyn VolumeSource>, kept: VoxelBox) -> Self {
        let whole = inner.info();
        assert!((0..3).all(|a| kept.end[a] <= whole.dims.0[a]), "{kept:?} leaves {}", whole.dims);
        let mut info = SourceInfo { dims: Dims(kept.extent().map(|n| n as u64)), ..whole.clone() };
        let corner = DVec3::from_array(kept.start.map(|s| s as f64));
        info.geometry.origin = whole.geometry.world_from_index().transform_point3(corner).to_array();
        Self { inner, start: kept.start, info }
    }
}

impl VolumeSource for SubBox {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let moved = |corner: [u64; 3]| std::array::from_fn(|a| corner[a] + self.start[a]);
        self.inner.read_box(VoxelBox { start: moved(voxels.start), end: moved(voxels.end) }, out)
    }
}

/// Path of a file in `tests/data`, which is part of the repository.
///
/// # Panics
/// If the file does not exist.
#[must_use]
pub fn stored_file(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data").join(name);
    assert!(path.exists(), "{} is part of the repository, but is not there", path.display());
    path
}

/// Name of the GPU adapter; `None`, with a printed message, if there is none.
///
/// # Panics
/// If there is none and `SUPERVOL_REQUIRE_GPU=1` is set.
#[must_use]
pub fn gpu_name() -> Option<String> {
    match device() {
        Ok(gpu) => Some(gpu.name()),
        Err(error) => {
            let is_required = std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!is_required, "SUPERVOL_REQUIRE_GPU=1, but {error}");
            skipped(&format!("no GPU adapter ({error})"));
            None
        }
    }
}

/// A volume built into a container in a temporary folder, which is removed with it.
pub struct Subject {
    volume: Volume,
    _folder: tempfile::TempDir,
}

impl std::ops::Deref for Subject {
    type Target = Volume;

    fn deref(&self) -> &Volume {
        &self.volume
    }
}

impl Subject {
    /// Builds a container of a volume.
    ///
    /// # Panics
    /// If the build fails.
    #[must_use]
    pub fn new(name: &str, source: &dyn VolumeSource, options: &BuildOptions) -> Self {
        let folder = tempfile::tempdir().expect("tests need a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let volume = Volume::build(&context, name, source, options).unwrap_or_else(|e| panic!("{name}: {e}"));
        Self { volume, _folder: folder }
    }

    /// World position of a point in index space.
    #[must_use]
    pub fn world(&self, index: [f64; 3]) -> [f64; 3] {
        self.volume.world(index).to_array()
    }

    /// JSON member of a perspective camera that sees the whole volume from outside, at an oblique angle.
    #[must_use]
    pub fn outside(&self) -> String {
        let target = self.world(self.middle());
        let away = DVec3::new(0.57, -0.71, 0.41).normalize() * self.radius() * 2.7;
        let eye = (DVec3::from_array(target) + away).to_array();
        format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.02, 0, 1], "fov_y": 38}}"#)
    }

    /// JSON member `"transfer_function"` with control points (share of the value range, colour, alpha).
    #[must_use]
    pub fn transfer_function(&self, points: &[(f64, [f64; 3], f64)]) -> String {
        let point = |&(fraction, color, alpha): &(f64, [f64; 3], f64)| {
            format!(r#"{{"value": {:?}, "color": {color:?}, "alpha": {alpha:?}}}"#, self.value(fraction))
        };
        let points = points.iter().map(point).collect::<Vec<_>>().join(", ");
        format!(r#""transfer_function": {{"points": [{points}]}}"#)
    }

    /// The scene with these JSON members.
    ///
    /// # Panics
    /// If they are no valid scene.
    #[must_use]
    pub fn scene(&self, members: &[&str]) -> ResolvedScene {
        self.volume.scene(members).unwrap_or_else(|e| panic!("{members:?}: {e}"))
    }

    /// The picture and its statistics. It must converge without failed bricks and without loops that hit their limit.
    ///
    /// # Panics
    /// If it does not.
    #[must_use]
    pub fn render(&self, scene: &ResolvedScene, options: &RenderOptions) -> (Image, FrameStats) {
        let rendered = self.volume.render(scene, options);
        rendered.unwrap_or_else(|e| panic!("{}, {:?}: {e}", self.name, options.backend))
    }

    /// The picture of level 0 by one backend.
    #[must_use]
    pub fn finest(&self, scene: &ResolvedScene, backend: Backend) -> Image {
        self.render(scene, &finest(backend)).0
    }
}

/// A renderer of a subject. Renderers with backend `gpu` share the device of the process.
///
/// # Panics
/// If there is no device, or threads cannot be started.
#[must_use]
pub fn new_renderer(subject: &Subject, options: RenderOptions) -> Renderer {
    let volume = PlacedVolume::of(subject.container.clone());
    let renderer = match options.backend {
        Backend::Gpu => device().map_err(RenderError::from).and_then(|gpu| Renderer::on_device(volume, options, gpu)),
        _ => Renderer::new(volume, options),
    };
    renderer.unwrap_or_else(|e| panic!("{}: {e}", subject.name))
}

/// Options for level 0 with one backend.
#[must_use]
pub fn finest(backend: Backend) -> RenderOptions {
    RenderOptions { backend, level: LevelChoice::Fixed(Lod(0)), threads: Some(2), ..RenderOptions::default() }
}

/// The greatest difference of a channel in grey levels; infinite if a pixel is not finite.
///
/// # Panics
/// If the pictures differ in size.
#[must_use]
pub fn distance(a: &Image, b: &Image) -> f64 {
    a.distance(b)
}

/// The mean magnitude of all channels' differences, in grey levels.
#[must_use]
pub fn mean_distance(a: &Image, b: &Image) -> f64 {
    let differences = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened()).map(|(p, q)| (p - q).abs());
    255.0 * differences.map(f64::from).sum::<f64>() / (4 * a.pixels.len()) as f64
}

/// Share of pixels with positive opacity.
#[must_use]
pub fn covered(image: &Image) -> f64 {
    let seen = image.pixels.iter().filter(|p| p[3] > 0.0).count();
    seen as f64 / image.pixels.len() as f64
}

/// Whether each pixel of the reference picture changes by at most [`BOUND`] when the eye moves by [`EYE_SHIFT_VOXELS`]
/// in the picture's plane. At the other pixels the exact picture jumps, and rounding decides the side that a backend
/// sees.
#[must_use]
pub fn stable_pixels(subject: &Subject, scene: &ResolvedScene, exact: &Image) -> Vec<bool> {
    let shift = EYE_SHIFT_VOXELS * subject.facts.geometry.smallest_spacing();
    let mut stable = vec![true; exact.pixels.len()];
    for (x, y) in [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)] {
        let mut moved = scene.clone();
        moved.camera.eye += shift * (x * scene.camera.right + y * scene.camera.up);
        let image = subject.finest(&moved, Backend::Reference);
        for (i, stable) in stable.iter_mut().enumerate() {
            let (p, q) = (image.pixels[i], exact.pixels[i]);
            assert!(p.iter().all(|v| v.is_finite()), "pixel {i} of the reference: {p:?}");
            *stable &= (0..4).all(|c| f64::from((p[c] - q[c]).abs()) * 255.0 <= BOUND);
        }
    }
    stable
}
