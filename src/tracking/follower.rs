//! From frame to pose: the states of the camera and what leads from one to the other.

use super::judgement::{Verdict, judge};
use super::keyframes::Keyframes;
use super::picture_pair::{FrameTag, PicturePair};
use super::registration::{Effort, Fit, align};
use super::{OnLost, PoseMode, Tracking, TrackingIssue, TrackingParams, TrackingState};
use crate::math::{Pinhole, Pose, View};

/// Keyframes that are tried for one lost frame.
const CANDIDATES: usize = 3;

/// Less depth than this is a covered lens or a blind sensor.
const MIN_VALID_SHARE: f32 = 0.02;

/// A model picture taken this far from the guess is replaced by one from there.
const STALE_M: f64 = 0.25;
const STALE_RAD: f64 = 0.25;

/// The states of the camera, on whatever device its pictures lie; [`Tracker`](super::Tracker) shows how
/// they lead from one to the other.
#[derive(Debug)]
pub(crate) struct Follower {
    params: TrackingParams,
    camera: Pinhole,
    keyframes: Keyframes,
    state: TrackingState,
    world_from_camera: Pose,
    /// The last pose fit to fuse with.
    trusted: Pose,
    /// Motion from the frame before the last to the last, in camera axes.
    motion: Pose,
    /// The pose at the start has been chosen.
    placed: bool,
    /// Poorly aligned frames in a row.
    degraded_frames: usize,
}

impl Follower {
    /// `camera` is that of all frames.
    pub fn new(params: &TrackingParams, camera: Pinhole) -> Self {
        Self {
            params: params.clone(),
            camera,
            keyframes: Keyframes::default(),
            state: TrackingState::Init,
            world_from_camera: Pose::identity(),
            trusted: Pose::identity(),
            motion: Pose::identity(),
            placed: false,
            degraded_frames: 0,
        }
    }

    /// Begins anew at this pose: for when the map has been emptied.
    pub fn reset(&mut self, world_from_camera: Pose) {
        self.keyframes.clear();
        self.state = TrackingState::Init;
        self.world_from_camera = world_from_camera;
        self.trusted = world_from_camera;
        self.motion = Pose::identity();
        self.placed = true;
        self.degraded_frames = 0;
    }

    /// The pose of this frame.
    pub fn follow<P: PicturePair>(
        &mut self,
        frame: FrameTag,
        pictures: &mut P,
    ) -> Result<Tracking, P::Error> {
        match self.params.mode {
            PoseMode::Recorded => Ok(self.recorded(frame)),
            PoseMode::Static => {
                let next = self.next_of_fixed();
                self.place(frame);
                Ok(self.unmeasured(frame, next, None))
            }
            PoseMode::Track => self.registered(frame, pictures),
        }
    }

    fn recorded(&mut self, frame: FrameTag) -> Tracking {
        let Some(pose) = frame.recorded_pose else {
            return self.unmeasured(
                frame,
                TrackingState::Lost,
                Some(TrackingIssue::NoRecordedPose),
            );
        };
        let next = self.next_of_fixed();
        self.placed = true;
        self.world_from_camera = pose;
        self.trusted = pose;
        self.unmeasured(frame, next, None)
    }

    /// The first frame is Init, also for poses that are not estimated.
    fn next_of_fixed(&self) -> TrackingState {
        if self.placed { TrackingState::Tracking } else { TrackingState::Init }
    }

    /// Before the first pose: the recording's, or else the world's origin.
    fn place(&mut self, frame: FrameTag) {
        if !self.placed {
            self.world_from_camera = frame.recorded_pose.unwrap_or_else(Pose::identity);
            self.trusted = self.world_from_camera;
            self.placed = true;
        }
    }

    fn registered<P: PicturePair>(
        &mut self,
        frame: FrameTag,
        pictures: &mut P,
    ) -> Result<Tracking, P::Error> {
        let size = pictures.frame_size();
        if size != self.camera.size() {
            let issue = TrackingIssue::WrongSize { width: size.width, height: size.height };
            return Ok(self.lose(frame, None, issue));
        }
        let valid_share = pictures.prepare()?;
        if valid_share < MIN_VALID_SHARE {
            return Ok(self.lose(frame, None, TrackingIssue::NoDepth { valid_share }));
        }
        let Some(model_view) = pictures.model_view() else {
            self.place(frame);
            self.motion = Pose::identity();
            self.consider_keyframe(self.world_from_camera, pictures)?;
            return Ok(self.unmeasured(frame, TrackingState::Init, None));
        };
        self.place(frame);
        let guess = self.guess();
        let fit = self.fit(&model_view, &guess, pictures)?;
        let verdict = judge(fit, Some(&self.world_from_camera), &self.params);
        Ok(match (self.state, verdict) {
            (TrackingState::Lost, Verdict::Good(fit)) => {
                self.accept(frame, fit, TrackingState::Relocalising, None)
            }
            (TrackingState::Lost, _) if self.params.on_lost == OnLost::Relocalise => {
                return self.relocalise(frame, pictures);
            }
            (TrackingState::Lost | TrackingState::Relocalising, Verdict::Poor(fit, issue)) => {
                self.lose(frame, Some(fit), issue)
            }
            (_, Verdict::Good(fit)) => {
                let tracking = self.accept(frame, fit, TrackingState::Tracking, None);
                self.consider_keyframe(fit.world_from_camera, pictures)?;
                tracking
            }
            (_, Verdict::Poor(fit, issue))
                if self.degraded_frames >= self.params.max_degraded_frames
                    && !matches!(issue, TrackingIssue::Underconstrained { .. }) =>
            {
                self.lose(frame, Some(fit), issue)
            }
            (_, Verdict::Poor(fit, issue)) => {
                self.accept(frame, fit, TrackingState::Degraded, Some(issue))
            }
            (_, Verdict::Bad(fit, issue)) => self.lose(frame, fit, issue),
        })
    }

    /// Keeps this frame to come back to, where that is wanted and no other was taken from near by.
    fn consider_keyframe<P: PicturePair>(
        &mut self,
        world_from_camera: Pose,
        pictures: &mut P,
    ) -> Result<(), P::Error> {
        if self.params.on_lost == OnLost::Relocalise && !self.keyframes.has_near(&world_from_camera)
        {
            self.keyframes.keep(pictures.thumbnail()?, world_from_camera);
        }
        Ok(())
    }

    /// Where the camera should be by now.
    fn guess(&self) -> Pose {
        self.world_from_camera * self.motion
    }

    /// Aligns with the picture from `model_view`, or with a new one where that is of no use for this guess.
    fn fit<P: PicturePair>(
        &self,
        model_view: &View,
        guess: &Pose,
        pictures: &mut P,
    ) -> Result<Option<Fit>, P::Error> {
        let away = guess.inverse() * model_view.world_from_view;
        let near = away.translation.vector.norm() < STALE_M && away.rotation.angle() < STALE_RAD;
        if near && model_view.is_perspective() {
            align(pictures, guess, &self.params, Effort::NORMAL)
        } else {
            self.fit_rendered(guess, Effort::NORMAL, pictures)
        }
    }

    /// Aligns with a picture of the map from `guess` itself.
    fn fit_rendered<P: PicturePair>(
        &self,
        guess: &Pose,
        effort: Effort,
        pictures: &mut P,
    ) -> Result<Option<Fit>, P::Error> {
        pictures.render_model(&View::perspective(self.camera, *guess))?;
        align(pictures, guess, &self.params, effort)
    }

    /// Tries the keyframes that look most like this frame: a wide alignment, then a normal one with the
    /// map as seen from where that led. The best supported pose is taken.
    fn relocalise<P: PicturePair>(
        &mut self,
        frame: FrameTag,
        pictures: &mut P,
    ) -> Result<Tracking, P::Error> {
        let thumbnail = pictures.thumbnail()?;
        let mut best: Option<Fit> = None;
        let mut why = TrackingIssue::NoModel;
        for candidate in self.keyframes.most_similar(&thumbnail, CANDIDATES) {
            let rough = self.fit_rendered(&candidate, Effort::WIDE, pictures)?;
            let Some(rough) = rough else { continue };
            let fit = self.fit_rendered(&rough.world_from_camera, Effort::NORMAL, pictures)?;
            match judge(fit, None, &self.params) {
                Verdict::Good(fit) => {
                    let better = best.is_none_or(|b| fit.support() > b.support());
                    best = if better { Some(fit) } else { best };
                }
                Verdict::Poor(_, issue) | Verdict::Bad(_, issue) => why = issue,
            }
        }
        Ok(match best {
            Some(fit) => self.accept(frame, fit, TrackingState::Relocalising, None),
            None => self.lose(frame, None, why),
        })
    }

    /// Goes on from the pose of `fit`.
    fn accept(
        &mut self,
        frame: FrameTag,
        fit: Fit,
        next: TrackingState,
        issue: Option<TrackingIssue>,
    ) -> Tracking {
        let following = matches!(self.state, TrackingState::Init | TrackingState::Tracking);
        self.motion = if following && next == TrackingState::Tracking {
            self.world_from_camera.inverse() * fit.world_from_camera
        } else {
            Pose::identity()
        };
        self.world_from_camera = fit.world_from_camera;
        if next == TrackingState::Tracking {
            self.trusted = fit.world_from_camera;
        }
        self.enter(frame, next, issue);
        fit.tracking(fit.world_from_camera, next, issue)
    }

    /// Goes back to the last pose that was trusted; reports the numbers of the attempt, if there was one.
    fn lose(&mut self, frame: FrameTag, fit: Option<Fit>, issue: TrackingIssue) -> Tracking {
        self.world_from_camera = self.trusted;
        self.motion = Pose::identity();
        let next = TrackingState::Lost;
        match fit {
            Some(fit) => {
                self.enter(frame, next, Some(issue));
                fit.tracking(self.world_from_camera, next, Some(issue))
            }
            None => self.unmeasured(frame, next, Some(issue)),
        }
    }

    /// A result without alignment.
    fn unmeasured(
        &mut self,
        frame: FrameTag,
        next: TrackingState,
        issue: Option<TrackingIssue>,
    ) -> Tracking {
        self.enter(frame, next, issue);
        Tracking {
            world_from_camera: self.world_from_camera,
            state: next,
            issue,
            inlier_share: 0.0,
            overlap: 0.0,
            rms_m: 0.0,
            condition: 0.0,
            rank: 0,
        }
    }

    /// Changes the state; each change is logged once.
    fn enter(&mut self, frame: FrameTag, next: TrackingState, issue: Option<TrackingIssue>) {
        let before = std::mem::replace(&mut self.state, next);
        self.degraded_frames = match (next, issue) {
            (_, Some(TrackingIssue::Underconstrained { .. })) => 0,
            (TrackingState::Degraded, _) => self.degraded_frames + 1,
            _ => 0,
        };
        if before == next {
            return;
        }
        match issue {
            Some(issue) => {
                log::warn!("frame {}: camera {before:?} -> {next:?}: {issue}", frame.index);
            }
            None => log::info!("frame {}: camera {before:?} -> {next:?}", frame.index),
        }
    }
}

impl Fit {
    /// How much of the frame speaks for this pose.
    fn support(&self) -> f32 {
        self.inlier_share * self.overlap
    }

    fn tracking(
        &self,
        world_from_camera: Pose,
        state: TrackingState,
        issue: Option<TrackingIssue>,
    ) -> Tracking {
        Tracking {
            world_from_camera,
            state,
            issue,
            inlier_share: self.inlier_share,
            overlap: self.overlap,
            rms_m: self.rms_m,
            condition: self.condition,
            rank: self.rank,
        }
    }
}
