//! Named settings. Each preset is written as its difference from another; no code asks for a
//! preset's name.

use super::{Settings, SettingsError};

#[derive(Clone, Copy, Debug)]
pub struct Preset {
    pub name: &'static str,
    pub summary: &'static str,
    /// The preset it starts from; none starts from the defaults.
    base: Option<&'static str>,
    changes: &'static [(&'static str, &'static str)],
}

pub const ALL: &[Preset] = &[
    Preset {
        name: "ours",
        summary: "image-space transfer at every pixel",
        base: None,
        changes: &[],
    },
    Preset {
        name: "ours-fast",
        summary: "image-space transfer on every 4th pixel in x and y",
        base: Some("ours"),
        changes: &[("transfer.subsampling", "4"), ("light.stride", "4")],
    },
    Preset {
        name: "ours-mobile",
        summary: "ours with a 64^3 volume and without D''' (the paper's notebook and tablet)",
        base: Some("ours"),
        changes: &[("volume.resolution", "64"), ("dyn_geo.denoise", "false")],
    },
    Preset {
        name: "ours-fast-mobile",
        summary: "ours-fast with a 64^3 volume and without D'''",
        base: Some("ours-fast"),
        changes: &[("volume.resolution", "64"), ("dyn_geo.denoise", "false")],
    },
    Preset {
        name: "gr12",
        summary: "ray-traced transfer through the volume at every pixel, the model alone as geometry",
        base: Some("ours"),
        changes: &[
            ("transfer.method", "ray-traced"),
            ("bounce.enabled", "false"),
            ("surface.top", "false"),
            ("surface.light", "false"),
            ("dyn_geo.merge", "false"),
            ("dyn_geo.smooth", "false"),
            ("dyn_geo.denoise", "false"),
        ],
    },
    Preset {
        name: "gr14",
        summary: "gr12 on every 4th pixel in x and y, refined at edges of depth and normals",
        base: Some("gr12"),
        changes: &[
            ("transfer.subsampling", "4"),
            ("transfer.refine", "true"),
            ("light.stride", "4"),
        ],
    },
];

pub(super) fn settings(name: &str) -> Result<Settings, SettingsError> {
    let preset =
        ALL.iter().find(|p| p.name == name).ok_or_else(|| SettingsError::UnknownPreset {
            name: name.to_owned(),
            known: ALL.iter().map(|p| p.name).collect::<Vec<_>>().join(", "),
        })?;
    let mut settings = match preset.base {
        Some(base) => settings(base)?,
        None => Settings::default(),
    };
    for (key, value) in preset.changes {
        settings.set(key, value)?;
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_differs_from_ours_only_in_sampling() {
        let (mut fast, ours) = (settings("ours-fast").unwrap(), settings("ours").unwrap());
        assert_eq!(fast.transfer.subsampling, 4);
        fast.transfer.subsampling = ours.transfer.subsampling;
        fast.light.stride = ours.light.stride;
        assert_eq!(fast, ours);
    }

    #[test]
    fn the_ray_traced_presets_take_the_model_alone_and_differ_only_in_sampling() {
        let (gr12, mut gr14) = (settings("gr12").unwrap(), settings("gr14").unwrap());
        assert_eq!(gr12.transfer.method, crate::transfer::TransferMethod::RayTraced);
        assert_eq!(gr12.transfer.ray_length_m, gr12.transfer.radius_m, "both look equally far");
        assert!(!gr12.bounce.enabled && !gr12.dyn_geo.merge && !gr12.surface.light);
        assert!(gr14.transfer.refine && gr14.transfer.subsampling == 4);
        gr14.transfer = gr12.transfer.clone();
        gr14.light.stride = gr12.light.stride;
        assert_eq!(gr14, gr12);
    }
}
