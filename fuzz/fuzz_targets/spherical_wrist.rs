//! See `redundancy_fuzz::numeric::spherical_wrist`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::numeric::spherical_wrist(data));
