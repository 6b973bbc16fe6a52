//! Whatever a camera may deliver, through every stage on the CPU: what kernels look up without a check must lie
//! inside.

use super::{Scratch, accepted};
use crate::capture::RawFrame;
use crate::config::Settings;
use crate::image::{Image, Size};
use crate::math::{Pinhole, Pose};
use crate::pipeline::Pipeline;
use crate::scene::{Model, PartData, Similarity, Vertex, VirtualObject, VirtualScene};
use crate::timing::StageTimes;
use glam::{Quat, Vec3};
use std::sync::Arc;

const FRAMES: usize = 3;
/// Size, lens, choices; then two bytes for each pose, and pixels to the end, again from their first byte
/// where there are too few.
const HEADER: usize = 4;

/// Frames of a camera: small pictures of any size, depth of any bits, and any choice of stages.
pub fn frames(data: &[u8], _: &Scratch) -> bool {
    let (Some(header), Some(pixels)) = (data.get(..HEADER), data.get(HEADER + 2 * FRAMES..)) else {
        return false;
    };
    let poses = &data[HEADER..];
    let [width, height, lens, choices] = [0, 1, 2, 3].map(|i| header[i]);
    // under sanitizers a ray-traced pixel takes a millisecond
    let size = Size::new(usize::from(width % 20) + 1, usize::from(height % 16) + 1);
    let f = 0.2 + f32::from(lens);
    let [cx, cy] = [size.width, size.height].map(|n| 0.5 * (n as f32 - 1.0));
    let camera = Pinhole { width: size.width, height: size.height, fx: f, fy: f, cx, cy };
    let mut source = Source { bytes: pixels, next: 0 };
    let made = Pipeline::new(settings(choices), camera, scene());
    let Ok(mut pipeline) = made else { return accepted(made.map(|_| ())) };
    for index in 0..FRAMES {
        let depth_m = (0..size.pixels()).map(|_| source.depth_m(choices & 1 != 0)).collect();
        let color = (0..size.pixels()).map(|_| [0; 3].map(|_: u8| source.byte())).collect();
        let moved = [0, 1].map(|i| f64::from(poses[2 * index + i] as i8) * 2e-3);
        let raw = RawFrame {
            index,
            timestamp_s: index as f64 / 30.0,
            color: Image::from_vec(size, color),
            depth_m: Image::from_vec(size, depth_m),
            world_from_camera: Some(Pose::new(
                nalgebra::Vector3::new(moved[0], moved[1], 0.0),
                nalgebra::Vector3::new(0.0, moved[1], moved[0]),
            )),
            exposure_s: None,
        };
        let Ok(outcome) = pipeline.process(raw, StageTimes::default()) else { return false };
        let pose = outcome.tracking.world_from_camera.to_homogeneous();
        assert!(pose.iter().all(|v| v.is_finite()), "{pose}");
        let light = &outcome.light.light.coefficients;
        assert!(light.as_flattened().iter().all(|v| v.is_finite()), "{light:?}");
    }
    true
}

/// Pixels from bytes that have no end; zeros where there are none at all.
struct Source<'a> {
    bytes: &'a [u8],
    next: usize,
}

impl Source<'_> {
    fn byte(&mut self) -> u8 {
        let byte = self.bytes.get(self.next % self.bytes.len().max(1)).copied().unwrap_or(0);
        self.next += 1;
        byte
    }

    /// Any number, or as a sensor that knows 255 steps of 2 cm.
    fn depth_m(&mut self, any: bool) -> f32 {
        match any {
            true => f32::from_le_bytes([0; 4].map(|_: u8| self.byte())),
            false => f32::from(self.byte()) * 0.02,
        }
    }
}

fn settings(choices: u8) -> Settings {
    let mut settings = Settings::preset("ours-fast-mobile").expect("a preset");
    let one_of = |bit: u8, yes: &'static str, no: &'static str| match choices & bit {
        0 => no,
        _ => yes,
    };
    let changes = [
        ("volume.resolution", "16"),
        ("surface.auxiliary_resolution", "16"),
        ("surface.warm_up_updates", "2"),
        ("transfer.directions", "4"),
        ("light.stride", "1"),
        ("tracking.mode", one_of(2, "track", "recorded")),
        ("transfer.subsampling", one_of(4, "1", "4")),
        ("transfer.method", one_of(8, "ray-traced", "image-space")),
        ("bounce.enabled", one_of(8, "false", "true")),
        ("light.channels", one_of(16, "rgb", "intensity")),
        ("volume.side_m", one_of(32, "0.5", "3.0")),
    ];
    for (key, value) in changes {
        settings.set(key, value).expect("a setting");
    }
    settings.validate().expect("settings in range");
    settings
}

/// A square ahead of the camera.
fn scene() -> VirtualScene {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let vertex = |[x, y]: [f32; 2]| Vertex {
        position: Vec3::new(0.1 * x, 0.1 * y, 0.0),
        normal: -Vec3::Z,
        ..Vertex::default()
    };
    let part = PartData {
        vertices: corners.map(vertex).to_vec(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..PartData::default()
    };
    let model = Arc::new(Model::new("square", vec![part]).expect("corners of its own"));
    let pose = Similarity { rotation: Quat::IDENTITY, scale: 1.0, translation: 0.8 * Vec3::Z };
    VirtualScene::from_objects([VirtualObject::placed(model, pose)])
}
