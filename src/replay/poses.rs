//! Estimated and recorded poses of a run, for its trajectory errors.

use crate::eval::trajectory::{self, AbsoluteError, MATCH_TOLERANCE_S, RelativeError, TimedPose};
use crate::math::Pose;

/// Frames that are kept of a run whose length nobody knows: half a megabyte.
const MOST: usize = 4096;

/// Keeps every frame of a recording. Of a camera, whose run may last for days, it keeps each where the camera
/// has poses (a recording that is played) until there are `MOST`, then every second, every fourth, ..
#[derive(Debug)]
pub struct RunPoses {
    endless: bool,
    /// Frames from one that is kept to the next.
    step: usize,
    frames: usize,
    kept: Vec<FramePoses>,
}

#[derive(Clone, Copy, Debug)]
pub struct FramePoses {
    pub timestamp_s: f64,
    pub estimated: Option<Pose>,
    pub recorded: Option<Pose>,
}

impl RunPoses {
    pub fn new(endless: bool) -> Self {
        Self { endless, step: 1, frames: 0, kept: Vec::new() }
    }

    pub fn push(&mut self, frame: FramePoses) {
        if self.endless && self.kept.is_empty() && frame.recorded.is_none() {
            return;
        }
        if self.frames.is_multiple_of(self.step) {
            self.kept.push(frame);
        }
        self.frames += 1;
        if self.endless && self.kept.len() == MOST {
            self.step *= 2;
            let mut even = [true, false].into_iter().cycle();
            self.kept.retain(|_| even.next() == Some(true));
        }
    }

    /// `None` where there are too few poses to say.
    pub fn errors(&self) -> (Option<AbsoluteError>, Option<RelativeError>) {
        let path = |of: fn(&FramePoses) -> Option<Pose>| -> Vec<TimedPose> {
            let timed = |f: &FramePoses| {
                Some(TimedPose { timestamp_s: f.timestamp_s, world_from_camera: of(f)? })
            };
            self.kept.iter().filter_map(timed).collect()
        };
        let (estimated, recorded) = (path(|f| f.estimated), path(|f| f.recorded));
        let absolute = trajectory::absolute_error(&estimated, &recorded, MATCH_TOLERANCE_S);
        let relative = trajectory::relative_error(&estimated, &recorded, MATCH_TOLERANCE_S, 1);
        let relative = relative.map(|error| RelativeError { step: self.step, ..error });
        (absolute.ok(), relative.ok())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion};

    /// Along a circle; the estimate goes away from it by a millimetre in a thousand frames.
    fn frame(i: usize) -> FramePoses {
        let turn = i as f64 * 0.01;
        let pose = |off_m: f64| {
            let at = Translation3::new(turn.cos(), turn.sin(), off_m + 0.1 * (3.0 * turn).sin());
            Pose::from_parts(at, UnitQuaternion::identity())
        };
        let estimated = Some(pose(1e-6 * i as f64));
        FramePoses { timestamp_s: i as f64 / 30.0, estimated, recorded: Some(pose(0.0)) }
    }

    fn run(endless: bool, frames: usize) -> RunPoses {
        let mut poses = RunPoses::new(endless);
        (0..frames).for_each(|i| poses.push(frame(i)));
        poses
    }

    #[test]
    fn days_of_a_camera_take_the_memory_of_minutes_and_have_the_same_error() {
        let (all, some) = (run(false, 50_000), run(true, 50_000));
        assert_eq!(all.kept.len(), 50_000);
        assert!(some.kept.len() < MOST && some.kept.capacity() <= MOST, "{}", some.kept.len());
        let (exact, relative) = all.errors();
        let (found, relative_found) = some.errors();
        let (exact, found) = (exact.unwrap().translation_m, found.unwrap().translation_m);
        // every 16th frame of a path whose error is smooth: its mean changes by the ends, a part in 3125
        assert!((found.rmse / exact.rmse - 1.0).abs() < 1e-3, "{found:?} {exact:?}");
        let (relative, relative_found) = (relative.unwrap(), relative_found.unwrap());
        assert_eq!((relative.step, relative_found.step), (1, 16));
        let ratio = relative_found.translation_m.mean / relative.translation_m.mean;
        assert!((ratio - 16.0).abs() < 1e-3, "{ratio}");
    }

    #[test]
    fn a_camera_without_poses_leaves_nothing() {
        let mut poses = RunPoses::new(true);
        (0..100_000).for_each(|i| poses.push(FramePoses { recorded: None, ..frame(i) }));
        assert!(poses.kept.is_empty());
        assert!(matches!(poses.errors(), (None, None)));
    }

    #[test]
    fn frames_whose_pose_is_missing_do_not_shift_the_others() {
        let mut poses = RunPoses::new(false);
        for i in 0..100 {
            let frame = frame(i);
            let lost = i % 7 == 0;
            let unrecorded = i % 5 == 1;
            poses.push(FramePoses {
                estimated: frame.estimated.filter(|_| !lost),
                recorded: frame.recorded.filter(|_| !unrecorded),
                ..frame
            });
        }
        let error = poses.errors().0.unwrap();
        // of 100 frames 15 were lost, 20 have no recorded pose, 3 (21, 56, 91) both
        assert_eq!((error.estimated, error.reference, error.matched), (85, 80, 68));
        // the way off is less than 0.1 mm
        assert!(error.translation_m.max < 1e-4, "{error:?}");
    }
}
