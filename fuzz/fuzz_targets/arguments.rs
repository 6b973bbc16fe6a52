//! The command line, parsed and never run. It belongs to the program, so its sources are taken in here.

#![no_main]

#[allow(dead_code, unused_imports)]
#[path = "../../src/cli/mod.rs"]
mod cli;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    cli::parses(data);
});
