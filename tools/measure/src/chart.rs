//! The chart: cost and error of every method on every scene.
//!
//! For each scene and look:
//! 1. The reference integrator draws the exact picture once, in `f64`, from the volume stored as floats.
//! 2. Each method draws the picture cold. This run counts bytes, bricks, samples and cells.
//! 3. Engines that state an error draw it once more, and state it.
//! 4. The method draws it warm, with all bricks in memory, until it has been timed often enough. Cost and error belong
//!    to the same picture. Tables that depend only on the transfer function are made before the warm clock starts.
//!
//! Processor time is that of the whole process, so nothing else may run in it. Failed methods are left out and named in
//! the notes.

use std::time::{Duration, Instant};

use glam::DVec3;
use supervol_format::codec::CodecChoice;
use supervol_preprocess::{BuildOptions, MaxError};
use supervol_runtime::engines::gpu::device::GpuDevice;
use supervol_runtime::render::options::{Backend, RenderOptions};
use supervol_runtime::render::process;
use supervol_runtime::render::renderer::{Renderer, render};
use supervol_runtime::render::stats::FrameStats;
use supervol_scene::image::{GREY_LEVELS, Image, greatest};
use supervol_scene::scene::ResolvedScene;

use crate::context::{ChartError, Context};
use crate::measure::{HALF_A_LEVEL, Spread, distance, flip};
use crate::methods::{DEFAULT, MethodSpec, methods};
use crate::points::{CPU, Point, mark_front};
use crate::scenes::{Grid, Loaded, Look, SceneSpec, Shading, Shape, Storage};
use crate::stated::{AtLevel, Pixels};
use crate::volume::{HOST_MEMORY_BYTES, Volume, build_options, finest, image_size, transfer_function};

/// Least and greatest number of timed warm pictures.
const REPEATS: [usize; 2] = [3, 9];
/// Time limit after which no further picture is timed.
const REPEAT_TIME: Duration = Duration::from_millis(100);
/// Camera distance from the centre, in radii of the volume. The volume fills the picture, and a pixel covers less than
/// two voxels everywhere, so the automatic level of detail is 0.
const CAMERA_RADII: f64 = 2.2;
/// Unit distance of opacities, world length: one voxel.
const UNIT_DISTANCE: f64 = 1.0;

/// Levels of detail whose stated errors are compared with the true errors.
const STATED_LEVELS: [u8; 2] = [0, 1];

/// Looks with pictures in the report.
const PICTURED_LOOKS: [Look; 2] =
    [Look { shape: Shape::Smooth, shading: Shading::On }, Look { shape: Shape::Spike, shading: Shading::Off }];
/// Methods with pictures in the report.
const PICTURED_METHODS: [(&str, &str); 4] = [
    (DEFAULT, "--max-error 0.5/255"),
    ("midpoint samples", "step 1 voxel"),
    ("pre-integrated", "step 1 voxel"),
    ("pre-classified", "step 1 voxel"),
];

/// Results of the chart.
#[derive(Debug)]
pub struct Chart {
    /// In order of scenes, looks and methods.
    pub points: Vec<Point>,
    /// Exact pictures, each with the pictures of some methods.
    pub pictures: Vec<PictureRow>,
    /// Stated errors of pixels, scene by scene, over all looks of the scene.
    pub stated: Vec<(String, Vec<AtLevel>)>,
    /// Remarks on this run, one sentence each.
    pub notes: Vec<String>,
    /// Width and height of the measured pictures, pixels.
    pub image_size: [u32; 2],
    /// Voxels along an edge of the volumes with selectable size.
    pub edge: u64,
}

/// The exact picture of a scene and look, and the pictures of some methods.
#[derive(Debug)]
pub struct PictureRow {
    /// Name of the scene.
    pub scene: String,
    /// Name of the transfer function.
    pub transfer_function: String,
    /// Picture of the reference integrator.
    pub exact: Image,
    /// Method, parameters and picture.
    pub pictures: Vec<(String, String, Image)>,
}

/// Cost of one picture, and its stated error.
struct Cost {
    cold: FrameStats,
    /// Greatest stated error of a pixel, fraction of full scale.
    stated: Option<f64>,
    cpu_ms: Vec<f64>,
    wall_ms: Vec<f64>,
}

/// Storage of a volume: voxel storage, codec, largest voxel error.
type Stock = (Storage, CodecChoice, MaxError);

/// The stored versions of a scene's volume that have been built so far.
struct Stored<'a> {
    context: &'a Context<'a>,
    spec: &'a SceneSpec,
    grid: Grid,
    volumes: Vec<(Stock, Volume)>,
}

/// Measures these scenes with every method.
///
/// # Errors
/// If a scene's volume or exact picture cannot be made.
pub fn run(context: &Context<'_>, scenes: &[&SceneSpec]) -> Result<Chart, ChartError> {
    let [width, height, edge] = context.pick([96, 72, 64], [48, 36, 32]);
    let mut chart = Chart {
        points: Vec::new(),
        pictures: Vec::new(),
        stated: Vec::new(),
        notes: Vec::new(),
        image_size: [width, height],
        edge: u64::from(edge),
    };
    let mut methods = methods();
    if let Err(why) = gpu_to_measure() {
        methods.retain(|method| method.backend != Backend::Gpu);
        chart.note(context, format!("the GPU backend is not measured: {why}"));
    }
    for spec in scenes {
        match (spec.load)(context, chart.edge)? {
            Loaded::Missing(why) => chart.note(context, why),
            Loaded::Grid(grid) => {
                chart.measure_scene(&mut Stored { context, spec, grid, volumes: Vec::new() }, &methods)?;
            }
        }
    }
    Ok(chart)
}

/// Name of the GPU adapter, or the reason why there is none.
fn gpu_to_measure() -> Result<String, String> {
    GpuDevice::open().map(|device| device.name()).map_err(|e| e.to_string())
}

impl Stored<'_> {
    /// The volume in this storage and codec; built at the first call.
    fn volume(&mut self, method: &MethodSpec) -> Result<&Volume, ChartError> {
        let stock @ (storage, codec, max_error) = (method.storage, method.codec, method.voxel_error);
        if let Some(i) = self.volumes.iter().position(|(there, _)| *there == stock) {
            return Ok(&self.volumes[i].1);
        }
        let options = BuildOptions { codec, max_error, ..build_options(self.context.pick(32, 16)) };
        let name = format!("{} {storage:?} {}", self.spec.name, self.volumes.len());
        let volume = Volume::build(self.context, &name, &self.grid.source(storage), &options)?;
        self.volumes.push((stock, volume));
        Ok(&self.volumes.last().expect("just pushed").1)
    }
}

impl Chart {
    fn note(&mut self, context: &Context<'_>, sentence: String) {
        (context.say)(&sentence);
        self.notes.push(sentence);
    }

    fn measure_scene(&mut self, stored: &mut Stored<'_>, methods: &[MethodSpec]) -> Result<(), ChartError> {
        let mut stated = STATED_LEVELS.map(|level| Pixels::new(level, HALF_A_LEVEL));
        for (number, &look) in stored.context.pick(&Look::ALL[..], &Look::QUICK[..]).iter().enumerate() {
            let first = self.points.len();
            let started = Instant::now();
            self.measure_look(stored, look, methods, |volume, scene, exact| {
                stated.iter_mut().try_for_each(|at| at.draw(number as u64, volume, scene, exact, stating()).map(|_| ()))
            })?;
            mark_front(&mut self.points[first..]);
            (stored.context.say)(&format!(
                "{}, {}: {} methods in {:.0} s",
                stored.spec.name,
                look.name(),
                self.points.len() - first,
                started.elapsed().as_secs_f64()
            ));
        }
        let stated = stated.map(Pixels::finish);
        for at in stated.iter().filter(|at| !at.scenes_above_stated.is_empty()) {
            let (scene, level, looks) = (stored.spec.name, at.level, at.scenes_above_stated.len());
            let what = format!("{scene}, level {level}: in {looks} looks a pixel is further off than is stated of it");
            self.note(stored.context, what);
        }
        self.stated.push((stored.spec.name.into(), stated.into()));
        Ok(())
    }

    /// Calls `compare` with the default's volume, the scene and the exact picture.
    fn measure_look(
        &mut self,
        stored: &mut Stored<'_>,
        look: Look,
        methods: &[MethodSpec],
        compare: impl FnOnce(&Volume, &ResolvedScene, &Image) -> Result<(), ChartError>,
    ) -> Result<(), ChartError> {
        let default = MethodSpec::default_method();
        let members = self.scene_members(stored, look)?;
        let members: Vec<&str> = members.iter().map(String::as_str).collect();
        let volume = stored.volume(&default)?;
        let scene = volume.scene(&members)?;
        let exact = volume.finest(&scene, Backend::Reference)?;
        compare(volume, &scene, &exact)?;
        let mut row = PictureRow {
            scene: stored.spec.name.into(),
            transfer_function: look.name().into(),
            exact,
            pictures: Vec::new(),
        };
        for method in methods.iter().filter(|method| method.is_for(look)) {
            match measure(stored, &members, method) {
                Ok((image, cost)) => {
                    self.points.push(point(&row, method, &image, &cost));
                    if PICTURED_METHODS.contains(&(method.method, method.parameters.as_str())) {
                        row.pictures.push((method.method.into(), method.parameters.clone(), image));
                    }
                }
                Err(error) => {
                    let (scene, method, parameters) = (stored.spec.name, method.method, &method.parameters);
                    let what = format!("{scene}, {}, {method}, {parameters}: {error}", look.name());
                    self.note(stored.context, what);
                }
            }
        }
        if PICTURED_LOOKS.contains(&look) {
            self.pictures.push(row);
        }
        Ok(())
    }

    /// Members of the scene file, equal for all storages.
    fn scene_members(&self, stored: &mut Stored<'_>, look: Look) -> Result<Vec<String>, ChartError> {
        let points = stored.spec.values.points(look.shape, stored.grid.range());
        let default = MethodSpec::default_method();
        let volume = stored.volume(&default)?;
        let mut members = vec![
            volume.looking_from(DVec3::new(0.57, -0.71, 0.41), CAMERA_RADII),
            image_size(self.image_size[0], self.image_size[1]),
            transfer_function(UNIT_DISTANCE, &points),
        ];
        if look.shading == Shading::On {
            members.push(r#""shading": {}"#.into());
        }
        Ok(members)
    }
}

fn measure(stored: &mut Stored<'_>, members: &[&str], method: &MethodSpec) -> Result<(Image, Cost), ChartError> {
    let volume = stored.volume(method)?;
    let scene = volume.scene(members)?;
    let options = RenderOptions {
        level: method.level,
        skipping: method.skipping,
        caster: method.integration.caster(),
        max_error: method.max_error_grey_levels / GREY_LEVELS,
        host_memory_bytes: HOST_MEMORY_BYTES,
        ..finest(method.backend)
    };
    // On a device of its own: a cold picture compiles the shaders.
    let (image, cold) = render(&volume.container, &scene, &options)?;
    volume.check_whole(&image, &cold)?;
    let stated = if method.states_its_error() { stated_error(volume, &scene, &options)? } else { None };
    let mut cost = Cost { cold, stated, cpu_ms: Vec::new(), wall_ms: Vec::new() };
    if method.backend == Backend::Gpu {
        time_gpu(volume, &scene, &options, &mut cost)?;
    } else {
        time_cpu(volume, &scene, &options, &mut cost)?;
    }
    Ok((image, cost))
}

/// Render options that also predict the error of each pixel.
fn stating() -> RenderOptions {
    RenderOptions { predict_error: true, host_memory_bytes: HOST_MEMORY_BYTES, ..finest(Backend::Cpu) }
}

/// Greatest stated error of a pixel, fraction of full scale; `None` if the engine states none.
fn stated_error(volume: &Volume, scene: &ResolvedScene, options: &RenderOptions) -> Result<Option<f64>, ChartError> {
    let stating = RenderOptions { predict_error: true, ..options.clone() };
    let (_, maps, _) = volume.render_with_maps(scene, &stating)?;
    Ok(maps.errors.map(|errors| greatest(errors.pixels.iter().map(|pixel| f64::from(pixel[0])))))
}

/// Whether enough pictures have been timed.
fn is_enough(timed: usize, begun: Instant) -> bool {
    timed >= REPEATS[1] || (timed >= REPEATS[0] && begun.elapsed() >= REPEAT_TIME)
}

/// Times pictures with all bricks in memory.
fn time_cpu(
    volume: &Volume,
    scene: &ResolvedScene,
    options: &RenderOptions,
    cost: &mut Cost,
) -> Result<(), ChartError> {
    let mut renderer =
        Renderer::new(supervol_runtime::render::volume::PlacedVolume::of(volume.container.clone()), options.clone())?;
    renderer.set_scene(scene.clone());
    // The first picture loads the bricks.
    renderer.advance(None)?;
    let begun = Instant::now();
    while !is_enough(cost.cpu_ms.len(), begun) {
        let (start, cpu_start) = (Instant::now(), process::cpu_time());
        renderer.begin_anew();
        renderer.advance(None)?;
        cost.cpu_ms.push(milliseconds(process::cpu_time().saturating_sub(cpu_start)));
        cost.wall_ms.push(milliseconds(start.elapsed()));
    }
    Ok(())
}

/// Repeats whole pictures. Wall time covers the passes. Processor time covers everything, including opening the device.
fn time_gpu(
    volume: &Volume,
    scene: &ResolvedScene,
    options: &RenderOptions,
    cost: &mut Cost,
) -> Result<(), ChartError> {
    for _ in 0..REPEATS[0] {
        let stats = volume.render(scene, options)?.1;
        cost.cpu_ms.push(stats.cpu_ms);
        cost.wall_ms.push(stats.render_ms);
    }
    Ok(())
}

fn point(row: &PictureRow, method: &MethodSpec, image: &Image, cost: &Cost) -> Point {
    let error = distance(image, &row.exact);
    let cpu = Spread::of(&cost.cpu_ms);
    let cold = &cost.cold;
    Point {
        scene: row.scene.clone(),
        transfer_function: row.transfer_function.clone(),
        method: method.method.into(),
        parameters: method.parameters.clone(),
        max_error: method.max_error(),
        stated: cost.stated,
        backend: cold.adapter.clone().unwrap_or_else(|| CPU.into()),
        cpu_ms: cpu.median_ms,
        cpu_ms_spread: cpu.greatest_ms - cpu.least_ms,
        wall_ms: Spread::of(&cost.wall_ms).median_ms,
        repeats: cost.cpu_ms.len(),
        cold_cpu_ms: cold.cpu_ms,
        samples: cold.casting.samples,
        cells: cold.casting.cells,
        bytes_read: cold.streaming.bytes_read,
        bricks_read: cold.streaming.page_ins,
        brick_memory_bytes: cold.host_cache_peak_bytes,
        peak_rss_bytes: process::peak_resident_bytes(),
        linf: error.linf,
        p999: error.p999,
        rmse: error.rmse,
        psnr_db: Some(error.psnr_db).filter(|psnr| psnr.is_finite()),
        bias: error.bias,
        flip: flip(image, &row.exact),
        pareto: false,
        default: method.is_default,
    }
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictured_methods_exist() {
        for (method, parameters) in PICTURED_METHODS {
            assert!(methods().iter().any(|m| (m.method, m.parameters.as_str()) == (method, parameters)), "{method}");
        }
    }
}
