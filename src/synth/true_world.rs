//! The truth of a made sequence that is too large for its files: the exact geometry of any frame,
//! and the light all around as a picture.

use super::options::{SynthError, SynthOptions};
use super::scene::Scene;
use super::tracer::World;
use crate::geometry::{GBuffer, Origin};
use crate::image::{Image, Size};
use crate::math::View;
use crate::math::bvh::Ray;
use crate::output::Panorama;
use glam::{Vec2, Vec3, Vec3A};
use rayon::iter::ParallelIterator;

/// Exact geometry at the time of one frame.
#[derive(Debug)]
pub struct TrueWorld {
    world: World,
    /// Of the virtual object, where it was asked for.
    virtual_index: Option<usize>,
    /// The camera at that frame.
    pub view: View,
}

/// The real scene of a frame, with what moves where it is then.
///
/// # Errors
/// Options out of range, an unknown scene, a frame that the sequence does not have.
pub fn true_world(options: &SynthOptions, frame: usize) -> Result<TrueWorld, SynthError> {
    TrueWorld::new(options, frame, false)
}

/// The same with the virtual object in the scene.
pub fn true_world_with_virtual(
    options: &SynthOptions,
    frame: usize,
) -> Result<TrueWorld, SynthError> {
    TrueWorld::new(options, frame, true)
}

/// The scene of a frame with its light.
fn scene_of(options: &SynthOptions, frame: usize) -> Result<Scene, SynthError> {
    let segments = options.segments()?;
    let found = segments.into_iter().find(|s| s.frames.contains(&frame));
    found.map(|s| s.scene).ok_or_else(|| {
        SynthError::Options(format!("frame {frame} of a sequence of {} frames", options.frames))
    })
}

impl TrueWorld {
    fn new(options: &SynthOptions, frame: usize, with_virtual: bool) -> Result<Self, SynthError> {
        let scene = scene_of(options, frame)?;
        let shot = options.shot(&scene, frame);
        let mut objects = scene.placed(options.time_s(frame));
        let virtual_index = with_virtual.then_some(objects.len());
        objects.extend(with_virtual.then(|| scene.virtual_object()));
        Ok(Self {
            world: scene.world_of(objects),
            virtual_index,
            view: View::perspective(shot.camera, shot.world_from_camera),
        })
    }

    /// Whether anything stands within `max_distance` metres of `point` along the unit `direction`.
    ///
    /// A point on a surface should be lifted off it a little (1e-4 m): rays meet what is before them
    /// from distance 0 on.
    pub fn occluded(&self, point: Vec3, direction: Vec3, max_distance: f32) -> bool {
        self.world.occluded(point.into(), direction.into(), max_distance)
    }

    /// What a view sees of the scene: exact depth, and the normals with which it was rendered.
    pub fn seen_in(&self, view: &View) -> GBuffer {
        let mut out = GBuffer::empty(*view);
        let size = view.size();
        let world_from_view = view.world_from_view_f32();
        for y in 0..size.height {
            for x in 0..size.width {
                let pixel = Vec2::new(x as f32, y as f32);
                // A step of 1 along this direction is 1 m of depth, so t is depth itself.
                let (near, far) = (view.unproject(pixel, 0.0), view.unproject(pixel, 1.0));
                let origin = Vec3A::from(world_from_view.transform_point3(near));
                let direction = Vec3A::from(world_from_view.transform_vector3(far - near));
                let Some(seen) = self.world.seen(&Ray::new(origin, direction)) else { continue };
                let is_virtual = Some(seen.object) == self.virtual_index;
                out.depth_m[(x, y)] = seen.t;
                out.normals.set(x, y, seen.normal.into());
                out.origin[(x, y)] = if is_virtual { Origin::Virtual } else { Origin::Model };
            }
        }
        out
    }
}

/// Points of a pixel, in each direction, that are averaged.
const SUPERSAMPLES: usize = 4;

/// The light of all sources around the scene's centre at a frame, as a lat-long picture of
/// `width` x `width / 2` pixels laid out as `environment.hdr` is; the scene itself is left out.
///
/// Linear RGB radiance times exposure, as the coefficients in `light.json`.
///
/// # Errors
/// As [`true_world`]; a width below 2.
pub fn environment_picture(
    options: &SynthOptions,
    frame: usize,
    width: usize,
) -> Result<Image<[f32; 3]>, SynthError> {
    if width < 2 {
        return Err(SynthError::Options(format!("an environment {width} pixels wide")));
    }
    let scene = scene_of(options, frame)?;
    let size = Size::new(width, width / 2);
    let fine = Size::new(size.width * SUPERSAMPLES, size.height * SUPERSAMPLES);
    let panorama = Panorama::z_up();
    let mut out = Image::new(size, [0.0; 3]);
    out.par_rows_mut().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let mut sum = Vec3A::ZERO;
            for k in 0..SUPERSAMPLES * SUPERSAMPLES {
                let (dx, dy) = (k % SUPERSAMPLES, k / SUPERSAMPLES);
                let at = (x * SUPERSAMPLES + dx, y * SUPERSAMPLES + dy);
                sum += arriving(&scene, panorama.direction(at.0, at.1, fine).as_vec3a());
            }
            let factor = scene.exposure / (SUPERSAMPLES * SUPERSAMPLES) as f32;
            *pixel = (sum * factor).to_array();
        }
    });
    Ok(out)
}

/// Radiance of all sources from a direction at the scene's centre. Lamps hide nothing, so it adds up.
fn arriving(scene: &Scene, direction: Vec3A) -> Vec3A {
    let centre = scene.centre.as_vec3a();
    let lamps = scene.lights.iter().filter_map(|l| l.light.hit(centre, direction));
    scene.environment.radiance(direction) + lamps.map(|seen| seen.radiance).sum::<Vec3A>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::sh;
    use crate::synth::{LightSwitch, generate};
    use std::path::Path;

    fn options(scene: &str) -> SynthOptions {
        SynthOptions {
            scene: scene.into(),
            frames: 4,
            width: 64,
            height: 48,
            samples: 1,
            ..SynthOptions::default()
        }
    }

    fn depth_file(path: &Path) -> Vec<f32> {
        let picture = image::open(path).expect("a picture").into_luma16();
        picture.pixels().map(|p| f32::from(p.0[0]) / 5000.0).collect()
    }

    #[test]
    fn the_true_world_is_what_the_files_show() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let options = SynthOptions { with_virtual: true, ..options("still-life") };
        generate(&options, folder.path(), &|_, _| {}).expect("a free folder");
        for frame in [0, 3] {
            let time = format!("{:.6}", 1000.0 + frame as f64 / 30.0);
            let real = true_world(&options, frame).expect("a frame");
            let both = true_world_with_virtual(&options, frame).expect("a frame");
            let cases = [
                (&real, format!("depth/{time}.png")),
                (&both, format!("composite/{time}.depth.png")),
            ];
            for (world, file) in cases {
                let seen = world.seen_in(&world.view);
                let written = depth_file(&folder.path().join(file));
                for (a, b) in seen.depth_m.as_slice().iter().zip(written) {
                    // files step by 0.2 mm
                    assert!((a - b).abs() < 1.1e-4, "{a} {b}");
                }
            }
            let count = |w: &TrueWorld| {
                let seen = w.seen_in(&w.view);
                seen.origin.as_slice().iter().filter(|&&o| o == Origin::Virtual).count()
            };
            assert!(count(&real) == 0 && count(&both) > 20);
        }
    }

    #[test]
    fn rays_find_what_stands_in_their_way() {
        let world = true_world(&options("sphere"), 0).expect("a frame");
        // The ball of 0.16 m around (-0.12, 0.18, 0.16), from its left.
        let from = Vec3::new(-0.42, 0.18, 0.16);
        assert!(world.occluded(from, Vec3::X, 0.15) && !world.occluded(from, Vec3::X, 0.13));
        assert!(!world.occluded(from, Vec3::Z, 5.0));
        assert!(true_world(&options("sphere"), 4).is_err());
    }

    #[test]
    fn the_picture_of_the_light_has_the_coefficients_of_the_light() {
        let switch = Some(LightSwitch { frame: 2, light: 1 });
        let options = SynthOptions { light: Some(0), switch, ..options("blocks") };
        for frame in [0, 2] {
            let picture = environment_picture(&options, frame, 128).expect("a picture");
            let size = picture.size();
            let panorama = Panorama::z_up();
            let mut found = [0.0; 16];
            for (i, rgb) in picture.as_slice().iter().enumerate() {
                let (x, y) = (i % size.width, i / size.width);
                let edge = |row: usize| (std::f64::consts::PI * row as f64 / 64.0).cos();
                let angle = std::f64::consts::TAU / 128.0 * (edge(y) - edge(y + 1));
                let mut basis = [0.0; sh::MAX_COEFFICIENTS];
                sh::basis_f64(panorama.direction(x, y, size), 4, &mut basis);
                let value = f64::from(crate::math::color::luminance(*rgb)) * angle;
                found.iter_mut().zip(basis).for_each(|(f, b)| *f += b * value);
            }
            let scene = scene_of(&options, frame).expect("a scene");
            let (area, ambient) = crate::synth::truth::source_sh(&scene);
            for i in 0..16 {
                let expected = f64::from(scene.exposure) * (area[i][1] + ambient[i][1]);
                let all = f64::from(scene.exposure) * (area[0][1] + ambient[0][1]);
                // the lamp's outline is sampled at 0.7 degrees, it is 18 degrees wide
                assert!((found[i] - expected).abs() < 0.01 * all, "{frame} {i}");
            }
        }
        assert!(environment_picture(&options, 0, 1).is_err());
        assert!(environment_picture(&options, 4, 8).is_err());
    }
}
