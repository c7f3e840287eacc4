//! `supervol render`: a container to a picture.

use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, ValueEnum};
use supervol_format::{Container, Lod};
use supervol_runtime::frame::{self, Backend, LevelChoice, Progress, RenderError, RenderOptions};
use supervol_runtime::image::ImageError;
use supervol_runtime::raycast::cpu::Skipping;
use supervol_runtime::raycast::method::Method;
use supervol_runtime::scene::{DataKind, Scene, ShadingSpec};
use supervol_runtime::stats::FrameStats;

use crate::failure::{Failure, with_container, with_output};
use crate::progress::Reporter;
use crate::quantity::{self, ErrorBound, show_bytes};

/// What to show, how, and within what memory.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container
    container: PathBuf,
    /// Scene file (JSON); without one, a camera that frames the volume and a preset for the data
    #[arg(long, value_name = "SCENE.json")]
    scene: Option<PathBuf>,
    /// Picture to write: .png (8 bit, with background), .exr or .npy (float, premultiplied RGBA without background)
    #[arg(short, long, value_name = "IMAGE")]
    output: PathBuf,
    /// Who casts the rays
    #[arg(long, value_enum, default_value = "auto")]
    backend: BackendName,
    /// Error of the picture that is aimed for, as a share of full scale
    #[arg(long, value_name = "E", default_value = "0.5/255", value_parser = quantity::error_bound)]
    max_error: ErrorBound,
    /// Complete the picture from what is there after this time; without it, it converges
    #[arg(long, value_name = "MS", value_parser = quantity::milliseconds)]
    time_budget: Option<u64>,
    /// Most graphics memory to use
    #[arg(long, default_value = "256MiB", value_parser = quantity::bytes)]
    gpu_memory: u64,
    /// Most host memory to use for bricks, rays and the picture
    #[arg(long, default_value = "512MiB", value_parser = quantity::bytes)]
    host_memory: u64,
    /// Level of detail: auto (as fine as a pixel needs, brick by brick), or 0 for full resolution, 1, 2, ...
    #[arg(long, default_value = "auto", value_parser = level)]
    level: LevelChoice,
    /// Leave out what cannot be seen; the picture is the same either way
    #[arg(long, value_enum, default_value = "on")]
    skipping: SkippingName,
    /// Threads; all processors by default
    #[arg(long)]
    threads: Option<NonZero<usize>>,
    /// Write what happened, as JSON
    #[arg(long, value_name = "STATS.json")]
    stats: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BackendName {
    Auto,
    Cpu,
    Gpu,
    Reference,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum SkippingName {
    On,
    Off,
}

fn level(text: &str) -> Result<LevelChoice, String> {
    if text == "auto" {
        return Ok(LevelChoice::Auto);
    }
    text.parse().map(|l| LevelChoice::Fixed(Lod(l))).map_err(|_| format!("'{text}': expected auto, 0, 1, 2, ..."))
}

impl Arguments {
    fn options<'a>(&self, progress: &'a (dyn Fn(Progress) + Sync)) -> Result<RenderOptions<'a>, Failure> {
        let max_error = match self.max_error {
            ErrorBound::Absolute(error) => error,
            ErrorBound::Percent(percent) => percent / 100.0,
        };
        Ok(RenderOptions {
            backend: match self.backend {
                BackendName::Auto => Backend::Auto,
                BackendName::Cpu => Backend::Cpu,
                BackendName::Gpu => Backend::Gpu,
                BackendName::Reference => Backend::Reference,
            },
            level: self.level,
            host_memory_bytes: self.host_memory,
            gpu_memory_bytes: self.gpu_memory,
            threads: self.threads.map(NonZero::get),
            skipping: match self.skipping {
                SkippingName::On => Skipping::On,
                SkippingName::Off => Skipping::Off,
            },
            time_budget_ms: self.time_budget,
            method: Method::DEFAULT,
            max_error,
            progress: Some(progress),
        })
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    let path = &arguments.container;
    let container = Arc::new(Container::open(path).map_err(|e| with_container(path, e))?);
    if let LevelChoice::Fixed(lod) = arguments.level
        && lod > container.pyramid().coarsest()
    {
        let message =
            format!("--level {}: {} has levels 0 to {}", lod.0, path.display(), container.pyramid().coarsest().0);
        return Err(Failure::Command(message));
    }
    let scene = match &arguments.scene {
        Some(file) => read_scene(file)?,
        None => default_scene(&container),
    };
    let bar = Reporter::over_rows();
    let on_progress = |progress: Progress| {
        bar.set_length(u64::from(progress.rows));
        bar.set_position(u64::from(progress.rows_finished));
        bar.set_message(format!("{} read, {} rays wait", show_bytes(progress.bytes_read), progress.rays_waiting));
    };
    let result = picture(&container, &scene, &arguments.output, &arguments.options(&on_progress)?);
    bar.finish_and_clear();
    let stats = result.map_err(|failure| failure.named(arguments.scene.as_deref()))?;
    if let Some(file) = &arguments.stats {
        let text = serde_json::to_string_pretty(&stats).map_err(|e| Failure::Machine(e.to_string()))?;
        std::fs::write(file, text + "\n")
            .map_err(|e| Failure::Machine(format!("cannot write {}: {e}", file.display())))?;
    }
    print(&arguments.output, &stats).map_err(with_output)
}

/// A picture for somebody who asked for none in particular: shaded, but for amplitudes, whose layers have no surfaces.
fn default_scene(container: &Container) -> Scene {
    let seismic = frame::volume_facts(container).kind == DataKind::Seismic;
    Scene { shading: (!seismic).then(ShadingSpec::default), ..Scene::default() }
}

fn read_scene(file: &Path) -> Result<Scene, Failure> {
    let text = std::fs::read_to_string(file)
        .map_err(|e| Failure::Command(format!("cannot read the scene {}: {e}", file.display())))?;
    Scene::from_json(&text).map_err(|e| Failure::Command(format!("{}: {e}", file.display())))
}

/// Renders and writes one picture: what `render` and `demo` share.
pub fn picture(
    container: &Arc<Container>,
    scene: &Scene,
    output: &Path,
    options: &RenderOptions<'_>,
) -> Result<FrameStats, Failure> {
    supervol_runtime::image::ImageFormat::from_path(output).map_err(Failure::command)?;
    let resolved = scene.resolve(&frame::volume_facts(container)).map_err(Failure::command)?;
    let (image, stats) = frame::render(container, &resolved, options).map_err(with_render)?;
    image.write(output, resolved.background).map_err(|error| match error {
        ImageError::Io { .. } => Failure::Machine(error.to_string()),
        other => Failure::Command(other.to_string()),
    })?;
    Ok(stats)
}

fn with_render(error: RenderError) -> Failure {
    let message = error.to_string();
    match error {
        RenderError::Budget(_) | RenderError::ReferenceTooLarge { .. } => Failure::Command(message),
        RenderError::Container(_) => Failure::Data(message),
        _ => Failure::Machine(message),
    }
}

fn print(output: &Path, stats: &FrameStats) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "{}: {} x {}, {}, {:.0} ms, {} bricks read ({}), peak memory {}{}",
        output.display(),
        stats.image_width,
        stats.image_height,
        stats.backend,
        stats.total_ms,
        stats.page_ins,
        show_bytes(stats.bytes_read),
        show_bytes(stats.peak_rss_bytes),
        if stats.converged { "" } else { ", not converged" },
    )?;
    for failure in &stats.failures {
        writeln!(out, "not readable, drawn from its parent: {}: {}", failure.brick, failure.reason)?;
    }
    Ok(())
}
