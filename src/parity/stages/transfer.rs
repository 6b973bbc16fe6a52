//! Transfer of the real scene, and of real and virtual objects together with a bounce of light.

use super::{Bench, ParityError};
use crate::fusion::TsdfVolume;
use crate::gpu::stages::{
    GpuIndirectMap, GpuTransferMap, GpuVolume, TracedTransferPass, TransferPass,
};
use crate::parity::tolerances::*;
use crate::parity::upload;
use crate::pipeline::{ObjectBuffers, StageBuffers};
use crate::transfer::{DirectionSet, RayTracedTransfer, TransferMap, TransferMethod};

/// By the method of the settings. The device's volume holds the voxels that `voxels` does: of one of them the
/// rays of both sides are.
pub fn transfer(
    bench: &mut Bench,
    seen: &StageBuffers,
    volume: &GpuVolume,
    voxels: &TsdfVolume,
) -> Result<(), ParityError> {
    match bench.settings.transfer.method {
        TransferMethod::ImageSpace => image_space(bench, seen),
        TransferMethod::RayTraced => ray_traced(bench, seen, volume, voxels),
    }
}

fn map_like(
    bench: &Bench,
    map: &TransferMap,
    seen: &StageBuffers,
) -> Result<GpuTransferMap, ParityError> {
    Ok(GpuTransferMap::new(bench.gpu, map.bands, map.step, seen.real.size())?)
}

fn image_space(bench: &mut Bench, seen: &StageBuffers) -> Result<(), ParityError> {
    let (gpu, params) = (bench.gpu, &bench.settings.transfer);
    let set = DirectionSet::new(params)?;
    let mut pass = TransferPass::new(gpu, params, &bench.settings.bounce, &set)?;
    let (main, sides) = (upload::buffer(gpu, seen.real)?, upload::buffers(gpu, seen.auxiliary)?);
    let out = map_like(bench, seen.real_transfer, seen)?;
    bench.run(|commands| pass.transfer(commands, (&main, &sides), &out))?;
    let found = out.coefficients.download(gpu)?;
    bench.ledger.compare(&TRANSFER, bench.frame, &seen.real_transfer.coefficients, &found);

    let Some(objects) = &seen.with_objects else { return Ok(()) };
    let real = map_like(bench, seen.real_transfer, seen)?;
    real.upload(gpu, seen.real_transfer);
    let main = upload::buffer(gpu, objects.main)?;
    let sides = upload::buffers(gpu, objects.auxiliary)?;
    let radiance = objects.radiance.map(|radiance| upload::radiance(gpu, radiance)).transpose()?;
    let radiance = radiance.as_ref().map(|(main, sides)| (main, &sides[..]));
    let indirect = GpuIndirectMap::new(gpu, out.step, seen.real.size())?;
    bench.run(|commands| {
        pass.transfer_and_bounce(commands, (&main, &sides), radiance, &real, &out, &indirect)
    })?;
    compare_merged(bench, objects, &out, &indirect)
}

fn compare_merged(
    bench: &mut Bench,
    objects: &ObjectBuffers,
    out: &GpuTransferMap,
    indirect: &GpuIndirectMap,
) -> Result<(), ParityError> {
    let found = out.coefficients.download(bench.gpu)?;
    let expected = &objects.transfer.coefficients;
    bench.ledger.compare(&MERGED_TRANSFER, bench.frame, expected, &found);
    if let Some(expected) = objects.indirect {
        let found = indirect.light.download(bench.gpu)?;
        let found: Vec<f32> = found.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
        bench.ledger.compare(&BOUNCE, bench.frame, expected.rgb.as_flattened(), &found);
    }
    Ok(())
}

fn ray_traced(
    bench: &mut Bench,
    seen: &StageBuffers,
    volume: &GpuVolume,
    voxels: &TsdfVolume,
) -> Result<(), ParityError> {
    let (gpu, params) = (bench.gpu, &bench.settings.transfer);
    let mut stage = RayTracedTransfer::new(params)?;
    let (mut real_map, mut merged_map) = (TransferMap::default(), TransferMap::default());
    stage.transfer(voxels, seen.real, &mut real_map);

    let set = DirectionSet::new(params)?;
    let mut pass = TracedTransferPass::new(gpu, params, &set, volume, seen.real.size())?;
    let real = upload::buffer(gpu, seen.real)?;
    let out = pass.new_map(gpu)?;
    bench.run(|commands| pass.transfer(commands, volume, &real, &out))?;
    let found = out.coefficients.download(gpu)?;
    bench.ledger.compare(&TRACED_TRANSFER, bench.frame, &real_map.coefficients, &found);

    let Some(objects) = &seen.with_objects else { return Ok(()) };
    let buffers = (seen.real, objects.main);
    stage.transfer_with_virtual(voxels, seen.objects, buffers, &real_map, &mut merged_map);
    let merged = upload::buffer(gpu, objects.main)?;
    let real_transfer = pass.new_map(gpu)?;
    real_transfer.upload(gpu, &real_map);
    bench.run(|commands| {
        let buffers = (&real, &merged);
        pass.transfer_with_virtual(commands, volume, seen.objects, buffers, &real_transfer, &out)
    })?;
    let found = out.coefficients.download(gpu)?;
    bench.ledger.compare(&TRACED_MERGED_TRANSFER, bench.frame, &merged_map.coefficients, &found);
    Ok(())
}
