//! Lens distortion.

use kornia_imgproc::calibration::CameraIntrinsic;
use kornia_imgproc::calibration::distortion::{PolynomialDistortion, distort_point_polynomial};
use serde::{Deserialize, Serialize};

/// Lens distortion, in OpenCV's definitions and order of coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "model", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Distortion {
    #[default]
    None,
    /// Brown-Conrady ("plumb bob").
    Brown { k1: f64, k2: f64, p1: f64, p2: f64, k3: f64 },
    /// Brown-Conrady with a denominator ("rational polynomial").
    Rational { k1: f64, k2: f64, p1: f64, p2: f64, k3: f64, k4: f64, k5: f64, k6: f64 },
    /// Equidistant fish-eye (Kannala and Brandt 2006): distance from the axis
    /// `angle (1 + k1 angle^2 + k2 angle^4 + k3 angle^6 + k4 angle^8)`.
    KannalaBrandt { k1: f64, k2: f64, k3: f64, k4: f64 },
}

impl Distortion {
    pub fn is_none(&self) -> bool {
        *self == Self::None
    }

    /// A distorted point of the image plane at z = 1 from an ideal one.
    pub fn distort(&self, x: f64, y: f64) -> (f64, f64) {
        match self.model() {
            Lens::Polynomial(p) => {
                let unit = CameraIntrinsic { fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
                distort_point_polynomial(x, y, &unit, &p)
            }
            Lens::Equidistant(k) => {
                let r = x.hypot(y);
                // on the axis the quotient is 1 to the last digit, or 0 / 0
                let scale = if r > 1e-8 { equidistant(&k, r.atan()).0 / r } else { 1.0 };
                (x * scale, y * scale)
            }
        }
    }

    /// The ideal point of a distorted one, by Newton's method. `None` where the distortion folds the
    /// image so that there is no nearby answer, and for what a fish-eye sees beside or behind itself.
    pub fn undistort(&self, xd: f64, yd: f64) -> Option<(f64, f64)> {
        match self.model() {
            Lens::Polynomial(_) => self.undistort_plane(xd, yd),
            Lens::Equidistant(k) => {
                let rd = xd.hypot(yd);
                let angle = equidistant_angle(&k, rd)?;
                let scale = if rd > 1e-8 { angle.tan() / rd } else { 1.0 };
                Some((xd * scale, yd * scale))
            }
        }
    }

    fn undistort_plane(&self, xd: f64, yd: f64) -> Option<(f64, f64)> {
        const STEP: f64 = 1e-6;
        const CLOSE: f64 = 1e-9;
        let (mut x, mut y) = (xd, yd);
        for _ in 0..20 {
            let (ex, ey) = self.distort(x, y);
            let (rx, ry) = (xd - ex, yd - ey);
            if rx.abs().max(ry.abs()) < CLOSE {
                return Some((x, y));
            }
            let ((ax, ay), (bx, by)) = (self.distort(x + STEP, y), self.distort(x, y + STEP));
            let (xx, yx) = ((ax - ex) / STEP, (ay - ey) / STEP);
            let (xy, yy) = ((bx - ex) / STEP, (by - ey) / STEP);
            let determinant = xx * yy - xy * yx;
            if determinant.is_nan() || determinant < 1e-3 {
                return None;
            }
            x += (yy * rx - xy * ry) / determinant;
            y += (xx * ry - yx * rx) / determinant;
        }
        None
    }

    /// Distance from the axis of the distorted point, from that of the ideal one, without the parts of
    /// a model that are not symmetric.
    pub(in crate::capture) fn radial(&self, r: f64) -> f64 {
        match self.model() {
            Lens::Equidistant(k) => equidistant(&k, r.atan()).0,
            Lens::Polynomial(p) => {
                let r2 = r * r;
                let above = 1.0 + r2 * (p.k1 + r2 * (p.k2 + r2 * p.k3));
                r * above / (1.0 + r2 * (p.k4 + r2 * (p.k5 + r2 * p.k6)))
            }
        }
    }

    fn model(&self) -> Lens {
        let zero = PolynomialDistortion::default();
        Lens::Polynomial(match *self {
            Self::None => zero,
            Self::Brown { k1, k2, p1, p2, k3 } => {
                PolynomialDistortion { k1, k2, k3, p1, p2, ..zero }
            }
            Self::Rational { k1, k2, p1, p2, k3, k4, k5, k6 } => {
                PolynomialDistortion { k1, k2, k3, k4, k5, k6, p1, p2 }
            }
            Self::KannalaBrandt { k1, k2, k3, k4 } => return Lens::Equidistant([k1, k2, k3, k4]),
        })
    }

    pub(super) fn coefficients(&self) -> Vec<f64> {
        match *self {
            Self::None => vec![],
            Self::Brown { k1, k2, p1, p2, k3 } => vec![k1, k2, p1, p2, k3],
            Self::Rational { k1, k2, p1, p2, k3, k4, k5, k6 } => {
                vec![k1, k2, p1, p2, k3, k4, k5, k6]
            }
            Self::KannalaBrandt { k1, k2, k3, k4 } => vec![k1, k2, k3, k4],
        }
    }
}

enum Lens {
    Polynomial(PolynomialDistortion),
    Equidistant([f64; 4]),
}

/// Distance from the axis of a ray at `angle`, and its derivative.
fn equidistant(k: &[f64; 4], angle: f64) -> (f64, f64) {
    let a2 = angle * angle;
    let value = 1.0 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3])));
    let slope = 1.0 + a2 * (3.0 * k[0] + a2 * (5.0 * k[1] + a2 * (7.0 * k[2] + a2 * 9.0 * k[3])));
    (angle * value, slope)
}

/// The angle below 89 degrees whose distance from the axis is `rd`, without a fold before it.
fn equidistant_angle(k: &[f64; 4], rd: f64) -> Option<f64> {
    const LARGEST: f64 = 89.0 / 180.0 * std::f64::consts::PI;
    let mut angle = rd.min(LARGEST);
    for _ in 0..30 {
        let (found, slope) = equidistant(k, angle);
        let rest = rd - found;
        if rest.abs() < 1e-12 {
            return Some(angle).filter(|a| (0.0..LARGEST).contains(a) && slope > 1e-3);
        }
        if slope.is_nan() || slope < 1e-3 {
            return None;
        }
        angle = (angle + rest / slope).clamp(0.0, 1.6);
    }
    None
}
