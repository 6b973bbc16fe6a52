//! A depth camera that shows no board: its lens, its place and its disparities from the planes that the
//! colour camera knows.
//!
//! After Herrera, Kannala and Heikkila 2012, without their spatial distortion of disparities: the board
//! of each colour picture is a plane in colour camera axes, and every disparity on it must be the
//! plane's. The region of the plane starts as the board's outline and grows over what fits. What few
//! planes leave open is held near what all sensors of the kind share.

use super::CalibrateError;
use super::board::{Board, PosedView};
use super::levenberg::{Normal, minimise};
use crate::capture::calibration::{CameraModel, Disparity, Distortion};
use crate::image::{Image, Size};
use crate::math::Pose;
use nalgebra::{DVector, Point3, Translation3, UnitQuaternion, Vector3};

/// Value of a pixel without disparity.
pub const NO_DISPARITY: u16 = 2047;

/// Focal lengths, principal point, rotation vector, translation, c0, c1.
const UNKNOWNS: usize = 12;
/// Pixels between used ones: neighbours share the sensor's correlation window.
const STEP: usize = 3;
/// Disparities farther from the plane do not belong to it. A Kinect's uncorrected distortion is 2 to 3.
const ON_PLANE: f64 = 4.0;
/// How far sensors of the kind differ from the nominal one, one standard deviation: pixels (of 640),
/// radians, metres, and the coefficients of the disparity.
///
/// Focal lengths: 2 %, rounded up from the scatter of what others published of their Kinects' infrared
/// cameras (Burrus 594 and 591 px, the two of the TUM RGB-D benchmark 591 and 590, 581 and 582, and 576
/// that the driver assumes of all) about 580, which is 1.5 %. Their principal points lie 13 px from the
/// middle across and 9 px down (RMS). The disparity is that of a baseline of 75 mm, 8 units a pixel and
/// 1090 for a point at infinity: `c1 = -1 / (8 f b)`, `c0 = -1090 c1`, both within 3 %.
const SPREAD: [f64; UNKNOWNS] =
    [12.0, 12.0, 12.0, 12.0, 0.02, 0.02, 0.02, 5e-3, 5e-3, 5e-3, 0.1, 1e-4];
/// Disparities of one picture share the distortion of its sensor: they weigh as many independent ones.
const INDEPENDENT: f64 = 25.0;
/// Residuals beyond count linearly.
const HUBER: f64 = 1.0;

/// A disparity picture and the board in the colour picture of the same moment.
pub struct DisparityView<'a> {
    pub colored: &'a PosedView,
    pub disparity: &'a Image<u16>,
}

#[derive(Clone, Debug)]
pub struct FoundDepthCamera {
    pub depth: CameraModel,
    pub color_from_depth: Pose,
    pub disparity: Disparity,
    /// One standard deviation of fx, fy, cx, cy in pixels.
    pub deviation_px: [f64; 4],
    /// Of measured less predicted disparity.
    pub rms: f64,
    /// The same of each view, and the pixels used of it.
    pub views: Vec<(f64, usize)>,
}

/// Solves for the depth camera. Planes must stand at several slants and distances; the error says so
/// where they do not.
pub fn find_depth_camera(
    board: &Board,
    views: &[DisparityView],
) -> Result<FoundDepthCamera, CalibrateError> {
    let size = views.first().map(|v| v.disparity.size());
    let size = size.ok_or(CalibrateError::Options("no disparity pictures".into()))?;
    if views.iter().any(|v| v.disparity.size() != size) {
        return Err(CalibrateError::Options("disparity pictures differ in size".into()));
    }
    let mut at = nominal(size);
    let mut samples = Vec::new();
    let nominal = at.clone();
    let mut last = Normal::new(UNKNOWNS);
    for round in 0..5 {
        samples.clear();
        for (number, view) in views.iter().enumerate() {
            let state = State::new(&at, view.colored);
            let region = outline(board, view.colored, &state, size);
            let tolerance = if round == 0 { 60.0 } else { ON_PLANE };
            let pixels = grow(view.disparity, region, &state, tolerance, round > 0);
            samples.extend(pixels.into_iter().map(|(x, y, d)| Sample { number, x, y, d }));
        }
        if samples.len() < 500 {
            let problem = "too few disparities on the boards: is the board's size right?";
            return Err(CalibrateError::Data(problem.into()));
        }
        let limit = if round == 0 { 5.0 } else { HUBER };
        let (solved, normal) = minimise(at, 60, |p| {
            let mut normal = normal_equations(p, views, &samples, limit);
            add_spread(&mut normal, p, &nominal, weight(&samples, views), size);
            normal
        });
        at = solved;
        last = normal;
    }
    check_determined(&normal_equations(&at, views, &samples, HUBER))?;
    let covariance = last.matrix.try_inverse().filter(|c| c.iter().all(|v| v.is_finite()));
    let covariance =
        covariance.ok_or(CalibrateError::Data("the depth camera was not found".into()))?;
    let mut found = found(&at, views, &samples, size);
    let share = weight(&samples, views) * found.rms.powi(2);
    found.deviation_px = std::array::from_fn(|k| (share * covariance[(k, k)].max(0.0)).sqrt());
    Ok(found)
}

struct Sample {
    number: usize,
    x: f64,
    y: f64,
    d: f64,
}

/// A Kinect v1 or a camera of its kind, whatever the size of its pictures.
fn nominal(size: Size) -> DVector<f64> {
    let f = 580.0 * size.width as f64 / 640.0;
    let center = [0.5 * size.width as f64 - 0.5, 0.5 * size.height as f64 - 0.5];
    let Disparity { c0, c1 } = Disparity::KINECT_V1;
    let place = [0.0, 0.0, 0.0, -0.025, 0.0, 0.0];
    DVector::from_iterator(UNKNOWNS, [f, f].into_iter().chain(center).chain(place).chain([c0, c1]))
}

fn camera(p: &DVector<f64>, size: Size) -> CameraModel {
    CameraModel {
        width: size.width,
        height: size.height,
        fx: p[0],
        fy: p[1],
        cx: p[2],
        cy: p[3],
        distortion: Distortion::None,
    }
}

fn color_from_depth(p: &DVector<f64>) -> Pose {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(p[4], p[5], p[6]));
    Pose::from_parts(Translation3::new(p[7], p[8], p[9]), turn)
}

/// One view's plane as a depth camera of these parameters sees it.
struct State {
    depth_from_color: Pose,
    /// Inverse depth at a pixel is `plane . (x, y, 1)`.
    plane: Vector3<f64>,
    camera: [f64; 4],
    disparity: Disparity,
}

impl State {
    fn new(p: &DVector<f64>, view: &PosedView) -> Self {
        let depth_from_color = color_from_depth(p).inverse();
        let depth_from_board = depth_from_color * view.camera_from_board;
        let normal = depth_from_board * Vector3::z();
        let reach = normal.dot(&depth_from_board.translation.vector);
        let [fx, fy, cx, cy] = [p[0], p[1], p[2], p[3]];
        let (a, b) = (normal.x / (reach * fx), normal.y / (reach * fy));
        Self {
            depth_from_color,
            plane: Vector3::new(a, b, normal.z / reach - a * cx - b * cy),
            camera: [fx, fy, cx, cy],
            disparity: Disparity { c0: p[10], c1: p[11] },
        }
    }

    fn predicted(&self, x: f64, y: f64) -> f64 {
        let inverse_depth = self.plane.x * x + self.plane.y * y + self.plane.z;
        (inverse_depth - self.disparity.c0) / self.disparity.c1
    }
}

/// The board in the depth picture as far as its inner corners reach: the squares around them are the
/// margin for a wrong start.
fn outline(board: &Board, view: &PosedView, state: &State, size: Size) -> Vec<[f64; 2]> {
    let s = board.square_m;
    let (right, bottom) = ((board.columns - 1) as f64 * s, (board.rows - 1) as f64 * s);
    let corners = [[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]];
    let [fx, fy, cx, cy] = state.camera;
    let depth_from_board = state.depth_from_color * view.camera_from_board;
    let seen = corners.map(|[x, y]| depth_from_board * Point3::new(x, y, 0.0));
    if seen.iter().any(|p| p.z < 0.05) {
        return Vec::new();
    }
    let limit = |v: f64, side: usize| v.clamp(-1.0, side as f64);
    seen.iter()
        .map(|p| [limit(fx * p.x / p.z + cx, size.width), limit(fy * p.y / p.z + cy, size.height)])
        .collect()
}

/// Whether a point lies in a convex polygon.
fn inside(polygon: &[[f64; 2]], x: f64, y: f64) -> bool {
    let side = |i: usize| {
        let ([ax, ay], [bx, by]) = (polygon[i], polygon[(i + 1) % polygon.len()]);
        (bx - ax) * (y - ay) - (by - ay) * (x - ax)
    };
    let mut sides = (0..polygon.len()).map(side);
    polygon.len() > 2 && (sides.clone().all(|s| s > 0.0) || sides.all(|s| s < 0.0))
}

/// Every [`STEP`]th pixel of the region with a disparity near the plane's; with `spread`, also of what
/// joins the region and is on the plane.
fn grow(
    disparity: &Image<u16>,
    region: Vec<[f64; 2]>,
    state: &State,
    tolerance: f64,
    spread: bool,
) -> Vec<(f64, f64, f64)> {
    let size = disparity.size();
    let (columns, rows) = (size.width.div_ceil(STEP), size.height.div_ceil(STEP));
    let on_plane = |i: usize| {
        let (x, y) = (i % columns * STEP, i / columns * STEP);
        let d = disparity.row(y)[x];
        let near = (f64::from(d) - state.predicted(x as f64, y as f64)).abs() < tolerance;
        (d != NO_DISPARITY && d != 0 && near).then_some((x as f64, y as f64, f64::from(d)))
    };
    let mut seen = vec![false; columns * rows];
    let mut queue: Vec<usize> = (0..columns * rows)
        .filter(|i| inside(&region, (i % columns * STEP) as f64, (i / columns * STEP) as f64))
        .collect();
    queue.iter().for_each(|&i| seen[i] = true);
    let mut found = Vec::new();
    while let Some(i) = queue.pop() {
        let Some(sample) = on_plane(i) else { continue };
        found.push(sample);
        let (x, y) = (i % columns, i / columns);
        let near = [
            (x > 0).then(|| i - 1),
            (x + 1 < columns).then_some(i + 1),
            (y > 0).then(|| i - columns),
            (y + 1 < rows).then_some(i + columns),
        ];
        for next in near.into_iter().flatten().filter(|_| spread) {
            if !std::mem::replace(&mut seen[next], true) {
                queue.push(next);
            }
        }
    }
    // In order of place: sums do not depend on how the region grew.
    found.sort_by(|a, b| (a.1, a.0).partial_cmp(&(b.1, b.0)).unwrap_or(std::cmp::Ordering::Equal));
    found
}

fn normal_equations(
    p: &DVector<f64>,
    views: &[DisparityView],
    samples: &[Sample],
    limit: f64,
) -> Normal {
    let states = |p: &DVector<f64>| -> Vec<State> {
        views.iter().map(|v| State::new(p, v.colored)).collect()
    };
    let here = states(p);
    // A residual is smooth in every parameter: forward differences of a millionth are good to 1e-6.
    let steps: Vec<f64> = p.iter().map(|v| 1e-6 * v.abs().max(0.1)).collect();
    let beside: Vec<Vec<State>> = (0..UNKNOWNS)
        .map(|k| {
            let mut q = p.clone();
            q[k] += steps[k];
            states(&q)
        })
        .collect();
    let mut normal = Normal::new(UNKNOWNS);
    let mut slope = DVector::zeros(UNKNOWNS);
    for sample in samples {
        let predicted = here[sample.number].predicted(sample.x, sample.y);
        for k in 0..UNKNOWNS {
            let moved = beside[k][sample.number].predicted(sample.x, sample.y);
            slope[k] = (moved - predicted) / steps[k];
        }
        normal.add(predicted - sample.d, &slope, limit);
    }
    normal
}

/// Disparities for each independent one.
fn weight(samples: &[Sample], views: &[DisparityView]) -> f64 {
    (samples.len() as f64 / (INDEPENDENT * views.len() as f64)).max(1.0)
}

/// The spread of sensors as further residuals, of a unit of disparity at one standard deviation.
fn add_spread(
    normal: &mut Normal,
    p: &DVector<f64>,
    nominal: &DVector<f64>,
    weight: f64,
    size: Size,
) {
    for k in 0..UNKNOWNS {
        let pixels = if k < 4 { size.width as f64 / 640.0 } else { 1.0 };
        let spread = pixels * SPREAD[k];
        let off = (p[k] - nominal[k]) / spread;
        normal.cost += weight * off * off;
        normal.gradient[k] += weight * off / spread;
        normal.matrix[(k, k)] += weight / (spread * spread);
    }
}

/// The correlation of the parameters must leave digits.
fn check_determined(normal: &Normal) -> Result<(), CalibrateError> {
    let scale: Vec<f64> = (0..UNKNOWNS).map(|i| normal.matrix[(i, i)].sqrt()).collect();
    let scaled = normal.matrix.map_with_location(|i, j, v| v / (scale[i] * scale[j]));
    let smallest = scaled.symmetric_eigenvalues().min();
    if smallest > 1e-10 {
        return Ok(());
    }
    let problem = "the boards do not determine the depth camera: show them at several slants, up to 50 \
                   degrees to each side, and at several distances";
    Err(CalibrateError::Data(problem.into()))
}

fn found(
    p: &DVector<f64>,
    views: &[DisparityView],
    samples: &[Sample],
    size: Size,
) -> FoundDepthCamera {
    let mut sums = vec![(0.0, 0usize); views.len()];
    for (number, view) in views.iter().enumerate() {
        let state = State::new(p, view.colored);
        for sample in samples.iter().filter(|s| s.number == number) {
            sums[number].0 += (sample.d - state.predicted(sample.x, sample.y)).powi(2);
            sums[number].1 += 1;
        }
    }
    let (square, count) = sums.iter().fold((0.0, 0), |a, s| (a.0 + s.0, a.1 + s.1));
    let root = |square: f64, count: usize| (square / count.max(1) as f64).sqrt();
    FoundDepthCamera {
        depth: camera(p, size),
        color_from_depth: color_from_depth(p),
        disparity: Disparity { c0: p[10], c1: p[11] },
        deviation_px: [0.0; 4],
        rms: root(square, count),
        views: sums.into_iter().map(|(square, count)| (root(square, count), count)).collect(),
    }
}

#[cfg(test)]
mod tests;
