//! Both trackers on the same frames: they go through the same states to the same poses.

use super::test_scene::{camera, corner_frame, corner_pose, frame, look_at, motion};
use super::*;
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::gpu::stages::test_support::{gpu, upload_frame};
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer};
use crate::image::{Image, Size};
use crate::math::{Pose, View};
use crate::parity::pose_difference;
use crate::parity::tolerances::{TRACKING_POSITION, TRACKING_ROTATION};
use crate::scene::analytic::{AnalyticScene, Shape};
use crate::tracking::{
    DEPTH_RANGE_M, FrameTag, Tracker, Tracking, TrackingIssue, TrackingParams, TrackingState,
};

/// The two trackers, and a map that is exact.
struct Both<'g> {
    gpu: &'g Gpu,
    cpu: Tracker,
    device: GpuTracker,
    map: AnalyticScene,
}

impl<'g> Both<'g> {
    fn new(gpu: &'g Gpu, params: &TrackingParams, camera: Pinhole) -> Self {
        Self {
            gpu,
            cpu: Tracker::new(params, camera),
            device: GpuTracker::new(gpu, params, camera).unwrap(),
            map: AnalyticScene::corner(),
        }
    }

    fn started(mut self, pose: Pose) -> Self {
        self.cpu.reset(pose);
        self.device.reset(pose);
        self
    }

    /// What both say of this frame.
    fn track(&mut self, frame: &RgbdFrame, model: Option<&GBuffer>) -> (Tracking, Tracking) {
        let Self { gpu, cpu, device, map } = self;
        let mut draw = |view: &View, out: &mut GBuffer| *out = map.render(view);
        let expected = cpu.track(frame, model, &mut draw);
        let on_device = model.map(|model| {
            let mut on_device = GpuGBuffer::empty(gpu, model.view).unwrap();
            on_device.upload(gpu, model);
            on_device
        });
        let mut draw = |commands: &mut Commands<'_>,
                        view: &View,
                        out: &mut GpuGBuffer|
         -> Result<(), GpuError> {
            out.upload(commands.gpu(), &map.render(view));
            Ok(())
        };
        let tag = FrameTag { index: frame.index, recorded_pose: frame.world_from_camera };
        let pictures = &upload_frame(gpu, frame);
        let usable = frame.depth_m.as_slice().iter().filter(|d| DEPTH_RANGE_M.contains(d)).count();
        let depth_share = usable as f32 / frame.depth_m.size().pixels() as f32;
        let newest = TrackedFrame { tag, pictures, depth_share };
        let mut commands = gpu.commands();
        let got = device.track(&mut commands, newest, on_device.as_ref(), &mut draw).unwrap();
        (expected, got)
    }
}

/// Poses within what the table says; the same judgement.
fn assert_equal((cpu, gpu): &(Tracking, Tracking)) {
    let (mm, degrees) = pose_difference(&cpu.world_from_camera, &gpu.world_from_camera);
    let [most_mm, most_degrees] =
        [&TRACKING_POSITION, &TRACKING_ROTATION].map(|tolerance| tolerance.software.largest);
    assert!(mm < most_mm && degrees < most_degrees, "{mm} mm, {degrees} deg: {cpu:?} {gpu:?}");
    assert_eq!((cpu.state, cpu.rank), (gpu.state, gpu.rank), "{cpu:?} {gpu:?}");
    let kind = |t: &Tracking| t.issue.map(|issue| std::mem::discriminant(&issue));
    assert_eq!(kind(cpu), kind(gpu), "{cpu:?} {gpu:?}");
    // single pixels at a gate, where poses differ
    assert!((cpu.inlier_share - gpu.inlier_share).abs() < 5e-3, "{cpu:?} {gpu:?}");
    assert!((cpu.overlap - gpu.overlap).abs() < 5e-3, "{cpu:?} {gpu:?}");
    assert!((cpu.rms_m - gpu.rms_m).abs() < 2e-5, "{cpu:?} {gpu:?}");
    if cpu.rank == 6 {
        assert!((cpu.condition / gpu.condition - 1.0).abs() < 0.02, "{cpu:?} {gpu:?}");
    }
}

#[test]
fn registers_to_the_pose_of_the_cpu() {
    let Some(gpu) = gpu() else { return };
    for (width, height) in [(160, 120), (67, 43)] {
        let camera = camera(width, height);
        let model = AnalyticScene::corner().render(&View::perspective(camera, corner_pose()));
        for (metres, degrees) in [
            ([0.0; 3], [0.0; 3]),
            ([0.005, 0.0, 0.0], [0.0, 0.3, 0.0]),
            ([0.02, -0.015, 0.025], [1.0, -1.5, 2.0]),
            ([-0.03, 0.02, 0.01], [-2.0, 1.0, -0.5]),
        ] {
            let truth = corner_pose() * motion(metres, degrees);
            let newest = frame(&AnalyticScene::corner(), camera, truth, 1);
            let mut both =
                Both::new(gpu, &TrackingParams::default(), camera).started(corner_pose());
            let found = both.track(&newest, Some(&model));
            assert_equal(&found);
            assert_eq!(found.1.state, TrackingState::Tracking, "{found:?}");
            let error = (truth.inverse() * found.1.world_from_camera).translation.vector.norm();
            // the filter rounds box and ball; a pixel is 10 mm wide in the small picture
            assert!(error < if width == 160 { 2e-3 } else { 5e-3 }, "{error} m");
        }
    }
}

#[test]
fn a_wall_leaves_motions_open() {
    let Some(gpu) = gpu() else { return };
    let camera = camera(67, 43);
    let wall = AnalyticScene::new([Shape::Plane { normal: -glam::Vec3::Z, offset: -1.5 }]);
    let model = wall.render(&View::perspective(camera, Pose::identity()));
    let newest = frame(&wall, camera, motion([0.0, 0.0, 0.01], [0.5, 0.3, 0.0]), 4);
    let found = Both::new(gpu, &TrackingParams::default(), camera)
        .started(Pose::identity())
        .track(&newest, Some(&model));
    assert_equal(&found);
    assert!(matches!(found.1.issue, Some(TrackingIssue::Underconstrained { .. })), "{found:?}");
}

#[test]
fn what_cannot_be_tracked_is_lost() {
    let Some(gpu) = gpu() else { return };
    let camera = camera(67, 43);
    let view = View::perspective(camera, corner_pose());
    let model = AnalyticScene::corner().render(&view);
    let good = corner_frame(camera, 1);
    let mut blind = good.clone();
    blind.depth_m.fill(0.0);
    let mut one_pixel = blind.clone();
    one_pixel.depth_m[(30, 20)] = 1.0;
    let mut no_numbers = good.clone();
    no_numbers.depth_m.fill(f32::NAN);
    let size = Size::new(3, 2);
    let small = RgbdFrame {
        color: Image::new(size, [0.2; 3]),
        intensity: Image::new(size, 0.0),
        depth_m: Image::new(size, 1.0),
        ..RgbdFrame::default()
    };
    let nothing = GBuffer::empty(view);
    let no_pixels = Pinhole { width: 0, height: 0, ..camera };
    let empty = GBuffer::empty(View::perspective(no_pixels, corner_pose()));
    for (frame, model) in [
        (&blind, &model),
        (&one_pixel, &model),
        (&no_numbers, &model),
        (&small, &model),
        (&good, &nothing),
        (&good, &empty),
    ] {
        let found = Both::new(gpu, &TrackingParams::default(), camera)
            .started(corner_pose())
            .track(frame, Some(model));
        assert_equal(&found);
        assert_eq!(found.0.issue, found.1.issue);
        assert_eq!(found.1.state, TrackingState::Lost);
        assert_eq!(found.1.world_from_camera, corner_pose());
    }
}

#[test]
fn the_way_back_is_found_by_both() {
    use TrackingState::*;
    let Some(gpu) = gpu() else { return };
    let camera = camera(80, 60);
    let orbit = |i: usize| {
        let a = -0.9 + 0.023 * i as f64;
        look_at([1.5 * a.cos(), 1.5 * a.sin(), 0.9])
    };
    let mut poses: Vec<Pose> = (0..30).map(orbit).collect();
    poses.extend([orbit(2) * motion([0.02, 0.01, -0.03], [2.0, -1.0, 1.0]); 8]);
    let params = TrackingParams { max_degraded_frames: 1, ..Default::default() };
    let mut both = Both::new(gpu, &params, camera);
    let (mut model, mut states) = (None, Vec::new());
    for (index, pose) in poses.iter().enumerate() {
        let mut newest = frame(&both.map, camera, *pose, index as u32);
        (newest.index, newest.world_from_camera) = (index, Some(*pose));
        let found = both.track(&newest, model.as_ref());
        assert_equal(&found);
        states.push(found.1.state);
        model = Some(both.map.render(&View::perspective(camera, found.0.world_from_camera)));
    }
    assert_eq!(states[0], Init);
    assert!(states[1..30].iter().all(|&s| s == Tracking), "{states:?}");
    let lost = states.iter().position(|&s| s == Lost).unwrap();
    assert_eq!(states[lost..lost + 3], [Lost, Relocalising, Tracking], "{states:?}");
}
