//! Which virtual objects a run gets: from the command line, from the sequence, or one of our own.

use super::CliError;
use super::args::ObjectArgs;
use glam::{Vec2, Vec3};
use kinlight::capture::FrameSource;
use kinlight::scene::{Model, Placement, Similarity, SurfaceAnchor, VirtualObject, VirtualScene};
use std::path::Path;
use std::sync::Arc;

/// Where an object stands when nobody says: on the surface below the picture's centre.
const DEFAULT_ANCHOR: [f32; 2] = [0.5, 0.6];

/// `sequence` is the recording, where there is one; `first` its first frame that is run.
pub fn scene(
    object: &ObjectArgs,
    sequence: Option<&Path>,
    first: usize,
    source: &dyn FrameSource,
) -> Result<VirtualScene, CliError> {
    if object.no_object {
        return Ok(VirtualScene::default());
    }
    if let Some(file) = &object.scene {
        return VirtualScene::load(file).map_err(bad);
    }
    if object.object.is_none() && object.at.is_none() && object.on.is_none() {
        return own(sequence, source, first, object.yaw, object.scale);
    }
    let model = match &object.object {
        Some(file) => Model::load(file).map_err(bad)?,
        None => kinlight::synth::virtual_object::model(),
    };
    let yaw = object.yaw.to_radians();
    let placement = match (object.at, object.on) {
        (Some(at), _) => {
            Placement::Placed(Similarity::standing(at.into(), Vec3::Z, yaw, object.scale))
        }
        (None, Some((u, v, frame))) => standing_at(Vec2::new(u, v), frame, yaw, object.scale),
        (None, None) => standing_at(default_pixel(source), first, yaw, object.scale),
    };
    Ok(VirtualScene::from_objects([VirtualObject { model: Arc::new(model), placement }]))
}

/// The sequence's own scene; without one, an object of ours on the surface below the picture's
/// centre in frame `first`, turned by `yaw` degrees.
pub fn of_sequence(
    sequence: &Path,
    source: &dyn FrameSource,
    first: usize,
    yaw: f32,
    scale: f32,
) -> Result<VirtualScene, CliError> {
    own(Some(sequence), source, first, yaw, scale)
}

fn own(
    sequence: Option<&Path>,
    source: &dyn FrameSource,
    first: usize,
    yaw: f32,
    scale: f32,
) -> Result<VirtualScene, CliError> {
    let file = sequence.map(|folder| folder.join("scene.toml")).filter(|file| file.exists());
    if let Some(file) = file {
        return VirtualScene::load_own(&file).map_err(bad);
    }
    let model = Arc::new(kinlight::synth::virtual_object::model());
    let placement = standing_at(default_pixel(source), first, yaw.to_radians(), scale);
    Ok(VirtualScene::from_objects([VirtualObject { model, placement }]))
}

fn default_pixel(source: &dyn FrameSource) -> Vec2 {
    let camera = source.camera();
    Vec2::from(DEFAULT_ANCHOR) * Vec2::new(camera.width as f32, camera.height as f32)
}

fn standing_at(pixel: Vec2, frame: usize, yaw_rad: f32, scale: f32) -> Placement {
    Placement::Pending(SurfaceAnchor::new(pixel, frame, yaw_rad, scale, None))
}

fn bad(error: kinlight::scene::SceneError) -> CliError {
    CliError::Object(error.to_string())
}
