//! Pictures of whole containers: what acceptance tests build, look at, and compare.
//!
//! A [`Subject`] is a volume built into a real container. Distances are the greatest difference of a channel, in grey
//! levels of 255. Pixels at which the right picture itself jumps (silhouettes) are found by [`stable_pixels`].

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use supervol_format::container::manifest::Source;
use supervol_format::{Container, Dims, Lod, VoxelBox};
use supervol_preprocess::source::{SourceError, SourceInfo, VolumeSource};
use supervol_preprocess::{BuildOptions, build};
use supervol_runtime::frame::{Backend, LevelChoice, RenderOptions, render, volume_facts};
use supervol_runtime::image::Image;
use supervol_runtime::raycast::gpu::GpuDevice;
use supervol_runtime::scene::{ResolvedScene, Scene, VolumeFacts};
use supervol_runtime::stats::FrameStats;

use crate::skipped;

/// How far two backends may be apart, in grey levels of 255.
pub const BOUND: f64 = 0.5;
/// How far the eye moves to find silhouettes, in level-0 voxels.
pub const EYE_SHIFT_VOXELS: f64 = 1e-4;

/// Part of another volume, cut out on reading; it stays where it was in the world.
pub struct SubBox {
    inner: Box<dyn VolumeSource>,
    start: [u64; 3],
    info: SourceInfo,
}

impl SubBox {
    /// The voxels of `kept`.
    ///
    /// # Panics
    /// If the box leaves the grid of `inner`.
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

/// A file of the developers' data folder: `$SUPERVOL_DATA`, or `shared/data` beside the workspace. Says so where it is
/// missing.
#[must_use]
pub fn data_file(name: &str) -> Option<PathBuf> {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let beside = ["../../shared/data", "../../../shared/data"].map(|p| manifest.join(p));
    let folders = std::env::var_os("SUPERVOL_DATA").map(PathBuf::from).into_iter().chain(beside);
    let found = folders.map(|folder| folder.join(name)).find(|path| path.exists());
    if found.is_none() {
        skipped(&format!("{name} is not in the data folder (set SUPERVOL_DATA)"));
    }
    found
}

/// Name of the GPU adapter, or `None` with a loud word where there is none.
///
/// # Panics
/// If there is none although `SUPERVOL_REQUIRE_GPU=1`.
#[must_use]
pub fn gpu_name() -> Option<String> {
    match GpuDevice::open() {
        Ok(gpu) => Some(gpu.name()),
        Err(error) => {
            let is_required = std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!is_required, "SUPERVOL_REQUIRE_GPU=1, but {error}");
            skipped(&format!("no GPU adapter ({error})"));
            None
        }
    }
}

/// A volume built into a container, in a folder that goes when this goes.
pub struct Subject {
    /// For messages and tables.
    pub name: String,
    /// The container, open.
    pub container: Arc<Container>,
    /// What scenes are resolved for.
    pub facts: VolumeFacts,
    _folder: tempfile::TempDir,
}

impl Subject {
    /// Builds a container of a volume.
    ///
    /// # Panics
    /// If that fails.
    #[must_use]
    pub fn new(name: &str, source: &dyn VolumeSource, options: &BuildOptions) -> Self {
        let folder = tempfile::tempdir().expect("tests need a temporary folder");
        let path = folder.path().join("out.svol");
        let format = source.info().format.to_owned();
        let origin = Source { name: name.into(), format, bytes: 0, xxh3_64: String::new() };
        build(source, origin, &path, options, &|_| ()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let container = Container::open(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
        let facts = volume_facts(&container);
        Self { name: name.into(), container: Arc::new(container), facts, _folder: folder }
    }

    /// The data value at this fraction of the value range.
    #[must_use]
    pub fn value(&self, fraction: f64) -> f64 {
        let range = self.facts.value_range;
        range.min + fraction * (range.max - range.min)
    }

    /// World position of a point of index space.
    #[must_use]
    pub fn world(&self, index: [f64; 3]) -> [f64; 3] {
        self.facts.geometry.world_from_index().transform_point3(index.into()).to_array()
    }

    /// Index coordinates of the middle.
    #[must_use]
    pub fn middle(&self) -> [f64; 3] {
        self.facts.dims.0.map(|n| (n as f64 - 1.0) / 2.0)
    }

    /// Half of the world diagonal.
    #[must_use]
    pub fn radius(&self) -> f64 {
        let extent = DVec3::from_array(self.facts.dims.0.map(|n| n as f64));
        0.5 * (self.facts.geometry.linear() * extent).length()
    }

    /// A perspective camera from outside that sees the whole volume, slightly askew.
    #[must_use]
    pub fn outside(&self) -> String {
        let target = self.world(self.middle());
        let away = DVec3::new(0.57, -0.71, 0.41).normalize() * self.radius() * 2.7;
        let eye = (DVec3::from_array(target) + away).to_array();
        format!(r#""camera": {{"eye": {eye:?}, "target": {target:?}, "up": [0.02, 0, 1], "fov_y": 38}}"#)
    }

    /// `"transfer_function"` with control points (fraction of the value range, colour, alpha).
    #[must_use]
    pub fn transfer_function(&self, points: &[(f64, [f64; 3], f64)]) -> String {
        let point = |&(fraction, color, alpha): &(f64, [f64; 3], f64)| {
            format!(r#"{{"value": {:?}, "color": {color:?}, "alpha": {alpha:?}}}"#, self.value(fraction))
        };
        let points = points.iter().map(point).collect::<Vec<_>>().join(", ");
        format!(r#""transfer_function": {{"points": [{points}]}}"#)
    }

    /// The scene of these JSON members.
    ///
    /// # Panics
    /// If they make none.
    #[must_use]
    pub fn scene(&self, members: &[&str]) -> ResolvedScene {
        let json = format!("{{{}}}", members.join(", "));
        let scene = Scene::from_json(&json).unwrap_or_else(|e| panic!("{json}: {e}"));
        scene.resolve(&self.facts).unwrap_or_else(|e| panic!("{json}: {e}"))
    }

    /// The picture, which must converge without a failed brick and without a loop that hit its limit.
    ///
    /// # Panics
    /// If it does not.
    #[must_use]
    pub fn render(&self, scene: &ResolvedScene, options: &RenderOptions<'_>) -> (Image, FrameStats) {
        let rendered = render(&self.container, scene, options);
        let (image, stats) = rendered.unwrap_or_else(|e| panic!("{}, {:?}: {e}", self.name, options.backend));
        let is_whole = stats.converged && stats.bricks_failed == 0 && stats.gpu_anomalies == 0;
        assert!(is_whole && stats.reference_capped_pieces == 0, "{}: {stats:#?}", self.name);
        (image, stats)
    }

    /// The picture of level 0 by one backend.
    #[must_use]
    pub fn finest(&self, scene: &ResolvedScene, backend: Backend) -> Image {
        self.render(scene, &finest(backend)).0
    }
}

/// Options for level 0 by one backend.
#[must_use]
pub fn finest(backend: Backend) -> RenderOptions<'static> {
    RenderOptions { backend, level: LevelChoice::Fixed(Lod(0)), threads: Some(2), ..RenderOptions::default() }
}

/// The greatest difference of a channel, in grey levels of 255, over the pixels that `judged` keeps.
///
/// # Panics
/// If the pictures differ in size or hold something else than finite numbers.
#[must_use]
pub fn distance_where(a: &Image, b: &Image, judged: impl Fn(usize) -> bool) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height), "sizes of two pictures to compare");
    let mut greatest = 0.0f64;
    for (i, (p, q)) in a.pixels.iter().zip(&b.pixels).enumerate() {
        assert!(p.iter().chain(q).all(|v| v.is_finite()), "pixel {i}: {p:?} and {q:?}");
        if judged(i) {
            (0..4).for_each(|c| greatest = greatest.max(255.0 * f64::from((p[c] - q[c]).abs())));
        }
    }
    greatest
}

/// The greatest difference of a channel, in grey levels of 255.
#[must_use]
pub fn distance(a: &Image, b: &Image) -> f64 {
    distance_where(a, b, |_| true)
}

/// The mean of all channels' differences, signs dropped, in grey levels of 255.
#[must_use]
pub fn mean_distance(a: &Image, b: &Image) -> f64 {
    let differences = a.pixels.as_flattened().iter().zip(b.pixels.as_flattened()).map(|(p, q)| (p - q).abs());
    255.0 * differences.map(f64::from).sum::<f64>() / (4 * a.pixels.len()) as f64
}

/// Share of pixels that show anything.
#[must_use]
pub fn covered(image: &Image) -> f64 {
    let seen = image.pixels.iter().filter(|p| p[3] > 0.0).count();
    seen as f64 / image.pixels.len() as f64
}

/// For each pixel, whether the reference stays within [`BOUND`] when the eye moves by [`EYE_SHIFT_VOXELS`] in the
/// picture's plane: elsewhere the right picture jumps, and rounding decides on which side a backend sees it.
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
            *stable &= (0..4).all(|c| f64::from((p[c] - q[c]).abs()) * 255.0 <= BOUND);
        }
    }
    stable
}
