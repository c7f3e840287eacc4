//! Damaged VTK images of every variant that VTK writes cause no panic and no large allocation.

use std::path::Path;

use supervol_sources::open::{OpenOptions, open};

use crate::grid_support;
use grid_support::{fuzz_header, largest_allocation};

#[test]
fn damaged_files() {
    let folder = tempfile::tempdir().unwrap();
    let written = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/vtk");
    for entry in std::fs::read_dir(written).unwrap() {
        let path = entry.unwrap().path();
        let file = std::fs::read(&path).unwrap();
        if path.to_string_lossy().contains("lzma") {
            continue; // Refused even undamaged.
        }
        let damaged = if path.extension().is_some_and(|end| end == "vtk") { "v.vtk" } else { "v.vti" };
        fuzz_header(folder.path(), damaged, &file, file.len(), 1500, |path| open(path, &OpenOptions::default()));
    }
    let largest = largest_allocation::largest_bytes();
    assert!(largest < 16 << 20, "{largest} bytes at once");
}
