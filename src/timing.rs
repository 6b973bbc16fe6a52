//! Stage times in the rows of the paper's tables.

use std::time::{Duration, Instant};

/// The paper's rows (Gruber et al. 2015, Tables 1 and 2), in the order of the data flow.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
pub enum Stage {
    Input,
    Reconstruct,
    Surface,
    DynGeo,
    RadTransfer,
    LightEst,
    Rendering,
}

impl Stage {
    pub const ALL: [Stage; 7] = [
        Stage::Input,
        Stage::Reconstruct,
        Stage::Surface,
        Stage::DynGeo,
        Stage::RadTransfer,
        Stage::LightEst,
        Stage::Rendering,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Stage::Input => "Input",
            Stage::Reconstruct => "Reconstruct",
            Stage::Surface => "Surface",
            Stage::DynGeo => "DynGeo",
            Stage::RadTransfer => "RadTransfer",
            Stage::LightEst => "LightEst",
            Stage::Rendering => "Rendering",
        }
    }
}

/// Wall-clock time of each stage of one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct StageTimes {
    times: [Duration; Stage::ALL.len()],
}

impl StageTimes {
    /// Runs `work` and adds its time to `stage`.
    pub fn measure<T>(&mut self, stage: Stage, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add(stage, start.elapsed());
        result
    }

    pub fn add(&mut self, stage: Stage, time: Duration) {
        self.times[stage as usize] += time;
    }

    pub fn get(&self, stage: Stage) -> Duration {
        self.times[stage as usize]
    }

    /// The paper's "Update": all stages.
    pub fn update(&self) -> Duration {
        self.times.iter().sum()
    }
}
