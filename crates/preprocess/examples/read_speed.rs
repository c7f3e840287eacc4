//! How fast volume files are read: opened, and every voxel read in file order and in boxes of bricks, in MB of voxels a second of
//! wall time.
//!
//!     cargo run --release -p supervol-preprocess --example read_speed -- FILE...

use std::io::Write;
use std::path::Path;
use std::time::Instant;

use supervol_format::VoxelBox;
use supervol_preprocess::file_order::boxes;
use supervol_preprocess::source::VolumeSource;
use supervol_preprocess::source::open::{OpenOptions, open};

/// Voxels of a box in file order, and edge of a box of bricks.
const BOX_VOXELS: u64 = 1 << 22;
const EDGE: u64 = 64;

/// Reads these boxes of a file, opening included; MB a second.
fn speed<B: Iterator<Item = VoxelBox>>(
    path: &Path,
    cut: impl Fn(VoxelBox) -> B,
) -> Result<(String, f64), Box<dyn std::error::Error>> {
    let begun = Instant::now();
    let source: Box<dyn VolumeSource> = open(path, &OpenOptions::default())?;
    let info = source.info();
    let mut bytes = 0;
    for part in cut(info.dims.full_box()) {
        let mut out = vec![0; part.voxels() * info.voxel_type.bytes()];
        source.read_box(part, &mut out)?;
        bytes += out.len();
    }
    Ok((format!("{} {}", info.dims, info.voxel_type), bytes as f64 / 1e6 / begun.elapsed().as_secs_f64()))
}

fn bricks(whole: VoxelBox) -> impl Iterator<Item = VoxelBox> {
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
        let (what, in_order) = speed(path, |whole| boxes(whole, BOX_VOXELS, u64::MAX))?;
        let (_, in_bricks) = speed(path, bricks)?;
        writeln!(out, "{}: {what}: {in_order:.0} MB/s in file order, {in_bricks:.0} in bricks", path.display())?;
    }
    Ok(())
}
