#![no_main]
//! Fuzz target with the body `supervol_tests::fuzz_bodies::codec_tree`.

libfuzzer_sys::fuzz_target!(|data: &[u8]| supervol_tests::fuzz_bodies::codec_tree(data));
