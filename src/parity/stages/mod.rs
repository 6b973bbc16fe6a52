//! Each stage of the GPU alone: it gets what the CPU's stage got, and gives what is compared with the CPU's.

mod camera;
mod light;
mod map;
mod objects;
mod transfer;

pub use camera::{input, tracking};
pub use light::{dyn_geo, light};
pub use map::{Fused, fusion, raycast};
pub(in crate::parity) use objects::codes;
pub use objects::{compositing, exitant, raster};
pub use transfer::transfer;

use super::{Ledger, ParityError};
use crate::config::Settings;
use crate::geometry::GBuffer;
use crate::gpu::{Commands, Gpu, GpuError};

/// Where a frame is compared, and what is found.
pub struct Bench<'a> {
    pub gpu: &'a Gpu,
    pub settings: &'a Settings,
    pub ledger: &'a mut Ledger,
    /// Number of the frame, for the report.
    pub frame: usize,
}

impl Bench<'_> {
    fn run(
        &self,
        record: impl FnOnce(&mut Commands<'_>) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let mut commands = self.gpu.commands();
        record(&mut commands)?;
        commands.submit()
    }
}

fn normals(buffer: &GBuffer) -> Vec<f32> {
    let n = &buffer.normals;
    [n.x.as_slice(), n.y.as_slice(), n.z.as_slice()].concat()
}

/// Normals of pixels that both have a surface: whether there is one, depth tells.
fn normals_of_both(cpu: &GBuffer, gpu: &GBuffer) -> [Vec<f32>; 2] {
    let pairs = cpu.depth_m.as_slice().iter().zip(gpu.depth_m.as_slice());
    let both: Vec<usize> =
        pairs.enumerate().filter(|(_, (a, b))| **a > 0.0 && **b > 0.0).map(|(i, _)| i).collect();
    [cpu, gpu].map(|buffer| {
        let n = &buffer.normals;
        let axes = [n.x.as_slice(), n.y.as_slice(), n.z.as_slice()];
        axes.iter().flat_map(|axis| both.iter().map(|&i| axis[i])).collect()
    })
}

fn origins(buffer: &GBuffer) -> Vec<f32> {
    buffer.origin.as_slice().iter().map(|&origin| f32::from(origin as u8)).collect()
}
