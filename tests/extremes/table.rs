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
    /// The GPU alone: limits that only it has.
    Gpu,
    /// What both share and the host computes: parameters, solves, files.
    Host,
}

/// How rows are printed.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Layout {
    #[default]
    Columns,
    Markdown,
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
    layout: Layout,
    passed: usize,
    failed: Vec<String>,
    skipped: usize,
    /// Skipped cases are failures.
    all_required: bool,
}

impl Table {
    /// `filter`: only cases whose stage or name contain it. Without a GPU, cases for it are skipped.
    pub fn new(filter: Option<String>, layout: Layout, with_gpu: bool) -> Self {
        let gpu = if with_gpu { open_gpu() } else { None };
        match layout {
            Layout::Columns => println!(
                "{:<12} {:<58} {:<5} {:<6} {:>11} {:>11}  what",
                "stage", "case", "on", "", "error", "bound"
            ),
            Layout::Markdown => println!(
                "| stage | case | on | | error | bound | what |\n| --- | --- | --- | --- | --- | --- | --- |"
            ),
        }
        let all_required =
            with_gpu && std::env::var("KINLIGHT_REQUIRE_GPU").is_ok_and(|v| v == "1");
        Self { gpu, filter, layout, all_required, ..Self::default() }
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
                self.run_on_gpu(stage, name, &body);
            }
            On::Gpu => self.run_on_gpu(stage, name, &body),
        }
    }

    /// A device that a case has broken fails that case, and is opened anew for the next.
    fn run_on_gpu(&mut self, stage: &str, name: &str, body: &dyn Fn(Device<'_>) -> Outcome) {
        let Some(gpu) = self.gpu.take() else {
            self.row([stage, name, "gpu", "SKIPPED", "-", "-", "no graphics device"]);
            self.skipped += 1;
            return;
        };
        self.run(stage, name, "gpu", &|| {
            let found = body(Device::Gpu(&gpu))?;
            gpu.check().map_err(|error| format!("the device: {error}"))?;
            Ok(found)
        });
        self.gpu = if gpu.check().is_ok() { Some(gpu) } else { open_gpu() };
    }

    fn run(&mut self, stage: &str, name: &str, on: &str, body: &dyn Fn() -> Outcome) {
        let began = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(body)).unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Err(format!("panicked: {}", text.unwrap_or("without a word")))
        });
        let took_s = began.elapsed().as_secs_f64();
        let holds = outcome.as_ref().is_ok_and(Found::holds);
        let number = |v: f64| if v == 0.0 { "0".to_owned() } else { format!("{v:.3e}") };
        let (error, bound, what) = match &outcome {
            Ok(found) => (number(found.error), number(found.bound), found.what.as_str()),
            Err(why) => ("-".to_owned(), "-".to_owned(), why.as_str()),
        };
        // messages of several lines
        let what = what.split_whitespace().collect::<Vec<_>>().join(" ");
        let slow = if took_s > 5.0 { format!(" ({took_s:.0} s)") } else { String::new() };
        let verdict = if holds { "ok" } else { "FAILED" };
        self.row([stage, name, on, verdict, &error, &bound, &format!("{what}{slow}")]);
        match holds {
            true => self.passed += 1,
            false => self.failed.push(format!("{stage}: {name} ({on})")),
        }
    }

    fn row(&self, [stage, name, on, verdict, error, bound, what]: [&str; 7]) {
        match self.layout {
            Layout::Columns => println!(
                "{stage:<12} {name:<58} {on:<5} {verdict:<6} {error:>11} {bound:>11}  {what}"
            ),
            Layout::Markdown => {
                let cells = [stage, name, on, verdict, error, bound, what];
                println!("| {} |", cells.map(|cell| cell.replace('|', "\\|")).join(" | "));
            }
        }
    }

    /// Whether all is well: skipped cases are not where a device is asked for and required.
    pub fn finish(self) -> bool {
        println!();
        for failed in &self.failed {
            println!("failed: {failed}");
        }
        let Self { passed, skipped, all_required, .. } = self;
        println!("{passed} passed, {} failed, {skipped} skipped", self.failed.len());
        self.failed.is_empty() && passed > 0 && !(all_required && skipped > 0)
    }
}

fn open_gpu() -> Option<Arc<Gpu>> {
    let opened = Gpu::open(&AdapterChoice::Best);
    opened.inspect_err(|error| println!("no GPU: {error}")).ok().map(Arc::new)
}
