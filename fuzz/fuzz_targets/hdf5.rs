#![no_main]
//! Fuzz target with the body `supervol_tests::fuzz_bodies::hdf5`.

libfuzzer_sys::fuzz_target!(|data: &[u8]| supervol_tests::fuzz_bodies::hdf5(data));
