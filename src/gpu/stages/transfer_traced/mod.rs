//! The RadTransfer stage by rays through the volume, as [`crate::transfer::RayTracedTransfer`].
//!
//! ```text
//! plan -> list -> volume -> project                          every point of the grid
//! cells -> refine -> list -> volume -> project, interpolate  every pixel, with refinement
//! again -> list -> volume -> list -> objects -> project      with virtual objects, from what the above found
//! ```
//!
//! One invocation sends up to 32 rays from one point, where the CPU sends one ray from each of sixteen.
//! Hierarchies of triangles are the CPU's, laid out depth first: whether anything is hit does not depend on
//! the order of the search. With virtual objects all interpolated pixels are interpolated again, while the
//! CPU leaves those whose corners have not changed: the results are the same.

mod level;
mod list;
mod objects;
mod refined;
#[cfg(test)]
mod tests;
mod uniforms;

use super::transfer::direction_rows;
use super::transfer_map::grid_size;
use super::{EmptySpacePass, GpuTransferMap, GpuVolume};
use crate::gpu::{Commands, Gpu, GpuBuffer, GpuError, GpuGBuffer, Shader};
use crate::image::Size;
use crate::math::View;
use crate::scene::VirtualScene;
use crate::timing::Stage;
use crate::transfer::{DirectionSet, TransferParams};
use level::{Level, Room};
use objects::GpuSceneRays;
use refined::Refined;
use uniforms::TracedUniform;

fn with_bands(file: &'static str, bands: usize) -> Shader {
    Shader::new(file).with_u32("BANDS", bands)
}

#[cfg(test)]
pub(super) fn shaders() -> Vec<Shader> {
    let makers = [
        level::plan_shader,
        level::volume_shader,
        level::again_shader,
        level::objects_shader,
        level::project_shader,
        refined::cells_shader,
        refined::refine_shader,
        refined::interpolate_shader,
    ];
    let lists = [false, true].map(|known_too| list::list_shader(4, known_too));
    let of_bands =
        (1..=crate::math::sh::MAX_BANDS).flat_map(|bands| makers.map(|shader| shader(bands)));
    of_bands.chain(lists).collect()
}

/// The stage, with what it keeps from frame to frame.
pub struct TracedTransferPass {
    params: TransferParams,
    image: Size,
    /// A direction, then its spherical harmonics.
    directions: GpuBuffer<[f32; 4]>,
    space: EmptySpacePass,
    objects: GpuSceneRays,
    /// The grid's points.
    level: Level,
    /// With refinement.
    refined: Option<Refined>,
    /// Of the last real pass.
    shown: Option<View>,
}

impl TracedTransferPass {
    /// For main buffers of this size, and volumes with as many blocks as this one. `set` must have been made
    /// of `params`.
    pub fn new(
        gpu: &Gpu,
        params: &TransferParams,
        set: &DirectionSet,
        volume: &GpuVolume,
        image: Size,
    ) -> Result<Self, GpuError> {
        let rows = direction_rows(set, params.bands);
        let refined = params.refines().then(|| Refined::new(gpu, params, image)).transpose()?;
        Ok(Self {
            directions: GpuBuffer::from_slice(gpu, "directions", &rows)?,
            space: EmptySpacePass::new(gpu, volume)?,
            objects: GpuSceneRays::new(gpu)?,
            level: Level::new(gpu, params, params.subsampling, image)?,
            refined,
            params: params.clone(),
            image,
            shown: None,
        })
    }

    /// A map for what this stage gives: of the grid's points; of every pixel, with refinement.
    pub fn new_map(&self, gpu: &Gpu) -> Result<GpuTransferMap, GpuError> {
        GpuTransferMap::new(gpu, self.params.bands, self.params.result_step(), self.image)
    }

    /// Transfer of every grid point of `main`; of every pixel, with refinement.
    ///
    /// # Panics
    /// If `main`, the volume or `out` is not what this stage was made for.
    pub fn transfer(
        &mut self,
        commands: &mut Commands<'_>,
        volume: &GpuVolume,
        main: &GpuGBuffer,
        out: &GpuTransferMap,
    ) -> Result<(), GpuError> {
        self.assert_fits(main, out);
        commands.stage(Stage::RadTransfer);
        self.shown = Some(main.view);
        if self.image.pixels() == 0 {
            return Ok(());
        }
        self.space.survey(commands, volume)?;
        let room = Room { directions: &self.directions, volume, space: &self.space };
        let uniform = TracedUniform::new(&self.params, volume, &main.view, &self.level, 0);
        let coarse = self.refined.as_ref().map_or(out, |refined| &refined.real);
        self.level.plan(commands, &uniform, main, &self.level.real.how)?;
        self.level.trace(commands, &uniform, room, main, &coarse.coefficients)?;
        let Some(refined) = &self.refined else { return Ok(()) };
        let Refined { pixels, .. } = refined;
        refined.plan(commands, &uniform, main, &pixels.real.how)?;
        pixels.trace(commands, &uniform, room, main, &out.coefficients)?;
        refined.interpolate(commands, &uniform, &pixels.real.how, coarse, &out.coefficients)
    }

    /// Transfer of real and virtual geometry together, with the directions of the real pass.
    ///
    /// `real_transfer` is what the last call of [`Self::transfer`] made of `volume` and `real`, and `merged`
    /// is `real` with `scene` drawn into it. Points that no object can influence are copied. Where objects
    /// stand is uploaded at once: commands are to be submitted before the next call.
    ///
    /// # Panics
    /// If buffers or maps are not what this stage was made for, or `real` was not in the last real pass.
    pub fn transfer_with_virtual(
        &mut self,
        commands: &mut Commands<'_>,
        volume: &GpuVolume,
        scene: &VirtualScene,
        (real, merged): (&GpuGBuffer, &GpuGBuffer),
        real_transfer: &GpuTransferMap,
        out: &GpuTransferMap,
    ) -> Result<(), GpuError> {
        self.assert_fits(real, real_transfer);
        self.assert_fits(merged, out);
        assert_eq!([self.shown, Some(merged.view)], [Some(real.view); 2], "view of the real pass");
        commands.stage(Stage::RadTransfer);
        if self.image.pixels() == 0 {
            return Ok(());
        }
        commands.copy(&real_transfer.coefficients, &out.coefficients, out.coefficients.len());
        self.objects.update(commands.gpu(), scene)?;
        let instances = self.objects.len();
        if instances == 0 {
            return Ok(());
        }
        let (objects, buffers) = (&self.objects, (real, merged));
        let room = Room { directions: &self.directions, volume, space: &self.space };
        let uniform =
            TracedUniform::new(&self.params, volume, &merged.view, &self.level, instances);
        let coarse = self.refined.as_ref().map_or(out, |refined| &refined.merged);
        if let Some(Refined { real, merged, .. }) = &self.refined {
            commands.copy(&real.coefficients, &merged.coefficients, real.coefficients.len());
        }
        self.level.plan(commands, &uniform, merged, &self.level.merged.how)?;
        self.level.trace_again(commands, &uniform, room, objects, buffers, &coarse.coefficients)?;
        let Some(refined) = &self.refined else { return Ok(()) };
        let Refined { pixels, .. } = refined;
        refined.plan(commands, &uniform, merged, &pixels.merged.how)?;
        pixels.trace_again(commands, &uniform, room, objects, buffers, &out.coefficients)?;
        refined.interpolate(commands, &uniform, &pixels.merged.how, coarse, &out.coefficients)
    }

    fn assert_fits(&self, main: &GpuGBuffer, map: &GpuTransferMap) {
        let step = self.params.result_step();
        assert_eq!(main.size(), self.image, "main buffer");
        let wanted = (self.params.bands, step, grid_size(step, self.image));
        assert_eq!((map.bands, map.step, map.grid), wanted, "map of transfer");
    }
}
