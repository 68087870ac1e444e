//! See `redundancy_fuzz::readers::path_csv`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::readers::path_csv(data));
