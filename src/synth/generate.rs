//! From a scene's name to a folder with a sequence.

use super::kinect;
use super::light::{Environment, LatLong};
use super::material::{Albedo, Material};
use super::mesh::Mesh;
use super::scene::{HALF_CIRCLE_LIGHTS, Placed, Scene, VirtualKind};
use super::shape::Shape;
use super::tracer::{CentreHits, Shot, World, render_centres, render_radiance};
use super::{glb, scenes, truth, virtual_object};
use crate::capture::CaptureError;
use crate::capture::writer::{
    ColorFormat, DepthCompression, FrameRef, TumWriter, encode_depth, write_whole,
};
use crate::image::{Image, Size};
use crate::math::color::{LINEAR_FROM_SRGB8, srgb8_from_linear};
use crate::math::{Pinhole, affine_from_pose};
use glam::{Affine3A, Vec3, Vec3A};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What is made. The defaults are those of a quick look.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SynthOptions {
    /// One of [`scenes::NAMES`].
    pub scene: String,
    /// At 30 Hz.
    pub frames: usize,
    pub width: usize,
    pub height: usize,
    /// Paths a pixel; powers of two are spread best.
    pub samples: u32,
    /// Scatterings of a path.
    pub bounces: u32,
    pub seed: u32,
    /// Also write `depth_kinect/`: the same depth as a Kinect v1 would give it.
    pub kinect_noise: bool,
    pub color: ColorFormat,
    /// Smaller depth files, slower.
    pub small_depth: bool,
    /// Also render frames with the virtual object truly in the scene, into `composite/`.
    pub with_virtual: bool,
    /// Every how many frames, from the first.
    pub virtual_every: usize,
    /// Replace the scene's lamps by one of four on a half circle (0 to 3).
    pub light: Option<usize>,
    /// Replace the scene's environment by a lat-long Radiance picture, +z up.
    pub environment: Option<PathBuf>,
}

impl Default for SynthOptions {
    fn default() -> Self {
        Self {
            scene: "demo".into(),
            frames: 60,
            width: 640,
            height: 480,
            samples: 16,
            bounces: 4,
            seed: 1,
            kinect_noise: false,
            color: ColorFormat::Png,
            small_depth: false,
            with_virtual: false,
            virtual_every: 1,
            light: None,
            environment: None,
        }
    }
}

impl SynthOptions {
    /// What `sequences/demo` was made with.
    pub fn demo() -> Self {
        Self {
            samples: 32,
            kinect_noise: true,
            color: ColorFormat::Jpeg(85),
            small_depth: true,
            with_virtual: true,
            virtual_every: 20,
            ..Self::default()
        }
    }

    /// The camera of Kinect-like recordings, 525 pixels at a width of 640.
    pub fn camera(&self) -> Pinhole {
        let focal = 525.0 * self.width as f32 / 640.0;
        Pinhole {
            width: self.width,
            height: self.height,
            fx: focal,
            fy: focal,
            cx: (self.width as f32 - 1.0) * 0.5,
            cy: (self.height as f32 - 1.0) * 0.5,
        }
    }

    fn check(&self) -> Result<(), SynthError> {
        let bad = |problem: String| Err(SynthError::Options(problem));
        if self.frames == 0 || self.samples == 0 || self.virtual_every == 0 {
            return bad("frames, samples and virtual_every must be at least 1".into());
        }
        if !(1..=8192).contains(&self.width) || !(1..=8192).contains(&self.height) {
            let (width, height) = (self.width, self.height);
            return bad(format!("pictures of {width}x{height}: sides must be 1 to 8192 pixels"));
        }
        match self.light {
            Some(light) if light >= HALF_CIRCLE_LIGHTS => {
                bad(format!("light {light}: there are lights 0 to {}", HALF_CIRCLE_LIGHTS - 1))
            }
            _ => Ok(()),
        }
    }

    /// The scene with the options' lights.
    pub fn scene(&self) -> Result<Scene, SynthError> {
        let mut scene = scenes::by_name(&self.scene).ok_or_else(|| {
            let known = scenes::NAMES.join(", ");
            SynthError::Options(format!("no scene is called {}; there are {known}", self.scene))
        })?;
        if let Some(index) = self.light {
            scene = scene.with_half_circle_light(index);
        }
        if let Some(path) = &self.environment {
            scene.environment = Environment::LatLong(read_environment(path)?);
        }
        Ok(scene)
    }
}

#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    #[error("{0}")]
    Options(String),
    #[error(transparent)]
    Write(#[from] CaptureError),
    #[error("{path}: {problem}")]
    File { path: String, problem: String },
}

fn file_error(path: &Path, problem: impl ToString) -> SynthError {
    SynthError::File { path: path.display().to_string(), problem: problem.to_string() }
}

fn read_environment(path: &Path) -> Result<LatLong, SynthError> {
    let picture = image::open(path).map_err(|e| file_error(path, e))?.into_rgb32f();
    let size = Size::new(picture.width() as usize, picture.height() as usize);
    let rgb = picture.pixels().map(|p| p.0).collect();
    LatLong::new(Image::from_vec(size, rgb)).ok_or_else(|| file_error(path, "an empty picture"))
}

/// The options of a sequence, written last: a folder that has it is complete.
pub const OPTIONS_FILE: &str = "synth.json";

pub(crate) const FRAMES_PER_S: f64 = 30.0;
/// Recordings do not begin at time 0.
const START_S: f64 = 1000.0;

/// Makes a sequence in `out_dir`, which must not hold one. Calls `progress(done, all)` after every
/// frame.
///
/// # Errors
/// Unknown scene, options out of range, an environment that cannot be read, a folder that holds a
/// recording or cannot be written.
pub fn generate(
    options: &SynthOptions,
    out_dir: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<(), SynthError> {
    options.check()?;
    let scene = options.scene()?;
    let camera = options.camera();
    let compression =
        if options.small_depth { DepthCompression::Small } else { DepthCompression::Fast };
    let mut writer = TumWriter::create(out_dir, camera, options.color, compression)?;
    if options.kinect_noise {
        writer = writer.with_second_depth("depth_kinect")?;
    }
    let object = write_scene_files(options, &scene, out_dir)?;
    let mut composites = Vec::new();
    for frame in 0..options.frames {
        let time_s = frame as f64 / FRAMES_PER_S;
        let shot = Shot {
            camera,
            world_from_camera: scene.camera_path.pose(time_s),
            samples: options.samples,
            bounces: options.bounces,
            seed: options.seed,
            frame: frame as u32,
        };
        let mut objects = scene.placed(time_s);
        let world = world_of(&scene, objects.clone());
        let exact = render_centres(&world, &shot);
        let sensed = options.kinect_noise.then(|| sensed_depth(&world, &shot, &exact));
        writer.push(&FrameRef {
            timestamp_s: START_S + time_s,
            color: &developed(&render_radiance(&world, &shot), scene.exposure),
            depth_m: &exact.depth_m,
            second_depth_m: sensed.as_ref(),
            world_from_camera: Some(&shot.world_from_camera),
        })?;
        if options.with_virtual && frame % options.virtual_every == 0 {
            let index = objects.len() as u32;
            objects.push(object.clone());
            let world = world_of(&scene, objects);
            write_composite(&world, &shot, index, &scene, START_S + time_s, options, out_dir)?;
            composites.push((frame, START_S + time_s));
        }
        progress(frame + 1, options.frames);
    }
    if options.with_virtual {
        let text = format!("{:#}\n", truth::virtual_json(&scene, &composites));
        write_whole(&out_dir.join("virtual.json"), text.as_bytes())?;
    }
    writer.finish()?;
    let path = out_dir.join(OPTIONS_FILE);
    let text = serde_json::to_string_pretty(options).map_err(|e| file_error(&path, e))?;
    write_whole(&path, format!("{text}\n").as_bytes())?;
    Ok(())
}

fn world_of(scene: &Scene, objects: Vec<Placed>) -> World {
    World::new(objects, scene.area_lights(), scene.environment.clone())
}

/// Writes `light.json` and, where the virtual object is a figure, `object.glb` and `scene.toml`;
/// returns the virtual object.
fn write_scene_files(
    options: &SynthOptions,
    scene: &Scene,
    out_dir: &Path,
) -> Result<Placed, SynthError> {
    let world = world_of(scene, scene.placed(0.0));
    let light = truth::light_json(scene, &world, options.frames, options.bounces);
    write_whole(&out_dir.join("light.json"), format!("{light:#}\n").as_bytes())?;
    match scene.virtual_kind {
        VirtualKind::Ball => {
            let radius = truth::BALL_RADIUS_M;
            let grey = truth::BALL_ALBEDO;
            Ok(Placed::new(
                Shape::sphere(radius),
                Material::diffuse(grey, grey, grey),
                Affine3A::from_translation(scene.virtual_at + Vec3::Z * radius),
            ))
        }
        VirtualKind::Figure => {
            let (mesh, texture) = virtual_object::figure();
            let path = out_dir.join(truth::FIGURE_FILE);
            let bytes = glb::encode("figure", &mesh, &texture).map_err(|e| file_error(&path, e))?;
            write_whole(&path, &bytes)?;
            write_whole(&out_dir.join("scene.toml"), truth::scene_toml(scene).as_bytes())?;
            let linear =
                texture.as_slice().iter().map(|c| c.map(|v| LINEAR_FROM_SRGB8[v as usize]));
            let picture = Image::from_vec(texture.size(), linear.collect());
            Ok(Placed::new(
                Shape::Mesh(Arc::new(Mesh::new(mesh))),
                Material::of(Albedo::Picture(Arc::new(picture))),
                virtual_object::world_from_figure(scene.virtual_at, 0.0),
            ))
        }
    }
}

/// Exposed and encoded as 8-bit sRGB.
pub(crate) fn developed(radiance: &Image<[f32; 3]>, exposure: f32) -> Image<[u8; 3]> {
    let encode = |rgb: &[f32; 3]| rgb.map(|v| srgb8_from_linear(v * exposure));
    Image::from_vec(radiance.size(), radiance.as_slice().iter().map(encode).collect())
}

fn sensed_depth(world: &World, shot: &Shot, exact: &CentreHits) -> Image<f32> {
    let world_from_camera = affine_from_pose(&shot.world_from_camera);
    let projector: Vec3A = world_from_camera.transform_point3(Vec3::X * kinect::BASELINE_M).into();
    let camera = &shot.camera;
    let in_shadow = |x: usize, y: usize| {
        // A little in front of the surface, so that it does not hide itself.
        let depth_m = exact.depth_m[(x, y)] * 0.9997;
        let u = (x as f32 - camera.cx) / camera.fx;
        let v = (y as f32 - camera.cy) / camera.fy;
        let point: Vec3A =
            world_from_camera.transform_point3(Vec3::new(u, v, 1.0) * depth_m).into();
        let towards = projector - point;
        let distance = towards.length();
        distance > 0.0 && world.occluded(point, towards / distance, distance)
    };
    kinect::sense(exact, camera, [shot.seed, shot.frame], in_shadow)
}

fn write_composite(
    world: &World,
    shot: &Shot,
    object: u32,
    scene: &Scene,
    timestamp_s: f64,
    options: &SynthOptions,
    out_dir: &Path,
) -> Result<(), SynthError> {
    let folder = out_dir.join("composite");
    std::fs::create_dir_all(&folder).map_err(|e| file_error(&folder, e))?;
    let write = |suffix: &str, encoded: image::ImageResult<Vec<u8>>| {
        let path = folder.join(format!("{timestamp_s:.6}{suffix}"));
        let bytes = encoded.map_err(|e| file_error(&path, e))?;
        write_whole(&path, &bytes).map_err(SynthError::from)
    };
    let hits = render_centres(world, shot);
    let mask = hits.object.as_slice().iter().map(|&o| if o == object { 255 } else { 0 });
    let mask: Vec<u8> = mask.collect();
    let picture = developed(&render_radiance(world, shot), scene.exposure);
    let suffix = format!(".{}", options.color.extension());
    write(&suffix, options.color.encode(&picture))?;
    write(".mask.png", encode_grey(&mask, picture.size()))?;
    write(".depth.png", encode_depth(&hits.depth_m, DepthCompression::Small))
}

fn encode_grey(pixels: &[u8], size: Size) -> image::ImageResult<Vec<u8>> {
    use image::ImageEncoder;
    let mut out = Vec::new();
    image::codecs::png::PngEncoder::new(&mut out).write_image(
        pixels,
        size.width as u32,
        size.height as u32,
        image::ExtendedColorType::L8,
    )?;
    Ok(out)
}
