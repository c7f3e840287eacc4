//! Build time and memory of containers, by volume size.
//!
//! The volume is a synthetic survey of bytes in a raw file, read from the page cache. A build does everything that
//! `supervol build` does: pyramid, ranges, error bounds, checksums, and a synced file.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use supervol_format::codec::CodecChoice;
use supervol_format::{Dims, Geometry, VoxelBox, VoxelType};
use supervol_preprocess::{BuildOptions, Existing, build, identify};
use supervol_runtime::render::process;
use supervol_sources::formats::raw::{RawOptions, RawSource};
use supervol_sources::synthetic::Synthetic;
use supervol_sources::{Endian, VolumeSource};

use super::CHOICES;
use crate::context::{ChartError, Context};
use crate::measure::Spread;

/// Voxels along an edge.
const EDGES: [u64; 4] = [64, 128, 256, 512];
/// Voxels along an edge at the small scale.
const SMALL_EDGES: [u64; 2] = [24, 48];
/// Builds of each kind; the median is kept.
const REPEATS: usize = 3;
/// Memory limit of a build, bytes: the default of `supervol build`.
pub const MEMORY_BYTES: u64 = 1 << 30;
/// Slices of the survey computed and written at a time.
const SLICES_AT_ONCE: usize = 16;
/// Seed of the survey.
const SEED: u64 = 1;

/// Builds of one size with one codec.
#[derive(Debug, Clone)]
pub struct Built {
    /// Codec name, as in `--codec`.
    pub codec: &'static str,
    /// Voxels along an edge; one byte each.
    pub edge: u64,
    /// Wall time, from raw file to synced container.
    pub wall: Spread,
    /// Processor time of all threads.
    pub cpu: Spread,
    /// Peak resident memory minus the resident memory before the first build; `None` if the system does not report it.
    pub peak_bytes: Option<u64>,
    /// Size of the container, bytes.
    pub container_bytes: u64,
}

impl Built {
    /// Size of the volume, bytes.
    #[must_use]
    pub const fn volume_bytes(&self) -> u64 {
        self.edge.pow(3)
    }

    /// Throughput in megabytes of the volume per second, for the median of this time.
    #[must_use]
    pub fn megabytes_per_second(&self, time: Spread) -> f64 {
        self.volume_bytes() as f64 / 1e3 / time.median_ms
    }
}

/// Builds every size with every codec, smallest first, because an allocator keeps memory from one build to the next.
///
/// # Errors
/// If the raw file cannot be written or built.
pub fn measure(context: &Context<'_>) -> Result<Vec<Built>, ChartError> {
    let resident_before = process::resident_bytes();
    let mut all = Vec::new();
    for &edge in context.pick(&EDGES[..], &SMALL_EDGES[..]) {
        (context.say)(&format!("building {edge}^3 voxels by every codec"));
        let file = RawFile::write(context, edge)?;
        for choice in CHOICES {
            all.push(measure_one(&file, choice, resident_before)?);
        }
    }
    all.sort_by_key(|built| CHOICES.iter().position(|choice| choice.name() == built.codec));
    Ok(all)
}

/// Raw file of bytes, removed on drop.
struct RawFile {
    path: PathBuf,
    edge: u64,
}

impl RawFile {
    fn write(context: &Context<'_>, edge: u64) -> Result<Self, ChartError> {
        let file = Self { path: context.folder.join(format!("survey-{edge}.raw")), edge };
        let survey = Synthetic::new("seismic", Dims([edge; 3]), Some(VoxelType::U8), SEED)?;
        let failed = |source| ChartError::Write { path: file.path.clone(), source };
        let mut out = File::create(&file.path).map_err(failed)?;
        for z in (0..edge).step_by(SLICES_AT_ONCE) {
            let voxels = VoxelBox { start: [0, 0, z], end: [edge, edge, (z + SLICES_AT_ONCE as u64).min(edge)] };
            let mut bytes = vec![0; voxels.voxels()];
            survey.read_box(voxels, &mut bytes)?;
            out.write_all(&bytes).map_err(failed)?;
        }
        Ok(file)
    }

    fn open(&self) -> Result<RawSource, ChartError> {
        let options = RawOptions {
            dims: Dims([self.edge; 3]),
            voxel_type: VoxelType::U8,
            endian: Endian::Little,
            header_bytes: 0,
            geometry: Geometry::IDENTITY,
            nodata: None,
        };
        Ok(RawSource::open(&self.path, &options)?)
    }
}

impl Drop for RawFile {
    fn drop(&mut self) {
        // The creator of the folder removes it with all its files.
        let _removed_early = std::fs::remove_file(&self.path);
    }
}

fn measure_one(file: &RawFile, choice: CodecChoice, resident_before: u64) -> Result<Built, ChartError> {
    let output = file.path.with_extension("svol");
    let is_peak_known = forget_peak(Path::new("/proc/self/clear_refs"));
    let (mut wall, mut cpu, mut container_bytes) = (Vec::new(), Vec::new(), 0);
    for _ in 0..REPEATS {
        let (begun, cpu_before) = (Instant::now(), process::cpu_time());
        container_bytes = build_once(file, choice, &output)?;
        wall.push(begun.elapsed().as_secs_f64() * 1e3);
        cpu.push((process::cpu_time() - cpu_before).as_secs_f64() * 1e3);
    }
    let peak = process::peak_resident_bytes().saturating_sub(resident_before);
    std::fs::remove_file(&output).map_err(|source| ChartError::Write { path: output, source })?;
    Ok(Built {
        codec: choice.name(),
        edge: file.edge,
        wall: Spread::of(&wall),
        cpu: Spread::of(&cpu),
        peak_bytes: is_peak_known.then_some(peak),
        container_bytes,
    })
}

fn build_once(file: &RawFile, choice: CodecChoice, output: &Path) -> Result<u64, ChartError> {
    let options = BuildOptions {
        codec: choice,
        memory_bytes: MEMORY_BYTES,
        existing: Existing::Replace,
        ..BuildOptions::default()
    };
    let source = file.open()?;
    let origin = identify(&file.path, source.info().format)?;
    Ok(build(&source, origin, output, &options, &|_| ())?.container_bytes)
}

/// Resets the peak resident memory that Linux records for this process. `false`: it failed, and later peaks are
/// unknown.
fn forget_peak(clear_refs: &Path) -> bool {
    std::fs::write(clear_refs, "5").is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::context::Scale;

    #[test]
    fn every_codec_builds_every_size() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let built = measure(&context).expect("a temporary folder has room");
        assert_eq!(built.len(), CHOICES.len() * SMALL_EDGES.len());
        assert!(built.iter().all(|b| b.wall.median_ms > 0.0 && b.container_bytes > 0));
        let largest = |codec: &str| built.iter().rfind(|b| b.codec == codec).expect("it was built");
        assert_eq!((largest("raw").edge, largest("auto").edge), (48, 48));
        assert!(largest("auto").container_bytes <= largest("zstd").container_bytes);
        assert!(largest("zstd").container_bytes < largest("raw").container_bytes);
        // The peak is that of a build, not of the whole process.
        let most = built.iter().filter_map(|b| b.peak_bytes).max().unwrap_or(0);
        assert!(most < 1 << 30, "{most}");
        assert_eq!(std::fs::read_dir(folder.path()).expect("it can be listed").count(), 0);
        assert!(!forget_peak(&folder.path().join("no/such")));
    }
}
