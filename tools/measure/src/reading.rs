//! Reading cost by requested error: time, bricks and bytes of a converged frame.
//!
//! One volume is virtual: its voxels are computed on each read, so it may be of any size. The frames use 1 GiB of
//! memory. A second volume fits into memory. The requested error is `--max-error`. It selects brick levels by their
//! stored bounds (docs/decisions/005-levels-by-error.md).

use serde::Serialize;
use supervol_runtime::render::options::Backend;
use supervol_scene::image::GREY_LEVELS;

use crate::context::{ChartError, Context, Scale};
use crate::paths::{CameraPath, FrameCost, Options, Ride, built_in, run};
use crate::peers::cases::{Looks, Subject};
use crate::virtual_volume::Field;

/// Requested errors, grey levels of 255, greatest first. The first one never needs bricks finer than a pixel.
const ERRORS: [f64; 5] = [GREY_LEVELS, 16.0, 8.0, 4.0, 2.0];
/// Voxels along an edge of the virtual volume: 16-bit waves, 1 TiB.
const EDGE: u64 = 8192;
/// Voxels along an edge of the survey, which fits into memory.
const SMALL_EDGE: u64 = 256;
/// Frames along the path.
const FRAMES: usize = 2;
/// Memory limit of a frame, bytes.
pub const HOST_MEMORY_BYTES: u64 = 1 << 30;
/// Threads for casting and decoding.
const THREADS: usize = 2;

/// Frames of one volume at one requested error.
#[derive(Debug, Clone, Serialize)]
pub struct Read {
    /// Name of the volume.
    pub scene: String,
    /// Voxels along x, y, z.
    pub dims: [u64; 3],
    /// Requested error, grey levels of 255.
    pub max_error: f64,
    /// Wall time of the first frame, from an empty cache, milliseconds.
    pub first_ms: f64,
    /// Wall time of the last frame, milliseconds.
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

/// Every volume at every requested error, for the report.
///
/// # Errors
/// If a volume cannot be made, or a frame cannot be drawn.
#[expect(clippy::missing_panics_doc, reason = "the camera path comes with the program")]
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

/// First and last frame of a ride; `None` for fewer than two frames.
fn read(name: &str, ride: &Ride, max_error: f64) -> Option<Read> {
    let [first, .., last] = &ride.frames[..] else { return None };
    let &FrameCost { ms: first_ms, cpu_ms, page_ins: bricks, bytes_read: bytes, .. } = first;
    let &FrameCost { ms: last_ms, page_ins: later_bricks, .. } = last;
    let (scene, dims) = (name.into(), ride.dims);
    Some(Read { scene, dims, max_error, first_ms, last_ms, cpu_ms, bricks, later_bricks, bytes })
}
