#![no_main]
//! See `supervol_tests::fuzz_bodies::codec_trimmed`.

libfuzzer_sys::fuzz_target!(|data: &[u8]| supervol_tests::fuzz_bodies::codec_trimmed(data));
