//! Bodies of the fuzz targets. libFuzzer calls them from `fuzz/fuzz_targets`; `tests/tests/drawn/fuzz_seeds.rs` calls
//! them with seeded mutations on every machine.
//!
//! A body returns if the bytes gave data or an error, and panics if the answer is wrong. Bodies that read whole files
//! take the first byte as a mode. Even: the rest is the file. Odd: the rest is a list of edits ([`apply_edits`]) of a
//! small valid file. With edits, a fuzzer gets past magic numbers and lengths at once.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use supervol_format::codec::tree::{self, Coarser};
use supervol_format::codec::{BrickShape, Codec, CodecChoice, decode_into, encode};
use supervol_format::container::header::{VERSION_BRICK_ERRORS, VERSION_EXACT, VERSION_QUANTIZED};
use supervol_format::voxel_type::Absence;
use supervol_format::{Container, Dims, VoxelBox, VoxelType};
use supervol_preprocess::{BuildOptions, MaxError};
use supervol_sources::formats::metaimage::{MetaImageSource, Outside};
use supervol_sources::formats::nifti::NiftiSource;
use supervol_sources::formats::npy::NpySource;
use supervol_sources::formats::nrrd::NrrdSource;
use supervol_sources::formats::segy::{SegyOptions, SegySource};
use supervol_sources::formats::tiff::TiffSource;
use supervol_sources::formats::vtk::VtkSource;
use supervol_sources::input::selection::Selection;
use supervol_sources::input::spool::SpoolFolder;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::fields::{Content, Field, built, options};
use crate::forge::{Forge, as_written_by};
pub use crate::fuzz_journal::*;
pub use crate::fuzz_seeds::*;
pub use crate::fuzz_small::*;

/// Most bricks of a damaged container that are decoded.
const BRICKS_LIMIT: u64 = 64;
/// Most voxels along an axis that are read of a damaged volume.
const READ_EDGE: u64 = 8;
/// Bytes of one edit: four for the position, one for the kind, one for the value.
const EDIT_BYTES: usize = 6;

/// A container file: opens it and reads every entry, brick and macro cell. If no checksum was corrected, every brick
/// that is returned must equal the undamaged one. The second bit of the mode requests corrected checksums. The higher
/// bits choose the container, one per version of the format.
///
/// # Panics
/// If a wrong brick is returned.
pub fn container(data: &[u8]) {
    let Some((&mode, rest)) = data.split_first() else { return };
    let seeds = seed_containers();
    let seed = &seeds[usize::from(mode >> 2) % seeds.len()];
    let mut file = if mode & 1 == 0 { rest.to_vec() } else { apply_edits(&seed.bytes, rest) };
    let mended = mode & 2 != 0 && file.len() == seed.bytes.len();
    if mended {
        // With corrected checksums, the code behind them sees the damage.
        let mut forge = Forge::new(seed.bytes.clone());
        forge.bytes = file;
        forge.reseal_pages();
        file = forge.bytes;
    }
    let Ok(container) = Container::from_source(Arc::new(file)) else { return };
    for number in 0..container.pyramid().brick_count().min(BRICKS_LIMIT) {
        let key = container.pyramid().key(number).expect("every number below the count is a brick");
        let Ok(entry) = container.entry(key) else { continue };
        let Ok(voxels) = container.read_brick(key, &entry) else { continue };
        assert_eq!(voxels.len(), container.shape(key).bytes());
        let mut record = vec![0; entry.record_bytes() as usize];
        container.read_at(entry.offset, &mut record).expect("a record that was read can be read again");
        let cells = container.macro_cells(key, &entry, &record);
        let count = container.pyramid().macro_cells(key).iter().product::<usize>();
        assert_eq!(cells.len(), count);
        let errors = container.read_cell_errors(key, &entry).expect("a record that was read can be read again");
        assert!(errors.len() == count && errors.iter().all(|&error| error <= entry.error));
        assert!([0, count].contains(&container.cell_errors(key, &entry, &record).len()));
        if mode & 1 == 1 && !mended {
            let original = seed.original.read_brick(key, &seed.entry(key)).expect("the seed container is whole");
            assert!(voxels == original, "a wrong {key} was handed out");
        }
    }
}

/// One container per readable version, the newest first. Voxels are quantised only in the one of version 2.
fn seed_containers() -> &'static [Forge] {
    static SEEDS: OnceLock<Vec<Forge>> = OnceLock::new();
    SEEDS.get_or_init(|| {
        let field = Field::of(Content::Holes, [34, 19, 17], VoxelType::I16);
        let bytes_with = |max_error| {
            let built = built(&field, &BuildOptions { max_error, ..options(16) });
            std::fs::read(&built.path).expect("the container was just built")
        };
        let [exact, moved] = [MaxError::Exact, MaxError::Value(3.0)].map(bytes_with);
        // In this order, so that inputs found before keep their meaning.
        let older = [(&exact, VERSION_EXACT), (&moved, VERSION_QUANTIZED), (&exact, VERSION_BRICK_ERRORS)]
            .map(|(bytes, version)| as_written_by(bytes, version));
        std::iter::once(exact).chain(older).map(Forge::new).collect()
    })
}

/// Inputs: each container unchanged, with an empty list of edits, and with an empty list and corrected checksums.
fn container_inputs() -> Vec<Vec<u8>> {
    let of = |(which, seed): (usize, &Forge)| {
        let mode = (which as u8) << 2;
        [[&[mode], &seed.bytes[..]].concat(), vec![mode | 1], vec![mode | 3]]
    };
    seed_containers().iter().enumerate().flat_map(of).collect()
}

/// The raw codec: payloads decoded, voxels encoded and decoded.
pub fn codec_raw(data: &[u8]) {
    codec(Codec::Raw, data);
}

/// The rle codec: payloads decoded, voxels encoded and decoded.
pub fn codec_rle(data: &[u8]) {
    codec(Codec::Rle, data);
}

/// The zstd codec: payloads decoded, voxels encoded and decoded.
pub fn codec_zstd(data: &[u8]) {
    codec(Codec::Zstd, data);
}

/// The wavelet codec: payloads decoded, voxels encoded and decoded.
pub fn codec_wavelet(data: &[u8]) {
    codec(Codec::Wavelet, data);
}

/// The trimmed codec (layers that repeat are left out): payloads decoded, voxels encoded and decoded.
pub fn codec_trimmed(data: &[u8]) {
    codec(Codec::Trimmed, data);
}

/// The tree of details: payloads decoded, voxels encoded and decoded. The first five bytes choose type, shape and factors.
/// The same bytes are the payload, the voxels and, from the end, the coarser voxels.
///
/// # Panics
/// If the round trip is not exact, or if the voxels of a decoded payload do not survive a round trip.
pub fn codec_tree(data: &[u8]) {
    let Some((&[kind, x, y, z, halved], rest)) = data.split_first_chunk::<5>() else { return };
    let voxel_type = VoxelType::ALL[usize::from(kind) % VoxelType::ALL.len()];
    let shape = BrickShape { voxel_type, extent: [x, y, z].map(|n| usize::from(n) % 24 + 1) };
    let factors = [0, 1, 2].map(|axis| u32::from(((halved % 7 + 1) >> axis) & 1) + 1);
    let bytes = BrickShape { extent: Coarser::extent(factors, shape.extent), ..shape }.bytes();
    let coarser: Vec<u8> = rest.iter().rev().copied().chain(std::iter::repeat(0)).take(bytes).collect();
    let coarser = Coarser { voxels: &coarser, factors, absence: Absence::NON_FINITE_ONLY };
    let round_trip = |voxels: &[u8]| {
        let coded = tree::encode_if_smaller(shape, voxels, coarser, None, usize::MAX);
        let Some(payload) = coded.expect("encoding needs only memory") else { return };
        let mut out = vec![0xa5; voxels.len()];
        tree::decode_into(shape, &payload, coarser, &mut out).expect("what was encoded decodes");
        assert!(out == voxels, "tree is not lossless for {shape:?} by {factors:?}");
    };
    let mut decoded = vec![0; shape.bytes()];
    if tree::decode_into(shape, rest, coarser, &mut decoded).is_ok() {
        round_trip(&decoded);
    }
    round_trip(&rest.iter().copied().chain(std::iter::repeat(0)).take(shape.bytes()).collect::<Vec<u8>>());
}

/// Inputs of [`codec_tree`]: payloads with and without classes, and one with holes.
fn tree_inputs() -> Vec<Vec<u8>> {
    let input = |voxel_type: VoxelType, voxels: &[u8], last: u8| {
        let shape = BrickShape { voxel_type, extent: [24; 3] };
        let factors = [2; 3];
        // Behind the payload there is nothing, so that the coarser voxels are read from its end. The input is decoded with
        // other coarser voxels than it was made from: its chunks fit only if it is not divided by their activity.
        let bytes = BrickShape { extent: [12; 3], ..shape }.bytes();
        let coarser = vec![0; bytes];
        let coarser = Coarser { voxels: &coarser, factors, absence: Absence::NON_FINITE_ONLY };
        let coded = tree::encode_if_smaller(shape, voxels, coarser, None, usize::MAX);
        let payload = coded.expect("encoding needs only memory").expect("voxels are multiples of a step");
        [&[voxel_type as u8 - 1, 23, 23, 23, last][..], &payload].concat()
    };
    let voxels: Vec<u8> = (0..24 * 24 * 24).map(|i: usize| (i * i / 991 % 7 + i / 2000) as u8).collect();
    let floats: Vec<u8> = (0..24 * 24 * 24)
        .flat_map(|i: u16| if i.is_multiple_of(5) { f32::NAN } else { f32::from(i / 13) }.to_le_bytes())
        .collect();
    vec![input(VoxelType::U8, &voxels, 6), input(VoxelType::F32, &floats, 6)]
}

/// The first four bytes choose type and shape. The rest is decoded as a payload, and encoded as voxels and decoded.
///
/// # Panics
/// If the round trip is not exact, or if the voxels of a decoded payload do not survive a round trip.
fn codec(codec: Codec, data: &[u8]) {
    let Some((&[kind, x, y, z], rest)) = data.split_first_chunk::<4>() else { return };
    let voxel_type = VoxelType::ALL[usize::from(kind) % VoxelType::ALL.len()];
    let shape = BrickShape { voxel_type, extent: [x, y, z].map(|n| usize::from(n) % 24 + 1) };
    let mut decoded = vec![0; shape.bytes()];
    if decode_into(codec, shape, rest, &mut decoded).is_ok() {
        round_trip(codec, shape, &decoded);
    }
    let voxels: Vec<u8> = rest.iter().copied().chain(std::iter::repeat(0)).take(shape.bytes()).collect();
    round_trip(codec, shape, &voxels);
}

fn round_trip(codec: Codec, shape: BrickShape, voxels: &[u8]) {
    // `encode` may choose another codec. Raw: the codec would enlarge the brick. Zstd: voxels are no multiples of a
    // step. Trimmed: layers of the apron repeat. Any plain codec: trimmed was requested and none repeat.
    let (written, payload) = encode(CodecChoice::Only(codec), shape, voxels).expect("encoding needs only memory");
    let is_allowed = match (codec, written) {
        (Codec::Raw, _) => written == Codec::Raw,
        (_, Codec::Raw | Codec::Trimmed) | (Codec::Wavelet | Codec::Trimmed, Codec::Zstd) => true,
        (Codec::Trimmed, Codec::Rle) => true,
        _ => written == codec,
    };
    assert!(is_allowed && payload.len() <= voxels.len(), "{shape:?}: expanded");
    let mut out = vec![0xa5; voxels.len()];
    decode_into(written, shape, &payload, &mut out).expect("what was encoded decodes");
    assert!(out == voxels, "{} is not lossless for {shape:?}", codec.name());
}

/// Reads a SEG-Y file.
pub fn segy(data: &[u8]) {
    let bytes = whole_file(data, &segy_seed());
    read_some(SegySource::from_bytes(Box::new(bytes), Path::new("fuzz.sgy"), &SegyOptions::default()));
}

/// Reads a NRRD file.
pub fn nrrd(data: &[u8]) {
    let bytes = whole_file(data, &nrrd_seed());
    in_a_file("fuzz.nrrd", &bytes, |path, spool| read_some(NrrdSource::open(path, spool)));
}

/// Reads a MetaImage, plain or compressed.
pub fn metaimage(data: &[u8]) {
    let bytes = whole_file(data, &metaimage_seed());
    in_a_file("fuzz.mha", &bytes, |path, spool| read_some(MetaImageSource::open(path, spool, Outside::Refused)));
}

/// Reads a plain NIfTI file; if the second bit of the mode is set, the header of an ANALYZE 7.5 pair.
pub fn nifti(data: &[u8]) {
    if data.first().is_some_and(|mode| mode & 2 != 0) {
        return in_a_file("fuzz.hdr", &whole_file(data, &analyze_seed()), |path, spool| {
            std::fs::write(path.with_extension("img"), [7; 48]).expect("room for a small file");
            read_some(NiftiSource::open(path, spool));
        });
    }
    let bytes = whole_file(data, &nifti_seed());
    in_a_file("fuzz.nii", &bytes, |path, spool| read_some(NiftiSource::open(path, spool)));
}

/// Reads an npy file.
pub fn npy(data: &[u8]) {
    let bytes = whole_file(data, &npy_seed());
    in_a_file("fuzz.npy", &bytes, |path, _| read_some(NpySource::open(path)));
}

/// Reads a DICOM file with one frame.
pub fn dicom(data: &[u8]) {
    let bytes = whole_file(data, &dicom_seed());
    in_a_file("fuzz.dcm", &bytes, read_some_of_any);
}

/// Reads a DICOM file with many frames in functional groups and RLE compression.
pub fn dicom_frames(data: &[u8]) {
    let bytes = whole_file(data, &dicom_frames_seed());
    in_a_file("fuzz.dcm", &bytes, read_some_of_any);
}

/// Reads a TIFF with the description of ImageJ, or (second and third bit of the mode) one with JPEG or zstd
/// compression.
pub fn tiff(data: &[u8]) {
    let seeds = tiff_seeds();
    let which = data.first().map_or(0, |mode| usize::from(mode >> 1)) % seeds.len();
    let bytes = whole_file(data, &seeds[which]);
    in_a_file("fuzz.tif", &bytes, |path, spool| {
        read_some(TiffSource::open(path, spool, &Selection::default()));
    });
}

/// Reads a VTK image in XML; if the second bit of the mode is set, one with LZ4 compression.
pub fn vti(data: &[u8]) {
    let seeds = vti_seeds();
    let which = data.first().map_or(0, |mode| usize::from(mode >> 1)) % seeds.len();
    let bytes = whole_file(data, &seeds[which]);
    in_a_file("fuzz.vti", &bytes, |path, spool| {
        read_some(VtkSource::open(path, spool, &Selection::default()));
    });
}

/// Reads a legacy VTK image.
pub fn vtk(data: &[u8]) {
    let bytes = whole_file(data, &vtk_seed());
    in_a_file("fuzz.vtk", &bytes, |path, spool| {
        read_some(VtkSource::open(path, spool, &Selection::default()));
    });
}

/// Reads an HDF5 file with one dataset.
pub fn hdf5(data: &[u8]) {
    in_a_file("fuzz.h5", &whole_file(data, &hdf5_seed()), read_some_of_any);
}

/// Reads a Zarr 2 array in one chunk with Blosc compression.
pub fn zarr(data: &[u8]) {
    in_a_folder(&whole_file(data, &zarr_seed()), ".zarray", "0.0.0");
}

/// Reads a Zarr 3 array in one shard.
pub fn zarr3(data: &[u8]) {
    in_a_folder(&whole_file(data, &zarr3_seed()), "zarr.json", "c/0/0/0");
}

/// Reads an N5 dataset in one block.
pub fn n5(data: &[u8]) {
    in_a_folder(&whole_file(data, &n5_seed()), "attributes.json", "0/0/0");
}

/// Writes a folder: metadata up to the first zero byte, and a chunk with the rest.
fn in_a_folder(bytes: &[u8], metadata: &str, chunk: &str) {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    in_a_file(metadata, &bytes[..end], |path, spool| {
        let folder = path.parent().expect("the file lies in a folder");
        let chunk = folder.join(chunk);
        std::fs::create_dir_all(chunk.parent().expect("a chunk lies in a folder")).expect("room for a folder");
        std::fs::write(chunk, bytes.get(end + 1..).unwrap_or_default()).expect("room for a small file");
        read_some_of_any(folder, spool);
    });
}

/// Body of a fuzz target.
pub type Body = fn(&[u8]);

/// Names, bodies and valid inputs of all targets.
#[must_use]
pub fn all() -> Vec<(&'static str, Body, Vec<Vec<u8>>)> {
    let whole = |seed: &[u8]| vec![[&[0], seed].concat()];
    let numbered = |seeds: &[Vec<u8>]| -> Vec<Vec<u8>> {
        seeds.iter().enumerate().map(|(which, seed)| [&[(which as u8) << 1], &seed[..]].concat()).collect()
    };
    let mut seeds: Vec<(&'static str, Body, Vec<Vec<u8>>)> = vec![
        ("container", container, container_inputs()),
        ("journal", journal, journal_inputs()),
        ("segy", segy, whole(&segy_seed())),
        ("nrrd", nrrd, whole(&nrrd_seed())),
        ("metaimage", metaimage, whole(&metaimage_seed())),
        ("nifti", nifti, vec![[&[0], &nifti_seed()[..]].concat(), [&[2], &analyze_seed()[..]].concat()]),
        ("npy", npy, whole(&npy_seed())),
        ("dicom", dicom, whole(&dicom_seed())),
        ("dicom_frames", dicom_frames, whole(&dicom_frames_seed())),
        ("tiff", tiff, numbered(&tiff_seeds())),
        ("vti", vti, numbered(&vti_seeds())),
        ("vtk", vtk, whole(&vtk_seed())),
        ("hdf5", hdf5, whole(&hdf5_seed())),
        ("zarr", zarr, whole(&zarr_seed())),
        ("zarr3", zarr3, whole(&zarr3_seed())),
        ("n5", n5, whole(&n5_seed())),
        ("codec_tree", codec_tree, tree_inputs()),
    ];
    let shape = BrickShape { voxel_type: VoxelType::ALL[3], extent: [6, 7, 8] };
    let voxels: Vec<u8> = (0..shape.bytes()).map(|i| (i / 13) as u8).collect();
    // One layer repeated along x, so that every codec that can trim does so.
    let repeating: Vec<u8> = voxels.chunks_exact(12).flat_map(|row| row[..2].repeat(6)).collect();
    let codecs: [(&'static str, Body, Codec, &[u8]); 5] = [
        ("codec_raw", codec_raw, Codec::Raw, &voxels),
        ("codec_rle", codec_rle, Codec::Rle, &voxels),
        ("codec_zstd", codec_zstd, Codec::Zstd, &voxels),
        ("codec_wavelet", codec_wavelet, Codec::Wavelet, &voxels),
        ("codec_trimmed", codec_trimmed, Codec::Trimmed, &repeating),
    ];
    for (name, body, codec, voxels) in codecs {
        let (written, payload) = encode(CodecChoice::Only(codec), shape, voxels).expect("encoding needs only memory");
        assert_eq!(written, codec, "{name}: a valid payload is one of the codec");
        seeds.push((name, body, vec![[&[3, 5, 6, 7], payload.as_slice()].concat()]));
    }
    seeds.extend(crate::fuzz_small::all());
    seeds
}

pub(crate) fn whole_file(data: &[u8], seed: &[u8]) -> Vec<u8> {
    match data.split_first() {
        None => Vec::new(),
        Some((mode, rest)) if mode & 1 == 0 => rest.to_vec(),
        Some((_, edits)) => apply_edits(seed, edits),
    }
}

/// Applies edits of six bytes each: position (modulo the length), kind, value. Kinds: replace, flip a bit, set four
/// bytes to the value, cut the file there, repeat 16 bytes from there.
#[must_use]
pub fn apply_edits(seed: &[u8], edits: &[u8]) -> Vec<u8> {
    let mut file = seed.to_vec();
    for edit in edits.as_chunks::<EDIT_BYTES>().0 {
        if file.is_empty() {
            break;
        }
        let [a, b, c, d, kind, value] = *edit;
        let at = u32::from_le_bytes([a, b, c, d]) as usize % file.len();
        match kind % 16 {
            0 => file.truncate(at),
            1 => {
                let copied = file[at..file.len().min(at + 16)].to_vec();
                file.splice(at..at, copied);
            }
            2..6 => file[at] ^= 1 << (value % 8),
            6..9 => file.iter_mut().skip(at).take(4).for_each(|b| *b = value),
            _ => file[at] = value,
        }
    }
    file
}

/// Reads a few boxes of a volume in any format.
pub(crate) fn read_some_of_any(path: &Path, spool: &SpoolFolder) {
    // Limits the memory for a decoded frame to that of a small machine.
    let segy = SegyOptions { memory_bytes: 64 << 20, ..SegyOptions::default() };
    let options = OpenOptions { spool: spool.clone(), segy, ..OpenOptions::default() };
    match open(path, &options) {
        Ok(source) => read_boxes(source.as_ref()),
        Err(error) => assert!(!error.to_string().is_empty(), "an error says something"),
    }
}

/// Reads the first and the last voxels of an opened volume.
fn read_some<S: VolumeSource>(opened: Result<S, SourceError>) {
    match opened {
        Ok(source) => read_boxes(&source),
        Err(error) => assert!(!error.to_string().is_empty(), "an error says something"),
    }
}

fn read_boxes(source: &dyn VolumeSource) {
    let info = source.info();
    let Dims(dims) = info.dims;
    assert!(info.dims.is_valid(), "{dims:?} was accepted");
    assert!(info.geometry.defect().is_none(), "{:?}", info.geometry);
    let edge = dims.map(|n| n.min(READ_EDGE));
    let boxes = [
        VoxelBox { start: [0; 3], end: edge },
        VoxelBox { start: std::array::from_fn(|a| dims[a] - edge[a]), end: dims },
    ];
    for voxels in boxes {
        let mut out = vec![0; voxels.voxels() * info.voxel_type.bytes()];
        // Data and errors are both valid answers.
        let _ = source.read_box(voxels, &mut out);
    }
}

pub(crate) fn in_a_file(name: &str, bytes: &[u8], read: impl FnOnce(&Path, &SpoolFolder)) {
    let memory = Path::new("/dev/shm");
    let place = if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() };
    let folder = tempfile::tempdir_in(place).expect("fuzzing needs a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("fuzzing needs room for a small file");
    read(&path, &SpoolFolder::at(folder.path()));
}
