//! See `redundancy_fuzz::readers::mesh`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::readers::mesh(data));
