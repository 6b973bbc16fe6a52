//! One call for each stage, on either backend.

use crate::table::Device;
use kinlight::capture::RgbdFrame;
use kinlight::compositing::{ComposeInput, CompositingParams, CompositingStage, ShadingBuffers};
use kinlight::fusion::{TsdfVolume, VolumeParams};
use kinlight::geometry::{DynGeo, DynGeoParams, GBuffer};
use kinlight::gpu::stages::{
    CompositingPass, DynGeoPass, FramePictures, GpuComposeInput, GpuPicture, GpuTracker,
    GpuTransferMap, GpuVirtualLayer, GpuVolume, LightSamplesPass, PictureReadBack, RayCaster,
    TrackedFrame, TransferPass,
};
use kinlight::gpu::{Commands, Gpu, GpuGBuffer};
use kinlight::image::Image;
use kinlight::lighting::{LightEstimate, LightEstimator, LightParams};
use kinlight::math::{Pinhole, View};
use kinlight::parity::upload;
use kinlight::tracking::{FrameTag, Tracker, Tracking, TrackingParams};
use kinlight::transfer::{
    BounceParams, DirectionSet, RadianceTransfer, TransferMap, TransferParams,
};

pub type Fallible<T> = Result<T, String>;

pub fn say(error: impl std::fmt::Display) -> String {
    error.to_string()
}

fn pictures(gpu: &Gpu, frame: &RgbdFrame) -> Fallible<FramePictures> {
    let pictures = FramePictures::new(gpu, frame.depth_m.size()).map_err(say)?;
    pictures.upload(gpu, frame);
    Ok(pictures)
}

/// A map of the room.
#[expect(clippy::large_enum_variant, reason = "there is one at a time")]
pub enum Map<'g> {
    Cpu(TsdfVolume),
    Gpu(&'g Gpu, Box<GpuVolume>),
}

impl<'g> Map<'g> {
    /// Around the origin.
    pub fn new(on: Device<'g>, params: &VolumeParams) -> Fallible<Self> {
        let volume = TsdfVolume::new(params, glam::Vec3::ZERO).map_err(say)?;
        Ok(match on {
            Device::Cpu => Self::Cpu(volume),
            Device::Gpu(gpu) => {
                let on_device = GpuVolume::new(gpu, params, *volume.lattice()).map_err(say)?;
                Self::Gpu(gpu, Box::new(on_device))
            }
        })
    }

    /// Of a frame with all pictures.
    pub fn integrate(&mut self, frame: &RgbdFrame, view: &View) -> Fallible<()> {
        match self {
            Self::Cpu(volume) => volume.integrate(frame, view).map_err(say),
            Self::Gpu(gpu, volume) => {
                let mut commands = gpu.commands();
                let pictures = pictures(gpu, frame)?;
                volume.integrate(&mut commands, &pictures, frame.index, view).map_err(say)?;
                commands.submit().map_err(say)
            }
        }
    }

    pub fn raycast(&self, view: &View) -> Fallible<GBuffer> {
        let mut out = GBuffer::empty(*view);
        match self {
            Self::Cpu(volume) => volume.raycast(view, &mut out),
            Self::Gpu(gpu, volume) => {
                let mut on_device = GpuGBuffer::empty(gpu, *view).map_err(say)?;
                let mut caster = RayCaster::new(gpu, view.size()).map_err(say)?;
                let mut commands = gpu.commands();
                caster.cast(&mut commands, volume, view, &mut on_device).map_err(say)?;
                commands.submit().map_err(say)?;
                out = on_device.download(gpu).map_err(say)?;
            }
        }
        Ok(out)
    }

    /// In the host's memory.
    pub fn into_host(self) -> Fallible<TsdfVolume> {
        match self {
            Self::Cpu(volume) => Ok(volume),
            Self::Gpu(gpu, volume) => volume.download(gpu).map_err(say),
        }
    }
}

/// The pose of a frame; the tracker is new and starts where `model`, the map's picture, was taken.
pub fn track(
    on: Device,
    params: &TrackingParams,
    frame: &RgbdFrame,
    model: &GBuffer,
    camera: Pinhole,
) -> Fallible<Tracking> {
    let start = model.view.world_from_view;
    match on {
        Device::Cpu => {
            let mut tracker = Tracker::new(params, camera);
            tracker.reset(start);
            Ok(tracker.track(frame, Some(model), &mut |view, out| out.set_view(*view)))
        }
        Device::Gpu(gpu) => {
            let mut tracker = GpuTracker::new(gpu, params, camera).map_err(say)?;
            tracker.reset(start);
            let depths = frame.depth_m.as_slice();
            let seen = depths.iter().filter(|&&d| d > 0.0).count();
            let newest = TrackedFrame {
                tag: FrameTag { index: frame.index, recorded_pose: frame.world_from_camera },
                pictures: &pictures(gpu, frame)?,
                depth_share: seen as f32 / depths.len() as f32,
            };
            let model = upload::buffer(gpu, model).map_err(say)?;
            let mut nothing = |_: &mut Commands<'_>, view: &View, out: &mut GpuGBuffer| {
                out.view = *view;
                Ok(())
            };
            tracker.track(&mut gpu.commands(), newest, Some(&model), &mut nothing).map_err(say)
        }
    }
}

/// G_r of a frame with all pictures.
pub fn dyn_geo(
    on: Device,
    params: &DynGeoParams,
    frame: &RgbdFrame,
    model: &GBuffer,
) -> Fallible<GBuffer> {
    let mut out = GBuffer::empty(model.view);
    match on {
        Device::Cpu => DynGeo::new(params).run(frame, model, &mut out),
        Device::Gpu(gpu) => {
            let mut on_device = GpuGBuffer::empty(gpu, model.view).map_err(say)?;
            let pass = DynGeoPass::new(gpu, params, model.size()).map_err(say)?;
            let (pictures, model) =
                (pictures(gpu, frame)?, upload::buffer(gpu, model).map_err(say)?);
            let mut commands = gpu.commands();
            pass.run(&mut commands, &pictures, &model, &mut on_device).map_err(say)?;
            commands.submit().map_err(say)?;
            out = on_device.download(gpu).map_err(say)?;
        }
    }
    Ok(out)
}

pub fn transfer(
    on: Device,
    params: &TransferParams,
    main: &GBuffer,
    auxiliary: &[GBuffer],
) -> Fallible<TransferMap> {
    let bounce = BounceParams::default();
    let mut out = TransferMap::default();
    match on {
        Device::Cpu => {
            let mut stage = RadianceTransfer::new(params, &bounce).map_err(say)?;
            stage.transfer(main, auxiliary, &mut out);
        }
        Device::Gpu(gpu) => {
            let set = DirectionSet::new(params).map_err(say)?;
            let mut pass = TransferPass::new(gpu, params, &bounce, &set).map_err(say)?;
            let on_device = GpuTransferMap::new(gpu, params.bands, params.subsampling, main.size())
                .map_err(say)?;
            let main = upload::buffer(gpu, main).map_err(say)?;
            let auxiliary = upload::buffers(gpu, auxiliary).map_err(say)?;
            let mut commands = gpu.commands();
            pass.transfer(&mut commands, (&main, &auxiliary), &on_device).map_err(say)?;
            commands.submit().map_err(say)?;
            let GpuTransferMap { bands, step, grid, .. } = on_device;
            let coefficients = on_device.coefficients.download(gpu).map_err(say)?;
            out = TransferMap { bands, step, grid, coefficients };
        }
    }
    Ok(out)
}

/// What the light is estimated from.
pub struct Lit<'a> {
    pub frame: &'a RgbdFrame,
    pub surface: &'a GBuffer,
    pub transfer: &'a TransferMap,
}

/// The light of one frame, by an estimator that knows no other.
pub fn estimate(on: Device, params: &LightParams, lit: &Lit) -> Fallible<LightEstimate> {
    let mut estimator = LightEstimator::new(params);
    let Lit { frame, surface, transfer } = *lit;
    match on {
        Device::Cpu => Ok(estimator.estimate(frame, surface, transfer, None)),
        Device::Gpu(gpu) => {
            let (size, bands, step) = (surface.size(), transfer.bands, transfer.step);
            let mut pass = LightSamplesPass::new(gpu, params, size, bands, step).map_err(say)?;
            let map = GpuTransferMap::new(gpu, bands, step, size).map_err(say)?;
            map.upload(gpu, transfer);
            let surface = upload::buffer(gpu, surface).map_err(say)?;
            let mut commands = gpu.commands();
            pass.run(&mut commands, &pictures(gpu, frame)?, &surface, &map).map_err(say)?;
            commands.submit().map_err(say)?;
            let found = pass.estimate(gpu, &mut estimator, None).map_err(say)?;
            found.ok_or_else(|| "no samples came back".into())
        }
    }
}

/// The device's copies of what is composed.
struct Uploaded {
    frame: FramePictures,
    merged: GpuGBuffer,
    layer: GpuVirtualLayer,
    transfers: [GpuTransferMap; 2],
}

impl Uploaded {
    fn new(gpu: &Gpu, input: &ComposeInput) -> Fallible<Self> {
        let size = input.merged.size();
        let layer = GpuVirtualLayer::empty(gpu, size).map_err(say)?;
        layer.upload(gpu, input.layer);
        let map = |map: &TransferMap| -> Fallible<GpuTransferMap> {
            let on_device = GpuTransferMap::new(gpu, map.bands, map.step, size).map_err(say)?;
            on_device.upload(gpu, map);
            Ok(on_device)
        };
        Ok(Self {
            frame: pictures(gpu, input.frame)?,
            merged: upload::buffer(gpu, input.merged).map_err(say)?,
            layer,
            transfers: [map(input.real_transfer)?, map(input.merged_transfer)?],
        })
    }

    fn input<'a>(&'a self, of: &ComposeInput<'a>) -> GpuComposeInput<'a> {
        let [real_transfer, merged_transfer] = &self.transfers;
        GpuComposeInput {
            frame: &self.frame,
            merged: &self.merged,
            layer: &self.layer,
            real_transfer,
            merged_transfer,
            indirect: None,
            light: of.light,
            mean_albedo: of.mean_albedo,
        }
    }
}

/// The picture of an input without a bounce.
pub fn compose(
    on: Device,
    params: &CompositingParams,
    input: &ComposeInput,
) -> Fallible<Image<[u8; 3]>> {
    match on {
        Device::Cpu => {
            let mut out = Image::default();
            CompositingStage::new(params).compose(input, &mut out);
            Ok(out)
        }
        Device::Gpu(gpu) => {
            let (size, step) = (input.merged.size(), input.real_transfer.step);
            let uploaded = Uploaded::new(gpu, input)?;
            let pass = CompositingPass::new(gpu, params, size, step).map_err(say)?;
            let out = GpuPicture::new(gpu, size).map_err(say)?;
            let mut read_back = PictureReadBack::new(gpu, size).map_err(say)?;
            let mut commands = gpu.commands();
            pass.run(&mut commands, &uploaded.input(input), &out).map_err(say)?;
            read_back.request(&mut commands, &out);
            commands.submit().map_err(say)?;
            read_back.take(gpu).map_err(say)?.ok_or_else(|| "no picture came back".into())
        }
    }
}

/// R and R' of the same.
pub fn shading(
    on: Device,
    params: &CompositingParams,
    input: &ComposeInput,
) -> Fallible<ShadingBuffers> {
    match on {
        Device::Cpu => Ok(CompositingStage::new(params).shading_buffers(input)),
        Device::Gpu(gpu) => {
            let (size, step) = (input.merged.size(), input.real_transfer.step);
            let uploaded = Uploaded::new(gpu, input)?;
            let pass = CompositingPass::new(gpu, params, size, step).map_err(say)?;
            pass.shading_buffers(gpu, &uploaded.input(input)).map_err(say)
        }
    }
}
