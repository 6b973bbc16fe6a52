//! The Surface stage: the main geometry buffer every frame, the auxiliary ones when they are out of date,
//! as [`crate::fusion::SurfaceStage`].

use super::{GpuVolume, RayCaster};
use crate::fusion::schedule::AuxiliarySchedule;
use crate::fusion::{AuxiliaryRig, Shown, SurfaceParams};
use crate::gpu::{Commands, Gpu, GpuError, GpuGBuffer};
use crate::math::View;
use crate::timing::Stage;
use glam::Vec3;

/// Geometry buffers ray-cast from the volume.
pub struct SurfacePass {
    pub main: GpuGBuffer,
    /// Left, right, top, light, as far as they are switched on; the light's once its direction
    /// is known.
    pub auxiliary: Vec<GpuGBuffer>,
    schedule: AuxiliarySchedule,
    caster: RayCaster,
}

impl SurfacePass {
    /// For a volume, from the camera that placed it.
    pub fn new(
        gpu: &Gpu,
        volume: &GpuVolume,
        first_camera: View,
        params: &SurfaceParams,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            main: GpuGBuffer::empty(gpu, first_camera)?,
            auxiliary: Vec::new(),
            schedule: AuxiliarySchedule::new(&volume.lattice, &first_camera, params),
            caster: RayCaster::new(gpu, first_camera.size())?,
        })
    }

    /// What each auxiliary buffer shows.
    pub fn shown(&self) -> &[Shown] {
        self.schedule.shown()
    }

    pub fn rig(&self) -> &AuxiliaryRig {
        self.schedule.rig()
    }

    /// Takes other settings from the next update on. Buffers whose view stays keep what they show.
    pub fn reconfigure(&mut self, gpu: &Gpu, params: &SurfaceParams) -> Result<(), GpuError> {
        let mut known: Vec<Option<GpuGBuffer>> = self.auxiliary.drain(..).map(Some).collect();
        for (view, at) in self.schedule.reconfigure(params) {
            let kept = at.and_then(|at| known[at].take());
            self.auxiliary.push(kept.map_or_else(|| GpuGBuffer::empty(gpu, view), Ok)?);
        }
        Ok(())
    }

    /// Casts what `camera_view` sees, which is as large as the first camera, and the auxiliary buffers
    /// that are due. `towards_light` is a unit vector; without it the last known direction is kept.
    pub fn update(
        &mut self,
        commands: &mut Commands<'_>,
        volume: &GpuVolume,
        camera_view: View,
        towards_light: Option<Vec3>,
    ) -> Result<(), GpuError> {
        commands.stage(Stage::Surface);
        self.caster.cast(commands, volume, &camera_view, &mut self.main)?;
        let due = self.schedule.next(volume.revision(), towards_light);
        let views: Vec<View> = self.schedule.views().collect();
        for view in &views[self.auxiliary.len()..] {
            self.auxiliary.push(GpuGBuffer::empty(commands.gpu(), *view)?);
        }
        for at in due {
            self.caster.cast(commands, volume, &views[at], &mut self.auxiliary[at])?;
        }
        Ok(())
    }
}
