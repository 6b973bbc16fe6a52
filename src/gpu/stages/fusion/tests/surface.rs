use super::*;
use crate::fusion::{SurfaceParams, SurfaceStage};
use crate::gpu::stages::SurfacePass;

/// Both stages over the same pictures.
struct Stages<'g> {
    pair: Pair<'g>,
    cpu: SurfaceStage,
    on_device: SurfacePass,
}

impl<'g> Stages<'g> {
    fn new(gpu: &'g Gpu, view: View, params: &SurfaceParams) -> Self {
        let pair = Pair::new(gpu, &volume_params(64));
        let cpu = SurfaceStage::new(&pair.cpu, view, params);
        let on_device = SurfacePass::new(gpu, &pair.on_device, view, params).unwrap();
        Self { pair, cpu, on_device }
    }

    fn update(&mut self, view: View, towards_light: Option<Vec3>) {
        self.cpu.update(&self.pair.cpu, view, towards_light);
        let mut commands = self.pair.gpu.commands();
        self.on_device.update(&mut commands, &self.pair.on_device, view, towards_light).unwrap();
        commands.submit().unwrap();
    }

    /// Every buffer shows the volume of the same revision.
    fn assert_equal(&self, case: &str) {
        let cpu = std::iter::once(&self.cpu.main).chain(&self.cpu.auxiliary);
        let gpu = std::iter::once(&self.on_device.main).chain(&self.on_device.auxiliary);
        assert_eq!(self.cpu.auxiliary.len(), self.on_device.auxiliary.len());
        for (number, (cpu, gpu)) in cpu.zip(gpu).enumerate() {
            let gpu = gpu.download(self.pair.gpu).unwrap();
            assert_eq!(cpu.view, gpu.view, "{case}, buffer {number}");
            let case = format!("{case}, buffer {number}");
            Differences::of(cpu, &gpu, 1e-3).assert_small(self.pair.gpu, &case);
        }
    }
}

#[test]
fn auxiliary_buffers_are_redone_in_turn_as_on_the_cpu() {
    let Some(gpu) = gpu() else { return };
    let params = SurfaceParams {
        auxiliary_resolution: 32,
        left: true,
        right: true,
        warm_up_updates: 1,
        ..SurfaceParams::default()
    };
    let scene = AnalyticScene::corner();
    let views: Vec<View> = arc(5).map(|pose| View::perspective(camera(67, 43), pose)).collect();
    let mut stages = Stages::new(gpu, views[0], &params);
    for (round, view) in views.iter().enumerate() {
        stages.pair.integrate(&colored(render(&scene, view)), view);
        let light = [None, Some(Vec3::Z), Some(Vec3::new(0.6, 0.0, 0.8))][round.min(2)];
        stages.update(*view, light);
        stages.assert_equal(&format!("round {round}"));
        assert_eq!(stages.on_device.auxiliary.len(), if round == 0 { 3 } else { 4 });
    }
    let fewer = SurfaceParams { left: false, ..params.clone() };
    stages.cpu.reconfigure(&fewer);
    stages.on_device.reconfigure(gpu, &fewer).unwrap();
    stages.assert_equal("without the left one");
    let finer = SurfaceParams { auxiliary_resolution: 40, ..params };
    stages.cpu.reconfigure(&finer);
    stages.on_device.reconfigure(gpu, &finer).unwrap();
    stages.update(views[0], None);
    stages.assert_equal("finer");
}
