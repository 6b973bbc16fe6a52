//! Geometry buffers with the virtual scene drawn into them, and what their pixels radiate, as those of
//! the CPU's pipeline.

use crate::fusion::Shown;
use crate::gpu::stages::{ExitantPass, GpuVirtualLayer, RasterPass, SurfacePass};
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer, GpuImage};
use crate::math::View;
use crate::pipeline::shared::PlacedObjects;
use crate::scene::{Rasteriser, VirtualScene};

/// The camera's view, new in every frame.
pub struct MergedMain {
    pub buffer: GpuGBuffer,
    pub layer: GpuVirtualLayer,
    pub radiance: GpuImage<[f32; 4]>,
}

impl MergedMain {
    pub fn new(gpu: &Gpu, view: View) -> Result<Self, GpuError> {
        Ok(Self {
            buffer: GpuGBuffer::empty(gpu, view)?,
            layer: GpuVirtualLayer::empty(gpu, view.size())?,
            radiance: GpuImage::new(gpu, "radiance", view.size())?,
        })
    }

    /// Whether an object may be seen.
    pub fn may_show(&self, scene: &VirtualScene, real: &GpuGBuffer) -> bool {
        !Rasteriser::misses(scene, &real.view)
    }

    /// Returns whether a virtual surface may be seen anywhere.
    pub fn draw(
        &mut self,
        commands: &mut Commands<'_>,
        rasteriser: &mut RasterPass,
        scene: &VirtualScene,
        real: &GpuGBuffer,
    ) -> Result<bool, GpuError> {
        let target = (&mut self.buffer, &self.layer);
        Ok(!rasteriser.draw(commands, 0, scene, real, target)?.window.is_empty())
    }

    pub fn radiate(
        &self,
        commands: &mut Commands<'_>,
        exitant: &ExitantPass,
        camera_color: &GpuImage<[f32; 4]>,
    ) -> Result<(), GpuError> {
        exitant.run(commands, &self.buffer, &self.layer, Some(camera_color), &self.radiance)
    }
}

/// The auxiliary views of one map. Their real buffers are refreshed in turn, and only then or when an object
/// has moved are they drawn again.
#[derive(Default)]
pub struct MergedSides {
    /// Those that are drawn.
    objects: PlacedObjects,
    views: Vec<SideView>,
    pub buffers: Vec<GpuGBuffer>,
    pub radiance: Vec<GpuImage<[f32; 4]>>,
}

struct SideView {
    /// What the real buffer showed when it was drawn into; none when objects have moved since.
    drawn: Option<Shown>,
    layer: GpuVirtualLayer,
    /// Whether a virtual surface may be in it.
    shows: bool,
}

impl MergedSides {
    /// Whether an object may be seen in any side view.
    pub fn may_show(scene: &VirtualScene, surface: &SurfacePass) -> bool {
        surface.auxiliary.iter().any(|buffer| !Rasteriser::misses(scene, &buffer.view))
    }

    /// Returns whether a virtual surface may be in any view. `surface` must be the same stage in every
    /// call.
    pub fn draw(
        &mut self,
        commands: &mut Commands<'_>,
        rasteriser: &mut RasterPass,
        scene: &VirtualScene,
        surface: &SurfacePass,
    ) -> Result<bool, GpuError> {
        if self.objects.follow(scene) {
            self.views.iter_mut().for_each(|view| view.drawn = None);
        }
        self.follow(commands.gpu(), surface)?;
        for (at, (real, &shown)) in surface.auxiliary.iter().zip(surface.shown()).enumerate() {
            let view = &mut self.views[at];
            if view.drawn != Some(shown) {
                let target = (&mut self.buffers[at], &view.layer);
                // the camera's view is number 0
                let drawn = rasteriser.draw(commands, 1 + at, scene, real, target)?;
                view.shows = !drawn.window.is_empty();
                view.drawn = Some(shown);
            }
        }
        Ok(self.views.iter().any(|view| view.shows))
    }

    /// Has buffers for all side views, of their sizes.
    fn follow(&mut self, gpu: &Gpu, surface: &SurfacePass) -> Result<(), GpuError> {
        let wanted = surface.auxiliary.iter().map(GpuGBuffer::size);
        let known = self.buffers.iter().map(GpuGBuffer::size);
        let kept = wanted.zip(known).take_while(|(wanted, known)| wanted == known).count();
        self.views.truncate(kept);
        self.buffers.truncate(kept);
        self.radiance.truncate(kept);
        for real in &surface.auxiliary[kept..] {
            let layer = GpuVirtualLayer::empty(gpu, real.size())?;
            self.views.push(SideView { drawn: None, layer, shows: false });
            self.buffers.push(GpuGBuffer::empty(gpu, real.view)?);
            self.radiance.push(GpuImage::new(gpu, "radiance of a side view", real.size())?);
        }
        Ok(())
    }

    /// Side views have no colour: all but virtual surfaces is dark.
    pub fn radiate(
        &self,
        commands: &mut Commands<'_>,
        exitant: &ExitantPass,
    ) -> Result<(), GpuError> {
        for ((view, buffer), out) in self.views.iter().zip(&self.buffers).zip(&self.radiance) {
            exitant.run(commands, buffer, &view.layer, None, out)?;
        }
        Ok(())
    }
}
