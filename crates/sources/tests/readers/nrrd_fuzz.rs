//! Damaged NRRD headers cause no panic and no large allocation.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;
use supervol_sources::formats::nrrd::NrrdSource;
use supervol_sources::input::spool::SpoolFolder;

use crate::grid_support;
use grid_support::{fuzz_header, largest_allocation};

const HEADER: &str = "NRRD0004\n# by hand\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: 4 3 2\n\
    space directions: (1,0,0) (0,2.5,0) (0,0,-1)\nkinds: domain domain domain\nendian: big\nbyte skip: 0\n\
    space origin: (0,1e3,0)\n";

#[test]
fn damaged_headers() {
    let folder = tempfile::tempdir().unwrap();
    let spool = SpoolFolder::at(folder.path());
    let open = |path: &std::path::Path| -> Result<Box<dyn supervol_sources::VolumeSource>, _> {
        Ok(Box::new(NrrdSource::open(path, &spool)?))
    };
    let voxels = [7; 48];
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&voxels).unwrap();
    let compressed = encoder.finish().unwrap();
    let numbers = "1 2 ".repeat(12);
    for (encoding, data) in [("raw", &voxels[..]), ("gzip", &compressed), ("ascii", numbers.as_bytes())] {
        let header = format!("{HEADER}encoding: {encoding}\n\n");
        let file = [header.as_bytes(), data].concat();
        fuzz_header(folder.path(), &format!("{encoding}.nrrd"), &file, header.len(), 5000, open);
    }
    for (number, slice) in voxels.chunks(24).enumerate() {
        std::fs::write(folder.path().join(format!("s{number}.raw")), slice).unwrap();
    }
    for files in ["s%d.raw 0 1 1\n", "LIST\ns0.raw\ns1.raw\n"] {
        let header = format!("{HEADER}encoding: raw\ndata file: {files}");
        fuzz_header(folder.path(), "parts.nhdr", header.as_bytes(), header.len(), 5000, open);
    }
    assert!(largest_allocation::largest_bytes() < 8 << 20, "{} bytes at once", largest_allocation::largest_bytes());
}
