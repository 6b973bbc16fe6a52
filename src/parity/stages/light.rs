//! The real scene as it is lit: DynGeo, and the light.

use super::{Bench, ParityError, normals, origins};
use crate::gpu::GpuGBuffer;
use crate::gpu::stages::{DynGeoPass, FramePictures, GpuTransferMap, LightSamplesPass};
use crate::lighting::LightEstimator;
use crate::parity::run::light_difference_deg;
use crate::parity::tolerances::*;
use crate::parity::upload;
use crate::pipeline::StageBuffers;

/// G_r of the frame and G_v.
pub fn dyn_geo(bench: &mut Bench, seen: &StageBuffers) -> Result<(), ParityError> {
    let (gpu, size) = (bench.gpu, seen.real.size());
    let pictures = FramePictures::new(gpu, size)?;
    pictures.upload(gpu, seen.frame);
    let model = upload::buffer(gpu, seen.model)?;
    let mut out = GpuGBuffer::empty(gpu, seen.model.view)?;
    let pass = DynGeoPass::new(gpu, &bench.settings.dyn_geo, size)?;
    bench.run(|commands| pass.run(commands, &pictures, &model, &mut out))?;
    let (cpu, gpu) = (seen.real, out.download(gpu)?);
    let Bench { ledger, frame, .. } = bench;
    ledger.compare(&DYNGEO_DEPTH, *frame, cpu.depth_m.as_slice(), gpu.depth_m.as_slice());
    ledger.compare(&DYNGEO_NORMAL, *frame, &normals(cpu), &normals(&gpu));
    ledger.compare(&DYNGEO_ORIGIN, *frame, &origins(cpu), &origins(&gpu));
    Ok(())
}

/// Samples and the light that is fitted to them, by estimators that know no other frame.
pub fn light(bench: &mut Bench, seen: &StageBuffers) -> Result<(), ParityError> {
    let (gpu, params) = (bench.gpu, &bench.settings.light);
    let (size, map) = (seen.real.size(), seen.real_transfer);
    let mut estimator = LightEstimator::new(params);
    let cpu = estimator.estimate(seen.frame, seen.real, map, seen.light_point);

    let pictures = FramePictures::new(gpu, size)?;
    pictures.upload(gpu, seen.frame);
    let real = upload::buffer(gpu, seen.real)?;
    let transfer = GpuTransferMap::new(gpu, map.bands, map.step, size)?;
    transfer.upload(gpu, map);
    let mut pass = LightSamplesPass::new(gpu, params, size, map.bands, map.step)?;
    bench.run(|commands| pass.run(commands, &pictures, &real, &transfer))?;
    let mut estimator = LightEstimator::new(params);
    let Some(gpu) = pass.estimate(gpu, &mut estimator, seen.light_point)? else { return Ok(()) };

    let pixels = [&cpu, &gpu].map(|estimate| [estimate.pixels as f32]);
    bench.ledger.compare(&LIGHT_PIXELS, bench.frame, &pixels[0], &pixels[1]);
    let degrees = light_difference_deg(&cpu, &gpu);
    bench.ledger.compare(&LIGHT_DIRECTION, bench.frame, &[0.0], &[degrees as f32]);
    Ok(())
}
