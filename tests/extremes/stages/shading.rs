//! Shading, what surfaces radiate, and the composed picture, against f64.

use super::made::*;
use super::on_device::{compose, say, shading};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::compositing::{ComposeInput, CompositingParams, VirtualLayer};
use kinlight::geometry::{GBuffer, Origin};
use kinlight::gpu::GpuImage;
use kinlight::gpu::stages::{ExitantPass, GpuVirtualLayer};
use kinlight::image::Image;
use kinlight::lighting::ShLight;
use kinlight::lighting::exitant::{DominantLight, exitant_radiance};
use kinlight::math::random::Rng;
use kinlight::math::{Pose, View};
use kinlight::parity::upload;

pub fn add_cases(table: &mut Table) {
    table.case("shading", "R of an evenly lit wall against f64", On::Both, even_wall);
    table.case("shading", "what virtual surfaces radiate against f64", On::Both, exitant);
    table.case("shading", "a shadow on each of 256 codes against f64", On::Both, ratio);
}

fn light() -> ShLight {
    lamps(4, 0.2, &[(Vec3::new(0.3, -0.5, -0.8).normalize(), 0.5)])
}

/// A wall that faces the camera, under a light, with another transfer on its right half.
struct Wall {
    picture: Picture,
    merged: Picture,
}

impl Wall {
    fn new(visible: f32) -> Self {
        let picture = Picture::open(SIZE, &light(), |_| -Vec3::Z);
        let mut merged = picture.clone();
        for (k, row) in merged.transfer.coefficients.chunks_mut(16).enumerate() {
            if k % SIZE.width >= SIZE.width / 2 {
                row.iter_mut().for_each(|t| *t *= visible);
            }
        }
        Self { picture, merged }
    }

    fn input<'a>(&'a self, layer: &'a VirtualLayer, light: &'a ShLight) -> ComposeInput<'a> {
        ComposeInput {
            frame: &self.picture.frame,
            real: &self.picture.surface,
            merged: &self.merged.surface,
            layer,
            real_transfer: &self.picture.transfer,
            merged_transfer: &self.merged.transfer,
            indirect: None,
            light,
            mean_albedo: 0.5,
        }
    }
}

fn even_wall(on: Device) -> Outcome {
    let (wall, layer, light) = (Wall::new(1.0), VirtualLayer::empty(SIZE), light());
    let out = shading(on, &CompositingParams::default(), &wall.input(&layer, &light))?;
    let row = wall.picture.transfer.at(0, 0);
    let terms = row.iter().zip(&light.coefficients).map(|(t, l)| f64::from(*t) * f64::from(l[0]));
    let (exact, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
    let worst = out.real.as_slice().iter().flatten().map(|r| (f64::from(*r) - exact).abs());
    // a sum of 16 products, then a weighted mean of 25 equal values at most
    let bound = (16.0 + 2.0 * 25.0) * ROUNDING * size;
    Ok(Found::new(worst.fold(0.0, f64::max), bound, "16 products, smoothed"))
}

fn exitant(on: Device) -> Outcome {
    let mut rng = Rng::new(&[19]);
    let mut buffer = GBuffer::empty(View::perspective(camera(SIZE), Pose::identity()));
    let mut layer = VirtualLayer::empty(SIZE);
    for (x, y) in (0..SIZE.pixels()).map(|k| (k % SIZE.width, k / SIZE.width)) {
        let normal = random_direction(&mut rng);
        buffer.normals.set(x, y, normal);
        buffer.origin[(x, y)] = Origin::Virtual;
        buffer.depth_m[(x, y)] = 1.0;
        layer.albedo[(x, y)] = [0; 3].map(|_| rng.uniform());
    }
    let light = DominantLight::of(&light()).ok_or("the light has a direction")?;
    let mean_albedo = 0.4;
    let found = match on {
        Device::Cpu => {
            let mut out = Image::default();
            exitant_radiance(&buffer, &layer, None, Some(light), mean_albedo, &mut out);
            out.into_vec()
        }
        Device::Gpu(gpu) => {
            let on_device = GpuVirtualLayer::empty(gpu, SIZE).map_err(say)?;
            on_device.upload(gpu, &layer);
            let out = GpuImage::new(gpu, "radiance", SIZE).map_err(say)?;
            let buffer = upload::buffer(gpu, &buffer).map_err(say)?;
            let mut commands = gpu.commands();
            ExitantPass::new(Some(light), mean_albedo)
                .run(&mut commands, &buffer, &on_device, None, &out)
                .map_err(say)?;
            commands.submit().map_err(say)?;
            let values: Vec<[f32; 4]> = out.buffer().download(gpu).map_err(say)?;
            values.into_iter().map(|[r, g, b, _]| [r, g, b]).collect()
        }
    };
    let towards = light.towards_light.as_dvec3();
    let mut worst = Found::new(0.0, 1.0, "");
    for (k, rgb) in found.iter().enumerate() {
        let at = (k % SIZE.width, k / SIZE.width);
        let n = buffer.normals.at(at.0, at.1).as_dvec3();
        // products of a dot product round in numbers of their size
        let size = (n * towards).abs().element_sum();
        for c in 0..3 {
            let scale = f64::from(layer.albedo[at][c]) * f64::from(light.irradiance[c])
                / (std::f64::consts::PI * f64::from(mean_albedo));
            let exact = scale * n.dot(towards).max(0.0);
            let bound = scale * ROUNDING * (3.0 * size + 5.0 * n.dot(towards).abs());
            let error = (f64::from(rgb[c]) - exact).abs();
            let what = "of the roundings of a dot product and four products";
            worst = worst.worse(Found::new(error / bound.max(f64::MIN_POSITIVE), 1.0, what));
        }
    }
    Ok(worst)
}

/// The picture holds all codes; a shadow leaves a share of the light on its right half.
fn ratio(on: Device) -> Outcome {
    let (layer, light) = (VirtualLayer::empty(SIZE), light());
    let mut worst = Found::new(0.0, 1.0, "");
    for visible in [1.0, 0.93, 0.5, 0.1] {
        let mut wall = Wall::new(visible);
        let codes = image(SIZE, |x, y| [(x + SIZE.width * y) as u8; 3]);
        wall.picture.frame.color_srgb = codes.clone();
        let params = CompositingParams::default();
        let out = compose(on, &params, &wall.input(&layer, &light))?;
        let mut untouched = 0;
        for (x, y) in (0..SIZE.pixels()).map(|k| (k % SIZE.width, k / SIZE.width)) {
            // smoothing mixes the shadow's edge
            if x.abs_diff(SIZE.width / 2) <= 4 {
                continue;
            }
            let share = if x < SIZE.width / 2 { 1.0 } else { f64::from(visible) };
            let code = codes[(x, y)][1];
            let exact = encode(decode(code) * share);
            let error = (f64::from(out[(x, y)][1]) - exact).abs();
            untouched += usize::from(share == 1.0 && out[(x, y)][1] != code);
            // to the nearest code, and the encoder's table errs by less than a twentieth of one
            let what = format!("codes, {visible} of the light left; rounding to the nearest");
            worst = worst.worse(Found::new(error, 0.55, what));
        }
        if untouched > 0 {
            return Err(format!("{untouched} pixels without a shadow have changed"));
        }
    }
    Ok(worst)
}

fn decode(code: u8) -> f64 {
    let e = f64::from(code) / 255.0;
    if e <= 0.04045 { e / 12.92 } else { ((e + 0.055) / 1.055).powf(2.4) }
}

fn encode(linear: f64) -> f64 {
    255.0
        * if linear <= 0.003_130_8 {
            12.92 * linear
        } else {
            1.055 * linear.powf(1.0 / 2.4) - 0.055
        }
}
