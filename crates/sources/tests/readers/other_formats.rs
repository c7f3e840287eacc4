//! Unsupported formats are refused by name, with a conversion.

use std::path::Path;

use supervol_sources::open::{OpenOptions, open};

use crate::grid_support;
use grid_support::assert_refused;

fn refused(path: &Path, words: &[&str]) {
    assert_refused(open(path, &OpenOptions::default()).map(|_| ()), words);
}

#[test]
fn files_are_known_by_their_first_bytes_or_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let files: [(&str, Vec<u8>, &str); 16] = [
        ("c", b"CDF\x01".to_vec(), "nccopy -k nc4"),
        ("d", b"PK\x03\x04".to_vec(), "`unzip "),
        ("e.vtu", b"<VTKFil".to_vec(), "ParaView"),
        ("f", b"\x1f\x8b\x08".to_vec(), "unpack"),
        ("g.czi", vec![0; 9], "Bio-Formats"),
        ("h.mgz", vec![0; 9], "h.mgz OUT.nii.gz`"),
        ("i.svol", supervol_format::container::header::MAGIC.to_vec(), "supervol render"),
        ("j.su", vec![0; 300], "segywrite"),
        // For a compressed file, the name tells more than the first bytes.
        ("k.mgz", b"\x1f\x8b\x08".to_vec(), "mri_convert"),
        ("l.tar.gz", b"\x1f\x8b\x08".to_vec(), "an archive of files"),
        ("m", b"SIMPLE  =                    T".to_vec(), "astropy"),
        ("n.xdmf", b"<?xml version=\"1.0\"?><Xdmf/>".to_vec(), "FILE.h5:/PATH"),
        ("o.hdr", b"ENVI\nsamples = 3".to_vec(), "gdal_translate"),
        ("p", b"#INRIMAGE-4#{\n".to_vec(), "`header_bytes` 256"),
        ("q", b"# === DATA DESCRIPTION FILE ===".to_vec(), "parrec2nii"),
        ("r", b"PVM\n4 4 4\n".to_vec(), "pvm2raw"),
    ];
    for (name, bytes, word) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        refused(&path, &["which is not read", word]);
    }
    // DICOM is supported; some programs write the beginning of a TIFF before its mark.
    for preamble in [&[][..], b"II*\0\x08\0\0\0"] {
        let path = folder.path().join("dicom");
        let mark = &b"DICM\x02\0\0\0"[..];
        std::fs::write(&path, [preamble, &vec![0; 128 - preamble.len()], mark].concat()).unwrap();
        refused(&path, &["transfer syntax"]);
    }
    for name in ["zarr.json", ".zattrs", "attributes.json"] {
        let path = folder.path().join(name);
        std::fs::write(&path, b"{}").unwrap();
        refused(&path, &["describes the Zarr or N5", &format!("give the folder: {}", folder.path().display())]);
    }
    let unknown = folder.path().join("unknown");
    std::fs::write(&unknown, [9; 20]).unwrap();
    refused(&unknown, &["MetaImage", "TIFF", "`dims`"]);
}

#[test]
fn folders_are_known_by_what_they_hold() {
    for (file, bytes, word) in [
        ("layout.bin", &b""[..], "seismic store"),
        ("slice_001.TIF", b"", "neither DICOM, pictures nor SEG-Y"),
        ("x.png", b"", "neither DICOM, pictures nor SEG-Y"),
        ("IM0001", &[&[0; 128][..], b"DICM"].concat(), "transfer syntax"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(file), bytes).unwrap();
        refused(folder.path(), &[word]);
    }
    refused(tempfile::tempdir().unwrap().path(), &["a folder without files"]);
}
