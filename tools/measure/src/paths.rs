//! Frames along a path, as in a viewer: the camera moves, or the transfer function changes. `supervol bench --path`.
//!
//! Paths are data (`benches/paths/*.json`): one perspective camera per frame, in units of the volume, and a shift of
//! the transfer function. One renderer draws all frames; levels of detail are automatic. The first frame starts with an
//! empty cache and includes reading and decoding.
//!
//! Without a time budget each frame converges. With a budget the frame ends at the deadline. Its distance from the
//! converged frame is then measured, by a second renderer.

use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::json;
use supervol_runtime::render::options::Backend;
use supervol_runtime::render::process;
use supervol_runtime::render::renderer::Ahead;
use supervol_runtime::stream::counters::DeviceCounters;
use supervol_scene::image::{GREY_LEVELS, Image};
use supervol_scene::scene::ResolvedScene;
use supervol_scene::transfer_function::TransferFunction;

use crate::context::{ChartError, Context, Pace};
use crate::measure::{Spread, distance};
use crate::peers::cases::{Case, Looks, Subject, planned};
use crate::peers::report::{self, markdown_table};
use crate::stability::streaming::session::{Session, Settings};

/// Built-in paths: name and text.
pub const BUILT_IN: [(&str, &str); 3] = [
    ("orbit", include_str!("../../../benches/paths/orbit.json")),
    ("dolly", include_str!("../../../benches/paths/dolly.json")),
    ("drag", include_str!("../../../benches/paths/drag.json")),
];
/// Largest number of frames of a path.
const FRAME_LIMIT: usize = 100_000;

/// The built-in path of this name; `None` if there is none.
///
/// # Errors
/// If its text is not a valid path.
pub fn built_in(name: &str) -> Option<Result<CameraPath, ChartError>> {
    let found = BUILT_IN.iter().find(|(known, _)| *known == name);
    found.map(|(_, text)| CameraPath::from_json(text))
}

/// A camera path.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Name, for tables and file names.
    pub name: String,
    /// Description, one sentence.
    pub what: String,
    /// Vertical angle of view, degrees.
    pub fov_y: f64,
    /// World vector that points up in the picture.
    pub up: [f64; 3],
    /// One station per frame.
    pub frames: Vec<Station>,
}

/// Position of one frame: world vectors from the centre of the volume, in half diagonals of the volume.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// Position of the eye.
    pub eye: [f64; 3],
    /// Point that the camera looks at.
    pub target: [f64; 3],
    /// Shift of the transfer function's control points, as a fraction of their value range.
    #[serde(default)]
    pub shift: f64,
}

/// The transfer function with its points shifted by a fraction of their value range.
fn shifted(function: &TransferFunction, share: f64) -> Result<TransferFunction, ChartError> {
    let mut points = function.points().to_vec();
    let width = points[points.len() - 1].value - points[0].value;
    points.iter_mut().for_each(|point| point.value += share * width);
    TransferFunction::new(points, function.unit_distance()).map_err(|e| ChartError::Command(e.to_string()))
}

impl CameraPath {
    /// Reads a path.
    ///
    /// # Errors
    /// If the text is not a valid path. An invalid camera is found only when its frame is drawn.
    pub fn from_json(text: &str) -> Result<Self, ChartError> {
        let path: Self =
            serde_json::from_str(text).map_err(|e| ChartError::Command(format!("not a camera path: {e}")))?;
        let frames = path.frames.len();
        if !(1..=FRAME_LIMIT).contains(&frames) {
            return Err(ChartError::Command(format!("a camera path has 1 to {FRAME_LIMIT} frames, found {frames}")));
        }
        Ok(path)
    }

    /// The scene of one frame.
    fn scene(&self, case: &Case<'_>, station: &Station, size: [u32; 2]) -> Result<ResolvedScene, ChartError> {
        let volume = &case.built.volume;
        let world = |p: [f64; 3]| volume.world(volume.middle()) + volume.radius() * glam::DVec3::from_array(p);
        let scene = case.seen_from(world(station.eye), world(station.target), self.up, self.fov_y, size)?;
        let transfer_function = shifted(&scene.transfer_function, station.shift)?;
        Ok(ResolvedScene { transfer_function, ..scene })
    }
}

/// Options of a ride.
#[derive(Debug, Clone)]
pub struct Options {
    /// Volumes to draw.
    pub subject: Subject,
    /// Looks of each scene.
    pub looks: Looks,
    /// Voxels along an edge of the synthetic volumes; `None`: the default of each volume.
    pub edge: Option<u64>,
    /// Gzipped NIfTI file of the real volume among the scenes (a carp).
    pub carp_nifti_gz: &'static [u8],
    /// Threads for casting and decoding.
    pub threads: usize,
    /// Width and height of each frame, pixels.
    pub image: [u32; 2],
    /// Memory limit of the frames, bytes.
    pub host_memory_bytes: u64,
    /// Capacity of the brick cache, bytes; `None`: all memory that is left.
    pub cache_bytes: Option<u64>,
    /// Time budget of a frame, milliseconds; `None`: each frame converges.
    pub frame_budget_ms: Option<u64>,
    /// Time after each frame for reading ahead, milliseconds; `None`: no reading ahead.
    pub ahead_ms: Option<u64>,
    /// Requested error, as a fraction of full scale.
    pub max_error: f64,
    /// Backends, measured one after the other.
    pub backends: Vec<Backend>,
}

/// Cost and quality of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct FrameCost {
    /// Wall time, milliseconds.
    pub ms: f64,
    /// Processor time of all threads, milliseconds.
    pub cpu_ms: f64,
    /// Bricks loaded into the cache.
    pub page_ins: u64,
    /// Loaded bricks that had been in the cache before.
    pub repeated_page_ins: u64,
    /// Bytes read, including reading ahead.
    pub bytes_read: u64,
    /// Bricks loaded ahead, after the frame, for the next frame.
    pub page_ins_ahead: u64,
    /// Fraction of the pixels that come from a coarser picture.
    pub unfinished: f64,
    /// Edge of the largest such coarse pixel, in pixels; 0 if all pixels are finished.
    pub coarsest_pixel: u32,
    /// Distance from the converged frame: root mean square over all channels, grey levels of 255.
    pub rmse: f64,
    /// Counters of the graphics device.
    #[serde(flatten)]
    pub device: DeviceCounters,
}

/// One volume and look along the path.
#[derive(Debug, Clone, Serialize)]
pub struct Ride {
    /// Name of the scene or of the file.
    pub scene: String,
    /// Voxels along x, y, z.
    pub dims: [u64; 3],
    /// `unshaded`, `shaded`, or `default`.
    pub shading: &'static str,
    /// `cpu` or `gpu`.
    pub backend: &'static str,
    /// Frames in the order of the path.
    pub frames: Vec<FrameCost>,
    /// First, middle and last frame, each with its file name.
    #[serde(skip)]
    pub pictures: Vec<(String, Image)>,
}

/// Median, extremes and 95th percentile of a quantity over the frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Summary {
    /// Median, least and greatest value.
    pub spread: Spread,
    /// 95th percentile: the smallest frame value that 95 % of the values do not exceed.
    pub p95: f64,
}

impl Ride {
    /// Summary of one quantity over all frames.
    ///
    /// # Panics
    /// Never: a ride has frames.
    #[must_use]
    pub fn summary(&self, of: fn(&FrameCost) -> f64) -> Summary {
        let mut numbers: Vec<f64> = self.frames.iter().map(of).collect();
        numbers.sort_by(f64::total_cmp);
        let last = (numbers.len() * 95).div_ceil(100).max(1) - 1;
        Summary { spread: Spread::of(&numbers), p95: numbers[last] }
    }

    /// Bricks loaded into the cache: in the first frame, and in all other frames together.
    #[must_use]
    pub fn page_ins(&self) -> [u64; 2] {
        let first = self.frames.first().map_or(0, |frame| frame.page_ins);
        [first, self.frames.iter().skip(1).map(|frame| frame.page_ins).sum()]
    }
}

/// Draws the frames of a path, one volume after the other.
///
/// # Errors
/// If a volume cannot be made, or a frame cannot be drawn.
pub fn run(context: &Context<'_>, path: &CameraPath, options: &Options) -> Result<Vec<Ride>, ChartError> {
    let mut rides = Vec::new();
    for plan in planned(context, &options.subject, options.edge)? {
        let built = plan.build(context, options.looks, options.carp_nifti_gz)?;
        for case in built.cases() {
            for &backend in &options.backends {
                let (name, look, frames) = (&built.name, case.look, path.frames.len());
                (context.say)(&format!("{name}, {look}, {}: {frames} frames", name_of(backend)));
                rides.push(ride(context, path, &case, options, backend)?);
            }
        }
    }
    Ok(rides)
}

fn name_of(backend: Backend) -> &'static str {
    if backend == Backend::Gpu { "gpu" } else { "cpu" }
}

fn ride(
    context: &Context<'_>,
    path: &CameraPath,
    case: &Case<'_>,
    options: &Options,
    backend: Backend,
) -> Result<Ride, ChartError> {
    let settings =
        Settings { threads: options.threads, host_memory_bytes: options.host_memory_bytes, ..Settings::default() };
    let settings = Settings { cache_bytes: options.cache_bytes, backend, max_error: options.max_error, ..settings };
    let mut session = Session::new(&case.built.volume.container, settings)?;
    let mut whole = Session::new(&case.built.volume.container, Settings { cache_bytes: None, ..settings })?;
    let kept = [0, path.frames.len() / 2, path.frames.len() - 1];
    let (mut frames, mut pictures) = (Vec::new(), Vec::new());
    let pace = Pace::new(context.say);
    for (i, station) in path.frames.iter().enumerate() {
        let scene = path.scene(case, station, options.image)?;
        let cpu = process::cpu_time();
        let frame = session.frame(&scene, options.frame_budget_ms)?;
        let cpu_ms = process::cpu_time().saturating_sub(cpu).as_secs_f64() * 1e3;
        let rmse = match frame.stats.converged {
            true => 0.0,
            false => GREY_LEVELS * distance(&frame.image, &whole.frame(&scene, None)?.image).rmse,
        };
        let ahead = options.ahead_ms.map_or(Ok(Ahead::default()), |most| session.look_ahead(most))?;
        let stats = &frame.stats;
        frames.push(FrameCost {
            ms: frame.ms,
            cpu_ms,
            page_ins: stats.streaming.page_ins,
            repeated_page_ins: stats.streaming.repeated_page_ins,
            bytes_read: stats.streaming.bytes_read + ahead.bytes_read,
            page_ins_ahead: ahead.page_ins,
            unfinished: stats.pixels_unfinished as f64 / frame.image.pixels.len() as f64,
            coarsest_pixel: stats.coarsest_pixel,
            rmse,
            device: stats.device,
        });
        pace.tell(|| format!("  frame {} of {}: {:.0} ms", i + 1, path.frames.len(), frame.ms));
        if kept.contains(&i) {
            let of_backend = if backend == Backend::Gpu { "-gpu" } else { "" };
            pictures.push((format!("{}-{}{of_backend}-{i:02}.png", case.name(), path.name), frame.image));
        }
    }
    let dims = case.built.dims().0;
    Ok(Ride { scene: case.built.name.clone(), dims, shading: case.look, backend: name_of(backend), frames, pictures })
}

/// Writes `path-NAME.json` (every frame), `path-NAME.md` and some pictures into a folder. Creates the folder if needed.
///
/// # Errors
/// If a file cannot be written.
pub fn write(path: &CameraPath, rides: &[Ride], command: &str, folder: &Path) -> Result<(), ChartError> {
    let cannot = |path: &Path, source| ChartError::Write { path: path.into(), source };
    std::fs::create_dir_all(folder).map_err(|e| cannot(folder, e))?;
    let value = json!({"command": command, "path": path.name, "what": path.what, "rides": rides});
    for (ending, text) in [("json", format!("{value:#}\n")), ("md", table(rides))] {
        let file = folder.join(format!("path-{}.{ending}", path.name));
        std::fs::write(&file, text).map_err(|e| cannot(&file, e))?;
    }
    for (name, picture) in rides.iter().flat_map(|ride| &ride.pictures) {
        let file = folder.join(name);
        picture.write(&file, [0.0; 3]).map_err(|e| cannot(&file, std::io::Error::other(e.to_string())))?;
    }
    Ok(())
}

/// A Markdown page: the measured configuration and the table.
#[must_use]
pub fn markdown(path: &CameraPath, rides: &[Ride], options: &Options, command: &str) -> String {
    let [width, height] = options.image;
    let (machine, threads) = (report::machine(), options.threads);
    let mebibytes = options.host_memory_bytes >> 20;
    let budget = match options.frame_budget_ms {
        Some(ms) => format!("A frame is handed over after {ms} ms; its error is its distance from the converged one."),
        None => "Every frame converges.".into(),
    };
    format!(
        "# Frames along the path {}, {}\n\n    {command}\n\n- {} {} frames of {width} x {height}.\n\
         - Machine: {machine}; threads: {threads}; memory: {mebibytes} MiB. {budget} The first frame begins with an empty \
         cache.\n\n{}",
        path.name,
        report::today(),
        path.what,
        path.frames.len(),
        table(rides)
    )
}

/// The rides as a Markdown table.
#[must_use]
pub fn table(rides: &[Ride]) -> String {
    let head = [
        "scene",
        "shading",
        "voxels",
        "backend",
        "ms, median",
        "ms, 95th percentile",
        "CPU ms, median",
        "CPU ms, 95th percentile",
        "first frame, ms",
        "bricks read, first frame",
        "bricks read, others",
        "bricks read ahead",
        "read again",
        "MB read",
        "pixels unfinished, median",
        "taken from pixels of, median",
        "RMS error, grey levels, median",
        "95th percentile",
    ];
    let line = |ride: &Ride| {
        let (wall, cpu) = (ride.summary(|f| f.ms), ride.summary(|f| f.cpu_ms));
        let [first, others] = ride.page_ins();
        [
            ride.scene.clone(),
            ride.shading.into(),
            ride.dims.map(|n| n.to_string()).join(" x "),
            ride.backend.into(),
            format!("{:.0}", wall.spread.median_ms),
            format!("{:.0}", wall.p95),
            format!("{:.0}", cpu.spread.median_ms),
            format!("{:.0}", cpu.p95),
            format!("{:.0}", ride.frames.first().map_or(0.0, |f| f.ms)),
            first.to_string(),
            others.to_string(),
            ride.frames.iter().map(|f| f.page_ins_ahead).sum::<u64>().to_string(),
            ride.frames.iter().map(|f| f.repeated_page_ins).sum::<u64>().to_string(),
            format!("{:.1}", ride.frames.iter().map(|f| f.bytes_read).sum::<u64>() as f64 / 1e6),
            format!("{:.0} %", 100.0 * ride.summary(|f| f.unfinished).spread.median_ms),
            format!("{:.0}", ride.summary(|f| f64::from(f.coarsest_pixel)).spread.median_ms),
            format!("{:.2}", ride.summary(|f| f.rmse).spread.median_ms),
            format!("{:.2}", ride.summary(|f| f.rmse).p95),
        ]
    };
    markdown_table(&head, &rides.iter().map(line).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use supervol_runtime::lod::by_error::ANY_ERROR;

    use super::*;
    use crate::Scale;

    fn built_in(name: &str) -> CameraPath {
        super::built_in(name).expect("it comes with the program").expect("a path")
    }

    #[test]
    fn built_in_paths_are_what_their_page_says() {
        let length = |v: [f64; 3]| glam::DVec3::from_array(v).length();
        let [orbit, dolly, drag] = ["orbit", "dolly", "drag"].map(built_in);
        for path in [&orbit, &dolly, &drag] {
            assert_eq!(path.frames.len(), 60, "{}", path.name);
        }
        let steps: Vec<f64> =
            orbit.frames.windows(2).map(|w| length(std::array::from_fn(|a| w[1].eye[a] - w[0].eye[a]))).collect();
        let step = 2.0 * 3.0 * 20f64.to_radians().cos() * 3f64.to_radians().sin();
        assert!(steps.iter().all(|s| (s - step).abs() < 1e-5), "equal steps of 6 degrees");
        assert!(orbit.frames.iter().all(|f| (length(f.eye) - 3.0).abs() < 1e-5 && f.target == [0.0; 3]));
        let shifts: Vec<f64> = drag.frames.iter().map(|f| f.shift).collect();
        assert!(drag.frames.iter().all(|f| f.eye == orbit.frames[0].eye) && shifts[0] == -0.15, "{shifts:?}");
        assert!(shifts.windows(2).all(|w| (w[1] - w[0] - 0.005).abs() < 1e-9), "{shifts:?}");
        let (first, last) = (dolly.frames[0], dolly.frames[59]);
        assert!((length(first.eye) - 3.0).abs() < 1e-5 && (length(last.eye) - 0.2).abs() < 1e-5);
        assert!(first.eye[0] > 0.0 && last.eye[0] < 0.0, "it goes through the middle");
        assert!(
            dolly
                .frames
                .iter()
                .all(|f| { (length(std::array::from_fn(|a| f.eye[a] - f.target[a])) - 1.0).abs() < 1e-5 })
        );
    }

    #[test]
    fn a_wrong_path_is_refused() {
        let wrong = |text: &str| CameraPath::from_json(text).expect_err("no path").to_string();
        assert!(wrong("{}").contains("name"));
        let empty = r#"{"name": "n", "what": "w", "fov_y": 30, "up": [0, 0, 1], "frames": []}"#;
        assert!(wrong(empty).contains("found 0"));
        assert!(wrong(&empty.replace("up", "upp")).contains("upp"));
    }

    /// Both backends draw the same frames and share one table.
    #[test]
    #[allow(clippy::print_stderr, reason = "a skipped test must be seen")]
    fn both_backends_ride_the_same_path() {
        if let Err(error) = supervol_runtime::engines::gpu::device::GpuDevice::open() {
            let is_required = std::env::var_os("SUPERVOL_REQUIRE_GPU").is_some_and(|v| v == "1");
            assert!(!is_required, "SUPERVOL_REQUIRE_GPU=1, but {error}");
            eprintln!("SKIPPED: no GPU adapter ({error})");
            return;
        }
        let mut path = built_in("orbit");
        path.frames.truncate(1);
        let rides = rides(&path, vec![Backend::Cpu, Backend::Gpu]);
        let [cpu, gpu] = &rides[..] else { panic!("two rides instead of {}", rides.len()) };
        assert_eq!([cpu.backend, gpu.backend], ["cpu", "gpu"]);
        assert!(cpu.pictures[0].1.distance(&gpu.pictures[0].1) < 1.0, "other pictures");
        assert!(table(&rides).contains("| 80 x 80 x 80 | gpu "));
    }

    fn rides(path: &CameraPath, backends: Vec<Backend>) -> Vec<Ride> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let options = Options {
            subject: Subject::Scenes(vec!["vessels".into()]),
            looks: Looks::Unshaded,
            edge: Some(80),
            carp_nifti_gz: &[],
            threads: 1,
            image: [40, 30],
            host_memory_bytes: 64 << 20,
            cache_bytes: None,
            frame_budget_ms: None,
            ahead_ms: None,
            max_error: ANY_ERROR,
            backends,
        };
        run(&context, path, &options).expect("frames")
    }

    #[test]
    fn a_ride_counts_each_brick_once_where_memory_suffices() {
        let mut path = built_in("dolly");
        path.frames = path.frames.into_iter().step_by(12).collect();
        let rides = rides(&path, vec![Backend::Cpu]);
        let [ride] = &rides[..] else { panic!("one ride instead of {}", rides.len()) };
        assert_eq!((ride.frames.len(), ride.pictures.len()), (5, 3));
        let [first, others] = ride.page_ins();
        // 80 voxels are two bricks of 64 along each axis; 8 + 1 over all levels.
        assert!(first > 0 && first + others <= 9, "{first} and {others}");
        assert!(ride.frames.iter().all(|f| f.ms > 0.0 && f.cpu_ms > 0.0));
        let wall = ride.summary(|f| f.ms);
        assert_eq!(wall.p95, wall.spread.greatest_ms, "of five frames, the slowest");
        let shown = |(_, picture): &(String, Image)| picture.pixels.iter().filter(|p| p[3] > 0.05).count();
        let shown: Vec<usize> = ride.pictures.iter().map(shown).collect();
        assert!(shown.iter().all(|&pixels| pixels > 10), "every picture shows something: {shown:?}");
        assert!(table(&rides).contains("| vessels | unshaded | 80 x 80 x 80 |"));
    }
}
