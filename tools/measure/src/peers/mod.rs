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
pub mod options;
pub mod ours;
pub mod pixels;
pub mod report;
pub mod results;
pub mod vtk;

use self::cases::{Case, Looks, Subject, planned};
use self::options::{PeerOptions, Run, SameSampling};
use self::ours::Sampler;
use self::pixels::ExactPixels;
use self::results::{Comparison, Drawn, Row};
use self::vtk::Peer;
use crate::context::{ChartError, Context};

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
