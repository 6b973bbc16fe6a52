//! Depth cameras that deliver disparities.

use serde::{Deserialize, Serialize};

/// `z_m = 1 / (c0 + c1 d)` of a stored disparity d: a Kinect v1's raw values, which fall with distance
/// of the reference pattern (Herrera, Kannala, Heikkila 2012, equation 4, without its spatial term).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Disparity {
    /// 1/metre.
    pub c0: f64,
    /// 1/metre per unit of disparity.
    pub c1: f64,
}

impl Disparity {
    /// Nominal Kinect v1.
    pub const KINECT_V1: Self = Self { c0: 3.11, c1: -0.00285 };

    /// Missing (0.0) where the disparity is that of no point in front of the camera.
    pub fn depth_m(&self, disparity: f64) -> f64 {
        let inverse = self.inverse_depth(disparity);
        // Farther than 100 m is noise about infinity.
        if inverse > 0.01 { 1.0 / inverse } else { 0.0 }
    }

    /// 1/metre.
    pub fn inverse_depth(&self, disparity: f64) -> f64 {
        self.c0 + self.c1 * disparity
    }

    /// The disparity of a point at this depth, not rounded.
    pub fn of_depth(&self, depth_m: f64) -> f64 {
        (1.0 / depth_m - self.c0) / self.c1
    }

    pub(super) fn problems(&self, found: &mut Vec<String>) {
        if !(self.c0.is_finite() && self.c1.is_finite() && self.c1 != 0.0) {
            found.push(format!("disparity coefficients {} {}", self.c0, self.c1));
        }
    }
}
