//! `kinlight doctor`: what this machine has, and what keeps a camera from working.

mod cameras;
#[cfg(feature = "gpu")]
mod graphics;

use super::Talk;
use super::error::CliError;
use super::live::parse_time;
use clap::Args;
use kinlight::diagnosis::{self, Machine, Optional, Prober, Question, answer};
use serde_json::{Value, json};
use std::ffi::OsString;
use std::time::Duration;

/// Say which graphics devices and cameras there are, what they can do, and what to do about those that do
/// not work.
///
/// Drivers of cameras are loaded and opened in processes of their own: one that crashes or hangs is reported.
#[derive(Debug, Args)]
pub struct DoctorArgs {
    /// Look at the adapter whose name or driver contains this, and at nothing else.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "NAME", conflicts_with = "devices")]
    adapter: Option<String>,
    /// Only list what --device takes here, one a line.
    #[arg(long)]
    devices: bool,
    /// Drivers of cameras that do not answer for this long are given up.
    #[arg(long, value_name = "15s", value_parser = parse_time, default_value = "15s")]
    patience: Duration,
}

/// Answer one question about drivers, for doctor.
#[derive(Debug, Args)]
pub struct ProbeArgs {
    #[arg(required = true)]
    question: Vec<OsString>,
}

/// Name of that command.
pub const PROBE: &str = "doctor-probe";

pub fn run(args: &DoctorArgs, talk: Talk) -> Result<(), CliError> {
    let prober = Prober {
        program: std::env::current_exe().map_err(|error| {
            CliError::Run(format!("where this program is cannot be found out: {error}"))
        })?,
        arguments: vec![PROBE.into()],
        limit: args.patience,
    };
    if args.devices {
        return list_devices(&prober, talk);
    }
    let mut result = graphics(args, talk)?;
    #[cfg(feature = "gpu")]
    if args.adapter.is_some() {
        talk.result(&result);
        return Ok(());
    }
    let report = diagnosis::cameras(&Machine::this(), &prober);
    talk.say(cameras::describe(&report));
    let optional = diagnosis::optional(args.patience);
    talk.say(describe_optional(&optional));
    for (i, problem) in report.problems.iter().enumerate() {
        talk.say(format_args!("{}. {}\n   -> {}", i + 1, problem.what, problem.fix));
    }
    talk.say(match report.problems.len() {
        0 => "no problems".to_owned(),
        1 => "1 problem".to_owned(),
        n => format!("{n} problems"),
    });
    result["cameras"] = json!(report);
    result["optional"] = json!(optional);
    let features = diagnosis::features().into_iter();
    result["features"] = features.map(|(name, on)| (name, Value::from(on))).collect::<Value>();
    result["problems"] = json!(report.problems);
    talk.result(&result);
    Ok(())
}

pub fn probe(args: &ProbeArgs) -> Result<(), CliError> {
    let question = Question::parse(&args.question)
        .ok_or_else(|| CliError::Usage(format!("{:?} is no question", args.question)))?;
    answer(&question, &mut std::io::stdout()).map_err(|e| CliError::Output(e.to_string()))
}

#[cfg(feature = "gpu")]
fn graphics(args: &DoctorArgs, talk: Talk) -> Result<Value, CliError> {
    graphics::look(args.adapter.as_deref(), talk)
}

#[cfg(not(feature = "gpu"))]
fn graphics(_args: &DoctorArgs, _talk: Talk) -> Result<Value, CliError> {
    Ok(json!({}))
}

fn list_devices(prober: &Prober, talk: Talk) -> Result<(), CliError> {
    let devices = diagnosis::devices(prober)
        .map_err(|failure| CliError::Device(format!("{failure} (`kinlight doctor` says more)")))?;
    if devices.is_empty() {
        log::warn!("no camera is there (`kinlight doctor` says what to look at)");
    }
    for device in &devices {
        talk.say(&device.device);
    }
    talk.result(&json!({ "devices": devices }));
    Ok(())
}

fn describe_optional(optional: &[Optional]) -> String {
    let mut text = "optional\n".to_owned();
    for Optional { program, version, used_for, install } in optional {
        text += &match version {
            Some(version) => format!("  {program}: {version}\n"),
            None => format!("  {program}: missing; {used_for} needs it: {install}\n"),
        };
    }
    let features = diagnosis::features();
    let named = |wanted: bool| {
        let names: Vec<_> =
            features.iter().filter(|(_, on)| *on == wanted).map(|(n, _)| *n).collect();
        if names.is_empty() { "none".to_owned() } else { names.join(", ") }
    };
    text + &format!("  features of this build: {}; without: {}", named(true), named(false))
}
