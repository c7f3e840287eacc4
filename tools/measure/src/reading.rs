//! What a renderer reads for the error that is asked for: time, bricks and bytes of a converged frame.
//!
//! A volume of which nothing is stored is computed when it is read, as large as one likes, in 1 GiB of memory; beside it stands one that
//! fits. What is asked for is `--max-error`, which chooses levels of bricks by their stored bounds (docs/decisions/005-levels-by-error.md).

use serde::Serialize;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::GREY_LEVELS;

use crate::context::{ChartError, Context, Scale};
use crate::paths::{CameraPath, FrameCost, Options, Ride, built_in, run};
use crate::peers::cases::{Looks, Subject};
use crate::virtual_volume::Field;

/// Errors that are asked for, grey levels of 255, the greatest first. By the first of them no brick is finer than pixels ask for.
const ERRORS: [f64; 5] = [GREY_LEVELS, 16.0, 8.0, 4.0, 2.0];
/// Voxels along an edge of the volume of which nothing is stored: waves of 16 bits, a tebibyte.
const EDGE: u64 = 8192;
/// The same of the survey beside it, which fits.
const SMALL_EDGE: u64 = 256;
/// Frames along the path.
const FRAMES: usize = 2;
/// Memory that frames may use.
pub const HOST_MEMORY_BYTES: u64 = 1 << 30;
/// Threads that cast and decode.
const THREADS: usize = 2;

/// Frames of one volume by one error that is asked for.
#[derive(Debug, Clone, Serialize)]
pub struct Read {
    /// Name of the volume.
    pub scene: String,
    /// Voxels along x, y, z.
    pub dims: [u64; 3],
    /// Error that is asked for, grey levels of 255.
    pub max_error: f64,
    /// Wall time of the first frame, from an empty cache, milliseconds.
    pub first_ms: f64,
    /// The same of the last frame.
    pub last_ms: f64,
    /// Processor time of the first frame, milliseconds.
    pub cpu_ms: f64,
    /// Bricks that the first frame read.
    pub bricks: u64,
    /// Bricks that the last frame read.
    pub later_bricks: u64,
    /// Bytes that the first frame read.
    pub bytes: u64,
}

/// Each volume by each error, for the report.
///
/// # Errors
/// If a volume cannot be made, or a frame cannot be drawn.
pub fn for_report(context: &Context<'_>) -> Result<Vec<Read>, ChartError> {
    let (edges, image, errors) = match context.scale {
        Scale::Full => ([EDGE, SMALL_EDGE], [200, 150], &ERRORS[..]),
        Scale::Small => ([128, 48], [24, 18], &ERRORS[3..]),
    };
    let subjects =
        [("waves", Subject::Virtual(Field::Waves, edges[0])), ("seismic", Subject::Scenes(vec!["seismic".into()]))];
    let orbit = built_in("orbit").expect("it comes with the program")?;
    let path = CameraPath { frames: orbit.frames[..FRAMES].to_vec(), ..orbit };
    let mut all = Vec::new();
    for (name, subject) in subjects {
        for &max_error in errors {
            let options = Options {
                subject: subject.clone(),
                looks: Looks::Unshaded,
                edge: Some(edges[1]),
                carp_nifti_gz: &[],
                threads: THREADS,
                image,
                host_memory_bytes: HOST_MEMORY_BYTES,
                cache_bytes: None,
                frame_budget_ms: None,
                ahead_ms: None,
                max_error: max_error / GREY_LEVELS,
                backends: vec![Backend::Cpu],
            };
            all.extend(run(context, &path, &options)?.iter().filter_map(|ride| read(name, ride, max_error)));
        }
    }
    Ok(all)
}

/// What a ride read; none of one without frames.
fn read(name: &str, ride: &Ride, max_error: f64) -> Option<Read> {
    let [first, .., last] = &ride.frames[..] else { return None };
    let &FrameCost { ms: first_ms, cpu_ms, page_ins: bricks, bytes_read: bytes, .. } = first;
    let &FrameCost { ms: last_ms, page_ins: later_bricks, .. } = last;
    let (scene, dims) = (name.into(), ride.dims);
    Some(Read { scene, dims, max_error, first_ms, last_ms, cpu_ms, bricks, later_bricks, bytes })
}
