//! Measures the read speed of volume files. Opens a file and reads every voxel, once in file order and once in boxes of
//! brick size. Prints MB of voxels per second of processor time, which other programs disturb less than wall time. Each
//! number is the best of [`ROUNDS`].
//!     cargo run --release -p supervol-sources --example read_speed -- FILE...

#![allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    clippy::cast_sign_loss,
    reason = "it measures small numbers"
)]

use std::io::Write;
use std::path::Path;

use rustix::time::{ClockId, clock_gettime};
use supervol_format::VoxelBox;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceInfo, VolumeSource};

/// Voxels of a box in file order, and edge of a box of brick size in voxels.
const BOX_VOXELS: u64 = 1 << 22;
const EDGE: u64 = 64;

const ROUNDS: usize = 3;

fn cpu_seconds() -> f64 {
    let now = clock_gettime(ClockId::ProcessCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// Opens a file and reads these boxes; returns MB of voxels per second.
fn speed<B: Iterator<Item = VoxelBox>>(
    path: &Path,
    cut: impl Fn(&SourceInfo) -> B,
) -> Result<(String, f64), Box<dyn std::error::Error>> {
    let begun = cpu_seconds();
    let source: Box<dyn VolumeSource> = open(path, &OpenOptions::default())?;
    let info = source.info();
    let mut bytes = 0;
    for part in cut(info) {
        let mut out = vec![0; part.voxels() * info.voxel_type.bytes()];
        source.read_box(part, &mut out)?;
        bytes += out.len();
    }
    Ok((format!("{} {}", info.dims, info.voxel_type), bytes as f64 / 1e6 / (cpu_seconds() - begun)))
}

/// Groups of whole slices across the slowest axis of the file.
fn slices(info: &SourceInfo) -> impl Iterator<Item = VoxelBox> + use<> {
    let (whole, axis) = (info.dims.full_box(), info.access_order.0[0]);
    let slice = whole.voxels() as u64 / whole.end[axis];
    let step = (BOX_VOXELS / slice).max(1);
    (0..whole.end[axis]).step_by(step as usize).map(move |at| {
        let mut part = whole;
        (part.start[axis], part.end[axis]) = (at, (at + step).min(whole.end[axis]));
        part
    })
}

fn bricks(info: &SourceInfo) -> impl Iterator<Item = VoxelBox> + use<> {
    let whole = info.dims.full_box();
    let starts = move |axis: usize| (whole.start[axis]..whole.end[axis]).step_by(EDGE as usize);
    starts(2).flat_map(move |z| {
        starts(1).flat_map(move |y| {
            starts(0).map(move |x| {
                let start = [x, y, z];
                VoxelBox { start, end: std::array::from_fn(|a| (start[a] + EDGE).min(whole.end[a])) }
            })
        })
    })
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout();
    for file in std::env::args_os().skip(1) {
        let path = Path::new(&file);
        let (mut what, mut in_order, mut in_bricks) = (String::new(), 0.0f64, 0.0f64);
        for _ in 0..ROUNDS {
            let (found, speed_in_order) = speed(path, slices)?;
            let (_, speed_in_bricks) = speed(path, bricks)?;
            (what, in_order, in_bricks) = (found, in_order.max(speed_in_order), in_bricks.max(speed_in_bricks));
        }
        writeln!(out, "{}: {what}: {in_order:.0} MB/s in file order, {in_bricks:.0} in bricks", path.display())?;
    }
    Ok(())
}
