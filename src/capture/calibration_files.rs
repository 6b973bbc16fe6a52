//! Calibrations as other programs write them.

use super::calibration::{Calibration, CameraModel, Disparity, Distortion, Rigid};
use super::text;
use crate::image::Size;
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use yaml_rust2::{Yaml, YamlLoader};

/// Reads OpenCV YAML, ROS `camera_info`, ORB-SLAM settings and the files of the Kinect Calibration
/// Toolbox. `pictures` is the size to assume where the file gives none.
pub(super) fn from_yaml(
    name: &str,
    content: &str,
    pictures: Option<Size>,
) -> Result<Calibration, String> {
    check_nesting(content)?;
    // OpenCV's first line, "%YAML:1.0", is no YAML.
    let body: String =
        content.split_inclusive('\n').filter(|line| !line.starts_with("%YAML")).collect();
    let documents = YamlLoader::load_from_str(&body).map_err(|e| e.to_string())?;
    let root = documents.first().ok_or("the file is empty")?;
    if !root["rK1"].is_badvalue() {
        from_kinect_toolbox(name, root)
    } else if !root["Camera.fx"].is_badvalue() {
        from_orb_slam(name, root, pictures)
    } else {
        let color = camera_info(root, pictures)?;
        Ok(Calibration::registered(name, color))
    }
}

/// Deep nesting would exhaust the parser's stack, anchors its memory. No calibration has either.
fn check_nesting(content: &str) -> Result<(), String> {
    let mut depth = 0u32;
    for (i, line) in content.lines().enumerate() {
        let lead = line.trim_start_matches([' ', '-', '?', ':', '\t']);
        let mut deepest = depth;
        for c in line.chars() {
            match c {
                '[' | '{' => depth += 1,
                // Those of a comment or of text close nothing: what opens later still counts.
                ']' | '}' => depth = depth.saturating_sub(1),
                _ => {}
            }
            deepest = deepest.max(depth);
        }
        if deepest > 16 || line.len() - lead.len() > 64 || lead.contains('&') {
            return Err(format!(
                "line {}: nesting and anchors like this are no calibration",
                i + 1
            ));
        }
    }
    Ok(())
}

/// Keys of ROS (`camera_matrix`, `distortion_model`), of the ROS message (`K`, `D`) and of OpenCV's
/// calibration sample, which are the same but for tags.
fn camera_info(root: &Yaml, pictures: Option<Size>) -> Result<CameraModel, String> {
    let matrix = first(root, &["camera_matrix", "cameraMatrix", "K", "k", "M1", "intrinsics"])
        .ok_or("no camera_matrix (or K) in the file")?;
    let k = values(matrix).filter(|v| v.len() == 9).ok_or("camera_matrix is not 3x3 numbers")?;
    let d = first(root, &["distortion_coefficients", "distCoeffs", "D", "d", "D1"]);
    let d = d.map_or(Some(vec![]), values).ok_or("distortion coefficients are not numbers")?;
    if let Some(r) = first(root, &["rectification_matrix", "R"]).and_then(values)
        && r != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    {
        return Err(
            "rectification_matrix is not the identity: stereo rectification is not read".into()
        );
    }
    let given = (|| {
        let number = |keys: &[&str]| usize::try_from(first(root, keys)?.as_i64()?).ok();
        Some(Size::new(number(&["image_width", "width"])?, number(&["image_height", "height"])?))
    })();
    let model = first(root, &["distortion_model"]).and_then(Yaml::as_str);
    camera(&k, distortion(model, &d)?, given.or(pictures))
}

fn from_orb_slam(name: &str, root: &Yaml, pictures: Option<Size>) -> Result<Calibration, String> {
    let number = |key: &str| scalar(&root[key]);
    let needed = |key: &str| number(key).ok_or(format!("{key} is missing or no number"));
    let zero = |key: &str| number(key).unwrap_or(0.0);
    let given = number("Camera.width").zip(number("Camera.height"));
    let given = given.map(|(w, h)| Size::new(w as usize, h as usize));
    let k = [
        needed("Camera.fx")?,
        0.0,
        needed("Camera.cx")?,
        0.0,
        needed("Camera.fy")?,
        needed("Camera.cy")?,
        0.0,
        0.0,
        1.0,
    ];
    let keys = ["Camera.k1", "Camera.k2", "Camera.p1", "Camera.p2", "Camera.k3"];
    let fisheye = root["Camera.type"].as_str().is_some_and(|t| t.starts_with("Kannala"));
    let lens = if fisheye {
        distortion(
            Some("equidistant"),
            &["Camera.k1", "Camera.k2", "Camera.k3", "Camera.k4"].map(zero),
        )?
    } else {
        distortion(None, &keys.map(zero))?
    };
    let mut out = Calibration::registered(name, camera(&k, lens, given.or(pictures))?);
    out.depth_factor = number("DepthMapFactor").or(number("RGBD.DepthMapFactor"));
    Ok(out)
}

/// Herrera, Kannala, Heikkila 2012: colour camera `rK1`, depth camera `dK`, and
/// `X_colour = dR X_depth + dt` in metres.
fn from_kinect_toolbox(name: &str, root: &Yaml) -> Result<Calibration, String> {
    let numbers = |key: &str, count: usize| {
        values(&root[key])
            .filter(|v| v.len() == count)
            .ok_or(format!("{key} is not {count} numbers"))
    };
    let size = numbers("rsize1", 3)?;
    let color_size = Size::new(size[1] as usize, size[0] as usize);
    let color =
        camera(&numbers("rK1", 9)?, distortion(None, &numbers("rkc1", 5)?)?, Some(color_size))?;
    // The file does not say the depth camera's size; the toolbox is for the Kinect v1.
    let depth_lens = distortion(None, &numbers("dkc", 5)?)?;
    let depth = camera(&numbers("dK", 9)?, depth_lens, Some(Size::new(640, 480)))?;
    let rotation = Matrix3::from_row_slice(&numbers("dR", 9)?);
    let dc = numbers("dc", 2)?;
    let t = numbers("dt", 3)?;
    if (rotation.transpose() * rotation - Matrix3::identity()).amax() > 1e-3 {
        return Err("dR is no rotation".into());
    }
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let pose = crate::math::Pose::from_parts(Translation3::new(t[0], t[1], t[2]), rotation);
    Ok(Calibration {
        registered: false,
        depth: Some(depth),
        invalid_depth: vec![2047],
        disparity: Some(Disparity { c0: dc[0], c1: dc[1] }),
        color_from_depth: Some(Rigid::from_pose(&pose)),
        ..Calibration::registered(name, color)
    })
}

/// Open3D's intrinsics: `intrinsic_matrix` is 3x3 by *columns*.
pub(super) fn from_open3d_json(name: &str, content: &str) -> Result<Calibration, String> {
    #[derive(serde::Deserialize)]
    struct File {
        width: usize,
        height: usize,
        intrinsic_matrix: [f64; 9],
        depth_scale: Option<f64>,
    }
    let file: File = serde_json::from_str(content).map_err(|e| e.to_string())?;
    let m = file.intrinsic_matrix;
    let by_rows = [m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]];
    let color = camera(&by_rows, Distortion::None, Some(Size::new(file.width, file.height)))
        .map_err(|e| format!("intrinsic_matrix, read by columns: {e}"))?;
    Ok(Calibration { depth_factor: file.depth_scale, ..Calibration::registered(name, color) })
}

/// Reads a bare 3x3 matrix, or `fx fy cx cy [width height [depth_factor]]`.
pub(super) fn from_text(
    name: &str,
    content: &str,
    pictures: Option<Size>,
) -> Result<Calibration, String> {
    let mut all = Vec::new();
    for (number, line) in text::lines(content) {
        all.extend(text::numbers(line).map_err(|p| format!("line {number}: {p}"))?);
    }
    let matrix = |v: &[f64]| [v[0], 0.0, v[2], 0.0, v[1], v[3], 0.0, 0.0, 1.0];
    let size = |v: &[f64]| Some(Size::new(v[4] as usize, v[5] as usize));
    let (k, given) = match all.len() {
        9 => (std::array::from_fn(|i| all[i]), pictures),
        4 => (matrix(&all), pictures),
        6 | 7 => (matrix(&all), size(&all)),
        count => {
            let problem = "expected a 3x3 matrix or fx fy cx cy [width height [depth_factor]]";
            return Err(format!("{count} numbers; {problem}"));
        }
    };
    let color = camera(&k, Distortion::None, given)?;
    let depth_factor = (all.len() == 7).then(|| all[6]);
    Ok(Calibration { depth_factor, ..Calibration::registered(name, color) })
}

fn camera(k: &[f64], distortion: Distortion, size: Option<Size>) -> Result<CameraModel, String> {
    let &[fx, skew, cx, a, fy, cy, b, c, d] = k else {
        return Err(format!("{} numbers; a camera matrix has 9", k.len()));
    };
    if [skew, a, b, c] != [0.0; 4] || d != 1.0 {
        return Err(format!("{k:?} is not of the form fx 0 cx; 0 fy cy; 0 0 1"));
    }
    let size = size.ok_or("the file does not give the size of the pictures")?;
    Ok(CameraModel { width: size.width, height: size.height, fx, fy, cx, cy, distortion })
}

/// Without a model's name, up to 5 coefficients are Brown's and 8 are the rational model's.
fn distortion(model: Option<&str>, d: &[f64]) -> Result<Distortion, String> {
    let at = |i: usize| d.get(i).copied().unwrap_or(0.0);
    let named = match (model, d.len()) {
        (Some("equidistant" | "fisheye" | "kannala_brandt"), 4) => {
            return Ok(Distortion::KannalaBrandt { k1: d[0], k2: d[1], k3: d[2], k4: d[3] });
        }
        (Some("plumb_bob") | None, 0 | 4 | 5) => {
            Distortion::Brown { k1: at(0), k2: at(1), p1: at(2), p2: at(3), k3: at(4) }
        }
        // OpenCV may append thin-prism and tilt coefficients, which must then be zero.
        (Some("rational_polynomial") | None, 8 | 12 | 14) if d[8..].iter().all(|&v| v == 0.0) => {
            Distortion::Rational {
                k1: d[0],
                k2: d[1],
                p1: d[2],
                p2: d[3],
                k3: d[4],
                k4: d[5],
                k5: d[6],
                k6: d[7],
            }
        }
        (model, count) => {
            let model = model.unwrap_or("no model named");
            return Err(format!("lens distortion ({model}) with {count} coefficients is not read"));
        }
    };
    Ok(if d.iter().all(|&v| v == 0.0) { Distortion::None } else { named })
}

fn first<'a>(root: &'a Yaml, keys: &[&str]) -> Option<&'a Yaml> {
    keys.iter().map(|k| &root[*k]).find(|node| !node.is_badvalue() && !node.is_null())
}

fn scalar(node: &Yaml) -> Option<f64> {
    match node {
        Yaml::Integer(i) => Some(*i as f64),
        Yaml::Real(_) => node.as_f64(),
        // "640." and "1.e-3" are numbers to OpenCV, not to YAML.
        Yaml::String(s) => s.trim().parse().ok(),
        _ => None,
    }
}

/// The numbers of a list, of a list of lists, or of an OpenCV or ROS matrix with `data`.
fn values(node: &Yaml) -> Option<Vec<f64>> {
    if !node["data"].is_badvalue() {
        return values(&node["data"]);
    }
    let list = node.as_vec()?;
    if let Some(rows) = list.iter().map(Yaml::as_vec).collect::<Option<Vec<_>>>() {
        return rows.into_iter().flatten().map(scalar).collect();
    }
    list.iter().map(scalar).collect()
}

#[cfg(test)]
#[rustfmt::skip]
mod tests {
    use super::*;

    const SIZE: Option<Size> = Some(Size::new(640, 480));

    #[test]
    fn opencv_yaml() {
        let text = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   \
            cols: 3\n   dt: d\n   data: [ 5.1e+02, 0., 319., 0., 511.5,\n       2.395e2, 0., 0., 1. ]\n\
            distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ 0.1, -0.2, 1e-3, -.002, 0.3 ]\n";
        let color = from_yaml("x", text, None).unwrap().color;
        assert_eq!((color.fx, color.fy, color.cx, color.cy), (510.0, 511.5, 319.0, 239.5));
        assert_eq!(color.distortion, Distortion::Brown { k1: 0.1, k2: -0.2, p1: 1e-3, p2: -0.002, k3: 0.3 });
        assert_eq!(color.size(), SIZE.unwrap());
    }

    #[test]
    fn ros_camera_info() {
        let ros = |model: &str, d: &str| format!("image_width: 640\nimage_height: 480\ncamera_name: rgb\n\
            camera_matrix:\n  rows: 3\n  cols: 3\n  data: [500, 0, 320, 0, 501, 240, 0, 0, 1]\n\
            distortion_model: {model}\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{d}]\n\
            rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n");
        let read = |model: &str, d: &str| from_yaml("x", &ros(model, d), None).map(|c| c.color.distortion);
        assert_eq!(read("plumb_bob", "0.1, 0.2, 0.3, 0.4, 0.5").unwrap(),
            Distortion::Brown { k1: 0.1, k2: 0.2, p1: 0.3, p2: 0.4, k3: 0.5 });
        assert_eq!(read("plumb_bob", "0, 0, 0, 0, 0").unwrap(), Distortion::None);
        assert_eq!(read("rational_polynomial", "1, 2, 3, 4, 5, 6, 7, 8").unwrap(),
            Distortion::Rational { k1: 1., k2: 2., p1: 3., p2: 4., k3: 5., k4: 6., k5: 7., k6: 8. });
        assert_eq!(read("equidistant", "1, 2, 3, 4").unwrap(),
            Distortion::KannalaBrandt { k1: 1., k2: 2., k3: 3., k4: 4. });
        assert!(read("plumb_bob", "1, 2, 3").unwrap_err().contains("3 coefficients"));
        assert!(read("ucm", "1, 2, 3, 4").unwrap_err().contains("ucm"));
        let turned = ros("plumb_bob", "0").replace("[1, 0, 0, 0, 1, 0, 0, 0, 1]", "[0, 1, 0, -1, 0, 0, 0, 0, 1]");
        assert!(from_yaml("x", &turned, None).is_err());
    }

    #[test]
    fn orb_slam_settings() {
        let text = "%YAML:1.0\nCamera.fx: 535.4\nCamera.fy: 539.2\nCamera.cx: 320.1\nCamera.cy: 247.6\nCamera.k1: 0.0\n\
            Camera.width: 640\nCamera.height: 480\nDepthMapFactor: 5000.0\n";
        let read = from_yaml("x", text, None).unwrap();
        assert_eq!((read.color.fy, read.depth_factor, read.color.distortion), (539.2, Some(5000.0), Distortion::None));
    }

    #[test]
    fn open3d_json_is_by_columns() {
        let by_columns = r#"{"width": 640, "height": 480, "intrinsic_matrix": [525, 0, 0, 0, 526, 0, 319.5, 239.5, 1]}"#;
        let color = from_open3d_json("x", by_columns).unwrap().color;
        assert_eq!((color.fx, color.fy, color.cx, color.cy), (525.0, 526.0, 319.5, 239.5));
        let by_rows = by_columns.replace("525, 0, 0, 0, 526, 0, 319.5, 239.5, 1", "525, 0, 319.5, 0, 526, 239.5, 0, 0, 1");
        assert!(from_open3d_json("x", &by_rows).unwrap_err().contains("by columns"));
    }

    #[test]
    fn bare_numbers() {
        let seven = from_text("x", "# fx fy ...\r\n525.0 526 319.5 239.5 640 480 5000\r\n", None).unwrap();
        assert_eq!((seven.color.fy, seven.color.height, seven.depth_factor), (526.0, 480, Some(5000.0)));
        let matrix = "5.85e+02 0 3.2e2\n0 585 240\n0 0 1\n";
        assert_eq!(from_text("x", matrix, SIZE).unwrap().color.cx, 320.0);
        assert!(from_text("x", matrix, None).is_err());
        assert!(from_text("x", "1 2 3", SIZE).is_err());
        assert!(from_text("x", "1 2 3 four", SIZE).unwrap_err().contains("line 1"));
    }

    #[test]
    fn hostile_yaml_is_refused_before_it_is_parsed() {
        for bad in [
            "[".repeat(100_000),
            format!("K: {}{}", "[".repeat(100_000), "]".repeat(100_000)),
            format!("# {}\nK: {}", "]".repeat(100_000), "[".repeat(100_000)),
            format!("{}x", "- ".repeat(100_000)),
            "a: &a [1]\nb: [*a, *a]".into(),
            "K: {".into(),
            String::new(),
            "K: [nan, 0, 1, 0, 1, 1, 0, 0, 1]".into(),
        ] {
            let read = from_yaml("x", &bad, SIZE).and_then(|c| c.check());
            assert!(read.is_err(), "{}", &bad[..bad.len().min(40)]);
        }
    }
}
