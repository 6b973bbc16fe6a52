//! Parameters of the transfer's shaders.

use crate::gpu::{ViewUniform, uniform};
use crate::image::Size;
use crate::math::sh::{self, MAX_BANDS};
use crate::math::{View, affine_from_pose};
use crate::transfer::{DirectionSet, TransferParams};
use bytemuck::Zeroable;
use glam::{Affine3A, Mat4};

/// Views that samples are looked up in at most: the main one and those at its side.
pub const MAX_VIEWS: usize = 8;

uniform! {
    pub struct LimitsUniform {
        view: ViewUniform,
        bias_m: f32,
        first: u32,
        extent: u32,
        pad: u32,
    }
}

uniform! {
    pub struct TransferView {
        view_from_main: [[f32; 4]; 4],
        view_from_world: [[f32; 4]; 4],
        world_from_view: [[f32; 4]; 4],
        scale: [f32; 2],
        inverse_scale: [f32; 2],
        centre: [f32; 2],
        size: [u32; 2],
        first: u32,
        perspective: u32,
        pad0: u32,
        pad1: u32,
    }
}

uniform! {
    pub struct TransferUniform {
        views: [TransferView; MAX_VIEWS],
        lobe: [[f32; 4]; MAX_BANDS * MAX_BANDS / 4],
        grid: [u32; 2],
        step: u32,
        tile: u32,
        directions: u32,
        samples: u32,
        chi: f32,
        bias_m: f32,
        farthest_m: f32,
        strength: f32,
        pad0: u32,
        pad1: u32,
    }
}

impl TransferView {
    /// `first`: of its pixels among those of all views.
    pub fn new(view: &View, main: &View, first: usize) -> Self {
        let from_main = affine_from_pose(&(view.world_from_view.inverse() * main.world_from_view));
        let columns = |a: Affine3A| Mat4::from(a).to_cols_array_2d();
        let (scale, centre) = view.scale_and_centre();
        let size = view.size();
        Self {
            view_from_main: columns(from_main),
            view_from_world: columns(view.view_from_world_f32()),
            world_from_view: columns(view.world_from_view_f32()),
            scale: scale.to_array(),
            inverse_scale: (1.0 / scale).to_array(),
            centre: centre.to_array(),
            size: [size.width as u32, size.height as u32],
            first: first as u32,
            perspective: u32::from(view.is_perspective()),
            pad0: 0,
            pad1: 0,
        }
    }
}

impl TransferUniform {
    /// For results on `grid`, without views. `strength` is that of the bounce.
    pub fn new(params: &TransferParams, set: &DirectionSet, grid: Size, strength: f32) -> Self {
        Self {
            views: [TransferView::zeroed(); MAX_VIEWS],
            lobe: bytemuck::cast(sh::lobe_factors()),
            grid: [grid.width as u32, grid.height as u32],
            step: params.subsampling as u32,
            tile: set.tile() as u32,
            directions: set.len() as u32,
            samples: params.samples as u32,
            chi: set.chi,
            bias_m: params.bias_m,
            farthest_m: set.farthest_m,
            strength,
            pad0: 0,
            pad1: 0,
        }
    }
}
