//! The Surface stage: the main geometry buffer every frame, the auxiliary ones when they are out
//! of date.

use super::{AuxiliaryRig, SurfaceParams, TsdfVolume};
use crate::geometry::GBuffer;
use crate::math::View;
use glam::Vec3;

/// What an auxiliary buffer shows: its view, and the volume's revision at that time. Buffers of the same
/// volume that show the same hold the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    view: View,
    revision: Option<u64>,
}

/// Geometry buffers ray-cast from the volume.
///
/// The main buffer is redone in every update. An auxiliary buffer is out of date when the volume
/// changed since, or its view moved. A moved view is redone at once; of the others,
/// `refresh_per_frame` are redone, those with the oldest contents first (in a tie the first of
/// left, right, top, light): with one a frame, a buffer is at most as many updates old as there are
/// buffers. During the first `warm_up_updates` all are redone.
#[derive(Debug)]
pub struct SurfaceStage {
    pub main: GBuffer,
    /// Left, right, top, light, as far as they are switched on; the light's once its direction
    /// is known.
    pub auxiliary: Vec<GBuffer>,
    shown: Vec<Shown>,
    rig: AuxiliaryRig,
    params: SurfaceParams,
    light: Option<Vec3>,
    updates: u64,
}

impl SurfaceStage {
    /// For a volume, from the camera that placed it.
    pub fn new(volume: &TsdfVolume, first_camera: View, params: &SurfaceParams) -> Self {
        Self {
            main: GBuffer::empty(first_camera),
            auxiliary: Vec::new(),
            shown: Vec::new(),
            rig: AuxiliaryRig::new(volume, &first_camera, params),
            params: params.clone(),
            light: None,
            updates: 0,
        }
    }

    /// What each auxiliary buffer shows.
    pub fn shown(&self) -> &[Shown] {
        &self.shown
    }

    pub fn rig(&self) -> &AuxiliaryRig {
        &self.rig
    }

    /// Takes other settings from the next update on. Buffers whose view stays keep what they show.
    pub fn reconfigure(&mut self, params: &SurfaceParams) {
        self.params = params.clone();
        self.rig.reconfigure(params);
        let mut known: Vec<(Shown, GBuffer)> =
            self.shown.drain(..).zip(self.auxiliary.drain(..)).collect();
        for view in self.rig.views(self.light) {
            let at = known.iter().position(|(shown, _)| shown.view == view);
            let (shown, buffer) = at.map_or_else(
                || (Shown { view, revision: None }, GBuffer::empty(view)),
                |at| known.swap_remove(at),
            );
            self.shown.push(shown);
            self.auxiliary.push(buffer);
        }
    }

    /// Casts what `camera_view` sees, and the auxiliary buffers that are due. `towards_light` is a
    /// unit vector; without it the last known direction is kept.
    pub fn update(&mut self, volume: &TsdfVolume, camera_view: View, towards_light: Option<Vec3>) {
        volume.raycast(&camera_view, &mut self.main);
        self.follow_light(towards_light);
        self.place_views();
        for at in self.due(volume.revision()) {
            let shown = &mut self.shown[at];
            volume.raycast(&shown.view, &mut self.auxiliary[at]);
            shown.revision = Some(volume.revision());
        }
        self.updates += 1;
    }

    /// Takes a new direction where it differs from the one in use by more than the tolerance.
    fn follow_light(&mut self, towards_light: Option<Vec3>) {
        let Some(direction) = towards_light.and_then(crate::math::unit) else { return };
        let tolerance = self.params.light_tolerance_deg.to_radians();
        if self.light.is_none_or(|light| light.angle_between(direction) > tolerance) {
            self.light = Some(direction);
        }
    }

    fn place_views(&mut self) {
        for (at, view) in self.rig.views(self.light).into_iter().enumerate() {
            match self.shown.get_mut(at) {
                None => {
                    self.shown.push(Shown { view, revision: None });
                    self.auxiliary.push(GBuffer::empty(view));
                }
                Some(shown) if shown.view != view => *shown = Shown { view, revision: None },
                Some(_) => {}
            }
        }
    }

    /// Buffers to redo now.
    fn due(&self, revision: u64) -> Vec<usize> {
        let mut stale: Vec<usize> =
            (0..self.shown.len()).filter(|&i| self.shown[i].revision != Some(revision)).collect();
        // never cast sorts first, then the oldest; the sort is stable
        stale.sort_by_key(|&i| self.shown[i].revision);
        let limited =
            self.params.refresh_per_frame > 0 && self.updates >= self.params.warm_up_updates;
        if limited {
            let moved = stale.iter().filter(|&&i| self.shown[i].revision.is_none()).count();
            stale.truncate(moved.max(self.params.refresh_per_frame));
        }
        stale
    }
}
