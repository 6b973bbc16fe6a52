//! Where the system says what is plugged in.

use std::io;
use std::path::{Path, PathBuf};

/// The system's folders, and how a device file is tried.
#[derive(Clone, Debug)]
pub struct Machine {
    /// `/sys`, `/dev` and `/proc`.
    pub sys: PathBuf,
    pub dev: PathBuf,
    pub proc: PathBuf,
    /// Opens a file for reading and writing, and closes it.
    pub open: fn(&Path) -> io::Result<()>,
}

impl Machine {
    /// The one that this runs on.
    pub fn this() -> Self {
        let open =
            |path: &Path| std::fs::OpenOptions::new().read(true).write(true).open(path).map(drop);
        Self { sys: "/sys".into(), dev: "/dev".into(), proc: "/proc".into(), open }
    }

    /// Names in the folder of kernel modules that are loaded.
    pub(super) fn has_module(&self, name: &str) -> bool {
        let modules = std::fs::read_to_string(self.proc.join("modules")).unwrap_or_default();
        modules.lines().any(|line| line.split_whitespace().next() == Some(name))
    }
}

/// What one of the small files of sysfs holds; `None` where it is not there.
pub(super) fn attribute(folder: &Path, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(folder.join(name)).ok()?;
    Some(text.trim().to_owned()).filter(|text| !text.is_empty())
}

/// Entries of a folder by name; none where there is no such folder.
pub(super) fn entries(folder: &Path) -> Vec<PathBuf> {
    let all = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut paths: Vec<_> = all.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
