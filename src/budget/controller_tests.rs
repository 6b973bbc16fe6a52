//! The controller on simulated machines.

use super::controller::{Change, Controller, FITS};
use crate::math::random::Rng;

/// As of a real ladder: the steps are uneven.
const LADDER_MS: [f64; 7] = [310.0, 240.0, 170.0, 130.0, 95.0, 80.0, 62.0];

struct Machine {
    controller: Controller,
    rng: Rng,
    changes: Vec<(usize, Change)>,
    frame: usize,
}

impl Machine {
    /// Starts as a run does: on the most accurate rung that is predicted to fit.
    fn new(budget_ms: f64) -> Self {
        let fits = |&ms: &f64| ms <= FITS * budget_ms;
        let rung = LADDER_MS.iter().position(fits).unwrap_or(LADDER_MS.len() - 1);
        Self {
            controller: Controller::new(budget_ms, LADDER_MS.to_vec(), rung, 5),
            rng: Rng::new(&[7]),
            changes: Vec::new(),
            frame: 0,
        }
    }

    /// Frames that take what was predicted times `load(frame, rung)`, and 4 % of noise.
    fn run(&mut self, frames: usize, load: impl Fn(usize, usize) -> f64) -> &mut Self {
        for _ in 0..frames {
            let rung = self.controller.rung();
            let noise = 1.0 + 0.04 * (2.0 * f64::from(self.rng.uniform()) - 1.0);
            let ms = LADDER_MS[rung] * load(self.frame, rung) * noise;
            if let Some(change) = self.controller.frame(ms) {
                assert_eq!((change.from, change.to), (rung, self.controller.rung()));
                self.changes.push((self.frame, change));
            }
            self.frame += 1;
        }
        self
    }

    fn rung(&self) -> usize {
        self.controller.rung()
    }
}

#[test]
fn a_machine_as_predicted_stays_where_it_starts() {
    for (budget, rung) in [(100.0, 4), (400.0, 0), (180.0, 2), (66.0, 6)] {
        let mut machine = Machine::new(budget);
        machine.run(2000, |_, _| 1.0);
        assert_eq!((machine.rung(), machine.changes.len()), (rung, 0), "{budget} ms");
    }
}

#[test]
fn a_slower_or_faster_machine_is_found_in_one_step() {
    let mut slow = Machine::new(200.0);
    slow.run(40, |_, _| 1.8);
    assert_eq!((slow.rung(), slow.changes.len()), (4, 1), "{:?}", slow.changes);
    assert!(slow.changes[0].0 < 10);
    // 240 * 0.4 = 96 is over 85 % of the budget
    let mut fast = Machine::new(100.0);
    fast.run(400, |_, _| 0.4);
    assert_eq!((fast.rung(), fast.changes.len()), (2, 1), "{:?}", fast.changes);
}

#[test]
fn lone_slow_frames_change_nothing() {
    let mut machine = Machine::new(100.0);
    machine.run(1000, |frame, _| if frame % 3 == 0 { 6.0 } else { 1.0 });
    assert!(machine.changes.is_empty(), "{:?}", machine.changes);
}

#[test]
fn a_load_for_a_while_is_met_at_once_and_recovered_from() {
    let mut machine = Machine::new(180.0);
    machine.run(100, |_, _| 1.0).run(120, |_, _| 1.7);
    assert_eq!(machine.rung(), 4, "95 * 1.7 fits in 180, 130 * 1.7 does not");
    assert_eq!(machine.changes.len(), 1);
    assert!(machine.changes[0].0 <= 103, "{:?}", machine.changes);
    machine.run(100, |_, _| 1.0);
    // 170 is over 85 % of the budget: hysteresis
    assert_eq!((machine.rung(), machine.changes.len()), (3, 2), "{:?}", machine.changes);
    machine.run(100, |_, _| 0.85);
    assert_eq!(machine.rung(), 2, "{:?}", machine.changes);
}

#[test]
fn a_slow_drift_is_followed_rung_by_rung() {
    let mut machine = Machine::new(320.0);
    machine.run(3000, |frame, _| 1.0 + frame as f64 / 1000.0);
    assert!(machine.changes.windows(2).all(|w| w[0].1.to == w[1].1.from));
    assert!(machine.changes.iter().all(|(_, c)| c.to > c.from), "{:?}", machine.changes);
    assert!((3..=6).contains(&machine.changes.len()), "{:?}", machine.changes);
    assert!(LADDER_MS[machine.rung()] * 4.0 <= 320.0 * 1.04 || machine.rung() == 6);
}

/// The better rung is predicted to fit and never does.
#[test]
fn a_wrong_prediction_is_tried_less_and_less_often() {
    let mut machine = Machine::new(120.0);
    machine.run(8000, |_, rung| if rung <= 3 { 1.3 } else { 0.75 });
    let ups: Vec<usize> =
        machine.changes.iter().filter(|(_, c)| c.to < c.from).map(|&(frame, _)| frame).collect();
    // 30, 60, ... 1920 frames between tries: 7 doublings, and then 4 a 8000 frames
    assert!((3..=11).contains(&ups.len()), "{ups:?}");
    let gaps: Vec<usize> = ups.windows(2).map(|w| w[1] - w[0]).collect();
    assert!(gaps.windows(2).all(|g| g[1] > g[0] || g[1] > 1900), "{gaps:?}");
    let over = machine.changes.iter().filter(|(_, c)| c.to > c.from).count();
    assert!(over <= ups.len() + 1);
}

#[test]
fn an_impossible_budget_ends_on_the_fastest_rung_and_stays() {
    let mut machine = Machine::new(30.0);
    assert_eq!(machine.rung(), 6);
    assert!(!machine.controller.exhausted(), "nothing is known yet");
    machine.run(500, |_, _| 1.0);
    assert!(machine.controller.exhausted());
    assert_eq!((machine.rung(), machine.changes.len()), (6, 0));
    let mut overloaded = Machine::new(400.0);
    overloaded.run(500, |_, _| 9.0);
    assert_eq!((overloaded.rung(), overloaded.changes.len()), (6, 1));
}

#[test]
fn what_is_no_time_is_no_frame() {
    let mut machine = Machine::new(180.0);
    machine.run(50, |_, _| 1.0);
    for _ in 0..100 {
        for ms in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -5.0] {
            assert_eq!(machine.controller.frame(ms), None);
        }
    }
    machine.run(50, |_, _| 1.0);
    assert!(machine.changes.is_empty());
}

#[test]
fn one_rung_is_a_ladder_too() {
    let mut controller = Controller::new(10.0, vec![20.0], 0, 0);
    assert!((0..100).all(|_| controller.frame(25.0).is_none()));
    assert!(controller.exhausted());
}

mod properties {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// On a machine that is only slower or faster than predicted, no matter how much, the controller
        /// comes to rest, within the budget wherever any rung is.
        #[test]
        fn it_comes_to_rest(budget in 20.0..1000.0f64, load in 0.05..20.0f64) {
            let mut machine = Machine::new(budget);
            machine.run(400, |_, _| load);
            let early = machine.changes.len();
            prop_assert!(early <= 4, "{:?}", machine.changes);
            machine.run(2000, |_, _| load);
            prop_assert!(machine.changes.len() <= early + 1, "{:?}", machine.changes);
            let ms = LADDER_MS[machine.rung()] * load;
            // medians of noisy frames reach 4 % over what they are of
            prop_assert!(ms <= 1.04 * budget || machine.rung() == 6, "{ms} of {budget}");
            // nothing better fits with margin; 5 % for noise
            for better in 0..machine.rung() {
                prop_assert!(LADDER_MS[better] * load >= 0.80 * budget);
            }
        }
    }
}
