use super::*;

fn full() -> Calibration {
    let lens = Distortion::Brown {
        k1: 0.262383,
        k2: -0.953104,
        p1: -0.005358,
        p2: 0.002628,
        k3: 1.163314,
    };
    let color = CameraModel {
        width: 640,
        height: 480,
        fx: 517.306408,
        fy: 516.469215,
        cx: 318.64304,
        cy: 255.313989,
        distortion: lens,
    };
    let depth = CameraModel { fx: 585.1, distortion: Distortion::None, ..color };
    let shift =
        Rigid { translation_m: [0.025, -1e-3, 0.1 + 0.2], rotation_xyzw: [0.0, 0.1, 0.0, 0.99] };
    Calibration {
        notes: "line 1\n\"line\" 2".into(),
        registered: false,
        depth_factor: Some(1000.0 / 3.0),
        invalid_depth: vec![0, 2047],
        poses_of: PoseOwner::Depth,
        depth: Some(depth),
        color_from_depth: Some(shift),
        ..Calibration::registered("made", color)
    }
}

#[test]
fn toml_round_trip_is_exact() {
    let mut calibration = full();
    for lens in [
        calibration.color.distortion,
        Distortion::None,
        Distortion::KannalaBrandt { k1: 0.1, k2: 0.2, k3: -0.3, k4: 1e-9 },
        Distortion::Rational { k1: 1., k2: 2., p1: 3., p2: 4., k3: 5., k4: 6., k5: 7., k6: 8. },
    ] {
        calibration.color.distortion = lens;
        let text = calibration.to_toml().unwrap();
        assert_eq!(Calibration::from_toml(&text).unwrap(), calibration, "{text}");
    }
}

#[test]
fn undistorting_undoes_distorting() {
    let lens = full().color.distortion;
    for (x, y) in [(0.0, 0.0), (0.5, -0.4), (-0.61, 0.49), (0.2, 0.3)] {
        let (xd, yd) = lens.distort(x, y);
        let (xu, yu) = lens.undistort(xd, yd).unwrap();
        assert!((xu - x).abs() < 1e-8 && (yu - y).abs() < 1e-8, "{x} {y}: {xu} {yu}");
    }
    // This lens folds far outside the picture: no answer rather than a wrong one.
    let fold = Distortion::Brown { k1: -0.5, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };
    assert!(fold.undistort(3.0, 3.0).is_none());
}

#[test]
fn photometry_and_disparities_survive_the_file() {
    let curve: Vec<f64> = (0..256).map(|i| (f64::from(i) / 255.0).powf(2.2)).collect();
    let photometry = Photometry {
        color_matrix: Some([[1.2, -0.1, -0.1], [0.0, 1.0, 0.0], [0.1, 0.2, 1.0 / 3.0]]),
        vignetting: Some(Vignetting { center: [0.49, 0.5], falloff: [-0.3, -0.1, 0.02] }),
        response: Some(Response { red: curve.clone(), green: curve.clone(), blue: curve }),
    };
    let mut calibration = Calibration { depth_factor: None, photometry, ..full() };
    calibration.disparity = Some(Disparity { c0: 3.12, c1: -0.00286 });
    let text = calibration.to_toml().unwrap();
    assert_eq!(Calibration::from_toml(&text).unwrap(), calibration, "{text}");
    let refused = |edit: &dyn Fn(&mut Calibration)| {
        let mut broken = calibration.clone();
        edit(&mut broken);
        broken.check().unwrap_err()
    };
    let response = |c: &mut Calibration| c.photometry.response.as_mut().unwrap().green[40] = 0.9;
    assert!(refused(&response).contains("response"));
    assert!(refused(&|c| c.depth_factor = Some(1000.0)).contains("exclude"));
    assert!(refused(&|c| c.disparity = Some(Disparity { c0: 3.0, c1: 0.0 })).contains("disparity"));
    let matrix = |c: &mut Calibration| c.photometry.color_matrix = Some([[f64::NAN; 3]; 3]);
    assert!(refused(&matrix).contains("color_matrix"));
}

#[test]
fn fish_eye_angles_come_back_up_to_the_side() {
    let lens = Distortion::KannalaBrandt { k1: 0.05, k2: -0.02, k3: 4e-3, k4: -5e-4 };
    for degrees in [0.0f64, 1e-7, 10.0, 45.0, 70.0, 85.0] {
        let r = degrees.to_radians().tan();
        let (xd, yd) = lens.distort(0.6 * r, -0.8 * r);
        let (x, y) = lens.undistort(xd, yd).unwrap();
        // The angle is solved to 1e-12, which the tangent at 85 degrees multiplies by 130.
        assert!((x - 0.6 * r).abs() < 1e-9 && (y + 0.8 * r).abs() < 1e-9, "{degrees}: {x} {y}");
    }
    assert!(lens.undistort(2.0, 0.0).is_none(), "beyond the side");
    let fold = Distortion::KannalaBrandt { k1: -0.5, k2: 0.0, k3: 0.0, k4: 0.0 };
    assert!(fold.undistort(0.9, 0.0).is_none(), "beyond the fold");
}

#[test]
fn every_problem_is_named_at_once() {
    let mut broken = full();
    broken.color.fx = -1.0;
    broken.depth_factor = Some(f64::NAN);
    broken.color_from_depth = None;
    let problem = broken.check().unwrap_err();
    for word in ["focal", "depth_factor", "color_from_depth"] {
        assert!(problem.contains(word), "{problem}");
    }
    assert!(Calibration::from_toml("name = \"x\"\nregistered = true\ntypo = 1").is_err());
}

#[test]
fn built_in_files_read_and_are_found_by_folder() {
    for name in built_in_names() {
        assert_eq!(built_in(name).unwrap().name, name);
    }
    let of = |folder: &str| built_in_for_folder(Path::new(folder)).map(|c| c.name);
    assert_eq!(of("/x/rgbd_dataset_freiburg2_desk").unwrap(), "tum_freiburg2");
    assert_eq!(of("fr1-desk").unwrap(), "tum_freiburg1");
    assert_eq!(of("/x/dynamic_hands_cup").unwrap(), "dynamic_hands_cup");
    assert_eq!(of("/fr1/office"), None);
}

#[test]
fn the_cup_camera_reproduces_the_alignment_measured_at_the_table() {
    let cup = built_in("dynamic_hands_cup").unwrap();
    let (depth, color) = (cup.depth.unwrap(), cup.color);
    let color_from_depth = cup.color_from_depth.unwrap().pose().unwrap();
    for (u, v) in [(320.0, 180.0), (40.0, 30.0), (600.0, 330.0)] {
        let z = 0.65;
        let ray = nalgebra::Point3::new((u - depth.cx) / depth.fx, (v - depth.cy) / depth.fy, 1.0);
        let p = color_from_depth * (ray * z);
        let found = (color.fx * p.x / p.z + color.cx, color.fy * p.y / p.z + color.cy);
        let measured = (320.0 + 0.96 * (u - 320.0) - 21.0, 180.0 + 0.96 * (v - 180.0) + 6.0);
        // the file's two decimals
        assert!((found.0 - measured.0).abs() < 0.01 && (found.1 - measured.1).abs() < 0.01);
    }
}

#[test]
fn scaling_keeps_rays_and_refuses_crops() {
    let camera = CameraModel { distortion: Distortion::None, ..full().color };
    let half = camera.scaled_to(Size::new(320, 240)).unwrap();
    // pixel 10 of the half picture covers pixels 20 and 21: centre 20.5
    assert!(((20.5 - camera.cx) / camera.fx - (10.0 - half.cx) / half.fx).abs() < 1e-12);
    assert!(camera.scaled_to(Size::new(640, 360)).is_none());
}
