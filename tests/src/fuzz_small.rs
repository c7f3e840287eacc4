//! Fuzz bodies that cover several small readers each. The lowest bit of the mode byte has the meaning of
//! [`super::fuzz_bodies`]: file, or edits of a valid one. The higher bits choose the reader.

#[cfg(feature = "pictures")]
use std::path::Path;

use crate::fuzz_bodies::{Body, in_a_file, read_some_of_any, whole_file};

/// A kind of file that a body covers: its name, and a valid example.
pub type Kind = (&'static str, &'static [u8]);

const ARCHIVES: [Kind; 4] = [
    ("fuzz.npz", include_bytes!("../data/fuzz/stored.npz")),
    ("fuzz.npz", include_bytes!("../data/fuzz/deflated.npz")),
    ("fuzz.zarr.zip", include_bytes!("../data/fuzz/stored.zarr.zip")),
    ("fuzz.zarr.zip", include_bytes!("../data/fuzz/deflated.zarr.zip")),
];

const SLICES: [Kind; 3] = [
    ("2.png", include_bytes!("../data/fuzz/grey.png")),
    ("2.jpg", include_bytes!("../data/grey.jpg")),
    ("2.tif", include_bytes!("../data/fuzz/half.tif")),
];

const VIEWERS: [Kind; 1] = [("fuzz.xml", VIEWER_XML.as_bytes())];

/// The voxel file that a `BigDataViewer` XML refers to.
pub const VIEWER_DATA: Kind = ("fuzz.h5", include_bytes!("../data/fuzz/viewer.h5"));

/// A `BigDataViewer` XML with voxels in `fuzz.h5`.
const VIEWER_XML: &str = "<?xml version=\"1.0\"?><SpimData version=\"0.2\"><BasePath type=\"relative\">.</BasePath><SequenceDescription>\
<ImageLoader format=\"bdv.hdf5\"><hdf5 type=\"relative\">fuzz.h5</hdf5></ImageLoader><ViewSetups><ViewSetup><id>0</id><voxelSize>\
<unit>um</unit><size>0.5 0.25 2.0</size></voxelSize></ViewSetup></ViewSetups></SequenceDescription><ViewRegistrations>\
<ViewRegistration timepoint=\"0\" setup=\"0\"><ViewTransform type=\"affine\"><affine>0.5 0 0 10 0 0.25 0 20 0 0 2 30</affine>\
</ViewTransform></ViewRegistration></ViewRegistrations></SpimData>";

#[cfg(feature = "pictures")]
const SCENE_FILES: [Kind; 6] = [
    (
        "fuzz.ply",
        b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 4\n\
          property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n",
    ),
    (
        "fuzz.stl",
        b"solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet\n\
          facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet\n\
          facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\nendfacet\n\
          facet normal 0 0 0\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet\nendsolid a\n",
    ),
    ("fuzz.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1/1 2/2 4/3\nf 1//1 4//1 3//1\nf -3 -2 -1\n"),
    ("fuzz.1dt", b"4\n0.0 0.0 0.0 0.0\n0.2 0.1 0.0 0.1\n0.6 0.5 0.4 0.5\n1.0 1.0 1.0 0.9\n"),
    (
        "fuzz.json",
        b"[{\"ColorSpace\": \"Lab\", \"Name\": \"two ramps\", \"NanColor\": [1, 1, 0], \"RGBPoints\": [0, 0, 0, 0, 100, 1, 0, 0, 200, 1, 1, 1],\
          \"Points\": [0, 0, 0.5, 0, 50, 0.2, 0.25, 0, 150, 1, 0.5, 0]}]",
    ),
    (
        "own.json",
        b"{\"unit_distance\": 2.5, \"points\": [{\"value\": -1.0, \"color\": [0.1, 0.2, 0.3], \"alpha\": 0.0},\
          {\"value\": 4.0, \"color\": [1.0, 0.5, 0.0], \"alpha\": 0.25}]}",
    ),
];

/// Reads archives of NumPy arrays and of Zarr, stored and deflated.
pub fn archives(data: &[u8]) {
    let (name, bytes) = chosen(&ARCHIVES, data);
    in_a_file(name, &bytes, read_some_of_any);
}

/// Reads a folder of two slices with the second one damaged: PNG, JPEG, or TIFF of half-precision floats.
pub fn slices(data: &[u8]) {
    let (name, bytes) = chosen(&SLICES, data);
    in_a_file(name, &bytes, |path, spool| {
        let folder = path.parent().expect("the file lies in a folder");
        let (_, valid) = SLICES.iter().find(|kind| kind.0 == name).expect("the name is of one of these");
        std::fs::write(folder.join(name.replace('2', "1")), valid).expect("room for a small file");
        read_some_of_any(folder, spool);
        read_some_of_any(path, spool);
    });
}

/// Reads a `BigDataViewer` XML file beside a valid HDF5 file.
pub fn viewer_xml(data: &[u8]) {
    let (name, bytes) = chosen(&VIEWERS, data);
    in_a_file(name, &bytes, |path, spool| {
        std::fs::write(path.with_file_name(VIEWER_DATA.0), VIEWER_DATA.1).expect("room for a small file");
        read_some_of_any(path, spool);
    });
}

/// Reads files that scenes refer to: meshes, transfer functions and colour maps, our own and other programs' formats.
#[cfg(feature = "pictures")]
pub fn scene_files(data: &[u8]) {
    use supervol_scene::clip::mesh_file;
    use supervol_scene::preset::transfer_file::TransferFile;

    let (name, bytes) = chosen(&SCENE_FILES, data);
    let is_mesh = ["ply", "stl", "obj"].iter().any(|end| name.ends_with(end));
    in_a_file(name, &bytes, |path: &Path, _| {
        if is_mesh {
            if let Ok(mesh) = mesh_file::read(path) {
                let crossings = mesh.crossings([-9.0, 0.2, 0.2].into(), [1.0, 0.0, 0.0].into());
                assert!(crossings.len().is_multiple_of(2) && crossings.is_sorted(), "{crossings:?}");
                assert!(crossings.iter().all(|t| t.is_finite()), "{crossings:?}");
            }
        } else if let Ok(file) = TransferFile::read(path) {
            for (at, color) in file.color_map().unwrap_or_default() {
                assert!(at.is_finite() && color.iter().all(|c| c.is_finite()), "{color:?} at {at}");
            }
        }
    });
}

/// Valid volume files of each kind: names and bytes. The last one needs `fuzz.h5` beside it.
#[must_use]
pub fn small_volumes() -> Vec<Kind> {
    [&ARCHIVES[..], &SLICES, &VIEWERS].concat()
}

/// Valid files of each kind that scenes refer to.
#[cfg(feature = "pictures")]
#[must_use]
pub fn small_scene_files() -> Vec<Kind> {
    SCENE_FILES.to_vec()
}

/// The kind of file that the mode byte chooses, and its bytes.
fn chosen(kinds: &[Kind], data: &[u8]) -> (&'static str, Vec<u8>) {
    let which = data.first().map_or(0, |mode| usize::from(mode >> 1));
    let (name, seed) = kinds[which % kinds.len()];
    (name, whole_file(data, seed))
}

/// Names, bodies and valid inputs of all kinds.
pub(crate) fn all() -> Vec<(&'static str, Body, Vec<Vec<u8>>)> {
    let whole = |kinds: &[Kind]| -> Vec<Vec<u8>> {
        kinds.iter().enumerate().map(|(which, (_, seed))| [&[(which as u8) << 1], *seed].concat()).collect()
    };
    vec![
        ("archives", archives as Body, whole(&ARCHIVES)),
        ("slices", slices, whole(&SLICES)),
        ("viewer_xml", viewer_xml, whole(&VIEWERS)),
        #[cfg(feature = "pictures")]
        ("scene_files", scene_files, whole(&SCENE_FILES)),
    ]
}
