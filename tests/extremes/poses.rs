//! Where a camera may be, how it may move, and poses that are none.

use crate::frames::*;
use crate::models::on_floor;
use crate::runs::{Run, run, settings};
use crate::table::{Device, Found, On, Outcome, Table};
use glam::Vec3;
use kinlight::capture::RawFrame;
use kinlight::math::Pose;
use kinlight::scene::analytic::AnalyticScene;
use kinlight::tracking::{TrackingIssue, TrackingState};
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};

fn corner(pose: Pose, index: usize) -> RawFrame {
    seen(&AnalyticScene::corner(), SIZE, pose, index)
}

pub fn cases(table: &mut Table) {
    places(table);
    broken_poses(table);
    motions(table);
    scenes(table);
}

/// Three frames from one place.
fn places(table: &mut Table) {
    let around = |pose: Pose, axis: Vector3<f64>| {
        pose * UnitQuaternion::from_scaled_axis(axis * std::f64::consts::PI)
    };
    let places = [
        ("on the floor, along it", look(Vec3::new(0.8, -0.6, 0.0), Vec3::new(-0.4, 0.2, 0.0))),
        (
            "on the ball's surface, outwards",
            look(Vec3::new(0.52, 0.1, 0.22), Vec3::new(2.0, 0.1, 0.22)),
        ),
        ("inside the box", look(Vec3::new(-0.25, 0.1, 0.15), Vec3::new(1.0, 0.0, 0.15))),
        ("below the floor", look(Vec3::new(0.8, -0.6, -0.5), MIDDLE)),
        ("straight down", look(Vec3::new(0.1, 0.0, 1.5), Vec3::new(0.1, 1e-4, 0.0))),
        ("rotated by pi about its axis", around(at_corner(), Vector3::z())),
        ("rotated by pi about its right", around(at_corner(), Vector3::x())),
        ("looking away", look(EYE, 2.0 * EYE - MIDDLE)),
        ("far enough for depth to end", look(EYE * 5.0, MIDDLE)),
    ];
    for (name, pose) in places {
        table.case("pose", name, On::Both, move |on| {
            let frames = [0, 1, 2].map(|index| corner(pose, index));
            run(on, &settings(&[])?, on_floor(), &frames)?.finish()
        });
    }
    // The volume is 2 m a side.
    let eye = EYE.as_dvec3();
    let centres = [
        ("in the volume's lower corner", eye + 1.0),
        ("in the volume's upper corner", eye - 1.0),
        ("in the middle of the volume", eye),
        ("100 m outside the volume", eye + 100.0),
        ("10 km outside the volume", eye - 10_000.0),
    ];
    for (name, centre) in centres {
        table.case("pose", name, On::Both, move |on| {
            let settings = settings(&[("volume.centre", &format!("{:?}", centre.to_array()))])?;
            let frames = [0, 1, 2].map(|index| corner(at_corner(), index));
            let mut run = run(on, &settings, on_floor(), &frames)?;
            run.broken.rule(run.outcomes[2].composed, || "it is not composed".to_owned());
            run.finish()
        });
    }
    for metres in [1e4, 1e5] {
        for poses in ["recorded", "track"] {
            let name = format!("{metres} m from the origin, poses {poses}");
            table.case("pose", name, On::Both, move |on| {
                let settings = settings(&[("tracking.mode", poses)])?;
                let away = Translation3::new(metres, -metres, metres / 20.0);
                let frames = [0, 1, 2].map(|index| RawFrame {
                    world_from_camera: Some(away * at_corner()),
                    ..corner(at_corner(), index)
                });
                let mut scene = on_floor();
                scene.translate(Vec3::new(metres as f32, -metres as f32, metres as f32 / 20.0));
                let mut run = run(on, &settings, scene, &frames)?;
                let error =
                    (away * at_corner()).inverse() * run.outcomes[2].tracking.world_from_camera;
                // f64 at 1e5 m: 1.5e-11 m a rounding; tracked as at home, see the tracking tests
                let bound = if poses == "track" { 5e-3 } else { 1e-9 };
                let moved = error.translation.vector.norm();
                run.broken.rule(moved < bound, || format!("the camera is off by {moved} m"));
                run.broken.rule(run.outcomes[2].composed, || "it is not composed".to_owned());
                run.finish()
            });
        }
    }
}

/// Recorded poses that no camera has.
fn broken_poses(table: &mut Table) {
    let nan = f64::NAN;
    let with_rotation = |x: f64, y: f64, z: f64, w: f64| {
        let q = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        Pose::from_parts(at_corner().translation, q)
    };
    let moved = |x: f64| Translation3::new(x, 0.0, 0.0) * at_corner();
    let poses = [
        ("a translation of NaN", moved(nan)),
        ("an infinite translation", moved(f64::INFINITY)),
        ("a translation of 1e7 m", moved(1e7)),
        ("a translation of 1e30 m", moved(1e30)),
        ("a translation of 1e300 m", moved(-1e300)),
        ("a quaternion of zeros", with_rotation(0.0, 0.0, 0.0, 0.0)),
        ("a quaternion of NaN", with_rotation(nan, 0.0, 0.0, 1.0)),
        ("a quaternion of length 2", with_rotation(0.0, 0.0, 0.0, 2.0)),
        ("a quaternion of length 1e200", with_rotation(1e200, 0.0, 0.0, 1e200)),
    ];
    for (name, pose) in poses {
        let bad =
            move |index| RawFrame { world_from_camera: Some(pose), ..corner(at_corner(), index) };
        table.case("pose", format!("{name} between good ones"), On::Both, move |on| {
            let good = |index| corner(at_corner(), index);
            let frames = [good(0), good(1), bad(2), good(3)];
            let mut run = run(on, &settings(&[])?, on_floor(), &frames)?;
            let tracking = run.outcomes[2].tracking.clone();
            let unknown = tracking.issue == Some(TrackingIssue::NoRecordedPose);
            run.broken.rule(unknown && tracking.state == TrackingState::Lost, || {
                format!("{:?} {:?}", tracking.state, tracking.issue)
            });
            run.broken.rule(run.outcomes[3].composed, || "the next is not composed".to_owned());
            run.finish()
        });
        table.case("pose", format!("{name} first"), On::Both, move |on| {
            let frames = [bad(0), corner(at_corner(), 1), corner(at_corner(), 2)];
            let mut composed = Vec::new();
            for mode in ["recorded", "track"] {
                let settings = settings(&[("tracking.mode", mode)])?;
                let run = run(on, &settings, on_floor(), &frames)?;
                composed.push(run.outcomes[2].composed);
                let found = run.finish()?;
                if found.error > 0.0 {
                    return Ok(found);
                }
            }
            // far from the first there is a limit, but the first is where it is
            let far = name == "a translation of 1e7 m";
            let expected = if far { composed.clone() } else { vec![true; 2] };
            let broken = usize::from(composed != expected);
            Ok(Found::broken(broken, format!("composed: {composed:?}")))
        });
    }
    table.case("pose", "none recorded at all", On::Both, |on| {
        let frames = [0, 1].map(|i| RawFrame { world_from_camera: None, ..corner(at_corner(), i) });
        let mut run = run(on, &settings(&[])?, on_floor(), &frames)?;
        run.broken.rule(!run.outcomes[1].composed, || "it is composed".to_owned());
        run.finish()
    });
}

/// Frames of a camera that takes the same step from each to the next.
fn stepped(on: Device<'_>, mode: &str, step: Pose, count: usize) -> Result<Run, String> {
    let settings = settings(&[("tracking.mode", mode), ("tracking.on_lost", "hold")])?;
    let mut pose = at_corner();
    let mut frames = vec![corner(pose, 0)];
    for index in 1..count {
        pose *= step;
        frames.push(corner(pose, index));
    }
    run(on, &settings, on_floor(), &frames)
}

/// Whether the run must end in tracking.
fn tracked(run: &mut Run, wanted: bool) {
    let state = run.outcomes.last().map(|o| o.tracking.state);
    let found = state == Some(TrackingState::Tracking);
    run.broken.rule(found == wanted, || format!("ends in {state:?}"));
}

/// Steps from frame to frame.
fn motions(table: &mut Table) {
    for metres in [0.0, 1e-12, 1e-9, 1e-6, 1e-3] {
        table.case(
            "pose",
            format!("steps of {metres:e} m, tracked"),
            On::Both,
            move |on| -> Outcome {
                let mut run = stepped(on, "track", Pose::translation(metres, 0.0, 0.0), 4)?;
                tracked(&mut run, true);
                run.finish()
            },
        );
    }
    for (name, step) in [
        ("a step of 1 m aside", Pose::translation(1.0, 0.0, 0.0)),
        ("a step of 1 km", Pose::translation(0.0, 0.0, -1000.0)),
        ("a turn by 60 degrees", Pose::rotation(Vector3::y() * 1.05)),
        ("a turn by pi", Pose::rotation(Vector3::y() * std::f64::consts::PI)),
    ] {
        table.case("pose", format!("{name}, tracked"), On::Both, move |on| -> Outcome {
            let mut run = stepped(on, "track", step, 2)?;
            tracked(&mut run, false);
            run.finish()
        });
        table.case("pose", format!("{name}, recorded"), On::Both, move |on| -> Outcome {
            let mut run = stepped(on, "recorded", step, 2)?;
            tracked(&mut run, true);
            run.finish()
        });
    }
    table.case("pose", "there and back by 100 km, recorded", On::Both, |on| -> Outcome {
        let far = Translation3::new(1e5, 0.0, 0.0) * at_corner();
        let away = RawFrame { world_from_camera: Some(far), ..corner(at_corner(), 1) };
        let frames = [corner(at_corner(), 0), away, corner(at_corner(), 2)];
        let mut run = run(on, &settings(&[])?, on_floor(), &frames)?;
        tracked(&mut run, true);
        run.finish()
    });
}

/// A camera at rest before what leaves motions open: the pose stays, and that motions are open is said.
fn scenes(table: &mut Table) {
    let open = TrackingState::Degraded;
    let scenes = [
        ("a wall", wall(), open),
        ("two planes", two_planes(), open),
        ("a ball", ball(), open),
        ("a corridor", corridor(), open),
        ("the corner", AnalyticScene::corner(), TrackingState::Tracking),
    ];
    for (name, scene, state) in scenes {
        table.case("tracking", format!("{name}, at rest"), On::Both, |on| {
            let (eye, at) = match name {
                "a corridor" => (Vec3::new(0.0, 0.1, 1.2), Vec3::new(1.0, 0.1, 1.1)),
                _ => (EYE, MIDDLE),
            };
            let settings = settings(&[("tracking.mode", "track"), ("volume.side_m", "3.0")])?;
            let frame = |index| seen(&scene, SIZE, look(eye, at), index);
            let frames = [frame(0), frame(1), frame(2)];
            let mut run = run(on, &settings, on_floor(), &frames)?;
            let found = run.outcomes[2].tracking.clone();
            let said = match found.issue {
                Some(TrackingIssue::Underconstrained { rank }) => rank == found.rank && rank < 6,
                _ => found.rank == 6,
            };
            run.broken.rule(said && found.state == state, || {
                format!("{:?} {:?} rank {}", found.state, found.issue, found.rank)
            });
            let moved = look(eye, at).inverse() * found.world_from_camera;
            let metres = moved.translation.vector.norm();
            // a fifth of a voxel
            Ok(run.finish()?.worse(Found::new(metres, 0.01, "metres that the camera moved")))
        });
    }
}
