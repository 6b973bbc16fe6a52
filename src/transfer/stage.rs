//! The RadTransfer stage by either method.

use super::{
    BounceParams, IndirectMap, Radiance, RadianceTransfer, RayTracedTransfer, TransferError,
    TransferMap, TransferMethod, TransferParams,
};
use crate::fusion::TsdfVolume;
use crate::geometry::GBuffer;
use crate::scene::VirtualScene;

/// The real scene, as a volume and as geometry buffers. Each method takes what it needs.
#[derive(Clone, Copy)]
pub struct RealScene<'a> {
    pub volume: &'a TsdfVolume,
    pub main: &'a GBuffer,
    pub auxiliary: &'a [GBuffer],
}

/// Virtual objects, and the buffers of the real scene with these drawn into them.
#[derive(Clone, Copy)]
pub struct MergedScene<'a> {
    pub objects: &'a VirtualScene,
    pub main: &'a GBuffer,
    pub auxiliary: &'a [GBuffer],
    /// What leaves the buffers' pixels; without it there is no bounce.
    pub radiance: Option<Radiance<'a>>,
}

/// Radiance transfer by the method that the settings ask for; boxed, as the two differ much in size.
#[derive(Debug)]
pub enum TransferStage {
    ImageSpace(Box<RadianceTransfer>),
    RayTraced(Box<RayTracedTransfer>),
}

impl TransferStage {
    pub fn new(params: &TransferParams, bounce: &BounceParams) -> Result<Self, TransferError> {
        bounce.check_with(params)?;
        Ok(match params.method {
            TransferMethod::ImageSpace => {
                Self::ImageSpace(Box::new(RadianceTransfer::new(params, bounce)?))
            }
            TransferMethod::RayTraced => Self::RayTraced(Box::new(RayTracedTransfer::new(params)?)),
        })
    }

    /// Transfer of the real scene.
    pub fn transfer(&mut self, real: RealScene, out: &mut TransferMap) {
        match self {
            Self::ImageSpace(stage) => stage.transfer(real.main, real.auxiliary, out),
            Self::RayTraced(stage) => stage.transfer(real.volume, real.main, out),
        }
    }

    /// Transfer of the real scene and virtual objects together, and one bounce of light;
    /// `real_transfer` is what the last call of [`Self::transfer`] made of `real`. Ray-traced transfer
    /// has no bounce and leaves `indirect` as it is.
    pub fn transfer_and_bounce(
        &mut self,
        real: RealScene,
        merged: MergedScene,
        real_transfer: &TransferMap,
        out: &mut TransferMap,
        indirect: &mut IndirectMap,
    ) {
        match self {
            Self::ImageSpace(stage) => stage.transfer_and_bounce(
                (real.main, real.auxiliary),
                (merged.main, merged.auxiliary),
                merged.radiance,
                real_transfer,
                out,
                indirect,
            ),
            Self::RayTraced(stage) => stage.transfer_with_virtual(
                real.volume,
                merged.objects,
                (real.main, merged.main),
                real_transfer,
                out,
            ),
        }
    }
}
