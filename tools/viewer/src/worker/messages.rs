//! Requests of the window and messages of the worker.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use eframe::egui::ColorImage;
use serde::{Deserialize, Serialize};
use supervol::{Backend, Error, ErrorKind, FrameStats, Picked, PlacedVolume, Volume};
use supervol_format::Container;
use supervol_format::coordinates::Coordinates;
use supervol_preprocess::Existing;
use supervol_preprocess::kept::Reading;
use supervol_preprocess::report::Progress as BuildProgress;
use supervol_scene::camera_path::CameraPath;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::image::{Image, ImageFormat};
use supervol_scene::preset::overview::Overview;
use supervol_scene::scene::Scene;
use supervol_sources::{Part, Survey};

/// Number of panels with a section each, beside the picture.
pub const PANELS: usize = 3;

/// Render settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Memory budget in bytes for bricks, rays and pictures, without the window's own memory.
    pub host_memory_bytes: u64,
    /// Error to aim for, as a fraction of full scale.
    pub max_error: f64,
    /// Time in milliseconds after which a changed view shows a picture.
    pub interaction_ms: u64,
    /// Device that casts the rays of pictures. Sections are always drawn by the CPU.
    pub backend: Backend,
    /// Threads for casting and decoding; `None`: one per processor. Applied when a volume is opened.
    pub threads: Option<usize>,
    /// Whether box, orientation, scale and colour bar are drawn around the volume.
    pub decorations: Decorations,
    /// Whether panels beside the picture get a part of the memory.
    pub side_panels: SidePanels,
    /// Diagnostic display.
    pub inspect: Inspect,
}

/// Diagnostic display of how a picture was made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Inspect {
    /// Only failed bricks.
    #[default]
    Nothing,
    /// Outlines of bricks in memory, coloured by level.
    Bricks,
    /// Replaces the converged picture by the error map, as `render --error-map` writes it.
    Errors,
    /// Replaces the converged picture by the work map, as `render --work-map` writes it. Pictures then take several
    /// times as long.
    Work,
}

/// Presence of panels beside the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SidePanels {
    /// Only the picture.
    #[default]
    Hidden,
    /// Panels with sections.
    Shown,
}

/// Presence of decorations around the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum Decorations {
    /// No decorations.
    #[default]
    Off,
    /// Decorations as `render --decorate` draws them.
    On,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            host_memory_bytes: 512 << 20,
            max_error: 0.5 / 255.0,
            interaction_ms: 33,
            // Only the CPU reports the error of each pixel.
            backend: Backend::Cpu,
            threads: None,
            decorations: Decorations::Off,
            side_panels: SidePanels::Hidden,
            inspect: Inspect::Nothing,
        }
    }
}

/// A request to open a volume.
#[derive(Debug, Clone)]
pub struct Open {
    /// Path of a container, or of a source file, for which a container is built in the cache folder.
    pub path: PathBuf,
    /// Options for a source file that does not describe itself.
    pub reading: Reading,
    /// Vertical exaggeration: factor of heights or depths.
    pub exaggeration: f64,
    /// Scene; missing keys get defaults that suit the data.
    pub scene: Scene,
}

/// A request to draw a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// Number of the request, ascending.
    pub number: u64,
    /// Number of the volume: [`OpenVolume::number`].
    pub volume: u64,
    /// Scene, with the size of the picture.
    pub scene: Scene,
}

/// A picture to export.
#[derive(Debug, Clone, PartialEq)]
pub struct Export {
    /// The scene, with the size of the picture.
    pub scene: Scene,
    /// Path; its extension gives the format: PNG, EXR or npy.
    pub path: PathBuf,
    /// Whether an existing picture may be replaced.
    pub existing: Existing,
}

/// Motion of the camera.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// A full turn around the target, in this number of pictures.
    Turntable(u32),
    /// Interpolation between key frames.
    Path(CameraPath),
}

/// An animation to write.
#[derive(Debug, Clone, PartialEq)]
pub struct Animation {
    /// The scene, with the size of the pictures. Its camera is the first one of a turntable.
    pub scene: Scene,
    /// Motion of the camera.
    pub motion: Motion,
    /// Folder for the pictures.
    pub folder: PathBuf,
    /// File format of the pictures.
    pub format: ImageFormat,
    /// Whether pictures of another animation are replaced.
    pub existing: Existing,
}

/// An open volume. Its content is shared by reference counts.
#[derive(Debug)]
pub struct OpenVolume {
    /// Number of the volume, ascending.
    pub number: u64,
    /// Path of the opened file.
    pub source: PathBuf,
    /// Options with which a source file was read.
    pub reading: Reading,
    /// Path of the container: the opened file, or a file in the cache folder. Empty for a preview.
    pub path: PathBuf,
    /// Only for a preview, which is shown while the container is built: distance of its voxels along each axis, in
    /// voxels of the volume.
    pub preview_of: Option<[u64; 3]>,
    /// The volume that is drawn.
    pub volume: Volume,
    /// The same at the place where it is drawn.
    pub placed: PlacedVolume,
    /// Line numbers and times or depths of a survey.
    pub survey: Option<Survey>,
    /// Coordinates of the volume's places.
    pub coordinates: Coordinates,
    /// Vertical exaggeration: factor of heights or depths.
    pub exaggeration: f64,
    /// The scene of the request with all defaults filled in.
    pub scene: Scene,
    /// Whether the request contained a camera.
    pub has_requested_camera: bool,
}

impl OpenVolume {
    /// The container, with the geometry that is drawn.
    #[must_use]
    pub fn container(&self) -> &Arc<Container> {
        self.placed.container()
    }

    /// Facts of the volume at the place where it is drawn.
    #[must_use]
    pub fn facts(&self) -> &VolumeFacts {
        self.placed.facts()
    }

    /// Overview from a coarse level, if one is small enough. It was read when the volume was opened.
    #[must_use]
    pub fn overview(&self) -> Option<&Overview> {
        self.placed.overview()
    }

    /// The vertical exaggeration as scenes of this volume name it.
    #[must_use]
    pub fn scene_exaggeration(&self) -> Option<f64> {
        self.scene.vertical_exaggeration
    }
}

/// A drawn picture.
#[derive(Debug)]
pub struct Frame {
    /// Number of the volume.
    pub volume: u64,
    /// Number of the request.
    pub number: u64,
    /// 8-bit RGB, background added.
    pub image: Arc<ColorImage>,
    /// Statistics of the picture.
    pub stats: FrameStats,
    /// Whether the picture is final.
    pub is_converged: bool,
    /// Wall time of drawing it so far, in milliseconds.
    pub spent_ms: f64,
    /// Bricks to outline in it.
    pub marks: Vec<Mark>,
}

/// A request for the value under a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Probe {
    /// Number of the request, ascending.
    pub number: u64,
    /// Number of the volume.
    pub volume: u64,
    /// Panel; `None`: the picture.
    pub panel: Option<usize>,
    /// Number of the request of the picture that has the pixel. Other pictures give no answer.
    pub picture: u64,
    /// Pixel (x, y), from the upper left.
    pub pixel: [u32; 2],
}

/// The answer to a [`Probe`]: a point, nothing, or an error.
#[derive(Debug, Clone, PartialEq)]
pub struct ProbeAnswer {
    /// The request.
    pub probe: Probe,
    /// The point under the pixel, `None` if there is nothing, or the error.
    pub found: Result<Option<Picked>, String>,
}

/// Bricks that were read for the next picture after the present one had converged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LookedAhead {
    /// Number of the request of the present picture.
    pub number: u64,
    /// Number of bricks read.
    pub page_ins: u64,
    /// Whether all predicted bricks are in memory.
    pub is_complete: bool,
}

/// A long-running task and its progress.
#[derive(Debug, Clone, PartialEq)]
pub enum Busy {
    /// Opening a file.
    Opening(PathBuf),
    /// Building a container from a file.
    Building(PathBuf, BuildProgress),
    /// Reading a mesh file that the scene refers to.
    Reading(PathBuf),
    /// Exporting a picture: finished rows and all rows.
    Exporting(PathBuf, [u32; 2]),
    /// Writing an animation to a folder: finished pictures and all pictures.
    Animating(PathBuf, [usize; 2]),
}

/// A failure or a success to report to the user.
#[derive(Debug, Clone, PartialEq)]
pub enum Message {
    /// A failure, in words, with advice.
    Failure(String),
    /// A success, in words.
    Done(String),
}

/// A file that cannot be read without options.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused {
    /// Path of the file.
    pub source: PathBuf,
    /// Reason, in words.
    pub why: String,
    /// Volumes of the file, if it holds several.
    pub choices: Vec<Part>,
}

/// Pending messages of the worker. [`super::Worker::messages`] takes them all and leaves only `busy`.
#[derive(Debug, Default)]
pub struct Messages {
    /// A volume has been opened.
    pub opened: Option<Arc<OpenVolume>>,
    /// A picture has been drawn.
    pub frame: Option<Frame>,
    /// Pictures of the panels.
    pub sections: [Option<Frame>; PANELS],
    /// Answer to the last probe.
    pub probed: Option<ProbeAnswer>,
    /// Bricks read for the next picture.
    pub ahead: Option<LookedAhead>,
    /// The running task.
    pub busy: Option<Busy>,
    /// A success or a failure.
    pub message: Option<Message>,
    /// A file that needs options.
    pub refused: Option<Box<Refused>>,
}

/// A brick to outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Level of detail.
    pub level: u8,
    /// Least and greatest corner, index coordinates of level 0.
    pub corners: [[f64; 3]; 2],
    /// Whether the brick could not be read.
    pub is_failed: bool,
}

/// A picture for the window, with its background; `began` is the time at which drawing began. A picture with failed
/// bricks may be final without having converged in the sense of the statistics.
pub(super) fn frame_of(
    view: &View,
    (picture, background): (&Image, [f64; 3]),
    (stats, is_converged): (FrameStats, bool),
    began: Instant,
) -> Frame {
    let size = [picture.width, picture.height].map(|n| n as usize);
    Frame {
        volume: view.volume,
        number: view.number,
        image: Arc::new(ColorImage::from_rgb(size, &picture.to_rgb8(background))),
        stats,
        is_converged,
        marks: Vec::new(),
        spent_ms: began.elapsed().as_secs_f64() * 1e3,
    }
}

/// The answer to a probe; `None` if it was interrupted by another request.
pub(super) fn picked(found: Result<Option<Picked>, Error>) -> Option<Result<Option<Picked>, String>> {
    match found {
        Err(error) if error.kind() == ErrorKind::Cancelled => None,
        found => Some(found.map_err(|e| e.to_string())),
    }
}
