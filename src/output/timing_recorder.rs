//! Stage times of a run of any length, in memory that does not grow with it.

use super::timings::ms;
use super::{FrameTiming, Quantiles, TimingSummary};
use crate::math::Distribution;
use crate::timing::Stage;

/// Takes the times of frames as they go by. Quantiles are exact for a few thousand frames; beyond those they
/// are within 0.25 % (or 0.1 microseconds), as [`Distribution`] says.
#[derive(Clone, Debug)]
pub struct TimingRecorder {
    /// Frames at the start that do not count.
    warm_up: usize,
    frames: usize,
    update_ms: Distribution,
    duration_ms: Distribution,
    age_ms: Distribution,
    stages_ms: [Distribution; Stage::ALL.len()],
}

impl TimingRecorder {
    /// The first `warm_up` frames are left out; where a run ends within them, its last frame counts.
    pub fn new(warm_up: usize) -> Self {
        Self {
            warm_up,
            frames: 0,
            update_ms: Distribution::new(),
            duration_ms: Distribution::new(),
            age_ms: Distribution::new(),
            stages_ms: Default::default(),
        }
    }

    pub fn push(&mut self, timing: &FrameTiming) {
        if self.frames <= self.warm_up {
            // Only the newest frame of the warm-up is held, and the first after it takes its place.
            self.distributions().for_each(Distribution::clear);
        }
        self.frames += 1;
        self.update_ms.push(ms(timing.stages.update()));
        self.duration_ms.push(ms(timing.duration));
        if let Some(age) = timing.age {
            self.age_ms.push(ms(age));
        }
        for (stage, times) in Stage::ALL.into_iter().zip(&mut self.stages_ms) {
            times.push(ms(timing.stages.get(stage)));
        }
    }

    /// `None` before any frame.
    pub fn summary(&self) -> Option<TimingSummary> {
        let update = Quantiles::of(&self.update_ms)?;
        let mut stages = [update; Stage::ALL.len()];
        for (stage, times) in stages.iter_mut().zip(&self.stages_ms) {
            *stage = Quantiles::of(times)?;
        }
        let measured = self.update_ms.count();
        Some(TimingSummary {
            frames: measured,
            warmup_frames: self.frames - measured,
            fps: 1000.0 / update.median_ms,
            update,
            duration: Quantiles::of(&self.duration_ms)?,
            age: Quantiles::of(&self.age_ms),
            stages,
            backend: None,
        })
    }

    /// Memory that all frames so far take.
    pub fn bytes(&self) -> usize {
        let others = [&self.update_ms, &self.duration_ms, &self.age_ms];
        others.into_iter().chain(&self.stages_ms).map(Distribution::bytes).sum()
    }

    fn distributions(&mut self) -> impl Iterator<Item = &mut Distribution> {
        let others = [&mut self.update_ms, &mut self.duration_ms, &mut self.age_ms];
        others.into_iter().chain(&mut self.stages_ms)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{median, quantile, random::Rng};
    use crate::timing::StageTimes;
    use crate::tracking::TrackingState;
    use std::time::Duration;

    /// Times as a long run has them: 5 to 40 ms a stage, now and then ten times as much.
    fn timing(frame: usize, rng: &mut Rng) -> FrameTiming {
        let mut stages = StageTimes::default();
        for stage in Stage::ALL {
            let slow = if rng.next_u32().is_multiple_of(50) { 10.0 } else { 1.0 };
            let ms = slow * (5.0 + 35.0 * f64::from(rng.uniform()));
            stages.add(stage, Duration::from_secs_f64(1e-3 * ms));
        }
        FrameTiming {
            frame,
            timestamp_s: frame as f64 / 30.0,
            duration: stages.update() + Duration::from_micros(300),
            age: Some(Duration::from_micros(u64::from(rng.next_u32() % 30_000))),
            stages,
            position_m: [0.0; 3],
            state: TrackingState::Tracking,
            setting: "ours".to_owned(),
        }
    }

    #[test]
    fn a_million_frames_take_no_more_memory_than_ten_thousand() {
        let (mut recorder, mut rng) = (TimingRecorder::new(5), Rng::new(&[3]));
        let mut inputs_ms = Vec::new();
        let mut after_ten_thousand = 0;
        for frame in 0..1_000_000 {
            let timing = timing(frame, &mut rng);
            recorder.push(&timing);
            if frame >= 5 {
                inputs_ms.push(ms(timing.stages.get(Stage::Input)));
            }
            if frame == 10_000 {
                after_ten_thousand = recorder.bytes();
            }
        }
        assert_eq!(recorder.bytes(), after_ten_thousand);
        assert!(after_ten_thousand > 0 && after_ten_thousand < 512 << 10, "{after_ten_thousand}");

        let summary = recorder.summary().unwrap();
        assert_eq!((summary.frames, summary.warmup_frames), (999_995, 5));
        let (found, all) = (summary.stage(Stage::Input), || inputs_ms.iter().copied());
        let pairs = [
            (found.median_ms, median(all())),
            (found.p95_ms, quantile(all(), 0.95)),
            (found.p99_ms, quantile(all(), 0.99)),
        ];
        for (found, exact) in pairs {
            let exact = exact.unwrap();
            // half a bin
            assert!((found - exact).abs() <= 0.0025 * exact, "{found} for {exact}");
        }
        assert_eq!(Some(found.max_ms), quantile(all(), 1.0));
    }

    #[test]
    fn where_a_run_ends_in_its_warm_up_the_last_frame_counts() {
        let mut rng = Rng::new(&[4]);
        let frames: Vec<_> = (0..4).map(|frame| timing(frame, &mut rng)).collect();
        let mut recorder = TimingRecorder::new(3);
        assert!(recorder.summary().is_none());
        for (i, frame) in frames.iter().enumerate() {
            recorder.push(frame);
            let summary = recorder.summary().unwrap();
            assert_eq!((summary.frames, summary.warmup_frames), (1, i));
            assert_eq!(summary.duration.max_ms, ms(frame.duration), "frame {i}");
        }
        recorder.push(&frames[0]);
        let summary = recorder.summary().unwrap();
        assert_eq!((summary.frames, summary.warmup_frames), (2, 3));
    }
}
