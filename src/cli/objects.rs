//! Which virtual objects a run gets: from the command line, from the sequence, or one of our own.

use super::CliError;
use super::args::RunArgs;
use glam::{Vec2, Vec3};
use kinlight::capture::FrameSource;
use kinlight::scene::{Model, Placement, Similarity, SurfaceAnchor, VirtualObject, VirtualScene};
use std::sync::Arc;

/// Where an object stands when nobody says: on the surface below the picture's centre.
const DEFAULT_ANCHOR: [f32; 2] = [0.5, 0.6];

pub fn scene(run: &RunArgs, source: &dyn FrameSource) -> Result<VirtualScene, CliError> {
    let bad = |e: kinlight::scene::SceneError| CliError::Object(e.to_string());
    let object = &run.object;
    if object.no_object {
        return Ok(VirtualScene::default());
    }
    let own_scene = run.sequence.join("scene.toml");
    if let Some(file) = &object.scene {
        return VirtualScene::load(file).map_err(bad);
    }
    if object.object.is_none() && object.at.is_none() && object.on.is_none() && own_scene.exists() {
        return VirtualScene::load(&own_scene).map_err(bad);
    }
    let model = match &object.object {
        Some(file) => Model::load(file).map_err(bad)?,
        None => kinlight::synth::virtual_object::model(),
    };
    let yaw = object.yaw.to_radians();
    let anchor = |u, v, frame| {
        Placement::Pending(SurfaceAnchor::new(Vec2::new(u, v), frame, yaw, object.scale, None))
    };
    let placement = match (object.at, object.on) {
        (Some(at), _) => {
            Placement::Placed(Similarity::standing(at.into(), Vec3::Z, yaw, object.scale))
        }
        (None, Some((u, v, frame))) => anchor(u, v, frame),
        (None, None) => {
            let camera = source.camera();
            let [u, v] = DEFAULT_ANCHOR;
            let first = run.frames.map_or(0, |f| f.first);
            anchor(camera.width as f32 * u, camera.height as f32 * v, first)
        }
    };
    Ok(VirtualScene::from_objects([VirtualObject { model: Arc::new(model), placement }]))
}
