//! The Rendering stage: what goes in, and the order of its passes.

use super::encode::SRGB;
use super::filter_gauss::BicubicGauss;
use super::grid::{Lamp, REAL, ShadingGrid, VirtualShading};
use super::pixels::Composer;
use super::planes::Planes;
use super::smooth::{Likeness, smooth};
use super::upsample::{Between, between, upsample};
use super::{CompositingParams, Compositor, Upsampling, VirtualLayer};
use crate::capture::RgbdFrame;
use crate::geometry::GBuffer;
use crate::image::{Image, Size};
use crate::lighting::ShLight;
use crate::math::color::{LINEAR_FROM_SRGB8, luminance};
use crate::transfer::{IndirectMap, TransferMap};

/// One frame with everything that is known about it. All images have the camera's size, all maps
/// one grid.
#[derive(Clone, Copy, Debug)]
pub struct ComposeInput<'a> {
    pub frame: &'a RgbdFrame,
    /// Geometry without and with virtual objects, seen by the (perspective) camera.
    pub real: &'a GBuffer,
    pub merged: &'a GBuffer,
    pub layer: &'a VirtualLayer,
    pub real_transfer: &'a TransferMap,
    pub merged_transfer: &'a TransferMap,
    /// Light of one bounce that virtual objects bring or receive (Eq. 14); none, no bounce.
    pub indirect: Option<&'a IndirectMap>,
    /// Times `mean_albedo`.
    pub light: &'a ShLight,
    pub mean_albedo: f32,
}

/// R and R' of every pixel, for looking at: 1 where there is no surface.
#[derive(Clone, Debug, Default)]
pub struct ShadingBuffers {
    pub real: Image<[f32; 3]>,
    pub merged: Image<[f32; 3]>,
}

/// Rendering stage. Keeps its memory from frame to frame.
#[derive(Clone, Debug)]
pub struct CompositingStage {
    params: CompositingParams,
    grid: ShadingGrid,
    smoothed: Planes,
    full: Planes,
    columns: Vec<Between>,
    rows: Vec<Between>,
    bicubic_gauss: BicubicGauss,
    virtual_light: Image<[f32; 3]>,
}

impl CompositingStage {
    pub fn new(params: &CompositingParams) -> Self {
        Self {
            params: params.clone(),
            grid: ShadingGrid::default(),
            smoothed: Planes::default(),
            full: Planes::default(),
            columns: Vec::new(),
            rows: Vec::new(),
            bicubic_gauss: BicubicGauss::default(),
            virtual_light: Image::default(),
        }
    }

    /// The camera image with virtual objects, 8-bit sRGB. Panics where sizes or grids of the input
    /// differ.
    pub fn compose(&mut self, input: &ComposeInput, out: &mut Image<[u8; 3]>) {
        check(input);
        let lamp = Lamp::new(input.light);
        self.shade(input, &lamp, false);
        let size = input.merged.size();
        out.reshape(size, [0; 3]);
        let mut virtual_light = std::mem::take(&mut self.virtual_light);
        virtual_light.reshape(size, [0.0; 3]);
        let composer = self.composer(input, &lamp);
        {
            use rayon::prelude::*;
            virtual_light.par_rows_mut().for_each(|(y, row)| composer.virtual_row(y, row));
            out.par_rows_mut().for_each(|(y, row)| composer.row(y, &virtual_light, row));
        }
        self.virtual_light = virtual_light;
    }

    /// R and R' at full resolution, everywhere.
    pub fn shading_buffers(&mut self, input: &ComposeInput) -> ShadingBuffers {
        check(input);
        let lamp = Lamp::new(input.light);
        self.shade(input, &lamp, true);
        let size = input.merged.size();
        let composer = self.composer(input, &lamp);
        let mut out =
            ShadingBuffers { real: Image::new(size, [1.0; 3]), merged: Image::new(size, [1.0; 3]) };
        for y in 0..size.height {
            for x in 0..size.width {
                if input.merged.depth_m[(x, y)] > 0.0 {
                    let real = |c| composer.shading.at(composer.layout.real(c), x, y);
                    out.real[(x, y)] = std::array::from_fn(real);
                    out.merged[(x, y)] = composer.merged_shading(x, y);
                }
            }
        }
        out
    }

    /// Fills the full-resolution shading: `self.smoothed` at step 1, else `self.full`.
    fn shade(&mut self, input: &ComposeInput, lamp: &Lamp, everywhere: bool) {
        self.grid.evaluate(input, lamp, self.virtual_shading(input));
        if everywhere {
            self.grid.touch_all();
        }
        let likeness = Likeness::new(&self.params);
        let size = input.merged.size();
        if size.pixels() == 0 {
            return;
        }
        if self.grid.step == 1 {
            smooth(&self.grid, input.merged, likeness, &mut self.smoothed);
            return;
        }
        between(&self.grid.u, size.width, &mut self.columns);
        between(&self.grid.v, size.height, &mut self.rows);
        let axes = (&self.columns[..], &self.rows[..]);
        match self.params.upsampling {
            Upsampling::JointBilateral => {
                smooth(&self.grid, input.merged, likeness, &mut self.smoothed);
                upsample(&self.grid, &self.smoothed, input.merged, likeness, axes, &mut self.full);
            }
            Upsampling::BicubicGauss => {
                let radius = self.params.gauss_radius;
                self.bicubic_gauss.run(&self.grid, size, axes, radius, &mut self.full);
            }
        }
    }

    /// Blind up-sampling mixes real and virtual points, whose planes must then mean the same.
    fn virtual_shading(&self, input: &ComposeInput) -> VirtualShading {
        let blind = self.params.upsampling == Upsampling::BicubicGauss;
        if blind && input.real_transfer.step > 1 {
            VirtualShading::Plain
        } else {
            VirtualShading::Visibility
        }
    }

    fn composer<'a>(&'a self, input: &'a ComposeInput<'a>, lamp: &'a Lamp) -> Composer<'a> {
        Composer {
            input,
            params: &self.params,
            lamp,
            layout: self.grid.layout,
            shading: if self.grid.step == 1 { &self.smoothed } else { &self.full },
            virtual_shading: self.virtual_shading(input),
            encoder: &SRGB,
            decoder: &LINEAR_FROM_SRGB8,
            exposure: match self.params.compositor {
                Compositor::Ratio => 1.0,
                Compositor::Difference => self.params.key / self.log_mean_of_real(),
            },
        }
    }

    /// Log-average of R (Reinhard et al. 2002, Eq. 1).
    fn log_mean_of_real(&self) -> f32 {
        let size = self.grid.size();
        let every = log_average_step(size);
        let (mut sum, mut count) = (0.0, 0usize);
        for j in (0..size.height).step_by(every) {
            for i in (0..size.width).step_by(every) {
                if self.grid.kind.at(0, i, j) == REAL {
                    let real = |c| self.grid.planes.at(self.grid.layout.real(c), i, j);
                    sum += f64::from(luminance([real(0), real(1), real(2)])).ln();
                    count += 1;
                }
            }
        }
        if count > 0 { (sum / count as f64).exp() as f32 } else { 1.0 }
    }
}

/// Columns and rows from one grid point of the log-average to the next, so that 20000 to 80000 are enough.
pub fn log_average_step(grid: Size) -> usize {
    (grid.pixels() / 20_000).isqrt().max(1)
}

fn check(input: &ComposeInput) {
    let size = input.merged.size();
    assert_eq!(input.real.size(), size, "real and merged geometry");
    assert_eq!(input.frame.color_srgb.size(), size, "picture and geometry");
    assert_eq!(input.layer.albedo.size(), size, "albedo and geometry");
    assert_eq!(input.layer.coverage.size(), size, "coverage and geometry");
    let (real, merged) = (input.real_transfer, input.merged_transfer);
    assert_eq!(
        (real.bands, real.step, real.grid),
        (merged.bands, merged.step, merged.grid),
        "real and merged transfer"
    );
    if let Some(indirect) = input.indirect {
        assert_eq!((indirect.step, indirect.grid), (merged.step, merged.grid), "bounce, transfer");
    }
}
