//! What lives on the device from stage to stage and from frame to frame.

use super::merged::{MergedMain, MergedSides};
use super::transfer::grid_step;
use crate::config::Settings;
use crate::gpu::stages::{
    FramePictures, GpuComposeInput, GpuIndirectMap, GpuPicture, GpuTransferMap, GpuVolume,
    PictureReadBack, SurfacePass,
};
use crate::gpu::{Gpu, GpuError, GpuGBuffer};
use crate::image::Size;
use crate::lighting::ShLight;
use crate::math::View;

/// The map of the room; it exists from the first fused frame on.
pub struct Map {
    pub volume: GpuVolume,
    pub surface: SurfacePass,
    /// The auxiliary buffers of `surface` with virtual objects.
    pub sides: MergedSides,
}

/// Everything that is known about the newest frame.
pub struct FrameBuffers {
    pub frame: FramePictures,
    /// G_r, the filtered geometry buffer.
    pub real: GpuGBuffer,
    pub merged: MergedMain,
    /// Whether virtual objects may change anything; where not, `merged` and all maps but the real transfer
    /// are those of an earlier frame.
    pub changed: bool,
    pub maps: TransferMaps,
    pub picture: GpuPicture,
    pub read_back: PictureReadBack,
    /// That come back of the newest frame's picture.
    pub picture_bytes: u64,
}

/// On one grid.
pub struct TransferMaps {
    pub real: GpuTransferMap,
    pub merged: GpuTransferMap,
    pub indirect: GpuIndirectMap,
}

impl TransferMaps {
    pub fn new(gpu: &Gpu, settings: &Settings, image: Size) -> Result<Self, GpuError> {
        let (bands, step) = (settings.transfer.bands, grid_step(&settings.transfer));
        Ok(Self {
            real: GpuTransferMap::new(gpu, bands, step, image)?,
            merged: GpuTransferMap::new(gpu, bands, step, image)?,
            indirect: GpuIndirectMap::new(gpu, step, image)?,
        })
    }
}

impl FrameBuffers {
    pub fn new(gpu: &Gpu, settings: &Settings, view: View) -> Result<Self, GpuError> {
        let size = view.size();
        Ok(Self {
            frame: FramePictures::new(gpu, size)?,
            real: GpuGBuffer::empty(gpu, view)?,
            merged: MergedMain::new(gpu, view)?,
            changed: false,
            maps: TransferMaps::new(gpu, settings, size)?,
            picture: GpuPicture::new(gpu, size)?,
            read_back: PictureReadBack::new(gpu, size)?,
            picture_bytes: 0,
        })
    }

    /// The buffer with virtual surfaces: the real one where there are none.
    pub fn merged_geometry(&self) -> &GpuGBuffer {
        if self.changed { &self.merged.buffer } else { &self.real }
    }

    pub fn compose_input<'a>(
        &'a self,
        settings: &Settings,
        light: &'a ShLight,
    ) -> GpuComposeInput<'a> {
        let maps = &self.maps;
        let bounce = settings.bounce.enabled && self.changed;
        GpuComposeInput {
            frame: &self.frame,
            merged: self.merged_geometry(),
            layer: &self.merged.layer,
            real_transfer: &maps.real,
            merged_transfer: if self.changed { &maps.merged } else { &maps.real },
            indirect: bounce.then_some(&maps.indirect),
            light,
            mean_albedo: settings.light.mean_albedo,
        }
    }
}
