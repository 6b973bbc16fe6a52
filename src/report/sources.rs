//! What there is to report: records that studies and runs have left in folders.

use super::run_record::{RUN_RECORD, RunRecord};
use crate::files;
use crate::output::TimingSummary;
use crate::study::composite::CompositeStudy;
use crate::study::light::LightStudy;
use crate::study::tradeoff::Tradeoff;
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};

/// Everything that was found, in the order of the folders.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    pub light: Vec<Found<LightStudy>>,
    pub composite: Vec<Found<CompositeStudy>>,
    pub tradeoff: Vec<Found<Tradeoff>>,
    pub runs: Vec<RunFolder>,
    pub problems: Vec<Problem>,
}

/// A record and the folder that it lies in.
#[derive(Clone, Debug)]
pub struct Found<T> {
    pub folder: PathBuf,
    pub record: T,
}

/// What `replay`, or `compare` for one preset, has left.
#[derive(Clone, Debug)]
pub struct RunFolder {
    pub folder: PathBuf,
    /// The preset; the folder's name where that is not known.
    pub name: String,
    pub made_by: Option<RunRecord>,
    pub timings: Option<TimingSummary>,
    /// `summary.json`.
    pub summary: Option<serde_json::Value>,
    /// `settings.toml`.
    pub settings: Option<toml::Table>,
    /// Composed frames, in their order.
    pub frames: Vec<PathBuf>,
}

/// A file that is there and cannot be used.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    pub path: PathBuf,
    pub problem: String,
}

impl std::fmt::Display for Problem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: {}", self.path.display(), self.problem)
    }
}

impl Sources {
    /// Looks for studies in `light/`, `composite/`, `tradeoff/`, the same below `study/`, and for
    /// runs in each folder and in those right below it. A folder that holds a study itself counts too.
    pub fn find(folders: &[PathBuf]) -> Self {
        let mut sources = Self::default();
        for folder in folders {
            if !folder.is_dir() {
                sources.problem(folder, "no folder is there");
                continue;
            }
            sources.find_study_here(folder);
            for root in [folder.clone(), folder.join("study")] {
                sources.light.extend(read_study(&root.join("light"), &mut sources.problems));
                sources
                    .composite
                    .extend(read_study(&root.join("composite"), &mut sources.problems));
                sources.tradeoff.extend(read_study(&root.join("tradeoff"), &mut sources.problems));
            }
            for below in [vec![folder.clone()], folders_in(folder)].concat() {
                sources.runs.extend(read_run(&below, &mut sources.problems));
            }
        }
        sources
    }

    pub fn is_empty(&self) -> bool {
        self.light.is_empty()
            && self.composite.is_empty()
            && self.tradeoff.is_empty()
            && self.runs.is_empty()
    }

    /// The first run of a preset that has stage times.
    pub(super) fn timings_of(&self, preset: &str) -> Option<&TimingSummary> {
        self.runs.iter().filter(|r| r.name == preset).find_map(|r| r.timings.as_ref())
    }

    /// What a page of these lacks, and the command that makes it.
    pub fn missing(&self) -> Vec<(&'static str, &'static str)> {
        [
            (self.runs.is_empty(), "stage times of presets", "kinlight compare"),
            (self.light.is_empty(), "light study", "kinlight study light"),
            (self.composite.is_empty(), "composite study", "kinlight study composite"),
            (self.tradeoff.is_empty(), "sweep of settings", "kinlight tradeoff"),
        ]
        .into_iter()
        .filter_map(|(missing, what, command)| missing.then_some((what, command)))
        .collect()
    }

    /// A folder that was named itself: what its record is shows in its fields.
    fn find_study_here(&mut self, folder: &Path) {
        let Ok(text) = files::read_text(&folder.join("study.json")) else { return };
        let keys: serde_json::Value = serde_json::from_str(&text).unwrap_or_default();
        if keys.get("methods").is_some() {
            self.light.extend(read_study(folder, &mut self.problems));
        } else if keys.get("points").is_some() {
            self.tradeoff.extend(read_study(folder, &mut self.problems));
        } else if keys.get("runs").is_some() {
            self.composite.extend(read_study(folder, &mut self.problems));
        } else {
            self.problem(&folder.join("study.json"), "not a study that is known here");
        }
    }

    fn problem(&mut self, path: &Path, problem: &str) {
        self.problems.push(Problem { path: path.to_owned(), problem: problem.to_owned() });
    }
}

fn read_study<T: DeserializeOwned>(folder: &Path, problems: &mut Vec<Problem>) -> Option<Found<T>> {
    let record = read_json(&folder.join("study.json"), problems)?;
    Some(Found { folder: folder.to_owned(), record })
}

fn read_run(folder: &Path, problems: &mut Vec<Problem>) -> Option<RunFolder> {
    if !["timings.json", "summary.json"].iter().any(|name| folder.join(name).exists()) {
        return None;
    }
    let made_by: Option<RunRecord> = read_json(&folder.join(RUN_RECORD), problems);
    let own_name = || folder.file_name().map(|n| n.to_string_lossy().into_owned());
    Some(RunFolder {
        name: made_by.as_ref().map(|m| m.preset.clone()).or_else(own_name).unwrap_or_default(),
        made_by,
        timings: read_json(&folder.join("timings.json"), problems),
        summary: read_json(&folder.join("summary.json"), problems),
        settings: read_settings(&folder.join("settings.toml"), problems),
        frames: pictures_in(&folder.join("frames")),
        folder: folder.to_owned(),
    })
}

/// `None` where there is no such file; one that is broken becomes a problem.
fn read_json<T: DeserializeOwned>(path: &Path, problems: &mut Vec<Problem>) -> Option<T> {
    read_with(path, problems, |text| serde_json::from_str(text).map_err(|e| e.to_string()))
}

fn read_settings(path: &Path, problems: &mut Vec<Problem>) -> Option<toml::Table> {
    read_with(path, problems, |text| text.parse().map_err(|e: toml::de::Error| e.to_string()))
}

fn read_with<T>(
    path: &Path,
    problems: &mut Vec<Problem>,
    parse: impl FnOnce(&str) -> Result<T, String>,
) -> Option<T> {
    let parsed = match files::read_text(path) {
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
        Err(e) => Err(e.to_string()),
        Ok(text) => parse(&text),
    };
    parsed
        .map_err(|problem| {
            let problem = problem.trim().to_owned();
            problems.push(Problem { path: path.to_owned(), problem });
        })
        .ok()
}

fn folders_in(folder: &Path) -> Vec<PathBuf> {
    sorted(folder, |path| path.is_dir())
}

pub(super) fn pictures_in(folder: &Path) -> Vec<PathBuf> {
    let is_picture = |path: &Path| path.extension().is_some_and(|e| e == "png" || e == "jpg");
    let mut paths = sorted(folder, is_picture);
    // without the extension, so that "ours" comes before "ours-fast"
    paths.sort_by(|a, b| a.file_stem().cmp(&b.file_stem()));
    paths
}

/// Entries of a folder by name; none where it cannot be read.
fn sorted(folder: &Path, wanted: impl Fn(&Path) -> bool) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path());
    let mut paths: Vec<PathBuf> = entries.filter(|p| wanted(p)).collect();
    paths.sort();
    paths
}

/// Folders below `pictures/` of a study, one a case.
pub(super) fn picture_cases(study: &Path) -> Vec<PathBuf> {
    folders_in(&study.join("pictures"))
}
