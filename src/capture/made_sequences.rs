//! Small recordings in each layout, written by the tests from exact scenes and read back.

use super::calibration::{SEVEN_SCENES, built_in};
use super::plausibility::residual;
use super::*;
use crate::image::Size;
use crate::math::View;
use crate::scene::analytic::{AnalyticScene, Shape};
use glam::{Quat, Vec3};
use image::{ImageBuffer, Luma, Rgb};
use nalgebra::Vector3;

pub(super) const SIZE: Size = Size::new(160, 120);

/// Writes files into a folder that goes when the test ends.
pub(super) struct Made {
    pub folder: tempfile::TempDir,
}

impl Made {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, content).unwrap();
    }

    pub fn color(&self, name: &str, size: Size) {
        self.write(name, "");
        let picture = ImageBuffer::from_fn(size.width as u32, size.height as u32, |x, y| {
            Rgb([x as u8, y as u8, 77])
        });
        picture.save(self.path().join(name)).unwrap();
    }

    pub fn depth(&self, name: &str, depth_m: &Image<f32>, factor: f32) {
        self.write(name, "");
        let (w, h) = (depth_m.width() as u32, depth_m.height() as u32);
        let stored = ImageBuffer::from_fn(w, h, |x, y| {
            Luma([(depth_m[(x as usize, y as usize)] * factor).round() as u16])
        });
        stored.save(self.path().join(name)).unwrap();
    }

    pub fn flat_depth(&self, name: &str) {
        self.depth(name, &Image::new(SIZE, 1.25), 5000.0);
    }

    pub fn open(&self) -> Result<Sequence, CaptureError> {
        open_sequence(self.path(), &CaptureOptions::default())
    }
}

pub(super) const INTRINSICS: &str =
    "# fx fy cx cy width height depth_scale\n140 141 79.5 59.5 160 120 5000\n";

fn camera() -> Pinhole {
    Pinhole { width: 160, height: 120, fx: 140.0, fy: 141.0, cx: 79.5, cy: 59.5 }
}

/// Camera poses around the corner scene, looking at it from 1.5 m away.
fn orbit(i: usize) -> Pose {
    let angle = 0.9 + 0.04 * i as f64;
    let eye = nalgebra::Point3::new(1.3 * angle.cos(), -1.3 * angle.sin(), 0.7 + 0.02 * i as f64);
    let forward = (nalgebra::Point3::new(-0.1, 0.2, 0.2) - eye).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rotation = nalgebra::Matrix3::from_columns(&[right, down, forward]);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(rotation);
    Pose::from_parts(eye.coords.into(), nalgebra::UnitQuaternion::from_rotation_matrix(&rotation))
}

fn tum_line(t: f64, pose: &Pose) -> String {
    let (p, q) = (pose.translation.vector, pose.rotation.coords);
    format!("{t:.6} {} {} {} {} {} {} {}\n", p.x, p.y, p.z, q.x, q.y, q.z, q.w)
}

fn matrix(pose: &Pose) -> String {
    let m = pose.to_homogeneous();
    (0..4).map(|r| format!("{} {} {} {}\n", m[(r, 0)], m[(r, 1)], m[(r, 2)], m[(r, 3)])).collect()
}

/// A TUM recording of the corner: depth exact to 0.1 mm at `factor` 5000.
fn tum_corner(frames: usize, factor: f32, pose_in_file: impl Fn(&Pose) -> Pose) -> Made {
    let made = Made::new();
    let (mut rgb, mut depth, mut truth) = (String::new(), String::new(), String::new());
    for i in 0..frames {
        let t = i as f64 / 30.0;
        let seen = AnalyticScene::corner().render(&View::perspective(camera(), orbit(i))).depth_m;
        made.color(&format!("rgb/{i}.png"), SIZE);
        made.depth(&format!("depth/{i}.png"), &seen, factor);
        rgb += &format!("{t:.6} rgb/{i}.png\n");
        depth += &format!("{:.6} depth/{i}.png\n", t + 0.003);
        truth += &tum_line(t, &pose_in_file(&orbit(i)));
    }
    made.write("rgb.txt", rgb);
    made.write("depth.txt", depth);
    made.write("groundtruth.txt", truth);
    made.write("intrinsics.txt", INTRINSICS);
    made
}

#[test]
fn tum_lists_orphans_and_interpolated_poses() {
    let made = Made::new();
    let names = ["a", "b", "c", "d"];
    for n in names {
        made.color(&format!("rgb/{n}.png"), SIZE);
        made.flat_depth(&format!("depth/{n}.png"));
        made.flat_depth(&format!("other/{n}.png"));
    }
    made.write("rgb.txt", "# color\r\n\r\n10.00 rgb/a.png\r\n10.03 rgb/b.png\r\n10.06 rgb/c.png\r\n10.50 rgb/d.png\r\n");
    made.write(
        "depth.txt",
        "10.012 depth/a.png\n10.07 depth/c.png\n10.3 depth/b.png\n10.51 depth/d.png\n",
    );
    made.write("other.txt", "10.06 other/a.png\n");
    let pose = |x: f64| Pose::translation(x, 0.0, 0.0);
    let truth = [9.98, 10.02, 10.08, 10.4, 10.6].map(|t| tum_line(t, &pose(t)));
    made.write("groundtruth.txt", truth.concat());
    made.write("intrinsics.txt", INTRINSICS);

    let mut sequence = made.open().unwrap();
    let info = sequence.info().clone();
    assert_eq!((info.layout, info.pairs, info.depth_factor), (Layout::Tum, 3, 5000.0));
    assert_eq!(info.color_orphans, ["rgb/b.png"]);
    assert_eq!(info.depth_orphans, ["depth/b.png"]);
    // Around 10.5 the ground truth has a gap of 0.2 s: no pose.
    assert_eq!(info.frames_with_pose, 2);
    let times = info.time_differences.unwrap();
    assert!((times.max_ms - 12.0).abs() < 1e-6 && (times.min_ms - 10.0).abs() < 1e-6);
    let mut seen = Vec::new();
    while let Some(frame) = sequence.next_frame().unwrap() {
        assert!(frame.depth_m.as_slice().iter().all(|&d| d == 1.25));
        assert_eq!(frame.color[(5, 9)], [5, 9, 77]);
        if let Some(pose) = frame.world_from_camera {
            assert!((pose.translation.x - frame.timestamp_s).abs() < 1e-9);
        }
        seen.push((frame.index, frame.timestamp_s));
    }
    assert_eq!(seen, [(0, 10.0), (1, 10.06), (2, 10.5)]);

    let options = CaptureOptions { depth_list: Some("other.txt".into()), ..Default::default() };
    assert_eq!(open_sequence(made.path(), &options).unwrap().info().pairs, 1);
    let range = CaptureOptions { first_frame: 1, end_frame: Some(2), ..Default::default() };
    let mut part = open_sequence(made.path(), &range).unwrap();
    assert_eq!((part.len(), part.next_frame().unwrap().unwrap().index), (Some(1), 1));
    assert!(part.next_frame().unwrap().is_none());
}

/// ICL-NUIM as its authors render it: x right, y up, z forward, fy negative; written without any of our
/// own camera code.
fn icl_nuim() -> Made {
    let made = Made::new();
    let room = AnalyticScene::new([
        Shape::Plane { normal: -Vec3::Z, offset: -3.0 },
        Shape::Plane { normal: Vec3::Y, offset: -0.8 },
        Shape::Sphere { centre: Vec3::new(0.3, 0.2, 2.2), radius: 0.4 },
        Shape::Box { min: Vec3::new(-0.9, -0.8, 1.8), max: Vec3::new(-0.3, -0.1, 2.4) },
    ]);
    let (fx, fy, cx, cy) =
        (481.2 / 4.0, -480.0 / 4.0, (319.5 + 0.5) / 4.0 - 0.5, (239.5 + 0.5) / 4.0 - 0.5);
    let (mut list, mut truth) = ("0 depth/0.png 0 rgb/0.png\n".to_owned(), String::new());
    for i in 0..=30 {
        let s = i as f32 / 30.0;
        let turn = Quat::from_rotation_x(0.15 * s)
            * Quat::from_rotation_y(-0.1 * s)
            * Quat::from_rotation_z(0.2 * s);
        let eye = Vec3::new(0.2 * s, 0.3 * s, -0.1 * s);
        let mut depth = Image::new(SIZE, 0.0);
        for y in 0..SIZE.height {
            for x in 0..SIZE.width {
                let ray = Vec3::new((x as f32 - cx) / fx, (y as f32 - cy) / fy, 1.0);
                depth[(x, y)] = room.hit(eye, turn * ray).map_or(0.0, |hit| hit.0);
            }
        }
        made.color(&format!("rgb/{i}.png"), SIZE);
        made.depth(&format!("depth/{i}.png"), &depth, 5000.0);
        if i > 0 {
            list += &format!("{i} depth/{i}.png {i} rgb/{i}.png\n");
            truth += &format!(
                "{i} {} {} {} {} {} {} {}\n",
                eye.x, eye.y, eye.z, turn.x, turn.y, turn.z, turn.w
            );
        }
    }
    made.write("associations.txt", list);
    made.write("livingRoom0.gt.freiburg", truth);
    made
}

#[test]
fn icl_nuim_becomes_right_handed() {
    let made = icl_nuim();
    let mut sequence = made.open().unwrap();
    let info = sequence.info().clone();
    assert_eq!((info.layout, info.pairs, info.frames_with_pose), (Layout::IclNuim, 31, 30));
    assert_eq!((info.camera.fx, info.camera.fy), (120.3, 120.0));
    let (first, last) = (sequence.frame(1).unwrap(), sequence.frame(30).unwrap());
    assert!((last.timestamp_s - 1.0).abs() < 1e-12);
    let (a, b) = (first.world_from_camera.unwrap(), last.world_from_camera.unwrap());
    // The camera rose, and our y points down.
    assert!((b.translation.y + 0.3).abs() < 1e-6 && (b.translation.x - 0.2).abs() < 1e-6);
    let moved = |to_from: Pose| {
        residual(&info.camera, &first.depth_m, &last.depth_m, &to_from, 1.0).unwrap()
    };
    // Nearest-pixel comparison on slants of up to 1.5 % of 3 m a pixel; a quarter pixel is the median
    let right = moved(b.inverse() * a).median_m;
    assert!(right < 4e-3, "{right}");
    let flip = |p: Pose| {
        let (t, q) = (p.translation, p.rotation.coords);
        let q = nalgebra::Quaternion::new(q.w, -q.x, q.y, -q.z);
        Pose::from_parts(
            Vector3::new(t.x, -t.y, t.z).into(),
            nalgebra::UnitQuaternion::new_normalize(q),
        )
    };
    let unconverted = moved(flip(b).inverse() * flip(a)).median_m;
    assert!(unconverted > 10.0 * right, "{unconverted} {right}");
    let report = inspect(made.path(), &CaptureOptions::default()).unwrap();
    assert_eq!(report.poses.unwrap().better, None);
}

#[test]
fn wrong_readings_are_named() {
    let found = |made: &Made, options: &CaptureOptions| {
        let report = inspect(made.path(), options).unwrap();
        assert!(report.to_string().contains("layout"));
        assert!(serde_json::to_string(&report).unwrap().contains("\"tum\""));
        report.findings.join("; ")
    };
    let default = CaptureOptions::default();
    let good = tum_corner(21, 5000.0, |p| *p);
    assert_eq!(found(&good, &default), "");
    let factor = CaptureOptions { depth_factor: Some(1000.0), ..Default::default() };
    let wrong = found(&good, &factor);
    assert!(
        wrong.contains("values fit factor 5000")
            && wrong.contains("depth factor 5000, 1000 is used"),
        "{wrong}"
    );
    let inverted = found(&tum_corner(21, 5000.0, Pose::inverse), &default);
    assert!(inverted.contains("inverted"), "{inverted}");
    let gl = found(
        &tum_corner(21, 5000.0, |p| p * Pose::rotation(Vector3::x() * std::f64::consts::PI)),
        &default,
    );
    assert!(gl.contains("OpenGL"), "{gl}");
}

#[test]
fn seven_scenes_is_registered_with_the_pose_of_the_colour_camera() {
    let made = Made::new();
    let kinect = built_in(SEVEN_SCENES).unwrap();
    let depth_camera = kinect.depth.unwrap().scaled_to(SIZE).unwrap().pinhole();
    for i in 0..3 {
        let mut seen =
            AnalyticScene::corner().render(&View::perspective(depth_camera, orbit(i))).depth_m;
        seen[(3, 3)] = 65.535;
        made.color(&format!("frame-{i:06}.color.jpg"), SIZE);
        made.depth(&format!("frame-{i:06}.depth.png"), &seen, 1000.0);
        made.write(&format!("frame-{i:06}.pose.txt"), matrix(&orbit(i)));
    }
    made.flat_depth("frame-000007.depth.png");
    let mut sequence = made.open().unwrap();
    let info = sequence.info().clone();
    assert_eq!((info.layout, info.pairs, info.registered), (Layout::SevenScenes, 3, false));
    assert_eq!(info.depth_orphans, ["frame-000007.depth.png"]);
    let frame = sequence.frame(2).unwrap();
    let close_share = |pose: Pose| {
        let truth = AnalyticScene::corner().render(&View::perspective(info.camera, pose)).depth_m;
        let pairs = frame.depth_m.as_slice().iter().zip(truth.as_slice()).filter(|p| *p.0 > 0.0);
        let (measured, close) = pairs.fold((0, 0), |(n, close), (found, exact)| {
            // millimetres as stored, half of them rounding
            (n + 1, close + usize::from((found - exact).abs() < 1.2e-3))
        });
        (measured, f64::from(close as u32) / f64::from(measured as u32))
    };
    let (measured, share) = close_share(frame.world_from_camera.unwrap());
    // The depth camera sees 80 % of the colour picture; patches cut creases, silhouettes and the ball,
    // which are 5 % of it at this size.
    assert!(measured > SIZE.pixels() * 7 / 10 && share > 0.94, "{measured} {share}");
    // By the depth camera's pose, 3 cm beside it, little fits.
    assert!(close_share(orbit(2)).1 < 0.2);
}

#[test]
fn redwood_folders_by_number_with_log_and_json() {
    let made = Made::new();
    let mut log = String::new();
    for i in 0..4 {
        let number = i + 1;
        made.color(&format!("color/{number:05}.png"), SIZE);
        if i != 1 {
            made.depth(&format!("depth/{number:05}.png"), &Image::new(SIZE, 2.0), 1000.0);
        }
        log += &format!("{i} {i} {}\n{}", i + 1, matrix(&orbit(i)));
    }
    made.write("trajectory.log", log);
    let json = r#"{"width": 160, "height": 120, "intrinsic_matrix": [131, 0, 0, 0, 132, 0, 79.5, 59.5, 1]}"#;
    made.write("my_intrinsic.json", json);
    let mut sequence = made.open().unwrap();
    let info = sequence.info();
    assert_eq!((info.layout, info.pairs, info.camera.fy), (Layout::Redwood, 3, 132.0));
    assert_eq!(info.color_orphans, ["00002.png"]);
    let frame = sequence.frame(1).unwrap();
    assert_eq!(frame.depth_m[(7, 7)], 2.0);
    assert!((frame.timestamp_s - 2.0 / 30.0).abs() < 1e-12);
    // The log counts colour pictures: the third, although it is the second pair.
    let error = frame.world_from_camera.unwrap().inverse() * orbit(2);
    assert!(error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-6);
}

#[test]
fn folders_with_time_stamps_in_their_names() {
    let made = Made::new();
    for t in ["7.000", "7.033", "7.066"] {
        made.color(&format!("rgb/{t}.png"), SIZE);
    }
    for t in ["7.041", "7.070"] {
        made.flat_depth(&format!("depth_b/{t}.png"));
    }
    std::fs::create_dir(made.path().join("depth")).unwrap();
    let options = CaptureOptions { depth_list: Some("depth_b".into()), ..Default::default() };
    let mut sequence = open_sequence(made.path(), &options).unwrap();
    assert_eq!((sequence.info().layout, sequence.info().pairs), (Layout::Folders, 2));
    assert_eq!(sequence.info().color_orphans, ["7.000.png"]);
    assert!(sequence.info().warnings.iter().any(|w| w.contains("Kinect")));
    assert_eq!(sequence.frame(0).unwrap().depth_m[(0, 0)], 6.25);
}
