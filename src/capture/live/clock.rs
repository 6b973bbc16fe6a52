//! The time of frames, made to rise whatever the device's clock does.

use std::time::Instant;

/// A device that gains more than this on the host between two frames has jumped; what drivers keep back
/// and hand over at once is less.
const MOST_GAINED_S: f64 = 1.0;

/// Until two frames have said otherwise.
const USUAL_STEP_S: f64 = 1.0 / 30.0;

/// Turns a device's time stamps into ones that rise. They are the device's own until it jumps; from then
/// on they are shifted so that the jump takes as long as it did on the host's clock.
#[derive(Debug)]
pub(super) struct DeviceClock {
    /// Whether the device's time should pass as the host's does: not where a recording is read as fast as
    /// it goes.
    in_step: bool,
    shift_s: f64,
    step_s: f64,
    last: Option<Tick>,
}

#[derive(Clone, Copy, Debug)]
struct Tick {
    device_s: f64,
    steady_s: f64,
    arrived: Instant,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Told {
    Time(f64),
    /// The device's clock jumped by `by_s`; the frame's time all the same.
    Jump {
        time_s: f64,
        by_s: f64,
    },
    /// The frame has the time of the one before it, or none.
    None,
}

impl DeviceClock {
    pub fn new(in_step: bool) -> Self {
        Self { in_step, shift_s: 0.0, step_s: USUAL_STEP_S, last: None }
    }

    /// The time of a frame that the device dates `device_s` and that came at `arrived`.
    pub fn tell(&mut self, device_s: f64, arrived: Instant) -> Told {
        if !device_s.is_finite() || self.last.is_some_and(|last| last.device_s == device_s) {
            return Told::None;
        }
        let told = match self.last {
            None => Told::Time(device_s),
            Some(last) => self.after(last, device_s, arrived),
        };
        if let Told::Time(steady_s) | Told::Jump { time_s: steady_s, .. } = told {
            self.last = Some(Tick { device_s, steady_s, arrived });
        }
        told
    }

    fn after(&mut self, last: Tick, device_s: f64, arrived: Instant) -> Told {
        let steady_s = device_s + self.shift_s;
        let step_s = steady_s - last.steady_s;
        let passed_s = arrived.saturating_duration_since(last.arrived).as_secs_f64();
        let ahead = self.in_step && step_s > passed_s + MOST_GAINED_S;
        if step_s > 0.0 && !ahead {
            self.step_s = step_s.min(USUAL_STEP_S);
            return Told::Time(steady_s);
        }
        let time_s = last.steady_s + passed_s.max(self.step_s);
        self.shift_s = time_s - device_s;
        Told::Jump { time_s, by_s: steady_s - time_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn time(told: Told) -> f64 {
        match told {
            Told::Time(s) => s,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn time_is_the_devices_own_until_it_jumps() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut clock = DeviceClock::new(true);
        assert_eq!(time(clock.tell(1000.1, at(0))), 1000.1);
        // four frames were dropped between
        assert_eq!(time(clock.tell(1000.3, at(200))), 1000.3);
        // back to zero while half a second passes
        let Told::Jump { time_s, by_s } = clock.tell(0.0, at(700)) else { panic!() };
        assert!((time_s - 1000.8).abs() < 1e-9 && (by_s + 1000.8).abs() < 1e-9, "{time_s} {by_s}");
        assert!((time(clock.tell(0.1, at(800))) - 1000.9).abs() < 1e-9);
        // an hour ahead
        let Told::Jump { time_s, .. } = clock.tell(3600.2, at(900)) else { panic!() };
        assert!((time_s - 1001.0).abs() < 1e-9, "{time_s}");
        assert!((time(clock.tell(3600.3, at(1000))) - 1001.1).abs() < 1e-9);
    }

    #[test]
    fn frames_without_a_time_of_their_own_are_none() {
        let now = Instant::now();
        let mut clock = DeviceClock::new(true);
        assert_eq!(clock.tell(f64::NAN, now), Told::None);
        assert_eq!(time(clock.tell(5.0, now)), 5.0);
        assert_eq!(clock.tell(5.0, now), Told::None);
        assert_eq!(clock.tell(f64::INFINITY, now), Told::None);
        assert_eq!(time(clock.tell(5.5, now)), 5.5);
    }

    #[test]
    fn a_recording_read_fast_has_not_jumped() {
        let now = Instant::now();
        let mut clock = DeviceClock::new(false);
        assert_eq!(time(clock.tell(5.0, now)), 5.0);
        assert_eq!(time(clock.tell(500.0, now)), 500.0);
        let Told::Jump { time_s, .. } = clock.tell(499.0, now) else { panic!() };
        assert!(time_s > 500.0);
    }
}
