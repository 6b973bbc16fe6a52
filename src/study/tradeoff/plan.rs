//! Which settings a sweep measures.
//!
//! Settings are points of a lattice whose axes are listed in [`AXES`]. The full product has tens of
//! thousands; the plan is
//! - every preset,
//! - every value of every axis alone, around `ours` and around `ours-fast`,
//! - the product of the axes that matter most: subsampling, directions, samples,
//! - afterwards the lattice neighbours of what came out on the front ([`neighbours`]).

use super::super::StudyError;
use crate::config::{Settings, presets};

/// Settings to measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    pub name: String,
    pub preset: String,
    /// `field=value` on top of the preset.
    pub changes: Vec<String>,
    pub settings: Settings,
    /// Its place on the lattice, where it has one.
    pub(super) place: Option<Place>,
}

/// An index into the values of each axis.
pub(super) type Place = [usize; AXES.len()];

struct Axis {
    values: &'static [Value],
    /// Which of them `ours` has.
    ours: usize,
    /// Whether names always tell it.
    named: bool,
}

struct Value {
    label: &'static str,
    /// From `ours`.
    changes: &'static [&'static str],
}

const fn value(label: &'static str, changes: &'static [&'static str]) -> Value {
    Value { label, changes }
}

const STEP: usize = 0;
const DIRECTIONS: usize = 1;
const SAMPLES: usize = 2;

/// Where `ours-fast` is on the axis of steps.
const STEP_4: usize = 2;

const AXES: [Axis; 8] = [
    Axis {
        values: &[
            value("step 1", &[]),
            value("step 2", &["transfer.subsampling=2"]),
            value("step 4", &["transfer.subsampling=4", "light.stride=4"]),
            value("step 8", &["transfer.subsampling=8", "light.stride=8"]),
        ],
        ours: 0,
        named: true,
    },
    Axis {
        values: &[
            value("8 directions", &["transfer.directions=8"]),
            value("16 directions", &["transfer.directions=16"]),
            value("32 directions", &[]),
            value("64 directions", &["transfer.directions=64"]),
            value("128 directions", &["transfer.directions=128"]),
            value("256 directions", &["transfer.directions=256"]),
        ],
        ours: 2,
        named: true,
    },
    Axis {
        values: &[value("1 sample", &["transfer.samples=1"]), value("3 samples", &[])],
        ours: 1,
        named: true,
    },
    Axis {
        values: &[
            value("2 bands", &["transfer.bands=2"]),
            value("3 bands", &["transfer.bands=3"]),
            value("4 bands", &[]),
            value("5 bands", &["transfer.bands=5"]),
        ],
        ours: 2,
        named: false,
    },
    Axis {
        values: &[
            value("no auxiliary buffers", &["surface.top=false", "surface.light=false"]),
            value("one auxiliary buffer a frame", &[]),
            value("all auxiliary buffers every frame", &["surface.refresh_per_frame=0"]),
            value("auxiliary buffers from all sides", &["surface.left=true", "surface.right=true"]),
        ],
        ours: 1,
        named: false,
    },
    Axis {
        values: &[
            value("volume 64", &["volume.resolution=64"]),
            value("volume 128", &["volume.resolution=128"]),
            value("volume 256", &[]),
            value("volume 512", &["volume.resolution=512"]),
        ],
        ours: 2,
        named: false,
    },
    Axis {
        values: &[
            value("without D'", &["dyn_geo.merge=false"]),
            value("without D'' and D'''", &["dyn_geo.smooth=false", "dyn_geo.denoise=false"]),
            value("without D'''", &["dyn_geo.denoise=false"]),
            value("D', D'' and D'''", &[]),
        ],
        ours: 3,
        named: false,
    },
    Axis {
        values: &[value("no bounce", &["bounce.enabled=false"]), value("bounce", &[])],
        ours: 1,
        named: false,
    },
];

/// The first round: everything of the module's list but the neighbours. `quick` leaves a sixth.
pub fn plan(quick: bool) -> Result<Vec<Variant>, StudyError> {
    let ours: Place = std::array::from_fn(|axis| AXES[axis].ours);
    let fast = with(ours, STEP, STEP_4);
    let mut places = Vec::new();
    if quick {
        places.extend(
            product(ours, &[0..4, 0..3, 0..2]).filter(|p| p[STEP] > 0 || p[DIRECTIONS] > 0),
        );
    } else {
        for base in [ours, fast] {
            for (axis, Axis { values, .. }) in AXES.iter().enumerate() {
                places.extend((0..values.len()).map(|at| with(base, axis, at)));
            }
        }
        let all = [STEP, DIRECTIONS, SAMPLES].map(|axis| 0..AXES[axis].values.len());
        places.extend(product(ours, &all));
    }
    let mut variants = Vec::new();
    for preset in presets::ALL.iter().filter(|p| !quick || p.name.starts_with("ours")) {
        push_new(&mut variants, of_preset(preset.name)?);
    }
    for place in places {
        push_new(&mut variants, at_place(place)?);
    }
    Ok(variants)
}

/// What is one step on one axis away from `of` and not in `known`.
pub fn neighbours<'a>(
    of: impl IntoIterator<Item = &'a Variant>,
    known: &[Variant],
) -> Result<Vec<Variant>, StudyError> {
    let mut new = known.to_vec();
    for place in of.into_iter().filter_map(|v| v.place) {
        for axis in 0..AXES.len() {
            let at = place[axis];
            let beside = [at.checked_sub(1), (at + 1 < AXES[axis].values.len()).then_some(at + 1)];
            for at in beside.into_iter().flatten() {
                push_new(&mut new, at_place(with(place, axis, at))?);
            }
        }
    }
    Ok(new.split_off(known.len()))
}

fn with(mut place: Place, axis: usize, at: usize) -> Place {
    place[axis] = at;
    place
}

/// All places over ranges of the first axes.
fn product(base: Place, ranges: &[std::ops::Range<usize>]) -> impl Iterator<Item = Place> {
    ranges
        .iter()
        .enumerate()
        .fold(vec![base], |places, (axis, range)| {
            let spread = |place: Place| range.clone().map(move |at| with(place, axis, at));
            places.into_iter().flat_map(spread).collect()
        })
        .into_iter()
}

/// Two names for the same settings are measured once. A place on the lattice is kept: neighbours
/// of presets are looked for too.
fn push_new(variants: &mut Vec<Variant>, new: Variant) {
    match variants.iter_mut().find(|v| v.settings == new.settings) {
        Some(known) => known.place = known.place.or(new.place),
        None => variants.push(new),
    }
}

fn of_preset(name: &str) -> Result<Variant, StudyError> {
    Ok(Variant {
        name: name.to_owned(),
        preset: name.to_owned(),
        changes: Vec::new(),
        settings: Settings::preset(name)?,
        place: None,
    })
}

fn at_place(place: Place) -> Result<Variant, StudyError> {
    let values = AXES.iter().zip(place);
    let labels = values.clone().filter(|(axis, at)| axis.named || *at != axis.ours);
    let name = labels.map(|(axis, at)| axis.values[at].label).collect::<Vec<_>>().join(", ");
    let changes: Vec<String> =
        values.flat_map(|(axis, at)| axis.values[at].changes).map(|&c| c.to_owned()).collect();
    let mut settings = Settings::preset("ours")?;
    for change in &changes {
        settings.assign(change)?;
    }
    settings.validate()?;
    Ok(Variant { name, preset: "ours".to_owned(), changes, settings, place: Some(place) })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_distinct(variants: &[Variant]) {
        for (i, a) in variants.iter().enumerate() {
            for b in &variants[..i] {
                assert!(a.settings != b.settings && a.name != b.name, "{} / {}", a.name, b.name);
            }
        }
    }

    #[test]
    fn every_variant_is_valid_once_and_what_it_says() {
        for (quick, count) in [(true, 15..40), (false, 60..100)] {
            let variants = plan(quick).unwrap();
            assert!(count.contains(&variants.len()), "{}", variants.len());
            assert_distinct(&variants);
            for variant in &variants {
                let mut again = Settings::preset(&variant.preset).unwrap();
                variant.changes.iter().for_each(|c| again.assign(c).unwrap());
                again.validate().unwrap();
                assert_eq!(again, variant.settings, "{}", variant.name);
            }
        }
    }

    #[test]
    fn the_plan_covers_the_axes_and_their_product() {
        let variants = plan(false).unwrap();
        let has = |change: &str| {
            let mut ours = Settings::preset("ours").unwrap();
            let mut fast = Settings::preset("ours-fast").unwrap();
            ours.assign(change).unwrap();
            fast.assign(change).unwrap();
            [ours, fast].iter().all(|s| variants.iter().any(|v| v.settings == *s))
        };
        for change in AXES[DIRECTIONS..].iter().flat_map(|a| a.values).flat_map(|v| v.changes) {
            // the auxiliary buffers go together
            assert!(
                has(change) || change.starts_with("surface.") || change.starts_with("dyn_geo"),
                "{change}"
            );
        }
        for (step, directions, samples) in [(1, 256, 3), (2, 8, 1), (4, 128, 3), (8, 256, 1)] {
            let at = |v: &Variant| {
                let t = &v.settings.transfer;
                (t.subsampling, t.directions, t.samples) == (step, directions, samples)
            };
            assert!(variants.iter().any(at), "{step} {directions} {samples}");
        }
    }

    #[test]
    fn ours_and_ours_fast_are_places_and_have_neighbours() {
        let variants = plan(true).unwrap();
        for preset in ["ours", "ours-fast"] {
            let base = variants.iter().find(|v| v.name == preset).unwrap();
            assert!(base.changes.is_empty() && base.place.is_some());
            let near = neighbours([base], &variants).unwrap();
            assert!(near.len() >= 8, "{preset}: {}", near.len());
            assert_distinct(&[&variants[..], &near].concat());
        }
        let full = plan(false).unwrap();
        let ours = full.iter().find(|v| v.name == "ours").unwrap();
        assert!(neighbours([ours], &full).unwrap().is_empty(), "all are in the plan");
    }
}
