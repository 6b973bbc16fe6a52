//! What a result was measured on.

use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    pub cpu: String,
    pub threads: usize,
    pub system: String,
    /// "cpu" or "gpu", and from which frame on another.
    pub backend: String,
    /// Of this program.
    pub version: String,
}

impl Machine {
    /// This machine, with the thread pool as it is now.
    pub fn here() -> Self {
        Self {
            cpu: cpu_name().unwrap_or_else(|| std::env::consts::ARCH.to_owned()),
            threads: rayon::current_num_threads(),
            system: std::env::consts::OS.to_owned(),
            backend: "cpu".to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }
}

fn cpu_name() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|l| l.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
