//! From frame to pose: the states of the camera and what leads from one to the other.

use super::judgement::{Verdict, judge};
use super::keyframes::{Keyframes, Thumbnail};
use super::normal_equations::Reduction;
use super::pyramid::Pyramid;
use super::registration::{Effort, Fit, align};
use super::{OnLost, PoseMode, Tracking, TrackingIssue, TrackingParams, TrackingState};
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::math::{Pinhole, Pose, View};

/// Keyframes that are tried for one lost frame.
const CANDIDATES: usize = 3;

/// Less depth than this is a covered lens or a blind sensor.
const MIN_VALID_SHARE: f32 = 0.02;

/// A model picture taken this far from the guess is replaced by one from there.
const STALE_M: f64 = 0.25;
const STALE_RAD: f64 = 0.25;

/// Follows the camera. One frame at a time; what a frame did is in its [`Tracking`].
///
/// ```text
/// Init ──> Tracking <──> Degraded         every frame with a model is aligned with it
///              │  ^          │
///              v  └──────┐   v
///             Lost <──> Relocalising      a pose is believed when it fits two frames in a row
/// ```
///
/// While lost, the pose is the last one that was well tracked. [`OnLost::Stop`] and
/// [`OnLost::Reset`] are for the caller to carry out when it sees [`TrackingState::Lost`] (the latter
/// by emptying the map and calling [`Tracker::reset`]); the tracker itself then holds.
#[derive(Debug)]
pub struct Tracker {
    params: TrackingParams,
    camera: Pinhole,
    pyramid: Pyramid,
    reduction: Reduction,
    keyframes: Keyframes,
    /// Ray-cast where the caller's picture does not serve.
    rendered: Option<GBuffer>,
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

impl Tracker {
    /// `camera` is that of all frames.
    pub fn new(params: &TrackingParams, camera: Pinhole) -> Self {
        Self {
            params: params.clone(),
            camera,
            pyramid: Pyramid::new(params, camera),
            reduction: Reduction::default(),
            keyframes: Keyframes::default(),
            rendered: None,
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
    ///
    /// `model` is the map's picture at the pose of the frame before, `None` before anything was fused.
    /// `render` draws the map from another view; it is called when the camera is lost, or when
    /// `model` shows another place than the guess.
    pub fn track(
        &mut self,
        frame: &RgbdFrame,
        model: Option<&GBuffer>,
        render: &mut dyn FnMut(&View, &mut GBuffer),
    ) -> Tracking {
        match self.params.mode {
            PoseMode::Recorded => self.recorded(frame),
            PoseMode::Static => {
                let next = self.next_of_fixed();
                self.place(frame);
                self.unmeasured(frame, next, None)
            }
            PoseMode::Track => self.registered(frame, model, render),
        }
    }

    fn recorded(&mut self, frame: &RgbdFrame) -> Tracking {
        let Some(pose) = frame.world_from_camera else {
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
    fn place(&mut self, frame: &RgbdFrame) {
        if !self.placed {
            self.world_from_camera = frame.world_from_camera.unwrap_or_else(Pose::identity);
            self.trusted = self.world_from_camera;
            self.placed = true;
        }
    }

    fn registered(
        &mut self,
        frame: &RgbdFrame,
        model: Option<&GBuffer>,
        render: &mut dyn FnMut(&View, &mut GBuffer),
    ) -> Tracking {
        if frame.depth_m.size() != self.camera.size() {
            let (width, height) = (frame.depth_m.width(), frame.depth_m.height());
            return self.lose(frame, None, TrackingIssue::WrongSize { width, height });
        }
        let valid_share = self.pyramid.update(&frame.depth_m);
        if valid_share < MIN_VALID_SHARE {
            return self.lose(frame, None, TrackingIssue::NoDepth { valid_share });
        }
        let Some(model) = model else {
            self.place(frame);
            self.motion = Pose::identity();
            if self.params.on_lost == OnLost::Relocalise {
                self.keyframes.consider(frame, &self.world_from_camera);
            }
            return self.unmeasured(frame, TrackingState::Init, None);
        };
        self.place(frame);
        let guess = self.guess();
        let fit = self.fit(model, &guess, render);
        let verdict = judge(fit, Some(&self.world_from_camera), &self.params);
        match (self.state, verdict) {
            (TrackingState::Lost, Verdict::Good(fit)) => {
                self.accept(frame, fit, TrackingState::Relocalising, None)
            }
            (TrackingState::Lost, _) if self.params.on_lost == OnLost::Relocalise => {
                self.relocalise(frame, render)
            }
            (TrackingState::Lost | TrackingState::Relocalising, Verdict::Poor(fit, issue)) => {
                self.lose(frame, Some(fit), issue)
            }
            (_, Verdict::Good(fit)) => {
                let tracking = self.accept(frame, fit, TrackingState::Tracking, None);
                if self.params.on_lost == OnLost::Relocalise {
                    self.keyframes.consider(frame, &fit.world_from_camera);
                }
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
        }
    }

    /// Where the camera should be by now.
    fn guess(&self) -> Pose {
        self.world_from_camera * self.motion
    }

    /// Aligns with `model`, or with a new picture where `model` is of no use for this guess.
    fn fit(
        &mut self,
        model: &GBuffer,
        guess: &Pose,
        render: &mut dyn FnMut(&View, &mut GBuffer),
    ) -> Option<Fit> {
        let away = guess.inverse() * model.view.world_from_view;
        let near = away.translation.vector.norm() < STALE_M && away.rotation.angle() < STALE_RAD;
        if near && model.view.is_perspective() {
            align(&self.pyramid, model, guess, &self.params, Effort::NORMAL, &mut self.reduction)
        } else {
            self.fit_rendered(guess, Effort::NORMAL, render)
        }
    }

    /// Aligns with a picture of the map from `guess` itself.
    fn fit_rendered(
        &mut self,
        guess: &Pose,
        effort: Effort,
        render: &mut dyn FnMut(&View, &mut GBuffer),
    ) -> Option<Fit> {
        let view = View::perspective(self.camera, *guess);
        let model = self.rendered.get_or_insert_with(|| GBuffer::empty(view));
        model.set_view(view);
        render(&view, model);
        align(&self.pyramid, model, guess, &self.params, effort, &mut self.reduction)
    }

    /// Tries the keyframes that look most like this frame: a wide alignment, then a normal one with the
    /// map as seen from where that led. The best supported pose is taken.
    fn relocalise(
        &mut self,
        frame: &RgbdFrame,
        render: &mut dyn FnMut(&View, &mut GBuffer),
    ) -> Tracking {
        let thumbnail = Thumbnail::new(frame);
        let mut best: Option<Fit> = None;
        let mut why = TrackingIssue::NoModel;
        for candidate in self.keyframes.most_similar(&thumbnail, CANDIDATES) {
            let Some(rough) = self.fit_rendered(&candidate, Effort::WIDE, render) else { continue };
            let fit = self.fit_rendered(&rough.world_from_camera, Effort::NORMAL, render);
            match judge(fit, None, &self.params) {
                Verdict::Good(fit) => {
                    let better = best.is_none_or(|b| fit.support() > b.support());
                    best = if better { Some(fit) } else { best };
                }
                Verdict::Poor(_, issue) | Verdict::Bad(_, issue) => why = issue,
            }
        }
        match best {
            Some(fit) => self.accept(frame, fit, TrackingState::Relocalising, None),
            None => self.lose(frame, None, why),
        }
    }

    /// Goes on from the pose of `fit`.
    fn accept(
        &mut self,
        frame: &RgbdFrame,
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
    fn lose(&mut self, frame: &RgbdFrame, fit: Option<Fit>, issue: TrackingIssue) -> Tracking {
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
        frame: &RgbdFrame,
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
    fn enter(&mut self, frame: &RgbdFrame, next: TrackingState, issue: Option<TrackingIssue>) {
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
