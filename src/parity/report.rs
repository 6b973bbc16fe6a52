//! What is said of a comparison: a table for people, and the same as JSON.

use super::ledger::{Found, Ledger};
use super::run::Summary;
use super::tolerances::{self, Limit, Tolerance};
use crate::config::Settings;
use crate::transfer::TransferMethod;
use serde::Serialize;
use std::fmt;

/// Both backends over the same frames.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// With its driver.
    pub adapter: String,
    /// It computes on the CPU, too.
    pub software: bool,
    pub frames: usize,
    /// Those at which stages were compared.
    pub stage_frames: Vec<usize>,
    /// Each stage with the CPU's input.
    pub stages: Vec<Row>,
    /// Each pipeline with its own results.
    pub run: Vec<Summary>,
    /// Nothing is out of tolerance.
    pub within: bool,
}

/// One result of a stage.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    pub stage: &'static str,
    pub quantity: &'static str,
    pub unit: &'static str,
    /// None where no frame came to it.
    pub found: Option<Found>,
    pub share_beyond: Option<f64>,
    pub limit: Limit,
    pub reason: &'static str,
    pub verdict: Verdict,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    Within,
    Beyond,
    /// No frame came to it.
    NotCompared,
}

impl Row {
    pub fn new(tolerance: &'static Tolerance, ledger: &Ledger) -> Self {
        let (limit, found) = (ledger.limit(tolerance), ledger.found(tolerance));
        let Tolerance { stage, quantity, unit, reason, .. } = *tolerance;
        let verdict = match found {
            None => Verdict::NotCompared,
            Some(found) if found.is_within(limit) => Verdict::Within,
            Some(_) => Verdict::Beyond,
        };
        let share_beyond = found.map(|found| found.share_beyond());
        Self { stage, quantity, unit, found, share_beyond, limit, reason, verdict }
    }
}

impl Report {
    pub fn new(
        gpu: &crate::gpu::Gpu,
        settings: &Settings,
        (frames, stage_frames): (usize, Vec<usize>),
        ledger: &Ledger,
        run: Vec<Summary>,
    ) -> Self {
        let wanted = tolerances::STAGES.into_iter().filter(|t| applies(t, settings));
        let stages: Vec<Row> = wanted.map(|tolerance| Row::new(tolerance, ledger)).collect();
        let within = stages.iter().all(|row| row.verdict != Verdict::Beyond)
            && run.iter().all(|summary| summary.within);
        Self {
            adapter: gpu.summary().to_string(),
            software: gpu.summary().is_software(),
            frames,
            stage_frames,
            stages,
            run,
            within,
        }
    }

    /// What is out of tolerance, by name.
    pub fn beyond(&self) -> Vec<String> {
        let rows = self.stages.iter().filter(|row| row.verdict == Verdict::Beyond);
        let stages = rows.map(|row| format!("{} {}", row.stage, row.quantity));
        let run = self.run.iter().filter(|summary| !summary.within);
        stages.chain(run.map(|summary| format!("run {}", summary.quantity))).collect()
    }
}

/// Whether these settings have this result at all.
fn applies(tolerance: &'static Tolerance, settings: &Settings) -> bool {
    use tolerances::*;
    let is = |other: &'static Tolerance| std::ptr::eq(tolerance, other);
    let traced = settings.transfer.method == TransferMethod::RayTraced;
    match tolerance {
        _ if is(&TRACED_TRANSFER) || is(&TRACED_MERGED_TRANSFER) => traced,
        _ if is(&TRANSFER) || is(&MERGED_TRANSFER) => !traced,
        _ if is(&EXITANT) || is(&BOUNCE) => settings.bounce.enabled,
        _ if is(&FUSION_COLOR) => settings.volume.color,
        _ => true,
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list: Vec<String> = self.stage_frames.iter().map(usize::to_string).collect();
        writeln!(f, "{}", self.adapter)?;
        writeln!(f, "\neach stage with the CPU's input, at frames {}", list.join(", "))?;
        writeln!(
            f,
            "{:<12} {:<21} {:<7} {:>9} {:>9} {:>6} {:>9} {:>9} {:>9}  {:<13} because of",
            "stage",
            "compared",
            "unit",
            "values",
            "largest",
            "at",
            "tolerance",
            "beyond",
            "allowed",
            ""
        )?;
        for row in &self.stages {
            writeln!(f, "{row}")?;
        }
        writeln!(f, "\neach pipeline with its own results, {} frames", self.frames)?;
        writeln!(
            f,
            "{:<21} {:<7} {:>7} {:>9} {:>9} {:>9} {:>6} {:>9} {:>7}",
            "compared", "unit", "frames", "median", "mean", "largest", "at", "allowed", "beyond"
        )?;
        for summary in &self.run {
            writeln!(f, "{summary}")?;
        }
        match self.beyond() {
            beyond if beyond.is_empty() => write!(f, "\nall within tolerance"),
            beyond => write!(f, "\nOUT OF TOLERANCE: {}", beyond.join(", ")),
        }
    }
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { stage, quantity, unit, limit, reason, .. } = self;
        write!(f, "{stage:<12} {quantity:<21} {unit:<7} ")?;
        match self.found {
            Some(found) => {
                write!(f, "{:>9} {:>9} ", found.values, number(found.largest))?;
                let frame = if found.largest > 0.0 { found.frame.to_string() } else { "-".into() };
                write!(f, "{frame:>6} ")?;
                write!(f, "{:>9} {:>9} ", number(limit.largest), percent(found.share_beyond()))?;
            }
            None => {
                write!(f, "{:>9} {:>9} {:>6} ", "-", "-", "-")?;
                write!(f, "{:>9} {:>9} ", number(limit.largest), "-")?;
            }
        }
        let verdict = match self.verdict {
            Verdict::Within => "within",
            Verdict::Beyond => "BEYOND",
            Verdict::NotCompared => "not compared",
        };
        write!(f, "{:>9}  {verdict:<13} {reason}", percent(limit.share))
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<21} {:<7} {:>7} ", self.quantity, self.unit, self.frames)?;
        let [median, mean, largest] = [self.median, self.mean, self.largest].map(number);
        write!(f, "{median:>9} {mean:>9} {largest:>9} {:>6} ", self.frame)?;
        let verdict = if self.within { "within" } else { "BEYOND" };
        write!(f, "{:>9} {:>7}  {verdict}", number(self.tolerance), self.beyond)
    }
}

fn number(value: f64) -> String {
    match value {
        0.0 => "0".to_owned(),
        value if (1e-2..1e5).contains(&value) => format!("{value:.3}"),
        value => format!("{value:.1e}"),
    }
}

fn percent(share: f64) -> String {
    match 100.0 * share {
        0.0 => "0 %".to_owned(),
        percent if percent < 1e-2 => format!("{percent:.0e} %"),
        percent => format!("{percent:.2} %"),
    }
}

/// JSON has no infinity.
pub(super) fn finite_or_text<S: serde::Serializer>(value: &f64, to: S) -> Result<S::Ok, S::Error> {
    if value.is_finite() { to.serialize_f64(*value) } else { to.serialize_str("infinite") }
}
