//! How a camera turns light into codes.

use serde::{Deserialize, Serialize};

/// What was measured of a colour camera's response to light. Absent parts are taken as ideal: codes as
/// sRGB, no fall-off, sRGB primaries.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Photometry {
    /// Linear sRGB is this matrix times the camera's linear RGB; by rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color_matrix: Option<[[f64; 3]; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vignetting: Option<Vignetting>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub response: Option<Response>,
}

/// Relative light of each of the 256 codes of a channel, rising, with 1 at code 255.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Response {
    pub red: Vec<f64>,
    pub green: Vec<f64>,
    pub blue: Vec<f64>,
}

/// Light that arrives away from the axis, as a share of what arrives on it:
/// `exp(a r^2 + b r^4 + c r^6)`, where r is the distance from `center`, 1 at half the diagonal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vignetting {
    /// Shares of width and height of the recorded picture.
    pub center: [f64; 2],
    pub falloff: [f64; 3],
}

impl Response {
    pub fn channels(&self) -> [&[f64]; 3] {
        [&self.red, &self.green, &self.blue]
    }

    fn is_usable(&self) -> bool {
        self.channels().iter().all(|curve| {
            let rises = curve.windows(2).all(|w| w[0] <= w[1]);
            curve.len() == 256 && rises && curve[0] >= 0.0 && (curve[255] - 1.0).abs() < 1e-6
        })
    }
}

impl Vignetting {
    /// Square of the distance from the axis, of a pixel in a picture of this size.
    pub fn radius2(&self, x: f64, y: f64, width: usize, height: usize) -> f64 {
        let (w, h) = (width as f64, height as f64);
        let dx = x + 0.5 - self.center[0] * w;
        let dy = y + 0.5 - self.center[1] * h;
        (dx * dx + dy * dy) / (0.25 * (w * w + h * h))
    }

    /// Share of light at a squared distance.
    pub fn share(&self, radius2: f64) -> f64 {
        let [a, b, c] = self.falloff;
        (radius2 * (a + radius2 * (b + radius2 * c))).exp()
    }

    /// From a twentieth to four times the light wherever the picture reaches: anything else was fitted
    /// to something that is no lens.
    fn is_usable(&self) -> bool {
        let [x, y] = self.center;
        let on_picture = [x, y].iter().all(|v| (0.0..=1.0).contains(v));
        // At most the farthest corner's, for any shape of picture.
        let reach2 = 4.0 * x.max(1.0 - x).max(y.max(1.0 - y)).powi(2);
        let shares = (0..=64).map(|i| self.share(reach2 * f64::from(i) / 64.0));
        on_picture && shares.into_iter().all(|share| (0.05..=4.0).contains(&share))
    }
}

impl Photometry {
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    pub(super) fn problems(&self, found: &mut Vec<String>) {
        if self.color_matrix.is_some_and(|m| !m.as_flattened().iter().all(|v| v.is_finite())) {
            found.push("color_matrix is not finite".into());
        }
        if self.vignetting.is_some_and(|v| !v.is_usable()) {
            found.push(
                "vignetting leaves less than a twentieth or more than 4 times the light".into(),
            );
        }
        if self.response.as_ref().is_some_and(|r| !r.is_usable()) {
            found.push("response is not three rising curves of 256 values that end at 1".into());
        }
    }
}
