//! See `redundancy_fuzz::numeric::panda_class`.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| redundancy_fuzz::numeric::panda_class(data));
