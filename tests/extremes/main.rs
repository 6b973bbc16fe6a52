//! Every stage at the ends of its inputs and past them, on both backends from one body, as a table.
//!
//! `cargo test --test extremes [-- FILTER]`: cases whose stage or name contain FILTER.

mod stages;
mod table;

use std::process::ExitCode;
use table::Table;

fn main() -> ExitCode {
    let filter = std::env::args().skip(1).find(|arg| !arg.starts_with('-'));
    let mut table = Table::new(filter);
    stages::add_cases(&mut table);
    if table.finish() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
