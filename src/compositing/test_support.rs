//! A floor with a virtual ball on it: transfer, light and camera image are made, so every output
//! is known.

use super::*;
use crate::capture::RgbdFrame;
use crate::geometry::{GBuffer, Origin};
use crate::lighting::ShLight;
use crate::math::color::srgb8_from_linear;
use crate::math::{Pinhole, Pose, View, sh};
use crate::scene::analytic::{AnalyticScene, Shape};
use crate::transfer::{IndirectMap, TransferMap};
use glam::{Vec2, Vec3};

pub const SIZE: Size = Size::new(67, 43);
pub const MEAN_ALBEDO: f32 = 0.5;
pub const BALL: Shape = Shape::Sphere { centre: Vec3::new(0.0, 0.0, 0.25), radius: 0.25 };

pub struct Case {
    pub frame: RgbdFrame,
    pub real: GBuffer,
    pub merged: GBuffer,
    pub layer: VirtualLayer,
    pub real_transfer: TransferMap,
    pub merged_transfer: TransferMap,
    pub indirect: Option<IndirectMap>,
    pub light: ShLight,
}

/// Looks down at the origin of the floor, 28 degrees off the vertical.
pub fn view(size: Size) -> View {
    let (width, height) = (size.width, size.height);
    let f = 0.9 * width as f32;
    let (cx, cy) = (0.5 * width as f32 - 0.5, 0.5 * height as f32 - 0.5);
    let turn = nalgebra::UnitQuaternion::from_euler_angles(std::f64::consts::PI - 0.5, 0.0, 0.0);
    let pose = Pose::from_parts(nalgebra::Translation3::new(0.0, 0.8, 1.5), turn);
    View::perspective(Pinhole { width, height, fx: f, fy: f, cx, cy }, pose)
}

pub fn point(buffer: &GBuffer, x: usize, y: usize) -> Vec3 {
    let in_view = buffer.view.unproject(Vec2::new(x as f32, y as f32), buffer.depth_m[(x, y)]);
    buffer.view.world_from_view_f32().transform_point3(in_view)
}

/// Light from above with a tilt; shading of the floor is 0.31.
pub fn light() -> ShLight {
    let lobe = sh::basis(Vec3::new(0.4, 0.3, 0.85).normalize(), 4);
    let coefficients =
        (0..16).map(|i| [if i == 0 { 0.7 } else { 0.0 } + 0.2 * lobe[i]; 3]).collect();
    ShLight { bands: 4, coefficients }
}

pub fn floor_only() -> AnalyticScene {
    AnalyticScene::new([Shape::Plane { normal: Vec3::Z, offset: 0.0 }])
}

/// Merges what a scene shows in front of the real one, as virtual.
pub fn with_virtual(real: &GBuffer, scene: &AnalyticScene) -> GBuffer {
    let mut merged = real.clone();
    let object = scene.render(&real.view);
    for y in 0..real.size().height {
        for x in 0..real.size().width {
            let depth = object.depth_m[(x, y)];
            let behind = real.depth_m[(x, y)];
            if depth > 0.0 && (behind == 0.0 || depth < behind) {
                merged.depth_m[(x, y)] = depth;
                merged.normals.set(x, y, object.normals.at(x, y));
                merged.origin[(x, y)] = Origin::Virtual;
            }
        }
    }
    merged
}

/// Unoccluded transfer, times what is visible from a point.
pub fn transfer(buffer: &GBuffer, step: usize, visible: impl Fn(Vec3) -> f32) -> TransferMap {
    let size = buffer.size();
    let grid = Size::new(size.width.div_ceil(step), size.height.div_ceil(step));
    let mut map = TransferMap { bands: 4, step, grid, coefficients: vec![0.0; grid.pixels() * 16] };
    for j in 0..grid.height {
        for i in 0..grid.width {
            let (x, y) = map.pixel(i, j, size);
            if buffer.depth_m[(x, y)] > 0.0 {
                let share = visible(point(buffer, x, y));
                let row = sh::unoccluded_transfer(buffer.normals.at(x, y), 4);
                let out = &mut map.coefficients[(j * grid.width + i) * 16..][..16];
                out.iter_mut().zip(row).for_each(|(o, t)| *o = share * t);
            }
        }
    }
    map
}

/// A floor of grey 0.4 under the light, without objects.
pub fn bare(size: Size, step: usize) -> Case {
    let real = floor_only().render(&view(size));
    let real_transfer = transfer(&real, step, |_| 1.0);
    let shading = real_transfer.coefficients.get(..16).map_or(0.0, |row| shade(&light(), row));
    let code = srgb8_from_linear(0.4 / MEAN_ALBEDO * shading);
    Case {
        frame: RgbdFrame { color_srgb: Image::new(size, [code; 3]), ..RgbdFrame::default() },
        merged: real.clone(),
        real,
        layer: VirtualLayer::empty(size),
        merged_transfer: real_transfer.clone(),
        real_transfer,
        indirect: None,
        light: light(),
    }
}

/// A ball stands on the floor; `visible` is what remains visible from a point of both.
pub fn ball(size: Size, step: usize, visible: impl Fn(Vec3) -> f32) -> Case {
    let mut case = bare(size, step);
    case.merged = with_virtual(&case.real, &AnalyticScene::new([BALL]));
    case.merged_transfer = transfer(&case.merged, step, visible);
    for y in 0..size.height {
        for x in 0..size.width {
            if case.merged.origin[(x, y)] == Origin::Virtual {
                case.layer.coverage[(x, y)] = 1.0;
                case.layer.albedo[(x, y)] = [0.6, 0.3, 0.2];
            }
        }
    }
    case
}

/// Darkens the floor around the ball's foot, and the ball towards it; 1 farther than 0.5 m.
pub fn shadow(p: Vec3) -> f32 {
    let near = 1.0 - (Vec2::new(p.x, p.y).length() / 0.5).min(1.0);
    1.0 - 0.7 * near * (1.0 - p.z)
}

pub fn shade(light: &ShLight, row: &[f32]) -> f32 {
    row.iter().zip(&light.coefficients).map(|(t, l)| t * l[0]).sum()
}

impl Case {
    pub fn input(&self) -> ComposeInput<'_> {
        ComposeInput {
            frame: &self.frame,
            real: &self.real,
            merged: &self.merged,
            layer: &self.layer,
            real_transfer: &self.real_transfer,
            merged_transfer: &self.merged_transfer,
            indirect: self.indirect.as_ref(),
            light: &self.light,
            mean_albedo: MEAN_ALBEDO,
        }
    }

    pub fn compose(&self, params: &CompositingParams) -> Image<[u8; 3]> {
        // poison: every pixel must be written
        let mut out = Image::new(Size::new(3, 3), [77; 3]);
        CompositingStage::new(params).compose(&self.input(), &mut out);
        out
    }

    pub fn is_virtual(&self, x: usize, y: usize) -> bool {
        self.merged.origin[(x, y)] == Origin::Virtual
    }

    pub fn pixels(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let size = self.merged.size();
        (0..size.height).flat_map(move |y| (0..size.width).map(move |x| (x, y)))
    }

    pub fn set_bounce(&mut self, rgb: [f32; 3]) {
        let TransferMap { step, grid, .. } = self.merged_transfer;
        self.indirect = Some(IndirectMap { step, grid, rgb: vec![rgb; grid.pixels()] });
    }
}

/// Every compositor with every way of up-sampling.
pub fn all_params() -> Vec<CompositingParams> {
    let mut all = Vec::new();
    for compositor in [Compositor::Ratio, Compositor::Difference] {
        for upsampling in [Upsampling::JointBilateral, Upsampling::BicubicGauss] {
            all.push(CompositingParams { compositor, upsampling, ..CompositingParams::default() });
        }
    }
    all
}
