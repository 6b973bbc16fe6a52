//! What a made sequence is to be.

use super::light::{Environment, LatLong};
use super::scene::{HALF_CIRCLE_LIGHTS, Scene, VirtualKind};
use super::scenes;
use super::tracer::Shot;
use super::truth::Segment;
use crate::capture::CaptureError;
use crate::capture::writer::ColorFormat;
use crate::image::encoded::{WITH_RADIANCE, decode_file};
use crate::image::{Image, Size};
use crate::math::Pinhole;
use crate::stop::Stopped;
use std::path::{Path, PathBuf};

const FRAMES_PER_S: f64 = 30.0;

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
    /// Later change to another of those lamps.
    pub switch: Option<LightSwitch>,
    /// Replace the scene's environment by a lat-long Radiance picture, +z up.
    pub environment: Option<PathBuf>,
    /// The camera stays where it is at the start; what moves in the scene moves.
    pub still: bool,
    /// Add a sensor's noise to the colour pictures; composites stay clean.
    pub color_noise: bool,
    /// Another virtual object than the scene's own.
    pub object: Option<VirtualKind>,
}

/// From `frame` on, half-circle light `light` alone shines.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightSwitch {
    pub frame: usize,
    pub light: usize,
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
            switch: None,
            still: false,
            color_noise: false,
            object: None,
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

    /// The first option that is out of range.
    pub(super) fn check(&self) -> Result<(), SynthError> {
        let bad = |problem: String| Err(SynthError::Options(problem));
        if self.frames == 0 || self.samples == 0 || self.virtual_every == 0 {
            return bad("frames, samples and virtual_every must be at least 1".into());
        }
        if !(1..=8192).contains(&self.width) || !(1..=8192).contains(&self.height) {
            let (width, height) = (self.width, self.height);
            return bad(format!("pictures of {width}x{height}: sides must be 1 to 8192 pixels"));
        }
        let lights = self.light.into_iter().chain(self.switch.map(|s| s.light));
        if let Some(light) = lights.into_iter().find(|&light| light >= HALF_CIRCLE_LIGHTS) {
            return bad(format!("light {light}: there are lights 0 to {}", HALF_CIRCLE_LIGHTS - 1));
        }
        match self.switch {
            Some(switch) if !(1..self.frames).contains(&switch.frame) => {
                let (frame, frames) = (switch.frame, self.frames);
                bad(format!("light switched at frame {frame} of {frames}: not within the sequence"))
            }
            _ => Ok(()),
        }
    }

    /// Frames with one light each, in order.
    pub(crate) fn segments(&self) -> Result<Vec<Segment>, SynthError> {
        self.check()?;
        let end = self.frames - 1;
        Ok(match self.switch {
            None => vec![Segment { frames: 0..=end, scene: self.scene(self.light)? }],
            Some(LightSwitch { frame, light }) => vec![
                Segment { frames: 0..=frame - 1, scene: self.scene(self.light)? },
                Segment { frames: frame..=end, scene: self.scene(Some(light))? },
            ],
        })
    }

    /// The scene with the options' lights and object.
    fn scene(&self, light: Option<usize>) -> Result<Scene, SynthError> {
        let mut scene = scenes::by_name(&self.scene).ok_or_else(|| {
            let known = scenes::NAMES.join(", ");
            SynthError::Options(format!("no scene is called {}; there are {known}", self.scene))
        })?;
        if let Some(index) = light {
            scene = scene.with_half_circle_light(index);
        }
        if let Some(path) = &self.environment {
            scene.environment = Environment::LatLong(read_environment(path)?);
        }
        scene.virtual_kind = self.object.unwrap_or(scene.virtual_kind);
        Ok(scene)
    }

    /// Of a frame since the first.
    pub(super) fn time_s(&self, frame: usize) -> f64 {
        frame as f64 / FRAMES_PER_S
    }

    /// How the camera takes a frame.
    pub(crate) fn shot(&self, scene: &Scene, frame: usize) -> Shot {
        let pose_time_s = if self.still { 0.0 } else { self.time_s(frame) };
        Shot {
            camera: self.camera(),
            world_from_camera: scene.camera_path.pose(pose_time_s),
            samples: self.samples,
            bounces: self.bounces,
            seed: self.seed,
            frame: frame as u32,
        }
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
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

pub(super) fn file_error(path: &Path, problem: impl ToString) -> SynthError {
    SynthError::File { path: path.display().to_string(), problem: problem.to_string() }
}

pub(crate) fn read_environment(path: &Path) -> Result<LatLong, SynthError> {
    let picture = decode_file(path, WITH_RADIANCE).map_err(|e| file_error(path, e))?.into_rgb32f();
    let size = Size::new(picture.width() as usize, picture.height() as usize);
    let rgb = picture.pixels().map(|p| p.0).collect();
    LatLong::new(Image::from_vec(size, rgb)).ok_or_else(|| file_error(path, "an empty picture"))
}
