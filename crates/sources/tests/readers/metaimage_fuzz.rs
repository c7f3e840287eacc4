//! Damaged MetaImage headers cause no panic and no large allocation.

use std::io::Write;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use supervol_sources::formats::metaimage::{MetaImageSource, Outside};
use supervol_sources::input::spool::SpoolFolder;

use crate::grid_support;
use grid_support::{fuzz_header, largest_allocation};

const HEADER: &str = "ObjectType = Image\nNDims = 3\nTransformMatrix = 1 0 0 0 0 1 0 -1 0\nOffset = 1 -2 1e3\n\
    ElementSpacing = 1 2.5 1\nDimSize = 4 3 2\nHeaderSize = 0\nElementType = MET_SHORT\n";

#[test]
fn damaged_headers() {
    let folder = tempfile::tempdir().unwrap();
    let spool = SpoolFolder::at(folder.path());
    let open = |path: &std::path::Path| -> Result<Box<dyn supervol_sources::VolumeSource>, _> {
        Ok(Box::new(MetaImageSource::open(path, &spool, Outside::Refused)?))
    };
    let voxels = [7; 48];
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&voxels).unwrap();
    let compressed = encoder.finish().unwrap();
    let numbers = "1 2 ".repeat(12);
    for (fields, data) in [
        ("BinaryDataByteOrderMSB = True\n", &voxels[..]),
        ("CompressedData = True\n", &compressed),
        ("BinaryData = False\n", numbers.as_bytes()),
    ] {
        let header = format!("{HEADER}{fields}ElementDataFile = LOCAL\n");
        let file = [header.as_bytes(), data].concat();
        fuzz_header(folder.path(), "v.mha", &file, header.len(), 5000, open);
    }
    for (number, slice) in voxels.chunks(24).enumerate() {
        std::fs::write(folder.path().join(format!("s{number}.raw")), slice).unwrap();
    }
    for files in ["s%d.raw 0 1 1\n", "LIST\ns0.raw\ns1.raw\n"] {
        let header = format!("{HEADER}ElementDataFile = {files}");
        fuzz_header(folder.path(), "parts.mhd", header.as_bytes(), header.len(), 5000, open);
    }
    assert!(largest_allocation::largest_bytes() < 8 << 20, "{} bytes at once", largest_allocation::largest_bytes());
}
