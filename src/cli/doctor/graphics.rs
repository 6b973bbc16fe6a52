//! The graphics devices of this machine.

use crate::cli::Talk;
use crate::cli::error::CliError;
use kinlight::gpu::AdapterChoice;
use kinlight::gpu::diagnosis::{AdapterReport, Verdict, diagnose};

/// Says what there is, and gives it as JSON.
pub fn look(adapter: Option<&str>, talk: Talk) -> Result<serde_json::Value, CliError> {
    let choice = adapter.map_or(AdapterChoice::Best, |name| AdapterChoice::Named(name.to_owned()));
    let (reports, verdict) = diagnose(&choice).map_err(|e| CliError::Usage(e.to_string()))?;
    for report in &reports {
        talk.say(describe(report));
    }
    let taken = verdict.adapter.as_deref().unwrap_or("the CPU backend");
    talk.say(format!("would be taken: {taken}, because {}", verdict.because));
    Ok(as_json(&reports, &verdict))
}

fn describe(report: &AdapterReport) -> String {
    let mut text = format!("{}\n", report.summary);
    let (there, missing) = report.features();
    let list = |names: &[&str]| match names {
        [] => "none".to_owned(),
        names => names.join(", "),
    };
    text += &format!("  optional features: {}; missing: {}\n", list(&there), list(&missing));
    for (name, value) in report.limits() {
        text += &format!("  {name}: {value}\n");
    }
    for (name, has, needed) in &report.short_of {
        text += &format!("  falls short of WebGPU's {name}: {has} of {needed}\n");
    }
    match &report.opens {
        None => text += "  was not opened",
        Some(Ok(())) => text += "  opens with WebGPU's default limits",
        Some(Err(error)) => text += &format!("  does not open: {error}"),
    }
    text
}

fn as_json(reports: &[AdapterReport], verdict: &Verdict) -> serde_json::Value {
    let adapters: Vec<_> = reports
        .iter()
        .map(|report| {
            serde_json::json!({
                "name": report.summary.name,
                "api": report.summary.api,
                "driver": report.summary.driver,
                "software": report.summary.is_software(),
                "features": report.features().0,
                "limits": report.limits().into_iter().collect::<std::collections::BTreeMap<_, _>>(),
                "short_of": report.short_of.iter().map(|(name, ..)| name).collect::<Vec<_>>(),
                "error": report.opens.as_ref().and_then(|o| o.as_ref().err()).map(ToString::to_string),
            })
        })
        .collect();
    serde_json::json!({
        "adapters": adapters,
        "taken": verdict.adapter,
        "because": verdict.because,
    })
}
