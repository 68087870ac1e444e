//! See `redundancy_fuzz::numeric::velocity`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::numeric::velocity(data));
