//! The sequences that a study runs over.

use super::truth::TruthFolder;
use super::variants::Variant;
use crate::stop::Stop;
use crate::study::{SequenceStore, StudyError};
use crate::synth::SynthOptions;
use crate::synth::scene::VirtualKind;
use std::path::{Path, PathBuf};

/// A sequence and the depth that is read from it.
pub struct Case {
    pub name: String,
    pub object: String,
    pub sensor_noise: bool,
    /// Whether variants are run, or the presets alone.
    pub variants: bool,
    pub truth: TruthFolder,
    /// What a made sequence was made with.
    pub made: Option<SynthOptions>,
}

impl Case {
    /// What is run here of the selected variants.
    pub fn variants_of<'a>(&self, selected: &'a [Variant]) -> &'a [Variant] {
        if self.variants { selected } else { &[] }
    }

    /// A folder with `virtual.json` and `composite/`.
    pub fn folder(path: &Path) -> Result<Self, StudyError> {
        let truth = TruthFolder::open(path)?;
        let name = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        Ok(Self {
            name: name.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            object: truth.name().to_owned(),
            sensor_noise: false,
            variants: true,
            truth,
            made: None,
        })
    }
}

/// How sequences are made.
#[derive(Clone, Debug)]
pub struct MadeOptions {
    pub frames: usize,
    pub size: (usize, usize),
    /// Light paths a pixel.
    pub samples: u32,
}

impl Default for MadeOptions {
    fn default() -> Self {
        Self { frames: 11, size: (320, 240), samples: 32 }
    }
}

/// A made sequence, its lamp one of the half circle's.
struct Recipe {
    scene: &'static str,
    light: usize,
    object: VirtualKind,
    /// Also with depth of the sensor model (there presets only), and with variants.
    full: bool,
}

const fn recipe(scene: &'static str, light: usize, object: VirtualKind, full: bool) -> Recipe {
    Recipe { scene, light, object, full }
}

/// Scenes of growing richness, each lit from another side, and every kind of object in one of them.
const RECIPES: [Recipe; 6] = [
    recipe("demo", 0, VirtualKind::Figure, true),
    recipe("desk", 1, VirtualKind::Figure, true),
    recipe("room", 3, VirtualKind::Figure, true),
    recipe("desk", 1, VirtualKind::Diffuse, false),
    recipe("desk", 1, VirtualKind::Coloured, false),
    recipe("desk", 1, VirtualKind::BrightDark, false),
];

impl Recipe {
    fn name(&self) -> String {
        format!("{}-light{}-{}", self.scene, self.light, self.object.name())
    }

    fn options(&self, made: &MadeOptions) -> SynthOptions {
        SynthOptions {
            scene: self.scene.into(),
            light: Some(self.light),
            object: Some(self.object),
            frames: made.frames,
            width: made.size.0,
            height: made.size.1,
            samples: made.samples,
            kinect_noise: self.full,
            with_virtual: true,
            // the last frame has seen the most
            virtual_every: made.frames.saturating_sub(1).max(1),
            ..SynthOptions::default()
        }
    }
}

/// Makes the sequences where they are not there yet: each with exact depth, and with that of the sensor
/// model.
pub fn made(
    options: &MadeOptions,
    store: &SequenceStore,
    stop: &Stop,
    progress: &dyn Fn(&str, usize, usize),
) -> Result<Vec<Case>, StudyError> {
    if options.frames == 0 {
        return Err(StudyError::Options("made sequences need at least one frame".into()));
    }
    let mut cases = Vec::new();
    for recipe in &RECIPES {
        let synth = recipe.options(options);
        let name = recipe.name();
        let folder = store.get(&name, &synth, stop, &|done, all| progress(&name, done, all))?;
        let (variants, made) = (recipe.full, Some(synth.clone()));
        cases.push(Case { variants, made, ..Case::folder(&folder)? });
        if recipe.full {
            let case = Case::folder(&folder)?;
            let (sensor_noise, variants, made) = (true, false, Some(synth));
            cases.push(Case { sensor_noise, variants, made, ..case });
        }
    }
    Ok(cases)
}

/// Sequences with truth that come with the program, or are found below `KINLIGHT_DATA`: those of them
/// that are there.
pub fn usual_folders() -> Vec<PathBuf> {
    let data = std::env::var_os("KINLIGHT_DATA").map(PathBuf::from);
    let sample = data.map(|d| d.join("mitsuba-sample"));
    let folders = std::iter::once(PathBuf::from("sequences/demo")).chain(sample);
    folders.filter(|f| f.join("virtual.json").exists()).collect()
}
