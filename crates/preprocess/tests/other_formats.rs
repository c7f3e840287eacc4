//! Formats that are not read say which they are, and what converts them.

#![allow(clippy::unwrap_used, reason = "tests fail loudly")]

mod grid_support;

use std::path::Path;

use grid_support::assert_refused;
use supervol_preprocess::source::open::{OpenOptions, open};

fn refused(path: &Path, words: &[&str]) {
    assert_refused(open(path, &OpenOptions::default()).map(|_| ()), words);
}

#[test]
fn files_are_known_by_their_first_bytes_or_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let dicom = |preamble: &[u8]| [preamble, &vec![0; 128 - preamble.len()], b"DICM\x02\0\0\0"].concat();
    let files: [(&str, Vec<u8>, &str); 10] = [
        ("a", dicom(b""), "DICOM"),
        // Some programs write a TIFF's beginning before the mark.
        ("b", dicom(b"II*\0\x08\0\0\0"), "DICOM"),
        ("c", b"\x89HDF\r\n\x1a\n".to_vec(), "h5py"),
        ("d", b"PK\x03\x04".to_vec(), "unzip"),
        ("e", b"# vtk DataFile Version 3.0".to_vec(), "ParaView"),
        ("f", b"\x1f\x8b\x08".to_vec(), "unpack"),
        ("g.czi", vec![0; 9], "Bio-Formats"),
        ("h.mgz", vec![0; 9], "mri_convert"),
        ("i.svol", supervol_format::container::header::MAGIC.to_vec(), "supervol render"),
        ("j.su", vec![0; 300], "segywrite"),
    ];
    for (name, bytes, word) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        refused(&path, &["which is not read", word]);
    }
    let unknown = folder.path().join("unknown");
    std::fs::write(&unknown, [9; 20]).unwrap();
    refused(&unknown, &["MetaImage", "TIFF", "--dims"]);
}

#[test]
fn folders_are_known_by_what_they_hold() {
    for (file, bytes, word) in [
        (".zgroup", &b"{}"[..], "Zarr"),
        ("zarr.json", b"{}", "Zarr"),
        ("attributes.json", b"{}", "N5"),
        ("slice_001.TIF", b"", "Image Sequence"),
        ("x.png", b"", "picture"),
        ("IM0001", &[&[0; 128][..], b"DICM"].concat(), "dcm2niix"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(file), bytes).unwrap();
        refused(folder.path(), &["folder", word]);
    }
    // What is none of these is no file, as before.
    let error = open(tempfile::tempdir().unwrap().path(), &OpenOptions::default()).err().unwrap().to_string();
    assert!(error.contains("found a folder"), "{error}");
}
