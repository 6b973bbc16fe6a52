//! What a light study runs.

use super::reference::Probe;
use crate::config::{Settings, SettingsError, presets};
use crate::study::StudyError;
use crate::synth::scene::HALF_CIRCLE_LIGHTS;
use crate::synth::{LightSwitch, STUDY, SynthOptions, scenes};
use std::collections::HashSet;
use std::fmt::Display;
use std::hash::Hash;

/// Presets that the paper compares, in the order of its Table 1.
const COMPARED: [&str; 4] = ["gr12", "ours", "gr14", "ours-fast"];

/// Frames between warm-up and the switch of the lamp, and from the switch on: a light that forgets a
/// tenth a frame has then forgotten all but 1.5 %.
const STEP_BEFORE: usize = 6;
const STEP_AFTER: usize = 40;

/// The default is the whole study, at the paper's size and with its scenes, lights and presets.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPlan {
    /// In order of growing richness.
    pub scenes: Vec<String>,
    /// On the half circle.
    pub lights: Vec<usize>,
    pub presets: Vec<String>,
    /// `field=value`, applied to every preset.
    pub assignments: Vec<String>,
    /// Depth as it is, and through the sensor model.
    pub exact: bool,
    pub kinect: bool,
    /// Frames of a run that count, after those of the warm-up.
    pub frames: usize,
    pub warm_up: usize,
    pub width: usize,
    pub height: usize,
    /// Paths a pixel.
    pub samples: u32,
    /// Measure what happens when the lamp is switched, in the richest of the scenes.
    pub steps: bool,
    /// Measure how the estimate moves where nothing does, in the richest of the scenes.
    pub jitter: bool,
}

impl Default for LightPlan {
    fn default() -> Self {
        let known = |name: &&str| presets::ALL.iter().any(|p| p.name == *name);
        Self {
            scenes: STUDY.map(String::from).to_vec(),
            lights: (0..HALF_CIRCLE_LIGHTS).collect(),
            presets: COMPARED.iter().filter(|&name| known(name)).map(|&n| n.to_owned()).collect(),
            assignments: Vec::new(),
            exact: true,
            kinect: true,
            frames: 12,
            warm_up: 4,
            width: 640,
            height: 480,
            samples: 8,
            steps: true,
            jitter: true,
        }
    }
}

/// How a light is found.
#[derive(Clone, Debug)]
pub(super) struct Method {
    pub name: String,
    pub settings: Settings,
    /// Looks at a light probe instead of the room.
    pub probe: Option<Probe>,
}

/// What is measured on a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Kind {
    Run { light: usize },
    Step { switch_frame: usize },
    Jitter,
}

/// One method on one sequence.
#[derive(Clone, Debug)]
pub(super) struct Job<'a> {
    pub kind: Kind,
    pub sequence: String,
    pub options: SynthOptions,
    pub sensor_noise: bool,
    pub method: &'a Method,
}

impl LightPlan {
    /// The presets with their settings, and the reference methods.
    pub(super) fn methods(&self) -> Result<Vec<Method>, StudyError> {
        let settings = |mut settings: Settings| -> Result<Settings, SettingsError> {
            self.assignments.iter().try_for_each(|a| settings.assign(a))?;
            settings.validate()?;
            Ok(settings)
        };
        let mut methods = Vec::new();
        for name in &self.presets {
            let settings = settings(Settings::preset(name)?)?;
            methods.push(Method { name: name.clone(), settings, probe: None });
        }
        let of_probe = settings(Settings::default())?;
        methods.extend(Probe::ALL.map(|probe| Method {
            name: probe.name().to_owned(),
            settings: of_probe.clone(),
            probe: Some(probe),
        }));
        Ok(methods)
    }

    pub(super) fn check(&self) -> Result<(), StudyError> {
        let bad = |problem: String| Err(StudyError::Options(problem));
        if self.presets.is_empty() || self.scenes.is_empty() || self.lights.is_empty() {
            return bad("a study needs at least one preset, one scene and one light".into());
        }
        if let Some(scene) = self.scenes.iter().find(|s| scenes::by_name(s).is_none()) {
            let known = scenes::NAMES.join(", ");
            return bad(format!("no scene is called '{scene}'; there are: {known}"));
        }
        if let Some(light) = self.lights.iter().find(|&&l| l >= HALF_CIRCLE_LIGHTS) {
            let last = HALF_CIRCLE_LIGHTS - 1;
            return bad(format!("light {light}: there are lights 0 to {last}"));
        }
        if self.frames == 0 || self.samples == 0 {
            return bad("frames and samples must be at least 1".into());
        }
        if !self.exact && !self.kinect {
            return bad("depth must be exact, of the sensor model, or both".into());
        }
        once("scene", &self.scenes)?;
        once("preset", &self.presets)?;
        once("light", &self.lights)
    }

    /// All runs, sequence by sequence.
    pub(super) fn jobs<'a>(&self, methods: &'a [Method]) -> Vec<Job<'a>> {
        let mut jobs = Vec::new();
        for scene in &self.scenes {
            for &light in &self.lights {
                let options = self.sequence(scene, light, self.warm_up + self.frames);
                let name = sequence_name(scene, light);
                self.add(&mut jobs, methods, Kind::Run { light }, &name, &options);
            }
        }
        let richest = &self.scenes[self.scenes.len() - 1];
        if self.steps {
            let options = self.switched(richest);
            let kind = Kind::Step { switch_frame: self.switch_frame() };
            self.add(&mut jobs, methods, kind, &format!("light_{richest}_switched"), &options);
        }
        if self.jitter {
            let options = self.sequence(richest, self.lights[0], self.warm_up + self.frames);
            let options = SynthOptions { still: true, ..options };
            let name = format!("light_{richest}_still");
            self.add(&mut jobs, methods, Kind::Jitter, &name, &options);
        }
        jobs
    }

    fn switch_frame(&self) -> usize {
        self.warm_up + STEP_BEFORE
    }

    /// The first light goes off and the last on; where there is but one, that two further.
    fn switched(&self, scene: &str) -> SynthOptions {
        let from = self.lights[0];
        let to = match self.lights[self.lights.len() - 1] {
            last if last == from => (from + HALF_CIRCLE_LIGHTS / 2) % HALF_CIRCLE_LIGHTS,
            last => last,
        };
        let frame = self.switch_frame();
        SynthOptions {
            switch: Some(LightSwitch { frame, light: to }),
            // Only the light changes.
            still: true,
            ..self.sequence(scene, from, frame + STEP_AFTER)
        }
    }

    /// The same for every preset, with and without sensor noise; light probes once, as they need no
    /// depth, and only where light differs from sequence to sequence.
    fn add<'a>(
        &self,
        jobs: &mut Vec<Job<'a>>,
        methods: &'a [Method],
        kind: Kind,
        sequence: &str,
        options: &SynthOptions,
    ) {
        let noises = [(self.exact, false), (self.kinect, true)];
        let noises: Vec<bool> = noises.into_iter().filter(|n| n.0).map(|n| n.1).collect();
        for method in methods {
            let noises = match (method.probe, kind) {
                (None, _) => &noises[..],
                (Some(_), Kind::Run { .. }) => &[false],
                (Some(_), _) => &[],
            };
            jobs.extend(noises.iter().map(|&sensor_noise| Job {
                kind,
                sequence: sequence.to_owned(),
                options: options.clone(),
                sensor_noise,
                method,
            }));
        }
    }

    pub(in crate::study) fn sequence(
        &self,
        scene: &str,
        light: usize,
        frames: usize,
    ) -> SynthOptions {
        SynthOptions {
            scene: scene.to_owned(),
            frames,
            width: self.width,
            height: self.height,
            samples: self.samples,
            kinect_noise: true,
            light: Some(light),
            ..SynthOptions::default()
        }
    }
}

fn once<T: Eq + Hash + Display>(what: &str, values: &[T]) -> Result<(), StudyError> {
    let mut seen = HashSet::new();
    match values.iter().find(|value| !seen.insert(*value)) {
        Some(twice) => Err(StudyError::Options(format!("{what} {twice} is given twice"))),
        None => Ok(()),
    }
}

/// Name of the sequence of one scene under one light.
pub(in crate::study) fn sequence_name(scene: &str, light: usize) -> String {
    format!("light_{scene}_{light}")
}
