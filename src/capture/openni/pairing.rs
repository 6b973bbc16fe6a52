//! Which depth frame belongs to which colour frame, while they arrive.

use std::collections::VecDeque;

/// Frames of one stream that wait for a partner. A stream that alone goes on must not fill the memory.
pub const MOST_WAITING: usize = 8;

/// Pairs frames that are at most half a period apart: with streams in order of time no other frame of the
/// same stream is nearer.
#[derive(Debug)]
pub struct Pairing<D, C> {
    depth: VecDeque<(f64, D)>,
    color: VecDeque<(f64, C)>,
    half_period_s: f64,
    /// Frames that found no partner.
    pub alone: usize,
}

impl<D, C> Pairing<D, C> {
    /// The period is that of the faster stream.
    pub fn new(period_s: f64) -> Self {
        let half_period_s = 0.5 * period_s;
        Self { depth: VecDeque::new(), color: VecDeque::new(), half_period_s, alone: 0 }
    }

    pub fn add_depth(&mut self, time_s: f64, frame: D) {
        self.depth.push_back((time_s, frame));
        if self.depth.len() > MOST_WAITING {
            self.depth.pop_front();
            self.alone += 1;
        }
    }

    pub fn add_color(&mut self, time_s: f64, frame: C) {
        self.color.push_back((time_s, frame));
        if self.color.len() > MOST_WAITING {
            self.color.pop_front();
            self.alone += 1;
        }
    }

    /// The oldest pair, at the time of its colour. Frames before it that can have no partner any more are
    /// dropped.
    pub fn take(&mut self) -> Option<(f64, D, C)> {
        loop {
            let (depth_s, color_s) = (self.depth.front()?.0, self.color.front()?.0);
            let later = depth_s - color_s;
            if later.abs() <= self.half_period_s {
                let ((_, depth), (_, color)) = (self.depth.pop_front()?, self.color.pop_front()?);
                return Some((color_s, depth, color));
            }
            self.alone += 1;
            if later > 0.0 {
                self.color.pop_front();
            } else {
                self.depth.pop_front();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 1.0 / 30.0;

    #[test]
    fn a_lost_frame_leaves_its_partner_alone_and_no_other() {
        let mut pairing = Pairing::new(PERIOD);
        let mut found = Vec::new();
        for k in 0..10u32 {
            let time = f64::from(k) * PERIOD;
            pairing.add_depth(time, k);
            if k != 4 {
                pairing.add_color(time + 0.4 * PERIOD, k);
            }
            while let Some((time, depth, color)) = pairing.take() {
                assert_eq!(time, f64::from(color) * PERIOD + 0.4 * PERIOD);
                found.push((depth, color));
            }
        }
        let expected: Vec<_> = [0, 1, 2, 3, 5, 6, 7, 8, 9].map(|k| (k, k)).into();
        assert_eq!(found, expected);
        assert_eq!(pairing.alone, 1);
    }

    #[test]
    fn a_stream_that_goes_on_alone_keeps_only_its_newest() {
        let mut pairing = Pairing::<u32, u32>::new(PERIOD);
        for k in 0..100 {
            pairing.add_depth(f64::from(k) * PERIOD, k);
        }
        assert_eq!((pairing.depth.len(), pairing.alone), (MOST_WAITING, 100 - MOST_WAITING));
        pairing.add_color(99.0 * PERIOD, 99);
        assert_eq!(pairing.take(), Some((99.0 * PERIOD, 99, 99)));
    }

    #[test]
    fn a_stream_at_half_the_rate_gets_the_nearest() {
        let mut pairing = Pairing::new(PERIOD);
        let mut pairs = Vec::new();
        for k in 0..12u32 {
            pairing.add_color(f64::from(k) * PERIOD, k);
            if k % 2 == 0 {
                pairing.add_depth((f64::from(k) + 0.3) * PERIOD, k);
            }
            pairs.extend(pairing.take().map(|(_, depth, color)| (depth, color)));
        }
        assert_eq!(pairs, [0, 2, 4, 6, 8, 10].map(|k| (k, k)));
        assert_eq!(pairing.alone, 5);
    }
}
