//! All settings of a run as one value. Presets are differences from the defaults, see [`presets`].

pub mod presets;
mod ranges;

use crate::capture::InputParams;
use crate::compositing::CompositingParams;
use crate::fusion::{SurfaceParams, VolumeParams};
use crate::geometry::DynGeoParams;
use crate::lighting::LightParams;
use crate::tracking::TrackingParams;
use crate::transfer::{BounceParams, TransferParams};
use serde::{Deserialize, Serialize};

/// One struct per stage, in the order of the data flow. The TOML file has the same keys.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    pub input: InputParams,
    pub tracking: TrackingParams,
    pub volume: VolumeParams,
    pub surface: SurfaceParams,
    pub dyn_geo: DynGeoParams,
    pub transfer: TransferParams,
    pub bounce: BounceParams,
    pub light: LightParams,
    pub compositing: CompositingParams,
}

#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SettingsError {
    #[error("no preset is called '{name}'; there are: {known}")]
    UnknownPreset { name: String, known: String },
    #[error("setting '{given}' is not of the form field=value")]
    NotAnAssignment { given: String },
    #[error("no setting is called '{key}'; '{parent}' has: {known}")]
    UnknownKey { key: String, parent: String, known: String },
    #[error("{key}: {problem}")]
    Value { key: String, problem: String },
    #[error("{file}: {problem}")]
    File { file: String, problem: String },
    #[error("settings out of range:\n  {}", .0.join("\n  "))]
    OutOfRange(Vec<String>),
}

impl Settings {
    pub fn preset(name: &str) -> Result<Self, SettingsError> {
        presets::settings(name)
    }

    /// Reads a TOML file on top of these settings: what the file does not name stays.
    pub fn merge_file(&mut self, path: &std::path::Path) -> Result<(), SettingsError> {
        let at =
            |problem: String| SettingsError::File { file: path.display().to_string(), problem };
        let text = crate::files::read_given_text(path).map_err(|e| at(e.to_string()))?;
        let patch: toml::Table = text.parse().map_err(|e: toml::de::Error| at(e.to_string()))?;
        let mut table = self.table();
        merge(&mut table, patch);
        *self = table.try_into().map_err(|e: toml::de::Error| at(e.to_string()))?;
        Ok(())
    }

    /// Applies one `section.field=value`.
    pub fn assign(&mut self, assignment: &str) -> Result<(), SettingsError> {
        let (key, value) = assignment
            .split_once('=')
            .ok_or_else(|| SettingsError::NotAnAssignment { given: assignment.to_owned() })?;
        self.set(key.trim(), value.trim())
    }

    /// Sets one field by its dotted name; the value is TOML, and text may stand without quotes.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), SettingsError> {
        let mut root = self.table();
        let mut table = &mut root;
        let (path, field) = key.rsplit_once('.').unwrap_or(("", key));
        for section in path.split('.').filter(|s| !s.is_empty()) {
            let unknown = unknown_key(section, "settings", table);
            table = table.get_mut(section).and_then(|v| v.as_table_mut()).ok_or(unknown)?;
        }
        // A field whose value is "none" is absent from the table, so the struct itself has the last word.
        let unknown = unknown_key(field, if path.is_empty() { "settings" } else { path }, table);
        table.insert(field.to_owned(), parse_value(value));
        *self = root.try_into().map_err(|e: toml::de::Error| {
            let problem = e.to_string();
            if problem.contains("unknown field") {
                unknown
            } else {
                SettingsError::Value { key: key.to_owned(), problem: problem.trim().to_owned() }
            }
        })?;
        Ok(())
    }

    /// All problems at once; a checked value is trusted afterwards.
    pub fn validate(&self) -> Result<(), SettingsError> {
        let problems = ranges::problems(self);
        if problems.is_empty() { Ok(()) } else { Err(SettingsError::OutOfRange(problems)) }
    }

    /// TOML that reads back to this same value.
    pub fn to_toml(&self) -> String {
        toml::to_string_pretty(self).expect("settings are plain data")
    }

    fn table(&self) -> toml::Table {
        toml::Table::try_from(self).expect("settings are plain data")
    }
}

fn unknown_key(key: &str, parent: &str, table: &toml::Table) -> SettingsError {
    let known = table.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
    SettingsError::UnknownKey { key: key.to_owned(), parent: parent.to_owned(), known }
}

fn parse_value(text: &str) -> toml::Value {
    format!("v = {text}")
        .parse::<toml::Table>()
        .ok()
        .and_then(|mut t| t.remove("v"))
        .unwrap_or_else(|| toml::Value::String(text.to_owned()))
}

fn merge(into: &mut toml::Table, patch: toml::Table) {
    for (key, value) in patch {
        match (into.get_mut(&key), value) {
            (Some(toml::Value::Table(old)), toml::Value::Table(new)) => merge(old, new),
            (_, value) => {
                into.insert(key, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_in_range_and_survives_toml() {
        for preset in presets::ALL {
            let settings = Settings::preset(preset.name).unwrap();
            settings.validate().unwrap();
            let back: Settings = toml::from_str(&settings.to_toml()).unwrap();
            assert_eq!(back, settings, "{}", preset.name);
        }
    }

    #[test]
    fn set_takes_toml_and_bare_words() {
        let mut s = Settings::default();
        s.assign("transfer.directions=64").unwrap();
        s.assign("tracking.mode = static").unwrap();
        s.assign("tracking.iterations=[8, 4]").unwrap();
        s.assign("volume.centre=[0.0, 0.5, 1.0]").unwrap();
        assert_eq!(s.transfer.directions, 64);
        assert_eq!(s.tracking.mode, crate::tracking::PoseMode::Static);
        assert_eq!(s.tracking.iterations, [8, 4]);
        assert_eq!(s.volume.centre, Some([0.0, 0.5, 1.0]));
    }

    #[test]
    fn mistakes_are_named() {
        let mut s = Settings::default();
        let before = s.clone();
        assert!(matches!(s.assign("transfer"), Err(SettingsError::NotAnAssignment { .. })));
        for bad in ["transfer.direction=3", "transfers.directions=3", "bands=3"] {
            assert!(matches!(s.assign(bad), Err(SettingsError::UnknownKey { .. })), "{bad}");
        }
        for bad in ["transfer.directions=many", "tracking.mode=guess", "dyn_geo.merge=7"] {
            assert!(matches!(s.assign(bad), Err(SettingsError::Value { .. })), "{bad}");
        }
        assert!(matches!(Settings::preset("best"), Err(SettingsError::UnknownPreset { .. })));
        assert_eq!(s, before, "a refused assignment changes nothing");
    }

    #[test]
    fn all_problems_are_reported_at_once() {
        let mut s = Settings::default();
        s.transfer.bands = 7;
        s.volume.resolution = 100;
        s.light.memory = f64::NAN;
        let Err(SettingsError::OutOfRange(problems)) = s.validate() else { panic!() };
        assert_eq!(problems.len(), 3, "{problems:?}");
    }

    #[test]
    fn rays_have_no_bounce() {
        let mut s = Settings::default();
        s.assign("transfer.method=ray-traced").unwrap();
        let error = s.validate().unwrap_err().to_string();
        assert!(error.contains("bounce.enabled is true"), "{error}");
        s.assign("bounce.enabled=false").unwrap();
        s.validate().unwrap();
    }

    #[test]
    fn a_file_changes_only_what_it_names() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.toml");
        std::fs::write(&path, "[transfer]\nbands = 3\n").unwrap();
        let mut s = Settings::preset("ours-fast").unwrap();
        s.merge_file(&path).unwrap();
        assert_eq!((s.transfer.bands, s.transfer.subsampling), (3, 4));
        std::fs::write(&path, "[transfer]\nband = 3\n").unwrap();
        let error = s.merge_file(&path).unwrap_err().to_string();
        assert!(error.contains("s.toml") && error.contains("band"), "{error}");
    }
}
