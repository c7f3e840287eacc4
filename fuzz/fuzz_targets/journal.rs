#![no_main]
//! See `supervol_tests::fuzz_bodies::journal`.

libfuzzer_sys::fuzz_target!(|data: &[u8]| supervol_tests::fuzz_bodies::journal(data));
