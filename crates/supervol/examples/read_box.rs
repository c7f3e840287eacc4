//! Reads a box of voxels as an array, at two levels of detail: `cargo run --release -p supervol --example read_box -- VOLUME`

#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;

use supervol::{Lod, Volume, VoxelBox};

fn main() -> Result<(), Box<dyn Error>> {
    let input = std::env::args().nth(1).ok_or("expected VOLUME")?;
    let volume = Volume::open(input)?;
    let unit = &volume.container().manifest().unit;

    for level in [0, volume.coarsest_level()] {
        // The middle slice, from one side to the other: only the bricks that it meets are read.
        let [nx, ny, nz] = volume.container().pyramid().level_at(Lod(level)).dims.0;
        let slice = VoxelBox { start: [0, 0, nz / 2], end: [nx, ny, nz / 2 + 1] };
        let array = volume.read(level, slice)?;

        let present: Vec<f64> = array.values().iter().copied().filter(|value| !value.is_nan()).collect();
        let mean = present.iter().sum::<f64>() / present.len() as f64;
        let greatest = present.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        println!("level {level}: {:?} voxels, mean {mean:.3} {unit}, greatest {greatest:.3} {unit}", array.shape());
        assert!(mean <= greatest, "a mean is no more than the greatest value");
    }
    Ok(())
}
