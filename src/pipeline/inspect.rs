//! What lies between the stages, for looking at and for comparing with other backends.

use super::{Pipeline, shared};
use crate::capture::RgbdFrame;
use crate::compositing::VirtualLayer;
use crate::fusion::TsdfVolume;
use crate::geometry::{GBuffer, Origin};
use crate::image::Image;
use crate::lighting::ShLight;
use crate::scene::VirtualScene;
use crate::transfer::{IndirectMap, Radiance, TransferMap};
use glam::Vec3;

/// What the stages took and gave in the newest frame, in the run's local coordinates.
#[derive(Clone)]
pub struct StageBuffers<'a> {
    /// After the Input stage.
    pub frame: &'a RgbdFrame,
    /// With this frame in it, if that was well tracked.
    pub volume: &'a TsdfVolume,
    /// G_v.
    pub model: &'a GBuffer,
    pub auxiliary: &'a [GBuffer],
    /// G_r.
    pub real: &'a GBuffer,
    pub real_transfer: &'a TransferMap,
    /// Times the scene's mean albedo.
    pub light: &'a ShLight,
    /// Where the light is wanted.
    pub light_point: Option<Vec3>,
    /// Where they stand in this frame.
    pub objects: &'a VirtualScene,
    /// `None` where virtual objects change nothing.
    pub with_objects: Option<ObjectBuffers<'a>>,
    pub composed: &'a Image<[u8; 3]>,
}

/// The same with virtual objects.
#[derive(Clone)]
pub struct ObjectBuffers<'a> {
    pub main: &'a GBuffer,
    pub layer: &'a VirtualLayer,
    /// None for transfer by rays, which looks at no side view.
    pub auxiliary: &'a [GBuffer],
    pub auxiliary_layers: Vec<&'a VirtualLayer>,
    /// What leaves the pixels of `main` and `auxiliary`; none without a bounce.
    pub radiance: Option<Radiance<'a>>,
    pub transfer: &'a TransferMap,
    /// None without a bounce.
    pub indirect: Option<&'a IndirectMap>,
}

impl ObjectBuffers<'_> {
    /// Whether a pixel of the camera's view is virtual.
    pub fn shows(&self) -> bool {
        self.main.origin.as_slice().contains(&Origin::Virtual)
    }
}

impl Pipeline {
    /// The newest frame between the stages; `None` where it was not composed.
    pub fn stages(&self) -> Option<StageBuffers<'_>> {
        let map = self.map.as_ref().filter(|_| self.composed_last)?;
        let last = &self.last;
        let bounce = self.settings.bounce.enabled;
        let with_objects = last.changed.then(|| ObjectBuffers {
            main: last.merged.buffer(&last.real),
            layer: &last.merged.layer,
            auxiliary: &map.sides.buffers,
            auxiliary_layers: map.sides.layers().collect(),
            radiance: bounce.then_some((&last.merged.radiance, &map.sides.radiance[..])),
            transfer: &last.merged_transfer,
            indirect: bounce.then_some(&last.indirect),
        });
        Some(StageBuffers {
            frame: &last.frame,
            volume: &map.volume,
            model: &map.surface.main,
            auxiliary: &map.surface.auxiliary,
            real: &last.real,
            real_transfer: &last.real_transfer,
            light: &self.light.as_ref()?.light,
            light_point: shared::light_point(&self.settings, self.origin.as_ref(), &self.scene),
            objects: &self.scene,
            with_objects,
            composed: &self.composed,
        })
    }
}
