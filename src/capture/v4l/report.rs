//! What cameras there are, and what each can do.

use super::error;
use super::modes::{self, Offered, Wanted};
use super::node::{Identity, Node};
use crate::capture::live::DeviceError;
use crate::capture::pixel_formats::PixelFormat;
use serde::Serialize;
use std::fmt;
use std::path::{Path, PathBuf};
use v4l::v4l_sys as sys;

/// A device node of V4L2.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodeReport {
    pub path: PathBuf,
    /// What it says it is; empty where it cannot be opened.
    pub card: String,
    pub driver: String,
    pub bus: String,
    pub formats: Vec<FormatReport>,
    /// Why it is of no use as a colour camera, and what to do.
    pub problem: Option<String>,
}

/// A format that a node offers.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormatReport {
    /// Its four letters.
    pub fourcc: String,
    /// Its name by the driver.
    pub name: String,
    /// Whether kinlight reads it.
    pub is_read: bool,
    /// Each with its rates.
    pub sizes: Vec<String>,
}

/// Every node `/dev/videoN`, in order.
pub fn nodes() -> Vec<NodeReport> {
    paths(Path::new("/dev")).iter().map(|path| look(path).0).collect()
}

/// Nodes by their numbers.
fn paths(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let number = |path: &Path| -> Option<u32> {
        path.file_name()?.to_str()?.strip_prefix("video")?.parse().ok()
    };
    let mut found: Vec<_> = entries
        .filter_map(|entry| {
            let path = entry.ok()?.path();
            Some((number(&path)?, path))
        })
        .collect();
    found.sort();
    found.into_iter().map(|(_, path)| path).collect()
}

fn look(path: &Path) -> (NodeReport, Result<Identity, DeviceError>) {
    let mut report = NodeReport {
        path: path.to_owned(),
        card: String::new(),
        driver: String::new(),
        bus: String::new(),
        formats: Vec::new(),
        problem: None,
    };
    let found = look_into(path, &mut report);
    report.problem = found.as_ref().err().map(ToString::to_string);
    (report, found)
}

fn look_into(path: &Path, report: &mut NodeReport) -> Result<Identity, DeviceError> {
    let explain = |doing: &'static str| move |e| error::explain(path, doing, &e);
    let unsupported = |why: String| DeviceError::Unsupported(format!("{}: {why}", path.display()));
    let node = Node::open(path).map_err(explain("opening"))?;
    let (identity, flags) = node.capabilities().map_err(explain("asking what it is"))?;
    report.card.clone_from(&identity.card);
    report.driver.clone_from(&identity.driver);
    report.bus.clone_from(&identity.bus);
    check(flags).map_err(unsupported)?;
    let wanted = Wanted::new(None, None);
    let offered = node.offers(wanted.size).map_err(explain("asking for its formats"))?;
    report.formats = offered.iter().map(format_report).collect();
    modes::ranked(&offered, &PixelFormat::ALL, &wanted).map_err(unsupported)?;
    Ok(identity)
}

fn format_report(offered: &Offered) -> FormatReport {
    FormatReport {
        fourcc: String::from_utf8_lossy(&offered.fourcc).into_owned(),
        name: offered.name.clone(),
        is_read: PixelFormat::from_fourcc(offered.fourcc).is_some(),
        sizes: offered.sizes.iter().map(modes::in_words).collect(),
    }
}

/// Whether a node with these capabilities gives pictures that can be streamed.
pub fn check(flags: u32) -> Result<(), String> {
    let has = |flag| flags & flag != 0;
    if has(sys::V4L2_CAP_VIDEO_CAPTURE) {
        return match has(sys::V4L2_CAP_STREAMING) {
            true => Ok(()),
            false => Err("it gives pictures only to read(), not to streaming".into()),
        };
    }
    let what = if has(sys::V4L2_CAP_META_CAPTURE) {
        "a node for metadata; the camera's pictures come from the one before it"
    } else if has(sys::V4L2_CAP_VIDEO_CAPTURE_MPLANE) {
        "a node whose pictures lie in several planes, which are not read"
    } else if has(sys::V4L2_CAP_VIDEO_OUTPUT | sys::V4L2_CAP_VIDEO_OUTPUT_MPLANE) {
        "a node for output"
    } else {
        "a node without pictures"
    };
    Err(format!("it is {what}"))
}

/// The first node that is of use. Of a camera that is known, that camera's: where it was, or at another plug.
pub fn first(known: Option<&Identity>) -> Result<PathBuf, DeviceError> {
    let (mut refused, mut moved) = (None, None);
    for path in paths(Path::new("/dev")) {
        match (look(&path).1, known) {
            (Ok(_), None) => return Ok(path),
            (Ok(identity), Some(known)) if identity == *known => return Ok(path),
            (Ok(identity), Some(known)) if identity.card == known.card => {
                moved.get_or_insert(path);
            }
            (Ok(_), Some(_)) => {}
            (Err(error @ DeviceError::Busy(_)), _) => refused = Some(error),
            (Err(error), _) => log::debug!("no colour camera: {error}"),
        }
    }
    moved.ok_or_else(|| {
        refused.unwrap_or_else(|| match known {
            Some(known) => DeviceError::Absent(format!("the camera {} is not there", known.card)),
            None => DeviceError::Absent(
                "there is no V4L2 camera: no /dev/videoN gives pictures (is it plugged in, and is its \
                 driver loaded, uvcvideo for most?)"
                    .into(),
            ),
        })
    })
}

impl fmt::Display for NodeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if !self.card.is_empty() {
            write!(f, ": {} ({}, {})", self.card, self.driver, self.bus)?;
        }
        for format in &self.formats {
            let read = if format.is_read { "" } else { " (not read)" };
            write!(f, "\n  {} {}{read}: {}", format.fourcc, format.name, format.sizes.join(", "))?;
        }
        match &self.problem {
            Some(problem) => write!(f, "\n  {problem}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_nodes_that_stream_pictures_pass() {
        const STREAMING: u32 = sys::V4L2_CAP_STREAMING;
        let said = |flags| check(flags).err().unwrap_or_default();
        assert_eq!(said(sys::V4L2_CAP_VIDEO_CAPTURE | STREAMING), "");
        assert!(said(sys::V4L2_CAP_VIDEO_CAPTURE).contains("read()"));
        assert!(said(sys::V4L2_CAP_META_CAPTURE | STREAMING).contains("metadata"));
        assert!(said(sys::V4L2_CAP_VIDEO_CAPTURE_MPLANE | STREAMING).contains("planes"));
        assert!(said(sys::V4L2_CAP_VIDEO_OUTPUT | STREAMING).contains("output"));
        assert!(said(STREAMING).contains("without pictures"));
    }

    #[test]
    fn nodes_are_found_by_their_numbers_alone() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["video10", "video2", "video", "videoX", "video-1", "v4l", "video0"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let found = paths(folder.path());
        let names: Vec<_> = found.iter().map(|p| p.file_name().unwrap()).collect();
        assert_eq!(names, ["video0", "video2", "video10"]);
        assert!(paths(&folder.path().join("none")).is_empty());
        // Files are no cameras, and said to be none.
        let (report, found) = look(&found[0]);
        assert!(matches!(found, Err(DeviceError::Unsupported(_))), "{found:?}");
        let said = report.to_string();
        assert!(said.ends_with("video0 is no V4L2 device"), "{said}");
    }
}
