//! What this machine has of what kinlight can use, and what to do where something is in the way.
//!
//! Graphics devices have a diagnosis of their own, in `gpu::diagnosis`.

mod known;
mod machine;
mod openni;
mod optional;
mod probe;
mod process;
#[cfg(test)]
mod tests;
mod usb;
mod video_nodes;

pub use known::{Driver, Part};
pub use machine::Machine;
pub use openni::{DriverFile, Fate, OpenniReport, SensorReport};
pub use optional::{Optional, features, optional};
pub use probe::{Failure, Prober, Question, answer};
pub use usb::UsbCamera;
pub use video_nodes::VideoNode;

use serde::Serialize;

/// Something that keeps a camera from working, and what to do about it, one sentence each.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    pub what: String,
    pub fix: String,
}

impl Problem {
    fn new(what: impl Into<String>, fix: impl Into<String>) -> Self {
        Self { what: what.into(), fix: fix.into() }
    }
}

/// All about cameras.
#[derive(Clone, Debug, Serialize)]
pub struct CameraReport {
    pub openni: OpenniReport,
    /// Depth cameras by their USB ids, and their parts; only those that are known to us.
    pub usb: Vec<UsbCamera>,
    pub video_nodes: Vec<VideoNode>,
    #[serde(skip)]
    pub problems: Vec<Problem>,
}

/// Looks at everything. Code of drivers runs in processes of `prober`'s, each for a limited time.
pub fn cameras(machine: &Machine, prober: &Prober) -> CameraReport {
    let openni = OpenniReport::of(prober);
    let usb = usb::find(machine);
    let video_nodes = video_nodes::find(machine);
    let mut problems = openni.problems();
    problems.extend(usb::problems(&usb, machine, &openni));
    problems.extend(video_nodes::problems(&video_nodes));
    problems.extend(unannounced(&usb, &openni, &problems));
    CameraReport { openni, usb, video_nodes, problems }
}

/// A device for `--device`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct UsableDevice {
    pub device: String,
    pub vendor: String,
    pub name: String,
}

/// What `--device` takes here, recordings aside.
///
/// # Errors
/// OpenNI2 cannot be loaded, crashes or does not answer.
pub fn devices(prober: &Prober) -> Result<Vec<UsableDevice>, Failure> {
    let announced = prober.announced()?.into_iter();
    let usable = announced.map(|found| UsableDevice {
        device: format!("openni:{}", found.uri),
        vendor: found.vendor,
        name: found.name,
    });
    Ok(usable.collect())
}

/// A camera that is plugged in and that OpenNI2 does not see, where nothing else explains it.
fn unannounced(usb: &[UsbCamera], openni: &OpenniReport, explained: &[Problem]) -> Option<Problem> {
    let camera = usb.iter().find(|c| c.part == Part::Depth)?;
    (openni.announces_nothing() && explained.is_empty()).then(|| {
        Problem::new(
            format!("{camera} is plugged in, and OpenNI2 announces no device"),
            "unplug it, wait a moment and plug it in again, with its own power supply where it has one",
        )
    })
}
