//! Whether a recording's numbers can be true: distances, depth factor, axes of the poses.

use super::RawFrame;
use crate::image::Image;
use crate::math::{Pinhole, Pose, median, quantile};
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use serde::Serialize;

/// Depth factors in use: millimetres, TUM, Replica, tenths of millimetres, KITTI-like 8.8 fixed point.
const FACTORS: [f64; 5] = [1000.0, 5000.0, 6553.5, 10_000.0, 256.0];

/// Every 4th pixel in x and y is looked at: 19 000 of a picture of 640x480.
const STRIDE: usize = 4;

#[derive(Clone, Debug, Serialize)]
pub struct Extent {
    /// Share of pixels with depth.
    pub valid_share: f64,
    pub depth_p5_m: f64,
    pub depth_median_m: f64,
    pub depth_p95_m: f64,
    /// Share of measured points inside a cube of 2 m around their median.
    pub in_2m_cube_share: f64,
}

/// How well depth of one frame predicts depth of another, by the recorded poses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Residual {
    /// Median of |predicted - measured depth|.
    pub median_m: f64,
    /// The same, of |predicted - measured| / measured.
    pub relative: f64,
    /// Share of the first frame's points that land on depth of the second.
    pub overlap: f64,
}

#[derive(Clone, Debug, Serialize)]
pub struct PoseCheck {
    /// Frames compared, with the residual by the recorded poses.
    pub pairs: Vec<(usize, usize, Residual)>,
    /// Mean relative residual of all pairs.
    pub as_recorded: f64,
    /// Other readings of the poses or of depth, with their mean relative residual.
    pub alternatives: Vec<(String, f64)>,
    /// The other reading that fits clearly better.
    pub better: Option<String>,
}

/// `None` where no pixel has depth.
pub fn extent(camera: &Pinhole, frames: &[RawFrame]) -> Option<Extent> {
    let mut depths = Vec::new();
    let mut points: [Vec<f64>; 3] = Default::default();
    let mut looked_at = 0usize;
    for frame in frames {
        looked_at += sampled(&frame.depth_m).count();
        for (x, y, d) in sampled(&frame.depth_m).filter(|s| s.2 > 0.0) {
            depths.push(d);
            let p = point(camera, x as f64, y as f64, d);
            (0..3).for_each(|k| points[k].push(p[k]));
        }
    }
    let centre: Vec<f64> =
        points.iter().map(|p| median(p.iter().copied())).collect::<Option<_>>()?;
    let inside =
        (0..depths.len()).filter(|&i| (0..3).all(|k| (points[k][i] - centre[k]).abs() <= 1.0));
    Some(Extent {
        valid_share: depths.len() as f64 / looked_at as f64,
        in_2m_cube_share: inside.count() as f64 / depths.len() as f64,
        depth_p5_m: quantile(depths.iter().copied(), 0.05)?,
        depth_median_m: median(depths.iter().copied())?,
        depth_p95_m: quantile(depths.iter().copied(), 0.95)?,
    })
}

impl Extent {
    /// Whether distances are those of an indoor depth camera: nothing nearer than 20 cm, half of the
    /// picture between 35 cm and 5 m, nearly all of it within 10 m.
    fn is_plausible(&self, scale: f64) -> bool {
        let [near, middle, far] =
            [self.depth_p5_m, self.depth_median_m, self.depth_p95_m].map(|d| d * scale);
        near >= 0.2 && (0.35..=5.0).contains(&middle) && far <= 10.0
    }

    /// Names the factors that would fit where the used one does not.
    pub fn factor_mistake(&self, used: f64) -> Option<String> {
        if self.is_plausible(1.0) {
            return None;
        }
        let fitting: Vec<_> = FACTORS
            .into_iter()
            .filter(|&f| f != used && self.is_plausible(used / f))
            .map(|f| format!("{f} (median {:.2} m)", self.depth_median_m * used / f))
            .collect();
        let fit = if fitting.is_empty() {
            "no usual factor".into()
        } else {
            format!("factor {}", fitting.join(" or "))
        };
        Some(format!(
            "depth from {:.2} to {:.2} m, median {:.2} m, is unusual: values fit {fit}, {used} is used",
            self.depth_p5_m, self.depth_p95_m, self.depth_median_m
        ))
    }
}

/// Moves depth of one frame into another and compares. `None` where fewer than 100 points overlap.
pub fn residual(
    camera: &Pinhole,
    from: &Image<f32>,
    to: &Image<f32>,
    to_from: &Pose,
    scale: f64,
) -> Option<Residual> {
    let (mut metres, mut relative) = (Vec::new(), Vec::new());
    let mut seen = 0usize;
    for (x, y, d) in sampled(from).filter(|s| s.2 > 0.0) {
        seen += 1;
        let p = to_from * Point3::from(point(camera, x as f64, y as f64, d * scale));
        let u = f64::from(camera.fx) * p.x / p.z + f64::from(camera.cx);
        let v = f64::from(camera.fy) * p.y / p.z + f64::from(camera.cy);
        if !(p.z > 0.0 && u > -0.5 && v > -0.5) {
            continue;
        }
        let measured =
            to.get((u + 0.5) as usize, (v + 0.5) as usize).map_or(0.0, |&d| f64::from(d) * scale);
        if measured > 0.0 {
            metres.push((p.z - measured).abs());
            relative.push((p.z - measured).abs() / measured);
        }
    }
    if metres.len() < 100 {
        return None;
    }
    let overlap = metres.len() as f64 / seen as f64;
    Some(Residual { overlap, median_m: median(metres)?, relative: median(relative)? })
}

type PoseReading = fn(&Pose) -> Pose;

/// Another reading of poses and depth.
struct Reading {
    name: String,
    pose: PoseReading,
    depth_scale: f64,
}

/// Compares frame 0 with the others, by the recorded poses and by what they might mean instead.
/// `None` where no two frames have poses and overlap.
pub fn check_poses(camera: &Pinhole, frames: &[RawFrame], factor: f64) -> Option<PoseCheck> {
    let first = frames.iter().find(|f| f.world_from_camera.is_some())?;
    let others: Vec<_> =
        frames.iter().filter(|f| f.index != first.index && f.world_from_camera.is_some()).collect();
    let recorded = Reading { name: "as recorded".into(), pose: |p| *p, depth_scale: 1.0 };
    let between = |other: &RawFrame, reading: &Reading| {
        let a = (reading.pose)(first.world_from_camera.as_ref()?);
        let b = (reading.pose)(other.world_from_camera.as_ref()?);
        residual(camera, &first.depth_m, &other.depth_m, &(b.inverse() * a), reading.depth_scale)
    };
    let pairs: Vec<_> = others
        .iter()
        .filter_map(|o| Some((first.index, o.index, between(o, &recorded)?)))
        .collect();
    // A reading that throws the points out of the picture fits badly, however well the rest fits.
    let mean = |reading: &Reading| {
        let known: Vec<f64> = others
            .iter()
            .map(|o| between(o, reading).map_or(1.0, |r| r.relative / r.overlap.sqrt()))
            .collect();
        known.iter().sum::<f64>() / known.len() as f64
    };
    if others.is_empty() {
        return None;
    }
    let as_recorded = mean(&recorded);
    let alternatives: Vec<_> = readings(factor).iter().map(|r| (r.name.clone(), mean(r))).collect();
    let best = alternatives.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    // Noise alone makes 0.3 %; two readings of nearly no motion differ by less than a third.
    let better =
        best.filter(|b| as_recorded > 0.005 && b.1 < 0.6 * as_recorded).map(|b| b.0.clone());
    Some(PoseCheck { pairs, as_recorded, alternatives, better })
}

fn readings(factor: f64) -> Vec<Reading> {
    let axes: [(&str, PoseReading); 5] = [
        ("poses are camera_from_world (inverted)", |p| p.inverse()),
        ("camera axes of OpenGL (y up, z backwards)", |p| {
            p * Pose::rotation(Vector3::x() * std::f64::consts::PI)
        }),
        ("y axis mirrored", |p| mirrored(p, Vector3::new(1.0, -1.0, 1.0))),
        ("x axis mirrored", |p| mirrored(p, Vector3::new(-1.0, 1.0, 1.0))),
        ("quaternions stored w first", |p| {
            let q = p.rotation.coords;
            let rotation =
                UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q.x, q.y, q.z, q.w));
            Pose::from_parts(p.translation, rotation)
        }),
    ];
    let axes =
        axes.into_iter().map(|(name, pose)| Reading { name: name.into(), pose, depth_scale: 1.0 });
    let factors =
        FACTORS.into_iter().filter(|f| (f / factor - 1.0).abs() > 0.01).map(|f| Reading {
            name: format!("depth factor {f}, {factor} is used"),
            pose: |p| *p,
            depth_scale: factor / f,
        });
    axes.chain(factors).collect()
}

/// The pose with one axis of both world and camera turned over: F T F.
fn mirrored(pose: &Pose, signs: Vector3<f64>) -> Pose {
    let f = Matrix3::from_diagonal(&signs);
    let rotation = f * pose.rotation.to_rotation_matrix().matrix() * f;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Pose::from_parts((f * pose.translation.vector).into(), rotation)
}

fn sampled(depth_m: &Image<f32>) -> impl Iterator<Item = (usize, usize, f64)> {
    let xs = (0..depth_m.width()).step_by(STRIDE);
    (0..depth_m.height())
        .step_by(STRIDE)
        .flat_map(move |y| xs.clone().map(move |x| (x, y, f64::from(depth_m[(x, y)]))))
}

fn point(camera: &Pinhole, u: f64, v: f64, d: f64) -> Vector3<f64> {
    let x = (u - f64::from(camera.cx)) / f64::from(camera.fx);
    let y = (v - f64::from(camera.cy)) / f64::from(camera.fy);
    Vector3::new(x * d, y * d, d)
}
