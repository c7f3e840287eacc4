//! The same pictures by other programs: `supervol bench --peers`.
//!
//! ```text
//! cases: volume, camera, transfer function, shading
//!   |-> ours:  Supervol's CPU backend, warm, its default method (and the peer's own way of sampling)
//!   |-> vtk:   VTK's CPU ray caster, in a process of its own, from a private Python environment
//!   `-> rows:  cost, distance of each picture from the reference, ratio of costs
//! ```
//!
//! Both programs read the same bytes, look from the same place, cast one ray per pixel with the same number of threads and
//! draw the same domain: VTK's volume ends at the centres of its outermost voxels, ours half a voxel further out, so that
//! ours is clipped to theirs. They run one after the other, case by case, so that a busy machine is busy for both.
//! Costs are processor time of all threads; pictures are compared as the rays gathered them, over black, before they are
//! rounded to 8 bits.
//!
//! A peer that cannot be measured (no Python, no network, no display library) is reported with the reason; the rest goes on.

pub mod cases;
pub mod environment;
pub mod ours;
pub mod report;
pub mod vtk;

use std::path::PathBuf;

use serde::Serialize;
use supervol_runtime::image::Image;

use crate::context::{ChartError, Context};
pub use crate::measure::Spread;
use crate::measure::{GREY_LEVELS, distance_of};
use cases::Case;
use ours::Sampler;
use vtk::Peer;

/// What is compared, with whom.
#[derive(Debug, Clone)]
pub struct Options {
    /// Whether other programs are measured, and how they are found.
    pub peer: Option<PeerOptions>,
    /// Threads of either program; at least 1.
    pub threads: usize,
    /// A gzipped NIfTI file of the real volume among the cases (a carp).
    pub carp_nifti_gz: &'static [u8],
    /// Only cases of these names; empty: all.
    pub only: Vec<String>,
}

/// How the peer is found.
#[derive(Debug, Clone)]
pub struct PeerOptions {
    /// The Python that makes the environment.
    pub python: PathBuf,
    /// Folder of the environment; made where it is not there.
    pub environment: PathBuf,
}

/// Cost of one picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Cost {
    /// Processor time of all threads.
    pub cpu: Spread,
    /// Wall time.
    pub wall: Spread,
    /// Processor time of the first picture: caches, tables and gradients that later pictures share are made in it.
    pub first_cpu_ms: f64,
    /// Processor time of the ray casting alone, where it can be told apart: without handing the picture out.
    pub cast_cpu: Option<Spread>,
}

/// How far a picture over black is from another, in grey levels of 255.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Levels {
    /// Greatest difference of any channel of any pixel.
    pub linf: f64,
    /// Root of the mean square.
    pub rmse: f64,
    /// Mean signed difference.
    pub bias: f64,
}

/// One program's picture of one case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// Name of the case.
    pub scene: &'static str,
    /// `unshaded` or `shaded`.
    pub shading: &'static str,
    /// `Supervol` or the peer.
    pub program: &'static str,
    /// How the program samples.
    pub sampling: String,
    /// Cost.
    pub cost: Cost,
    /// Processor time over that of Supervol's default in the same case: above 1, Supervol's default is faster.
    pub ratio_to_default: f64,
    /// Processor time over that of Supervol when it samples as this row does; null where it was not made to.
    pub ratio_to_same_sampling: Option<f64>,
    /// Distance from the reference.
    pub from_reference: Levels,
    /// Distance from Supervol's default.
    pub from_default: Levels,
}

/// Everything that was measured.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// Day of the run, UTC, year-month-day.
    pub date: String,
    /// Version of Supervol.
    pub supervol: &'static str,
    /// Processor, its number of logical cores, operating system.
    pub machine: String,
    /// Threads of either program.
    pub threads: usize,
    /// Pictures whose cost is measured, per row, after the first.
    pub repeats: usize,
    /// Pixels of the pictures whose cost is measured.
    pub image_size: [u32; 2],
    /// Pixels of the pictures whose error is measured.
    pub error_image_size: [u32; 2],
    /// The peer: what it is, or why it was not measured; null where nobody asked.
    pub peer: Option<PeerReport>,
    /// One row for each picture.
    pub rows: Vec<Row>,
    /// The timed pictures, by the name of their file.
    #[serde(skip)]
    pub pictures: Vec<(String, Image)>,
}

/// What is known of a peer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PeerReport {
    /// Name.
    pub name: &'static str,
    /// Whether every case was measured.
    pub measured: bool,
    /// Why not, in one sentence; null where it was.
    pub why_not: Option<String>,
    /// Versions of the peer and of what it stands on.
    pub versions: Option<vtk::Versions>,
}

/// Sizes of a run.
#[derive(Debug, Clone, Copy)]
pub struct Sizes {
    /// Timed pictures per row.
    pub repeats: usize,
    /// Pixels of timed pictures.
    pub image: [u32; 2],
    /// Pixels of pictures compared with the reference, which is slow.
    pub error_image: [u32; 2],
    /// Step lengths of the peer, in smallest spacings.
    pub steps_voxels: &'static [f64],
}

/// The sizes that a context asks for.
#[must_use]
pub fn sizes(context: &Context<'_>) -> Sizes {
    Sizes {
        repeats: context.pick(5, 3),
        image: context.pick([320, 240], [160, 120]),
        error_image: context.pick([128, 96], [40, 30]),
        steps_voxels: &[1.0, 0.5],
    }
}

/// Runs the comparison.
///
/// # Errors
/// If Supervol's own side fails. A peer that fails is part of the answer.
pub fn compare(context: &Context<'_>, options: &Options) -> Result<Comparison, ChartError> {
    let sizes = sizes(context);
    let mut peer = options.peer.as_ref().map(|found| Peer::prepare(found, context.say));
    let mut rows = Vec::new();
    let mut pictures = Vec::new();
    for recipe in cases::recipes(context, &options.only)? {
        let volume = recipe.build(context, options.carp_nifti_gz)?;
        for case in recipe.cases(&volume) {
            (context.say)(&format!("{}, {}", case.name, case.shading_name()));
            let mut drawn = draw_ours(&case, sizes, options.threads)?;
            if let Some(peer) = &mut peer {
                drawn.extend(peer.draw(context, &case, sizes, options.threads)?);
            }
            let reference = case.reference(sizes.error_image)?;
            rows.extend(rows_of(&case, &drawn, &reference));
            pictures.extend(drawn.into_iter().map(|d| (d.file_name(&case), d.picture)));
        }
    }
    Ok(Comparison {
        date: report::today(),
        supervol: env!("CARGO_PKG_VERSION"),
        machine: report::machine(),
        threads: options.threads,
        repeats: sizes.repeats,
        image_size: sizes.image,
        error_image_size: sizes.error_image,
        peer: peer.map(Peer::into_report),
        rows,
        pictures,
    })
}

/// One program's pictures of a case, and their cost.
pub struct Drawn {
    /// Which program.
    pub program: &'static str,
    /// How it samples.
    pub sampling: String,
    /// Its step in smallest spacings, if it has one.
    pub step_voxels: Option<f64>,
    /// Cost of the large picture.
    pub cost: Cost,
    /// The large picture.
    pub picture: Image,
    /// The small picture.
    pub error_picture: Image,
}

impl Drawn {
    fn file_name(&self, case: &Case<'_>) -> String {
        let step = self.step_voxels.map_or("default".into(), |step| format!("step-{step}"));
        format!("{}-{}-{}-{step}.png", case.name, case.shading_name(), self.program.to_lowercase())
    }
}

/// How a row is called that samples at equal distances.
fn sampling_name(step_voxels: f64) -> String {
    format!("a sample every {step_voxels} voxel")
}

/// Supervol's default first, then its rows that sample as the peer does.
fn draw_ours(case: &Case<'_>, sizes: Sizes, threads: usize) -> Result<Vec<Drawn>, ChartError> {
    Sampler::all(sizes.steps_voxels).into_iter().map(|sampler| ours::draw(case, sampler, sizes, threads)).collect()
}

/// The rows of one case; the first picture is Supervol's default.
fn rows_of(case: &Case<'_>, drawn: &[Drawn], reference: &Image) -> Vec<Row> {
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
            scene: case.name,
            shading: case.shading_name(),
            program: d.program,
            sampling: d.sampling.clone(),
            cost: d.cost,
            ratio_to_default: cpu(d) / cpu(default),
            ratio_to_same_sampling: same_sampling(d),
            from_reference: levels(&d.error_picture, reference),
            from_default: levels(&d.error_picture, &default.error_picture),
        })
        .collect()
}

/// The channels over black, not rounded.
fn over_black(picture: &Image) -> Vec<f32> {
    picture.pixels.iter().flat_map(|p| [p[0], p[1], p[2]]).collect()
}

fn levels(picture: &Image, exact: &Image) -> Levels {
    let d = distance_of(&over_black(picture), &over_black(exact));
    Levels { linf: GREY_LEVELS * d.linf, rmse: GREY_LEVELS * d.rmse, bias: GREY_LEVELS * d.bias }
}

#[cfg(test)]
mod tests;
