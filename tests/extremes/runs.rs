//! A pipeline on either backend, looked at after every frame. On the GPU the CPU's goes along: at the extremes
//! too, both must come to the same states.

use crate::checks::{Broken, check};
use crate::frames::camera;
use crate::table::{Device, Found, Outcome};
use kinlight::capture::RawFrame;
use kinlight::config::Settings;
use kinlight::lighting::ShLight;
use kinlight::math::Pinhole;
use kinlight::pipeline::{Backend, FrameOutcome, GpuPipeline, Pipeline, PipelineError};
use kinlight::scene::VirtualScene;
use kinlight::timing::StageTimes;

/// Quick for small pictures: 64^3 voxels, side views of 64x64, transfer on every 2nd pixel, recorded poses.
pub const QUICK: [(&str, &str); 6] = [
    ("surface.auxiliary_resolution", "64"),
    ("surface.warm_up_updates", "2"),
    ("surface.left", "true"),
    ("transfer.subsampling", "2"),
    ("light.stride", "2"),
    ("tracking.mode", "recorded"),
];

/// [`QUICK`], and then `changes`; validated.
pub fn settings(changes: &[(&str, &str)]) -> Result<Settings, String> {
    let mut settings = Settings::preset("ours-fast-mobile").map_err(|e| e.to_string())?;
    for (key, value) in QUICK.iter().chain(changes) {
        settings.set(key, value).map_err(|e| e.to_string())?;
    }
    settings.validate().map_err(|e| e.to_string())?;
    Ok(settings)
}

enum Pipe {
    Cpu(Box<Pipeline>),
    /// And its twin.
    Gpu(Box<GpuPipeline>, Box<Pipeline>),
}

pub struct Run {
    pipe: Pipe,
    has_objects: bool,
    pub broken: Broken,
    /// Of the frames so far.
    pub outcomes: Vec<FrameOutcome>,
    /// Of the GPU against its twin: largest share of picture values more than 1 apart, largest distance of
    /// cameras in metres, largest angle of lights in degrees.
    apart: [f64; 3],
}

impl Run {
    pub fn new(
        device: Device<'_>,
        settings: &Settings,
        camera: Pinhole,
        scene: VirtualScene,
    ) -> Result<Self, PipelineError> {
        let has_objects = scene.bounds().next().is_some() || scene.pending() > 0;
        let cpu = Box::new(Pipeline::new(settings.clone(), camera, scene.clone())?);
        let pipe = match device {
            Device::Cpu => Pipe::Cpu(cpu),
            Device::Gpu(gpu) => {
                let made = GpuPipeline::new(gpu.clone(), settings.clone(), camera, scene)?;
                Pipe::Gpu(Box::new(made), cpu)
            }
        };
        let (broken, outcomes) = (Broken::default(), Vec::new());
        Ok(Self { pipe, has_objects, broken, outcomes, apart: [0.0; 3] })
    }

    pub fn set_light(&mut self, light: Option<ShLight>) {
        match &mut self.pipe {
            Pipe::Cpu(cpu) => cpu.set_light(light),
            Pipe::Gpu(gpu, cpu) => {
                gpu.set_light(light.clone());
                cpu.set_light(light);
            }
        }
    }

    pub fn backend(&self) -> &dyn Backend {
        match &self.pipe {
            Pipe::Cpu(cpu) => &**cpu,
            Pipe::Gpu(gpu, _) => &**gpu,
        }
    }

    /// Processes and checks a frame.
    pub fn frame(&mut self, raw: &RawFrame) -> Result<&FrameOutcome, PipelineError> {
        let outcome = match &mut self.pipe {
            Pipe::Cpu(cpu) => cpu.process(raw.clone(), StageTimes::default())?,
            Pipe::Gpu(gpu, cpu) => {
                let twin = cpu.process(raw.clone(), StageTimes::default());
                let found = gpu.process(raw, StageTimes::default());
                let agree = twin.is_ok() == found.is_ok();
                self.broken.rule(agree, || match (&twin, &found) {
                    (Err(error), _) => format!("an error on the CPU alone: {error}"),
                    (_, Err(error)) => format!("an error on the GPU alone: {error}"),
                    _ => String::new(),
                });
                let found = found?;
                if let Ok(twin) = twin {
                    self.compare(&twin, &found);
                }
                found
            }
        };
        let mut broken = std::mem::take(&mut self.broken);
        check(&mut broken, self.backend(), raw, &outcome, self.has_objects);
        self.broken = broken;
        self.outcomes.push(outcome);
        Ok(&self.outcomes[self.outcomes.len() - 1])
    }

    fn compare(&mut self, cpu: &FrameOutcome, gpu: &FrameOutcome) {
        let Pipe::Gpu(of_gpu, of_cpu) = &self.pipe else { return };
        let state = |o: &FrameOutcome| (o.tracking.state, o.composed, o.light.rejection);
        self.broken.rule(state(cpu) == state(gpu), || {
            format!("frame {}: {:?} on the CPU, {:?} on the GPU", cpu.index, state(cpu), state(gpu))
        });
        let codes = |backend: &dyn Backend| backend.composed().as_slice().as_flattened().to_vec();
        let (a, b) = (codes(&**of_cpu), codes(&**of_gpu));
        let beyond = a.iter().zip(&b).filter(|(a, b)| a.abs_diff(**b) > 1).count();
        let moved = cpu.tracking.world_from_camera.inverse() * gpu.tracking.world_from_camera;
        let direction = |o: &FrameOutcome| o.light.light.dominant_direction();
        let turned = match (direction(cpu), direction(gpu)) {
            (Some(a), Some(b)) => a.cross(b).length().atan2(a.dot(b)).to_degrees(),
            _ => 0.0,
        };
        let found = [
            beyond as f64 / a.len().max(1) as f64,
            moved.translation.vector.norm(),
            f64::from(turned),
        ];
        // NaN counts as far apart
        self.apart =
            std::array::from_fn(
                |i| if found[i] <= self.apart[i] { self.apart[i] } else { found[i] },
            );
    }

    /// Of the GPU's lights and its twin's, the largest angle.
    pub fn light_apart_deg(&self) -> f64 {
        self.apart[2]
    }

    /// How often each state was met, in order, and what became of light and picture.
    fn story(&self) -> String {
        let mut states: Vec<(String, usize)> = Vec::new();
        for outcome in &self.outcomes {
            let composed = if outcome.composed { "composed" } else { "plain" };
            let light = match outcome.light.rejection {
                None => "lit".to_owned(),
                Some(rejection) => format!("{rejection:?}"),
            };
            let state = format!("{:?} {composed} {light}", outcome.tracking.state);
            match states.last_mut() {
                Some((last, count)) if *last == state => *count += 1,
                _ => states.push((state, 1)),
            }
        }
        let told = states.iter().map(|(state, count)| match count {
            1 => state.clone(),
            _ => format!("{count} x {state}"),
        });
        let mut story = told.collect::<Vec<_>>().join(", ");
        if let Pipe::Gpu(..) = self.pipe {
            let [share, metres, degrees] = self.apart;
            story += &format!("; CPU: {:.2} %, {metres:.1e} m, {degrees:.1e} deg", 100.0 * share);
        }
        story
    }

    /// Looks at the mesh too.
    pub fn finish(mut self) -> Outcome {
        let mesh = self.backend().mesh().map_err(|e| e.to_string())?;
        let bad = mesh.positions.as_flattened().iter().filter(|v| !v.is_finite()).count();
        self.broken.values(bad, || "vertices of the mesh".to_owned());
        let story = self.story();
        Ok(Found::broken(self.broken.count, self.broken.first.unwrap_or(story)))
    }
}

/// Processes all frames with a scene, of the camera of their size.
pub fn run(
    device: Device<'_>,
    settings: &Settings,
    scene: VirtualScene,
    frames: &[RawFrame],
) -> Result<Run, String> {
    let size = frames.first().ok_or("no frames")?.color.size();
    let mut run = Run::new(device, settings, camera(size), scene).map_err(|e| e.to_string())?;
    for frame in frames {
        run.frame(frame).map_err(|e| e.to_string())?;
    }
    Ok(run)
}
