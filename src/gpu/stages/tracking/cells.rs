//! Thumbnails of frames: the device makes the means of cells, the host what is compared.

use crate::gpu::stages::FramePictures;
use crate::gpu::{Commands, Constant, Gpu, GpuBuffer, GpuError, ReadBack, Shader, uniform};
use crate::tracking::{COLUMNS, MIN_CELL_DEPTH, ROWS, Thumbnail};

uniform! {
    struct CellsUniform {
        size: [u32; 2],
    }
}

const CELLS: usize = COLUMNS * ROWS;

pub(super) fn shader() -> Shader {
    Shader::new("tracking/cells")
        .with_u32("COLUMNS", COLUMNS)
        .with_u32("ROWS", ROWS)
        .with("MIN_CELL_DEPTH", Constant::F32(MIN_CELL_DEPTH))
}

pub(super) struct CellMeans {
    shader: Shader,
    /// Intensity of all cells, then depth.
    means: GpuBuffer<f32>,
    read_back: ReadBack<f32>,
}

impl CellMeans {
    pub fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            shader: shader(),
            means: GpuBuffer::new(gpu, "means of cells", 2 * CELLS)?,
            read_back: ReadBack::new(gpu, "means of cells", 2 * CELLS)?,
        })
    }

    /// Submits `commands`, and waits. The frame has pixels.
    pub fn thumbnail(
        &mut self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
    ) -> Result<Thumbnail, GpuError> {
        let size = [frame.size.width as u32, frame.size.height as u32];
        commands
            .pass(&self.shader)?
            .uniform(&CellsUniform { size })?
            .read(&frame.color)?
            .read(&frame.depth_m)?
            .write(&self.means)?
            .over_count(CELLS)?;
        self.read_back.request(commands, &self.means, 2 * CELLS);
        commands.flush()?;
        let mut means = self.read_back.take(commands.gpu())?.unwrap_or_default();
        let depth_m = means.split_off(CELLS);
        Ok(Thumbnail::from_cells(&means, depth_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::parity::Difference;
    use crate::gpu::stages::test_support::{gpu, upload_frame};
    use crate::gpu::stages::tracking::test_scene::{camera, corner_frame};

    #[test]
    fn thumbnails_equal_the_cpus() {
        let Some(gpu) = gpu() else { return };
        let mut cells = CellMeans::new(gpu).unwrap();
        // more pixels than cells, fewer, and a single one
        for (width, height) in [(160, 120), (67, 43), (5, 2), (1, 1)] {
            let mut frame = corner_frame(camera(width, height), 6);
            let special = [f32::NAN, f32::INFINITY, -1.0, f32::NEG_INFINITY, -0.0];
            for (i, special) in special.into_iter().cycle().take(width * height / 9).enumerate() {
                frame.depth_m.as_mut_slice()[9 * i] = special;
                frame.intensity.as_mut_slice()[9 * i + 3] = special;
            }
            // cells with too little depth
            for y in 0..height / 2 {
                for x in (0..width).filter(|x| x % 5 != 0) {
                    frame.depth_m[(x, y)] = 0.0;
                }
            }
            let cpu = Thumbnail::new(&frame);
            let gpu = cells.thumbnail(&mut gpu.commands(), &upload_frame(gpu, &frame)).unwrap();
            // two roundings of depths below 4 m
            let depth = Difference::of(&cpu.depth_m, &gpu.depth_m, 5e-7);
            // the same of intensities below 256 steps, in units of their standard deviation of about 20
            let intensity = Difference::of(&cpu.intensity, &gpu.intensity, 1e-5);
            assert!(depth.is_within(0.0), "{width}x{height} depth: {depth}");
            assert!(intensity.is_within(0.0), "{width}x{height} intensity: {intensity}");
            assert!(width < 2 || cpu.depth_m.iter().any(|&d| d > 0.0));
        }
    }
}
