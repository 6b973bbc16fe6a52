//! Geometry buffers with the virtual scene drawn into them, and what their pixels radiate. Each is made
//! anew only where it would come out differently.

use super::shared::PlacedObjects;
use crate::compositing::VirtualLayer;
use crate::fusion::{Shown, SurfaceStage};
use crate::geometry::GBuffer;
use crate::image::Image;
use crate::lighting::ShLight;
use crate::lighting::exitant::{DominantLight, exitant_radiance, exitant_radiance_within};
use crate::scene::{DrawReport, Rasteriser, VirtualScene};
use std::ops::Range;

/// What virtual surfaces reflect.
#[derive(Clone, Copy)]
pub struct Reflection {
    light: Option<DominantLight>,
    mean_albedo: f32,
}

impl Reflection {
    pub fn of(light: &ShLight, mean_albedo: f32) -> Self {
        Self { light: DominantLight::of(light), mean_albedo }
    }
}

/// The camera's view, new in every frame.
#[derive(Default)]
pub struct MergedMain {
    /// Of the last frame in which an object could be seen.
    buffer: Option<GBuffer>,
    pub layer: VirtualLayer,
    pub radiance: Image<[f32; 3]>,
    report: DrawReport,
}

impl MergedMain {
    /// Returns whether a virtual surface is seen anywhere.
    pub fn draw(
        &mut self,
        rasteriser: &mut Rasteriser,
        scene: &VirtualScene,
        real: &GBuffer,
    ) -> bool {
        if !Rasteriser::misses(scene, &real.view) {
            let buffer = self.buffer.get_or_insert_with(|| GBuffer::empty(real.view));
            self.report = rasteriser.draw(scene, real, buffer, &mut self.layer);
            return self.shows();
        }
        if self.shows() || self.layer.coverage.size() != real.size() {
            self.layer.albedo.reshape(real.size(), [0.0; 3]);
            self.layer.coverage.reshape(real.size(), 0.0);
            self.layer.coverage.fill(0.0);
        }
        self.report = DrawReport::default();
        false
    }

    fn shows(&self) -> bool {
        self.report.covered > 0
    }

    /// The buffer with virtual surfaces: `real` itself where there are none.
    pub fn buffer<'a>(&'a self, real: &'a GBuffer) -> &'a GBuffer {
        self.buffer.as_ref().filter(|_| self.shows()).unwrap_or(real)
    }

    /// Real pixels light virtual points alone, and without virtual pixels there are none of these.
    pub fn radiate(
        &mut self,
        real: &GBuffer,
        camera_color: &Image<[f32; 3]>,
        reflection: Reflection,
    ) {
        self.radiance.reshape(real.size(), [0.0; 3]);
        if self.report.pixels > 0 {
            let Reflection { light, mean_albedo } = reflection;
            let buffer = self.buffer.as_ref().unwrap_or(real);
            let color = Some(camera_color);
            exitant_radiance(buffer, &self.layer, color, light, mean_albedo, &mut self.radiance);
        }
    }
}

/// The auxiliary views of one map. Their real buffers are refreshed in turn, and only then or when an object
/// has moved are they drawn again.
#[derive(Default)]
pub struct MergedSides {
    /// Those that are drawn.
    objects: PlacedObjects,
    views: Vec<SideView>,
    pub buffers: Vec<GBuffer>,
    pub radiance: Vec<Image<[f32; 3]>>,
}

#[derive(Default)]
struct SideView {
    /// What the real buffer showed when it was drawn into; none when objects have moved since.
    drawn: Option<Shown>,
    layer: VirtualLayer,
    report: DrawReport,
    /// Outside these columns and rows, the radiance is zero.
    lit: (Range<usize>, Range<usize>),
}

impl MergedSides {
    /// Whether an object may be seen in any side view.
    pub fn may_show(scene: &VirtualScene, surface: &SurfaceStage) -> bool {
        surface.auxiliary.iter().any(|buffer| !Rasteriser::misses(scene, &buffer.view))
    }

    /// Returns whether a pixel of any view is virtual. `surface` must be the same stage in every call.
    pub fn draw(
        &mut self,
        rasteriser: &mut Rasteriser,
        scene: &VirtualScene,
        surface: &SurfaceStage,
    ) -> bool {
        if self.objects.follow(scene) {
            self.views.iter_mut().for_each(|view| view.drawn = None);
        }
        let count = surface.auxiliary.len();
        self.views.resize_with(count, SideView::default);
        self.radiance.resize_with(count, Image::default);
        self.buffers.truncate(count);
        for (at, (real, &shown)) in surface.auxiliary.iter().zip(surface.shown()).enumerate() {
            if at == self.buffers.len() {
                self.buffers.push(GBuffer::empty(real.view));
            }
            let view = &mut self.views[at];
            if view.drawn != Some(shown) {
                let merged = &mut self.buffers[at];
                view.report = rasteriser.draw(scene, real, merged, &mut view.layer);
                view.drawn = Some(shown);
            }
        }
        self.views.iter().any(|view| view.report.pixels > 0)
    }

    /// What is drawn into each of the views.
    pub fn layers(&self) -> impl Iterator<Item = &VirtualLayer> {
        self.views.iter().map(|view| &view.layer)
    }

    /// Side views have no colour: all but virtual surfaces is dark.
    pub fn radiate(&mut self, reflection: Reflection) {
        let Reflection { light, mean_albedo } = reflection;
        for ((view, buffer), out) in
            self.views.iter_mut().zip(&self.buffers).zip(&mut self.radiance)
        {
            let window = (view.report.columns.clone(), view.report.rows.clone());
            if out.size() != buffer.size() {
                out.reshape(buffer.size(), [0.0; 3]);
                out.fill([0.0; 3]);
            } else if view.lit != window {
                let (columns, rows) = view.lit.clone();
                rows.for_each(|y| out.row_mut(y)[columns.clone()].fill([0.0; 3]));
            }
            let within = window.clone();
            exitant_radiance_within(within, buffer, &view.layer, None, light, mean_albedo, out);
            view.lit = window;
        }
    }
}
