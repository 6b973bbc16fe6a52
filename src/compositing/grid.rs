//! Shading at the grid points of the transfer, and which of them virtual objects change.

use super::planes::Planes;
use super::stage::ComposeInput;
use crate::geometry::{GBuffer, Origin};
use crate::image::Size;
use crate::lighting::ShLight;
use crate::math::sh;
use glam::Vec3;
use rayon::prelude::*;

/// Kinds of surface, as f32 so that kernels compare them lane by lane.
pub const NOTHING: f32 = 0.0;
pub const REAL: f32 = 1.0;
pub const VIRTUAL: f32 = 2.0;

/// R below this share of the mean shading is ringing of the harmonics or noise; ratios of such
/// values mean nothing.
const FLOOR_SHARE: f32 = 0.08;

/// Visibility of a virtual point: shading by unoccluded shading, both raised by this share of the
/// mean shading, so that the quotient stays finite on the dark side.
const VISIBILITY_OFFSET_SHARE: f32 = 0.05;

/// Visibility above this is noise.
pub const MAX_VISIBILITY: f32 = 8.0;

/// Kind of surface that a pixel of the merged buffer shows.
#[inline(always)]
pub fn kind_of(origin: Origin, depth_m: f32) -> f32 {
    match origin {
        Origin::Virtual => VIRTUAL,
        Origin::None => NOTHING,
        _ if depth_m > 0.0 => REAL,
        _ => NOTHING,
    }
}

/// A light made ready for dot products with transfer, and for unoccluded surfaces.
#[derive(Clone, Debug)]
pub struct Lamp {
    /// One channel where the three are equal.
    pub channels: usize,
    /// Coefficients of each channel, zero beyond the light's bands.
    pub coefficients: [[f32; sh::MAX_COEFFICIENTS]; 3],
    /// Polynomial of the normal for each channel: bands 0 to 2 times A_l / pi.
    pub polynomial: [[f32; 9]; 3],
    pub floor: f32,
    pub visibility_offset: f32,
}

impl Lamp {
    pub fn new(light: &ShLight) -> Self {
        let mut lamp = Self {
            channels: 1,
            coefficients: [[0.0; sh::MAX_COEFFICIENTS]; 3],
            polynomial: [[0.0; 9]; 3],
            floor: 0.0,
            visibility_offset: 0.0,
        };
        for (i, &rgb) in light.coefficients.iter().take(sh::MAX_COEFFICIENTS).enumerate() {
            // A light that is not finite is no light.
            let rgb = rgb.map(|v| if v.is_finite() { v } else { 0.0 });
            if rgb[1] != rgb[0] || rgb[2] != rgb[0] {
                lamp.channels = 3;
            }
            for c in 0..3 {
                lamp.coefficients[c][i] = rgb[c];
            }
        }
        lamp.polynomial = lamp.coefficients.map(|l| unoccluded_polynomial(&l));
        let y00 = sh::basis(Vec3::Z, 1)[0];
        let mean = y00 * lamp.coefficients.map(|l| l[0]).into_iter().fold(0.0, f32::max);
        lamp.floor = (FLOOR_SHARE * mean).max(1e-6);
        lamp.visibility_offset = (VISIBILITY_OFFSET_SHARE * mean).max(1e-6);
        lamp
    }

    /// Shading from transfer, per channel, not below the floor. NaN gives the floor.
    #[inline(always)]
    fn shade(&self, transfer: &[f32]) -> [f32; 3] {
        let mut out = [self.floor; 3];
        for c in 0..self.channels {
            out[c] = dot(transfer, &self.coefficients[c]).max(self.floor);
        }
        out
    }

    /// Shading of an unoccluded surface from bands 0 to 2 (band 3 is zero, the fifth is below
    /// 5 %), per channel, not negative.
    #[inline(always)]
    pub fn unoccluded(&self, n: Vec3) -> [f32; 3] {
        let terms = [
            1.0,
            n.y,
            n.z,
            n.x,
            n.x * n.y,
            n.y * n.z,
            3.0 * n.z * n.z - 1.0,
            n.x * n.z,
            n.x * n.x - n.y * n.y,
        ];
        let mut out = [0.0; 3];
        for c in 0..self.channels {
            let sum: f32 = terms.iter().zip(&self.polynomial[c]).map(|(t, p)| t * p).sum();
            out[c] = sum.max(0.0);
        }
        out
    }

    /// Part of the unoccluded light that arrives.
    #[inline(always)]
    fn visibility(&self, shading: f32, unoccluded: f32) -> f32 {
        let offset = self.visibility_offset;
        ((shading + offset) / (unoccluded + offset)).min(MAX_VISIBILITY)
    }

    /// Inverse of [`Self::visibility`].
    #[inline(always)]
    pub fn shading(&self, visibility: f32, unoccluded: f32) -> f32 {
        let offset = self.visibility_offset;
        (visibility * (unoccluded + offset) - offset).max(self.floor)
    }
}

fn unoccluded_polynomial(light: &[f32; sh::MAX_COEFFICIENTS]) -> [f32; 9] {
    // Constants of the basis in the order of its indices.
    const BASIS: [f64; 9] = [
        0.282_094_791_773_878_14,
        0.488_602_511_902_919_9,
        0.488_602_511_902_919_9,
        0.488_602_511_902_919_9,
        1.092_548_430_592_079,
        1.092_548_430_592_079,
        0.315_391_565_252_520_05,
        1.092_548_430_592_079,
        0.546_274_215_296_039_6,
    ];
    std::array::from_fn(|i| {
        let band = i.isqrt();
        let factor = sh::CLAMPED_COSINE[band] / std::f64::consts::PI * BASIS[i];
        (f64::from(light[i]) * factor) as f32
    })
}

/// Dot product with the first coefficients of a light; 16 at a time are summed as a tree.
#[inline(always)]
fn dot(transfer: &[f32], light: &[f32; sh::MAX_COEFFICIENTS]) -> f32 {
    let (blocks, rest) = transfer.as_chunks::<16>();
    let mut sum = 0.0;
    for (block, light) in blocks.iter().zip(light.chunks_exact(16)) {
        let mut lanes = [0.0; 16];
        for k in 0..16 {
            lanes[k] = block[k] * light[k];
        }
        let mut half = 8;
        while half > 0 {
            for k in 0..half {
                lanes[k] += lanes[k + half];
            }
            half /= 2;
        }
        sum += lanes[0];
    }
    let light = &light[blocks.len() * 16..];
    sum + rest.iter().zip(light).map(|(t, l)| t * l).sum::<f32>()
}

/// Planes of the grid and of the up-sampled shading: R, R' (or the visibility of virtual points)
/// and the bounce.
#[derive(Clone, Copy, Debug, Default)]
pub struct Layout {
    /// 1 or 3.
    pub channels: usize,
    pub bounce: bool,
}

impl Layout {
    pub fn count(self) -> usize {
        2 * self.channels + if self.bounce { 3 } else { 0 }
    }

    pub fn real(self, channel: usize) -> usize {
        channel.min(self.channels - 1)
    }

    pub fn merged(self, channel: usize) -> usize {
        self.channels + channel.min(self.channels - 1)
    }

    pub fn bounce(self, channel: usize) -> usize {
        2 * self.channels + channel
    }
}

/// Everything the filters need at the grid points.
#[derive(Clone, Debug, Default)]
pub struct ShadingGrid {
    pub step: usize,
    pub layout: Layout,
    pub planes: Planes,
    /// One plane of kinds, and where the grid is coarser than the image depth and normals.
    pub kind: Planes,
    pub surface: Planes,
    /// Pixel columns and rows of the grid points.
    pub u: Vec<f32>,
    pub v: Vec<f32>,
    /// Points that virtual objects change, then widened by two points in x and y.
    changed: Vec<u8>,
    widened: Vec<u8>,
}

/// Shading planes of virtual points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VirtualShading {
    /// R' itself.
    Plain,
    /// R' by the unoccluded shading of the point's normal.
    Visibility,
}

impl ShadingGrid {
    pub fn size(&self) -> Size {
        self.planes.size()
    }

    /// Shading of every grid point. The maps belong to the buffers of `input`.
    pub fn evaluate(&mut self, input: &ComposeInput, lamp: &Lamp, virtual_shading: VirtualShading) {
        let map = input.real_transfer;
        let image = input.merged.size();
        self.step = map.step;
        self.layout = Layout { channels: lamp.channels, bounce: input.indirect.is_some() };
        self.planes.reshape(map.grid, self.layout.count());
        self.kind.reshape(map.grid, 1);
        self.surface.reshape(if map.step > 1 { map.grid } else { Size::default() }, 4);
        self.changed.resize(map.grid.pixels(), 0);
        self.u.clear();
        self.v.clear();
        if map.grid.pixels() == 0 || image.pixels() == 0 {
            return;
        }
        self.u.extend((0..map.grid.width).map(|i| map.pixel(i, 0, image).0 as f32));
        self.v.extend((0..map.grid.height).map(|j| map.pixel(0, j, image).1 as f32));
        let row = RowEvaluation { input, lamp, virtual_shading, layout: self.layout };
        let changed = self.changed.par_chunks_mut(map.grid.width);
        self.planes
            .par_rows_mut()
            .zip(self.kind.par_rows_mut())
            .zip(changed)
            .for_each(|(((j, planes), (_, kind)), changed)| row.run(j, planes, kind, changed));
        if map.step > 1 {
            self.surface.par_rows_mut().for_each(|(j, out)| gather_surface(input, j, out));
        }
        self.widen();
    }

    /// Marks everything as changed, so that the filters run everywhere.
    pub fn touch_all(&mut self) {
        self.widened.fill(1);
    }

    /// Points within two of a changed one: those whose filtered value a changed pixel may read.
    pub fn widened_row(&self, j: usize) -> &[u8] {
        let width = self.size().width;
        &self.widened[j * width..(j + 1) * width]
    }

    fn widen(&mut self) {
        let Size { width, height } = self.size();
        self.widened.resize(width * height, 0);
        let changed = &self.changed;
        self.widened.par_chunks_mut(width.max(1)).enumerate().for_each(|(j, out)| {
            out.fill(0);
            for row in j.saturating_sub(2)..(j + 3).min(height) {
                let row = &changed[row * width..(row + 1) * width];
                for shift in 0..3.min(width) {
                    let far = width - shift;
                    out[shift..].iter_mut().zip(&row[..far]).for_each(|(o, c)| *o |= c);
                    out[..far].iter_mut().zip(&row[shift..]).for_each(|(o, c)| *o |= c);
                }
            }
        });
    }
}

struct RowEvaluation<'a> {
    input: &'a ComposeInput<'a>,
    lamp: &'a Lamp,
    virtual_shading: VirtualShading,
    layout: Layout,
}

impl RowEvaluation<'_> {
    fn run(&self, j: usize, planes: &mut [f32], kind: &mut [f32], changed: &mut [u8]) {
        let width = kind.len();
        for i in 0..width {
            let (x, y) = self.input.merged_transfer.pixel(i, j, self.input.merged.size());
            kind[i] = kind_of(self.input.merged.origin[(x, y)], self.input.merged.depth_m[(x, y)]);
        }
        evaluate_row(self, j, planes, kind, changed);
    }

    #[inline(always)]
    fn body(&self, j: usize, planes: &mut [f32], kind: &[f32], changed: &mut [u8]) {
        let (width, layout) = (kind.len(), self.layout);
        for i in 0..width {
            let real = self.lamp.shade(self.input.real_transfer.at(i, j));
            let mut merged = self.lamp.shade(self.input.merged_transfer.at(i, j));
            let is_virtual = kind[i] == VIRTUAL;
            let mut differs = is_virtual | (real != merged);
            if is_virtual && self.virtual_shading == VirtualShading::Visibility {
                let (x, y) = self.input.merged_transfer.pixel(i, j, self.input.merged.size());
                let unoccluded = self.lamp.unoccluded(self.input.merged.normals.at(x, y));
                for c in 0..layout.channels {
                    merged[c] = self.lamp.visibility(merged[c], unoccluded[c]);
                }
            }
            for c in 0..layout.channels {
                planes[layout.real(c) * width + i] = real[c];
                planes[layout.merged(c) * width + i] = merged[c];
            }
            if let Some(indirect) = self.input.indirect {
                let light = indirect.rgb[j * width + i];
                for c in 0..3 {
                    // max turns NaN into 0
                    let light = light[c].max(0.0).clamp(0.0, f32::MAX);
                    differs |= light != 0.0;
                    planes[layout.bounce(c) * width + i] = light;
                }
            }
            changed[i] = u8::from(differs);
        }
    }
}

#[multiversion::multiversion(targets(
    "x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma+bmi2",
    "x86_64+avx2+fma+bmi2"
))]
fn evaluate_row(
    row: &RowEvaluation,
    j: usize,
    planes: &mut [f32],
    kind: &[f32],
    changed: &mut [u8],
) {
    row.body(j, planes, kind, changed);
}

/// Depth and normals of the pixels that grid points stand at.
fn gather_surface(input: &ComposeInput, j: usize, out: &mut [f32]) {
    let merged: &GBuffer = input.merged;
    let width = out.len() / 4;
    for i in 0..width {
        let (x, y) = input.merged_transfer.pixel(i, j, merged.size());
        let n = merged.normals.at(x, y);
        for (plane, value) in [merged.depth_m[(x, y)], n.x, n.y, n.z].into_iter().enumerate() {
            out[plane * width + i] = value;
        }
    }
}
