//! See `redundancy_fuzz::readers::scene_json`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::readers::scene_json(data));
