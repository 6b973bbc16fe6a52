//! The volume and its views.

use super::{Bench, ParityError, normals_of_both};
use crate::capture::RgbdFrame;
use crate::fusion::TsdfVolume;
use crate::geometry::GBuffer;
use crate::gpu::Gpu;
use crate::gpu::stages::{FramePictures, GpuVolume, RayCaster};
use crate::math::View;
use crate::parity::tolerances::*;

/// A volume on the device, made of what the CPU's is made of: prepared frames and the CPU's poses.
#[derive(Default)]
pub struct Fused(Option<GpuVolume>);

impl Fused {
    /// Integrates the frame that was the newest to enter `cpu`.
    pub fn follow(
        &mut self,
        gpu: &Gpu,
        cpu: &TsdfVolume,
        frame: &RgbdFrame,
        view: &View,
    ) -> Result<(), ParityError> {
        // the map was begun anew where this is not its next revision
        let volume = match self.0.take() {
            Some(volume) if volume.revision() + 1 == cpu.revision() => volume,
            _ => GpuVolume::new(gpu, cpu.params(), *cpu.lattice())?,
        };
        let volume = self.0.insert(volume);
        let pictures = FramePictures::new(gpu, frame.depth_m.size())?;
        pictures.upload(gpu, frame);
        let mut commands = gpu.commands();
        volume.integrate(&mut commands, &pictures, frame.index, view)?;
        Ok(commands.submit()?)
    }

    /// None before the first frame.
    pub fn volume(&self) -> Option<&GpuVolume> {
        self.0.as_ref()
    }
}

/// Every voxel of the two volumes, which were made of the same frames.
pub fn fusion(bench: &mut Bench, cpu: &TsdfVolume, gpu: &TsdfVolume) {
    let [cpu, gpu] = Voxels::of(cpu, gpu);
    let Bench { ledger, frame, .. } = bench;
    ledger.compare(&FUSION_DISTANCE, *frame, &cpu.distances, &gpu.distances);
    ledger.compare(&FUSION_WEIGHT, *frame, &cpu.weights, &gpu.weights);
    ledger.compare(&FUSION_COLOR, *frame, &cpu.colors, &gpu.colors);
}

/// By block; no number where one has a block that the other has not.
#[derive(Default)]
struct Voxels {
    distances: Vec<f32>,
    weights: Vec<f32>,
    colors: Vec<f32>,
}

impl Voxels {
    fn of(cpu: &TsdfVolume, gpu: &TsdfVolume) -> [Self; 2] {
        let [cpu, gpu] = [cpu, gpu].map(TsdfVolume::stored_blocks);
        let (mut a, mut b) = (cpu.iter().peekable(), gpu.iter().peekable());
        let mut out = [Self::default(), Self::default()];
        loop {
            let index = match (a.peek(), b.peek()) {
                (Some(a), Some(b)) => a.index.min(b.index),
                (Some(block), None) | (None, Some(block)) => block.index,
                (None, None) => return out,
            };
            let of_both = [a.next_if(|a| a.index == index), b.next_if(|b| b.index == index)];
            for (out, block) in out.iter_mut().zip(of_both) {
                out.push(block, of_both.into_iter().flatten().any(|block| block.color.is_some()));
            }
        }
    }

    fn push(&mut self, block: Option<&crate::fusion::stored::StoredBlock>, colored: bool) {
        use crate::fusion::block::VOXELS;
        let missing = std::iter::repeat_n(f32::NAN, VOXELS);
        match block {
            Some(block) => {
                self.distances.extend(block.tsdf.iter().map(|&d| f32::from(d)));
                self.weights.extend(block.weight.iter().map(|&w| f32::from(w)));
            }
            None => {
                self.distances.extend(missing.clone());
                self.weights.extend(missing.clone());
            }
        }
        match block.and_then(|block| block.color.as_ref()) {
            Some(color) => self.colors.extend(color.as_flattened().iter().map(|&c| f32::from(c))),
            None if colored => self.colors.extend(std::iter::repeat_n(f32::NAN, 4 * VOXELS)),
            None => {}
        }
    }
}

/// These views of the device's volume, whose voxels `cpu` holds: it is rays alone that differ.
pub fn raycast(
    bench: &mut Bench,
    volume: &GpuVolume,
    cpu: &TsdfVolume,
    views: impl IntoIterator<Item = View>,
) -> Result<(), ParityError> {
    for view in views {
        let mut expected = GBuffer::empty(view);
        cpu.raycast(&view, &mut expected);
        let mut caster = RayCaster::new(bench.gpu, view.size())?;
        let mut out = crate::gpu::GpuGBuffer::empty(bench.gpu, view)?;
        bench.run(|commands| caster.cast(commands, volume, &view, &mut out))?;
        let found = out.download(bench.gpu)?;
        let (cpu, gpu) = (expected.depth_m.as_slice(), found.depth_m.as_slice());
        bench.ledger.compare(&RAYCAST_DEPTH, bench.frame, cpu, gpu);
        let [cpu, gpu] = normals_of_both(&expected, &found);
        bench.ledger.compare(&RAYCAST_NORMAL, bench.frame, &cpu, &gpu);
    }
    Ok(())
}
