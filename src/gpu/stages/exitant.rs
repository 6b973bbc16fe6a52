//! What the pixels of a geometry buffer radiate, the source of the bounce: as
//! [`crate::lighting::exitant`]. The light is a number or two and comes from the host.

use super::GpuVirtualLayer;
use crate::gpu::{Commands, GpuError, GpuGBuffer, GpuImage, Shader, uniform};
use crate::lighting::exitant::DominantLight;
use crate::timing::Stage;

uniform! {
    struct ExitantUniform {
        towards_light: [f32; 4],
        radiance: [f32; 4],
        pixels: u32,
        is_seen: u32,
        pad0: u32,
        pad1: u32,
    }
}

pub(super) const SHADER: Shader = Shader::new("exitant/radiance");

/// Reflection of the dominant light by virtual surfaces, and the camera's colour on real ones.
pub struct ExitantPass {
    uniform: ExitantUniform,
}

impl ExitantPass {
    /// `light` is times the scene's mean albedo; without one, virtual surfaces are dark.
    pub fn new(light: Option<DominantLight>, mean_albedo: f32) -> Self {
        let scale = std::f32::consts::FRAC_1_PI / mean_albedo;
        let towards = light.map_or([0.0; 3], |light| light.towards_light.to_array());
        let radiance = light.map_or([0.0; 3], |light| light.irradiance.map(|e| e * scale));
        let padded = |[x, y, z]: [f32; 3]| [x, y, z, 0.0];
        let uniform = ExitantUniform {
            towards_light: padded(towards),
            radiance: padded(radiance),
            pixels: 0,
            is_seen: 0,
            pad0: 0,
            pad1: 0,
        };
        Self { uniform }
    }

    /// Outgoing linear radiance of every pixel. `camera_color` is what the camera saw, or none for a side
    /// view, where real surfaces stay dark.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn run(
        &self,
        commands: &mut Commands<'_>,
        buffer: &GpuGBuffer,
        layer: &GpuVirtualLayer,
        camera_color: Option<&GpuImage<[f32; 4]>>,
        out: &GpuImage<[f32; 4]>,
    ) -> Result<(), GpuError> {
        let size = buffer.size();
        let color = camera_color.map_or(size, GpuImage::size);
        assert!([layer.size(), out.size(), color] == [size; 3], "sizes of exitant radiance");
        commands.stage(Stage::RadTransfer);
        let (pixels, is_seen) = (size.pixels() as u32, u32::from(camera_color.is_some()));
        commands
            .pass(&SHADER)?
            .uniform(&ExitantUniform { pixels, is_seen, ..self.uniform })?
            .read(&buffer.surface)?
            .read(&buffer.origin)?
            .read(layer)?
            // without colour it is not used, but something must be bound
            .read(camera_color.unwrap_or(&buffer.surface))?
            .write(out)?
            .over_count(size.pixels())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compositing::VirtualLayer;
    use crate::geometry::{GBuffer, Origin};
    use crate::gpu::Gpu;
    use crate::gpu::stages::test_support::gpu;
    use crate::image::{Image, Size};
    use crate::lighting::exitant::exitant_radiance;
    use crate::math::random::Rng;
    use crate::parity::tolerances::EXITANT;
    use crate::scene::raster::tests::{moved, ortho, pinhole};
    use glam::Vec3;

    /// Every origin, with normals to and away from the light.
    fn scene(view: crate::math::View) -> (GBuffer, VirtualLayer, Image<[f32; 3]>) {
        let (size, mut rng) = (view.size(), Rng::new(&[23]));
        let mut buffer = GBuffer::empty(view);
        let mut layer = VirtualLayer::empty(size);
        let mut color = Image::new(size, [0.0; 3]);
        let origins = [Origin::Virtual, Origin::Model, Origin::None, Origin::Sensor];
        for i in 0..size.pixels() {
            let (x, y) = (i % size.width, i / size.width);
            let normal = Vec3::new(rng.normal(), rng.normal(), rng.normal());
            buffer.normals.set(x, y, normal.normalize());
            buffer.origin[(x, y)] = origins[i % 4];
            layer.albedo[(x, y)] = [rng.uniform(), rng.uniform(), rng.uniform()];
            layer.coverage[(x, y)] = rng.uniform();
            color[(x, y)] = [rng.uniform(), rng.uniform(), rng.uniform()];
        }
        (buffer, layer, color)
    }

    fn both(gpu: &Gpu, size: Size, colored: bool, light: Option<DominantLight>) -> [Vec<f32>; 2] {
        let view = if colored {
            moved(pinhole(size.width, size.height))
        } else {
            ortho(size.width, size.height, 30.0)
        };
        let (buffer, layer, color) = scene(view);
        let mut expected = Image::default();
        let color = colored.then_some(&color);
        exitant_radiance(&buffer, &layer, color, light, 0.4, &mut expected);

        let mut on_device = GpuGBuffer::empty(gpu, view).unwrap();
        on_device.upload(gpu, &buffer);
        let layer_on_device = GpuVirtualLayer::empty(gpu, size).unwrap();
        layer_on_device.upload(gpu, &layer);
        let color = color.map(|color| {
            let padded = color.as_slice().iter().map(|&[r, g, b]| [r, g, b, 55.0]).collect();
            GpuImage::from_image(gpu, "colour", &Image::from_vec(size, padded)).unwrap()
        });
        let wrong = Image::new(size, [7.7; 4]);
        let out = GpuImage::from_image(gpu, "radiance", &wrong).unwrap();
        let mut commands = gpu.commands();
        let pass = ExitantPass::new(light, 0.4);
        pass.run(&mut commands, &on_device, &layer_on_device, color.as_ref(), &out).unwrap();
        commands.submit().unwrap();
        let found = out.buffer().download(gpu).unwrap();
        let found = found.iter().flat_map(|rgb| rgb[..3].to_vec()).collect();
        [expected.as_slice().as_flattened().to_vec(), found]
    }

    #[test]
    fn radiance_is_that_of_the_cpu() {
        let Some(device) = gpu() else { return };
        let light = DominantLight {
            towards_light: Vec3::new(0.6, -0.48, 0.64),
            irradiance: [3.0, 2.0, 0.5],
        };
        for (width, height) in [(67, 43), (160, 120), (1, 1)] {
            let size = Size::new(width, height);
            for (colored, light) in
                [(true, Some(light)), (true, None), (false, Some(light)), (false, None)]
            {
                let [cpu, gpu] = both(device, size, colored, light);
                let (found, within) = EXITANT.compare(device, &cpu, &gpu);
                assert!(within, "{size} {colored} {light:?}: {found}");
                let lit = cpu.iter().filter(|&&r| r > 0.0).count();
                assert!(size.pixels() == 1 || (lit > 0) == (colored || light.is_some()));
            }
        }
    }
}
