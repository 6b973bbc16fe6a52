//! Which auxiliary buffers there are and which of them are redone when, wherever they are kept.

use super::{AuxiliaryRig, Lattice, SurfaceParams};
use crate::math::View;
use glam::Vec3;

/// What an auxiliary buffer shows: its view, and the volume's revision at that time. Buffers of the same
/// volume that show the same hold the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    view: View,
    revision: Option<u64>,
}

/// An auxiliary buffer is out of date when the volume changed since, or its view moved. A moved view
/// is redone at once; of the others, `refresh_per_frame` are redone, those with the oldest contents
/// first (in a tie the first of left, right, top, light). With the default of one a frame and four
/// buffers a buffer is at most four updates old. During the first `warm_up_updates` all are redone.
#[derive(Debug)]
pub(crate) struct AuxiliarySchedule {
    shown: Vec<Shown>,
    rig: AuxiliaryRig,
    params: SurfaceParams,
    light: Option<Vec3>,
    updates: u64,
}

impl AuxiliarySchedule {
    pub fn new(lattice: &Lattice, first_camera: &View, params: &SurfaceParams) -> Self {
        Self {
            shown: Vec::new(),
            rig: AuxiliaryRig::new(lattice, first_camera, params),
            params: params.clone(),
            light: None,
            updates: 0,
        }
    }

    pub fn rig(&self) -> &AuxiliaryRig {
        &self.rig
    }

    /// What each buffer shows.
    pub fn shown(&self) -> &[Shown] {
        &self.shown
    }

    /// The views that buffers are wanted for, in the buffers' order.
    pub fn views(&self) -> impl Iterator<Item = View> {
        self.shown.iter().map(|shown| shown.view)
    }

    /// Takes other settings. Returns the views wanted from now on, each with the number of the buffer
    /// that showed it so far; without one a new buffer is due.
    pub fn reconfigure(&mut self, params: &SurfaceParams) -> Vec<(View, Option<usize>)> {
        self.params = params.clone();
        self.rig.reconfigure(params);
        let mut known: Vec<Option<Shown>> = self.shown.drain(..).map(Some).collect();
        let mut wanted = Vec::new();
        for view in self.rig.views(self.light) {
            let at = known.iter().position(|shown| shown.is_some_and(|s| s.view == view));
            let shown = at.and_then(|at| known[at].take());
            self.shown.push(shown.unwrap_or(Shown { view, revision: None }));
            wanted.push((view, at));
        }
        wanted
    }

    /// Starts an update and returns the buffers to redo in it, from a volume of this revision.
    /// `towards_light` is a unit vector; without it the last known direction is kept.
    pub fn next(&mut self, revision: u64, towards_light: Option<Vec3>) -> Vec<usize> {
        self.follow_light(towards_light);
        self.place_views();
        let due = self.due(revision);
        due.iter().for_each(|&at| self.shown[at].revision = Some(revision));
        self.updates += 1;
        due
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
                None => self.shown.push(Shown { view, revision: None }),
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
