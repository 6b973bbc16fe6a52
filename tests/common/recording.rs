//! Small recordings: every fourth pixel of the demo, which is exact for depth and camera alike.

use kinlight::capture::writer::{ColorFormat, DepthCompression, FrameRef, TumWriter};
use kinlight::capture::{CaptureOptions, FrameSource, RawFrame, open_sequence};
use kinlight::image::{Image, Size};
use kinlight::math::Pinhole;
use std::path::{Path, PathBuf};

/// A recording in memory.
#[derive(Clone)]
pub struct Recording {
    pub camera: Pinhole,
    pub frames: Vec<RawFrame>,
}

/// Of the demo, every n-th pixel in x and y.
const STEP: usize = 4;

pub fn demo_folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sequences/demo")
}

/// The first frames of the demo at 160x120.
pub fn small_demo(count: usize) -> Recording {
    let options = CaptureOptions { end_frame: Some(count), ..CaptureOptions::default() };
    let mut source = open_sequence(&demo_folder(), &options).unwrap();
    let full = source.camera();
    let step = STEP as f32;
    let camera = Pinhole {
        width: full.width / STEP,
        height: full.height / STEP,
        fx: full.fx / step,
        fy: full.fy / step,
        cx: full.cx / step,
        cy: full.cy / step,
    };
    let frames = std::iter::from_fn(|| source.next_frame().unwrap())
        .map(|frame| RawFrame {
            color: every_nth(&frame.color, camera.size()),
            depth_m: every_nth(&frame.depth_m, camera.size()),
            ..frame
        })
        .collect();
    Recording { camera, frames }
}

/// The first four frames of the demo over and over, at 30 frames a second, cropped to this size.
pub fn looped(count: usize, size: Size) -> Recording {
    let mut recording = small_demo(4).cropped(size);
    let some = recording.frames.clone();
    let again = |i: usize| RawFrame {
        index: i,
        timestamp_s: looped_time_s(i),
        ..some[i % some.len()].clone()
    };
    recording.frames = (0..count).map(again).collect();
    recording
}

/// In whole microseconds, as recordings have it.
pub fn looped_time_s(frame: usize) -> f64 {
    500.0 + (frame as f64 / 30.0 * 1e6).round() / 1e6
}

fn every_nth<T: Copy>(image: &Image<T>, size: Size) -> Image<T> {
    let pixels =
        (0..size.pixels()).map(|i| image[(i % size.width * STEP, i / size.width * STEP)]).collect();
    Image::from_vec(size, pixels)
}

impl Recording {
    /// The window of this size at the upper left corner.
    pub fn cropped(&self, size: Size) -> Self {
        let camera = Pinhole { width: size.width, height: size.height, ..self.camera };
        let frames = self.frames.iter().map(|frame| RawFrame {
            color: crop(&frame.color, size),
            depth_m: crop(&frame.depth_m, size),
            ..frame.clone()
        });
        Self { camera, frames: frames.collect() }
    }

    pub fn with_color(mut self, value: u8) -> Self {
        self.frames.iter_mut().for_each(|frame| frame.color.fill([value; 3]));
        self
    }

    pub fn without_depth(mut self) -> Self {
        self.frames.iter_mut().for_each(|frame| frame.depth_m.fill(0.0));
        self
    }

    /// As a recording in the TUM layout, with the demo's object.
    pub fn write(&self, folder: &Path) {
        let mut writer =
            TumWriter::create(folder, self.camera, ColorFormat::Png, DepthCompression::Fast)
                .unwrap();
        for frame in &self.frames {
            writer
                .push(&FrameRef {
                    timestamp_s: frame.timestamp_s,
                    color: &frame.color,
                    depth_m: &frame.depth_m,
                    second_depth_m: None,
                    world_from_camera: frame.world_from_camera.as_ref(),
                })
                .unwrap();
        }
        writer.finish().unwrap();
        for name in ["scene.toml", "object.glb"] {
            std::fs::copy(demo_folder().join(name), folder.join(name)).unwrap();
        }
    }
}

fn crop<T: Copy>(image: &Image<T>, size: Size) -> Image<T> {
    let pixels = (0..size.pixels()).map(|i| image[(i % size.width, i / size.width)]).collect();
    Image::from_vec(size, pixels)
}
