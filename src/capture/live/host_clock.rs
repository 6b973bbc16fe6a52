//! The host's time of what a device dates by a clock of its own.

/// The shortest delay is looked for among frames of this time and as much before: short enough for clocks
/// that drift apart by 100 us a second, long enough to find a frame that was not kept waiting.
const WINDOW_S: f64 = 10.0;

/// Maps a device's times to the host's. What was delivered with the least delay has been on its way for the
/// time that delivery always takes; the others were kept waiting.
#[derive(Debug, Default)]
pub(in crate::capture) struct HostClock {
    window: Option<Window>,
}

#[derive(Clone, Copy, Debug)]
struct Window {
    began_s: f64,
    /// Least of arrival minus device time, since then and in the window before.
    least_s: f64,
    before_s: f64,
}

impl HostClock {
    /// The host's time of a frame that the device dates `device_s` and that came at `arrived_s`. Both clocks
    /// go forwards.
    pub fn tell(&mut self, device_s: f64, arrived_s: f64) -> f64 {
        let behind_s = arrived_s - device_s;
        let window = self.window.get_or_insert(Window {
            began_s: arrived_s,
            least_s: behind_s,
            before_s: behind_s,
        });
        if arrived_s - window.began_s > WINDOW_S {
            *window = Window { began_s: arrived_s, least_s: behind_s, before_s: window.least_s };
        }
        window.least_s = window.least_s.min(behind_s);
        device_s + window.least_s.min(window.before_s)
    }

    /// The device has set its clock: what was known about it is void.
    pub fn forget(&mut self) {
        self.window = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Rng;

    const PERIOD_S: f64 = 1.0 / 30.0;

    /// Frames of `seconds`, dated by a clock that starts at -700 s and gains `drift`, on their way for 12 ms
    /// and then kept waiting for up to 30 ms. Gives, after the first second, how far told times are from those
    /// of arrival without waiting.
    fn errors(seconds: usize, drift: f64) -> Vec<f64> {
        let (mut clock, mut rng) = (HostClock::default(), Rng::new(&[3]));
        let frames = (0..seconds * 30).map(|k| {
            let taken_s = k as f64 * PERIOD_S;
            let delivered_s = taken_s + 0.012;
            let waited_s = f64::from(rng.next_u32() % 1000) * 30e-6;
            let told_s = clock.tell(taken_s * (1.0 + drift) - 700.0, delivered_s + waited_s);
            told_s - delivered_s
        });
        frames.skip(30).collect()
    }

    #[test]
    fn waiting_is_taken_out_and_delivery_is_not() {
        for error in errors(60, 0.0) {
            // The least of 30 random waits and more: one chance in 2^30 for above half of the longest.
            // Sums of f64 round.
            assert!((-1e-9..0.015).contains(&error), "{error}");
        }
        let settled = errors(60, 0.0)[300..].iter().fold(0.0f64, |worst, e| worst.max(*e));
        assert!(settled < 0.002, "{settled}");
    }

    #[test]
    fn clocks_that_drift_apart_are_followed() {
        for drift in [1e-4, -1e-4] {
            let worst = errors(3600, drift)[600..].iter().fold(0.0f64, |w, e| w.max(e.abs()));
            // Two windows of 10 s at 100 us a second, and the wait of the best frame.
            assert!(worst < 0.002 + 0.002, "{drift}: {worst}");
        }
    }

    #[test]
    fn a_clock_that_was_set_is_met_anew() {
        let mut clock = HostClock::default();
        assert_eq!(clock.tell(100.0, 5.0), 5.0);
        clock.forget();
        assert_eq!(clock.tell(20.0, 6.0), 6.0);
    }
}
