//! `runs.csv` and the tables of `summary.md`.

use super::record::{CompositeFrame, CompositeRun, CompositeStudy};
use super::variants::PRESET;
use std::fmt::Write;

/// A column of the tables.
struct Measure {
    name: &'static str,
    of: fn(&CompositeFrame) -> f64,
    decimals: usize,
}

const MEASURES: [Measure; 7] = [
    Measure { name: "PSNR dB", of: |f| f.psnr_db, decimals: 2 },
    Measure { name: "SSIM", of: |f| f.ssim, decimals: 4 },
    Measure { name: "FLIP", of: |f| f.flip, decimals: 4 },
    Measure { name: "change", of: |f| f.changed_rmse, decimals: 3 },
    Measure { name: "shadow", of: |f| f.shadow_found, decimals: 3 },
    Measure { name: "spill", of: |f| f.spill, decimals: 3 },
    Measure { name: "object", of: |f| f.object_rmse, decimals: 3 },
];

const LEGEND: &str = "change: relative RMSE of the change of light on real surfaces (1: as if nothing \
    had been composed); shadow: share of the true shadow's weight that is found; spill: change where \
    the truth has none, relative to its change; object: relative RMSE on the object's own pixels.\n";

/// One line a frame.
pub fn csv(study: &CompositeStudy) -> String {
    let mut out = String::from(
        "sequence,object,sensor_noise,preset,variant,changes,frame,psnr_db,ssim,flip,changed_rmse,\
         object_rmse,shadow_found,spill,noise_rmse,changed_pixels,light_deg,implied_albedo,update_ms\n",
    );
    for run in &study.runs {
        for f in &run.frames {
            let _ = writeln!(
                out,
                "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
                field(&run.sequence),
                field(&run.object),
                run.sensor_noise,
                run.preset,
                run.key,
                field(&run.changes.join(" ")),
                f.frame,
                f.psnr_db,
                f.ssim,
                f.flip,
                f.changed_rmse,
                f.object_rmse,
                f.shadow_found,
                f.spill,
                f.noise_rmse,
                f.changed_pixels,
                f.light_deg,
                f.implied_albedo,
                run.update_ms,
            );
        }
    }
    out
}

/// Text in quotes where it has to be.
fn field(text: &str) -> String {
    if text.contains([',', '"', '\n']) {
        return format!("\"{}\"", text.replace('"', "\"\""));
    }
    text.to_owned()
}

/// Markdown for pasting.
pub fn summary(study: &CompositeStudy) -> String {
    let mut out = String::from("# Composed frames against path-traced truth\n\n");
    let machine = &study.machine;
    let _ = writeln!(out, "{}, {} threads. `{}`\n", machine.cpu, machine.threads, study.command);
    out.push_str(LEGEND);
    out.push_str("\n## Presets\n\n");
    preset_table(&mut out, &study.runs);
    for preset in presets(&study.runs) {
        let _ = writeln!(out, "\n## Variants of {preset}\n");
        variant_table(&mut out, &study.runs, preset);
    }
    out
}

fn presets(runs: &[CompositeRun]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for run in runs {
        if !names.contains(&run.preset.as_str()) {
            names.push(&run.preset);
        }
    }
    names
}

fn heading(out: &mut String, first: &[&str]) {
    let names = first.iter().copied().chain(MEASURES.iter().map(|m| m.name));
    let names: Vec<&str> = names.chain(["ms"]).collect();
    let _ = writeln!(out, "| {} |", names.join(" | "));
    let rules = (0..names.len()).map(|i| if i < first.len() { "---" } else { "---:" });
    let _ = writeln!(out, "| {} |", rules.collect::<Vec<_>>().join(" | "));
}

fn preset_table(out: &mut String, runs: &[CompositeRun]) {
    heading(out, &["sequence", "object", "depth", "preset"]);
    for run in runs.iter().filter(|r| r.key == PRESET) {
        let depth = if run.sensor_noise { "Kinect" } else { "given" };
        let _ = write!(out, "| {} | {} | {depth} | {} |", run.sequence, run.object, run.preset);
        for m in &MEASURES {
            let _ = write!(out, " {} |", number(mean(run.frames.iter().map(m.of)), m.decimals));
        }
        let _ = writeln!(out, " {:.0} |", run.update_ms);
    }
    let all = |f: fn(&CompositeFrame) -> f64, preset: &str| {
        mean(
            runs.iter()
                .filter(|r| r.key == PRESET && r.preset == preset)
                .flat_map(|r| r.frames.iter().map(f)),
        )
    };
    for preset in presets(runs) {
        let _ = write!(out, "| **mean** | | | {preset} |");
        for m in &MEASURES {
            let _ = write!(out, " {} |", number(all(m.of, preset), m.decimals));
        }
        let times = runs.iter().filter(|r| r.key == PRESET && r.preset == preset);
        let _ = writeln!(out, " {} |", number(mean(times.map(|r| r.update_ms)), 0));
    }
}

/// The preset's means over the cases that variants were run on, and each variant's difference from them.
fn variant_table(out: &mut String, runs: &[CompositeRun], preset: &str) {
    let of_preset: Vec<&CompositeRun> = runs.iter().filter(|r| r.preset == preset).collect();
    let mut variants: Vec<&CompositeRun> = Vec::new();
    for run in of_preset.iter().filter(|r| r.key != PRESET) {
        if !variants.iter().any(|v| v.key == run.key) {
            variants.push(run);
        }
    }
    if variants.is_empty() {
        out.push_str("None were run.\n");
        return;
    }
    let base_of = |run: &CompositeRun| {
        of_preset.iter().copied().find(|b| b.key == PRESET && same_case(b, run))
    };
    heading(out, &["variant", "cases", "better"]);
    let with_variants =
        |b: &&&CompositeRun| of_preset.iter().any(|r| r.key != PRESET && same_case(r, b));
    let bases: Vec<&CompositeRun> =
        of_preset.iter().filter(|r| r.key == PRESET).filter(with_variants).copied().collect();
    let _ = write!(out, "| *{preset} itself* | {} | |", bases.len());
    for m in &MEASURES {
        let values = bases.iter().flat_map(|r| r.frames.iter().map(m.of));
        let _ = write!(out, " {} |", number(mean(values), m.decimals));
    }
    let _ = writeln!(out, " {} |", number(mean(bases.iter().map(|r| r.update_ms)), 0));
    for variant in variants {
        let pairs: Vec<(&CompositeRun, &CompositeRun)> = of_preset
            .iter()
            .filter(|r| r.key == variant.key)
            .filter_map(|r| Some((*r, base_of(r)?)))
            .collect();
        variant_row(out, &variant.variant, &pairs);
    }
    out.push_str("\nDifferences from the preset; better: cases whose change error is smaller.\n");
}

fn variant_row(out: &mut String, words: &str, pairs: &[(&CompositeRun, &CompositeRun)]) {
    let change = |run: &CompositeRun| mean(run.frames.iter().map(|f| f.changed_rmse));
    let better = pairs.iter().filter(|(run, base)| change(run) < change(base)).count();
    let _ = write!(out, "| {words} | {} | {better} |", pairs.len());
    for m in &MEASURES {
        let differences = pairs.iter().flat_map(|(run, base)| {
            run.frames.iter().zip(&base.frames).map(|(a, b)| (m.of)(a) - (m.of)(b))
        });
        let _ = write!(out, " {} |", signed(mean(differences), m.decimals));
    }
    let times = pairs.iter().map(|(run, base)| run.update_ms - base.update_ms);
    let _ = writeln!(out, " {} |", signed(mean(times), 0));
}

fn same_case(a: &CompositeRun, b: &CompositeRun) -> bool {
    (&a.folder, a.sensor_noise) == (&b.folder, b.sensor_noise)
}

/// Of the finite values; NaN where there is none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.filter(|v| v.is_finite()).fold((0.0, 0), |(sum, n), v| (sum + v, n + 1));
    if count == 0 { f64::NAN } else { sum / f64::from(count) }
}

fn number(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:.decimals$}") } else { "-".into() }
}

fn signed(value: f64, decimals: usize) -> String {
    if value.is_finite() { format!("{value:+.decimals$}") } else { "-".into() }
}
