//! How long a study will still take.

use std::collections::BTreeMap;
use std::time::Instant;

/// What a frame of 640x480 takes until it has been measured, seconds: of no method in particular.
const GUESS_S: f64 = 0.8;

/// Work is counted in frames of a kind: of a method, or of sequences to make.
#[derive(Debug)]
pub(super) struct Outlook {
    guess_s: f64,
    left: BTreeMap<String, usize>,
    /// Frames done, and the time they took.
    done: BTreeMap<String, (usize, f64)>,
    last: Instant,
}

impl Outlook {
    pub fn new(pixels: usize) -> Self {
        Self {
            guess_s: GUESS_S * pixels as f64 / (640.0 * 480.0),
            left: BTreeMap::new(),
            done: BTreeMap::new(),
            last: Instant::now(),
        }
    }

    pub fn expect(&mut self, kind: &str, frames: usize) {
        *self.left.entry(kind.to_owned()).or_default() += frames;
    }

    /// Time counts from here.
    pub fn start(&mut self) {
        self.last = Instant::now();
    }

    /// One frame is done; it took the time since the last.
    pub fn tick(&mut self, kind: &str) {
        let took_s = self.last.elapsed().as_secs_f64();
        self.start();
        if let Some(left) = self.left.get_mut(kind) {
            *left = left.saturating_sub(1);
        }
        let (frames, seconds) = self.done.entry(kind.to_owned()).or_default();
        *frames += 1;
        *seconds += took_s;
    }

    pub fn left_s(&self) -> f64 {
        let of = |(kind, &frames): (&String, &usize)| {
            let frame_s = match self.done.get(kind) {
                Some(&(frames, seconds)) => seconds / frames as f64,
                None => self.guess_s,
            };
            frame_s * frames as f64
        };
        self.left.iter().map(of).sum()
    }

    /// Share of all work that is done, 0 to 1.
    pub fn share(&self) -> f64 {
        let done: f64 = self.done.values().map(|d| d.1).sum();
        let all = done + self.left_s();
        if all > 0.0 { done / all } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_measured_replaces_the_guess() {
        let mut outlook = Outlook::new(640 * 480);
        outlook.expect("a", 10);
        outlook.expect("b", 5);
        assert_eq!(outlook.left_s(), 15.0 * GUESS_S);
        assert_eq!(outlook.share(), 0.0);
        outlook.tick("a");
        outlook.done.insert("a".into(), (1, 2.0));
        assert!((outlook.left_s() - (9.0 * 2.0 + 5.0 * GUESS_S)).abs() < 1e-12);
        assert!((outlook.share() - 2.0 / (2.0 + outlook.left_s())).abs() < 1e-12);
        (0..9).for_each(|_| outlook.tick("a"));
        (0..7).for_each(|_| outlook.tick("b"));
        assert_eq!(
            (outlook.left_s(), outlook.share()),
            (0.0, 1.0),
            "more than expected is no harm"
        );
    }
}
