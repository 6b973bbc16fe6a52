//! From options to a folder with a sequence.

use super::develop::developed;
use super::options::{SynthError, SynthOptions, file_error};
use super::scene::{Placed, Scene};
use super::tracer::{CentreHits, Shot, World, render_centres, render_radiance};
use super::truth::{self, Segment};
use super::{glb, kinect};
use crate::capture::writer::{DepthCompression, DepthFormat, FrameRef, TumWriter, write_whole};
use crate::image::{Image, Size};
use crate::math::affine_from_pose;
use crate::stop::{Stop, Stopped};
use glam::{Vec3, Vec3A};
use std::path::Path;

/// The options of a sequence, written last: a folder that has it is complete.
pub const OPTIONS_FILE: &str = "synth.json";

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
    generate_until(&Stop::default(), options, out_dir, progress)
}

/// As [`generate`]; once `stop` is asked, the frame in work is the last.
///
/// # Errors
/// As well [`SynthError::Stopped`]: the folder is a whole recording then, but not that of the options, and has no
/// [`OPTIONS_FILE`].
pub fn generate_until(
    stop: &Stop,
    options: &SynthOptions,
    out_dir: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<(), SynthError> {
    let segments = options.segments()?;
    let compression =
        if options.small_depth { DepthCompression::Small } else { DepthCompression::Fast };
    let mut writer = TumWriter::create(out_dir, options.camera(), options.color, compression)?;
    if options.kinect_noise {
        writer = writer.with_second_depth("depth_kinect")?;
    }
    let object = write_scene_files(options, &segments, out_dir)?;
    let mut composites = Vec::new();
    let frames = segments
        .iter()
        .flat_map(|Segment { frames, scene }| frames.clone().map(move |frame| (frame, scene)));
    for (frame, scene) in frames.take_while(|_| !stop.is_asked()) {
        let timestamp_s = START_S + options.time_s(frame);
        write_frame(options, scene, frame, &mut writer, timestamp_s)?;
        if options.with_virtual && frame % options.virtual_every == 0 {
            write_composite(options, scene, frame, &object, timestamp_s, out_dir)?;
            composites.push((frame, timestamp_s));
        }
        progress(frame + 1, options.frames);
    }
    if options.with_virtual {
        let text = format!("{:#}\n", truth::virtual_json(&segments[0].scene, &composites));
        write_whole(&out_dir.join("virtual.json"), text.as_bytes())?;
    }
    if writer.finish()? < options.frames {
        return Err(Stopped.into());
    }
    let path = out_dir.join(OPTIONS_FILE);
    let text = serde_json::to_string_pretty(options).map_err(|e| file_error(&path, e))?;
    write_whole(&path, format!("{text}\n").as_bytes())?;
    Ok(())
}

/// Writes `light.json`, `object.glb` and `scene.toml`; returns the virtual object.
fn write_scene_files(
    options: &SynthOptions,
    segments: &[Segment],
    out_dir: &Path,
) -> Result<Placed, SynthError> {
    let light = truth::light_json(segments, options.bounces);
    write_whole(&out_dir.join("light.json"), format!("{light:#}\n").as_bytes())?;
    let scene = &segments[0].scene;
    let (mesh, texture) = scene.virtual_kind.mesh();
    let path = out_dir.join(truth::OBJECT_FILE);
    let name = scene.virtual_kind.name();
    let bytes = glb::encode(name, &mesh, &texture).map_err(|e| file_error(&path, e))?;
    write_whole(&path, &bytes)?;
    write_whole(&out_dir.join("scene.toml"), truth::scene_toml(scene).as_bytes())?;
    Ok(scene.virtual_object())
}

fn write_frame(
    options: &SynthOptions,
    scene: &Scene,
    frame: usize,
    writer: &mut TumWriter,
    timestamp_s: f64,
) -> Result<(), SynthError> {
    let shot = options.shot(scene, frame);
    let world = scene.world_at(options.time_s(frame));
    let exact = render_centres(&world, &shot);
    let sensed = options.kinect_noise.then(|| sensed_depth(&world, &shot, &exact));
    let noise = options.color_noise.then_some([shot.seed, shot.frame]);
    writer.push(&FrameRef {
        timestamp_s,
        color: &developed(&render_radiance(&world, &shot), scene.exposure, noise),
        depth_m: &exact.depth_m,
        second_depth_m: sensed.as_ref(),
        world_from_camera: Some(&shot.world_from_camera),
    })?;
    Ok(())
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
    options: &SynthOptions,
    scene: &Scene,
    frame: usize,
    object: &Placed,
    timestamp_s: f64,
    out_dir: &Path,
) -> Result<(), SynthError> {
    let shot = options.shot(scene, frame);
    let mut objects = scene.placed(options.time_s(frame));
    let index = objects.len() as u32;
    objects.push(object.clone());
    let world = scene.world_of(objects);
    let folder = out_dir.join("composite");
    std::fs::create_dir_all(&folder).map_err(|e| file_error(&folder, e))?;
    let write = |suffix: &str, encoded: image::ImageResult<Vec<u8>>| {
        let path = folder.join(format!("{timestamp_s:.6}{suffix}"));
        let bytes = encoded.map_err(|e| file_error(&path, e))?;
        write_whole(&path, &bytes).map_err(SynthError::from)
    };
    let hits = render_centres(&world, &shot);
    let mask = hits.object.as_slice().iter().map(|&o| if o == index { 255 } else { 0 });
    let mask: Vec<u8> = mask.collect();
    let picture = developed(&render_radiance(&world, &shot), scene.exposure, None);
    let suffix = format!(".{}", options.color.extension());
    write(&suffix, options.color.encode(&picture))?;
    write(".mask.png", encode_grey(&mask, picture.size()))?;
    let exact = DepthFormat { compression: DepthCompression::Small, ..DepthFormat::default() };
    write(".depth.png", exact.encode(&hits.depth_m))
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
