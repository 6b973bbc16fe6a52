//! Built-in scenes, and whole sequences against their own files.

use super::tracer::World;
use super::{LightSwitch, OPTIONS_FILE, SynthOptions, VirtualKind, generate, scenes};
use crate::eval::light::LightTruth;
use crate::math::{Pinhole, Pose, pose_from_xyzw};
use crate::scene::VirtualScene;
use glam::Vec3A;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// How many of 18 points on the virtual object's axis the camera sees.
fn visible_axis_points(time_s: f64) -> usize {
    let scene = scenes::by_name("demo").expect("a built-in scene");
    let world = World::new(scene.placed(time_s), scene.area_lights(), scene.environment.clone());
    let t = scene.camera_path.pose(time_s).translation.vector;
    let eye = Vec3A::new(t.x as f32, t.y as f32, t.z as f32);
    (0..18)
        .filter(|&i| {
            let point = Vec3A::from(scene.virtual_at) + Vec3A::Z * (0.005 + 0.01 * i as f32);
            let towards = point - eye;
            !world.occluded(eye, towards.normalize(), towards.length())
        })
        .count()
}

#[test]
fn the_hand_of_the_demo_passes_partly_in_front_of_the_virtual_object() {
    let scene = scenes::by_name("demo").expect("a built-in scene");
    assert!(scene.placed(0.5).len() + 5 < scene.placed(1.5).len());
    assert_eq!(visible_axis_points(0.5), 18);
    let least = (40..50).map(|frame| visible_axis_points(f64::from(frame) / 30.0)).min();
    assert!(least.is_some_and(|n| (2..17).contains(&n)), "{least:?}");
}

#[test]
fn cameras_move_like_hands() {
    for name in scenes::NAMES {
        let path = scenes::by_name(name).expect("a built-in scene").camera_path;
        let mut moved = 0.0f64;
        for frame in 1..120 {
            let step = path.pose(f64::from(frame - 1) / 30.0).inverse()
                * path.pose(f64::from(frame) / 30.0);
            assert!(step.translation.vector.norm() < 0.010, "{name} {frame}");
            assert!(step.rotation.angle().to_degrees() < 1.0, "{name} {frame}");
            moved += step.translation.vector.norm();
        }
        assert!(moved > 0.2, "{name}: {moved}");
    }
}

fn options(scene: &str) -> SynthOptions {
    SynthOptions {
        scene: scene.into(),
        frames: 3,
        width: 96,
        height: 72,
        samples: 1,
        kinect_noise: true,
        with_virtual: true,
        virtual_every: 2,
        ..SynthOptions::default()
    }
}

/// All files below a folder with their bytes.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut out = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).expect("a folder") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).expect("below").display().to_string();
                out.insert(name, fs::read(&path).expect("a file"));
            }
        }
    }
    out
}

#[test]
fn the_same_options_give_the_same_bytes_and_all_files() {
    let make = |seed| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let options = SynthOptions { seed, ..options("demo") };
        generate(&options, folder.path(), &|_, _| {}).expect("a free folder");
        contents(folder.path())
    };
    let (first, second, other) = (make(1), make(1), make(2));
    assert_eq!(first, second);
    let differs = |name: &str| first[name] != other[name];
    assert!(differs("rgb/1000.000000.png") && differs("depth_kinect/1000.000000.png"));
    assert!(!differs("depth/1000.000000.png"));
    for name in [
        "rgb.txt",
        "depth.txt",
        "depth_kinect.txt",
        "associations.txt",
        "groundtruth.txt",
        "intrinsics.txt",
        "light.json",
        "virtual.json",
        "scene.toml",
        "object.glb",
        "composite/1000.066667.png",
        "composite/1000.066667.mask.png",
    ] {
        assert!(first.contains_key(name), "{name} is missing");
    }
    assert!(!first.keys().any(|name| name.ends_with(".tmp")));
}

#[test]
fn wrong_options_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let fails = |options: SynthOptions, needle: &str| {
        let error = generate(&options, folder.path(), &|_, _| {}).expect_err(needle).to_string();
        assert!(error.contains(needle), "{error}");
    };
    fails(options("cathedral"), "cathedral");
    fails(SynthOptions { frames: 0, ..options("demo") }, "frames");
    fails(SynthOptions { width: 0, ..options("demo") }, "0x72");
    fails(SynthOptions { light: Some(4), ..options("demo") }, "light 4");
    let switch = |frame, light| Some(LightSwitch { frame, light });
    fails(SynthOptions { switch: switch(1, 4), ..options("demo") }, "light 4");
    fails(SynthOptions { switch: switch(0, 1), ..options("demo") }, "frame 0 of 3");
    fails(SynthOptions { switch: switch(3, 1), ..options("demo") }, "frame 3 of 3");
    fails(SynthOptions { environment: Some("none.hdr".into()), ..options("demo") }, "none.hdr");
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 0, "nothing was written");
}

type DepthPicture = image::ImageBuffer<image::Luma<u16>, Vec<u16>>;

/// The frames of a sequence as its text files describe them.
fn read_frames(folder: &Path) -> (Pinhole, Vec<(Pose, DepthPicture)>) {
    let numbers = |line: &str| -> Vec<f64> {
        line.split(' ').map(|word| word.parse().expect("a number")).collect()
    };
    let text = |name: &str| fs::read_to_string(folder.join(name)).expect("a list");
    let lines = |text: &str| -> Vec<String> {
        text.lines().filter(|l| !l.starts_with('#')).map(str::to_owned).collect()
    };
    let c = numbers(&lines(&text("intrinsics.txt"))[0]);
    assert_eq!(c[6], 5000.0);
    let camera = Pinhole {
        width: c[4] as usize,
        height: c[5] as usize,
        fx: c[0] as f32,
        fy: c[1] as f32,
        cx: c[2] as f32,
        cy: c[3] as f32,
    };
    let poses = lines(&text("groundtruth.txt"));
    let depths = lines(&text("depth.txt"));
    assert_eq!(poses.len(), depths.len());
    let frames = poses.iter().zip(&depths).map(|(pose, depth)| {
        let p = numbers(pose);
        let pose = pose_from_xyzw([p[1], p[2], p[3]], [p[4], p[5], p[6], p[7]]);
        let (_, file) = depth.split_once(' ').expect("two words");
        let picture = image::open(folder.join(file)).expect("a picture").into_luma16();
        (pose.expect("a pose"), picture)
    });
    (camera, frames.collect())
}

#[test]
fn frame_0_lands_on_frame_k_by_the_written_poses() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let options = SynthOptions { frames: 12, with_virtual: false, ..options("sphere") };
    generate(&options, folder.path(), &|_, _| {}).expect("a free folder");
    let (camera, frames) = read_frames(folder.path());
    let (first_pose, first) = &frames[0];
    let (pose, last) = &frames[11];
    assert!((pose.translation.vector - first_pose.translation.vector).norm() > 0.02);
    let camera_from_first = pose.inverse() * first_pose;
    let (mut errors, mut checked) = (Vec::new(), 0);
    for (x, y, depth) in first.enumerate_pixels() {
        let z = f64::from(depth.0[0]) / 5000.0;
        let ray_x = (f64::from(x) - f64::from(camera.cx)) / f64::from(camera.fx);
        let ray_y = (f64::from(y) - f64::from(camera.cy)) / f64::from(camera.fy);
        let p = camera_from_first * nalgebra::Point3::new(ray_x * z, ray_y * z, z);
        let u = (p.x / p.z * f64::from(camera.fx) + f64::from(camera.cx)).round();
        let v = (p.y / p.z * f64::from(camera.fy) + f64::from(camera.cy)).round();
        let inside = u >= 0.0 && v >= 0.0 && u < camera.width as f64 && v < camera.height as f64;
        if z > 0.0 && inside {
            let there = f64::from(last.get_pixel(u as u32, v as u32).0[0]) / 5000.0;
            errors.push((there - p.z).abs());
            checked += 1;
        }
    }
    errors.sort_by(f64::total_cmp);
    assert!(checked > 5000, "{checked}");
    // Half a pixel is 5 mm across at 0.8 m, on slopes around 45 degrees; edges are beyond 90 %.
    assert!(errors[checked / 2] < 0.004, "{}", errors[checked / 2]);
    assert!(errors[checked * 9 / 10] < 0.015, "{}", errors[checked * 9 / 10]);
}

/// `light.json` of a tiny sequence.
fn light_of(options: &SynthOptions) -> serde_json::Value {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let tiny = SynthOptions { frames: 1, width: 8, height: 6, samples: 1, ..options.clone() };
    generate(&tiny, folder.path(), &|_, _| {}).expect("a free folder");
    let text = fs::read_to_string(folder.path().join("light.json")).expect("light.json");
    serde_json::from_str(&text).expect("JSON")
}

fn direction(light: &serde_json::Value, name: &str) -> Vec3A {
    let v = light["segments"][0][name].as_array().expect("a direction");
    Vec3A::from_array(std::array::from_fn(|i| v[i].as_f64().expect("a number") as f32))
}

#[test]
fn four_lights_stand_60_degrees_apart_and_the_file_says_so() {
    let horizontal: Vec<Vec3A> = (0..4)
        .map(|index| {
            let light = light_of(&SynthOptions { light: Some(index), ..options("sphere") });
            assert_eq!(light["segments"][0]["strongest_light"], format!("light_{index}"));
            let towards = direction(&light, "dominant_direction");
            // band 1 of what the sources send agrees: ambient light is even, the lamp is square
            assert!(towards.dot(direction(&light, "dominant_direction_sh")) > 0.9999);
            assert!((towards.z - 50f32.to_radians().sin()).abs() < 1e-4);
            Vec3A::new(towards.x, towards.y, 0.0).normalize()
        })
        .collect();
    assert!(horizontal[0].dot(-Vec3A::X) > 0.9999 && horizontal[3].dot(Vec3A::X) > 0.9999);
    for pair in horizontal.windows(2) {
        assert!((pair[0].dot(pair[1]) - 0.5).abs() < 1e-4 && pair[1].y < 1e-4);
    }
}

#[test]
fn an_environment_from_a_file_lights_the_scene() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("sky.hdr");
    // bright at the zenith alone
    let sky = image::Rgb32FImage::from_fn(16, 8, |_, y| {
        image::Rgb(if y == 0 { [50.0, 40.0, 30.0] } else { [0.1, 0.1, 0.1] })
    });
    image::DynamicImage::ImageRgb32F(sky).save(&path).expect("an encodable picture");
    let light = light_of(&SynthOptions { environment: Some(path), ..options("sphere") });
    assert_eq!(light["environment"], "lat-long");
    let ambient: Vec<f64> =
        serde_json::from_value(light["segments"][0]["sh_ambient"].clone()).expect("numbers");
    // Cap of pi / 8 around +z: 2 pi (1 - cos) sr; shared exponents keep 1 part in 256.
    let cap = 2.0 * std::f64::consts::PI * (1.0 - (std::f64::consts::PI / 8.0).cos());
    let rest = 4.0 * std::f64::consts::PI - cap;
    let luminance = 0.2126 * 50.0 + 0.7152 * 40.0 + 0.0722 * 30.0;
    let expected = 0.9 * 0.282_095 * (luminance * cap + 0.1 * rest);
    assert!((ambient[0] / expected - 1.0).abs() < 0.01, "{} {expected}", ambient[0]);
    assert!(ambient[2] > 0.0 && ambient[1].abs() < 1e-6 && ambient[3].abs() < 1e-6);
}

#[test]
fn a_switched_light_is_two_segments_and_brightens_the_other_side() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let switch = Some(LightSwitch { frame: 2, light: 3 });
    let options = SynthOptions {
        frames: 4,
        samples: 4,
        light: Some(0),
        switch,
        still: true,
        with_virtual: false,
        ..options("sphere")
    };
    generate(&options, folder.path(), &|_, _| {}).expect("a free folder");
    let truth = LightTruth::read(&folder.path().join("light.json")).expect("light.json");
    let x = |frame| truth.at_frame(frame).expect("a segment").dominant_direction[0];
    assert!(x(0) < -0.5 && x(1) < -0.5 && x(2) > 0.5 && x(3) > 0.5);
    assert!(truth.at_frame(4).is_none());
    // The ball's left half against its right half.
    let contrast = |frame: usize| {
        let name = format!("rgb/{:.6}.png", 1000.0 + frame as f64 / 30.0);
        let picture = image::open(folder.path().join(name)).expect("a picture").into_luma8();
        let sum = |from: u32, to: u32| -> i64 {
            let pixels = (20..32).flat_map(|y| (from..to).map(move |x| (x, y)));
            pixels.map(|(x, y)| i64::from(picture.get_pixel(x, y).0[0])).sum()
        };
        sum(30, 37) - sum(42, 49)
    };
    assert!(contrast(0) > 0 && contrast(1) > 0, "{} {}", contrast(0), contrast(1));
    assert!(contrast(2) < 0 && contrast(3) < 0, "{} {}", contrast(2), contrast(3));
}

#[test]
fn a_still_camera_repeats_poses_and_depth_and_not_colour() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let options =
        SynthOptions { still: true, color_noise: true, with_virtual: false, ..options("blocks") };
    generate(&options, folder.path(), &|_, _| {}).expect("a free folder");
    let files = contents(folder.path());
    let file = |kind: &str, time: &str| &files[&format!("{kind}/{time}.png")];
    let (first, second) = ("1000.000000", "1000.033333");
    assert_eq!(file("depth", first), file("depth", second));
    assert_ne!(file("depth_kinect", first), file("depth_kinect", second));
    assert_ne!(file("rgb", first), file("rgb", second));
    let (_, frames) = read_frames(folder.path());
    assert!(frames.iter().all(|(pose, _)| *pose == frames[0].0));
}

#[test]
fn every_virtual_object_can_be_loaded_from_its_sequence() {
    for object in VirtualKind::ALL {
        assert_eq!(VirtualKind::by_name(object.name()), Some(object));
        let folder = tempfile::tempdir().expect("a temporary folder");
        let options = SynthOptions { object: Some(object), frames: 1, ..options("blocks") };
        generate(&options, folder.path(), &|_, _| {}).expect("a free folder");
        VirtualScene::load(&folder.path().join("scene.toml")).expect("a scene");
        let text = fs::read(folder.path().join(OPTIONS_FILE)).expect("the options");
        let read: SynthOptions = serde_json::from_slice(&text).expect("options");
        assert_eq!(read, options);
        let mask = folder.path().join("composite/1000.000000.mask.png");
        let mask = image::open(mask).expect("a mask").into_luma8();
        let seen = mask.pixels().filter(|p| p.0[0] > 0).count();
        assert!((30..3000).contains(&seen), "{}: {seen} pixels", object.name());
    }
}
