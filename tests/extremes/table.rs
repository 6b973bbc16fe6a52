//! Runs cases on the backends they are for, and prints what was found: one row a case and backend.

use kinlight::gpu::{AdapterChoice, Gpu};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

/// Where a case is computed.
#[derive(Clone, Copy)]
pub enum Device<'g> {
    Cpu,
    Gpu(&'g Arc<Gpu>),
}

/// The backends of a case.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum On {
    /// Both, from one body.
    Both,
    /// What both share and the host computes: parameters, solves, files.
    Host,
}

/// The largest error that a case met, and what it may be. Cases without a number (nothing panics, nothing is
/// NaN) count the values that break the rule: their bound is 0.
#[derive(Clone, Debug)]
pub struct Found {
    pub error: f64,
    pub bound: f64,
    /// What was measured, and where the bound is from.
    pub what: String,
}

impl Found {
    pub fn new(error: f64, bound: f64, what: impl Into<String>) -> Self {
        Self { error, bound, what: what.into() }
    }

    /// So many values break a rule that none may.
    pub fn broken(count: usize, what: impl Into<String>) -> Self {
        Self::new(count as f64, 0.0, what)
    }

    /// The one that is further beyond its bound.
    pub fn worse(self, other: Self) -> Self {
        let excess = |found: &Self| match found.bound > 0.0 {
            _ if !found.error.is_finite() => f64::INFINITY,
            true => found.error / found.bound,
            false if found.error > 0.0 => f64::INFINITY,
            false => 0.0,
        };
        if excess(&other) > excess(&self) { other } else { self }
    }

    fn holds(&self) -> bool {
        self.error <= self.bound
    }
}

/// Why a case could not say: counts as a failure.
pub type Outcome = Result<Found, String>;

#[derive(Default)]
pub struct Table {
    gpu: Option<Arc<Gpu>>,
    filter: Option<String>,
    passed: usize,
    failed: Vec<String>,
    skipped: usize,
}

impl Table {
    /// `filter`: only cases whose stage or name contain it.
    pub fn new(filter: Option<String>) -> Self {
        let gpu = Gpu::open(&AdapterChoice::Best)
            .inspect_err(|error| println!("no GPU: {error}"))
            .ok()
            .map(Arc::new);
        println!(
            "{:<12} {:<58} {:<5} {:<6} {:>11} {:>11}  what",
            "stage", "case", "on", "", "error", "bound"
        );
        Self { gpu, filter, ..Self::default() }
    }

    pub fn case(
        &mut self,
        stage: &str,
        name: impl AsRef<str>,
        on: On,
        body: impl Fn(Device<'_>) -> Outcome,
    ) {
        let name = name.as_ref();
        let wanted = |filter: &String| stage.contains(filter) || name.contains(filter);
        if !self.filter.as_ref().is_none_or(wanted) {
            return;
        }
        match on {
            On::Host => self.run(stage, name, "host", &|| body(Device::Cpu)),
            On::Both => {
                self.run(stage, name, "cpu", &|| body(Device::Cpu));
                match self.gpu.take() {
                    Some(gpu) => {
                        self.run(stage, name, "gpu", &|| body(Device::Gpu(&gpu)));
                        self.gpu = Some(gpu);
                    }
                    None => self.skip(stage, name),
                }
            }
        }
    }

    fn run(&mut self, stage: &str, name: &str, on: &str, body: &dyn Fn() -> Outcome) {
        let began = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Err(format!("panicked: {}", text.unwrap_or("without a word")))
        });
        let took_s = began.elapsed().as_secs_f64();
        let (verdict, numbers, what) = match &outcome {
            Ok(found) => (
                if found.holds() { "ok" } else { "FAILED" },
                format!("{:>11.3e} {:>11.3e}", found.error, found.bound),
                found.what.as_str(),
            ),
            Err(why) => ("FAILED", format!("{:>11} {:>11}", "-", "-"), why.as_str()),
        };
        let slow = if took_s > 5.0 { format!(" ({took_s:.0} s)") } else { String::new() };
        println!("{stage:<12} {name:<58} {on:<5} {verdict:<6} {numbers}  {what}{slow}");
        match verdict {
            "ok" => self.passed += 1,
            _ => self.failed.push(format!("{stage}: {name} ({on})")),
        }
    }

    fn skip(&mut self, stage: &str, name: &str) {
        println!("{stage:<12} {name:<58} gpu   SKIPPED: no graphics device");
        self.skipped += 1;
    }

    /// Whether all is well: skipped cases are not where a device is required.
    pub fn finish(self) -> bool {
        for failed in &self.failed {
            println!("failed: {failed}");
        }
        let Self { passed, skipped, .. } = self;
        println!("{passed} passed, {} failed, {skipped} skipped", self.failed.len());
        let required = std::env::var("KINLIGHT_REQUIRE_GPU").is_ok_and(|v| v == "1");
        self.failed.is_empty() && passed > 0 && !(required && skipped > 0)
    }
}
