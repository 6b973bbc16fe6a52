//! Input and tracking.

use super::{Bench, ParityError};
use crate::capture::{RawFrame, RgbdFrame};
use crate::geometry::GBuffer;
use crate::gpu::stages::{FramePictures, GpuTracker, InputPass, TrackedFrame};
use crate::gpu::{Commands, GpuGBuffer};
use crate::math::{Projection, View};
use crate::parity::run::pose_difference;
use crate::parity::tolerances::*;
use crate::parity::upload;
use crate::tracking::{DEPTH_RANGE_M, FrameTag, Tracker};

/// The Input stage: `raw` as recorded, `expected` as the CPU prepared it.
pub fn input(bench: &mut Bench, raw: &RawFrame, expected: &RgbdFrame) -> Result<(), ParityError> {
    let gpu = bench.gpu;
    let pictures = FramePictures::new(gpu, raw.color.size())?;
    let pass = InputPass::new(gpu, &bench.settings.input)?;
    bench.run(|commands| pass.run(commands, raw, &pictures))?;
    let color = pictures.color.buffer().download(gpu)?;
    let depth_m = pictures.depth_m.buffer().download(gpu)?;
    let rgb: Vec<f32> = color.iter().flat_map(|c| [c[0], c[1], c[2]]).collect();
    let steps: Vec<f32> = color.iter().map(|c| c[3]).collect();
    let Bench { ledger, frame, .. } = bench;
    ledger.compare(&INPUT_DEPTH, *frame, expected.depth_m.as_slice(), &depth_m);
    ledger.compare(&INPUT_COLOR, *frame, expected.color.as_slice().as_flattened(), &rgb);
    ledger.compare(&INPUT_INTENSITY, *frame, expected.intensity.as_slice(), &steps);
    Ok(())
}

/// The pose of `frame` from `model`, the map's picture of the frame before. Both trackers are new and start where
/// that was taken, so that nothing but their pictures counts.
pub fn tracking(bench: &mut Bench, frame: &RgbdFrame, model: &GBuffer) -> Result<(), ParityError> {
    let (gpu, params) = (bench.gpu, &bench.settings.tracking);
    let Projection::Perspective(camera) = model.view.projection else { return Ok(()) };
    let start = model.view.world_from_view;
    let mut on_cpu = Tracker::new(params, camera);
    let mut on_gpu = GpuTracker::new(gpu, params, camera)?;
    on_cpu.reset(start);
    on_gpu.reset(start);
    // never called: the picture shows the place that both start from
    let cpu = on_cpu.track(frame, Some(model), &mut |view, out| out.set_view(*view));

    let pictures = &FramePictures::new(gpu, frame.color.size())?;
    pictures.upload(gpu, frame);
    let input = InputPass::new(gpu, &bench.settings.input)?;
    let depth_share = input.depth_share(&frame.depth_m, &DEPTH_RANGE_M);
    let tag = FrameTag { index: frame.index, recorded_pose: frame.world_from_camera };
    let seen = upload::buffer(gpu, model)?;
    let mut nothing = |_: &mut Commands<'_>, view: &View, out: &mut GpuGBuffer| {
        out.view = *view;
        Ok(())
    };
    let newest = TrackedFrame { tag, pictures, depth_share };
    let gpu = on_gpu.track(&mut gpu.commands(), newest, Some(&seen), &mut nothing)?;
    let (mm, degrees) = match cpu.state == gpu.state {
        true => pose_difference(&cpu.world_from_camera, &gpu.world_from_camera),
        false => (f64::INFINITY, f64::INFINITY),
    };
    bench.ledger.compare(&TRACKING_POSITION, bench.frame, &[0.0], &[mm as f32]);
    bench.ledger.compare(&TRACKING_ROTATION, bench.frame, &[0.0], &[degrees as f32]);
    Ok(())
}
