//! The Surface stage: the main geometry buffer every frame, the auxiliary ones when they are out
//! of date.

use super::schedule::{AuxiliarySchedule, Shown};
use super::{AuxiliaryRig, SurfaceParams, TsdfVolume};
use crate::geometry::GBuffer;
use crate::math::View;
use glam::Vec3;

/// Geometry buffers ray-cast from the volume.
///
/// The main buffer is redone in every update, an auxiliary buffer when it is out of date and its turn
/// comes: at once where its view moved, else `refresh_per_frame` in an update, those with the oldest
/// contents first.
#[derive(Debug)]
pub struct SurfaceStage {
    pub main: GBuffer,
    /// Left, right, top, light, as far as they are switched on; the light's once its direction
    /// is known.
    pub auxiliary: Vec<GBuffer>,
    schedule: AuxiliarySchedule,
}

impl SurfaceStage {
    /// For a volume, from the camera that placed it.
    pub fn new(volume: &TsdfVolume, first_camera: View, params: &SurfaceParams) -> Self {
        Self {
            main: GBuffer::empty(first_camera),
            auxiliary: Vec::new(),
            schedule: AuxiliarySchedule::new(&volume.lattice, &first_camera, params),
        }
    }

    /// What each auxiliary buffer shows.
    pub fn shown(&self) -> &[Shown] {
        self.schedule.shown()
    }

    pub fn rig(&self) -> &AuxiliaryRig {
        self.schedule.rig()
    }

    /// Takes other settings from the next update on. Buffers whose view stays keep what they show.
    pub fn reconfigure(&mut self, params: &SurfaceParams) {
        let mut known: Vec<Option<GBuffer>> = self.auxiliary.drain(..).map(Some).collect();
        for (view, at) in self.schedule.reconfigure(params) {
            let buffer = at.and_then(|at| known[at].take());
            self.auxiliary.push(buffer.unwrap_or_else(|| GBuffer::empty(view)));
        }
    }

    /// Casts what `camera_view` sees, and the auxiliary buffers that are due. `towards_light` is a
    /// unit vector; without it the last known direction is kept.
    pub fn update(&mut self, volume: &TsdfVolume, camera_view: View, towards_light: Option<Vec3>) {
        volume.raycast(&camera_view, &mut self.main);
        let due = self.schedule.next(volume.revision(), towards_light);
        let views: Vec<View> = self.schedule.views().collect();
        self.auxiliary.extend(views[self.auxiliary.len()..].iter().map(|&v| GBuffer::empty(v)));
        for at in due {
            volume.raycast(&views[at], &mut self.auxiliary[at]);
        }
    }
}
