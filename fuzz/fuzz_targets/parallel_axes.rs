//! See `redundancy_fuzz::numeric::parallel_axes`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::numeric::parallel_axes(data));
