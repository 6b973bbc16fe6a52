//! The device's microseconds as seconds that only go forwards.

use std::time::Duration;

/// A gap that nothing but a change of the clock explains, beyond the time that has really gone by.
const GAP_US: i64 = 2_000_000;

/// Times of depth and colour frames. Where a device sets its clock, times go on one period after the last.
#[derive(Debug)]
pub struct DeviceClock {
    period_us: i64,
    streams: [StreamClock; 2],
}

#[derive(Clone, Copy, Debug, Default)]
struct StreamClock {
    last_us: Option<i64>,
    offset_us: i64,
}

/// A time, and by how much the clock was found to be off from now on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tick {
    pub seconds: f64,
    pub jump_s: Option<f64>,
}

impl DeviceClock {
    pub fn new(period_s: f64) -> Self {
        Self { period_us: ((period_s * 1e6) as i64).max(1), streams: Default::default() }
    }

    /// `stream` is 0 or 1. `elapsed` is what has really gone by since the stream's last frame; unknown in a
    /// recording, where a gap means nothing.
    pub fn tick(&mut self, stream: usize, device_us: u64, elapsed: Option<Duration>) -> Tick {
        let raw = i64::try_from(device_us).unwrap_or(i64::MAX / 2);
        let own = self.streams[stream];
        let Some(last) = own.last_us else {
            return self.accept(stream, raw, self.streams[1 - stream].offset_us, None);
        };
        let longest = elapsed.map_or(i64::MAX, |e| {
            GAP_US
                .saturating_add(i64::try_from(e.as_micros()).unwrap_or(i64::MAX).saturating_mul(2))
        });
        let plausible = |offset: i64| {
            let step = raw.saturating_add(offset).saturating_sub(last);
            step > 0 && step <= longest
        };
        if plausible(own.offset_us) {
            return self.accept(stream, raw, own.offset_us, None);
        }
        // The other stream has the same clock: where it has jumped already, follow it.
        let other = self.streams[1 - stream].offset_us;
        let offset = if other != own.offset_us && plausible(other) {
            other
        } else {
            last.saturating_add(self.period_us).saturating_sub(raw)
        };
        let jump_us = own.offset_us.saturating_sub(offset);
        self.accept(stream, raw, offset, Some(jump_us as f64 / 1e6))
    }

    fn accept(&mut self, stream: usize, raw: i64, offset_us: i64, jump_s: Option<f64>) -> Tick {
        let us = raw.saturating_add(offset_us);
        self.streams[stream] = StreamClock { last_us: Some(us), offset_us };
        Tick { seconds: us as f64 / 1e6, jump_s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: u64 = 33_333;

    fn run(began_us: i64, jump_at: u64, by_us: i64) -> (Vec<f64>, Vec<f64>, usize) {
        let mut clock = DeviceClock::new(STEP as f64 / 1e6);
        let (mut depth, mut color, mut jumps) = (Vec::new(), Vec::new(), 0);
        for k in 0..20 {
            let off = if k >= jump_at { by_us } else { 0 };
            let raw = (began_us + (k * STEP) as i64 + off) as u64;
            let real = Some(Duration::from_micros(STEP));
            let (d, c) = (clock.tick(0, raw, real), clock.tick(1, raw + 1000, real));
            jumps += usize::from(d.jump_s.is_some());
            assert_eq!(d.jump_s.is_some(), c.jump_s.is_some());
            if let Some(jump_s) = d.jump_s {
                assert!((jump_s - by_us as f64 / 1e6).abs() < 1e-9, "{jump_s}");
            }
            depth.push(d.seconds);
            color.push(c.seconds);
        }
        (depth, color, jumps)
    }

    #[test]
    fn without_a_jump_times_are_the_devices() {
        let (depth, _, jumps) = run(10_000_000, 99, 0);
        assert_eq!((depth[0], depth[1], jumps), (10.0, 10_033_333.0 / 1e6, 0));
    }

    #[test]
    fn a_jump_either_way_changes_neither_steps_nor_the_difference_of_the_streams() {
        for by_us in [-9_000_000, -50_000, 5_000_000, 4_000_000_000] {
            // a device that is on for a year counts 3e13
            for began_us in [10_000_000, 31_536_000_000_000] {
                let (depth, color, jumps) = run(began_us, 7, by_us);
                assert_eq!(jumps, 1, "{by_us}");
                for (k, d) in depth.iter().enumerate() {
                    let expected = began_us as f64 / 1e6 + k as f64 * STEP as f64 * 1e-6;
                    assert!((d - expected).abs() < 1e-6, "frame {k}: {d}");
                    // f64 has steps of 4e-9 s after a year
                    assert!((color[k] - d - 0.001).abs() < 1e-8, "frame {k}: {}", color[k]);
                }
            }
        }
    }

    #[test]
    fn a_real_pause_is_none() {
        let mut clock = DeviceClock::new(0.033);
        clock.tick(0, 0, None);
        let after = clock.tick(0, 60_000_000, Some(Duration::from_secs(60)));
        assert_eq!(after, Tick { seconds: 60.0, jump_s: None });
        let recorded = clock.tick(0, 3_600_000_000, None);
        assert_eq!(recorded, Tick { seconds: 3600.0, jump_s: None });
        assert!(clock.tick(0, u64::MAX, Some(Duration::ZERO)).seconds.is_finite());
    }
}
