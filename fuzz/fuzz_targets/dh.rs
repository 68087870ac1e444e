//! See `redundancy_fuzz::readers::dh`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::readers::dh(data));
