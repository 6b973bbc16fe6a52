//! Drivers, asked in processes of their own: one that crashes or hangs takes no one with it.
//!
//! The program runs itself with the words of a [`Question`]; that process calls [`answer`], which prints what
//! it is doing and at last what it found, a line of JSON each.

use super::process::{self, Ended, Finished};
use crate::capture::openni::{FoundDevice, LoadedLibrary, SensorDetail, probe};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

/// Begins each line of an answer: drivers print, too.
const MARK: &str = "kinlight-answer ";

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Question {
    /// Where OpenNI2 is loaded from.
    Library,
    /// Whether this file can be loaded as a driver.
    Driver(PathBuf),
    /// What OpenNI2 announces.
    Devices,
    /// What the device of this URI offers and gives.
    Device(String),
}

impl Question {
    /// As arguments of the process that answers.
    fn words(&self) -> Vec<OsString> {
        match self {
            Self::Library => vec!["library".into()],
            Self::Driver(path) => vec!["driver".into(), path.into()],
            Self::Devices => vec!["devices".into()],
            Self::Device(uri) => vec!["device".into(), uri.into()],
        }
    }

    pub fn parse(words: &[OsString]) -> Option<Self> {
        match (words.first()?.to_str()?, words.get(1), words.len()) {
            ("library", None, 1) => Some(Self::Library),
            ("devices", None, 1) => Some(Self::Devices),
            ("driver", Some(path), 2) => Some(Self::Driver(path.into())),
            ("device", Some(uri), 2) => Some(Self::Device(uri.to_str()?.to_owned())),
            _ => None,
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Line<T> {
    Doing(String),
    Found(T),
    Refused(String),
}

/// Answers in this process.
///
/// # Errors
/// The answer cannot be written.
pub fn answer(question: &Question, out: &mut dyn Write) -> std::io::Result<()> {
    match question {
        Question::Library => {
            say(out, &doing("loading OpenNI2"))?;
            tell(out, probe::library())
        }
        Question::Driver(path) => {
            say(out, &doing("loading the driver"))?;
            tell(out, probe::driver(path))
        }
        Question::Devices => {
            say(out, &doing("loading OpenNI2 and its drivers"))?;
            tell(out, probe::announced())
        }
        Question::Device(uri) => {
            let mut failed = Ok(());
            let found = probe::sensor(uri, &mut |what| {
                if failed.is_ok() {
                    failed = say(out, &doing(what));
                }
            });
            failed?;
            tell(out, found)
        }
    }
}

fn doing(what: &str) -> Line<()> {
    Line::Doing(what.to_owned())
}

fn tell<T: Serialize>(
    out: &mut dyn Write,
    found: Result<T, impl std::fmt::Display>,
) -> std::io::Result<()> {
    let line = match found {
        Ok(found) => Line::Found(found),
        Err(why) => Line::Refused(why.to_string()),
    };
    say(out, &line)
}

fn say<T: Serialize>(out: &mut dyn Write, line: &Line<T>) -> std::io::Result<()> {
    // On a line of its own, also where a driver has left one open.
    writeln!(out, "\n{MARK}{}", serde_json::to_string(line)?)?;
    out.flush()
}

/// Why there is no answer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failure {
    /// The answer is that it does not work.
    #[error("{0}")]
    Refused(String),
    #[error("it crashed ({signal}) while {doing}")]
    Crashed { signal: String, doing: String },
    #[error("it did not answer within {limit_s} s, while {doing}")]
    Silent { limit_s: f64, doing: String },
    #[error("{0}")]
    Broken(String),
}

/// Asks, each question in a process of its own.
#[derive(Clone, Debug)]
pub struct Prober {
    /// The program that answers, and its arguments before the words of a question.
    pub program: PathBuf,
    pub arguments: Vec<OsString>,
    /// For each question.
    pub limit: Duration,
}

impl Prober {
    pub(super) fn library(&self) -> Result<LoadedLibrary, Failure> {
        self.ask(&Question::Library)
    }

    pub(super) fn driver(&self, path: &Path) -> Result<(), Failure> {
        self.ask(&Question::Driver(path.to_owned()))
    }

    pub(super) fn announced(&self) -> Result<Vec<FoundDevice>, Failure> {
        self.ask(&Question::Devices)
    }

    pub(super) fn device(&self, uri: &str) -> Result<SensorDetail, Failure> {
        self.ask(&Question::Device(uri.to_owned()))
    }

    fn ask<T: DeserializeOwned>(&self, question: &Question) -> Result<T, Failure> {
        let mut command = Command::new(&self.program);
        command.args(&self.arguments).args(question.words());
        let finished = process::run(&mut command, self.limit).map_err(|error| {
            Failure::Broken(format!("{} cannot be started: {error}", self.program.display()))
        })?;
        self.understand(&finished)
    }

    /// What was found counts, however the process ended after it.
    fn understand<T: DeserializeOwned>(&self, finished: &Finished) -> Result<T, Failure> {
        let mut doing = "starting".to_owned();
        let lines = finished.lines().filter_map(|line| line.strip_prefix(MARK));
        for line in lines.filter_map(|line| serde_json::from_str::<Line<T>>(line).ok()) {
            match line {
                Line::Doing(what) => doing = what,
                Line::Found(found) => return Ok(found),
                Line::Refused(why) => return Err(Failure::Refused(why)),
            }
        }
        Err(match finished.ended {
            Ended::Signal(signal) => Failure::Crashed { signal: name(signal), doing },
            Ended::OutOfTime => Failure::Silent { limit_s: self.limit.as_secs_f64(), doing },
            Ended::Exited(code) => {
                let said = finished.last_error().unwrap_or_default();
                Failure::Broken(format!("it ended with code {code} while {doing}: {said}"))
            }
        })
    }
}

fn name(signal: i32) -> String {
    let name = match signal {
        4 => "SIGILL",
        6 => "SIGABRT",
        7 => "SIGBUS",
        8 => "SIGFPE",
        9 => "SIGKILL",
        11 => "SIGSEGV",
        other => return format!("signal {other}"),
    };
    name.to_owned()
}
