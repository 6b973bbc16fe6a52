//! The RadTransfer stage by either method, as [`crate::transfer::TransferStage`].

use crate::config::Settings;
use crate::gpu::stages::{
    GpuBuffers, GpuIndirectMap, GpuRadiance, GpuTransferMap, GpuVolume, TracedTransferPass,
    TransferPass,
};
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer};
use crate::image::Size;
use crate::pipeline::PipelineError;
use crate::scene::VirtualScene;
use crate::transfer::{DirectionSet, TransferMethod, TransferParams};

/// Pixels from one point of the transfer's grid to the next.
pub fn grid_step(params: &TransferParams) -> usize {
    match params.method {
        TransferMethod::ImageSpace => params.subsampling,
        TransferMethod::RayTraced => params.result_step(),
    }
}

/// The real scene, as a volume and as geometry buffers. Each method takes what it needs.
#[derive(Clone, Copy)]
pub struct RealScene<'a> {
    pub volume: &'a GpuVolume,
    pub buffers: GpuBuffers<'a>,
}

/// Virtual objects, and the buffers of the real scene with these drawn into them.
#[derive(Clone, Copy)]
pub struct MergedScene<'a> {
    pub objects: &'a VirtualScene,
    pub buffers: GpuBuffers<'a>,
    /// What leaves the buffers' pixels; without it there is no bounce.
    pub radiance: Option<GpuRadiance<'a>>,
}

pub enum GpuTransferStage {
    ImageSpace(Box<TransferPass>),
    RayTraced(Box<Traced>),
}

/// Its pass is made for the size of the volume, which is known when there is one.
pub struct Traced {
    params: TransferParams,
    set: DirectionSet,
    image: Size,
    pass: Option<TracedTransferPass>,
}

impl Traced {
    fn pass(&mut self, gpu: &Gpu, volume: &GpuVolume) -> Result<&mut TracedTransferPass, GpuError> {
        let Self { params, set, image, pass } = self;
        let made = match pass.take() {
            Some(made) => made,
            None => TracedTransferPass::new(gpu, params, set, volume, *image)?,
        };
        Ok(pass.insert(made))
    }
}

impl GpuTransferStage {
    pub fn new(gpu: &Gpu, settings: &Settings, image: Size) -> Result<Self, PipelineError> {
        let Settings { transfer: params, bounce, .. } = settings;
        bounce.check_with(params)?;
        let set = DirectionSet::new(params)?;
        Ok(match params.method {
            TransferMethod::ImageSpace => {
                Self::ImageSpace(Box::new(TransferPass::new(gpu, params, bounce, &set)?))
            }
            TransferMethod::RayTraced => {
                let params = params.clone();
                Self::RayTraced(Box::new(Traced { params, set, image, pass: None }))
            }
        })
    }

    /// Transfer of the real scene.
    pub fn transfer(
        &mut self,
        commands: &mut Commands<'_>,
        real: RealScene,
        out: &GpuTransferMap,
    ) -> Result<(), GpuError> {
        match self {
            Self::ImageSpace(pass) => pass.transfer(commands, real.buffers, out),
            Self::RayTraced(traced) => {
                let pass = traced.pass(commands.gpu(), real.volume)?;
                pass.transfer(commands, real.volume, real.buffers.0, out)
            }
        }
    }

    /// Transfer of the real scene and virtual objects together, and one bounce of light; `real_transfer` is
    /// what the last call of [`Self::transfer`] made of `real`. Ray-traced transfer has no bounce and leaves
    /// `indirect` as it is.
    pub fn transfer_and_bounce(
        &mut self,
        commands: &mut Commands<'_>,
        real: RealScene,
        merged: MergedScene,
        real_transfer: &GpuTransferMap,
        out: &GpuTransferMap,
        indirect: &GpuIndirectMap,
    ) -> Result<(), GpuError> {
        match self {
            Self::ImageSpace(pass) => pass.transfer_and_bounce(
                commands,
                merged.buffers,
                merged.radiance,
                real_transfer,
                out,
                indirect,
            ),
            Self::RayTraced(traced) => {
                let main: (&GpuGBuffer, &GpuGBuffer) = (real.buffers.0, merged.buffers.0);
                let pass = traced.pass(commands.gpu(), real.volume)?;
                let (volume, objects) = (real.volume, merged.objects);
                pass.transfer_with_virtual(commands, volume, objects, main, real_transfer, out)
            }
        }
    }
}
