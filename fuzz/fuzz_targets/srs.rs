//! See `redundancy_fuzz::numeric::srs`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::numeric::srs(data));
