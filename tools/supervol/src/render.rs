//! `supervol render`: renders a picture of a container.

use std::io::Write;
use std::num::NonZero;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::json;
use supervol_arguments::cache::CacheArguments;
use supervol_arguments::failure::{Failure, with_container, with_output};
use supervol_arguments::output::{self, Beside, Force, Recording, RenderOutputs};
use supervol_arguments::progress::{RayBar, announce, announce_files};
use supervol_arguments::quantity::{self, show_bytes};
use supervol_arguments::scene::{name_of_scene, read_scene};
use supervol_arguments::source::SourceArguments;
use supervol_arguments::terminal::{self, Format};
use supervol_format::readable::counted;
use supervol_format::{Container, Lod};
use supervol_runtime::engines::cpu::Caster;
use supervol_runtime::engines::packets::PacketRule;
use supervol_runtime::engines::packets::simd::InstructionSet;
use supervol_runtime::render::options::{Backend, LevelChoice, Refining, RenderOptions};
use supervol_runtime::render::process;
use supervol_runtime::render::renderer::NO_DEVICE;
use supervol_runtime::render::stats::FrameStats;
use supervol_runtime::render::volume::PlacedVolume;
use supervol_runtime::stream::classify::Skipping;
use supervol_runtime::stream::held::BrickForm;
use supervol_scene::camera_path;
use supervol_scene::camera_path::CameraPath;
use supervol_scene::image::ImageFormat;
use supervol_scene::preset::view::upright;
use supervol_scene::scene::{CameraSpec, Scene};

use crate::failed_bricks::{FailedBricks, check_all_read};
use crate::look::LookArguments;
use crate::panels::Panels;
use crate::sequence::Sequence;
use crate::written::{PictureOutputs, Subject, warn};
use crate::{pick, picture};

/// Options for single pictures only.
const OF_ONE_PICTURE: [&str; 7] = ["stats", "error_map", "work_map", "check", "time_budget", "record", "fidelity"];
/// Number of rays of `--check` without a number.
const CHECK_RAYS: &str = "1000";

/// Picture, method and memory limits.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Container, or a volume file or folder as for `build`
    ///
    /// For a volume file, a container is built into the cache folder first.
    #[arg(value_name = "CONTAINER|FILE")]
    volume: PathBuf,
    /// Scene file (JSON), - for standard input, or the scene itself ('{...}')
    ///
    /// Values that the scene leaves out are chosen to suit the data. Without --scene, all of them are.
    #[arg(long, value_name = "SCENE.json")]
    scene: Option<PathBuf>,
    /// Print the complete scene of these options on standard output, for example as a start for a scene file
    ///
    /// Without --output, no picture is drawn.
    #[arg(long)]
    print_scene: bool,
    /// Picture to write: .png, .exr or .npy; - writes PNG to standard output
    ///
    /// .png has 8 bits a channel, with background. .exr and .npy have floats: premultiplied RGBA without background.
    /// With --turntable or --path, this is the folder for frame-00000.png and so on (--frame-format).
    #[arg(short, long, value_name = "IMAGE|FOLDER", required_unless_present_any = ["print_scene", "pick"])]
    output: Option<PathBuf>,
    /// Write N pictures of one turn around the volume: 1 to 100000
    ///
    /// If the command was stopped, the same command continues it.
    #[arg(long, value_name = "N", requires = "output", conflicts_with_all = OF_ONE_PICTURE,
          value_parser = clap::value_parser!(u32).range(1..=i64::from(camera_path::FRAME_LIMIT)))]
    turntable: Option<u32>,
    /// Write the pictures of a camera that moves between key frames
    ///
    /// The file holds {"keys": [{"frame": 0, "camera": {...}}, ...]}, with cameras as in a scene.
    #[arg(long, value_name = "KEYS.json", requires = "output", conflicts_with_all = OF_ONE_PICTURE,
          conflicts_with_all = ["turntable", "camera", "zoom"])]
    path: Option<PathBuf>,
    /// File format of the pictures of --turntable and --path; exr and npy hold floats [default: png]
    #[arg(long, value_enum, value_name = "FORMAT", requires = "output")]
    frame_format: Option<FrameFormat>,
    /// Backend that casts the rays [default: auto]
    #[arg(long, value_enum)]
    backend: Option<BackendName>,
    /// Largest allowed error of a pixel channel, as a fraction of full scale: 0.05/255 to 16/255, or 1
    ///
    /// The error sets the accuracy of integration along rays, on both backends. With --level auto, it also decides
    /// where coarser levels may be drawn. With 1, levels follow from the size of a pixel alone, and rays are integrated
    /// within 16/255.
    #[arg(long, value_name = "E", default_value = "0.5/255", value_parser = quantity::picture_error)]
    max_error: f64,
    /// Instruction set for packets of rays (CPU backend): avx512, avx2 or portable [default: the best of this
    /// processor]
    #[arg(long, value_name = "SET")]
    instructions: Option<InstructionSet>,
    /// Deadline for the picture in ms, counted from the start of the command [default: none, the picture converges]
    ///
    /// At the deadline, the picture is written as it is. The CPU backend draws large pixels first, then smaller ones.
    /// Other backends complete the picture from the bricks that are already read.
    #[arg(long, value_name = "MS", value_parser = quantity::milliseconds)]
    time_budget: Option<u64>,
    /// GPU memory limit, for example 2GiB [default: 1GiB on cards with their own memory, 256MiB on others]
    ///
    /// If a card has no room for 1GiB, the default is 512MiB or 256MiB.
    #[arg(long, value_name = "BYTES", value_parser = quantity::bytes)]
    gpu_memory: Option<u64>,
    /// Host memory limit for bricks, rays and the picture, for example 4GiB
    #[arg(long, visible_alias = "memory", default_value = "512MiB", value_parser = quantity::bytes)]
    host_memory: u64,
    /// Level of detail: auto, or a number; 0 is full resolution
    ///
    /// With auto, each brick is as fine as --max-error and the size of a pixel require.
    #[arg(long, default_value = "auto", value_parser = level)]
    level: LevelChoice,
    /// Skip bricks that are invisible; the picture is the same with on and off
    #[arg(long, value_enum, default_value = "on")]
    skipping: SkippingName,
    /// Form of bricks in host memory, for tests and measurements; the picture is the same
    #[arg(long, value_enum, default_value = "by-budget", hide = true)]
    brick_form: BrickFormName,
    /// Number of threads: 1 to 1024 [default: all processors]
    #[arg(long, value_parser = quantity::threads)]
    threads: Option<NonZero<usize>>,
    /// Write statistics as JSON: times, memory, streaming, errors
    ///
    /// `error_predicted` is the expected difference from the exact picture in grey levels of 255, for mode dvr. On
    /// the GPU it needs a transfer function without steps. It has a `total` and the terms `cells`, `ray_ends`,
    /// `transfer_function`, `levels` and `rounding`. For each, `is_bound` is true for an upper bound, and false for
    /// an estimate. `error_stated` is the difference from the finest level, whichever levels were drawn. Summing it
    /// takes 1 to 2 % of the casting time on the CPU, and 3 to 6 % on the GPU.
    #[arg(long, value_name = "STATS.json", requires = "output")]
    stats: Option<PathBuf>,
    /// State the error in the picture's record; for .npy, also write the record to IMAGE.npy.json
    ///
    /// Each .png (text chunk) and .exr (attribute) has a record, under the key `supervol`: the complete scene, checksums
    /// of container and pixels, the requested error, failures and levels. `supervol verify PICTURE --container FILE`
    /// proves the picture with it. Stating the error takes 2 to 6 % of the casting time.
    #[arg(long, requires = "output")]
    record: bool,
    /// Write the picture's fidelity as JSON: what is reduced, why, for how long, and by how many grey levels
    ///
    /// Dimensions are data_resolution, display_resolution, sampling_density, decoded_extent, pixel_value_quantisation,
    /// transform_approximation and rendering_path, the words of clinical viewers. Errors are stated as for --record.
    #[arg(long, value_name = "FIDELITY.json", requires = "output")]
    fidelity: Option<PathBuf>,
    /// Write an image with the stated error of each pixel, against the exact picture of the finest level
    ///
    /// EXR and NumPy hold fractions of full scale, as in the picture. PNG holds colours, from black (at most 0.1 grey
    /// levels of 255) through blue (0.5), green (2), yellow (16) and red (64) to white (255).
    #[arg(long, value_name = "FILE", requires = "output")]
    error_map: Option<PathBuf>,
    /// Write an image with the work of each pixel's rays (CPU backend): cells crossed and leaps over empty space
    ///
    /// Each number is the mean of a pixel's rays. EXR and NumPy hold cells in the first channel, leaps in the second.
    /// PNG shows cells in orange and leaps in blue, on a logarithmic scale up to 1,000. The picture stays the same,
    /// but takes several times as long.
    #[arg(long, value_name = "FILE", requires = "output")]
    work_map: Option<PathBuf>,
    /// Measure the error: cast N random rays again with the reference integrator [default without N: 1000]
    ///
    /// With --level auto, the reference is the exact picture of level 0. The level must fit into --host-memory.
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = CHECK_RAYS, requires = "output")]
    check: Option<NonZero<u64>>,
    /// Exit with code 0 even if bricks cannot be read
    ///
    /// Their coarser parents are drawn in their place.
    #[arg(long)]
    allow_failed: bool,
    /// Draw axes, orientation, scale, colour legend and name beside the volume
    ///
    /// auto decorates PNG files of commands that run in a terminal. It decorates no .exr or .npy file, no sequence,
    /// and no output of scripts and pipes. The scale is drawn for parallel rays only. The orientation shows the sides
    /// of a patient or the points of the compass.
    #[arg(long, value_enum, value_name = "WHEN", requires = "output", default_value = "auto", default_missing_value = "on",
          num_args = 0..=1, require_equals = true)]
    decorate: Decorate,
    /// Print value, world position, voxel and survey lines of the first visible point under pixel X,Y
    ///
    /// Pixel 0,0 is at the top left. The point depends on the mode. In dvr it is where half of the opacity is
    /// reached, in iso the surface, in mip and minip the extreme. Slices count, too. Repeat the option for several
    /// pixels. Without --output, no picture is drawn.
    #[arg(long, value_name = "X,Y", value_parser = quantity::pixel, conflicts_with_all = ["turntable", "path"])]
    pick: Vec<[u32; 2]>,
    /// Print the result of --pick as JSON
    #[arg(long, requires = "pick", conflicts_with = "print_scene")]
    json: bool,
    #[command(flatten)]
    force: Force,
    #[command(flatten)]
    look: LookArguments,
    #[command(flatten)]
    cache: CacheArguments,
    #[command(flatten)]
    source: SourceArguments,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BackendName {
    Auto,
    Cpu,
    Gpu,
    Reference,
}

/// File format of the pictures of a sequence.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum FrameFormat {
    Png,
    Exr,
    Npy,
}

impl From<FrameFormat> for ImageFormat {
    fn from(format: FrameFormat) -> Self {
        match format {
            FrameFormat::Png => Self::Png,
            FrameFormat::Exr => Self::Exr,
            FrameFormat::Npy => Self::Npy,
        }
    }
}

/// Decorations beside the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Decorate {
    Auto,
    On,
    Off,
}

impl Decorate {
    /// Tests if a picture in this file is decorated.
    fn applies_to(self, output: &Path, is_at_terminal: bool) -> bool {
        let is_png = || output.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
        self == Self::On || (self == Self::Auto && is_at_terminal && is_png())
    }
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BrickFormName {
    ByBudget,
    Plain,
    Packed,
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
    /// Render options of the command line. The time budget began at `start`.
    fn options(&self, start: Instant) -> RenderOptions {
        let passed = u64::try_from(start.elapsed().as_millis()).unwrap_or(u64::MAX);
        RenderOptions {
            backend: match self.backend.unwrap_or(BackendName::Auto) {
                // GPUs do not count the work of rays.
                BackendName::Auto if self.work_map.is_some() => Backend::Cpu,
                BackendName::Auto => Backend::Auto,
                BackendName::Cpu => Backend::Cpu,
                BackendName::Gpu => Backend::Gpu,
                BackendName::Reference => Backend::Reference,
            },
            level: self.level,
            host_memory_bytes: self.host_memory,
            process_bytes: process::bytes_beside_pictures(self.threads.map(NonZero::get)),
            cache_bytes: None,
            brick_form: match self.brick_form {
                BrickFormName::ByBudget => BrickForm::ByBudget,
                BrickFormName::Plain => BrickForm::Plain,
                BrickFormName::Packed => BrickForm::Packed,
            },
            gpu_memory_bytes: self.gpu_memory,
            threads: self.threads.map(NonZero::get),
            skipping: match self.skipping {
                SkippingName::On => Skipping::On,
                SkippingName::Off => Skipping::Off,
            },
            time_budget_ms: self.time_budget.map(|budget| budget.saturating_sub(passed)),
            caster: Caster::Packets(PacketRule { instructions: self.instructions, ..PacketRule::DEFAULT }),
            max_error: self.max_error,
            predict_error: self.states_error(),
            count_work: self.work_map.is_some(),
            refining: Refining::Tiles,
            progress: None,
            rays_finished: None,
        }
    }
}

impl Arguments {
    /// Tests if an output needs the stated error.
    fn states_error(&self) -> bool {
        self.stats.is_some() || self.error_map.is_some() || self.fidelity.is_some() || self.record
    }

    /// Names of the outputs beside the picture.
    fn beside(&self) -> Beside<'_> {
        Beside {
            error_map: self.error_map.as_deref(),
            work_map: self.work_map.as_deref(),
            statistics: self.stats.as_deref(),
            fidelity: self.fidelity.as_deref(),
            record: if self.record { Recording::Full } else { Recording::Usual },
        }
    }

    /// Path of the container to draw.
    fn container(&self) -> Result<PathBuf, Failure> {
        let memory_bytes = self.host_memory;
        let (reading, threads) = (self.source.reading(memory_bytes)?, self.threads.map(NonZero::get));
        self.cache.container_of(&self.volume, &reading, (threads, memory_bytes), self.look.kind_name())
    }
}

/// Motion of the camera.
struct Motion {
    /// Camera of each picture.
    cameras: Vec<CameraSpec>,
    /// The request as JSON, as in `sequence.json`.
    asked: serde_json::Value,
}

impl Arguments {
    /// Bricks that cannot be read: refused or allowed.
    fn failed_bricks(&self) -> FailedBricks {
        if self.allow_failed { FailedBricks::Allowed } else { FailedBricks::Refused }
    }

    /// Tests if the single picture is decorated.
    fn decorates(&self, output: &Path) -> bool {
        self.decorate.applies_to(output, terminal::is_at_terminal())
    }

    /// Refuses contradictory options.
    fn check(&self) -> Result<(), Failure> {
        let is_said = self.print_scene || !self.pick.is_empty();
        let is_reference = self.backend == Some(BackendName::Reference);
        let is_not_cpu = is_reference || self.backend == Some(BackendName::Gpu);
        let moves = self.turntable.is_some() || self.path.is_some();
        let wrong = if is_said && self.output.as_deref().is_some_and(output::is_standard) {
            "-o -: expected a file for the picture, because --print-scene and --pick write to standard output"
        } else if self.error_map.is_some() && is_reference {
            "--error-map needs --backend cpu or gpu; the reference has no stated error"
        } else if self.work_map.is_some() && is_not_cpu {
            "--work-map needs --backend cpu: other backends do not count the work of rays"
        } else if self.frame_format.is_some() && !moves {
            "--frame-format needs --turntable or --path; the format of one picture follows from its file name"
        } else if self.look.shows_panels() && moves {
            "--slice: the camera of a slice that is shown face on does not move; use --slices volume to show slices inside the volume"
        } else {
            return Ok(());
        };
        Err(Failure::Command(wrong.into()))
    }

    /// Warns of options without effect.
    fn warn_of_unused(&self) -> Result<(), Failure> {
        let is_not_gpu = matches!(self.backend, Some(BackendName::Cpu | BackendName::Reference));
        let format = match self.frame_format {
            Some(format) => Some(format.into()),
            None => self.output.as_deref().and_then(|output| ImageFormat::from_path(output).ok()),
        };
        let is_bare = format.is_some_and(|format| format != ImageFormat::Png);
        let unused = [
            (self.gpu_memory.is_some() && is_not_gpu, "--gpu-memory changes nothing with this --backend"),
            (
                self.look.has_background() && is_bare,
                "--background changes nothing in .exr and .npy: they hold the picture without background",
            ),
        ];
        for (_, message) in unused.iter().filter(|(is_unused, _)| *is_unused) {
            warn(message)?;
        }
        Ok(())
    }

    /// Output path of several slices; refuses options of single pictures.
    fn output_of_panels(&self) -> Result<&Path, Failure> {
        let of_one = [
            ("--stats", self.stats.is_some()),
            ("--error-map", self.error_map.is_some()),
            ("--work-map", self.work_map.is_some()),
            ("--record", self.record),
            ("--fidelity", self.fidelity.is_some()),
            ("--check", self.check.is_some()),
            ("--time-budget", self.time_budget.is_some()),
            ("--print-scene", self.print_scene),
            ("--pick", !self.pick.is_empty()),
        ];
        if let Some((option, _)) = of_one.iter().find(|(_, given)| *given) {
            return Err(Failure::Command(format!(
                "{option} needs a single picture: expected one --slice, found several"
            )));
        }
        let output = self.output.as_deref();
        output.ok_or_else(|| Failure::Command("--slice: expected a picture to write (-o)".into()))
    }

    /// Complete scene, and the cameras if there are several pictures.
    ///
    fn shown(&self, scene: Scene, volume: PlacedVolume) -> Result<(Scene, Option<Motion>), Failure> {
        let (container, facts) = (volume.container(), volume.facts());
        let overview = if self.look.asks_overview(&scene) { volume.overview() } else { None };
        let has_camera = scene.camera.is_some();
        let shown = self.look.scene(&scene, container, facts, overview);
        let mut shown = shown.map_err(|failure| failure.named(self.scene.as_deref()))?;
        if let Some(note) = self.look.note_of_table(&shown, overview) {
            announce(&format!("supervol: note: {note}"));
        }
        let motion = match (self.turntable, &self.path) {
            (Some(frames), _) => {
                if !has_camera {
                    shown.camera = Some(self.look.turning_camera(&shown, facts, overview));
                }
                let first = shown.camera.as_ref().expect("a complete scene has a camera");
                let cameras = camera_path::turntable(first, upright(facts), frames);
                Some(Motion { cameras, asked: json!({ "turntable": frames }) })
            }
            (None, Some(file)) => {
                let path = CameraPath::from_json(&supervol_arguments::input::read_text(file, "a camera path")?);
                let path = path.map_err(|e| Failure::Command(format!("{}: {e}", file.display())))?;
                Some(Motion { cameras: path.cameras(), asked: json!({ "path": path }) })
            }
            (None, None) => None,
        };
        if let Some(first) = motion.as_ref().and_then(|motion| motion.cameras.first()) {
            shown.camera = Some(first.clone());
        }
        Ok((shown, motion))
    }
}

/// Refuses a level that the container does not have.
fn check_level(level: LevelChoice, path: &Path, container: &Container) -> Result<(), Failure> {
    let coarsest = container.pyramid().coarsest();
    match level {
        LevelChoice::Fixed(lod) if lod > coarsest => {
            let message = format!(
                "--level {}: expected a level of {}, which has levels 0 to {}",
                lod.0,
                path.display(),
                coarsest.0
            );
            Err(Failure::Command(message))
        }
        LevelChoice::Fixed(_) | LevelChoice::Auto => Ok(()),
    }
}

/// Runs the command; `start` is the start of the program.
pub fn run(arguments: &Arguments, start: Instant) -> Result<(), Failure> {
    arguments.check()?;
    arguments.warn_of_unused()?;
    let path = &arguments.container()?;
    let container = Container::open(path).map_err(|e| with_container(path, e))?;
    let scene = match &arguments.scene {
        Some(file) => read_scene(file)?,
        None => Scene::default(),
    };
    let volume = arguments.look.volume(container);
    let placed = arguments.look.placed(&volume, &scene)?;
    let (container, facts) = (placed.container().clone(), placed.facts().clone());
    check_level(arguments.level, path, &container)?;
    let inputs = [Some(path), Some(&arguments.volume), arguments.scene.as_ref(), arguments.path.as_ref()];
    let inputs: Vec<&Path> = inputs.into_iter().flatten().map(PathBuf::as_path).collect();
    for note in arguments.look.notes(&container) {
        announce(&format!("supervol: note: {note}"));
    }
    if let Some((looks, grid)) = arguments.look.panels(&scene)? {
        let output = arguments.output_of_panels()?;
        let named = |look: &LookArguments| Ok((look.name(), look.scene(&scene, &container, &facts, None)?));
        let panels: Vec<(String, Scene)> = looks.iter().map(named).collect::<Result<_, Failure>>()?;
        let inputs: Vec<&Path> = inputs.into_iter().chain(panels.iter().flat_map(|(_, scene)| scene.files())).collect();
        let file = RenderOutputs::begin(output, Beside::default(), &inputs, arguments.force)?.picture;
        // All panels have the same cuts.
        panels.first().iter().for_each(|(_, scene)| announce_files(scene));
        let (decorate, failed_bricks) = (arguments.decorates(output), arguments.failed_bricks());
        let volume = &volume.without_overview();
        let panels = Panels { volume, panels: &panels, grid, decorate, failed_bricks };
        return panels.run(file, (path, output), &arguments.options(start));
    }
    let (scene, motion) = arguments.shown(scene, placed)?;
    let volume = &volume.without_overview();
    let inputs: Vec<&Path> = inputs.into_iter().chain(scene.files()).collect();
    if arguments.print_scene {
        let text = serde_json::to_string_pretty(&scene).map_err(|e| Failure::Machine(e.to_string()))?;
        writeln!(terminal::stdout(), "{text}").map_err(with_output)?;
    }
    if !arguments.pick.is_empty() || arguments.output.is_some() {
        announce_files(&scene);
    }
    if !arguments.pick.is_empty() {
        let format = if arguments.json { Format::Json } else { Format::Text };
        pick::run((volume, &scene), &arguments.options(start), &arguments.pick, format)
            .map_err(|failure| failure.named(arguments.scene.as_deref().map(name_of_scene)))?;
    }
    let Some(output) = &arguments.output else { return Ok(()) };
    let is_one = motion.is_none();
    let decorate = if is_one { arguments.decorates(output) } else { arguments.decorate == Decorate::On };
    let subject = Subject { volume, scene: &scene, decorate };
    if let Some(Motion { cameras, asked }) = &motion {
        let (force, failed_bricks) = (arguments.force, arguments.failed_bricks());
        let format = arguments.frame_format.unwrap_or(FrameFormat::Png).into();
        let sequence =
            Sequence { subject, cameras, motion: asked, folder: output, format, inputs: &inputs, force, failed_bricks };
        return sequence.run(&arguments.options(start));
    }
    let RenderOutputs { picture: file, maps, statistics, fidelity, record } =
        RenderOutputs::begin(output, arguments.beside(), &inputs, arguments.force)?;
    let outputs = PictureOutputs { picture: file, maps, fidelity, record };
    let bar = RayBar::over(&scene);
    let (progress, rays_finished) = (Some(bar.on_progress()), Some(bar.finished()));
    let options = RenderOptions { progress, rays_finished, ..arguments.options(start) };
    let result = picture::draw(&subject, outputs, (&options, start), arguments.check);
    drop(bar);
    let stats = result.map_err(|failure| failure.named(arguments.scene.as_deref().map(name_of_scene)))?;
    if let Some(file) = statistics {
        let text = serde_json::to_string_pretty(&stats).map_err(|e| Failure::Machine(e.to_string()))?;
        file.write(&(text + "\n"))?;
    }
    if !arguments.print_scene {
        print(output, &stats).map_err(with_output)?;
    }
    // Without `--backend`, only an unusual choice is reported.
    if let Some(why) = about_backend(options.backend, &stats)
        && (arguments.backend.is_some() || stats.no_gpu_because.as_deref() != Some(NO_DEVICE))
    {
        announce(&why);
    }
    check_all_read(path, stats.bricks_failed, arguments.failed_bricks())
}

/// Message about the automatically chosen backend and the reason, or about a slow requested one.
fn about_backend(asked: Backend, stats: &FrameStats) -> Option<String> {
    let adapter = stats.adapter.as_deref().unwrap_or("a graphics adapter");
    match asked {
        Backend::Auto => Some(match &stats.no_gpu_because {
            Some(why) => format!("--backend auto: {}, because {why}", stats.backend),
            None => format!("--backend auto: {}, because {adapter} is present", stats.backend),
        }),
        Backend::Gpu if stats.adapter_is_software => {
            Some(format!("{adapter} is a processor: --backend cpu draws the same picture many times faster"))
        }
        _ => None,
    }
}

fn print(output: &Path, stats: &FrameStats) -> std::io::Result<()> {
    let mut out = output::remarks_on(output);
    writeln!(
        out,
        "{}: {} x {}, {}, {:.0} ms, {} read ({}), peak memory {}{}",
        output.display(),
        stats.image_width,
        stats.image_height,
        stats.backend,
        stats.total_ms,
        counted(stats.streaming.page_ins, "brick"),
        show_bytes(stats.streaming.bytes_read),
        show_bytes(stats.peak_rss_bytes),
        if stats.converged { "" } else { ", not converged" },
    )?;
    if stats.pixels_unfinished > 0 {
        let pixels = f64::from(stats.image_width) * f64::from(stats.image_height);
        let share = 100.0 * stats.pixels_unfinished as f64 / pixels;
        let edge = stats.coarsest_pixel;
        writeln!(
            out,
            "deadline reached: {share:.0} % of the pixels have 1/{edge} of the resolution in each direction"
        )?;
    }
    if let Some(stated) = &stats.error_stated {
        let or_not = if stated.presence_may_change {
            "; some voxels are present in one level and absent in another"
        } else {
            ""
        };
        writeln!(
            out,
            "stated error, against the finest level, of 255 grey levels: at most {:.3}, mean {:.4}{or_not}",
            stated.largest_grey_levels, stated.mean_grey_levels,
        )?;
    }
    if let Some(measured) = &stats.error_measured {
        writeln!(
            out,
            "error against the exact picture of level {}, {} rays cast again, of 255 grey levels: largest {:.4}, 99.9th \
             percentile {:.4}, mean {:+.5}{}",
            measured.level,
            measured.rays,
            measured.largest_grey_levels,
            measured.p999_grey_levels,
            measured.mean_grey_levels,
            match measured.capped_pieces {
                0 => String::new(),
                pieces => format!("; the reference did not converge on {pieces} pieces of rays"),
            },
        )?;
    }
    if stats.bricks_failed > 0 {
        let share = 100.0 * (stats.fallbacks as f64 / stats.casting.rays.max(1) as f64).min(1.0);
        let affected = if share >= 1.0 { format!("up to {share:.0} %") } else { "less than 1 %".into() };
        writeln!(
            out,
            "{} could not be read; {affected} of the rays needed them",
            counted(stats.bricks_failed, "brick")
        )?;
    }
    for failure in &stats.failures {
        // Removes the name of the brick, with which most reasons begin.
        let reason =
            failure.reason.strip_prefix(&failure.brick).map_or(&*failure.reason, |rest| rest.trim_start_matches(": "));
        writeln!(out, "not readable, replaced by its parent: {}: {reason}", failure.brick)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pictures_for_people_are_decorated_unasked() {
        let unasked = |name: &str, at| Decorate::Auto.applies_to(Path::new(name), at);
        assert!(unasked("a.png", true) && unasked("a.PNG", true));
        assert!(!unasked("a.png", false) && !unasked("a.exr", true) && !unasked("a.npy", true) && !unasked("-", true));
        assert!(
            Decorate::On.applies_to(Path::new("a.npy"), false) && !Decorate::Off.applies_to(Path::new("a.png"), true)
        );
    }
}
