//! What fuzzing starts from: small inputs of every kind, whole and broken, made here.
//!
//! `cargo test --lib fuzzing::seeds -- --ignored` writes them anew.

use super::replay::corpus;
use super::scene::{glb, triangle};
use super::{Scratch, TARGETS, files};
use crate::budget::Profile;
use crate::capture::calibration::built_in;
use crate::config::Settings;
use crate::report::fixtures;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

/// Target, name, content.
type Seed = (&'static str, String, Vec<u8>);

fn all() -> Vec<Seed> {
    let mut seeds = Vec::new();
    let mut add = |target: &'static str, name: &str, content: &[u8]| {
        seeds.push((target, name.to_owned(), content.to_vec()));
    };
    text_seeds(&mut add);
    picture_seeds(&mut add);
    calibration_seeds(&mut add);
    sequence_seeds(&mut add);
    settings_seeds(&mut add);
    scene_seeds(&mut add);
    gltf_seeds(&mut add);
    record_seeds(&mut add);
    frame_seeds(&mut add);
    seeds
}

type Add<'a> = dyn FnMut(&'static str, &str, &[u8]) + 'a;

/// Width, height, lens, choices, three poses of two bytes, and pixels; see `frames`.
fn frame_seeds(add: &mut Add) {
    let wall = [60, 60, 61, 62, 64, 70, 58, 90, 120, 200];
    for (name, choices) in
        [("recorded", 0), ("tracked", 2), ("ray-traced", 8 | 4), ("rgb", 16 | 32)]
    {
        let header = [39, 31, 26, choices, 0, 0, 1, 255, 2, 1];
        add("frames", name, &[&header[..], &wall[..]].concat());
    }
    let bits = [1.0f32, 0.0, f32::NAN, f32::INFINITY, -1.0, 1e-40, 3e38, 0.7].map(f32::to_le_bytes);
    add(
        "frames",
        "any-depth",
        &[&[35, 30, 30, 1, 0, 0, 0, 0, 0, 0][..], &bits.concat()[..]].concat(),
    );
    add("frames", "one-pixel", &[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 50]);
    add("frames", "cut", &[9, 9, 9]);
}

const POSE: &str = "0.0 1 2 3 0 0 0 1\n0.05 1 2 3.1 0 0.0998334 0 0.9950042\n";
const MATRIX: &str = "1 0 0 0.5\n0 1 0 0\n0 0 1 -2e-1\n0 0 0 1\n";

fn text_seeds(add: &mut Add) {
    let rgb = "# colour\n0.0 rgb/0.png\n0.0333 rgb/1.png\r\n0.0667 rgb/2.png\n";
    let depth = "0.01 depth/0.png\n0.04 depth/1.png\n0.0667 depth/2.png\n";
    add("lists", "tum", format!("t{rgb}\0{depth}\0{POSE}").as_bytes());
    add("lists", "tum-backwards", b"t2 a.png\n1 b.png\n1 c.png\n\x001 d.png\n2 e.png\n\0");
    add("lists", "tum-outside", b"t0 ../a.png\n\x000 /etc/b.png\n\0");
    add("lists", "tum-no-text", b"t\xff\xfe\0\0");
    let pairs = "0 depth/0.png 0 rgb/0.png\n1 depth/1.png 1 rgb/1.png\n";
    add("lists", "associated", format!("a{pairs}\0{POSE}").as_bytes());
    add("lists", "associated-unclear", b"a0 a.png 0 b.png\n\0");
    add("lists", "icl-nuim", format!("i{pairs}\x001 0.1 0.2 0.3 0 0 0 1\n").as_bytes());

    add("poses", "tum", format!("t{POSE}").as_bytes());
    add("poses", "tum-short", b"t0 0 0 0 1 1 1 1\n1 nan 0 0 0 0 0 1\n2 1\n");
    add("poses", "matrix", format!("m{MATRIX}").as_bytes());
    add("poses", "matrix-mirrored", b"m1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n");
    add("poses", "log", format!("l0 0 1\n{MATRIX}2 2 3\n{MATRIX}").as_bytes());
    add("poses", "log-cut", b"l0 0 1\n1 0 0 0\n0 1 0 0\n");
    add("poses", "log-far", b"l99999999999 0 1\n1 0 0 0\n");
}

pub fn png(width: u32, height: u32, color: ExtendedColorType) -> Vec<u8> {
    let bytes = width as usize * height as usize * usize::from(color.bits_per_pixel()) / 8;
    let data: Vec<u8> = (0..bytes).map(|i| if i % 2 == 0 { 19 } else { (i % 61) as u8 }).collect();
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Best, FilterType::Adaptive)
        .write_image(&data, width, height, color)
        .unwrap();
    out
}

fn jpeg(width: u32, height: u32, color: ExtendedColorType) -> Vec<u8> {
    let bytes = width as usize * height as usize * usize::from(color.bits_per_pixel()) / 8;
    let data: Vec<u8> = (0..bytes).map(|i| (i * 7 % 251) as u8).collect();
    let mut out = Vec::new();
    JpegEncoder::new_with_quality(&mut out, 60).encode(&data, width, height, color).unwrap();
    out
}

fn picture_seeds(add: &mut Add) {
    use ExtendedColorType::{L8, L16, La8, Rgb8, Rgb16, Rgba8, Rgba16};
    for (name, color) in [
        ("rgb8", Rgb8),
        ("grey8", L8),
        ("grey16", L16),
        ("grey-alpha8", La8),
        ("rgba8", Rgba8),
        ("rgb16", Rgb16),
        ("rgba16", Rgba16),
    ] {
        add("pictures", &format!("{name}.png"), &png(9, 7, color));
    }
    add("pictures", "rgb.jpg", &jpeg(17, 9, Rgb8));
    add("pictures", "grey.jpg", &jpeg(17, 9, L8));
    let whole = png(9, 7, L16);
    add("pictures", "cut.png", &whole[..whole.len() - 20]);
    let cut = jpeg(17, 9, Rgb8);
    add("pictures", "cut.jpg", &cut[..cut.len() / 2]);
    let mut huge = whole;
    huge[16..24].copy_from_slice(&[0, 0, 0x20, 0, 0, 0, 0x20, 0]);
    add("pictures", "bomb.png", &huge);
    add("pictures", "none", b"GIF89a");
}

fn calibration_seeds(add: &mut Add) {
    let with = |kind: char, text: &str| format!("{kind}{text}").into_bytes();
    for name in ["tum_freiburg1", "7scenes_redkitchen", "kinect_v1"] {
        let text = built_in(name).unwrap().to_toml().unwrap();
        add("calibration", &format!("{name}.toml"), &with('t', &text));
    }
    let color = "name = \"f\"\nregistered = true\n[color]\nwidth = 640\nheight = 480\nfx = 500.0\nfy = 500.0\n\
        cx = 319.5\ncy = 239.5\n";
    let rest = "[color.distortion]\nmodel = \"kannala-brandt\"\nk1 = 0.02\nk2 = -0.01\nk3 = 3e-3\nk4 = -1e-3\n\
        [photometry]\ncolor_matrix = [[1.1, 0.0, -0.1], [0.0, 1.0, 0.0], [0.0, -0.2, 1.2]]\n\
        [photometry.vignetting]\ncenter = [0.5, 0.5]\nfalloff = [-0.4, 0.0, 0.0]\n";
    add("calibration", "fish-eye.toml", &with('t', &format!("{color}{rest}")));
    add(
        "calibration",
        "disparity.toml",
        &with('t', &format!("{color}[disparity]\nc0 = 3.1\nc1 = -0.0028\n")),
    );
    add("calibration", "unknown-field.toml", &with('t', &format!("{color}skew = 0.1\n")));
    let data = "[ 5.1e+02, 0., 319., 0., 511.5, 239.5, 0., 0., 1. ]";
    let opencv = format!(
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
         cols: 3\n   dt: d\n   data: {data}\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   \
         dt: d\n   data: [ 0.1, -0.2, 1e-3, -.002, 0.3 ]\n"
    );
    add("calibration", "opencv.yaml", &with('y', &opencv));
    let ros = "image_width: 640\nimage_height: 480\ncamera_name: rgb\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
        data: [500, 0, 320, 0, 501, 240, 0, 0, 1]\ndistortion_model: rational_polynomial\n\
        distortion_coefficients:\n  rows: 1\n  cols: 8\n  data: [0.1, 0, 0, 0, 0, 0.1, 0, 0]\n";
    add("calibration", "ros.yaml", &with('y', ros));
    add(
        "calibration",
        "message.yaml",
        &with('y', "K: [500, 0, 320, 0, 501, 240, 0, 0, 1]\nD: []\n"),
    );
    let slam = "%YAML:1.0\nCamera.fx: 535.4\nCamera.fy: 539.2\nCamera.cx: 320.1\nCamera.cy: 247.6\nCamera.k1: 0.1\n\
        Camera.width: 640\nCamera.height: 480\nDepthMapFactor: 5000.0\n";
    add("calibration", "orb-slam.yaml", &with('y', slam));
    let toolbox = "rsize1: [3, 480, 640]\nrK1: [[520, 0, 320], [0, 520, 240], [0, 0, 1]]\nrkc1: [0.1, 0, 0, 0, 0]\n\
        dK: [[580, 0, 320], [0, 580, 240], [0, 0, 1]]\ndkc: [0, 0, 0, 0, 0]\ndR: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n\
        dt: [-0.02, 0, 0]\ndc: [3.0, -0.0028]\n";
    add("calibration", "toolbox.yaml", &with('y', toolbox));
    add(
        "calibration",
        "nested.yaml",
        &with('y', &format!("# ]]]]]]]]]]]]]]]]]]\nK: {}", "[".repeat(40))),
    );
    let json = r#"{"width": 640, "height": 480, "intrinsic_matrix": [525, 0, 0, 0, 526, 0, 319.5, 239.5, 1], "depth_scale": 1000}"#;
    add("calibration", "open3d.json", &with('j', json));
    add(
        "calibration",
        "numbers.txt",
        &with('x', "# fx fy cx cy w h\n525.0 526 319.5 239.5 640 480 5000\n"),
    );
    add("calibration", "matrix.txt", &with('x', "585 0 320\n0 585 240\n0 0 1\n"));
}

fn folder(parts: &[(&str, &[u8])]) -> Vec<u8> {
    let mut out = Vec::new();
    for (name, content) in parts {
        if !out.is_empty() {
            out.push(b'\n');
        }
        out.extend(format!("@{name}\n").bytes());
        out.extend(*content);
    }
    assert_eq!(files(&out).collect::<Vec<_>>(), parts, "a picture has a mark in it");
    out
}

fn sequence_seeds(add: &mut Add) {
    let (color, depth) = (png(8, 6, ExtendedColorType::Rgb8), png(8, 6, ExtendedColorType::L16));
    let intrinsics: &[u8] = b"7 7 3.5 2.5 8 6 5000\n";
    let tum: [(&str, &[u8]); 6] = [
        ("rgb.txt", b"0 rgb/0.png\n0.03 rgb/1.png\n"),
        ("depth.txt", b"0.01 depth/0.png\n0.04 depth/1.png\n"),
        ("groundtruth.txt", POSE.as_bytes()),
        ("intrinsics.txt", intrinsics),
        ("rgb/0.png", &color),
        ("depth/0.png", &depth),
    ];
    add("sequence", "tum", &folder(&tum));
    add(
        "sequence",
        "tum-cut",
        &folder(&[tum[0], tum[1], tum[3], ("rgb/0.png", &color[..40]), tum[5]]),
    );
    let seven: [(&str, &[u8]); 3] = [
        ("frame-000000.color.png", &color),
        ("frame-000000.depth.png", &depth),
        ("frame-000000.pose.txt", MATRIX.as_bytes()),
    ];
    add("sequence", "7-scenes", &folder(&seven));
    let log = format!("0 0 1\n{MATRIX}");
    let json = r#"{"width":8,"height":6,"intrinsic_matrix":[7,0,0,0,7,0,3.5,2.5,1]}"#;
    let redwood: [(&str, &[u8]); 4] = [
        ("color/00001.png", &color),
        ("depth/00001.png", &depth),
        ("trajectory.log", log.as_bytes()),
        ("intrinsic.json", json.as_bytes()),
    ];
    add("sequence", "redwood", &folder(&redwood));
    let calibration = "name = \"f\"\nregistered = false\ndepth_factor = 5000.0\n[color]\nwidth = 8\nheight = 6\nfx = 7.0\n\
        fy = 7.0\ncx = 3.5\ncy = 2.5\n[color.distortion]\nmodel = \"brown\"\nk1 = 0.1\nk2 = 0.0\np1 = 0.0\np2 = 0.01\n\
        k3 = 0.0\n[depth]\nwidth = 8\nheight = 6\nfx = 7.5\nfy = 7.5\ncx = 3.5\ncy = 2.5\n[color_from_depth]\n\
        translation_m = [0.02, 0.0, 0.0]\nrotation_xyzw = [0.0, 0.0, 0.0, 1.0]\n";
    let stamped: [(&str, &[u8]); 4] = [
        ("calibration.toml", calibration.as_bytes()),
        ("rgb/7.000.png", &color),
        ("depth/7.010.png", &depth),
        ("depth/7.000.png", &depth),
    ];
    add("sequence", "folders", &folder(&stamped));
    add("sequence", "nothing", b"@readme.txt\nnothing here");
}

fn settings_seeds(add: &mut Add) {
    let text = |kind: char, text: &str| format!("{kind}{text}").into_bytes();
    add("settings", "whole.toml", &text('f', &Settings::default().to_toml()));
    add("settings", "one.toml", b"f[transfer]\nbands = 3\n[tracking]\niterations = [8, 4]\n");
    add("settings", "out-of-range.toml", b"f[volume]\nresolution = 7\nside_m = nan\n");
    add(
        "settings",
        "assignments",
        b"stransfer.directions=64\0tracking.mode=static\0volume.centre=[0.0, 0.5, 1.0]",
    );
    add("settings", "unknown", b"stransfer.direction=3\0=\0a.b.c=1\0transfer=1");
    let mut profile = Profile::built_in();
    profile.steps.truncate(3);
    add("settings", "profile.toml", &text('p', &toml::to_string(&profile).unwrap()));
    add("settings", "profile-empty.toml", b"perror = \"composite\"\nsequences = []\nsteps = []\n");
}

fn scene_seeds(add: &mut Add) {
    add(
        "scene",
        "two.toml",
        b"[[object]]\nfile = \"o.glb\"\nat = [1, 2.5, 3]\nyaw_deg = 90\nscale = 2\n\
        [[object]]\nfile = \"./o.glb\"\non = [3, 4, 5]\nup = [0, 0, 2]\n",
    );
    add("scene", "outside.toml", b"[[object]]\nfile = \"../secret.glb\"\nat = [0, 0, 0]\n");
    add("scene", "absolute.toml", b"[[object]]\nfile = \"/dev/zero\"\nat = [0, 0, 0]\n");
    add("scene", "link.toml", b"[[object]]\nfile = \"link.glb\"\nat = [0, 0, 0]\n");
    add("scene", "far.toml", b"[[object]]\nfile = \"o.glb\"\nat = [1e300, 0, 0]\nscale = 1e-300\n");
}

fn gltf_seeds(add: &mut Add) {
    add("gltf", "triangle.glb", &triangle());
    let uvs = [0.0f32, 0.0, 1.0, 0.0, 0.0, 1.0].map(f32::to_le_bytes).concat();
    let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).concat();
    let picture = png(2, 2, ExtendedColorType::Rgba8);
    let binary = [&corners[..], &uvs, &[0, 0, 1, 0, 2, 0, 0, 0], &picture].concat();
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_texture_transform"],"scenes":[{{"nodes":[0]}}],
"nodes":[{{"children":[1],"translation":[1,0,0],"rotation":[0.7071068,0,0,0.7071068]}},{{"mesh":0,"scale":[2,3,-4]}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":1}},"indices":2,"material":0,"mode":5}}]}}],
"materials":[{{"alphaMode":"MASK","alphaCutoff":0.3,"pbrMetallicRoughness":{{"baseColorFactor":[1,0.5,1,1],
"baseColorTexture":{{"index":0,"extensions":{{"KHR_texture_transform":{{"offset":[1,0],"rotation":0.1,"scale":[-1,1]}}}}}}}}}}],
"textures":[{{"source":0,"sampler":0}}],"samplers":[{{"wrapS":33071,"wrapT":33648}}],
"images":[{{"bufferView":3,"mimeType":"image/png"}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}},
{{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}},{{"bufferView":2,"componentType":5123,"count":3,"type":"SCALAR"}}],
"bufferViews":[{{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},
{{"buffer":0,"byteOffset":60,"byteLength":6}},{{"buffer":0,"byteOffset":68,"byteLength":{}}}],
"buffers":[{{"byteLength":{}}}]}}"#,
        picture.len(),
        binary.len()
    );
    add("gltf", "textured.glb", &glb(&json, &binary));
    let external = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0,"skin":0},{"translation":[0,2,0]}],"skins":[{"joints":[1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0,"COLOR_0":1,"JOINTS_0":2,"WEIGHTS_0":3}}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0],
"sparse":{"count":1,"indices":{"bufferView":1,"componentType":5121},"values":{"bufferView":0}}},
{"bufferView":0,"componentType":5121,"normalized":true,"count":3,"type":"VEC4"},
{"bufferView":0,"componentType":5121,"count":3,"type":"VEC4"},{"bufferView":0,"componentType":5126,"count":3,"type":"VEC4"}],
"bufferViews":[{"buffer":0,"byteLength":48},{"buffer":0,"byteOffset":48,"byteLength":4}],
"buffers":[{"byteLength":64,"uri":"data.bin"}]}"#;
    add("gltf", "external.gltf", external.as_bytes());
    add("gltf", "outside.gltf", external.replace("data.bin", "..%2fsecret.glb").as_bytes());
    add("gltf", "link.gltf", external.replace("data.bin", "link.glb").as_bytes());
    let inline = external.replace("data.bin", &format!("data:;base64,{}", "AAAA".repeat(22)));
    add("gltf", "inline.gltf", inline.as_bytes());
    let zeros = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
"accessors":[{"componentType":5126,"count":99999999,"type":"VEC3","min":[0,0,0],"max":[0,0,0],
"sparse":{"count":1,"indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":0}}}],
"bufferViews":[{"buffer":0,"byteLength":12}],"buffers":[{"byteLength":64,"uri":"data.bin"}]}"#;
    add("gltf", "zeros.gltf", zeros.as_bytes());
}

fn record_seeds(add: &mut Add) {
    let json = |kind: char, value: serde_json::Value| format!("{kind}{value}").into_bytes();
    let segment = |first: usize| {
        serde_json::json!({"first_frame": first, "last_frame": first + 4, "dominant_direction": [0.0, 0.6, 0.8],
            "sh": [1.0, 0.1, 0.2, 0.3]})
    };
    let light = serde_json::json!({"sequence": "a", "center": [0.0, 1.0, 2.0], "segments": [segment(0), segment(5)]});
    add("records", "light.json", &json('l', light));
    let overlap = serde_json::json!({"center": null, "segments": [segment(0), segment(4)]});
    add("records", "light-overlap.json", &json('l', overlap));
    add("records", "virtual.json", br#"v{"kind":"sphere","center":[0,0,1],"radius":0.1,"albedo":[0.5,0.5,0.5],"name":"ball","frames":[3],"timestamps":["1.0"]}"#);
    add(
        "records",
        "virtual-away.json",
        br#"v{"kind":"mesh","name":"../../x","frames":[3],"timestamps":["../../a"]}"#,
    );
    let mut hdr = b"h".to_vec();
    let pixels: Vec<_> = (0..32).map(|i| image::Rgb([i as f32, 0.5, 2.0])).collect();
    image::codecs::hdr::HdrEncoder::new(&mut hdr).encode(&pixels, 8, 4).unwrap();
    add("records", "sky.hdr", &hdr);
    add(
        "records",
        "bomb.hdr",
        b"h#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n\x02\x02",
    );
    let value = |v: serde_json::Result<serde_json::Value>| v.unwrap();
    let mut light = fixtures::light_study();
    light.runs.truncate(3);
    light.runs.iter_mut().for_each(|run| run.frames.truncate(3));
    light.steps.truncate(1);
    light.jitter.truncate(2);
    add("records", "light-study.json", &json('s', value(serde_json::to_value(&light))));
    let mut composite = fixtures::composite_study();
    composite.runs.truncate(4);
    composite.runs.iter_mut().for_each(|run| run.frames.truncate(2));
    add("records", "composite-study.json", &json('s', value(serde_json::to_value(&composite))));
    let mut sweep = fixtures::tradeoff();
    sweep.points.truncate(4);
    add("records", "tradeoff.json", &json('s', value(serde_json::to_value(&sweep))));
    add(
        "records",
        "timings.json",
        &json('t', value(serde_json::to_value(fixtures::timings([1.0; 7])))),
    );
    add("records", "summary.json", br#"u{"frames":3,"states":{"tracking":3},"name":"<b>"}"#);
    let run = serde_json::json!({"preset": "ours", "sequence": "a", "command": "kinlight replay",
        "machine": fixtures::machine()});
    add("records", "run.json", &json('r', run));

    let chart: String = crate::calibrate::chart::SRGB_CODES
        .iter()
        .map(|[r, g, b]| format!("patch,{r},{g},{b}\n"))
        .collect();
    add("calibrate", "chart.csv", format!("cname,r,g,b\n{chart}").as_bytes());
    add("calibrate", "chart-short.csv", b"c1,2,3\n4,5,6\n");
    add("calibrate", "exposures.txt", b"e# stops\na.png 0.01\nb/c.png 0.02 # twice\n");
    add("calibrate", "exposures-outside.txt", b"e../a.png 0.01\n/etc/b.png 1\n");
    add("calibrate", "disparity.pgm", b"pP5\n# made\n2 1\n2047\n\x07\xff\x01\x02");
    add("calibrate", "bomb.pgm", b"pP5 8192 8192 65535\n\0");
}

#[test]
#[ignore = "writes fuzz/corpus"]
fn seeds_are_written_anew() {
    for (target, name, content) in all() {
        let folder = corpus().join(target);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(name), content).unwrap();
    }
}

#[test]
fn seeds_named_for_a_fault_are_refused_and_the_others_taken() {
    let faults = [
        "bomb",
        "cut",
        "outside",
        "none",
        "unknown",
        "far",
        "mirrored",
        "zeros",
        "nothing",
        "short",
        "no-text",
        "link",
        "absolute",
        "nested",
        "out-of-range",
        "empty",
        "overlap",
        "unclear",
    ];
    for target in &TARGETS {
        let folder = tempfile::tempdir().unwrap();
        let scratch = Scratch::new(folder.path());
        for (_, name, content) in all().into_iter().filter(|(of, ..)| *of == target.name) {
            let faulty = faults.iter().any(|fault| name.contains(fault));
            assert_eq!((target.body)(&content, &scratch), !faulty, "{}/{name}", target.name);
        }
    }
}
