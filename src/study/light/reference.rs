//! The paper's reference method (Gruber et al. 2015, Sec. 6.2): a grey diffuse ball in view, whose
//! normals are known exactly, and the same solver.

use super::observe::Observation;
use crate::capture::RgbdFrame;
use crate::config::Settings;
use crate::geometry::{GBuffer, Origin};
use crate::image::Image;
use crate::lighting::LightEstimator;
use crate::math::bvh::Ray;
use crate::math::color::LINEAR_FROM_SRGB8;
use crate::math::{Pinhole, Pose, View, fibonacci_sphere, pose_from_xyzw, sh};
use crate::stop::Stop;
use crate::study::StudyError;
use crate::synth::material::Material;
use crate::synth::scene::{Placed, Scene};
use crate::synth::shape::Shape;
use crate::synth::tracer::{Shot, World, render_centres, render_radiance};
use crate::synth::{SynthError, SynthOptions, developed};
use crate::transfer::TransferMap;
use glam::{Affine3A, DMat3, DQuat, DVec3, Vec2, Vec3A, dvec3};
use std::ops::Range;

/// What light reaches the ball.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Probe {
    /// That of the lamp and the environment, after the room has shadowed and scattered it: what a
    /// real light probe sees.
    InRoom,
    /// That of the lamp and the environment alone: what is left is the error of the solver itself.
    Alone,
}

impl Probe {
    pub const ALL: [Probe; 2] = [Probe::InRoom, Probe::Alone];

    pub fn name(self) -> &'static str {
        match self {
            Probe::InRoom => super::REFERENCE,
            Probe::Alone => super::REFERENCE_ALONE,
        }
    }
}

const ALBEDO: f32 = 0.6;

const RADIUS_M: f64 = 0.04;

/// Nothing may be nearer to the ball's centre.
const CLEARANCE_M: f32 = 0.045;

/// Heights above the scene's centre that are tried, and the step between them.
const LIFT_STEP_M: f64 = 0.02;
const LIFT_STEPS: usize = 30;

/// The ball is looked at closely from where the camera is, so that the result does not depend on the
/// sequence's resolution: side of the square picture, and the share of it that the ball covers.
const SIDE: usize = 96;
const COVERED: f64 = 0.9;

const SAMPLES: u32 = 16;

/// Estimates from the ball for these frames of a sequence; `tick` is called after each.
pub(super) fn observe_probe(
    probe: Probe,
    options: &SynthOptions,
    settings: &Settings,
    frames: Range<usize>,
    stop: &Stop,
    tick: &dyn Fn(),
) -> Result<Vec<Observation>, StudyError> {
    let stage = Stage::new(probe, options)?;
    let mut estimator = LightEstimator::new(&settings.light);
    let mut transfer = TransferMap::default();
    let observed = frames.map(|index| {
        stop.check()?;
        let (frame, surface) = stage.look(index);
        unoccluded_transfer(&surface, settings.transfer.bands, &mut transfer);
        let estimate = estimator.estimate(&frame, &surface, &transfer, None);
        tick();
        Ok(Observation::new(index, &estimate, None, None))
    });
    observed.collect()
}

/// The ball in its surroundings.
struct Stage<'a> {
    options: &'a SynthOptions,
    scene: Scene,
    world: World,
    centre: DVec3,
    /// The ball's index in the world.
    ball: u32,
}

impl<'a> Stage<'a> {
    fn new(probe: Probe, options: &'a SynthOptions) -> Result<Self, StudyError> {
        let mut scene = first_scene(options)?;
        // The probe is measured in the room as it is without passing hands.
        scene.objects.retain(|object| object.motion.is_none());
        let room = scene.placed(0.0);
        let centre =
            free_place(&room, &scene.world_of(room.clone()), scene.centre).ok_or_else(|| {
                let name = &options.scene;
                StudyError::Options(format!(
                    "{name} has no room for a light probe above its centre"
                ))
            })?;
        let mut objects = match probe {
            Probe::InRoom => room,
            Probe::Alone => Vec::new(),
        };
        let ball = objects.len() as u32;
        let material = Material::diffuse(ALBEDO, ALBEDO, ALBEDO);
        let place = Affine3A::from_translation(centre.as_vec3());
        objects.push(Placed::new(Shape::sphere(RADIUS_M as f32), material, place));
        Ok(Self { world: scene.world_of(objects), options, scene, centre, ball })
    }

    /// The picture of the ball, and its surface.
    fn look(&self, index: usize) -> (RgbdFrame, GBuffer) {
        let of_sequence = self.options.shot(&self.scene, index);
        let position = of_sequence.world_from_camera.translation.vector;
        let eye = dvec3(position.x, position.y, position.z);
        let shot = Shot {
            camera: close_up(eye.distance(self.centre)),
            world_from_camera: looking_at(eye, self.centre),
            samples: SAMPLES,
            ..of_sequence
        };
        let radiance = render_radiance(&self.world, &shot);
        let color_srgb = developed(&radiance, self.scene.exposure, None);
        let linear = color_srgb.as_slice().iter().map(|c| c.map(|v| LINEAR_FROM_SRGB8[v as usize]));
        let surface = self.surface(&shot);
        let frame = RgbdFrame {
            index,
            color: Image::from_vec(color_srgb.size(), linear.collect()),
            depth_m: surface.depth_m.clone(),
            world_from_camera: Some(shot.world_from_camera),
            color_srgb,
            ..RgbdFrame::default()
        };
        (frame, surface)
    }

    /// Only the ball is a surface, with its exact normals.
    fn surface(&self, shot: &Shot) -> GBuffer {
        let view = View::perspective(shot.camera, shot.world_from_camera);
        let world_from_view = view.world_from_view_f32();
        let hits = render_centres(&self.world, shot);
        let mut surface = GBuffer::empty(view);
        for y in 0..SIDE {
            for x in (0..SIDE).filter(|&x| hits.object[(x, y)] == self.ball) {
                let depth_m = hits.depth_m[(x, y)];
                let in_view = view.unproject(Vec2::new(x as f32, y as f32), depth_m);
                let point = world_from_view.transform_point3(in_view).as_dvec3();
                let normal = (point - self.centre).normalize_or_zero();
                surface.depth_m[(x, y)] = depth_m;
                surface.normals.set(x, y, normal.as_vec3());
                surface.origin[(x, y)] = Origin::Model;
            }
        }
        surface
    }
}

fn first_scene(options: &SynthOptions) -> Result<Scene, SynthError> {
    Ok(options.segments()?.swap_remove(0).scene)
}

fn unoccluded_transfer(surface: &GBuffer, bands: usize, out: &mut TransferMap) {
    let n = sh::coefficients(bands);
    (out.bands, out.step, out.grid) = (bands, 1, surface.size());
    out.coefficients.clear();
    out.coefficients.resize(n * out.grid.pixels(), 0.0);
    for (i, row) in out.coefficients.chunks_mut(n).enumerate() {
        let (x, y) = (i % out.grid.width, i / out.grid.width);
        if surface.depth_m[(x, y)] > 0.0 {
            let normal = surface.normals.at(x, y);
            row.copy_from_slice(&sh::unoccluded_transfer(normal, bands)[..n]);
        }
    }
}

/// The lowest place at or above `centre` where the ball touches nothing.
fn free_place(room: &[Placed], world: &World, centre: DVec3) -> Option<DVec3> {
    (0..LIFT_STEPS)
        .map(|step| centre + DVec3::Z * (LIFT_STEP_M * step as f64))
        .find(|place| is_free(room, world, place.as_vec3a()))
}

/// Rays on a Fibonacci sphere, 2.5 degrees apart: none meets anything near, and most of those that meet
/// something meet it from outside.
fn is_free(room: &[Placed], world: &World, place: Vec3A) -> bool {
    const RAYS: usize = 4096;
    let mut from_inside = 0;
    for direction in fibonacci_sphere(RAYS) {
        let direction = direction.to_vec3a();
        let Some((object, hit)) = world.hit(&Ray::new(place, direction)) else { continue };
        if hit.t < CLEARANCE_M {
            return false;
        }
        let outwards = room[object].world_from_object.transform_vector3a(hit.normal);
        from_inside += usize::from(outwards.dot(direction) > 0.0);
    }
    from_inside < RAYS / 2
}

fn close_up(distance_m: f64) -> Pinhole {
    // The ball's silhouette lies at this tangent from the picture's centre.
    let tangent = RADIUS_M / (distance_m * distance_m - RADIUS_M * RADIUS_M).sqrt();
    let focal = (0.5 * COVERED * SIDE as f64 / tangent) as f32;
    let centre = (SIDE as f32 - 1.0) * 0.5;
    Pinhole { width: SIDE, height: SIDE, fx: focal, fy: focal, cx: centre, cy: centre }
}

fn looking_at(eye: DVec3, target: DVec3) -> Pose {
    let forward = (target - eye).normalize();
    let right = forward.any_orthogonal_vector().normalize();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    pose_from_xyzw(eye.to_array(), DQuat::from_mat3(&axes).to_array())
        .expect("a camera does not stand in its target")
}
