//! Video devices of the kernel, V4L2.

use super::machine::{attribute, entries, file_name};
use super::{Machine, Problem};
use serde::Serialize;
use std::io::ErrorKind;
use std::path::PathBuf;

/// `/dev/videoN`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct VideoNode {
    pub path: PathBuf,
    pub name: Option<String>,
    /// Why it cannot be opened, where it cannot.
    pub error: Option<String>,
    #[serde(skip)]
    denied: bool,
}

/// Every node that the kernel knows, by number. What each offers is asked where it is opened as a camera.
pub(super) fn find(machine: &Machine) -> Vec<VideoNode> {
    let known = entries(&machine.sys.join("class/video4linux"));
    let number = |name: &str| name.strip_prefix("video")?.parse::<u32>().ok();
    let mut nodes: Vec<_> = known
        .iter()
        .filter_map(|folder| {
            let name = file_name(folder);
            let (number, path) = (number(&name)?, machine.dev.join(&name));
            let error = (machine.open)(&path).err();
            let node = VideoNode {
                path,
                name: attribute(folder, "name"),
                denied: error.as_ref().is_some_and(|e| e.kind() == ErrorKind::PermissionDenied),
                error: error.map(|e| e.to_string()),
            };
            Some((number, node))
        })
        .collect();
    nodes.sort_by_key(|(number, _)| *number);
    nodes.into_iter().map(|(_, node)| node).collect()
}

pub(super) fn problems(nodes: &[VideoNode]) -> Vec<Problem> {
    let problem = |node: &VideoNode| {
        let fix = if node.denied {
            "add yourself to the group video (`sudo usermod -aG video $USER`) and log in again"
        } else {
            "close other programs that use it, and in a container pass the device on to it"
        };
        let (path, error) = (node.path.display(), node.error.as_ref()?);
        Some(Problem::new(format!("{path} cannot be opened ({error})"), fix))
    };
    nodes.iter().filter_map(problem).collect()
}
