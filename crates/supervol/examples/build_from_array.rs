//! Builds a container of voxels in memory, and draws it: `cargo run --release -p supervol --example build_from_array -- FOLDER`
//!
//! Voxels that are not all in memory come from a source of one's own: see `Waves` below.

#![allow(clippy::cast_possible_truncation, reason = "an example of a small volume")]
#![allow(clippy::print_stdout, reason = "an example shows what it finds")]

use std::error::Error;
use std::path::PathBuf;

use supervol::{
    ArraySource, BuildOptions, Dims, Existing, Options, Scene, SourceError, SourceInfo, Volume, VolumeSource, VoxelBox,
    VoxelType,
};

/// A volume that is computed on read: it takes no memory, whatever its size.
struct Waves(SourceInfo);

impl Waves {
    fn new(dims: [u64; 3]) -> Self {
        Self(SourceInfo::plain("waves", Dims(dims), VoxelType::F32))
    }
}

impl VolumeSource for Waves {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    /// Fills `out` with the voxels of a box: little endian, packed, x contiguous.
    fn read_box(&self, voxels: VoxelBox, out: &mut [u8]) -> Result<(), SourceError> {
        let [nx, ny, _] = voxels.extent();
        for (number, voxel) in out.chunks_exact_mut(size_of::<f32>()).enumerate() {
            let local = [number % nx, number / nx % ny, number / nx / ny];
            let [x, y, z] = std::array::from_fn(|axis| (voxels.start[axis] as usize + local[axis]) as f32);
            let value = (0.2 * x).sin() + (0.15 * y).cos() + (0.1 * (x + z)).sin();
            voxel.copy_from_slice(&value.to_le_bytes());
        }
        Ok(())
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("expected FOLDER")?);
    std::fs::create_dir_all(&folder)?;
    let options = BuildOptions { existing: Existing::Replace, ..BuildOptions::default() };

    let voxels: Vec<u16> = (0..64u32 * 48 * 32).map(|n| (n % 64 * 100 + n / 64 % 48 * 50) as u16).collect();
    let ramp = ArraySource::new([64, 48, 32], voxels)?.with_info(|info| info.geometry.spacing = [1.0, 1.0, 2.0]);
    let report = supervol::build_source(&ramp, "ramp", folder.join("ramp.svol"), &options, &|_| {})?;
    println!("ramp: {} bytes of voxels, {} of container", report.source_bytes, report.container_bytes);

    let waves = Waves::new([128, 96, 80]);
    supervol::build_source(&waves, "waves", folder.join("waves.svol"), &options, &|_| {})?;
    let picture = Volume::open(folder.join("waves.svol"))?.draw(&Scene::default(), &Options::default())?;
    picture.save(folder.join("waves.png"))?;
    Ok(())
}
