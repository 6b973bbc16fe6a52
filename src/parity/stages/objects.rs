//! Virtual objects: drawn, lit, and in the picture.

use super::{Bench, ParityError, normals_of_both, origins};
use crate::compositing::VirtualLayer;
use crate::geometry::GBuffer;
use crate::gpu::stages::{
    CompositingPass, ExitantPass, FramePictures, GpuComposeInput, GpuIndirectMap, GpuPicture,
    GpuTransferMap, GpuVirtualLayer, PictureReadBack, RasterPass,
};
use crate::gpu::{GpuError, GpuGBuffer, GpuImage};
use crate::image::Image;
use crate::lighting::exitant::DominantLight;
use crate::parity::tolerances::*;
use crate::parity::upload;
use crate::pipeline::{ObjectBuffers, StageBuffers};

/// The objects drawn into all views.
pub fn raster(
    bench: &mut Bench,
    seen: &StageBuffers,
    objects: &ObjectBuffers,
) -> Result<(), ParityError> {
    let gpu = bench.gpu;
    let mut pass = RasterPass::new(gpu)?;
    let sides = seen.auxiliary.iter().zip(objects.auxiliary);
    let views = std::iter::once((seen.real, objects.main)).chain(sides);
    let layers = std::iter::once(objects.layer).chain(objects.auxiliary_layers.iter().copied());
    for ((real, expected), expected_layer) in views.zip(layers) {
        let real = upload::buffer(gpu, real)?;
        let mut merged = GpuGBuffer::empty(gpu, real.view)?;
        let layer = GpuVirtualLayer::empty(gpu, real.size())?;
        let target = (&mut merged, &layer);
        bench.run(|commands| pass.draw(commands, 0, seen.objects, &real, target).map(|_| ()))?;
        let texels = layer.texels.buffer().download(gpu)?;
        compare_drawn(bench, (expected, expected_layer), (&merged.download(gpu)?, &texels));
    }
    Ok(())
}

fn compare_drawn(
    bench: &mut Bench,
    (cpu, layer): (&GBuffer, &VirtualLayer),
    (gpu, texels): (&GBuffer, &[[f32; 4]]),
) {
    let Bench { ledger, frame, .. } = bench;
    ledger.compare(&RASTER_DEPTH, *frame, cpu.depth_m.as_slice(), gpu.depth_m.as_slice());
    ledger.compare(&RASTER_ORIGIN, *frame, &origins(cpu), &origins(gpu));
    let [a, b] = normals_of_both(cpu, gpu);
    ledger.compare(&RASTER_NORMAL, *frame, &a, &b);
    let coverage: Vec<f32> = texels.iter().map(|texel| texel[3]).collect();
    ledger.compare(&RASTER_COVERAGE, *frame, layer.coverage.as_slice(), &coverage);
    let texels = layer.albedo.as_slice().iter().zip(layer.coverage.as_slice()).zip(texels);
    let covered = texels.filter(|((_, a), b)| **a > 0.0 && b[3] > 0.0);
    let colors: Vec<_> = covered.map(|((a, _), b)| (*a, [b[0], b[1], b[2]])).collect();
    let (cpu, gpu): (Vec<_>, Vec<_>) = colors.into_iter().unzip();
    ledger.compare(&RASTER_COLOR, *frame, cpu.as_flattened(), gpu.as_flattened());
}

/// What the pixels of all views radiate. Without virtual pixels in the camera's view the CPU leaves that out.
pub fn exitant(
    bench: &mut Bench,
    seen: &StageBuffers,
    objects: &ObjectBuffers,
) -> Result<(), ParityError> {
    let Some((main, sides)) = objects.radiance else { return Ok(()) };
    let light = DominantLight::of(seen.light);
    let pass = ExitantPass::new(light, bench.settings.light.mean_albedo);
    if objects.shows() {
        let color = Some(&seen.frame.color);
        radiate(bench, &pass, (objects.main, objects.layer), color, main)?;
    }
    let views = objects.auxiliary.iter().zip(&objects.auxiliary_layers).zip(sides);
    for ((buffer, layer), expected) in views {
        radiate(bench, &pass, (buffer, layer), None, expected)?;
    }
    Ok(())
}

fn radiate(
    bench: &mut Bench,
    pass: &ExitantPass,
    (buffer, layer): (&GBuffer, &VirtualLayer),
    color: Option<&Image<[f32; 3]>>,
    expected: &Image<[f32; 3]>,
) -> Result<(), ParityError> {
    let (gpu, size) = (bench.gpu, buffer.size());
    let on_device = upload::buffer(gpu, buffer)?;
    let layer_on_device = GpuVirtualLayer::empty(gpu, size)?;
    layer_on_device.upload(gpu, layer);
    let color = color.map(|color| upload::rgb(gpu, color)).transpose()?;
    let out = GpuImage::new(gpu, "radiance", size)?;
    bench.run(|commands| pass.run(commands, &on_device, &layer_on_device, color.as_ref(), &out))?;
    let found = out.buffer().download(gpu)?;
    let found: Vec<f32> = found.iter().flat_map(|&[r, g, b, _]| [r, g, b]).collect();
    bench.ledger.compare(&EXITANT, bench.frame, expected.as_slice().as_flattened(), &found);
    Ok(())
}

/// The picture, under the CPU's light and transfer.
pub fn compositing(
    bench: &mut Bench,
    seen: &StageBuffers,
    objects: &ObjectBuffers,
) -> Result<(), ParityError> {
    let (gpu, size) = (bench.gpu, seen.real.size());
    let (bands, step) = (seen.real_transfer.bands, seen.real_transfer.step);
    let pictures = FramePictures::new(gpu, size)?;
    pictures.upload(gpu, seen.frame);
    let merged = upload::buffer(gpu, objects.main)?;
    let layer = GpuVirtualLayer::empty(gpu, size)?;
    layer.upload(gpu, objects.layer);
    let real_transfer = GpuTransferMap::new(gpu, bands, step, size)?;
    real_transfer.upload(gpu, seen.real_transfer);
    let merged_transfer = GpuTransferMap::new(gpu, bands, step, size)?;
    merged_transfer.upload(gpu, objects.transfer);
    let uploaded = |map| {
        let made = GpuIndirectMap::new(gpu, step, size)?;
        made.upload(gpu, map);
        Ok::<_, GpuError>(made)
    };
    let indirect = objects.indirect.map(uploaded).transpose()?;
    let input = GpuComposeInput {
        frame: &pictures,
        merged: &merged,
        layer: &layer,
        real_transfer: &real_transfer,
        merged_transfer: &merged_transfer,
        indirect: indirect.as_ref(),
        light: seen.light,
        mean_albedo: bench.settings.light.mean_albedo,
    };
    let pass = CompositingPass::new(gpu, &bench.settings.compositing, size, step)?;
    let picture = GpuPicture::new(gpu, size)?;
    let mut read_back = PictureReadBack::new(gpu, size)?;
    bench.run(|commands| {
        pass.run(commands, &input, &picture)?;
        read_back.request(commands, &picture);
        Ok(())
    })?;
    let Some(found) = read_back.take(gpu)? else { return Ok(()) };
    let [cpu, gpu] = [seen.composed, &found].map(codes);
    bench.ledger.compare(&COMPOSITING, bench.frame, &cpu, &gpu);
    Ok(())
}

pub(in crate::parity) fn codes(picture: &Image<[u8; 3]>) -> Vec<f32> {
    picture.as_slice().as_flattened().iter().map(|&code| f32::from(code)).collect()
}
