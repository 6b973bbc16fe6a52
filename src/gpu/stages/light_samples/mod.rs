//! Samples of a frame for the estimation of light, as `find` and `pick` of the CPU's samples; the light is fitted
//! to them by [`LightEstimator`] on the CPU.
//!
//! ```text
//! judge -> pick -> about 1000 samples, read back
//! picture       -> depth and luminance, which samples of later frames are compared with
//! ```
//!
//! The same pixels are picked; they come in any order and are sorted. Transfer, whose values are below 1, comes
//! back in steps of 2^-15, and so do normals, which only choose a bin of 30 degrees; all else comes as it is: 61 to
//! 63 KiB a frame.

mod decode;

#[cfg(test)]
mod tests;

use super::transfer_map::grid_size;
use super::{FramePictures, GpuTransferMap};
use crate::gpu::{
    Commands, Constant, Gpu, GpuBuffer, GpuError, GpuGBuffer, ReadBack, Shader, ViewUniform,
    uniform,
};
use crate::image::Size;
use crate::lighting::{
    LightEstimate, LightEstimator, LightParams, PickedSamples, RANK_STEPS, SAME_DEPTH,
    most_samples, samples_per_frame,
};
use crate::math::{View, sh};
use crate::timing::Stage;
use decode::{HEADER, decode, sample_words};
use glam::Vec3;

uniform! {
    struct SamplesUniform {
        view: ViewUniform,
        last_view: ViewUniform,
        grid: [u32; 2],
        step: u32,
        every: u32,
        columns: u32,
        candidates: u32,
        brightest: f32,
        darkest: f32,
        min_cosine: f32,
        model_only: u32,
        has_last: u32,
        pad: u32,
    }
}

uniform! {
    struct PictureUniform {
        pixels: u32,
        pad: u32,
    }
}

fn judge_shader(bands: usize) -> Shader {
    Shader::new("light_samples/judge").with_u32("COEFFICIENTS", sh::coefficients(bands))
}

fn pick_shader(bands: usize) -> Shader {
    Shader::new("light_samples/pick")
        .with_u32("COEFFICIENTS", sh::coefficients(bands))
        .with_u32("SAMPLES", samples_per_frame(bands))
        .with_u32("MOST_SAMPLES", most_samples(bands))
        .with_u32("RANK_STEP_X", RANK_STEPS[0] as usize)
        .with_u32("RANK_STEP_Y", RANK_STEPS[1] as usize)
        .with_u32("SAMPLE_WORDS", sample_words(bands))
        .with("SAME_DEPTH", Constant::F32(SAME_DEPTH))
}

const PICTURE: Shader = Shader::new("light_samples/picture");

#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    let of_bands = (1..=sh::MAX_BANDS).flat_map(|b| [judge_shader(b), pick_shader(b)]);
    of_bands.chain([PICTURE]).collect()
}

/// Picks samples, and keeps the pictures that they are compared with.
pub struct LightSamplesPass {
    params: LightParams,
    size: Size,
    bands: usize,
    step: usize,
    judge: Shader,
    pick: Shader,
    /// 1 for each candidate that tells something.
    usable: GpuBuffer<u32>,
    picked: GpuBuffer<u32>,
    /// Depth and luminance of the frame whose light was found last, and of the newest.
    last: GpuBuffer<[f32; 2]>,
    newest: GpuBuffer<[f32; 2]>,
    last_view: Option<View>,
    read_back: ReadBack<u32>,
    /// Of the frame whose samples are under way.
    under_way: Option<View>,
}

impl LightSamplesPass {
    /// For frames of this size with transfer of so many bands on every `step`-th pixel.
    pub fn new(
        gpu: &Gpu,
        params: &LightParams,
        size: Size,
        bands: usize,
        step: usize,
    ) -> Result<Self, GpuError> {
        let words = HEADER + most_samples(bands) * sample_words(bands);
        let candidates = candidates(size, step, every(params, step)).pixels();
        Ok(Self {
            params: params.clone(),
            size,
            bands,
            step,
            judge: judge_shader(bands),
            pick: pick_shader(bands),
            usable: GpuBuffer::new(gpu, "usable pixels", candidates)?,
            picked: GpuBuffer::new(gpu, "picked samples", words)?,
            last: GpuBuffer::new(gpu, "last picture", size.pixels())?,
            newest: GpuBuffer::new(gpu, "newest picture", size.pixels())?,
            last_view: None,
            read_back: ReadBack::new(gpu, "picked samples", words)?,
            under_way: None,
        })
    }

    /// Takes other parameters with `renewed`, made for frames of the same size; what the next frame is compared
    /// with is kept.
    pub fn replace_by(&mut self, renewed: Self) {
        let old = std::mem::replace(self, renewed);
        self.last = old.last;
        self.last_view = old.last_view;
    }

    /// Picks samples of a frame and has them read back.
    ///
    /// # Panics
    /// If sizes, bands or step are not those of [`Self::new`], or samples of a frame before were not taken.
    pub fn run(
        &mut self,
        commands: &mut Commands<'_>,
        frame: &FramePictures,
        surface: &GpuGBuffer,
        transfer: &GpuTransferMap,
    ) -> Result<(), GpuError> {
        assert!(self.under_way.is_none(), "samples are taken before the next are picked");
        assert_eq!([frame.size, surface.size()], [self.size; 2], "sizes of a frame");
        assert_eq!((transfer.bands, transfer.step), (self.bands, self.step), "bands and step");
        assert_eq!(transfer.grid, grid_size(self.step, self.size), "grid of transfer");
        commands.stage(Stage::LightEst);
        let uniform = self.uniform(&surface.view, transfer.grid);
        commands.clear(&self.picked);
        commands
            .pass(&self.judge)?
            .uniform(&uniform)?
            .read(&surface.surface)?
            .read(&surface.origin)?
            .read(&frame.color_srgb)?
            .read(&frame.color)?
            .read(&transfer.coefficients)?
            .write(&self.usable)?
            .write(&self.picked)?
            .over_count(self.usable.len())?;
        commands
            .pass(&self.pick)?
            .uniform(&uniform)?
            .read(&self.usable)?
            .read(&surface.surface)?
            .read(&frame.color)?
            .read(&transfer.coefficients)?
            .read(&self.last)?
            .write(&self.picked)?
            .over_count(self.usable.len())?;
        commands
            .pass(&PICTURE)?
            .uniform(&PictureUniform { pixels: self.size.pixels() as u32, pad: 0 })?
            .read(&surface.surface)?
            .read(&frame.color)?
            .write(&self.newest)?
            .over_count(self.size.pixels())?;
        self.read_back.request(commands, &self.picked, self.picked.len());
        self.under_way = Some(surface.view);
        Ok(())
    }

    /// The light of the frame that was given to [`Self::run`], once its commands have been submitted: waits for
    /// the device. `None` where there is no such frame.
    pub fn estimate(
        &mut self,
        gpu: &Gpu,
        estimator: &mut LightEstimator,
        at: Option<Vec3>,
    ) -> Result<Option<LightEstimate>, GpuError> {
        let Some(picked) = self.take(gpu)? else { return Ok(None) };
        let estimate = estimator.estimate_picked(&picked, at);
        if estimate.valid() {
            std::mem::swap(&mut self.last, &mut self.newest);
            self.last_view = Some(picked.view);
        }
        Ok(Some(estimate))
    }

    fn take(&mut self, gpu: &Gpu) -> Result<Option<PickedSamples>, GpuError> {
        let Some(view) = self.under_way.take() else { return Ok(None) };
        let words = self.read_back.take(gpu)?;
        Ok(words.map(|words| decode(&words, view, self.bands)))
    }

    fn uniform(&self, view: &View, grid: Size) -> SamplesUniform {
        let every = every(&self.params, self.step);
        SamplesUniform {
            view: ViewUniform::new(view),
            last_view: ViewUniform::new(self.last_view.as_ref().unwrap_or(view)),
            grid: [grid.width as u32, grid.height as u32],
            step: self.step as u32,
            every: every as u32,
            columns: candidates(self.size, self.step, every).width as u32,
            candidates: self.usable.len() as u32,
            brightest: self.params.max_encoded * 255.0,
            darkest: self.params.min_encoded * 255.0,
            min_cosine: self.params.min_cosine,
            model_only: u32::from(self.params.model_only),
            has_last: u32::from(self.last_view.is_some()),
            pad: 0,
        }
    }
}

/// Grid points from one candidate to the next.
fn every(params: &LightParams, step: usize) -> usize {
    params.stride.div_ceil(step).max(1)
}

/// The grid of candidates.
fn candidates(image: Size, step: usize, every: usize) -> Size {
    grid_size(every, grid_size(step, image))
}
