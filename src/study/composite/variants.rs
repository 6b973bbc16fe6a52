//! The choices that the program leaves open, each as a change of settings.

use crate::config::{Settings, SettingsError};
use serde::{Deserialize, Serialize};

/// Which light the frames are composed under.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LightSource {
    #[default]
    Estimated,
    /// The true light of the emitters.
    True,
    /// The true light that arrives in the scene's middle, scattered light included.
    TrueWithScattered,
}

/// One question put to a preset.
#[derive(Clone, Copy, Debug)]
pub struct Variant {
    /// Short name, for the command line.
    pub key: &'static str,
    /// In words, for tables.
    pub words: &'static str,
    /// `field=value`.
    pub changes: &'static [&'static str],
    pub light: LightSource,
    /// Takes the mean albedo for which the preset's estimated light is as strong as the true one.
    pub true_albedo: bool,
}

const fn settings(
    key: &'static str,
    words: &'static str,
    changes: &'static [&'static str],
) -> Variant {
    Variant { key, words, changes, light: LightSource::Estimated, true_albedo: false }
}

/// The key of a preset as it is.
pub const PRESET: &str = "preset";

/// All variants. Those that change nothing in a preset are left out when it is run.
pub const ALL: &[Variant] = &[
    settings("chi-text", "chi of the text", &["transfer.chi=text"]),
    settings("chi-neighbour", "chi to the neighbour", &["transfer.chi=neighbour"]),
    settings("chi-printed", "chi as printed", &["transfer.chi=printed"]),
    settings(
        "bicubic-gauss",
        "bicubic and Gaussian up-sampling",
        &["compositing.upsampling=bicubic-gauss"],
    ),
    settings(
        "joint-bilateral",
        "joint bilateral up-sampling",
        &["compositing.upsampling=joint-bilateral"],
    ),
    settings("ratio", "ratio compositor", &["compositing.compositor=ratio"]),
    settings("difference", "difference as printed", &["compositing.compositor=difference"]),
    settings("directions-16", "16 directions", &["transfer.directions=16"]),
    settings("directions-32", "32 directions", &["transfer.directions=32"]),
    settings("directions-64", "64 directions", &["transfer.directions=64"]),
    settings("directions-128", "128 directions", &["transfer.directions=128"]),
    settings("samples-1", "1 sample a direction", &["transfer.samples=1"]),
    settings("samples-3", "3 samples a direction", &["transfer.samples=3"]),
    settings("samples-6", "6 samples a direction", &["transfer.samples=6"]),
    settings("no-left", "no buffer from the left", &["surface.left=false"]),
    settings("no-right", "no buffer from the right", &["surface.right=false"]),
    settings(
        "no-left-right",
        "no buffers from left and right",
        &["surface.left=false", "surface.right=false"],
    ),
    settings("no-top", "no buffer from above", &["surface.top=false"]),
    settings("no-light-buffer", "no buffer from the light", &["surface.light=false"]),
    settings(
        "no-auxiliary",
        "no auxiliary buffer",
        &["surface.left=false", "surface.right=false", "surface.top=false", "surface.light=false"],
    ),
    settings("no-bounce", "without the bounce", &["bounce.enabled=false"]),
    settings("bands-2", "2 bands", &["transfer.bands=2"]),
    settings("bands-3", "3 bands", &["transfer.bands=3"]),
    settings("bands-4", "4 bands", &["transfer.bands=4"]),
    settings("bands-5", "5 bands", &["transfer.bands=5"]),
    settings("prior-dark", "dark prior", &["light.prior=dark"]),
    settings("prior-distant", "lamp at infinity", &["light.prior=distant-lamp"]),
    settings("no-denoise", "without D'''", &["dyn_geo.denoise=false"]),
    Variant { light: LightSource::True, ..settings("true-light", "true light", &[]) },
    Variant {
        light: LightSource::TrueWithScattered,
        ..settings("true-light-scattered", "true light with what the scene scatters", &[])
    },
    // With a light that is given, the albedo takes no part but in the bounce.
    Variant { true_albedo: true, ..settings("true-albedo", "true mean albedo", &[]) },
];

impl Variant {
    /// The preset's settings with this variant's changes.
    pub fn apply(&self, preset: &Settings) -> Result<Settings, SettingsError> {
        let mut settings = preset.clone();
        for change in self.changes {
            settings.assign(change)?;
        }
        settings.validate()?;
        Ok(settings)
    }

    /// Whether it asks anything of a preset.
    pub fn differs(&self, settings: &Settings, preset: &Settings) -> bool {
        settings != preset || self.light != LightSource::Estimated || self.true_albedo
    }
}

/// "all", "presets" (none), or keys.
pub fn select(names: &[String]) -> Result<Vec<Variant>, String> {
    let mut selected: Vec<Variant> = Vec::new();
    for name in names {
        match name.as_str() {
            "all" => selected.extend(ALL),
            "presets" => {}
            key => {
                let known = || ALL.iter().map(|v| v.key).collect::<Vec<_>>().join(", ");
                let variant = ALL.iter().find(|v| v.key == key);
                selected.push(*variant.ok_or_else(|| {
                    format!("no variant is called '{key}'; there are: all, presets, {}", known())
                })?);
            }
        }
    }
    let mut seen = std::collections::HashSet::new();
    selected.retain(|v| seen.insert(v.key));
    Ok(selected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::presets;
    use crate::transfer::TransferMethod;

    #[test]
    fn every_variant_is_valid_on_every_preset() {
        let all = presets::ALL.iter().map(|preset| Settings::preset(preset.name).unwrap());
        for preset in all {
            let asked = |v: &&Variant| v.differs(&v.apply(&preset).unwrap(), &preset);
            // each choice has one value that is the preset's own; ray-traced presets have no bounce, no
            // side views and no D''' either
            let own = match preset.transfer.method {
                TransferMethod::ImageSpace => 8,
                TransferMethod::RayTraced => 15,
            };
            let asked = ALL.iter().filter(asked).count();
            assert!(asked >= ALL.len() - own, "{asked} of {}", ALL.len());
        }
    }

    #[test]
    fn names_select() {
        let names = |list: &[&str]| list.iter().map(|s| s.to_string()).collect::<Vec<_>>();
        let keys = |list: &[&str]| {
            select(&names(list)).map(|v| v.iter().map(|v| v.key).collect::<Vec<_>>())
        };
        assert_eq!(keys(&["presets"]), Ok(vec![]));
        assert_eq!(keys(&["bands-3", "no-top", "bands-3"]), Ok(vec!["bands-3", "no-top"]));
        assert_eq!(keys(&["all"]).unwrap().len(), ALL.len());
        assert!(keys(&["bands-9"]).unwrap_err().contains("'bands-9'; there are: all"));
    }
}
