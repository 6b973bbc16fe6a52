//! A scene as data: objects, lights, what moves, and how the camera is held.

use super::light::{AreaLight, Environment};
use super::material::{Albedo, Material};
use super::mesh::{Mesh, MeshData};
use super::shape::Shape;
use super::tracer::World;
use super::{ball, virtual_object};
use crate::image::Image;
use crate::math::bvh::Aabb;
use crate::math::color::LINEAR_FROM_SRGB8;
use crate::math::{Pose, pose_from_xyzw};
use glam::{Affine3A, DMat3, DQuat, DVec3, Quat, Vec3, Vec3A};
use std::sync::Arc;

/// Everything that makes one sequence. World axes: z up, metres; the table top, where there is
/// one, is z = 0.
#[derive(Clone, Debug)]
pub struct Scene {
    pub name: &'static str,
    pub note: &'static str,
    pub objects: Vec<Object>,
    pub lights: Vec<NamedLight>,
    pub environment: Environment,
    pub motions: Vec<Motion>,
    pub camera_path: CameraPath,
    /// Factor from radiance to linear picture values.
    pub exposure: f32,
    /// Where the true light is given.
    pub centre: DVec3,
    /// Clear of objects, above the centre: what really arrives there is given too.
    pub probe: DVec3,
    /// Where the virtual object stands.
    pub virtual_at: Vec3,
    pub virtual_kind: VirtualKind,
}

/// What stands in a scene virtually; all are Lambertian.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VirtualKind {
    /// The figure of [`super::virtual_object`].
    Figure,
    /// A ball of [`super::ball::RADIUS_M`] in one grey.
    Diffuse,
    /// The same ball, its left half saturated red, its right half saturated green.
    Coloured,
    /// The same ball, its left half nearly white, its right half nearly black.
    BrightDark,
}

impl VirtualKind {
    pub const ALL: [Self; 4] = [Self::Figure, Self::Diffuse, Self::Coloured, Self::BrightDark];

    pub fn name(self) -> &'static str {
        match self {
            Self::Figure => "figure",
            Self::Diffuse => "diffuse",
            Self::Coloured => "coloured",
            Self::BrightDark => "bright-dark",
        }
    }

    pub fn by_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Mesh in glTF axes (+y up, origin at the foot) and sRGB texture.
    pub fn mesh(self) -> (MeshData, Image<[u8; 3]>) {
        match self {
            Self::Figure => virtual_object::figure(),
            Self::Diffuse => ball::painted([[0.6; 3]; 2]),
            Self::Coloured => ball::painted([[0.65, 0.03, 0.02], [0.04, 0.42, 0.06]]),
            Self::BrightDark => ball::painted([[0.9; 3], [0.05; 3]]),
        }
    }
}

#[derive(Clone, Debug)]
pub struct NamedLight {
    pub name: String,
    pub light: AreaLight,
}

#[derive(Clone, Debug)]
pub struct Object {
    pub shape: Shape,
    pub material: Material,
    /// Rigid; in the axes of its motion where it has one.
    pub pose: Affine3A,
    /// Index into the scene's motions.
    pub motion: Option<usize>,
}

impl Object {
    pub fn new(shape: Shape, material: Material, at: Vec3) -> Self {
        Self { shape, material, pose: Affine3A::from_translation(at), motion: None }
    }

    /// Turned about its own +z.
    pub fn yawed(self, degrees: f32) -> Self {
        self.rotated(Quat::from_rotation_z(degrees.to_radians()))
    }

    /// Turned about its own origin.
    pub fn rotated(mut self, rotation: Quat) -> Self {
        self.pose *= Affine3A::from_quat(rotation);
        self
    }

    pub fn moving(mut self, motion: usize) -> Self {
        self.motion = Some(motion);
        self
    }
}

/// Rigid motion through keys; what it carries is there from the first key to the last.
#[derive(Clone, Debug)]
pub struct Motion {
    pub keys: Vec<Key>,
}

#[derive(Clone, Copy, Debug)]
pub struct Key {
    pub time_s: f32,
    pub position: Vec3,
    pub rotation: Quat,
}

impl Motion {
    /// `None` before the first and after the last key. Positions follow a Catmull-Rom curve.
    pub fn pose(&self, time_s: f32) -> Option<Affine3A> {
        let keys = &self.keys;
        let next = keys.iter().position(|k| k.time_s >= time_s)?;
        if next == 0 {
            let first = &keys[0];
            return (first.time_s == time_s)
                .then(|| Affine3A::from_rotation_translation(first.rotation, first.position));
        }
        let (a, b) = (&keys[next - 1], &keys[next]);
        let before = keys[next.saturating_sub(2)].position;
        let after = keys[(next + 1).min(keys.len() - 1)].position;
        let s = (time_s - a.time_s) / (b.time_s - a.time_s);
        let (out, into) = ((b.position - before) * 0.5, (after - a.position) * 0.5);
        let (s2, s3) = (s * s, s * s * s);
        let position = a.position * (2.0 * s3 - 3.0 * s2 + 1.0)
            + out * (s3 - 2.0 * s2 + s)
            + b.position * (3.0 * s2 - 2.0 * s3)
            + into * (s3 - s2);
        let rotation = a.rotation.slerp(b.rotation, s);
        Some(Affine3A::from_rotation_translation(rotation, position))
    }
}

/// A camera held by hand: it looks from `eye` at `target`, both sway slowly and tremble a little.
#[derive(Clone, Copy, Debug)]
pub struct CameraPath {
    pub eye: DVec3,
    pub target: DVec3,
    pub eye_swing: DVec3,
    pub target_swing: DVec3,
    pub roll_rad: f64,
    pub period_s: f64,
}

impl CameraPath {
    /// Camera-to-world. Rounded to the eight decimals that pose files carry, so that the pose that
    /// is written is the pose that was rendered.
    pub fn pose(&self, time_s: f64) -> Pose {
        let turn = std::f64::consts::TAU * time_s / self.period_s;
        let wave = |rate: f64, phase: f64| (turn * rate + phase).sin();
        let slow = DVec3::new(wave(1.0, 0.0), wave(0.83, 1.1), wave(1.21, 2.3));
        let tremble = DVec3::new(wave(7.3, 0.4), wave(6.1, 2.0), wave(8.7, 4.1));
        let eye = self.eye + self.eye_swing * (slow + 0.03 * tremble);
        let lag = DVec3::new(wave(0.9, 0.7), wave(1.1, 2.9), wave(0.7, 1.7));
        let target = self.target
            + self.target_swing * (lag + 0.04 * DVec3::new(tremble.z, tremble.x, tremble.y));
        let forward = (target - eye).normalize();
        let roll = self.roll_rad * wave(0.77, 0.5);
        let level = forward.cross(DVec3::Z).normalize();
        let right = level * roll.cos() + level.cross(forward) * -roll.sin();
        let down = forward.cross(right);
        let q = DQuat::from_mat3(&DMat3::from_cols(right, down, forward));
        let round = |v: f64| (v * 1e8).round() / 1e8;
        pose_from_xyzw(eye.to_array().map(round), q.to_array().map(round))
            .expect("a unit quaternion and a finite position")
    }
}

/// An object at one time, ready for rays.
#[derive(Clone, Debug)]
pub struct Placed {
    pub shape: Shape,
    pub material: Material,
    pub world_from_object: Affine3A,
    pub object_from_world: Affine3A,
    pub bounds: Aabb,
}

impl Placed {
    pub fn new(shape: Shape, material: Material, world_from_object: Affine3A) -> Self {
        let corners = shape.bounds().corners();
        Self {
            bounds: Aabb::of_points(corners.map(|c| world_from_object.transform_point3a(c))),
            object_from_world: world_from_object.inverse(),
            shape,
            material,
            world_from_object,
        }
    }
}

impl Scene {
    /// The objects that are there at a time.
    pub fn placed(&self, time_s: f64) -> Vec<Placed> {
        let carriers: Vec<Option<Affine3A>> =
            self.motions.iter().map(|m| m.pose(time_s as f32)).collect();
        self.objects
            .iter()
            .filter_map(|object| {
                let pose = match object.motion {
                    Some(index) => carriers[index]? * object.pose,
                    None => object.pose,
                };
                Some(Placed::new(object.shape.clone(), object.material.clone(), pose))
            })
            .collect()
    }

    /// Everything but the virtual object, at a time, ready for rays.
    pub fn world_at(&self, time_s: f64) -> World {
        self.world_of(self.placed(time_s))
    }

    /// These objects under the scene's light.
    pub fn world_of(&self, objects: Vec<Placed>) -> World {
        World::new(objects, self.area_lights(), self.environment.clone())
    }

    /// Where it stands, ready for rays.
    pub fn virtual_object(&self) -> Placed {
        let (mesh, texture) = self.virtual_kind.mesh();
        let linear = texture.as_slice().iter().map(|c| c.map(|v| LINEAR_FROM_SRGB8[v as usize]));
        let picture = Image::from_vec(texture.size(), linear.collect());
        Placed::new(
            Shape::Mesh(Arc::new(Mesh::new(mesh))),
            Material::of(Albedo::Picture(Arc::new(picture))),
            virtual_object::world_from_figure(self.virtual_at, 0.0),
        )
    }

    pub fn area_lights(&self) -> Vec<AreaLight> {
        self.lights.iter().map(|l| l.light).collect()
    }

    /// Replaces the lights by one of four on a half circle around the centre (Gruber et al. 2015,
    /// Sec. 6.2), on the camera's side; the environment stays as fill.
    pub fn with_half_circle_light(mut self, index: usize) -> Self {
        self.lights = vec![half_circle_light(self.centre.as_vec3().into(), index)];
        self
    }
}

pub const HALF_CIRCLE_LIGHTS: usize = 4;

/// Light `index` of [`HALF_CIRCLE_LIGHTS`]: from the left (-x), over the camera's side (-y), to the
/// right (+x), 50 degrees high.
pub fn half_circle_light(centre: Vec3A, index: usize) -> NamedLight {
    let azimuth_deg = 180.0 + 180.0 * index as f32 / (HALF_CIRCLE_LIGHTS - 1) as f32;
    let light = light_around(centre, azimuth_deg, 50.0);
    NamedLight { name: format!("light_{index}"), light }
}

/// A white lamp, 0.6 m square, 1.9 m from the centre, which it faces; azimuth counts from +x
/// towards +y.
pub fn light_around(centre: Vec3A, azimuth_deg: f32, elevation_deg: f32) -> AreaLight {
    let (azimuth, elevation) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
    let towards = Vec3A::new(
        elevation.cos() * azimuth.cos(),
        elevation.cos() * azimuth.sin(),
        elevation.sin(),
    );
    AreaLight::facing(centre + towards * 1.9, centre, 0.6, Vec3A::splat(26.0))
}
