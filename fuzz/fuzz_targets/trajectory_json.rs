//! See `redundancy_fuzz::readers::trajectory_json`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::readers::trajectory_json(data));
