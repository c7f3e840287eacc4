//! Results of a comparison: pictures, costs, distances and rows.

use serde::Serialize;
use supervol_scene::image::Image;

use super::cases::Case;
use crate::measure::Spread;

/// Cost of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Number of timed pictures, without the first.
    pub repeats: usize,
    /// Processor time of all threads.
    pub cpu: Spread,
    /// Wall time.
    pub wall: Spread,
    /// Processor time of the first picture, ms: it also makes caches, tables and gradients that later pictures reuse.
    pub first_cpu_ms: f64,
    /// Processor time of the ray casting alone, without reading the picture back; null if it cannot be separated.
    pub cast_cpu: Option<Spread>,
}

/// Distance between two pictures over four channels before the background, grey levels of 255.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Levels {
    /// Greatest difference of any channel of any pixel.
    pub linf: f64,
    /// 99.9th percentile of the differences of all channels of all pixels.
    pub p999: f64,
    /// Root mean square difference.
    pub rmse: f64,
    /// Mean signed difference.
    pub bias: f64,
}

/// One program's picture of one case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the scene or of the file.
    pub scene: String,
    /// Voxels along x, y, z.
    pub dims: [u64; 3],
    /// `unshaded`, `shaded`, or `default` for the user's own volume.
    pub shading: &'static str,
    /// `Supervol` or the peer.
    pub program: &'static str,
    /// Sampling of the program.
    pub sampling: String,
    /// Cost of the picture.
    pub cost: Cost,
    /// Processor time divided by that of Supervol's default in the same case; above 1, Supervol's default is faster.
    pub ratio_to_default: f64,
    /// Processor time divided by that of Supervol with the same sampling; null if that was not measured.
    pub ratio_to_same_sampling: Option<f64>,
    /// Distance from the reference, at [`Self::error_pixels`] pixels; null if the volume is too large.
    pub from_reference: Option<Levels>,
    /// Number of pixels at which this distance was measured.
    pub error_pixels: usize,
    /// Intervals on the rays of these pixels at which the reference did not converge.
    pub reference_capped_pieces: u64,
    /// Distance from Supervol's default, at all pixels.
    pub from_default: Levels,
}

/// Results of a comparison.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Day of the run, UTC, year-month-day.
    pub date: String,
    /// Version of Supervol.
    pub supervol: &'static str,
    /// Processor, its number of logical cores, operating system.
    pub machine: String,
    /// Threads of each program.
    pub threads: usize,
    /// Width and height of the pictures, pixels.
    pub image_size: [u32; 2],
    /// The peer, or the reason why it was not measured; null if it was not requested.
    pub peer: Option<PeerReport>,
    /// One row per picture.
    pub rows: Vec<Row>,
    /// The timed pictures with their file names.
    #[serde(skip)]
    pub pictures: Vec<(String, Image)>,
}

/// Report about a peer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PeerReport {
    /// Name.
    pub name: &'static str,
    /// Whether every case was measured.
    pub measured: bool,
    /// Reason why a case was not measured, one sentence; null if all were measured.
    pub why_not: Option<String>,
    /// Versions of the peer and of its libraries.
    pub versions: Option<Versions>,
}

/// Versions of the programs and libraries behind the pictures.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Versions {
    /// VTK.
    pub vtk: String,
    /// Python.
    pub python: String,
    /// NumPy.
    pub numpy: String,
    /// Class of VTK's render window.
    pub window: String,
}

/// Picture of one program and one case, with its cost.
#[derive(Debug)]
pub struct Drawn {
    /// The program.
    pub program: &'static str,
    /// Its sampling.
    pub sampling: String,
    /// Its step in smallest voxel spacings; `None` without a step.
    pub step_voxels: Option<f64>,
    /// Cost of the picture.
    pub cost: Cost,
    /// The picture.
    pub picture: Image,
}

impl Drawn {
    /// Name of the picture's file.
    #[must_use]
    pub fn file_name(&self, case: &Case<'_>) -> String {
        let step = self.step_voxels.map_or("default".into(), |step| format!("step-{step}"));
        format!("{}-{}-{step}.png", case.name(), self.program.to_lowercase())
    }
}

/// Name of the sampling of a row with equal distances.
#[must_use]
pub fn sampling_name(step_voxels: f64) -> String {
    format!("a sample every {step_voxels} voxel")
}
