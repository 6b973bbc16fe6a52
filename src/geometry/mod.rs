//! Geometry buffers, and the image-space filters that merge the model with the newest depth.

mod dyngeo;
mod median;
mod normals;

pub use dyngeo::DynGeo;
#[cfg(feature = "gpu")]
pub(crate) use median::window_taps;
#[cfg(feature = "gpu")]
pub(crate) use normals::{MAX_SLOPE as NORMAL_MAX_SLOPE, REACH as NORMAL_REACH};

use crate::image::{Image, NormalImage, Size};
use crate::math::View;

/// What a pixel of a geometry buffer shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Origin {
    #[default]
    None = 0,
    /// Ray-cast from the volume.
    Model = 1,
    /// Taken from the newest depth picture.
    Sensor = 2,
    /// A virtual object.
    Virtual = 3,
}

/// Depth and normals of the surfaces seen in a view.
#[derive(Clone, Debug)]
pub struct GBuffer {
    pub view: View,
    /// z-depth in metres; missing = 0.0.
    pub depth_m: Image<f32>,
    /// Unit normals in world axes, facing the view; zero where missing.
    pub normals: NormalImage,
    pub origin: Image<Origin>,
}

impl GBuffer {
    pub fn empty(view: View) -> Self {
        let size = view.size();
        Self {
            view,
            depth_m: Image::new(size, 0.0),
            normals: NormalImage::new(size),
            origin: Image::new(size, Origin::None),
        }
    }

    pub fn size(&self) -> Size {
        self.depth_m.size()
    }

    /// Takes over everything, keeping memory where the size allows.
    pub fn copy_from(&mut self, other: &Self) {
        self.set_view(other.view);
        self.depth_m.as_mut_slice().copy_from_slice(other.depth_m.as_slice());
        self.normals.x.as_mut_slice().copy_from_slice(other.normals.x.as_slice());
        self.normals.y.as_mut_slice().copy_from_slice(other.normals.y.as_slice());
        self.normals.z.as_mut_slice().copy_from_slice(other.normals.z.as_slice());
        self.origin.as_mut_slice().copy_from_slice(other.origin.as_slice());
    }

    /// Takes another view, keeping memory where the size allows. Contents are stale until written.
    pub fn set_view(&mut self, view: View) {
        let size = view.size();
        self.view = view;
        self.depth_m.reshape(size, 0.0);
        self.normals.reshape(size);
        self.origin.reshape(size, Origin::None);
    }
}

/// DynGeo stage: Gruber et al. 2015, Eq. 1-5, with the parameters of its Sec. 6.1.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DynGeoParams {
    /// Merge sensor depth into the model's depth (D'); off means the model's depth alone.
    pub merge: bool,
    /// Joint bilateral median (D'').
    pub smooth: bool,
    /// Plain median (D''').
    pub denoise: bool,
    /// Window k of D', pixels. A window reaches k / 2 pixels to each side.
    pub merge_window: usize,
    /// Window k of D'', pixels.
    pub smooth_window: usize,
    /// Window k of D''', pixels.
    pub denoise_window: usize,
    /// D' and D'' look at taps x taps pixels of their window; an even number leaves out the pixel
    /// itself.
    pub taps: usize,
    /// lambda_I, 8-bit steps of encoded intensity; positive.
    pub intensity_threshold: f32,
    /// lambda_D; also how far from the result the model's depth may be to lend its normal.
    pub depth_threshold_m: f32,
}

impl Default for DynGeoParams {
    fn default() -> Self {
        Self {
            merge: true,
            smooth: true,
            denoise: true,
            merge_window: 20,
            smooth_window: 8,
            denoise_window: 2,
            taps: 5,
            intensity_threshold: 7.0,
            depth_threshold_m: 0.05,
        }
    }
}
