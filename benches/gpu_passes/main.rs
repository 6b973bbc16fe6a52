//! Every pass of the GPU pipeline at 640x480 with 256 voxels a side, on the demo sequence: what it takes here,
//! what it does, and what that would take at least on GPUs with published figures.
//!
//! ```text
//! cargo bench --bench gpu_passes                      # four presets
//! cargo bench --bench gpu_passes -- ours raster       # rows of one preset whose name contains "raster"
//! cargo bench --bench gpu_passes -- --kernels         # a row for each shader
//! cargo bench --bench gpu_passes -- --frames 9 --adapter NVIDIA
//! ```
//!
//! Times are the device's own where it has timestamps and is no software; else the host's around submitting one
//! pass and waiting for it. Nothing is asserted.

mod arguments;
mod rows;
mod run;
mod tables;

use arguments::Arguments;
use kinlight::gpu::Gpu;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::parse(std::env::args().skip(1))?;
    let gpu = match Gpu::open_for_profile(&arguments.adapter) {
        Ok(gpu) => Arc::new(gpu),
        Err(error) => {
            println!("Nothing is measured: {error}");
            return Ok(());
        }
    };
    println!("Adapter: {}.", gpu.summary());
    println!(
        "Times of passes: {}.\n",
        match gpu.tells_pass_times() {
            true => "device timestamps",
            false => "host clock around submitting one pass and waiting for it",
        }
    );
    let mut runs = run::Runs::start(gpu, arguments.frames)?;
    for preset in &arguments.presets {
        let measured = runs.measure(preset)?;
        println!("## `{preset}`\n");
        tables::print_stages(&measured);
        tables::print_passes(&measured, &arguments);
    }
    Ok(())
}
