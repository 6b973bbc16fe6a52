#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| kinlight_fuzz::run("frames", data));
