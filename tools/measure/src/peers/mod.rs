//! The same pictures by other programs: `supervol bench --peers`.
//!
//! ```text
//! cases: volume, camera, transfer function, shading
//!   |-> ours:   Supervol's CPU backend, warm, its default method (and the peer's own way of sampling, if asked for)
//!   |-> vtk:    VTK's CPU ray caster, in a process of its own, from a private Python environment
//!   |-> pixels: some pixels of the picture by the reference integrator
//!   `-> rows:   cost, distance of each picture from the reference, ratio of costs
//! ```
//!
//! Both programs read the same voxels, use the same camera and draw the same domain. They cast one ray per pixel with
//! the same number of threads. VTK's volume ends at the centres of its outermost voxels, Supervol's half a voxel
//! further out, so Supervol's is clipped. The programs run alternately, case by case, so that a busy machine slows
//! both.
//!
//! Costs are processor time of all threads. Pictures are compared as gathered along the rays: colour and opacity before
//! the background, not rounded to 8 bits. Errors belong to the timed pictures and are measured at random pixels.
//!
//! If a peer cannot be measured (no Python, no network, no display library), the report gives the reason and the rest
//! of the comparison continues.

pub mod cases;
pub mod environment;
pub mod ours;
pub mod pixels;
pub mod report;
pub mod vtk;

use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;
use supervol_scene::image::Image;

use crate::context::{ChartError, Context, Scale};
pub use crate::measure::Spread;
use crate::volume::HOST_MEMORY_BYTES;
use cases::{Case, Looks, Subject, planned};
use ours::Sampler;
use pixels::ExactPixels;
use vtk::Peer;

/// Options of a comparison.
#[derive(Debug, Clone)]
pub struct Options {
    /// The peer programs; `None`: only Supervol is measured.
    pub peer: Option<PeerOptions>,
    /// Gzipped NIfTI file of the real volume among the scenes (a carp).
    pub carp_nifti_gz: &'static [u8],
    /// Volumes to draw.
    pub subject: Subject,
    /// Looks of each scene.
    pub looks: Looks,
    /// Voxels along an edge of the synthetic volumes; `None`: the default of each volume.
    pub edge: Option<u64>,
    /// Options of the measurement.
    pub run: Run,
}

/// Options of the measurement.
#[derive(Debug, Clone)]
pub struct Run {
    /// Threads of each program; at least 1.
    pub threads: usize,
    /// Whether Supervol also samples like the peer.
    pub same_sampling: SameSampling,
    /// Sizes and repeats.
    pub sizes: Sizes,
}

/// Whether Supervol also draws each picture with the peer's sampling: samples at equal distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SameSampling {
    /// Supervol's default only.
    #[default]
    No,
    /// Supervol's default, and the peer's sampling.
    Yes,
}

/// Python and environment of the peer.
#[derive(Debug, Clone)]
pub struct PeerOptions {
    /// Python that makes the environment.
    pub python: PathBuf,
    /// Folder of the environment; created if needed.
    pub environment: PathBuf,
}

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
    pub versions: Option<vtk::Versions>,
}

/// Sizes of a run.
#[derive(Debug, Clone)]
pub struct Sizes {
    /// Number of timed pictures per row, after the first; at least 1.
    pub repeats: usize,
    /// Time limit after which no further picture of a row is timed.
    pub row_limit: Duration,
    /// Width and height of the pictures, pixels.
    pub image: [u32; 2],
    /// Number of pixels that are compared with the reference.
    pub error_pixels: usize,
    /// Steps of the peer, in smallest voxel spacings.
    pub steps_voxels: Vec<f64>,
    /// Memory limit of Supervol's pictures, bytes.
    pub host_memory_bytes: u64,
}

impl Sizes {
    /// Sizes of a scale.
    #[must_use]
    pub fn of(scale: Scale) -> Self {
        let (repeats, image, error_pixels) = match scale {
            Scale::Full => (5, [1024, 768], 1000),
            Scale::Small => (3, [160, 120], 300),
        };
        Self {
            repeats,
            row_limit: Duration::from_secs(60),
            image,
            error_pixels,
            steps_voxels: vec![1.0],
            host_memory_bytes: HOST_MEMORY_BYTES,
        }
    }
}

/// Runs the comparison.
///
/// # Errors
/// If Supervol's own part fails. A failing peer is only reported.
pub fn compare(context: &Context<'_>, options: &Options) -> Result<Comparison, ChartError> {
    let plans = planned(context, &options.subject, options.edge)?;
    let mut peer = options.peer.as_ref().map(|found| Peer::prepare(found, context.say));
    let (mut rows, mut pictures) = (Vec::new(), Vec::new());
    for plan in plans {
        let built = plan.build(context, options.looks, options.carp_nifti_gz)?;
        for case in built.cases() {
            let drawn = draw(context, &case, peer.as_mut(), &options.run)?;
            let sizes = &options.run.sizes;
            let exact = ExactPixels::new(&case, &case.scene(sizes.image)?, sizes.error_pixels, context.say)?;
            let added = rows_of(&case, &drawn, exact.as_ref());
            (context.say)(&summary(&added));
            rows.extend(added);
            pictures.extend(drawn.into_iter().map(|d| (d.file_name(&case), d.picture)));
        }
    }
    Ok(Comparison {
        date: report::today(),
        supervol: env!("CARGO_PKG_VERSION"),
        machine: report::machine(),
        threads: options.run.threads,
        image_size: options.run.sizes.image,
        peer: peer.map(Peer::into_report),
        rows,
        pictures,
    })
}

/// Pictures of one case by all programs, Supervol's default first.
fn draw(context: &Context<'_>, case: &Case<'_>, peer: Option<&mut Peer>, run: &Run) -> Result<Vec<Drawn>, ChartError> {
    (context.say)(&format!("{}, {}", case.built.name, case.look));
    let steps: &[f64] = match run.same_sampling {
        SameSampling::No => &[],
        SameSampling::Yes => &run.sizes.steps_voxels,
    };
    let mut drawn = Vec::new();
    for sampler in Sampler::all(steps) {
        drawn.push(ours::draw(context, case, sampler, run)?);
    }
    if let Some(peer) = peer {
        drawn.extend(peer.draw(context, case, run)?);
    }
    Ok(drawn)
}

/// Results of a case in one line.
fn summary(rows: &[Row]) -> String {
    let one = |row: &Row| {
        let error = row.from_reference.map_or(String::new(), |e| format!(", error {:.2}", e.linf));
        format!("{} {:.0} CPU-ms{error}", row.program, row.cost.cpu.median_ms)
    };
    format!("  {}", rows.iter().map(one).collect::<Vec<_>>().join("; "))
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
    fn file_name(&self, case: &Case<'_>) -> String {
        let step = self.step_voxels.map_or("default".into(), |step| format!("step-{step}"));
        format!("{}-{}-{step}.png", case.name(), self.program.to_lowercase())
    }
}

/// Name of the sampling of a row with equal distances.
fn sampling_name(step_voxels: f64) -> String {
    format!("a sample every {step_voxels} voxel")
}

/// The rows of one case; the first picture is Supervol's default.
fn rows_of(case: &Case<'_>, drawn: &[Drawn], exact: Option<&ExactPixels>) -> Vec<Row> {
    let default = &drawn[0];
    let cpu = |d: &Drawn| d.cost.cpu.median_ms;
    let same_sampling = |row: &Drawn| {
        let is_same =
            |d: &&Drawn| d.program == ours::NAME && d.step_voxels.is_some() && d.step_voxels == row.step_voxels;
        drawn.iter().find(is_same).map(|d| cpu(row) / cpu(d))
    };
    drawn
        .iter()
        .map(|d| Row {
            scene: case.built.name.clone(),
            dims: case.built.dims().0,
            shading: case.look,
            program: d.program,
            sampling: d.sampling.clone(),
            cost: d.cost,
            ratio_to_default: cpu(d) / cpu(default),
            ratio_to_same_sampling: same_sampling(d),
            from_reference: exact.map(|exact| exact.distance(&d.picture)),
            error_pixels: exact.map_or(0, ExactPixels::count),
            reference_capped_pieces: exact.map_or(0, |exact| exact.capped_pieces),
            from_default: pixels::levels(d.picture.pixels.as_flattened(), default.picture.pixels.as_flattened()),
        })
        .collect()
}

#[cfg(test)]
mod tests;
