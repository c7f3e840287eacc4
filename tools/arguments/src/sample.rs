//! Sample volume, built into the program.

/// CT of a carp, a NIfTI file; scan by M. Scheuring, University of Erlangen; BSD-2-Clause; see `tests/data/README.md`.
pub const CARP: &[u8] = include_bytes!("../../../tests/data/carp_ct.nii.gz");
