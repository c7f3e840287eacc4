//! Damaged npy headers cause no panic and no large allocation.

use supervol_sources::formats::npy::NpySource;

use crate::grid_support;
use grid_support::{fuzz_header, largest_allocation};

#[test]
fn damaged_headers() {
    let folder = tempfile::tempdir().unwrap();
    for (version, order) in [(1, "False"), (2, "True")] {
        let dict = format!("{{'descr': '<f4', 'fortran_order': {order}, 'shape': (3, 4, 5), }}   \n");
        let mut file = b"\x93NUMPY".to_vec();
        file.extend([version, 0, dict.len() as u8, 0]);
        if version == 2 {
            file.extend([0, 0]);
        }
        file.extend(dict.as_bytes());
        let header_bytes = file.len();
        file.extend([1; 240]);
        let name = format!("version{version}.npy");
        fuzz_header(folder.path(), &name, &file, header_bytes, 5000, |path| Ok(Box::new(NpySource::open(path)?)));
    }
    assert!(largest_allocation::largest_bytes() < 4 << 20, "{} bytes at once", largest_allocation::largest_bytes());
}
