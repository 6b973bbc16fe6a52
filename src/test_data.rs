//! Real data for tests: found through `KINLIGHT_DATA`, skipped visibly where it is not at hand.

use std::path::{Path, PathBuf};

/// A file or folder below `KINLIGHT_DATA` (default `../shared/data` beside the project).
pub fn real_data(name: &str) -> Option<PathBuf> {
    let root = std::env::var_os("KINLIGHT_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
        PathBuf::from,
    );
    let path = root.join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: no {name} below KINLIGHT_DATA or ../shared/data");
    None
}
