//! VTK images: real files, and small files that VTK wrote in every variant, compared with VTK's reader.

use std::path::{Path, PathBuf};

use supervol_format::{Dims, VoxelType};
use supervol_sources::open::{OpenOptions, open};
use supervol_sources::{SourceError, VolumeSource};

use crate::grid_support;
use grid_support::*;

/// Name, dims, type, spacing along z, one voxel; least, greatest and sum of all voxels, by VTK. The voxel is half-way
/// along z, a third along y and a quarter along x.
type RealFile = (&'static str, [u64; 3], VoxelType, f64, f64, [f64; 3]);
const REAL_FILES: [RealFile; 6] = [
    ("vti/bonsai.vti", [256; 3], VoxelType::U8, 1.0, 11.0, [0.0, 255.0, 230_038_784.0]),
    ("vti/aneurism.vti", [256; 3], VoxelType::U8, 1.0, 0.0, [0.0, 255.0, 17_938_365.0]),
    ("vti/hydrogen_f32.vti", [64; 3], VoxelType::F32, 1.0, 0.068_735, [0.0, 1.0, 4_856.008_970_333_326]),
    ("vti/frog_tissues_labels.vti", [500, 470, 136], VoxelType::U8, 1.5, 0.0, [0.0, 29.0, 12_244_762.0]),
    ("vti/channels_celldata_i64.vti", [250, 250, 100], VoxelType::U8, 1.0, 3.0, [0.0, 4.0, 1_709_192.0]),
    ("vtk-legacy/ironProt.vtk", [68; 3], VoxelType::U8, 1.0, 255.0, [0.0, 255.0, 4_131_089.0]),
];

/// Files of one image, written by VTK; see `tests/data/README.md`.
const WRITTEN: [&str; 15] = [
    "appended-32-be.vti",
    "appended-64-le.vti",
    "appended-b64-32-le.vti",
    "appended-b64-lz4-64-be.vti",
    "appended-b64-zlib-64-be.vti",
    "appended-lz4-32-le.vti",
    "appended-zlib-32-le.vti",
    "ascii-32-le.vti",
    "binary-32-be.vti",
    "binary-64-le.vti",
    "binary-lz4-64-le.vti",
    "binary-zlib-32-le.vti",
    "binary-zlib-64-be.vti",
    "legacy-ascii.vtk",
    "legacy-binary.vtk",
];

fn written(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/vtk").join(name)
}

fn opened(path: &Path) -> Result<Box<dyn VolumeSource>, SourceError> {
    open(path, &OpenOptions::default())
}

#[test]
fn real_files_are_what_vtk_reads() {
    for (name, dims, voxel_type, spacing_z, value, [least, greatest, sum]) in REAL_FILES {
        let Some(path) = data_file(name) else { continue };
        let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((source.info().dims, source.info().voxel_type), (Dims(dims), voxel_type), "{name}");
        let found = summary(source.as_ref(), [dims[0] / 4, dims[1] / 3, dims[2] / 2]);
        assert_eq!((found.0, found.1), (least, greatest), "{name}");
        assert!((found.2 / sum - 1.0).abs() < 1e-9, "{name}: {} is not {sum}", found.2);
        assert!((found.3 - value).abs() < 1e-6, "{name}: {}", found.3);
        assert_eq!(source.info().geometry.spacing[2], spacing_z, "{name}");
    }
    let Some(path) = data_file("vti/channels_celldata_i64.vti") else { return };
    let cells = opened(&path).unwrap();
    assert_eq!(cells.info().geometry.origin, [0.5; 3]);
    assert!(
        cells.info().notes.iter().any(|note| note.to_string().contains("int64, of 0 to 4: kept as u8")),
        "{:?}",
        cells.info().notes
    );
}

/// Values of the voxels: x + 10 y + 100 z.
fn ramp() -> Vec<f64> {
    let voxel = |i: u32| f64::from(i % 5 + 10 * (i / 5 % 4) + 100 * (i / 20));
    (0..60).map(voxel).collect()
}

#[test]
fn every_way_in_which_vtk_writes() {
    for name in WRITTEN {
        let path = written(name);
        let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
        let info = source.info();
        assert_eq!((info.dims, info.voxel_type, info.format), (Dims([5, 4, 3]), VoxelType::F32, "vtk"), "{name}");
        let expected: Vec<u8> = ramp().into_iter().flat_map(|v| (v as f32).to_le_bytes()).collect();
        check_boxes(source.as_ref(), &expected, 3);
        let is_legacy = name.ends_with("vtk");
        let world = info.geometry.world_from_index();
        // Legacy files have no directions.
        let (first, next) =
            if is_legacy { ([11.0, 21.0, 30.0], [11.5, 21.0, 30.0]) } else { ([9.0, 21.0, 30.0], [9.0, 21.5, 30.0]) };
        assert_eq!(world.transform_point3([0.0; 3].into()).to_array(), first, "{name}");
        assert_eq!(world.transform_point3([1.0, 0.0, 0.0].into()).to_array(), next, "{name}");
        if name == "legacy-ascii.vtk" {
            continue;
        }
        // Other arrays by name: 64-bit integers, colours.
        let mut named = path.clone().into_os_string();
        named.push(":/whole");
        let whole = opened(Path::new(&named)).unwrap_or_else(|e| panic!("{e}"));
        let expected = if name.starts_with("ascii") { VoxelType::F64 } else { VoxelType::I32 };
        assert_eq!(whole.info().voxel_type, expected, "{name}");
        assert_eq!(summary(whole.as_ref(), [4, 3, 2]).3, 234_000.0 - 5.0, "{name}");
        let mut named = path.clone().into_os_string();
        named.push(":/colours");
        let mut options = OpenOptions::default();
        options.selection.channel = Some(1);
        let green = open(Path::new(&named), &options).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(value_at(green.as_ref(), [4, 3, 2]), f64::from(234 % 7), "{name}");
        let error = opened(&{
            let mut named = path.clone().into_os_string();
            named.push(":/heat");
            PathBuf::from(named)
        });
        assert_refused(error, &["no array `heat`", "ramp, whole, colours"]);
    }
}

#[test]
fn what_is_no_image_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let files = [
        ("a.vti", "<VTKFile type=\"PolyData\"></VTKFile>", "PolyData"),
        ("a.pvti", "<VTKFile type=\"PImageData\"></VTKFile>", "lists the pieces of an image"),
        ("b.vti", "<VTKFile type=\"ImageData\" compressor=\"vtkLZMADataCompressor\"></VTKFile>", "LZMA"),
        ("c.vtk", "# vtk DataFile Version 3.0\nt\nBINARY\nDATASET RECTILINEAR_GRID\n", "RECTILINEAR_GRID"),
        (
            "d.vti",
            "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 3 0 3 0 3\"><Piece Extent=\"0 1 0 3 0 3\">",
            "pieces",
        ),
        ("e.vti", "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 3 0 3 0 3\">", "at least one"),
        // An unterminated comment behind the end of another tag.
        ("f.vti", "<VTKFile type=\"ImageData\"><!-- <Piece>", "tags of at most 64 KiB"),
    ];
    for (name, text, word) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        assert_refused(opened(&path), &[word]);
    }
    assert_refused(opened(&written("appended-lzma-32-le.vti")), &["vtkLZMADataCompressor", "zlib or LZ4", "ParaView"]);
}

/// VTK writes u8 voxels to text files as colours, in fractions of 255.
#[test]
fn bytes_that_vtk_writes_as_text() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bytes.vtk");
    let head = "# vtk DataFile Version 5.1\nvtk output\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 1\nSPACING 0.5 0.6 2\n\
                ORIGIN 1 2 3\nPOINT_DATA 6\nCOLOR_SCALARS v 1\n";
    // As VTK 9.7 writes 4, 42, 106, 129, 0 and 255.
    std::fs::write(&path, format!("{head}0.0156863 0.164706 0.415686 \n0.505882 0 1 \n")).unwrap();
    let source = opened(&path).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((source.info().dims, source.info().voxel_type), (Dims([3, 2, 1]), VoxelType::U8));
    check_boxes(source.as_ref(), &[4, 42, 106, 129, 0, 255], 3);
    for wrong in ["0.1 0.2 0.3 0.4 0.5 1.5", "0.1 0.2 0.3 0.4 0.5 -1", "0.1 0.2 0.3 0.4 0.5 nan", "0.1 0.2"] {
        std::fs::write(&path, format!("{head}{wrong}\n")).unwrap();
        assert_refused(opened(&path).map(|_| ()), &["text data"]);
    }
}
