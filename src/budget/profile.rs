//! What settings cost on a machine, as a file.

use super::BudgetError;
use crate::output::{OutputError, atomic_write};
use crate::study::Machine;
use crate::study::tradeoff::{ErrorKind, TradePoint, Tradeoff, pareto_front};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

const BUILT_IN: &str = include_str!("built_in.toml");

/// The front of a sweep: of all its points, and of those of each volume, since a run cannot change
/// its volume and wants a whole ladder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    pub error: ErrorKind,
    pub sequences: Vec<String>,
    pub machine: Machine,
    /// Fastest first.
    pub steps: Vec<ProfileStep>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProfileStep {
    pub name: String,
    pub preset: String,
    /// `field=value` on top of the preset.
    pub changes: Vec<String>,
    pub update_ms: f64,
    pub error: f64,
    /// By [`crate::timing::Stage::name`].
    pub stage_ms: BTreeMap<String, f64>,
}

impl Profile {
    /// `None` where no point has that error.
    pub fn of(study: &Tradeoff, kind: ErrorKind) -> Option<Self> {
        let mut by_volume: BTreeMap<String, Vec<&TradePoint>> = BTreeMap::new();
        for point in &study.points {
            by_volume.entry(volume_of(point)).or_default().push(point);
        }
        let mut steps = Vec::new();
        for points in by_volume.values() {
            let plane: Vec<_> =
                points.iter().map(|p| (p.update_ms, kind.of(p).unwrap_or(f64::NAN))).collect();
            let on_front = points.iter().zip(pareto_front(&plane)).filter(|(_, on)| *on);
            steps.extend(on_front.filter_map(|(p, _)| step(p, kind)));
        }
        steps.sort_by(|a, b| a.update_ms.total_cmp(&b.update_ms));
        (!steps.is_empty()).then(|| Self {
            error: kind,
            sequences: study.sequences.clone(),
            machine: study.machine.clone(),
            steps,
        })
    }

    pub fn read(path: &Path) -> Result<Self, BudgetError> {
        let at =
            |problem: String| BudgetError::Profile { path: path.display().to_string(), problem };
        let text = crate::files::read_given_text(path).map_err(|e| at(e.to_string()))?;
        Self::parse(&text).map_err(at)
    }

    /// Replaces the file as a whole, or leaves it as it was.
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let text = toml::to_string(self).expect("a profile is plain data");
        atomic_write(path, |out| {
            writeln!(out, "# What settings cost on this machine. Made by `kinlight tradeoff`.")?;
            out.write_all(text.as_bytes())
        })
    }

    /// Measured on another machine: good for what is faster than what, and by how much.
    pub fn built_in() -> Self {
        Self::parse(BUILT_IN).expect("the built-in profile is tested")
    }

    /// For a backend, "cpu" or "gpu": `explicit`, else that of this machine, else the built-in one. A file
    /// that is there but broken is an error. Says on the log which is taken.
    pub fn find(explicit: Option<&Path>, backend: &str) -> Result<Self, BudgetError> {
        let here = Machine { backend: backend.to_owned(), ..Machine::here() };
        let default = Self::default_path(backend);
        let path = match explicit {
            Some(path) => Some(path.to_owned()),
            None => default.as_ref().ok().filter(|path| path.exists()).cloned(),
        };
        let Some(path) = path else {
            let profile = Self::built_in();
            log::info!("budget: {}", profile.as_substitute(&here, default.ok().as_deref()));
            return Ok(profile);
        };
        let profile = Self::read(&path)?;
        log::info!("budget: profile {}, {} steps", path.display(), profile.steps.len());
        let there = &profile.machine;
        let known = |m: &Machine| (m.cpu.clone(), m.threads, m.version.clone(), m.backend.clone());
        if known(there) != known(&here) {
            log::warn!(
                "budget: the profile was measured on {} with {} threads by version {}, backend {}, this is \
                 {} with {}, {} and {}: its times will be scaled by what is measured",
                there.cpu,
                there.threads,
                there.version,
                there.backend,
                here.cpu,
                here.threads,
                here.version,
                here.backend
            );
        }
        Ok(profile)
    }

    /// Why this one is taken.
    fn as_substitute(&self, here: &Machine, place: Option<&Path>) -> String {
        let Machine { cpu, threads, backend, .. } = &self.machine;
        let measured = format!("taking the built-in one, measured on {cpu} with {threads} threads");
        if here.backend == *backend {
            return format!(
                "this machine has no profile (`kinlight tradeoff` makes one); {measured}"
            );
        }
        let place = place.map_or_else(|| "--profile".to_owned(), |path| path.display().to_string());
        format!(
            "there is no profile of the {} backend ({place}); {measured}, backend {backend}: its times \
             will be scaled by what is measured",
            here.backend
        )
    }

    /// `$XDG_CONFIG_HOME/kinlight/profile-<backend>.toml`, `~/.config` where that is not set.
    pub fn default_path(backend: &str) -> Result<PathBuf, BudgetError> {
        path_in(std::env::var_os("XDG_CONFIG_HOME"), std::env::var_os("HOME"), backend)
    }

    fn parse(text: &str) -> Result<Self, String> {
        let profile: Self = toml::from_str(text).map_err(|e| e.to_string())?;
        if profile.steps.is_empty() {
            return Err("it has no steps".into());
        }
        for step in &profile.steps {
            let timed = step.update_ms > 0.0 && step.update_ms.is_finite();
            let judged = step.error >= 0.0 && step.error.is_finite();
            if !(timed && judged) {
                return Err(format!(
                    "step '{}': update_ms must be above 0, error not negative",
                    step.name
                ));
            }
        }
        Ok(profile)
    }
}

/// Relative paths are to be ignored, says the XDG base directory specification.
fn path_in(
    config: Option<OsString>,
    home: Option<OsString>,
    backend: &str,
) -> Result<PathBuf, BudgetError> {
    let absolute = |folder: Option<OsString>| folder.map(PathBuf::from).filter(|p| p.is_absolute());
    let folder = absolute(config).or_else(|| absolute(home).map(|home| home.join(".config")));
    let folder = folder.ok_or(BudgetError::NoPlace)?;
    Ok(folder.join("kinlight").join(format!("profile-{backend}.toml")))
}

/// What a point says about the volume; presets speak for themselves.
fn volume_of(point: &TradePoint) -> String {
    let changes = point.changes.iter().map(String::as_str);
    let settings = crate::config::Settings::preset(&point.preset).map(|mut settings| {
        let applied = changes.clone().try_for_each(|c| settings.assign(c));
        applied.map(|()| format!("{:?}", settings.volume))
    });
    match settings {
        Ok(Ok(volume)) => volume,
        // of another version: told apart by its words, and refused where it is used
        _ => format!("{} {:?}", point.preset, point.changes),
    }
}

fn step(point: &TradePoint, kind: ErrorKind) -> Option<ProfileStep> {
    let mut stage_ms = point.stage_ms.clone();
    stage_ms.remove("Update");
    Some(ProfileStep {
        name: point.name.clone(),
        preset: point.preset.clone(),
        changes: point.changes.clone(),
        update_ms: point.update_ms,
        error: kind.of(point)?,
        stage_ms,
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub fn profile(steps: &[(&str, &[&str], f64, f64)]) -> Profile {
        Profile {
            error: ErrorKind::Composite,
            sequences: vec!["sequences/demo".into()],
            machine: Machine::here(),
            steps: steps
                .iter()
                .map(|&(preset, changes, update_ms, error)| ProfileStep {
                    name: format!("{preset} {changes:?}"),
                    preset: preset.to_owned(),
                    changes: changes.iter().map(|&c| c.to_owned()).collect(),
                    update_ms,
                    error,
                    stage_ms: BTreeMap::from([("Surface".to_owned(), 3.5)]),
                })
                .collect(),
        }
    }

    fn point(changes: &[&str], update_ms: f64, error: Option<f64>) -> TradePoint {
        TradePoint {
            name: changes.join(", "),
            preset: "ours".to_owned(),
            changes: changes.iter().map(|&c| c.to_owned()).collect(),
            stage_ms: [("Update".to_owned(), update_ms), ("Input".to_owned(), 1.0)].into(),
            update_ms,
            light_angle_deg: None,
            light_relative_l2: None,
            transfer_error: None,
            composite_error: error,
            volume_mib: 1.0,
            on_front: false,
        }
    }

    #[test]
    fn a_profile_has_the_front_of_every_volume() {
        let small = "volume.resolution=64";
        let study = Tradeoff {
            machine: Machine::here(),
            command: String::new(),
            sequences: vec!["a".into()],
            warm_up: 1,
            points: vec![
                point(&[], 300.0, Some(0.1)),
                point(&["transfer.directions=16"], 200.0, Some(0.2)),
                point(&["transfer.directions=8"], 250.0, Some(0.3)),
                point(&[small], 290.0, Some(0.09)),
                point(&[small, "transfer.directions=16"], 190.0, None),
            ],
        };
        let profile = Profile::of(&study, ErrorKind::Composite).unwrap();
        let names: Vec<&str> = profile.steps.iter().map(|s| &s.name[..]).collect();
        // the 64-voxel point beats ours, which stays as the best of its own volume
        assert_eq!(names, ["transfer.directions=16", small, ""]);
        assert!(!profile.steps[0].stage_ms.contains_key("Update"));
        assert!(Profile::of(&study, ErrorKind::Light).is_none());
    }

    #[test]
    fn files_are_whole_and_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/profile-cpu.toml");
        let profile =
            profile(&[("ours-fast", &[], 95.0, 0.2), ("ours", &["light.stride=4"], 300.0, 0.1)]);
        profile.write(&path).unwrap();
        assert_eq!(Profile::read(&path).unwrap(), profile);
        for backend in ["cpu", "gpu"] {
            assert_eq!(Profile::find(Some(&path), backend).unwrap(), profile);
        }
        for (text, word) in [
            ("error = \"composite\"", "missing field"),
            (&std::fs::read_to_string(&path).unwrap().replace("300.0", "nan"), "above 0"),
            (&std::fs::read_to_string(&path).unwrap().replace("0.1", "-0.1"), "negative"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = Profile::find(Some(&path), "gpu").unwrap_err().to_string();
            assert!(message.contains(word) && message.contains("profile-cpu.toml"), "{message}");
        }
        assert!(Profile::find(Some(&folder.path().join("none.toml")), "cpu").is_err());
    }

    #[test]
    fn a_profile_of_another_backend_says_so() {
        let here = |backend: &str| Machine { backend: backend.to_owned(), ..Machine::here() };
        let place = path_in(Some("/c".into()), None, "gpu").unwrap();
        let words = |backend| Profile::built_in().as_substitute(&here(backend), Some(&place));
        assert!(words("gpu").contains("/c/kinlight/profile-gpu.toml"), "{}", words("gpu"));
        assert!(words("gpu").contains("backend cpu"), "{}", words("gpu"));
        assert!(words("cpu").contains("kinlight tradeoff"), "{}", words("cpu"));
    }

    #[test]
    fn the_place_follows_the_xdg_specification() {
        let path = |config: Option<&str>, home: Option<&str>| {
            path_in(config.map(Into::into), home.map(Into::into), "cpu").ok()
        };
        let expected = |text: &str| Some(PathBuf::from(text));
        assert_eq!(path(Some("/c"), Some("/h")), expected("/c/kinlight/profile-cpu.toml"));
        assert_eq!(path(None, Some("/h")), expected("/h/.config/kinlight/profile-cpu.toml"));
        assert_eq!(path(Some("c"), Some("/h")), expected("/h/.config/kinlight/profile-cpu.toml"));
        assert_eq!(path(Some(""), None), None);
    }

    #[test]
    fn the_built_in_profile_is_sound_and_tells_budgets_apart() {
        let profile = Profile::built_in();
        for step in &profile.steps {
            let stages: f64 = step.stage_ms.values().sum();
            // medians of stages against the median of sums
            assert!((0.9..1.1).contains(&(stages / step.update_ms)), "{}: {stages}", step.name);
        }
        let start = |ms| {
            let budget = std::time::Duration::from_millis(ms);
            let ladder = super::super::Ladder::choose(&profile, budget, &|_| Ok(())).unwrap();
            let start = &ladder.rungs()[ladder.start()];
            assert!(start.predicted_ms <= ms as f64);
            start.settings.clone()
        };
        assert_ne!(start(100), start(400));
    }
}
