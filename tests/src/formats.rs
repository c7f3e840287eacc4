//! Result of reading every real file in the data folder: built, verified and read back, or refused with the reason.
//!
//! `cargo run -p supervol-tests --bin formats -- DATA_FOLDER` writes the table in `docs/formats.md`; the test
//! `formats.rs` writes it again and compares.

use std::path::{Path, PathBuf};

use supervol_arguments::source::flag;
use supervol_format::container::manifest::Source;
use supervol_format::level_reader::LevelReader;
use supervol_format::{Dims, Geometry, Lod};
use supervol_preprocess::verify::verify;
use supervol_preprocess::{BuildOptions, Existing, build, identify_source};
use supervol_sources::formats::raw::RawOptions;
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{Endian, VolumeSource};

/// Folders of the data folder that the table covers.
const FOLDERS: [&str; 13] = [
    "segy/real",
    "segy/odd",
    "segy/f3-formats",
    "nrrd",
    "nifti",
    "npy",
    "metaimage",
    "dicom/odd",
    "hdf5",
    "npz",
    "tiff",
    "vti",
    "vtk-legacy",
];
/// Folders that are inputs as a whole.
const FOLDERS_AS_INPUTS: [&str; 18] = [
    "dicom/brain_pd_19slices",
    "n5/n5_viewer_multiscale_modern",
    "png-slices/fibsem-medulla-250",
    "tiff/odd/ome-multifile",
    "zarr/ome_zarr_0.4",
    "zarr/ome_zarr_0.5",
    "zarr/ome_zarr_0.6_scale.zarr",
    "zarr/v2/1d.contiguous.f4.be",
    "zarr/v2/2d.chunked.ragged.i2",
    "zarr/v2/3d.chunked.O",
    "zarr/v2/3d.chunked.i2",
    "zarr/v2/3d.chunked.mixed.i2.C",
    "zarr/v2/3d.chunked.mixed.i2.F",
    "zarr/v2/3d.contiguous.i2",
    "zarr/v3/3d.chunked.compressed.sharded.i2",
    "zarr/v3/3d.chunked.i2",
    "zarr/v3/3d.chunked.mixed.i2.F",
    "zarr/v3/3d.contiguous.i2",
];
/// Files that belong to other files and are opened with them.
const PARTS: [&str; 3] = ["BallBinary30x30x30.raw", "HeadMRVolume.raw", "BrainProtonDensitySliceBorder20.zraw"];
/// Memory budget of each build, in bytes.
const MEMORY_BYTES: u64 = 256 << 20;

/// Result for one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outcome {
    /// Path inside the data folder.
    pub file: String,
    /// `builds` or `refused`.
    pub fate: &'static str,
    /// Dims and type, or the reason.
    pub what: String,
    /// Notes of the reader.
    pub notes: Vec<String>,
}

/// All files in the covered folders, sorted, including the raw ones and the header of the headless slices.
///
/// # Errors
/// If a folder cannot be listed.
pub fn files(data: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for folder in FOLDERS {
        list(&data.join(folder), &mut files)?;
    }
    files.extend(FOLDERS_AS_INPUTS.map(|folder| data.join(folder)));
    files.push(data.join("raw/walnut_128x96x114_u16le.raw"));
    files.push(data.join("raw/headsq_64x64x93_i16le/quarter.nhdr"));
    files.retain(|f| !PARTS.iter().any(|part| f.ends_with(part)));
    files.sort();
    files.dedup();
    Ok(files)
}

fn list(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            list(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}

/// Opens, builds, verifies and reads back one file; `work` is a folder for the container.
///
/// # Panics
/// If a file that opens does not build or verify, or differs when it is read back: that is a bug.
#[must_use]
pub fn outcome(data: &Path, path: &Path, work: &Path) -> Outcome {
    let file = path.strip_prefix(data).unwrap_or(path).display().to_string();
    let mut options = OpenOptions::default();
    options.segy.memory_bytes = MEMORY_BYTES;
    if path.extension().is_some_and(|e| e == "raw") {
        options.raw = Some(RawOptions {
            dims: Dims([128, 96, 114]),
            voxel_type: supervol_format::VoxelType::U16,
            endian: Endian::Little,
            header_bytes: 0,
            geometry: Geometry::IDENTITY,
            nodata: None,
        });
    }
    let source = match open(path, &options) {
        Ok(source) => source,
        Err(error) => {
            // The path is in the first column.
            let reason = error
                .named(flag)
                .replace(&format!("{}: ", path.display()), "")
                .replace(&data.display().to_string(), "");
            return Outcome { file, fate: "refused", what: reason, notes: Vec::new() };
        }
    };
    let info = source.info();
    let origin = identify_source(path, &options.selection, source.as_ref()).unwrap_or_else(|e| panic!("{file}: {e}"));
    round_trip(&file, source.as_ref(), origin, work);
    let what = format!("{} {}", info.dims, info.voxel_type);
    Outcome { file, fate: "builds", what, notes: info.notes.iter().map(|note| note.named(flag)).collect() }
}

fn round_trip(file: &str, source: &dyn VolumeSource, origin: Source, work: &Path) {
    let output = work.join("round-trip.svol");
    let options =
        BuildOptions { memory_bytes: MEMORY_BYTES, existing: Existing::Replace, threads: 2, ..BuildOptions::default() };
    build(source, origin, &output, &options, &|_| ()).unwrap_or_else(|e| panic!("{file}: {e}"));
    let container = verify(&output, MEMORY_BYTES, &|_, _| ()).unwrap_or_else(|e| panic!("{file}: {e}"));
    let voxels = source.info().dims.full_box();
    let bytes = voxels.voxels() * source.info().voxel_type.bytes();
    let (mut expected, mut found) = (vec![0; bytes], vec![0; bytes]);
    source.read_box(voxels, &mut expected).unwrap_or_else(|e| panic!("{file}: {e}"));
    let reader = LevelReader::new(&container, Lod::FINEST, 0);
    reader.read_box(voxels, &mut found).unwrap_or_else(|e| panic!("{file}: {e}"));
    assert!(expected == found, "{file}: level 0 is not the source's voxels bit for bit");
}

/// Hand-written table of the readable and writable formats.
const SCREEN: &str = "\
| format | read | written (`extract`, `mesh`) |
|---|---|---|
| SEG-Y (`.sgy`, `.segy`; a folder with one file per line) | revisions 0 to 2, in place; of files that are not stacked one offset (`--offset N`) or the mean (`--offset stack`); `--samples`, `--interval`, `--il-byte`, ... where headers lie | `.sgy`: revision 1 or 2, lines and coordinates of the survey, in centimetres or finer |
| DICOM (folder, or one file) | one series (`--series N\\|UID`, listed where there are several), sorted by position; many frames in one file; rescale slope and intercept, else a real-world value mapping; padding, gantry tilt; segmentations, also of single bits: a segment (`--channel N`), or a label map; uncompressed in place; RLE, JPEG (also lossless), JPEG 2000 | |
| NIfTI-1, -2 (`.nii`, `.nii.gz`, `.hdr` + `.img`), ANALYZE 7.5 (`.hdr` + `.img`) | all real types, RGB(A); plain in place; the intent code of labels; of ANALYZE spacings and SPM's scale, no place in the world | `.nii`, `.nii.gz`: the place as sform (single precision; NIfTI-2 where an axis is longer than 32,767) |
| OME-Zarr 0.1 to 0.5 (and 0.6 as far as it scales and moves), Zarr 2 and 3 | chunk by chunk; any level (`--source-level N`); gzip, zlib, zstd, Blosc, LZ4, shards, transposition; axes, places, units, `image-label`; attributes of CF, coordinates of the axes (xarray); surveys (MDIO); `FOLDER:/NAME` for an array or image in it; half-precision floats; in a ZIP file, stored or deflated, too (`.zarr.zip`, `.ozx`) | `.zarr`: OME-Zarr 0.4, one level, zstd: spacings, the first voxel's place, units; no directions |
| N5 | chunk by chunk; any level; gzip, zstd, Blosc, LZ4; spacings of N5-viewer, COSEM, BigDataViewer | |
| BigDataViewer (`.xml` beside its `.h5` or `.n5`) | a view: setup (`--channel`), time point (`--frame`), level (`--source-level`); voxel sizes, units, the product of its transforms; 16 bits are unsigned unless `dataType` says otherwise | |
| HDF5 (`.h5`, `.nc`, also Imaris, NetCDF 4, ITK) | `FILE.h5:/NAME`, or the only dataset; chunk by chunk; deflate, shuffle, szip, LZ4, LZF, n-bit, scale-offset; truth values as 0 and 1; attributes of CF, coordinates of the axes; surveys (segysak); `element_size_um`; links and raw data in other files of its folder | |
| NRRD (`.nrrd`, `.nhdr`) | raw in place, gzip, text; data in files of their own; segmentations of 3D Slicer as labels | `.nrrd` |
| MetaImage (`.mha`, `.mhd`) | raw in place, zlib, text; data in files of their own; a negative spacing turns its axis | `.mha`; patients in left-posterior-superior, which `Comment` says |
| VTK image (`.vti`, legacy `.vtk`) | raw in place, base64, text, zlib, LZ4; points or cells; `FILE.vti:/NAME` for another array than the active one | `.vti` |
| TIFF, BigTIFF, OME-TIFF, ImageJ stacks | strips, tiles, deflate, LZW, PackBits, zstd, predictors, JPEG (8 bits); numbers of a pixel together or in planes; single bits as 0 and 1, 64-bit integers, half-precision floats; series of OME (`--series N`); ImageJ's calibration, and its stacks with one page; nodata, scale, offset and unit of GDAL; plain in place | `.tif`: BigTIFF with OME-XML: spacing, no origin, no directions |
| folder of PNG, JPEG or single-page TIFF | in natural order; say `--spacing` | |
| NumPy (`.npy`, `.npz`) | in place; compressed archives; half-precision floats; `FILE.npz:/NAME` for one of several arrays | `.npy` |
| raw | `--dims`, `--dtype`, `--offset`; in place | `.raw` |
| meshes | | `.ply`, `.stl`, `.obj`: `supervol mesh --iso V` |

What is read in place, or chunk by chunk, costs no disk; all else is decoded once into a nameless temporary file beside the output.
Where there are several volumes (time points, echoes), `--frame T` takes one, where there are several numbers per voxel, `--channel C`;
of colours the luminance (Rec. 601) is used. 64-bit integers are kept in the smallest type that holds all of them, half-precision floats as f32. What was chosen,
left out or not understood is said when a container is built, and by `supervol info`.

Attributes that explain the numbers of a file are applied, and a note names them: `_FillValue`, `missing_value`, `valid_range`,
`scale_factor`, `add_offset`, `units` and `_Unsigned` of CF; tags of GDAL; ImageJ's calibration; slopes of DICOM, NIfTI and MetaImage.
`--stored-values` ignores them. `--nodata V` makes a further value absent, in every format. Usual nulls (1e30, -999.25, -9999 and the
like) are absent by default if they are frequent and far from all other values; `--keep-nulls` keeps them. Even coordinates give
the spacing and the place of an axis; uneven ones are noted.

Arrays with axes inline, crossline, and time, twt, depth or samples are surveys. Their line numbers, CDP coordinates, units and missing
traces are read. `--axes NAME,...` names the axes of an array (Zarr, N5, HDF5, NumPy), the slowest first.

For VTK, write `.vti`: VTK 9.7.2 reads its dimensions, spacing and directions as they
are. Its NRRD reader takes the first axis of a volume for numbers of a pixel: 4 x 3 x 2 voxels become a flat picture of 3 x 2 pixels
with 4 numbers each (`findings/vtk-nrrd-flat.sh`). Its MetaImage reader transposes the directions of turned axes, so that a volume
turns the opposite way (`findings/vtk-metaimage-transposed.sh`). SimpleITK reads both as they are meant.

`tools/ci.sh readers` holds all of this against
SimpleITK, VTK, pydicom, tifffile, zarr, tensorstore, nibabel, pynrrd, segyio and h5py.

";

/// The document: readable and writable formats, then one row per file.
#[must_use]
pub fn document(outcomes: &[Outcome]) -> String {
    let mut out = String::from("# Formats\n\n");
    out += SCREEN;
    out += "## Files\n\n\
         What becomes of real and odd files: each either builds, passes `supervol verify` and gives back the source's\n\
         voxels bit for bit (SEG-Y: the decoded samples), or is refused with the reason. Dims are x by y by z; for SEG-Y\n\
         x is the crossline, y the inline, z the sample. Made by\n\n    \
         cargo run -p supervol-tests --bin formats -- DATA_FOLDER > docs/formats.md\n\n\
         and compared with a fresh run by the test `formats`.\n\n\
         | file | outcome | volume, or reason | what the reader noticed |\n|---|---|---|---|\n";
    for o in outcomes {
        let cell = |text: &str| text.replace('|', "\\|").replace('\n', " ");
        out += &format!("| {} | {} | {} | {} |\n", o.file, o.fate, cell(&o.what), cell(&o.notes.join("; ")));
    }
    out
}
