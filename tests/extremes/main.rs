//! Every stage at the ends of its inputs and past them, on both backends from one body, as a table.
//!
//! `cargo test --test extremes [-- [--markdown] [--cpu] FILTER]`: cases whose stage or name contain FILTER; `--cpu`,
//! or `KINLIGHT_EXTREMES=cpu`, without a GPU, as a rule in a fifth of the time.

mod checks;
mod frames;
mod models;
mod runs;
mod table;

mod colours;
mod depths;
mod lights;
mod objects;
mod poses;
mod presets;
mod settings;
mod sizes;
mod stages;
mod storage;
mod volumes;

use std::process::ExitCode;
use table::{Layout, Table};

fn main() -> ExitCode {
    let (flags, filters): (Vec<_>, Vec<_>) =
        std::env::args().skip(1).partition(|arg| arg.starts_with('-'));
    let given = |name: &str| flags.iter().any(|flag| flag == name);
    let layout = if given("--markdown") { Layout::Markdown } else { Layout::Columns };
    let on_cpu = std::env::var("KINLIGHT_EXTREMES").is_ok_and(|v| v == "cpu") || given("--cpu");
    let mut table = Table::new(filters.into_iter().next(), layout, !on_cpu);
    depths::cases(&mut table);
    sizes::cases(&mut table);
    colours::cases(&mut table);
    poses::cases(&mut table);
    volumes::cases(&mut table);
    storage::cases(&mut table);
    lights::cases(&mut table);
    objects::cases(&mut table);
    presets::cases(&mut table);
    settings::cases(&mut table);
    stages::add_cases(&mut table);
    if table.finish() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
