//! Made cameras, surfaces and pictures whose truth is known.

use glam::{DVec3, Vec3};
use kinlight::capture::RgbdFrame;
use kinlight::geometry::{GBuffer, Origin};
use kinlight::image::{Image, Size};
use kinlight::lighting::ShLight;
use kinlight::math::color::srgb8_from_linear;
use kinlight::math::random::Rng;
use kinlight::math::{Pinhole, Pose, View, sh};
use kinlight::transfer::TransferMap;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f32::consts::PI;

/// Small: the graphics device may be this machine's processor.
pub const SIZE: Size = Size::new(64, 48);

/// Half a rounding of f32, relative.
pub const ROUNDING: f64 = 0.5 * f32::EPSILON as f64;

pub fn camera(size: Size) -> Pinhole {
    let (w, h) = (size.width as f32, size.height as f32);
    let (cx, cy) = (0.5 * w - 0.5, 0.5 * h - 0.5);
    Pinhole { width: size.width, height: size.height, fx: 0.82 * w, fy: 0.82 * w, cx, cy }
}

/// Looks from `eye` to `target`, both in metres, with world z up.
pub fn look_at(eye: [f64; 3], target: [f64; 3]) -> Pose {
    let (eye, target) = (Vector3::from(eye), Vector3::from(target));
    let forward = (target - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let axes = Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    let rotation = Rotation3::from_matrix_unchecked(axes);
    Pose::from_parts(Translation3::from(eye), UnitQuaternion::from_rotation_matrix(&rotation))
}

/// A place from which the corner scene shows floor, walls, box and ball.
pub fn corner_view(size: Size) -> View {
    View::perspective(camera(size), look_at([1.0, -1.1, 0.9], [-0.1, 0.15, 0.1]))
}

pub fn motion(translation_m: [f64; 3], rotation_deg: [f64; 3]) -> Pose {
    Pose::new(Vector3::from(translation_m), Vector3::from(rotation_deg).map(f64::to_radians))
}

/// A frame with all pictures, uniformly grey.
pub fn grey_frame(depth_m: Image<f32>) -> RgbdFrame {
    let size = depth_m.size();
    RgbdFrame {
        color_srgb: Image::new(size, [120; 3]),
        color: Image::new(size, [0.2; 3]),
        intensity: Image::new(size, 120.0),
        depth_m,
        ..RgbdFrame::default()
    }
}

/// The image of a function of pixels.
pub fn image<T: Clone>(size: Size, mut pixel: impl FnMut(usize, usize) -> T) -> Image<T> {
    let at = |k: usize| (k % size.width, k / size.width);
    Image::from_vec(size, (0..size.pixels()).map(|k| pixel(at(k).0, at(k).1)).collect())
}

/// The ray of a pixel in f64, one metre deep.
pub fn ray(camera: &Pinhole, u: f64, v: f64) -> DVec3 {
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(f64::from);
    DVec3::new((u - cx) / fx, (v - cy) / fy, 1.0)
}

/// The deepest f64 has of a plane `normal . p = offset` in camera axes.
pub fn plane_depth_m(camera: &Pinhole, normal: DVec3, offset_m: f64, u: f64, v: f64) -> f64 {
    offset_m / normal.dot(ray(camera, u, v))
}

/// Point k of a Fibonacci sphere of n points, with z in (min_z, 1).
pub fn on_sphere(k: usize, n: usize, min_z: f32) -> Vec3 {
    let z = 1.0 - (1.0 - min_z) * (k as f32 + 0.5) / n as f32;
    let (s, c) = (PI * (3.0 - 5f32.sqrt()) * k as f32).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vec3::new(r * c, r * s, z)
}

/// Uniform on the sphere.
pub fn random_direction(rng: &mut Rng) -> Vec3 {
    loop {
        let v = Vec3::from([0; 3].map(|_| 2.0 * rng.uniform() - 1.0));
        if v.length_squared() <= 1.0 && v.length_squared() > 1e-3 {
            return v.normalize();
        }
    }
}

/// A picture of surfaces 1 m before the camera, and what lights them.
#[derive(Clone)]
pub struct Picture {
    pub frame: RgbdFrame,
    pub surface: GBuffer,
    pub transfer: TransferMap,
}

impl Picture {
    /// Unoccluded surfaces of albedo 1, in the colour that f64 gives them under `light`.
    pub fn open(size: Size, light: &ShLight, normal: impl Fn(usize) -> Vec3) -> Self {
        let mut surface = GBuffer::empty(View::perspective(camera(size), Pose::identity()));
        let n = sh::coefficients(light.bands);
        let mut coefficients = Vec::with_capacity(size.pixels() * n);
        for k in 0..size.pixels() {
            let at = (k % size.width, k / size.width);
            surface.depth_m[at] = 1.0;
            surface.normals.set(at.0, at.1, normal(k));
            surface.origin[at] = Origin::Model;
            coefficients.extend(&sh::unoccluded_transfer(normal(k), light.bands)[..n]);
        }
        let transfer = TransferMap { bands: light.bands, step: 1, grid: size, coefficients };
        Self::lit(surface, transfer, light)
    }

    /// Surfaces of albedo 1 with this transfer, at every pixel.
    pub fn lit(surface: GBuffer, transfer: TransferMap, light: &ShLight) -> Self {
        let color = image(surface.size(), |x, y| shade(light, transfer.at(x, y)));
        Self { frame: frame_of(color), surface, transfer }
    }

    pub fn colored(&self, change: impl FnMut(usize, [f32; 3]) -> [f32; 3]) -> Self {
        let (size, mut change) = (self.surface.size(), change);
        let color = image(size, |x, y| change(y * size.width + x, self.frame.color[(x, y)]));
        Self { frame: frame_of(color), ..self.clone() }
    }

    pub fn noisy(&self, deviation: f32, rng: &mut Rng) -> Self {
        self.colored(|_, rgb| {
            let noise = deviation * rng.normal();
            rgb.map(|v| v + noise)
        })
    }
}

fn frame_of(color: Image<[f32; 3]>) -> RgbdFrame {
    let size = color.size();
    let srgb = color.as_slice().iter().map(|c| c.map(srgb8_from_linear)).collect();
    let frame = grey_frame(Image::new(size, 1.0));
    RgbdFrame { color_srgb: Image::from_vec(size, srgb), color, ..frame }
}

/// T.l in f64.
pub fn shade(light: &ShLight, row: &[f32]) -> [f32; 3] {
    std::array::from_fn(|c| {
        let terms = row.iter().zip(&light.coefficients);
        terms.map(|(t, l)| f64::from(*t) * f64::from(l[c])).sum::<f64>() as f32
    })
}

/// Ambient light of radiance `ambient`, and lobes: directions with the irradiance of a surface that faces them.
pub fn lamps(bands: usize, ambient: f32, lobes: &[(Vec3, f32)]) -> ShLight {
    let mut coefficients = vec![0.0; sh::coefficients(bands)];
    coefficients[0] = ambient * (4.0 * PI).sqrt();
    for &(towards, irradiance) in lobes {
        let basis = sh::basis(towards, bands);
        coefficients.iter_mut().zip(basis).for_each(|(c, y)| *c += irradiance * y);
    }
    ShLight { bands, coefficients: coefficients.into_iter().map(|c| [c; 3]).collect() }
}
