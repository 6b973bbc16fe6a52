//! The settings a run may use, from most accurate to fastest.

use super::controller::FITS;
use super::{BudgetError, Profile, ProfileStep};
use crate::config::{Settings, SettingsError};
use crate::study::tradeoff::pareto_front;
use std::time::Duration;

/// Share of the budget that some settings within reach take at most: on another machine, or another
/// day, all are slower than predicted.
const COMFORTABLE: f64 = 0.8;

/// One choice of settings, and what the profile says it costs.
#[derive(Clone, Debug, PartialEq)]
pub struct Rung {
    pub name: String,
    pub settings: Settings,
    pub predicted_ms: f64,
    pub error: f64,
}

/// Slowest and most accurate first; each rung is faster and less accurate than the one before.
#[derive(Clone, Debug)]
pub struct Ladder {
    rungs: Vec<Rung>,
    start: usize,
}

impl Ladder {
    /// Starts on the most accurate settings of the profile that fit the budget and from which a running
    /// pipeline can change to some that leave room, the fastest where none fits; and keeps those that
    /// it can change to from there.
    ///
    /// `adjust` applies what the user asked for besides the budget. Steps that it makes equal are
    /// one, with the longest of their times.
    pub fn choose(
        profile: &Profile,
        budget: Duration,
        adjust: &dyn Fn(&mut Settings) -> Result<(), SettingsError>,
    ) -> Result<Self, BudgetError> {
        let limit_ms = FITS * 1e3 * budget.as_secs_f64();
        let mut rungs = rungs(profile, adjust)?;
        let comfortable_ms = COMFORTABLE * 1e3 * budget.as_secs_f64();
        let can_step_down = |from: &Rung| {
            let reachable = rungs.iter().filter(|to| reachable(&to.settings, &from.settings));
            reachable.into_iter().any(|to| to.predicted_ms <= comfortable_ms)
        };
        let fitting = || rungs.iter().filter(|r| r.predicted_ms <= limit_ms);
        let most_accurate = |a: &&Rung, b: &&Rung| a.error.total_cmp(&b.error);
        let best = fitting().filter(|&r| can_step_down(r)).min_by(most_accurate);
        let best = best.or_else(|| fitting().min_by(most_accurate));
        let fastest = rungs.iter().min_by(|a, b| a.predicted_ms.total_cmp(&b.predicted_ms));
        let chosen = best.or(fastest).expect("a profile has steps").settings.clone();
        rungs.retain(|rung| reachable(&rung.settings, &chosen));

        let plane: Vec<_> = rungs.iter().map(|r| (r.predicted_ms, r.error)).collect();
        let mut on_front = pareto_front(&plane).into_iter();
        rungs.retain(|_| on_front.next() == Some(true));
        rungs.sort_by(|a, b| b.predicted_ms.total_cmp(&a.predicted_ms));
        rungs.dedup_by(|a, b| a.predicted_ms == b.predicted_ms); // equal in time and error
        let start = rungs.iter().position(|r| r.predicted_ms <= limit_ms);
        let start = start.unwrap_or(rungs.len() - 1);
        if rungs[start].predicted_ms > limit_ms {
            log::warn!(
                "budget: nothing is predicted to fit {:.1} ms; starting with the fastest, '{}' at {:.1} ms",
                1e3 * budget.as_secs_f64(),
                rungs[start].name,
                rungs[start].predicted_ms
            );
        }
        Ok(Self { rungs, start })
    }

    pub fn rungs(&self) -> &[Rung] {
        &self.rungs
    }

    /// Where a run starts.
    pub fn start(&self) -> usize {
        self.start
    }
}

/// Whether a pipeline with `from` can be [reconfigured](crate::pipeline::Pipeline::reconfigure).
fn reachable(to: &Settings, from: &Settings) -> bool {
    to.input == from.input && to.tracking == from.tracking && to.volume == from.volume
}

fn rungs(
    profile: &Profile,
    adjust: &dyn Fn(&mut Settings) -> Result<(), SettingsError>,
) -> Result<Vec<Rung>, BudgetError> {
    let mut rungs: Vec<Rung> = Vec::new();
    for step in &profile.steps {
        let settings = settings_of(step, adjust)
            .map_err(|e| BudgetError::Step { step: step.name.clone(), problem: e.to_string() })?;
        match rungs.iter_mut().find(|rung| rung.settings == settings) {
            Some(same) => {
                same.predicted_ms = same.predicted_ms.max(step.update_ms);
                same.error = same.error.min(step.error);
            }
            None => rungs.push(Rung {
                name: step.name.clone(),
                settings,
                predicted_ms: step.update_ms,
                error: step.error,
            }),
        }
    }
    Ok(rungs)
}

fn settings_of(
    step: &ProfileStep,
    adjust: &dyn Fn(&mut Settings) -> Result<(), SettingsError>,
) -> Result<Settings, SettingsError> {
    let mut settings = Settings::preset(&step.preset)?;
    for change in &step.changes {
        settings.assign(change)?;
    }
    adjust(&mut settings)?;
    settings.validate()?;
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::super::profile::tests::profile;
    use super::*;

    const SMALL: &str = "volume.resolution=64";

    fn choose(steps: &[(&str, &[&str], f64, f64)], budget_ms: u64) -> Ladder {
        Ladder::choose(&profile(steps), Duration::from_millis(budget_ms), &|_| Ok(())).unwrap()
    }

    fn times(ladder: &Ladder) -> Vec<f64> {
        ladder.rungs().iter().map(|r| r.predicted_ms).collect()
    }

    const STEPS: &[(&str, &[&str], f64, f64)] = &[
        ("ours-fast", &["transfer.directions=8"], 60.0, 0.4),
        ("ours-fast", &[], 95.0, 0.2),
        ("ours", &[SMALL, "transfer.directions=8"], 105.0, 0.1),
        ("ours", &["transfer.directions=16"], 200.0, 0.15),
        ("ours", &["transfer.directions=24"], 200.0, 0.15),
        ("ours", &["transfer.directions=8"], 210.0, 0.3),
        ("ours", &[], 300.0, 0.05),
        ("ours", &[SMALL], 290.0, 0.06),
    ];

    #[test]
    fn the_most_accurate_that_fits_and_what_can_be_reached_from_it() {
        let ladder = choose(STEPS, 400);
        assert_eq!(times(&ladder), [300.0, 200.0, 95.0, 60.0]);
        assert_eq!(ladder.start(), 0);
        assert!(ladder.rungs().iter().all(|r| r.settings.volume.resolution == 256));
        assert_eq!(choose(STEPS, 101).start(), 2);
        assert_eq!(choose(STEPS, 99).start(), 3, "95 is more than 95 % of 99");
        // the small volume is best here, and the run stays with it
        let small = choose(STEPS, 250);
        assert_eq!((times(&small), small.start()), (vec![290.0, 105.0], 1));
    }

    #[test]
    fn a_way_down_is_worth_more_than_accuracy() {
        let large = "volume.resolution=512";
        let steps: &[(&str, &[&str], f64, f64)] = &[
            ("ours-fast", &["transfer.directions=8"], 70.0, 0.4),
            ("ours-fast", &[], 85.0, 0.3),
            ("ours-fast", &[large], 90.0, 0.2),
            ("ours", &[large], 110.0, 0.1),
        ];
        // at 90 of 100 ms the large volume has nothing faster
        let ladder = choose(steps, 100);
        assert_eq!((times(&ladder), ladder.start()), (vec![85.0, 70.0], 0));
        assert_eq!(times(&choose(steps, 400)), [110.0, 90.0]);
        // where nothing leaves room, what fits is taken
        assert_eq!(times(&choose(&steps[1..], 100)), [110.0, 90.0]);
    }

    #[test]
    fn nothing_fits() {
        let ladder = choose(STEPS, 10);
        assert_eq!(ladder.rungs()[ladder.start()].predicted_ms, 60.0);
    }

    #[test]
    fn the_users_own_settings_are_on_every_rung() {
        let adjust = |s: &mut Settings| s.assign("transfer.directions=48");
        let ladder = Ladder::choose(&profile(STEPS), Duration::from_millis(400), &adjust).unwrap();
        assert!(ladder.rungs().iter().all(|r| r.settings.transfer.directions == 48));
        // ours: 200, 210 and 300 are one now; ours-fast: 60 and 95
        assert_eq!(times(&ladder), [300.0, 95.0]);
        let error = Ladder::choose(&profile(STEPS), Duration::from_millis(400), &|s| {
            s.assign("transfer.bands=9")
        });
        assert!(error.unwrap_err().to_string().contains("transfer.bands"));
    }

    #[test]
    fn settings_of_another_version_are_named() {
        let unknown = profile(&[("ours", &["transfer.speed=9"], 10.0, 0.1)]);
        let error = Ladder::choose(&unknown, Duration::from_millis(400), &|_| Ok(())).unwrap_err();
        assert!(error.to_string().contains("speed"), "{error}");
    }
}
