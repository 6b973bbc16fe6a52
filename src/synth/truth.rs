//! The true light of a sequence (`light.json`) and where its virtual object is (`virtual.json`,
//! `scene.toml`).

use super::light::{AreaLight, Environment, Sh, add_direction, area_light_sh};
use super::sampler::Sampler;
use super::scene::{NamedLight, Scene};
use super::tracer::World;
use crate::math::bvh::Ray;
use crate::math::color::luminance;
use crate::math::fibonacci_sphere_f64;
use glam::{DVec3, Vec3A};
use rayon::prelude::*;
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::ops::RangeInclusive;

const CONVENTION: &str = "real orthonormal, 4 bands, l major, m=-l..l, no Condon-Shortley phase: \
    l=1 is (+y,+z,+x)*0.4886; world axes; scaled by exposure: linear pixel value of a Lambertian \
    surface = albedo/pi * integral(L cos); sh_rgb has one [r, g, b] a coefficient, sh is its \
    Rec. 709 luminance";

/// Light of all sources at a point, nothing in between: area lights, and the environment.
pub fn source_sh(scene: &Scene) -> (Sh, Sh) {
    let mut area = Sh::default();
    for light in &scene.lights {
        add(&mut area, &area_light_sh(&light.light, scene.centre), 1.0);
    }
    (area, scene.environment.sh())
}

fn add(to: &mut Sh, from: &Sh, factor: f64) {
    for (a, b) in to.as_flattened_mut().iter_mut().zip(from.as_flattened()) {
        *a += b * factor;
    }
}

/// Everything that arrives at the probe point, light that the scene scatters included.
pub fn probe_sh(scene: &Scene, world: &World, bounces: u32) -> Sh {
    const DIRECTIONS: usize = 1 << 15;
    let directions: Vec<DVec3> = fibonacci_sphere_f64(DIRECTIONS).collect();
    let arriving: Vec<(DVec3, [f64; 3])> = directions
        .into_par_iter()
        .enumerate()
        .map(|(i, direction)| {
            let ray = Ray::new(scene.probe.as_vec3a(), direction.as_vec3a());
            let mut sampler = Sampler::new(&[0x9b0b_e001, i as u32], 0);
            let radiance = world.radiance(ray, bounces, &mut sampler).as_dvec3();
            (direction, (radiance * (4.0 * PI / DIRECTIONS as f64)).to_array())
        })
        .collect();
    let mut out = Sh::default();
    for (direction, radiance) in arriving {
        add_direction(&mut out, direction, radiance);
    }
    for light in &scene.lights {
        add_visible(&mut out, &light.light, scene.probe, world);
    }
    out
}

/// The first step of a path does not see area lights: here they are, as far as they are visible.
fn add_visible(out: &mut Sh, light: &AreaLight, point: DVec3, world: &World) {
    for (direction, distance, angle) in light.patches(point, 48) {
        let d: Vec3A = direction.as_vec3a();
        if !world.occluded(point.as_vec3a(), d, distance as f32) {
            let radiance = light.radiance().as_dvec3().to_array().map(|r| r * angle);
            add_direction(out, direction, radiance);
        }
    }
}

fn luminances(sh: &Sh, exposure: f64) -> Vec<f64> {
    // f32 weights, as everywhere in the program; the channels keep f64
    let [r, g, b] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(luminance);
    let weights = [r, g, b].map(f64::from);
    sh.iter().map(|c| exposure * c.iter().zip(weights).map(|(v, w)| v * w).sum::<f64>()).collect()
}

fn scaled(sh: &Sh, exposure: f64) -> Vec<[f64; 3]> {
    sh.iter().map(|c| c.map(|v| v * exposure)).collect()
}

fn direction_of_band_1(sh: &[f64]) -> Option<[f64; 3]> {
    DVec3::new(sh[3], sh[1], sh[2]).try_normalize().map(|d| d.to_array())
}

/// Frames with one light.
#[derive(Clone, Debug)]
pub struct Segment {
    pub frames: RangeInclusive<usize>,
    pub scene: Scene,
}

/// `light.json`; `segments` differ in their lamps alone. What moves is where it is at the start.
pub fn light_json(segments: &[Segment], bounces: u32) -> Value {
    let Scene { name, note, centre, probe, exposure, environment, .. } = &segments[0].scene;
    let environment = match environment {
        Environment::Uniform(_) => "uniform",
        Environment::LatLong(_) => "lat-long",
    };
    let segments: Vec<Value> = segments.iter().map(|s| segment_json(s, bounces)).collect();
    json!({
        "sequence": name,
        "scene": name,
        "note": note,
        "world": "right-handed, metres, z up; directions point towards the light",
        "center": centre.to_array(),
        "probe_point": probe.to_array(),
        "exposure": exposure,
        "environment": environment,
        "sh_convention": CONVENTION,
        "segments": segments,
    })
}

fn segment_json(segment: &Segment, bounces: u32) -> Value {
    let scene = &segment.scene;
    let (area, ambient) = source_sh(scene);
    let mut sources = area;
    add(&mut sources, &ambient, 1.0);
    let probe = probe_sh(scene, &scene.world_at(0.0), bounces);
    let exposure = f64::from(scene.exposure);
    let [sh, sh_area, sh_ambient, sh_probe] =
        [&sources, &area, &ambient, &probe].map(|sh| luminances(sh, exposure));
    // One lamp: the direction of its centre, as for the mitsuba sequences; several: that of all.
    let dominant = match scene.lights.as_slice() {
        [one] => {
            let towards = one.light.centre().as_dvec3() - scene.centre;
            towards.try_normalize().map(|d| d.to_array())
        }
        [] => direction_of_band_1(&sh),
        _ => direction_of_band_1(&sh_area),
    };
    json!({
        "first_frame": segment.frames.start(),
        "last_frame": segment.frames.end(),
        "lights": lights_json(scene),
        "dominant_direction": dominant,
        "strongest_light": strongest(scene),
        "sh": sh,
        "sh_ambient": sh_ambient,
        "sh_area": sh_area,
        "sh_probe": sh_probe,
        "sh_rgb": scaled(&sources, exposure),
        "sh_probe_rgb": scaled(&probe, exposure),
        "dominant_direction_sh": direction_of_band_1(&sh),
        "dominant_direction_probe": direction_of_band_1(&sh_probe),
    })
}

fn lights_json(scene: &Scene) -> serde_json::Map<String, Value> {
    let entry = |named: &NamedLight| {
        let position = named.light.centre().as_dvec3();
        let direction = (position - scene.centre).normalize_or_zero();
        let [half_u, half_v] = named.light.half_sides();
        let entry = json!({
            "position": position.to_array(),
            "radiance": named.light.radiance().to_array(),
            "half_u": half_u.to_array(),
            "half_v": half_v.to_array(),
            "factor": 1.0,
            "direction_from_center": direction.to_array(),
        });
        (named.name.clone(), entry)
    };
    scene.lights.iter().map(entry).collect()
}

/// The lamp that gives most light at the centre.
fn strongest(scene: &Scene) -> Option<&str> {
    let amount = |light: &AreaLight| {
        let rgb = area_light_sh(light, scene.centre)[0].map(|v| v as f32);
        luminance(rgb)
    };
    scene
        .lights
        .iter()
        .max_by(|a, b| amount(&a.light).total_cmp(&amount(&b.light)))
        .map(|named| named.name.as_str())
}

pub const OBJECT_FILE: &str = "object.glb";

/// `virtual.json`: the object, and the frames that have a picture with it.
pub fn virtual_json(scene: &Scene, composites: &[(usize, f64)]) -> Value {
    let mut out = json!({
        "kind": "mesh",
        "name": scene.virtual_kind.name(),
        "file": OBJECT_FILE,
        "at": scene.virtual_at.to_array(),
        "yaw_deg": 0.0,
        "scale": 1.0,
    });
    out["frames"] = composites.iter().map(|&(frame, _)| json!(frame)).collect();
    out["timestamps"] = composites.iter().map(|&(_, t)| json!(format!("{t:.6}"))).collect();
    out["note"] = json!(
        "world frame of groundtruth.txt; Lambertian; composite/<t> is path traced with the object, \
         rgb/<t> without it, same light and exposure; composite/<t>.mask.png \
         marks its pixels, composite/<t>.depth.png is the depth with it"
    );
    out
}

/// `scene.toml`: where the object stands.
pub fn scene_toml(scene: &Scene) -> String {
    let at = scene.virtual_at;
    format!(
        "# World axes of the sequence's poses, z up, metres; the object's +y stands along world +z.\n\
         [[object]]\nfile = \"{OBJECT_FILE}\"\nat = [{:?}, {:?}, {:?}]\nyaw_deg = 0.0\nscale = 1.0\n",
        at.x, at.y, at.z
    )
}
