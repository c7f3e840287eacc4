//! Codecs on bricks of real and synthetic volumes: bits per voxel, encoding speed, decoding speed.
//!
//! The bricks are evenly spaced among the bricks of level 0 with more than one value. Voxels are rounded to multiples
//! of a step, as `build --max-error` does, and encoded by each codec. Bits are per stored voxel, aprons included.
//! Speeds are bytes of voxels per second of processor time on one thread: the best of several rounds over all bricks.

use std::path::{Path, PathBuf};

use supervol_format::codec::quantize::Quantizer;
use supervol_format::codec::{BrickShape, Codec, CodecChoice, Coding, decode_into, encode};
use supervol_format::container::ContainerError;
use supervol_format::voxel_type::Absence;
use supervol_format::{BrickKey, Container, Dims, Lod, ValueRange, VoxelType};
use supervol_preprocess::BuildOptions;
use supervol_runtime::render::process;
use supervol_sources::VolumeSource;
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::synthetic::Synthetic;

use super::CHOICES;
use crate::context::{ChartError, Context};
use crate::scenes::{CARP, data_file};
use crate::volume::{Volume, build_options};

/// Bricks of each volume.
const BRICKS: usize = 16;
/// Rounds over all bricks; the fastest is kept.
const ROUNDS: usize = 3;
/// Allowed errors, as fractions of the value range.
const SHARES: [f64; 2] = [0.0, 0.01];
/// Synthetic volumes.
const SYNTHETIC: [(&str, &str, VoxelType); 4] = [
    ("survey", "seismic", VoxelType::U8),
    ("survey", "seismic", VoxelType::I16),
    ("survey", "seismic", VoxelType::F32),
    ("vessels", "vessels", VoxelType::U8),
];
/// Volumes of the developers' data folder: name and file. The folder's own table gives their origins.
const REAL: [(&str, &str); 6] = [
    ("F3", "segy/real/f3_int16_be.sgy"),
    ("Penobscot section", "segy/real/penobscot_xl1155.sgy"),
    ("Volve velocities", "segy/real/volve_migvel_depth_sub3d.sgy"),
    ("electron microscopy", "png-slices/fibsem-medulla-250"),
    ("stent CT", "npz/stent.npz"),
    ("frog, labels", "vti/frog_tissues_labels.vti"),
];

/// Stored voxels of a brick.
#[derive(Debug, Clone)]
pub struct Brick {
    /// Voxel type and extent.
    pub shape: BrickShape,
    /// Stored voxels; little endian, x fastest.
    pub voxels: Vec<u8>,
}

/// Results of one codec.
#[derive(Debug, Clone)]
pub struct Figures {
    /// Codec name, as in `--codec`.
    pub codec: &'static str,
    /// Total size of all payloads, bytes.
    pub bytes: usize,
    /// Decoding speed, megabytes of voxels per second of processor time.
    pub decode_mb_s: f64,
    /// Encoding speed, in the same unit.
    pub encode_mb_s: f64,
}

/// Results of all codecs on one volume at one allowed error.
#[derive(Debug, Clone)]
pub struct Rates {
    /// Name of the volume.
    pub name: String,
    /// Voxel type of the volume.
    pub voxel_type: VoxelType,
    /// Allowed error, fraction of the value range.
    pub share: f64,
    /// Stored voxels of all bricks.
    pub voxels: usize,
    /// Results by codec, in the order of [`CHOICES`].
    pub codecs: Vec<Figures>,
}

impl Rates {
    /// Bits per stored voxel of one codec.
    #[must_use]
    pub fn bits(&self, figures: &Figures) -> f64 {
        figures.bytes as f64 * 8.0 / self.voxels as f64
    }
}

/// Up to `most` bricks of level 0 and the range of their values. Uniform bricks are skipped; the rest is evenly spaced.
///
/// # Errors
/// If the container cannot be read.
pub fn bricks_of(container: &Container, most: usize) -> Result<(Vec<Brick>, ValueRange), ContainerError> {
    let mut keys: Vec<BrickKey> = Vec::new();
    for key in container.pyramid().keys_of(Lod::FINEST) {
        if container.entry(key)?.codec != Codec::Uniform {
            keys.push(key);
        }
    }
    let mut range = ValueRange::EMPTY;
    let mut bricks = Vec::new();
    for &key in keys.iter().step_by(keys.len().div_ceil(most).max(1)) {
        let entry = container.entry(key)?;
        range = range.union(entry.range);
        bricks.push(Brick { shape: container.shape(key), voxels: container.read_brick(key, &entry)? });
    }
    Ok((bricks, range))
}

/// Rounds voxels as `build --max-error` does.
#[must_use]
pub fn moved(bricks: &[Brick], absence: Absence, quantizer: Option<Quantizer>) -> Vec<Brick> {
    let mut bricks = bricks.to_vec();
    if let Some(quantizer) = quantizer {
        for brick in &mut bricks {
            let _greatest = quantizer.snap(brick.shape.voxel_type, absence, &mut brick.voxels);
        }
    }
    bricks
}

/// Size of the voxels of all bricks, bytes.
#[must_use]
pub fn bytes_of(bricks: &[Brick]) -> usize {
    bricks.iter().map(|brick| brick.voxels.len()).sum()
}

/// Results of one codec on these bricks; speeds are the best of `rounds` rounds.
///
/// # Panics
/// If an encoded brick cannot be decoded.
#[must_use]
pub fn figures(bricks: &[Brick], coding: Coding, rounds: usize) -> Figures {
    let code = |brick: &Brick| encode(coding, brick.shape, &brick.voxels).expect("there is memory");
    let payloads: Vec<(Codec, Vec<u8>)> = bricks.iter().map(code).collect();
    let encode_s = best_of(rounds, || bricks.iter().for_each(|brick| drop(std::hint::black_box(code(brick)))));
    let mut out = Vec::new();
    let decode_s = best_of(rounds, || {
        for (brick, (codec, payload)) in bricks.iter().zip(&payloads) {
            out.resize(brick.voxels.len(), 0);
            decode_into(*codec, brick.shape, payload, &mut out).expect("what was encoded decodes");
        }
    });
    let megabytes = bytes_of(bricks) as f64 / 1e6;
    let bytes = payloads.iter().map(|(_, payload)| payload.len()).sum();
    let codec = coding.choice.name();
    Figures { codec, bytes, decode_mb_s: megabytes / decode_s, encode_mb_s: megabytes / encode_s }
}

/// Shortest processor time of a round, seconds. No other thread may work meanwhile.
fn best_of(rounds: usize, mut round: impl FnMut()) -> f64 {
    let time = |_| {
        let begun = process::cpu_time();
        round();
        (process::cpu_time() - begun).as_secs_f64()
    };
    (0..rounds).map(time).fold(f64::INFINITY, f64::min)
}

/// Measures all available volumes. The second value lists the missing ones.
pub(super) fn measure(context: &Context<'_>) -> Result<(Vec<Rates>, Vec<String>), ChartError> {
    let (mut rates, mut notes) = (Vec::new(), Vec::new());
    let edge = context.pick(192, 24);
    for &(name, field, voxel_type) in context.pick(&SYNTHETIC[..], &SYNTHETIC[..2]) {
        let source = Synthetic::new(field, Dims([edge; 3]), Some(voxel_type), 1)?;
        rates.extend(measure_source(context, name, &source)?);
    }
    if context.pick(false, true) {
        return Ok((rates, notes));
    }
    let carp = context.folder.join("carp_ct.nii.gz");
    std::fs::write(&carp, CARP).map_err(|source| ChartError::Write { path: carp.clone(), source })?;
    let spool = SpoolFolder::at(context.folder);
    rates.extend(measure_source(context, "carp CT", &NiftiSource::open(&carp, &spool)?)?);
    for (name, file) in REAL {
        let Some(path) = data_file(file) else {
            notes.push(format!(
                "codecs on {name}: {file} is in no data folder (name one in the environment variable SUPERVOL_DATA)"
            ));
            continue;
        };
        rates.extend(measure_source(context, name, &*open_real(&path, &spool)?)?);
    }
    Ok((rates, notes))
}

fn open_real(path: &Path, spool: &SpoolFolder) -> Result<Box<dyn VolumeSource>, ChartError> {
    Ok(open(path, &OpenOptions { spool: spool.clone(), ..OpenOptions::default() })?)
}

/// Results of all codecs on a volume: lossless, and within each allowed error.
fn measure_source(context: &Context<'_>, name: &str, source: &dyn VolumeSource) -> Result<Vec<Rates>, ChartError> {
    let voxel_type = source.info().voxel_type;
    (context.say)(&format!("coding {name}, {voxel_type}"));
    let options = BuildOptions { codec: CodecChoice::Only(Codec::Raw), ..build_options(64) };
    let volume = Volume::build(context, &format!("rates {name} {voxel_type}"), source, &options)?;
    let (exact, range) = bricks_of(&volume.container, BRICKS)?;
    let absence = volume.container.descriptor().absence;
    let within = |share: f64| {
        let quantizer = Quantizer::within(voxel_type, share * range.width());
        // No quantizer: the allowed error is smaller than the difference between whole numbers.
        (share == 0.0 || quantizer.is_some()).then(|| {
            let bricks = moved(&exact, absence, quantizer);
            let of_choice = |choice| figures(&bricks, Coding { choice, absence, quantizer }, ROUNDS);
            let codecs = CHOICES.map(of_choice).into();
            Rates { name: name.into(), voxel_type, share, voxels: bytes_of(&bricks) / voxel_type.bytes(), codecs }
        })
    };
    let measured = SHARES.into_iter().filter_map(within).collect();
    remove(volume.path)?;
    Ok(measured)
}

fn remove(path: PathBuf) -> Result<(), ChartError> {
    std::fs::remove_file(&path).map_err(|source| ChartError::Write { path, source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::context::Scale;

    #[test]
    fn codecs_are_measured_without_loss_and_within_an_error() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let context = Context { scale: Scale::Small, folder: folder.path(), say: &|_| () };
        let (rates, notes) = measure(&context).expect("a temporary folder has room");
        let measured: Vec<_> = rates.iter().map(|r| (r.voxel_type, r.share)).collect();
        let types = [VoxelType::U8, VoxelType::I16];
        assert_eq!(measured, types.map(|t| SHARES.map(|share| (t, share))).concat());
        assert!(notes.is_empty());
        for rates in &rates {
            let names: Vec<_> = rates.codecs.iter().map(|f| f.codec).collect();
            assert_eq!(names, ["raw", "rle", "zstd", "wavelet", "auto"]);
            let bits: Vec<_> = rates.codecs.iter().map(|f| rates.bits(f)).collect();
            assert_eq!(bits[0], 8.0 * rates.voxel_type.bytes() as f64, "raw voxels are as long as they are");
            assert!(bits.iter().all(|b| *b >= bits[4] && *b <= bits[0]), "auto is the smallest: {bits:?}");
            assert!(rates.codecs.iter().all(|f| f.decode_mb_s > 0.0 && f.encode_mb_s > 0.0));
        }
        // An allowed error saves bits.
        assert!(rates[1].codecs[4].bytes < rates[0].codecs[4].bytes);
    }
}
