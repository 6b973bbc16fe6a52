//! What the pipeline decides on the host, wherever the stages run.

use super::origin::is_first_camera;
use super::{PipelineError, WorldOrigin};
use crate::capture::{RawFrame, RgbdFrame};
use crate::config::Settings;
use crate::fusion::place_centre;
use crate::lighting::ShLight;
use crate::math::{Pinhole, Pose, View, sh};
use crate::mesh::TriangleMesh;
use crate::scene::{Model, Similarity, VirtualScene};
use crate::tracking::{OnLost, PoseMode, Tracking, TrackingParams, TrackingState};
use glam::Vec3;
use std::sync::Arc;

/// The run's local coordinates. The first camera chooses them, and the scene is moved there. Where poses are those of
/// the recording, there is none before the first that a camera can have.
pub fn local_world(
    origin: &mut Option<WorldOrigin>,
    scene: &mut VirtualScene,
    recorded_pose: Option<Pose>,
    mode: PoseMode,
) -> WorldOrigin {
    if let Some(origin) = origin {
        return *origin;
    }
    let first = recorded_pose.filter(is_first_camera);
    let chosen = WorldOrigin::near(&first.unwrap_or_default());
    if first.is_some() || mode != PoseMode::Recorded {
        scene.translate(chosen.local_point([0.0; 3]));
        *origin = Some(chosen);
    }
    chosen
}

/// Whether frames of this camera can be processed.
pub fn check_camera(camera: &Pinhole) -> Result<(), PipelineError> {
    camera.check().map_err(PipelineError::Camera)
}

/// Whether both pictures of a frame show the same.
pub fn check_frame(raw: &RawFrame) -> Result<(), PipelineError> {
    let (color, depth) = (raw.color.size(), raw.depth_m.size());
    match color == depth {
        true => Ok(()),
        false => Err(PipelineError::Pictures { frame: raw.index, color, depth }),
    }
}

/// Whether the map has to be emptied after this frame.
pub fn begins_anew(
    params: &TrackingParams,
    tracking: &Tracking,
    frame: usize,
) -> Result<bool, PipelineError> {
    match params.on_lost {
        _ if tracking.state != TrackingState::Lost => Ok(false),
        OnLost::Hold | OnLost::Relocalise => Ok(false),
        OnLost::Reset => Ok(true),
        OnLost::Stop => {
            let reason = tracking.issue.map_or("no reason".into(), |issue| issue.to_string());
            Err(PipelineError::Lost { frame, reason })
        }
    }
}

/// Where V is by the settings, or from what this frame sees; none where it sees nothing.
pub fn map_centre(
    settings: &Settings,
    origin: Option<&WorldOrigin>,
    frame: &RgbdFrame,
    view: &View,
) -> Option<Vec3> {
    match (settings.volume.centre, origin) {
        (Some(centre), Some(origin)) => Some(origin.local_point(centre)),
        _ => place_centre(frame, view, settings.volume.side_m),
    }
}

/// Where the light is wanted, near the local origin.
pub fn light_point(
    settings: &Settings,
    origin: Option<&WorldOrigin>,
    scene: &VirtualScene,
) -> Option<Vec3> {
    if let (Some(at), Some(origin)) = (settings.light.at, origin) {
        return Some(origin.local_point(at));
    }
    let (sum, count) = scene.bounds().fold((Vec3::ZERO, 0), |(sum, n), b| (sum + b.centre, n + 1));
    (count > 0).then(|| sum / count as f32)
}

/// Refuses what would lose the map or the camera.
pub fn may_change(from: &Settings, to: &Settings) -> Result<(), PipelineError> {
    let fixed = [
        ("input", to.input == from.input),
        ("tracking", to.tracking == from.tracking),
        ("volume", to.volume == from.volume),
    ];
    match fixed.iter().find(|(_, same)| !same) {
        Some(&(section, _)) => Err(PipelineError::Fixed { section }),
        None => Ok(()),
    }
}

/// A light without the bands that the transfer does not have. Coefficients that it lacks or that are not
/// finite are dark.
pub fn with_bands(mut light: ShLight, most: usize) -> ShLight {
    light.bands = light.bands.min(most);
    light.coefficients.resize(sh::coefficients(light.bands), [0.0; 3]);
    for value in light.coefficients.as_flattened_mut() {
        *value = if value.is_finite() { *value } else { 0.0 };
    }
    light
}

/// From local coordinates to those of the recording.
pub fn mesh_in_world(mut mesh: TriangleMesh, origin: Option<&WorldOrigin>) -> TriangleMesh {
    if let Some(offset) = origin.map(WorldOrigin::offset) {
        for position in &mut mesh.positions {
            *position = std::array::from_fn(|i| (f64::from(position[i]) + offset[i]) as f32);
        }
    }
    mesh
}

/// The objects that stood somewhere when it was looked last.
#[derive(Default)]
pub struct PlacedObjects(Vec<(Arc<Model>, Similarity)>);

impl PlacedObjects {
    /// Whether an object has come, gone or moved since the last call.
    pub fn follow(&mut self, scene: &VirtualScene) -> bool {
        let placed =
            || scene.objects.iter().filter_map(|o| Some((&o.model, o.world_from_object()?)));
        let mut known = self.0.iter();
        let same = placed().all(|(model, place)| {
            known.next().is_some_and(|(m, p)| Arc::ptr_eq(m, model) && *p == place)
        }) && known.next().is_none();
        if !same {
            self.0.clear();
            self.0.extend(placed().map(|(model, place)| (model.clone(), place)));
        }
        !same
    }
}
